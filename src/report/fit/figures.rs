//! Figures of an identification.

use super::FitReport;
use crate::identify::{Band, FitStatus, FittedParameter, Iteration, NORMAL_95, Profile};
use crate::mechanics::cohesive::{Parameter, Traction};
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
            for (name, picture) in force.draw()? {
                save(name.into(), picture)?;
            }
        }
        save("fit-history".into(), self.history()?)?;
        save("parameters".into(), self.parameters()?)?;
        for (mode, curve) in self.curves.iter().enumerate().filter(|(_, curve)| !curve.jumps.is_empty()) {
            let plot = law_plot(mode, curve);
            save(format!("law-{}", MODES[mode].0), plot.draw()?)?;
        }
        let along: Vec<f64> =
            self.case.problem.joint.model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let normal: fn(&Traction) -> f64 = |t| t.normal;
        for (name, label, which, pick) in
            [("tn", "T_n (MPa)", "Normal", normal), ("tt", "T_t (MPa)", "Tangential", |t| t.tangential)]
        {
            let band = |band: &Band| {
                let [y, low, high] =
                    [&band.traction, &band.low, &band.high].map(|list| list.iter().map(pick).collect::<Vec<f64>>());
                let series = PlotSeries::new(format!("instant {}", band.instant), Style::Line, along.clone(), y);
                series.with_limits(&low, &high)
            };
            let bands = self.bands.iter().filter(|band| chosen.contains(&band.instant));
            let title = format!("{which} traction along the joint, 95 % bands");
            let plot = Plot::new(title, "distance along the joint (mm)", label, bands.map(band))
                .with_note(format!("bands: {}", self.bands_hold()));
            if !(plot.series.is_empty() || along.is_empty()) {
                save(format!("{name}-bands"), plot.draw()?)?;
            }
        }
        if let Some(Profile { name, values, rise, .. }) = self.profile.as_ref().filter(|p| p.values.len() > 1) {
            let series = PlotSeries::new("", Style::LineAndMarkers, values.clone(), rise.clone());
            let plot = Plot::new(format!("Profile likelihood of {name}"), name, "rise of the objective", [series])
                .with_note(format!("95 % interval: where the rise is below {:.2}", NORMAL_95 * NORMAL_95));
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
        let y = Axis::log("omega / last of its stage");
        let plot = Plot::new("Objective against evaluation", "evaluation", y, series);
        match self.fit.status {
            FitStatus::Converged => plot.with_note(ended).draw(),
            _ => Plot { warnings: vec![ended], ..plot }.draw(),
        }
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
        let in_words = |&FittedParameter { parameter: Parameter { name, unit, .. }, value, std, .. }: &_| match std {
            Some(std) => format!("{name} = {value:.5} \u{b1} {std:.2e} {unit} (standard uncertainty)"),
            None => format!("{name} = {value:.5} {unit}"),
        };
        let notes = self.fit.parameters.iter().map(in_words).collect();
        let y = "value over the value at the end; band: 95 % at the end";
        Plot { notes, ..Plot::new("Parameters against evaluation", "evaluation", y, series) }.draw()
    }
}
