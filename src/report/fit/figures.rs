//! Figures of an identification.

use super::FitReport;
use crate::identify::FitStatus;
use crate::identify::{Iteration, NORMAL_95};
use crate::report::law_plot::{MODES, law_plot};
use crate::report::{Axis, Picture, Plot, PlotSeries, ReportError, Style};

impl FitReport<'_> {
    /// Draws the history of the fit, the parameters, the law and the tractions at the `chosen` instants (from 1), each
    /// with its 95 % band; `save` is called with the name (without ending) of each picture.
    ///
    /// # Errors
    /// A picture without a finite range, and what `save` refuses.
    pub fn draw<E: From<ReportError>>(
        &self,
        chosen: &[usize],
        mut save: impl FnMut(String, Picture) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some(force) = &self.force {
            save("force".into(), force.draw()?)?;
        }
        save("fit-history".into(), self.history()?)?;
        save("parameters".into(), self.parameters()?)?;
        for (mode, curve) in self.curves.iter().enumerate() {
            let plot = law_plot(mode, curve);
            save(format!("law-{}", MODES[mode].0), plot.draw()?)?;
        }
        for (name, label, normal) in [("tn", "T_n (MPa)", true), ("tt", "T_t (MPa)", false)] {
            let along: Vec<f64> =
                self.case.problem.joint.model.pair_positions().into_iter().map(|(_, along)| along).collect();
            let series: Vec<PlotSeries> = (self.bands.iter().filter(|band| chosen.contains(&band.instant)))
                .map(|band| {
                    let pick = |t: &crate::mechanics::cohesive::Traction| if normal { t.normal } else { t.tangential };
                    let [y, low, high] =
                        [&band.traction, &band.low, &band.high].map(|list| list.iter().map(pick).collect::<Vec<f64>>());
                    PlotSeries::new(format!("instant {}", band.instant), Style::Line, along.clone(), y)
                        .with_limits(&low, &high)
                })
                .collect();
            if series.is_empty() {
                continue;
            }
            let plot = Plot {
                title: format!("{} traction along the joint, 95 % bands", if normal { "Normal" } else { "Tangential" }),
                x: Axis::linear("distance along the joint (mm)"),
                y: Axis::linear(label),
                series,
                notes: vec![format!("bands: {}", self.bands_hold())],
                ..Plot::default()
            };
            save(format!("{name}-bands"), plot.draw()?)?;
        }
        if let Some(profile) = &self.profile
            && profile.values.len() > 1
        {
            let plot = Plot {
                title: format!("Profile likelihood of {}", profile.name),
                x: Axis::linear(profile.name),
                y: Axis::linear("rise of the objective"),
                series: vec![PlotSeries::new("", Style::LineAndMarkers, profile.values.clone(), profile.rise.clone())],
                notes: vec![format!("95 % interval: where the rise is below {:.2}", NORMAL_95 * NORMAL_95)],
                ..Plot::default()
            };
            save("profile".into(), plot.draw()?)?;
        }
        Ok(())
    }

    /// The objective over the evaluations, stage by stage: each has weights of its own.
    fn history(&self) -> Result<Picture, ReportError> {
        let history = &self.fit.history;
        let n_stages = history.last().map_or(0, |i| i.stage);
        let mut series = Vec::new();
        let (mut x_refused, mut y_refused) = (Vec::new(), Vec::new());
        for stage in 1..=n_stages {
            let of_stage = || history.iter().enumerate().filter(|(_, i)| i.stage == stage);
            let positive = |i: &Iteration| i.omega.filter(|omega| *omega > 0.0);
            let last = of_stage().rev().filter(|(_, i)| i.accepted).find_map(|(_, i)| positive(i));
            let Some(last) = last else { continue };
            let points = |accepted: bool| -> (Vec<f64>, Vec<f64>) {
                let list = of_stage().filter(|(_, i)| i.accepted == accepted);
                list.filter_map(|(k, i)| Some((k as f64, positive(i)? / last))).unzip()
            };
            let (x, y) = points(true);
            let name = if n_stages > 1 { format!("stage {stage}") } else { "accepted".into() };
            series.push(PlotSeries::new(name, Style::LineAndMarkers, x, y));
            let (x, y) = points(false);
            x_refused.extend(x);
            y_refused.extend(y);
        }
        if !x_refused.is_empty() {
            series.push(PlotSeries::new("refused", Style::Markers, x_refused, y_refused));
        }
        let ended = format!("{}: {}", self.fit.status.name(), self.fit.reason);
        let has_converged = self.fit.status == FitStatus::Converged;
        Plot {
            title: "Objective against evaluation".into(),
            x: Axis::linear("evaluation"),
            y: Axis::log("omega / last of its stage"),
            series,
            notes: if has_converged { vec![ended.clone()] } else { Vec::new() },
            warnings: if has_converged { Vec::new() } else { vec![ended] },
        }
        .draw()
    }

    /// The parameters over the evaluations, relative to where they ended, with the 95 % interval at the end.
    fn parameters(&self) -> Result<Picture, ReportError> {
        let mut series = Vec::new();
        for (k, p) in self.fit.parameters.iter().enumerate() {
            let accepted = self.fit.history.iter().enumerate().filter(|(_, i)| i.accepted);
            let (x, y): (Vec<f64>, Vec<f64>) = accepted.map(|(e, i)| (e as f64, i.z[k] / p.value)).unzip();
            let mut one = PlotSeries::new(p.parameter.name, Style::LineAndMarkers, x, y);
            if let Some([low, high]) = p.interval95 {
                // How far the interval reaches from the value, about every point.
                let reach = |end: f64| (end - p.value) / p.value.abs();
                let [low, high] = [low, high].map(|end| one.y.iter().map(|y| y + reach(end)).collect::<Vec<f64>>());
                one = one.with_limits(&low, &high);
            }
            series.push(one);
        }
        let in_words = |p: &crate::identify::FittedParameter| match p.std {
            Some(std) => format!(
                "{} = {:.5} \u{b1} {:.2e} {} (standard uncertainty)",
                p.parameter.name, p.value, std, p.parameter.unit
            ),
            None => format!("{} = {:.5} {}", p.parameter.name, p.value, p.parameter.unit),
        };
        Plot {
            title: "Parameters against evaluation".into(),
            x: Axis::linear("evaluation"),
            y: Axis::linear("value over the value at the end; band: 95 % at the end"),
            series,
            notes: self.fit.parameters.iter().map(in_words).collect(),
            ..Plot::default()
        }
        .draw()
    }
}
