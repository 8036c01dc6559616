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
pub use cracks::crack_search::{CrackSearch, FoundCrack, MovedPath, NoCrack, Rejected, move_onto_crack, search_cracks};
pub use error::{CorrelationError, Lack, TextureFault, UpdateRefused};
pub use judge::apart::{Apart, Bodies};
pub use noise::fixed_pattern::FixedPattern;
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

// What its parts share.
use correlator::COARSE;
use cracks::faces::{Followed, follow_nodes};
use error::Result;
use judge::marks::{ImagePair, bilinear, is_mismatch, mark_pulled_along};
use judge::screen::LEAST_LEFT;
use noise::bend::{BendTest, Bent, Looks, is_named};
use noise::fixed_pattern::{find_pattern, pattern_variance};
use noise::interpolation_bias::InterpolationBias;
use noise::misfit::{Look, MATCHED, MisfitTest, Residuals};
use noise::model_error::MeshLines;
use noise::noise_correlation::{NoiseProbe, Prepared, factors};
use noise::noise_model::Elements;
use noise::reference_noise::{high_frequency, rounding};
use noise::stretch::DeformationGradient;
use noise::uncertainty::{NodalSpread, NoiseGain, displacement_in_middle, spread_of};
use prepare::finest::{Finest, finest_level};
use prepare::gradient_noise::{
    AssumedNoise, LEAST_SHARE_OF_VARIANCE, OfElement, diagonal_with_noise, gradient_sums, mass_matrix, without_noise,
};
use prepare::hot_pixels::HotPixels;
use prepare::level::{Level, coarser, support, support_of};
use prepare::own::{Changed, Own};
use prepare::smoothing::smooth_reference;
use prepare::texture::{
    SeenByNode, find_faults, find_least_determined, find_undetermined, lost_in_noise, seen_by_nodes,
};
use prior::border::bare_borders;
use prior::filled::{affine, continue_field, fill_field};
use prior::outliers::replace_outliers;
use prior::regularisation::{PenaltyScale, Regulariser, upper_pairs};
use prior::splines::{KNOT_ELEMENTS, noise_of_values, splines};
use result::correlation::{choose_better, rigid};
use result::point_values::PointValuesOf;
use result::settled::{Iterated, LeftOut, Settled, elements_of};
use solve::iterate::{Enough, Limits, Outcome, SLOW, TOO_SLOW, Turn, WILD_ELEMENTS, iterate, nothing};
use solve::light::{Light, Seen, is_suspected};
use solve::mixing::{Mixed, State};
use solve::pace::Pace;
use start::features::{Features, Pair};
use start::find::{LEAST_INSIDE, score};
use start::initial::{named, numbers};
use start::patch::Patch;
use start::period::{periods, transpose};
use start::search::{Match, Motion, draws, first_motion, fit, motions};
use start::wide_search::wide_motions;
