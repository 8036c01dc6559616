//! Standard uncertainty of the nodal displacements (THEORY 2): `Cov(a) = 2 sigma^2 M^-1`, with regularisation
//! `2 sigma^2 A^-1 M A^-1`, `A = M + w R`.

use super::regularisation::Regulariser;
use crate::backend::{GreyTransfer, PixelSums};
use crate::imaging::Interpolation;
use crate::isa::Isa;
use crate::linalg::{Pattern, Solver, Spread, inverse_diagonal};
use crate::mesh::{Mesh, shape_functions};
use crate::units::Px;

/// Diagonal of `M^-1`, or with regularisation of `A^-1 M A^-1`, per node, and the degrees of freedom that each
/// takes.
pub(super) fn spread_of(isa: Isa, mesh: &Mesh<Px>, solver: &Solver, regulariser: Option<&Regulariser>) -> Spread {
    // A solver without penalty is that of a frame which the regularisation could not hold.
    if let (Some(regulariser), Some(_)) = (regulariser, solver.penalty())
        && let Ok(spread) = regulariser.spread(solver.data())
    {
        return spread;
    }
    let variance = inverse_diagonal(isa, solver.matrix(), solver.jacobi(), &colours(mesh, solver.matrix().pattern()));
    Spread { variance, freedom: vec![2.0; mesh.n_nodes()] }
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

/// Variance gain of the interpolation, tabulated over the sub-pixel offset.
#[derive(Debug)]
pub(super) struct NoiseGain {
    deformed: [f64; 65],
    /// Noise variance of the reference in that of one image.
    reference: f64,
}

impl NoiseGain {
    pub fn new(interpolation: Interpolation, n_references: usize) -> Self {
        let deformed = std::array::from_fn(|k| interpolation.noise_gain(k as f64 / 64.0));
        Self { deformed, reference: 1.0 / n_references.max(1) as f64 }
    }

    fn at(&self, u: f64) -> f64 {
        let t = 64.0 * (u - u.floor());
        let k = (t as usize).min(63);
        self.deformed[k] + (t - k as f64) * (self.deformed[k + 1] - self.deformed[k])
    }

    /// Variance of the residual at a displacement `u` for noise of one grey level in one image.
    pub fn of_pair(&self, u: [f64; 2], transfer: GreyTransfer) -> f64 {
        self.reference + transfer.gain.powi(2) * self.at(u[0]) * self.at(u[1])
    }

    /// Standard deviation of the noise of one image from the residual of one zone, grey levels: the
    /// residual holds the noise of f and the interpolated (filtered) noise of g,
    /// `var(r) = sigma^2 (1/k + gain^2 v_x v_y)` with the mean of k references; each node and the transfer take degrees of freedom.
    pub fn noise_of_residual(
        &self,
        mesh: &Mesh<Px>,
        zone: usize,
        displacement: &[[f64; 2]],
        sums: &PixelSums,
        transfer: GreyTransfer,
        unknowns: f64,
    ) -> f64 {
        let mut gain = 0.0;
        let elements = mesh.zone_elements(zone);
        let n_elements = elements.len() as f64;
        let middle = shape_functions(0.5, 0.5);
        for nodes in &mesh.elements()[elements] {
            let u: [f64; 2] = std::array::from_fn(|c| {
                nodes.iter().zip(middle).map(|(&node, psi)| psi * displacement[node as usize][c]).sum()
            });
            gain += self.at(u[0]) * self.at(u[1]);
        }
        let freedom = (sums.n - unknowns).max(1.0);
        (sums.rr / freedom / (self.reference + transfer.gain.powi(2) * gain / n_elements)).max(0.0).sqrt()
    }
}
