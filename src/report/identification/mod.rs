//! The report from images to the law of an adhesive: what was measured, what was found, how far it can be trusted.

mod comparison;
mod history;
mod measurement;
mod result;

pub use comparison::measured_mm;

use super::fit::{FitRecord, LawRows, TractionRows};
use super::page::{Block, Page, Section};
use super::summary::Summary;
use super::tournament::TournamentReport;
use super::{Name, ReportError, version};
use crate::field::Measurement;
use crate::imaging::Image;
use crate::mechanics::Joint;
use crate::mechanics::cohesive::{CohesiveLaw, Parameter};
use crate::remark::Remark;
use crate::units::{PixelSize, Px};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What a report is made of.
#[derive(Debug)]
pub struct IdentificationReport<'a> {
    /// Name of the case file.
    pub case: String,
    /// The reference image.
    pub reference: &'a Image,
    /// `summary.json` of the correlation.
    pub correlation: &'a Summary,
    /// Millimetres per pixel.
    pub pixel_size: PixelSize,
    /// Side of the elements, px.
    pub element_px: f64,
    /// Thickness of the adhesive, mm.
    pub thickness_mm: f64,
    /// The frames that became instants, in order: their numbers and fields.
    pub frames: &'a [(usize, Measurement<Px>)],
    /// Mesh, materials and border; its law is the identified one (or the given one, without a fit).
    pub joint: &'a Joint,
    /// The identified law.
    pub law: &'a dyn CohesiveLaw,
    /// Computed displacement of every node of the joint at each instant, mm; empty where there is no solution.
    pub computed: &'a [Vec<[f64; 2]>],
    /// The tractions of the fit with their 95 % bands, as `traction-bands.csv` has them; none without a fit.
    pub bands: &'a [TractionRows],
    /// The law of the fit with its 95 % bands in opening and sliding, as `law.csv` has it.
    pub law_bands: Option<&'a [LawRows; 2]>,
    /// `fit.json`; none when nothing was fitted.
    pub fit: Option<&'a FitRecord>,
    /// Other laws fitted to the same data; none where that was not asked for.
    pub laws: Option<&'a TournamentReport>,
    /// True values of the parameters by their names, where they are known: of a virtual test.
    pub truth: Option<&'a BTreeMap<String, f64>>,
    /// `rigid-motion.json`: the parameters when the rigid motion is treated the other way.
    pub other_rigid_motion: Option<&'a OtherRigidMotion>,
    /// Remarks of the steps.
    pub remarks: Vec<Remark>,
    /// Versions, hashes and steps: name and value.
    pub provenance: Vec<(String, String)>,
}

/// `rigid-motion.json`: what the parameters would be, to first order, if the rigid motion were treated the other way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum OtherRigidMotion {
    /// They are known.
    Found {
        /// `overall` or `none`: what `remove_rigid_motion` would then be.
        other_choice: Name,
        /// The parameters.
        parameters: BTreeMap<String, f64>,
    },
    /// They are not.
    Failed {
        /// Why.
        failed: String,
    },
}

/// Instants that are drawn: one early, one in the middle, the last.
fn choose_instants(n: usize) -> Vec<usize> {
    let mut chosen = vec![n.div_ceil(4).max(1) - 1, n.div_ceil(2).max(1) - 1, n.max(1) - 1];
    chosen.dedup();
    chosen.retain(|&k| k < n);
    chosen
}

impl IdentificationReport<'_> {
    /// The report as a page, what must be known first.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn page(&self) -> Result<Page, ReportError> {
        let mut sections = match self.fit {
            Some(fit) => vec![self.result(fit), self.trust(fit)?],
            None => vec![self.measurement()?],
        };
        sections.extend(self.laws.map(TournamentReport::section).transpose()?);
        if self.fit.is_some() {
            sections.push(self.measurement()?);
        }
        sections.extend([self.comparison()?, self.tractions()?]);
        if let Some(fit) = self.fit {
            sections.extend(self.history(fit)?);
        }
        sections.push(self.provenance());
        let title = match self.fit {
            Some(_) => "Cohesive law of an adhesive, identified from images",
            None => "A bonded joint, measured on images and computed",
        };
        let subtitle = format!("{}; {}; units mm, MPa, N/mm, x to the right, y up", self.case, version());
        Ok(Page { title: title.to_owned(), subtitle, sections })
    }

    /// Names of the fitted parameters, in the order of the rows of their matrices and iterates.
    fn fitted_names(&self) -> &[Name] {
        self.fit.map_or(&[], |fit| &fit.parameter_order)
    }

    /// The parameter called `name`, of the law or of the strips.
    fn parameter(&self, name: &str) -> Option<&'static Parameter> {
        let of_strips = self.joint.model.materials().iter().map(|material| material.parameters());
        [self.law.parameters()].into_iter().chain(of_strips).flatten().find(|p| p.name == name)
    }

    fn unit(&self, name: &str) -> &'static str {
        self.parameter(name).map_or("", |p| if p.unit == "1" { "" } else { p.unit })
    }

    /// The values that are found, in the units that people speak of: mm below 0.5 as µm.
    fn shown(&self, name: &str) -> (f64, String) {
        match self.unit(name) {
            "mm" => (1e3, "\u{b5}m".to_owned()),
            unit => (1.0, unit.to_owned()),
        }
    }

    /// Symbol and meaning of a parameter.
    fn label(&self, name: &str) -> String {
        let meaning = self.parameter(name).map_or("", |p| p.meaning);
        format!("{name}: {meaning}")
    }

    fn provenance(&self) -> Section {
        let text = "Everything that the numbers above depend on: the same versions and files give the same result.";
        let blocks = vec![Block::text(text), Block::Facts(self.provenance.clone())];
        Section { title: "Versions and hashes".into(), blocks }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_early_one_middle_and_the_last_instant_are_drawn() {
        assert_eq!(choose_instants(19), [4, 9, 18]);
        assert_eq!(choose_instants(1), [0]);
        assert_eq!(choose_instants(2), [0, 1]);
        assert!(choose_instants(0).is_empty());
    }
}
