//! The load cell beside the prediction: the record, its table and its figure.

use super::{Name, Picture, Plot, PlotSeries, ReportError, Style, to_strings, version};
use crate::identify::{Band, LoadCell, LoadComparison};
use crate::io::joint::write_table;
use crate::remark::Remark;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};

/// Measured and computed force of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ForceRecord {
    /// The column of the load file.
    pub column: Name,
    /// The group of nodes whose reaction it is.
    pub group: String,
    /// The direction in which it counts, a unit vector.
    pub direction: [f64; 2],
    /// Width of the specimen.
    pub width_mm: f64,
    /// Standard uncertainty of a force; null where none is stated.
    #[serde(rename = "std_N")]
    pub std_n: Option<f64>,
    /// Whether it took part in the fit.
    pub used: bool,
    /// Root mean square of measured less computed force.
    #[serde(rename = "rms_N")]
    pub rms_n: f64,
    /// The same by the largest measured force, %; null where all are zero.
    pub rms_percent: Option<f64>,
    /// The largest difference, measured less computed.
    #[serde(rename = "largest_N")]
    pub largest_n: f64,
    /// Its instant.
    pub largest_at_instant: usize,
    /// The factor that brings the computed forces closest to the measured ones; null where all computed ones are zero.
    pub scale: Option<f64>,
    /// Place on the mid-line where the joint opens most, mm.
    #[serde(default)]
    pub opening_at_mm: [f64; 2],
    /// All that in words.
    pub text: String,
    /// The instants that have a force.
    pub points: Vec<ForcePoint>,
    /// What a user should look at; the remarks of the run have it too.
    #[serde(skip)]
    pub remark: Option<Remark>,
}

/// The force at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ForcePoint {
    /// The instant, from 1.
    pub instant: usize,
    /// What the load cell showed.
    #[serde(rename = "measured_N")]
    pub measured_n: f64,
    /// The reaction of the model times the width.
    #[serde(rename = "computed_N")]
    pub computed_n: f64,
    /// Opening of the joint where it opens most.
    #[serde(default)]
    pub opening_mm: f64,
    /// Standard uncertainty of the computed force after a fit: noise of the measurement and uncertain constants.
    #[serde(rename = "computed_std_N", default)]
    pub computed_std_n: Option<f64>,
    /// Ends of its 95 % band, which also holds what the bands of the tractions hold.
    #[serde(rename = "computed_95_N", default)]
    pub computed_95_n: Option<[f64; 2]>,
}

impl ForceRecord {
    /// What `cell` measured beside what was computed; `used` where it took part in the fit.
    pub fn of(cell: &LoadCell, comparison: &LoadComparison, used: bool) -> Self {
        let (openings, opening_at_mm) = &comparison.openings;
        let point = |(&(instant, measured_n, computed_n), &opening_mm): (&(usize, f64, f64), &f64)| ForcePoint {
            instant,
            measured_n,
            computed_n,
            opening_mm,
            computed_std_n: None,
            computed_95_n: None,
        };
        Self {
            column: cell.column.clone().into(),
            group: cell.group.name.clone(),
            direction: cell.direction,
            width_mm: cell.width_mm,
            std_n: cell.std_n,
            used,
            rms_n: comparison.rms_n,
            rms_percent: (comparison.peak_n > 0.0).then(|| 100.0 * comparison.rms_n / comparison.peak_n),
            largest_n: comparison.largest.0,
            largest_at_instant: comparison.largest.1,
            scale: comparison.scale,
            text: comparison.text(cell),
            opening_at_mm: *opening_at_mm,
            points: comparison.points.iter().zip(openings).map(point).collect(),
            remark: comparison.remark(cell),
        }
    }

    /// The same with what the fit of `bands` says of the computed force.
    pub(super) fn with_bands(mut self, bands: &[Band]) -> Self {
        for point in &mut self.points {
            let force = bands.iter().find(|band| band.instant == point.instant).and_then(|band| band.force);
            point.computed_std_n = force.map(|force| force.std_n);
            let ends = |[below, above]: [f64; 2]| [point.computed_n - below, point.computed_n + above];
            point.computed_95_n = force.map(|force| ends(force.sides_n));
        }
        self
    }

    /// Writes `force.csv`.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        let mut columns = vec!["instant", "measured_N", "computed_N", "opening_mm"];
        let banded = self.points.iter().any(|at| at.computed_std_n.is_some());
        if banded {
            columns.extend(["computed_std_N", "computed_low_N", "computed_high_N"]);
        }
        let row = |at: &ForcePoint| {
            let mut values = vec![at.measured_n, at.computed_n, at.opening_mm];
            if banded {
                let [low, high] = at.computed_95_n.unwrap_or([f64::NAN; 2]);
                values.extend([at.computed_std_n.unwrap_or(f64::NAN), low, high]);
            }
            (vec![at.instant as u64], values)
        };
        write_table(out, &[version(), self.text.clone()], &to_strings(&columns), self.points.iter().map(row))
    }

    /// Measured and computed force, each picture with its name: `force` over the instants, `force-opening` over the opening
    /// of a joint that opens.
    ///
    /// # Errors
    /// Values without a finite range.
    pub fn draw(&self) -> Result<Vec<(&'static str, Picture)>, ReportError> {
        ["force", "force-opening"].into_iter().zip(self.plots()).map(|(name, plot)| Ok((name, plot.draw()?))).collect()
    }

    /// The same before they are drawn.
    pub(super) fn plots(&self) -> Vec<Plot> {
        /// An opening, mm, below which there is nothing but rounding.
        const NONE: f64 = 1e-9;
        let [x, y] = self.opening_at_mm;
        let opening = format!("opening at ({x:.2}, {y:.2}) mm, where it is largest (mm)");
        let opens = self.points.iter().any(|point| point.opening_mm.abs() > NONE);
        let over_opening = opens.then(|| self.plot(&opening, |point| point.opening_mm));
        [self.plot("instant", |point| point.instant as f64)].into_iter().chain(over_opening).collect()
    }

    fn plot(&self, over: &str, x: fn(&ForcePoint) -> f64) -> Plot {
        let column = |of: fn(&ForcePoint) -> f64| self.points.iter().map(of).collect::<Vec<f64>>();
        let x = column(x);
        let mut measured = PlotSeries::new("measured", Style::Markers, x.clone(), column(|point| point.measured_n));
        if let Some(std) = self.std_n {
            measured = measured.with_band(vec![1.96 * std; x.len()]);
        }
        let mut computed = PlotSeries::new("computed", Style::Line, x, column(|point| point.computed_n));
        let mut used = if self.used { "It took part in the fit." } else { "It took no part in a fit." };
        let ends: Option<Vec<[f64; 2]>> = self.points.iter().map(|point| point.computed_95_n).collect();
        if let Some(ends) = ends.filter(|ends| !ends.is_empty()) {
            let [low, high] = [0, 1].map(|side| ends.iter().map(|ends| ends[side]).collect::<Vec<f64>>());
            computed = computed.with_limits(&low, &high);
            used = match self.used {
                true => "It took part in the fit. Band: 95 %, noise and uncertain constants.",
                false => "It took no part in a fit. Band: 95 %, noise and uncertain constants, the width as stated.",
            };
        }
        let plot = Plot::new(format!("Force on {}", self.group), over, "force (N)", [measured, computed]);
        plot.with_note(&self.text).with_note(used)
    }
}
