//! Four-node interface elements of finite thickness (THEORY 4).

use super::{ElementStiffness, ElementVector};
use crate::io::case::{Kinematics, Quadrature};
use crate::mechanics::cohesive::{CohesiveLaw, CohesiveStiffness, Jump, Traction};
use crate::mesh::GAUSS;
use nalgebra::{Matrix2, SMatrix, Vector2};

/// One point of an element: jump (normal, tangential) = `b u` where rotations are small.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InterfacePoint {
    b: Slopes,
    /// Share of each of the two node pairs.
    shape: [f64; 2],
    /// The lower face to the upper one at rest, normal and tangential component, mm.
    offset: Vector2<f64>,
    /// Length of the mid-line that the point stands for, mm.
    pub weight: f64,
    /// Unit normal, from the lower to the upper face.
    pub normal: [f64; 2],
    /// Its place on the mid-line, mm.
    pub position: [f64; 2],
}

/// Derivative of a jump (normal, tangential) by the displacements of the nodes.
type Slopes = SMatrix<f64, 2, 8>;

impl InterfacePoint {
    fn add_force(&self, b: &Slopes, traction: Traction, force: &mut ElementVector) {
        *force += b.tr_mul(&(traction.vector() * self.weight));
    }

    fn add_stiffness(&self, b: &Slopes, tangent: &CohesiveStiffness, stiffness: &mut ElementStiffness) {
        *stiffness += b.tr_mul(&(tangent * self.weight * b));
    }
}

/// The mid-line of an element where it is now: its axes, and how they follow the nodes.
struct MidLine {
    tangent: Vector2<f64>,
    normal: Vector2<f64>,
    /// Derivative of its angle, and of the logarithm of its length, by the displacements.
    turn: ElementVector,
    stretch: ElementVector,
}

/// A point between faces that turn: `jump = (n . d, t . d) - offset`, `d` from the lower to the upper face now.
struct Turned {
    jump: Jump,
    b: Slopes,
    /// `d` by normal and tangential component, and their derivatives while the axes stand still.
    d: Vector2<f64>,
    still: Slopes,
}

/// One interface element: nodes lower left, lower right, upper left, upper right, seen along its tangent.
#[derive(Debug, Clone, PartialEq)]
pub struct Interface {
    points: [InterfacePoint; 2],
    ends: [InterfacePoint; 2],
    corners: [Vector2<f64>; 4],
    kinematics: Kinematics,
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
            let offset = frame * (shape[0] * offset[0] + shape[1] * offset[1]);
            InterfacePoint { b, shape, offset, weight: 0.5 * length, normal: normal.into(), position }
        };
        let ends = [point(0.0), point(1.0)];
        let points = match quadrature {
            Quadrature::NewtonCotes => ends,
            Quadrature::Gauss => GAUSS.map(point),
        };
        let corners = [l1, l2, u1, u2];
        Some(Self { points, ends, corners, kinematics, length, gap: 0.5 * (above[0] + above[1]) })
    }

    /// Where the nodes are under the displacements `u`.
    fn places(&self, u: &ElementVector) -> [Vector2<f64>; 4] {
        std::array::from_fn(|k| self.corners[k] + u.fixed_rows::<2>(2 * k))
    }

    fn mid_line(places: &[Vector2<f64>; 4]) -> MidLine {
        let [l1, l2, u1, u2] = places;
        let along = 0.5 * ((l2 - l1) + (u2 - u1));
        let length = along.norm();
        let tangent = along / length;
        let normal = Vector2::new(-tangent.y, tangent.x);
        let follow = |axis: Vector2<f64>| {
            let side = |k: usize| if k.is_multiple_of(2) { -0.5 } else { 0.5 };
            ElementVector::from_fn(|i, _| side(i / 2) * axis[i % 2] / length)
        };
        MidLine { tangent, normal, turn: follow(normal), stretch: follow(tangent) }
    }

    /// The point between the faces at `places`, seen from the mid-line there. A rotation `w` of the mid-line changes
    /// `(n . d, t . d)` by `(-t . d, n . d) w`.
    fn turned(point: &InterfacePoint, places: &[Vector2<f64>; 4], line: &MidLine) -> Turned {
        let [l1, l2, u1, u2] = places;
        let [first, second] = point.shape;
        let d = first * (u1 - l1) + second * (u2 - l2);
        let d = Vector2::new(line.normal.dot(&d), line.tangent.dot(&d));
        let mut still = Slopes::zeros();
        for k in 0..2 {
            for c in 0..2 {
                let axes = Vector2::new(line.normal[c], line.tangent[c]) * point.shape[k];
                still.set_column(2 * k + c, &-axes);
                still.set_column(4 + 2 * k + c, &axes);
            }
        }
        let b = still + Vector2::new(-d[1], d[0]) * line.turn.transpose();
        Turned { jump: Jump::from(d - point.offset), b, d, still }
    }

    /// Calls `each` with every quadrature point, the jump there under `u`, and its derivative by `u`.
    fn for_each(&self, u: &ElementVector, mut each: impl FnMut(&InterfacePoint, Jump, &Slopes)) {
        if self.kinematics.is_small() {
            self.points.iter().for_each(|point| each(point, Jump::from(point.b * u), &point.b));
            return;
        }
        let places = self.places(u);
        let line = Self::mid_line(&places);
        for point in &self.points {
            let Turned { jump, b, .. } = Self::turned(point, &places, &line);
            each(point, jump, &b);
        }
    }

    /// The jump at `point`, one of this element, under the nodal displacements `u` (mm).
    pub fn jump(&self, point: &InterfacePoint, u: &ElementVector) -> Jump {
        if self.kinematics.is_small() {
            return Jump::from(point.b * u);
        }
        let places = self.places(u);
        Self::turned(point, &places, &Self::mid_line(&places)).jump
    }

    /// Its change with a change `by` of the displacements, to first order.
    pub fn jump_change(&self, point: &InterfacePoint, u: &ElementVector, by: &ElementVector) -> Jump {
        if self.kinematics.is_small() {
            return Jump::from(point.b * by);
        }
        let places = self.places(u);
        Jump::from(Self::turned(point, &places, &Self::mid_line(&places)).b * by)
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
        self.for_each(u, |point, jump, b| point.add_force(b, law.response(jump).traction, &mut force));
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
        let mut add = |point: &InterfacePoint, jump: Jump, b: &Slopes| {
            let mut response = law.response(jump);
            response.tangent += Matrix2::from_diagonal(&viscous);
            point.add_force(b, response.traction, &mut force);
            point.add_stiffness(b, &response.tangent, &mut stiffness);
            response.traction
        };
        if self.kinematics.is_small() {
            self.for_each(u, |point, jump, b| _ = add(point, jump, b));
        } else {
            let places = self.places(u);
            let line = Self::mid_line(&places);
            let mut second = ElementStiffness::zeros();
            for point in &self.points {
                let turned = Self::turned(point, &places, &line);
                let traction = add(point, turned.jump, &turned.b);
                second += turned.second_derivative(traction, &line) * point.weight;
            }
            stiffness += second;
        }
        (force, stiffness)
    }

    /// The matrix that gives the same forces when multiplied with `u`, from the secants of the law; of small rotations
    /// alone.
    pub fn secant(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> ElementStiffness {
        let mut stiffness = ElementStiffness::zeros();
        self.for_each(u, |point, jump, b| point.add_stiffness(b, &law.secant(jump), &mut stiffness));
        stiffness
    }

    /// Derivative of the nodal forces by the thickness of the adhesive, relative, at fixed displacements: a separation is
    /// strain times thickness, so that `T(jump / thickness)` falls by the tangent times the jump.
    pub fn force_by_thickness(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> ElementVector {
        let mut force = ElementVector::zeros();
        self.for_each(u, |point, jump, b| {
            let by = -(law.response(jump).tangent * Vector2::new(jump.normal, jump.tangential));
            point.add_force(b, Traction { normal: by.x, tangential: by.y }, &mut force);
        });
        force
    }

    /// Derivatives of the forces by each parameter of the law, at fixed `u`.
    pub fn force_by_parameters(&self, law: &dyn CohesiveLaw, u: &ElementVector) -> Vec<ElementVector> {
        let n = law.parameters().len();
        let (mut forces, mut by) = (vec![ElementVector::zeros(); n], vec![Traction::default(); n]);
        self.for_each(u, |point, jump, b| {
            law.by_parameters(jump, &mut by);
            for (force, &traction) in forces.iter_mut().zip(&by) {
                point.add_force(b, traction, force);
            }
        });
        forces
    }
}

impl Turned {
    /// `T_n d2 jump_n + T_t d2 jump_t`: what the turning of the axes adds to the tangent. With `w` the derivative of
    /// the angle, `s` that of the logarithm of the length and `a_n`, `a_t` those of `n . d`, `t . d` in axes that
    /// stand still,
    ///
    /// ```text
    /// d2 jump_n = -(a_t w + w a_t) - (n . d) w w + (t . d) (w s + s w)
    /// d2 jump_t =  (a_n w + w a_n) - (t . d) w w - (n . d) (w s + s w)
    /// ```
    fn second_derivative(&self, Traction { normal, tangential }: Traction, line: &MidLine) -> ElementStiffness {
        let MidLine { turn, stretch, .. } = line;
        let [dn, dt] = [self.d[0], self.d[1]];
        // Everything has w as one factor: w q + q w.
        let still = self.still.transpose();
        let other =
            still.column(0) * tangential - still.column(1) * normal - turn * (0.5 * (normal * dn + tangential * dt))
                + stretch * (normal * dt - tangential * dn);
        turn * other.transpose() + other * turn.transpose()
    }
}
