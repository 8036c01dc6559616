//! The weights of the objective: `omega = r^T W r` over all instants and rows.

use crate::identify::{Noise, Precision};
use crate::linalg::{Dense, DenseCholesky, NotPositiveDefinite};
use rayon::prelude::*;

/// The weights `W`, symmetric.
#[derive(Debug)]
pub enum Weights {
    /// A weight for each row of each instant.
    Diagonal(Vec<Vec<f64>>),
    /// The inverse covariance, with the unknown true boundary eliminated.
    Inverse(InverseCovariance),
}

/// `W = P - P T (T^T P T)^-1 T^T P` of THEORY 7 for `P = (I + common 1 1^T)^-1 (x) M` and `T` the derivatives of all
/// rows by the prescribed displacements of each instant, without forming it.
///
/// The noise of the common reference is one more unknown field `e` with its own precision `M/common`: given it the
/// instants (which a force, in its row, has no part of) are independent, with weights `D_i = M - Q_i Q_i^T`, `Q_i = M
/// T_i L_i^-T`, `L_i L_i^T = T_i^T M T_i`; then `W = D - D 1 G^-1 1^T D`, `G = M/common + sum D_i`.
#[derive(Debug)]
pub struct InverseCovariance {
    /// `1/sigma^2`, or 1 while sigma is not known.
    factor: f64,
    common: f64,
    /// `Q_i`; empty where the prescribed displacements have no noise.
    q: Vec<Dense>,
    /// `T_i` and the factor of `T_i^T M T_i`.
    boundary: Vec<(Dense, DenseCholesky)>,
    /// The factor of `G`, where instants are tied and the boundary is noisy.
    g: Option<DenseCholesky>,
}

impl InverseCovariance {
    /// The weights for `noise` over `n_instants`; `by_boundary[i]` is `T_i`, empty where the boundary has no noise.
    ///
    /// # Errors
    /// A matrix without inverse.
    pub fn new(noise: &Noise, n_instants: usize, by_boundary: Vec<Dense>) -> Result<Self, NotPositiveDefinite> {
        let m = &noise.precision;
        let part = |t: Dense| {
            let mt = m.times(&t);
            let factor = t.transposed_times(&mt).cholesky()?;
            Ok((factor.half_solve_right(&mt), (t, factor)))
        };
        let parts: Vec<(Dense, (Dense, DenseCholesky))> =
            by_boundary.into_par_iter().map(part).collect::<Result<_, NotPositiveDefinite>>()?;
        let (q, boundary): (Vec<Dense>, Vec<_>) = parts.into_iter().unzip();
        let g = if noise.common > 0.0 && !q.is_empty() {
            let dense = m.dense();
            // Four sums of their own, whatever the number of threads: the same bits.
            let parts: Vec<Dense> = (q.par_chunks(q.len().div_ceil(4)))
                .map(|q| {
                    let mut sum = Dense::zeros(dense.n_rows(), dense.n_rows());
                    q.iter().for_each(|q| sum.add_square_below(-1.0, q));
                    sum
                })
                .collect();
            let mut g = Dense::zeros(dense.n_rows(), dense.n_rows());
            g.add(n_instants as f64 + 1.0 / noise.common, &dense);
            parts.iter().for_each(|part| g.add(1.0, part));
            if let Precision::WithForce { .. } = m {
                let last = g.n_rows() - 1;
                for k in 0..last {
                    g[(k, last)] = 0.0;
                    g[(last, k)] = 0.0;
                }
                g[(last, last)] = 1.0;
            }
            Some(g.cholesky()?)
        } else {
            None
        };
        let factor = noise.sigma.map_or(1.0, |sigma| 1.0 / (sigma * sigma));
        Ok(Self { factor, common: noise.common, q, boundary, g })
    }

    /// `D_i x_i` and the sum over the instants, without `1/sigma^2`.
    fn by_instant(&self, precision: &Precision, x: &[Dense]) -> (Vec<Dense>, Dense) {
        let weighted = |(i, x): (usize, &Dense)| {
            let mut y = precision.times(x);
            if let Some(q) = self.q.get(i) {
                let part = q.times(&q.transposed_times(x));
                y.add(-1.0, &part);
            }
            y
        };
        let y: Vec<Dense> = x.par_iter().enumerate().map(weighted).collect();
        let mut sum = Dense::zeros(x[0].n_rows(), x[0].n_columns());
        y.iter().for_each(|y| sum.add(1.0, y));
        precision.leave_force_out(&mut sum);
        (y, sum)
    }

    /// What the prescribed displacements have to be corrected by, instant by instant, for residuals `x` (one column).
    ///
    /// # Panics
    /// When the boundary has no noise.
    pub fn boundary_corrections(&self, precision: &Precision, x: &[Dense]) -> Vec<Vec<f64>> {
        let common = self.g.as_ref().map(|g| g.solve(&self.by_instant(precision, x).1));
        let correction = |(i, (t, factor)): (usize, &(Dense, DenseCholesky))| {
            let mut rest = x[i].clone();
            if let Some(common) = &common {
                rest.add(-1.0, common);
            }
            factor.solve(&t.transposed_times(&precision.times(&rest))).column(0).to_vec()
        };
        self.boundary.par_iter().enumerate().map(correction).collect()
    }

    fn times(&self, precision: &Precision, x: &[Dense]) -> Vec<Dense> {
        let (mut y, sum) = self.by_instant(precision, x);
        match (&self.g, self.common > 0.0) {
            (Some(g), _) => {
                let z = g.solve(&sum);
                let zs: Vec<Dense> = vec![z; y.len()];
                let (dz, _) = self.by_instant(precision, &zs);
                y.iter_mut().zip(&dz).for_each(|(y, dz)| y.add(-1.0, dz));
            }
            (None, true) => {
                let share = -1.0 / (y.len() as f64 + 1.0 / self.common);
                y.iter_mut().for_each(|y| y.add(share, &sum));
            }
            (None, false) => {}
        }
        y.iter_mut().for_each(|y| scale(y, self.factor));
        y
    }
}

impl Weights {
    /// `W x` for blocks of columns, one block for each instant.
    pub fn times(&self, noise: &Noise, x: &[Dense]) -> Vec<Dense> {
        match self {
            Self::Diagonal(weights) => {
                let weighted = |(x, weights): (&Dense, &Vec<f64>)| {
                    Dense::from_fn(x.n_rows(), x.n_columns(), |r, c| weights[r] * x[(r, c)])
                };
                x.iter().zip(weights).map(weighted).collect()
            }
            Self::Inverse(inverse) => inverse.times(&noise.precision, x),
        }
    }
}

/// Multiplies all entries.
pub(crate) fn scale(matrix: &mut Dense, factor: f64) {
    for k in 0..matrix.n_columns() {
        matrix.column_mut(k).iter_mut().for_each(|v| *v *= factor);
    }
}
