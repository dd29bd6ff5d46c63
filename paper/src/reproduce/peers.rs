//! Other trackers on the same videos: the measurements of `bench/peers.py` as lines of our tables.

use std::path::PathBuf;

use crate::eval::tally::{Figure, Tally};
use foveate::{Error, Result, files};

use super::line::Group;
use super::plan::Experiment;
use super::results::Line;

/// A tracker's results on the videos of one scene of one experiment.
pub(super) struct Peer {
    experiment: String,
    scene: String,
    tracker: String,
    figures: Vec<Figure>,
}

/// The columns of a file.
const HEAD: &str = "experiment,scene,tracker,digit,seed,mean,spread,off_at_end";

/// Reads files of peers; lines that begin with `#` describe how they were made.
pub(super) fn read(paths: &[PathBuf]) -> Result<Vec<Peer>> {
    let mut peers: Vec<Peer> = vec![];
    for path in paths {
        let text = files::read_text(path, files::TEXT)?;
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.starts_with('#') && !line.trim().is_empty());
        if lines.next().is_none_or(|(_, head)| head.trim() != HEAD) {
            return Err(Error::malformed(
                path,
                format!("expected a first line {HEAD}; bench/peers.py writes such files"),
            ));
        }
        for (i, line) in lines {
            let row = parse(line).ok_or_else(|| {
                Error::malformed(path, format!("line {}: expected {HEAD}, the last one 0 or 1, got {line}", i + 1))
            })?;
            let same =
                |p: &&mut Peer| (&p.experiment, &p.scene, &p.tracker) == (&row.experiment, &row.scene, &row.tracker);
            match peers.iter_mut().find(same) {
                Some(peer) => peer.figures.extend(row.figures),
                None => peers.push(row),
            }
        }
    }
    Ok(peers)
}

fn parse(line: &str) -> Option<Peer> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    let [experiment, scene, tracker, digit, seed, mean, spread, off] = cells[..] else { return None };
    seed.parse::<u64>().ok()?;
    let number = |text: &str| text.parse::<f64>().ok().filter(|x| x.is_finite() && *x >= 0.0);
    let digit = digit.parse().ok().filter(|d| *d <= 9)?;
    let off_at_end = ["0", "1"].iter().position(|l| *l == off)? == 1;
    let figures = vec![Figure { digit, value: number(mean)?, spread: number(spread)?, off_at_end }];
    Some(Peer { experiment: experiment.into(), scene: scene.into(), tracker: tracker.into(), figures })
}

/// Returns the peers' lines of an experiment.
pub(super) fn lines<'a>(peers: &'a [Peer], experiment: &'a Experiment) -> impl Iterator<Item = Line> + 'a {
    let such = |peer: &&Peer| {
        peer.experiment == experiment.name && experiment.scenes.iter().any(|scene| scene.name == peer.scene)
    };
    peers.iter().filter(such).filter_map(|peer| {
        Some(Line {
            name: peer.tracker.clone(),
            group: Group::Peer,
            row: None,
            configuration: peer.tracker.clone(),
            policy: "-".into(),
            scene: peer.scene.clone(),
            other: None,
            tally: Tally::of(&peer.figures, None).ok()?,
            details: Default::default(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_peers_become_lines() {
        let dir = tempfile::tempdir().expect("a folder");
        let file = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::write(&path, text).expect("writable");
            path
        };
        let good = format!("# by hand\n{HEAD}\ntable1,clean,csrt,3,1,2.0,1.0,0\ntable1,clean,csrt,3,2,4.0,1.0,1\n");
        let peers = read(&[file("good.csv", &good)]).expect("a good file");
        let table = Experiment::named("table1").expect("it is there");
        let lines: Vec<Line> = lines(&peers, &table).collect();
        assert_eq!((lines.len(), lines[0].tally.mean, lines[0].tally.off_at_end), (1, 3.0, 0.5));
        let bad = format!("{HEAD}\ntable1,clean,csrt,30,1,2.0,1.0,0\n");
        assert!(read(&[file("bad.csv", &bad)]).is_err_and(|e| e.to_string().contains("line 2")));
        assert!(read(&[file("none.csv", "a,b\n")]).is_err());
    }
}
