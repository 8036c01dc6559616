//! The Gauss-Newton iteration on one level.

use super::level::Level;
use super::own::Own;
use super::regularisation::Regulariser;
use crate::backend::{Backend, BackendError, KernelOptions};
use crate::field::{RigidMotion, Status};
use crate::mesh::Mesh;
use crate::units::Px;

/// When to stop.
#[derive(Clone, Copy)]
pub(super) struct Limits<'a> {
    pub tolerance_px: f64,
    /// Per node, what is good enough where corrections fall slowly, px: a tenth of its standard uncertainty. Empty where
    /// noise is not what slows them down.
    pub enough_px: &'a [f64],
    pub max_iterations: usize,
    /// Corrections of this many element sizes belong to no displacement field.
    pub wild_elements: f64,
    /// How far the field is turned.
    pub turn: Turn,
    /// Whether the frame needs a solver of its own even where it has lost no pixels.
    pub own: bool,
    /// What holds the displacement of the frame's own solver in place of what the level has.
    pub regulariser: Option<&'a Regulariser>,
}

/// How far a field is turned as a whole, for steps: the normal matrix is made of gradients of the reference, which are
/// turned in the deformed image, and with them the corrections. Left as they are they converge the slower the larger
/// the rotation, and beyond 60 degrees not at all.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Turn {
    cos: f64,
    sin: f64,
}

impl Turn {
    /// Not at all.
    pub const NONE: Self = Self { cos: 1.0, sin: 0.0 };

    /// Of a displacement of the nodes, the mean over the zones by their nodes. Below 8 degrees none: it would save a
    /// fraction of an iteration.
    pub fn of(mesh: &Mesh<Px>, displacement: &[[f64; 2]]) -> Self {
        const LEAST: f64 = 8.0 / 180.0 * std::f64::consts::PI;
        let (mut cos, mut sin) = (0.0, 0.0);
        for zone in 0..mesh.zones().len() {
            let nodes = mesh.zone_nodes(zone);
            // Some thousand tell it as well as all.
            let some = nodes.clone().step_by(nodes.len() / 4096 + 1);
            let points = some.map(|node| (mesh.nodes()[node], displacement[node]));
            if let Some(motion) = RigidMotion::fit(points) {
                cos += nodes.len() as f64 * motion.rotation_rad.cos();
                sin += nodes.len() as f64 * motion.rotation_rad.sin();
            }
        }
        let (angle, length) = (sin.atan2(cos), cos.hypot(sin));
        // Zones that turn against each other have no turn in common.
        if angle.abs() < LEAST || length.is_nan() || length <= 0.5 * mesh.n_nodes() as f64 {
            return Self::NONE;
        }
        Self { cos: cos / length, sin: sin / length }
    }

    /// Variances along x and y of what was found before it was turned, in the deformed image.
    pub fn variances(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (c, s) = (self.cos * self.cos, self.sin * self.sin);
        if self == Self::NONE { [x, y] } else { [c * x + s * y, s * x + c * y] }
    }
}

/// From this iteration on corrections count as slow, and as stalled from the second on.
const SLOW: [usize; 2] = [7, 12];

/// How an iteration ended.
pub(super) struct Outcome<B: Backend> {
    pub status: Status,
    pub iterations: usize,
    pub correction_px: f64,
    /// The node of that correction.
    pub worst_node: usize,
    /// Largest correction of the first step: how far off the start was.
    pub first_correction_px: f64,
    /// Smallest correlation coefficient of a zone at the start.
    pub first_correlation: f64,
    /// Smallest change of a zone's correlation coefficient from the start to the last evaluation.
    pub gained: f64,
    /// What the frame is solved with when it has lost pixels.
    pub own: Option<Own<B>>,
    /// How far the field was turned.
    pub turn: Turn,
}

/// A first correction of more than this, px, comes from a start that is too rough for what the frame has lost to be known: full steps
/// beside the border would overshoot, and elements be lost that have most of their pixels.
const ROUGH_PX: f64 = 0.25;
/// The frame's own matrix is renewed when elements have been left out or have come back, and when corrections fall by less
/// than this while the pixels counted have changed by this share of an element.
const SLOW_RATE: f64 = 0.25;
const RENEW_SHARE: f64 = 0.1;
/// A correction that falls by less than this has stalled.
const STALLED: f64 = 0.8;
/// From this iteration on, an iteration ends whose corrections have fallen too slowly to reach the tolerance within the
/// limit this many times in a row: long enough for the half step of an overshoot to have its effect.
const TOO_SLOW: [usize; 2] = [12, 8];
/// [`Limits::wild_elements`] of what nothing but the images holds.
pub(super) const WILD_ELEMENTS: f64 = 8.0;

/// Nothing follows the field but what its steps move.
pub(super) fn nothing<A, B>(_: &mut A, _: &mut B) -> Result<(), BackendError> {
    Ok(())
}

/// Corrections below this, px, may be round-off, whose rate means nothing: the smallest elements under noise reach it.
const ROUND_OFF_PX: f64 = 5e-6;

/// Iterates `field` on `level` until the correction, and the error it leaves, are below the tolerance. After each step
/// that another one follows comes `between`: what else is to follow the field.
///
/// The grey transfer is fitted at the field before the correction (which is made for it, THEORY 2), and fields of light
/// follow one iteration late, so that the corrections c may fall unevenly: what repeats is two of them together, by the rate
/// `q = c(k) / c(k-2)`. What is still to come is then about
/// `(c(k-1) + c(k)) q / (1 - q)`; of corrections that fall evenly that is the sum of their geometric series.
pub(super) fn iterate<B: Backend>(
    backend: &B,
    level: &Level<B>,
    frame: &mut B::Frame,
    field: &mut B::Field,
    limits: Limits<'_>,
    options: &KernelOptions,
    mut between: impl FnMut(&mut B::Frame, &mut B::Field) -> Result<(), BackendError>,
) -> Result<Outcome<B>, BackendError> {
    let size = level.mesh.element_size();
    let mut outcome = Outcome {
        status: Status::IterationLimit,
        iterations: 0,
        correction_px: f64::INFINITY,
        worst_node: 0,
        first_correction_px: 0.0,
        first_correlation: 0.0,
        gained: 0.0,
        own: None,
        turn: limits.turn,
    };
    // The last two corrections, the latest first.
    let (mut before, mut stalls, mut late) = ([f64::INFINITY; 2], 0, 0);
    // Pixels counted and elements lost when the own solver was made.
    let mut made_at = (0.0, 0);
    for iteration in 1..=limits.max_iterations {
        // A correction that comes back with the other sign each time is an overshoot somewhere: one half step
        // settles it. More of them would only slow down what approaches from one side.
        let damping = if stalls == 3 { 0.5 } else { 1.0 };
        let scale = [damping * limits.turn.cos, damping * limits.turn.sin];
        let solver = outcome.own.as_ref().map_or(&level.solver, |own| &own.solver);
        let mut step = backend.step(&level.prepared, frame, field, solver, scale)?;
        let moved = (step.counted - made_at.0).abs() > RENEW_SHARE * size * size;
        let renew = match outcome.own {
            None => {
                (step.lost > 0 && (iteration > 1 || step.correction_px < ROUGH_PX)) || (limits.own && iteration == 1)
            }
            Some(_) => step.lost != made_at.1 || (moved && step.correction_px > SLOW_RATE * before[0]),
        };
        if renew {
            let own = Own::new(backend, level, frame, field, options, limits.regulariser)?;
            step = backend.solve_again(&level.prepared, frame, field, &own.solver, scale)?;
            (outcome.own, made_at) = (Some(own), (step.counted, step.lost));
        }
        let correction = step.correction_px;
        outcome.iterations = iteration;
        outcome.correction_px = correction;
        outcome.worst_node = step.worst_node;
        outcome.gained = step.gained;
        if iteration == 1 {
            outcome.first_correlation = step.correlation;
            outcome.first_correction_px = correction;
        }
        if !correction.is_finite() || correction > limits.wild_elements * size {
            outcome.status = Status::Diverged;
            break;
        }
        let settled = correction < ROUND_OFF_PX || error_left(correction, before) < limits.tolerance_px;
        if correction < limits.tolerance_px && settled {
            outcome.status = Status::Converged;
            break;
        }
        if let Some(&enough) = limits.enough_px.get(step.worst_node).filter(|enough| correction < **enough) {
            let slow = iteration >= SLOW[0] && error_left(correction, before) < 3.0 * enough;
            if slow || iteration >= SLOW[1] {
                outcome.status = Status::Converged;
                break;
            }
        }
        let target =
            limits.enough_px.get(step.worst_node).map_or(limits.tolerance_px, |px| px.max(limits.tolerance_px));
        let arrives = iterations_left(correction, before[1], target) <= (limits.max_iterations - iteration) as f64;
        late = if arrives || iteration < TOO_SLOW[0] { 0 } else { late + 1 };
        if late == TOO_SLOW[1] {
            break;
        }
        // After a half step the correction is that of the full one: counting starts anew.
        stalls = if correction > STALLED * before[0] && damping == 1.0 { stalls + 1 } else { 0 };
        before = [correction, before[0]];
        if iteration < limits.max_iterations {
            between(frame, field)?;
        }
    }
    Ok(outcome)
}

/// What the corrections still to come add up to, after `correction` and those before it, the latest first (infinite
/// where there were none).
fn error_left(correction: f64, [last, one_before]: [f64; 2]) -> f64 {
    let earlier = if one_before.is_finite() { one_before } else { last };
    if !earlier.is_finite() {
        return correction; // the first: as if each were half of the one before
    }
    let rate = if earlier > 0.0 { (correction / earlier).min(0.99) } else { 0.0 };
    (last + correction) * rate / (1.0 - rate)
}

/// Iterations until a correction that was `earlier` two iterations ago has fallen to `target`; infinite if it does not fall.
fn iterations_left(correction: f64, earlier: f64, target: f64) -> f64 {
    if correction <= target {
        return 0.0;
    }
    if correction < earlier { 2.0 * (target / correction).ln() / (correction / earlier).ln() } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::iterations_left;

    #[test]
    fn what_falls_by_a_tenth_each_time_needs_as_many_iterations_as_tenths() {
        // Two iterations ago it was 1 / 0.9^2 of what it is: 44 more take it to a hundredth, ln 0.01 / ln 0.9 = 43.7.
        let left = iterations_left(1e-2, 1e-2 / 0.81, 1e-4);
        assert!((left - 43.7).abs() < 0.05, "{left}");
        assert_eq!(iterations_left(1e-5, 1e-2, 1e-4), 0.0);
        assert_eq!(iterations_left(1e-2, 1e-2, 1e-4), f64::INFINITY);
        assert_eq!(iterations_left(2e-2, 1e-2, 1e-4), f64::INFINITY);
    }
}
