//! What an identification gives people and programs: `fit.json`, tables, figures.

mod budget;
mod figures;
mod json;
mod remarks;
mod sensitivity;
mod several;
mod several_page;
mod tables;

pub use budget::{budget_lines, defaults_used};
pub use json::{
    BudgetRecord, ConsistencyRecord, FitRecord, GroupRecord, IterationRecord, MisfitRecord, ParameterRecord,
    QuantityRecord, StartRecord, SweepRecord, TestParameterRecord, TestRecord, VerdictRecord,
};
pub use sensitivity::{JointSensitivity, LawSensitivity, read_joint_sensitivities, read_law_sensitivities};
pub use several::{several_json, write_tests};
pub(super) use several_page::misfit_plot;
pub use several_page::several_page;
pub use tables::{Banded, LawRows, TractionRows, read_bands, read_law, write_sweep};
pub(super) use tables::{law_rows, notes, rows_of};

use super::ForceRecord;
use crate::identify::{Band, Case, CurveBand, Fit, FitError, LoadCell, Profile, bands, curve_bands};
use crate::reduction::Traction;

/// A case, its fit, and what was made of it.
#[derive(Debug)]
pub struct FitReport<'a> {
    /// The case.
    pub case: &'a Case<'a>,
    /// Its fit.
    pub fit: &'a Fit,
    /// Tractions along the joint with their uncertainty.
    pub bands: Vec<Band>,
    /// The law with its uncertainty, in opening and in sliding.
    pub curves: [CurveBand; 2],
    /// The profile that was asked for.
    pub profile: Option<Profile>,
    /// The load cell beside the prediction.
    pub force: Option<ForceRecord>,
}

impl<'a> FitReport<'a> {
    /// Standard uncertainty of the law at a separation of a direct traction, MPa: that of the pure mode that it is nearer
    /// to, since laws have bands in pure modes.
    pub(crate) fn std_along(&self, direct: &Traction, separation: f64) -> f64 {
        let slides = direct.jumps_mm.last().is_some_and(|[opening, sliding]| sliding.abs() > opening.abs());
        let curve = &self.curves[usize::from(slides)];
        let size = |k: usize| curve.jumps[k].normal + curve.jumps[k].tangential;
        let nearest = (0..curve.jumps.len())
            .min_by(|&a, &b| (size(a) - separation).abs().total_cmp(&(size(b) - separation).abs()));
        nearest.map_or(0.0, |k| curve.std[k])
    }

    /// The report of `fit`; the profile is computed by the caller, since it takes many fits.
    ///
    /// # Errors
    /// See [`FitError`].
    pub fn new(case: &'a Case<'a>, fit: &'a Fit, profile: Option<Profile>) -> Result<Self, FitError> {
        let (bands, curves) = (bands(&case.problem, fit)?, curve_bands(&case.problem, fit)?);
        let problem = &case.problem;
        let law = problem.unknowns.law_at(&fit.evaluation.x)?;
        let used = problem.observation.force.is_some();
        let compare = |cell: &LoadCell| {
            let comparison = cell.compare(fit.evaluation.model(problem), &*law, fit.solution())?;
            Some(ForceRecord::of(cell, &comparison, used).with_bands(&bands))
        };
        let force = problem.observation.cell().and_then(compare);
        Ok(Self { case, fit, bands, curves, profile, force })
    }

    /// What the 95 % bands hold, in words.
    pub(super) fn bands_hold(&self) -> &'static str {
        match self.fit.refinement.as_ref().is_some_and(|refinement| refinement.included) {
            true => "noise of the measurement, uncertain constants and the element size",
            false => "noise of the measurement and uncertain constants",
        }
    }
}
