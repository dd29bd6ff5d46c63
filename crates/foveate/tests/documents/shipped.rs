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
        let s = if rings.len() == 1 { "" } else { "s" };
        let colours = if colour.is_empty() { "" } else { ", and colour" };
        let looks = format!("{} ring{s} ({}){colours}", rings.len(), windows.join(", "));
        let (name, particles) = (format!("`{name}`"), config.particles.to_string());
        let (policy, encoder, lost) = (policy(&config.policy), encoder(&config.encoder), lost(&config));
        out += &line([&name, &purpose(text), &policy, &looks, encoder, &particles, lost]);
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
        EncoderConfig::Onnx { .. } => "network in an ONNX file (`onnx`)",
        EncoderConfig::Oriented { .. } => "gradients (`oriented`)",
        EncoderConfig::Raw { standardise: true } => "standardised pixels (`raw`)",
        EncoderConfig::Raw { .. } => "pixels (`raw`)",
        EncoderConfig::Rbm { .. } => "RBM (`rbm`)",
        EncoderConfig::Kmeans { .. } => "k-means filters (`kmeans`)",
        _ => unreachable!("a configuration that ships has parts of the library"),
    }
}

/// Where the numbers of P(lost) come from.
fn lost(config: &Config) -> &'static str {
    let weights = config.confidence.weights;
    if weights == foveate::control::ConfidenceModel::default().weights {
        "default, not calibrated"
    } else if weights[1..].iter().all(|w| *w == 0.0) {
        "0 or 1: a threshold"
    } else {
        "fitted"
    }
}
