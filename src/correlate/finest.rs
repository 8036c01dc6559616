//! The finest level of a reference, with its texture check.

use super::error::CorrelationError;
use super::level::{Level, assemble, elimination_order, support};
use super::options::Options;
use super::texture::{TextureFault, faults, least_determined, undetermined};
use super::uncertainty::inverse_variances;
use crate::backend::{Backend, KernelOptions};
use crate::linalg::{Pattern, Solver};
use crate::mesh::PixelMesh;
use std::sync::Arc;

/// The finest level and what goes with it.
pub(super) struct Finest<B: Backend> {
    pub level: Level<B>,
    /// Diagonal of the inverse of its matrix, per node.
    pub inverse_variance: Vec<[f64; 2]>,
    /// Nodes left out.
    pub dropped: Vec<TextureFault>,
}

/// Prepares the finest level: matrix, factor, uncertainty. Nodes without texture are refused or left out,
/// until what remains is determined.
pub(super) fn finest_level<B: Backend>(
    backend: &B,
    frame: &mut B::Frame,
    mesh: &PixelMesh,
    noise: f64,
    kernel: &KernelOptions,
    options: &Options,
) -> Result<Finest<B>, CorrelationError> {
    let (mut prepared, mut moments) = backend.reference(frame, 0, mesh, kernel)?;
    let mesh = mesh.mesh.clone();
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let mut keep = vec![true; mesh.n_nodes()];
    let mut active = vec![true; mesh.n_elements()];
    let mut dropped: Vec<TextureFault> = Vec::new();
    loop {
        let mut matrix = assemble(&mesh, &pattern, &moments, kernel);
        let mut found = faults(&mesh, &matrix, &support(&mesh, &moments), noise, kernel.interpolation);
        found.retain(|fault| keep[fault.node]);
        if found.is_empty() {
            matrix.hold(&keep);
            let solver = Solver::iterative(matrix);
            // Two long pieces of work that need the matrix alone.
            let (factor, inverse_variance) = rayon::join(
                || solver.factor(options.solver, || elimination_order(&mesh, &pattern)),
                || inverse_variances(backend.host_isa(), &mesh, &solver),
            );
            let has_factor = factor.is_ok();
            let solver = solver.with_factor(factor.unwrap_or(None));
            found = undetermined(&mesh, &inverse_variance, &keep, noise);
            if !has_factor && found.is_empty() {
                found = least_determined(&mesh, &inverse_variance, &keep);
            }
            if found.is_empty() {
                backend.restrict(&mut prepared, &active);
                dropped.sort_by_key(|fault| fault.node);
                let level = Level { mesh, prepared, moments, pattern, solver, keep };
                return Ok(Finest { level, inverse_variance, dropped });
            }
        }
        if !options.drop_textureless {
            return Err(CorrelationError::NoTexture { faults: found, n_nodes: mesh.n_nodes() });
        }
        if found.len() == keep.iter().filter(|&&kept| kept).count() {
            return Err(CorrelationError::Textureless);
        }
        // An element with a node that is left out would be read at a guess there, so it is left out
        // too; that may leave further nodes without texture.
        for fault in &found {
            keep[fault.node] = false;
        }
        for (element, nodes) in mesh.elements().iter().enumerate() {
            if active[element] && nodes.iter().any(|&node| !keep[node as usize]) {
                active[element] = false;
                moments[element] = Default::default();
            }
        }
        dropped.extend(found);
    }
}
