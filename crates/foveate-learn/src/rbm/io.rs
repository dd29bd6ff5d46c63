//! Model files: safetensors (readable from Python), with a JSON text under the metadata key `foveate`.
//!
//! The metadata have the format, the kind, the origin of the model, and a SHA-256 of the rest, so that a damaged file
//! is detected. The same model gives the same bytes.

use super::number::{LARGEST, is_usable};
use super::{Rbm, Visible};
use foveate_base::{Error, Result, files};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::path::Path;

/// Version of the files written here; others are refused.
const FORMAT: u32 = 1;
/// The key of the safetensors metadata that holds the JSON text.
const KEY: &str = "foveate";

/// Where a model comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Metadata {
    /// What its visible units see, as JSON; this module does not read it.
    pub retina: String,
    /// The command that trains it again.
    pub command: String,
    /// A description of the training data.
    pub data: String,
    /// SHA-256 of the training rows.
    pub data_sha256: String,
    /// The seed of the training.
    pub seed: u64,
    /// Epochs it was trained for.
    pub epochs: usize,
}

/// A named tensor: name, shape, values row-major.
pub type Tensor<'a> = (&'a str, Vec<usize>, &'a [f32]);
/// Tensors of a file by name.
pub type Tensors = HashMap<String, (Vec<usize>, Vec<f32>)>;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header<T> {
    format: u32,
    kind: String,
    about: T,
    sha256: String,
}

/// The metadata of a model file whose tensors are the whole model.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Where the model comes from.
    pub metadata: Metadata,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct AboutRbm {
    visible: Visible,
    metadata: Metadata,
}

impl Rbm {
    /// The bytes of a model file.
    pub fn to_bytes(&self, metadata: &Metadata) -> Vec<u8> {
        let about = AboutRbm { visible: self.visible(), metadata: metadata.clone() };
        pack("rbm", about, &self.tensors())
    }
    /// W, b and c, as model files have them.
    pub fn tensors(&self) -> Vec<Tensor<'_>> {
        let (n_v, n_h) = self.shape();
        vec![
            ("weights", vec![n_v, n_h], &*self.weights),
            ("visible_bias", vec![n_v], &*self.visible_bias),
            ("hidden_bias", vec![n_h], &*self.hidden_bias),
        ]
    }
    /// From the tensors of a model file, which are used up to what does not belong to a machine; problems in words.
    pub fn of_tensors(visible: Visible, tensors: &mut Tensors) -> std::result::Result<Self, String> {
        let mut take = |name: &str| tensors.remove(name).ok_or_else(|| format!("the tensor {name} is missing"));
        let (weights, visible_bias, hidden_bias) = (take("weights")?, take("visible_bias")?, take("hidden_bias")?);
        let (n_v, n_h) = (visible_bias.1.len(), hidden_bias.1.len());
        if weights.0 != [n_v, n_h] || visible_bias.0 != [n_v] || hidden_bias.0 != [n_h] {
            return Err(format!(
                "weights are {:?}, visible_bias {:?}, hidden_bias {:?}; expected [n_v, n_h], [n_v], [n_h]",
                weights.0, visible_bias.0, hidden_bias.0
            ));
        }
        Self::new(visible, weights.1, visible_bias.1, hidden_bias.1).map_err(|e| e.to_string())
    }
    /// Writes a model file; it is whole or not there.
    pub fn save(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        files::write(path, &self.to_bytes(metadata))
    }
    /// Reads a model from the bytes of a file; `path` stands for it in errors.
    ///
    /// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Metadata)> {
        let (rbm, about) =
            open(bytes, path, "rbm", |about: &AboutRbm, tensors| Self::of_tensors(about.visible, tensors))?;
        Ok((rbm, about.metadata))
    }
    /// Reads a model file; see [`Rbm::from_bytes`].
    pub fn load(path: &Path) -> Result<(Self, Metadata)> {
        Self::from_bytes(&read(path)?, path)
    }
}

/// The bytes of a file, if it is not absurdly large.
pub fn read(path: &Path) -> Result<Vec<u8>> {
    files::read(path, files::MODEL)
}

/// An error of a model file of this kind.
pub fn refuse(path: &Path, problem: &str, kind: &str) -> Error {
    Error::malformed(path, format!("not a usable model: {problem}; `{}` makes one", command(kind)))
}

/// The command that trains a model of this kind.
pub fn command(kind: &str) -> String {
    match kind {
        "mcrbm" | "autoencoder" => format!("cargo run --release -p paper -- train {kind}"),
        _ => format!("foveate train {kind}"),
    }
}

/// The bytes of a file of tensors.
pub fn pack(kind: &str, about: impl Serialize, tensors: &[Tensor<'_>]) -> Vec<u8> {
    let mut header = Header { format: FORMAT, kind: kind.into(), about, sha256: String::new() };
    let bytes: Vec<Vec<u8>> = tensors.iter().map(|t| t.2.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
    let views: Vec<(&str, TensorView<'_>)> = (tensors.iter().zip(&bytes))
        .map(|(t, bytes)| (t.0, TensorView::new(Dtype::F32, t.1.clone(), bytes).expect("values fill their shape")))
        .collect();
    header.sha256 = seal(&header, views.iter().map(|(name, view)| (*name, view)).collect());
    let text = serde_json::to_string(&header).expect("plain data become JSON");
    // One key: a map of several would be written in random order.
    let metadata = HashMap::from([(KEY.to_string(), text)]);
    safetensors::serialize(views, Some(metadata)).expect("a short header and distinct names")
}

/// The content of a file of tensors, and whether its checksum is valid. Check that last, because other checks give
/// better reasons. Problems are texts.
pub fn unpack<T: Serialize + DeserializeOwned>(
    bytes: &[u8],
    kind: &str,
) -> std::result::Result<(T, Tensors, std::result::Result<(), String>), String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| format!("not a whole safetensors file ({e})"))?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let text = metadata.metadata().as_ref().and_then(|m| m.get(KEY));
    let text = text.ok_or_else(|| format!("a safetensors file without our metadata (key {KEY})"))?;
    let plain: serde_json::Value = serde_json::from_str(text).map_err(|e| format!("its metadata is damaged ({e})"))?;
    if plain["format"] != FORMAT || plain["kind"] != kind {
        return Err(format!(
            "it has format {} and kind {}, expected format {FORMAT} and kind \"{kind}\"",
            plain["format"], plain["kind"]
        ));
    }
    let mut header: Header<T> = serde_json::from_str(text).map_err(|e| format!("its metadata is damaged ({e})"))?;
    let mut tensors = Tensors::new();
    for (name, view) in file.iter() {
        if view.dtype() != Dtype::F32 {
            return Err(format!("the tensor {name} holds {:?}, expected F32", view.dtype()));
        }
        let numbers = view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let values: Vec<f32> = numbers.collect();
        if let Some(x) = values.iter().find(|x| x.is_finite() && !is_usable(**x)) {
            return Err(format!(
                "the tensor {name} has a number {x:e}, beyond {LARGEST:e}: sums of it would not be numbers"
            ));
        }
        tensors.insert(name.to_string(), (view.shape().to_vec(), values));
    }
    let promised = std::mem::take(&mut header.sha256);
    let views: Vec<(&str, TensorView<'_>)> = file.iter().collect();
    let found = seal(&header, views.iter().map(|(name, view)| (*name, view)).collect());
    let sealed = if found == promised { Ok(()) } else { Err("its checksum is wrong: the file is damaged".to_string()) };
    Ok((header.about, tensors, sealed))
}

/// The model in the bytes of a model file, built by `take` from all of its tensors, and the metadata of the file.
///
/// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
pub fn open<T: Serialize + DeserializeOwned, M>(
    bytes: &[u8],
    path: &Path,
    kind: &str,
    take: impl FnOnce(&T, &mut Tensors) -> std::result::Result<M, String>,
) -> Result<(M, T)> {
    let no = |problem: String| refuse(path, &problem, kind);
    let (about, mut tensors, sealed) = unpack::<T>(bytes, kind).map_err(no)?;
    let model = take(&about, &mut tensors).map_err(no)?;
    if !tensors.is_empty() {
        return Err(no(format!("it has {} tensors more than a model of kind \"{kind}\"", tensors.len())));
    }
    sealed.map_err(no)?;
    Ok((model, about))
}

/// The kind of a file of tensors; `None` if it is not one of ours.
pub fn kind(bytes: &[u8]) -> Option<String> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).ok()?;
    let text = metadata.metadata().as_ref()?.get(KEY)?;
    serde_json::from_str::<serde_json::Value>(text).ok()?["kind"].as_str().map(String::from)
}

/// SHA-256 over the header (without this) and all tensors, in the order of their names.
fn seal<T: Serialize>(header: &Header<T>, mut tensors: Vec<(&str, &TensorView<'_>)>) -> String {
    tensors.sort_by_key(|t| t.0);
    let mut sha = Sha256::new();
    sha.update(serde_json::to_string(header).expect("plain data become JSON"));
    for (name, view) in tensors {
        sha.update(format!("\n{name}{:?}\n", view.shape()));
        sha.update(view.data());
    }
    sha.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model() -> (Rbm, Metadata, Vec<u8>) {
        let x = |n: usize| (0..n).map(|i| (i as f32 * 0.37).sin()).collect();
        let rbm = Rbm::new(Visible::Gaussian, x(15), x(5), x(3)).expect("finite");
        let metadata = Metadata {
            retina: "{\"side\":28}".into(),
            command: "foveate train".into(),
            seed: u64::MAX,
            ..Default::default()
        };
        let bytes = rbm.to_bytes(&metadata);
        (rbm, metadata, bytes)
    }

    #[test]
    fn models_come_back_from_files_and_equal_models_are_equal_files() {
        let (rbm, metadata, bytes) = model();
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("model.safetensors");
        rbm.save(&path, &metadata).expect("a writable folder");
        assert_eq!(Rbm::load(&path).expect("just written"), (rbm, metadata));
        assert_eq!(std::fs::read(&path).expect("just written"), bytes);
        let missing = Rbm::load(&dir.path().join("none.safetensors")).expect_err("no file").to_string();
        assert!(missing.contains("none.safetensors"), "{missing}");
    }

    #[test]
    fn wrong_files_are_refused_with_the_reason() {
        let path = Path::new("m.safetensors");
        let why = |bytes: &[u8]| Rbm::from_bytes(bytes, path).expect_err("refused").to_string();
        let about = || AboutRbm { visible: Visible::Bernoulli, metadata: Metadata::default() };
        let (w, b, c) = ([0.5f32; 6], [0.0f32; 2], [0.0f32; 3]);
        let nan = [0.0, f32::NAN, 0.0];
        assert!(why(b"").contains("m.safetensors: not a usable model"));
        assert!(why(b"\x89PNG\r\n\x1a\n0123456789").contains("not a whole safetensors file"));
        assert!(
            why(&pack("checkpoint", about(), &[])).contains("kind \"checkpoint\", expected format 1 and kind \"rbm\"")
        );
        assert!(why(&pack("rbm", about(), &[("weights", vec![2, 3], &w)])).contains("visible_bias is missing"));
        let all = |w: Vec<usize>, c: &[f32]| {
            let tensors: [Tensor<'_>; 3] =
                [("weights", w, &[0.5; 6]), ("visible_bias", vec![2], &b), ("hidden_bias", vec![3], c)];
            pack("rbm", about(), &tensors)
        };
        assert!(why(&all(vec![3, 2], &c)).contains("weights are [3, 2]"));
        assert!(why(&all(vec![2, 3], &nan)).contains("hidden_bias[1] is NaN"));
        let (_, _, good) = model();
        assert!(why(&good[..good.len() - 1]).contains("not a whole safetensors file"));
        let mut bent = good.clone();
        *bent.last_mut().expect("not empty") ^= 1;
        assert!(why(&bent).contains("checksum"));
    }

    /// 400 damaged files. None may panic, and none may pass for a model it is not.
    #[test]
    fn damaged_files_never_panic_and_never_pass() {
        let (rbm, metadata, bytes) = model();
        for seed in 0..400 {
            if let Ok(read) = Rbm::from_bytes(&foveate_testing::damaged(&bytes, &[], seed), Path::new("m")) {
                assert_eq!(read, (rbm.clone(), metadata.clone()), "{seed}");
            }
        }
    }
}
