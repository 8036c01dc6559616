//! Four-node interface elements of finite thickness (THEORY 4).

use super::{ElementStiffness, ElementVector};
use crate::mechanics::cohesive::{CohesiveLaw, CohesiveStiffness, Jump, Traction};
use crate::mesh::GAUSS;
use nalgebra::{Matrix2, SMatrix, Vector2};

/// Where the traction is evaluated along an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quadrature {
    /// At its two ends: every node pair for itself.
    #[default]
    NewtonCotes,
    /// At the two Gauss points.
    Gauss,
}

impl Quadrature {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::NewtonCotes => "newton-cotes",
            Self::Gauss => "gauss",
        }
    }
}

/// What counts as jump between faces that are a distance apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kinematics {
    /// Upper minus lower displacement, as in the paper: a rotation `w` of the joint gives `-w t` of sliding.
    #[default]
    Paper,
    /// Less what the rotation of the mid-line contributes: an infinitesimal rotation of the joint gives nothing.
    Objective,
}

impl Kinematics {
    /// Its name in case files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Objective => "objective",
        }
    }
}

/// One point of an element: jump (normal, tangential) = `b u`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterfacePoint {
    b: SMatrix<f64, 2, 8>,
    /// Length of the mid-line that the point stands for, mm.
    pub weight: f64,
    /// Unit normal, from the lower to the upper face.
    pub normal: [f64; 2],
    /// Its place on the mid-line, mm.
    pub position: [f64; 2],
}

impl InterfacePoint {
    /// The jump under the nodal displacements `u` (mm).
    pub fn jump(&self, u: &ElementVector) -> Jump {
        let jump = self.b * u;
        Jump { normal: jump[0], tangential: jump[1] }
    }

    fn add_force(&self, traction: Traction, force: &mut ElementVector) {
        *force += self.b.tr_mul(&(traction.vector() * self.weight));
    }

    fn add_stiffness(&self, tangent: &CohesiveStiffness, stiffness: &mut ElementStiffness) {
        *stiffness += self.b.tr_mul(&(tangent * self.weight * self.b));
    }
}

/// One interface element: nodes lower left, lower right, upper left, upper right, seen along its tangent.
#[derive(Debug, Clone, PartialEq)]
pub struct Interface {
    points: [InterfacePoint; 2],
    ends: [InterfacePoint; 2],
    length: f64,
    gap: f64,
}

impl Interface {
    /// The element between the lower nodes `l1`, `l2` and the upper nodes `u1`, `u2` (mm). The tangent leads along
    /// the mid-line from the first to the second pair, the normal is the tangent turned by 90 degrees.
    /// `None` when the mid-line has no length or the upper face is not above the lower.
    pub fn new([l1, l2, u1, u2]: [[f64; 2]; 4], quadrature: Quadrature, kinematics: Kinematics) -> Option<Self> {
        let [l1, l2, u1, u2] = [l1, l2, u1, u2].map(Vector2::from);
        let (first, second) = (0.5 * (l1 + u1), 0.5 * (l2 + u2));
        let along = second - first;
        let length = along.x.hypot(along.y);
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let tangent = along / length;
        let normal = Vector2::new(-tangent.y, tangent.x);
        let offset = [u1 - l1, u2 - l2];
        let above = offset.map(|o| o.dot(&normal));
        // Faces that touch are allowed; a pair that leans over by half an element is no pair.
        if above.iter().any(|&above| above < -1e-9 * length)
            || offset.iter().any(|o| o.dot(&tangent).abs() > 0.5 * length)
        {
            return None;
        }
        let frame = Matrix2::from_columns(&[normal, tangent]).transpose();
        let point = |share: f64| {
            let shape = [1.0 - share, share];
            let mut b = SMatrix::<f64, 2, 8>::zeros();
            for k in 0..2 {
                b.fixed_columns_mut::<2>(2 * k).copy_from(&(-shape[k] * frame));
                b.fixed_columns_mut::<2>(4 + 2 * k).copy_from(&(shape[k] * frame));
            }
            if kinematics == Kinematics::Objective {
                // Rotation of the mid-line w = n . d(mean u)/ds; it moves the upper point against the lower by
                // w z x o, o the offset between them, which is taken off the jump.
                let o = shape[0] * offset[0] + shape[1] * offset[1];
                let lever = frame * Vector2::new(-o.y, o.x);
                for k in 0..4 {
                    let slope = if k % 2 == 0 { -0.5 } else { 0.5 } / length;
                    let mut of_node = b.fixed_columns_mut::<2>(2 * k);
                    of_node -= lever * slope * normal.transpose();
                }
            }
            let position = (shape[0] * first + shape[1] * second).into();
            InterfacePoint { b, weight: 0.5 * length, normal: normal.into(), position }
        };
        let ends = [point(0.0), point(1.0)];
        let points = match quadrature {
            Quadrature::NewtonCotes => ends,
            Quadrature::Gauss => GAUSS.map(point),
        };
        Some(Self { points, ends, length, gap: 0.5 * (above[0] + above[1]) })
    }

    /// The quadrature points.
    pub fn points(&self) -> &[InterfacePoint; 2] {
        &self.points
    }

    /// Points at the two node pairs, whatever the quadrature.
    pub fn ends(&self) -> &[InterfacePoint; 2] {
        &self.ends
    }

    /// Length of the mid-line, mm.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Mean distance of the faces, mm.
    pub fn gap(&self) -> f64 {
        self.gap
    }

    /// Nodal forces that the tractions under the displacements `u` oppose.
    pub fn force(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> ElementVector {
        let mut force = ElementVector::zeros();
        for point in &self.points {
            point.add_force(law.response(point.jump(u)).traction, &mut force);
        }
        force
    }

    /// The same and its derivative by the displacements, not symmetric; with `viscous` (MPa/mm) added to the
    /// derivatives of normal and tangential traction.
    pub fn tangent(
        &self,
        law: &dyn CohesiveLaw,
        viscous: Vector2<f64>,
        u: &ElementVector,
    ) -> (ElementVector, ElementStiffness) {
        let (mut force, mut stiffness) = (ElementVector::zeros(), ElementStiffness::zeros());
        for point in &self.points {
            let mut response = law.response(point.jump(u));
            response.tangent += Matrix2::from_diagonal(&viscous);
            point.add_force(response.traction, &mut force);
            point.add_stiffness(&response.tangent, &mut stiffness);
        }
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law.
    pub fn secant(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> ElementStiffness {
        let mut stiffness = ElementStiffness::zeros();
        for point in &self.points {
            point.add_stiffness(&law.secant(point.jump(u)), &mut stiffness);
        }
        stiffness
    }

    /// Derivatives of the forces by each parameter of the law, at fixed `u`.
    pub fn force_by_parameters(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> Vec<ElementVector> {
        let n = law.parameters().len();
        let (mut forces, mut by) = (vec![ElementVector::zeros(); n], vec![Traction::default(); n]);
        for point in &self.points {
            law.by_parameters(point.jump(u), &mut by);
            for (force, &traction) in forces.iter_mut().zip(&by) {
                point.add_force(traction, force);
            }
        }
        forces
    }
}
