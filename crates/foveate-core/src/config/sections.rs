//! Sections of a configuration that name a component of the library or a registered one.

use std::cell::RefCell;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{DeserializeSeed, Deserializer, Error as _, MapAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use super::encoders::EncoderConfig;
use super::kinds::{DETECTORS, ENCODERS, POLICIES, PROPOSALS, REWARDS};
use super::own::OwnPart;
use super::parts::Parts;
use super::policies::PolicyConfig;
use super::proposals::{DetectorConfig, ProposalConfig};
use super::rewards::RewardConfig;
use crate::tree::{Entry, Node, Problem, Value};

/// A section that names a component by its `kind`.
trait Section: Sized {
    const NAME: &'static str;
    /// The kinds of the library.
    const BUILTIN: &'static [&'static str];
    /// Reads a section of a kind of the library.
    fn builtin(section: &Node) -> Result<Self, Problem>;
    /// A section of a registered kind.
    fn own(part: OwnPart) -> Self;
}

thread_local! {
    /// The components of the configuration that is being read: serde hands no context to the types that it reads.
    static PARTS: RefCell<Parts> = RefCell::default();
}

/// Reads a configuration whose sections may name these components.
pub(super) fn reading<T>(parts: &Parts, read: impl FnOnce() -> T) -> T {
    struct Restore(Parts);
    impl Drop for Restore {
        fn drop(&mut self) {
            PARTS.set(std::mem::take(&mut self.0));
        }
    }
    let _restore = Restore(PARTS.replace(parts.clone()));
    read()
}

/// The components of the configuration that is being read.
pub(super) fn parts() -> Parts {
    PARTS.with_borrow(Parts::clone)
}

/// Reads a section. The error of an unknown kind has the place of the kind, and lists all kinds.
fn deserialize<'de, D: Deserializer<'de>, T: Section>(d: D) -> Result<T, D::Error> {
    d.deserialize_map(Whole(PhantomData))
}

struct Whole<T>(PhantomData<T>);

impl<'de, T: Section> Visitor<'de> for Whole<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a section with `kind`")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<T, A::Error> {
        let (mut kind, mut settings) = (None, vec![]);
        while let Some(key) = map.next_key::<String>()? {
            if key == "kind" {
                kind = Some(map.next_value_seed(Kind::<T>(PhantomData))?);
            } else {
                settings.push(Entry::new(key, map.next_value::<Node>()?));
            }
        }
        let kind = kind.ok_or_else(|| A::Error::missing_field("kind"))?;
        if !T::BUILTIN.contains(&&*kind) {
            return Ok(T::own(OwnPart::new(kind, settings)));
        }
        settings.push(Entry::new("kind", Value::Text(kind)));
        T::builtin(&Value::Section(settings).into()).map_err(|e| A::Error::custom(e.message()))
    }
}

/// Reads a kind that there is.
struct Kind<T>(PhantomData<T>);

impl<'de, T: Section> DeserializeSeed<'de> for Kind<T> {
    type Value = String;
    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<String, D::Error> {
        d.deserialize_str(self)
    }
}

impl<T: Section> Visitor<'_> for Kind<T> {
    type Value = String;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the name of a part")
    }

    fn visit_str<E: serde::de::Error>(self, kind: &str) -> Result<String, E> {
        let parts = parts();
        let registered = parts.names(T::NAME);
        if T::BUILTIN.contains(&kind) || registered.contains(&kind) {
            return Ok(kind.into());
        }
        let all: Vec<String> = T::BUILTIN.iter().chain(&registered).map(|kind| format!("`{kind}`")).collect();
        let expected = match &all[..] {
            [] => "a part that the program registers; it registers none".into(),
            all => format!("one of {}", all.join(", ")),
        };
        Err(E::custom(format!("unknown kind `{kind}`, expected {expected}")))
    }
}

/// For enums that derive serde's traits with `remote = "Self"` and skip a variant `Own`: a registered component is read as `Own`.
macro_rules! sections {
    ($($section:ident: $name:literal, $builtin:ident;)*) => {$(
        impl Section for $section {
            const NAME: &'static str = $name;
            const BUILTIN: &'static [&'static str] = &$builtin;
            fn builtin(section: &Node) -> Result<Self, Problem> {
                $section::deserialize(section)
            }
            fn own(part: OwnPart) -> Self {
                Self::Own(part)
            }
        }
        impl<'de> Deserialize<'de> for $section {
            fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                deserialize(d)
            }
        }
        impl Serialize for $section {
            fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
                match self {
                    Self::Own(part) => part.serialize(s),
                    builtin => $section::serialize(builtin, s),
                }
            }
        }
    )*};
}

sections! {
    PolicyConfig: "policy", POLICIES;
    EncoderConfig: "encoder", ENCODERS;
    ProposalConfig: "proposal", PROPOSALS;
    DetectorConfig: "detector", DETECTORS;
    RewardConfig: "reward", REWARDS;
}

/// An observation model: the library has none by name.
impl Section for OwnPart {
    const NAME: &'static str = "observation_model";
    const BUILTIN: &'static [&'static str] = &[];
    fn builtin(_: &Node) -> Result<Self, Problem> {
        unreachable!("the library has none")
    }
    fn own(part: OwnPart) -> Self {
        part
    }
}

impl<'de> Deserialize<'de> for OwnPart {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        deserialize(d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The error of serde for an unknown variant lists the known ones.
    #[test]
    fn all_kinds_of_the_library_are_listed() {
        fn listed<T: Section>() {
            let unknown = Value::Section(vec![Entry::new("kind", Value::Text("?".into()))]);
            let error = T::builtin(&unknown.into()).err().expect("no such kind").message().to_owned();
            let (_, found) = error.split_once("expected one of ").or(error.split_once("expected ")).expect("a list");
            let found = found.replace(" or ", ", ");
            let kinds: Vec<&str> = found.split(", ").map(|kind| kind.trim_matches('`')).collect();
            assert_eq!(kinds, T::BUILTIN, "{}", T::NAME);
        }
        listed::<PolicyConfig>();
        listed::<EncoderConfig>();
        listed::<ProposalConfig>();
        listed::<DetectorConfig>();
        listed::<RewardConfig>();
    }
}
