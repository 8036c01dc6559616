//! From images to results without a command line: what `quadrille correlate`, `watch`, `simulate`, `identify` and `run` do.
//!
//! [`Plan`] says what is to be done: a case, with a [`Request`] over it. [`run_series`] does it, into a
//! [`RunFolder`], tells whoever watches what happens ([`Event`]), stops when it is asked to ([`Stop`]), goes on where an earlier
//! start was stopped, and returns what came of it ([`Ran`]). [`run_case`] goes on from there to the fit and its report. Nothing here
//! prints or ends the process.

// What others have written must not end the program here either (see crates/io/src): what a run reads again is a file like any other.
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

mod busy;
mod camera;
mod case;
mod check;
mod computing;
mod crack_auto;
mod cracks;
mod doubts;
mod engine;
mod error;
mod event;
mod explore;
mod feed;
mod folder;
mod found;
mod frames;
mod heard;
mod identification;
mod in_memory;
mod kept;
mod lock;
mod look;
mod output;
mod page;
mod pipeline;
mod plan;
pub(crate) mod quantities;
mod read;
mod record;
mod reference;
mod rehearsal;
mod relay;
mod remarks;
mod report;
mod request;
mod restart;
mod run_toml;
mod said;
mod series;
mod session;
mod several;
mod shard;
mod simulation;
mod steps;
mod stop;
mod store_of_run;
mod tally;
pub(crate) mod text;
mod tournament;
mod wanted;
mod watching;
mod which_reference;
mod worker;
mod zones;

pub use busy::Busy;
pub use case::{CaseRun, run_case};
pub use check::{Checked, CheckedZone, check, keeps_to};
pub use error::{Result, RunError};
pub use event::{Event, Watcher};
pub use explore::{Explored, ExplorerPage};
pub use folder::{RunFolder, correlation_in};
pub use identification::identify;
pub use in_memory::InMemory;
pub use look::{FitOfRun, Off, model_less_measured};
pub use plan::{Images, Plan, strain_window};
pub use request::{Export, Request};
pub use series::run_series;
pub use session::{Existing, Outcome, Ran, Session};
pub use several::identify_several;
pub use shard::Shard;
pub use simulation::simulate;
pub use stop::Stop;
pub use text::chain;
pub use tournament::compare_laws;
pub use watching::{Watching, watch};

#[doc(hidden)]
pub use restart::is_of_a_restart;

#[cfg(feature = "cli")]
pub(crate) use self::{
    error::shell_word,
    folder::{About, FIGURES, frame_in_words, locks_in},
    lock::{Holder, holders},
    read::read_json,
    record::Record,
    restart::all_frames,
};
