//! The sandbox as a whole. This program is the parent and, if asked, the child, so it has a `main` of its own.
//!
//! The child gives the same frames and errors, has no rights, and is never left out in silence.

use std::ffi::OsString;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

use foveate_core::scene::Image;
use foveate_video::sandbox::{decode_if_asked, decode_image_in};
use foveate_video::{Decoder, Mp4Writer, Options, Sandbox, encode_png, open_with, save_png};

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    if let Some(status) = decode_if_asked(&arguments) {
        return status.into();
    }
    let own = Sandbox(vec![std::env::current_exe().expect("this program").into()]);
    let folder = tempfile::tempdir().expect("a folder");
    if cfg!(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "riscv64"))) {
        the_frames_are_the_same(folder.path(), &own);
        what_has_no_sandbox_is_refused(folder.path(), &own);
        the_child_has_a_filter_and_limits();
        println!("the sandbox keeps its promises");
    } else {
        let problem = decode_image_in(&own, b"").expect_err("another system");
        assert!(problem.contains("Linux"), "{problem}");
    }
    ExitCode::SUCCESS
}

fn picture(t: u8) -> Image {
    Image::new(51, 33, 3, (0..3 * 51 * 33).map(|i| (i % 251) as u8 ^ (t * 3)).collect()).expect("sizes agree")
}

/// The frames of a source and its error.
fn read(path: &Path, sandbox: Option<Sandbox>) -> (Vec<(u64, Image)>, Option<String>) {
    let (mut frames, mut error) = (vec![], None);
    match open_with(path, &Options { decoder: Decoder::Builtin, sandbox, ..Options::default() }) {
        Ok(source) => source.for_each(|frame| match frame {
            Ok(frame) => frames.push((frame.time.to_bits(), frame.image)),
            Err(problem) => error = Some(problem.to_string()),
        }),
        Err(problem) => error = Some(problem.to_string()),
    }
    (frames, error)
}

/// Videos and pictures, whole and damaged, with and without the child.
fn the_frames_are_the_same(folder: &Path, own: &Sandbox) {
    let film = folder.join("film.mp4");
    let mut writer = Mp4Writer::create(&film, 51, 33, 25.0).expect("a writable folder");
    (0..40).for_each(|t| writer.push(&picture(t), f64::from(t) / 25.0).expect("a frame"));
    writer.finish().expect("written");
    let mut bytes = std::fs::read(&film).expect("a file");
    let middle = bytes.len() / 2;
    bytes[middle..middle + 200].fill(0);
    std::fs::write(folder.join("zeros.mp4"), &bytes).expect("a writable folder");
    std::fs::write(folder.join("cut.mp4"), &bytes[..middle]).expect("a writable folder");
    std::fs::write(folder.join("other.mkv"), "no video at all").expect("a writable folder");
    for name in ["pictures", "broken"] {
        std::fs::create_dir(folder.join(name)).expect("a writable folder");
        (0..5).for_each(|t| save_png(folder.join(format!("{name}/{t}.png")), &picture(t)).expect("a writable folder"));
    }
    std::fs::write(folder.join("broken/3.png"), &encode_png(&picture(3))[..300]).expect("a writable folder");
    for (name, frames) in [
        ("film.mp4", 40..41),
        ("pictures", 5..6),
        ("zeros.mp4", 0..41),
        ("cut.mp4", 0..40),
        ("broken", 3..4),
        ("other.mkv", 0..1),
    ] {
        let (free, apart) = (read(&folder.join(name), None), read(&folder.join(name), Some(own.clone())));
        assert_eq!(free.1, apart.1, "{name}");
        assert!(free.0 == apart.0 && frames.contains(&free.0.len()), "{name}: {} frames", free.0.len());
    }
    assert_eq!(decode_image_in(own, &encode_png(&picture(7))), Ok(picture(7)));
}

/// Other sources, and a program that is no child.
fn what_has_no_sandbox_is_refused(folder: &Path, own: &Sandbox) {
    std::fs::write(folder.join("a.y4m"), "YUV4MPEG2 W4 H2 F10:1 Cmono\nFRAME\n12345678").expect("a file");
    let text = read(&folder.join("a.y4m"), Some(own.clone())).1.expect("refused");
    assert!(text.contains("a.y4m") && text.contains("leave out --sandbox"), "{text}");
    let text = read(Path::new("-"), Some(own.clone())).1.expect("refused");
    assert!(text.contains("give a file"), "{text}");
    for (program, word) in [("/bin/true", "failed"), ("/bin/echo", "unknown message"), ("/no/program", "cannot start")]
    {
        for name in ["film.mp4", "pictures"] {
            let (frames, text) = read(&folder.join(name), Some(Sandbox(vec![program.into()])));
            let text = text.expect("an error");
            assert!(frames.is_empty() && text.contains(word) && text.contains(name), "{program}: {text}");
        }
    }
}

/// The kernel lists a filter and limits for a child that decodes.
fn the_child_has_a_filter_and_limits() {
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["decode-in-sandbox", "100000000", "77"]).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = command.spawn().expect("it starts");
    let (mut input, mut output) = (child.stdin.take().expect("piped"), child.stdout.take().expect("piped"));
    let bytes = encode_png(&picture(1));
    input.write_all(&(bytes.len() as u64).to_le_bytes()).and_then(|()| input.write_all(&bytes)).expect("it reads");
    let mut kind = [0];
    output.read_exact(&mut kind).expect("an answer");
    assert_eq!(kind, [1], "a picture");
    let of = |name: &str| std::fs::read_to_string(format!("/proc/{}/{name}", child.id())).expect("it waits");
    let (status, limits) = (of("status"), of("limits"));
    for line in ["Seccomp:\t2", "NoNewPrivs:\t1", "Threads:\t1"] {
        assert!(status.contains(line), "{line}: {status}");
    }
    let limit = |name: &str| limits.lines().find_map(|line| line.strip_prefix(name)?.split_whitespace().next());
    for (name, most) in [("Max open files", "0"), ("Max file size", "0"), ("Max cpu time", "77")] {
        assert_eq!(limit(name), Some(most), "{limits}");
    }
    assert!(limit("Max address space").is_some_and(|bytes| bytes != "unlimited"), "{limits}");
    drop((input, output));
    child.wait().expect("it ends");
}
