//! Requests of files, settings and streams for too much memory are refused before allocation, in little memory and time.
#![cfg(target_os = "linux")]

mod place;

use std::io::Write;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use foveate::scene::Image;
use foveate::video::{Mp4Writer, encode_jpeg, encode_png};
use place::{PROGRAM, Place, errors};

/// The limit given to the program, and its allowed resident memory.
const ALLOWED: &str = "200M";
const MOST: u64 = 300;
/// The longest computing time, seconds, of which an optimised build takes a tenth. Other programs do not count.
const LONGEST: f64 = 8.0;
/// A run that neither computes nor ends is stopped.
const NEVER: Duration = Duration::from_secs(120);

/// User and system time of a process so far, seconds.
fn computing(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    let after_name = text.rsplit_once(')').map_or("", |(_, rest)| rest);
    // In hundredths of a second.
    after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// A run, which must end in time and in little memory; its output, and whether it succeeded.
fn bounded(place: &Place, args: &[&str]) -> (bool, String) {
    let args = [args, &["--max-memory", ALLOWED]].concat();
    let began = Instant::now();
    let mut child = place.command(&args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("it starts");
    let (status, mut peak, mut used) = (format!("/proc/{}/status", child.id()), 0, 0.0f64);
    loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kilobytes = line.and_then(|line| line.trim().trim_end_matches("kB").trim().parse::<u64>().ok());
        peak = peak.max(kilobytes.unwrap_or(0) >> 10);
        used = used.max(computing(child.id()));
        if peak > MOST || used > LONGEST || began.elapsed() > NEVER {
            let _ = child.kill();
        }
        if let Some(status) = child.try_wait().expect("it can be waited for") {
            let mut said = String::new();
            let mut errors = child.stderr.take().expect("it was asked for");
            std::io::Read::read_to_string(&mut errors, &mut said).expect("text");
            println!("{peak} MiB, {used:.2} s: {args:?}");
            assert!(peak <= MOST && used <= LONGEST, "{args:?}: {peak} MiB, {used:.2} s");
            assert!(status.code().is_some_and(|code| code < 2), "{args:?}: {status}, {said}");
            return (status.success(), said);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn checksum(bytes: &[u8]) -> u32 {
    let step = |c: u32, _| if c & 1 == 1 { 0xedb8_8320 ^ c >> 1 } else { c >> 1 };
    !bytes.iter().fold(!0, |c: u32, b| (0..8).fold(c ^ u32::from(*b), step))
}

/// Small pictures whose headers claim 16384 × 16384 pixels.
fn claims() -> [(&'static str, Vec<u8>); 2] {
    let picture = Image::new(16, 16, 3, vec![90; 768]).expect("whole");
    let (mut png, mut jpeg) = (encode_png(&picture), encode_jpeg(&picture, 80));
    let side = 16384u32.to_be_bytes();
    png[16..20].copy_from_slice(&side);
    png[20..24].copy_from_slice(&side);
    let sum = checksum(&png[12..29]).to_be_bytes();
    png[29..33].copy_from_slice(&sum);
    let frame = jpeg.windows(2).position(|mark| matches!(mark, [0xff, 0xc0..=0xc2])).expect("a frame header");
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
    [("claims.png", png), ("claims.jpg", jpeg)]
}

/// A small picture whose colour profile unpacks to 600 MiB.
fn profiled() -> Vec<u8> {
    let png = encode_png(&Image::new(16, 16, 3, vec![90; 768]).expect("whole"));
    let mut zeros = flate2::write::ZlibEncoder::new(vec![], flate2::Compression::fast());
    (0..600).for_each(|_| zeros.write_all(&[0; 1 << 20]).expect("memory"));
    let profile = [&b"iCCPprofile\0\0"[..], &zeros.finish().expect("memory")].concat();
    let length = (profile.len() as u32 - 4).to_be_bytes();
    [&png[..33], &length, &profile, &checksum(&profile).to_be_bytes(), &png[33..]].concat()
}

/// A short video whose index claims so many frames of one byte, all in the first chunk.
fn claiming(frames: u32, path: &Path) -> Vec<u8> {
    let mut film = Mp4Writer::create(path, 16, 16, 30.0).expect("a film");
    film.push(&Image::new(16, 16, 3, vec![90; 768]).expect("whole"), 0.0).expect("a frame");
    film.finish().expect("a film");
    let mut bytes = std::fs::read(path).expect("it was written");
    let mut write = |name: &[u8; 4], from: usize, numbers: &[u32]| {
        let at = bytes.windows(4).position(|word| word == name).expect("such a box") + from;
        let numbers = numbers.iter().flat_map(|number| number.to_be_bytes());
        bytes[at..].iter_mut().zip(numbers).for_each(|(byte, new)| *byte = new);
    };
    write(b"stsz", 8, &[1, frames]);
    write(b"stsc", 16, &[frames]);
    bytes
}

#[test]
fn nothing_that_is_asked_for_is_taken_first() {
    let place = Place::new();
    let refused = |args: &[&str], word: &str| {
        let (well, said) = bounded(&place, args);
        assert!(!well && said.contains(word), "{args:?}: {said}");
    };
    for (name, bytes) in claims() {
        place.write(name, &bytes);
        refused(&["track", name, "--init", "1,1,9,9"], "20.0 GiB");
        refused(&["look", name, "--map", "saliency"], "20.0 GiB");
    }
    place.write("claims.y4m", b"YUV4MPEG2 W16384 H16384 F30:1\nFRAME\n");
    refused(&["track", "claims.y4m", "--init", "1,1,9,9"], "20.0 GiB");
    place.write("claims.raw", [0; 100]);
    refused(&["track", "claims.raw", "--raw", "16384x16384", "--init", "1,1,9,9"], "20.0 GiB");

    let sparse = |name: &str, head: &[u8], len: u64| {
        place.write(name, head);
        let file = std::fs::OpenOptions::new().write(true).open(place.path(name)).expect("it was written");
        file.set_len(len).expect("room for a hole");
    };
    let head = [&20u32.to_be_bytes()[..], b"ftypisom\0\0\0\0isom", &(400u32 << 20).to_be_bytes(), b"moov"].concat();
    sparse("index.mp4", &head, (400 << 20) + 20);
    refused(&["track", "index.mp4", "--init", "1,1,9,9"], "400 MiB");
    sparse("frames.mp4", &claiming(15_000_000, &place.path("film.mp4")), 16 << 20);
    refused(&["track", "frames.mp4", "--init", "1,1,9,9"], "an index of 15000000 frames");

    let shape = |frame: u32| format!("<box frame=\"{frame}\" xtl=\"1\" ytl=\"1\" xbr=\"9\" ybr=\"9\"/>");
    let track = format!("<track id=\"1\">{}{}</track>", shape(0), shape(99_999));
    place.write("cvat.xml", format!("<annotations>{}</annotations>", track.repeat(1000)));
    refused(&["convert", "cvat.xml", "out.json", "--from", "cvat", "--to", "coco"], "600000 boxes");
    // What can be read can be written.
    let track = format!("<track id=\"1\">{}{}</track>", shape(0), shape(149_999));
    place.write("cvat.xml", format!("<annotations>{track}</annotations>"));
    for to in ["coco", "label-studio"] {
        let (well, said) =
            bounded(&place, &["convert", "cvat.xml", "out.json", "--from", "cvat", "--to", to, "--size", "64x48"]);
        assert!(well, "{said}");
    }
    place.write("cvat.xml", format!("<annotations>{}</annotations>", "<a/>".repeat(8_000_000)));
    refused(&["convert", "cvat.xml", "out.json", "--from", "cvat", "--to", "coco"], "XML of 8000003 elements");
    let attributes: String = (0..300_000).map(|i| format!("a{i}=\"\" ")).collect();
    place.write("cvat.xml", format!("<annotations><a {attributes}/></annotations>"));
    refused(&["convert", "cvat.xml", "out.json", "--from", "cvat", "--to", "coco"], "300000 attributes");
    let box_of = |rest: &str| format!("{{\"image_id\":1,\"bbox\":[1,1,9,9]{rest}}}");
    let coco = |annotations: &str| format!("{{\"images\":[{{\"id\":1}}],\"annotations\":[{annotations}]}}");
    place.write("coco.json", coco(&vec![box_of(""); 2_000_000].join(",")));
    refused(&["convert", "coco.json", "out.txt", "--from", "coco", "--to", "mot"], "JSON of");
    let outline = format!(",\"segmentation\":[{}[]]", "[],".repeat(7_000_000));
    place.write("coco.json", coco(&box_of(&outline)));
    let (well, said) = bounded(&place, &["convert", "coco.json", "out.txt", "--from", "coco", "--to", "mot"]);
    assert!(well && said.contains("segmentations are left out"), "{said}");
    place.write("blank.txt", ["\n".repeat(20_000_000).as_bytes(), b"1,2,3,4\n"].concat());
    for format in ["otb", "vot"] {
        refused(&["convert", "blank.txt", "out.json", "--from", format, "--to", "coco"], "20000001 lines");
    }
    place.write("det.txt", b"1000000000,-1,10,10,20,20,1\n");
    refused(&["track", "video", "--detections", "det.txt"], "none of its 1 boxes counts");
    refused(&["convert", "det.txt", "out.json", "--from", "mot", "--to", "coco"], "1000000000");
    let boxes: String = (0..10_000).map(|i| format!("1,{},{},{},20,20,1\n", i + 1, 1 + i % 90, 1 + i / 90)).collect();
    place.write("inits.txt", boxes);
    refused(&["track", "video", "--inits", "inits.txt"], "10000 targets");
    refused(&["track", "video", "--set", "particles=1000000"], "1000000 of them");
    let train = ["train", "rbm", "--data", "video/img", "--out", "m.safetensors", "--set"];
    refused(&[&train[..], &["training.hidden=1000000000"]].concat(), "65536");
    for many in ["1000000000", "9223372036854775807"] {
        let setting = format!("glimpses.number={many}");
        refused(&[&train[..], &[&setting]].concat(), &format!("{many} glimpses"));
    }

    // A state of 30 million numbers, and one whose indices exceed the largest number.
    let state = |next: u64, tracker: &str| {
        format!("{{\"next_frame\":{next},\"source\":\"v\",\"size\":[9,9],\"tracker\":[{tracker}0]}}")
    };
    place.write("state.json", state(1, &"0,".repeat(30_000_000)));
    refused(&["track", "video", "--load-state", "state.json"], "a state of 60000056 bytes would take");
    place.write("state.json", state(u64::MAX, ""));
    refused(&["track", "video", "--load-state", "state.json"], "18446744073709551615 frames");

    // Inputs without end.
    std::fs::create_dir(place.path("earlier")).expect("a new folder");
    std::os::unix::fs::symlink("/dev/zero", place.path("earlier/run.json")).expect("a link");
    let list = ["track", "video", "-c", "c.toml", "-o", "earlier"];
    refused(&list, "expected the list of files");
    std::fs::remove_file(place.path("earlier/run.json")).expect("it was there");
    let fifo = std::process::Command::new("mkfifo").arg(place.path("earlier/run.json")).status();
    assert!(fifo.expect("mkfifo").success());
    refused(&list, "expected the list of files");
    refused(&["eval", "--seqs", "video", "--config", "c.toml", "--out", "earlier"], "expected the list of files");
    let zero = "/dev/zero";
    std::fs::create_dir_all(place.path("zeros/img")).expect("a new folder");
    std::os::unix::fs::symlink(zero, place.path("zeros/img/1.png")).expect("a link");
    std::os::unix::fs::symlink(zero, place.path("truth.txt")).expect("a link");
    let weights = place::CONFIG.replace("kind = \"raw\"", "kind = \"rbm\"\nweights = \"/dev/zero\"");
    place.write("weights.toml", weights);
    refused(&["track", zero, "--init", "1,1,9,9"], "yuv4mpeg");
    refused(&["track", "zeros", "--init", "1,1,9,9"], "not a regular file");
    refused(&["track", "video", "-c", "weights.toml"], "not a regular file");
    for option in ["--detections", "--inits", "--load-state", "--recognise"] {
        refused(&["track", "video", option, zero], "not a regular file");
    }
    std::fs::remove_file(place.path("video/groundtruth_rect.txt")).expect("it was there");
    std::os::unix::fs::symlink(zero, place.path("video/groundtruth_rect.txt")).expect("a link");
    refused(&["track", "video"], "no box to start from");
    refused(&["eval", "--seqs", "video", "--out", "e"], "not a regular file");

    // Small requests succeed.
    place.write("profile.png", profiled());
    let (well, said) = bounded(&place, &["look", "profile.png", "--map", "saliency"]);
    assert!(well, "{said}");
    let (well, said) = bounded(&place, &["track", "video", "-c", "c.toml", "--init", "50,60,28,28", "-o", "o"]);
    assert!(well, "{said}");
}

/// With little address space threads and allocations are refused at any place. The program may end there, but it does not panic, wait
/// for ever, or give half a result a final name without a report of where it ends.
#[test]
fn threads_and_memory_that_are_not_given_are_no_panic() {
    let place = Place::new();
    let shell = "ulimit -v $0 && exec timeout 30 \"$@\"";
    let (mut done, mut refused) = (0, 0);
    for kilobytes in (40_000..=120_000u64).step_by(4_000).chain([2_000_000]) {
        let _ = std::fs::remove_dir_all(place.path("o"));
        let limit = kilobytes.to_string();
        let mut command = std::process::Command::new("bash");
        command.current_dir(place.path("")).env("RUST_BACKTRACE", "0").args(["-c", shell, &limit, PROGRAM]);
        command.args(["track", "video", "-c", "c.toml", "--init", "50,60,28,28", "-o", "o", "--threads", "3"]);
        let output = command.output().expect("bash");
        let said = errors(&output);
        assert!(!said.contains("panicked"), "{kilobytes} kB: {said}");
        assert!(![Some(101), Some(124)].contains(&output.status.code()), "{kilobytes} kB: {}, {said}", output.status);
        let lines = std::fs::read_to_string(place.path("o/boxes.txt")).map_or(0, |text| text.lines().count());
        match output.status.success() {
            true => done += 1,
            false => refused += 1,
        }
        let whole = std::fs::read_dir(place.path("video/img")).expect("a folder").count();
        // A picture that could not be had ends the track before it: the error names it, and the results so far are there.
        let broken = lines == 0 || said.contains(&format!("frame {}:", lines + 1));
        assert!(lines == whole || !output.status.success() && broken, "{kilobytes} kB: {lines} lines: {said}");
    }
    assert!(done > 0 && refused > 0, "{done} done, {refused} refused");
}
