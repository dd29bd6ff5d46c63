//! Inner loops of foveate that need vector instructions.
