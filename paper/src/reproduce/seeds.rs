//! Seeds of videos and trackers: `10` stands for 1 to 10, `11..=20` and `11..21` for 11 to 20.

use std::str::FromStr;

use serde::Deserialize;

/// Consecutive seeds; at least one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(try_from = "Written")]
pub(super) struct Seeds {
    pub first: u64,
    /// Number of seeds.
    pub count: u64,
}

/// Seeds in a file.
#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Count(u64),
    Text(String),
}

impl Seeds {
    /// Returns the seeds from 1 to `last`.
    pub(super) fn up_to(last: u64) -> Self {
        Self { first: 1, count: last }
    }
    pub(super) fn last(self) -> u64 {
        self.first + (self.count - 1)
    }
    pub(super) fn iter(self) -> std::ops::RangeInclusive<u64> {
        self.first..=self.last()
    }
}

impl FromStr for Seeds {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let number = |word: &str| word.trim().parse::<u64>().ok();
        let read = || match text.split_once("..") {
            None => Some((1, number(text)?.checked_add(1)?)),
            Some((first, last)) => match last.strip_prefix('=') {
                Some(last) => Some((number(first)?, number(last)?.checked_add(1)?)),
                None => Some((number(first)?, number(last)?)),
            },
        };
        let seeds = read().and_then(|(first, end)| Some(Self { first, count: end.checked_sub(first)? }));
        seeds.filter(|seeds| (1..=10_000).contains(&seeds.count)).ok_or_else(|| {
            format!("expected 1 to 10000 seeds, as their number, such as 10, or a range, such as 11..=20; got {text}")
        })
    }
}

impl TryFrom<Written> for Seeds {
    type Error = String;
    fn try_from(written: Written) -> Result<Self, String> {
        match written {
            Written::Count(count) => count.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_ranges_of_seeds() {
        for (text, first, count) in [("3", 1, 3), ("11..=20", 11, 10), ("11..21", 11, 10), ("0..1", 0, 1)] {
            let seeds: Seeds = text.parse().expect(text);
            assert_eq!((seeds.first, seeds.count, seeds.iter().count() as u64), (first, count, count), "{text}");
        }
        for wrong in ["0", "5..5", "6..=5", "a..b", "1..", "10001", "-1", "0..=18446744073709551615"] {
            assert!(wrong.parse::<Seeds>().is_err_and(|e| e.contains("1 to 10000")), "{wrong}");
        }
        assert_eq!(Seeds::try_from(Written::Text("2..=4".into())), Ok(Seeds { first: 2, count: 3 }));
    }
}
