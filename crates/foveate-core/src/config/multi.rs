//! Many targets of one configuration: they share retina and first layer.

use super::{Blueprint, Configure};
use crate::ensemble::Ensemble;
use crate::multi::MultiTracker;
use foveate_base::files::Nowhere;
use foveate_base::{Error, Result};

impl Blueprint {
    /// Many targets, with the rules of `[multi_target]`, or the usual ones where it is left out. Randomness of target i is
    /// named by the seed and i.
    ///
    /// # Errors
    /// [`Error::Config`] where it has `[sensor]`, which serves one target, a committee, or a policy that settles beside the centre.
    pub fn multi_tracker(&self, seed: u64) -> Result<MultiTracker> {
        if self.config.sensor.is_some() {
            return Err(Error::Config("sensor: it serves one target; leave it out to follow many".into()));
        }
        if self.config.policy.commits_elsewhere() {
            return Err(Error::Config(
                "policy: to learn anew of another place than the centre takes the whole first picture, which many targets do not keep; \
                 set policy.kind = \"fixed\" with u and v 0, or another kind than explore-then-commit"
                    .into(),
            ));
        }
        if self.config.committee > 1 {
            return Err(Error::Config("committee: it follows one target; leave it out to follow many".into()));
        }
        self.parts()?;
        let blueprint = self.clone();
        let parts = move || blueprint.parts().expect("they were made before");
        let make = move |id| Ensemble::new(vec![parts()], seed, id);
        let (settings, blueprint) = (self.config.multi_target.unwrap_or_default(), self.clone());
        let (make, fresh) = (Box::new(make), Box::new(move || blueprint.preprocessor()));
        Ok(MultiTracker::of(self.origin(seed, 0), settings, self.memory_estimate(), make, fresh))
    }
}

impl MultiTracker {
    /// Many targets by the name of a configuration that ships (`multi`, for example), or by a configuration; none yet.
    ///
    /// # Errors
    /// As [`crate::Tracker::new`].
    pub fn new(what: impl Configure) -> Result<Self> {
        let config = what.config()?;
        let seed = config.seed;
        config.check(&Nowhere)?.multi_tracker(seed)
    }
}
