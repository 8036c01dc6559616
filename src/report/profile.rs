//! A quantity along a line.

use super::figure::{FigureOptions, Values};
use super::map::warnings;
use super::{Axis, Plot, PlotSeries, ReportError, Style};
use crate::field::{Measurement, NodalNoise, PointValues, Segment, Value, at_point};
use crate::mesh::shape_functions;
use crate::units::Px;

/// Points of a profile, about.
const POINTS: f64 = 600.0;
/// Half the band around a profile in standard uncertainties.
const K: f64 = 2.0;

/// What is drawn along the line.
pub(super) enum Profiled<'a> {
    /// A number with its uncertainty at each point.
    Numbers(&'a dyn Fn(&PointValues) -> Option<Value>),
    /// Values without an uncertainty.
    Values(&'a Values),
}

/// The curve along `line`; title and ordinate are still to be named. There are gaps where nothing was measured.
pub(super) fn profile_plot(
    measurement: &Measurement<Px>,
    what: Profiled<'_>,
    is_strain: bool,
    line: [f64; 4],
    options: &FigureOptions,
) -> Result<Plot, ReportError> {
    let [x0, y0, x1, y1] = line;
    let length = (x1 - x0).hypot(y1 - y0);
    // Not finer than anybody can see; a line that is none is refused by `Segment`.
    let step = if length > 0.0 && length.is_finite() { length / POINTS } else { 1.0 };
    let points = Segment::new([x0, y0], [x1, y1], step)?.points();
    let mut values = vec![f64::NAN; points.len()];
    let mut half = None;
    match what {
        Profiled::Values(field) => sample(measurement, field, &points, &mut values),
        Profiled::Numbers(of) => {
            let noise = match options.known_noise {
                true => NodalNoise::of(measurement),
                false => NodalNoise::unknown_of(measurement),
            };
            let half = half.insert(vec![0.0; points.len()]);
            for (k, &(_, at)) in points.iter().enumerate() {
                let Some(there) = at_point(measurement, &noise, options.strain, at) else { continue };
                if let Some(Value { value, sigma }) = of(&there) {
                    values[k] = value;
                    half[k] = K * sigma;
                }
            }
        }
    }
    let mm = options.pixel_size.map_or(String::new(), |size| format!("; 1 px is {} mm", size.mm_per_px()));
    let mut notes = vec![format!("from A ({x0}, {y0}) px to B ({x1}, {y1}) px{mm}")];
    if is_strain {
        let definition = options.strain;
        notes.push(format!("{definition} strain, {}, over twice the element size", definition.formula()));
    }
    if half.is_some() {
        let bound =
            if options.known_noise { "" } else { " (upper bounds: neighbouring nodes are bound to each other)" };
        notes.push(format!("band: \u{b1}{K} standard uncertainties{bound}"));
    }
    let s = points.iter().map(|(s, _)| *s).collect();
    let mut series = PlotSeries::new("", Style::Line, s, values);
    series.band = half.map(|half| [half.clone(), half]);
    let x = Axis::linear("distance from A (px)").with_range(0.0, length);
    Ok(Plot { notes, warnings: warnings(measurement, true), ..Plot::new("", x, "", [series]) })
}

/// Interpolates nodal values, or takes those of the elements, at the points in elements with all nodes measured.
fn sample(measurement: &Measurement<Px>, field: &Values, points: &[(f64, [f64; 2])], values: &mut [f64]) {
    let mesh = &measurement.mesh;
    for ((_, [x, y]), value) in points.iter().zip(values) {
        let Some((element, xi, eta)) = mesh.find(*x, *y) else { continue };
        let nodes = mesh.elements()[element].map(|node| node as usize);
        if nodes.iter().all(|&node| measurement.measured[node]) {
            *value = match field {
                Values::Nodes(v) => shape_functions(xi, eta).iter().zip(nodes).map(|(n, node)| n * v[node]).sum(),
                Values::Elements(v) => v[element],
            };
        }
    }
}
