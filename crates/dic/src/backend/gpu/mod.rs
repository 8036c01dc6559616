//! The GPU backend: WGSL kernels through wgpu, on any adapter that offers WebGPU's default limits.
//!
//! Images, references and fields live on the device. Some iterations are one batch of work and one small report of each
//! (largest correction, match of the zones), with which the field comes back where it may be the end. Sums run in a
//! fixed order and without atomics, so one device gives the same bits on every run. Kernels: `shaders/`; their twins:
//! the CPU backend.

mod device;
mod field;
mod handle;
mod layout;
mod level;
mod plane;
mod profile;
mod shader;
mod solver;
mod timed;

pub use super::adapter::{AdapterKind, Adapters, GpuAdapter, GpuOptions};
pub use device::adapters;
pub use field::GpuField;
pub(super) use handle::Handle;
pub use layout::{Mirror, mirrors};
pub use level::GpuLevel;
pub use plane::GpuFrame;
pub use profile::{Noted, Timing, Work};
pub use shader::{Binding, Extent, KERNELS, Kernel, Part, source};
pub use solver::GpuSolver;

use crate::backend::bend::{BentMoments, BentSums};
use crate::backend::check::DeviceCheck;
use crate::backend::{
    Ahead, Backend, BackendError, ElementMoments, Found, GreyMap, GreyTransfer, KernelOptions, OnDevice, PixelSums,
    Place, Step, Traffic,
};
use crate::imaging::{Image, Interpolation};
use crate::linalg::Solver;
use crate::mesh::PixelMesh;
use device::Gpu;
use std::sync::Arc;

/// Does `work` on `adapter`, once that has computed the same as the CPU.
///
/// # Errors
/// See [`GpuBackend::new`]; [`BackendError::Wrong`].
pub(super) fn open<W: OnDevice>(
    adapter: &GpuAdapter,
    options: &GpuOptions,
    work: W,
) -> Result<W::Output, BackendError> {
    let altered = options.altered.clone().filter(|_| !options.altered_later);
    let backend = GpuBackend::new(adapter, &GpuOptions { fail_after: None, altered, ..options.clone() })?;
    if !options.trusted {
        DeviceCheck::of(&backend)?.right(backend.device())?;
    }
    if options.altered_later {
        backend.gpu.alter(options.altered.clone());
    }
    options.fail_after.into_iter().for_each(|readbacks| backend.gpu.fail_after(readbacks));
    Ok(work.on(backend))
}

/// What the comparison of `adapter` with the CPU finds.
///
/// # Errors
/// See [`GpuBackend::new`].
pub fn check(adapter: &GpuAdapter, options: &GpuOptions) -> Result<DeviceCheck, BackendError> {
    DeviceCheck::of(&GpuBackend::new(adapter, options)?)
}

/// Frames worth correlating at the same time: while one waits for its report, others work.
const FRAMES_IN_FLIGHT: usize = 3;

/// A graphics device that correlates; copies of it share the device.
#[derive(Debug, Clone)]
pub struct GpuBackend {
    gpu: Arc<Gpu>,
}

impl GpuBackend {
    /// Opens an adapter.
    ///
    /// # Errors
    /// When it cannot be opened, or offers too little.
    pub fn new(adapter: &GpuAdapter, options: &GpuOptions) -> Result<Self, BackendError> {
        if let Some(why) = &adapter.unusable {
            return Err(BackendError::Device { device: adapter.name.clone(), message: why.clone() });
        }
        Ok(Self { gpu: Arc::new(Gpu::open(adapter.clone(), options)?) })
    }

    /// The adapter.
    pub fn adapter(&self) -> &GpuAdapter {
        &self.gpu.adapter
    }

    /// Waits until the device has done everything it was given.
    ///
    /// # Errors
    /// When it fails.
    pub fn wait(&self) -> Result<(), BackendError> {
        self.gpu.wait()
    }

    /// Notes from now on what every piece of work takes, which slows the work down; `None` ends it. Returns what
    /// was noted before.
    pub fn profile(&self, timing: Option<Timing>) -> Vec<Noted> {
        self.gpu.profile.switch(timing)
    }

    /// Copies `bytes`, rounded down to a multiple of 16 and at least that, within the device's memory, to and fro,
    /// `times` times in all, and waits. They are written once before.
    ///
    /// # Errors
    /// When the device fails, or not all copies have been made.
    pub fn copy_within(&self, bytes: u64, times: usize) -> Result<(), BackendError> {
        const WORDS: u64 = 16;
        let (gpu, bytes) = (&self.gpu, bytes.max(WORDS) / WORDS * WORDS);
        let buffers = [gpu.visible(bytes, "a copy")?, gpu.visible(bytes, "a copy")?];
        let (last, pipeline) =
            (gpu.storage(WORDS, "its end")?, gpu.pipeline(Kernel::Copy, Interpolation::default(), 0));
        let ways = [[0, 1], [1, 0]].map(|way| gpu.bind(&pipeline, &way.map(|k: usize| buffers[k].part(0, bytes))));
        let mut recorder = gpu.record();
        recorder.clear(&buffers[0]);
        (0..times).for_each(|k| recorder.run(&ways[k % 2], (bytes / WORDS).div_ceil(256) as u32));
        recorder.copy(&buffers[times % 2], bytes - WORDS, &last, 0, WORDS);
        let arrived = recorder.fetch(&[(&last, WORDS)], &mut Traffic::default())?;
        if device::values::<u32>(&arrived).iter().any(|&copies| copies as usize != times) {
            let message = format!("{times} copies of {bytes} bytes within its memory did not arrive");
            return Err(BackendError::Device { device: gpu.adapter.name.clone(), message });
        }
        Ok(())
    }

    /// Sends `bytes` to the device's memory, and waits.
    ///
    /// # Errors
    /// When the device fails.
    pub fn upload(&self, bytes: &[u8]) -> Result<(), BackendError> {
        let to = self.gpu.storage(bytes.len() as u64, "an upload")?;
        self.gpu.write(&to, bytes);
        self.gpu.record().submit(&mut Traffic::default());
        self.gpu.wait()
    }

    /// Hands over next to nothing and fetches next to nothing: what the way to the device and back takes.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round_trip(&self) -> Result<(), BackendError> {
        const BYTES: u64 = 64;
        let buffer = self.gpu.storage(BYTES, "a round trip")?;
        self.gpu.record().fetch(&[(&buffer, BYTES)], &mut Traffic::default()).map(|_| ())
    }
}

impl Backend for GpuBackend {
    type Frame = GpuFrame;
    type Level = GpuLevel;
    type Field = GpuField;
    type Solver = GpuSolver;

    fn device(&self) -> String {
        let GpuAdapter { name, api, driver, .. } = &self.gpu.adapter;
        format!("gpu ({name}, {api}, {driver})")
    }

    fn frames_in_flight(&self) -> usize {
        FRAMES_IN_FLIGHT
    }

    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<GpuFrame, BackendError> {
        GpuFrame::new(&self.gpu, image, options)
    }

    fn image(&self, frame: &GpuFrame) -> Arc<Image> {
        frame.host.image.clone()
    }

    fn grey_map(&self, frame: &mut GpuFrame, level: usize) -> GreyMap {
        frame.host.level(level).clone()
    }

    fn reference(
        &self,
        frame: &mut GpuFrame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(GpuLevel, Vec<ElementMoments>), BackendError> {
        GpuLevel::new(&self.gpu, frame, level, mesh, options, smoothed)
    }

    fn restrict(&self, level: &mut GpuLevel, active: &[bool]) -> Result<(), BackendError> {
        level.restrict(&self.gpu, active)
    }

    fn link(&self, level: &mut GpuLevel, places: Vec<Place>) -> Result<(), BackendError> {
        level.link(&self.gpu, &places)
    }

    fn release(&self, frame: &mut GpuFrame) {
        frame.release();
    }

    fn solver(&self, _: &GpuLevel, solver: Solver) -> Result<GpuSolver, BackendError> {
        GpuSolver::new(&self.gpu, solver)
    }

    fn solver_like(&self, _: &GpuLevel, solver: Solver, like: &GpuSolver) -> Result<GpuSolver, BackendError> {
        like.change_rows(&self.gpu, solver)
    }

    fn reclaim(&self, solver: GpuSolver) -> Option<Solver> {
        Some(solver.into_host())
    }

    fn start(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<GpuField, BackendError> {
        GpuField::new(&self.gpu, level, frame, displacement, transfer)
    }

    fn start_finer(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        coarse: &GpuField,
        moved: bool,
    ) -> Result<GpuField, BackendError> {
        GpuField::finer(&self.gpu, level, frame, coarse, moved)
    }

    fn observe(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        field.observe(&self.gpu, level, &mut frame.traffic)
    }

    fn step(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
        solver: &GpuSolver,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError> {
        field.step(&self.gpu, level, (solver, scale), ahead, &mut frame.traffic)
    }

    fn solve_again(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
        solver: &GpuSolver,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError> {
        field.solve_again(&self.gpu, level, (solver, scale), ahead, &mut frame.traffic)
    }

    fn right_hand_side(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        field.right_hand_side(&self.gpu, level, &mut frame.traffic)
    }

    fn remaining_moments(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError> {
        let lost = field.read_lost(&self.gpu, level, &mut frame.traffic)?;
        let numbers: Vec<u32> = lost.iter().map(|lost| lost.0).collect();
        let moments = level.moments(&self.gpu, &numbers, Some(field.evaluated()), &mut frame.traffic)?;
        let remaining = |((element, any_left), moments): ((u32, bool), ElementMoments)| {
            (element as usize, if any_left { moments } else { ElementMoments::default() })
        };
        Ok(lost.into_iter().zip(moments).map(remaining).collect())
    }

    fn element_sums(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        field.element_sums(&self.gpu, level, &mut frame.traffic, false)
    }

    fn exclude(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
        excluded: &[bool],
    ) -> Result<(), BackendError> {
        field.exclude(&self.gpu, level, &mut frame.traffic, excluded)
    }

    fn all_sums(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
    ) -> Result<Vec<PixelSums>, BackendError> {
        Ok(field.element_sums(&self.gpu, level, &mut frame.traffic, true)?.0)
    }

    fn place(
        &self,
        _: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
        displacement: &[[f64; 2]],
    ) -> Result<(), BackendError> {
        field.place(&self.gpu, &mut frame.traffic, displacement);
        Ok(())
    }

    fn read_start(
        &self,
        _: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
    ) -> Result<(Vec<[f64; 2]>, Vec<GreyTransfer>), BackendError> {
        field.read_start(&self.gpu, &mut frame.traffic)
    }

    fn light(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &mut GpuField,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        field.light(&self.gpu, level, frame, light)
    }

    fn read_field(&self, level: &GpuLevel, frame: &mut GpuFrame, field: &GpuField) -> Result<Found, BackendError> {
        field.read(&self.gpu, level, &mut frame.traffic)
    }

    fn bent_moments(&self, level: &GpuLevel, elements: &[u32]) -> Result<Vec<BentMoments>, BackendError> {
        // A few times per reference: on the host.
        Ok(level.on_host()?.bent_moments(elements))
    }

    fn bent_sums(
        &self,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        field: &GpuField,
        elements: &[u32],
    ) -> Result<Vec<BentSums>, BackendError> {
        let all = field.bend(&self.gpu, level, frame)?;
        Ok(elements.iter().map(|&element| all[element as usize]).collect())
    }

    fn traffic(&self, frame: &GpuFrame) -> Option<Traffic> {
        Some(frame.traffic)
    }
}
