//! The fit of several tests: search, what noise and constants do, what each test tells.

use super::case::{CombinedCase, TestCase};
use super::consistency::Consistency;
use super::known::{Known, LedTogether};
use super::made::Made;
use super::misfit::{Judged, misfits};
use super::released::release;
use super::search::{Found, Searched, search};
use super::share::{TestShare, shares};
use super::verdict::{OfTests, verdict};
use crate::identify::solve::fit::{compare, correlation_of, describe, reasons_unfinished};
use crate::identify::{
    CutShort, Evaluation, Fit, FitError, Grounds, LARGEST_STD, Misfit, MissingMode, Refined, Released, Rotations,
    Statistics, Verdict, extrapolated, implausible_result,
};
use crate::io::case::Discretisation;

/// One test in a fit of several.
#[derive(Debug)]
pub struct TestFit {
    /// What it tells.
    pub share: TestShare,
    /// The fit as this test sees it: parameters, uncertainties, budget and verdict are those of all tests together;
    /// objective, misfit, displacements and tractions its own.
    pub fit: Fit,
}

/// A fit of several tests.
#[derive(Debug)]
pub struct CombinedFit {
    /// The tests, in the order of the case.
    pub tests: Vec<TestFit>,
    /// The objective of all, each in units of its noise.
    pub omega: f64,
    /// Whether the data of all tests contradict the model; `None` without covariance.
    pub misfit: Option<Misfit>,
    /// Whether the tests agree on the parameters; `None` where two of them do not tell the same, or their noise is not
    /// known.
    pub consistency: Option<Consistency>,
}

impl CombinedFit {
    /// Parameters, uncertainties and verdict, as the first test sees them.
    pub fn fit(&self) -> &Fit {
        &self.tests[0].fit
    }
}

/// Whether the data contradict the model, as far as that was looked at.
#[derive(Default)]
struct Doubts {
    misfits: Vec<Misfit>,
    total: Option<Misfit>,
    consistency: Option<Consistency>,
    released: Option<Released>,
}

/// Fits the unknowns that the tests of `case` share.
///
/// # Errors
/// See [`FitError`]. Not converging is an outcome.
pub fn fit_combined(case: &CombinedCase<'_>) -> Result<CombinedFit, FitError> {
    let tests: Vec<Searched<'_>> = (case.tests.iter())
        .map(|TestCase { name, case }| Searched { name, problem: &case.problem, options: &case.options })
        .collect();
    let first = tests[0].problem;
    let (unknowns, options) = (&first.unknowns, tests[0].options);
    let starts = options.starts_of(unknowns);
    let found = search(&tests, &starts, &options.region, |ends| compare(unknowns, &starts, ends).0)?;
    if found.ends[found.best].local.is_none() {
        let (start, reason) = (describe(unknowns, &unknowns.start()), found.ends[found.best].reason.clone());
        return Err(FitError::NoStart { start, reason });
    }
    let known = Known::at(&tests, &found.weights, &found.stage.z)?;
    let mut missing = Vec::new();
    first.watch.begins("element size");
    let refined: Vec<Option<Refined>> = (tests.iter().zip(&known.evaluations))
        .map(|(test, evaluation)| match test.options.discretisation {
            Discretisation::Off => None,
            _ => test.problem.refine(evaluation, &test.problem.border.boundary),
        })
        .collect();
    if first.watch.ended().is_some() && refined.iter().any(Option::is_none) {
        missing.push("the effect of the element size");
    }
    let made = Made::new(&tests, &case.constants, &found.weights, &known, &refined);
    let end = AtEnd { tests, starts, found, known, refined, made };
    let doubts = match &end.known.led {
        Some(led) if !end.found.stage.status.cut_short() => {
            let doubts = end.doubt(led)?;
            if first.watch.ended().is_some() {
                missing.push("what the prescribed parameters would be as unknowns");
            }
            doubts
        }
        Some(_) => {
            missing.push("the misfit test");
            Doubts::default()
        }
        None => Doubts::default(),
    };
    let cut_short = first.watch.ended().map(|ended| CutShort { ended, missing });
    end.put_together(doubts, cut_short)
}

/// The search of several tests at its end, with what is known there.
struct AtEnd<'a> {
    tests: Vec<Searched<'a>>,
    starts: Vec<Vec<f64>>,
    found: Found,
    known: Known,
    refined: Vec<Option<Refined>>,
    made: Made,
}

impl AtEnd<'_> {
    /// The misfit of each test and of all, whether they agree, and what the prescribed parameters would be.
    fn doubt(&self, led: &LedTogether) -> Result<Doubts, FitError> {
        let Self { tests, found, known, refined, made, .. } = self;
        let watch = &tests[0].problem.watch;
        watch.begins("misfit");
        let of_test = |k: usize| Judged {
            name: tests[k].name,
            problem: tests[k].problem,
            evaluation: &known.evaluations[k],
            weights: &found.weights[k].weights,
            statistics: &led.statistics[k],
            refined: refined[k].as_ref().map(|refined| refined.change.as_slice()),
            effects: &made.effects[k],
        };
        let (misfits, total, consistency) = misfits(&(0..tests.len()).map(of_test).collect::<Vec<_>>())?;
        watch.begins("prescribed parameters as unknowns");
        let released = release(tests, &found.weights, &known.evaluations[0], known.sum.omega)?;
        let released = released.filter(|_| watch.ended().is_none());
        Ok(Doubts { misfits, total: Some(total), consistency, released })
    }

    fn judge(&self, shares: &[TestShare], doubts: &Doubts, cut_short: Option<&CutShort>) -> Verdict {
        let Self { tests, found, known, made, .. } = self;
        let first = tests[0].problem;
        let unfinished = reasons_unfinished(found.stage.status, cut_short, &first.unknowns, &known.evaluations[0].x);
        let statistics: Option<&Statistics> = known.led.as_ref().map(|led| &led.statistics[0]);
        let correlation = statistics.map(|statistics| correlation_of(&statistics.covariance, Some(statistics)));
        let prescribed =
            doubts.released.as_ref().map_or(Vec::new(), |released| first.prescribed_std(released, &made.constants));
        let mut given: Vec<String> = Vec::new();
        for line in tests.iter().flat_map(|test| test.problem.given()) {
            if !given.contains(&line) {
                given.push(line);
            }
        }
        // The one that is furthest off.
        let ratios = tests.iter().filter_map(|test| test.problem.noise.ratio);
        let ratio = ratios.max_by(|a, b| a.ln().abs().total_cmp(&b.ln().abs()));
        let grounds = correlation.as_ref().map(|correlation| Grounds {
            correlation,
            intervals: made.intervals.as_ref(),
            misfit: doubts.total.as_ref(),
            released: doubts.released.as_ref(),
            width: None,
            along: None,
            released_std: &prescribed,
            noise_ratio: ratio,
            given,
            unfinished: unfinished.clone(),
            missing: self.missing_mode(),
        });
        let of = OfTests {
            parameters: &made.parameters,
            shares,
            misfits: &doubts.misfits,
            consistency: doubts.consistency.as_ref(),
        };
        verdict(&of, grounds.as_ref(), unfinished)
    }

    /// The mode that none of the tests has, and that would tell what all of them together tell worst.
    fn missing_mode(&self) -> Option<MissingMode> {
        let known = &self.known;
        let noise = known.led.as_ref().map(|led| &led.statistics[0].covariance);
        let of_test = |(test, evaluation): (&Searched<'_>, &Evaluation)| {
            test.problem.missing_mode(evaluation, &known.sum.h, noise, LARGEST_STD)
        };
        let modes: Vec<MissingMode> = self.tests.iter().zip(&known.evaluations).map(of_test).collect::<Option<_>>()?;
        let missing = modes.iter().all(|mode| mode.missing.is_some()).then_some(modes[0].missing)?;
        // The share of one test would tell nothing of all.
        Some(MissingMode { opening_share: None, missing })
    }

    /// What finite rotations would change, where that is asked for: every test moves the parameters of all.
    fn turn(&self) -> Option<Rotations> {
        let Self { tests, known: Known { evaluations, led, .. }, .. } = self;
        let is_asked = |test: &Searched<'_>| test.problem.is_small() && test.options.judge_rotations;
        let led = led.as_ref().filter(|_| tests.iter().any(is_asked) && tests[0].options.doubt)?;
        let slopes = tests[0].problem.unknowns.slopes(&evaluations[0].x);
        let mut sum = Some(vec![0.0; slopes.len()]);
        for (k, test) in tests.iter().enumerate().filter(|(_, test)| is_asked(test)) {
            let moved = test.problem.turn(&evaluations[k], &test.problem.border.boundary);
            sum = sum.zip(moved).map(|(mut sum, moved)| {
                sum.iter_mut().zip(led.statistics[k].shift(&moved)).for_each(|(sum, z)| *sum += z);
                sum
            });
        }
        Some(Rotations::new(sum, &slopes))
    }

    /// The fit as each test sees it.
    fn put_together(self, doubts: Doubts, cut_short: Option<CutShort>) -> Result<CombinedFit, FitError> {
        let shares = shares(&self.tests, &self.known);
        let verdict = self.judge(&shares, &doubts, cut_short.as_ref());
        let rotations = if cut_short.is_none() { self.turn() } else { None };
        let Self { tests, starts, found, known, refined, made } = self;
        let unknowns = &tests[0].problem.unknowns;
        let starts = compare(unknowns, &starts, &found.ends).1;
        let history: Vec<_> = found.stage.history.into_iter().map(|iteration| iteration.unscaled(unknowns)).collect();
        let singular_values = known.sum.singular_values()?;
        let law = unknowns.law_at(&known.evaluations[0].x)?;
        let verdict = verdict.with_rotations(rotations.as_ref(), &made.parameters);
        let of_law = |k: usize| {
            let mut remarks = implausible_result(tests[k].problem, &*law);
            // One law for all tests: said once.
            remarks.extend((k == 0).then(|| extrapolated(&*law, made.furthest)).flatten());
            remarks
        };
        let mut statistics = known.led.map(|led| led.statistics.into_iter());
        let mut list = Vec::with_capacity(tests.len());
        for (k, (evaluation, share)) in known.evaluations.into_iter().zip(shares).enumerate() {
            let statistics = statistics.as_mut().and_then(Iterator::next);
            let fit = Fit {
                parameters: made.parameters.clone(),
                values: law.values(),
                derived: made.derived.clone(),
                furthest: made.furthest,
                covariance: made.covariance.clone(),
                correlation: made.covariance.as_ref().map(|c| correlation_of(c, statistics.as_ref())),
                singular_values: singular_values.clone(),
                omega: share.omega,
                status: found.stage.status,
                reason: found.stage.reason.clone(),
                evaluations: found.stage.evaluations,
                rescued: found.stage.rescued,
                history: history.clone(),
                starts: starts.clone(),
                misfit: doubts.misfits.get(k).cloned(),
                released: doubts.released.clone(),
                width: None,
                along: None,
                verdict: verdict.clone(),
                statistics,
                constants: made.effects[k].clone(),
                budget: made.budget.clone(),
                remarks: of_law(k),
                intervals: made.intervals.clone(),
                refinement: made.refinement(refined[k].as_ref()),
                rotations: rotations.clone(),
                evaluation,
                boundary: tests[k].problem.border.boundary.clone(),
                largest_correction: None,
                cut_short: cut_short.clone(),
                axes: None,
            };
            list.push(TestFit { share, fit });
        }
        let Doubts { total: misfit, consistency, .. } = doubts;
        Ok(CombinedFit { tests: list, omega: known.sum.omega, misfit, consistency })
    }
}
