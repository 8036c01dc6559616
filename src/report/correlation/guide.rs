//! The reporting table of the good practice guide.

use super::CorrelationReport;
use super::gauge::median_sigma;
use crate::field::{Elements, Noise, RegularisationKind, StrainWindow};
use crate::report::page::{Block, Section};
use crate::report::summary::ReferenceSummary;
use crate::report::words::significant;

/// What stands where only the user knows.
const BLANK: &str = "________";

impl CorrelationReport<'_> {
    pub(super) fn guide(&self) -> Section {
        let summary = self.summary;
        let options = &self.case.correlation;
        let ReferenceSummary { width_px, height_px, depth, mean_of, .. } = &summary.reference;
        let given = self.case.report.entries().into_iter();
        let mut facts: Vec<(String, String)> =
            given.map(|(name, said)| (name.to_owned(), said.unwrap_or(BLANK).to_owned())).collect();
        let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
        add("image size and depth", format!("{width_px} x {height_px} px, {depth}"));
        let view = self.pixel_size.map(|size| {
            let [w, h] = [width_px, height_px].map(|&px| significant(size.mm_from_px(px as f64), 4));
            format!("{w} x {h} mm")
        });
        add("field of view", view.unwrap_or(BLANK.to_owned()));
        let scale = self.pixel_size.map(|size| format!("1 px = {} mm", significant(size.mm_per_px(), 5)));
        add("image scale", scale.unwrap_or("not given (--pixel-size)".to_owned()));
        let n_references = mean_of.len().max(1);
        add("number of images", format!("{n_references} reference, {} deformed", summary.frames.len()));
        add("DIC software", format!("quadrille {}, {}", summary.quadrille, summary.device));
        add("kind of DIC", "two-dimensional, global: all nodes of a zone are solved for together".into());
        add("subset size", format!("{} (side of the elements)", self.length(self.element_px)));
        add("step size", format!("{} (distance of the nodes)", self.length(self.element_px)));
        add("subset shape function", "bilinear, continuous between elements (Q4)".into());
        add("interpolation", options.interpolation.unwrap_or_default().name().to_owned());
        let brightness = options.brightness.map_or("auto".to_owned(), |brightness| brightness.to_string());
        let tolerance = significant(summary.tolerance_in_effect_px.unwrap_or(summary.tolerance_px), 2);
        let criterion = format!("sum of squared differences with gain and offset (brightness: {brightness})");
        add("matching criterion", format!("{criterion}; largest last correction {tolerance} px"));
        add("image filtering", "none (coarser scales of the search are means of pixels)".into());
        let filtering = match (options.regularisation, options.cutoff_px, options.elements) {
            (Some(kind), Some(cutoff), _) if kind != RegularisationKind::None => {
                format!("{kind} regularisation, cut-off {}", self.length(cutoff))
            }
            (_, _, Some(Elements::CubicSpline)) => "cubic splines with a knot every two elements".into(),
            _ => "none".into(),
        };
        add("displacement filtering", filtering);
        let reference = match options.update_reference {
            Some(update) if update.to_string() != "never" => format!("renewed ({update}), displacements added up"),
            _ => "the same for all frames".into(),
        };
        add("reference", reference);
        self.strain_rows(&mut add);
        self.noise_rows(&mut add);
        let text = "After the reporting requirements of the good practice guide of the International Digital Image Correlation \
                    Society. What the program cannot know is left blank: fill it in, or \
                    give it in [report] of the case file, from where the same command takes it.";
        Section { title: "Reporting table".into(), blocks: vec![Block::text(text), Block::Facts(facts)] }
    }

    fn strain_rows(&self, add: &mut impl FnMut(&str, String)) {
        let Some(last) = self.drawn.last() else { return };
        let definition = last.strain.definition;
        add("strain formulation", format!("{definition}, {}; tensor shear", definition.formula()));
        match last.strain.window.as_ref().map(|strains| strains.window) {
            Some(window) => {
                add("strain window", format!("{window}, plane fitted by least squares"));
                let length = self.length(window.gauge_length(self.element_px));
                add("virtual strain gauge", format!("(N - 1) L_step + L_subset = {length}"));
            }
            None => {
                add("strain window", "none: gradient of the shape functions at the centre of an element".into());
                add("virtual strain gauge", format!("{} (one element)", self.length(self.element_px)));
            }
        }
    }

    fn noise_rows(&self, add: &mut impl FnMut(&str, String)) {
        let frames = &self.summary.frames;
        let grey: Vec<f64> = frames.iter().flat_map(|frame| &frame.zones).map(|zone| zone.noise_grey).collect();
        let known: Vec<f64> = grey.into_iter().filter(|v| v.is_finite()).collect();
        if !known.is_empty() {
            let from = match self.case.correlation.noise {
                None | Some(Noise::Residual | Noise::PhotonOfResidual) => "from the residual",
                Some(_) => "as given",
            };
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            add("image noise", format!("{} grey levels, {from}", significant(mean, 3)));
        }
        let Some(first) = self.drawn.first() else { return };
        let Some(sigma) = median_sigma(&first.field) else { return };
        let [x, y] = sigma.map(|sigma| self.uncertainty(sigma));
        let value = format!("ux {x}, uy {y}: standard uncertainty, median of frame {}", first.number);
        add("displacement noise floor", value);
        let window = first.strain.window.as_ref().map(|strains| strains.window);
        let factor = window.map_or(crate::field::ELEMENT_NOISE, StrainWindow::noise);
        let [x, y] = sigma.map(|sigma| factor * sigma / self.element_px);
        let upper = if self.is_regularised() { ", were nodes not bound to each other" } else { "" };
        let resolution = format!("resolution (twice that) {:.1e}", 2.0 * x.max(y));
        let over = "standard uncertainty over the virtual strain gauge, inside";
        add("strain noise floor", format!("exx {x:.1e}, eyy {y:.1e}: {over}{upper}; {resolution}"));
    }
}
