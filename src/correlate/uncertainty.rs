//! Standard uncertainty of the nodal displacements (THEORY 2 and 10), for noise that need not be small:
//! `Cov(a) = sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v lambda M0^-1 P M0^-1]`, with regularisation `A^-1 . A^-1` around
//! `M0` and `P`, `A = M0 + w R`.

use super::gradient_noise::LEAST_SHARE_OF_VARIANCE;
use super::regularisation::Regulariser;
use crate::backend::{GreyTransfer, PixelSums};
use crate::imaging::Interpolation;
use crate::isa::Isa;
use crate::linalg::{BlockMatrix, ElementMatrix, Pattern, Solver, Spread, inverse_diagonal_with, upper};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;

/// A residual that says less than the first of these times the stated noise, or more than the second, contradicts it.
/// Misfit only adds to the residual, so that less is the plainer of the two; a quarter more is more than interpolation
/// and 8 bit rounding make of any noise that matters.
pub const NOISE_CONTRADICTED: [f64; 2] = [0.8, 1.25];

/// What the noise of the images does to every node, and what the nodes take from the residual (THEORY 10).
#[derive(Debug)]
pub(super) struct NodalSpread {
    /// Diagonal of `M0^-1`, with regularisation of `A^-1 M0 A^-1`, per node.
    variance: Vec<[f64; 2]>,
    /// Diagonal of `M0^-1 P M0^-1`, with regularisation of `A^-1 P A^-1`.
    of_mass: Vec<[f64; 2]>,
    /// Degrees of freedom that each node takes from the residual.
    pub freedom: Vec<f64>,
    /// What was taken off the matrix: `M0 = M - lambda P`, the mean over the elements of each node.
    lambda: Vec<f64>,
    is_regularised: bool,
}

/// Variances at one node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AtNode {
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

    /// As made: for the noise that the steps suppose.
    pub fn variance(&self) -> &[[f64; 2]] {
        &self.variance
    }
}

/// The spread of a solution with `solver`, whose matrix is that of `moments` without the noise `lambda` (per element).
pub(super) fn spread_of(
    isa: Isa,
    mesh: &Mesh<Px>,
    solver: &Solver,
    regulariser: Option<&Regulariser>,
    masses: &[ElementMatrix],
    lambda: &[f64],
) -> NodalSpread {
    let pattern = solver.data().pattern().clone();
    let mut mass = BlockMatrix::assemble(&pattern, mesh.elements(), masses);
    let lambda = nodal_lambda(mesh, &pattern, masses, lambda);
    // A solver without penalty is that of a frame which the regularisation could not hold.
    if let (Some(regulariser), Some(_)) = (regulariser, solver.penalty())
        && let Ok(Spread { variance, freedom }) = regulariser.spread(solver.data())
    {
        // P is about M0 over the mean square gradient of the zone; that of a node which the penalty holds may be nothing.
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
        return NodalSpread { variance, of_mass, freedom, lambda, is_regularised: true };
    }
    let held: Vec<bool> = {
        let mut keep = vec![true; mesh.n_nodes()];
        solver.matrix().held().iter().for_each(|&node| keep[node as usize] = false);
        keep
    };
    mass.hold(&held);
    let colours = colours(mesh, &pattern);
    let (variance, of_mass) = inverse_diagonal_with(isa, solver.matrix(), solver.jacobi(), &colours, &mass);
    NodalSpread { variance, of_mass, freedom: vec![2.0; mesh.n_nodes()], lambda, is_regularised: false }
}

/// The mean of what was taken off the elements around each node, by their share of it.
fn nodal_lambda(mesh: &Mesh<Px>, pattern: &Pattern, masses: &[ElementMatrix], lambda: &[f64]) -> Vec<f64> {
    (0..mesh.n_nodes())
        .map(|node| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for &(element, corner) in pattern.elements_of(node) {
                let own = masses[element as usize][upper(2 * corner as usize, 2 * corner as usize)];
                sum += own * lambda[element as usize];
                weight += own;
            }
            if weight > 0.0 { sum / weight } else { 0.0 }
        })
        .collect()
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

/// Noise that the interpolation lets through, tabulated over the sub-pixel offset.
#[derive(Debug)]
pub(super) struct NoiseGain {
    deformed: [f64; 65],
    /// Of the product with the noise of the gradient.
    product: [f64; 65],
    /// `G`.
    gradient: f64,
    /// Noise variance of the reference in that of one image.
    reference: f64,
}

/// What of the noise of the deformed image is in a zone of one frame, in the grey levels of the reference: THEORY 10 with
/// the factor of the transfer, `var(r) = sigma^2 (1/k + gain^2 v)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct ZoneGain {
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

    /// Variance of a component of the displacement of a node, px^2, for `noise` grey levels in one image:
    /// `sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v_D lambda M0^-1 P M0^-1]`. The noise of the reference against that of its
    /// own gradient cancels.
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
            reference: 1.0 / n_references.max(1) as f64,
        }
    }

    /// Noise variance of the reference in that of one image.
    pub fn of_reference(&self) -> f64 {
        self.reference
    }

    /// Share of the noise variance of the deformed image that its interpolation lets through in an element.
    pub fn in_element(&self, mesh: &Mesh<Px>, element: usize, displacement: &[[f64; 2]]) -> f64 {
        let middle = shape_functions(0.5, 0.5);
        let nodes = mesh.elements()[element].iter().zip(middle);
        let u: [f64; 2] =
            std::array::from_fn(|c| nodes.clone().map(|(&node, psi)| psi * displacement[node as usize][c]).sum());
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
        self.reference + transfer.gain.powi(2) * vx * vy
    }

    /// Variance of the interpolated noise in the middle of each element of a zone, in that of one image.
    pub fn variances(&self, mesh: &Mesh<Px>, zone: usize, displacement: &[[f64; 2]]) -> Vec<f64> {
        mesh.zone_elements(zone).map(|element| self.in_element(mesh, element, displacement)).collect()
    }

    /// For a deformed image as it is, at whole pixels.
    pub fn at_rest(&self) -> ZoneGain {
        ZoneGain {
            residual: self.reference + 1.0,
            reference: self.reference,
            deformed: 1.0,
            product: [1.0; 2],
            gradient: self.gradient * self.reference,
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
        let middle = shape_functions(0.5, 0.5);
        let (mut residual, mut product) = (0.0, [0.0; 2]);
        for nodes in &mesh.elements()[elements] {
            let u: [f64; 2] = std::array::from_fn(|c| {
                nodes.iter().zip(middle).map(|(&node, psi)| psi * displacement[node as usize][c]).sum()
            });
            // Where a frame has diverged a displacement may be no number.
            let u = u.map(|u| if u.is_finite() { u } else { 0.0 });
            let [vx, vy] = u.map(|u| Self::at(&self.deformed, u));
            let [px, py] = u.map(|u| Self::at(&self.product, u));
            residual += vx * vy;
            product[0] += px * vy;
            product[1] += vx * py;
        }
        let used = transfer.gain * transfer.gain;
        // The gain in use supposes that both images are noisy alike; what it is off by scales the residual's derivative.
        let ratio = self.reference * n_elements / residual.max(f64::MIN_POSITIVE);
        let known = fitted.and_then(|sums| sums.transfer_for(ratio)).map_or(used, |known| known.gain * known.gain);
        let off = if used > 0.0 { known / used } else { 1.0 };
        ZoneGain {
            residual: self.reference + used * residual / n_elements,
            reference: self.reference * off,
            deformed: known,
            product: product.map(|sum| known * sum / n_elements),
            gradient: self.gradient * self.reference,
        }
    }

    /// Standard deviation of the noise of one image from the residual of one zone, grey levels: the residual holds the
    /// noise of f and the interpolated (filtered) noise of g; each node and the transfer take degrees of freedom.
    pub fn noise_of_residual(gain: &ZoneGain, sums: &PixelSums, unknowns: f64) -> f64 {
        let freedom = (sums.n - unknowns).max(1.0);
        (sums.rr / freedom / gain.residual).max(0.0).sqrt()
    }
}
