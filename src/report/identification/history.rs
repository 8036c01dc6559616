//! How the fit went.

use super::IdentificationReport;
use crate::report::fit::{FitRecord, IterationRecord, StartRecord};
use crate::report::page::{Block, Curves, Section};
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
        let plot = |title: &str, y: Axis, series| Plot {
            title: title.to_owned(),
            x: Axis::linear("iteration"),
            y,
            series,
            ..Plot::default()
        };
        let mut stages: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (k, entry) in history.iter().enumerate() {
            stages.entry(entry.stage).or_default().push(k);
        }
        let n_stages = stages.len();
        let stages: Vec<PlotSeries> = stages
            .into_iter()
            .map(|(number, stage)| {
                let last = stage.last().map_or(1.0, |&k| omega[k]);
                let name = if n_stages > 1 { format!("stage {number}") } else { String::new() };
                let (x, y) = stage.iter().map(|&k| (step[k], omega[k] / last)).unzip();
                PlotSeries::new(name, Style::LineAndMarkers, x, y)
            })
            .collect();
        let mut curves = vec![Block::Curves(Curves::new(
            &plot("Objective of the fit", Axis::log("omega / last of its stage"), stages),
            "The objective at every iteration; a stage is a run of the trust region with one kind of weights, the last with those asked for",
        )?)];
        let series: Vec<PlotSeries> = names
            .iter()
            .enumerate()
            .filter_map(|(k, name)| {
                let of: Vec<f64> = history.iter().map(|entry| entry.x.get(k).copied().unwrap_or(f64::NAN)).collect();
                let last = *of.last()?;
                (last != 0.0 && last.is_finite()).then(|| {
                    PlotSeries::new(
                        name.clone(),
                        Style::LineAndMarkers,
                        step.clone(),
                        of.iter().map(|v| v / last).collect(),
                    )
                })
            })
            .collect();
        if !series.is_empty() {
            let drawn = plot("Parameters over their last value", Axis::linear("parameter / last value"), series);
            curves.push(Block::Curves(Curves::new(&drawn, "The parameters at every iteration")?));
        }
        let mut blocks = vec![Block::Grid(curves)];
        let starts = &fit.starts;
        if starts.len() > 1 {
            let list = |values: &[f64]| values.iter().map(|v| significant(*v, 5)).collect::<Vec<_>>().join(", ");
            let row = |entry: &StartRecord| {
                vec![list(&entry.start), list(&entry.end), plain_or_dash(entry.omega), entry.status.to_string()]
            };
            blocks.push(Block::Heading(format!("Further starts ({})", names.join(", "))));
            blocks.push(Block::Table {
                columns: ["start", "end", "omega", "status"].map(str::to_owned).into(),
                rows: starts.iter().map(row).collect(),
            });
        }
        Ok(Some(Section { title: "How the fit went".into(), blocks }))
    }
}
