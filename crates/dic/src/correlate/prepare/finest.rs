//! The finest level of a reference, with its texture check.

use crate::backend::{Backend, ElementMoments, KernelOptions, couple};
use crate::correlate::{
    AssumedNoise, Changed, CorrelationError, Lack, Level, NodalSpread, NoiseGain, OfElement, Options, PenaltyScale,
    Regulariser, Result, SeenByNode, TextureFault, diagonal_with_noise, find_faults, find_least_determined,
    find_undetermined, seen_by_nodes, splines, spread_of, support_of, without_noise,
};
use crate::field::Elements;
use crate::imaging::Image;
use crate::isa::Isa;
use crate::linalg::{BlockMatrix, Pattern, Solver, Subspace, dissection, nested_dissection};
use crate::mesh::{Mesh, PixelMesh};
use crate::units::Px;
use rayon::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

/// The finest level and what goes with it.
pub(crate) struct Finest<B: Backend> {
    pub level: Level<B>,
    /// Variances for image noise of one grey level, per node.
    pub spread: NodalSpread,
    /// What the nodes see of texture and noise together.
    pub seen: Vec<SeenByNode>,
    pub dropped: Vec<TextureFault>,
    /// Nodes without texture that a regularisation or splines hold.
    pub held: Vec<TextureFault>,
}

/// What the pixels of the finest level say of its elements and nodes, while some are left out.
struct Seen<'a> {
    mesh: &'a Mesh<Px>,
    pattern: &'a Pattern,
    moments: Vec<ElementMoments>,
    of_elements: Vec<OfElement>,
    /// Elements that are not left out.
    active: Vec<bool>,
    /// Per node, its block with the noise of the gradient.
    blocks: Vec<[f64; 3]>,
    /// See [`support_of`].
    support: Vec<f64>,
}

impl<'a> Seen<'a> {
    fn new(
        (mesh, pattern): (&'a Mesh<Px>, &'a Pattern),
        moments: Vec<ElementMoments>,
        options: &KernelOptions,
        lambda: f64,
    ) -> Self {
        let of_elements = OfElement::all(mesh, &moments, options, lambda);
        let (active, blocks, support) = (vec![true; mesh.n_elements()], Vec::new(), Vec::new());
        let mut seen = Self { mesh, pattern, moments, of_elements, active, blocks, support };
        let of_nodes = (0..mesh.n_nodes()).into_par_iter().with_min_len(2048).map(|node| seen.of_node(node));
        (seen.blocks, seen.support) = of_nodes.unzip();
        seen
    }

    fn of_node(&self, node: usize) -> ([f64; 3], f64) {
        let block = diagonal_with_noise(self.mesh, self.pattern, &self.of_elements, node);
        (block, support_of(self.pattern, &self.moments, node))
    }

    /// Leaves out the elements of `nodes`, which would be read at a guess there. Returns those that were not before.
    fn leave_out(&mut self, nodes: &[u32]) -> Vec<u32> {
        let mut left_out = self.pattern.elements_around(nodes);
        left_out.retain(|&element| self.active[element as usize]);
        for element in left_out.iter().map(|&element| element as usize) {
            self.active[element] = false;
            (self.moments[element], self.of_elements[element]) = (ElementMoments::default(), OfElement::NONE);
        }
        for node in left_out.iter().flat_map(|&element| self.mesh.elements()[element as usize]) {
            (self.blocks[node as usize], self.support[node as usize]) = self.of_node(node as usize);
        }
        left_out
    }
}

/// What a round of the search for nodes without texture is given.
struct Round<'a> {
    isa: Isa,
    seen: &'a Seen<'a>,
    pattern: &'a Arc<Pattern>,
    /// Nodes that are not left out, and those of them that see texture.
    keep: &'a [bool],
    textured: Vec<bool>,
    lambda: f64,
    kernel: &'a KernelOptions,
    options: &'a Options,
    splines: Option<&'a Arc<Subspace>>,
}

struct Solved {
    solver: Solver,
    regulariser: Option<Regulariser>,
    spread: NodalSpread,
    has_factor: bool,
}

impl Round<'_> {
    /// The matrix without the nodes left out, its factor, its spread; `before`: those before `left_out` went.
    fn solve(&self, before: Option<(BlockMatrix, NodalSpread)>, mut left_out: Vec<u32>) -> Solved {
        let Self { isa, seen, pattern, keep, options, .. } = *self;
        let mesh = seen.mesh;
        left_out.sort_unstable();
        let lost: Vec<_> = left_out.into_iter().map(|at| (at as usize, ElementMoments::default())).collect();
        let changed = Changed::new((mesh, pattern), &seen.moments, &lost, self.lambda, self.kernel);
        let (mut matrix, spread) = match before {
            Some((mut matrix, spread)) => {
                let of_element = |element: u32| &seen.of_elements[element as usize].matrix;
                matrix.assemble_rows(&changed.nodes, mesh.elements(), of_element);
                (matrix, Some(spread))
            }
            None => (without_noise(mesh, pattern, &seen.of_elements), None),
        };
        matrix.hold(keep);
        let spread_with = |solver: &Solver, regulariser: Option<&Regulariser>| {
            let before = spread.as_ref().filter(|_| regulariser.is_none());
            before
                .and_then(|spread| spread.update(isa, (mesh, &seen.moments), pattern, (solver, None), &changed))
                .unwrap_or_else(|| spread_of(isa, mesh, solver, regulariser, &seen.of_elements))
        };
        let texture = PenaltyScale { matrix: &matrix, support: &seen.support, seen: &self.textured };
        let regulariser = match self.splines {
            Some(splines) => Some(Regulariser::Splines(splines.clone())),
            None => Regulariser::new(options.regularisation, mesh, pattern, &seen.active, &texture, true),
        };
        let Some(regulariser) = regulariser else {
            let solver = Solver::iterative(matrix);
            // Two long pieces of work that need the matrix alone.
            let (factor, spread) = rayon::join(
                || solver.factor(options.solver, || elimination_order(mesh, pattern)),
                || spread_with(&solver, None),
            );
            let has_factor = factor.is_ok();
            let solver = solver.with_factor(factor.unwrap_or(None));
            return Solved { solver, regulariser: None, spread, has_factor };
        };
        let solver = regulariser.solver(matrix.clone());
        let has_factor = solver.is_ok();
        // Else the images alone say which nodes are to blame.
        let solver = solver.unwrap_or_else(|_| Solver::iterative(matrix));
        let spread = spread_with(&solver, Some(&regulariser).filter(|_| has_factor));
        Solved { solver, regulariser: Some(regulariser), spread, has_factor }
    }
}

/// Prepares the finest level. Nodes without texture are refused, left out or held until the rest is determined.
///
/// That may take a dozen rounds, each of which leaves out a few nodes: what does not change is kept.
pub(crate) fn finest_level<B: Backend>(
    backend: &B,
    frame: &mut B::Frame,
    (mesh, smoothed): (&PixelMesh, Option<&Arc<Image>>),
    noise: &AssumedNoise,
    noise_gain: &NoiseGain,
    kernel: &KernelOptions,
    options: &Options,
) -> Result<Finest<B>> {
    let (mut prepared, moments) = backend.reference(frame, 0, mesh, kernel, smoothed)?;
    let mesh = mesh.mesh.clone();
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let lambda = noise.lambda(kernel);
    let mut seen = Seen::new((&mesh, &pattern), moments, kernel, lambda);
    let mut keep = vec![true; mesh.n_nodes()];
    let mut dropped: Vec<TextureFault> = Vec::new();
    let splines = match options.elements {
        Elements::Bilinear => None,
        Elements::CubicSpline => Some(Arc::new(splines(&mesh).ok_or_else(|| {
            let zone = (0..mesh.zones().len()).find(|&zone| mesh.grid(zone).is_none()).unwrap_or(0);
            CorrelationError::Splines { zone: mesh.zones()[zone].clone() }
        })?)),
    };
    // The matrix of the last round that came so far, its spread, and the elements that have been left out since.
    let (mut made, mut left_out): (Option<(BlockMatrix, NodalSpread)>, Vec<u32>) = (None, Vec::new());
    loop {
        let mut found = {
            let (gain, most) = (kernel.gradient_noise_gain, options.sigma_most_px);
            find_faults(&mesh, &seen.blocks, &seen.support, noise, gain, most)
        };
        found.retain(|fault| keep[fault.node]);
        let mut held = Vec::new();
        if !options.drop_textureless && options.is_held() {
            held = std::mem::take(&mut found);
            found = find_blank_zones(&mesh, &held);
        }
        if found.is_empty() {
            // Kept, and not held by the regularisation alone.
            let mut textured = keep.clone();
            held.iter().for_each(|fault| textured[fault.node] = false);
            let (splines, isa) = (splines.as_ref(), backend.host_isa());
            let round =
                Round { isa, seen: &seen, pattern: &pattern, keep: &keep, textured, lambda, kernel, options, splines };
            let Solved { solver, regulariser, spread, has_factor } =
                round.solve(made.take(), std::mem::take(&mut left_out));
            let at_rest = noise_gain.at_rest();
            found = find_undetermined(&mesh, &keep, options.sigma_most_px, |node| {
                [0, 1].map(|c| {
                    let at = spread.at(node, c, at_rest.lambda(noise.of_check));
                    at_rest.variance(noise.of_check, at, c).sqrt()
                })
            });
            if !has_factor && found.is_empty() {
                found = find_least_determined(&mesh, &spread.variance, &keep);
            }
            if found.is_empty() {
                let seen_by_nodes = seen_by_nodes(&seen.blocks, &seen.support);
                let Seen { moments, active, .. } = seen;
                backend.restrict(&mut prepared, &active)?;
                let solver = backend.solver(&prepared, couple(solver, &pattern, &moments, kernel.brightness))?;
                dropped.sort_by_key(|fault| fault.node);
                let moments = Arc::new(moments);
                let level = Level { mesh, prepared, moments, pattern, solver, keep, regulariser, lambda };
                return Ok(Finest { level, spread, seen: seen_by_nodes, dropped, held });
            }
            if regulariser.is_none() {
                made = Some((solver.into_matrix(), spread));
            }
        }
        if !options.drop_textureless {
            refuse_left_out(&mesh, &dropped, &found, options, noise)?;
        }
        if found.len() == keep.iter().filter(|&&kept| kept).count() {
            let faults: Vec<&TextureFault> = dropped.iter().chain(&found).collect();
            let larger = larger_elements(&faults, options);
            return Err(CorrelationError::Textureless { stated: noise.beyond_image(), larger });
        }
        found.iter().for_each(|fault| keep[fault.node] = false);
        // That may leave further nodes without texture.
        let nodes: Vec<u32> = found.iter().map(|fault| fault.node as u32).collect();
        left_out.extend(seen.leave_out(&nodes));
        dropped.extend(found);
    }
}

/// The size of elements, px, with which nine tenths of the nodes would be certain enough, or fewer where that is too
/// large: their standard uncertainty falls with it. None where they show no texture at all.
fn larger_elements(faults: &[&TextureFault], options: &Options) -> Option<usize> {
    let size = options.element_size;
    let of_fault = |fault: &&TextureFault| match fault.lack {
        Lack::Precision { sigma_px } => sigma_px,
        Lack::Texture { .. } => f64::INFINITY,
    };
    let mut sigma: Vec<f64> = faults.iter().map(of_fault).collect();
    sigma.sort_by(f64::total_cmp);
    [0.9, 0.75, 0.5].into_iter().find_map(|share| {
        let most = sigma.get((share * sigma.len() as f64) as usize).filter(|sigma| sigma.is_finite())?;
        let larger = (size as f64 * most / options.sigma_most_px / 8.0).ceil() as usize * 8;
        (size < larger && larger <= 128).then_some(larger)
    })
}

/// Refuses nodes without texture that are more than their share of a zone, or on a border of which none may be left
/// out. `dropped` went before, because of others; `found` would follow.
fn refuse_left_out(
    mesh: &Mesh<Px>,
    dropped: &[TextureFault],
    found: &[TextureFault],
    options: &Options,
    noise: &AssumedNoise,
) -> Result<()> {
    let mut all: Vec<TextureFault> = dropped.iter().chain(found).cloned().collect();
    all.sort_by_key(|fault| fault.node);
    for (zone, name) in mesh.zones().iter().enumerate() {
        let nodes = mesh.zone_nodes(zone);
        let of_zone = || all.iter().filter(|fault| nodes.contains(&fault.node));
        if of_zone().count() as f64 > options.textureless_share * nodes.len() as f64 {
            let (stated, n_nodes) = (noise.beyond_image(), mesh.n_nodes());
            return Err(CorrelationError::NoTexture { stated, faults: all, n_nodes });
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

/// The faults of zones in which not one node sees texture: there is nothing that could hold them.
fn find_blank_zones(mesh: &Mesh<Px>, faults: &[TextureFault]) -> Vec<TextureFault> {
    let zone_of = |fault: &TextureFault| mesh.node_zone()[fault.node] as usize;
    let mut left: Vec<usize> = (0..mesh.zones().len()).map(|zone| mesh.zone_nodes(zone).len()).collect();
    faults.iter().for_each(|fault| left[zone_of(fault)] -= 1);
    faults.iter().filter(|fault| left[zone_of(fault)] == 0).cloned().collect()
}

/// Elimination order of all zones, one after the other.
fn elimination_order(mesh: &Mesh<Px>, pattern: &Pattern) -> Vec<usize> {
    let mut order = Vec::with_capacity(mesh.n_nodes());
    for zone in 0..mesh.zones().len() {
        let nodes = mesh.zone_nodes(zone);
        let Some(grid) = mesh.grid(zone) else {
            order.extend(dissection(pattern, mesh.nodes(), nodes));
            continue;
        };
        let places = nested_dissection(grid.nx + 1, grid.ny + 1);
        if mesh.whole_grid(zone).is_some() {
            order.extend(places.into_iter().map(|place| nodes.start + place));
            continue;
        }
        // The order of the whole grid serves a part of it too.
        let mut node_at = vec![None; grid.n_nodes()];
        for node in nodes {
            let [i, j] = grid.column_and_row(mesh.nodes()[node]);
            node_at[j * (grid.nx + 1) + i] = Some(node);
        }
        order.extend(places.into_iter().filter_map(|place| node_at[place]));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Brightness;
    use crate::imaging::Interpolation;
    use crate::mesh::{Roi, Zone};

    #[test]
    fn what_is_kept_from_round_to_round_is_what_would_be_made_anew() {
        let zones = [Zone::rectangle("zone", Roi { x0: 0.0, y0: 0.0, x1: 96.0, y1: 80.0 })];
        let mesh = PixelMesh::on_zones(&zones, 8, 0.5, [96, 80]).unwrap().mesh;
        let pattern = Pattern::new(mesh.n_nodes(), mesh.elements());
        let noise = |k: usize| 0.5 + f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 65536.0;
        // The means of the nine weights, as of a gradient that is even over the element.
        const EVEN: [f64; 3] = [1.0 / 3.0, 1.0 / 6.0, 1.0 / 3.0];
        let of_element = |element: usize| ElementMoments {
            gradient: [0, 1, 2].map(|p| {
                let square = if p == 1 { 5.0 } else { 640.0 } * noise(3 * element + p);
                EVEN.map(|row| EVEN.map(|column| square * row * column))
            }),
            n: 64.0,
            ..ElementMoments::default()
        };
        let moments: Vec<ElementMoments> = (0..mesh.n_elements()).map(of_element).collect();
        let options = KernelOptions::new((0.0, 255.0), Interpolation::Cubic, Brightness::Zone);
        let new = |moments: Vec<ElementMoments>| Seen::new((&mesh, &pattern), moments, &options, 0.5);
        let mut seen = new(moments);
        assert!(seen.of_elements.iter().all(|of| of.lambda == 0.5), "the noise is taken off");
        let [corner, beside, middle] =
            [[0.0, 0.0], [8.0, 0.0], [48.0, 40.0]].map(|at| mesh.nodes().iter().position(|&x| x == at).unwrap() as u32);
        let rounds = [(vec![middle, corner], 5), (vec![beside], 1), (vec![corner], 0)];
        for (nodes, want) in rounds {
            assert_eq!(seen.leave_out(&nodes).len(), want);
            let anew = new(seen.moments.clone());
            assert_eq!((&seen.blocks, &seen.support), (&anew.blocks, &anew.support));
            let matrices = [&seen, &anew].map(|of| without_noise(&mesh, &Arc::new(pattern.clone()), &of.of_elements));
            assert_eq!(matrices[0].blocks(), matrices[1].blocks());
        }
        assert_eq!(seen.active.iter().filter(|active| !**active).count(), 6);
        assert_eq!((seen.blocks[corner as usize], seen.support[corner as usize]), ([0.0; 3], 0.0));
    }
}
