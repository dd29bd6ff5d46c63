//! The generated table of the configurations that ship.

use foveate::config::{BUILTIN, Config, EncoderConfig, PolicyConfig};
use foveate::files::Nowhere;

/// A table of the configurations that ship: the purpose of each, and its policy, retina and encoder.
pub(crate) fn configurations() -> String {
    let head = ["configuration", "for", "policy", "retina", "encoder", "particles", "P(lost)"];
    let line = |cells: [&str; 7]| format!("| {} |\n", cells.join(" | "));
    let mut out = line(head) + &line(["---"; 7]);
    for (name, text) in BUILTIN {
        let config = Config::parse(text, name).expect("it ships");
        let (retina, _) = config.identity(&Nowhere).expect("its model ships");
        let (rings, colour) = (&retina.config().rings, &retina.config().colour);
        let windows: Vec<String> = rings.iter().map(|[window, cell]| format!("{window}/{cell}")).collect();
        let looks = windows.join(", ") + if colour.is_empty() { "" } else { ", colour" };
        let lost = lost(name, text, &config);
        let (name, particles) = (format!("`{name}`"), config.particles.to_string());
        let (policy, encoder) = (policy(&config.policy), encoder(&config.encoder));
        out += &line([&name, &purpose(text), &policy, &looks, encoder, &particles, &lost]);
    }
    out
}

/// The first sentence of a configuration's first comment.
fn purpose(text: &str) -> String {
    let comment = text.lines().take_while(|l| l.starts_with('#')).map(|l| l.trim_start_matches(['#', ' ']));
    let comment = comment.collect::<Vec<_>>().join(" ");
    comment.split(". ").next().expect("one part").trim_end_matches('.').replace('|', "\\|")
}

fn policy(config: &PolicyConfig) -> String {
    let gazes = |n: usize| format!("{n} × {n} gazes");
    match config {
        PolicyConfig::Fixed { u, v } if (*u, *v) == (0.0, 0.0) => "fixed centre".into(),
        PolicyConfig::Fixed { .. } => "fixed gaze".into(),
        PolicyConfig::Random { grid } => format!("random, {}", gazes(grid.n)),
        PolicyConfig::Circular { grid } => format!("circular, {}", gazes(grid.n)),
        PolicyConfig::Hedge { grid, .. } => format!("**Hedge**, {}", gazes(grid.n)),
        PolicyConfig::Pool { grid, .. } => format!("**pool**, {}", gazes(grid.n)),
        PolicyConfig::ExploreThenCommit { grid, .. } => format!("**explore, then commit**, {}", gazes(grid.n)),
        PolicyConfig::GpUcb(_) => "**GP-UCB**, any gaze".into(),
        PolicyConfig::Anchor { policy: inner } => format!("centre and {}", policy(inner)),
        _ => "**EXP3**".into(),
    }
}

fn encoder(config: &EncoderConfig) -> &'static str {
    match config {
        EncoderConfig::Onnx { .. } => "`onnx`",
        EncoderConfig::Oriented { .. } => "`oriented`",
        EncoderConfig::Raw { standardise: true } => "`raw`, standardised",
        EncoderConfig::Raw { .. } => "`raw`",
        EncoderConfig::Rbm { .. } => "`rbm`",
        EncoderConfig::Kmeans { .. } => "`kmeans`",
        _ => unreachable!("a configuration that ships has parts of the library"),
    }
}

/// Where the numbers of P(lost) come from: the command above them names the configuration that they were fitted to.
fn lost(name: &str, text: &str, config: &Config) -> String {
    let weights = config.confidence.weights;
    let fitted =
        text.split("foveate train confidence --config ").nth(1).and_then(|rest| rest.split_whitespace().next());
    match fitted {
        _ if weights == foveate::control::ConfidenceModel::default().weights => "default, not calibrated".into(),
        _ if weights[1..].iter().all(|w| *w == 0.0) => "0 or 1: a threshold".into(),
        Some(other) if other == name => "fitted".into(),
        Some(other) => format!("fitted to `{other}`"),
        None => "not calibrated".into(),
    }
}
