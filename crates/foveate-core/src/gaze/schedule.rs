//! The learning rate of a bandit in each frame: the theorems' rates, or a fixed number.

use foveate_base::{Error, Result};
use serde::de::{Deserializer, Error as _, IgnoredAny, MapAccess, Visitor};
use serde::ser::{SerializeMap, Serializer};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A rate γₜ in frame t, from 1. In configurations `0.5`, `{ frames = 300 }` or `"anytime"`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Schedule {
    /// Always this, above 0.
    Fixed(f64),
    /// Always the rate with the best bound over this many frames, at least 1.
    Frames(u64),
    /// Falling as 1/√t: a bound for every number of frames, with a slightly larger constant.
    Anytime,
}

impl Schedule {
    /// Checks that a fixed rate is from 10⁻⁹ to `most`, and frames are 1 to 10⁹.
    ///
    /// # Errors
    /// If a number is out of range; the error names the `key`.
    pub fn check(self, key: &str, most: f64) -> Result<()> {
        match self {
            Self::Fixed(rate) if !(1e-9..=most).contains(&rate) => {
                Err(Error::Config(format!("{key} is a number from 1e-9 to {most}; it is {rate}")))
            }
            Self::Frames(frames) if !(1..=1_000_000_000).contains(&frames) => {
                Err(Error::Config(format!("{key} is for 1 to 1000000000 frames; frames is {frames}")))
            }
            _ => Ok(()),
        }
    }
    /// Returns the rate in frame `t`: theory gives √(`known` / T) for T frames and √(`anytime` / t) for any number.
    pub(super) fn rate(self, t: u64, known: f64, anytime: f64) -> f64 {
        match self {
            Self::Fixed(rate) => rate,
            Self::Frames(frames) => (known / frames as f64).sqrt(),
            Self::Anytime => (anytime / t as f64).sqrt(),
        }
    }
}

impl From<f64> for Schedule {
    fn from(rate: f64) -> Self {
        Self::Fixed(rate)
    }
}

impl Serialize for Schedule {
    fn serialize<S: Serializer>(&self, s: S) -> std::result::Result<S::Ok, S::Error> {
        match *self {
            Self::Fixed(rate) => s.serialize_f64(rate),
            Self::Anytime => s.serialize_str("anytime"),
            Self::Frames(frames) => {
                let mut map = s.serialize_map(Some(1))?;
                map.serialize_entry("frames", &frames)?;
                map.end()
            }
        }
    }
}

impl<'de> Deserialize<'de> for Schedule {
    fn deserialize<D: Deserializer<'de>>(d: D) -> std::result::Result<Self, D::Error> {
        struct Spelling;
        impl<'de> Visitor<'de> for Spelling {
            type Value = Schedule;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a rate as a number, \"anytime\", or for example { frames = 300 }")
            }
            fn visit_f64<E>(self, rate: f64) -> std::result::Result<Schedule, E> {
                Ok(Schedule::Fixed(rate))
            }
            fn visit_i64<E>(self, rate: i64) -> std::result::Result<Schedule, E> {
                Ok(Schedule::Fixed(rate as f64))
            }
            fn visit_u64<E>(self, rate: u64) -> std::result::Result<Schedule, E> {
                Ok(Schedule::Fixed(rate as f64))
            }
            fn visit_str<E: serde::de::Error>(self, word: &str) -> std::result::Result<Schedule, E> {
                match word {
                    "anytime" => Ok(Schedule::Anytime),
                    _ => Err(E::invalid_value(serde::de::Unexpected::Str(word), &self)),
                }
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Schedule, A::Error> {
                match map.next_key::<String>()?.as_deref() {
                    Some("frames") => {}
                    Some(key) => return Err(A::Error::unknown_field(key, &["frames"])),
                    None => return Err(A::Error::missing_field("frames")),
                }
                let frames = map.next_value()?;
                match map.next_key::<String>()? {
                    None => Ok(Schedule::Frames(frames)),
                    Some(key) => {
                        map.next_value::<IgnoredAny>()?;
                        Err(A::Error::unknown_field(&key, &["frames"]))
                    }
                }
            }
        }
        d.deserialize_any(Spelling)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_have_three_spellings() {
        for (text, schedule) in [
            ("0.5", Schedule::Fixed(0.5)),
            ("5", Schedule::Fixed(5.0)),
            ("\"anytime\"", Schedule::Anytime),
            ("{\"frames\":300}", Schedule::Frames(300)),
        ] {
            let read: Schedule = serde_json::from_str(text).expect(text);
            assert_eq!(read, schedule);
            let again = serde_json::to_string(&read).expect("plain data");
            assert_eq!(serde_json::from_str::<Schedule>(&again).expect(text), schedule);
        }
        for (text, words) in [
            ("\"anytme\"", "\"anytime\", or for example { frames = 300 }"),
            ("true", "a rate as a number"),
            ("{}", "missing field `frames`"),
            ("{\"frame\": 1}", "unknown field `frame`"),
            ("{\"frames\": 1, \"more\": 2}", "unknown field `more`"),
            ("{\"frames\": -1}", "-1"),
        ] {
            let error = serde_json::from_str::<Schedule>(text).expect_err(text).to_string();
            assert!(error.contains(words), "{text}: {error}");
        }
    }

    #[test]
    fn rates_are_checked_and_fall() {
        for wrong in [Schedule::Fixed(f64::NAN), Schedule::Fixed(0.0), Schedule::Fixed(2.0), Schedule::Frames(0)] {
            assert!(wrong.check("policy.gamma", 1.0).expect_err("out of range").to_string().contains("policy.gamma"));
        }
        assert!(Schedule::Anytime.check("policy.gamma", 1.0).is_ok());
        assert_eq!(Schedule::Fixed(0.3).rate(7, 1.0, 1.0), 0.3);
        assert_eq!(Schedule::Frames(25).rate(7, 4.0, 1.0), 0.4);
        assert_eq!(Schedule::Anytime.rate(25, 1.0, 9.0), 0.6);
    }
}
