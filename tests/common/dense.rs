//! Dense symmetric systems, to compare sparse ones with.

use quadrille::linalg::BlockMatrix;

/// A square matrix, row by row.
#[derive(Clone)]
pub struct Dense {
    pub n: usize,
    pub values: Vec<f64>,
}

impl Dense {
    pub fn zero(n: usize) -> Self {
        Self { n, values: vec![0.0; n * n] }
    }

    /// All entries of a block matrix, read column by column through its product with unit vectors.
    pub fn of(matrix: &BlockMatrix) -> Self {
        let n_nodes = matrix.pattern().n_nodes();
        let mut dense = Self::zero(2 * n_nodes);
        for column in 0..2 * n_nodes {
            let mut unit = vec![[0.0; 2]; n_nodes];
            unit[column / 2][column % 2] = 1.0;
            for (node, product) in matrix.multiply(&unit).into_iter().enumerate() {
                for c in 0..2 {
                    *dense.at(2 * node + c, column) = product[c];
                }
            }
        }
        dense
    }

    pub fn at(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.values[row * self.n + column]
    }

    /// Solves for all right-hand sides, by Gauss elimination with row pivots.
    pub fn solve(&self, rhs: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let n = self.n;
        let mut rows: Vec<Vec<f64>> = (0..n)
            .map(|i| {
                let mut row = self.values[i * n..(i + 1) * n].to_vec();
                row.extend(rhs.iter().map(|b| b[i]));
                row
            })
            .collect();
        for k in 0..n {
            let pivot = (k..n).max_by(|&a, &b| rows[a][k].abs().total_cmp(&rows[b][k].abs())).unwrap();
            rows.swap(k, pivot);
            let (above, below) = rows.split_at_mut(k + 1);
            let pivot = &above[k];
            assert!(pivot[k] != 0.0, "singular at unknown {k}");
            for row in below {
                let factor = row[k] / pivot[k];
                if factor != 0.0 {
                    for (value, p) in row[k..].iter_mut().zip(&pivot[k..]) {
                        *value -= factor * p;
                    }
                }
            }
        }
        (0..rhs.len())
            .map(|b| {
                let mut x = vec![0.0; n];
                for i in (0..n).rev() {
                    let known: f64 = (i + 1..n).map(|j| rows[i][j] * x[j]).sum();
                    x[i] = (rows[i][n + b] - known) / rows[i][i];
                }
                x
            })
            .collect()
    }

    /// The inverse, column by column.
    pub fn inverse(&self) -> Vec<Vec<f64>> {
        let units: Vec<Vec<f64>> = (0..self.n)
            .map(|k| {
                let mut unit = vec![0.0; self.n];
                unit[k] = 1.0;
                unit
            })
            .collect();
        self.solve(&units)
    }
}

/// The least-squares fit of linear elements between `nodes` to `u`: what a correlation makes of a displacement on even
/// texture.
pub fn fitted(nodes: &[f64], u: impl Fn(f64) -> f64) -> Vec<f64> {
    const STEPS: usize = 400; // the midpoint rule is good to 1e-6 of the amplitude
    let n = nodes.len();
    let (mut mass, mut load) = (Dense::zero(n), vec![0.0; n]);
    for k in 0..n - 1 {
        let length = nodes[k + 1] - nodes[k];
        for (i, j, m) in [(k, k, 2.0), (k, k + 1, 1.0), (k + 1, k, 1.0), (k + 1, k + 1, 2.0)] {
            *mass.at(i, j) += m * length / 6.0;
        }
        for step in 0..STEPS {
            let t = (step as f64 + 0.5) / STEPS as f64;
            let part = u(nodes[k] + t * length) * length / STEPS as f64;
            load[k] += (1.0 - t) * part;
            load[k + 1] += t * part;
        }
    }
    mass.solve(&[load]).remove(0)
}
