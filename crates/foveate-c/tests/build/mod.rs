//! Compilers of the system, and programs made by them.

use foveate_testing::program;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::SystemTime;

#[derive(Clone, Copy)]
pub(crate) enum Language {
    C,
    Cpp,
}

impl Language {
    pub(crate) fn ending(self) -> &'static str {
        if matches!(self, Self::C) { "c" } else { "cpp" }
    }
    /// The compiler and its standard, if it is installed.
    pub(crate) fn compiler(self) -> Result<[&'static str; 2], String> {
        let [name, standard] = if matches!(self, Self::C) { ["cc", "-std=c99"] } else { ["c++", "-std=c++17"] };
        program(name, "--version").map(|()| [name, standard])
    }
}

/// The flags of OpenCV, if it is installed with its header files.
pub(crate) fn opencv() -> Result<Vec<&'static str>, String> {
    let found = Path::new("/usr/include/opencv4/opencv2/videoio.hpp").is_file();
    let flags = ["-isystem", "/usr/include/opencv4", "-lopencv_core", "-lopencv_videoio"];
    if found { Ok(flags.to_vec()) } else { Err("OpenCV's header files".into()) }
}

/// The static library that these tests were built with: the newest one beside them.
pub(crate) fn archive() -> PathBuf {
    let tests = std::env::current_exe().expect("the path of the test");
    let entries = std::fs::read_dir(tests.parent().expect("a folder")).expect("readable");
    let libraries = entries.map(|entry| entry.expect("readable").path()).filter(|path| {
        let name = path.file_name().expect("a name").to_string_lossy();
        name.starts_with("libfoveate_c") && name.ends_with(".a")
    });
    let time = |path: &PathBuf| path.metadata().and_then(|data| data.modified()).unwrap_or(SystemTime::UNIX_EPOCH);
    libraries.max_by_key(time).expect("cargo builds the static library before the tests")
}

/// A way to compile programs.
pub(crate) struct Build<'a> {
    compiler: [&'static str; 2],
    folder: &'a Path,
    flags: Vec<&'static str>,
}

impl<'a> Build<'a> {
    pub(crate) fn new(compiler: [&'static str; 2], folder: &'a Path) -> Self {
        Self { compiler, folder, flags: vec![] }
    }
    pub(crate) fn with(self, flags: &[&'static str]) -> Self {
        Self { flags: [&self.flags, flags].concat(), ..self }
    }
    /// Whether a program compiled with these flags runs.
    pub(crate) fn offers(&self, what: &str) -> Result<(), String> {
        let (source, program) = (self.folder.join("empty.c"), self.folder.join("empty"));
        std::fs::write(&source, "int main(void) { return 0; }\n").expect("a writable folder");
        let succeeds = |command: &mut Command| {
            let command = command.stdout(Stdio::null()).stderr(Stdio::null());
            command.status().is_ok_and(|status| status.success())
        };
        let compiled = succeeds(Command::new(self.compiler[0]).args(&self.flags).arg(source).arg("-o").arg(&program));
        if compiled && succeeds(&mut Command::new(program)) { Ok(()) } else { Err(what.into()) }
    }
    /// Compiles a program of tests/programs.
    pub(crate) fn program(&self, name: &str) -> PathBuf {
        self.compile(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/programs").join(name))
    }
    /// Compiles a program, with every warning an error.
    pub(crate) fn compile(&self, source: &Path) -> PathBuf {
        let program = self.folder.join(source.file_name().expect("a name")).with_extension(match self.compiler[0] {
            "cc" => "of-c",
            _ => "of-cpp",
        });
        let [compiler, standard] = self.compiler;
        let mut command = Command::new(compiler);
        command.args([standard, "-O1", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow", "-Wconversion", "-I"]);
        command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("include"));
        command.arg(source).arg("-o").arg(&program).arg(archive()).args(&self.flags);
        run(command.args(["-lpthread", "-ldl", "-lm", "-lgcc_s"]));
        program
    }
}

/// Runs a program that must succeed; returns its output.
pub(crate) fn run(command: &mut Command) -> String {
    let Output { status, stdout, stderr } = command.output().expect("a program that starts");
    let (printed, errors) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
    assert!(status.success(), "{command:?}: {status}\n{printed}\n{errors}");
    printed.into_owned()
}
