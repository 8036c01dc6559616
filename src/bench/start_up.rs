//! What comes once, before the first frame.

use super::BenchError;
use super::scene::Scene;
use super::times::Spread;
use crate::backend::gpu::{GpuAdapter, GpuBackend, GpuOptions, Kernel, Timing, Work};
use crate::clock::Stopwatch;
use crate::correlate::Correlator;
use serde::Serialize;

/// The start of one kernel, seconds on the wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct KernelStart {
    /// The kernel.
    pub kernel: Kernel,
    /// Making it for the device.
    pub compile_s: f64,
    /// Its first run, on a small image, less its shortest later one: many drivers finish their work only then.
    pub first_run_s: f64,
}

/// The start of a device.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StartUp {
    /// Opening it.
    pub open_s: f64,
    /// All of its kernels together.
    pub kernels_s: f64,
    /// One by one.
    pub kernels: Vec<KernelStart>,
}

/// Side of the small image.
const SIZE: usize = 256;

/// Opens an adapter and runs every kernel that a pair needs for the first time.
///
/// # Errors
/// When the device fails.
pub fn start_up(adapter: &GpuAdapter) -> Result<(GpuBackend, StartUp), BenchError> {
    let watch = Stopwatch::start();
    let backend = GpuBackend::new(adapter, &GpuOptions::default())?;
    let open_s = watch.elapsed().wall_s;
    let scene = Scene::new(SIZE, 16, 1)?;
    backend.profile(Some(Timing::Batches));
    let correlator = Correlator::new(backend.clone(), scene.reference.clone(), &scene.zone(), scene.options())?;
    correlator.correlate(scene.frame(0).clone(), None)?;
    let noted = backend.profile(None);
    let seconds = |work: Work| {
        let of_work = noted.iter().filter(move |noted| noted.work == work);
        of_work.map(|noted| noted.elapsed.wall_s).collect::<Vec<_>>()
    };
    let of_kernel = |&kernel: &Kernel| {
        let compile_s = seconds(Work::Compile(kernel)).iter().sum();
        let runs = seconds(Work::Kernel(kernel));
        let first = runs.first()?;
        Some(KernelStart { kernel, compile_s, first_run_s: first - Spread::of(runs.clone()).fastest })
    };
    let kernels: Vec<KernelStart> = crate::backend::gpu::KERNELS.iter().filter_map(of_kernel).collect();
    let kernels_s = kernels.iter().map(|start| start.compile_s + start.first_run_s).sum();
    Ok((backend, StartUp { open_s, kernels_s, kernels }))
}
