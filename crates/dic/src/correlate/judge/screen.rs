//! Elements give up, not frames: those that do not match leave the sums of one frame (docs/correlation.md, 2.8.1).
//!
//! A frame that converges is tested by the residual of its elements against that of their zone. Those that do not
//! match, as a rule none, are left out, the rest is iterated on with its own matrix, and all are tested again, those
//! left out where the field around would put them: some come back.
//!
//! A frame that does not converge is tried once more with a penalty that keeps the field smooth until they are known:
//! what one of them does then spreads no further than the penalty's length.

use crate::backend::{Backend, ElementMatch, Found, GreyTransfer};
use crate::correlate::{
    COARSE, Correlation, Correlator, Iterated, LeftOut, Level, Limits, Look, OfElement, Outcome, PenaltyScale,
    Regularisation, Regulariser, Result, Start, StartUsed, Turn, continue_field, elements_of, iterate, nothing,
    numbers, support, without_noise,
};
use crate::field::Status;
use crate::mesh::Mesh;
use crate::units::Px;

/// An element is left out when its mean square residual exceeds that of its zone by this factor (twice in amplitude)
const OUT_RATIO: f64 = 4.0;
/// and leaves this displacement, px, or this share of the variance of its texture, unexplained: what a field of smooth
/// displacement does not follow is less.
const OUT_PX: f64 = 0.5;
const OUT_SHARE: f64 = 0.3;
/// It comes back below any of these.
const BACK_RATIO: f64 = 2.25;
const BACK_PX: f64 = 0.35;
const BACK_SHARE: f64 = 0.15;
/// Rounds of leaving out and taking back, at most; and how often an element may be left out before it stays so.
const ROUNDS: usize = 8;
const TIMES: u8 = 2;
/// A zone of which less than this share of elements is left has no field.
pub(crate) const LEAST_LEFT: f64 = 0.2;
/// Cut-off length of the penalty of a second try, in elements.
const SMOOTH_ELEMENTS: f64 = 6.0;
/// Up to this many nodes a factor solves with this penalty. Beyond, conjugate gradients do, since a short cut-off
/// leaves the matrix well conditioned: a factor of 262 000 nodes would take seconds and 4 GB.
const FACTORED_UP_TO: usize = 5_000;
/// Limits of the smooth iterations of a second try.
const SMOOTH_TOLERANCE_PX: f64 = 0.02;
const SMOOTH_ITERATIONS: usize = 15;
/// What the penalty alone holds may go far, by so many elements in one iteration.
const WILD_SMOOTH_ELEMENTS: f64 = 100.0;
/// A node that leaves the smooth field by more than this, px, has gone astray.
const ASTRAY_PX: f64 = 1.5;
/// and when the field has run away by this share of the furthest.
const AWAY: f64 = 0.25;
/// Iterations after which the rest has to have settled, and what a node may still move by then, px: elements around
/// nodes that wander on do not hold them.
const REST_ITERATIONS: usize = 20;
const SETTLED_PX: f64 = 0.02;
/// How often elements that hinder the rest are left out before the frame is given up; each time half of what a node may
/// still move by is left.
const TRIES: i32 = 8;

impl<B: Backend> Correlator<B> {
    /// The elements to leave out from now on; `times` counts how often each was.
    fn choose_mismatched(
        &self,
        elements: &[ElementMatch],
        found: &Found,
        excluded: &[bool],
        times: &mut [u8],
    ) -> Vec<bool> {
        let Found { displacement, transfer, .. } = found;
        let residuals = self.residuals(elements, displacement, transfer, &self.spread.freedom, excluded);
        let looks = self.misfit_test.rate_residuals(&residuals);
        let is_out = |(element, look): (usize, Option<Look>)| {
            let was = excluded[element];
            let Some(Look { ratio, px, share, .. }) = look else { return was };
            if was {
                return times[element] >= TIMES || (ratio > BACK_RATIO && (px > BACK_PX || share > BACK_SHARE));
            }
            let out = ratio > OUT_RATIO && (px > OUT_PX || share > OUT_SHARE);
            times[element] += u8::from(out);
            out
        };
        looks.into_iter().enumerate().map(is_out).collect()
    }

    /// Whether so much of a zone is out of the sums that nothing can be said of it; `elements` are those that count.
    /// Those zones do not matter that are `lost` anyway.
    pub(crate) fn is_gone(&self, elements: &[ElementMatch], lost: &[bool]) -> bool {
        let Level { mesh, moments, .. } = &self.levels[0];
        (0..mesh.zones().len()).filter(|&zone| !lost[zone]).any(|zone| {
            let in_use = || mesh.zone_elements(zone).filter(|&element| moments[element].n > 0.0);
            let (all, left) = (in_use().count(), in_use().filter(|&element| elements[element].n > 0.0).count());
            (left as f64) < LEAST_LEFT * all as f64
        })
    }

    /// Leaves out the elements that do not match, until the rest has converged without them; `excluded` are those that
    /// are left out already. Of a frame whose elements all match only the test is made.
    pub(crate) fn screen(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        Iterated { outcome, found, light, excluded, lost }: &mut Iterated<B>,
    ) -> Result<()> {
        let level = &self.levels[0];
        let Level { mesh, prepared, .. } = level;
        // What has not settled tells little of its elements: that is for the second try.
        if outcome.status != Status::Converged {
            return Ok(());
        }
        let mut times = vec![0u8; mesh.n_elements()];
        let mut astray = vec![false; mesh.n_elements()];
        let mut came_back = astray.clone();
        for _ in 0..ROUNDS {
            let any = excluded.contains(&true);
            let elements = if any {
                found.displacement = continue_field(mesh, &found.displacement, &found.elements);
                self.backend.place(prepared, frame, field, &found.displacement)?;
                self.backend.observe(prepared, frame, field)?;
                self.backend.all_sums(prepared, frame, field)?.iter().map(ElementMatch::from).collect()
            } else {
                found.elements.clone()
            };
            let mut next = self.choose_mismatched(&elements, found, excluded, &mut times);
            if next == *excluded && outcome.status == Status::Converged && astray.contains(&true) {
                // The rest has settled: what only hindered it may come back, once.
                for element in 0..mesh.n_elements() {
                    if std::mem::take(&mut astray[element]) {
                        (times[element], came_back[element]) = (TIMES - 1, true);
                    }
                }
                next = self.choose_mismatched(&elements, found, excluded, &mut times);
            }
            if any {
                let at = std::mem::take(&mut found.displacement);
                *found = Found { displacement: at, ..self.backend.read_field(prepared, frame, field)? };
            }
            if next == *excluded {
                break;
            }
            let before = found.displacement.clone();
            *excluded = next;
            self.backend.exclude(prepared, frame, field, excluded)?;
            let mut iterations = outcome.iterations;
            for tries in 1.. {
                let limits = self.rest_limits(outcome.turn);
                *outcome = match light.as_mut() {
                    Some(light) => self.iterate_in_light(frame, field, light, found, limits)?,
                    None => iterate(&self.backend, level, frame, field, limits, &self.kernel, nothing)?,
                };
                iterations += outcome.iterations;
                outcome.iterations = iterations;
                if outcome.status == Status::Converged || tries == TRIES {
                    break;
                }
                // What has too few neighbours left to be held by goes as well.
                for element in self.leave_out_astray(frame, field, &before, outcome, excluded, tries)? {
                    (times[element], astray[element]) = (TIMES, !came_back[element]);
                }
            }
            *found = self.backend.read_field(prepared, frame, field)?;
            if outcome.status == Status::Diverged || self.is_gone(&found.elements, lost) {
                break;
            }
        }
        Ok(())
    }

    pub(crate) fn rest_limits(&self, turn: Turn) -> Limits<'_> {
        let limits = self.limits(turn);
        let max_iterations = limits.max_iterations.min(REST_ITERATIONS);
        Limits { own: true, enough_anywhere: true, max_iterations, ..limits }
    }

    /// After an iteration of the elements that are left: where it has not settled, iterates on without those around
    /// nodes that have gone astray from `safe` or still move, until the rest has or nothing is left.
    pub(crate) fn iterate_without_astray(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        safe: &[[f64; 2]],
        mut outcome: Outcome<B>,
        excluded: &mut [bool],
    ) -> Result<Outcome<B>> {
        let level = &self.levels[0];
        let lost = self.lost_zones(excluded);
        for tries in 1..TRIES {
            if outcome.status == Status::Converged {
                break;
            }
            self.leave_out_astray(frame, field, safe, &outcome, excluded, tries)?;
            if self.is_gone(&self.backend.read_field(&level.prepared, frame, field)?.elements, &lost) {
                break;
            }
            let (limits, before) = (self.rest_limits(outcome.turn), outcome.iterations);
            outcome = iterate(&self.backend, level, frame, field, limits, &self.kernel, nothing)?;
            outcome.iterations += before;
        }
        Ok(outcome)
    }

    /// After an iteration that has not settled: leaves out the elements around nodes that have gone astray from `safe`
    /// or still move, and puts the field back there. What has run away has taken its neighbourhood along: of that
    /// only the nodes that ran furthest go, and all go back. The elements that are left out now.
    fn leave_out_astray(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        safe: &[[f64; 2]],
        outcome: &Outcome<B>,
        excluded: &mut [bool],
        tries: i32,
    ) -> Result<Vec<usize>> {
        let settled_px = SETTLED_PX * 0.5f64.powi(tries - 1);
        let level = &self.levels[0];
        let prepared = &level.prepared;
        let now = self.backend.read_field(prepared, frame, field)?.displacement;
        let ran_away = outcome.status == Status::Diverged;
        let mut then = now.clone();
        if !ran_away {
            let one = Limits { max_iterations: 1, ..self.rest_limits(outcome.turn) };
            iterate(&self.backend, level, frame, field, one, &self.kernel, nothing)?;
            then = self.backend.read_field(prepared, frame, field)?.displacement;
        }
        let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        let furthest = now.iter().zip(safe).map(off).filter(|off| off.is_finite()).fold(0.0, f64::max);
        let limit = if ran_away { ASTRAY_PX.max(AWAY * furthest) } else { ASTRAY_PX };
        let is_astray = |node: usize| {
            // What is no number is astray as well.
            let is_near = off((&now[node], &safe[node])) < limit && off((&now[node], &then[node])) < settled_px;
            node == outcome.worst_node || !is_near
        };
        let astray: Vec<bool> = (0..now.len()).map(is_astray).collect();
        let mut left_out = Vec::new();
        for (element, nodes) in self.mesh().elements().iter().enumerate() {
            if !excluded[element] && nodes.iter().any(|&node| astray[node as usize]) {
                excluded[element] = true;
                left_out.push(element);
            }
        }
        let back = |node: usize| if ran_away || astray[node] { safe[node] } else { then[node] };
        let displacement: Vec<[f64; 2]> = (0..now.len()).map(back).collect();
        self.backend.place(prepared, frame, field, &displacement)?;
        self.backend.observe(prepared, frame, field)?;
        self.backend.exclude(prepared, frame, field, excluded)?;
        Ok(left_out)
    }

    /// The penalty that keeps a level smooth while its elements are told apart; none without a scale for it.
    fn smoother(&self, level: usize) -> Option<Regulariser> {
        let Level { mesh, moments, pattern, keep, lambda, .. } = &self.levels[level];
        let cutoff_px = SMOOTH_ELEMENTS * mesh.element_size();
        let smooth = Regularisation::EquilibriumGap { cutoff_px, poisson: Regularisation::POISSON };
        let matrix = without_noise(mesh, pattern, &OfElement::all(mesh, moments, &self.kernel, *lambda));
        let active: Vec<bool> = moments.iter().map(|moments| moments.n > 0.0).collect();
        let texture = PenaltyScale { matrix: &matrix, support: &support(pattern, moments), seen: keep };
        Regulariser::new(smooth, mesh, pattern, &active, &texture, mesh.n_nodes() <= FACTORED_UP_TO)
    }

    /// [`Correlator::descend_pyramid`] from the search, smoothly as long as it is not known what does not match.
    pub(crate) fn smooth_pyramid(
        &self,
        frame: &mut B::Frame,
        displacement: Vec<[f64; 2]>,
        transfer: Vec<GreyTransfer>,
        lost: &[bool],
    ) -> Result<Correlation> {
        let top = &self.levels[self.levels.len() - 1];
        let mut field = self.backend.start(&top.prepared, frame, &displacement, &transfer)?;
        let mut iterations = 0;
        for (at, pair) in self.levels.windows(2).enumerate().rev() {
            let [finer, level] = pair else { continue };
            let prepared = &level.prepared;
            let smoother = self.smoother(at + 1);
            let limits = self.smooth_limits(smoother.as_ref());
            let given_up = elements_of(&level.mesh, lost);
            if given_up.contains(&true) {
                self.backend.exclude(prepared, frame, &mut field, &given_up)?;
            }
            self.backend.observe(prepared, frame, &mut field)?;
            let mut moved = true;
            // Once with all elements, and once without those that do not match.
            for round in 0..2 {
                if round > 0 {
                    let poor = find_poor(&level.mesh, &self.backend.read_field(prepared, frame, &field)?.elements);
                    if !poor.contains(&true) {
                        break;
                    }
                    let poor: Vec<bool> = poor.iter().zip(&given_up).map(|(poor, lost)| *poor || *lost).collect();
                    self.backend.exclude(prepared, frame, &mut field, &poor)?;
                }
                let outcome = iterate(&self.backend, level, frame, &mut field, limits, &self.kernel, nothing)?;
                iterations += outcome.iterations;
                moved = outcome.status != Status::Diverged;
                if !moved {
                    break;
                }
            }
            field = self.backend.start_finer(&finer.prepared, frame, &field, moved)?;
        }
        let (displacement, transfer) = self.backend.read_start(&self.levels[0].prepared, frame, &field)?;
        let left_out = numbers(&elements_of(self.mesh(), lost));
        self.try_smoothly(frame, &Start { displacement, transfer, left_out }, StartUsed::Cold, iterations)
    }

    /// Whether a frame that has not converged is tried once more: who allows only a few iterations does not want it.
    pub(crate) fn may_try_again(&self) -> bool {
        self.options.max_iterations >= SMOOTH_ITERATIONS
    }

    fn smooth_limits<'a>(&self, regulariser: Option<&'a Regulariser>) -> Limits<'a> {
        Limits {
            tolerance_px: SMOOTH_TOLERANCE_PX,
            max_iterations: SMOOTH_ITERATIONS,
            own: true,
            regulariser,
            wild_elements: WILD_SMOOTH_ELEMENTS,
            // The penalty is not turned with the corrections.
            turn: Turn::NONE,
            ..COARSE
        }
    }

    /// A second try of a frame, from `from`: smoothly until what does not match is known, then without it.
    pub(crate) fn try_smoothly(
        &self,
        frame: &mut B::Frame,
        from: &Start,
        start: StartUsed,
        coarse_iterations: usize,
    ) -> Result<Correlation> {
        let level = &self.levels[0];
        let Level { mesh, prepared, .. } = level;
        let smoother = self.smoother(0);
        let (mut field, LeftOut { elements: mut excluded, zones }) = self.start_field(frame, from)?;
        self.backend.observe(prepared, frame, &mut field)?;
        let mut times = vec![0u8; mesh.n_elements()];
        let mut iterations = 0;
        for _ in 0..ROUNDS / 2 {
            let limits = self.smooth_limits(smoother.as_ref());
            let mut outcome = iterate(&self.backend, level, frame, &mut field, limits, &self.kernel, nothing)?;
            iterations += outcome.iterations;
            if outcome.status == Status::Diverged {
                outcome.iterations = iterations;
                // That of the penalty is no matrix of the frame.
                outcome.own = None;
                let left_out = LeftOut { elements: excluded, zones };
                return self.finish(frame, &mut field, outcome, start, coarse_iterations, left_out);
            }
            let found = self.backend.read_field(prepared, frame, &field)?;
            let all = self.backend.all_sums(prepared, frame, &field)?;
            let elements: Vec<ElementMatch> = all.iter().map(ElementMatch::from).collect();
            let next = self.choose_mismatched(&elements, &found, &excluded, &mut times);
            if next == excluded {
                break;
            }
            excluded = next;
            // What was pulled along by something else goes where the field around it is.
            let mut counted = elements;
            counted.iter_mut().zip(&excluded).filter(|(_, out)| **out).for_each(|(element, _)| element.n = 0.0);
            let displacement = continue_field(mesh, &found.displacement, &counted);
            self.backend.place(prepared, frame, &mut field, &displacement)?;
            self.backend.observe(prepared, frame, &mut field)?;
            self.backend.exclude(prepared, frame, &mut field, &excluded)?;
        }
        let safe = self.backend.read_field(prepared, frame, &field)?.displacement;
        let limits = self.rest_limits(self.turn(level, &safe));
        let mut outcome = iterate(&self.backend, level, frame, &mut field, limits, &self.kernel, nothing)?;
        outcome.iterations += iterations;
        let outcome = self.iterate_without_astray(frame, &mut field, &safe, outcome, &mut excluded)?;
        self.finish(frame, &mut field, outcome, start, coarse_iterations, LeftOut { elements: excluded, zones })
    }
}

/// Elements that match much worse than those of their zone do.
fn find_poor(mesh: &Mesh<Px>, elements: &[ElementMatch]) -> Vec<bool> {
    let mut poor = vec![false; elements.len()];
    for zone in 0..mesh.zones().len() {
        let mut sorted: Vec<f64> =
            mesh.zone_elements(zone).filter(|&e| elements[e].n > 0.0).map(|e| elements[e].correlation).collect();
        sorted.sort_by(f64::total_cmp);
        // The better half says what a match is: most of a zone may be covered.
        let Some(&good) = sorted.get(sorted.len() * 3 / 4) else { continue };
        mesh.zone_elements(zone).for_each(|e| poor[e] = elements[e].n > 0.0 && elements[e].correlation < 0.6 * good);
    }
    poor
}
