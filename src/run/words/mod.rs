//! What a run says: events, remarks on its files, errors.

pub(crate) mod doubts;
pub(crate) mod error;
pub(crate) mod event;
pub(crate) mod heard;
pub(crate) mod remarks;
pub(crate) mod said;
pub(crate) mod tally;
pub(crate) mod text;
