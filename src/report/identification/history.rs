//! How the fit went.

use super::IdentificationReport;
use crate::report::fit::{FitRecord, IterationRecord, StartRecord};
use crate::report::page::{Block, Section};
use crate::report::words::{plain_or_dash, significant};
use crate::report::{Axis, Plot, PlotSeries, ReportError, Style};
use std::collections::BTreeMap;

impl IdentificationReport<'_> {
    pub(super) fn history(&self, fit: &FitRecord) -> Result<Option<Section>, ReportError> {
        // Trials that were refused are in fit.json; the fit did not go on from them.
        let history: Vec<&IterationRecord> = fit.history.iter().filter(|entry| entry.accepted).collect();
        if history.is_empty() {
            return Ok(None);
        }
        let names = self.fitted_names();
        let step: Vec<f64> = (0..history.len()).map(|k| k as f64).collect();
        let omega: Vec<f64> = history.iter().map(|entry| entry.omega.unwrap_or(f64::NAN)).collect();
        let mut stages: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (k, entry) in history.iter().enumerate() {
            stages.entry(entry.stage).or_default().push(k);
        }
        let n_stages = stages.len();
        let stages = stages.into_iter().map(|(number, stage)| {
            let last = stage.last().map_or(1.0, |&k| omega[k]);
            let name = if n_stages > 1 { format!("stage {number}") } else { String::new() };
            let (x, y) = stage.iter().map(|&k| (step[k], omega[k] / last)).unzip();
            PlotSeries::new(name, Style::LineAndMarkers, x, y)
        });
        let y = Axis::log("omega / last of its stage");
        let caption = "The objective at every iteration; a stage is a run of the trust region with one kind of weights, \
                       the last with those asked for";
        let mut curves = vec![Block::curves(&Plot::new("Objective of the fit", "iteration", y, stages), caption)?];
        let series = names.iter().enumerate().filter_map(|(k, name)| {
            let of: Vec<f64> = history.iter().map(|entry| entry.x.get(k).copied().unwrap_or(f64::NAN)).collect();
            let last = *of.last().filter(|last| **last != 0.0 && last.is_finite())?;
            let of = of.iter().map(|v| v / last).collect();
            Some(PlotSeries::new(name.clone(), Style::LineAndMarkers, step.clone(), of))
        });
        let plot = Plot::new("Parameters over their last value", "iteration", "parameter / last value", series);
        if !plot.series.is_empty() {
            curves.push(Block::curves(&plot, "The parameters at every iteration")?);
        }
        let mut blocks = vec![Block::Grid(curves)];
        let starts = &fit.starts;
        if starts.len() > 1 {
            let list = |values: &[f64]| values.iter().map(|v| significant(*v, 5)).collect::<Vec<_>>().join(", ");
            let row = |entry: &StartRecord| {
                vec![list(&entry.start), list(&entry.end), plain_or_dash(entry.omega), entry.status.to_string()]
            };
            blocks.push(Block::Heading(format!("Further starts ({})", names.join(", "))));
            blocks.push(Block::table(&["start", "end", "omega", "status"], starts.iter().map(row)));
        }
        Ok(Some(Section { title: "How the fit went".into(), blocks }))
    }
}
