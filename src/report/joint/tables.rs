//! Tables of a solution.

use super::JointReport;
use crate::io::joint::write_table;
use crate::report::fit::notes;
use crate::report::to_strings;
use std::io::{self, Write};

impl JointReport<'_> {
    /// Writes `solution.csv`: the displacement of every node at every instant that has a solution.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_solution<W: Write>(&self, out: W) -> io::Result<()> {
        let rows = self.solved().flat_map(|(number, instant)| {
            (0..).zip(&instant.displacement).map(move |(node, u)| (vec![number as u64, node], u.to_vec()))
        });
        let columns = to_strings(&["instant", "node", "ux_mm", "uy_mm"]);
        write_table(out, &notes("displacement of every node"), &columns, rows)
    }

    /// Writes `tractions.csv`: jump and traction of every node pair, in their order along the joint.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_tractions<W: Write>(&self, out: W) -> io::Result<()> {
        let columns = ["instant", "lower_node", "upper_node", "x_mm", "y_mm", "Dn_mm", "Dt_mm", "Tn_MPa", "Tt_MPa"];
        let model = &self.joint.model;
        let positions = model.pair_positions();
        let rows = self.solved().flat_map(|(number, instant)| {
            let jumps = model.jumps(&instant.displacement);
            let tractions = model.tractions(&*self.joint.law, &instant.displacement);
            let rows: Vec<_> = (model.mesh().pairs().iter().zip(&positions).zip(jumps.into_iter().zip(tractions)))
                .map(|((&[lower, upper], ([x, y], _)), (jump, traction))| {
                    let values = vec![*x, *y, jump.normal, jump.tangential, traction.normal, traction.tangential];
                    (vec![number as u64, lower.into(), upper.into()], values)
                })
                .collect();
            rows
        });
        let about = "jump and traction of every node pair, upper minus lower";
        write_table(out, &notes(about), &to_strings(&columns), rows)
    }

    /// Writes `sensitivities.csv`: the derivatives of every displacement, first those of u_x, then those of u_y.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_sensitivities<W: Write>(&self, out: W) -> io::Result<()> {
        let mut columns = to_strings(&["instant", "node"]);
        for component in ["ux", "uy"] {
            columns.extend(self.names().iter().map(|name| format!("d{component}_d{name}")));
        }
        let rows = self.solved().flat_map(|(number, instant)| {
            (0..instant.displacement.len()).map(move |node| {
                let component = |c: usize| instant.sensitivities.iter().map(move |field| field[node][c]);
                (vec![number as u64, node as u64], component(0).chain(component(1)).collect())
            })
        });
        write_table(out, &notes("derivative of every displacement (mm) by each parameter"), &columns, rows)
    }
}
