//! Bilinear quadrilaterals with 2 x 2 Gauss points, for small strains and unit thickness; rotations small or of any
//! size.

use super::Kinematics;
use super::{ElementStiffness, ElementVector};
use crate::mechanics::substrate::{EngineeringStrain, Stress, SubstrateLaw, SubstrateResponse, SubstrateStiffness};
use crate::mesh::{CORNERS, ElementGeometry, GAUSS_POINTS, GAUSS_WEIGHT};
use nalgebra::{Matrix2, Matrix3x2, Vector2};

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
    pub fn strain(&self, u: &ElementVector) -> EngineeringStrain {
        let mut strain = EngineeringStrain::default();
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            strain.xx += gx * u[2 * k];
            strain.yy += gy * u[2 * k + 1];
            strain.gamma_xy += gy * u[2 * k] + gx * u[2 * k + 1];
        }
        strain
    }

    /// The deformation gradient `F = I + du/dX`.
    fn deformation(&self, u: &ElementVector) -> Matrix2<f64> {
        let mut f = Matrix2::identity();
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            f += Matrix2::new(u[2 * k] * gx, u[2 * k] * gy, u[2 * k + 1] * gx, u[2 * k + 1] * gy);
        }
        f
    }

    /// The Green-Lagrange strain `(F^T F - I)/2`: nothing under any rotation (THEORY 14).
    pub fn green_lagrange(&self, u: &ElementVector) -> EngineeringStrain {
        let mut gradient = Matrix2::zeros();
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            gradient += Matrix2::new(u[2 * k] * gx, u[2 * k] * gy, u[2 * k + 1] * gx, u[2 * k + 1] * gy);
        }
        // Not F^T F - I: small strains would lose their last digits against the 1.
        let [x, y] = [gradient.column(0), gradient.column(1)];
        EngineeringStrain {
            xx: x[0] + 0.5 * x.norm_squared(),
            yy: y[1] + 0.5 * y.norm_squared(),
            gamma_xy: x[1] + y[0] + x.dot(&y),
        }
    }

    /// Adds the nodal forces of the second Piola-Kirchhoff stress `stress` under the deformation gradient `f`.
    fn add_turned_force(&self, Stress([x, y, shear]): Stress, f: &Matrix2<f64>, force: &mut ElementVector) {
        let first = f * Matrix2::new(x, shear, shear, y) * self.weight;
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            force[2 * k] += first[(0, 0)] * gx + first[(0, 1)] * gy;
            force[2 * k + 1] += first[(1, 0)] * gx + first[(1, 1)] * gy;
        }
    }

    /// Adds what the material and the stress itself (the geometric stiffness) resist with; only what is on and right of
    /// the diagonal blocks.
    fn add_turned_stiffness(&self, response: &SubstrateResponse, f: &Matrix2<f64>, stiffness: &mut ElementStiffness) {
        let Stress([x, y, shear]) = response.stress;
        let stress = Matrix2::new(x, shear, shear, y) * self.weight;
        let d = response.tangent * self.weight;
        // Derivative of (E_xx, E_yy, 2 E_xy) by the two components of a node.
        let strains = self.gradients.map(|[gx, gy]| {
            Matrix3x2::new(
                f[(0, 0)] * gx,
                f[(1, 0)] * gx,
                f[(0, 1)] * gy,
                f[(1, 1)] * gy,
                f[(0, 0)] * gy + f[(0, 1)] * gx,
                f[(1, 0)] * gy + f[(1, 1)] * gx,
            )
        });
        for (b, &[bx, by]) in self.gradients.iter().enumerate() {
            let of_b = d * strains[b];
            let pull = stress * Vector2::new(bx, by);
            for (a, &[ax, ay]) in self.gradients.iter().enumerate().take(b + 1) {
                let mut block = stiffness.fixed_view_mut::<2, 2>(2 * a, 2 * b);
                block += strains[a].tr_mul(&of_b) + Matrix2::identity() * (ax * pull.x + ay * pull.y);
            }
        }
    }

    /// Adds the nodal forces of `stress` to `force`.
    fn add_force(&self, Stress([x, y, shear]): Stress, force: &mut ElementVector) {
        let [x, y, shear] = [x, y, shear].map(|stress| stress * self.weight);
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            force[2 * k] += gx * x + gy * shear;
            force[2 * k + 1] += gy * y + gx * shear;
        }
    }

    /// Adds `B^T D B` to `stiffness`, for a symmetric `D`: column by column, without the zeros of `B`.
    fn add_stiffness(&self, tangent: &SubstrateStiffness, stiffness: &mut ElementStiffness) {
        let d = tangent * self.weight;
        // Down a column the gradients, and those of the other direction.
        let (mut own, mut other) = ([0.0; 8], [0.0; 8]);
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            (own[2 * k], own[2 * k + 1]) = (gx, gy);
            (other[2 * k], other[2 * k + 1]) = (gy, gx);
        }
        let (columns, _) = stiffness.as_mut_slice().as_chunks_mut::<8>();
        for (k, column) in columns.iter_mut().enumerate() {
            let normal = k % 2;
            // D times this column of B.
            let [x, y, shear] = [0, 1, 2].map(|row| d[(row, normal)] * own[k] + d[(row, 2)] * other[k]);
            for i in 0..8 {
                let along = if i % 2 == 0 { x } else { y };
                column[i] += own[i] * along + other[i] * shear;
            }
        }
    }
}

/// One element with its Gauss points at (-,-), (+,-), (+,+), (-,+).
#[derive(Debug, Clone, PartialEq)]
pub struct Q4 {
    points: [Q4Point; 4],
    small: bool,
}

impl Q4 {
    /// The element with the given corners, counter-clockwise with y up; of a triangle the last one twice. Rotations are
    /// small or of any size, as `kinematics` says.
    /// `None` when it is inverted, folded, or without area.
    pub fn new(corners: [[f64; 2]; 4], kinematics: Kinematics) -> Option<Self> {
        let geometry = ElementGeometry::new(corners);
        // Positive at the corners, then everywhere (it is linear); in the corner of a triangle that two nodes
        // share it is zero by itself.
        let checked = if geometry.is_triangle() { 2 } else { 4 };
        let positive = |&at: &[f64; 2]| geometry.map_at(at).determinant > 0.0; // a NaN is not
        if !CORNERS[..checked].iter().all(positive) {
            return None;
        }
        let points = GAUSS_POINTS.map(|at| {
            let map = geometry.map_at(at);
            Q4Point { gradients: map.gradients(), weight: GAUSS_WEIGHT * map.determinant }
        });
        Some(Self { points, small: kinematics.is_small() })
    }

    /// The strain at `point`, one of this element, under the nodal displacements `u` (mm): small, or Green-Lagrange.
    pub fn strain(&self, point: &Q4Point, u: &ElementVector) -> EngineeringStrain {
        if self.small { point.strain(u) } else { point.green_lagrange(u) }
    }

    /// The Gauss points.
    pub fn points(&self) -> &[Q4Point; 4] {
        &self.points
    }

    /// Nodal forces that the stress under the displacements `u` opposes.
    pub fn force(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> ElementVector {
        let mut force = ElementVector::zeros();
        for point in &self.points {
            if self.small {
                point.add_force(law.stress(point.strain(u)), &mut force);
            } else {
                point.add_turned_force(law.stress(point.green_lagrange(u)), &point.deformation(u), &mut force);
            }
        }
        force
    }

    /// The same and its derivative by the displacements.
    pub fn tangent(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> (ElementVector, ElementStiffness) {
        let (mut force, mut stiffness) = (ElementVector::zeros(), ElementStiffness::zeros());
        let responses = law.responses(&self.points.map(|point| self.strain(&point, u)));
        for (point, response) in self.points.iter().zip(&responses) {
            if self.small {
                point.add_force(response.stress, &mut force);
                point.add_stiffness(&response.tangent, &mut stiffness);
            } else {
                let f = point.deformation(u);
                point.add_turned_force(response.stress, &f, &mut force);
                point.add_turned_stiffness(response, &f, &mut stiffness);
            }
        }
        stiffness.fill_lower_triangle_with_upper_triangle();
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law; of small rotations
    /// alone.
    pub fn secant(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> ElementStiffness {
        let mut stiffness = ElementStiffness::zeros();
        for point in &self.points {
            point.add_stiffness(&law.secant(point.strain(u)), &mut stiffness);
        }
        stiffness.fill_lower_triangle_with_upper_triangle();
        stiffness
    }

    /// Derivatives of the forces by each parameter of the law, at fixed `u`.
    pub fn force_by_parameters(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> Vec<ElementVector> {
        let n = law.parameters().len();
        let (mut forces, mut by) = (vec![ElementVector::zeros(); n], vec![Stress::default(); n]);
        for point in &self.points {
            law.by_parameters(self.strain(point, u), &mut by);
            let f = (!self.small).then(|| point.deformation(u));
            for (force, &stress) in forces.iter_mut().zip(&by) {
                match &f {
                    None => point.add_force(stress, force),
                    Some(f) => point.add_turned_force(stress, f, force),
                }
            }
        }
        forces
    }
}
