//! Standard uncertainty of the nodal displacements (THEORY 2 and 10), for noise that need not be small:
//! `Cov(a) = sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v lambda M0^-1 P M0^-1]`, with regularisation `A^-1 . A^-1` around
//! `M0` and `P`, `A = M0 + w R`.

use crate::backend::{ElementMoments, GreyTransfer, PixelSums};
use crate::correlate::{Changed, LEAST_SHARE_OF_VARIANCE, OfElement, Regulariser, mass_matrix};
use crate::imaging::Interpolation;
use crate::isa::Isa;
use crate::linalg::{
    BlockMatrix, ElementMatrix, Pattern, Solver, Spread, inverse_diagonal_of_part, inverse_diagonal_with, upper,
};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;
use rayon::prelude::*;

/// Where elements have lost pixels the spread is done anew for their nodes and this many rows of nodes around them.
/// What happens at a node reaches others by about 0.27 per row, and their variance by the square of that: by 4e-4
/// beyond.
const REDONE_ROWS: usize = 2;
/// and those redone are solved for with this many further rows, beyond which nodes are held: as much again.
const FREE_ROWS: usize = 2;

/// What the noise of the images does to every node, and what the nodes take from the residual (THEORY 10).
#[derive(Debug, Clone)]
pub(crate) struct NodalSpread {
    /// Diagonal of `M0^-1`, with regularisation of `A^-1 M0 A^-1`, per node, for the noise that the steps suppose.
    pub variance: Vec<[f64; 2]>,
    /// Diagonal of `M0^-1 P M0^-1`, with regularisation of `A^-1 P A^-1`.
    of_mass: Vec<[f64; 2]>,
    /// Degrees of freedom that each node takes from the residual.
    pub freedom: Vec<f64>,
    /// What was taken off the matrix: `M0 = M - lambda P`, the mean over the elements of each node.
    lambda: Vec<f64>,
    is_regularised: bool,
    /// With regularisation, of `of_mass` over `variance` in each zone.
    mass_by_texture: Vec<[f64; 2]>,
    /// Nodes of one colour are far apart, see [`colours`]; none with regularisation.
    colours: Vec<u32>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct AtNode {
    /// Of `M0^-1`.
    pub texture: f64,
    /// Of `M0^-1 P M0^-1`.
    pub mass: f64,
    /// Whether the noise was more than could be taken off.
    pub at_bound: bool,
}

impl NodalSpread {
    /// Where the matrix is `M - lambda P` for another `lambda`.
    ///
    /// `1 / (M0^-1)_ii` falls evenly with lambda where the texture is even, by `(M0^-1 P M0^-1)_ii / (M0^-1)_ii^2`; the
    /// matrix itself is not made anew for it.
    pub fn at(&self, node: usize, component: usize, lambda: f64) -> AtNode {
        let (texture, mass) = (self.variance[node][component], self.of_mass[node][component]);
        if self.is_regularised || texture <= 0.0 {
            return AtNode { texture, mass, at_bound: false };
        }
        let slope = mass / (texture * texture);
        let with_noise = 1.0 / texture + slope * self.lambda[node];
        let wanted = with_noise - slope * lambda;
        let least = LEAST_SHARE_OF_VARIANCE * with_noise;
        let texture = 1.0 / wanted.max(least);
        AtNode { texture, mass: slope * texture * texture, at_bound: wanted < least }
    }

    /// That of a frame in which elements have lost pixels, for `solver` of what is left, with the `regulariser` of the
    /// level: done anew around them, see [`REDONE_ROWS`]. `None` when a regularisation does not hold what is left.
    pub fn update(
        &self,
        isa: Isa,
        (mesh, moments): (&Mesh<Px>, &[ElementMoments]),
        pattern: &Pattern,
        (solver, regulariser): (&Solver, Option<&Regulariser>),
        changed: &Changed,
    ) -> Option<Self> {
        let further = regulariser.map_or(0, |regulariser| regulariser.reach_rows(mesh.element_size()));
        let redone = pattern.around(&changed.nodes, REDONE_ROWS + further);
        let free = pattern.around(&redone, FREE_ROWS + further);
        let elements = pattern.elements_around(&free);
        let is_changed = |element: u32| changed.elements.binary_search(&element).is_ok();
        let mass = |&element: &u32| match is_changed(element) {
            true => changed.of(element).mass,
            false => mass_matrix(mesh, element as usize, &moments[element as usize]),
        };
        let masses: Vec<ElementMatrix> = elements.par_iter().with_min_len(64).map(mass).collect();
        let mass_of = |element: u32| &masses[elements.binary_search(&element).expect("an element of these nodes")];
        let mut spread = self.clone();
        for &node in &changed.nodes {
            let node = node as usize;
            spread.lambda[node] = mean_lambda(pattern, node, |element| (mass_of(element), changed.of(element).lambda));
        }
        if free.is_empty() {
            return Some(spread); // a solver of its own although nothing is lost
        }
        if let Some(regulariser) = regulariser {
            if !solver.is_held() {
                return None;
            }
            let Spread { variance, freedom } = regulariser.spread_of_part(solver.data(), &free, &redone).ok()?;
            for (at, &node) in redone.iter().enumerate() {
                let node = node as usize;
                let by_texture = self.mass_by_texture[mesh.node_zone()[node] as usize];
                spread.variance[node] = variance[at];
                spread.of_mass[node] = [0, 1].map(|c| variance[at][c] * by_texture[c]);
                spread.freedom[node] = freedom[at];
            }
            return Some(spread);
        }
        let matrix = solver.matrix().part(&free);
        let mut mass = BlockMatrix::assemble_part(pattern, &free, mesh.elements(), mass_of);
        let mut keep = vec![true; free.len()];
        matrix.held().iter().for_each(|&node| keep[node as usize] = false);
        mass.hold(&keep);
        let colours: Vec<u32> = free.iter().map(|&node| self.colours[node as usize]).collect();
        let (variance, of_mass) = inverse_diagonal_of_part(isa, (&matrix, &mass), &colours, &free);
        for &node in &redone {
            let at = free.binary_search(&node).expect("redone nodes are free");
            (spread.variance[node as usize], spread.of_mass[node as usize]) = (variance[at], of_mass[at]);
        }
        Some(spread)
    }
}

/// The spread of a solution with `solver`, whose matrix is that of these elements without their noise.
pub(crate) fn spread_of(
    isa: Isa,
    mesh: &Mesh<Px>,
    solver: &Solver,
    regulariser: Option<&Regulariser>,
    of_elements: &[OfElement],
) -> NodalSpread {
    let pattern = solver.data().pattern().clone();
    let mut mass = BlockMatrix::assemble_by(&pattern, mesh.elements(), |element| &of_elements[element as usize].mass);
    let lambda_of = |element: u32| {
        let OfElement { mass, lambda, .. } = &of_elements[element as usize];
        (mass, *lambda)
    };
    let nodes = (0..mesh.n_nodes()).into_par_iter().with_min_len(2048);
    let lambda = nodes.map(|node| mean_lambda(&pattern, node, lambda_of)).collect();
    // None of the solver of a frame which the regularisation could not hold.
    if let Some(Spread { variance, freedom }) = regulariser.and_then(|regulariser| regulariser.spread(solver)) {
        // P is about M0 over the mean square gradient of the zone; that of a node held by the penalty may be nothing.
        let over_gradient: Vec<[f64; 2]> = (0..mesh.zones().len())
            .map(|zone| {
                let (mut of_mass, mut of_texture) = (0.0, [0.0; 2]);
                for node in mesh.zone_nodes(zone) {
                    let ([xx, _, yy], [p, ..]) = (solver.data().diagonal(node), mass.diagonal(node));
                    of_mass += p;
                    of_texture = [of_texture[0] + xx, of_texture[1] + yy];
                }
                of_texture.map(|of_texture| if of_texture > 0.0 { of_mass / of_texture } else { 0.0 })
            })
            .collect();
        let scaled = |(node, variance): (usize, &[f64; 2])| {
            let [x, y] = over_gradient[mesh.node_zone()[node] as usize];
            [variance[0] * x, variance[1] * y]
        };
        let of_mass = variance.iter().enumerate().map(scaled).collect();
        let (mass_by_texture, colours) = (over_gradient, Vec::new());
        return NodalSpread { variance, of_mass, freedom, lambda, is_regularised: true, mass_by_texture, colours };
    }
    let mut keep = vec![true; mesh.n_nodes()];
    solver.matrix().held().iter().for_each(|&node| keep[node as usize] = false);
    mass.hold(&keep);
    let colours = colours(mesh, &pattern);
    let (variance, of_mass) = inverse_diagonal_with(isa, solver.matrix(), solver.jacobi(), &colours, &mass);
    let (freedom, mass_by_texture) = (vec![2.0; mesh.n_nodes()], Vec::new());
    NodalSpread { variance, of_mass, freedom, lambda, is_regularised: false, mass_by_texture, colours }
}

/// The mean of what was taken off the elements around a node, by share; `of_element`: mass, and what was taken.
fn mean_lambda<'a>(pattern: &Pattern, node: usize, of_element: impl Fn(u32) -> (&'a ElementMatrix, f64)) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for &(element, corner) in pattern.elements_of(node) {
        let (mass, lambda) = of_element(element);
        let own = mass[upper(2 * corner as usize, 2 * corner as usize)];
        sum += own * lambda;
        weight += own;
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// Colours such that nodes of one colour are five steps along mesh lines apart: on a grid thirteen by the
/// perfect code of radius 2, elsewhere the first that is free. The corners of a whole grid, which scatter and
/// so leak the most, have two colours to themselves. (Zones do not touch each other.)
fn colours(mesh: &Mesh<Px>, pattern: &Pattern) -> Vec<u32> {
    let mut colour = Vec::with_capacity(mesh.n_nodes());
    for zone in 0..mesh.zones().len() {
        let nodes = mesh.zone_nodes(zone);
        let Some(grid) = mesh.grid(zone) else {
            colour.extend(pattern.colours(nodes, 5));
            continue;
        };
        colour.extend(mesh.nodes()[nodes.clone()].iter().map(|&x| {
            let [i, j] = grid.column_and_row(x);
            ((i + 5 * j) % 13) as u32
        }));
        if mesh.whole_grid(zone).is_some() && grid.nx + grid.ny >= 5 {
            for (i, j, own) in [(0, 0, 13), (grid.nx, 0, 14), (grid.nx, grid.ny, 13), (0, grid.ny, 14)] {
                colour[grid.node(i, j)] = own;
            }
        }
    }
    colour
}

/// The displacement in the middle of an element with these nodes, px.
pub(crate) fn displacement_in_middle(nodes: [u32; 4], displacement: &[[f64; 2]]) -> [f64; 2] {
    let middle = shape_functions(0.5, 0.5);
    [0, 1].map(|c| nodes.iter().zip(middle).map(|(&node, psi)| psi * displacement[node as usize][c]).sum())
}

/// Noise that the interpolation lets through, tabulated over the sub-pixel offset.
pub(crate) struct NoiseGain {
    deformed: [f64; 65],
    /// Of the product with the noise of the gradient.
    product: [f64; 65],
    /// `G`.
    pub gradient: f64,
    /// Noise variance of the reference in that of one image.
    pub of_reference: f64,
}

/// What of the noise of the deformed image is in a zone of one frame, in the grey levels of the reference: THEORY 10
/// with the factor of the transfer, `var(r) = sigma^2 (1/k + gain^2 v)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ZoneGain {
    /// Noise variance of the residual, by that of one image.
    pub residual: f64,
    /// Of the reference: `1/k`.
    reference: f64,
    /// Of the deformed image against a smooth gradient: `gain^2`, since texture is smooth for the interpolation.
    deformed: f64,
    /// Of the deformed image against the noise of the gradient, per component: `gain^2 v_D`.
    product: [f64; 2],
    /// `G / k`.
    gradient: f64,
}

impl ZoneGain {
    /// What noise of `noise` grey levels adds to the mean square of each component of the gradient.
    pub fn lambda(&self, noise: f64) -> f64 {
        noise * noise * self.gradient
    }

    /// Variance of a component of a node's displacement, px^2, for `noise` grey levels in one image:
    /// `sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v_D lambda M0^-1 P M0^-1]`; noise of the reference against its own
    /// gradient cancels.
    pub fn variance(&self, noise: f64, at: AtNode, component: usize) -> f64 {
        let of_gradient = self.product[component] * self.lambda(noise);
        noise * noise * ((self.reference + self.deformed) * at.texture + of_gradient * at.mass)
    }
}

impl NoiseGain {
    pub fn new(interpolation: Interpolation, n_references: usize) -> Self {
        let table = |of: &dyn Fn(f64) -> f64| std::array::from_fn(|k| of(k as f64 / 64.0));
        Self {
            deformed: table(&|t| interpolation.noise_gain(t)),
            product: table(&|t| interpolation.gradient_noise_passed(t)),
            gradient: interpolation.gradient_noise_gain(),
            of_reference: 1.0 / n_references.max(1) as f64,
        }
    }

    /// Share of the noise variance of the deformed image that its interpolation lets through in an element.
    pub fn in_element(&self, mesh: &Mesh<Px>, element: usize, displacement: &[[f64; 2]]) -> f64 {
        let u = displacement_in_middle(mesh.elements()[element], displacement);
        Self::at(&self.deformed, u[0]) * Self::at(&self.deformed, u[1])
    }

    fn at(table: &[f64; 65], u: f64) -> f64 {
        let t = 64.0 * (u - u.floor());
        let k = (t as usize).min(63);
        table[k] + (t - k as f64) * (table[k + 1] - table[k])
    }

    /// Variance of the residual at a displacement `u` for noise of one grey level in one image.
    pub fn of_pair(&self, u: [f64; 2], transfer: GreyTransfer) -> f64 {
        let [vx, vy] = u.map(|u| Self::at(&self.deformed, u));
        self.of_reference + transfer.gain.powi(2) * vx * vy
    }

    /// Variance of the interpolated noise in the middle of each element, in that of one image.
    pub fn variances(&self, mesh: &Mesh<Px>, displacement: &[[f64; 2]]) -> Vec<f64> {
        (0..mesh.n_elements()).map(|element| self.in_element(mesh, element, displacement)).collect()
    }

    pub fn at_rest(&self) -> ZoneGain {
        ZoneGain {
            residual: self.of_reference + 1.0,
            reference: self.of_reference,
            deformed: 1.0,
            product: [1.0; 2],
            gradient: self.gradient * self.of_reference,
        }
    }

    /// For a zone of a frame, the mean over its elements; `fitted` are the sums that the transfer was fitted to.
    pub fn of_zone(
        &self,
        mesh: &Mesh<Px>,
        zone: usize,
        displacement: &[[f64; 2]],
        transfer: GreyTransfer,
        fitted: Option<&PixelSums>,
    ) -> ZoneGain {
        let elements = mesh.zone_elements(zone);
        let n_elements = (elements.len() as f64).max(1.0);
        let (mut residual, mut product) = (0.0, [0.0; 2]);
        for &nodes in &mesh.elements()[elements] {
            // Where a frame has diverged a displacement may be no number.
            let u = displacement_in_middle(nodes, displacement).map(|u| if u.is_finite() { u } else { 0.0 });
            let [vx, vy] = u.map(|u| Self::at(&self.deformed, u));
            let [px, py] = u.map(|u| Self::at(&self.product, u));
            residual += vx * vy;
            product[0] += px * vy;
            product[1] += vx * py;
        }
        let used = transfer.gain * transfer.gain;
        // The gain in use supposes that both images are noisy alike; what it is off by scales the derivative.
        let ratio = self.of_reference * n_elements / residual.max(f64::MIN_POSITIVE);
        let known = fitted.and_then(|sums| sums.transfer_for(ratio)).map_or(used, |known| known.gain * known.gain);
        let off = if used > 0.0 { known / used } else { 1.0 };
        ZoneGain {
            residual: self.of_reference + used * residual / n_elements,
            reference: self.of_reference * off,
            deformed: known,
            product: product.map(|sum| known * sum / n_elements),
            gradient: self.gradient * self.of_reference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::KernelOptions;
    use crate::correlate::prepare::gradient_noise::{OfElement, without_noise};
    use crate::correlate::prepare::level::support;
    use crate::correlate::prior::regularisation::{PenaltyScale, Regularisation};
    use crate::field::Brightness;
    use crate::mesh::{PixelMesh, Roi, Zone};
    use std::sync::Arc;

    const ELEMENT: usize = 8;

    /// Moments of an element of noise, of which the columns from `first` on are left.
    fn moments(element: usize, first: usize) -> ElementMoments {
        let noise = |k: usize| f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 32768.0 - 1.0;
        let mut moments = ElementMoments::default();
        for (x, y) in (0..ELEMENT).flat_map(|y| (first..ELEMENT).map(move |x| (x, y))) {
            let pixel = (element * ELEMENT + y) * ELEMENT + x;
            let (fx, fy) = (noise(2 * pixel + 1), noise(2 * pixel + 2));
            let products = |k: usize| {
                let s = (k as f64 + 0.5) / ELEMENT as f64;
                [(1.0 - s) * (1.0 - s), s * (1.0 - s), s * s]
            };
            for (p, value) in [fx * fx, fx * fy, fy * fy].into_iter().enumerate() {
                for q in 0..3 {
                    for w in 0..3 {
                        moments.gradient[p][q][w] += value * products(y)[q] * products(x)[w];
                    }
                }
            }
            moments.n += 1.0;
        }
        moments
    }

    /// Largest relative differences, near elements that have lost `columns` columns of pixels at the left border, from
    /// all nodes done anew: of standard deviations by texture and by noise of the gradient, and of the freedom.
    fn differences(columns: usize, regularisation: Regularisation) -> [f64; 3] {
        let size = 20 * ELEMENT;
        let roi = Roi { x0: 0.0, y0: 0.0, x1: size as f64, y1: size as f64 };
        let laid = PixelMesh::on_zones(&[Zone::rectangle("all", roi)], ELEMENT, 0.5, [size; 2]).unwrap();
        let mesh = &laid.mesh;
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        let options = KernelOptions::new((0.0, 255.0), Interpolation::Cubic, Brightness::Zone);
        let (isa, lambda) = (Isa::detect(), 0.05 / 3.0);
        let all: Vec<ElementMoments> = (0..mesh.n_elements()).map(|element| moments(element, 0)).collect();
        let left_of = |element: usize| {
            let out = columns.saturating_sub(mesh.corners(element)[0][0] as usize).min(ELEMENT);
            (out > 0).then(|| if out > ELEMENT / 2 { ElementMoments::default() } else { moments(element, out) })
        };
        let lost: Vec<_> = (0..all.len()).filter_map(|element| Some((element, left_of(element)?))).collect();
        assert_eq!(lost.len(), 20 * columns.div_ceil(ELEMENT));
        let changed = Changed::new((mesh, &pattern), &all, &lost, lambda, &options);
        let nothing = Changed::new((mesh, &pattern), &all, &[], lambda, &options);
        let (support, seen, active) = (support(&pattern, &all), vec![true; mesh.n_nodes()], vec![true; all.len()]);
        let matrices: Vec<ElementMatrix> = all.iter().map(|moments| moments.matrix()).collect();
        let matrix = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
        let scale = PenaltyScale { matrix: &matrix, support: &support, seen: &seen };
        let regulariser = Regulariser::new(regularisation, mesh, &pattern, &active, &scale, true);
        let with_penalty = |data: BlockMatrix| match &regulariser {
            Some(regulariser) => regulariser.solver(data).unwrap(),
            None => Solver::iterative(data),
        };
        let spread_with = |changed: &Changed| {
            let of: Vec<OfElement> = (0..all.len())
                .map(|element| match changed.elements.binary_search(&(element as u32)) {
                    Ok(_) => *changed.of(element as u32),
                    Err(_) => OfElement::new(mesh, element, &all[element], &options, lambda),
                })
                .collect();
            let solver = with_penalty(without_noise(mesh, &pattern, &of));
            let spread = spread_of(isa, mesh, &solver, regulariser.as_ref(), &of);
            (solver, spread)
        };
        let (level, before) = spread_with(&nothing);
        let mut data = level.data().clone();
        data.assemble_rows(&changed.nodes, mesh.elements(), |element| &changed.of(element).matrix);
        let (whole, want) = spread_with(&changed);
        assert_eq!(data.blocks(), whole.data().blocks(), "rows made anew are those of the whole matrix");
        let (own, moments) = (with_penalty(data), (&**mesh, &*all));
        let got = before.update(isa, moments, &pattern, (&own, regulariser.as_ref()), &changed).unwrap();
        let mut worst = [0.0f64; 3];
        for node in 0..mesh.n_nodes() {
            assert_eq!(got.lambda[node], want.lambda[node], "node {node}");
            let want_variance = want.variance[node];
            let pairs = [(got.variance[node], want_variance), (got.of_mass[node], want.of_mass[node])];
            for (worst, (got, want)) in worst.iter_mut().zip(pairs) {
                (0..2).for_each(|c| assert_eq!(got[c] > 0.0, want[c] > 0.0, "node {node}"));
                // A node of which nothing is left has nothing but what leaks to its neighbours.
                let off = |c: usize| if want_variance[c] > 0.0 { ((got[c] / want[c]).sqrt() - 1.0).abs() } else { 0.0 };
                *worst = worst.max(off(0)).max(off(1));
            }
            worst[2] = worst[2].max(0.5 * (got.freedom[node] - want.freedom[node]).abs());
        }
        worst
    }

    #[test]
    fn uncertainties_done_anew_near_lost_elements_are_those_of_all_nodes_done_anew() {
        let cutoff_px = 3.0 * ELEMENT as f64;
        let (tikhonov, gap) =
            (Regularisation::Tikhonov { cutoff_px }, Regularisation::EquilibriumGap { cutoff_px, poisson: 0.33 });
        // Half an element, three whole ones, an element and a quarter; a texture so uneven that what happens at a node
        // falls by 0.4 per row: by 0.4^6 = 0.4 % in a variance where nodes are held. Both are probed with the same
        // signs.
        let probed = [0.015, 0.05, f64::MIN_POSITIVE];
        // Selected inverses are exact: what is left is what is not done anew, where nodes are held, and the gradient's
        // noise by the texture of the zone, with or without the pixels lost.
        let selected = [1e-3, 1e-2, 1e-3];
        let none = Regularisation::None;
        for (regularisation, n, limits) in [(none, 3, probed), (tikhonov, 2, selected), (gap, 2, selected)] {
            for columns in [ELEMENT / 2, 3 * ELEMENT, ELEMENT + 2].into_iter().take(n) {
                let found = differences(columns, regularisation);
                let right = found.iter().zip(limits).all(|(found, limit)| *found < limit);
                assert!(right, "{regularisation:?}, {columns} columns: {found:?}");
            }
        }
    }
}
