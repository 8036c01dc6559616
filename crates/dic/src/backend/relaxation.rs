//! How far a node is moved by its correction: as the fall of its last one tells, node by node.
//!
//! The normal matrix is made of gradients of the reference. Where the two images differ (a cut border, whose pixels
//! come and go; more contrast than the reference has), it is too soft or too stiff, and the corrections of a node or
//! two fall slowly where all others have settled. Aitken's relaxation (Irons and Tuck, 1969) by node takes that away:
//! of corrections that fell by the rate q with steps of the factor w, the error left is w / (1 - q) of a correction.

use crate::linalg::Solver;

/// A node's correction, px, and what it is multiplied by. Twin: shaders/correct.wgsl.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Relaxation {
    correction: [f64; 2],
    factor: f64,
}

/// Factors stay within these: neighbours are corrected as well, and for them a factor is not meant.
const FACTORS: [f64; 2] = [0.6, LONGEST];
/// Of a correction no node is moved by more than this many times.
pub(crate) const LONGEST: f64 = 1.1;
/// And what is left of a rate below 1 is taken to be this at least.
const LEAST_LEFT: f64 = 0.1;

/// A node that was corrected by more than this, px, is not relaxed, nor is any after this many steps from a start: what
/// is far off or does not settle wanders, and quotients of corrections that wander would make round-off grow from step
/// to step.
const FARTHEST: f64 = 0.25;
const STEPS: usize = 8;

/// Whether the nodes are relaxed in a `step` with `solver` from a start, the first of which is 1 and has no correction
/// before it: those that are bound to each other move together.
pub(super) fn is_relaxed(step: usize, solver: &Solver) -> bool {
    (2..=STEPS).contains(&step) && solver.subspace().is_none()
}

impl Relaxation {
    /// Of a `correction` that follows the one `before`, with the factor 1 after none.
    pub fn new(before: Option<&Self>, correction: [f64; 2]) -> Self {
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let after = |before: &Self| {
            let squares = dot(before.correction, before.correction);
            // A node that was not moved has no rate.
            if squares > 0.0 && squares <= FARTHEST * FARTHEST {
                let rate = dot(before.correction, correction) / squares;
                (before.factor / (1.0 - rate).max(LEAST_LEFT)).clamp(FACTORS[0], FACTORS[1])
            } else {
                1.0
            }
        };
        Self { correction, factor: before.map_or(1.0, after) }
    }

    /// The same where all corrections are multiplied by `damping` beside.
    pub fn damped(self, damping: f64) -> Self {
        Self { factor: self.factor * damping, ..self }
    }

    /// What the node is moved by, px.
    pub fn movement(&self) -> [f64; 2] {
        self.correction.map(|d| self.factor * d)
    }
}

#[cfg(test)]
mod tests {
    use super::Relaxation;

    /// Corrections until one is below `least`, of a node whose error an unrelaxed step multiplies by `rate`.
    fn corrections(rate: f64, least: f64) -> usize {
        let (mut error, mut last) = ([0.03, -0.02], None);
        for made in 1..100 {
            let correction = error.map(|e| (1.0 - rate) * e);
            if correction[0].abs().max(correction[1].abs()) < least {
                return made;
            }
            let relaxed = Relaxation::new(last.as_ref(), correction);
            let by = relaxed.movement();
            error = [error[0] - by[0], error[1] - by[1]];
            last = Some(relaxed);
        }
        panic!("no end");
    }

    #[test]
    fn a_node_that_overshoots_or_falls_short_settles_at_once_within_the_range_of_factors() {
        // One step shows the rate, the second ends it, the third correction is round-off. Without: ln(1e-9) / ln(rate)
        // steps.
        for rate in [-0.6, -0.43, -0.1, 0.05] {
            assert_eq!(corrections(rate, 1e-9), 3, "{rate}");
        }
        // Beyond, by the rate 1 - w (1 - rate) that the outermost factor w leaves: -0.14 and 0.34, in place of -0.9 and
        // 0.4.
        assert!(corrections(-0.9, 1e-9) <= 13);
        assert!(corrections(0.4, 1e-9) <= 21);
    }

    #[test]
    fn nothing_is_made_of_a_node_that_stood_still_and_what_is_no_number_stays_none() {
        let still = Relaxation::new(None, [0.0; 2]);
        assert_eq!(Relaxation::new(Some(&still), [0.1, -0.2]).movement(), [0.1, -0.2]);
        let relaxed = Relaxation::new(Some(&Relaxation::new(None, [0.1, 0.1])), [f64::NAN, 0.0]);
        assert!(relaxed.movement()[0].is_nan());
    }

    #[test]
    fn a_node_that_was_far_off_is_not_relaxed() {
        let after = |correction: f64| {
            let next = [-0.4 * correction, 0.0];
            Relaxation::new(Some(&Relaxation::new(None, [correction, 0.0])), next).movement()[0] / next[0]
        };
        assert!((after(0.24) - 1.0 / 1.4).abs() < 1e-12);
        assert_eq!(after(0.26), 1.0);
    }
}
