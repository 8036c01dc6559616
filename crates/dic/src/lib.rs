//! Global Q4 digital image correlation of quadrille: backends that touch pixels, the correlator, synthetic images, and
//! what can be measured on an image.

#![cfg_attr(not(test), deny(clippy::unwrap_used))]

pub use quadrille_base::{clock, digest, field, imaging, isa, linalg, mesh, parts, plane, remark, units};

pub mod backend;
pub mod correlate;
pub mod metrology;
pub mod synth;
