//! The noise of measured displacements, in space and time (THEORY 7).

use crate::io::joint::RunMatrix;
use crate::linalg::{
    BlockMatrix, Cholesky, Dense, ElementMatrix, NotPositiveDefinite, Pattern, alike, dissection, selected_inverse,
};
use crate::mesh::ElementGeometry;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Precision `M` of the displacements of some nodes at one instant, up to the factor that the noise gives:
/// `Cov = sigma^2 M^-1`. Rows go node by node, x then y.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum Precision {
    /// Every component on its own.
    White(usize),
    /// The normal matrix of a correlation, all its nodes.
    Sparse {
        /// `M`.
        matrix: BlockMatrix,
        /// Its factor.
        factor: Cholesky,
        /// The order in which its nodes are eliminated.
        order: Vec<usize>,
    },
    /// Of a selection of nodes: the inverse of their part of `M^-1`, never a block of `M`.
    Marginal {
        /// `(M^-1)_oo`.
        covariance: Dense,
        /// Its inverse.
        matrix: Dense,
    },
    /// Of displacements and, in one more row, a force whose noise has nothing in common with theirs, nor with another
    /// instant's.
    WithForce {
        /// That of the displacements.
        displacements: Box<Precision>,
        /// `sigma^2` over the variance of the force.
        weight: f64,
    },
}

impl Precision {
    /// That of the nodes `kept` of a correlation; the others are marginalised.
    ///
    /// # Errors
    /// A matrix that is not positive definite: a node without texture.
    pub fn of_matrix(
        positions: &[[f64; 2]],
        elements: &[[u32; 4]],
        matrices: &[ElementMatrix],
        kept: &[u32],
    ) -> Result<Self, NotPositiveDefinite> {
        let pattern = Arc::new(Pattern::new(positions.len(), elements));
        let mut matrix = BlockMatrix::assemble(&pattern, elements, matrices);
        // Nodes that no pixel speaks of are not measured: they take part in nothing.
        let seen: Vec<bool> = (0..positions.len()).map(|node| matrix.diagonal(node)[0] > 0.0).collect();
        matrix.hold(&seen);
        let order = dissection(&pattern, positions, 0..positions.len());
        let factor = Cholesky::new(&matrix, &order)?;
        if kept.len() == positions.len() && (0..).zip(kept).all(|(k, &node)| k == node) {
            return Ok(Self::Sparse { matrix, factor, order });
        }
        let mut covariance = Dense::zeros(2 * kept.len(), 2 * kept.len());
        for (k, &node) in kept.iter().enumerate() {
            for c in 0..2 {
                let mut column = vec![[0.0; 2]; positions.len()];
                column[node as usize][c] = 1.0;
                factor.solve(&mut column);
                for (j, &other) in kept.iter().enumerate() {
                    for d in 0..2 {
                        covariance[(2 * j + d, 2 * k + c)] = column[other as usize][d];
                    }
                }
            }
        }
        let matrix = covariance.cholesky()?.inverse();
        Ok(Self::Marginal { covariance, matrix })
    }

    /// Number of rows.
    pub fn n(&self) -> usize {
        match self {
            Self::White(n) => *n,
            Self::Sparse { matrix, .. } => 2 * matrix.pattern().n_nodes(),
            Self::Marginal { matrix, .. } => matrix.n_rows(),
            Self::WithForce { displacements, .. } => displacements.n() + 1,
        }
    }

    /// That of the displacements.
    pub fn of_displacements(&self) -> &Self {
        match self {
            Self::WithForce { displacements, .. } => displacements,
            other => other,
        }
    }

    /// Takes the row of the force out of `x`: what the instants have in common is the noise of displacements alone.
    pub(crate) fn leave_force_out(&self, x: &mut Dense) {
        if let Self::WithForce { displacements, .. } = self {
            let row = displacements.n();
            (0..x.n_columns()).for_each(|k| x[(row, k)] = 0.0);
        }
    }

    /// `M x`, column by column.
    pub fn times(&self, x: &Dense) -> Dense {
        match self {
            Self::White(_) => x.clone(),
            Self::Sparse { matrix, .. } => each_column(x, |column| matrix.multiply(&column)),
            Self::Marginal { matrix, .. } => matrix.times(x),
            Self::WithForce { displacements, weight } => with_last(x, |above| displacements.times(above), *weight),
        }
    }

    /// `M^-1 x`, column by column.
    pub fn inverse_times(&self, x: &Dense) -> Dense {
        match self {
            Self::White(_) => x.clone(),
            Self::Sparse { factor, .. } => each_column(x, |mut column| {
                factor.solve(&mut column);
                column
            }),
            Self::Marginal { covariance, .. } => covariance.times(x),
            Self::WithForce { displacements, weight } => {
                with_last(x, |above| displacements.inverse_times(above), 1.0 / weight)
            }
        }
    }

    /// Columns of covariance `M^-1` from columns of independent numbers of variance 1.
    fn colour(&self, x: &Dense) -> Option<Dense> {
        Some(match self {
            Self::White(_) => x.clone(),
            Self::Sparse { .. } => self.inverse_times(&self.dense().cholesky().ok()?.half_times(x)),
            Self::Marginal { covariance, .. } => covariance.cholesky().ok()?.half_times(x),
            Self::WithForce { displacements, weight } => {
                let above = displacements.colour(&without_last(x))?;
                with_last(x, |_| above.clone(), 1.0 / weight.sqrt())
            }
        })
    }

    /// `M`, dense.
    pub fn dense(&self) -> Dense {
        let n = self.n();
        match self {
            Self::Marginal { matrix, .. } => matrix.clone(),
            _ => self.times(&Dense::from_fn(n, n, |r, c| f64::from(r == c))),
        }
    }
}

/// `x` without its last row.
fn without_last(x: &Dense) -> Dense {
    Dense::from_fn(x.n_rows() - 1, x.n_columns(), |r, c| x[(r, c)])
}

/// What `map` makes of all rows but the last, and that times `factor`.
fn with_last(x: &Dense, map: impl FnOnce(&Dense) -> Dense, factor: f64) -> Dense {
    let last = x.n_rows() - 1;
    let above = map(&without_last(x));
    Dense::from_fn(x.n_rows(), x.n_columns(), |r, c| if r == last { factor * x[(r, c)] } else { above[(r, c)] })
}

fn each_column(x: &Dense, map: impl Fn(Vec<[f64; 2]>) -> Vec<[f64; 2]>) -> Dense {
    let mut result = Dense::zeros(x.n_rows(), x.n_columns());
    for k in 0..x.n_columns() {
        let (pairs, _) = x.column(k).as_chunks::<2>();
        result.column_mut(k).copy_from_slice(map(pairs.to_vec()).as_flattened());
    }
    result
}

/// The noise: `Cov = sigma^2 (I + common 1 1^T) (x) M^-1` over instants and components.
#[derive(Debug)]
pub struct Noise {
    /// `M`.
    pub precision: Precision,
    /// What all instants have in common, by the variance of one: 1 for one reference image, 1/k for the mean of k, 0
    /// for instants that are independent.
    pub common: f64,
    /// Whether the prescribed displacements carry it too; their components then are among the rows.
    pub on_boundary: bool,
    /// `sigma`; `None` when the residual has to tell it.
    pub sigma: Option<f64>,
    /// Where it comes from, in words.
    pub source: String,
    /// Noise that the residual of the images shows over the noise that the uncertainties of the displacements were
    /// made with; `None` where these are not told apart.
    pub ratio: Option<f64>,
}

impl Noise {
    /// The variance of one displacement of one instant in the mean, by `sigma^2`; zero where there are none.
    pub fn mean_variance(&self) -> f64 {
        let variances = self.variances();
        variances.iter().sum::<f64>() / variances.len().max(1) as f64
    }

    /// The variance of each displacement of one instant, by `sigma^2`.
    pub(crate) fn variances(&self) -> Vec<f64> {
        let precision = self.precision.of_displacements();
        let n = precision.n();
        let of_one: Vec<f64> = match precision {
            Precision::WithForce { .. } => Vec::new(), // a force beside a force: never made
            Precision::White(n) => vec![1.0; *n],
            Precision::Marginal { covariance, .. } => (0..n).map(|k| covariance[(k, k)]).collect(),
            Precision::Sparse { matrix, order, .. } => {
                let inverse = selected_inverse(matrix, order, matrix.pattern());
                let inverse = inverse.expect("a precision that was factorised when it was made");
                (0..n / 2).map(|node| inverse.diagonal(node)).flat_map(|[xx, _, yy]| [xx, yy]).collect()
            }
        };
        of_one.into_iter().map(|variance| (1.0 + self.common) * variance).collect()
    }

    /// Noise of all rows at `n_instants` instants, one list for each, that of the common reference among it: mm, or in
    /// units of `sigma` where that is not known. A seed means the same for ever.
    pub fn draw(&self, n_instants: usize, seed: u64) -> Vec<Vec<f64>> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let n = self.precision.n();
        let mut white = Dense::zeros(n, n_instants + 1);
        for k in 0..=n_instants {
            white.column_mut(k).iter_mut().for_each(|v| *v = StandardNormal.sample(&mut random));
        }
        let mut coloured = self.precision.colour(&white).expect("a precision that was factorised when it was made");
        let (sigma, tied) = (self.sigma.unwrap_or(1.0), self.common.sqrt());
        let row = |(e, c): (&f64, &f64)| sigma * (e + tied * c);
        let forces: Vec<f64> = match &self.precision {
            Precision::WithForce { .. } => (0..n_instants).map(|k| coloured[(n - 1, k)]).collect(),
            _ => Vec::new(),
        };
        self.precision.leave_force_out(&mut coloured);
        let at_instant = |k: usize| {
            let mut rows: Vec<f64> = coloured.column(k).iter().zip(coloured.column(n_instants)).map(row).collect();
            if let (Some(last), Some(force)) = (rows.last_mut(), forces.get(k)) {
                *last = sigma * force;
            }
            rows
        };
        (0..n_instants).map(at_instant).collect()
    }
}

/// The normal matrix of a texture that is the same everywhere: the integrals of the products of the shape functions.
pub(crate) fn even_texture(nodes: &[[f64; 2]], elements: &[[u32; 4]]) -> RunMatrix {
    let element_matrix = |corners: &[u32; 4]| -> ElementMatrix {
        alike(ElementGeometry::new(corners.map(|node| nodes[node as usize])).mass_matrix(), 1.0)
    };
    RunMatrix {
        corners: elements.to_vec(),
        matrices: elements.iter().map(element_matrix).collect(),
        of_noise: Vec::new(),
    }
}
