//! Bilinear quadrilaterals with 2 x 2 Gauss points, for small strains and unit thickness.

use super::{ElementStiffness, ElementVector};
use crate::mechanics::substrate::{EngineeringStrain, Stress, SubstrateLaw, SubstrateStiffness};
use crate::mesh::{CORNERS, ElementGeometry, GAUSS_POINTS, GAUSS_WEIGHT};
use nalgebra::Matrix2;

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

    /// Adds the nodal forces of `stress` to `force`.
    fn add_force(&self, Stress([x, y, shear]): Stress, force: &mut ElementVector) {
        let [x, y, shear] = [x, y, shear].map(|stress| stress * self.weight);
        for (k, &[gx, gy]) in self.gradients.iter().enumerate() {
            force[2 * k] += gx * x + gy * shear;
            force[2 * k + 1] += gy * y + gx * shear;
        }
    }

    /// Adds `B^T D B` to `stiffness`, for a symmetric `D`; only what is on and right of the diagonal blocks. Written out
    /// without the zeros of `B`.
    fn add_stiffness(&self, tangent: &SubstrateStiffness, stiffness: &mut ElementStiffness) {
        let d = tangent * self.weight;
        for (b, &[bx, by]) in self.gradients.iter().enumerate() {
            // D B for the two components of node b.
            let along_x = d.column(0) * bx + d.column(2) * by;
            let along_y = d.column(1) * by + d.column(2) * bx;
            for (a, &[ax, ay]) in self.gradients.iter().enumerate().take(b + 1) {
                let mut block = stiffness.fixed_view_mut::<2, 2>(2 * a, 2 * b);
                block += Matrix2::new(
                    ax * along_x[0] + ay * along_x[2],
                    ax * along_y[0] + ay * along_y[2],
                    ay * along_x[1] + ax * along_x[2],
                    ay * along_y[1] + ax * along_y[2],
                );
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
        Some(Self { points })
    }

    /// The Gauss points.
    pub fn points(&self) -> &[Q4Point; 4] {
        &self.points
    }

    /// Nodal forces that the stress under the displacements `u` opposes.
    pub fn force(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> ElementVector {
        let mut force = ElementVector::zeros();
        for point in &self.points {
            point.add_force(law.stress(point.strain(u)), &mut force);
        }
        force
    }

    /// The same and its derivative by the displacements.
    pub fn tangent(&self, law: &dyn SubstrateLaw, u: &ElementVector) -> (ElementVector, ElementStiffness) {
        let (mut force, mut stiffness) = (ElementVector::zeros(), ElementStiffness::zeros());
        for point in &self.points {
            let response = law.response(point.strain(u));
            point.add_force(response.stress, &mut force);
            point.add_stiffness(&response.tangent, &mut stiffness);
        }
        stiffness.fill_lower_triangle_with_upper_triangle();
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law.
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
            law.by_parameters(point.strain(u), &mut by);
            for (force, &stress) in forces.iter_mut().zip(&by) {
                point.add_force(stress, force);
            }
        }
        forces
    }
}
