//! The configurations that ship.

/// Configurations that ship with the program.
pub const BUILTIN: &[(&str, &str)] = &[
    ("digits", include_str!("../../configs/digits.toml")),
    ("digits-hedge", include_str!("../../configs/digits-hedge.toml")),
    ("digits-rbm", include_str!("../../configs/digits-rbm.toml")),
    ("digits-partial", include_str!("../../configs/digits-partial.toml")),
    ("digits-multi", include_str!("../../configs/digits-multi.toml")),
    ("digits-closeup", include_str!("../../configs/digits-closeup.toml")),
    ("digits-pool", include_str!("../../configs/digits-pool.toml")),
    ("natural", include_str!("../../configs/natural.toml")),
    ("natural-committee", NATURAL_COMMITTEE),
    ("multi", include_str!("../../configs/multi.toml")),
    ("multi-motion", include_str!("../../configs/multi-motion.toml")),
    ("multi-boxes", include_str!("../../configs/multi-boxes.toml")),
    ("natural-fast", include_str!("../../configs/natural-fast.toml")),
    ("natural-middle", include_str!("../../configs/natural-middle.toml")),
    ("foveated", include_str!("../../configs/foveated.toml")),
    ("narrow", include_str!("../../configs/narrow.toml")),
    ("natural-raw", include_str!("../../configs/natural-raw.toml")),
    ("natural-learned", include_str!("../../configs/natural-learned.toml")),
];

/// The configurations in the order in which lists offer them: groups by purpose, each with names and titles. What serves another
/// configuration alone (`natural-middle`) is in no group.
pub const OFFERED: &[(&str, &[(&str, &str)])] = &[
    (
        "Real video",
        &[
            ("natural", "any target"),
            ("natural-fast", "any target, fast"),
            ("natural-committee", "any target, accurate: three trackers vote"),
            ("natural-learned", "any target, by learned features"),
            ("natural-raw", "any target, by raw pixels: a baseline"),
        ],
    ),
    (
        "Real video, seen in part",
        &[
            ("narrow", "a small window that learns where to look"),
            ("foveated", "a sensor that reads at most 244 values a plane"),
        ],
    ),
    (
        "Many targets",
        &[
            ("multi", "people and cars, with a detector"),
            ("multi-motion", "people and cars, found by motion"),
            ("multi-boxes", "targets whose first boxes are given"),
            ("digits-multi", "digits that grow, turn and cross"),
        ],
    ),
    (
        "Digits",
        &[
            ("digits", "digits among digits, fixed centre"),
            ("digits-hedge", "digits among digits, Hedge"),
            ("digits-rbm", "digits among digits, learned features"),
            ("digits-partial", "a digit behind bars, in noise"),
            ("digits-closeup", "a large digit through a small window"),
            ("digits-pool", "a large digit through nine windows"),
        ],
    ),
];

const NATURAL_COMMITTEE: &str = concat!(
    "# Real video: three `natural` trackers with different seeds that vote.\n",
    "committee = 3\n",
    include_str!("../../configs/natural.toml")
);

/// Returns the purpose of a configuration: the first sentence of its text.
pub fn about(text: &str) -> &str {
    let line = text.lines().find_map(|line| line.strip_prefix('#')).unwrap_or("").trim();
    let end = line.find(". ").unwrap_or(line.len());
    line[..end].trim_end_matches(['.', ':', ','])
}

#[cfg(test)]
mod offered {
    use super::{BUILTIN, OFFERED};

    /// Each configuration is offered once; only one that another takes as its second opinion is not.
    #[test]
    fn every_configuration_is_offered_once() {
        let offered: Vec<&str> = OFFERED.iter().flat_map(|(_, some)| some.iter().map(|(name, _)| *name)).collect();
        for (name, _) in BUILTIN {
            let serves = BUILTIN.iter().any(|(_, text)| text.contains(&format!("second_opinion = \"builtin:{name}\"")));
            assert_eq!(offered.iter().filter(|other| *other == name).count(), usize::from(!serves), "{name}");
        }
        assert!(offered.iter().all(|name| BUILTIN.iter().any(|(other, _)| other == name)), "{offered:?}");
        assert!(OFFERED[0].1[0].0 == "natural" && OFFERED.last().is_some_and(|(group, _)| group.starts_with("Digits")));
    }
}

#[cfg(all(test, feature = "learn"))]
mod tests {
    use crate::config::Config;
    use foveate_base::files::Folder;

    #[test]
    fn other_learned_features_are_a_setting_away() {
        let learned = Config::builtin("natural-learned").expect("it ships").expect("it is right");
        let changed = ["encoder.kind=kmeans", "likelihood.sharpness=60"];
        let config = changed.iter().try_fold(learned, |config, setting| config.set(setting));
        config.and_then(|config| config.check(&Folder::here())).expect("the filters suit every retina");
    }
}
