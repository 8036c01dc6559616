//! What a correlation gives: displacements with their uncertainty, strains, rigid motions; and its choices.

mod flattening;
mod mark;
mod measurement;
mod noise;
mod options;
mod point_filter;
mod quantities;
mod rigid;
mod strain;
mod strain_field;
mod strain_window;
mod window;

pub use flattening::Flattened;
pub use mark::{ElementMark, Marked};
pub use measurement::{DOUBTFUL, Measurement, Misfit, ModelError, PointField, Status};
pub use noise::{NOISE_CONTRADICTED, Noise, NoiseCorrelation};
pub use options::{Brightness, Elements, RegularisationKind, StartFrom, UnknownChoice, UpdateReference};
pub use point_filter::{PointFilter, PointFilters};
pub use quantities::{
    CrackLine, CrackTip, CrackValues, Curve, Elasticity, Elongation, Extensometer, Facing, FacingPoint,
    FrameQuantities, Gauge, Jump, NodalNoise, OPEN_BY_SIGMA, OpeningValues, PointValues, Quantities, QuantityError,
    Reading, Region, RegionValues, RemoveRigid, RigidRemoved, Segment, Spread, Strains, StressIntensity, Tension,
    TensionConstant, TensionGauges, TensionOptions, TensionPoint, TipState, Value, at_point, remove_rigid,
};
pub use rigid::{RigidMotion, uniform_strain};
pub use strain::{
    ELEMENT_NOISE, Invariant, NODE_NOISE, StrainDefinition, TensorStrain, element_strain_sigma, node_strain_sigma,
    rotation_deg,
};
pub use strain_field::{StrainField, rotations};
pub use strain_window::{StrainWindows, WindowStrains};
pub use window::StrainWindow;
