//! Measured against computed, and the tractions of the law.

use super::{IdentificationReport, choose_instants};
use crate::field::Measurement;
use crate::mechanics::Joint;
use crate::mechanics::cohesive::Jump;
use crate::report::fit::Banded;
use crate::report::law_plot::mode_plot;
use crate::report::page::{Block, Section};
use crate::report::words::significant;
use crate::report::{Axis, Plot, PlotSeries, ReportError, Style};
use crate::units::{PixelSize, Px, Vector};

/// Measured displacement of a node at instant `at` (from 0) of `joint`, mm with y up, less the rigid motion where that
/// was removed; `None` where none was measured.
pub fn measured_mm(
    field: &Measurement<Px>,
    scale: PixelSize,
    joint: &Joint,
    at: usize,
    node: usize,
) -> Option<[f64; 2]> {
    let (&measured, &u) = (field.measured.get(node)?, field.displacement.get(node)?);
    let u = measured.then(|| scale.to_mm(Vector::new(u)).components())?;
    let Some(motion) = joint.removed.get(at) else { return Some(u) };
    let rigid = motion.displacement(*joint.model.mesh().nodes().get(node)?);
    let (sin, cos) = motion.rotation_rad.sin_cos();
    let rest = [u[0] - rigid[0], u[1] - rigid[1]];
    Some([cos * rest[0] + sin * rest[1], -sin * rest[0] + cos * rest[1]])
}

impl IdentificationReport<'_> {
    /// Instants that have a solution, of those to be drawn.
    fn drawn_instants(&self) -> Vec<usize> {
        let solved: Vec<usize> = (0..self.computed.len()).filter(|&k| !self.computed[k].is_empty()).collect();
        choose_instants(solved.len()).into_iter().map(|k| solved[k]).collect()
    }

    /// Name of instant `at` in legends.
    fn name_of(&self, at: usize) -> String {
        match self.frames.get(at) {
            Some((number, _)) => format!("frame {number}"),
            None => format!("instant {}", at + 1),
        }
    }

    /// Measured displacement of a node at an instant, mm with y up, less the rigid motion where that was removed.
    fn measured_displacement(&self, at: usize, node: usize) -> Option<[f64; 2]> {
        let (_, field) = self.frames.get(at)?;
        measured_mm(field, self.pixel_size, self.joint, at, node)
    }

    pub(super) fn comparison(&self) -> Result<Section, ReportError> {
        let mut blocks = vec![Block::text(
            "Jumps across the adhesive, upper minus lower face. Points: measured, with two standard uncertainties. Lines: computed with the law above, \
             the measured displacement of the outer border prescribed.",
        )];
        let model = &self.joint.model;
        let pairs = model.mesh().pairs();
        let positions: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let normals = model.pair_normals();
        let mut curves = Vec::new();
        for (title, label) in [("Opening", "opening (\u{b5}m)"), ("Sliding", "sliding (\u{b5}m)")] {
            let axis = |k: usize| if title == "Opening" { normals[k] } else { [normals[k][1], -normals[k][0]] };
            let along_axis = |k: usize, from: [f64; 2], to: [f64; 2]| -> f64 {
                axis(k).iter().zip(from).zip(to).map(|((axis, from), to)| axis * (to - from)).sum()
            };
            let mut series = Vec::new();
            for at in self.drawn_instants() {
                let u = &self.computed[at];
                let line = |k: usize| 1e3 * along_axis(k, u[pairs[k][0] as usize], u[pairs[k][1] as usize]);
                let line = (0..pairs.len()).map(line).collect();
                series.push(PlotSeries::new(self.name_of(at), Style::Line, positions.clone(), line));
            }
            // In the colour of its line.
            for (colour, at) in self.drawn_instants().into_iter().enumerate() {
                let (mut x, mut y, mut half) = (Vec::new(), Vec::new(), Vec::new());
                for (k, (&[lower, upper], along)) in pairs.iter().zip(&positions).enumerate() {
                    let both = [lower, upper].map(|node| self.measured_displacement(at, node as usize));
                    if let [Some(below), Some(above)] = both {
                        let sigma = |node: u32| {
                            let [x, y] = self.frames[at].1.sigma[node as usize];
                            self.pixel_size.mm_from_px((axis(k)[0] * x).hypot(axis(k)[1] * y))
                        };
                        x.push(*along);
                        y.push(1e3 * along_axis(k, below, above));
                        half.push(2e3 * sigma(lower).hypot(sigma(upper)));
                    }
                }
                let points = PlotSeries::new("", Style::Markers, x, y).with_band(half);
                series.push(PlotSeries { colour: Some(colour), ..points });
            }
            let about = format!("{title} along the joint, measured and computed");
            let plot = Plot::new(about, "distance along the joint (mm)", label, series);
            curves.push(Block::curves(&plot, format!("{title}: points measured, lines computed"))?);
        }
        blocks.push(Block::Grid(curves));
        let (mut instant, mut off, mut noise) = (Vec::new(), Vec::new(), Vec::new());
        for at in (0..self.computed.len()).filter(|&at| !self.computed[at].is_empty()) {
            let (mut sum, mut sigma, mut n) = (0.0, 0.0, 0.0);
            let Some((number, field)) = self.frames.get(at) else { continue };
            // Zones beside the joint are no part of it.
            for node in 0..field.displacement.len().min(model.mesh().nodes().len()) {
                let free = (0..2).all(|c| model.unknown(node, c).is_some());
                if let (Some(u), true) = (self.measured_displacement(at, node), free) {
                    for c in 0..2 {
                        sum += (u[c] - self.computed[at][node][c]).powi(2);
                        sigma += field.sigma[node][c].powi(2);
                        n += 1.0;
                    }
                }
            }
            if n > 0.0 {
                let px = |v: f64| (v / n).sqrt() / self.pixel_size.mm_per_px();
                instant.push(*number as f64);
                off.push(px(sum));
                noise.push((sigma / n).sqrt());
            }
        }
        if !instant.is_empty() {
            let highest = 1.3 * off.iter().chain(&noise).fold(1e-6, |most: f64, v| most.max(*v));
            let y = Axis::linear("root mean square (px)").with_range(0.0, highest);
            let series = [
                PlotSeries::new("measured less computed", Style::LineAndMarkers, instant.clone(), off),
                PlotSeries::new("uncertainty of the measurement", Style::Dashed, instant, noise),
            ];
            let plot = Plot::new("Measured less computed displacement, all free nodes", "frame", y, series);
            let caption = "A line that rises far above the uncertainty shows that the model does not follow the joint; \
                           a little above it is the noise of the prescribed border";
            blocks.push(Block::Grid(vec![Block::curves(&plot, caption)?]));
        }
        Ok(Section { title: "Measured against computed displacement".into(), blocks })
    }

    pub(super) fn tractions(&self) -> Result<Section, ReportError> {
        let model = &self.joint.model;
        let along: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let mut curves = Vec::new();
        for (c, title, label) in [(0, "Normal", "T_n (MPa)"), (1, "Tangential", "T_t (MPa)")] {
            let of_instant = |at: usize| match self.bands.iter().find(|band| band.instant == at + 1) {
                Some(band) => banded(self.name_of(at), &band.along_mm, &band.tractions[c]),
                None => {
                    let values = model.tractions(self.law, &self.computed[at]).into_iter();
                    let values = values.map(|t| if c == 0 { t.normal } else { t.tangential }).collect();
                    PlotSeries::new(self.name_of(at), Style::Line, along.clone(), values)
                }
            };
            let series = self.drawn_instants().into_iter().map(of_instant);
            let about = format!("{title} traction along the joint");
            let plot = Plot::new(about, "distance along the joint (mm)", label, series);
            curves.push(Block::curves(&plot, format!("{title} traction of the adhesive on the strips"))?);
        }
        for (mode, title) in ["Opening without sliding", "Sliding without opening"].into_iter().enumerate() {
            let plot = mode_plot(title.to_owned(), mode, vec![self.law_curve(mode)]);
            curves.push(Block::curves(&plot, format!("{title}: traction of the law against the jump"))?);
        }
        let bands = match (self.bands.is_empty(), self.fit.is_some_and(|fit| fit.discretisation == "included")) {
            (true, _) => "",
            (_, true) => {
                " Bands: 95 %, of the noise of the measurement and its border, uncertain constants and the element size; the \
                 numbers are those of traction-bands.csv and law.csv."
            }
            (_, false) => {
                " Bands: 95 %, of the noise of the measurement and its border and of uncertain constants; the numbers are \
                 those of traction-bands.csv and law.csv."
            }
        };
        let blocks = vec![
            Block::Text(format!(
                "Largest tractions of the law: T_n {} MPa in pure opening, T_t {} MPa in pure sliding.{bands}",
                significant(self.law.peak().normal, 4),
                significant(self.law.peak().tangential, 4)
            )),
            Block::Grid(curves),
        ];
        Ok(Section { title: "Tractions".into(), blocks })
    }

    /// Traction against separation in one pure mode, with the band of the fit.
    fn law_curve(&self, mode: usize) -> PlotSeries {
        let um = |jumps: &[f64]| jumps.iter().map(|jump| 1e3 * jump).collect::<Vec<f64>>();
        if let Some(modes) = self.law_bands {
            return banded(String::new(), &um(&modes[mode].jump_mm), &modes[mode].traction);
        }
        let jumps = self.computed.iter().filter(|u| !u.is_empty()).flat_map(|u| self.joint.model.jumps(u));
        let most_sliding = jumps.map(|jump| jump.tangential.abs()).fold(0.0, f64::max);
        let front = self.law.front_opening();
        let end = if mode == 0 { front } else { most_sliding.max(front) };
        let jumps: Vec<f64> = (0..=120).map(|k| end * f64::from(k) / 120.0).collect();
        let traction = |&d: &f64| match mode {
            0 => self.law.response(Jump { normal: d, tangential: 0.0 }).traction.normal,
            _ => self.law.response(Jump { normal: 0.0, tangential: d }).traction.tangential,
        };
        PlotSeries::new("", Style::Line, um(&jumps), jumps.iter().map(traction).collect())
    }
}

/// A line with its 95 % band.
fn banded(name: String, x: &[f64], Banded { value, low, high, .. }: &Banded) -> PlotSeries {
    PlotSeries::new(name, Style::Line, x.to_vec(), value.clone()).with_limits(low, high)
}
