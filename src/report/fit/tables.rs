//! Tables of an identification.

use super::FitReport;
use crate::identify::{CurveBand, Derived, FitStatus, SweepRow};
use crate::io::joint::{JointFileError, read_table, write_table};
use crate::report::{to_strings, version};
use std::io::{self, Write};
use std::path::Path;

/// Columns of the tractions: those of T_n, then those of T_t.
const TRACTIONS: [&str; 8] =
    ["Tn_MPa", "Tn_std_MPa", "Tn_low95_MPa", "Tn_high95_MPa", "Tt_MPa", "Tt_std_MPa", "Tt_low95_MPa", "Tt_high95_MPa"];
/// Columns of the law's traction.
const LAW: [&str; 4] = ["traction_MPa", "std_MPa", "low95_MPa", "high95_MPa"];

/// The column of a derived quantity, with its unit.
pub(super) fn column_of(quantity: &Derived) -> String {
    format!("{}_{}", quantity.name, quantity.unit.replace('/', "_per_"))
}

/// What stands above a table of a joint.
pub(in crate::report) fn notes(what: &str) -> [String; 2] {
    [version(), format!("{what}; mm, MPa; y up; nodes from 0, instants from 1")]
}

impl FitReport<'_> {
    /// Writes `fit-history.csv`: every evaluation; NaN for an objective that could not be computed.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_history<W: Write>(&self, out: W) -> io::Result<()> {
        let mut columns = to_strings(&["evaluation", "stage", "accepted", "rescued"]);
        columns.extend(self.fit.parameters.iter().map(|p| p.parameter.key()));
        columns.extend(to_strings(&["omega", "radius"]));
        let rows = (1u64..).zip(&self.fit.history).map(|(k, i)| {
            let mut values = i.z.clone();
            values.extend([i.omega.unwrap_or(f64::NAN), i.radius]);
            (vec![k, i.stage as u64, u64::from(i.accepted), u64::from(i.rescued)], values)
        });
        write_table(out, &notes("every evaluation of the objective"), &columns, rows)
    }

    /// Writes `traction-bands.csv`: tractions with standard uncertainties and 95 % bands.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_bands<W: Write>(&self, out: W) -> io::Result<()> {
        let columns = to_strings(&[&["instant", "lower_node", "upper_node", "along_mm"][..], &TRACTIONS].concat());
        let model = &self.case.problem.joint.model;
        let along: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let rows = self.bands.iter().flat_map(|band| {
            let row = |k: usize| {
                let [lower, upper] = model.mesh().pairs()[k];
                let numbers = vec![band.instant as u64, lower.into(), upper.into()];
                let bands = [band.traction[k], band.std[k], band.low[k], band.high[k]];
                let values = [bands.map(|t| t.normal), bands.map(|t| t.tangential)];
                (numbers, [&[along[k]], values.as_flattened()].concat())
            };
            (0..band.traction.len()).map(row).collect::<Vec<_>>()
        });
        write_table(out, &notes("tractions of the fit with standard uncertainties and 95 % bands"), &columns, rows)
    }

    /// Writes `law.csv`: traction against separation, opening (1) and sliding (2).
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_law<W: Write>(&self, out: W) -> io::Result<()> {
        let columns = to_strings(&[&["mode", "point", "jump_mm"][..], &LAW].concat());
        let about = "traction of the fitted law in pure opening (1) and pure sliding (2), with its 95 % band";
        write_table(out, &notes(about), &columns, law_rows(&self.curves))
    }
}

/// The rows of a law: mode and point; jump, traction, its standard uncertainty, the ends of its band.
pub(in crate::report) fn law_rows(curves: &[CurveBand; 2]) -> impl Iterator<Item = (Vec<u64>, Vec<f64>)> {
    (1u64..).zip(curves).flat_map(|(mode, curve)| {
        let row = move |k: usize| {
            let jump = curve.jumps[k].normal + curve.jumps[k].tangential;
            let values = vec![jump, curve.traction[k], curve.std[k], curve.low[k], curve.high[k]];
            (vec![mode, k as u64], values)
        };
        (0..curve.jumps.len()).map(row)
    })
}

/// Values along a curve with their uncertainty, as the tables hold them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Banded {
    /// The values.
    pub value: Vec<f64>,
    /// Their standard uncertainties.
    pub std: Vec<f64>,
    /// Lower ends of the 95 % band.
    pub low: Vec<f64>,
    /// Upper ends of the 95 % band.
    pub high: Vec<f64>,
}

impl Banded {
    fn push(&mut self, values: &[f64]) {
        for (list, value) in [&mut self.value, &mut self.std, &mut self.low, &mut self.high].into_iter().zip(values) {
            list.push(*value);
        }
    }
}

/// The tractions of one instant in `traction-bands.csv`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TractionRows {
    /// The instant, from 1.
    pub instant: usize,
    /// Distance of the node pairs along the joint, mm.
    pub along_mm: Vec<f64>,
    /// `T_n` and `T_t`, MPa.
    pub tractions: [Banded; 2],
}

/// The law in one pure mode in `law.csv`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LawRows {
    /// The jump, mm.
    pub jump_mm: Vec<f64>,
    /// The traction along it, MPa.
    pub traction: Banded,
}

/// Reads `traction-bands.csv`, instant by instant.
///
/// # Errors
/// A file that is no such table.
pub fn read_bands(path: &Path) -> Result<Vec<TractionRows>, JointFileError> {
    let mut list: Vec<TractionRows> = Vec::new();
    for row in rows_of(path, &[&["instant", "along_mm"][..], &TRACTIONS].concat())? {
        let instant = row[0] as usize;
        if list.last().is_none_or(|last| last.instant != instant) {
            list.push(TractionRows { instant, ..TractionRows::default() });
        }
        let Some(last) = list.last_mut() else { continue };
        last.along_mm.push(row[1]);
        last.tractions.iter_mut().zip(row[2..].chunks_exact(4)).for_each(|(banded, values)| banded.push(values));
    }
    Ok(list)
}

/// Reads `law.csv`: opening and sliding.
///
/// # Errors
/// A file that is no such table.
pub fn read_law(path: &Path) -> Result<[LawRows; 2], JointFileError> {
    let mut modes: [LawRows; 2] = Default::default();
    for row in rows_of(path, &[&["mode", "jump_mm"][..], &LAW].concat())? {
        let mode = &mut modes[usize::from(row[0] > 1.0)];
        mode.jump_mm.push(row[1]);
        mode.traction.push(&row[2..]);
    }
    Ok(modes)
}

/// The columns called `names` of a table.
pub(in crate::report) fn rows_of(path: &Path, names: &[&str]) -> Result<Vec<Vec<f64>>, JointFileError> {
    let (columns, rows) = read_table(path)?;
    let place = |name: &&str| {
        columns.iter().position(|column| column == name).ok_or_else(|| JointFileError::Row {
            path: path.to_owned(),
            line: 1,
            what: format!("there is no column {name}"),
        })
    };
    let places: Vec<usize> = names.iter().map(place).collect::<Result<_, _>>()?;
    Ok(rows.iter().map(|row| places.iter().map(|&k| row[k]).collect()).collect())
}

/// Writes `sweep.csv`: the fits with the parameter called `name` prescribed.
///
/// # Errors
/// Those of `out`.
pub fn write_sweep<W: Write>(out: W, name: &str, rows: &[SweepRow]) -> io::Result<()> {
    let mut columns = to_strings(&["row", "converged", "rescued"]);
    columns.push(name.to_owned());
    if let Some(row) = rows.first() {
        columns.extend(row.fit.parameters.iter().map(|p| p.parameter.key()).flat_map(|p| [p.clone(), p + "_std"]));
        columns.extend(row.fit.derived.iter().map(|q| column_of(&q.quantity)).flat_map(|q| [q.clone(), q + "_std"]));
    }
    columns.push("omega".to_owned());
    let rows = (1u64..).zip(rows).map(|(k, row)| {
        let mut values = vec![row.value];
        row.fit.parameters.iter().for_each(|p| values.extend([p.value, p.std.unwrap_or(f64::NAN)]));
        row.fit.derived.iter().for_each(|q| values.extend([q.quantity.value, q.std.unwrap_or(f64::NAN)]));
        values.push(row.fit.omega);
        let converged = row.fit.status == FitStatus::Converged;
        (vec![k, u64::from(converged), row.fit.rescued as u64], values)
    });
    write_table(out, &notes("one parameter prescribed, the others fitted"), &columns, rows)
}
