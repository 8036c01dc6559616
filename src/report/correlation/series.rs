//! What changes from frame to frame, and what was drawn from the fields.

use super::gauge::median_sigma;
use super::{CorrelationReport, POINTS, spread};
use crate::field::{Curve, Measurement, StrainField};
use crate::io::load::LoadColumn;
use crate::io::quantities::LineHistory;
use crate::report::page::{Block, Section};
use crate::report::summary::FrameSummary;
use crate::report::{Cells, Palette, Plot, PlotSeries, ReportError, Style};
use crate::units::Px;

/// Curves of quantities that are drawn, at most.
const CURVES: usize = 36;

/// What is read of a field for the curves over the series.
#[derive(Debug, Clone)]
pub struct SeriesPoint {
    /// Number of the frame.
    pub number: usize,
    /// Mean of exx, eyy and exy over the elements of each zone.
    pub strain: Vec<Option<[f64; 3]>>,
    /// Median standard uncertainty of a nodal displacement, x and y.
    pub sigma_px: [f64; 2],
}

impl SeriesPoint {
    /// Of a field and its strains; `None` where no node is measured.
    pub fn new(number: usize, field: &Measurement<Px>, strain: &StrainField) -> Option<Self> {
        let mesh = &field.mesh;
        let mut sums = vec![([0.0; 3], 0.0); mesh.zones().len()];
        for (zone, strain) in mesh.element_zone().iter().zip(&strain.elements) {
            if let (Some(strain), (sum, n)) = (strain, &mut sums[*zone as usize]) {
                sum.iter_mut().zip(strain.components()).for_each(|(sum, e)| *sum += e);
                *n += 1.0;
            }
        }
        let mean = |(sum, n): ([f64; 3], f64)| (n > 0.0).then(|| sum.map(|v| v / n));
        Some(Self { number, strain: sums.into_iter().map(mean).collect(), sigma_px: median_sigma(field)? })
    }
}

/// A quantity of a frame.
type OfFrame<'a> = &'a dyn Fn(&FrameSummary) -> Option<f64>;

impl CorrelationReport<'_> {
    pub(super) fn series(&self) -> Result<Option<Section>, ReportError> {
        let frames = &self.summary.frames;
        if frames.len() < 2 {
            return Ok(None);
        }
        let thin: Vec<&FrameSummary> = spread(frames.len(), POINTS).into_iter().map(|k| &frames[k]).collect();
        let style = if thin.len() > 40 { Style::Line } else { Style::LineAndMarkers };
        let over = |name: &str, of: OfFrame<'_>| {
            let (x, y) = thin.iter().map(|frame| (frame.number as f64, of(frame).unwrap_or(f64::NAN))).unzip();
            PlotSeries::new(name, style, x, y)
        };
        let mut blocks = Vec::new();
        let mut draw = |title: &str, y: &str, series: Vec<PlotSeries>, caption: &str| {
            blocks.push(Block::curves(&Plot::new(title, "frame", y, series), caption)?);
            Ok::<_, ReportError>(())
        };
        let shift = |c: usize| move |frame: &FrameSummary| frame.rigid_motion.as_ref().map(|m| m.translation_px[c]);
        let series = vec![over("x, to the right", &shift(0)), over("y, down", &shift(1))];
        let caption = "Of all measured nodes, at their centre";
        draw("Rigid motion: translation", "translation (px)", series, caption)?;
        let series = vec![over("", &|frame| frame.rigid_motion.as_ref().map(|m| m.rotation_deg))];
        draw("Rigid motion: rotation", "rotation (degrees)", series, "Positive clockwise in the image")?;
        let of_sampled = |name: String, of: &dyn Fn(&SeriesPoint) -> Option<f64>| {
            let points = self.sampled.iter();
            let (x, y) = points.map(|point| (point.number as f64, of(point).unwrap_or(f64::NAN))).unzip();
            PlotSeries::new(name, Style::LineAndMarkers, x, y)
        };
        let n_zones = self.sampled.iter().map(|point| point.strain.len()).max().unwrap_or(0);
        let components = ["exx", "eyy", "exy"];
        let mut strains = Vec::new();
        // More zones would be more lines than anybody can tell apart.
        for zone in 0..n_zones.min(2) {
            for (c, name) in components.into_iter().enumerate() {
                let name = match self.drawn.last().filter(|_| n_zones > 1) {
                    Some(frame) => format!("{name}, {}", frame.field.mesh.zones()[zone]),
                    None => name.to_owned(),
                };
                strains.push(of_sampled(name, &|point| point.strain.get(zone).copied().flatten().map(|e| e[c])));
            }
        }
        let caption = "Mean over the elements of a zone (of the first two); for a long series, some of its frames";
        draw("Mean strain", "strain", strains, caption)?;
        let noise = |frame: &FrameSummary| {
            let known: Vec<f64> = frame.zones.iter().map(|zone| zone.noise_grey).filter(|v| v.is_finite()).collect();
            (!known.is_empty()).then(|| (known.iter().map(|v| v * v).sum::<f64>() / known.len() as f64).sqrt())
        };
        let series = vec![over("residual, rms", &|frame| frame.residual_grey), over("noise of one image", &noise)];
        let caption = "With noise alone the residual is 1.2 to 1.4 times the noise of one image; where it rises, \
                       something is not followed";
        draw("Residual and noise", "grey levels", series, caption)?;
        let sigma = |c: usize| move |point: &SeriesPoint| Some(point.sigma_px[c]);
        let series = vec![of_sampled("ux".into(), &sigma(0)), of_sampled("uy".into(), &sigma(1))];
        let caption = "Median over the nodes; for a long series, some of its frames";
        draw("Standard uncertainty of a nodal displacement", "standard uncertainty (px)", series, caption)?;
        Ok(Some(Section { title: "Over the series".into(), blocks: vec![Block::Grid(blocks)] }))
    }

    pub(super) fn quantities(&self) -> Result<Option<Section>, ReportError> {
        let curves: Vec<&Curve> = self.quantities.curves.iter().filter(|curve| curve.x.len() > 1).collect();
        let times = self.quantities.times.as_ref();
        let maps = self.quantities.lines.iter().flat_map(|line| line_maps(line, times));
        let maps = maps.take(CURVES).map(|(_, plot)| Block::curves(&plot, "White: no value"));
        let mut blocks = maps.collect::<Result<Vec<_>, _>>()?;
        if curves.is_empty() && blocks.is_empty() {
            return Ok(None);
        }
        let bound =
            if self.is_regularised() { " (upper bounds: neighbouring nodes are bound to each other)" } else { "" };
        let bars = format!("Bars: \u{b1}2 standard uncertainties{bound}");
        for curve in curves.iter().take(CURVES) {
            let places = spread(curve.x.len(), POINTS);
            let thin = |values: &[f64]| places.iter().map(|&k| values[k]).collect::<Vec<f64>>();
            let thin = Curve { x: thin(&curve.x), y: thin(&curve.y), sigma: thin(&curve.sigma), ..(*curve).clone() };
            let (plot, caption) = match curve.is_against_load() {
                true => (turn_axes(&thin), "x: the measured quantity; its standard uncertainty is in quantities/"),
                false => (along_load(&thin), &*bars),
            };
            blocks.push(Block::curves(&plot, caption)?);
        }
        let mut section = vec![Block::Grid(blocks)];
        if curves.len() > CURVES {
            section.push(Block::Text(format!(
                "{} further curves are not drawn here; `quadrille probe --curves` draws them all.",
                curves.len() - CURVES
            )));
        }
        Ok(Some(Section { title: "Quantities".into(), blocks: section }))
    }
}

/// The quantity along y, with bars of two standard uncertainties, and what it is against along x.
pub fn along_load(curve: &Curve) -> Plot {
    let band = curve.sigma.iter().map(|sigma| 2.0 * sigma).collect();
    let series = PlotSeries::new("", Style::LineAndMarkers, curve.x.clone(), curve.y.clone()).with_band(band);
    draw_curve(curve, series, [curve.against_in_words(), curve.quantity_in_words()])
}

/// What it is against along y, the quantity along x: load over opening, stress over strain.
pub fn turn_axes(curve: &Curve) -> Plot {
    let series = PlotSeries::new("", Style::LineAndMarkers, curve.y.clone(), curve.x.clone());
    draw_curve(curve, series, [curve.quantity_in_words(), curve.against_in_words()])
}

/// What lies along a line over the frames, or over their times where these are known: a map for each quantity, by its
/// name in tables, and the name of what it is over.
pub fn line_maps(line: &LineHistory, times: Option<&LoadColumn>) -> Vec<([String; 2], Plot)> {
    let at = |frame: usize| times.map_or(Some(frame as f64), |times| times.at(frame));
    let mut columns: Vec<(f64, usize)> =
        line.frames.iter().enumerate().filter_map(|(k, &frame)| Some((at(frame)?, k))).collect();
    columns.sort_by(|a, b| a.0.total_cmp(&b.0));
    columns.dedup_by_key(|column| column.0);
    let over = times.map_or("frame", |times| &times.name);
    let in_words = |name: &str| {
        let (name, unit) = match (name.strip_suffix("_px"), name.strip_suffix("_s")) {
            (Some(of), _) => (of, " (px)"),
            (_, Some(of)) => (of, " (s)"),
            _ => (name, ""),
        };
        format!("{}{unit}", name.replace('_', " "))
    };
    let map = |(k, quantity): (usize, &&str)| {
        let values = |column: &(f64, usize)| line.values.get(column.1)?.get(k).cloned();
        let palette = if quantity.starts_with('u') { Palette::Viridis } else { Palette::BlueRed };
        let cells = Cells {
            x: columns.iter().map(|column| column.0).collect(),
            y: line.along_px.clone(),
            values: columns.iter().filter_map(values).collect(),
            label: in_words(quantity),
            palette,
        };
        let title = format!("{}: {} along it over the series", line.name, in_words(quantity));
        let plot = Plot::new(title, in_words(over), "along the line (px)", []);
        ([(*quantity).to_owned(), over.to_owned()], Plot { cells: Some(cells), ..plot })
    };
    if columns.len() < 2 { Vec::new() } else { line.quantities.iter().enumerate().map(map).collect() }
}

fn draw_curve(curve: &Curve, series: PlotSeries, [x, y]: [(String, String); 2]) -> Plot {
    let label = |(name, unit): &(String, String)| match unit.as_str() {
        "1" => name.clone(),
        unit => format!("{name} ({unit})"),
    };
    Plot::new(format!("{}: {} against {}", curve.name, y.0, x.0), label(&x), label(&y), [series])
}
