//! `foveate configs`: the configurations that ship with the program.

use foveate::config::{BUILTIN, Config, about};
use foveate::files::Nowhere;
use foveate::identity::Retina;
use foveate::{Error, Result};

#[derive(clap::Args)]
pub(crate) struct Args {
    /// Configuration to print as TOML, as a starting point for a --config file. If omitted, list all configurations: name, gaze policy,
    /// retina rings (window/cell in template pixels, innermost first) and purpose
    name: Option<String>,
}

/// Runs the command.
pub(crate) fn run(args: Args) -> Result<()> {
    let Some(name) = &args.name else { return list() };
    match BUILTIN.iter().find(|b| b.0 == *name) {
        Some((_, text)) => {
            say!("{}", text.trim_end());
            Ok(())
        }
        None => Err(Error::Config(format!(
            "no configuration is called {name}; those that ship: {}",
            Config::names().join(", ")
        ))),
    }
}

fn list() -> Result<()> {
    let mut lines = vec![["name", "policy", "retina"].map(String::from).to_vec()];
    lines[0].push("for".into());
    for (name, text) in BUILTIN {
        let blueprint = Config::parse(text, name)?.check(&Nowhere)?;
        let policy = blueprint.config().policy_kind();
        lines.push(vec![(*name).into(), policy, rings(&*blueprint.retina()), about(text).into()]);
    }
    let widest = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths = [widest(0), widest(1), widest(2)];
    for line in &lines {
        let cell = |i: usize| format!("{:<1$}", line[i], widths[i]);
        say!("{}  {}  {}  {}", cell(0), cell(1), cell(2), line[3]);
    }
    Ok(())
}

/// Returns the windows of a retina and their cells, as `8/1 16/2 24/4`, in units of the smallest cell. A `+` precedes the windows that read
/// colour.
pub(crate) fn rings(retina: &dyn Retina) -> String {
    let finest = retina.cells().iter().map(|c| c.half).fold(f64::INFINITY, f64::min);
    let mut rings: Vec<(usize, f64, f64)> = vec![];
    for cell in retina.cells() {
        let reach = cell.u.abs().max(cell.v.abs()) + cell.half;
        match rings.iter_mut().find(|r| r.0 == cell.channel.min(1) && r.1 == cell.half) {
            Some(ring) => ring.2 = ring.2.max(reach),
            None => rings.push((cell.channel.min(1), cell.half, reach)),
        }
    }
    let unit = |length: f64| (length / finest).round();
    let ring = |(channel, half, reach): &(usize, f64, f64)| {
        format!("{}{}/{}", if *channel > 0 { "+" } else { "" }, unit(*reach), unit(*half))
    };
    rings.iter().map(ring).collect::<Vec<_>>().join(" ")
}
