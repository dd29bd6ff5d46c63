//! Settings from TOML, and one of them changed by its key, as a command line has it: `policy.kind=hedge`.

use super::Config;
use super::sections::reading;
use crate::tree::{Entry, Node, Value};
use foveate_base::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Reads settings from TOML; `name` stands for the text in errors.
pub fn parse<T: DeserializeOwned>(text: &str, name: &str) -> Result<T> {
    let wrong = |problem: String| Error::Config(format!("{name}: {}", Config::problem(&problem)));
    Node::parse(text).map_err(wrong)?.read().map_err(|problem| wrong(problem.shown(text)))
}

/// The same with one setting changed: `setting` is `key=value`, the key with dots, the value as TOML has it, or a bare word
/// for a string. Another `kind` of a part begins with that kind's defaults. `none` leaves the key out, as a file that
/// does not have it.
///
/// # Errors
/// [`Error::Config`] where it has no `=`, the key is none, or the value does not fit.
pub fn changed<T: Serialize + DeserializeOwned>(settings: &T, setting: &str) -> Result<T> {
    // A position in generated text does not help the user.
    let read = |whole: Node| whole.read().map_err(|problem| wrong(setting, &Config::problem(problem.message())));
    change(Node::of(settings), setting).and_then(read)
}

fn wrong(setting: &str, why: &str) -> Error {
    Error::Config(format!("{setting}: {why}"))
}

fn change(mut whole: Node, setting: &str) -> Result<Node> {
    let wrong = |why: &str| wrong(setting, why);
    let (key, text) = setting
        .split_once('=')
        .map(|(key, text)| (key.trim(), text.trim()))
        .filter(|(key, text)| !key.is_empty() && !text.is_empty())
        .ok_or_else(|| wrong("expected key=value, for example particles=400 or policy.kind=hedge"))?;
    let value = match Node::parse(&format!("value = {text}")) {
        Ok(mut section) => section.entries().expect("a document").remove(0).node,
        Err(_) if text.chars().all(|c| c.is_alphanumeric() || "-_:./".contains(c)) => Value::Text(text.into()).into(),
        Err(e) => return Err(wrong(&e)),
    };
    let (path, last) = key.rsplit_once('.').unwrap_or(("", key));
    let mut section = whole.entries().expect("settings are a section");
    for part in path.split('.').filter(|part| !part.is_empty()) {
        let inner = entry(section, part, || Value::Section(vec![]));
        section = inner.entries().ok_or_else(|| wrong(&format!("{part} is a value, not a section")))?;
    }
    if last == "kind" && !section.contains(&Entry::new("kind", value.clone())) {
        section.clear();
    }
    if value.value == Value::Text("none".into()) {
        let at = section.iter().position(|entry| entry.key == last && entry.node.value != Value::Null);
        section.remove(at.ok_or_else(|| wrong("there is none to leave out"))?);
    } else {
        *entry(section, last, || Value::Null) = value;
        // One of two.
        let other = match key {
            "likelihood.sharpness" => "calibrate",
            "likelihood.calibrate" => "sharpness",
            _ => return Ok(whole),
        };
        section.retain(|entry| entry.key != other);
    }
    Ok(whole)
}

/// Returns the value of a key; if there is none, `value` becomes it.
fn entry<'a>(section: &'a mut Vec<Entry>, key: &str, value: fn() -> Value) -> &'a mut Node {
    let at = section.iter().position(|entry| entry.key == key).unwrap_or_else(|| {
        section.push(Entry::new(key, Value::Null));
        section.len() - 1
    });
    let node = &mut section[at].node;
    if node.value == Value::Null {
        node.value = value();
    }
    node
}

impl Config {
    /// The same with one setting changed, see [`changed`].
    ///
    /// # Errors
    /// As [`changed`].
    pub fn set(&self, setting: &str) -> Result<Self> {
        reading(&self.parts, || changed(self, setting))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_changed_by_its_key() {
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        let fewer = natural.set("particles=400").expect("a number");
        assert_eq!(Config { particles: natural.particles, ..fewer.clone() }, natural);
        assert_eq!(fewer.particles, 400);
        let hedge = natural.set("policy.kind=hedge").and_then(|c| c.set("policy.gamma=2.5")).expect("a policy");
        assert!(hedge.to_toml().contains("kind = \"hedge\"") && hedge.to_toml().contains("gamma = 2.5"));
        let without = natural.set("distractors={ reach = 3.0 }").expect("a section");
        assert_eq!(without.distractors.as_ref().map(|d| d.reach), Some(3.0));
        let found = without.set("distractors=none").expect("it may be left out");
        assert_eq!(Config { distractors: without.distractors.clone(), ..found.clone() }, without);
        assert!(found.distractors.is_none());
        let calibrated = natural.set("likelihood.calibrate={nats = 12, least = 1, most = 1000}").expect("one of two");
        assert!(calibrated.likelihood.sharpness.is_none());
        let fixed = calibrated.set("likelihood.sharpness=20").expect("one of two");
        assert!(fixed.likelihood.calibrate.is_none() && fixed.likelihood.sharpness == Some(20.0));
        for (wrong, said) in [
            ("particles", "key=value"),
            ("particles=0", "particles"),
            ("nothing=1", "nothing"),
            ("particles.x=1", "not a section"),
            ("search.fit=0.5", "unknown field `search`, expected one of"),
            ("policy.kind=best", "best"),
            ("particles=none", "particles"),
            ("sensor=none", "none to leave out"),
        ] {
            let error = natural.set(wrong).expect_err(wrong).to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn an_error_names_the_setting_and_no_line() {
        let natural = Config::builtin("natural").expect("it ships").expect("it is right");
        for setting in ["particels=3", "policy.kind=hegde", "policy.gama=3", "particles=many"] {
            let error = natural.set(setting).expect_err(setting).to_string();
            assert!(error.contains(setting) && !error.contains("line "), "{error}");
        }
    }
}
