//! The settings of the optimiser.

use foveate_base::Result;
use foveate_base::error::within;

foveate_base::settings! {
    /// How to search.
    pub struct Settings in "optimiser" and rules {
        /// Values remembered, 2 to 2000: the newest. Memory is 24 bytes × window², taken at the start.
        pub window: usize = 300; 2.0 to 2000.0,
        /// Points before the process is used, 2 to 1000; twice the variables and 3 if absent.
        pub warm_up: Option<usize> = None,
        /// Points at which DIRECT may read the bound, for each point proposed; 1 to 100,000.
        pub evaluations: usize = 1000; 1.0 to 1e5,
    }
}

impl Settings {
    fn rules(&self) -> Result<()> {
        self.warm_up.map_or(Ok(()), |points| within("optimiser.warm_up", points as f64, 2.0, 1000.0))
    }
}
