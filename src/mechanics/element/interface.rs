//! Four-node interface elements of finite thickness (THEORY 4).

use super::{ElementStiffness, ElementVector};
use crate::mechanics::cohesive::{CohesiveLaw, CohesiveStiffness, Jump, Traction};

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
    b: [[f64; 8]; 2],
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
        let along = |b: &[f64; 8]| b.iter().zip(u).map(|(b, u)| b * u).sum::<f64>();
        Jump { normal: along(&self.b[0]), tangential: along(&self.b[1]) }
    }

    fn add_force(&self, traction: Traction, force: &mut ElementVector) {
        let [normal, tangential] = [traction.normal, traction.tangential].map(|t| t * self.weight);
        for k in 0..8 {
            force[k] += self.b[0][k] * normal + self.b[1][k] * tangential;
        }
    }

    fn add_stiffness(&self, tangent: &CohesiveStiffness, stiffness: &mut ElementStiffness) {
        let c = tangent.map(|row| row.map(|entry| entry * self.weight));
        for column in 0..8 {
            let (bn, bt) = (self.b[0][column], self.b[1][column]);
            let (normal, tangential) = (c[0][0] * bn + c[0][1] * bt, c[1][0] * bn + c[1][1] * bt);
            for row in 0..8 {
                stiffness[row][column] += self.b[0][row] * normal + self.b[1][row] * tangential;
            }
        }
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
        let middle = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
        let (first, second) = (middle(l1, u1), middle(l2, u2));
        let along = [second[0] - first[0], second[1] - first[1]];
        let length = along[0].hypot(along[1]);
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let tangent = along.map(|c| c / length);
        let normal = [-tangent[1], tangent[0]];
        let offset = [[u1[0] - l1[0], u1[1] - l1[1]], [u2[0] - l2[0], u2[1] - l2[1]]];
        let above = offset.map(|o| o[0] * normal[0] + o[1] * normal[1]);
        let sideways = offset.map(|o| (o[0] * tangent[0] + o[1] * tangent[1]).abs());
        // Faces that touch are allowed; a pair that leans over by half an element is no pair.
        if above.iter().any(|&above| above < -1e-9 * length) || sideways.iter().any(|&s| s > 0.5 * length) {
            return None;
        }
        let point = |share: f64| {
            let shape = [1.0 - share, share];
            let mut b = [[0.0; 8]; 2];
            for (row, axis) in b.iter_mut().zip([normal, tangent]) {
                for k in 0..2 {
                    for c in 0..2 {
                        row[2 * k + c] = -shape[k] * axis[c];
                        row[4 + 2 * k + c] = shape[k] * axis[c];
                    }
                }
            }
            if kinematics == Kinematics::Objective {
                // Rotation of the mid-line w = n . d(mean u)/ds; it moves the upper point against the lower by
                // w z x o, o the offset between them, which is taken off the jump.
                let o: [f64; 2] = std::array::from_fn(|c| shape[0] * offset[0][c] + shape[1] * offset[1][c]);
                for (row, axis) in b.iter_mut().zip([normal, tangent]) {
                    let lever = -o[1] * axis[0] + o[0] * axis[1];
                    for k in 0..4 {
                        let slope = if k % 2 == 0 { -0.5 } else { 0.5 } / length;
                        for c in 0..2 {
                            row[2 * k + c] -= lever * slope * normal[c];
                        }
                    }
                }
            }
            let position = std::array::from_fn(|c| shape[0] * first[c] + shape[1] * second[c]);
            InterfacePoint { b, weight: 0.5 * length, normal, position }
        };
        let ends = [point(0.0), point(1.0)];
        let points = match quadrature {
            Quadrature::NewtonCotes => ends,
            // 1/2 -+ 1/(2 sqrt(3))
            Quadrature::Gauss => [point(0.211_324_865_405_187_13), point(0.788_675_134_594_812_9)],
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
        let mut force = [0.0; 8];
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
        viscous: [f64; 2],
        u: &ElementVector,
    ) -> (ElementVector, ElementStiffness) {
        let (mut force, mut stiffness) = ([0.0; 8], [[0.0; 8]; 8]);
        for point in &self.points {
            let mut response = law.response(point.jump(u));
            response.tangent[0][0] += viscous[0];
            response.tangent[1][1] += viscous[1];
            point.add_force(response.traction, &mut force);
            point.add_stiffness(&response.tangent, &mut stiffness);
        }
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law.
    pub fn secant(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> ElementStiffness {
        let mut stiffness = [[0.0; 8]; 8];
        for point in &self.points {
            point.add_stiffness(&law.secant(point.jump(u)), &mut stiffness);
        }
        stiffness
    }

    /// Derivatives of the forces by each parameter of the law, at fixed `u`.
    pub fn force_by_parameters(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> Vec<ElementVector> {
        let n = law.parameters().len();
        let (mut forces, mut by) = (vec![[0.0; 8]; n], vec![Traction::default(); n]);
        for point in &self.points {
            law.by_parameters(point.jump(u), &mut by);
            for (force, &traction) in forces.iter_mut().zip(&by) {
                point.add_force(traction, force);
            }
        }
        forces
    }
}
