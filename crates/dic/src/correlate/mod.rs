//! Global Q4 correlation of an image series (THEORY 2): one reference, any number of deformed images.

mod cracks;
mod judge;
mod noise;
mod prepare;
mod prior;
mod result;
mod series;
mod solve;
mod start;

mod correlator;
mod error;

pub use correlator::Correlator;
pub use cracks::crack_search::{CrackSearch, FoundCrack, NoCrack, Rejected, search_cracks};
pub use error::{CorrelationError, Lack, TextureFault, UpdateRefused};
pub use noise::noise_correlation::NoiseColour;
pub use noise::noise_model::PhotonNoise;
pub use noise::reference_noise::assumed_noise;
pub use prepare::options::Options;
pub use prepare::reference::Reference;
pub use prior::border::BareBorder;
pub use prior::regularisation::Regularisation;
pub use result::correlation::{Correlation, StartUsed, ZoneResult};
pub use result::overlap::Overlap;
pub use series::chain::{ChainState, Keyframe, ReferenceChain};
pub use series::chosen::{Correlate, Uploaded, prepare};
pub use series::tracker::{History, Tracker};
pub use solve::light::SmoothLight;
pub use start::initial::Start;
pub use start::period::Ambiguity;
