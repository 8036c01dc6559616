//! What a correlation does again and again, as every device does it.

use super::scene::{Scene, kernel_options};
use super::times::{Times, repeat};
use super::{BenchError, Subject};
use quadrille::backend::{Ahead, Backend, BackendError, GreyTransfer};
use quadrille::linalg::{BlockMatrix, Pattern, Solver};
use serde::Serialize;
use std::sync::Arc;

/// How near work is to what the memory allows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bound {
    /// Bytes that the work must move at least: every value that goes in or comes out, once.
    pub bytes: u64,
    /// Those over its shortest time, 1e9 per second.
    pub gb_per_s: f64,
    /// The same in per cent of what long copies reach on this device.
    pub percent_of_copy: f64,
}

impl Bound {
    pub(super) fn new(bytes: u64, seconds: f64, copy_rate: f64) -> Self {
        let rate = bytes as f64 / seconds.max(1e-12);
        Self { bytes, gb_per_s: 1e-9 * rate, percent_of_copy: 100.0 * rate / copy_rate }
    }
}

/// What one pass takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PassCost {
    /// Its name.
    pub name: &'static str,
    /// What is included.
    pub includes: &'static str,
    /// Seconds.
    pub seconds: Times,
    /// Nanoseconds per pixel of the image, shortest time on the device's clock.
    pub ns_per_px: f64,
    /// How near it is to what the memory allows.
    pub bound: Bound,
}

/// A field that residual passes can be made at.
pub struct ResidualPass<B: Backend> {
    backend: B,
    level: B::Level,
    frame: B::Frame,
    field: B::Field,
    solver: B::Solver,
}

impl<B: Subject> ResidualPass<B> {
    /// Prepares reference, frame and solver, and starts a field with [`Scene::field`] of `scale`.
    ///
    /// # Errors
    /// When the device fails.
    pub fn new(backend: &B, scene: &Scene, scale: f64) -> Result<Self, BackendError> {
        let options = kernel_options();
        let mut reference = backend.frame(scene.reference.clone(), &options)?;
        let (level, moments) = backend.reference(&mut reference, 0, &scene.mesh, &options, None)?;
        let mut frame = backend.prepare(scene.deformed[0].clone(), &options)?;
        let field = backend.start(&level, &mut frame, &scene.field(scale), &[GreyTransfer::NONE])?;
        let mesh = &scene.mesh.mesh;
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        let matrices: Vec<_> = moments.iter().map(|m| m.matrix()).collect();
        let matrix = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
        let solver = backend.solver(&level, Solver::iterative(matrix))?;
        Ok(Self { backend: backend.clone(), level, frame, field, solver })
    }

    /// One residual pass, with its sums on the host.
    ///
    /// # Errors
    /// When the device fails.
    pub fn observe(&mut self) -> Result<(), BackendError> {
        self.backend.observe(&self.level, &mut self.frame, &mut self.field).map(|_| ())
    }

    /// One Gauss-Newton iteration, with its report on the host.
    ///
    /// # Errors
    /// When the device fails.
    pub fn step(&mut self) -> Result<(), BackendError> {
        self.backend
            .step(&self.level, &mut self.frame, &mut self.field, &self.solver, [1.0, 0.0], &Ahead::NONE)
            .map(|_| ())
    }

    /// The field and the match of every element, on the host.
    ///
    /// # Errors
    /// When the device fails.
    pub fn read_field(&mut self) -> Result<(), BackendError> {
        self.backend.read_field(&self.level, &mut self.frame, &self.field).map(|_| ())
    }
}

/// Names of the passes that others refer to.
pub(super) const RESIDUAL: &str = "residual";

/// Every pass at one size of images.
///
/// # Errors
/// When the device fails.
pub fn pass_costs<B: Subject>(
    backend: &B,
    scene: &Scene,
    runs: usize,
    copy_rate: f64,
) -> Result<Vec<PassCost>, BenchError> {
    let options = kernel_options();
    let (pixels, elements, nodes) =
        (scene.pixels(), scene.mesh.mesh.n_elements() as u64, scene.mesh.mesh.n_nodes() as u64);
    let cost = |name, includes, seconds: Times, bytes: u64| {
        let fastest = match backend.clock() {
            super::Clock::Processor => seconds.cpu.fastest,
            super::Clock::Device => seconds.wall.fastest,
        };
        let ns_per_px = 1e9 * fastest / pixels as f64;
        PassCost { name, includes, seconds, ns_per_px, bound: Bound::new(bytes, fastest, copy_rate) }
    };
    let frame = repeat(runs, || backend.prepare(scene.deformed[0].clone(), &options))?;
    let reference = repeat(runs, || {
        let mut frame = backend.frame(scene.reference.clone(), &options)?;
        backend.reference(&mut frame, 0, &scene.mesh, &options, None)
    })?;
    // f (4 bytes a pixel), its gradient (4) and the coefficients of the deformed image (4) once; the sums of an element
    // are 15 values.
    let residual_bytes = 12 * pixels + 60 * elements + 16 * nodes;
    let mut uniform = ResidualPass::new(backend, scene, 0.03)?;
    let quiet = repeat(runs, || uniform.observe())?;
    drop(uniform);
    let mut pass = ResidualPass::new(backend, scene, 1.0)?;
    let residual = repeat(runs, || pass.observe())?;
    let iteration = repeat(runs, || pass.step())?;
    let found = repeat(runs, || pass.read_field())?;
    Ok(vec![
        cost("frame", "8-bit pixels in host memory to spline coefficients on the device", frame, 5 * pixels),
        cost(
            "reference",
            "the same, gradient, 27 moments of each element back to the host",
            reference,
            9 * pixels + 120 * elements,
        ),
        cost("residual, 0.1 % strain", "as below, on a nearly uniform field", quiet, residual_bytes),
        cost(
            RESIDUAL,
            "interpolation, residual, right-hand side of each element, sums to the host",
            residual,
            residual_bytes,
        ),
        cost(
            "iteration",
            "residual pass, solution of the normal equations, correction, report to the host",
            iteration,
            residual_bytes + 4 * 9 * 16 * nodes / 4 + 100 * nodes,
        ),
        cost("results", "field and match of each element to the host", found, 80 * elements + 28 * nodes),
    ])
}
