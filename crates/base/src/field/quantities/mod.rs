//! Numbers drawn from a measured field: at points, along lines, between points, between zones.
//!
//! Every number that is a sum of nodal displacements is a [`Reading`], and its standard uncertainty comes from
//! those of the nodes and from how their noise goes together ([`NodalNoise`]). What cannot be read (outside the
//! mesh, on nodes without measurement) is `None`, never a number.

mod crack;
mod extensometer;
mod facing;
pub(super) mod noise;
mod plan;
mod point;
mod reading;
mod region;
mod register;
mod stress_intensity;
mod tension;

pub use crack::{CrackLine, CrackTip, CrackValues, OPEN_BY_SIGMA, TipState};
pub use extensometer::{Elongation, Extensometer};
pub use facing::{Facing, FacingPoint, Jump};
pub use noise::NodalNoise;
pub use plan::{Curve, FrameQuantities, OpeningValues, Quantities};
pub use point::{PointValues, Segment, at_point};
pub use reading::{Reading, Value};
pub use region::{Region, RegionValues, Spread};
pub use register::{RemoveRigid, RigidRemoved, remove_rigid};
pub use stress_intensity::{Elasticity, StressIntensity};
pub use tension::{Gauge, Strains, Tension, TensionConstant, TensionGauges, TensionOptions, TensionPoint};

use thiserror::Error;

/// Why a quantity cannot be drawn from any field of a mesh.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum QuantityError {
    /// A coordinate or a length is not finite, or a length is not positive.
    #[error("{what} is {value}; give a finite number{}", if *.positive { " above 0" } else { "" })]
    Number {
        /// What is wrong.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Whether it must also be positive.
        positive: bool,
    },
    /// The two ends are one point.
    #[error("{what} from ({x}, {y}) px to the same point has no direction; give two different points")]
    NoLength {
        /// A line or an extensometer.
        what: &'static str,
        /// The point, px.
        x: f64,
        /// The point, px.
        y: f64,
    },
    /// A region that is none.
    #[error("a region has no area; give three corners or more that do not lie on a line")]
    NoArea,
    /// More points than anybody can read.
    #[error("a line of {length_px} px with a point every {step_px} px has more than {limit} points; enlarge the step")]
    TooManyPoints {
        /// Length of the line, px.
        length_px: f64,
        /// Distance of the points, px.
        step_px: f64,
        /// The most that are made.
        limit: usize,
    },
    /// There is no zone of this name.
    #[error("there is no zone '{0}'; the zones are {1}")]
    NoSuchZone(String, String),
    /// Both sides of an opening are one zone.
    #[error("an opening lies between two zones; '{zone}' is given twice")]
    OneZone {
        /// Its name.
        zone: String,
    },
    /// No edge of one zone looks at an edge of the other.
    #[error("zones '{0}' and '{1}' have no edges that face each other across a gap")]
    NotFacing(String, String),
}

fn finite(what: &'static str, values: &[f64]) -> Result<(), QuantityError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(QuantityError::Number { what, value, positive: false }),
        None => Ok(()),
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), QuantityError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(QuantityError::Number { what, value, positive: true }) }
}
