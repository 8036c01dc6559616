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

pub(crate) use busy::{Busy, Spent};
pub(crate) use engine::{Engine, Failure};
pub(crate) use frame::{Decoded, Done, Frames, Picture};
pub(crate) use pipeline::{Numbered, Widths};
pub(crate) use reference::{Reference, about_reference, element_size_px, windows};
