//! Computes probabilities of classes from the last Δ looks (section 2.2).
//!
//! Either the multi-fixation RBM includes the classes, and p(y | x) is exact (Larochelle & Hinton 2010), or it was
//! trained without them and a logistic regression reads its hidden units (the paper). In both cases log-probabilities
//! are divided by a temperature that was fitted on held-out digits, so that they are calibrated.

use super::Recognizer;
use crate::geometry::Gaze;
use crate::saved_state::SavedState;
use foveate_base::files::Files;
use foveate_base::{Error, Result};
use foveate_learn::rbm::fixations::{About, FixationRbm, Reading};
use foveate_learn::softmax::{Softmax, normalize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A recogniser with the last Δ looks in it.
#[derive(Clone, Debug)]
pub struct MultiFixation {
    rbm: Arc<FixationRbm>,
    classifier: Option<Arc<Softmax>>,
    temperature: f64,
    reading: Reading,
    hidden: Vec<f32>,
    names: Arc<[String]>,
}

impl MultiFixation {
    /// Joins a machine and, if it has no classes, a classifier of its hidden units. `temperature` divides the
    /// machine's own log-probabilities; a classifier has its own temperature.
    ///
    /// Fails if both have classes or neither, or their sizes differ.
    pub fn new(rbm: Arc<FixationRbm>, classifier: Option<Arc<Softmax>>, temperature: f64) -> Result<Self> {
        let fits = match &classifier {
            Some(classifier) => rbm.classes() == 0 && classifier.width() == rbm.hidden(),
            None => rbm.classes() > 1,
        };
        if !fits || !(1e-3..=1e3).contains(&temperature) {
            let width = classifier.map_or(0, |c| c.width());
            return Err(Error::Invalid(format!(
                "a recogniser is a multi-fixation RBM with classes, or one without and a classifier of its hidden units; got {} classes, {} hidden units, a classifier of {width}, temperature {temperature}",
                rbm.classes(),
                rbm.hidden()
            )));
        }
        let (reading, hidden) = (rbm.reading(), vec![0.0; rbm.hidden()]);
        Ok(Self { rbm, classifier, temperature, reading, hidden, names: [].into() })
    }
    /// With names for its classes, in their order; others than as many are left out.
    pub fn named(self, names: Vec<String>) -> Self {
        let names = if names.len() == self.classes() { names } else { vec![] };
        Self { names: names.into(), ..self }
    }
    /// Reads a model file, and [the classifier beside it](classifier_path) if the machine has no classes.
    pub fn read(files: &dyn Files, path: &Path) -> Result<(Self, About)> {
        let (rbm, about) = FixationRbm::from_bytes(&files.read(path)?, path)?;
        let beside = classifier_path(path);
        let classifier = match rbm.classes() {
            0 => Some(Softmax::from_bytes(&files.read(&beside)?, &beside)?.0),
            _ => None,
        };
        let temperature = f64::from(about.temperature);
        Ok((Self::new(Arc::new(rbm), classifier.map(Arc::new), temperature)?, about))
    }
    /// The machine.
    pub fn rbm(&self) -> &FixationRbm {
        &self.rbm
    }
    /// Δ: the largest number of looks in a decision.
    pub fn window(&self) -> usize {
        self.rbm.window()
    }
    /// Adds the first layer's features of a look, and drops the oldest of more than Δ. Allocates nothing.
    fn look(&mut self, features: &[f32], gaze: Gaze) {
        let code = self.rbm.places().code(gaze.u as f32, gaze.v as f32);
        self.reading.fixate(&self.rbm, features, code);
    }
    /// log p(y | the last Δ looks), nats; the same for all classes while there is none. Allocates nothing.
    fn log_probabilities(&mut self, log_p: &mut [f64]) {
        if self.reading.count() == 0 {
            return log_p.fill(-(log_p.len() as f64).ln());
        }
        match &self.classifier {
            Some(classifier) => {
                self.reading.hidden_probabilities(&self.rbm, &mut self.hidden);
                let hidden = foveate_base::rows::Rows::new(&self.hidden, self.hidden.len());
                classifier.log_probabilities(hidden, log_p);
            }
            None => {
                self.reading.log_posterior(&self.rbm, log_p);
                log_p.iter_mut().for_each(|q| *q /= self.temperature);
                normalize(log_p);
            }
        }
    }
}

impl Recognizer for MultiFixation {
    fn classes(&self) -> usize {
        self.classifier.as_ref().map_or(self.rbm.classes(), |c| c.classes())
    }
    fn names(&self) -> &[String] {
        &self.names
    }
    fn width(&self) -> usize {
        self.rbm.glimpse_len()
    }
    fn recognize(&mut self, features: &[f32], gaze: Gaze, log_p: &mut [f64]) {
        self.look(features, gaze);
        self.log_probabilities(log_p);
    }
    fn reset(&mut self) {
        self.reading.clear();
    }
    fn save(&self) -> SavedState {
        SavedState::new(&self.reading)
    }
    fn load(&mut self, saved: &SavedState) -> Result<()> {
        let reading = saved.read().ok().filter(|reading: &Reading| reading.fits(&self.rbm));
        self.reading = reading.ok_or_else(|| Error::Invalid("the saved looks are of another recogniser".into()))?;
        Ok(())
    }
}

/// The path of the classifier of a machine without classes: FILE.softmax beside FILE.
pub fn classifier_path(path: &Path) -> PathBuf {
    let mut name = path.to_path_buf().into_os_string();
    name.push(".softmax");
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::files::Folder;
    use foveate_base::rows::Rows;
    use foveate_learn::rbm::fixations::{Code, Cost, Places, Recipe, Sequences, Trainer};
    use foveate_learn::softmax::Fit;
    use foveate_learn::training::Training;

    /// A machine learned on two patterns at two places, and the data.
    fn learned(cost: Cost, classes: usize) -> (Arc<FixationRbm>, Vec<f32>, Vec<Code>, Vec<u8>) {
        let (mut x, mut z, mut y) = (vec![], vec![], vec![]);
        for i in 0..60usize {
            for k in 0..2 {
                x.extend((0..4).map(|j| f32::from(u8::from((j + k + i) % 2 == 0))));
                z.push(Code::one_hot(k));
            }
            y.push((i % 2) as u8);
        }
        let places = Places::new(vec![[-0.5, 0.0], [0.5, 0.0]]).expect("two places");
        let usual = Recipe::new(cost, 2, classes, places);
        let recipe = Recipe { hidden: 8, factors: 8, epochs: 20, rate: 0.03, batch: 10, ..usual };
        let data = Sequences::new(Rows::new(&x, 4), &z, &y, 2).expect("they fit");
        let mut trainer = Trainer::new(recipe, data).expect("they fit");
        while !trainer.is_done() {
            trainer.epoch(data);
        }
        (Arc::new(trainer.learned().expect("finite")), x, z, y)
    }

    #[test]
    fn both_kinds_recognise_patterns_and_go_on_where_they_were_saved() {
        let (own, x, ..) = learned(Cost::HybridSequential, 2);
        let (bare, rows, z, y) = learned(Cost::Generative, 0);
        let hidden = bare.hidden_probabilities(Rows::new(&rows, 4), &z, 2);
        let (classifier, _) = Softmax::fit(Rows::new(&hidden, 8), &y, 2, Fit::default()).expect("they fit");
        assert!(MultiFixation::new(bare.clone(), None, 1.0).is_err());
        let dir = tempfile::tempdir().expect("a temporary folder");
        let path = dir.path().join("m.safetensors");
        let about = About { metadata: Default::default(), first_layer: String::new(), temperature: 1.0 };
        bare.save(&path, &about).expect("a writable folder");
        assert!(
            MultiFixation::read(&Folder::here(), &path).expect_err("no classifier").to_string().contains(".softmax")
        );
        classifier.save(&classifier_path(&path), &Default::default()).expect("a writable folder");
        for mut recogniser in [
            MultiFixation::new(own, None, 1.0).expect("it has classes"),
            MultiFixation::read(&Folder::here(), &path).expect("both").0,
        ] {
            let mut log_p = [0.0; 2];
            recogniser.log_probabilities(&mut log_p);
            assert_eq!((recogniser.classes(), log_p), (2, [-(2f64.ln()); 2]));
            for i in 0..6 {
                recogniser.reset();
                for k in 0..2 {
                    let u = if k == 0 { -0.5 } else { 0.5 };
                    recogniser.look(&x[(i * 2 + k) * 4..][..4], Gaze { u, v: 3.0, arm: None });
                }
                recogniser.log_probabilities(&mut log_p);
                assert!(log_p[i % 2] > 0.7f64.ln(), "{i}: {log_p:?}");
            }
            let mut other = recogniser.clone();
            other.reset();
            other.load(&recogniser.save()).expect("the same machine");
            let mut again = [0.0; 2];
            other.log_probabilities(&mut again);
            assert_eq!(again, log_p);
            assert!(other.load(&SavedState::new(&3)).is_err());
            crate::conformance::recognizer(&|| Box::new(recogniser.clone()));
        }
    }
}
