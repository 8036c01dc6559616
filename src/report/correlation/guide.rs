//! The reporting table of the good practice guide.

use super::CorrelationReport;
use super::gauge::median_sigma;
use crate::field::{Elements, Noise, RegularisationKind, StrainWindow};
use crate::report::page::{Block, Section};
use crate::report::words::significant;

/// What stands where only the user knows.
const BLANK: &str = "________";

impl CorrelationReport<'_> {
    pub(super) fn guide(&self) -> Section {
        let summary = self.summary;
        let options = &self.case.correlation;
        let reference = &summary.reference;
        let mut facts: Vec<(String, String)> = self
            .case
            .report
            .entries()
            .into_iter()
            .map(|(name, said)| (name.to_owned(), said.unwrap_or(BLANK).to_owned()))
            .collect();
        let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
        add(
            "image size and depth",
            format!("{} x {} px, {}", reference.width_px, reference.height_px, reference.depth),
        );
        add(
            "field of view",
            match self.pixel_size {
                Some(size) => {
                    let [w, h] =
                        [reference.width_px, reference.height_px].map(|px| significant(size.mm_from_px(px as f64), 4));
                    format!("{w} x {h} mm")
                }
                None => BLANK.to_owned(),
            },
        );
        add(
            "image scale",
            match self.pixel_size {
                Some(size) => format!("1 px = {} mm", significant(size.mm_per_px(), 5)),
                None => "not given (--pixel-size)".to_owned(),
            },
        );
        add(
            "number of images",
            format!("{} reference, {} deformed", reference.mean_of.len().max(1), summary.frames.len()),
        );
        add("DIC software", format!("quadrille {}, {}", summary.quadrille, summary.device));
        add("kind of DIC", "two-dimensional, global: all nodes of a zone are solved for together".into());
        add("subset size", format!("{} (side of the elements)", self.length(self.element_px)));
        add("step size", format!("{} (distance of the nodes)", self.length(self.element_px)));
        add("subset shape function", "bilinear, continuous between elements (Q4)".into());
        add(
            "interpolation",
            match options.interpolation {
                Some(interpolation) => interpolation.name().to_owned(),
                None => "cubic".into(),
            },
        );
        let brightness = options.brightness.map_or("auto".to_owned(), |brightness| brightness.to_string());
        add(
            "matching criterion",
            format!(
                "sum of squared differences with gain and offset (brightness: {brightness}); largest last correction {} px",
                significant(summary.tolerance_in_effect_px.unwrap_or(summary.tolerance_px), 2)
            ),
        );
        add("image filtering", "none (coarser scales of the search are means of pixels)".into());
        add(
            "displacement filtering",
            match (options.regularisation, options.cutoff_px) {
                (Some(kind), Some(cutoff)) if kind != RegularisationKind::None => {
                    format!("{kind} regularisation, cut-off {}", self.length(cutoff))
                }
                _ => match options.elements {
                    Some(Elements::CubicSpline) => "cubic splines with a knot every two elements".into(),
                    _ => "none".into(),
                },
            },
        );
        add(
            "reference",
            match options.update_reference {
                Some(update) if update.to_string() != "never" => format!("renewed ({update}), displacements added up"),
                _ => "the same for all frames".into(),
            },
        );
        self.strain_rows(&mut add);
        self.noise_rows(&mut add);
        let text = "After the reporting requirements of the good practice guide of the International Digital Image Correlation \
                    Society. What the program cannot know is left blank: fill it in, or \
                    give it in [report] of the case file, from where the same command takes it.";
        Section { title: "Reporting table".into(), blocks: vec![Block::Text(text.into()), Block::Facts(facts)] }
    }

    fn strain_rows(&self, add: &mut impl FnMut(&str, String)) {
        let Some(last) = self.drawn.last() else { return };
        let definition = last.strain.definition;
        add("strain formulation", format!("{definition}, {}; tensor shear", definition.formula()));
        match last.strain.window.as_ref().map(|strains| strains.window) {
            Some(window) => {
                add("strain window", format!("{window}, plane fitted by least squares"));
                add(
                    "virtual strain gauge",
                    format!("(N - 1) L_step + L_subset = {}", self.length(window.gauge_length(self.element_px))),
                );
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
        let Some((first, sigma)) = self.drawn.first().and_then(|frame| Some((frame, median_sigma(&frame.field)?)))
        else {
            return;
        };
        add(
            "displacement noise floor",
            format!(
                "ux {}, uy {}: standard uncertainty, median of frame {}",
                self.uncertainty(sigma[0]),
                self.uncertainty(sigma[1]),
                first.number
            ),
        );
        let window = first.strain.window.as_ref().map(|strains| strains.window);
        let factor = window.map_or(crate::field::ELEMENT_NOISE, StrainWindow::noise);
        let [x, y] = sigma.map(|sigma| factor * sigma / self.element_px);
        let upper = if self.is_regularised() { ", were nodes not bound to each other" } else { "" };
        add(
            "strain noise floor",
            format!(
                "exx {x:.1e}, eyy {y:.1e}: standard uncertainty over the virtual strain gauge, inside{upper}; resolution \
                     (twice that) {:.1e}",
                2.0 * x.max(y)
            ),
        );
    }
}
