//! The solver of the normal equations on the device: a fixed small number of conjugate gradient iterations, with
//! no word from the host in between. With a factor (asked for, or because of a regularisation) the host solves.

use super::device::{Bound, Buffer, Gpu};
use super::layout;
use super::level::GpuLevel;
use super::shader::Kernel;
use crate::backend::BackendError;
use crate::linalg::Solver;
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};

/// Fall of the residual that the inner iterations are to reach: a Gauss-Newton iteration contracts about ninefold,
/// and one that is solved to this loses nothing (`benches/RESULTS.md`).
const REDUCTION: f64 = 3e-2;
/// Inner iterations, at least and at most.
const LEAST: usize = 4;
const MOST: usize = 32;
/// Threads of a workgroup of the solver's kernels.
pub(super) const NODES_TOGETHER: usize = 256;

/// A solver that both sides have.
#[derive(Debug)]
pub struct GpuSolver {
    host: Solver,
    pub(super) id: u64,
    pub(super) device: Option<ConjugateGradients>,
}

impl Deref for GpuSolver {
    type Target = Solver;

    fn deref(&self) -> &Solver {
        &self.host
    }
}

/// A matrix on the device and what iterates with it.
#[derive(Debug)]
pub(super) struct ConjugateGradients {
    pub jacobi: Buffer,
    pattern: Buffer,
    blocks: Buffer,
    /// Inner iterations.
    pub n: usize,
    /// Per iteration, for each window of nodes: its constants, its blocks in bytes, its workgroups.
    products: Vec<Vec<(Buffer, u64, u64, u32)>>,
    updates: Vec<Buffer>,
}

/// Vectors of the conjugate gradients, part of a field.
#[derive(Debug)]
pub(super) struct Vectors {
    pub residual: Buffer,
    pub preconditioned: Buffer,
    pub solution: Buffer,
    pub directions: [Buffer; 2],
    pub image: Buffer,
    pub products: Buffer,
}

impl Vectors {
    pub(super) fn new(gpu: &Gpu, n_nodes: usize) -> Result<Self, BackendError> {
        let vector = || gpu.visible(8 * n_nodes as u64, "a vector of the nodes");
        let n_partial = n_nodes.div_ceil(NODES_TOGETHER);
        Ok(Self {
            residual: vector()?,
            preconditioned: vector()?,
            solution: vector()?,
            directions: [vector()?, vector()?],
            image: vector()?,
            products: gpu.visible(4 * ((2 * MOST + 1) * n_partial) as u64, "sums of the solver")?,
        })
    }
}

impl GpuSolver {
    pub(super) fn new(gpu: &Gpu, host: Solver) -> Result<Self, BackendError> {
        static COUNT: AtomicU64 = AtomicU64::new(1);
        let device = if host.name() == "iterative" { Some(ConjugateGradients::new(gpu, &host)?) } else { None };
        Ok(Self { host, id: COUNT.fetch_add(1, Ordering::Relaxed), device })
    }
}

impl ConjugateGradients {
    fn new(gpu: &Gpu, solver: &Solver) -> Result<Self, BackendError> {
        let matrix = solver.matrix();
        let (pattern, n_nodes) = (matrix.pattern(), matrix.pattern().n_nodes());
        let mut jacobi: Vec<[f32; 4]> =
            solver.jacobi().inverse.iter().map(|&[xx, xy, yy]| [xx as f32, xy as f32, yy as f32, 0.0]).collect();
        // A node that is held takes no correction, whatever the right-hand side there.
        matrix.held().iter().for_each(|&node| jacobi[node as usize] = [0.0; 4]);
        let starts = n_nodes as u32 + 1;
        let rows: Vec<u32> = (0..n_nodes).map(|node| starts + pattern.row(node).start as u32).collect();
        let end = starts + pattern.n_blocks() as u32;
        let places: Vec<u32> = rows.into_iter().chain([end]).chain(pattern.columns().iter().copied()).collect();
        let blocks: Vec<[f32; 4]> = matrix.blocks().iter().map(|block| block.map(|v| v as f32)).collect();
        let blocks_buffer = gpu.storage(16 * blocks.len() as u64, "the normal matrix")?;
        gpu.write(&blocks_buffer, &blocks);
        let n = solver.trial_iterations(REDUCTION, MOST).max(LEAST);
        let n_partial = n_nodes.div_ceil(NODES_TOGETHER);
        // Windows of nodes whose blocks are seen at once; they begin with a workgroup.
        let blocks_seen = (gpu.max_binding_bytes.saturating_sub(gpu.alignment()) / 16) as usize;
        let mut windows: Vec<(usize, usize)> = Vec::new();
        let mut from = 0;
        while from < n_nodes {
            let first_block = pattern.row(from).start;
            let fits = |to: usize| pattern.row(to - 1).end - first_block <= blocks_seen;
            let mut to = (from + NODES_TOGETHER).min(n_nodes);
            if !fits(to) {
                let what = format!("the normal matrix of {n_nodes} nodes on {}", gpu.adapter.name);
                return Err(BackendError::OutOfMemory { what });
            }
            while to < n_nodes && fits((to + NODES_TOGETHER).min(n_nodes)) {
                to = (to + NODES_TOGETHER).min(n_nodes);
            }
            windows.push((from, to));
            from = to;
        }
        let constants = |iteration: usize, from: usize, to: usize, first_block: usize| layout::Cg {
            n_nodes: n_nodes as u32,
            iteration: iteration as u32,
            n_partial: n_partial as u32,
            first_node: from as u32,
            last_node: to as u32,
            first_block: first_block as u32,
            unused0: 0,
            unused1: 0,
        };
        let per_alignment = (gpu.alignment() / 16).max(1) as usize;
        let product = |iteration: usize| {
            let window = |&(from, to): &(usize, usize)| {
                let first_block = pattern.row(from).start / per_alignment * per_alignment;
                let uniform = gpu.uniform(&constants(iteration, from, to, first_block));
                let bytes = 16 * (pattern.row(to - 1).end - first_block) as u64;
                (uniform, 16 * first_block as u64, bytes, (to - from).div_ceil(NODES_TOGETHER) as u32)
            };
            windows.iter().map(window).collect()
        };
        Ok(Self {
            jacobi: gpu.filled(&jacobi, "the nodal blocks")?,
            pattern: gpu.filled(&places, "the pattern of the normal matrix")?,
            n,
            products: (0..n).map(product).collect(),
            updates: (0..n).map(|iteration| gpu.uniform(&constants(iteration, 0, n_nodes, 0))).collect(),
            blocks: blocks_buffer,
        })
    }

    /// The right-hand side and the start of the iteration.
    pub(super) fn gather(&self, gpu: &Gpu, level: &GpuLevel, sums: &Buffer, vectors: &Vectors) -> (Bound, u32) {
        gather(gpu, level, sums, vectors, &self.jacobi)
    }

    /// The kernels of all iterations, with their workgroups.
    pub(super) fn kernels(&self, gpu: &Gpu, level: &GpuLevel, vectors: &Vectors) -> Vec<(Bound, u32)> {
        let interpolation = level.options.interpolation;
        let (product, update) =
            (gpu.pipeline(Kernel::CgProduct, interpolation, 0), gpu.pipeline(Kernel::CgUpdate, interpolation, 0));
        let groups = level.mesh.n_nodes().div_ceil(NODES_TOGETHER) as u32;
        let mut kernels = Vec::new();
        for k in 0..self.n {
            let [old, new] = if k % 2 == 0 { [0, 1] } else { [1, 0] };
            for (uniform, at, bytes, groups) in &self.products[k] {
                let bound = gpu.bind(
                    &product,
                    &[
                        uniform.whole(),
                        self.pattern.whole(),
                        self.blocks.part(*at, *bytes),
                        vectors.preconditioned.whole(),
                        vectors.directions[old].whole(),
                        vectors.directions[new].whole(),
                        vectors.image.whole(),
                        vectors.products.whole(),
                    ],
                );
                kernels.push((bound, *groups));
            }
            let bound = gpu.bind(
                &update,
                &[
                    self.updates[k].whole(),
                    self.jacobi.whole(),
                    vectors.directions[new].whole(),
                    vectors.image.whole(),
                    vectors.solution.whole(),
                    vectors.residual.whole(),
                    vectors.preconditioned.whole(),
                    vectors.products.whole(),
                ],
            );
            kernels.push((bound, groups));
        }
        kernels
    }
}

/// The kernel that gathers the right-hand side of the nodes.
pub(super) fn gather(gpu: &Gpu, level: &GpuLevel, sums: &Buffer, vectors: &Vectors, jacobi: &Buffer) -> (Bound, u32) {
    let pipeline = gpu.pipeline(Kernel::Gather, level.options.interpolation, 0);
    let bound = gpu.bind(
        &pipeline,
        &[
            level.gather.whole(),
            level.incidence.whole(),
            sums.whole(),
            jacobi.whole(),
            vectors.residual.whole(),
            vectors.preconditioned.whole(),
            vectors.solution.whole(),
            vectors.products.whole(),
        ],
    );
    (bound, level.mesh.n_nodes().div_ceil(NODES_TOGETHER) as u32)
}
