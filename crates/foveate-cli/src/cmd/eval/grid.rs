//! Candidates of `foveate eval --choose`: all combinations of the listed values.

use foveate::config::Config;
use foveate::text::counted;
use foveate::{Error, Result};

/// Maximum number of candidates; more are assumed to be a mistake.
const MOST: usize = 1000;

/// A candidate: its settings, `KEY=VALUE` with a space between two, and its configuration.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Candidate {
    pub name: String,
    pub config: Config,
}

/// Returns all combinations of settings such as `colour.mixing_weight=0.1,0.2`, with the last one changing first.
///
/// Fails if one is not a list of values for a key, a key comes twice, a configuration is refused, two candidates are the same, or there are
/// fewer than two or more than [`MOST`].
pub(super) fn candidates(config: &Config, choices: &[String]) -> Result<Vec<Candidate>> {
    let lists: Vec<(&str, Vec<&str>)> = choices.iter().map(|choice| list(choice)).collect::<Result<_>>()?;
    for (i, (key, _)) in lists.iter().enumerate() {
        if lists[..i].iter().any(|(other, _)| other == key) {
            return Err(Error::Config(format!("--choose {key} is given twice: list all of its values in one")));
        }
    }
    let count = lists.iter().try_fold(1usize, |n, (_, values)| n.checked_mul(values.len())).unwrap_or(usize::MAX);
    if !(2..=MOST).contains(&count) {
        return Err(Error::Config(format!(
            "--choose makes {}: expected 2 to {MOST}, such as --choose particles=400,800",
            counted(count, "candidate")
        )));
    }
    let mut found = vec![Candidate { name: String::new(), config: config.clone() }];
    for (key, values) in &lists {
        let mut next = vec![];
        for candidate in &found {
            for value in values {
                let setting = format!("{key}={value}");
                let config = candidate.config.set(&setting)?;
                let name = format!("{} {setting}", candidate.name).trim().to_owned();
                next.push(Candidate { name, config });
            }
        }
        found = next;
    }
    for (i, one) in found.iter().enumerate() {
        if let Some(same) = found[..i].iter().find(|other| other.config == one.config) {
            return Err(Error::Config(format!(
                "--choose: the candidates {} and {} are the same configuration: list each value once",
                same.name, one.name
            )));
        }
    }
    Ok(found)
}

/// Parses a key and its values. Commas in brackets, braces and quotes do not separate values.
fn list(choice: &str) -> Result<(&str, Vec<&str>)> {
    let wrong = || {
        Error::Config(format!("--choose {choice}: expected KEY=VALUE,VALUE..., such as colour.mixing_weight=0.1,0.2"))
    };
    let (key, text) = choice.split_once('=').ok_or_else(wrong)?;
    let (mut values, mut from, mut depth, mut quote) = (vec![], 0, 0usize, None);
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (Some(mark), _) if c == mark => quote = None,
            (Some(_), _) => (),
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth = depth.checked_sub(1).ok_or_else(wrong)?,
            (None, ',') if depth == 0 => {
                values.push(text[from..i].trim());
                from = i + 1;
            }
            _ => (),
        }
    }
    values.push(text[from..].trim());
    if key.trim().is_empty() || values.iter().any(|value| value.is_empty()) {
        return Err(wrong());
    }
    Ok((key.trim(), values))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn natural() -> Config {
        Config::builtin("natural").expect("it ships").expect("it is right")
    }

    fn of(choices: &[&str]) -> Result<Vec<Candidate>> {
        candidates(&natural(), &choices.iter().map(ToString::to_string).collect::<Vec<_>>())
    }

    #[test]
    fn a_grid_has_all_combinations() {
        let found = of(&["particles=400,800", "camera_motion.share= 1, 0.5"]).expect("four");
        let names: Vec<&str> = found.iter().map(|c| c.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "particles=400 camera_motion.share=1",
                "particles=400 camera_motion.share=0.5",
                "particles=800 camera_motion.share=1",
                "particles=800 camera_motion.share=0.5",
            ]
        );
        assert_eq!(found[2].config.particles, 800);
        assert_eq!(found.iter().filter(|c| c.config == natural().set("particles=400").expect("fewer")).count(), 1);
    }

    #[test]
    fn commas_in_values_divide_nothing() {
        let parts = |text| list(text).expect("a list").1;
        assert_eq!(parts("retina.rings=[[18, 1]],[[16,1],[32,2]]"), ["[[18, 1]]", "[[16,1],[32,2]]"]);
        assert_eq!(parts("a.b={ x = 1, y = \"],\" },'u,v'"), ["{ x = 1, y = \"],\" }", "'u,v'"]);
    }

    #[test]
    fn mistakes_are_errors() {
        for (wrong, said) in [
            (&["particles"][..], "expected KEY=VALUE"),
            (&["particles=400,"], "expected KEY=VALUE"),
            (&["particles=400]"], "expected KEY=VALUE"),
            (&["particles=400"], "makes 1 candidate: expected 2 to 1000"),
            (&["particles=400,0"], "particles"),
            (&["no.such=1,2"], "no"),
            (&["particles=400,400"], "are the same configuration"),
            (&["particles=400,800", "particles=200,300"], "given twice"),
        ] {
            let problem = of(wrong).expect_err(wrong[0]).to_string();
            assert!(problem.contains(said), "{wrong:?}: {problem}");
        }
    }
}
