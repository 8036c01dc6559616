//! The Gauss-Newton iteration on one level.

use crate::backend::{Ahead, Backend, BackendError, COUPLED, KernelOptions, LONGEST};
use crate::correlate::{Level, Own, Pace, Regulariser};
use crate::field::{Brightness, RigidMotion, Status};
use crate::linalg::Pattern;
use crate::mesh::Mesh;
use crate::units::Px;

#[derive(Clone, Copy)]
pub(crate) struct Limits<'a> {
    pub tolerance_px: f64,
    /// Per node, what is good enough where corrections fall slowly; empty where that is not known.
    pub enough: &'a [Enough],
    pub max_iterations: usize,
    /// Corrections of this many element sizes belong to no displacement field.
    pub wild_elements: f64,
    pub turn: Turn,
    /// Whether fields of light follow the displacement one iteration late.
    pub late_light: bool,
    /// First corrections above this, px, at more than the share `few_far` of a zone's nodes end it: it is far off.
    pub near_px: f64,
    pub few_far: f64,
    /// Whether the frame needs a solver of its own even where it has lost no pixels.
    pub own: bool,
    /// Whether what is good enough at a node will do wherever corrections fall slowly, noise or not.
    pub enough_anywhere: bool,
    /// What holds the displacement of the frame's own solver in place of what the level has.
    pub regulariser: Option<&'a Regulariser>,
}

/// What is good enough at a node where corrections fall slowly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Enough {
    /// A tenth of its standard uncertainty, px.
    pub px: f64,
    /// Whether corrections may fall slowly because noise is much of its texture, or leaves it uncertain.
    pub is_noisy: bool,
}

/// How far a field is turned as a whole, for steps: the gradients of the reference, of which the normal matrix is made,
/// are turned in the deformed image, and the corrections with them; left alone they do not converge beyond 60 degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Turn {
    cos: f64,
    sin: f64,
}

impl Turn {
    /// Not at all.
    pub const NONE: Self = Self { cos: 1.0, sin: 0.0 };

    /// Of a displacement, the mean over the zones by their nodes; none below 8 degrees, where it would save little.
    pub fn of(mesh: &Mesh<Px>, displacement: &[[f64; 2]]) -> Self {
        /// Radians.
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
}

/// Where noise may be the reason, corrections count as slow from the first iteration on, from the second on more may be
/// left of them, and from each on more nodes that have not settled are not waited for.
pub(crate) const SLOW: [usize; 3] = [7, 12, 20];
/// What may be left of them before and after that, in parts of what is good enough; of nodes that are not noisy the
/// first.
const LEFT: [f64; 2] = [3.0, 10.0];

/// Of more nodes than this share none is given up,
const FEW_UNSETTLED: f64 = 0.05;
/// nor of more than these before the second of [`SLOW`] and the third: one of 100 000, and of 10 000.
const HANDFUL_UNSETTLED: [f64; 2] = [1e-5, 1e-4];

/// At most so many steps along mesh lines away others follow a node that does not settle, each by a third of the one
/// before or less: as many as that makes more of what is enough.
const PULLED_ALONG: [usize; 2] = [2, 6];
const PULLED_SHARE: f64 = 1.0 / 3.0;

/// How many steps away nodes follow one that moves by `ratio` times what is enough for them.
fn pulled_along(ratio: f64) -> usize {
    let [least, most] = PULLED_ALONG;
    // Of what is no number as far as any.
    let steps = (ratio.ln() / -PULLED_SHARE.ln()).ceil().min(most as f64) as usize;
    steps.clamp(least, most)
}

pub(crate) struct Outcome<B: Backend> {
    pub status: Status,
    pub iterations: usize,
    pub correction_px: f64,
    pub worst_node: usize,
    /// Nodes that noise keeps from settling: they are still on their way, and their uncertainty is not known.
    pub unsettled: Vec<usize>,
    /// Whether it ended because the start was far off, see [`Limits::near_px`].
    pub is_far: bool,
    /// Smallest correlation coefficient of a zone at the start.
    pub first_correlation: f64,
    /// Smallest change of a zone's correlation coefficient from the start to the last evaluation.
    pub gained: f64,
    /// What the frame is solved with when it has lost pixels.
    pub own: Option<Own<B>>,
    pub turn: Turn,
}

/// A first correction of more than this, px, comes from a start that is too rough for what the frame has lost to be
/// known: full steps beside the border would overshoot, and elements be lost that have most of their pixels.
const ROUGH_PX: f64 = 0.25;
/// The frame's own matrix is renewed when elements have been left out or have come back, and when corrections fall by
/// less than this while the pixels counted have changed by this share of an element.
const SLOW_RATE: f64 = 0.25;
const RENEW_SHARE: f64 = 0.02;
/// From this iteration on, an iteration ends whose corrections have fallen too slowly to reach the tolerance within the
/// limit this many times in a row, or are not halved often enough: long enough for the half step of an overshoot to
/// have its effect.
pub(crate) const TOO_SLOW: [usize; 2] = [12, 8];
/// [`Limits::wild_elements`] of what nothing but the images holds.
pub(crate) const WILD_ELEMENTS: f64 = 8.0;

/// How single nodes are moved from iteration to iteration, towards the end of those that noise makes long.
#[derive(Default)]
struct Watch {
    displacement: Vec<[f64; 2]>,
    /// The last step was so many times the corrections.
    factor: f64,
    /// The last two corrections of each node, px, the latest first; empty until they are known.
    corrections: [Vec<f64>; 2],
}

impl Watch {
    /// Takes notice of where the nodes are after a step of `factor` times their corrections.
    fn note(&mut self, displacement: Vec<[f64; 2]>, factor: f64) {
        let moved = |(now, then): (&[f64; 2], &[f64; 2])| (now[0] - then[0]).hypot(now[1] - then[1]) / factor;
        let corrections = displacement.iter().zip(&self.displacement).map(moved).collect();
        self.corrections.swap(0, 1);
        self.corrections[0] = corrections;
        self.factor = factor;
        self.displacement = displacement;
    }

    /// Sets the nodes apart that noise keeps from settling, if they are few: whose correction is more than what is
    /// enough there, or that have more than `may_be_left` times that still before them; and those beside them that
    /// they pull along. `None` where another node has not settled, or the last two corrections are not known yet.
    fn set_unsettled_apart(
        &self,
        pattern: &Pattern,
        enough: &[Enough],
        tolerance_px: f64,
        may_be_left: f64,
    ) -> Option<Rest> {
        let [last, before] = &self.corrections;
        if before.len() != enough.len() {
            return None;
        }
        let (mut unsettled, mut others, mut worst) = (Vec::new(), Vec::new(), (0, 0.0));
        // The largest correction of the one, and the least that is enough for the others, px.
        let (mut largest, mut least) = (0.0f64, f64::INFINITY);
        for (node, ((&now, &then), enough)) in last.iter().zip(before).zip(enough).enumerate() {
            let rate = if then > 0.0 { (now / then).min(0.99) } else { 0.0 };
            // Of the correction itself a step of another length has left something too.
            let left = now * (rate / (1.0 - rate) + (1.0 - self.factor).abs());
            let (px, most) = (enough.px.max(tolerance_px), if enough.is_noisy { may_be_left } else { LEFT[0] });
            match now < px && left < most * px {
                true if now > worst.1 => worst = (node, now),
                true => {}
                false if enough.is_noisy => {
                    unsettled.push(node as u32);
                    largest = largest.max(now);
                }
                false => {
                    others.push(node as u32);
                    least = least.min(px);
                }
            }
        }
        if !others.is_empty() {
            let beside = pattern.around(&unsettled, pulled_along(largest / least));
            if !others.iter().all(|node| beside.binary_search(node).is_ok()) {
                return None;
            }
            unsettled.append(&mut others);
        }
        let unsettled: Vec<usize> = unsettled.into_iter().map(|node| node as usize).collect();
        (unsettled.len() as f64 <= FEW_UNSETTLED * enough.len() as f64).then_some(Rest { unsettled, worst })
    }
}

struct Rest {
    unsettled: Vec<usize>,
    /// The node of the others with the largest correction, and that, px.
    worst: (usize, f64),
}

impl Rest {
    /// Whether what has not settled of `n_nodes` nodes is no longer waited for after `iteration`.
    fn is_enough(&self, iteration: usize, n_nodes: usize) -> bool {
        let handful = HANDFUL_UNSETTLED[usize::from(iteration >= SLOW[1])];
        self.unsettled.len() as f64 <= handful * n_nodes as f64 || iteration >= SLOW[2]
    }
}

/// Nothing follows the field but what its steps move.
pub(crate) fn nothing<A, B>(_: &mut A, _: &mut B) -> Result<(), BackendError> {
    Ok(())
}

/// The last correction may be this many tolerances, but not so many px unless the tolerance is, if those that it would
/// be followed by add up to less than one. The residual, which belongs to the field before it, is then still that of
/// the result: it differs by the square of the correction.
const LAST: f64 = 10.0;
const LAST_PX: f64 = 0.01;
/// Corrections below this, px, may be round-off, whose rate means nothing: the smallest elements under noise reach it.
const ROUND_OFF_PX: f64 = 5e-6;
/// So may those below this part of what is good enough at their node, a thousandth of its standard uncertainty, where
/// it is poorly determined: did they fall by a hundredth only, a tenth of it would be left.
const ROUND_OFF_SHARE: f64 = 0.01;

/// Whether the first step has moved more than a few nodes of a zone by as much that the start was far off.
fn is_far<B: Backend>(
    backend: &B,
    level: &Level<B>,
    frame: &mut B::Frame,
    field: &B::Field,
    Limits { near_px, few_far, .. }: Limits<'_>,
) -> Result<bool, BackendError> {
    let (start, _) = backend.read_start(&level.prepared, frame, field)?;
    let now = backend.read_field(&level.prepared, frame, field)?.displacement;
    // What is no number is far as well.
    let is_near = |node: usize| (0..2).all(|c| (now[node][c] - start[node][c]).abs() < near_px);
    let is_far = |zone: usize| {
        let nodes = level.mesh.zone_nodes(zone);
        let few = few_far * nodes.len() as f64;
        nodes.filter(|&node| !is_near(node)).count() as f64 > few
    };
    Ok((0..level.mesh.zones().len()).any(is_far))
}

/// The steps that a device may make after that of `iteration` unseen by the host, whom they leave no choice. A frame
/// with a solver of its own was so when that was `made`: pixels counted and elements lost.
fn steps_ahead(iteration: usize, limits: &Limits<'_>, made: Option<(f64, usize)>, size: f64) -> Ahead {
    let of_own = limits.own && made.is_none();
    let steps = Pace::SAME.min(limits.max_iterations).saturating_sub(iteration);
    // Light is to follow each of them.
    if steps == 0 || of_own || limits.late_light {
        return Ahead::NONE;
    }
    let counted = made.map_or([0.0, f64::INFINITY], |(counted, _)| {
        let most = RENEW_SHARE * size * size;
        [counted - most, counted + most]
    });
    let correction_px = [last_px(limits), limits.near_px.min(limits.wild_elements * size)];
    Ahead { steps, correction_px, lost: made.map_or(0, |(_, lost)| lost), counted }
}

/// No larger a correction is the last, px.
fn last_px(limits: &Limits<'_>) -> f64 {
    limits.tolerance_px.max(LAST_PX.min(LAST * limits.tolerance_px))
}

/// Iterates `field` on `level` until the error that the last correction leaves is below the tolerance. After each step
/// that another one follows comes `between`: what else is to follow the field.
pub(crate) fn iterate<B: Backend>(
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
        unsettled: Vec::new(),
        is_far: false,
        first_correlation: 0.0,
        gained: 0.0,
        own: None,
        turn: limits.turn,
    };
    let (mut pace, mut late, mut watch) = (Pace::default(), 0, Watch::default());
    // Steps that light follows are combined.
    pace.is_whole = limits.late_light;
    // Pixels counted and elements lost when the own solver was made.
    let mut made_at = (0.0, 0);
    for iteration in 1..=limits.max_iterations {
        let scale = [pace.factor * limits.turn.cos, pace.factor * limits.turn.sin];
        let solver = outcome.own.as_ref().map_or(&level.solver, |own| &own.solver);
        let ahead = self::steps_ahead(iteration, &limits, outcome.own.as_ref().map(|_| made_at), size);
        let mut step = backend.step(&level.prepared, frame, field, solver, scale, &ahead)?;
        let moved = (step.counted - made_at.0).abs() > RENEW_SHARE * size * size;
        let renew = match outcome.own {
            None => {
                (step.lost > 0 && (iteration > 1 || step.correction_px < ROUGH_PX)) || (limits.own && iteration == 1)
            }
            Some(_) => step.lost != made_at.1 || (moved && step.correction_px > SLOW_RATE * pace.last()),
        };
        if renew {
            if let Some(own) = outcome.own.take() {
                own.give_back(backend, level);
            }
            let own = Own::new(backend, level, frame, field, options, limits.regulariser)?;
            made_at = (step.counted, step.lost);
            let ahead = self::steps_ahead(iteration, &limits, Some(made_at), size);
            step = backend.solve_again(&level.prepared, frame, field, &own.solver, scale, &ahead)?;
            outcome.own = Some(own);
        }
        let correction = step.correction_px;
        outcome.iterations = iteration;
        outcome.correction_px = correction;
        outcome.worst_node = step.worst_node;
        outcome.gained = step.gained;
        if iteration == 1 {
            outcome.first_correlation = step.correlation;
            if correction >= limits.near_px && is_far(backend, level, frame, field, limits)? {
                outcome.is_far = true;
                break;
            }
        }
        if !correction.is_finite() || correction > limits.wild_elements * size {
            outcome.status = Status::Diverged;
            break;
        }
        let is_even = !(renew || limits.late_light)
            && matches!(options.brightness, Brightness::Zone | Brightness::Off)
            && step.correlation >= COUPLED;
        let left = LONGEST * pace.left(correction, is_even);
        let is_small = correction < last_px(&limits) && left < limits.tolerance_px;
        let enough = limits.enough.get(step.worst_node);
        let round_off_px = enough.map_or(0.0, |enough| ROUND_OFF_SHARE * enough.px).max(ROUND_OFF_PX);
        if is_small || correction < limits.tolerance_px.min(round_off_px) {
            outcome.status = Status::Converged;
            break;
        }
        let enough = enough.filter(|enough| enough.is_noisy || limits.enough_anywhere);
        if iteration >= SLOW[0] && enough.is_some() {
            // Behind the largest correction there may be one that is not good enough at its node.
            watch.note(backend.read_field(&level.prepared, frame, field)?.displacement, pace.factor);
            let left = LEFT[usize::from(iteration >= SLOW[1])];
            let rest = watch.set_unsettled_apart(&level.pattern, limits.enough, limits.tolerance_px, left);
            if let Some(rest) = rest.filter(|rest| rest.is_enough(iteration, limits.enough.len())) {
                outcome.status = Status::Converged;
                (outcome.worst_node, outcome.correction_px) = rest.worst;
                outcome.unsettled = rest.unsettled;
                break;
            }
        } else {
            watch = Watch::default();
        }
        let target = enough.map_or(0.0, |enough| enough.px).max(limits.tolerance_px);
        let arrives = pace.iterations_left(correction, target) <= (limits.max_iterations - iteration) as f64;
        late = if arrives || iteration < TOO_SLOW[0] { 0 } else { late + 1 };
        pace.note(correction, renew);
        // A node that noise keeps from settling may be given up first.
        let from = if enough.is_some_and(|enough| enough.is_noisy) { SLOW[2] } else { TOO_SLOW[0] };
        if late == TOO_SLOW[1]
            || (iteration >= from && pace.is_halved_too_seldom(target, limits.max_iterations - iteration))
        {
            break;
        }
        if iteration < limits.max_iterations {
            between(frame, field)?;
        }
    }
    Ok(outcome)
}

#[cfg(test)]
mod tests {
    use super::{Enough, Watch};
    use crate::linalg::Pattern;

    fn strip(n_nodes: usize) -> Pattern {
        let elements: Vec<[u32; 4]> =
            (0..n_nodes as u32 / 2 - 1).map(|e| [2 * e, 2 * e + 2, 2 * e + 3, 2 * e + 1]).collect();
        Pattern::new(n_nodes, &elements)
    }

    /// What a watch says of nodes with these corrections along x, px, of steps of these factors, where `may_be_left`.
    fn told_by(
        corrections: &[[f64; 2]],
        enough: &[Enough],
        factors: [f64; 2],
        may_be_left: f64,
    ) -> Option<(Vec<usize>, (usize, f64))> {
        let mut watch = Watch::default();
        let mut at = vec![[1.0, 2.0]; corrections.len()];
        watch.note(at.clone(), 1.0);
        for (k, factor) in factors.into_iter().enumerate() {
            // Two corrections are needed.
            assert!(watch.set_unsettled_apart(&strip(enough.len()), enough, 1e-4, 3.0).is_none());
            at.iter_mut().zip(corrections).for_each(|(at, by)| at[0] += factor * by[k]);
            watch.note(at.clone(), factor);
        }
        let rest = watch.set_unsettled_apart(&strip(enough.len()), enough, 1e-4, may_be_left)?;
        Some((rest.unsettled, rest.worst))
    }

    fn told(corrections: &[[f64; 2]], enough: &[Enough]) -> Option<(Vec<usize>, (usize, f64))> {
        told_by(corrections, enough, [1.0; 2], 3.0)
    }

    #[test]
    fn a_handful_of_nodes_that_have_not_settled_is_waited_for_less_long_than_more_of_them() {
        let ends_after = |unsettled: usize, n_nodes: usize| {
            let rest = super::Rest { unsettled: (0..unsettled).collect(), worst: (0, 0.0) };
            (7..=30).find(|&iteration| rest.is_enough(iteration, n_nodes))
        };
        // One of 100 000, then one of 10 000.
        for (unsettled, n_nodes, after) in [
            (0, 50, 7),
            (1, 9_999, 20),
            (1, 10_000, 12),
            (2, 10_000, 20),
            (1, 100_000, 7),
            (2, 100_000, 12),
            (100, 1_000_000, 12),
            (101, 1_000_000, 20),
        ] {
            assert_eq!(ends_after(unsettled, n_nodes), Some(after), "{unsettled} of {n_nodes}");
        }
    }

    #[test]
    fn what_runs_away_pulls_others_along_the_further_the_faster_it_runs() {
        let ratios = [0.5, 9.0, 9.1, 27.0, 81.1, 1e9, f64::INFINITY, f64::NAN];
        assert_eq!(ratios.map(super::pulled_along), [2, 2, 3, 3, 5, 6, 6, 6]);
    }

    #[test]
    fn nodes_that_noise_keeps_from_settling_are_given_up_if_they_are_few_and_no_other_node_is() {
        let noisy = Enough { px: 0.02, is_noisy: true };
        let clear = Enough { px: 0.002, is_noisy: false };
        let many = |first: [f64; 2]| {
            let mut all = vec![[1e-3, 1e-4]; 40];
            all[7] = first;
            all
        };
        let mut enough = vec![clear; 40];
        enough[7] = noisy;
        // It goes on by nearly as much each time: 0.01 / (1 - 0.9) is still to come.
        let (unsettled, (worst, px)) = told(&many([0.01, 0.009]), &enough).unwrap();
        assert_eq!((unsettled, worst), (vec![7], 0));
        assert!((px - 1e-4).abs() < 1e-12);
        // It falls fast, from where it is good enough: nothing is left out.
        assert_eq!(told(&many([0.02, 0.008]), &enough).unwrap().0, Vec::<usize>::new());
        // The same corrections where noise is not the reason: the frame goes on.
        assert!(told(&many([0.01, 0.009]), &[clear; 40]).is_none());
        // More may be left of it later on, and no more of another than before.
        let later = |corrections: &[[f64; 2]], enough: &[Enough]| told_by(corrections, enough, [1.0; 2], 10.0);
        assert_eq!(later(&many([0.01, 0.009]), &enough).unwrap().0, Vec::<usize>::new());
        let mut slow_elsewhere = many([0.02, 0.008]);
        slow_elsewhere[3] = [1.5e-3, 1.3e-3]; // 8.4e-3 is left, 4.2 times what is enough
        assert!(later(&slow_elsewhere, &enough).is_none());
        // Half a step leaves half the correction, and twice as long a one says nothing of the rate.
        assert_eq!(told_by(&many([0.02, 0.008]), &enough, [1.0, 0.5], 0.4).unwrap().0, vec![7]);
        assert_eq!(told_by(&many([0.02, 0.008]), &enough, [2.0, 1.0], 0.4).unwrap().0, Vec::<usize>::new());
        // What follows a node that does not settle is given up with it, two steps away but not three; the faster it
        // moves the further: 0.05 px are 25 times what is enough for the others, 3^3 = 27.
        let (slow, fast) = ([0.01, 0.009], [0.05, 0.05]);
        for (first, node, is_pulled) in [(slow, 11, true), (slow, 13, false), (fast, 13, true), (fast, 15, false)] {
            let mut pulled = many(first);
            pulled[node] = [3e-3, 2.9e-3];
            assert_eq!(told(&pulled, &enough).map(|(unsettled, _)| unsettled), is_pulled.then(|| vec![7, node]));
        }
        // Three of 40 are more than a twentieth.
        let mut three = many([0.01, 0.009]);
        (three[1], three[2], enough[1], enough[2]) = ([0.01, 0.009], [0.01, 0.009], noisy, noisy);
        assert!(told(&three, &enough).is_none());
    }
}
