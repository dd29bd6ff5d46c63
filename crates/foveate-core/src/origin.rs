//! The origin of a saved tracker: a state resumes bit for bit only in a tracker with the same origin.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// The seed, the number of the target, and the configurations of the tracker, its second tracker, and so on. A tracker of parts that a
/// program combined itself has no configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Origin {
    pub seed: u64,
    pub target: u64,
    pub configurations: Vec<Value>,
}

/// Maximum number of differences that an error lists; the others are counted.
const LISTED: usize = 4;
/// Maximum number of characters of a value in an error.
const SHOWN: usize = 40;

impl Origin {
    /// Creates the origin of a tracker of parts that a program combined itself.
    pub(crate) fn by_hand(seed: u64) -> Self {
        Self { seed, target: 0, configurations: vec![] }
    }

    /// Compares with a saved origin. The error lists the differences.
    pub(crate) fn check(&self, saved: &Self) -> Result<(), String> {
        let mut all = vec![];
        let numbers = [("seed", saved.seed, self.seed), ("target", saved.target, self.target)];
        all.extend(
            numbers.iter().filter(|(_, saved, ours)| saved != ours).map(|(key, saved, ours)| say(key, saved, ours)),
        );
        for k in 0..saved.configurations.len().max(self.configurations.len()) {
            let [saved, ours] = [saved, self].map(|origin| origin.configurations.get(k).unwrap_or(&Value::Null));
            // The seed in use is compared above.
            let name = "second_opinion: ".repeat(k);
            differences(&name, saved, ours, &mut |key| key != "seed", &mut all);
        }
        if all.is_empty() {
            return Ok(());
        }
        let more = all.len().saturating_sub(LISTED);
        all.truncate(LISTED);
        let more = if more > 0 { format!(", and {more} more") } else { String::new() };
        Err(format!(
            "it was saved with other settings: {}{more}; make the tracker with the settings that the state was saved with",
            all.join(", ")
        ))
    }
}

fn say(key: &str, saved: impl std::fmt::Display, ours: impl std::fmt::Display) -> String {
    format!("{key} is {saved} in the state and {ours} in this tracker")
}

/// Formats a value for an error.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "not set".into(),
        Value::Object(_) => "set".into(),
        other => {
            let text = other.to_string();
            if text.chars().count() <= SHOWN { text } else { text.chars().take(SHOWN).collect::<String>() + "..." }
        }
    }
}

/// Appends the keys under `at` whose values differ, as text. An unset key is `Null`.
fn differences(at: &str, saved: &Value, ours: &Value, counts: &mut dyn FnMut(&str) -> bool, all: &mut Vec<String>) {
    if saved == ours {
        return;
    }
    let (Value::Object(a), Value::Object(b)) = (saved, ours) else {
        let at = if at.is_empty() { "the configuration" } else { at.trim_end_matches([':', ' ', '.']) };
        all.push(say(at, shown(saved), shown(ours)));
        return;
    };
    for key in a.keys().chain(b.keys()).collect::<BTreeSet<_>>().into_iter().filter(|key| counts(key)) {
        let [a, b] = [a, b].map(|table| table.get(key).unwrap_or(&Value::Null));
        let end = if a.is_object() && b.is_object() { "." } else { "" };
        differences(&format!("{at}{key}{end}"), a, b, &mut |_| true, all);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn differences_are_named() {
        let origin =
            |seed, configurations: &[Value]| Origin { seed, target: 0, configurations: configurations.to_vec() };
        let ours = origin(1, &[json!({"seed": 1, "particles": 400, "policy": {"kind": "fixed", "u": 0.0}})]);
        assert_eq!(ours.check(&ours.clone()), Ok(()));
        // The seed in the file differs from the seed in use.
        assert_eq!(
            ours.check(&origin(1, &[json!({"seed": 9, "particles": 400, "policy": {"kind": "fixed", "u": 0.0}})])),
            Ok(())
        );
        let said = |saved: Origin| ours.check(&saved).expect_err("another one");
        let other =
            said(origin(2, &[json!({"seed": 1, "particles": 100, "policy": {"kind": "hedge"}, "colour": {"a": 1}})]));
        for words in [
            "seed is 2 in the state and 1 in this tracker",
            "particles is 100 in the state and 400 in this tracker",
            "policy.kind is \"hedge\" in the state and \"fixed\" in this tracker",
            "colour is set in the state and not set in this tracker",
            "and 1 more",
        ] {
            assert!(other.contains(words), "{other}");
        }
        assert!(said(origin(1, &[])).contains("the configuration is not set in the state and set in this tracker"));
        let pair = said(origin(1, &[ours.configurations[0].clone(), json!({"particles": 3})]));
        assert!(pair.contains("second_opinion is set in the state and not set in this tracker"), "{pair}");
    }
}
