//! What can be chosen about a virtual test, and what can be wrong with it.

use crate::mechanics::cohesive::LawError;
use crate::mechanics::substrate::SubstrateError;
use crate::mechanics::{Kinematics, MeshFault, ModelError};
use crate::synth::{Depth, SynthError};
use thiserror::Error;

/// How the grips load the joint of a virtual test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mixity {
    /// They open it from the right, and slide it a little.
    Opening,
    /// They open it from the right and slide it.
    #[default]
    Mixed,
    /// They slide it, and open it a little.
    Sliding,
}

impl Mixity {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Opening => "opening",
            Self::Mixed => "mixed",
            Self::Sliding => "sliding",
        }
    }
}

/// How a virtual test is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualOptions {
    /// Seed of speckles and noise.
    pub seed: u64,
    /// Depth of the images.
    pub depth: Depth,
    /// Standard deviation of the noise, grey levels of 255.
    pub noise_grey: f32,
    /// Mean size of the speckles, px.
    pub speckle_px: f64,
    /// Instants after the reference; the path is the same whatever their number.
    pub instants: usize,
    /// The adhesive: `phi_n` (N/mm), `delta_n`, `delta_t` (mm), `r`.
    pub law: [f64; 4],
    /// How it is loaded.
    pub mixity: Mixity,
    /// How it is computed: with small rotations as in the paper, or with finite ones.
    pub kinematics: Kinematics,
}

impl Default for VirtualOptions {
    /// 19 instants of a joint with the parameters of Table 1 of Fedele et al. (2009) and r = 4, 8 bit, noise of 2 grey
    /// levels.
    fn default() -> Self {
        let (law, mixity) = ([1.0, 0.005, 0.05, 4.0], Mixity::Mixed);
        let kinematics = Kinematics::Paper;
        Self { seed: 1, depth: Depth::U8, noise_grey: 2.0, speckle_px: 4.5, instants: 19, law, mixity, kinematics }
    }
}

impl VirtualOptions {
    /// Largest number of instants.
    pub const MOST_INSTANTS: usize = 1000;

    pub(super) fn check(&self) -> Result<(), VirtualError> {
        if !(1..=Self::MOST_INSTANTS).contains(&self.instants) {
            return Err(VirtualError::Instants { instants: self.instants });
        }
        if !(self.noise_grey.is_finite() && self.noise_grey >= 0.0) {
            return Err(SynthError::Noise { noise: self.noise_grey }.into());
        }
        Ok(())
    }
}

/// Why there is no virtual test.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VirtualError {
    /// A number of instants that cannot be.
    #[error("{instants} instants; choose 1 to {} (19 are usual)", VirtualOptions::MOST_INSTANTS)]
    Instants {
        /// The number.
        instants: usize,
    },
    /// The joint cannot be followed.
    #[error(
        "the joint has no solution at instant {instant} under this law; choose a lower peak traction phi_n/(e delta_n)"
    )]
    NoSolution {
        /// The instant.
        instant: usize,
    },
    /// Parameters that no adhesive has.
    #[error(transparent)]
    Law(#[from] LawError),
    /// A material that there is not.
    #[error(transparent)]
    Substrate(#[from] SubstrateError),
    /// A mesh that makes no joint.
    #[error(transparent)]
    Mesh(#[from] MeshFault),
    /// A border that holds no joint.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Images that cannot be made.
    #[error(transparent)]
    Synth(#[from] SynthError),
}
