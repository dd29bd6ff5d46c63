//! The policies that an experiment compares, derived from a configuration's own policy.

use foveate::config::{Exp3AsPrintedConfig, Exp3Config, Exp3IxConfig, Exp3SConfig, PolicyConfig};
use foveate::gaze::{Bayes, Grid, Schedule};
use foveate::lab::eval::regret::reach;

/// The baseline: always the centre of the template.
pub(crate) const FIXED: PolicyConfig = PolicyConfig::Fixed { u: 0.0, v: 0.0 };

/// Returns the fixed centre first, then every policy of the paper with its variants, then those that look at the centre too.
///
/// All look within the reach of `own`: grids are 3 × 3 over it. Hedge has the rate of `own`, and GP-UCB its settings. If `own` has none, γ
/// = 5 (the theory's rate for 300 frames, 0.24, learns too late), default settings, and a guard of 0.7 apply.
pub(crate) fn policies(own: &PolicyConfig) -> Vec<PolicyConfig> {
    let grid = Grid { n: 3, reach: reach(own).unwrap_or(Grid::default().reach) };
    let gamma = gamma_of(own).unwrap_or(Schedule::Fixed(5.0));
    let usual = Bayes { reach: grid.reach, start: 0.4 * grid.reach, ..Bayes::default() };
    let bayes = bayes_of(own).unwrap_or(usual);
    let guard = bayes.guard.or(Some(0.7));
    let bayes = Bayes { guard: None, caution: 0.0, ..bayes };
    let (random, hedge, gp_ucb) =
        (PolicyConfig::Random { grid }, PolicyConfig::Hedge { grid, gamma }, PolicyConfig::GpUcb(bayes.clone()));
    let anchor = |policy: &PolicyConfig| PolicyConfig::Anchor { policy: Box::new(policy.clone()) };
    let anchored = [&random, &hedge, &gp_ucb].map(anchor);
    let own_looks = [
        FIXED,
        random,
        PolicyConfig::Circular { grid },
        hedge,
        PolicyConfig::Exp3(Exp3Config { grid, ..Exp3Config::default() }),
        PolicyConfig::Exp3Ix(Exp3IxConfig { grid, ..Exp3IxConfig::default() }),
        PolicyConfig::Exp3S(Exp3SConfig { grid, ..Exp3SConfig::default() }),
        PolicyConfig::Exp3AsPrinted(Exp3AsPrintedConfig { grid, ..Exp3AsPrintedConfig::default() }),
        gp_ucb,
        PolicyConfig::GpUcb(Bayes { guard, ..bayes.clone() }),
        PolicyConfig::GpUcb(Bayes { caution: 1.0, ..bayes }),
    ];
    own_looks.into_iter().chain(anchored).collect()
}

fn gamma_of(policy: &PolicyConfig) -> Option<Schedule> {
    match policy {
        PolicyConfig::Hedge { gamma, .. } => Some(*gamma),
        PolicyConfig::Anchor { policy } => gamma_of(policy),
        _ => None,
    }
}

fn bayes_of(policy: &PolicyConfig) -> Option<Bayes> {
    match policy {
        PolicyConfig::GpUcb(bayes) => Some(bayes.clone()),
        PolicyConfig::Anchor { policy } => bayes_of(policy),
        _ => None,
    }
}

/// Returns the name of a policy in the table: its kind, preceded by `anchor+` for a policy beside an anchor, and followed by the limit of
/// GP-UCB's exploration.
pub(crate) fn policy_name(policy: &PolicyConfig) -> String {
    let kind = || {
        let value = serde_json::to_value(policy).expect("a configuration is plain data");
        value["kind"].as_str().unwrap_or("?").to_owned()
    };
    match policy {
        PolicyConfig::Anchor { policy } => format!("anchor+{}", policy_name(policy)),
        PolicyConfig::GpUcb(bayes) if bayes.guard.is_some() => kind() + " guarded",
        PolicyConfig::GpUcb(bayes) if bayes.caution > 0.0 => kind() + " cautious",
        _ => kind(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_take_after_the_configurations_own() {
        let grid = Grid { n: 5, reach: 0.83 };
        let own = PolicyConfig::Anchor { policy: Box::new(PolicyConfig::Hedge { grid, gamma: Schedule::Fixed(0.1) }) };
        let all = policies(&own);
        let names: Vec<_> = all.iter().map(policy_name).collect();
        assert_eq!(names[..4], ["fixed", "random", "circular", "hedge"]);
        assert_eq!(names[8..11], ["gp-ucb", "gp-ucb guarded", "gp-ucb cautious"]);
        assert_eq!(names[11..], ["anchor+random", "anchor+hedge", "anchor+gp-ucb"]);
        assert_eq!(all[3], PolicyConfig::Hedge { grid: Grid { n: 3, reach: 0.83 }, gamma: Schedule::Fixed(0.1) });
        assert!(all[1..].iter().all(|policy| reach(policy) == Some(0.83)));
        let gamma = Schedule::Fixed(5.0);
        assert_eq!(policies(&FIXED)[3], PolicyConfig::Hedge { grid: Grid::default(), gamma });
        let own = PolicyConfig::GpUcb(Bayes { window: 300, guard: Some(1.0), ..Bayes::default() });
        assert!(policies(&own).contains(&PolicyConfig::GpUcb(Bayes { window: 300, ..Bayes::default() })));
        assert!(policies(&own).contains(&own), "its own guard");
    }
}
