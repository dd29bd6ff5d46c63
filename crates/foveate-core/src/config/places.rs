//! Where a configuration finds the model files that it names.

use foveate_base::files::Files;
use std::path::Path;

/// Where model files are, and the folder there that names are relative to.
pub(super) type Places<'a> = (&'a dyn Files, &'a Path);
