//! The folder of a run: its store, records, restart, locks.

pub(crate) mod kept;
pub(crate) mod lock;
pub(crate) mod read;
pub(crate) mod record;
pub(crate) mod restart;
pub(crate) mod run_folder;
pub(crate) mod steps;
pub(crate) mod store_of_run;

pub(crate) use kept::Kept;
pub(crate) use lock::Lock;
pub(crate) use restart::{Earlier, FrameRecord};
pub(crate) use run_folder::{
    About, CORRELATION, FIGURES, FORCE, J_INTEGRAL, RIGID_MOTION, RunFolder, TOURNAMENT, TOURNAMENT_TRACTIONS,
    correlation_in, csv_name, frame_in_words, locks_in, vtu_name,
};
