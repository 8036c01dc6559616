//! Series of images: of files, in memory, of a camera that still writes.

pub(crate) mod camera;
pub(crate) mod files;
pub(crate) mod imported;
pub(crate) mod in_memory;
mod prepared;
pub(crate) mod watching;
