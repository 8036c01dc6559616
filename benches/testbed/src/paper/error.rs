//! Why an experiment of the paper cannot be done.

use quadrille::identify::FitError;
use quadrille::mechanics::cohesive::LawError;
use quadrille::mechanics::substrate::SubstrateError;
use quadrille::mechanics::{BoundaryFault, MeshFault, ModelError};
use quadrille::virtual_test::VirtualError;
use thiserror::Error;

/// Why an experiment of the paper cannot be done.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PaperError {
    /// A number of draws that cannot be.
    #[error("{seeds} seeds; choose 1 to {most} (20 are usual)")]
    Seeds {
        /// The number.
        seeds: usize,
        /// The largest.
        most: usize,
    },
    /// A level of noise that is none.
    #[error("noise of {s_px} px; give a finite number, zero or more")]
    Noise {
        /// The standard deviation, px.
        s_px: f64,
    },
    /// The region cannot be followed under the true law.
    #[error(
        "the region has no solution at instant {instant} under this law; choose a lower peak traction phi_n/(e delta_n)"
    )]
    NoSolution {
        /// The instant, from 1.
        instant: usize,
    },
    /// A node of the region that the larger joint does not have.
    #[error(
        "node {node} of the region at ({x}, {y}) mm is not a node of the computed joint: this is a bug in quadrille"
    )]
    NotInJoint {
        /// The node.
        node: u32,
        /// Its position, mm.
        x: f64,
        /// Its position, mm.
        y: f64,
    },
    /// The larger joint.
    #[error(transparent)]
    Virtual(#[from] VirtualError),
    /// The mesh of the region.
    #[error(transparent)]
    Mesh(#[from] MeshFault),
    /// Its border.
    #[error(transparent)]
    Boundary(#[from] BoundaryFault),
    /// Its strips.
    #[error(transparent)]
    Substrate(#[from] SubstrateError),
    /// Its model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Parameters that no adhesive has.
    #[error(transparent)]
    Law(#[from] LawError),
    /// The fit.
    #[error(transparent)]
    Fit(#[from] FitError),
}
