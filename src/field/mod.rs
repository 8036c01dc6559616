//! What a correlation gives: displacement fields with their uncertainty, strains and rigid motions; and the
//! choices it is run with.

mod mark;
mod measurement;
mod noise;
mod options;
mod quantities;
mod rigid;
mod strain;

pub use mark::{ElementMark, Marked};
pub use measurement::{Measurement, Misfit, ModelError, Status};
pub use noise::{Noise, NoiseCorrelation};
pub use options::{Brightness, RegularisationKind, StartFrom, UnknownChoice, UpdateReference};
pub use quantities::{
    Curve, Elongation, Extensometer, Facing, FacingPoint, FrameQuantities, Jump, NodalNoise, OpeningValues,
    PointValues, Quantities, QuantityError, Reading, RemoveRigid, RigidRemoved, Segment, Value, at_point, remove_rigid,
};
pub use rigid::RigidMotion;
pub use strain::{
    ELEMENT_NOISE, NODE_NOISE, StrainDefinition, StrainField, TensorStrain, element_strain_sigma, node_strain_sigma,
};
