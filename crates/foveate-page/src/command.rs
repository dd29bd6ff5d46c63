//! The command line that reproduces a track.

use std::path::Path;

use foveate_core::Profile;
use foveate_core::geometry::BBox;

/// Returns the `foveate track` command for these boxes: the first one is --init, the others are --reinit.
pub fn command(path: &Path, given: &[(usize, BBox)], config: &str, policy: Option<&str>, seed: Option<u64>) -> String {
    let numbers = |b: &BBox| format!("{},{},{},{}", b.x + 1.0, b.y + 1.0, b.w, b.h);
    let mut line = format!("foveate track {}", quoted(&path.to_string_lossy()));
    for (k, (index, bbox)) in given.iter().enumerate() {
        line += &match k {
            0 if *index == 0 => format!(" --init {}", numbers(bbox)),
            0 => format!(" --from {} --init {}", index + 1, numbers(bbox)),
            _ => format!(" --reinit {}:{}", index + 1, numbers(bbox)),
        };
    }
    if config != Profile::Balanced.name() {
        line += &format!(" --config {}", quoted(config));
    }
    if let Some(policy) = policy {
        line += &format!(" --policy {policy}");
    }
    if let Some(seed) = seed {
        line += &format!(" --seed {seed}");
    }
    line
}

/// Quotes a path for a shell.
fn quoted(path: &str) -> String {
    if path.starts_with('-') { word(&format!("./{path}")) } else { word(path) }
}

/// Quotes a word for a shell.
pub fn word(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_is_one_that_a_shell_understands() {
        let (a, b) = (BBox::new(9.0, 19.0, 30.0, 40.5), BBox::new(0.0, 0.0, 30.0, 40.0));
        assert_eq!(
            command(Path::new("a.mp4"), &[(0, a)], "natural", None, None),
            "foveate track a.mp4 --init 10,20,30,40.5"
        );
        let given = [(4, a), (9, b)];
        assert_eq!(
            command(Path::new("it's; rm"), &given, "digits", Some("hedge"), Some(3)),
            r"foveate track 'it'\''s; rm' --from 5 --init 10,20,30,40.5 --reinit 10:1,1,30,40 --config digits --policy hedge --seed 3"
        );
        assert_eq!(quoted("-x"), "./-x");
    }
}
