//! C and C++ programs, compiled by the system's compilers and linked with the library: they get the boxes of the Rust library, bit for
//! bit, and misuse gives codes.

mod build;
mod scene;

use foveate_testing::{data, need, program, skip};
use std::path::Path;
use std::process::Command;

use build::{Build, Language, archive, opencv, run};
use scene::{Scene, Video};

/// Runs boxes.c or boxes.cpp on a video, under a tool if one is given.
fn boxes(tool: &[&str], program: &Path, kind: &str, configuration: &str, video: &Video, half: usize) -> String {
    let file = program.with_extension(format!("{kind}.raw"));
    std::fs::write(&file, video.bytes()).expect("a writable folder");
    let words = [tool, &[program.to_str().expect("UTF-8"), kind, configuration]].concat();
    let mut command = Command::new(words[0]);
    command.args(&words[1..]).arg(&file);
    command.args(video.layout().map(|n| n.to_string())).arg(half.to_string());
    command.args(video.scene.boxes.iter().flatten().map(|n| n.to_string()));
    run(&mut command)
}

fn compare(program: &Path, video: &Video) {
    for (kind, configuration, expected) in [
        ("single", "fast", video.scene.single("natural-fast")),
        ("many", "multi-boxes", video.scene.many("multi-boxes")),
    ] {
        let found = boxes(&[], program, kind, configuration, video, video.scene.frames.len() / 2);
        let differs = expected.lines().zip(found.lines()).position(|(a, b)| a != b);
        assert!(expected == found, "{kind}: the first line that differs is {differs:?}:\n{expected}\n{found}");
        assert!(expected.lines().count() >= video.scene.frames.len() - 1, "{expected}");
    }
}

/// Every layout of pixels, with gaps between rows, and a state that is saved and continued half-way.
#[test]
fn boxes_are_those_of_rust() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (language, formats) in [(Language::C, [1, 4]), (Language::Cpp, [2, 3])] {
        let program =
            Build::new(need!(language.compiler()), dir.path()).program(&format!("boxes.{}", language.ending()));
        for format in formats {
            compare(&program, &Video { scene: &Scene::synthetic(16), format, gap: 8 * format });
        }
    }
}

#[test]
fn boxes_in_real_video_are_those_of_rust() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let programs = [Language::C, Language::Cpp].map(|language| {
        let compiler = language.compiler()?;
        Ok::<_, String>(Build::new(compiler, dir.path()).program(&format!("boxes.{}", language.ending())))
    });
    for name in ["Car1", "Couple", "Crossing", "Dog1", "DragonBaby", "Jogging"] {
        let scene = Scene::read(&need!(data(&format!("tracking/{name}"))), 12);
        for program in &programs {
            compare(need!(program.as_ref().map_err(String::clone)), &Video { scene: &scene, format: 1, gap: 0 });
        }
    }
}

#[test]
fn misuse_gives_codes() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let build = Build::new(need!(Language::C.compiler()), dir.path());
    for name in ["misuse.c", "threads.c"] {
        run(&mut Command::new(build.program(name)));
    }
}

#[test]
fn memory_is_flat_for_2000_updates() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let program = Build::new(need!(Language::C.compiler()), dir.path()).program("flat.c");
    if !Path::new("/proc/self/status").is_file() {
        return skip("/proc/self/status");
    }
    let scene = Scene::synthetic(30);
    let file = dir.path().join("flat.raw");
    std::fs::write(&file, Video { scene: &scene, format: 1, gap: 0 }.bytes()).expect("a writable folder");
    let numbers = [scene.width, scene.height, scene.frames.len()].into_iter().chain(scene.boxes[0]);
    let printed = run(Command::new(program).arg(file).args(numbers.map(|n| n.to_string())));
    let kb: Vec<i64> = printed.lines().map(|line| line.parse().expect("a number")).collect();
    println!("resident memory after 200 and 2,000 updates: {kb:?} kB");
    assert!(kb.len() == 2 && kb[1] - kb[0] <= 1024, "{kb:?} kB");
}

#[test]
fn the_sanitizers_find_nothing() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"];
    let build = Build::new(need!(Language::C.compiler()), dir.path()).with(&flags);
    need!(build.offers("AddressSanitizer"));
    for name in ["misuse.c", "threads.c"] {
        run(&mut Command::new(build.program(name)));
    }
    let scene = Scene::synthetic(6);
    let found =
        boxes(&[], &build.program("boxes.c"), "many", "multi-boxes", &Video { scene: &scene, format: 3, gap: 1 }, 2);
    assert_eq!(found, scene.many("multi-boxes"));
}

#[test]
fn valgrind_finds_nothing() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let build = Build::new(need!(Language::C.compiler()), dir.path()).with(&["-g"]);
    need!(program("valgrind", "--version"));
    let tool =
        ["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", "--errors-for-leak-kinds=definite,indirect"];
    for name in ["misuse.c", "threads.c"] {
        run(Command::new(tool[0]).args(&tool[1..]).arg(build.program(name)));
    }
    let video = Video { scene: &Scene::synthetic(4), format: 0, gap: 3 };
    for (kind, configuration) in [("single", "fast"), ("many", "multi-boxes")] {
        let found = boxes(&tool, &build.program("boxes.c"), kind, configuration, &video, 1);
        assert!(found.lines().count() >= 3, "{found}");
    }
}

#[test]
fn examples_track() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let scene = Scene::synthetic(8);
    let [x, y, w, h] = scene.boxes[0].map(|n| n.to_string());
    let example = Build::new(need!(Language::C.compiler()), dir.path()).program("../../examples/track.c");
    let (width, height) = (scene.width.to_string(), scene.height.to_string());
    let file = dir.path().join("example.raw");
    std::fs::write(&file, Video { scene: &scene, format: 1, gap: 0 }.bytes()).expect("a writable folder");
    let input = std::fs::File::open(&file).expect("it was written");
    let printed = run(Command::new(example).args([&width, &height, &x, &y, &w, &h]).stdin(input));
    let seen = scene.seen("natural");
    let lines = seen.iter().zip(1..).map(|(seen, frame)| {
        let (b, usable) = (seen.bbox, if seen.is_usable() { "usable" } else { "guess" });
        format!("{frame} {:.2} {:.2} {:.2} {:.2} {usable} P(lost) {:.2}\n", b.x, b.y, b.w, b.h, seen.p_lost)
    });
    assert_eq!(printed, lines.collect::<String>());

    let flags = need!(opencv());
    let build = Build::new(need!(Language::Cpp.compiler()), dir.path()).with(&flags);
    for (t, rgb) in scene.frames.iter().enumerate() {
        let head = format!("P6\n{width} {height}\n255\n").into_bytes();
        std::fs::write(dir.path().join(format!("frame{t:03}.ppm")), [&head[..], rgb].concat()).expect("writable");
    }
    let pictures = dir.path().join("frame%03d.ppm");
    let printed =
        run(Command::new(build.program("../../examples/track_opencv.cpp")).arg(pictures).args([&x, &y, &w, &h]));
    let lines = seen.iter().zip(1..).map(|(seen, frame)| {
        assert!(seen.is_usable(), "the example keeps the last usable box");
        let round = |v: f64| v.round_ties_even();
        let (b, p) = (seen.bbox, seen.p_lost);
        let (left, top) = (round(b.x), round(b.y));
        let (w, h) = (round(b.x + b.w) - left, round(b.y + b.h) - top);
        format!("{frame} {left} {top} {w} {h} ok P(lost) {p:.2}\n")
    });
    assert_eq!(printed, lines.collect::<String>());
}

#[test]
fn code_of_the_guide_compiles() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let page =
        std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/c.md")).expect("the page");
    let mut compiled = 0;
    for block in page.split("```").skip(1).step_by(2) {
        let (language, code) = block.split_once('\n').expect("a block has lines");
        let language = match language {
            "c" => Language::C,
            "cpp" => Language::Cpp,
            _ => continue,
        };
        let mut build = Build::new(need!(language.compiler()), dir.path()).with(&["-c"]);
        if code.contains("opencv2") {
            build = build.with(&need!(opencv()));
        }
        let file = dir.path().join(format!("guide{compiled}.{}", language.ending()));
        std::fs::write(&file, code).expect("a writable folder");
        build.compile(&file);
        compiled += 1;
    }
    assert!(compiled >= 2, "{compiled} programs");
}

/// pkg-config and CMake find what `install` installs, shared and static, and the shared library has versioned symbols.
#[test]
fn installed_files_serve_pkg_config_and_cmake() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    need!(Language::C.compiler());
    need!(if cfg!(target_os = "linux") { Ok(()) } else { Err("a system on which the script was tried".to_owned()) });
    let sources = Path::new(env!("CARGO_MANIFEST_DIR"));
    let prefix = dir.path().join("prefix");
    run(Command::new(sources.join("install")).arg(&prefix).env("FOVEATE_ARCHIVE", archive()));
    let library = prefix.join("lib/libfoveate.so");
    if program("nm", "--version").is_ok() {
        let symbols = run(Command::new("nm").args(["-D", "--defined-only"]).arg(&library));
        let header = std::fs::read_to_string(sources.join("include/foveate.h")).expect("the header");
        let functions = symbols.lines().filter(|line| line.contains(" T "));
        for line in functions.clone() {
            let (name, version) = line.rsplit_once(' ').expect("a name").1.split_once("@@").expect(line);
            assert!(header.contains(&format!("{name}(")) && version == "FOVEATE_0.1", "{line}");
        }
        assert_eq!(functions.count(), header.matches(");").count(), "all functions of the header are exported");
    }
    let works = |name: &str| {
        run(Command::new(dir.path().join(name)).env("LD_LIBRARY_PATH", prefix.join("lib")));
    };
    need!(program("pkg-config", "--version"));
    for (name, options) in [("shared", &["--cflags", "--libs"][..]), ("static", &["--static", "--cflags", "--libs"])] {
        let package = Command::new("pkg-config")
            .args(options)
            .arg("foveate")
            .env("PKG_CONFIG_PATH", prefix.join("lib/pkgconfig"))
            .output();
        let flags = String::from_utf8(package.expect("it is installed").stdout).expect("text");
        let link = if name == "static" { flags.replace("-lfoveate", "-l:libfoveate.a") } else { flags };
        let misuse = sources.join("tests/programs/misuse.c");
        run(Command::new("cc").arg(misuse).arg("-o").arg(dir.path().join(name)).args(link.split_whitespace()));
        works(name);
    }
    need!(program("cmake", "--version"));
    let project = dir.path().join("project");
    std::fs::create_dir(&project).expect("a writable folder");
    let programs = sources.join("tests/programs");
    let text = format!(
        "cmake_minimum_required(VERSION 3.16)\nproject(user C)\nfind_package(foveate 0.1 REQUIRED)\n\
         add_executable(cshared {0}/misuse.c)\ntarget_link_libraries(cshared foveate::foveate)\n\
         add_executable(cstatic {0}/misuse.c)\ntarget_link_libraries(cstatic foveate::static)\n",
        programs.display()
    );
    std::fs::write(project.join("CMakeLists.txt"), text).expect("a writable folder");
    let built = dir.path().join("built");
    let prefixed = format!("-DCMAKE_PREFIX_PATH={}", prefix.display());
    run(Command::new("cmake").arg("-S").arg(&project).arg("-B").arg(&built).arg(prefixed));
    run(Command::new("cmake").arg("--build").arg(&built));
    works("built/cshared");
    works("built/cstatic");
}
