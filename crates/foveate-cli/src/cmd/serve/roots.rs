//! Restricts the page to the folders and files given on the command line.
//!
//! A place is named by the index of its root and the path below it: `0/walks/one.mp4`.

use std::path::{Component, Path, PathBuf};

use foveate::video::{image_files, is_live, is_video, without_password};
use foveate::{Error, Result};
use serde::Serialize;

/// Maximum number of listed names per folder.
const MOST: usize = 2000;

/// The accessible folders and files.
#[derive(Debug)]
pub(super) struct Roots(Vec<Root>);

#[derive(Debug)]
struct Root {
    /// The path as given.
    given: PathBuf,
    /// The canonical path; for a stream or a camera, its address.
    real: PathBuf,
    live: bool,
}

/// An accessible place.
#[derive(Clone, Debug)]
pub(super) struct Place {
    /// The path as the user would write it.
    pub shown: PathBuf,
    /// The canonical path.
    pub real: PathBuf,
    root: PathBuf,
}

impl Place {
    /// Fails unless this canonical path still leads to itself: a link may have taken its place, or that of a folder above it.
    pub(super) fn check(&self, real: &Path) -> Result<()> {
        if real.canonicalize().is_ok_and(|now| now == real) {
            return Ok(());
        }
        Err(Error::malformed(&self.shown, "it was moved, removed or replaced by a link; open it again"))
    }

    /// Returns a file in the place, or the place itself if it is a file; `None` if the file lies outside the root.
    pub(super) fn inside(&self, file: &Path) -> Option<PathBuf> {
        let real = file.canonicalize().ok()?;
        (real.starts_with(&self.root) && real.is_file()).then_some(real)
    }
}

/// An entry of a folder.
#[derive(Debug, Serialize)]
pub(super) struct Entry {
    pub name: String,
    pub path: String,
    /// The kind: `folder`, `images`, `video` or `stream`.
    pub kind: &'static str,
}

impl Roots {
    /// Fails if a path does not exist or is neither a folder nor a regular file.
    pub(super) fn new(paths: &[PathBuf]) -> Result<Self> {
        let root = |given: &PathBuf| {
            if is_live(given) {
                return Ok(Root { given: given.clone(), real: given.clone(), live: true });
            }
            let cannot = "cannot serve it; give folders or video files that are there";
            let real = given.canonicalize().map_err(Error::io(given, cannot))?;
            if !real.is_dir() && !real.is_file() {
                return Err(Error::malformed(
                    given,
                    "neither a folder nor a regular file; give folders or video files",
                ));
            }
            Ok(Root { given: given.clone(), real, live: false })
        };
        paths.iter().map(root).collect::<Result<_>>().map(Self)
    }

    /// Returns the folder or regular file that a name stands for.
    pub(super) fn find(&self, name: &str) -> Result<Place> {
        let nothing = || Error::Invalid(format!("there is no {name:?} here; choose from the list"));
        let (root, rest) = name.split_once('/').unwrap_or((name, ""));
        let root = root.parse().ok().and_then(|k: usize| self.0.get(k)).filter(|root| !root.live);
        let root = root.ok_or_else(nothing)?;
        let below = Path::new(rest);
        let plain = |part: &Component<'_>| matches!(part, Component::Normal(_));
        if rest.contains(['\0', '\\']) || !below.components().all(|part| plain(&part)) {
            return Err(nothing());
        }
        let join = |path: &Path| if rest.is_empty() { path.to_owned() } else { path.join(below) };
        let real = join(&root.real).canonicalize().map_err(|_| nothing())?;
        if !real.starts_with(&root.real) || !(real.is_dir() || real.is_file()) {
            return Err(nothing());
        }
        Ok(Place { shown: join(&root.given), real, root: root.real.clone() })
    }

    /// Returns the address of a given stream or camera.
    pub(super) fn stream(&self, name: &str) -> Option<&Path> {
        let root = name.parse().ok().and_then(|k: usize| self.0.get(k))?;
        root.live.then_some(&*root.real)
    }

    /// Lists the entries of a place; an empty name lists the roots.
    pub(super) fn list(&self, name: &str) -> Result<Vec<Entry>> {
        if name.is_empty() {
            let entry = |(k, root): (usize, &Root)| {
                let name = root.given.to_string_lossy().into_owned();
                if root.live {
                    return Some(Entry { name: without_password(&name).into(), path: k.to_string(), kind: "stream" });
                }
                kind(&root.real).map(|kind| Entry { name, path: k.to_string(), kind })
            };
            return Ok(self.0.iter().enumerate().filter_map(entry).collect());
        }
        let place = self.find(name)?;
        let entries = std::fs::read_dir(&place.real).map_err(Error::io(&place.shown, "cannot read the folder"))?;
        let mut found = vec![];
        for entry in entries.flatten().take(50 * MOST) {
            let Ok(file) = entry.file_name().into_string() else { continue };
            let path = format!("{name}/{file}");
            let Ok(inner) = self.find(&path) else { continue };
            if let Some(kind) = kind(&inner.real).filter(|_| !file.starts_with('.')) {
                found.push(Entry { name: file, path, kind });
            }
        }
        found.sort_by(|a, b| {
            (a.kind == "video", a.name.to_lowercase()).cmp(&(b.kind == "video", b.name.to_lowercase()))
        });
        if image_files(&place.real).is_ok_and(|files| is_both(&place.real, &files)) {
            found.insert(0, Entry { name: "the pictures of this folder".into(), path: name.into(), kind: "images" });
        }
        found.truncate(MOST);
        Ok(found)
    }
}

/// Returns the kind of a place for the page; `None` if the page cannot show it.
fn kind(path: &Path) -> Option<&'static str> {
    if path.is_dir() {
        let sequence = image_files(path).is_ok_and(|files| !is_both(path, &files));
        return Some(if sequence { "images" } else { "folder" });
    }
    is_video(path).then_some("video")
}

/// Returns whether these pictures lie in the folder itself, beside other folders.
fn is_both(path: &Path, pictures: &[PathBuf]) -> bool {
    let folders = || {
        let entries = std::fs::read_dir(path).into_iter().flatten().flatten().take(50 * MOST);
        entries
            .filter(|entry| !entry.file_name().as_encoded_bytes().starts_with(b"."))
            .any(|entry| entry.path().is_dir())
    };
    pictures.first().is_some_and(|file| file.parent() == Some(path)) && folders()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_the_roots_is_found() {
        let dir = tempfile::tempdir().expect("a folder");
        let at = |name: &str| dir.path().join(name);
        std::fs::create_dir_all(at("in/deep")).expect("writable");
        for file in ["out.mp4", "in/a.mp4", "in/deep/b.MP4", "in/notes.txt", "in/.hidden.mp4"] {
            std::fs::write(at(file), "x").expect("writable");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("out.mp4"), at("in/link.mp4")).expect("a link");
            std::os::unix::fs::symlink(dir.path(), at("in/up")).expect("a link");
            std::os::unix::fs::symlink("/dev/zero", at("in/zero.mp4")).expect("a link");
        }
        let roots = Roots::new(&[at("in"), at("in/deep/b.MP4")]).expect("both are there");
        let names: Vec<String> = roots.list("0").expect("a folder").into_iter().map(|e| e.path).collect();
        assert_eq!(names, ["0/deep", "0/a.mp4"]);
        let kinds: Vec<&str> = roots.list("").expect("roots").iter().map(|e| e.kind).collect();
        assert_eq!(kinds, ["folder", "video"]);
        assert!(roots.find("0/deep/b.MP4").is_ok() && roots.find("1").is_ok());
        // A picture beside folders hides none of them.
        std::fs::create_dir_all(at("both/clip")).expect("writable");
        std::fs::write(at("both/plan.jpg"), "x").expect("writable");
        std::fs::write(at("both/clip/1.jpg"), "x").expect("writable");
        let both = Roots::new(&[at("both")]).expect("it is there");
        assert_eq!(both.list("").expect("roots")[0].kind, "folder");
        let entries = both.list("0").expect("a folder");
        let entries: Vec<_> = entries.iter().map(|entry| (&*entry.path, entry.kind)).collect();
        assert_eq!(entries, [("0", "images"), ("0/clip", "images")]);
        let absolute = format!("0/{}", at("out.mp4").display());
        for name in [
            "",
            "2",
            "-1",
            "0/..",
            "0/../out.mp4",
            "0/deep/../../out.mp4",
            "0/link.mp4",
            "0/up/out.mp4",
            "0/zero.mp4",
            "0/missing",
            "0/./a.mp4/..",
            "0/..\\out.mp4",
            "0/%2e%2e/out.mp4",
            "0/a.mp4\0",
            "1/..",
            "1/../../out.mp4",
            "/etc/passwd",
            &absolute,
        ] {
            assert!(roots.find(name).is_err(), "{name}");
            assert!(name.is_empty() || roots.list(name).is_err(), "{name}");
        }
        let address = PathBuf::from("rtsp://me:secret@host:554/live?user=a@b");
        let roots = Roots::new(&[at("in"), address.clone()]).expect("an address is not looked for");
        assert_eq!((roots.stream("1"), roots.stream("0"), roots.stream("rtsp://h/")), (Some(&*address), None, None));
        assert!(roots.find("1").is_err() && roots.list("1").is_err() && roots.find("1/live").is_err());
        let entry = roots.list("").expect("roots").remove(1);
        assert_eq!((&*entry.name, entry.kind), ("rtsp://host:554/live?user=a@b", "stream"));
        assert!(Roots::new(&[at("nowhere")]).expect_err("it is not there").to_string().contains("nowhere"));
    }
}
