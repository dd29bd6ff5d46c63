//! The saved state of `--save-state` and `--load-state`.

use std::path::Path;

use foveate::config::{Blueprint, Config};
use foveate::video::SourceInfo;
use foveate::{Error, Result, files};

/// The state of a tracker, and the configuration it was created from.
#[derive(serde::Serialize, serde::Deserialize)]
pub(super) struct SavedState {
    pub next_frame: usize,
    pub seed: u64,
    pub config: String,
    /// The name of the video, without its folder.
    #[serde(default)]
    pub source: String,
    /// Width and height of the tracked pictures.
    #[serde(default)]
    pub size: Option<[usize; 2]>,
    pub tracker: serde_json::Value,
}

/// Returns the last component of a path or an address.
pub(super) fn video_name(source: &Path) -> String {
    let whole = std::fs::canonicalize(source);
    whole.as_deref().unwrap_or(source).file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

impl SavedState {
    pub(super) fn write(
        path: &Path,
        (source, about): (&Path, &SourceInfo),
        blueprint: &Blueprint,
        seed: u64,
        next_frame: usize,
        tracker: serde_json::Value,
    ) -> Result<()> {
        let (config, source, size) =
            (blueprint.config().to_toml(), video_name(source), Some([about.width, about.height]));
        let saved = Self { next_frame, seed, config, source, size, tracker };
        let text = serde_json::to_string(&saved).map_err(|e| Error::Invalid(e.to_string()))?;
        files::write(path, text.as_bytes())
    }

    /// Refuses pictures of another size than the tracked ones.
    pub(super) fn check_size(&self, path: &Path, about: &SourceInfo) -> Result<()> {
        let now = [about.width, about.height];
        match self.size.filter(|then| *then != now) {
            Some([w, h]) => Err(Error::malformed(
                path,
                format!(
                    "it was saved in pictures of {w} x {h} pixels, these have {} x {}; give the same --scale and video",
                    now[0], now[1]
                ),
            )),
            None => Ok(()),
        }
    }

    /// Reads a state. Fails if it was saved with another configuration or seed.
    pub(super) fn read(path: &Path, blueprint: &Blueprint, seed: u64) -> Result<Self> {
        let text = files::read_text(path, files::TEXT)?;
        let saved: Self = serde_json::from_str(&text)
            .map_err(|e| Error::malformed(path, format!("not a state written by --save-state: {e}; write it again")))?;
        if saved.seed != seed {
            let problem =
                format!("it was saved with the seed {}, this run has {seed}; give --seed {}", saved.seed, saved.seed);
            return Err(Error::malformed(path, problem));
        }
        let ours = blueprint.config().to_toml();
        // A setting that was added since then has its default value.
        let same = Config::parse(&saved.config, "").is_ok_and(|config| config.to_toml() == ours);
        if !same {
            let differs =
                saved.config.lines().find(|line| !ours.lines().any(|l| l == *line)).unwrap_or("fewer settings");
            let problem = format!("it was saved with another configuration, which has `{differs}`");
            let todo = "give the same --config, --policy, --set and --recognise";
            return Err(Error::malformed(path, format!("{problem}; {todo}")));
        }
        Ok(saved)
    }
}
