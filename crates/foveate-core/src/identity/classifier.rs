//! Classifies the target into the user's own classes: logistic regression on the first layer's features of one look (section 2.2).
//!
//! log p(y | x) of the last look alone: looks add up over frames outside (`identity/accumulate.rs`). The names of the classes
//! are in the model file, beside the retina and the first layer that it reads.

use super::Recognizer;
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};
use foveate_learn::rbm::io::{pack, unpack};
use foveate_learn::rbm::{Metadata, io};
use foveate_learn::softmax::Softmax;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

const KIND: &str = "classifier";
/// Bytes of a class's name.
const LONGEST: usize = 200;

/// The metadata of a model file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Its origin.
    pub metadata: Metadata,
    /// The first layer of its input features, as JSON. Not used here.
    pub first_layer: String,
    /// Names of the classes, in their order.
    pub names: Vec<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    about: About,
    temperature: f64,
}

/// A classifier of single looks, with the names of its classes.
#[derive(Clone, Debug)]
pub struct Classifier {
    softmax: Arc<Softmax>,
    names: Arc<[String]>,
}

impl Classifier {
    /// Joins them. Fails if the numbers of names and classes differ, or names are equal, empty or too long.
    pub fn new(softmax: Softmax, names: Vec<String>) -> Result<Self> {
        let named = names.iter().all(|n| (1..=LONGEST).contains(&n.len()));
        let alone = names.iter().enumerate().all(|(i, n)| !names[..i].contains(n));
        if names.len() != softmax.classes() || !named || !alone {
            return Err(Error::Invalid(format!(
                "{} classes need as many names, all different, of 1 to {LONGEST} bytes; got {names:?}",
                softmax.classes()
            )));
        }
        Ok(Self { softmax: Arc::new(softmax), names: names.into() })
    }
    /// The regression.
    pub fn softmax(&self) -> &Softmax {
        &self.softmax
    }
    /// The bytes of a model file. The names are the classifier's own.
    pub fn to_bytes(&self, metadata: &Metadata, first_layer: &str) -> Vec<u8> {
        let about = About { metadata: metadata.clone(), first_layer: first_layer.into(), names: self.names.to_vec() };
        let file = File { about, temperature: self.softmax.temperature() };
        pack(KIND, file, &self.softmax.tensors())
    }
    /// Reads a model from the bytes of a file; errors call it `path`.
    ///
    /// Fails, with the reason, if they are not a model file, are of another format or kind, or are damaged in any way.
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, About)> {
        let refuse = |problem: String| io::refuse(path, &problem, KIND);
        let (file, tensors, sealed) = unpack::<File>(bytes, KIND).map_err(refuse)?;
        let softmax = Softmax::of_tensors(tensors, file.temperature).map_err(refuse)?;
        let found = Self::new(softmax, file.about.names.clone()).map_err(|e| refuse(e.to_string()))?;
        sealed.map_err(refuse)?;
        Ok((found, file.about))
    }
    /// Whether these bytes are a model file of this kind, whole or not.
    pub fn is_one(bytes: &[u8]) -> bool {
        io::kind(bytes).as_deref() == Some(KIND)
    }
}

impl Recognizer for Classifier {
    fn classes(&self) -> usize {
        self.softmax.classes()
    }
    fn names(&self) -> &[String] {
        &self.names
    }
    fn width(&self) -> usize {
        self.softmax.width()
    }
    fn recognize(&mut self, features: &[f32], _: Gaze, log_p: &mut [f64]) {
        self.softmax.log_probabilities(Rows::new(features, features.len()), log_p);
    }
    fn reset(&mut self) {}
    fn save(&self) -> SavedState {
        // It stands on one look, and remembers none.
        SavedState::new(&json!({ "looks": [] }))
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        if *saved == Recognizer::save(self) {
            return Ok(());
        }
        Err(Error::Invalid("the saved looks are of another recogniser".into()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_learn::softmax::Fit;

    fn names() -> Vec<String> {
        ["a, b", "\"c\"", "d"].map(String::from).to_vec()
    }

    fn classifier() -> Classifier {
        let rows: Vec<f32> = (0..120).map(|i| ((i * i) as f32).sin()).collect();
        let labels: Vec<u8> = (0..30).map(|i| i % 3).collect();
        let (softmax, _) = Softmax::fit(Rows::new(&rows, 4), &labels, 3, Fit::default()).expect("they fit");
        Classifier::new(softmax, names()).expect("three names")
    }

    #[test]
    fn it_keeps_the_law_and_comes_back_from_its_file() {
        crate::conformance::recognizer(&|| Box::new(classifier()));
        let (path, it) = (Path::new("m.safetensors"), classifier());
        let mut bytes = it.to_bytes(&Metadata::default(), "{}");
        let (back, about) = Classifier::from_bytes(&bytes, path).expect("just written");
        assert_eq!((back.softmax(), about.names), (it.softmax(), names()));
        assert!(Classifier::is_one(&bytes) && !Classifier::is_one(&bytes[..9]));
        *bytes.last_mut().expect("not empty") ^= 1;
        let damaged = Classifier::from_bytes(&bytes, path).expect_err("damaged").to_string();
        assert!(damaged.contains("foveate train classifier"), "{damaged}");
    }

    #[test]
    fn names_must_be_as_many_as_classes_and_differ() {
        let softmax = || classifier().softmax().clone();
        for wrong in [vec!["a", "b"], vec!["a", "b", "a"], vec!["a", "", "b"]] {
            assert!(Classifier::new(softmax(), wrong.into_iter().map(String::from).collect()).is_err());
        }
    }
}
