//! `paper reproduce` through the program: the same results after kills, in parts, with any number of threads.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Table 3 and the figure of digits, small, of few particles, on digits drawn by a pen: 36 runs.
fn reproduce(dir: &Path, out: &str, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_paper"));
    command.args(["reproduce", "table3", "fig-digits", "--quick", "--set", "particles=150", "--out", out]).args(more);
    command.env("FOVEATE_DATA", dir).current_dir(dir).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

fn succeeds(mut command: Command) {
    assert!(command.status().expect("the program starts").success(), "{command:?}");
}

/// Finished runs, by name.
fn runs(dir: &Path, out: &str) -> Vec<String> {
    let Ok(all) = std::fs::read_dir(dir.join(out).join("runs")) else { return vec![] };
    let names = all.map(|entry| entry.expect("a file").file_name().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".json") && !name.starts_with('.')).collect();
    names.sort();
    names
}

/// The files beside the page, which names the command.
fn written(dir: &Path, out: &str) -> Vec<Vec<u8>> {
    let read = |name: &&str| std::fs::read(dir.join(out).join(name)).expect("a file of results");
    ["table3.json", "table3.csv", "fig-digits.json", "fig-digits-1.png"].iter().map(read).collect()
}

/// Kills the program once it has finished so many runs; `false` where it ended before.
fn killed(mut child: Child, dir: &Path, out: &str, after: usize) -> bool {
    let began = Instant::now();
    while runs(dir, out).len() < after {
        if child.try_wait().expect("a child").is_some() {
            return false;
        }
        assert!(began.elapsed() < Duration::from_secs(300), "it stands still");
        std::thread::sleep(Duration::from_millis(3));
    }
    child.kill().expect("a child");
    child.wait().expect("a child");
    true
}

#[test]
fn kills_and_parts_do_not_show() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    succeeds(reproduce(dir, "whole", &["--threads", "2"]));
    assert_eq!(runs(dir, "whole").len(), 36);

    // Killed three times, somewhere in a run, with another number of threads each time.
    for (after, threads) in [(5, "1"), (13, "3"), (22, "2")] {
        let child = reproduce(dir, "killed", &["--threads", threads]).spawn().expect("the program starts");
        assert!(killed(child, dir, "killed", after), "killed before its end");
        assert!(!dir.join("killed/index.html").exists());
    }
    let (kept, at) = (runs(dir, "killed"), |name: &String| {
        std::fs::metadata(dir.join("killed/runs").join(name)).and_then(|m| m.modified()).expect("a finished run")
    });
    let before: Vec<_> = kept.iter().map(at).collect();
    succeeds(reproduce(dir, "killed", &[]));
    assert_eq!(written(dir, "killed"), written(dir, "whole"));
    assert_eq!(runs(dir, "killed"), runs(dir, "whole"), "no run is lost, none is done under another name");
    assert_eq!(kept.iter().map(at).collect::<Vec<_>>(), before, "no finished run is done again");

    // In three parts, put together.
    for part in ["1/3", "2/3", "3/3"] {
        succeeds(reproduce(dir, &format!("part{}", &part[..1]), &["--shard", part]));
    }
    let each: Vec<usize> = (1..=3).map(|i| runs(dir, &format!("part{i}")).len()).collect();
    assert_eq!(each.iter().sum::<usize>(), 36, "{each:?}");
    assert!(each.iter().all(|n| *n < 36), "{each:?}");
    let all = ["--merge", "part1", "--merge", "part2", "--merge", "part3", "--threads", "1"];
    succeeds(reproduce(dir, "merged", &all));
    assert_eq!(written(dir, "merged"), written(dir, "whole"));
    let page = std::fs::read_to_string(dir.join("merged/index.html")).expect("a page");
    assert!(page.contains("NOT MNIST") && page.contains("data:image/png;base64,") && !page.contains("src=\"http"));
}

#[test]
fn many_targets_in_parts() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let multi = |out: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_paper"));
        command.args(["reproduce", "fig-multi", "--quick", "--seeds", "7..=7", "--set", "particles=100", "--out", out]);
        command.args(more);
        command.env("FOVEATE_DATA", dir).current_dir(dir).stdout(Stdio::null()).stderr(Stdio::null());
        succeeds(command);
        let files = ["fig-multi.json", "fig-multi.csv", "fig-multi-strip.png"];
        files.map(|name| std::fs::read(dir.join(out).join(name)).ok())
    };
    let whole = multi("whole", &[]);
    assert!(whole.iter().all(Option::is_some), "table and film strip");
    // Together and alone.
    assert_eq!(runs(dir, "whole").len(), 2);
    for file in ["fig-multi.mp4", "fig-multi-report.html"] {
        assert!(std::fs::metadata(dir.join("whole").join(file)).expect(file).len() > 400, "{file}");
    }
    // Which part does a run follows from its digest: one may have both.
    for part in ["1/2", "2/2"] {
        multi(&format!("part{}", &part[..1]), &["--shard", part]);
    }
    assert_eq!(runs(dir, "part1").len() + runs(dir, "part2").len(), 2);
    assert_eq!(multi("merged", &["--merge", "part1", "--merge", "part2", "--threads", "1"]), whole);
    let page = std::fs::read_to_string(dir.join("merged/index.html")).expect("a page");
    assert!(page.contains("<th>HOTA</th>") && page.contains("data:image/png;base64,"));
}

/// A figure keeps no runs, for which the folder would be made.
#[test]
fn a_figure_makes_its_folder() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut command = Command::new(env!("CARGO_BIN_EXE_paper"));
    command.args(["reproduce", "fig-policy", "--quick", "--set", "particles=50", "--out", "new/out"]);
    command.env("FOVEATE_DATA", dir.path()).current_dir(dir.path()).stdout(Stdio::null()).stderr(Stdio::null());
    succeeds(command);
    for file in ["index.html", "fig-policy.json", "fig-policy-1-8.svg"] {
        assert!(dir.path().join("new/out").join(file).is_file(), "{file}");
    }
}

#[test]
fn impossible_requests_are_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::write(dir.path().join("peers.csv"), "a,b\n1,2\n").expect("writable");
    let head = "title = 't'\nabout = ''\nseeds = 1\nframes = 30\ndigits = [3]\nkind = 'digits'\n";
    let scene = "scene = [{ name = 'bars', video = { scene = 'occlusion' } }]\n";
    let wrong = format!("{head}{scene}[[line]]\nname = 'Hedge'\nconfig = 'digits-hedge'\nscenes = ['dark']\n");
    std::fs::write(dir.path().join("wrong.toml"), wrong).expect("writable");
    let flat = format!("{head}{scene}[[line]]\nname = 'Hedge'\nconfig = 'digits-hedge'\n");
    std::fs::write(dir.path().join("flat.toml"), flat).expect("writable");
    std::fs::create_dir(dir.path().join("other")).expect("writable");
    std::fs::copy(dir.path().join("flat.toml"), dir.path().join("other/flat.toml")).expect("writable");
    for (wrong, says) in [
        (&["table9"][..], "table1"),
        (&["flat.toml", "other/flat.toml"], "other/flat.toml: its results would replace those of flat.toml"),
        (&["table1", "--shard", "3/2"], "1/4"),
        (&["table1", "--quick", "--merge", "nowhere"], "nowhere"),
        (&["table1", "--quick", "--peer", "peers.csv"], "peers.csv"),
        (&["table1", "--data", "nowhere"], "nowhere"),
        (&["why-exp3", "--seeds", "0"], "1 to 10000"),
        (&["why-exp3", "--quick", "--set", "particles=none"], "particles"),
        (&["wrong.toml"], "wrong.toml: line Hedge is run on a scene dark"),
        (&["flat.toml"], "gp-ucb"),
        (&["fig-digits", "--set", "particles=50", "--write-docs", "."], "--write-docs"),
        (&["fig-digits", "--write-docs", "."], "expects MNIST's test files"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_paper"))
            .arg("reproduce")
            .args(wrong)
            .env("FOVEATE_DATA", dir.path())
            .current_dir(dir.path())
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(says), "{wrong:?}: {said}");
    }
}

#[test]
fn settings_and_seeds_name_other_runs_and_damaged_ones_are_done_again() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let curve = |more: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_paper"))
            .args(["reproduce", "fig-hedge", "--quick", "--out", "out"])
            .args(more)
            .env("FOVEATE_DATA", dir)
            .current_dir(dir)
            .output()
            .expect("the program starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success() && said.contains("NOT MNIST"), "{said}");
        let text = std::fs::read_to_string(dir.join("out/fig-hedge.txt")).expect("a table");
        (said, text, String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let (said, first, printed) = curve(&["--threads", "1"]);
    assert!(said.contains("2 runs, 0 of them") && printed.contains(&first) && first.contains("the eight"), "{said}");
    assert_eq!(runs(dir, "out").len(), 4, "two seeds, two templates");
    let path = dir.join("out/runs").join(&runs(dir, "out")[0]);
    let whole = std::fs::read(&path).expect("a finished run");
    std::fs::write(&path, &whole[..whole.len() / 2]).expect("a writable folder");
    let (said, again, _) = curve(&["--threads", "3"]);
    assert!(said.contains("2 runs, 1 of them") && again == first, "{said}");
    let (said, other, _) = curve(&["--set", "particles=50", "--set", "policy.gamma=0.5"]);
    assert!(said.contains("2 runs, 0 of them") && other != first, "{said}");
    assert_eq!(runs(dir, "out").len(), 8);
    let (said, ..) = curve(&["--seeds", "2..=3"]);
    assert!(said.contains("2 runs, 1 of them"), "seed 2 is done: {said}");
    assert_eq!(runs(dir, "out").len(), 10);
    assert!(dir.join("out/fig-hedge.svg").is_file());
}

#[test]
fn a_changed_picture_names_another_run() {
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let paper = |args: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_paper"));
        let output = command.args(args).env("FOVEATE_DATA", dir).current_dir(dir).output().expect("it starts");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{said}");
        said
    };
    // Too short for a clip, which would take time.
    paper(&["synth", "clutter", "--frames", "12", "--out", "tracking/a"]);
    let recovery = || paper(&["reproduce", "recovery", "--quick", "--out", "out"]);
    assert!(recovery().contains("1 run, 0 of them"));
    assert!(recovery().contains("1 run, 1 of them"));
    let all = std::fs::read_dir(dir.join("tracking/a/img")).expect("pictures").map(|entry| entry.expect("one").path());
    let mut pictures: Vec<_> = all.collect();
    pictures.sort();
    std::fs::copy(&pictures[2], &pictures[1]).expect("a writable folder");
    assert!(recovery().contains("1 run, 0 of them"));
}
