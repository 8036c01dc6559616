//! Bilinear quadrilaterals with 2 x 2 Gauss points, for small strains and unit thickness.

use super::{ElementStiffness, ElementVector};
use crate::mechanics::substrate::{Strain, Stress, SubstrateLaw};

/// `1/sqrt(3)`.
const GAUSS: f64 = 0.577_350_269_189_625_8;

/// Places of the Gauss points in the square -1..1, in the order in which stresses are given.
const POINTS: [[f64; 2]; 4] = [[-GAUSS, -GAUSS], [GAUSS, -GAUSS], [GAUSS, GAUSS], [-GAUSS, GAUSS]];

/// Corners of the square -1..1, in the order of an element's nodes.
const CORNERS: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];

/// One Gauss point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Q4Point {
    /// Gradient of the shape function of each node, 1/mm.
    pub gradients: [[f64; 2]; 4],
    /// Weight, mm^2: area of the element that the point stands for.
    pub weight: f64,
}

impl Q4Point {
    /// The strain under the nodal displacements `u` (mm).
    pub fn strain(&self, u: &ElementVector) -> Strain {
        let mut strain = [0.0; 3];
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            strain[0] += gx * u[2 * k];
            strain[1] += gy * u[2 * k + 1];
            strain[2] += gy * u[2 * k] + gx * u[2 * k + 1];
        }
        Strain(strain)
    }

    /// Adds the nodal forces of `stress` to `force`.
    fn add_force(&self, Stress([x, y, shear]): Stress, force: &mut ElementVector) {
        let [x, y, shear] = [x, y, shear].map(|stress| stress * self.weight);
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            force[2 * k] += gx * x + gy * shear;
            force[2 * k + 1] += gy * y + gx * shear;
        }
    }

    /// Adds `B^T D B` to `stiffness`, for a symmetric `D`; only what is on and right of the diagonal blocks.
    fn add_stiffness(&self, tangent: &[[f64; 3]; 3], stiffness: &mut ElementStiffness) {
        let d = tangent.map(|row| row.map(|entry| entry * self.weight));
        for (b, &[bx, by]) in self.gradients.iter().enumerate() {
            // D B for the two components of node b.
            let along_x: [f64; 3] = std::array::from_fn(|i| d[i][0] * bx + d[i][2] * by);
            let along_y: [f64; 3] = std::array::from_fn(|i| d[i][1] * by + d[i][2] * bx);
            for (a, &[ax, ay]) in self.gradients.iter().enumerate().take(b + 1) {
                stiffness[2 * a][2 * b] += ax * along_x[0] + ay * along_x[2];
                stiffness[2 * a][2 * b + 1] += ax * along_y[0] + ay * along_y[2];
                stiffness[2 * a + 1][2 * b] += ay * along_x[1] + ax * along_x[2];
                stiffness[2 * a + 1][2 * b + 1] += ay * along_y[1] + ax * along_y[2];
            }
        }
    }
}

/// One element with its Gauss points at (-,-), (+,-), (+,+), (-,+).
#[derive(Debug, Clone, PartialEq)]
pub struct Q4 {
    points: [Q4Point; 4],
}

impl Q4 {
    /// The element with the given corners, counter-clockwise with y up; of a triangle the last one twice.
    /// `None` when it is inverted, folded, or without area.
    pub fn new(corners: [[f64; 2]; 4]) -> Option<Self> {
        let triangle = corners[2] == corners[3];
        // Positive at the corners, then everywhere (it is linear); in the corner of a triangle that two nodes
        // share it is zero by itself.
        let at_corners = CORNERS.iter().map(|&at| jacobian(&corners, at).1);
        let bad = |(k, determinant): (usize, f64)| {
            let positive = determinant > 0.0; // a NaN is not
            !positive && (!triangle || k < 2)
        };
        if at_corners.enumerate().any(bad) {
            return None;
        }
        let points = POINTS.map(|at| {
            let (j, determinant) = jacobian(&corners, at);
            let gradients = local_gradients(at)
                .map(|[a, b]| [(j[1][1] * a - j[0][1] * b) / determinant, (j[0][0] * b - j[1][0] * a) / determinant]);
            Q4Point { gradients, weight: determinant }
        });
        Some(Self { points })
    }

    /// The Gauss points.
    pub fn points(&self) -> &[Q4Point; 4] {
        &self.points
    }

    /// Nodal forces that the stress under the displacements `u` opposes.
    pub fn force(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> ElementVector {
        let mut force = [0.0; 8];
        for point in &self.points {
            point.add_force(law.stress(point.strain(u)), &mut force);
        }
        force
    }

    /// The same and its derivative by the displacements.
    pub fn tangent(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> (ElementVector, ElementStiffness) {
        let (mut force, mut stiffness) = ([0.0; 8], [[0.0; 8]; 8]);
        for point in &self.points {
            let response = law.response(point.strain(u));
            point.add_force(response.stress, &mut force);
            point.add_stiffness(&response.tangent, &mut stiffness);
        }
        mirror(&mut stiffness);
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law.
    pub fn secant(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> ElementStiffness {
        let mut stiffness = [[0.0; 8]; 8];
        for point in &self.points {
            point.add_stiffness(&law.secant(point.strain(u)), &mut stiffness);
        }
        mirror(&mut stiffness);
        stiffness
    }

    /// Derivatives of the forces by each parameter of the law, at fixed `u`.
    pub fn force_by_parameters(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> Vec<ElementVector> {
        let n = law.parameters().len();
        let (mut forces, mut by) = (vec![[0.0; 8]; n], vec![Stress::default(); n]);
        for point in &self.points {
            law.by_parameters(point.strain(u), &mut by);
            for (force, &stress) in forces.iter_mut().zip(&by) {
                point.add_force(stress, force);
            }
        }
        forces
    }
}

/// Copies the blocks right of the diagonal to the left of it.
fn mirror(stiffness: &mut ElementStiffness) {
    for row in 0..8 {
        for column in 0..row {
            // Within a diagonal block both are there, equal for a symmetric D.
            stiffness[row][column] = stiffness[column][row];
        }
    }
}

/// Derivatives of the shape functions by the local coordinates.
fn local_gradients([xi, eta]: [f64; 2]) -> [[f64; 2]; 4] {
    CORNERS.map(|[cx, cy]| [0.25 * cx * (1.0 + cy * eta), 0.25 * cy * (1.0 + cx * xi)])
}

/// `[[dx/dxi, dy/dxi], [dx/deta, dy/deta]]` and its determinant.
fn jacobian(corners: &[[f64; 2]; 4], at: [f64; 2]) -> ([[f64; 2]; 2], f64) {
    let mut j = [[0.0; 2]; 2];
    for (gradient, corner) in local_gradients(at).iter().zip(corners) {
        for i in 0..2 {
            for c in 0..2 {
                j[i][c] += gradient[i] * corner[c];
            }
        }
    }
    (j, j[0][0] * j[1][1] - j[0][1] * j[1][0])
}
