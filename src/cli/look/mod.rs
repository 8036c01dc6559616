//! Commands that read the fields of a run.

mod animate;
pub(crate) mod compare;
pub(crate) mod export;
pub(crate) mod figures;
pub(crate) mod frames;
pub(crate) mod import;
pub(crate) mod probe;
pub(crate) mod view;
