use super::*;

fn write(folder: &Path, name: &str, text: &str) {
    fs::write(folder.join(name), text).expect("a writable folder");
}

/// Writes these files with this text as a complete run.
fn run(out: &Path, names: &[&str], text: &str) -> Result<Vec<PathBuf>> {
    let results = Results::begin(out, names, &[])?;
    names.iter().for_each(|name| write(results.folder(), name, text));
    results.keep(Ended::Finished, 1, None)
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    let mut names: Vec<_> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).expect("a file")
}

#[test]
fn a_run_takes_the_place_of_an_earlier_one_whole() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("a/b");
    run(&out, &["boxes.txt", "film.mp4"], "one").expect("a first run");
    assert_eq!(names(&out), ["boxes.txt", "film.mp4", "run.json"]);
    let began = Results::begin(&out, &["boxes.txt"], &[]).expect("a second one");
    write(began.folder(), "boxes.txt", "two");
    assert_eq!(read(&out, "boxes.txt"), "one");
    drop(began);
    assert_eq!((read(&out, "boxes.txt").as_str(), names(&place.path().join("a"))), ("one", vec!["b".to_owned()]));
    let paths = run(&out, &["boxes.txt"], "three").expect("a third one");
    assert_eq!(paths, [out.join("boxes.txt")]);
    assert_eq!((read(&out, "boxes.txt").as_str(), names(&out)), ("three", vec!["boxes.txt".into(), "run.json".into()]));
    assert_eq!(names(&place.path().join("a")), ["b"], "nothing else stays");
    // Nothing was there, and nothing comes.
    drop(Results::begin(&place.path().join("x/y/z"), &["boxes.txt"], &[]).expect("a folder that can be made"));
    assert_eq!(names(place.path()), ["a"]);
}

#[test]
fn other_files_stay() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("out");
    fs::create_dir_all(out.join("mine")).expect("a folder");
    write(&out, "notes.txt", "mine");
    write(&out, "film.mp4", "mine");
    write(&out, "boxes.txt", "mine, until a run writes one");
    run(&out, &["boxes.txt", "report.html"], "one").expect("a first run");
    run(&out, &["boxes.txt"], "two").expect("a second one");
    assert_eq!(names(&out), ["boxes.txt", "film.mp4", "mine", "notes.txt", "run.json"]);
    assert_eq!((read(&out, "film.mp4"), read(&out, "boxes.txt")), ("mine".into(), "two".into()));
    assert_eq!(names(place.path()), ["out"]);
    // A list that was tampered with reaches nothing elsewhere.
    write(place.path(), "precious", "mine");
    let list =
        r#"{ "program": "foveate 0", "complete": true, "files": ["../precious", "/etc/hosts", "mine", "boxes.txt"] }"#;
    write(&out, MANIFEST, list);
    assert_eq!(listed(&out), ["boxes.txt"]);
    run(&out, &["other.txt"], "three").expect("a third one");
    assert_eq!(names(&out), ["film.mp4", "mine", "notes.txt", "other.txt", "run.json"]);
    assert!(place.path().join("precious").is_file());
}

#[test]
fn what_a_killed_run_left_is_removed_or_put_back() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("out");
    // A number that no process has: the largest that systems give is below it.
    let dead = i32::MAX;
    let (part, other) = (format!(".out.{dead}.tmp"), format!(".outer.{dead}.tmp"));
    for name in [&*part, &*other, ".out.notes.tmp", ".out.1.txt"] {
        fs::create_dir(place.path().join(name)).expect("a folder");
        write(&place.path().join(name), "boxes.txt", "half");
    }
    let away = place.path().join(format!(".out.{dead}.old"));
    fs::create_dir(&away).expect("a folder");
    write(&away, "boxes.txt", "the run before");
    drop(Results::begin(&out, &["boxes.txt"], &[]).expect("a run"));
    assert_eq!(read(&out, "boxes.txt"), "the run before", "put back");
    assert_eq!(names(place.path()), [".out.1.txt", ".out.notes.tmp", &*other, "out"]);
}

#[test]
fn impossible_results_are_refused_before_the_work() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("out");
    run(&out, &["film.mp4"], "one").expect("a first run");
    write(place.path(), "file", "");
    fs::create_dir(out.join("boxes.txt")).expect("a folder");
    let film = out.join("film.mp4");
    let begin = |out: &Path, names: &[&str], inputs: &[&Path]| {
        let error = Results::begin(out, names, inputs).err().expect("an error").to_string();
        assert!(error.contains("give another --out"), "{error}");
        error
    };
    assert!(begin(&place.path().join("file"), &["a"], &[]).contains("found a file"));
    assert!(begin(&out, &["boxes.txt"], &[]).contains("found a folder"));
    assert!(begin(&out, &["track.csv"], &[&film]).contains("it is read"));
    write(&out, MANIFEST, "[1, 2]");
    assert!(begin(&out, &["track.csv"], &[]).contains("run.json"));
    assert!(begin(Path::new("/"), &["track.csv"], &[]).contains("a name"));
    assert_eq!(names(place.path()), ["file", "out"]);
}

#[test]
fn a_finished_run_stays_where_a_new_one_lost_a_file() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("out");
    let with_loss = || {
        let mut results = Results::begin(&out, &["boxes.txt", "film.mp4"], &[]).expect("a run");
        write(results.folder(), "boxes.txt", "new");
        results.leave_out(&["film.mp4"]);
        assert!(!results.is_empty());
        let lost = results.folder().join("film.mp4").display().to_string() + ": no space";
        let lost = results.with_final_path(&Error::Invalid(lost));
        assert_eq!(lost.to_string(), format!("{}: no space", out.join("film.mp4").display()));
        results.keep(Ended::Error, 1, Some(&lost))
    };
    // Without a finished run, the other files are kept.
    for _ in 0..2 {
        assert_eq!(with_loss().expect("the others"), [out.join("boxes.txt")]);
        assert_eq!(names(&out), ["boxes.txt", "run.json"]);
    }
    run(&out, &["boxes.txt", "film.mp4"], "good").expect("a finished run");
    let error = with_loss().expect_err("a finished run").to_string();
    assert!(error.contains("out/film.mp4: no space; run it again") && error.contains("is unchanged"), "{error}");
    assert_eq!((read(&out, "boxes.txt").as_str(), read(&out, "film.mp4").as_str()), ("good", "good"));
    let beside = names(place.path());
    assert!(beside[1].starts_with("out.unplaced-"), "{beside:?}");
    assert_eq!(read(&place.path().join(&beside[1]), "boxes.txt"), "new");
}

#[test]
fn results_that_are_not_whole_replace_nothing() {
    let place = tempfile::tempdir().expect("a temporary folder");
    let out = place.path().join("out");
    run(&out, &["boxes.txt"], "one").expect("a first run");
    let results = Results::begin(&out, &["boxes.txt", "film.mp4"], &[]).expect("a second one");
    write(results.folder(), "boxes.txt", "two");
    let error = results.keep(Ended::Finished, 1, None).expect_err("no film").to_string();
    assert!(error.contains("film.mp4") && error.contains("unplaced"), "{error}");
    assert_eq!(read(&out, "boxes.txt"), "one");
    let beside = names(place.path());
    assert!(beside.len() == 2 && beside[1].starts_with("out.unplaced-"), "{beside:?}");
}
