//! What each kernel of a graphics device takes, and the device itself before its first frame.

use super::passes::Bound;
use super::times::Spread;
use quadrille::backend::check::DeviceCheck;
use serde::Serialize;

/// What one kernel takes, in one iteration or for one image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KernelCost {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// How often it runs there.
    pub dispatches: usize,
    /// Seconds of all of these together, on the device's clock.
    pub seconds: Spread,
    /// Nanoseconds per pixel of the image, of the shortest.
    pub ns_per_px: f64,
    /// How near it is to what the memory allows.
    pub bound: Bound,
    /// What the bytes are.
    pub moves: &'static str,
}

/// The start of one kernel, seconds on the wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct KernelStart {
    /// Name of the kernel.
    pub kernel: &'static str,
    /// Making it for the device.
    pub compile_s: f64,
    /// Its first run, on a small image, less its shortest later one: many drivers finish their work only then.
    pub first_run_s: f64,
}

/// The start of a device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StartUp {
    /// Its numbers beside those of the CPU.
    pub check: DeviceCheck,
    /// Opening it.
    pub open_s: f64,
    /// One submission of next to nothing until a few bytes are back, on the wall: an iteration takes one at least.
    pub round_trip_s: Spread,
    /// The shortest kernel on a small image, as a submission of its own, on the wall: what handing over a dispatch
    /// takes.
    pub dispatch_s: f64,
    /// Bytes from the host's memory to the device's, 1e9 per second.
    pub upload_gb_per_s: f64,
    /// All of its kernels together.
    pub kernels_s: f64,
    /// One by one.
    pub kernels: Vec<KernelStart>,
}
