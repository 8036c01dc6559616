//! Identification: the parameters of the adhesive's law from measured displacements (THEORY 6 and 7).
//!
//! [`Case::new`] makes a [`Problem`] of what a case file names; [`fit`] solves it. The residual, the Jacobian and the
//! weights are in `objective`, `noise` and `weights`, the iteration in `trust_region` and `cone_step`, what the noise
//! does to the result in `statistics`. Units: mm, MPa, N/mm; y up.

mod cases;
mod doubt;
mod intervals;
mod laws;
mod objective;
mod result;
mod solve;

mod combined;

pub use crate::io::case::{Discretisation, Intervals, WeightKind};
pub use cases::case::Case;
pub use cases::error::FitError;
pub use cases::options::FitOptions;
pub use cases::uncertainties::{
    DEFAULT_ALPHA, DEFAULT_ANGLE, DEFAULT_E, DEFAULT_FACE_PX, DEFAULT_LAW, DEFAULT_NOISE, DEFAULT_NU,
    DEFAULT_PIXEL_SIZE, DEFAULT_THICKNESS_PX, DEFAULT_WIDTH, DEFAULT_YIELD,
};
pub use combined::{
    CombinedCase, CombinedFit, Consistency, SAME_GAP, TestCase, TestFit, TestShare, fit_combined, stds_of_information,
};
pub use doubt::discretisation::Refinement;
pub use doubt::left_out::LeftOut;
pub use doubt::misfit::{Misfit, MisfitGroup};
pub use doubt::missing_mode::{MissingMode, Mode, opening_share};
pub(crate) use doubt::plausibility::extrapolated;
pub use doubt::plausibility::{implausible_joint, implausible_result, implausible_simulation};
pub use doubt::released::{Released, ReleasedParameter};
pub use doubt::released_width::ReleasedWidth;
pub use doubt::rotations::{ROTATIONS_HELD, ROTATIONS_TOLD, Rotations, describe_change};
pub use doubt::significance::NOISE_LEVEL_STD;
pub use doubt::thickness_along::ThicknessAlong;
pub use doubt::verdict::{
    Grounds, LARGEST_CORRELATION, LARGEST_FAILED, LARGEST_NOISE_RATIO, LARGEST_STD, Outcome, Verdict,
};
pub use intervals::bands::{Band, CurveBand, ForceBand, bands, curve_bands};
pub use intervals::bootstrap::Bootstrap;
pub use intervals::budget::{Budget, BudgetLine, ELEMENT_SIZE, NOISE, NOISE_LEVEL, Parts, interval95};
pub use intervals::constants::{Constant, ConstantEffect, ConstantKind, Face, Source};
pub use intervals::intervals_::{DRAWS, IntervalBasis, IntervalKind, LINEAR_PROBE, LINEAR_STD, Linearity, doubts};
pub use intervals::profile::{Profile, profile};
pub use intervals::statistics::{NORMAL_95, Statistics};
pub use laws::averages::{Part, Spread, average, average_curve, share_of_interval, within_noise};
pub use laws::sweep::{SweepRow, sweep};
pub use laws::tournament::{Average, LawFit, Score, Tournament, laws_of, tournament};
pub use objective::border::{Border, Smooth};
pub use objective::load_cell::{LoadCell, LoadComparison};
pub use objective::noise::{Noise, Precision};
pub use objective::observation::{CameraChange, Observation, ObservedInstant, largest_without_rigid_motion};
pub use objective::problem::{Evaluation, Problem};
pub use objective::unknowns::{Asked, OfMaterial, Scale, Unknown, Unknowns, WIDE};
pub use objective::weights::{InverseCovariance, Weights};
pub use result::derived::{Derived, WORK_REACHED, derived, work_along};
pub(crate) use result::derived::{furthest, share_beyond};
pub use result::fitted::{FittedParameter, FittedQuantity, StartEnd};
pub use solve::cone_step::{StepRegion, cone_step};
pub use solve::fit::{CutShort, Fit, first_order, fit};
pub use solve::law_starts::law_like;
pub use solve::starts::latin_hypercube;
pub use solve::trust_region::{End, FitStatus, Iteration, Local, TrustRegionOptions, minimise};
pub use solve::watch::{Ended, FitProgress, FitWatch};

use cases::error::wrong;
use doubt::discretisation::Refined;
use doubt::plausibility::unless_meant;
use doubt::significance::{FALSE_REJECTIONS, as_normal, normal_tail};
use intervals::axes::Axes;
use intervals::bootstrap::Base;
use intervals::budget::Ingredients;
use intervals::intervals_::settle;
use intervals::profile_ends::ProfileEnds;
use objective::border::prescribed_of;
use objective::noise::even_texture;
use objective::weights::scale;
use result::fitted::{Fitted, assess};
use solve::cone_step::{HalfSpace, room};
use solve::far_starts::other_minima;
use solve::stage::{COARSE, Stage, full_weights};
use solve::trust_region::minimise_unless;
