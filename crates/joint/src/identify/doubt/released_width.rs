//! Do force and displacements want the same parameters? The width of the specimen as one more unknown.

use crate::identify::{ConstantEffect, ConstantKind, Evaluation, NORMAL_95, ObservedInstant, Problem, Weights};
use crate::linalg::Dense;

/// The width of the specimen as one more unknown: do forces and displacements want the same parameters?
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReleasedWidth {
    /// The width that the case gives, mm.
    pub prescribed_mm: f64,
    /// The width that the data prefer, mm.
    pub value_mm: f64,
    /// Its standard uncertainty by the noise, mm.
    pub std_mm: f64,
    /// That of the difference: noise, the width as it was given, all other constants and the size of the elements, mm.
    pub allowed_mm: f64,
    /// What the objective falls by.
    pub gain: f64,
}

impl ReleasedWidth {
    /// Fall of the objective that a right width exceeds in one of a thousand cases.
    pub const LIMIT: f64 = 10.83;

    /// Whether the data refuse the width.
    pub fn contradicts(&self) -> bool {
        self.gain > Self::LIMIT && (self.value_mm - self.prescribed_mm).abs() > NORMAL_95 * self.allowed_mm
    }

    /// What there is to say, when they do.
    pub fn sentence(&self) -> Option<String> {
        self.contradicts().then(|| {
            format!(
                "force and displacements contradict each other: width_mm = {} is refused, as an unknown it is {:.4} +- {:.2}, and omega \
                 falls by {:.0}; check width_mm, the unit, the zero and the group of the load cell, and whether the model holds all of \
                 the joint that bears the load",
                self.prescribed_mm, self.value_mm, self.std_mm, self.gain
            )
        })
    }
}

impl Problem<'_> {
    /// The width of the specimen as one more unknown of the fit that ended at `evaluation` under `weights`, to first
    /// order; `None` without a force, or where the data say nothing of it. `refined` and `effects` as of
    /// [`Problem::misfit`].
    pub(crate) fn width_as_unknown(
        &self,
        evaluation: &Evaluation,
        weights: &Weights,
        refined: Option<&[Dense]>,
        effects: &[ConstantEffect],
        prescribed_std: f64,
    ) -> Option<ReleasedWidth> {
        let cell = self.observation.force.as_ref()?;
        let Weights::Inverse(_) = weights else { return None };
        let law = self.unknowns.law_at(&evaluation.x).ok()?;
        let model = &self.joint.model;
        let by_width = |observed: &ObservedInstant| {
            let u = &evaluation.solution.instants[observed.index].displacement;
            self.observation.column(observed.index, |_, _| 0.0, |cell| cell.reaction(model, &*law, u).value)
        };
        let change: Vec<Dense> = self.observation.instants.iter().map(by_width).collect();
        let a = evaluation.local(weights, &self.noise).h.cholesky().ok()?.inverse();
        let (square, left) = self.not_absorbed(weights, &evaluation.jacobian(), &a, &change);
        let weighted = weights.times(&self.noise, &left);
        // What other rows move the width by, with all parameters free.
        let moved = |rows: &[Dense]| {
            weighted.iter().zip(rows).map(|(w, rows)| w.transposed_times(rows)[(0, 0)]).sum::<f64>() / square
        };
        let by = moved(&evaluation.residual());
        let others = effects.iter().filter(|effect| effect.constant.kind != ConstantKind::Width);
        let by_others: f64 = others.map(|effect| moved(&effect.rows).powi(2)).sum();
        let by_size = refined.map_or(0.0, moved);
        let std_mm = square.sqrt().recip();
        let released = ReleasedWidth {
            prescribed_mm: cell.width_mm,
            value_mm: cell.width_mm + by,
            std_mm,
            allowed_mm: (std_mm * std_mm + by_others + by_size * by_size + prescribed_std * prescribed_std).sqrt(),
            gain: by * by * square,
        };
        (released.gain.is_finite() && released.allowed_mm.is_finite()).then_some(released)
    }
}
