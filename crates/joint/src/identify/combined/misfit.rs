//! The misfit of each test at the parameters that all share, and of all of them together.

use super::consistency::{Consistency, Pull, consistency};
use crate::identify::doubt::misfit::Unexplained;
use crate::identify::{
    ConstantEffect, Evaluation, FitError, Local, Misfit, MisfitGroup, Problem, Statistics, Weights, full_weights, scale,
};
use crate::linalg::Dense;

/// One test at the end of the fit.
pub(super) struct Judged<'a> {
    pub name: &'a str,
    pub problem: &'a Problem<'a>,
    pub evaluation: &'a Evaluation,
    pub weights: &'a Weights,
    pub statistics: &'a Statistics,
    /// Change of the rows with elements half as large.
    pub refined: Option<&'a [Dense]>,
    /// What the constants of all tests do, in the same order in each.
    pub effects: &'a [ConstantEffect],
}

/// A test under the inverse covariance, in units of its noise.
struct White<'a> {
    test: &'a Judged<'a>,
    own: Option<Weights>,
    unit: f64,
    local: Local,
    jacobian: Vec<Dense>,
}

impl<'a> White<'a> {
    fn new(test: &'a Judged<'a>) -> Result<Self, FitError> {
        let own = match test.weights {
            Weights::Inverse(_) => None,
            Weights::Diagonal(_) => Some(full_weights(test.problem, test.evaluation)?),
        };
        let sigma = test.statistics.sigma;
        // With an unknown noise the inverse covariance holds that of noise 1.
        let unit = if test.problem.noise.sigma.is_some() { 1.0 } else { 1.0 / (sigma * sigma) };
        let weights = own.as_ref().unwrap_or(test.weights);
        let local = test.evaluation.local(weights, &test.problem.noise).times(unit);
        Ok(Self { test, own, unit, local, jacobian: test.evaluation.jacobian() })
    }

    /// `u W d`.
    fn times(&self, d: &[Dense]) -> Vec<Dense> {
        let mut weighted = self.own.as_ref().unwrap_or(self.test.weights).times(&self.test.problem.noise, d);
        weighted.iter_mut().for_each(|x| scale(x, self.unit));
        weighted
    }

    /// `J^T u W d`.
    fn gradient(&self, weighted: &[Dense]) -> Dense {
        let mut sum = Dense::zeros(self.local.b.len(), 1);
        self.jacobian.iter().zip(weighted).for_each(|(j, wd)| sum.add(1.0, &j.transposed_times(wd)));
        sum
    }
}

/// What of a change of the rows the parameters do not take up, of one test.
struct Left {
    square: f64,
    rows: Vec<Dense>,
    /// What it pulls this test's parameters by.
    gradient: Dense,
}

/// What is left of `changes`, one of each test, after the parameters that all share have followed.
fn residual_after(tests: &[White<'_>], a: &Dense, changes: &[&[Dense]]) -> Vec<Left> {
    let mut sum = Dense::zeros(a.n_rows(), 1);
    for (test, change) in tests.iter().zip(changes) {
        sum.add(1.0, &test.gradient(&test.times(change)));
    }
    let taken = a.times(&sum);
    let of_test = |(test, change): (&White<'_>, &&[Dense])| {
        let rows: Vec<Dense> = (change.iter().zip(&test.jacobian))
            .map(|(d, j)| {
                let mut left = d.clone();
                left.add(-1.0, &j.times(&taken));
                left
            })
            .collect();
        let weighted = test.times(&rows);
        let square = rows.iter().zip(&weighted).map(|(d, wd)| d.transposed_times(wd)[(0, 0)]).sum::<f64>().max(0.0);
        Left { square, gradient: test.gradient(&weighted), rows }
    };
    tests.iter().zip(changes).map(of_test).collect()
}

/// The misfit of each test, of all together, and whether the tests agree on the parameters. Errors: a tangent or a
/// covariance without inverse.
pub(super) fn misfits(tests: &[Judged<'_>]) -> Result<(Vec<Misfit>, Misfit, Option<Consistency>), FitError> {
    let white: Vec<White<'_>> = tests.iter().map(White::new).collect::<Result<_, _>>()?;
    let n = white[0].local.b.len();
    let (mut h, mut b) = (Dense::zeros(n, n), Dense::zeros(n, 1));
    for test in &white {
        h.add(1.0, &test.local.h);
        b.add(1.0, &Dense::from_fn(n, 1, |k, _| test.local.b[k]));
    }
    let a = h.cholesky().map_err(|_| FitError::NotFinite)?.inverse();
    // What other weights leave above the minimum under these, to first order.
    let step = a.times(&b);
    let n_effects = tests[0].effects.len();
    let changes = |k: usize| tests.iter().map(|test| test.effects[k].rows.as_slice()).collect::<Vec<&[Dense]>>();
    let constants: Vec<Vec<Left>> = (0..n_effects).map(|k| residual_after(&white, &a, &changes(k))).collect();
    let still: Vec<Vec<Dense>> = (tests.iter())
        .map(|test| test.evaluation.blocks.iter().map(|block| Dense::zeros(block.n_rows(), 1)).collect())
        .collect();
    let refined: Vec<&[Dense]> =
        tests.iter().zip(&still).map(|(test, still)| test.refined.unwrap_or(still.as_slice())).collect();
    let finer = residual_after(&white, &a, &refined);
    let mut list = Vec::with_capacity(tests.len());
    for (k, test) in white.iter().enumerate() {
        let Local { omega, b, h, .. } = &test.local;
        let hs = h.times(&step);
        let at_end = omega + (0..n).map(|j| step[(j, 0)] * (hs[(j, 0)] - 2.0 * b[j])).sum::<f64>();
        let ah = a.times(h);
        let taken: f64 = (0..n).map(|j| ah[(j, j)]).sum();
        let unexplained = Unexplained {
            omega: at_end.max(0.0),
            freedom: (tests[k].problem.n_data() as f64 - taken).max(1.0),
            floor: tests[k].refined.map(|_| (finer[k].square, finer[k].rows.clone())),
            constants: constants.iter().map(|of| (of[k].square, of[k].rows.clone())).collect(),
        };
        list.push(tests[k].problem.judge(tests[k].evaluation, tests[k].statistics, unexplained));
    }
    let pulls: Vec<Pull> = (white.iter().enumerate())
        .map(|(k, test)| {
            let hs = test.local.h.times(&step);
            Pull {
                h: test.local.h.clone(),
                b: Dense::from_fn(n, 1, |j, _| test.local.b[j] - hs[(j, 0)]),
                others: constants.iter().map(|of| &of[k]).chain([&finer[k]]).map(|l| l.gradient.clone()).collect(),
            }
        })
        .collect();
    let tested = tests.iter().all(|test| test.problem.noise.sigma.is_some());
    let consistency = if tested { consistency(&pulls) } else { None };
    let names: Vec<&str> = tests.iter().map(|test| test.name).collect();
    let total = together(&names, &list);
    Ok((list, total, consistency))
}

/// The sum of the misfits of tests called `names`.
fn together(names: &[&str], list: &[Misfit]) -> Misfit {
    let sum = |of: fn(&Misfit) -> f64| list.iter().map(of).sum::<f64>();
    let floor = list.iter().any(|m| m.floor.is_some()).then(|| sum(|m| m.floor.unwrap_or(0.0)));
    let (omega, freedom, constants) = (sum(|m| m.omega), sum(|m| m.freedom), sum(|m| m.constants));
    let expected = freedom + floor.unwrap_or(0.0) + constants;
    let std = sum(|m| m.std * m.std).sqrt();
    let groups = |of: fn(&Misfit) -> &Vec<MisfitGroup>| -> Vec<MisfitGroup> {
        let named = |(name, misfit): (&&str, &Misfit)| {
            let name = (*name).to_owned();
            let one =
                move |group: &MisfitGroup| MisfitGroup { name: format!("{name}, {}", group.name), ..group.clone() };
            of(misfit).iter().map(one).collect::<Vec<_>>()
        };
        names.iter().zip(list).flat_map(named).collect()
    };
    let groups = [groups(|m| &m.by_instant), groups(|m| &m.by_region), groups(|m| &m.by_both)];
    Misfit::new([omega, freedom, constants], floor, (expected, std), list.iter().all(|m| m.tested), groups)
}
