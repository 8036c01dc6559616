//! The map from the plane to raw pixels, its inverse, and their derivatives.

use super::shape::{CameraError, CameraShape, Covariance, PARAMETERS, Theta, USUAL_DISTANCE, USUAL_DISTORTION};
use crate::plane::Point;

/// A matrix of two rows.
pub(super) type Square = [[f64; 2]; 2];

/// Rows of points along a side of the image at which a camera is checked.
const CHECKED: usize = 17;
/// Change of the area above which a distortion is mild.
const MILD: f64 = 0.5;
/// Change of the area below which it is taken to fold.
const FOLD: f64 = 0.05;
/// Distance from the camera, of that of the centre, up to which the plane is in sight: behind it nothing is seen.
const IN_SIGHT: f64 = 0.1;
/// Newton's steps square their error: what follows one of this size, in lengths that are divided by `f`, is round-off.
const SETTLED: f64 = 1e-9;

/// A camera, its parameters and their uncertainty.
///
/// With `c` the centre, `d = X - c` and `f` the length that coordinates are divided by (THEORY 22):
///
/// ```text
/// n = A d / (f (1 + h . d)),      A = [1 + stretch, shear; shear, 1 - stretch],  h = (tilt_x, tilt_y)
/// x = c + f D(n),                 D: Brown's distortion with k1, k2, p1, p2, k3
/// ```
///
/// A homography has eight numbers: `h`, `stretch` and `shear` are four. The others (scale, rotation, origin of the
/// plane) are free, and so chosen that plane and image agree at the centre.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::camera::{Camera, CameraShape};
/// let mut shape = CameraShape::plain([1024, 768]);
/// shape.theta[0] = 0.01; // 1 % at the corner: coordinates are divided by half the diagonal
/// let camera = Camera::new(shape).unwrap();
/// let corner = camera.pixel([1023.0, 767.0]);
/// assert!((corner[0] - 1023.0 - 0.01 * 511.5).abs() < 0.02);
/// let back = camera.plane(corner).unwrap();
/// assert!((back[0] - 1023.0).abs() < 1e-9);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    shape: CameraShape,
    /// Changes of the parameters, one standard uncertainty each, independent of each other.
    columns: Vec<Theta>,
}

impl Camera {
    /// Checks what is given.
    ///
    /// # Errors
    /// Numbers that cannot be, a matrix that is no covariance, a distortion that folds inside the image.
    pub fn new(shape: CameraShape) -> Result<Self, CameraError> {
        let positive = [("focal_px", shape.focal_px[0]), ("focal_px", shape.focal_px[1])];
        let sizes = shape.image_size_px.map(|n| ("image_size_px", n as f64));
        for (what, value) in positive.into_iter().chain(sizes) {
            if !(value.is_finite() && value > 0.0) {
                return Err(CameraError::Number { what, value, positive: true });
            }
        }
        if let Some(k) = shape.theta.iter().position(|v| !v.is_finite()) {
            return Err(CameraError::Number { what: PARAMETERS[k], value: shape.theta[k], positive: false });
        }
        if !(shape.distance_std.is_finite() && shape.distance_std >= 0.0) {
            return Err(CameraError::Std { what: "the distance", value: shape.distance_std });
        }
        let columns = shape.covariance.columns()?;
        let camera = Self { shape, columns };
        let [width, height] = camera.shape.image_size_px.map(|n| (n - 1) as f64 / (CHECKED - 1) as f64);
        for at in (0..CHECKED * CHECKED).map(|k| [(k % CHECKED) as f64 * width, (k / CHECKED) as f64 * height]) {
            let is_seen = camera.undistorted_along(camera.normalised(at)).is_some() && camera.plane(at).is_some();
            is_seen.then_some(()).ok_or(CameraError::Folds { x: at[0], y: at[1] })?;
        }
        Ok(camera)
    }

    /// Of nothing known: no distortion, and the uncertainty of a usual lens, [`USUAL_DISTORTION`] at the corner, and of a
    /// usual distance.
    ///
    /// # Errors
    /// Images without pixels.
    pub fn usual(image_size_px: [usize; 2]) -> Result<Self, CameraError> {
        let mut std = [0.0; PARAMETERS.len()];
        std[0] = USUAL_DISTORTION;
        let (covariance, distance_std) = (Covariance::of_std(&std), USUAL_DISTANCE);
        Self::new(CameraShape { covariance, distance_std, ..CameraShape::plain(image_size_px) })
    }

    /// What it is given by.
    pub fn shape(&self) -> &CameraShape {
        &self.shape
    }

    /// Whether plane and raw pixels are the same.
    pub fn is_plain(&self) -> bool {
        (0..PARAMETERS.len()).all(|k| (5..7).contains(&k) || self.shape.theta[k] == 0.0)
    }

    /// Whether it has no uncertainty, and none comes of zones that stay as they are.
    pub fn is_exact(&self) -> bool {
        self.columns.is_empty() && self.shape.distance_std == 0.0 && self.shape.still.is_empty()
    }

    /// Changes of the parameters by one standard uncertainty, independent of each other, one for each parameter that its covariance
    /// names.
    pub fn columns(&self) -> &[Theta] {
        &self.columns
    }

    /// Refuses images of another size.
    ///
    /// # Errors
    /// [`CameraError::ImageSize`].
    pub fn check_images(&self, images: [usize; 2]) -> Result<(), CameraError> {
        let camera = self.shape.image_size_px;
        if camera == images { Ok(()) } else { Err(CameraError::ImageSize { camera, images }) }
    }

    /// Where the point `at` of the plane falls, raw px.
    pub fn pixel(&self, at: Point) -> Point {
        self.pixel_of(&self.seen(at))
    }

    fn pixel_of(&self, seen: &Seen) -> Point {
        let ([a, b], f) = (self.distorted(seen.n), self.shape.focal_px);
        [seen.centre[0] + f[0] * a, seen.centre[1] + f[1] * b]
    }

    /// The point of the plane that is seen at `px`; `None` where the distortion folds, or the plane is not in sight.
    pub fn plane(&self, px: Point) -> Option<Point> {
        let [cx, cy] = [self.shape.theta[5], self.shape.theta[6]];
        let focal = self.shape.focal_px;
        let n = self.undistorted(self.normalised(px))?;
        let q = [n[0] * focal[0], n[1] * focal[1]];
        // (A - q h^T) d = q
        let (h, a) = (self.tilt(), self.stretch());
        let matrix = [0, 1].map(|i| [0, 1].map(|j| a[i][j] - q[i] * h[j]));
        let inverse = inverse(matrix)?;
        let d = times(inverse, q);
        (1.0 + h[0] * d[0] + h[1] * d[1] > IN_SIGHT).then_some([cx + d[0], cy + d[1]])
    }

    /// The same with `dX/dx` there, by few steps from a place of the plane that is `near`.
    pub(super) fn plane_near(&self, px: Point, near: Point) -> Option<(Point, Square)> {
        const STEPS: usize = 4;
        let settled = SETTLED * SETTLED * self.shape.focal_px[0] * self.shape.focal_px[1];
        let mut at = near;
        for _ in 0..STEPS {
            let seen = self.seen(at);
            let lens = self.lens_slope(seen.n);
            if !(seen.w > IN_SIGHT && determinant(lens) > MILD) {
                break;
            }
            let (slope, there) = (inverse(product(lens, seen.slope))?, self.pixel_of(&seen));
            let [x, y] = times(slope, [px[0] - there[0], px[1] - there[1]]);
            at = [at[0] + x, at[1] + y];
            if x * x + y * y <= settled {
                return Some((at, slope));
            }
        }
        let at = self.plane(px)?;
        Some((at, self.plane_slope(at)?))
    }

    /// `dP/dX` at the point `at` of the plane.
    pub fn slope(&self, at: Point) -> Square {
        let seen = self.seen(at);
        product(self.lens_slope(seen.n), seen.slope)
    }

    /// `dX/dx`, the inverse of [`slope`](Self::slope) at the point `at` of the plane; `None` where it has none.
    pub fn plane_slope(&self, at: Point) -> Option<Square> {
        inverse(self.slope(at))
    }

    /// `dP/dtheta`: a vector for each of [`PARAMETERS`], at the point `at` of the plane.
    pub fn by_parameters(&self, at: Point) -> [Point; PARAMETERS.len()] {
        let seen = self.seen(at);
        let ([x, y], f, lens) = (seen.n, self.shape.focal_px, self.lens_slope(seen.n));
        let r2 = x * x + y * y;
        let radial = |power: f64| [f[0] * x * power, f[1] * y * power];
        let moved = product(lens, seen.slope);
        let through = |q: Point| times(lens, q);
        let (q, d, w) = (seen.q, seen.d, seen.w);
        [
            radial(r2),
            radial(r2 * r2),
            [f[0] * 2.0 * x * y, f[1] * (r2 + 2.0 * y * y)],
            [f[0] * (r2 + 2.0 * x * x), f[1] * 2.0 * x * y],
            radial(r2 * r2 * r2),
            [1.0 - moved[0][0], -moved[1][0]],
            [-moved[0][1], 1.0 - moved[1][1]],
            through([-q[0] * d[0] / w, -q[1] * d[0] / w]),
            through([-q[0] * d[1] / w, -q[1] * d[1] / w]),
            through([d[0] / w, -d[1] / w]),
            through([d[1] / w, d[0] / w]),
        ]
    }

    /// Change of the point of the plane that is seen at a raw pixel, for a change of the parameters:
    /// `dX/dtheta = -(dP/dX)^-1 dP/dtheta`. `at` is that point.
    pub fn plane_change(&self, at: Point, by: &Theta) -> Option<Point> {
        self.plane_changes(at, std::slice::from_ref(by))?.next()
    }

    /// The same for several changes, for which the derivatives are made once.
    pub fn plane_changes(&self, at: Point, by: &[Theta]) -> Option<impl Iterator<Item = Point>> {
        let slope = self.plane_slope(at)?;
        let list = self.by_parameters(at);
        let less = |sum: Point, (by, t): (&Point, &f64)| [sum[0] - by[0] * t, sum[1] - by[1] * t];
        let sum = move |by: &Theta| list.iter().zip(by).fold([0.0; 2], less);
        Some(by.iter().map(move |by| times(slope, sum(by))))
    }

    fn normalised(&self, px: Point) -> Point {
        [0, 1].map(|c| (px[c] - self.shape.theta[5 + c]) / self.shape.focal_px[c])
    }

    fn tilt(&self) -> Point {
        [self.shape.theta[7], self.shape.theta[8]]
    }

    fn stretch(&self) -> Square {
        let [a, b] = [self.shape.theta[9], self.shape.theta[10]];
        [[1.0 + a, b], [b, 1.0 - a]]
    }

    fn seen(&self, at: Point) -> Seen {
        let centre = [self.shape.theta[5], self.shape.theta[6]];
        let d = [at[0] - centre[0], at[1] - centre[1]];
        let (h, a) = (self.tilt(), self.stretch());
        let w = 1.0 + h[0] * d[0] + h[1] * d[1];
        let nearer = 1.0 / w;
        let ([x, y], f) = (times(a, d), self.shape.focal_px);
        let q = [x * nearer, y * nearer];
        let row = |[x, y]: Point, q: f64| [(x - q * h[0]) * nearer, (y - q * h[1]) * nearer];
        let slope = [row(a[0], q[0]), row(a[1], q[1])];
        Seen { centre, d, w, q, n: [q[0] / f[0], q[1] / f[1]], slope }
    }

    fn distorted(&self, n: Point) -> Point {
        brown(&self.shape.theta, n)
    }

    /// The derivative of the distortion.
    fn distortion_slope(&self, [x, y]: Point) -> Square {
        let [k1, k2, p1, p2, k3, ..] = self.shape.theta;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let by_r2 = k1 + r2 * (2.0 * k2 + 3.0 * k3 * r2);
        let mixed = 2.0 * x * y * by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        [
            [radial + 2.0 * x * x * by_r2 + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
            [mixed, radial + 2.0 * y * y * by_r2 + 6.0 * p1 * y + 2.0 * p2 * x],
        ]
    }

    /// The same in pixels.
    fn lens_slope(&self, n: Point) -> Square {
        let ([[xx, xy], [yx, yy]], f) = (self.distortion_slope(n), self.shape.focal_px);
        [[xx, f[0] / f[1] * xy], [f[1] / f[0] * yx, yy]]
    }

    /// Inverts the distortion: by Newton's method from the place itself where the distortion is mild, else along the ray.
    fn undistorted(&self, wanted: Point) -> Option<Point> {
        if self.shape.theta[..5].iter().all(|&k| k == 0.0) {
            return wanted.iter().all(|v| v.is_finite()).then_some(wanted);
        }
        self.newton(wanted, wanted, MILD).or_else(|| self.undistorted_along(wanted))
    }

    /// The same from the centre outwards, in steps along the ray: a fold between is never passed.
    fn undistorted_along(&self, wanted: Point) -> Option<Point> {
        const STEPS: usize = 4;
        (1..=STEPS).try_fold([0.0; 2], |before: Point, step| {
            let goal = wanted.map(|v| v * step as f64 / STEPS as f64);
            // A guess at the same distortion as before.
            let start = if step == 1 { goal } else { before.map(|v| v * step as f64 / (step - 1) as f64) };
            self.newton(goal, start, FOLD)
        })
    }

    /// Newton's method; `None` where the area shrinks below `least`, or it does not settle.
    fn newton(&self, goal: Point, start: Point, least: f64) -> Option<Point> {
        let mut n = start;
        for _ in 0..30 {
            let slope = self.distortion_slope(n);
            if determinant(slope) < least {
                return None;
            }
            let at = self.distorted(n);
            let [x, y] = times(inverse(slope)?, [goal[0] - at[0], goal[1] - at[1]]);
            n = [n[0] + x, n[1] + y];
            if x * x + y * y <= SETTLED * SETTLED * (1.0 + n[0] * n[0] + n[1] * n[1]) {
                return Some(n);
            }
        }
        None
    }
}

/// Brown's distortion of normalised coordinates, by the first five of the parameters.
pub(super) fn brown(theta: &[f64], [x, y]: Point) -> Point {
    let &[k1, k2, p1, p2, k3, ..] = theta else { return [x, y] };
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    [x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y]
}

/// A point of the plane on its way to the image.
struct Seen {
    centre: Point,
    /// Away from the centre, px.
    d: Point,
    /// `1 + h . d`.
    w: f64,
    /// Undistorted, away from the centre, px.
    q: Point,
    /// Normalised.
    n: Point,
    /// `dq/dX`.
    slope: Square,
}

pub(super) fn times([[a, b], [c, d]]: Square, [x, y]: Point) -> Point {
    [a * x + b * y, c * x + d * y]
}

/// Element by element: maps of maps are calls.
pub(super) fn product([[a, b], [c, d]]: Square, [[e, f], [g, h]]: Square) -> Square {
    [[a * e + b * g, a * f + b * h], [c * e + d * g, c * f + d * h]]
}

fn determinant(m: Square) -> f64 {
    m[0][0] * m[1][1] - m[0][1] * m[1][0]
}

pub(super) fn inverse(m: Square) -> Option<Square> {
    let by = 1.0 / determinant(m);
    let inverse = [[m[1][1] * by, -m[0][1] * by], [-m[1][0] * by, m[0][0] * by]];
    inverse.iter().flatten().sum::<f64>().is_finite().then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bent() -> Camera {
        let mut shape = CameraShape::plain([1024, 768]);
        shape.focal_px = [700.0, 720.0];
        shape.theta = [-0.05, 0.02, 1e-3, -2e-3, 0.004, 500.0, 390.0, 3e-5, -2e-5, -0.002, 0.001];
        Camera::new(shape).unwrap()
    }

    const PLACES: [Point; 4] = [[3.0, 5.0], [1010.0, 20.0], [512.0, 390.5], [700.0, 750.0]];

    #[test]
    fn the_inverse_leads_back_and_its_slopes_are_differences() {
        let camera = bent();
        for px in PLACES {
            let at = camera.plane(px).unwrap();
            let back = camera.pixel(at);
            // Positions near 1000: some roundings.
            assert!((back[0] - px[0]).hypot(back[1] - px[1]) < 1e-9, "{px:?} {back:?}");
            let (forth, h) = (camera.slope(at), 1e-3);
            for k in 0..2 {
                let by = |s: f64| {
                    let mut there = at;
                    there[k] += s * h;
                    camera.pixel(there)
                };
                let (a, b) = (by(1.0), by(-1.0));
                for c in 0..2 {
                    // Truncation h^2 times third derivatives (1e-6), round-off 1e-13/h.
                    assert!((forth[c][k] - (a[c] - b[c]) / (2.0 * h)).abs() < 1e-9);
                }
            }
            let one = product(camera.plane_slope(at).unwrap(), forth);
            assert!((one[0][0] - 1.0).abs() < 1e-12 && one[0][1].abs() < 1e-12);
        }
    }

    #[test]
    fn from_a_place_nearby_the_inverse_is_the_same() {
        let camera = bent();
        for px in PLACES {
            let at = camera.plane(px).unwrap();
            let slope = camera.plane_slope(at).unwrap();
            // A point, what moved by some px, and a start that leads nowhere.
            for near in [at, [at[0] + 12.0, at[1] - 9.0], [f64::NAN; 2], [1e9, 0.0]] {
                let (found, of) = camera.plane_near(px, near).unwrap();
                // Positions near 1000: some roundings. Slopes are those before the last step.
                assert!((found[0] - at[0]).hypot(found[1] - at[1]) < 1e-12 * 1e3, "{near:?} {found:?} {at:?}");
                assert!(of.iter().flatten().zip(slope.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-10));
            }
        }
    }

    #[test]
    fn a_change_of_the_parameters_moves_what_a_pixel_sees_as_differences_say() {
        let camera = bent();
        for (k, name) in PARAMETERS.into_iter().enumerate() {
            let h = if name.starts_with("centre") { 1e-2 } else { 1e-7 };
            let with = |by: f64| {
                let mut shape = camera.shape().clone();
                shape.theta[k] += by;
                Camera::new(shape).unwrap()
            };
            let (more, less) = (with(h), with(-h));
            let mut unit = [0.0; PARAMETERS.len()];
            unit[k] = 1.0;
            for px in PLACES {
                let at = camera.plane(px).unwrap();
                let change = camera.plane_change(at, &unit).unwrap();
                let (a, b) = (more.plane(px).unwrap(), less.plane(px).unwrap());
                for c in 0..2 {
                    let want = (a[c] - b[c]) / (2.0 * h);
                    // Round-off of positions near 1000 by the step.
                    let tolerance = 2e-12 * 1e3 / h * 1e-1 + 1e-6 * want.abs();
                    assert!((change[c] - want).abs() < tolerance, "{name} {px:?}: {} {want}", change[c]);
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_a_camera_is_refused() {
        let shape = CameraShape::plain([1024, 768]);
        let with = |k: usize, value: f64| {
            let mut shape = shape.clone();
            shape.theta[k] = value;
            Camera::new(shape)
        };
        assert!(matches!(with(0, -0.6), Err(CameraError::Folds { .. })));
        assert!(matches!(with(4, -0.5), Err(CameraError::Folds { .. })));
        assert!(matches!(with(1, f64::NAN), Err(CameraError::Number { what: "k2", .. })));
        assert!(matches!(with(7, 1.0), Err(CameraError::Folds { .. })));
        let covariance = |matrix: Vec<Vec<f64>>| {
            Camera::new(CameraShape { covariance: Covariance { of: vec![0, 1], matrix }, ..shape.clone() })
        };
        assert!(matches!(covariance(vec![vec![1.0, 0.0]]), Err(CameraError::CovarianceSize { .. })));
        assert!(matches!(covariance(vec![vec![1.0, 2.0], vec![2.0, 1.0]]), Err(CameraError::Covariance(_))));
        assert!(matches!(covariance(vec![vec![1.0, 0.5], vec![0.2, 1.0]]), Err(CameraError::Covariance(_))));
        let camera = Camera::new(shape.clone()).unwrap();
        assert!(matches!(camera.check_images([768, 1024]), Err(CameraError::ImageSize { .. })));
        assert!(camera.is_plain() && camera.is_exact() && !Camera::usual([64, 64]).unwrap().is_exact());
    }
}
