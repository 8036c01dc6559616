//! The models of quadrille: the mechanics of bonded joints, the identification of their cohesive law from measured
//! fields, and the reduction of tests without a model.

#![cfg_attr(not(test), deny(clippy::unwrap_used))]

pub use quadrille_base::{field, imaging, linalg, mesh, remark, units};
pub use quadrille_io as io;

pub mod identify;
pub mod mechanics;
pub mod reduction;
