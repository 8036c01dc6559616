//! What becomes of the parameters that several tests share: budget, covariance, intervals.

use super::known::Known;
use super::search::{Searched, TestWeights};
use super::sources::{CombinedConstant, Contribution, effects};
use crate::identify::{
    Base, Budget, Constant, ConstantEffect, Fitted, FittedParameter, FittedQuantity, Ingredients, IntervalBasis,
    NOISE_LEVEL, Refined, Refinement, Source, assess, doubts, furthest, settle, work_along,
};
use crate::io::case::{Discretisation, Intervals};
use crate::linalg::Dense;
use crate::mechanics::cohesive::Jump;

/// Parameters with all that is known of them.
pub(super) struct Made {
    pub parameters: Vec<FittedParameter>,
    pub derived: Vec<FittedQuantity>,
    pub covariance: Option<Dense>,
    pub budget: Budget,
    /// The constants of all tests.
    pub constants: Vec<Constant>,
    /// What they do, as each test sees it.
    pub effects: Vec<Vec<ConstantEffect>>,
    pub intervals: Option<IntervalBasis>,
    /// How far the joints went.
    pub furthest: Option<Jump>,
    by_size: Option<Vec<f64>>,
    size_included: bool,
}

impl Made {
    /// That of `tests` that ended as `known`; `constants` are those of all of them, `refined` what elements half as
    /// large change.
    pub(super) fn new(
        tests: &[Searched<'_>],
        constants: &[CombinedConstant],
        weights: &[TestWeights],
        known: &Known,
        refined: &[Option<Refined>],
    ) -> Self {
        let first = tests[0].problem;
        let (unknowns, x) = (&first.unknowns, &known.evaluations[0].x);
        let statistics = known.led.as_ref().map(|led| led.statistics.as_slice());
        let views = statistics.map_or_else(
            || vec![Vec::new(); tests.len()],
            |statistics| {
                let of_test = |k: usize| Contribution {
                    problem: tests[k].problem,
                    evaluation: &known.evaluations[k],
                    statistics: &statistics[k],
                    constants: &tests[k].options.constants,
                };
                effects(&(0..tests.len()).map(of_test).collect::<Vec<_>>(), constants)
            },
        );
        let constants: Vec<Constant> =
            constants.iter().map(|combined| with_noise_level(tests, known, &combined.constant)).collect();
        let asked = |wanted: Discretisation| tests.iter().any(|test| test.options.discretisation == wanted);
        let discretisation = match () {
            () if asked(Discretisation::Included) => Discretisation::Included,
            () if asked(Discretisation::Stated) => Discretisation::Stated,
            () => Discretisation::Off,
        };
        let wanted = |k: usize| tests[k].options.discretisation != Discretisation::Off;
        let by_size = statistics.filter(|_| discretisation != Discretisation::Off).and_then(|statistics| {
            let mut sum = vec![0.0; x.len()];
            for k in (0..tests.len()).filter(|&k| wanted(k)) {
                let moved = statistics[k].shift(&refined[k].as_ref()?.change);
                sum.iter_mut().zip(moved).for_each(|(sum, z)| *sum += z);
            }
            Some(sum)
        });
        let slopes = unknowns.slopes(x);
        let by_refinement: Option<Vec<f64>> =
            by_size.as_ref().map(|scaled| scaled.iter().zip(&slopes).map(|(z, slope)| z * slope).collect());
        let of_tests = tests.iter().zip(&known.evaluations);
        let furthest = unknowns.law_at(x).ok().and_then(|law| {
            let jumps = of_tests.filter_map(|(test, evaluation)| furthest(test.problem, evaluation, &*law));
            jumps.max_by(|a, b| work_along(&*law, *a).total_cmp(&work_along(&*law, *b)))
        });
        let of_first = statistics.map(|statistics| &statistics[0]);
        let Fitted { budget, mut parameters, mut derived, covariance } = assess(
            first,
            &Ingredients {
                x,
                statistics: of_first,
                constants: &constants,
                effects: &views[0],
                by_refinement: by_refinement.as_deref(),
                discretisation,
                furthest,
            },
        );
        let intervals = of_first.map(|statistics| {
            let base = Base {
                problem: first,
                evaluation: &known.evaluations[0],
                statistics,
                weights: &weights[0].weights,
                boundary: &first.border.boundary,
                follows_data: true,
                furthest,
            };
            let mut basis = settle(&base, Intervals::Linear, Some(0), &budget, &mut parameters, &mut derived);
            let names: Vec<&str> = parameters.iter().map(|p| p.parameter.name).collect();
            let relative = |p: &FittedParameter| p.std_noise.unwrap_or(0.0) / p.value.abs().max(f64::MIN_POSITIVE);
            basis.linearity.doubts = doubts(&names, &parameters.iter().map(relative).collect::<Vec<_>>(), None);
            basis
        });
        let size_included = discretisation == Discretisation::Included;
        Self {
            parameters,
            derived,
            covariance,
            budget,
            constants,
            effects: views,
            intervals,
            furthest,
            by_size,
            size_included,
        }
    }

    /// What elements half as large change, as a test sees it.
    pub(super) fn refinement(&self, refined: Option<&Refined>) -> Option<Refinement> {
        let (scaled, refined) = self.by_size.as_ref().zip(refined)?;
        Some(Refinement {
            scaled: scaled.clone(),
            jumps: refined.jumps.clone(),
            forces: refined.forces.clone(),
            included: self.size_included,
        })
    }
}

/// A constant as it is; of the level of the noise, which is one line for all tests, the largest uncertainty that one of
/// them has.
fn with_noise_level(tests: &[Searched<'_>], known: &Known, constant: &Constant) -> Constant {
    let Some(led) = known.led.as_ref().filter(|_| constant.name == NOISE_LEVEL) else { return constant.clone() };
    let mut largest = Constant { std: 0.0, source: Source::Exact, ..constant.clone() };
    for (test, statistics) in tests.iter().zip(&led.statistics) {
        for one in test.options.constants.iter().filter(|one| one.name == NOISE_LEVEL) {
            let n = test.problem.n_data().max(1) as f64;
            let (std, source) = match statistics.sigma_estimated && one.source == Source::Default {
                true => ((0.5 / n).sqrt(), Source::Computed),
                false => (one.std, one.source),
            };
            if std > largest.std {
                // A default that is not to be made anew from the data of the first test.
                let default = source == Source::Default && led.statistics[0].sigma_estimated;
                (largest.std, largest.source) = (std, if default { Source::Stated } else { source });
            }
        }
    }
    largest
}
