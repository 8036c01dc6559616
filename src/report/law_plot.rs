//! The law drawn: traction against separation in a pure mode, with its band where the data give one.

use super::{Plot, PlotSeries, Style};
use crate::identify::CurveBand;

/// Names of the pure modes, their jumps and their tractions.
pub(super) const MODES: [(&str, &str, &str); 2] = [("opening", "D_n", "T_n"), ("sliding", "D_t", "T_t")];

/// The curve called `name`, with its band where `banded` says so.
pub(super) fn law_series(name: &str, curve: &CurveBand, style: Style, banded: bool) -> PlotSeries {
    let um: Vec<f64> = curve.jumps.iter().map(|jump| 1e3 * (jump.normal + jump.tangential)).collect();
    let series = PlotSeries::new(name, style, um, curve.traction.clone());
    if banded { series.with_limits(&curve.low, &curve.high) } else { series }
}

/// The law of a fit in pure opening (0) or sliding (1).
pub(super) fn law_plot(mode: usize, curve: &CurveBand) -> Plot {
    let series = law_series("fit, 95 % band", curve, Style::Line, true);
    mode_plot(format!("The law in pure {}", MODES[mode].0), mode, vec![series])
}

/// Curves of traction against separation in opening (0) or sliding (1).
pub(super) fn mode_plot(title: String, mode: usize, series: Vec<PlotSeries>) -> Plot {
    let (_, jump, traction) = MODES[mode];
    Plot::new(title, format!("{jump} (\u{b5}m)"), format!("{traction} (MPa)"), series)
}
