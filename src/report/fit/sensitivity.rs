//! What a small change of each parameter does to law and joint: `law-sensitivities.csv`, `joint-sensitivities.csv`.

use super::FitReport;
use super::tables::{notes, rows_of};
use crate::io::joint::{JointFileError, write_table};
use crate::mechanics::cohesive::{CohesiveLaw, Traction};
use crate::report::to_strings;
use std::io::{self, Write};
use std::path::Path;

/// Values of the joint at a node pair.
const OF_PAIR: [&str; 4] = ["Dn_mm", "Dt_mm", "Tn_MPa", "Tt_MPa"];

/// The law in one pure mode, as `law-sensitivities.csv` has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LawSensitivity {
    /// Of each parameter the derivative of the traction by it, MPa per its unit, at the jumps of `law.csv`.
    pub by: Vec<Vec<f64>>,
}

/// The joint at one instant, as `joint-sensitivities.csv` has it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JointSensitivity {
    /// The instant, from 1.
    pub instant: usize,
    /// Distance of the node pairs along the joint, mm.
    pub along_mm: Vec<f64>,
    /// Opening, sliding (mm), `T_n`, `T_t` (MPa).
    pub value: [Vec<f64>; 4],
    /// Of each parameter their derivatives by it.
    pub by: Vec<[Vec<f64>; 4]>,
}

impl FitReport<'_> {
    fn law(&self) -> io::Result<Box<dyn CohesiveLaw>> {
        self.case.problem.unknowns.law_at(&self.fit.evaluation.x).map_err(io::Error::other)
    }

    fn keys(&self) -> Vec<String> {
        self.case.problem.unknowns.list().iter().map(|unknown| unknown.parameter.key()).collect()
    }

    /// Writes `law-sensitivities.csv`: derivatives of the traction of `law.csv` by each parameter.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_law_sensitivities<W: Write>(&self, out: W) -> io::Result<()> {
        let (law, unknowns) = (self.law()?, self.case.problem.unknowns.list());
        let mut columns = to_strings(&["mode", "point", "jump_mm"]);
        columns.extend(self.keys().iter().map(|key| format!("traction_MPa_by_{key}")));
        let mut rows = Vec::new();
        for (mode, curve) in (1u64..).zip(&self.curves) {
            for (point, &jump) in (0u64..).zip(&curve.jumps) {
                let mut by = vec![Traction::default(); law.parameters().len()];
                law.by_parameters(jump, &mut by);
                let mut values = vec![jump.normal + jump.tangential];
                let pick = |t: Traction| if mode == 1 { t.normal } else { t.tangential };
                values.extend(unknowns.iter().map(|unknown| by.get(unknown.index).map_or(0.0, |&by| pick(by))));
                rows.push((vec![mode, point], values));
            }
        }
        let about =
            "derivatives of the traction of the fitted law in pure opening (1) and pure sliding (2) by each parameter";
        write_table(out, &notes(about), &columns, rows.into_iter())
    }

    /// Writes `joint-sensitivities.csv`: jumps and tractions along the joint, and their derivatives by each parameter
    /// while the prescribed displacements stay.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_joint_sensitivities<W: Write>(&self, out: W) -> io::Result<()> {
        let (law, problem) = (self.law()?, &self.case.problem);
        let model = self.fit.evaluation.model(problem);
        let unknowns = problem.unknowns.list();
        let mut columns = to_strings(&[&["instant", "lower_node", "upper_node", "along_mm"][..], &OF_PAIR].concat());
        columns.extend(self.keys().iter().flat_map(|key| OF_PAIR.map(|value| format!("{value}_by_{key}"))));
        let along: Vec<f64> = model.pair_positions().into_iter().map(|(_, along)| along).collect();
        let mut rows = Vec::new();
        for observed in &problem.observation.instants {
            let instant = &self.fit.solution().instants[observed.index];
            let jumps = model.jumps(&instant.displacement);
            let changes: Option<Vec<_>> = unknowns
                .iter()
                .map(|unknown| {
                    Some(model.jump_changes(&instant.displacement, instant.sensitivities.get(unknown.index)?))
                })
                .collect();
            // An instant without a solution has none.
            let Some(changes) = changes else { continue };
            for (pair, &jump) in jumps.iter().enumerate() {
                let response = law.response(jump);
                let mut at_fixed_jump = vec![Traction::default(); law.parameters().len()];
                law.by_parameters(jump, &mut at_fixed_jump);
                let (t, tangent) = (response.traction, response.tangent);
                let mut values = vec![along[pair], jump.normal, jump.tangential, t.normal, t.tangential];
                for (unknown, changes) in unknowns.iter().zip(&changes) {
                    let direct = at_fixed_jump.get(unknown.index).copied().unwrap_or_default();
                    let d = changes[pair];
                    let through = |row: usize| tangent[(row, 0)] * d.normal + tangent[(row, 1)] * d.tangential;
                    values.extend([d.normal, d.tangential, direct.normal + through(0), direct.tangential + through(1)]);
                }
                let [lower, upper] = model.mesh().pairs()[pair];
                rows.push((vec![observed.index as u64 + 1, lower.into(), upper.into()], values));
            }
        }
        let about = "jumps and tractions along the joint and their derivatives by each parameter";
        write_table(out, &notes(about), &columns, rows.into_iter())
    }
}

/// Reads `law-sensitivities.csv`: opening and sliding, by the parameters of these keys.
///
/// # Errors
/// A file that is no such table.
pub fn read_law_sensitivities(path: &Path, keys: &[String]) -> Result<[LawSensitivity; 2], JointFileError> {
    let columns: Vec<String> = keys.iter().map(|key| format!("traction_MPa_by_{key}")).collect();
    let mut wanted = vec!["mode"];
    wanted.extend(columns.iter().map(String::as_str));
    let mut modes = [(); 2].map(|()| LawSensitivity { by: vec![Vec::new(); keys.len()] });
    for row in rows_of(path, &wanted)? {
        let mode = &mut modes[usize::from(row[0] > 1.0)];
        mode.by.iter_mut().zip(&row[1..]).for_each(|(list, value)| list.push(*value));
    }
    Ok(modes)
}

/// Reads `joint-sensitivities.csv`, instant by instant, by the parameters of these keys.
///
/// # Errors
/// A file that is no such table.
pub fn read_joint_sensitivities(path: &Path, keys: &[String]) -> Result<Vec<JointSensitivity>, JointFileError> {
    let columns: Vec<String> = keys.iter().flat_map(|key| OF_PAIR.map(|value| format!("{value}_by_{key}"))).collect();
    let mut wanted = [&["instant", "along_mm"][..], &OF_PAIR].concat();
    wanted.extend(columns.iter().map(String::as_str));
    let mut list: Vec<JointSensitivity> = Vec::new();
    for row in rows_of(path, &wanted)? {
        let instant = row[0] as usize;
        if list.last().is_none_or(|last| last.instant != instant) {
            let by = vec![<[Vec<f64>; 4]>::default(); keys.len()];
            list.push(JointSensitivity { instant, by, ..JointSensitivity::default() });
        }
        let Some(last) = list.last_mut() else { continue };
        last.along_mm.push(row[1]);
        let lists = last.value.iter_mut().chain(last.by.iter_mut().flatten());
        lists.zip(&row[2..]).for_each(|(list, value)| list.push(*value));
    }
    Ok(list)
}
