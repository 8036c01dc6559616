//! How corrections fall from iteration to iteration, what is still to come of them, and how long the next step is.

/// The iteration is never taken to converge faster than this, for the estimate of what is still to come.
const FASTEST: f64 = 0.1;
/// A correction that falls by less than this has stalled.
const STALLED: f64 = 0.8;
/// Corrections that fall by a rate between these, twice the same as far as it matters, fall slowly and evenly: one mode
/// is left.
const SLOW: [f64; 2] = [0.5, 0.97];
/// Two rates are the same when they differ by less than this share of what they are below 1.
const EVEN: f64 = 0.1;
/// No step that is longer than its correction moves a node by more than this, px.
const LONGEST_PX: f64 = 0.25;
/// Corrections that have not been halved in so many iterations fall slowly, or not at all: nodes wander where the
/// images have nothing in common.
const UNHALVED: usize = 8;

/// What is amiss with the steps where corrections fall slowly and evenly.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Steps {
    /// They overshoot: nodes that see more contrast in the deformed image than in the reference, whose matrix is too
    /// soft for it. Taken for granted at first, since a shorter step does no harm.
    TooLong,
    /// They fall short: nodes at which the two images have little texture in common, so that the matrix is too stiff.
    TooShort,
    /// Neither helps.
    AsTheyAre,
}

/// A step of another length, until its effect is seen.
#[derive(Debug, Clone, Copy)]
struct Changed {
    /// By which corrections fell,
    rate: f64,
    /// and the correction after it if it had been as the others.
    expected: f64,
}

pub(crate) struct Pace {
    /// The last two corrections, the latest first; infinite where there were none.
    before: [f64; 2],
    /// By what the last one fell.
    ratio: f64,
    stalls: usize,
    /// What the correction of the step that comes next, or is being made, is multiplied by.
    pub factor: f64,
    /// Whether all steps have their whole length: what is made of them is another's affair.
    pub is_whole: bool,
    steps: Steps,
    changed: Option<Changed>,
    /// The last correction that was half of those before it, and how many came after it.
    halved: (f64, usize),
    /// The slowest rate of which a step of another length has hidden what is left.
    least_rate: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            before: [f64::INFINITY; 2],
            ratio: f64::NAN,
            stalls: 0,
            factor: 1.0,
            is_whole: false,
            steps: Steps::TooLong,
            changed: None,
            halved: (f64::INFINITY, 0),
            least_rate: FASTEST,
        }
    }
}

impl Pace {
    /// So many steps have the same length, whatever the corrections: two of these have to fall alike before one is
    /// another.
    pub const SAME: usize = 3;

    pub fn last(&self) -> f64 {
        self.before[0]
    }

    /// What the corrections still to come add up to, after `correction`.
    ///
    /// Where light follows one iteration late, corrections fall unevenly: what repeats is two of them, by the rate
    /// `q = c(k) / c(k-2)`, and still to come is `(c(k-1) + c(k)) q / (1 - q)`, of even ones the sum of their series.
    /// Where light is solved along they fall evenly (`is_even`), and the second tells the rate. None is taken below
    /// [`FASTEST`], since they may fall fast by chance, nor below a rate of which another step has hidden what is left.
    pub fn left(&self, correction: f64, is_even: bool) -> f64 {
        let [last, one_before] = self.before;
        let series = |rate: f64| rate / (1.0 - rate);
        let ratio = |earlier: f64| if earlier > 0.0 { (correction / earlier).min(0.99) } else { 0.0 };
        let by_last = correction * series(ratio(last).max(self.least_rate));
        match (last.is_finite(), one_before.is_finite()) {
            (false, _) => correction.max(by_last), // the first: as if each were half of the one before
            (true, false) if is_even => by_last,
            (true, false) => by_last.max((last + correction) * series(ratio(last))),
            (true, true) => by_last.max((last + correction) * series(ratio(one_before))),
        }
    }

    /// Iterations until a correction falls to `target`, by the one two iterations ago; infinite if it does not fall.
    pub fn iterations_left(&self, correction: f64, target: f64) -> f64 {
        let earlier = self.before[1];
        if correction <= target {
            return 0.0;
        }
        if correction < earlier {
            2.0 * (target / correction).ln() / (correction / earlier).ln()
        } else {
            f64::INFINITY
        }
    }

    /// Whether corrections are halved too seldom to fall to `target` within `iterations`: told by the last that was
    /// half of those before it, which ups and downs and steps of another length do not hide.
    pub fn is_halved_too_seldom(&self, target: f64, iterations: usize) -> bool {
        let (correction, since) = self.halved;
        since >= UNHALVED && (0.5 * correction / target).log2() * since as f64 > iterations as f64
    }

    /// Notes the `correction` made and chooses the next step; `anew` where what it was found with has changed.
    pub fn note(&mut self, correction: f64, anew: bool) {
        let made = std::mem::replace(&mut self.factor, 1.0);
        let ratio = correction / self.before[0];
        self.before = [correction, self.before[0]];
        let (halved, since) = self.halved;
        self.halved = if correction < 0.5 * halved { (correction, 0) } else { (halved, since + 1) };
        if self.is_whole {
            return;
        }
        if let Some(Changed { rate, expected }) = self.changed {
            // Corrections from before the step say nothing of those after it.
            if made != 1.0 {
                self.before = [f64::INFINITY; 2];
                return;
            }
            // A correction that was found anew says nothing of the step before it.
            if correction >= expected && !anew {
                self.steps = match self.steps {
                    Steps::TooLong => Steps::TooShort,
                    _ => Steps::AsTheyAre,
                };
            }
            (self.changed, self.ratio, self.stalls) = (None, rate, 0);
            return;
        }
        // What grows evenly changes its sign each time: steps that are more than twice too long.
        let grows = ratio > SLOW[1] && self.ratio > SLOW[1];
        let even = if grows { EVEN * (1.0 + ratio) } else { EVEN * (1.0 - ratio) };
        let is_even = (ratio - self.ratio).abs() < even && !anew;
        self.ratio = if anew { f64::NAN } else { ratio };
        self.stalls = if ratio > STALLED { self.stalls + 1 } else { 0 };
        let factor = match self.steps {
            _ if is_even && grows => Some(1.0 / (1.0 + ratio)),
            _ if !is_even || !(SLOW[0]..=SLOW[1]).contains(&ratio) => None,
            Steps::TooLong => Some(1.0 / (1.0 + ratio)),
            Steps::TooShort => Some(1.0 / (1.0 - ratio)).filter(|factor| factor * ratio * correction < LONGEST_PX),
            Steps::AsTheyAre => None,
        };
        if let Some(factor) = factor {
            self.factor = factor;
            // Of what has grown nothing is hidden: the corrections after the step are larger than the error left.
            let expected = if grows { f64::INFINITY } else { ratio * ratio * correction };
            self.changed = Some(Changed { rate: ratio, expected });
            self.least_rate = if grows { self.least_rate } else { self.least_rate.max(ratio) };
        } else if self.stalls == 3 {
            // What comes back with the other sign each time, nearly as large, is an overshoot somewhere: one half step
            // settles it. More of them would only slow down what approaches from one side.
            self.factor = 0.5;
            self.changed = Some(Changed { rate: ratio, expected: f64::INFINITY });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Pace, Steps};

    /// Steps, and the error left, until a field of modes that fall by these rates is said to be below the tolerance.
    fn run(modes: &[(f64, f64)], tolerance: f64) -> (usize, f64) {
        let mut errors: Vec<f64> = modes.iter().map(|mode| mode.0).collect();
        let mut pace = Pace::default();
        for iteration in 1..200 {
            let corrections: Vec<f64> = errors.iter().zip(modes).map(|(e, mode)| e * (1.0 - mode.1)).collect();
            let correction = corrections.iter().fold(0.0f64, |most, c| most.max(c.abs()));
            errors.iter_mut().zip(&corrections).for_each(|(e, c)| *e -= pace.factor * c);
            if pace.left(correction, true) < tolerance {
                return (iteration, errors.iter().fold(0.0f64, |most, e| most.max(e.abs())));
            }
            pace.note(correction, false);
        }
        panic!("no end of {modes:?}");
    }

    #[test]
    fn what_falls_by_a_tenth_each_time_needs_as_many_iterations_as_tenths() {
        // Two iterations ago it was 1 / 0.9^2 of what it is: 44 more take it to a hundredth, ln 0.01 / ln 0.9 = 43.7.
        let left = |correction: f64, earlier: f64| {
            Pace { before: [f64::NAN, earlier], ..Pace::default() }.iterations_left(correction, 1e-4)
        };
        assert!((left(1e-2, 1e-2 / 0.81) - 43.7).abs() < 0.05, "{}", left(1e-2, 1e-2 / 0.81));
        assert_eq!(
            [(1e-5, 1e-2), (1e-2, 1e-2), (2e-2, 1e-2)].map(|(c, e)| left(c, e)),
            [0.0, f64::INFINITY, f64::INFINITY]
        );
    }

    #[test]
    fn the_first_steps_have_their_whole_length_whatever_the_corrections() {
        let corrections = [1e-3, 0.04, 0.06, 0.5, 0.98, 1.0, 1.3, f64::INFINITY];
        for (first, second) in corrections.iter().flat_map(|first| corrections.map(|second| (*first, second))) {
            for anew in [false, true] {
                let mut pace = Pace::default();
                for correction in [first, second].into_iter().take(Pace::SAME - 1) {
                    assert_eq!(pace.factor, 1.0);
                    pace.note(correction, anew);
                }
                assert_eq!(pace.factor, 1.0, "{first} {second} {anew}");
            }
        }
        let mut pace = Pace::default();
        [1.0, 0.5, 0.25].into_iter().for_each(|c| pace.note(c, false));
        assert_ne!(pace.factor, 1.0, "the one after them need not");
    }

    #[test]
    fn steps_that_are_to_be_whole_stay_so_and_hide_nothing_of_what_is_left() {
        let mut pace = Pace { is_whole: true, ..Pace::default() };
        for k in 0..12 {
            pace.note(0.9f64.powi(k), false);
            assert_eq!(pace.factor, 1.0);
        }
        // Two that fall by a hundredth: nothing of the slow ones before is left.
        [1e-3, 1e-5].into_iter().for_each(|c| pace.note(c, false));
        assert!(pace.left(1e-7, false) < 1e-7, "{}", pace.left(1e-7, false));
    }

    #[test]
    fn a_step_of_another_length_is_judged_by_what_comes_after_it_unless_that_was_found_anew() {
        // Corrections that fall evenly by a half: the third brings a step of 1 / 1.5 of its length.
        let after_a_changed_step = |correction: f64, anew: bool| {
            let mut pace = Pace::default();
            [1.0, 0.5, 0.25].into_iter().for_each(|c| pace.note(c, false));
            assert_eq!(pace.factor, 1.0 / 1.5);
            pace.note(0.125, false); // made with it
            pace.note(correction, anew);
            pace.steps
        };
        // The next would have been 0.25 * 0.5^2 with steps as they were.
        assert_eq!(after_a_changed_step(0.05, false), Steps::TooLong);
        assert_eq!(after_a_changed_step(0.07, false), Steps::TooShort);
        assert_eq!(after_a_changed_step(0.07, true), Steps::TooLong);
    }

    #[test]
    fn corrections_that_are_not_halved_in_time_end_an_iteration_and_others_do_not() {
        let ends = |corrections: &dyn Fn(i32) -> f64, most: usize| {
            let mut pace = Pace::default();
            (0..most).position(|k| {
                pace.note(corrections(k as i32), false);
                pace.is_halved_too_seldom(1e-4, most - k)
            })
        };
        // Up and down from the first on, and after they have fallen to 3 px once.
        assert_eq!(ends(&|k| [4.0, 7.0, 5.0][k as usize % 3], 50), Some(8));
        assert_eq!(ends(&|k| if k < 4 { 48.0 / 2.5f64.powi(k) } else { 4.0 + f64::from(k % 2) }, 50), Some(11));
        // By 7 % each time a hundredth is not reached in 50 iterations, but in 100.
        let slow = |k: i32| 1e-2 * 0.93f64.powi(k);
        assert_eq!((ends(&slow, 50), ends(&slow, 100)), (Some(8), None));
        // Every second one larger than before, by the same rate; and by a tenth each time, which halves them in seven.
        assert_eq!(ends(&|k| slow(k) * [1.0, 1.3][k as usize % 2], 50), Some(8));
        assert_eq!(ends(&|k| 40.0 * 0.9f64.powi(k), 50), None);
    }

    #[test]
    fn a_slow_mode_is_ended_by_one_step_and_the_error_left_is_below_the_tolerance() {
        // The rate of an open hole under load (-0.74), with modes that fall fast, and others, also two at once. With
        // steps as they are the tolerance takes ln(1e-4) / ln(rate) iterations: 31 at 0.74, 57 at 0.85.
        for (slow, most) in [
            (-0.6, 8),
            (-0.74, 9),
            (-0.85, 9),
            (-0.93, 10),
            (-1.05, 11),
            (-1.4, 12),
            (-2.2, 12),
            (0.6, 10),
            (0.74, 11),
            (0.85, 11),
            (0.93, 12),
            (0.96, 13),
        ] {
            let (iterations, error) = run(&[(1.0, 0.03), (0.3, 0.2), (0.2, slow)], 1e-4);
            assert!(iterations <= most && error <= 1e-4, "{slow}: {iterations} iterations, {error:.1e}");
        }
        for pair in [[0.6, 0.85], [0.7, 0.8], [0.5, 0.9], [-0.5, 0.8], [-0.7, -0.8], [-0.6, 0.7], [-0.74, 0.5]] {
            let (iterations, error) = run(&[(1.0, 0.03), (0.2, pair[0]), (0.2, pair[1])], 1e-4);
            assert!(iterations <= 20 && error <= 1e-4, "{pair:?}: {iterations} iterations, {error:.1e}");
        }
    }
}
