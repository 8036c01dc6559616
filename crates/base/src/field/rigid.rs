//! The rigid-body motion in a displacement field.

use serde::Serialize;

/// The rotation about `centre` and the translation that fit a set of displacements best.
///
/// A point `X` moves to `centre + translation + R (X - centre)`, with the exact rotation
/// `R = [cos w, -sin w; sin w, cos w]` (least squares, Procrustes). With y down, a positive angle turns
/// x towards y: clockwise on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RigidMotion {
    /// Mean of the reference positions.
    pub centre: [f64; 2],
    /// Displacement of `centre`.
    pub translation: [f64; 2],
    /// Angle of rotation, radians.
    pub rotation_rad: f64,
}

impl RigidMotion {
    /// Fits the motion to `points` and their `displacements`; `None` without any point.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::RigidMotion;
    /// let points = [[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]];
    /// let shift = [[1.0, -3.0]; 3];
    /// let motion = RigidMotion::fit(points.into_iter().zip(shift)).unwrap();
    /// assert!((motion.translation[1] + 3.0).abs() < 1e-15 && motion.rotation_rad.abs() < 1e-15);
    /// ```
    pub fn fit(points_and_displacements: impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone) -> Option<Self> {
        let mut n = 0.0;
        let (mut centre, mut translation) = ([0.0; 2], [0.0; 2]);
        for (x, u) in points_and_displacements.clone() {
            n += 1.0;
            for k in 0..2 {
                centre[k] += x[k];
                translation[k] += u[k];
            }
        }
        if n == 0.0 {
            return None;
        }
        for k in 0..2 {
            centre[k] /= n;
            translation[k] /= n;
        }
        // Maximise sum (X - centre) . R^T (x - mean x): the angle of the summed complex products.
        let (mut along, mut across) = (0.0, 0.0);
        for (x, u) in points_and_displacements {
            let a = [x[0] - centre[0], x[1] - centre[1]];
            let b = [a[0] + u[0] - translation[0], a[1] + u[1] - translation[1]];
            along += a[0] * b[0] + a[1] * b[1];
            across += a[0] * b[1] - a[1] * b[0];
        }
        Some(Self { centre, translation, rotation_rad: across.atan2(along) })
    }

    /// The displacement of the point `x` under this motion; of many points [`RigidMotion::field`].
    pub fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        self.field()(x)
    }

    /// The displacement of points under this motion, whose sine and cosine are taken once.
    pub fn field(&self) -> impl Fn([f64; 2]) -> [f64; 2] {
        let Self { centre, translation, rotation_rad } = *self;
        let (sin, cos) = rotation_rad.sin_cos();
        move |x| {
            let a = [x[0] - centre[0], x[1] - centre[1]];
            [translation[0] + (cos - 1.0) * a[0] - sin * a[1], translation[1] + sin * a[0] + (cos - 1.0) * a[1]]
        }
    }
}

/// The strain of a field that is alike in all directions and at all places, as of a scale that changed, an expansion by
/// heat, two equal loads; `None` where a fifth of it or more is something else, noise included.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::uniform_strain;
/// let points = [[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [100.0, 100.0]];
/// let field = |[a, b]: [f64; 2]| uniform_strain(points.iter().map(move |&[x, y]| ([x, y], [a * x + 3.0, b * y])));
/// assert!((field([1e-3, 1e-3]).unwrap() - 1e-3).abs() < 1e-12);
/// assert_eq!(field([1e-3, -3e-4]), None); // pulled along x
/// ```
pub fn uniform_strain(points_and_displacements: impl Iterator<Item = ([f64; 2], [f64; 2])> + Clone) -> Option<f64> {
    /// How many times the strain's own displacement is what else there is.
    const CLEAR: f64 = 5.0;
    let RigidMotion { centre, translation, rotation_rad } = RigidMotion::fit(points_and_displacements.clone())?;
    let (sin, cos) = rotation_rad.sin_cos();
    let (mut size, mut along, mut moved) = (0.0, 0.0, 0.0);
    for (x, u) in points_and_displacements {
        let a = [x[0] - centre[0], x[1] - centre[1]];
        let b = [a[0] + u[0] - translation[0], a[1] + u[1] - translation[1]];
        let turned = [cos * a[0] - sin * a[1], sin * a[0] + cos * a[1]];
        size += a[0] * a[0] + a[1] * a[1];
        along += turned[0] * b[0] + turned[1] * b[1];
        moved += b[0] * b[0] + b[1] * b[1];
    }
    let strain = along / size - 1.0;
    let left = (moved - along * along / size).max(0.0);
    (strain * strain * size > CLEAR * CLEAR * left).then_some(strain)
}
