//! Where the pixel work is done: one trait, one implementation per device.

pub mod cpu;
mod sums;

pub use sums::{ElementMoments, PixelSums};

use crate::field::Brightness;
use crate::imaging::{Image, Interpolation};
use crate::isa::Isa;
use crate::linalg::Solver;
use crate::mesh::PixelMesh;
use std::sync::Arc;
use thiserror::Error;

/// Why a device could not do its work.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum BackendError {
    /// The device ran out of memory.
    #[error("the device has no memory left for {what}: use larger elements or smaller images")]
    OutOfMemory {
        /// What was to be stored.
        what: String,
    },
}

/// Grey levels of a pyramid level on the host, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyMap {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels less the series' offset.
    pub values: Vec<f32>,
}

/// How brightness and contrast of the deformed image are brought to those of the reference:
/// `f = gain g + offset` (THEORY 2, with gain = 1 + c).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GreyTransfer {
    /// Factor on the deformed image.
    pub gain: f64,
    /// Grey levels added, about the series' offset.
    pub offset: f64,
}

impl GreyTransfer {
    /// No change: `f = g`.
    pub const NONE: Self = Self { gain: 1.0, offset: 0.0 };
}

/// What is prepared for every level of a reference image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelOptions {
    /// Interpolation of the deformed image, and gradient of the reference.
    pub interpolation: Interpolation,
    /// Grey level subtracted from all images of the series, so that `f32` sums keep their digits.
    pub grey_offset: f32,
    /// How brightness and contrast are followed.
    pub brightness: Brightness,
}

/// An element of which less than this share of its pixels is inside the deformed image is left out: it
/// would say too little about its far nodes.
pub const KEPT_SHARE: f64 = 0.5;

/// and comes back only with this share, so that it does not flicker while the field settles.
pub const BACK_SHARE: f64 = 0.6;

/// What one Gauss-Newton step found, at the field before its correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Largest component of the nodal correction, px of the level.
    pub correction_px: f64,
    /// The node that it belongs to.
    pub worst_node: usize,
    /// Sums over the pixels of each zone that are inside the deformed image.
    pub zones: Vec<PixelSums>,
}

/// A device that correlates: images and fields live on it, small sums come back.
///
/// The correlator decides (levels, starts, when to stop, what to report); a backend does what touches
/// pixels or runs inside the iteration. Implementations give the same numbers within round-off.
pub trait Backend: Sync {
    /// An image with its pyramid, on the device.
    type Frame: Send;
    /// A reference prepared at one scale, on the device.
    type Level: Send + Sync;
    /// A displacement field being iterated, on the device.
    type Field: Send;

    /// What device this is: its name and the instruction path or driver.
    fn device(&self) -> String;

    /// Instruction path of the work that stays on the CPU.
    fn host_isa(&self) -> Isa {
        Isa::detect()
    }

    /// Brings an image to the device; pyramid levels are made when first asked for.
    ///
    /// # Errors
    /// When the device fails.
    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<Self::Frame, BackendError>;

    /// Grey levels of one pyramid level (0 is the image itself), for the search of a start.
    ///
    /// # Errors
    /// When the device fails.
    fn grey_map(&self, frame: &mut Self::Frame, level: usize) -> Result<GreyMap, BackendError>;

    /// Prepares a reference at one scale: grey levels and gradients of `frame`, and the sums of every
    /// element of `mesh` (in pixels of that level).
    ///
    /// # Errors
    /// When the device fails.
    fn reference(
        &self,
        frame: &mut Self::Frame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
    ) -> Result<(Self::Level, Vec<ElementMoments>), BackendError>;

    /// Starts an iteration at `displacement` (px of the level, per node) and `transfer` (per zone).
    fn start(&self, level: &Self::Level, displacement: &[[f64; 2]], transfer: &[GreyTransfer]) -> Self::Field;

    /// Evaluates the sums at the field as it is and sets its transfer from them; no correction.
    ///
    /// # Errors
    /// When the device fails.
    fn observe(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
    ) -> Result<Vec<PixelSums>, BackendError>;

    /// Leaves the elements where `active` is false out of all sums.
    fn restrict(&self, level: &mut Self::Level, active: &[bool]);

    /// One Gauss-Newton step: right-hand side, solution, update of the field by `damping` times the
    /// correction, and of its transfer.
    ///
    /// # Errors
    /// When the device fails.
    fn step(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        solver: &Solver,
        damping: f64,
    ) -> Result<Step, BackendError>;

    /// The moments of the elements that have lost pixels, counting only those inside the deformed image.
    ///
    /// # Errors
    /// When the device fails.
    fn remaining_moments(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError>;

    /// The displacement, px of the level, per node.
    ///
    /// # Errors
    /// When the device fails.
    fn displacement(&self, field: &Self::Field) -> Result<Vec<[f64; 2]>, BackendError>;

    /// Transfer of grey levels per zone; the mean over its elements where each has its own.
    fn transfer(&self, level: &Self::Level, field: &Self::Field) -> Vec<GreyTransfer>;

    /// Sums of the last evaluation, per element.
    ///
    /// # Errors
    /// When the device fails.
    fn element_sums(&self, level: &Self::Level, field: &Self::Field) -> Result<Vec<PixelSums>, BackendError>;
}
