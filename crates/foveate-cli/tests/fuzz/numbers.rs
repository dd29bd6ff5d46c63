//! Saved states with one changed number: still JSON, so that the code after reading is reached.

use serde_json::{Value, json};

/// Valid and invalid numbers of a state.
pub(crate) fn odd() -> [Value; 9] {
    [
        json!(-1),
        json!(0),
        json!(1),
        json!(-25.0),
        json!(63.9),
        json!(1e-300),
        json!(9e11),
        json!(1e300),
        json!(u64::MAX),
    ]
}

/// Where the numbers of a state are; of an array the first two and the last.
pub(crate) fn places(state: &Value, at: &str, found: &mut Vec<String>) {
    match state {
        Value::Number(_) => found.push(at.into()),
        Value::Object(map) => map.iter().for_each(|(key, value)| places(value, &format!("{at}/{key}"), found)),
        Value::Array(all) => {
            let few = (0..all.len()).filter(|k| *k < 2 || k + 1 == all.len());
            few.for_each(|k| places(&all[k], &format!("{at}/{k}"), found));
        }
        _ => (),
    }
}
