//! Image files by a numbered pattern: `frames/%04d.png`.

use std::path::{Path, PathBuf};

use crate::folder::is_image;
use foveate_base::{Error, Result};

/// The files of a pattern, by number: `%d` is a number, `%04d` one of at least four digits with leading zeros. `None`
/// if the path is no pattern or a file has exactly this name.
///
/// # Errors
/// Fails if the folder cannot be read, has no file of the pattern, or a number is missing between the first and the last.
pub(crate) fn files(path: &Path) -> Result<Option<Vec<PathBuf>>> {
    let Some((before, digits, after)) = path.file_name().and_then(|name| parts(name.to_str()?)) else {
        return Ok(None);
    };
    if path.exists() {
        return Ok(None);
    }
    let wrong = |problem: String| Error::malformed(path, problem);
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder, "cannot read the folder"))? {
        let file = entry.map_err(Error::io(folder, "cannot read the folder"))?.path();
        let number = file.file_name().and_then(|name| {
            let number = name.to_str()?.strip_prefix(before)?.strip_suffix(after)?;
            let padded = number.len() == digits || (number.len() > digits && !number.starts_with('0'));
            let plain = number.bytes().all(|b| b.is_ascii_digit()) && padded;
            number.parse::<u64>().ok().filter(|_| plain)
        });
        found.extend(number.filter(|_| is_image(&file)).map(|number| (number, file)));
    }
    found.sort();
    if found.is_empty() {
        return Err(wrong(
            "expected .jpg, .png, .bmp, .webp or .tif files with numbers in the place of the pattern, found none"
                .into(),
        ));
    }
    if let Some(gap) = found.windows(2).find(|pair| pair[1].0 != pair[0].0 + 1) {
        let problem = format!(
            "expected a file for every number, found {} and then {}; give the folder itself if the frames between are not wanted",
            gap[0].0, gap[1].0
        );
        return Err(wrong(problem));
    }
    Ok(Some(found.into_iter().map(|(_, file)| file).collect()))
}

/// The part before the number, its least number of digits, and the part after it.
fn parts(name: &str) -> Option<(&str, usize, &str)> {
    let (before, rest) = name.split_once('%')?;
    let (digits, after) = rest.split_once('d')?;
    let digits = match digits.strip_prefix('0') {
        _ if digits.is_empty() => 1,
        Some(digits) => digits.parse().ok().filter(|digits| (1..=20).contains(digits))?,
        None => return None,
    };
    (!after.contains('%')).then_some((before, digits, after))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{open, save_png};
    use foveate_core::scene::Image;

    #[test]
    fn frames_come_by_their_numbers() {
        let dir = tempfile::tempdir().expect("a folder");
        let save = |name: &str, value: u8| {
            save_png(dir.path().join(name), &Image::grey(4, 3, value)).expect("a writable folder");
        };
        for (name, value) in
            [("a0009.png", 9), ("a0010.png", 10), ("a0011.png", 11), ("a12.png", 12), ("b0012.png", 13)]
        {
            save(name, value);
        }
        let values = |pattern: &str| -> Result<Vec<u8>> {
            Ok(open(dir.path().join(pattern))?.map(|f| f.expect("a frame").image.at(0, 0, 0)).collect())
        };
        assert_eq!(values("a%04d.png").expect("three"), [9, 10, 11]);
        assert_eq!(values("a%d.png").expect("one"), [12]);
        let error = |pattern: &str| values(pattern).expect_err(pattern).to_string();
        assert!(error("c%04d.png").contains("found none"));
        save("a0013.png", 13);
        assert!(error("a%04d.png").contains("found 11 and then 13"));
        // A file of this very name is one picture; other signs are no pattern.
        save("a%04d.png", 7);
        assert_eq!(values("a%04d.png").expect("one"), [7]);
        for name in ["a%4d.png", "a%s.png", "a%04d%04d.png", "100%.png"] {
            assert_eq!(parts(name), None, "{name}");
        }
    }
}
