//! Global Q4 correlation of an image series (THEORY 2): one reference, any number of deformed images.

mod correlator;
mod iterate;
mod level;
mod search;
mod series;
mod texture;
mod uncertainty;

pub use correlator::{Correlation, CorrelationError, Correlator, Options, StartUsed, ZoneResult};
pub use series::Tracker;
pub use texture::{Lack, TextureFault, assumed_noise};
