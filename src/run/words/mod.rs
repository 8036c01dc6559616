//! What a run says: events, remarks on its files, errors.

pub(crate) mod doubts;
pub(crate) mod error;
pub(crate) mod event;
pub(crate) mod fields;
pub(crate) mod heard;
pub(crate) mod motion_order;
pub(crate) mod remarks;
pub(crate) mod said;
pub(crate) mod tally;
pub(crate) mod text;

pub(crate) use error::thread;
pub use error::{Result, RunError};
pub use event::{Event, Watcher};
pub(crate) use heard::Heard;
pub use text::chain;
pub(crate) use text::{absolute, file_name, plural, ranges};
