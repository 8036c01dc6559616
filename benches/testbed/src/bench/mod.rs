//! What correlation costs on a device: single passes and kernels, a cold pair, a series. `docs/performance.md` says
//! how to read the numbers. Measures and returns; the command line and `benches/` print.

mod graphics;
mod kernels;
mod measured;
mod passes;
mod record;
mod scene;
mod text;
mod times;
mod whole;

pub use kernels::{KernelCost, KernelStart, StartUp};
pub use measured::DeviceRecord;
pub use passes::{Bound, PassCost, ResidualPass, pass_costs};
pub use record::{Device, Record};
pub use scene::{Scene, kernel_options};
pub use times::{Spread, Times, once, repeat};
pub use whole::{PairCost, SeriesCost, Share, pair_cost, series_cost};

use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, BackendError, KernelOptions};
use quadrille::correlate::CorrelationError;
use quadrille::imaging::Image;
use quadrille::mesh::MeshError;
use quadrille::synth::SynthError;
use quadrille_base::clock::Elapsed;
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use thiserror::Error;

/// Why nothing could be measured.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BenchError {
    /// The device failed.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The correlation of the synthetic images failed.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// The images are too small for such elements.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The images cannot be made.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// A frame that must converge did not: its time would mean nothing.
    #[error(
        "frame {frame} of {size} x {size} px with elements of {element} px did not converge: choose other elements"
    )]
    NotConverged {
        /// Number of the frame in the series.
        frame: usize,
        /// Side of the image, px.
        size: usize,
        /// Side of the elements, px.
        element: usize,
    },
}

/// What a device's figures are read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Processor time of this process, over all threads: for the CPU, and for drivers that compute on it. Programs
    /// beside it on the machine disturb it little.
    Processor,
    /// The device's timestamps for kernels (wall time where it has none), wall time for everything else.
    Device,
}

impl Clock {
    /// Seconds on this clock.
    pub fn of(self, elapsed: Elapsed) -> f64 {
        match self {
            Self::Processor => elapsed.cpu_s,
            Self::Device => elapsed.wall_s,
        }
    }

    /// What its seconds are.
    pub fn describe(self) -> &'static str {
        match self {
            Self::Processor => "processor time of this process, all threads together",
            Self::Device => "the device's own clock for kernels, wall time for all else",
        }
    }
}

/// A device that can be measured.
pub trait Subject: Backend {
    /// Brings an image to the device with its interpolation coefficients, and waits for them.
    ///
    /// # Errors
    /// When the device fails.
    fn prepare(&self, image: Arc<Image>, options: &KernelOptions) -> Result<Self::Frame, BackendError>;

    /// What its figures are read from.
    fn clock(&self) -> Clock;

    /// Whether it is a graphics device, which can tell what its kernels take.
    fn is_graphics(&self) -> bool {
        false
    }

    /// Every kernel that the images of `scene` need, at their own size; none on the CPU, whose passes are its kernels.
    ///
    /// # Errors
    /// When the device fails.
    fn kernel_costs(&self, _scene: &Scene, _runs: usize, _copy_rate: f64) -> Result<Vec<KernelCost>, BenchError> {
        Ok(Vec::new())
    }

    /// Where the time of `work` goes, which is done for that; nothing is done on the CPU, which cannot tell.
    ///
    /// # Errors
    /// When the device fails, and those of `work`.
    fn shares(&self, _work: impl FnMut() -> Result<(), BenchError>) -> Result<Vec<Share>, BenchError> {
        Ok(Vec::new())
    }

    /// Bytes per second read and written by long copies within its memory: of one core, on the processor's clock.
    ///
    /// # Errors
    /// When the device fails.
    fn copy_rate(&self) -> Result<f64, BackendError> {
        Ok(copy_rate_of_core())
    }
}

impl Subject for CpuBackend {
    fn prepare(&self, image: Arc<Image>, options: &KernelOptions) -> Result<Self::Frame, BackendError> {
        let mut frame = self.frame(image, options)?;
        self.prefilter(&mut frame, 0)?;
        Ok(frame)
    }

    fn clock(&self) -> Clock {
        Clock::Processor
    }
}

/// Bytes copied at once to find what memory can do: far more than any cache holds.
const COPIED: u64 = 256 << 20;

fn copy_rate_of_core() -> f64 {
    const PIECE: usize = 1 << 20;
    let from = vec![1u8; COPIED as usize];
    let mut to = vec![0u8; COPIED as usize];
    let mut copy =
        || to.par_chunks_mut(PIECE).zip(from.par_chunks(PIECE)).for_each(|(to, from)| to.copy_from_slice(from));
    let times = (0..4).map(|_| {
        let watch = quadrille_base::clock::Stopwatch::start();
        copy();
        watch.elapsed().cpu_s
    });
    let fastest = times.fold(f64::INFINITY, f64::min);
    2.0 * COPIED as f64 / fastest
}

/// What to measure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Plan {
    /// Sides of the square images, px.
    pub sizes_px: Vec<usize>,
    /// Side of the elements, px.
    pub element_size_px: usize,
    /// Repetitions of a pass, a kernel and a cold pair.
    pub runs: usize,
    /// Frames of the series.
    pub frames: usize,
}

/// Figures of one image size.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeCost {
    /// Side of the square image, px.
    pub size_px: usize,
    /// Elements.
    pub n_elements: usize,
    /// Nodes.
    pub n_nodes: usize,
    /// Passes over an image, as both kinds of device do them.
    pub passes: Vec<PassCost>,
    /// Kernels of a graphics device.
    pub kernels: Vec<KernelCost>,
    /// A reference and one frame, nothing known.
    pub pair: PairCost,
    /// Frames that follow each other.
    pub series: SeriesCost,
}

/// Everything at one size of images.
///
/// # Errors
/// When the device fails, or the elements do not fit.
pub fn size_cost<B: Subject>(backend: &B, scene: &Scene, plan: &Plan, copy_rate: f64) -> Result<SizeCost, BenchError> {
    Ok(SizeCost {
        size_px: scene.size,
        n_elements: scene.mesh.mesh.n_elements(),
        n_nodes: scene.mesh.mesh.n_nodes(),
        passes: pass_costs(backend, scene, plan.runs, copy_rate)?,
        kernels: backend.kernel_costs(scene, plan.runs, copy_rate)?,
        pair: pair_cost(backend, scene, plan.runs)?,
        series: series_cost(backend, scene, plan.frames)?,
    })
}
