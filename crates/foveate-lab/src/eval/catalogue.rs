//! The half, the source and the attributes of each sequence.
//!
//! Settings are chosen on one half and tested on the other; the test is valid only if no source is in both. `catalogue.csv` lists the
//! halves of known sequences, with its rule; a file `halves.txt` beside other sequences lists theirs. The half of any other sequence is a
//! hash of its source.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use foveate_base::{Error, Result, files};
use foveate_core::geometry::BBox;
use serde::{Deserialize, Serialize};

use super::attributes::{Attribute, computed};

/// One of the two halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
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
    /// Returns the half of this letter.
    fn of(letter: &str) -> Option<Self> {
        Self::BOTH.into_iter().find(|half| half.name() == letter)
    }
}

/// The source of a sequence, its half, and the kind of its target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// The source video or series. For a sequence that is not listed: its name, without the `-2` of a second target.
    pub source: String,
    /// The half: the listed one, or else one from a hash of the source (FNV-1a; the parity of its bits).
    pub half: Half,
    /// The kind of target, such as `person`; `None` if the sequence is not listed.
    pub kind: Option<String>,
}

/// A line of the list.
struct Entry {
    sequence: &'static str,
    origin: Origin,
    labels: Vec<Attribute>,
}

static LIST: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let lines = include_str!("catalogue.csv").lines().filter(|line| !line.starts_with('#')).skip(1);
    lines.map(|line| entry(line).unwrap_or_else(|| panic!("catalogue.csv ships with the program: {line}"))).collect()
});

fn entry(line: &'static str) -> Option<Entry> {
    let mut cells = line.split(',').map(str::trim);
    let (sequence, source) = (cells.next()?, cells.next()?);
    let half = Half::of(cells.next()?)?;
    let kind = Some(cells.nth(1)?.to_owned());
    let label = |name: &str| Attribute::ALL.into_iter().find(|a| a.name() == name && !a.is_computed());
    let labels = cells.next()?.split(';').map(|name| label(name.trim())).collect::<Option<_>>()?;
    Some(Entry { sequence, origin: Origin { source: source.into(), half, kind }, labels })
}

/// Returns the entry of a sequence, or of the sequence that it is a part of (`-from-120`: bench/variants.py).
fn listed(sequence: &str) -> Option<&'static Entry> {
    let named = |name: &str| LIST.iter().find(|entry| entry.sequence == name);
    let later = || sequence.rsplit_once("-from-").filter(|(_, frame)| frame.bytes().all(|c| c.is_ascii_digit()));
    named(sequence).or_else(|| named(later()?.0))
}

/// Returns the origin of a sequence by its name: that of `catalogue.csv`, or else one from a hash of its source.
pub fn origin(sequence: &str) -> Origin {
    let target = |(video, n): (_, &str)| (!n.is_empty() && n.bytes().all(|c| c.is_ascii_digit())).then_some(video);
    let unlisted = || {
        let source = sequence.rsplit_once('-').and_then(target).unwrap_or(sequence);
        let mix = |h: u64, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        let even = source.bytes().fold(0xcbf2_9ce4_8422_2325, mix).count_ones() % 2 == 0;
        Origin { source: source.into(), half: if even { Half::A } else { Half::B }, kind: None }
    };
    listed(sequence).map_or_else(unlisted, |entry| entry.origin.clone())
}

/// Reads the file `halves.txt` of a folder of sequences: half, name, kind and source of one in each line, separated by spaces; `#` begins a
/// comment. Returns the origins by name; none without such a file.
///
/// # Errors
/// The file cannot be read, a line does not have this form, or a source is in both halves.
pub(super) fn of_folder(folder: &Path) -> Result<BTreeMap<String, Origin>> {
    let path = folder.join("halves.txt");
    if !path.is_file() {
        return Ok(BTreeMap::new());
    }
    let text = files::read_text(&path, files::TEXT)?;
    let (mut found, mut halves) = (BTreeMap::new(), BTreeMap::new());
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.starts_with('#') && !line.trim().is_empty()) {
        let wrong = |problem: String| Error::malformed(&path, format!("line {}: {problem}", i + 1));
        let cells: Vec<&str> = line.split_whitespace().collect();
        let half = cells.first().and_then(|letter| Half::of(letter));
        let (&[_, name, kind, source], Some(half)) = (&cells[..], half) else {
            return Err(wrong(format!("expected half (a or b), name, kind and source, found {line:?}")));
        };
        if *halves.entry(source).or_insert(half) != half {
            return Err(wrong(format!("the source {source} is in both halves; expected each source in one")));
        }
        found.insert(name.to_owned(), Origin { source: source.into(), half, kind: Some(kind.into()) });
    }
    Ok(found)
}

/// Returns the attributes of a sequence with these true boxes, in the order of tables: the listed labels, and those computed from the boxes.
pub fn attributes(sequence: &str, truth: &[Option<BBox>]) -> Vec<Attribute> {
    let mut found = computed(truth);
    found.extend(listed(sequence).iter().flat_map(|entry| &entry.labels));
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
            let Origin { source, half, .. } = &e.origin;
            assert_eq!(halves.entry(source).or_insert(*half), half, "{source}");
            assert_eq!(origin(e.sequence), e.origin);
        }
        let count = |half| LIST.iter().filter(|e| e.origin.half == half).count();
        assert_eq!((LIST.len(), halves.len(), count(Half::A), count(Half::B)), (35, 30, 18, 17));
        assert_eq!(["Car1-from-90", "Car1-from-x"].map(|name| origin(name).source), ["Car", "Car1-from-x"]);
        for same in [["Jogging", "Jogging-2"], ["Bolt", "Bolt2"], ["UavWakeboard4", "UavWakeboard10"]] {
            assert_eq!(origin(same[0]).source, origin(same[1]).source);
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
            assert!(
                LIST.iter().filter(|e| e.origin.source == *name).all(|e| e.origin.half == dealt),
                "{name} is number {i}"
            );
        }
    }

    #[test]
    fn unknown_sequences_have_a_stable_half_of_their_video() {
        assert_eq!(["street", "street-2", "a-b"].map(|name| origin(name).source), ["street", "street", "a-b"]);
        assert_eq!(origin("street"), origin("street-2"));
        // Parity of FNV-1a by hand: the hash of no byte is the offset basis, with an even number of bits.
        assert_eq!((origin("").half, 0xcbf2_9ce4_8422_2325u64.count_ones() % 2), (Half::A, 0));
        let names: Vec<String> = (0..400).map(|i| format!("video{i}")).collect();
        let a = names.iter().filter(|name| origin(name).half == Half::A).count();
        assert!((150..=250).contains(&a), "{a} of 400 names: a fair coin leaves this once in two million");
    }

    #[test]
    fn a_folder_lists_its_halves() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let read = |text: &str| {
            std::fs::write(dir.path().join("halves.txt"), text).expect("written");
            of_folder(dir.path())
        };
        let found = read("# half name kind source\nb Dog animal walk\n\nb Cat animal walk\na Car vehicle road\n")
            .expect("three");
        let dog = Origin { source: "walk".into(), half: Half::B, kind: Some("animal".into()) };
        assert_eq!((found.len(), &found["Dog"], found["Car"].half), (3, &dog, Half::A));
        for (text, said) in
            [("c Dog animal walk", "line 1"), ("#\na Dog animal", "line 2"), ("a A x s\nb B x s", "both halves")]
        {
            let problem = read(text).expect_err(text).to_string();
            assert!(problem.contains(said) && problem.contains("halves.txt"), "{problem}");
        }
        std::fs::remove_file(dir.path().join("halves.txt")).expect("removed");
        assert!(of_folder(dir.path()).expect("none").is_empty());
    }

    #[test]
    fn attributes_come_from_labels_and_boxes() {
        let truth = [Some(BBox { x: 0.0, y: 0.0, w: 10.0, h: 10.0 }); 3];
        let (d, l) = (Attribute::Deformation, Attribute::LookAlikes);
        assert_eq!(attributes("Bolt2", &truth), [d, Attribute::LowResolution, l, Attribute::CameraMotion]);
        assert_eq!(attributes("unheard of", &truth), [Attribute::LowResolution]);
    }
}
