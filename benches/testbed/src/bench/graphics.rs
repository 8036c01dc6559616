//! What is measured of a graphics device beside what every device has: its start and its kernels.

use super::kernels::{KernelCost, KernelStart, StartUp};
use super::measured::{DeviceRecord, Measured, opened};
use super::passes::{Bound, ResidualPass};
use super::scene::{Scene, kernel_options};
use super::times::{Spread, repeat};
use super::whole::Share;
use super::{BenchError, COPIED, Clock, Subject, copy_rate_of_core};
use quadrille::backend::check::DeviceCheck;
use quadrille::backend::gpu::{
    AdapterKind, Extent, GpuAdapter, GpuBackend, GpuOptions, KERNELS, Kernel, Noted, Part, Timing, Work,
};
use quadrille::backend::{Backend, BackendError, KernelOptions};
use quadrille::correlate::Correlator;
use quadrille::imaging::Image;
use quadrille_base::clock::{Elapsed, Stopwatch};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Opens an adapter to be measured.
pub(super) fn open(adapter: &GpuAdapter) -> Result<(Box<dyn Measured>, DeviceRecord), BenchError> {
    let (gpu, start) = start_up(adapter)?;
    opened(gpu, adapter.kind.name(), Some(start))
}

impl Subject for GpuBackend {
    fn prepare(&self, image: Arc<Image>, options: &KernelOptions) -> Result<Self::Frame, BackendError> {
        let frame = self.frame(image, options)?;
        self.wait()?;
        Ok(frame)
    }

    fn clock(&self) -> Clock {
        clock_of(self.adapter())
    }

    fn is_graphics(&self) -> bool {
        true
    }

    fn kernel_costs(&self, scene: &Scene, runs: usize, copy_rate: f64) -> Result<Vec<KernelCost>, BenchError> {
        kernel_costs(self, scene, runs, copy_rate)
    }

    fn shares(&self, mut work: impl FnMut() -> Result<(), BenchError>) -> Result<Vec<Share>, BenchError> {
        self.profile(Some(timing_of(self)));
        work()?;
        Ok(shares_of(&self.profile(None), |elapsed| self.clock().of(elapsed)))
    }

    fn copy_rate(&self) -> Result<f64, BackendError> {
        if self.clock() == Clock::Processor {
            return Ok(copy_rate_of_core());
        }
        let bytes = COPIED.min(self.adapter().max_binding_bytes);
        let times = repeat(5, || self.copy_within(bytes, COPIES))?;
        // Read and written each time, and written once before.
        Ok((bytes * (2 * COPIES as u64 + 1)) as f64 / times.wall.fastest)
    }
}

fn clock_of(adapter: &GpuAdapter) -> Clock {
    if adapter.kind == AdapterKind::Software { Clock::Processor } else { Clock::Device }
}

/// How its kernels are timed.
fn timing_of(backend: &GpuBackend) -> Timing {
    let timestamps = backend.adapter().has_timestamps && backend.clock() == Clock::Device;
    if timestamps { Timing::Timestamps } else { Timing::Batches }
}

/// Copies in one go.
const COPIES: usize = 20;

/// Round trips of which the median is told.
const ROUND_TRIPS: usize = 50;

/// Bytes that are sent at once: an image of 64 Mpx of 8 bit.
const SENT: u64 = 64 << 20;

/// Side of the small image.
const SIZE: usize = 256;

/// Opens an adapter and runs every kernel that a pair needs for the first time.
fn start_up(adapter: &GpuAdapter) -> Result<(GpuBackend, StartUp), BenchError> {
    // Times of a device that computes something else are worth nothing; on another device, for kernels are compiled
    // below.
    let checked = GpuBackend::new(adapter, &GpuOptions::default())?;
    let check = DeviceCheck::of(&checked)?;
    check.right(checked.device())?;
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
        Some(KernelStart { kernel: kernel.name(), compile_s, first_run_s: first - Spread::of(runs.clone()).fastest })
    };
    let kernels: Vec<KernelStart> = KERNELS.iter().filter_map(of_kernel).collect();
    let kernels_s = kernels.iter().map(|start| start.compile_s + start.first_run_s).sum();
    let dispatch_s = KERNELS.iter().flat_map(|&kernel| seconds(Work::Kernel(kernel))).fold(f64::INFINITY, f64::min);
    let round_trip_s = repeat(ROUND_TRIPS, || backend.round_trip())?.wall;
    let sent = vec![0; SENT.min(backend.adapter().max_buffer_bytes) as usize];
    let upload_s = repeat(5, || backend.upload(&sent))?.wall.fastest;
    let upload_gb_per_s = 1e-9 * sent.len() as f64 / upload_s;
    Ok((backend, StartUp { check, open_s, round_trip_s, dispatch_s, upload_gb_per_s, kernels_s, kernels }))
}

/// Every kernel that the images of `scene` need, at their own size.
fn kernel_costs(
    backend: &GpuBackend,
    scene: &Scene,
    runs: usize,
    copy_rate: f64,
) -> Result<Vec<KernelCost>, BenchError> {
    let timing = timing_of(backend);
    let options = kernel_options();
    let mut runs_of: BTreeMap<Kernel, (usize, Vec<f64>)> = BTreeMap::new();
    let mut add = |noted: &[Noted], wanted: &[Kernel]| {
        for &kernel in wanted {
            let of_kernel = noted.iter().filter(|noted| noted.work == Work::Kernel(kernel));
            let seconds: Vec<f64> = of_kernel.map(|noted| backend.clock().of(noted.elapsed)).collect();
            if !seconds.is_empty() {
                let (dispatches, all) = runs_of.entry(kernel).or_default();
                *dispatches = seconds.len();
                all.push(seconds.iter().sum());
            }
        }
    };
    let mut pass = ResidualPass::new(backend, scene, 1.0)?;
    pass.step()?;
    let halved = scene.mesh.halved(scene.element, [scene.size / 2; 2]);
    for _ in 0..runs.max(1) {
        backend.profile(Some(timing));
        let mut frame = backend.prepare(scene.reference.clone(), &options)?;
        let image = [Kernel::Unpack, Kernel::Prefilter, Kernel::BorderColumns, Kernel::BorderRows];
        add(&backend.profile(Some(timing)), &image);
        backend.reference(&mut frame, 0, &scene.mesh, &options, None)?;
        add(&backend.profile(Some(timing)), &[Kernel::Gradient, Kernel::NormalMatrix]);
        if let Some(halved) = &halved {
            backend.reference(&mut frame, 1, halved, &options, None)?;
            add(&backend.profile(Some(timing)), &[Kernel::Downsample]);
        }
        pass.step()?;
        let iteration = [
            Kernel::Residual,
            Kernel::Tally,
            Kernel::Gather,
            Kernel::CgProduct,
            Kernel::CgUpdate,
            Kernel::Correct,
            Kernel::Summary,
        ];
        add(&backend.profile(Some(timing)), &iteration);
        pass.read_field()?;
        add(&backend.profile(None), &[Kernel::ResidualMap]);
    }
    let cost = |(kernel, (dispatches, seconds)): (Kernel, (usize, Vec<f64>))| {
        let seconds = Spread::of(seconds);
        let mesh = &scene.mesh.mesh;
        let (bytes, moves) = kernel.moves(Extent {
            pixels: scene.pixels(),
            side: scene.size as u64,
            elements: mesh.n_elements() as u64,
            nodes: mesh.n_nodes() as u64,
            runs: dispatches as u64,
        });
        let ns_per_px = 1e9 * seconds.fastest / scene.pixels() as f64;
        let bound = Bound::new(bytes, seconds.fastest, copy_rate);
        KernelCost { kernel: kernel.name(), dispatches, seconds, ns_per_px, bound, moves }
    };
    Ok(runs_of.into_iter().map(cost).collect())
}

const PARTS: [&str; 6] = ["upload", "image to coefficients", "residual", "solve", "other kernels", "readback"];

fn shares_of(noted: &[Noted], clock: impl Fn(Elapsed) -> f64) -> Vec<Share> {
    let mut seconds = [0.0; PARTS.len()];
    for Noted { work, elapsed } in noted {
        let part = match work {
            Work::Upload => 0,
            Work::Kernel(kernel) => match kernel.part() {
                Part::Image => 1,
                Part::Residual => 2,
                Part::Solve => 3,
                Part::Other => 4,
            },
            Work::Readback => 5,
            Work::Compile(_) => continue,
        };
        seconds[part] += clock(*elapsed);
    }
    let all: f64 = seconds.iter().sum();
    let share = |(part, seconds)| Share { part, seconds, percent: 100.0 * seconds / all.max(f64::MIN_POSITIVE) };
    PARTS.into_iter().zip(seconds).map(share).collect()
}
