//! Sequences of fixations to learn from.

use super::Code;
use foveate_base::rows::Rows;
use foveate_base::{Error, Result};

/// Sequences of `window` fixations each: glimpses, places and classes.
#[derive(Clone, Copy, Debug)]
pub struct Sequences<'a> {
    glimpses: Rows<'a>,
    codes: &'a [Code],
    labels: &'a [u8],
    window: usize,
    /// The largest place and label.
    largest: (usize, usize),
}

impl<'a> Sequences<'a> {
    /// `glimpses` has a row for each fixation, sequence after sequence, values from 0 to 1; `codes` one for each row;
    /// `labels` one for each sequence, or none at all.
    ///
    /// Fails if the numbers of rows do not fit, there is no sequence, or a value is out of range.
    pub fn new(glimpses: Rows<'a>, codes: &'a [Code], labels: &'a [u8], window: usize) -> Result<Self> {
        let n = codes.len().checked_div(window).unwrap_or(0);
        if n == 0 || n * window != codes.len() || glimpses.len() != codes.len() || ![0, n].contains(&labels.len()) {
            return Err(Error::Invalid(format!(
                "sequences of {window} fixations need as many glimpses as codes, and a label each or none; got {} glimpses, {} codes, {} labels",
                glimpses.len(),
                codes.len(),
                labels.len()
            )));
        }
        if let Some(i) = glimpses.data().iter().position(|x| !(0.0..=1.0).contains(x)) {
            let (row, x) = (i / glimpses.width(), glimpses.data()[i]);
            return Err(Error::Invalid(format!("glimpse {row} holds {x}: binary units need values from 0 to 1")));
        }
        let place = codes.iter().flat_map(|c| c.parts()).map(|p| p.0).max().unwrap_or(0);
        let label = labels.iter().max().map_or(0, |&l| usize::from(l));
        Ok(Self { glimpses, codes, labels, window, largest: (place, label) })
    }
    /// Number of sequences.
    pub fn len(&self) -> usize {
        self.codes.len() / self.window
    }
    /// Never: there is one at least.
    pub fn is_empty(&self) -> bool {
        false
    }
    /// Fixations of a sequence.
    pub fn window(&self) -> usize {
        self.window
    }
    /// All glimpses, sequence after sequence.
    pub fn glimpses(&self) -> Rows<'a> {
        self.glimpses
    }
    /// All codes, sequence after sequence.
    pub fn codes(&self) -> &'a [Code] {
        self.codes
    }
    /// A label for each sequence, or none at all.
    pub fn labels(&self) -> &'a [u8] {
        self.labels
    }
    /// Fails if they do not fit a machine.
    pub(super) fn check(&self, n_v: usize, places: usize, classes: usize, window: usize) -> Result<()> {
        let (place, label) = self.largest;
        let labelled = classes == 0 || self.labels.len() == self.len();
        if self.glimpses.width() == n_v
            && place < places
            && self.window == window
            && labelled
            && (classes == 0 || label < classes)
        {
            return Ok(());
        }
        Err(Error::Invalid(format!(
            "a machine for {window} fixations of {n_v} values at {places} places and {classes} classes does not fit {} fixations of {} values, places to {place}, {} labels to {label}",
            self.window,
            self.glimpses.width(),
            self.labels.len()
        )))
    }
}
