//! Frozen answers of shipped configurations: boxes, status and P(lost), bit for bit. A change that is not meant to change them shows here.
//!
//! Configurations with an RBM are left out: its products are summed in another order on each processor.
//! `FOVEATE_WRITE_FROZEN=1` writes the digests in `tests/frozen/` anew, where a change of behaviour is wanted.
#![allow(missing_docs)]

use foveate::BBox;
use foveate_testing::{data, need};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Runs the program in `folder` with the instructions that most machines have, and without the data of the machine: synthetic scenes
/// then have drawn digits everywhere.
fn foveate(folder: &Path, args: &[&str]) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_foveate"));
    let output = command
        .current_dir(folder)
        .env_remove("FOVEATE_DATA")
        .env("FOVEATE_KERNELS", "avx2")
        .args(args)
        .output()
        .expect("it starts");
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

#[cfg(target_arch = "x86_64")]
fn avx2() -> Result<(), &'static str> {
    if std::is_x86_feature_detected!("avx2") { Ok(()) } else { Err("processor with AVX2") }
}

/// 64 bits of FNV-1a.
fn digest(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}

/// The digest of these columns of a table.
fn columns(path: &Path, names: &[&str]) -> u64 {
    let text = std::fs::read_to_string(path).expect("a table was written");
    let (head, rows) = text.split_once('\n').expect("a head");
    let head: Vec<_> = head.split(',').collect();
    let at: Vec<_> = names.iter().map(|name| head.iter().position(|it| it == name).expect(name)).collect();
    digest(rows.lines().flat_map(|row| {
        let fields: Vec<_> = row.split(',').collect();
        at.iter().map(|&k| format!("{},", fields[k])).collect::<String>().into_bytes()
    }))
}

const TRACK: [&str; 7] = ["frame", "left", "top", "width", "height", "p_lost", "status"];

/// One line of the digest: the scene and the configuration, then the digests.
fn single(folder: &Path, scene: &str, config: &str) -> String {
    let out = folder.join("out");
    foveate(folder, &["track", scene, "--config", config, "--no-video", "--no-report", "--out", "out"]);
    let boxes = digest(std::fs::read(out.join("boxes.txt")).expect("boxes"));
    let line = format!("{scene} {config} {boxes:016x} {:016x}", columns(&out.join("track.csv"), &TRACK));
    std::fs::remove_dir_all(out).expect("its folder goes");
    line
}

fn multi(folder: &Path, scene: &str, how: &[&str]) -> String {
    let out = folder.join("out");
    foveate(folder, &[&["track", scene, "--no-video", "--no-report", "--out", "out"][..], how].concat());
    let line =
        format!("{scene} {} {:016x}", how.join(" "), digest(std::fs::read(out.join("tracks.txt")).expect("tracks")));
    std::fs::remove_dir_all(out).expect("its folder goes");
    line
}

/// Compares with `tests/frozen.txt`, line by line.
fn compare(lines: &str, part: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/frozen/{part}.txt"));
    if std::env::var_os("FOVEATE_WRITE_FROZEN").is_some() {
        return std::fs::write(&path, lines).expect("a writable checkout");
    }
    let frozen = std::fs::read_to_string(&path).expect("the digest is in the checkout");
    let differ: Vec<_> = lines.lines().filter(|line| !frozen.lines().any(|it| it == *line)).collect();
    assert!(differ.is_empty(), "these answers changed:\n{}", differ.join("\n"));
}

#[test]
#[cfg(target_arch = "x86_64")]
fn synthetic_scenes_give_the_frozen_answers() {
    need!(avx2());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    foveate(folder, &["synth", "clutter", "--frames", "24", "--out", "clutter"]);
    foveate(folder, &["synth", "partial", "--frames", "24", "--out", "partial"]);
    foveate(folder, &["synth", "multi", "--targets", "2", "--crossings", "1", "--frames", "60", "--out", "many"]);
    let mut lines = String::new();
    for config in [
        "digits",
        "digits-hedge",
        "digits-closeup",
        "digits-pool",
        "natural",
        "natural-committee",
        "natural-fast",
        "natural-raw",
        "foveated",
        "narrow",
        "digits-multi",
    ] {
        writeln!(lines, "{}", single(folder, "clutter", config)).expect("a string takes all");
    }
    for config in ["digits-partial", "natural", "narrow"] {
        writeln!(lines, "{}", single(folder, "partial", config)).expect("a string takes all");
    }
    for config in ["multi", "multi-motion"] {
        writeln!(lines, "{}", multi(folder, "many", &["--detect", "motion", "--config", config]))
            .expect("a string takes all");
    }
    let first = |target: usize| {
        let truth =
            std::fs::read_to_string(folder.join(format!("many/groundtruth_rect.{target}.txt"))).expect("the truth");
        truth.lines().next().expect("a first box").to_string()
    };
    let inits = ["--init", &first(1), "--init", &first(2), "--config", "multi-boxes"];
    writeln!(lines, "{}", multi(folder, "many", &inits)).expect("a string takes all");
    compare(&lines, "synthetic");
}

/// Copies the first frames of a sequence and its truth.
fn cut(sequence: &Path, out: &Path, frames: usize) {
    std::fs::create_dir_all(out.join("img")).expect("a writable folder");
    let mut names: Vec<_> =
        std::fs::read_dir(sequence.join("img")).expect("pictures").map(|it| it.expect("one").file_name()).collect();
    names.sort();
    for name in names.iter().take(frames) {
        std::fs::copy(sequence.join("img").join(name), out.join("img").join(name)).expect("a copy");
    }
    let truth =
        ["groundtruth_rect.txt", "groundtruth_rect.1.txt"].into_iter().find(|name| sequence.join(name).exists());
    std::fs::copy(sequence.join(truth.expect("a truth")), out.join("groundtruth_rect.txt")).expect("a copy");
}

#[test]
#[cfg(target_arch = "x86_64")]
fn real_video_gives_the_frozen_answers() {
    need!(avx2());
    let (tracking, mot) = (need!(data("tracking-wide")), need!(data("mot/TUD-Campus")));
    let data = tracking.parent().expect("the data");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let mut lines = String::new();
    for set in ["tracking", "tracking-wide"] {
        let entries = std::fs::read_dir(data.join(set)).expect("sequences");
        let mut sequences: Vec<_> =
            entries.map(|it| it.expect("one").path()).filter(|it| it.join("img").is_dir()).collect();
        sequences.sort();
        for (k, sequence) in sequences.iter().enumerate() {
            let name = sequence.file_name().expect("a name").to_string_lossy().into_owned();
            cut(sequence, &folder.join(&name), 10);
            let few: &[&str] = if k % 7 == 0 { &["natural-committee", "foveated", "narrow"] } else { &[] };
            for config in ["natural", "natural-fast"].iter().chain(few) {
                writeln!(lines, "{}", single(folder, &name, config)).expect("a string takes all");
            }
        }
    }
    let scene = folder.join("mot");
    std::fs::create_dir_all(scene.join("img1")).expect("a writable folder");
    for frame in 1..=30 {
        let picture = format!("img1/{frame:06}.jpg");
        std::fs::copy(mot.join(&picture), scene.join(&picture)).expect("a copy");
    }
    let all = std::fs::read_to_string(mot.join("det/det.txt")).expect("detections");
    let frame = |line: &&str| line.split(',').next().and_then(|it| it.parse::<usize>().ok()).is_some_and(|it| it <= 30);
    let first: Vec<_> = all.lines().filter(frame).collect();
    std::fs::write(scene.join("det.txt"), first.join("\n")).expect("a writable folder");
    writeln!(lines, "{}", multi(folder, "mot", &["--detections", "mot/det.txt"])).expect("a string takes all");
    writeln!(lines, "{}", multi(folder, "mot", &["--detect", "motion"])).expect("a string takes all");
    compare(&lines, "real");
}

/// The table of an occlusion in docs/confidence.md is what its command gives.
#[test]
#[cfg(target_arch = "x86_64")]
fn the_page_on_confidence_shows_what_its_command_gives() {
    need!(avx2());
    let source = need!(data("tracking-wide/Woman"));
    let numbers =
        |line: &str| line.split([',', '\t']).map(|n| n.trim().parse().expect("a number")).collect::<Vec<f64>>();
    let boxes = |path: &Path| -> Vec<BBox> {
        let text = std::fs::read_to_string(path).expect("boxes");
        let rows = text.lines().filter(|line| !line.trim().is_empty()).map(numbers);
        rows.map(|b| BBox::counted_from_1(b[0], b[1], b[2], b[3])).collect()
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let video = source.to_str().expect("its name is text");
    foveate(
        folder.path(),
        &["track", video, "--seed", "1", "--until", "162", "--no-video", "--no-report", "--out", "out"],
    );
    let (found, truth) = (boxes(&folder.path().join("out/boxes.txt")), boxes(&source.join("groundtruth_rect.txt")));
    let table = std::fs::read_to_string(folder.path().join("out/track.csv")).expect("a table");
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().expect("a head");
    let at = ["p_lost", "status", "usable"].map(|name| head.iter().position(|it| *it == name).expect(name));
    let rows: Vec<_> = lines.collect();
    let page = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/confidence.md"));
    let page = page.expect("the page");
    let (_, page) = page.split_once("### An occlusion in track.csv").expect("its heading");
    let shown: Vec<&str> = page.lines().skip_while(|line| !line.starts_with("| --- ")).skip(1).collect();
    let shown: Vec<&str> = shown.into_iter().take_while(|line| line.starts_with('|')).collect();
    assert!(shown.len() >= 5, "{shown:?}");
    let given = shown.iter().map(|line| {
        let frame: usize = line[1..].split('|').next().and_then(|n| n.trim().parse().ok()).expect("a frame");
        let (row, iou) = (&rows[frame - 1], found[frame - 1].iou(&truth[frame - 1]));
        let [p_lost, status, usable] = at.map(|k| row[k]);
        let p_lost: f64 = p_lost.parse().expect("a number");
        format!("| {frame} | {p_lost:.2} | {status} | {usable} | {iou:.2} |")
    });
    assert_eq!(given.collect::<Vec<_>>(), shown);
}
