//! The half, the source and the attributes of each sequence.
//!
//! Settings are chosen on one half and tested on the other; the test is valid only if no source is in both. `catalogue.csv` lists the
//! halves of known sequences, with its rule; the half of any other sequence is a hash of its source.

use std::sync::LazyLock;

use serde::Serialize;

use super::Sequence;
use super::attributes::{Attribute, computed};

/// One of the two halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Half {
    /// The first.
    A,
    /// The second.
    B,
}

impl Half {
    /// Both halves.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];
    /// Returns the other half.
    pub fn other(self) -> Self {
        if self == Self::A { Self::B } else { Self::A }
    }
    /// Returns its letter, lower case.
    pub fn name(self) -> &'static str {
        if self == Self::A { "a" } else { "b" }
    }
}

/// A line of the list.
struct Entry {
    sequence: &'static str,
    source: &'static str,
    half: Half,
    labels: Vec<Attribute>,
}

static LIST: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let lines = include_str!("catalogue.csv").lines().filter(|line| !line.starts_with('#')).skip(1);
    lines.map(|line| entry(line).unwrap_or_else(|| panic!("catalogue.csv ships with the program: {line}"))).collect()
});

fn entry(line: &'static str) -> Option<Entry> {
    let mut cells = line.split(',').map(str::trim);
    let (sequence, source) = (cells.next()?, cells.next()?);
    let half = match cells.next()? {
        "a" => Half::A,
        "b" => Half::B,
        _ => return None,
    };
    let label = |name: &str| Attribute::ALL.into_iter().find(|a| a.name() == name && !a.is_computed());
    let labels = cells.nth(1)?.split(';').map(|name| label(name.trim())).collect::<Option<_>>()?;
    Some(Entry { sequence, source, half, labels })
}

/// Returns the entry of a sequence, or of the sequence that it is a part of (`-from-120`: bench/variants.py).
fn listed(sequence: &str) -> Option<&'static Entry> {
    let named = |name: &str| LIST.iter().find(|entry| entry.sequence == name);
    let later = || sequence.rsplit_once("-from-").filter(|(_, frame)| frame.bytes().all(|c| c.is_ascii_digit()));
    named(sequence).or_else(|| named(later()?.0))
}

/// Returns the source video or series of a sequence. For a sequence that is not listed: its name, without the `-2` of a second target.
pub fn source(sequence: &str) -> &str {
    let target = |(video, n): (_, &str)| (!n.is_empty() && n.bytes().all(|c| c.is_ascii_digit())).then_some(video);
    let unlisted = || sequence.rsplit_once('-').and_then(target).unwrap_or(sequence);
    listed(sequence).map_or_else(unlisted, |entry| entry.source)
}

/// Returns whether a sequence is listed: the halves of other sequences matter only to `foveate eval --choose`.
pub fn is_listed(sequence: &str) -> bool {
    listed(sequence).is_some()
}

/// Returns the half of a sequence: the listed one, or else one from a hash of its source (FNV-1a; the parity of its bits).
pub fn half(sequence: &str) -> Half {
    let hash = |name: &str| {
        name.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    };
    let unlisted = || if hash(source(sequence)).count_ones() % 2 == 0 { Half::A } else { Half::B };
    listed(sequence).map_or_else(unlisted, |entry| entry.half)
}

/// Returns the attributes of a sequence, in the order of tables: the listed labels, and those computed from its true boxes.
pub fn attributes(sequence: &Sequence) -> Vec<Attribute> {
    let mut found = computed(&sequence.truth);
    found.extend(listed(&sequence.name).iter().flat_map(|entry| &entry.labels));
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn no_source_is_in_both_halves() {
        let mut halves: BTreeMap<&str, Half> = BTreeMap::new();
        for e in LIST.iter() {
            assert_eq!(*halves.entry(e.source).or_insert(e.half), e.half, "{}", e.source);
            assert_eq!((source(e.sequence), half(e.sequence)), (e.source, e.half));
        }
        let count = |half| LIST.iter().filter(|e| e.half == half).count();
        assert_eq!((LIST.len(), halves.len(), count(Half::A), count(Half::B)), (35, 30, 18, 17));
        assert_eq!(["Car1-from-90", "Car1-from-x"].map(source), ["Car", "Car1-from-x"]);
        for same in [["Jogging", "Jogging-2"], ["Bolt", "Bolt2"], ["UavWakeboard4", "UavWakeboard10"]] {
            assert_eq!(source(same[0]), source(same[1]));
        }
    }

    /// Applies the rule stated in the list again.
    #[test]
    fn sources_are_dealt_by_difficulty() {
        let mut sources: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
        let lines: Vec<&str> = include_str!("catalogue.csv").lines().filter(|line| !line.starts_with('#')).collect();
        for cells in lines[1..].iter().map(|line| line.split(',').collect::<Vec<_>>()) {
            sources.entry(cells[1]).or_default().push(cells[3].parse().expect("a number"));
        }
        let mean = |v: &Vec<f64>| v.iter().sum::<f64>() / v.len() as f64;
        let mut order: Vec<(&str, f64)> = sources.iter().map(|(name, v)| (*name, mean(v))).collect();
        order.sort_by(|a, b| a.1.total_cmp(&b.1));
        for (i, (name, _)) in order.iter().enumerate() {
            let dealt = [Half::A, Half::B, Half::B, Half::A][i % 4];
            assert!(LIST.iter().filter(|e| e.source == *name).all(|e| e.half == dealt), "{name} is number {i}");
        }
    }

    #[test]
    fn unknown_sequences_have_a_stable_half_of_their_video() {
        assert_eq!((source("street"), source("street-2"), source("a-b")), ("street", "street", "a-b"));
        assert_eq!(half("street"), half("street-2"));
        // Parity of FNV-1a by hand: the hash of no byte is the offset basis, with an even number of bits.
        assert_eq!((half(""), 0xcbf2_9ce4_8422_2325u64.count_ones() % 2), (Half::A, 0));
        let names: Vec<String> = (0..400).map(|i| format!("video{i}")).collect();
        let a = names.iter().filter(|name| half(name) == Half::A).count();
        assert!((150..=250).contains(&a), "{a} of 400 names: a fair coin leaves this once in two million");
    }

    #[test]
    fn attributes_come_from_labels_and_boxes() {
        let b = foveate_core::geometry::BBox { x: 0.0, y: 0.0, w: 10.0, h: 10.0 };
        let (images, truth_file) = ("nowhere".into(), "nowhere".into());
        let mut sequence = Sequence { name: "Bolt2".into(), images, truth_file, truth: vec![Some(b); 3] };
        let (d, l) = (Attribute::Deformation, Attribute::LookAlikes);
        assert_eq!(attributes(&sequence), [d, Attribute::LowResolution, l, Attribute::CameraMotion]);
        sequence.name = "unheard of".into();
        assert_eq!(attributes(&sequence), [Attribute::LowResolution]);
    }
}
