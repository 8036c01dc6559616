//! From images to results without a command line: what `quadrille correlate`, `watch`, `calibrate`, `simulate`,
//! `identify`, `run` and `make virtual-test` do.
//!
//! [`Plan`] says what is to be done: a case, with a [`Request`] over it. [`run_series`] does it, into a
//! [`RunFolder`], tells whoever watches what happens ([`Event`]), stops when it is asked to ([`Stop`]), goes on where
//! an earlier start was stopped, and returns what came of it ([`Ran`]). [`run_case`] goes on from there to the fit and
//! its report. Nothing here prints or ends the process.

// What others have written must not end the program here either (see crates/io/src): what a run reads again is a file
// like any other.
#![cfg_attr(
    not(test),
    deny(
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod calibration;
mod folder;
mod frames;
mod joint;
pub(crate) mod look;
mod plan;
mod series;
pub(crate) mod words;

pub use calibration::{Calibrated, Calibrating, calibrate};
pub use folder::run_folder::{RunFolder, correlation_in};
pub use frames::busy::Busy;
pub(crate) use joint::photograph::photograph;
pub use joint::{
    CaseRun, compare_laws, identify, identify_several, reduce, run_case, simulate, virtual_test, write_virtual_test,
};
pub use look::{Comparison, Explored, ExplorerPage, FitOfRun, Off, PlacedModel, compare, model_less_measured};
pub use plan::{
    Checked, CheckedZone, Existing, Export, Images, Outcome, Plan, Ran, Request, Session, Shard, Stop, check, keeps_to,
    strain_window,
};
pub use series::{
    files::run_series,
    imported::{Import, Imported, import_fields},
    in_memory::InMemory,
    watching::Watching,
    watching::watch,
};
pub use words::{Event, Result, RunError, Watcher, chain};

#[doc(hidden)]
pub use folder::restart::is_of_a_restart;

#[cfg(feature = "cli")]
pub(crate) use self::{
    folder::lock::{Holder, holders},
    folder::read::{make_folder, read_json, read_text, write_file},
    folder::record::Record,
    folder::restart::all_frames,
    folder::run_folder::{About, FIGURES, frame_in_words, locks_in, save_picture},
    look::reference::{of_size, reference},
};
