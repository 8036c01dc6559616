//! Which kind of test would tell what a test leaves open: one that opens the joint, or one that slides it (THEORY 12).

use crate::identify::{Evaluation, Problem};
use crate::linalg::Dense;
use crate::mechanics::Model;
use crate::mechanics::cohesive::{CohesiveLaw, Jump, Traction};

/// Share of the work of separation from which a test counts as one of that mode.
const ONE_MODE: f64 = 0.7;
/// Share of the largest eigenvalue of the normal matrix up to which nothing is told.
const NOTHING: f64 = 1e-11;
/// Points of each pure mode at which the law is looked at.
const POINTS: usize = 60;
/// By so much, so many times at most, the jump is made larger until a pure mode has no traction left: nine powers of
/// ten.
const STRETCH: f64 = 1.2;
const STRETCHES: usize = 120;
/// Step of a scaled unknown for the derivative of the tractions: truncation and round-off are far below what is asked.
const STEP: f64 = 1e-4;

/// A pure mode of separation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Along the normal.
    Opening,
    /// Along the joint.
    Sliding,
}

impl Mode {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Opening => "opening",
            Self::Sliding => "sliding",
        }
    }
}

/// How a test loads the joint, and what kind of test would tell what it tells worst.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissingMode {
    /// Share of opening in the work that the tractions do while the faces part, from 0 to 1; `None` where they do
    /// none.
    pub opening_share: Option<f64>,
    /// The mode that is missing; `None` where the test has it already.
    pub missing: Option<Mode>,
}

/// Share of opening in the work of separation of a run whose displacements at each instant are `fields`; `None` where
/// there is no such work.
pub fn opening_share<'a>(
    model: &Model,
    law: &dyn CohesiveLaw,
    fields: impl IntoIterator<Item = &'a Vec<[f64; 2]>>,
) -> Option<f64> {
    let n = model.mesh().pairs().len();
    let mut before = vec![(Jump::default(), Traction::default()); n];
    let mut work = vec![[0.0_f64; 2]; n];
    for u in fields {
        let now: Vec<_> = model.jumps(u).into_iter().map(|jump| (jump, law.response(jump).traction)).collect();
        for ((work, (j0, t0)), (j1, t1)) in work.iter_mut().zip(&before).zip(&now) {
            work[0] += 0.5 * (t0.normal + t1.normal) * (j1.normal - j0.normal);
            work[1] += 0.5 * (t0.tangential + t1.tangential) * (j1.tangential - j0.tangential);
        }
        before = now;
    }
    // Pairs are all but evenly spaced: each counts alike. What closes the joint separates nothing.
    let open: f64 =
        (before.iter().zip(&work)).filter(|((j, _), _)| j.normal > 0.0).map(|(_, work)| work[0].max(0.0)).sum();
    let slide: f64 = work.iter().map(|work| work[1].max(0.0)).sum();
    (open + slide > 0.0).then(|| open / (open + slide))
}

impl Problem<'_> {
    /// What kind of test would tell the combinations of unknowns that the data leave open: those with a standard
    /// uncertainty above `largest_std` under `covariance` (of the scaled unknowns), or, without one, those that the
    /// normal matrix `h` says nothing of; one at least. `None` where that cannot be said.
    pub(crate) fn missing_mode(
        &self,
        evaluation: &Evaluation,
        h: &Dense,
        covariance: Option<&Dense>,
        largest_std: f64,
    ) -> Option<MissingMode> {
        let law = self.unknowns.law_at(&evaluation.x).ok().filter(|law| !law.parameters().is_empty())?;
        let fields = evaluation.solution.instants.iter().map(|instant| &instant.displacement);
        let opening_share = opening_share(&self.joint.model, &*law, fields);
        let share_of = |mode: Mode| match mode {
            Mode::Opening => opening_share,
            Mode::Sliding => opening_share.map(|share| 1.0 - share),
        };
        let (values, vectors) = covariance.unwrap_or(h).symmetric_eigen()?;
        let n = values.len();
        // The worst known first.
        let open: Vec<usize> = match covariance {
            Some(_) => (0..n).rev().filter(|&k| k + 1 == n || values[k] > largest_std * largest_std).collect(),
            None => (0..n).filter(|&k| k == 0 || values[k] <= NOTHING * values[n - 1]).collect(),
        };
        let wanted: Vec<Mode> = open.iter().filter_map(|&k| self.mode_of(evaluation, vectors.column(k))).collect();
        wanted.first()?;
        let missing = wanted.into_iter().find(|&mode| share_of(mode).is_none_or(|share| share < ONE_MODE));
        Some(MissingMode { opening_share, missing })
    }

    /// The pure mode in which the tractions of the law change most when the scaled unknowns move along `direction`.
    fn mode_of(&self, evaluation: &Evaluation, direction: &[f64]) -> Option<Mode> {
        let unknowns = &self.unknowns;
        let z = unknowns.scaled(&evaluation.x);
        let moved = |h: f64| {
            let z: Vec<f64> = z.iter().zip(direction).map(|(z, d)| z + h * d).collect();
            // Not through the bounds: a value on one of them moves as well.
            let x: Vec<f64> = unknowns.list().iter().zip(&z).map(|(unknown, z)| unknown.scale.unscaled(*z)).collect();
            unknowns.law_at(&x).ok()
        };
        let (law, more) = (unknowns.law_at(&evaluation.x).ok()?, moved(STEP).or_else(|| moved(-STEP))?);
        let peak = law.peak();
        let change = |mode: Mode| {
            let jump = |s: f64| match mode {
                Mode::Opening => Jump { normal: s, tangential: 0.0 },
                Mode::Sliding => Jump { normal: 0.0, tangential: s },
            };
            let of = |t: Traction| if mode == Mode::Opening { t.normal } else { t.tangential };
            let (traction, peak) = (|law: &dyn CohesiveLaw, s: f64| of(law.response(jump(s)).traction), of(peak));
            // As far as there is traction: past its peak, and down again.
            let (mut reach, mut passed) = (1e-3 * law.front_opening(), false);
            for _ in 0..STRETCHES {
                let here = traction(&*law, reach);
                passed |= here > 0.7 * peak;
                if passed && here < 0.05 * peak {
                    break;
                }
                reach *= STRETCH;
            }
            let at = |k: usize| reach * k as f64 / POINTS as f64;
            let off = |k: usize| (traction(&*more, at(k)) - traction(&*law, at(k))) / peak;
            (1..=POINTS).map(|k| off(k) * off(k)).sum::<f64>()
        };
        let [opening, sliding] = [Mode::Opening, Mode::Sliding].map(change);
        (opening.is_finite() && sliding.is_finite()).then_some(if opening > sliding {
            Mode::Opening
        } else {
            Mode::Sliding
        })
    }
}

impl MissingMode {
    /// What is missing, as a sentence; `None` where another test of the same kind is all that can be advised.
    pub fn sentence(&self) -> Option<String> {
        let missing = self.missing?.name();
        let here = self.opening_share.map_or(String::new(), |share| {
            format!(": here opening does {:.0} % of the work of separation", 100.0 * share)
        });
        let article = if missing == "opening" { "an" } else { "a" };
        Some(format!("what is missing is {article} {missing} test{here}; fit both together ([[test]])"))
    }
}
