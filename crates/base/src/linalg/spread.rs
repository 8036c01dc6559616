//! Variances and degrees of freedom of a regularised solution.

use super::blocks::BlockMatrix;
use super::cholesky::NotPositiveDefinite;
use super::selected_inverse::selected_inverse;

/// What is known of each node's unknowns in a least-squares solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Variances `[xx, yy]` of each node for data of unit variance.
    pub variance: Vec<[f64; 2]>,
    /// Degrees of freedom that each node takes from the residual: 2 without regularisation, less with it.
    pub freedom: Vec<f64>,
}

/// Relative step of the central difference: exact to its square, 0.01 % at the most.
const STEP: f64 = 0.01;

/// Variances and degrees of freedom of the solution `a = A^-1 b`, where `b` has the covariance `M` (`data`) and
/// `A = M + w R` with the `penalty` `w R`: the diagonal of `A^-1 M A^-1`, and per node that of
/// `2 M A^-1 - M A^-1 M A^-1`, whose trace is what the mean square of the residual is short of. The nodes are
/// eliminated in `order`.
///
/// `A^-1 M A^-1` is the derivative of `-(s M + w R)^-1` by `s` at 1, so two selected inverses give it wherever `M`
/// has entries, however far the penalty carries a load.
///
/// # Errors
/// [`NotPositiveDefinite`] when neither the data nor the penalty determines some unknown.
pub fn spread(data: &BlockMatrix, penalty: &BlockMatrix, order: &[usize]) -> Result<Spread, NotPositiveDefinite> {
    let inverse = |scale: f64| {
        let mut sum = penalty.clone();
        sum.add(data, scale);
        selected_inverse(&sum, order, data.pattern())
    };
    let (less, more) = rayon::join(|| inverse(1.0 - STEP), || inverse(1.0 + STEP));
    let (less, more) = (less?, more?);
    let pattern = data.pattern();
    let mut spread = Spread { variance: Vec::new(), freedom: Vec::new() };
    for node in 0..pattern.n_nodes() {
        let (mut variance, mut freedom) = ([0.0; 2], 0.0);
        for at in pattern.row(node) {
            let (less, more) = (&less.blocks()[at], &more.blocks()[at]);
            let covariance: [f64; 4] = std::array::from_fn(|k| (less[k] - more[k]) / (2.0 * STEP));
            for (k, m) in data.blocks()[at].iter().enumerate() {
                freedom += m * (less[k] + more[k] - covariance[k]);
            }
            if pattern.columns()[at] as usize == node {
                variance = [covariance[0].max(0.0), covariance[3].max(0.0)];
            }
        }
        spread.variance.push(variance);
        spread.freedom.push(freedom);
    }
    Ok(spread)
}
