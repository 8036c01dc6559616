//! What is looked at afterwards: pages, quantities, cracks.

pub(crate) mod apart;
pub(crate) mod compare;
pub(crate) mod crack_auto;
pub(crate) mod explore;
pub(crate) mod fit_of_run;
mod frame;
pub(crate) mod page;
mod projection;
pub(crate) mod quantities;
pub(crate) mod reference;
pub(crate) mod report;

pub use compare::{Comparison, PlacedModel, compare};
pub use explore::{Explored, ExplorerPage};
pub(crate) use fit_of_run::off_at;
pub use fit_of_run::{FitOfRun, Off, model_less_measured};
