//! The finest level of a reference, with its texture check.

use super::error::{CorrelationError, TextureFault};
use super::gradient_noise::{AssumedNoise, element_lambda, element_matrices, mass_matrices, without_noise};
use super::level::{Level, elimination_order, support};
use super::options::Options;
use super::regularisation::{PenaltyScale, Regularisation, Regulariser};
use super::texture::{SeenByNode, faults, least_determined, seen_by_nodes, undetermined};
use super::uncertainty::{NodalSpread, NoiseGain, spread_of};
use crate::backend::{Backend, KernelOptions, coupled};
use crate::linalg::{BlockMatrix, Pattern, Solver};
use crate::mesh::{Mesh, PixelMesh};
use crate::units::Px;
use std::collections::HashSet;
use std::sync::Arc;

/// The finest level and what goes with it.
pub(super) struct Finest<B: Backend> {
    pub level: Level<B>,
    /// Variances for image noise of one grey level, per node.
    pub spread: NodalSpread,
    /// What the nodes see of texture and noise together.
    pub seen: Vec<SeenByNode>,
    /// Nodes left out.
    pub dropped: Vec<TextureFault>,
    /// Nodes without texture that the regularisation holds.
    pub held: Vec<TextureFault>,
}

/// Prepares the finest level: matrix, factor, uncertainty. Nodes without texture are refused, left out or held by
/// the regularisation, until what remains is determined.
pub(super) fn finest_level<B: Backend>(
    backend: &B,
    frame: &mut B::Frame,
    mesh: &PixelMesh,
    noise: &AssumedNoise,
    noise_gain: &NoiseGain,
    kernel: &KernelOptions,
    options: &Options,
) -> Result<Finest<B>, CorrelationError> {
    let (mut prepared, mut moments) = backend.reference(frame, 0, mesh, kernel)?;
    let mesh = mesh.mesh.clone();
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let mut keep = vec![true; mesh.n_nodes()];
    let mut active = vec![true; mesh.n_elements()];
    let mut dropped: Vec<TextureFault> = Vec::new();
    let lambda = noise.lambda(kernel.interpolation);
    loop {
        let matrices = element_matrices(&moments, kernel);
        let masses = mass_matrices(&mesh, &moments);
        let support = support(&mesh, &moments);
        let with_noise = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
        let mut found = faults(&mesh, &with_noise, &support, noise, kernel.interpolation);
        let seen_by_nodes = seen_by_nodes(&with_noise, &support);
        drop(with_noise);
        found.retain(|fault| keep[fault.node]);
        let mut held = Vec::new();
        if !options.drop_textureless && options.regularisation != Regularisation::None {
            held = std::mem::take(&mut found);
            found = of_blank_zones(&mesh, &held);
        }
        if found.is_empty() {
            let seen = textured(&keep, &held);
            let taken_off = element_lambda(&matrices, &masses, lambda);
            let mut matrix = without_noise(&mesh, &pattern, &matrices, &masses, &taken_off);
            matrix.hold(&keep);
            let spread_of = |solver: &Solver, regulariser: Option<&Regulariser>| {
                spread_of(backend.host_isa(), &mesh, solver, regulariser, &masses, &taken_off)
            };
            let texture = PenaltyScale { matrix: &matrix, support: &support, seen: &seen };
            let regulariser = Regulariser::new(options.regularisation, &mesh, &pattern, &active, &texture);
            let (solver, spread, has_factor) = match &regulariser {
                Some(regulariser) => match regulariser.solver(matrix.clone()) {
                    Ok(solver) => {
                        let spread = spread_of(&solver, Some(regulariser));
                        (solver, spread, true)
                    }
                    // The images alone say which nodes are to blame.
                    Err(_) => {
                        let solver = Solver::iterative(matrix);
                        let spread = spread_of(&solver, None);
                        (solver, spread, false)
                    }
                },
                None => {
                    let solver = Solver::iterative(matrix);
                    // Two long pieces of work that need the matrix alone.
                    let (factor, spread) = rayon::join(
                        || solver.factor(backend.solver_choice(options.solver), || elimination_order(&mesh, &pattern)),
                        || spread_of(&solver, None),
                    );
                    let has_factor = factor.is_ok();
                    (solver.with_factor(factor.unwrap_or(None)), spread, has_factor)
                }
            };
            let at_rest = noise_gain.at_rest();
            found = undetermined(&mesh, &keep, |node| {
                [0, 1].map(|c| {
                    let at = spread.at(node, c, at_rest.lambda(noise.of_check));
                    at_rest.variance(noise.of_check, at, c).sqrt()
                })
            });
            if !has_factor && found.is_empty() {
                found = least_determined(&mesh, spread.variance(), &keep);
            }
            if found.is_empty() {
                backend.restrict(&mut prepared, &active)?;
                let solver = backend.solver(&prepared, coupled(solver, &pattern, &moments, kernel.brightness))?;
                dropped.sort_by_key(|fault| fault.node);
                let moments = Arc::new(moments);
                let level = Level { mesh, prepared, moments, pattern, solver, keep, regulariser, lambda };
                return Ok(Finest { level, spread, seen: seen_by_nodes, dropped, held });
            }
        }
        if !options.drop_textureless {
            may_be_left_out(&mesh, &dropped, &found, options)?;
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

/// Refuses nodes without texture that are more than their share of a zone, or on a border of which none may be left out.
/// `dropped` went before, because of others; `found` would follow.
fn may_be_left_out(
    mesh: &Mesh<Px>,
    dropped: &[TextureFault],
    found: &[TextureFault],
    options: &Options,
) -> Result<(), CorrelationError> {
    let mut all: Vec<TextureFault> = dropped.iter().chain(found).cloned().collect();
    all.sort_by_key(|fault| fault.node);
    for (zone, name) in mesh.zones().iter().enumerate() {
        let nodes = mesh.zone_nodes(zone);
        let of_zone = || all.iter().filter(|fault| nodes.contains(&fault.node));
        if of_zone().count() as f64 > options.textureless_share * nodes.len() as f64 {
            return Err(CorrelationError::NoTexture { faults: all, n_nodes: mesh.n_nodes() });
        }
        if options.whole_borders.contains(name) {
            let border: HashSet<u32> = mesh.boundary(zone).into_iter().flatten().collect();
            let on_border = |fault: &&TextureFault| border.contains(&(fault.node as u32));
            let faults: Vec<TextureFault> = of_zone().filter(on_border).cloned().collect();
            if !faults.is_empty() {
                return Err(CorrelationError::FaceWithoutTexture { zone: name.clone(), faults });
            }
        }
    }
    Ok(())
}

/// The nodes that see texture: kept, and not held by the regularisation alone.
fn textured(keep: &[bool], held: &[TextureFault]) -> Vec<bool> {
    let mut seen = keep.to_vec();
    held.iter().for_each(|fault| seen[fault.node] = false);
    seen
}

/// The faults of zones in which not one node sees texture: there is nothing that could hold them.
fn of_blank_zones(mesh: &Mesh<Px>, faults: &[TextureFault]) -> Vec<TextureFault> {
    let zone_of = |fault: &TextureFault| mesh.node_zone()[fault.node] as usize;
    let mut left: Vec<usize> = (0..mesh.zones().len()).map(|zone| mesh.zone_nodes(zone).len()).collect();
    faults.iter().for_each(|fault| left[zone_of(fault)] -= 1);
    faults.iter().filter(|fault| left[zone_of(fault)] == 0).cloned().collect()
}
