//! What is minimised: observations, weights, residual, Jacobian.

pub(crate) mod border;
pub(crate) mod estimated_boundary;
pub(crate) mod load_cell;
pub(crate) mod noise;
pub(crate) mod observation;
pub(crate) mod problem;
pub(crate) mod unknowns;
pub(crate) mod weights;
