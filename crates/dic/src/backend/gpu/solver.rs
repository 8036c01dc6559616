//! The solver of the normal equations on the device: a fixed small number of conjugate gradient iterations, with
//! no word from the host in between. With a factor that was asked for, or a regularisation over so long waves that
//! conjugate gradients are slow, the host solves.

use super::device::{Bound, Buffer, Gpu};
use super::layout;
use super::level::GpuLevel;
use super::shader::Kernel;
use crate::backend::BackendError;
use crate::linalg::{BlockMatrix, REDUCTION_CHANGED, Solver};
use rayon::prelude::*;
use std::ops::{Deref, Range};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Fall of the residual that the inner iterations are to reach with a regularised matrix, whose long waves fall last
/// and are what the regularisation is about; else it is that of the host: an iteration solved to less takes another
/// one.
const REDUCTION_REGULARISED: f64 = 1e-3;
/// Inner iterations, at least and at most; a regularised matrix that needs more is solved by the host.
const LEAST: usize = 4;
const MOST: usize = 32;
/// A row of a penalty whose sum is more than this share of its diagonal acts on a displacement that is the same
/// everywhere; the kernel supposes that none does.
const ROW_SUM: f64 = 1e-6;
/// Threads of a workgroup of the solver's kernels.
pub(super) const NODES_TOGETHER: usize = 256;

/// A solver that both sides have.
#[derive(Debug)]
pub struct GpuSolver {
    host: Solver,
    pub(super) id: u64,
    /// How the nodes answer to gain and offset of their zone, see [`Solver::responses`].
    pub(super) responses: Option<Arc<Buffer>>,
    pub(super) device: Option<ConjugateGradients>,
    /// Inner iterations of a matrix of which some rows have changed.
    n_changed: Option<usize>,
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
    blocks: Buffer,
    /// Blocks of the penalty, on the same pattern.
    penalty: Option<Buffer>,
    /// Inner iterations.
    pub n: usize,
    pattern: Arc<OnDevice>,
}

/// A pattern on the device.
#[derive(Debug)]
struct OnDevice {
    pattern: Buffer,
    n_nodes: usize,
    /// Windows of nodes whose blocks are seen at once.
    windows: Vec<Window>,
}

/// Nodes and the place of their blocks; the place in bytes, too, where a binding may begin.
#[derive(Debug)]
struct Window {
    nodes: Range<usize>,
    first_block: usize,
    bytes: u64,
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
        let (reduction, of_changed) = match host.penalty() {
            Some(_) => (REDUCTION_REGULARISED, None),
            None => (host.reduction(), Some(REDUCTION_CHANGED)),
        };
        let trial = |reduction: f64| host.trial_iterations(reduction, MOST).max(LEAST);
        // One with a factor of its own is not tried.
        let iterations = if host.name() == "iterative" || host.penalty().is_some() { trial(reduction) } else { MOST };
        let on_device = match host.penalty() {
            Some(penalty) => iterations < MOST && acts_on_differences(penalty),
            None => host.name() == "iterative",
        };
        let pattern = || Ok(Arc::new(OnDevice::new(gpu, &host)?));
        let device = match on_device {
            true => Some(ConjugateGradients::new(gpu, &host, iterations, pattern()?)?),
            false => None,
        };
        let n_changed = if on_device { of_changed.map(trial) } else { None };
        let of_node =
            |(gain, offset): (&[f64; 2], &[f64; 2])| [gain[0], gain[1], offset[0], offset[1]].map(|u| u as f32);
        let responses = host
            .responses()
            .map(|[by_gain, by_offset]| -> Vec<[f32; 4]> { by_gain.iter().zip(by_offset).map(of_node).collect() });
        let responses = responses.map(|of| gpu.filled(&of, "responses to light")).transpose()?.map(Arc::new);
        Ok(Self { host, id: next_id(), responses, device, n_changed })
    }

    /// The solver of the host.
    pub(super) fn into_host(self) -> Solver {
        self.host
    }

    /// One for a matrix that differs from that of this one in some rows, see [`Solver::change_rows`]: what both have in
    /// common is not brought to the device again.
    pub(super) fn change_rows(&self, gpu: &Gpu, host: Solver) -> Result<Self, BackendError> {
        let (Some(of_this), Some(n), None) = (&self.device, self.n_changed, host.penalty()) else {
            return Self::new(gpu, host);
        };
        let device = Some(ConjugateGradients::new(gpu, &host, n, of_this.pattern.clone())?);
        Ok(Self { host, id: next_id(), responses: self.responses.clone(), device, n_changed: self.n_changed })
    }
}

fn next_id() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(1);
    COUNT.fetch_add(1, Ordering::Relaxed)
}

impl OnDevice {
    fn new(gpu: &Gpu, solver: &Solver) -> Result<Self, BackendError> {
        let pattern = solver.matrix().pattern();
        let n_nodes = pattern.n_nodes();
        let starts = n_nodes as u32 + 1;
        let rows: Vec<u32> = (0..n_nodes).map(|node| starts + pattern.row(node).start as u32).collect();
        let end = starts + pattern.n_blocks() as u32;
        let places: Vec<u32> = rows.into_iter().chain([end]).chain(pattern.columns().iter().copied()).collect();
        let blocks_seen = (gpu.max_binding_bytes.saturating_sub(gpu.alignment()) / 16) as usize;
        let per_alignment = (gpu.alignment() / 16).max(1) as usize;
        // They begin with a workgroup.
        let mut windows = Vec::new();
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
            let first_block = first_block / per_alignment * per_alignment;
            let bytes = 16 * (pattern.row(to - 1).end - first_block) as u64;
            windows.push(Window { nodes: from..to, first_block, bytes });
            from = to;
        }
        Ok(Self { pattern: gpu.filled(&places, "the pattern of the normal matrix")?, n_nodes, windows })
    }

    /// What an iteration is told.
    fn constants(&self, iteration: usize, nodes: Range<usize>, first_block: usize) -> layout::Cg {
        layout::Cg {
            n_nodes: self.n_nodes as u32,
            iteration: iteration as u32,
            n_partial: self.n_nodes.div_ceil(NODES_TOGETHER) as u32,
            first_node: nodes.start as u32,
            last_node: nodes.end as u32,
            first_block: first_block as u32,
            unused0: 0,
            unused1: 0,
        }
    }

    /// Of each window: what the iteration is told, its part of `blocks`, its workgroups.
    fn parts<'a>(
        &'a self,
        gpu: &'a Gpu,
        iteration: usize,
        blocks: &'a Buffer,
    ) -> impl Iterator<Item = (Buffer, wgpu::BindingResource<'a>, u32)> {
        self.windows.iter().map(move |Window { nodes, first_block, bytes }| {
            let uniform = gpu.uniform(&self.constants(iteration, nodes.clone(), *first_block));
            let groups = nodes.len().div_ceil(NODES_TOGETHER) as u32;
            (uniform, blocks.part(16 * *first_block as u64, *bytes), groups)
        })
    }
}

impl ConjugateGradients {
    fn new(gpu: &Gpu, solver: &Solver, n: usize, pattern: Arc<OnDevice>) -> Result<Self, BackendError> {
        let matrix = solver.matrix();
        let mut jacobi: Vec<[f32; 4]> =
            solver.jacobi().inverse.iter().map(|&[xx, xy, yy]| [xx as f32, xy as f32, yy as f32, 0.0]).collect();
        // A node that is held takes no correction, whatever the right-hand side there.
        matrix.held().iter().for_each(|&node| jacobi[node as usize] = [0.0; 4]);
        let stored = |matrix: &BlockMatrix| {
            let blocks: Vec<[f32; 4]> = matrix.blocks().par_iter().map(|block| block.map(|v| v as f32)).collect();
            let buffer = gpu.storage(16 * blocks.len() as u64, "the normal matrix")?;
            gpu.write(&buffer, &blocks);
            Ok::<_, BackendError>(buffer)
        };
        Ok(Self {
            jacobi: gpu.filled(&jacobi, "the nodal blocks")?,
            blocks: stored(matrix)?,
            penalty: solver.penalty().map(|penalty| stored(penalty)).transpose()?,
            n,
            pattern,
        })
    }

    /// The right-hand side at `displacement` and the start of the iteration.
    pub(super) fn gather(
        &self,
        gpu: &Gpu,
        level: &GpuLevel,
        [sums, displacement]: [&Buffer; 2],
        vectors: &Vectors,
    ) -> Vec<(Bound, u32)> {
        let mut kernels = vec![gather(gpu, level, sums, vectors, &self.jacobi)];
        let Some(penalty) = &self.penalty else { return kernels };
        let pipeline = gpu.pipeline(Kernel::Penalty, level.options.interpolation, 0);
        for (uniform, part, groups) in self.pattern.parts(gpu, 0, penalty) {
            let bound = gpu.bind(
                &pipeline,
                &[
                    uniform.whole(),
                    self.pattern.pattern.whole(),
                    part,
                    displacement.whole(),
                    self.jacobi.whole(),
                    vectors.residual.whole(),
                    vectors.preconditioned.whole(),
                    vectors.products.whole(),
                ],
            );
            kernels.push((bound, groups));
        }
        kernels
    }

    /// The kernels of all iterations, with their workgroups.
    pub(super) fn kernels(&self, gpu: &Gpu, level: &GpuLevel, vectors: &Vectors) -> Vec<(Bound, u32)> {
        let interpolation = level.options.interpolation;
        let (product, update) =
            (gpu.pipeline(Kernel::CgProduct, interpolation, 0), gpu.pipeline(Kernel::CgUpdate, interpolation, 0));
        let n_nodes = level.mesh.n_nodes();
        let mut kernels = Vec::new();
        for k in 0..self.n {
            let [old, new] = if k % 2 == 0 { [0, 1] } else { [1, 0] };
            for (uniform, part, groups) in self.pattern.parts(gpu, k, &self.blocks) {
                let bound = gpu.bind(
                    &product,
                    &[
                        uniform.whole(),
                        self.pattern.pattern.whole(),
                        part,
                        vectors.preconditioned.whole(),
                        vectors.directions[old].whole(),
                        vectors.directions[new].whole(),
                        vectors.image.whole(),
                        vectors.products.whole(),
                    ],
                );
                kernels.push((bound, groups));
            }
            let bound = gpu.bind(
                &update,
                &[
                    gpu.uniform(&self.pattern.constants(k, 0..n_nodes, 0)).whole(),
                    self.jacobi.whole(),
                    vectors.directions[new].whole(),
                    vectors.image.whole(),
                    vectors.solution.whole(),
                    vectors.residual.whole(),
                    vectors.preconditioned.whole(),
                    vectors.products.whole(),
                ],
            );
            kernels.push((bound, n_nodes.div_ceil(NODES_TOGETHER) as u32));
        }
        kernels
    }
}

/// Whether a penalty leaves a displacement alone that is the same everywhere.
fn acts_on_differences(penalty: &BlockMatrix) -> bool {
    (0..penalty.pattern().n_nodes()).all(|node| {
        let [xx, _, yy] = penalty.diagonal(node);
        let mut sum = [0.0; 4];
        for block in &penalty.blocks()[penalty.pattern().row(node)] {
            sum.iter_mut().zip(block).for_each(|(sum, value)| *sum += value);
        }
        sum.iter().all(|sum| sum.abs() <= ROW_SUM * xx.max(yy))
    })
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
