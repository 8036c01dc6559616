//! Tables of an identification.

use super::FitReport;
use crate::identify::SweepRow;
use crate::io::joint::write_table;
use std::io::{self, Write};

fn notes(what: &str) -> [String; 2] {
    let version = format!("quadrille {}", env!("CARGO_PKG_VERSION"));
    [version, format!("{what}; mm, MPa; y up; nodes from 0, instants from 1")]
}

fn names(columns: &[&str]) -> Vec<String> {
    columns.iter().map(|&name| name.to_owned()).collect()
}

impl FitReport<'_> {
    /// Writes `fit-history.csv`: every evaluation; NaN for an objective that could not be computed.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_history<W: Write>(&self, out: W) -> io::Result<()> {
        let mut columns = names(&["evaluation", "stage", "accepted", "rescued"]);
        columns.extend(self.fit.parameters.iter().map(|p| p.parameter.key()));
        columns.extend(names(&["omega", "radius"]));
        let rows = (1u64..).zip(&self.fit.history).map(|(k, i)| {
            let mut values = i.z.clone();
            values.extend([i.omega.unwrap_or(f64::NAN), i.radius]);
            (vec![k, i.stage as u64, u64::from(i.accepted), u64::from(i.rescued)], values)
        });
        write_table(out, &notes("every evaluation of the objective"), &columns, rows)
    }

    /// Writes `traction-bands.csv`: tractions with standard uncertainties.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_bands<W: Write>(&self, out: W) -> io::Result<()> {
        let columns =
            names(&["instant", "lower_node", "upper_node", "along_mm", "Tn_MPa", "Tn_std_MPa", "Tt_MPa", "Tt_std_MPa"]);
        let model = &self.case.problem.joint.model;
        let along: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let rows = self.bands.iter().flat_map(|band| {
            let row = |k: usize| {
                let [lower, upper] = model.mesh().pairs()[k];
                let (t, s) = (band.traction[k], band.std[k]);
                let numbers = vec![band.instant as u64, lower.into(), upper.into()];
                (numbers, vec![along[k], t.normal, s.normal, t.tangential, s.tangential])
            };
            (0..band.traction.len()).map(row).collect::<Vec<_>>()
        });
        write_table(out, &notes("tractions of the fit with their standard uncertainties"), &columns, rows)
    }

    /// Writes `law.csv`: traction against separation, opening (1) and sliding (2).
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_law<W: Write>(&self, out: W) -> io::Result<()> {
        let columns = names(&["mode", "point", "jump_mm", "traction_MPa", "std_MPa"]);
        let rows = (1u64..).zip(&self.curves).flat_map(|(mode, curve)| {
            let row = move |k: usize| {
                let jump = curve.jumps[k].normal + curve.jumps[k].tangential;
                (vec![mode, k as u64], vec![jump, curve.traction[k], curve.std[k]])
            };
            (0..curve.jumps.len()).map(row)
        });
        write_table(out, &notes("traction of the fitted law in pure opening (1) and pure sliding (2)"), &columns, rows)
    }
}

/// Writes `sweep.csv`: the fits with the parameter called `name` prescribed.
///
/// # Errors
/// Those of `out`.
pub fn write_sweep<W: Write>(out: W, name: &str, rows: &[SweepRow]) -> io::Result<()> {
    let mut columns = names(&["row", "converged", "rescued"]);
    columns.push(name.to_owned());
    if let Some(row) = rows.first() {
        for p in &row.fit.parameters {
            columns.extend([p.parameter.key(), format!("{}_std", p.parameter.key())]);
        }
        for q in &row.fit.derived {
            let unit = q.quantity.unit.replace('/', "_per_");
            columns.extend([format!("{}_{unit}", q.quantity.name), format!("{}_{unit}_std", q.quantity.name)]);
        }
    }
    columns.push("omega".to_owned());
    let rows = (1u64..).zip(rows).map(|(k, row)| {
        let mut values = vec![row.value];
        row.fit.parameters.iter().for_each(|p| values.extend([p.value, p.std.unwrap_or(f64::NAN)]));
        row.fit.derived.iter().for_each(|q| values.extend([q.quantity.value, q.std.unwrap_or(f64::NAN)]));
        values.push(row.fit.omega);
        let converged = row.fit.status == crate::identify::FitStatus::Converged;
        (vec![k, u64::from(converged), row.fit.rescued as u64], values)
    });
    write_table(out, &notes("one parameter prescribed, the others fitted"), &columns, rows)
}
