//! Frames on their way: read, correlated, written.

pub(crate) mod busy;
pub(crate) mod computing;
pub(crate) mod engine;
pub(crate) mod feed;
pub(crate) mod frame;
pub(crate) mod output;
pub(crate) mod pipeline;
pub(crate) mod reference;
pub(crate) mod relay;
pub(crate) mod worker;
