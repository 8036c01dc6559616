//! The law drawn: traction against separation in a pure mode, with its band where the data give one.

use super::{Axis, Plot, PlotSeries, Style};
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
    let (name, jump, traction) = MODES[mode];
    Plot {
        title: format!("The law in pure {name}"),
        x: Axis::linear(format!("{jump} (\u{b5}m)")),
        y: Axis::linear(format!("{traction} (MPa)")),
        series: vec![law_series("fit, 95 % band", curve, Style::Line, true)],
        ..Plot::default()
    }
}
