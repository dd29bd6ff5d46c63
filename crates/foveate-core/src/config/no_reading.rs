//! No recogniser can be read: this build has no learned weights.

use super::RecogniserConfig;
use super::parts::Parts;
use crate::recognition::Recognition;
use foveate_base::Result;
use foveate_base::files::Files;

#[derive(Clone)]
pub(super) enum Recogniser {}

impl RecogniserConfig {
    pub(super) fn read(&self, _: &dyn Files, _: &Parts) -> Result<Recogniser> {
        match *self {}
    }
}

impl Recogniser {
    pub(super) fn recognition(&self) -> Result<Recognition> {
        match *self {}
    }
}
