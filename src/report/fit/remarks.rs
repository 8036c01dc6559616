//! What there is to say of the result of a fit.

use crate::identify::{CutShort, Fit, FittedParameter, IntervalKind};
use crate::remark::{About, Code, Remark};

fn of_fit(code: Code, text: impl Into<String>) -> Remark {
    Remark::new(code, About::Fit, text)
}

fn of_parameter(code: Code, p: &FittedParameter, text: String) -> Remark {
    Remark::new(code, About::Parameter(p.parameter.name.to_owned()), text)
}

/// The fit was ended before its time.
pub(super) fn cut_short(cut: &CutShort) -> Remark {
    of_fit(Code::FitCutShort, format!("the fit was cut short: {}", cut.text()))
}

/// The effects of the constants `missing` could not be computed; `None` where all could.
pub(super) fn effects_missing(missing: &[&str]) -> Option<Remark> {
    let names = missing.join(", ");
    let text = format!("the effect of {names} could not be computed: the intervals are without it");
    (!missing.is_empty()).then(|| of_fit(Code::EffectMissing, text).with("constants", names))
}

/// The effect of the size of the elements could not be computed.
pub(super) fn discretisation_missing() -> Remark {
    let text = "the effect of the element size could not be computed (no finer mesh, or no solution on it): the \
                intervals are without it";
    of_fit(Code::EffectMissing, text).with("constants", "element size")
}

/// A parameter ended on its bound.
pub(super) fn on_bound(p: &FittedParameter) -> Remark {
    let [low, high] = p.bounds;
    let text =
        format!("{} ended on its bound ({} of {low} to {high}): its interval means little", p.parameter.name, p.value);
    of_parameter(Code::ParameterOnBound, p, text).with("value", p.value).with("lower", low).with("upper", high)
}

/// The forward run at the result was rescued.
pub(super) fn rescued() -> Remark {
    let text = "the forward run at the result was rescued: node pairs snapped, and the objective may jump nearby";
    of_fit(Code::SolutionRescued, text)
}

/// Converged starts ended up to `apart` from each other.
pub(super) fn starts_differ(apart: f64) -> Remark {
    let text =
        format!("the starts led to different ends, up to {apart:.1e} apart in scaled unknowns: the best was taken");
    of_fit(Code::StartsDiffer, text).with("apart", apart)
}

/// What a user should know of the intervals: doubts of linear theory, biases, sides without an end.
pub(super) fn of_intervals(fit: &Fit) -> Vec<Remark> {
    let Some(basis) = fit.intervals.as_ref().filter(|basis| basis.linearity.in_doubt()) else { return Vec::new() };
    let doubts = basis.linearity.doubts.join("; ");
    let text = match (basis.kind, &basis.bootstrap) {
        (IntervalKind::Linear, _) => format!("linear intervals are in doubt: {doubts}"),
        (IntervalKind::Profile, None) => {
            format!("intervals are those of the profile likelihood, without the bias that noise makes: {doubts}")
        }
        (IntervalKind::Profile, Some(bootstrap)) => format!(
            "intervals are those of the profile likelihood, extended by the bias that {} refits of simulated data \
             show ({} failed, {} on a bound): {doubts}",
            bootstrap.draws, bootstrap.failed, bootstrap.on_bound,
        ),
    };
    let mut found = vec![of_fit(Code::IntervalsInDoubt, text).with("kind", basis.kind.name())];
    for p in &fit.parameters {
        let (name, unit) = (p.parameter.name, p.parameter.unit);
        if let (Some(bias), Some(std)) = (p.bias, p.std)
            && bias.abs() > 0.25 * std
        {
            let percent = 100.0 * bias / p.value;
            let text = format!(
                "noise shifts {name} by {percent:+.1} % on average ({bias:+.3e} {unit}); the value is as fitted, its \
                 interval holds the shift"
            );
            found.push(of_parameter(Code::NoiseBiases, p, text).with("bias_percent", percent));
        }
        for (end, side) in p.ends95.iter().zip(["lower", "upper"]) {
            if end.is_none() && p.std.is_some() {
                let text = format!(
                    "the 95 % interval of {name} has no {side} end: the objective does not rise enough within the \
                     bounds and a factor of 20, or the model has no solution on the way"
                );
                found.push(of_parameter(Code::IntervalOpen, p, text).with("side", side));
            }
        }
    }
    found
}
