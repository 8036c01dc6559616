//! Diagonal of the covariance of a regularised solution, by probing with the factor.

use super::blocks::BlockMatrix;
use super::cholesky::Cholesky;
use super::inverse_diagonal::sign;
use rayon::prelude::*;

/// Colours that share one piece of work: two right-hand sides each.
const COLOURS: usize = 8;

/// What is known of each node's unknowns in a least-squares solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Variances `[xx, yy]` of each node for data of unit variance.
    pub variance: Vec<[f64; 2]>,
    /// Degrees of freedom that each node takes from the residual: 2 without regularisation, less with it.
    pub freedom: Vec<f64>,
}

/// Variances and degrees of freedom of the solution `a = A^-1 b`, where `b` has the covariance `M` (`data`) and
/// `A = M + w R` the factor `factor`: the diagonal of `A^-1 M A^-1`, and per node that of
/// `2 M A^-1 - M A^-1 M A^-1`, whose trace is what the mean square of the residual is short of.
///
/// One right-hand side holds unit loads at all nodes of a `colour`, with fixed random signs, so nodes of one
/// colour must be so far apart that their solutions hardly overlap; two solutions per colour and component.
/// The same bits for any number of threads.
pub fn spread(factor: &Cholesky, data: &BlockMatrix, colour: &[u32]) -> Spread {
    let n = colour.len();
    let n_colours = colour.iter().max().map_or(0, |&c| c as usize + 1);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); n_colours];
    for (node, &c) in colour.iter().enumerate() {
        members[c as usize].push(node);
    }
    let found: Vec<Vec<(usize, [f64; 2], f64)>> = members
        .par_chunks(COLOURS)
        .map(|members| {
            let mut x = vec![[0.0; 2]; 2 * members.len() * n];
            for (at, nodes) in members.iter().enumerate() {
                for &node in nodes {
                    for c in 0..2 {
                        x[(2 * at + c) * n + node][c] = f64::from(sign(node));
                    }
                }
            }
            factor.solve_all(&mut x);
            let mut z = Vec::with_capacity(x.len());
            x.chunks_exact(n).for_each(|x| z.extend(data.multiply(x)));
            // M x is lost in the next solution, but for its values at the loads.
            let loaded = |z: &[[f64; 2]], at: usize, node: usize| {
                [0, 1].map(|c| f64::from(sign(node)) * z[(2 * at + c) * n + node][c])
            };
            let at_loads = |z: &[[f64; 2]]| -> Vec<[f64; 2]> {
                members
                    .iter()
                    .enumerate()
                    .flat_map(|(at, m)| m.iter().map(move |&k| (at, k)))
                    .map(|(at, k)| loaded(z, at, k))
                    .collect()
            };
            let once = at_loads(&z);
            factor.solve_all(&mut z);
            let variance = at_loads(&z);
            let nodes = members.iter().enumerate().flat_map(|(at, m)| m.iter().map(move |&node| (at, node)));
            nodes
                .zip(once.iter().zip(&variance))
                .map(|((at, node), (once, variance))| {
                    let mut freedom = 0.0;
                    for c in 0..2 {
                        let column = &z[(2 * at + c) * n..(2 * at + c + 1) * n];
                        freedom += 2.0 * once[c] - f64::from(sign(node)) * data.row_times(node, column)[c];
                    }
                    (node, variance.map(|v| v.max(0.0)), freedom)
                })
                .collect()
        })
        .collect();
    let mut spread = Spread { variance: vec![[0.0; 2]; n], freedom: vec![0.0; n] };
    for (node, variance, freedom) in found.into_iter().flatten() {
        spread.variance[node] = variance;
        spread.freedom[node] = freedom;
    }
    spread
}
