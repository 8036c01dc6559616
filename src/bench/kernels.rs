//! What each kernel of a graphics device takes.

use super::passes::{Bound, ResidualPass};
use super::scene::{Scene, kernel_options};
use super::times::Spread;
use super::{BenchError, Subject};
use crate::backend::gpu::{Kernel, Noted, Work};
use serde::Serialize;
use std::collections::BTreeMap;

/// What one kernel takes, in one iteration or for one image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KernelCost {
    /// The kernel.
    pub kernel: Kernel,
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

/// Bytes that a kernel must move for one image or in one iteration with `dispatches` runs, and what they are. Every
/// value that it reads or writes counts once, however often it is read; P pixels, E elements, N nodes.
fn bytes_of(kernel: Kernel, scene: &Scene, dispatches: usize) -> (u64, &'static str) {
    let side = scene.size as u64;
    let (p, e, n) = (scene.pixels(), scene.mesh.mesh.n_elements() as u64, scene.mesh.mesh.n_nodes() as u64);
    // Inner nodes are coupled with nine.
    let blocks = 9 * n;
    match kernel {
        Kernel::Unpack => (5 * p, "P (1 B pixel + 4 B grey level)"),
        Kernel::Downsample => (5 * p, "P (4 B fine + 1/4 of 4 B coarse)"),
        Kernel::Prefilter => (16 * p, "2 passes x P (4 B in + 4 B out)"),
        Kernel::BorderColumns => (72 * side, "per row 10 values in, 8 out"),
        Kernel::BorderRows => (72 * side, "per column 10 values in, 8 out"),
        Kernel::Gradient => (20 * p, "P (grey level, coefficient in; f, fx, fy out)"),
        Kernel::NormalMatrix => (12 * p + 256 * e, "P (f, fx, fy) + E (64 B element, 192 B moments)"),
        Kernel::Residual | Kernel::ResidualRuns => {
            (16 * p + 128 * e + 16 * n, "P (f, fx, fy, coefficient) + E (64 B element, 64 B sums) + 16 B N")
        }
        Kernel::Fit | Kernel::Tally => (80 * e, "E (64 B sums, 16 B of the reference)"),
        Kernel::Gather => (32 * e + 64 * n, "E 32 B of sums + N (24 B incidence, 16 B block, 24 B out)"),
        Kernel::CgProduct => {
            (dispatches as u64 * (20 * blocks + 32 * n), "per run: 9 N (16 B block, 4 B column) + N 4 vectors of 8 B")
        }
        Kernel::CgUpdate => (dispatches as u64 * 72 * n, "per run: N (16 B block, 4 vectors in, 3 out of 8 B)"),
        Kernel::Correct => (40 * n, "N (8 B correction, 16 B in and out)"),
        Kernel::Penalty => {
            (20 * blocks + 56 * n, "9 N (16 B block, 4 B column) + N (16 B field, 16 B block, 8 B in, 16 B out)")
        }
        Kernel::Summary => (48 * e.div_ceil(256) + 8 * n.div_ceil(256), "sums of groups of elements and of nodes"),
        Kernel::Prolong => (64 * n, "N (32 B place, 16 B in, 16 B out)"),
        Kernel::ResidualMap => (88 * e + 28 * n, "E (80 B in, 8 B out) + N (16 B in, 12 B out)"),
    }
}

/// Every kernel that the images of `scene` need, at their own size; none on the CPU, whose passes are its kernels.
///
/// # Errors
/// When the device fails.
pub fn kernel_costs<B: Subject>(
    backend: &B,
    scene: &Scene,
    runs: usize,
    copy_rate: f64,
) -> Result<Vec<KernelCost>, BenchError> {
    let Some((graphics, timing)) = backend.graphics() else { return Ok(Vec::new()) };
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
        graphics.profile(Some(timing));
        let mut frame = backend.prepare(scene.reference.clone(), &options)?;
        let image = [Kernel::Unpack, Kernel::Prefilter, Kernel::BorderColumns, Kernel::BorderRows];
        add(&graphics.profile(Some(timing)), &image);
        backend.reference(&mut frame, 0, &scene.mesh, &options)?;
        add(&graphics.profile(Some(timing)), &[Kernel::Gradient, Kernel::NormalMatrix]);
        if let Some(halved) = &halved {
            backend.reference(&mut frame, 1, halved, &options)?;
            add(&graphics.profile(Some(timing)), &[Kernel::Downsample]);
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
        add(&graphics.profile(Some(timing)), &iteration);
        pass.found()?;
        add(&graphics.profile(None), &[Kernel::ResidualMap]);
    }
    let cost = |(kernel, (dispatches, seconds)): (Kernel, (usize, Vec<f64>))| {
        let seconds = Spread::of(seconds);
        let (bytes, moves) = bytes_of(kernel, scene, dispatches);
        let ns_per_px = 1e9 * seconds.fastest / scene.pixels() as f64;
        let bound = Bound::new(bytes, seconds.fastest, copy_rate);
        KernelCost { kernel, dispatches, seconds, ns_per_px, bound, moves }
    };
    Ok(runs_of.into_iter().map(cost).collect())
}
