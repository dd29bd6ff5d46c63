//! Many trackers of one configuration: they share retina and first layer.

use super::Blueprint;
use crate::Result;
use crate::many::Many;

impl Blueprint {
    /// Many targets, with the rules of `[many]`, or those there are where it is left out. Target i has the tracker that
    /// `tracker(seed, i)` gives.
    pub fn many(&self, seed: u64) -> Result<Many> {
        self.tracker(seed, 0)?;
        let blueprint = self.clone();
        let make = move |id| blueprint.tracker(seed, id).expect("one was made with the same parts");
        Ok(Many::new(self.config.many.unwrap_or_default(), Box::new(make)))
    }
}
