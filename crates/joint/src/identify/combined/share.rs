//! What each of several tests tells by itself.

use super::alone::stds_of_information;
use super::known::Known;
use super::search::Searched;
use crate::identify::{Evaluation, opening_share};
use crate::linalg::Dense;

/// Least growth of a standard uncertainty that makes a test worth something.
const WORTH: f64 = 1.01;

/// What one test tells.
#[derive(Debug, Clone, PartialEq)]
pub struct TestShare {
    /// Its name.
    pub name: String,
    /// Numbers compared.
    pub n_data: usize,
    /// Its part of the objective, in units of its noise.
    pub omega: f64,
    /// Standard uncertainty of each parameter by the noise if this test were alone, from its own information at the
    /// parameters found; `None` of a parameter that it says nothing of.
    pub std_alone: Vec<Option<f64>>,
    /// The same of all the other tests together.
    pub std_without: Vec<Option<f64>>,
    /// Share of opening in its work of separation; `None` where there is none.
    pub opening_share: Option<f64>,
    /// Whether without it every standard uncertainty is the same to 1 %.
    pub adds_nothing: bool,
}

/// The shares of tests that ended as `known`.
pub(super) fn shares(tests: &[Searched<'_>], known: &Known) -> Vec<TestShare> {
    let n = known.sum.b.len();
    let zero = || Dense::zeros(n, n);
    let spread_of = |k: usize| known.led.as_ref().map(|led| &led.spreads[k]);
    let of_test = |k: usize| {
        let evaluation: &Evaluation = &known.evaluations[k];
        let slopes = tests[k].problem.unknowns.slopes(&evaluation.x);
        let in_units = |stds: Vec<Option<f64>>| -> Vec<Option<f64>> {
            stds.iter().zip(&slopes).map(|(std, slope)| std.map(|std| std * slope)).collect()
        };
        let of = |wanted: &dyn Fn(usize) -> bool| {
            let (mut h, mut spread) = (zero(), zero());
            for j in (0..tests.len()).filter(|&j| wanted(j)) {
                h.add(1.0, &known.locals[j].h);
                spread.add(1.0, spread_of(j).unwrap_or(&known.locals[j].h));
            }
            in_units(stds_of_information(&h, &spread))
        };
        let (std_alone, std_without) = (of(&|j| j == k), of(&|j| j != k));
        let all = of(&|_| true);
        let same = |(without, all): (&Option<f64>, &Option<f64>)| match (without, all) {
            (Some(without), Some(all)) => *without <= WORTH * all,
            (without, all) => without.is_none() && all.is_none(),
        };
        let law = tests[k].problem.unknowns.law_at(&evaluation.x).ok();
        let fields = || evaluation.solution.instants.iter().map(|instant| &instant.displacement);
        TestShare {
            name: tests[k].name.to_owned(),
            n_data: tests[k].problem.n_data(),
            omega: known.locals[k].omega,
            adds_nothing: tests.len() > 1 && std_without.iter().zip(&all).all(same),
            std_alone,
            std_without,
            opening_share: law.and_then(|law| opening_share(&tests[k].problem.joint.model, &*law, fields())),
        }
    };
    (0..tests.len()).map(of_test).collect()
}
