//! What an appearance needs only while it looks at a frame. Many targets, looked at one after the other, share it: see
//! [`super::Appearance::exchange`].

use super::colour::Counts;
use super::dense::Maps;
use super::discriminant::Learning;
use super::views::{Apart, Views};
use crate::scene::Image;

/// Scratch buffers of a look: views of the frame, glimpses and features, sums to learn from. The next target ignores their content.
#[derive(Default)]
pub struct Buffers {
    pub(super) views: Views,
    pub(super) glimpses: Vec<f32>,
    pub(super) features: Vec<f32>,
    /// Of places that are learned from.
    pub(super) learned: Vec<f32>,
    pub(super) apart: Apart,
    pub(super) dimmed: Option<Image>,
    pub(super) maps: Maps,
    pub(super) learning: Learning,
    pub(super) counts: Counts,
}

foveate_base::opaque_debug!(Buffers);
