//! Whether several tests want the same parameters of the law.

use super::alone::pseudo_inverse;
use crate::identify::{FALSE_REJECTIONS, as_normal, normal_tail};
use crate::linalg::Dense;

/// What one test would have the parameters do.
pub(super) struct Pull {
    /// `J^T W J`.
    pub h: Dense,
    /// `J^T W r` at the parameters that all share.
    pub b: Dense,
    /// The same of what each constant, off by its standard uncertainty, and the size of the elements leave there.
    pub others: Vec<Dense>,
}

/// How far the tests disagree on the parameters: what their objectives would fall by if each had parameters of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Consistency {
    /// The fall of the objective, to first order, in units of the noise's variance.
    pub gain: f64,
    /// What noise, constants and element size make of it on average.
    pub expected: f64,
    /// Its normal deviate.
    pub z: f64,
    /// That above which the tests contradict each other: one right set of tests in a hundred.
    pub limit: f64,
    /// By how many of its own standard uncertainties each test would move each parameter, `[test][parameter]`; `None`
    /// where it says nothing of it.
    pub moves: Vec<Vec<Option<f64>>>,
}

impl Consistency {
    /// Whether the tests contradict each other.
    pub fn contradicted(&self) -> bool {
        self.z > self.limit
    }
}

/// How far tests with these pulls disagree; `None` where there is nothing that two of them tell.
pub(super) fn consistency(pulls: &[Pull]) -> Option<Consistency> {
    let n = pulls.first()?.h.n_rows();
    let (mut gain, mut freedom, mut moves) = (0.0, 0.0, Vec::new());
    let mut by_other = vec![0.0; pulls[0].others.len()];
    for pull in pulls {
        let (inverse, told) = pseudo_inverse(&pull.h)?;
        let square = |b: &Dense| b.transposed_times(&inverse.times(b))[(0, 0)].max(0.0);
        gain += square(&pull.b);
        freedom += told as f64;
        by_other.iter_mut().zip(&pull.others).for_each(|(sum, other)| *sum += square(other));
        let step = inverse.times(&pull.b);
        let own = |k: usize| (inverse[(k, k)] > 0.0).then(|| step[(k, 0)] / inverse[(k, k)].sqrt());
        moves.push((0..n).map(own).collect());
    }
    let freedom = freedom - n as f64;
    if freedom < 0.5 {
        return None;
    }
    let expected = freedom + by_other.iter().sum::<f64>();
    let of_others: f64 = by_other.iter().map(|square| 4.0 * square + 2.0 * square * square).sum();
    let variance = 2.0 * freedom + of_others;
    let z = as_normal(gain / expected, 2.0 * expected * expected / variance);
    Some(Consistency { gain, expected, z, limit: normal_tail(FALSE_REJECTIONS), moves })
}
