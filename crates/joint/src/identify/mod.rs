//! Identification: the parameters of the adhesive's law from measured displacements (THEORY 6 and 7).
//!
//! [`Case::new`] makes a [`Problem`] of what a case file names; [`fit`] solves it. The residual, the Jacobian and the
//! weights are in `objective`, `noise` and `weights`, the iteration in `trust_region` and `cone_step`, what the noise does to
//! the result in `statistics`. Units: mm, MPa, N/mm; y up.

mod averages;
mod axes;
mod bands;
mod bootstrap;
mod budget;
mod case;
mod combined;
mod cone_step;
mod constants;
mod derived;
mod discretisation;
mod error;
mod estimated_boundary;
mod far_starts;
mod fit;
mod fitted;
mod given;
mod intervals;
mod law_starts;
mod left_out;
mod load_cell;
mod misfit;
mod missing_mode;
mod noise;
mod objective;
mod observation;
mod options;
mod plausibility;
mod profile;
mod profile_ends;
mod released;
mod released_width;
mod remarks;
mod rotations;
mod stage;
mod starts;
mod statistics;
mod sweep;
mod tournament;
mod trust_region;
mod uncertainties;
mod unknowns;
mod verdict;
mod watch;
mod weights;

pub use crate::io::case::{Discretisation, Intervals, WeightKind};
pub use averages::{Part, Spread, average, average_curve, share_of_interval, within_noise};
pub use bands::{Band, CurveBand, bands, curve_bands};
pub use bootstrap::Bootstrap;
pub use budget::{Budget, BudgetLine, ELEMENT_SIZE, NOISE, NOISE_LEVEL, Parts, interval95};
pub use case::Case;
pub use combined::{
    CombinedCase, CombinedFit, Consistency, SAME_GAP, TestCase, TestFit, TestShare, fit_combined, stds_of_information,
};
pub use cone_step::{StepRegion, cone_step};
pub use constants::{Constant, ConstantEffect, ConstantKind, Face, Source};
pub use derived::{Derived, derived};
pub use discretisation::Refinement;
pub use error::FitError;
pub use fit::{CutShort, Fit, first_order, fit};
pub use fitted::{FittedParameter, FittedQuantity, StartEnd};
pub use intervals::{DRAWS, IntervalBasis, IntervalKind, LINEAR_PROBE, LINEAR_STD, Linearity, doubts};
pub use law_starts::law_like;
pub use left_out::LeftOut;
pub use load_cell::{LoadCell, LoadComparison};
pub use misfit::{Misfit, MisfitGroup, NOISE_LEVEL_STD};
pub use missing_mode::{MissingMode, Mode, opening_share};
pub use noise::{Noise, Precision};
pub use objective::{Evaluation, Problem};
pub use observation::{Observation, ObservedInstant, largest_without_rigid_motion};
pub use options::{FitOptions, RotationCheck};
pub use plausibility::{implausible_joint, implausible_result};
pub use profile::{Profile, profile};
pub use released::{Released, ReleasedParameter};
pub use released_width::ReleasedWidth;
pub use rotations::{ROTATIONS_HELD, ROTATIONS_TOLD, Rotations};
pub use starts::latin_hypercube;
pub use statistics::{NORMAL_95, Statistics};
pub use sweep::{SweepRow, sweep};
pub use tournament::{Average, LawFit, Score, Tournament, laws_of, tournament};
pub use trust_region::{End, FitStatus, Iteration, Local, TrustRegionOptions, minimise};
pub use uncertainties::{
    DEFAULT_ALPHA, DEFAULT_ANGLE, DEFAULT_E, DEFAULT_FACE_PX, DEFAULT_LAW, DEFAULT_NOISE, DEFAULT_NU,
    DEFAULT_PIXEL_SIZE, DEFAULT_THICKNESS_PX, DEFAULT_WIDTH, DEFAULT_YIELD,
};
pub use unknowns::{Scale, Unknown, Unknowns, WIDE};
pub use verdict::{Grounds, LARGEST_CORRELATION, LARGEST_FAILED, LARGEST_NOISE_RATIO, LARGEST_STD, Outcome, Verdict};
pub use watch::{Ended, FitProgress, FitWatch};
pub use weights::{InverseCovariance, Weights};
