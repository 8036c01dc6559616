//! What calibrations say and draw alike.

use crate::camera::calibrate::{Estimate, Tried};
use crate::field::Measurement;
use crate::report::{Backdrop, Figure, FigureOptions, draw_frame};
use crate::run::words::Result;
use crate::units::Px;
use std::path::Path;

/// A camera is worth its name when it is known to a fraction of its value.
const KNOWN: f64 = 3.0;

/// Draws what the camera leaves of a field: structure in it is a lens that these coefficients do not describe, or a
/// specimen, or target, that is not what it was taken for.
pub(super) fn draw_residual(
    folder: &Path,
    number: usize,
    field: &Measurement<Px>,
    left: &[Option<[f64; 2]>],
    backdrop: &Backdrop,
    note: String,
) -> Result<()> {
    let residual = Measurement {
        displacement: left.iter().map(|left| left.unwrap_or_default()).collect(),
        measured: left.iter().map(Option::is_some).collect(),
        model_error: None,
        points: None,
        ..field.clone()
    };
    let options =
        FigureOptions { figures: vec![Figure::Ux, Figure::Uy], notes: vec![note], ..FigureOptions::default() };
    draw_frame(folder, number, &residual, backdrop, None, &options)?;
    Ok(())
}

/// Whether a group of coefficients was taken in.
pub(super) fn said_of_tried(tried: &Tried) -> String {
    let is_in = if tried.evidence > 0.0 { "taken in" } else { "left out" };
    format!("{}: {is_in}, by evidence ({:+.0}, Bayesian information criterion)", tried.names, tried.evidence)
}

/// A number of the camera, in the unit that `scale` brings it to.
pub(super) fn said_of(name: &str, estimate: &Estimate, scale: f64, unit: &str) -> String {
    let (value, std) = (scale * estimate.value, scale * estimate.std);
    match estimate {
        Estimate { is_determined: false, .. } => format!("{name}: not determined by these images (+- {std:.2} {unit})"),
        _ if value.abs() > KNOWN * std => {
            format!("{name}: {value:.4} +- {std:.4} {unit}, known to {:.1} %", 100.0 * std / value.abs())
        }
        _ => format!("{name}: zero within {value:.4} +- {std:.4} {unit}"),
    }
}
