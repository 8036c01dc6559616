//! Where the pixel work is done: one trait, one implementation per device.

mod adapter;
pub mod bend;
pub mod check;
pub mod choice;
pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
#[cfg(not(feature = "gpu"))]
#[path = "no_gpu.rs"]
pub mod gpu;
#[cfg(feature = "testbed")]
mod instant;
mod pyramid;
mod relaxation;
mod spline;
mod sums;

#[cfg(feature = "testbed")]
pub use instant::InstantBackend;
pub(crate) use relaxation::LONGEST;
pub(crate) use spline::{at_pixel, taps};
pub use sums::{ElementMatch, ElementMoments, PixelSums, couple};

use crate::field::Brightness;
use crate::imaging::{Image, Interpolation};
use crate::isa::Isa;
use crate::linalg::Solver;
use crate::mesh::PixelMesh;
use bend::{BentMoments, BentSums};
use std::ops::Deref;
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
    /// A graphics device failed.
    #[error("{device} failed: {message}")]
    Device {
        /// Its name.
        device: String,
        /// What it said.
        message: String,
    },
    /// A graphics device that computes other numbers than the CPU.
    #[error(
        "{device} does not compute what the CPU does: {what} differ by {difference}, where round-off allows {allowed}; update its \
         driver, or use --device cpu (--trust-device measures with it all the same)"
    )]
    Wrong {
        /// Its name.
        device: String,
        /// The numbers that differ most.
        what: String,
        /// Their largest difference.
        difference: String,
        /// What round-off may make of it.
        allowed: String,
    },
    /// A graphics device whose field the CPU does not find.
    #[error(
        "{device} found a field that is up to {difference_px:.2e} px from that of the CPU, where {allowed_px:.2e} px are allowed"
    )]
    WrongField {
        /// Its name.
        device: String,
        /// The largest difference, px.
        difference_px: f64,
        /// What round-off and the tolerance of the iteration allow, px.
        allowed_px: f64,
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

    /// What `to` adds to the deformed image as this transfer shows it, which is about f: shares of f and of 1.
    pub fn change(self, to: Self) -> [f64; 2] {
        let of_f = (to.gain - self.gain) / self.gain;
        let of_one = to.offset - self.offset - of_f * self.offset;
        if self.gain > 0.0 && of_f.is_finite() && of_one.is_finite() { [of_f, of_one] } else { [0.0; 2] }
    }
}

/// What is prepared for every level of a reference image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelOptions {
    /// Interpolation of the deformed image, which says what the gradient of the reference is of.
    pub interpolation: Interpolation,
    /// Grey level subtracted from all images of the series, so that `f32` sums keep their digits.
    pub grey_offset: f32,
    /// Unit of the reference's gradient, grey levels per px: a power of two, in whole numbers of which it is kept in
    /// 16 bits.
    pub gradient_unit: f32,
    /// What white noise of variance one in the pixels adds to the mean square of each component of that gradient.
    pub gradient_noise_gain: f64,
    /// And to the mean product of that gradient and the reference's own, which is another where the former is smoothed.
    pub gradient_pattern_gain: f64,
    /// How brightness and contrast are followed.
    pub brightness: Brightness,
}

impl KernelOptions {
    /// For images about as dark and bright as one whose grey levels lie in `range`.
    pub fn new(range: (f32, f32), interpolation: Interpolation, brightness: Brightness) -> Self {
        let (low, high) = range;
        let gradient_noise_gain = interpolation.gradient_noise_gain();
        Self {
            interpolation,
            grey_offset: 0.5 * (low + high),
            gradient_unit: gradient_unit(high - low),
            gradient_noise_gain,
            gradient_pattern_gain: gradient_noise_gain,
            brightness,
        }
    }

    /// The same for the image that the gradient is taken of.
    pub(crate) fn of_gradient(self) -> Self {
        Self { interpolation: self.interpolation.of_gradient(), ..self }
    }
}

/// The unit in which gradients of an image are kept as whole 16-bit numbers, whose grey levels have this `range`: the
/// smallest power of two (which multiplies without loss) of which 32 767 are at least twice the range. At a pixel the
/// cubic spline rises by 1.1 of the range at most, on the border of an image that is black and white by turns by 1.74 of
/// it. What rounding takes is half a unit, 1/16 000 of the range at most: in 8 bits a
/// hundredth of what noise of one grey level makes of a gradient.
fn gradient_unit(range: f32) -> f32 {
    let exponent = (2.0 * f64::from(range) / 32_767.0).log2().ceil();
    // Of an image without contrast, or of grey levels that are no numbers, any will do.
    if exponent.is_finite() { 2.0f64.powi(exponent.clamp(-100.0, 100.0) as i32) as f32 } else { 1.0 }
}

/// An element of which less than this share of its pixels is inside the deformed image is left out: it
/// would say too little about its far nodes.
const KEPT_SHARE: f64 = 0.5;
/// Of small elements it is so many px of a side, in which one row of pixels more or less does not decide where the node
/// beyond it goes,
const KEPT_PX: f64 = 6.4;
/// but never more than this share.
const KEPT_MOST: f64 = 0.95;
/// It comes back only with this share more, or whole, so that it does not flicker while the field settles.
const BACK_MORE: f64 = 0.1;
/// One that has been left out so often in a field stays so: a node beside it would go in and out with it for ever.
pub const STAYS_OUT: u32 = 3;

/// Shares of its pixels that an element of this size, px, must keep inside the deformed image, and get back once it has
/// been left out.
pub fn kept_and_back_share(element_size: f64) -> [f64; 2] {
    let kept = (KEPT_PX / element_size).clamp(KEPT_SHARE, KEPT_MOST);
    [kept, (kept + BACK_MORE).min(1.0)]
}

/// Where the two images are correlated less than this, a change of light says nothing of how the displacement follows
/// it.
pub const COUPLED: f64 = 0.9;

/// An element that has lost more than this share of its pixels makes the constant matrix too stiff for the
/// right-hand side.
pub const LOST_SHARE: f64 = 0.05;

/// What one Gauss-Newton step found, at the field before its correction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Largest component of the nodal correction, px of the level; not a number when one of them is none.
    pub correction_px: f64,
    /// The node that it belongs to.
    pub worst_node: usize,
    /// Smallest correlation coefficient of a zone that has pixels in the sums.
    pub correlation: f64,
    /// Smallest change of a zone's correlation coefficient since the first evaluation of the field.
    pub gained: f64,
    /// Pixels counted.
    pub counted: f64,
    /// Elements that have lost more than [`LOST_SHARE`] of their pixels; those that are left out count twice.
    pub lost: usize,
}

/// When steps may follow one, with the same solver and the same scale, before the host has seen what that came to: the
/// way to a device and back is then saved. They are not made where any of this does not hold. Twin:
/// shaders/largest.wgsl.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ahead {
    /// So many at most.
    pub steps: usize,
    /// [`Step::correction_px`] at least, and less than.
    pub correction_px: [f64; 2],
    /// [`Step::lost`].
    pub lost: usize,
    /// [`Step::counted`] at least and at most.
    pub counted: [f64; 2],
}

impl Ahead {
    /// None follows.
    pub const NONE: Self = Self { steps: 0, correction_px: [0.0; 2], lost: 0, counted: [0.0; 2] };
}

/// What an iteration has found when it ends.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The displacement, px of the level, per node.
    pub displacement: Vec<[f64; 2]>,
    /// Sums of the last evaluation, per zone.
    pub zones: Vec<PixelSums>,
    /// How the elements matched at the last evaluation.
    pub elements: Vec<ElementMatch>,
    /// Transfer of grey levels per zone; the mean over its elements where each has its own.
    pub transfer: Vec<GreyTransfer>,
}

/// Where a node of a level lies in the mesh of the next coarser one: its displacement there is the sum of
/// those of four nodes by these weights.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Nodes of the coarser mesh.
    pub nodes: [u32; 4],
    /// Their shape functions.
    pub weights: [f64; 4],
}

/// What went between the host and a device for one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Traffic {
    /// Batches of work handed to the device.
    pub submissions: usize,
    /// Times that the host waited for results of the device.
    pub readbacks: usize,
    /// Bytes sent to the device, the image among them.
    pub bytes_up: usize,
    /// Bytes fetched from it.
    pub bytes_down: usize,
}

/// A device that correlates: images and fields live on it, small sums come back.
///
/// The correlator decides (levels, starts, when to stop, what to report); a backend does what touches
/// pixels or runs inside the iteration. Implementations give the same numbers within round-off. Copies share the
/// device.
pub trait Backend: Clone + Send + Sync + 'static {
    /// An image with its pyramid, on the device.
    type Frame: Send + 'static;
    /// A reference prepared at one scale, on the device.
    type Level: Send + Sync;
    /// A displacement field being iterated, on the device.
    type Field: Send;
    /// A solver of the normal equations, on the device too.
    type Solver: Deref<Target = Solver> + Send + Sync;

    /// What device this is: its name and the instruction path or driver.
    fn device(&self) -> String;

    /// Instruction path of the work that stays on the CPU.
    fn host_isa(&self) -> Isa {
        Isa::detect()
    }

    /// Frames worth correlating at the same time, when they do not depend on each other.
    fn frames_in_flight(&self) -> usize {
        1
    }

    /// Brings an image to the device; pyramid levels are made when first asked for.
    ///
    /// # Errors
    /// When the device fails.
    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<Self::Frame, BackendError>;

    /// The image of a frame, on the host.
    fn image(&self, frame: &Self::Frame) -> Arc<Image>;

    /// Grey levels of one pyramid level (0 is the image itself) on the host, for the search of a start.
    fn grey_map(&self, frame: &mut Self::Frame, level: usize) -> GreyMap;

    /// Prepares a reference at one scale: grey levels and gradients of `frame`, and the sums of every
    /// element of `mesh` (in pixels of that level). The gradients are those of `smoothed`, where there is one.
    ///
    /// # Errors
    /// When the device fails.
    fn reference(
        &self,
        frame: &mut Self::Frame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(Self::Level, Vec<ElementMoments>), BackendError>;

    /// Leaves the elements where `active` is false out of all sums.
    ///
    /// # Errors
    /// When the device fails.
    fn restrict(&self, level: &mut Self::Level, active: &[bool]) -> Result<(), BackendError>;

    /// Tells a level where its nodes lie in the next coarser one.
    ///
    /// # Errors
    /// When the device fails.
    fn link(&self, level: &mut Self::Level, places: Vec<Place>) -> Result<(), BackendError>;

    /// Gives back what iterations alone need of a frame; it is made again when they go on.
    fn release(&self, frame: &mut Self::Frame);

    /// Brings a solver of a level's normal equations to the device.
    ///
    /// # Errors
    /// When the device fails.
    fn solver(&self, level: &Self::Level, solver: Solver) -> Result<Self::Solver, BackendError>;

    /// As [`Backend::solver`], for a matrix that is that of `like` but for some rows.
    ///
    /// # Errors
    /// When the device fails.
    fn solver_like(
        &self,
        level: &Self::Level,
        solver: Solver,
        _like: &Self::Solver,
    ) -> Result<Self::Solver, BackendError> {
        self.solver(level, solver)
    }

    /// The solver that was brought to the device, which no longer needs it; none where something else still does.
    fn reclaim(&self, solver: Self::Solver) -> Option<Solver>;

    /// Starts an iteration at `displacement` (px of the level, per node) and `transfer` (per zone).
    ///
    /// # Errors
    /// When the device fails.
    fn start(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<Self::Field, BackendError>;

    /// Starts an iteration where that of the next coarser level `coarse` ended; where it began, unless `moved`.
    ///
    /// # Errors
    /// When the device fails.
    fn start_finer(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        coarse: &Self::Field,
        moved: bool,
    ) -> Result<Self::Field, BackendError>;

    /// Evaluates the sums at the field as it is, per zone, and sets its transfer from them; no correction.
    ///
    /// # Errors
    /// When the device fails.
    fn observe(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError>;

    /// One Gauss-Newton step: right-hand side, solution, update of the field by `scale` times the correction, and of
    /// its transfer. `scale` is `damping (cos a, sin a)`: each correction is turned by the angle a of the field,
    /// since the matrix is made of gradients of the reference, which are turned in the deformed image. Beside the
    /// damping, which is of all, each node is moved by as much of its correction as the fall of its last one tells.
    /// A device may make those after it too, as far as `ahead` allows it, and give them back when they are asked
    /// for; until then nothing else may be asked of the field.
    ///
    /// # Errors
    /// When the device fails.
    fn step(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        solver: &Self::Solver,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError>;

    /// Takes the correction of the last step back and makes another one with `solver` from the same sums: for a frame
    /// that turned out to have lost pixels. As after [`Backend::step`] others may follow.
    ///
    /// # Errors
    /// When the device fails.
    fn solve_again(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        solver: &Self::Solver,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError>;

    /// The right-hand side of the last evaluation, per node: what checks compare.
    ///
    /// # Errors
    /// When the device fails.
    fn right_hand_side(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<Vec<[f64; 2]>, BackendError>;

    /// The moments of the elements that have lost pixels at the last evaluation, counting only those inside
    /// the deformed image; none at all of elements that are left out.
    ///
    /// # Errors
    /// When the device fails.
    fn remaining_moments(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError>;

    /// The sums of the last evaluation, per element, none of elements that are left out; and the transfer of grey
    /// levels per zone, which has followed them.
    ///
    /// # Errors
    /// When the device fails.
    fn element_sums(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError>;

    /// Leaves elements out of all sums of this field, those of the last evaluation too, until told otherwise. They are
    /// still read, see [`Backend::all_sums`]; one that is taken back counts from the next evaluation on.
    ///
    /// # Errors
    /// When the device fails.
    fn exclude(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        excluded: &[bool],
    ) -> Result<(), BackendError>;

    /// The sums of the last evaluation, per element, those of excluded elements too; none of elements that have left
    /// the deformed image or are not active.
    ///
    /// # Errors
    /// When the device fails.
    fn all_sums(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<Vec<PixelSums>, BackendError>;

    /// Puts a field under iteration to `displacement`, px of the level, per node. What follows needs an evaluation.
    ///
    /// # Errors
    /// When the device fails.
    fn place(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        displacement: &[[f64; 2]],
    ) -> Result<(), BackendError>;

    /// Where the iteration of a field started: displacement per node, px of the level, and transfer per zone.
    ///
    /// # Errors
    /// When the device fails.
    #[allow(clippy::type_complexity, reason = "two lists, as `start` takes them")]
    fn read_start(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<(Vec<[f64; 2]>, Vec<GreyTransfer>), BackendError>;

    /// From now on brings the deformed image to the light of the reference before all else: `g` becomes
    /// `gain g + offset`, by the values at the nodes of the level, bilinear within an element. All sums are then those
    /// of this `g`, and the transfers of the zones come after it. For levels whose brightness is not per element. With
    /// [`GreyTransfer::NONE`] at all nodes it is as if none had been set.
    ///
    /// # Errors
    /// When the device fails.
    fn light(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &mut Self::Field,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError>;

    /// What the iteration has found.
    ///
    /// # Errors
    /// When the device fails.
    fn read_field(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
    ) -> Result<Found, BackendError>;

    /// What a reference shows of displacements that bend within these elements.
    ///
    /// # Errors
    /// When the device fails.
    fn bent_moments(&self, level: &Self::Level, elements: &[u32]) -> Result<Vec<BentMoments>, BackendError>;

    /// How far the residual at the field as it is follows such displacements, for these elements, be they out of all
    /// other sums.
    ///
    /// # Errors
    /// When the device fails.
    fn bent_sums(
        &self,
        level: &Self::Level,
        frame: &mut Self::Frame,
        field: &Self::Field,
        elements: &[u32],
    ) -> Result<Vec<BentSums>, BackendError>;

    /// What went between the host and the device for a frame, when they are two.
    fn traffic(&self, _frame: &Self::Frame) -> Option<Traffic> {
        None
    }
}

/// Work for a device that is chosen when the program runs, written once for all of them. What it gives back should no
/// longer say which device it was: that keeps the choice in this one place.
pub trait OnDevice {
    /// What comes of it.
    type Output;

    /// Does it with the device that was chosen.
    fn on<B: Backend>(self, backend: B) -> Self::Output;
}
