//! Acceleration of a displacement and of the light that follows it one iteration late (Anderson 1965).
//!
//! A step takes the state `x` (displacement and light) to `g(x)`; `f = g - x` is what it changes. Where one holds the
//! other up, the changes fall slowly and evenly. The next state is the combination `sum a g` of the last ones, `sum a = 1`,
//! whose changes of the displacement cancel best.

use crate::backend::GreyTransfer;
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// Displacement of the nodes, px, and light there.
#[derive(Clone)]
pub(crate) struct State {
    pub displacement: Vec<[f64; 2]>,
    pub light: Vec<GreyTransfer>,
}

#[derive(Default)]
pub(crate) struct Mixed {
    /// The displacement that the last step began with.
    began: Option<Vec<[f64; 2]>>,
    /// What the last steps led to, and by how much they changed the displacement; the latest first.
    steps: VecDeque<(State, Vec<[f64; 2]>)>,
}

/// Steps that are combined.
const STEPS: usize = 5;
/// A change that is so many times the one before it ends what was known.
const GROWS: f64 = 2.0;
/// Of the mean square difference, what keeps the weights small.
const DAMPED: f64 = 1e-8;

fn dot(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
}

impl Mixed {
    /// What comes next does not follow on the last step.
    pub fn begin_anew(&mut self) {
        self.began = None;
    }

    /// Takes notice of what a step has led to, and puts `at` where the next begins; whether that is another displacement.
    pub fn advance(&mut self, at: &mut State) -> bool {
        let Some(began) = self.began.replace(at.displacement.clone()) else { return false };
        let change = |(now, then): (&[f64; 2], &[f64; 2])| [now[0] - then[0], now[1] - then[1]];
        let change: Vec<[f64; 2]> = at.displacement.iter().zip(&began).map(change).collect();
        let square = dot(&change, &change);
        if self.steps.front().is_some_and(|(_, before)| square > GROWS * GROWS * dot(before, before)) {
            self.steps.clear();
        }
        self.steps.push_front((at.clone(), change));
        self.steps.truncate(STEPS);
        let (Some(weights), Some((latest, _))) = (self.weights(), self.steps.front()) else { return false };
        for (weight, (state, _)) in weights.iter().zip(self.steps.iter().skip(1)) {
            for ((at, latest), state) in at.displacement.iter_mut().zip(&latest.displacement).zip(&state.displacement) {
                (0..2).for_each(|c| at[c] += weight * (state[c] - latest[c]));
            }
            for ((at, latest), state) in at.light.iter_mut().zip(&latest.light).zip(&state.light) {
                at.gain += weight * (state.gain - latest.gain);
                at.offset += weight * (state.offset - latest.offset);
            }
        }
        self.began = Some(at.displacement.clone());
        true
    }

    /// Weights of the steps before the latest, whose own is what is missing to one.
    fn weights(&self) -> Option<DVector<f64>> {
        let (_, latest) = self.steps.front()?;
        let less = |(_, change): &(State, Vec<[f64; 2]>)| -> Vec<[f64; 2]> {
            change.iter().zip(latest).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect()
        };
        let differences: Vec<Vec<[f64; 2]>> = self.steps.iter().skip(1).map(less).collect();
        let n = differences.len();
        if n == 0 {
            return None;
        }
        let mut matrix = DMatrix::from_fn(n, n, |i, j| dot(&differences[i], &differences[j]));
        let damped = DAMPED * matrix.trace() / n as f64;
        (0..n).for_each(|i| matrix[(i, i)] += damped);
        let rhs = DVector::from_fn(n, |i, _| -dot(&differences[i], latest));
        matrix.cholesky().map(|factor| factor.solve(&rhs)).filter(|w| w.iter().all(|w| w.is_finite()))
    }
}

#[cfg(test)]
mod tests {
    use super::{Mixed, State};
    use crate::backend::GreyTransfer;

    #[test]
    fn displacement_and_light_that_hold_each_other_up_settle_in_a_third_of_the_steps() {
        // At each node the displacement follows the light and the light the displacement, both one step late: alone they
        // fall by the root of this share in each step.
        let shares = [0.95, 0.9, 0.6, 0.3, 0.1];
        let steps_to = |mix: bool| {
            let mut mixed = Mixed::default();
            let light = vec![GreyTransfer { gain: 1.0, offset: 0.0 }; shares.len()];
            let mut at = State { displacement: vec![[1.0, -0.5]; shares.len()], light };
            for step in 1..400 {
                let mut next = at.clone();
                for (node, share) in shares.iter().enumerate() {
                    next.displacement[node] = [share * at.light[node].gain, share * at.light[node].offset];
                    next.light[node] =
                        GreyTransfer { gain: at.displacement[node][0], offset: at.displacement[node][1] };
                }
                if next.displacement.iter().all(|u| u[0].hypot(u[1]) < 1e-4) {
                    return step;
                }
                if mix {
                    mixed.advance(&mut next);
                }
                at = next;
            }
            400
        };
        let (alone, mixed) = (steps_to(false), steps_to(true));
        // 2 ln(1e-4) / ln(0.95) = 359.
        assert!(alone > 340 && 3 * mixed < alone, "{alone} alone, {mixed} combined");
    }
}
