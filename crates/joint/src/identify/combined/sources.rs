//! Constants of several tests: which are one and the same, and what each does to the parameters that all tests share.

use crate::identify::doubt::remarks::uncertainties_differ;
use crate::identify::intervals::constants::power_of_length;
use crate::identify::{
    Constant, ConstantEffect, ConstantKind, Evaluation, FitError, NOISE_LEVEL, Problem, Source, Statistics, wrong,
};
use crate::linalg::Dense;
use crate::mechanics::cohesive::Jump;
use crate::remark::Remark;

/// A constant of one test or of several.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CombinedConstant {
    /// Its name: with that of the test where it is one test's own.
    pub constant: Constant,
    /// Its place among the constants of each test; `None` where that has it not.
    pub of: Vec<Option<usize>>,
}

/// The constants of all tests, each called as in `names`. `shared` lists those whose error is the same in all tests;
/// without it these are the constants of the strips that agree in value and uncertainty. Parameters of the law always
/// are. Errors: a name in `shared` that no test has, or whose values differ.
pub(super) fn combined_constants(
    names: &[&str],
    constants: &[&[Constant]],
    shared: Option<&[String]>,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<CombinedConstant>, FitError> {
    let listed = |name: &str| shared.is_some_and(|list| list.iter().any(|one| one == name));
    for name in shared.unwrap_or_default() {
        let all = || constants.iter().flat_map(|list| list.iter());
        if !all().any(|constant| constant.name == *name && can_be_shared(&constant.kind)) {
            let mut there: Vec<&str> = Vec::new();
            all().filter(|c| can_be_shared(&c.kind)).for_each(|c| {
                if !there.contains(&c.name.as_str()) {
                    there.push(&c.name);
                }
            });
            let what = format!("shared names \"{name}\": there is no such constant; there are {}", there.join(", "));
            return Err(wrong("fit", "shared", what));
        }
    }
    let mut found: Vec<CombinedConstant> = Vec::new();
    for (k, list) in constants.iter().enumerate() {
        for (place, constant) in list.iter().enumerate() {
            let of_law = matches!(constant.kind, ConstantKind::Law { .. } | ConstantKind::NoiseLevel);
            let by_itself = shared.is_none() && matches!(constant.kind, ConstantKind::Material { .. });
            let may_share = of_law || by_itself || listed(&constant.name);
            let same_name = |one: &CombinedConstant| one.constant.name == constant.name && one.of[k].is_none();
            let one =
                found.iter().position(|one| may_share && same_name(one) && (of_law || agree(&one.constant, constant)));
            if let Some(one) = one.map(|at| &mut found[at]) {
                if of_law && one.constant.std != constant.std {
                    if constant.name != NOISE_LEVEL {
                        remarks.push(uncertainties_differ(&constant.name));
                    }
                    if constant.std > one.constant.std {
                        one.constant = constant.clone();
                    }
                }
                one.of[k] = Some(place);
                continue;
            }
            if let Some(other) = found.iter().find(|one| listed(&constant.name) && same_name(one)) {
                let first = other.of.iter().position(Option::is_some).unwrap_or(0);
                return Err(wrong("fit", "shared", differ(&other.constant, constant, [names[first], names[k]])));
            }
            let mut of = vec![None; constants.len()];
            of[k] = Some(place);
            found.push(CombinedConstant { constant: constant.clone(), of });
        }
    }
    // One that others have under the same name says whose it is.
    let namesakes =
        |one: &CombinedConstant| found.iter().filter(|other| other.constant.name == one.constant.name).count();
    let of_several: Vec<bool> = found.iter().map(|one| namesakes(one) > 1).collect();
    for (one, _) in found.iter_mut().zip(of_several).filter(|(_, several)| *several) {
        let owners: Vec<&str> = one.of.iter().zip(names).filter_map(|(of, name)| of.map(|_| *name)).collect();
        one.constant.name = format!("{} ({})", one.constant.name, owners.join(", "));
    }
    Ok(found)
}

fn can_be_shared(kind: &ConstantKind) -> bool {
    !matches!(kind, ConstantKind::Law { .. } | ConstantKind::NoiseLevel)
}

/// Whether two constants of one name say the same.
fn agree(a: &Constant, b: &Constant) -> bool {
    let same = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs());
    let value = match (a.value, b.value) {
        (Some(a), Some(b)) => same(a, b),
        (a, b) => a == b,
    };
    value && same(a.std, b.std) && a.source == b.source
}

fn differ(a: &Constant, b: &Constant, tests: [&str; 2]) -> String {
    let said = |c: &Constant| {
        let value = c.value.map_or(String::new(), |value| format!("{value} {} ", c.unit));
        match c.source {
            Source::Exact => format!("{value}(exact)"),
            Source::Unknown => format!("{value}(uncertainty not stated)"),
            _ => format!("{value}+- {}", c.std),
        }
    };
    format!(
        "shared names \"{}\", but it is {} in test \"{}\" and {} in test \"{}\"; state the same, or take it out of the list",
        a.name,
        said(a),
        tests[0],
        said(b),
        tests[1]
    )
}

/// What one test contributes to the effects of the constants.
pub(super) struct Contribution<'a> {
    pub problem: &'a Problem<'a>,
    pub evaluation: &'a Evaluation,
    /// With the inverse of the normal matrix of all tests.
    pub statistics: &'a Statistics,
    pub constants: &'a [Constant],
}

/// What each constant does to the parameters that all tests share: of each test its view of every effect, in the same
/// order, without those that could not be computed in some test that has them.
pub(super) fn effects(tests: &[Contribution<'_>], constants: &[CombinedConstant]) -> Vec<Vec<ConstantEffect>> {
    // Of a parameter of the law that tests know differently well the larger uncertainty holds in all.
    let with_larger = |(k, test): (usize, &Contribution<'_>)| {
        let mut list = test.constants.to_vec();
        for CombinedConstant { constant, of } in constants {
            if let Some(place) = of[k] {
                (list[place].std, list[place].source) = (constant.std, constant.source);
            }
        }
        list
    };
    let lists: Vec<Vec<Constant>> = tests.iter().enumerate().map(with_larger).collect();
    let own: Vec<Vec<ConstantEffect>> = tests.iter().zip(&lists).map(|(test, list)| test.effects(list)).collect();
    let mut views: Vec<Vec<ConstantEffect>> = vec![Vec::new(); tests.len()];
    for combined in constants {
        let of_test = |k: usize| {
            let constant = combined.of[k].map(|place| &lists[k][place])?;
            own[k].iter().find(|effect| effect.constant == *constant)
        };
        let needed = combined.of.iter().flatten().count();
        let found: Vec<Option<&ConstantEffect>> = (0..tests.len()).map(of_test).collect();
        if combined.constant.std <= 0.0 || found.iter().flatten().count() < needed {
            continue;
        }
        let mut scaled = vec![0.0; tests[0].problem.unknowns.n()];
        for (test, effect) in tests.iter().zip(&found) {
            let Some(effect) = effect else { continue };
            let moved = test.statistics.shift(&effect.rows);
            scaled.iter_mut().zip(moved).for_each(|(sum, z)| *sum += z);
        }
        for (k, test) in tests.iter().enumerate() {
            let law = test.problem.law_change(&combined.constant, &test.evaluation.x, &scaled);
            let (jumps, forces, rows) = match found[k] {
                Some(effect) => (effect.jumps.clone(), effect.forces.clone(), effect.rows.clone()),
                None => test.still(),
            };
            let constant = combined.constant.clone();
            views[k].push(ConstantEffect { constant, scaled: scaled.clone(), law, jumps, forces, rows });
        }
    }
    views
}

impl Contribution<'_> {
    /// The effects of the test's `constants`, the rows with all that a change of the pixel size does.
    fn effects(&self, constants: &[Constant]) -> Vec<ConstantEffect> {
        let mut effects = self.problem.constant_effects(self.evaluation, self.statistics, constants);
        let (unknowns, x) = (&self.problem.unknowns, &self.evaluation.x);
        let slopes = unknowns.slopes(x);
        for effect in effects.iter_mut().filter(|effect| effect.constant.kind == ConstantKind::PixelSize) {
            // In a test by itself the parameters follow the scale and leave no rows; where others hold them, they do
            // not.
            let relative = effect.constant.value.map_or(effect.constant.std, |value| effect.constant.std / value);
            let follow: Vec<f64> = (unknowns.list().iter().zip(x).zip(&slopes))
                .map(|((unknown, x), slope)| relative * power_of_length(unknown.parameter.unit) * x / slope)
                .collect();
            for (rows, block) in effect.rows.iter_mut().zip(&self.evaluation.blocks) {
                let moved = |r: usize| follow.iter().enumerate().map(|(k, z)| block[(r, k + 1)] * z).sum::<f64>();
                *rows = Dense::from_fn(rows.n_rows(), 1, |r, _| rows[(r, 0)] - moved(r));
            }
        }
        effects
    }

    /// Jumps, forces and rows that do not move.
    fn still(&self) -> (Vec<Vec<Jump>>, Vec<f64>, Vec<Dense>) {
        let n_pairs = self.problem.joint.model.mesh().pairs().len();
        let blocks = &self.evaluation.blocks;
        let jumps = vec![vec![Jump::default(); n_pairs]; blocks.len()];
        (jumps, vec![0.0; blocks.len()], blocks.iter().map(|block| Dense::zeros(block.n_rows(), 1)).collect())
    }
}
