//! From measurements to an element size, with the reasons.

use super::noise::{Noise, Origin};
use super::texture::TextureFigures;
use super::trials::Bias;
use super::{Options, SizeResult};
use crate::imaging::Interpolation;
use serde::Serialize;

/// An element should hold this many speckles along each side: fewer, and some nodes see next to none.
const SPECKLES: f64 = 3.0;
/// Per cent of the nodes that may be without texture.
const REFUSED_PERCENT: f64 = 1.0;
/// Speckles smaller than this are not resolved by the pixels; larger ones cost resolution.
const FINE_PX: f64 = 3.0;
const COARSE_PX: f64 = 10.0;
/// Per cent of saturated pixels, and of the range of grey levels, worth a word.
const SATURATED_PERCENT: f64 = 1.0;
const RANGE_PERCENT: f64 = 25.0;
/// A bias above this share of the standard uncertainty is seen once a few dozen nodes are averaged.
const BIAS_SHARE: f64 = 0.2;

/// The recommended element size and what else to do.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// The element size, px; `None` when none of those tried can be recommended.
    pub element_size_px: Option<usize>,
    /// Whether it reaches the target uncertainty.
    pub target_met: bool,
    /// Whether it resolves the period asked for; `None` if none was.
    pub period_met: Option<bool>,
    /// Why this size.
    pub reasons: Vec<String>,
    /// What else is worth knowing or doing about the images.
    pub hints: Vec<String>,
}

impl Advice {
    /// The rule: of the sizes that hold three speckles along a side, have at most 1 % of their nodes without
    /// texture (beyond those that no size heals) and converged in every trial, the smallest whose uncertainty is within
    /// the target; when a period is to be resolved, the largest that resolves it.
    pub(super) fn new(
        noise: &Noise,
        texture: &TextureFigures,
        results: &[SizeResult],
        bias: &[Bias],
        options: &Options,
    ) -> Self {
        let speckle = texture.larger_speckle_px();
        // What no size heals is not the size's fault: there is no texture at all.
        let bare_percent = results.iter().map(|result| result.refused_percent).fold(100.0, f64::min);
        let sound = |result: &&SizeResult| {
            let converged = result.measured.as_ref().is_some_and(|scatter| scatter.n_pairs_failed == 0);
            converged && result.refused_percent <= bare_percent + REFUSED_PERCENT
        };
        let holds_speckles =
            |result: &&SizeResult| speckle.is_none_or(|speckle| result.element_size_px as f64 >= SPECKLES * speckle);
        let mut reasons = Vec::new();
        let mut fit: Vec<&SizeResult> = results.iter().filter(|r| sound(r) && holds_speckles(r)).collect();
        if fit.is_empty() {
            fit.extend(results.iter().rfind(sound));
            if let (Some(largest), Some(speckle)) = (fit.first(), speckle) {
                reasons.push(format!(
                    "no size tried holds {SPECKLES} speckles of {speckle:.1} px along a side; {} px is the largest tried",
                    largest.element_size_px
                ));
            }
        } else if let Some(speckle) = speckle {
            let least = SPECKLES * speckle;
            reasons.push(format!("{SPECKLES} speckles of {speckle:.1} px along a side need {least:.0} px or more"));
        }
        let target = options.target_sigma_px;
        let within = |result: &SizeResult| result.sigma_px().is_some_and(|sigma| sigma <= target);
        let (chosen, period_met) = match options.resolve_period_px {
            Some(period) => {
                let resolving = fit.iter().rfind(|result| result.period_px() <= period);
                (resolving.or(fit.first()).copied(), Some(resolving.is_some()))
            }
            None => (fit.iter().find(|result| within(result)).or(fit.last()).copied(), None),
        };
        let mut hints = about_images(noise, texture);
        if bare_percent > REFUSED_PERCENT {
            hints.push(format!(
                "{bare_percent:.0} % of the nodes see no texture with any size tried: choose the specimen with --roi"
            ));
        }
        let Some(chosen) = chosen else {
            reasons.push(
                "every size tried leaves nodes without texture or pairs that do not converge: \
                 improve speckles, focus or light, or choose another region"
                    .into(),
            );
            return Self { element_size_px: None, target_met: false, period_met, reasons, hints };
        };
        let size = chosen.element_size_px;
        let sigma = chosen.sigma_px().unwrap_or(f64::INFINITY);
        let period = chosen.period_px();
        match (period_met, options.resolve_period_px) {
            (Some(true), Some(asked)) => {
                reasons.push(format!("{size} px is the largest size tried that resolves {asked} px ({period:.0} px)"));
            }
            (Some(false), Some(asked)) => reasons.push(format!(
                "no sound size resolves {asked} px; {size} px is the smallest, and resolves {period:.0} px"
            )),
            _ if within(chosen) => reasons.push(format!(
                "{size} px is the smallest of these with an uncertainty within {target} px ({sigma:.4} px); \
                 it resolves periods from {period:.0} px on"
            )),
            _ => reasons.push(format!(
                "no size tried reaches {target} px; {size} px is the largest ({sigma:.4} px); \
                 it resolves periods from {period:.0} px on"
            )),
        }
        if period_met.is_some() {
            let verdict = if within(chosen) { "within" } else { "above" };
            reasons.push(format!("its uncertainty is {sigma:.4} px, {verdict} the target of {target} px"));
        }
        hints.extend(about_bias(bias, options.interpolation, sigma));
        Self { element_size_px: Some(size), target_met: within(chosen), period_met, reasons, hints }
    }
}

/// From this factor on the standard uncertainty, noise that is not white is worth a word.
const CORRELATED: f64 = 1.1;

fn about_images(noise: &Noise, texture: &TextureFigures) -> Vec<String> {
    let mut hints = Vec::new();
    if noise.origin == Origin::Assumed {
        hints.push(
            "the noise is assumed, not measured, and rather too large: all uncertainties scale with it; one more \
             image of the specimen at rest, named after the reference, measures it"
                .into(),
        );
    }
    if noise.sigma_grey > 1.25 * noise.ceiling_grey {
        hints.push(format!(
            "the reference can hold no more than {:.2} grey levels of white noise: the images are not equally \
             noisy, or what differs between them is not all noise",
            noise.ceiling_grey
        ));
    }
    if noise.depends_on_grey() {
        let parts: Vec<_> = noise.by_grey.iter().map(|part| format!("{:.2}", part.sigma_grey)).collect();
        hints.push(format!(
            "the noise depends on the grey level ({} from dark to bright); the uncertainties are made with the mean",
            parts.join(", ")
        ));
    }
    let factor = noise.correlation.as_ref().and_then(|found| found.factor);
    if let Some([x, y]) = factor.filter(|factor| factor[0].max(factor[1]) > CORRELATED) {
        hints.push(format!(
            "the noise is correlated from pixel to pixel: displacements are {:.2} times as uncertain as the table, which \
             supposes white noise, says (correlate --noise-correlation {:.2})",
            x.max(y),
            x.max(y)
        ));
    }
    for pair in &noise.pairs {
        if pair.drift_px.iter().any(|u| u.abs() > 0.5) || pair.rotation_deg.abs() > 0.05 {
            hints.push(format!(
                "{}: moved by ({:.2}, {:.2}) px and {:.3} deg since the reference: that is not at rest, and what \
                 cannot be undone counts as noise",
                pair.name, pair.drift_px[0], pair.drift_px[1], pair.rotation_deg
            ));
        }
    }
    match texture.larger_speckle_px() {
        None => hints.push("the texture is coarser than 32 px in some direction: no speckle size".into()),
        Some(_) => {
            let [x, y] = texture.speckle_px.map(|s| s.unwrap_or(f64::NAN));
            let (small, large) = (x.min(y), x.max(y));
            if small < FINE_PX {
                hints.push(format!(
                    "speckles of {small:.1} px are too fine: below {FINE_PX} px they are aliased, which biases \
                     displacements in a way that no moved copy of this image can show; larger speckles or more \
                     magnification help"
                ));
            }
            if large > COARSE_PX {
                hints.push(format!(
                    "speckles of {large:.1} px are coarse: finer ones (4 to 5 px) would allow smaller elements"
                ));
            }
            if large > 1.5 * small {
                hints.push(format!(
                    "speckles measure {x:.1} px along x and {y:.1} px along y: blurred or moved while exposed?"
                ));
            }
        }
    }
    for (percent, end) in texture.saturated_percent.into_iter().zip(["dark", "bright"]) {
        if percent > SATURATED_PERCENT {
            hints.push(format!("{percent:.1} % of the pixels are saturated at the {end} end: change the exposure"));
        }
    }
    if let Some(used) = texture.range_used_percent
        && used < RANGE_PERCENT
    {
        hints.push(format!("only {used:.0} % of the grey levels are used: more light or contrast lowers the noise"));
    }
    hints
}

fn about_bias(bias: &[Bias], used: Interpolation, sigma: f64) -> Option<String> {
    let largest =
        |wanted| bias.iter().find(|b| b.interpolation == wanted && !b.shift_px.is_empty()).map(|b| b.largest_px);
    let (own, best) = (largest(used)?, largest(Interpolation::Quintic)?);
    (own > BIAS_SHARE * sigma && best < 0.5 * own).then(|| {
        format!(
            "the bias of {} reaches {own:.1e} px, {:.0} % of the uncertainty: --interpolation quintic lowers it to {best:.1e} px",
            used.name(),
            100.0 * own / sigma
        )
    })
}
