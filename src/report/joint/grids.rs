//! A solution for ParaView: the strips, and the interface as its own line.

use super::JointReport;
use crate::io::vtk::{GridValues, write_grid};
use crate::mechanics::cohesive::{CohesiveResponse, Jump, Traction};
use crate::mechanics::{Instant, Joint};
use crate::report::version;
use std::collections::HashMap;
use std::io::{self, Write};

impl JointReport<'_> {
    /// Writes the strips at instant `number`: displacement and its derivatives at the nodes; stress, equivalent stress
    /// and plastic strain of the elements (means of their Gauss points).
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_strips<W: Write>(&self, out: W, number: usize, instant: &Instant) -> io::Result<()> {
        let (model, u) = (&self.joint.model, &instant.displacement);
        let mesh = model.mesh();
        let cell = |&[a, b, c, d]: &[u32; 4]| if c == d { vec![a, b, c] } else { vec![a, b, c, d] };
        let cells: Vec<Vec<u32>> = mesh.elements().iter().map(cell).collect();
        let mut at_points = vec![GridValues::Vectors("displacement_mm".into(), spatial(u))];
        for (name, field) in self.names().iter().zip(&instant.sensitivities) {
            at_points.push(GridValues::Vectors(format!("du_d{name}"), spatial(field)));
        }
        let mean = |values: [f64; 4]| values.iter().sum::<f64>() / 4.0;
        let stress = model.stresses(u).into_iter().map(|s| [0, 1, 2].map(|c| mean(s.map(|s| s.0[c])))).collect();
        let states = model.states(u);
        let equivalent = states.iter().map(|s| mean(s.map(|s| s.equivalent_stress))).collect();
        let plastic = states.iter().map(|s| mean(s.map(|s| s.plastic_strain))).collect();
        let at_cells = [
            GridValues::Vectors("stress_xx_yy_xy_MPa".into(), stress),
            GridValues::Scalars("equivalent_stress_MPa".into(), equivalent),
            GridValues::Scalars("plastic_strain".into(), plastic),
            GridValues::Scalars("group".into(), mesh.element_group().iter().map(|&g| f64::from(g)).collect()),
        ];
        write_grid(out, &title(number), mesh.nodes(), &cells, &at_points, &at_cells).map_err(io::Error::other)
    }

    /// Writes the mid-line of the interface at instant `number`: displacement, jumps, tractions, and the state (-1
    /// compressed, 0 loading, 1 softening, 2 open).
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_interface<W: Write>(&self, out: W, number: usize, instant: &Instant) -> io::Result<()> {
        let (model, u) = (&self.joint.model, &instant.displacement);
        let mesh = model.mesh();
        let place: HashMap<[u32; 2], u32> = (0u32..).zip(mesh.pairs()).map(|(k, &pair)| (pair, k)).collect();
        let line = |&[l1, l2, u1, u2]: &[u32; 4]| vec![place[&[l1, u1]], place[&[l2, u2]]];
        let lines: Vec<Vec<u32>> = mesh.interfaces().iter().map(line).collect();
        let middle: Vec<[f64; 2]> = model.pair_positions().into_iter().map(|(at, _)| at).collect();
        let between = |&[lower, upper]: &[u32; 2]| [0, 1].map(|c| 0.5 * (u[lower as usize][c] + u[upper as usize][c]));
        let along: Vec<[f64; 2]> = mesh.pairs().iter().map(between).collect();
        let jumps = model.jumps(u);
        let scalars = |name: &str, of: &dyn Fn(Jump) -> f64| {
            GridValues::Scalars(name.into(), jumps.iter().map(|&jump| of(jump)).collect())
        };
        let tractions = model.tractions(&*self.joint.law, u);
        let traction = |name: &str, of: &dyn Fn(Traction) -> f64| {
            GridValues::Scalars(name.into(), tractions.iter().map(|&traction| of(traction)).collect())
        };
        // Cracked faces are open where they do not press on each other.
        let states = jumps.iter().zip(mesh.cracked_pairs()).map(|(&jump, cracked)| match cracked {
            true if jump.normal >= 0.0 => 2.0,
            _ => state(self.joint, jump),
        });
        let at_points = [
            GridValues::Vectors("displacement_mm".into(), spatial(&along)),
            scalars("normal_jump_mm", &|jump| jump.normal),
            scalars("tangential_jump_mm", &|jump| jump.tangential),
            traction("normal_traction_MPa", &|traction| traction.normal),
            traction("tangential_traction_MPa", &|traction| traction.tangential),
            GridValues::Scalars("state".into(), states.collect()),
        ];
        let title = format!("{}; state: -1 compressed, 0 loading, 1 softening, 2 open", title(number));
        write_grid(out, &title, &middle, &lines, &at_points, &[]).map_err(io::Error::other)
    }
}

fn title(number: usize) -> String {
    format!("{}, instant {number}; mm, MPa, y up", version())
}

fn spatial(field: &[[f64; 2]]) -> Vec<[f64; 3]> {
    field.iter().map(|&[x, y]| [x, y, 0.0]).collect()
}

/// Whether a law is beyond its peak: the symmetric part of its tangent is not positive.
pub(super) fn softens(response: &CohesiveResponse) -> bool {
    let tangent = &response.tangent;
    let (nn, nt, tn, tt) = (tangent.m11, tangent.m12, tangent.m21, tangent.m22);
    nn * tt - 0.25 * (nt + tn) * (nt + tn) < 0.0 || nn + tt < 0.0
}

/// -1 compressed, 0 loading, 1 softening (the symmetric part of the tangent is not positive), 2 open.
fn state(joint: &Joint, jump: Jump) -> f64 {
    if jump.normal < 0.0 {
        -1.0
    } else if jump.normal >= joint.law.front_opening() {
        2.0
    } else if softens(&joint.law.response(jump)) {
        1.0
    } else {
        0.0
    }
}
