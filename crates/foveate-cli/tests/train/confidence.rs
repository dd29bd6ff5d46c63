//! `foveate train confidence`.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::place::{Place, done, errors, printed};
use crate::training::fails;

fn fit(place: &Place, out: &str) -> Command {
    let args = "train confidence --config digits --seeds 4 --rounds 2 --threads 2 --seqs seqs --out";
    place.command(args.split(' ').chain([out]))
}

/// Killed while it tracks, a fit continues with the stored tracks, to the same table; what is done is removed, and nothing
/// else that lies there.
#[test]
fn a_fit_that_was_killed_goes_on() {
    let place = Place::empty();
    for digit in ["3", "7"] {
        place.done(["synth", "clutter", "--digit", digit, "--frames", "120", "--out", &format!("seqs/{digit}")]);
    }
    let table = |out| place.text(out).split_once('\n').expect("the command, and the table").1.to_owned();
    let whole = printed(&done(&mut fit(&place, "whole.toml")));
    assert!(!place.path("whole.runs").exists(), "what is finished begins anew");

    // Not files being written under another name.
    let kept = |file: &std::fs::DirEntry| file.path().extension().is_some_and(|end| end == "json");
    let runs = || std::fs::read_dir(place.path("cut.runs")).map_or(0, |all| all.flatten().filter(kept).count());
    let mut command = fit(&place, "cut.toml");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it runs");
    let began = Instant::now();
    while runs() < 2 {
        assert!(began.elapsed() < Duration::from_secs(60) && child.try_wait().expect("a child").is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("it still runs");
    child.wait().expect("it ends");
    assert!(runs() >= 2 && !place.path("cut.toml").exists());
    place.write("cut.runs/note.txt", "mine");
    let last = done(&mut fit(&place, "cut.toml"));
    let message = errors(&last);
    let (first, _) = message.split_once(" of them from ").expect("how many runs were kept");
    assert!(!first.ends_with(" 0"), "{message}");
    assert_eq!(table("cut.toml"), table("whole.toml"));
    assert_eq!(printed(&last).replace("cut.", "whole."), whole);
    assert!(place.path("cut.runs/note.txt").exists() && runs() == 0, "{} are left", runs());
}

/// An output that cannot be written, or that would replace an input, is an error before any video is opened.
#[test]
fn unwritable_results_are_refused_at_once() {
    let place = Place::empty();
    std::fs::create_dir(place.path("folder")).expect("a folder");
    fails(fit(&place, "folder"), "expected a file to write to, found a folder");
    fails(fit(&place, "nowhere/table.toml"), "there is no folder");
    let with = |more: &[&str]| {
        let mut command = fit(&place, "table.toml");
        command.args(more);
        command
    };
    fails(with(&["--cues", "folder"]), "expected a file to write to, found a folder");
    for name in ["table.toml", "table.svg", "table.runs"] {
        fails(with(&["--cues", name]), "are written under the same name");
    }
    fails(fit(&place, "table.svg"), "its plot gets the same name");
    fails(fit(&place, "table.runs"), "the folder of its finished tracks gets the same name");
    fails(with(&["--only-second-opinion"]), "--only-second-opinion: digits has none; add second_opinion");
    fails(with(&["--set", "committee=2"]), "fit a member: --set committee=1");
    for (half, bias) in [("a", "bias = 1.0"), ("b", "bias = 2.0")] {
        let text = include_str!("../../../foveate-core/configs/digits.toml").replace("bias = 1.521", bias);
        place.write(&format!("digits-{half}.toml"), text);
    }
    let two = "train confidence --config digits-{other}.toml --seqs . --out table.toml";
    place.refuses(two.split(' '), "[confidence] of the two halves differs");
    for half in ["a", "b"] {
        std::fs::remove_file(place.path(&format!("digits-{half}.toml"))).expect("it was written");
    }
    assert_eq!(place.names(""), ["folder"], "nothing was made");
}
