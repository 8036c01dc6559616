//! A change of the computed rows as one more unknown of a fit, to first order: do the data ask for it? (THEORY 11)

use crate::identify::{ConstantEffect, Evaluation, NORMAL_95, Problem, Weights};
use crate::linalg::Dense;

/// How far off what was prescribed the data want something: by units of the change.
pub(super) struct OneMore {
    pub value: f64,
    /// Its standard uncertainty by the noise,
    pub std: f64,
    /// and by all that is uncertain.
    pub allowed: f64,
    /// What the objective falls by.
    pub gain: f64,
}

impl OneMore {
    /// Fall of the objective that something right exceeds in one of a thousand cases.
    pub const LIMIT: f64 = 10.83;

    /// Whether the data ask for it.
    pub fn contradicts(&self) -> bool {
        self.gain > Self::LIMIT && self.value.abs() > NORMAL_95 * self.allowed
    }
}

impl Problem<'_> {
    /// The size of a `change` of the computed rows, as one more unknown beside all parameters of the fit that ended so.
    /// `refined` as of [`Problem::misfit`]; `others` are the constants that are uncertain beside it, and
    /// `prescribed_std` says how well it is known itself. `None` where the data say nothing of it.
    pub(super) fn one_more_unknown<'a>(
        &self,
        change: &[Dense],
        (evaluation, weights): (&Evaluation, &Weights),
        refined: Option<&[Dense]>,
        others: impl Iterator<Item = &'a ConstantEffect>,
        prescribed_std: f64,
    ) -> Option<OneMore> {
        let a = evaluation.local(weights, &self.noise).h.cholesky().ok()?.inverse();
        let (square, left) = self.not_absorbed(weights, &evaluation.jacobian(), &a, change);
        let weighted = weights.times(&self.noise, &left);
        let moved = |rows: &[Dense]| {
            weighted.iter().zip(rows).map(|(w, rows)| w.transposed_times(rows)[(0, 0)]).sum::<f64>() / square
        };
        let value = moved(&evaluation.residual());
        let by_others: f64 = others.map(|effect| moved(&effect.rows).powi(2)).sum();
        let by_size = refined.map_or(0.0, moved);
        let std = square.sqrt().recip();
        let allowed = (std * std + by_others + by_size * by_size + prescribed_std * prescribed_std).sqrt();
        let one_more = OneMore { value, std, allowed, gain: value * value * square };
        (one_more.gain.is_finite() && allowed.is_finite()).then_some(one_more)
    }
}
