//! Commands that read the fields of a run.

mod animate;
pub(crate) mod export;
pub(crate) mod figures;
pub(crate) mod frames;
pub(crate) mod probe;
pub(crate) mod view;
