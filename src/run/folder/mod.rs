//! The folder of a run: its store, records, restart, locks.

pub(crate) mod kept;
pub(crate) mod lock;
pub(crate) mod read;
pub(crate) mod record;
pub(crate) mod restart;
pub(crate) mod run_folder;
pub(crate) mod steps;
pub(crate) mod store_of_run;
