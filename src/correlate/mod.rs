//! Global Q4 correlation of an image series (THEORY 2): one reference, any number of deformed images.

mod border;
mod chain;
mod correlation;
mod correlator;
mod error;
mod finest;
mod gradient_noise;
mod iterate;
mod level;
mod light;
mod misfit;
mod model_error;
mod noise_correlation;
mod noise_model;
mod options;
mod patch;
mod regularisation;
mod search;
mod series;
mod texture;
mod uncertainty;

pub use border::BareBorder;
pub use chain::{ChainState, Keyframe, ReferenceChain, UpdateRefused};
pub use correlation::{Correlation, StartUsed, ZoneResult};
pub use correlator::Correlator;
pub use error::CorrelationError;
pub use light::SmoothLight;
pub use noise_correlation::NoiseColour;
pub use noise_model::PhotonNoise;
pub use options::Options;
pub use regularisation::Regularisation;
pub use series::{History, Start, Tracker};
pub use texture::{Lack, TextureFault, assumed_noise};
pub use uncertainty::NOISE_CONTRADICTED;
