//! Keys that had another name before version 0.1: a configuration that still has one is told the new name.

/// Old and new names. Where a key was only renamed within one section, that section's name comes before the dot.
const RENAMED: [(&str, &str); 22] = [
    ("guide", "camera_motion"),
    ("vigilance", "consistency"),
    ("rivals", "distractors"),
    ("sighting", "detection_likelihood"),
    ("search", "redetection"),
    ("walls", "clamp_to_frame"),
    ("many", "multi_target"),
    ("birth", "multi_target.initiation"),
    ("death", "multi_target.termination"),
    ("memory", "multi_target.reidentification"),
    ("leaps", "dynamics.tail_probability"),
    ("leap", "dynamics.tail_scale"),
    ("share", "discriminant.mixing_weight"),
    ("rate", "discriminant.learning_rate"),
    ("first", "discriminant.first_frame_weight"),
    ("surprise", "discriminant.gate"),
    ("blur", "confidence.localisation_noise"),
    ("likeness", "multi_target.reidentification.similarity"),
    ("dim_familiar", "likelihood.background_discount"),
    ("aspect", ""),
    ("pace", ""),
    ("middle", ""),
];

/// What an error of the parser should say beside its own words, where the key it stumbled over had another name.
pub(super) fn hint(error: &str) -> String {
    let Some(key) = error.split("unknown field `").nth(1).and_then(|rest| rest.split('`').next()) else {
        return String::new();
    };
    // Of a key that means something else elsewhere, only where the new one would do.
    let fits =
        |new: &str| new.is_empty() || new.rsplit('.').next().is_some_and(|last| error.contains(&format!("`{last}`")));
    match RENAMED.iter().find(|(old, new)| *old == key && fits(new)) {
        Some((old, "")) => format!("\n`{old}` is no longer there: it did not pay; leave it out"),
        Some((old, new)) => format!("\n`{old}` is now called `{new}`"),
        None => String::new(),
    }
}
