//! The law explorer of the page of a run: the fit, its verdict and budget, and what a change of each parameter does.

use super::super::correlation::spread;
use super::super::fit::{FitRecord, JointSensitivity, LawRows, LawSensitivity, TractionRows};
use serde_json::{Value, json};

/// Instants of which the joint is shown.
const INSTANTS: usize = 12;
/// Digits of what is drawn.
const DIGITS: usize = 5;

/// What is known of a fit, from its records.
#[derive(Debug)]
pub struct LawView<'a> {
    /// `fit.json`.
    pub fit: &'a FitRecord,
    /// `law.csv`.
    pub law: &'a [LawRows; 2],
    /// `law-sensitivities.csv`; none of an earlier version.
    pub law_by: Option<&'a [LawSensitivity; 2]>,
    /// `traction-bands.csv`.
    pub bands: &'a [TractionRows],
    /// `joint-sensitivities.csv`; empty of an earlier version.
    pub joint: &'a [JointSensitivity],
    /// The inverse of the covariance of the parameters; none without one.
    pub inverse: Option<Vec<Vec<f64>>>,
    /// What the distance from the fit, chi-square with as many degrees as parameters, is below in 95 % of cases.
    pub limit: f64,
}

impl LawView<'_> {
    /// Its size in the page, bytes.
    pub fn n_bytes(&self) -> usize {
        self.data().to_string().len()
    }

    /// What the script of the page is given.
    pub(super) fn data(&self) -> Value {
        let fit = self.fit;
        let parameter = |name: &super::super::Name| {
            let p = fit.parameters.get(name)?;
            Some(json!({
                "name": name, "unit": p.unit, "meaning": p.meaning, "value": p.value, "std": p.std, "ends95": p.ends95,
                "lower": p.lower, "upper": p.upper,
            }))
        };
        let budget = fit.budget.iter().map(|line| {
            json!({"name": line.name, "source": line.source, "included": line.included, "parameters": line.parameters})
        });
        json!({
            "outcome": fit.verdict.outcome,
            "determined": fit.verdict.determined && !fit.verdict.conditional,
            "sentences": fit.verdict.sentences,
            "law": fit.law,
            "omega": fit.omega,
            "misfit": fit.misfit.as_ref().map(|misfit| json!({
                "omega": misfit.omega, "freedom": misfit.freedom, "z": misfit.z, "z_limit": misfit.z_limit, "rejected": misfit.rejected,
                "tested": misfit.tested,
            })),
            "parameters": fit.parameter_order.iter().filter_map(parameter).collect::<Vec<_>>(),
            "inverse": self.inverse,
            "limit": self.limit,
            "modes": self.law.iter().enumerate().map(|(mode, rows)| self.mode(mode, rows)).collect::<Vec<_>>(),
            "joint": self.joint(),
            "budget": budget.collect::<Vec<_>>(),
        })
    }

    fn mode(&self, mode: usize, rows: &LawRows) -> Value {
        json!({
            "jump_mm": short(&rows.jump_mm),
            "value": short(&rows.traction.value),
            "low": short(&rows.traction.low),
            "high": short(&rows.traction.high),
            "by": self.law_by.map(|by| by[mode].by.iter().map(|list| short(list)).collect::<Vec<_>>()),
        })
    }

    /// The joint at some instants, evenly, the last among them.
    fn joint(&self) -> Vec<Value> {
        let one = |at: &JointSensitivity| {
            let band = self.bands.iter().find(|band| band.instant == at.instant);
            let ends = band.map(|band| {
                band.tractions.iter().map(|t| json!({"low": short(&t.low), "high": short(&t.high)})).collect::<Vec<_>>()
            });
            json!({
                "instant": at.instant,
                "along_mm": short(&at.along_mm),
                "value": at.value.iter().map(|list| short(list)).collect::<Vec<_>>(),
                "by": at.by.iter().map(|of| of.iter().map(|list| short(list)).collect::<Vec<_>>()).collect::<Vec<_>>(),
                "ends": ends,
            })
        };
        spread(self.joint.len(), INSTANTS).into_iter().map(|k| one(&self.joint[k])).collect()
    }
}

/// Numbers with few digits; what is none is null.
fn short(list: &[f64]) -> Vec<Option<f64>> {
    let rounded = |v: &f64| v.is_finite().then(|| format!("{v:.DIGITS$e}").parse().ok()).flatten();
    list.iter().map(rounded).collect()
}
