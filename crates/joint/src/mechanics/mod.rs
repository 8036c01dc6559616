//! Cohesive joints: two strips and the adhesive between them, driven by the displacements of their border.
//!
//! [`Model::forward`] gives the displacements at every instant with exact parameter sensitivities; the law of the
//! adhesive is an argument. Units: mm, MPa, N/mm (unit thickness); x to the right, y **up** (THEORY 1).

mod arc_length;
mod boundary;
mod case;
mod case_error;
pub mod cohesive;
mod drives;
pub mod element;
mod energy;
mod error;
mod groups;
mod held;
mod j_integral;
mod joint;
mod model;
mod newton;
mod options;
mod pairing;
mod parts;
mod path_work;
mod reaction;
mod remarks;
mod sensitivity;
mod solution;
mod specimen;
pub mod substrate;
mod supports;
mod tied;

pub use arc_length::{FollowOptions, Followed, PathEnd};
pub use boundary::{BoundaryHistory, Drives};
pub use case::{Joint, MeasuredMesh, case_laws, law_of_case, materials_of_case};
pub use case_error::JointError;
pub use element::{Kinematics, Quadrature};
pub use energy::{Energies, EnergyOptions};
pub use error::{BoundaryFault, MeshFault, ModelError};
pub use groups::{NodeGroup, select_nodes};
pub use j_integral::{JFault, JIntegral, ModeWork, phase_deg};
pub use joint::{Carry, JointMesh};
pub use model::{Model, ModelOptions};
pub use options::{ForwardOptions, NewtonOptions};
pub use parts::JointParts;
pub use reaction::{ReactionAt, ReactionGauge};
pub use sensitivity::{Linearised, NodalField};
pub use solution::{Failure, Instant, Sensitivity, Solution, Status};
pub use specimen::{Specimen, SpecimenError, SpecimenKind, SpecimenOptions};
pub use supports::{RigidBlock, Supports};

use boundary::Drive;
use case_error::wrong;
use model::{Stiffness, Work};
use newton::Path;
use parts::{border_edges, sorted, strips};
use path_work::works_along;
use supports::BlockMotion;
use tied::{NONE, TiedBlock};
