//! What the computed displacements are compared with: nodes, instants, and the scale of each instant.

use crate::field::RigidMotion;
use crate::identify::LoadCell;
use crate::linalg::Dense;

/// What was measured and the fit uses. Rows are displacements (mm), node by node, x then y; the last one, where a load
/// cell takes part, is its force (N), which stays zero at instants without one.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// The nodes of the rows: those compared and, where the boundary has noise, the prescribed ones.
    pub nodes: Vec<u32>,
    /// Which of them are compared.
    pub compared: Vec<bool>,
    /// Where each prescribed node of the measured mesh stands in `nodes`; empty where the boundary has no noise.
    pub prescribed: Vec<usize>,
    /// The instants compared.
    pub instants: Vec<ObservedInstant>,
    /// Size of a pixel, mm; `None` where the displacements come from a table.
    pub pixel_size_mm: Option<f64>,
    /// The load cell, where it takes part in the fit.
    pub force: Option<LoadCell>,
    /// The load cell, where it is only held against the prediction.
    pub held: Option<LoadCell>,
    /// What the displacements are off when the camera is.
    pub camera: Vec<CameraChange>,
}

/// What the measured displacements are off when the camera is off by one standard uncertainty (THEORY 22).
#[derive(Debug, Clone, PartialEq)]
pub struct CameraChange {
    /// Change of the displacement of each node of the measured mesh at each instant of the border, mm.
    pub instants: Vec<Vec<[f64; 2]>>,
    /// Whether the border was measured with it.
    pub is_of_border: bool,
}

/// One instant.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedInstant {
    /// Its place in the boundary history, from 0.
    pub index: usize,
    /// Measured displacement of each row, mm.
    pub displacement: Vec<f64>,
    /// Largest |u_x| and |u_y| of all measured nodes after the rigid motion of all is taken off, mm (THEORY 6).
    pub largest: [f64; 2],
    /// A factor on its weight.
    pub factor: f64,
}

impl Observation {
    /// Rows of an instant.
    pub fn n_rows(&self) -> usize {
        2 * self.nodes.len() + usize::from(self.force.is_some())
    }

    /// The row of the force.
    pub fn force_row(&self) -> Option<usize> {
        self.force.as_ref().map(|_| 2 * self.nodes.len())
    }

    /// The load cell, whether it takes part or not.
    pub fn cell(&self) -> Option<&LoadCell> {
        self.force.as_ref().or(self.held.as_ref())
    }

    /// A column of rows at the instant number `index` of the border: `of_node` of each node and component, `of_force`
    /// of the load cell where it has a value then.
    pub(crate) fn column(
        &self,
        index: usize,
        of_node: impl Fn(usize, usize) -> f64,
        of_force: impl FnOnce(&LoadCell) -> f64,
    ) -> Dense {
        let force = self.force.as_ref().filter(|cell| cell.at(index).is_some()).map_or(0.0, of_force);
        let n = 2 * self.nodes.len();
        let entry = |row: usize| if row == n { force } else { of_node(self.nodes[row / 2] as usize, row % 2) };
        Dense::from_fn(self.n_rows(), 1, |row, _| entry(row))
    }

    /// Forces compared over all instants.
    pub fn n_forces(&self) -> usize {
        let Some(cell) = &self.force else { return 0 };
        self.instants.iter().filter(|instant| cell.at(instant.index).is_some()).count()
    }

    /// Whether a row is compared.
    pub fn compares(&self, row: usize) -> bool {
        self.compared.get(row / 2).is_none_or(|compared| *compared)
    }

    /// Numbers compared over all instants.
    pub fn n_data(&self) -> usize {
        2 * self.compared.iter().filter(|compared| **compared).count() * self.instants.len() + self.n_forces()
    }
}

/// Largest |u_x| and |u_y| after the least-squares rigid motion (two translations, one infinitesimal rotation) of all
/// points together is taken off.
pub fn largest_without_rigid_motion(points: &[([f64; 2], [f64; 2])]) -> [f64; 2] {
    let n = points.len().max(1) as f64;
    let centre = [0, 1].map(|c| points.iter().map(|(x, _)| x[c]).sum::<f64>() / n);
    let shift = [0, 1].map(|c| points.iter().map(|(_, u)| u[c]).sum::<f64>() / n);
    let (mut moment, mut inertia) = (0.0, 0.0);
    for (x, u) in points {
        let a = [x[0] - centre[0], x[1] - centre[1]];
        moment += a[0] * (u[1] - shift[1]) - a[1] * (u[0] - shift[0]);
        inertia += a[0] * a[0] + a[1] * a[1];
    }
    let w = if inertia > 0.0 { moment / inertia } else { 0.0 };
    let mut largest = [0.0_f64; 2];
    for (x, u) in points {
        let rest = [u[0] - shift[0] + w * (x[1] - centre[1]), u[1] - shift[1] - w * (x[0] - centre[0])];
        largest = [0, 1].map(|c| largest[c].max(rest[c].abs()));
    }
    largest
}

/// The displacement `u` of the point `x` without the rigid motion: what is left is turned back.
pub fn remove_motion(motion: &RigidMotion, x: [f64; 2], u: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = motion.rotation_rad.sin_cos();
    let rigid = motion.displacement(x);
    let rest = [u[0] - rigid[0], u[1] - rigid[1]];
    [cos * rest[0] + sin * rest[1], -sin * rest[0] + cos * rest[1]]
}
