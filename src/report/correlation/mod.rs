//! The report of a series of correlations: what was measured, how far to trust it, what a paper must say of it.

mod fields;
mod gauge;
mod guide;
mod series;
mod warnings;

pub use series::{SeriesPoint, along_load, line_maps, turn_axes};

use super::page::{Block, Page, Section};
use super::summary::{ReferenceSummary, Summary};
use super::tension::tension_section;
use super::words::{plain, significant};
use super::{Backdrop, ReportError};
use crate::field::{Measurement, StrainField};
use crate::io::case::CaseFile;
use crate::io::quantities::QuantitySummary;
use crate::units::{PixelSize, Px};

/// Frames whose fields are drawn, at most.
pub const DRAWN: usize = 3;
/// Frames whose strains are read for the curves over the series, at most.
pub const SAMPLED: usize = 60;
/// Points of a curve, at most.
const POINTS: usize = 400;

/// A frame whose field is drawn.
#[derive(Debug)]
pub struct DrawnFrame {
    /// Its number.
    pub number: usize,
    /// Its field.
    pub field: Measurement<Px>,
    /// Its strains.
    pub strain: StrainField,
}

/// What a report is made of.
#[derive(Debug)]
pub struct CorrelationReport<'a> {
    /// `summary.json`.
    pub summary: &'a Summary,
    /// What was asked for, every choice made; its section `[report]` goes into the reporting table.
    pub case: &'a CaseFile,
    /// The reference image, or a blank sheet of its size.
    pub reference: &'a Backdrop,
    /// Millimetres per pixel, where they are known.
    pub pixel_size: Option<PixelSize>,
    /// Side of the elements, px.
    pub element_px: f64,
    /// The frames whose fields are drawn: up to [`DRAWN`], the last one last; see [`choose_frames`].
    pub drawn: &'a [DrawnFrame],
    /// Strains and uncertainty of up to [`SAMPLED`] frames.
    pub sampled: &'a [SeriesPoint],
    /// What was drawn from the fields: against load or frame, along lines, and what there is to say of it.
    pub quantities: &'a QuantitySummary,
    /// Versions and hashes: name and value.
    pub provenance: Vec<(String, String)>,
}

/// Of `n` things the places of `at_most`, evenly spread, with the last and, of more than one, the first.
pub fn spread(n: usize, at_most: usize) -> Vec<usize> {
    match (n, at_most) {
        (0, _) | (_, 0) => Vec::new(),
        (_, 1) => vec![n - 1],
        _ if n <= at_most => (0..n).collect(),
        _ => (0..at_most).map(|k| k * (n - 1) / (at_most - 1)).collect(),
    }
}

/// Of `n` frames with a field the places of those that are drawn: the first, one in the middle, the last.
pub fn choose_frames(n: usize) -> Vec<usize> {
    spread(n, DRAWN)
}

impl CorrelationReport<'_> {
    /// The report as a page, what must be known first.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn page(&self) -> Result<Page, ReportError> {
        let mut sections = vec![self.warnings(), self.facts(), self.fields()?];
        let tension = self.quantities.tension.as_ref().map(tension_section).transpose()?;
        sections.extend([tension, self.series()?, self.quantities()?, self.gauge()?].into_iter().flatten());
        let text = "The same versions and files give the same numbers. run.toml beside this page has all of them.";
        let blocks = vec![Block::text(text), Block::Facts(self.provenance.clone())];
        sections.extend([self.guide(), Section { title: "Versions and hashes".into(), blocks }]);
        let subtitle = format!(
            "{}; quadrille {}; lengths in px of the reference image, x to the right, y down",
            self.summary.reference.file, self.summary.quadrille
        );
        Ok(Page { title: "Displacements measured on images".into(), subtitle, sections })
    }

    /// A length in px, and in mm where the scale is known.
    fn length(&self, px: f64) -> String {
        self.in_both(px, plain)
    }

    /// The same of a standard uncertainty.
    fn uncertainty(&self, px: f64) -> String {
        self.in_both(px, |value| significant(value, 3))
    }

    fn in_both(&self, px: f64, write: impl Fn(f64) -> String) -> String {
        let mm = self.pixel_size.map(|size| format!(" = {} mm", write(size.mm_from_px(px))));
        format!("{} px{}", write(px), mm.unwrap_or_default())
    }

    fn facts(&self) -> Section {
        let summary = self.summary;
        let ReferenceSummary { width_px, height_px, depth, mean_of, .. } = &summary.reference;
        let mut facts = Vec::new();
        let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
        let images = format!("{} reference and {} deformed", mean_of.len().max(1), summary.frames.len());
        add("images", format!("{images}, {width_px} x {height_px} px, {depth}"));
        if let Some(scale) = self.pixel_size {
            let [width, height] = [width_px, height_px].map(|&px| significant(scale.mm_from_px(px as f64), 4));
            let px = significant(scale.mm_per_px(), 5);
            add("scale", format!("1 px = {px} mm; field of view {width} x {height} mm"));
        }
        let counts = format!("{} elements, {} nodes", summary.n_elements, summary.n_nodes);
        add("elements", format!("bilinear, of about {}; {counts}", self.length(self.element_px)));
        let statuses: Vec<String> =
            summary.counts.iter().map(|(name, n)| format!("{n} {}", name.replace('_', " "))).collect();
        add("frames", statuses.join(", "));
        if let Some(last) = self.sampled.last() {
            let [x, y] = last.sigma_px.map(|sigma| self.uncertainty(sigma));
            let value = format!("ux {x}, uy {y}, frame {}", last.number);
            add("standard uncertainty of a nodal displacement (median)", value);
        }
        add("device", summary.device.clone());
        add("time", format!("{} s", significant(summary.seconds_total, 3)));
        Section { title: "What was measured, and how".into(), blocks: vec![Block::Facts(facts)] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_series_is_thinned_to_its_ends_and_what_lies_evenly_between() {
        assert_eq!(spread(5, 60), [0, 1, 2, 3, 4]);
        let thin = spread(100_000, 60);
        assert_eq!((thin.len(), thin[0], thin[59]), (60, 0, 99_999));
        assert!(thin.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!((spread(7, 1), spread(0, 9)), (vec![6], vec![]));
        assert_eq!((choose_frames(19), choose_frames(1), choose_frames(0)), (vec![0, 9, 18], vec![0], vec![]));
    }
}
