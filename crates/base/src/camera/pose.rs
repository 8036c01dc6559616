//! Where a flat target stands before the camera, and where its points are seen (THEORY 22).

use super::model::{brown, inverse, times};
use super::{PARAMETERS, Theta};
use crate::plane::Point;

/// Numbers of what all images share: k1, k2, p1, p2, k3 for lengths in half diagonals, the centre (px), half a diagonal
/// by the focal length, and the height of a pixel by its width.
pub(super) const COMMON: usize = 9;
/// Its parts: the centre along x, half a diagonal by the focal length, height by width.
pub(super) const CENTRE: usize = 5;
pub(super) const NEARNESS: usize = 7;
pub(super) const ASPECT: usize = 8;

/// How a pose is described.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stand {
    /// By all that a plane can be seen as: perspective along x and y by half diagonals, stretch, shear, and a
    /// similarity from mm, `[u, -v; v, u] X + t`.
    Free,
    /// By a turn (rotation vector), the logarithm of the scale in px per mm, and the place of the origin, px: with one
    /// focal length for all images.
    Rigid,
}

impl Stand {
    /// Numbers of a pose.
    pub fn n(self) -> usize {
        match self {
            Self::Free => 8,
            Self::Rigid => 6,
        }
    }

    /// Steps of these numbers that move points by some hundredths of a pixel.
    pub fn steps(self, half: f64, scale: f64) -> Vec<f64> {
        match self {
            Self::Free => vec![1e-5, 1e-5, 1e-5, 1e-5, 1e-5 * scale, 1e-5 * scale, 1e-5 * half, 1e-5 * half],
            Self::Rigid => vec![1e-5, 1e-5, 1e-5, 1e-5, 1e-5 * half, 1e-5 * half],
        }
    }
}

/// From mm to pixels about the centre before distortion: `q = (N X + n) / (1 + d . X)`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Homography {
    /// `N`, px/mm.
    slope: [[f64; 2]; 2],
    /// `n`, px.
    shift: Point,
    /// `d`, 1/mm.
    fall: Point,
}

impl Homography {
    /// Of a pose in images of this half diagonal.
    pub fn new(stand: Stand, common: &[f64], pose: &[f64], half: f64) -> Option<Self> {
        match (stand, pose) {
            (Stand::Free, &[hx, hy, a, b, u, v, x, y]) => {
                let (h, a) = ([hx / half, hy / half], [[1.0 + a, b], [b, 1.0 - a]]);
                let (mm, t) = ([[u, -v], [v, u]], [x, y]);
                let least = 1.0 + h[0] * t[0] + h[1] * t[1];
                let product = super::model::product(a, mm);
                Some(Self {
                    slope: product.map(|row| row.map(|v| v / least)),
                    shift: times(a, t).map(|v| v / least),
                    fall: [(h[0] * u + h[1] * v) / least, (h[1] * u - h[0] * v) / least],
                })
            }
            (Stand::Rigid, &[a, b, c, log_scale, x, y]) => {
                let r = rotation([a, b, c]);
                let scale = log_scale.exp();
                let near = common.get(NEARNESS)? / half * scale;
                Some(Self {
                    slope: [[r[0][0], r[0][1]], [r[1][0], r[1][1]]].map(|row| row.map(|v| scale * v)),
                    shift: [x, y],
                    fall: [near * r[2][0], near * r[2][1]],
                })
            }
            _ => None,
        }
    }

    /// Where a point is seen, px.
    pub fn pixel(&self, common: &[f64], at: Point, half: f64) -> Option<Point> {
        let w = 1.0 + self.fall[0] * at[0] + self.fall[1] * at[1];
        let q = times(self.slope, at);
        let n = [0, 1].map(|c| (q[c] + self.shift[c]) / (w * half));
        let [x, y] = brown(common, n);
        // Behind the camera nothing is seen.
        let seen = [common[CENTRE] + half * x, common[CENTRE + 1] + half * common[ASPECT] * y];
        (w > 0.1 && seen.iter().all(|v| v.is_finite())).then_some(seen)
    }

    /// Where the middle of what is seen of a disc lies, px: of its four points where the mean of any field of the third
    /// degree is taken, each weighed by how large its surroundings are seen.
    pub fn disc(&self, common: &[f64], at: Point, radius: f64, half: f64) -> Option<Point> {
        if radius <= 0.0 {
            return self.pixel(common, at, half);
        }
        let away = radius / 2f64.sqrt();
        let (mut sum, mut weights) = ([0.0; 2], 0.0);
        for [dx, dy] in [[away, 0.0], [-away, 0.0], [0.0, away], [0.0, -away]] {
            let there = [at[0] + dx, at[1] + dy];
            let seen = self.pixel(common, there, half)?;
            let h = 1e-3 * radius;
            let beside = |step: Point| self.pixel(common, [there[0] + step[0], there[1] + step[1]], half);
            let (right, up) = (beside([h, 0.0])?, beside([0.0, h])?);
            let area = (right[0] - seen[0]) * (up[1] - seen[1]) - (right[1] - seen[1]) * (up[0] - seen[0]);
            weights += area;
            (0..2).for_each(|c| sum[c] += area * seen[c]);
        }
        (weights != 0.0).then(|| sum.map(|v| v / weights))
    }

    /// The parameters of a camera that sees the plane so, with coefficients by half diagonals, and the size of a pixel
    /// at its centre, mm.
    pub fn camera(&self, common: &[f64], half: f64) -> Option<(Theta, f64)> {
        let back = inverse(self.slope)?;
        let at = times(back, self.shift).map(|v| -v);
        let w = 1.0 + self.fall[0] * at[0] + self.fall[1] * at[1];
        // dq/dX at the point that is seen at the centre; it is A S, A symmetric with the trace 2, S a similarity.
        let aspect = common[ASPECT];
        let j = [0, 1].map(|r| [0, 1].map(|c| self.slope[r][c] / w * if r == 1 { aspect } else { 1.0 }));
        let (u, v) = (0.5 * (j[0][0] + j[1][1]), 0.5 * (j[1][0] - j[0][1]));
        let (m, n) = (0.5 * (j[0][0] - j[1][1]), 0.5 * (j[0][1] + j[1][0]));
        let square = u * u + v * v;
        let h = self.fall.map(|v| v / w);
        let mut theta = [0.0; PARAMETERS.len()];
        theta[..NEARNESS].copy_from_slice(common.get(..NEARNESS)?);
        theta[7..].copy_from_slice(&[
            (h[0] * u - h[1] * v) / square,
            (h[0] * v + h[1] * u) / square,
            (u * m - v * n) / square,
            (v * m + u * n) / square,
        ]);
        let size = 1.0 / square.sqrt();
        (w > 0.1 && half > 0.0 && size.is_finite() && theta.iter().all(|v| v.is_finite())).then_some((theta, size))
    }

    /// Sums over what two turned axes say of the square of nearness, `1/f^2 = v/u`: `[u, v]`, of lengths in px.
    pub fn focal_sums(&self) -> [f64; 2] {
        let [[a1, b1], [a2, b2]] = self.slope;
        let [a3, b3] = self.fall;
        let square = a1 * a1 + a2 * a2 + b1 * b1 + b2 * b2;
        let (u, v) = ([a1 * b1 + a2 * b2, a1 * a1 + a2 * a2 - b1 * b1 - b2 * b2], [a3 * b3, a3 * a3 - b3 * b3]);
        let by = |a: [f64; 2], b: [f64; 2]| (a[0] * b[0] + 0.25 * a[1] * b[1]) / (square * square);
        [by(u, u), -by(u, v)]
    }

    /// The rigid pose that comes nearest to it, with nearness `near` (1/px).
    pub fn rigid(&self, near: f64) -> Option<Vec<f64>> {
        let column = |c: usize| [near * self.slope[0][c], near * self.slope[1][c], self.fall[c]];
        let (a, b) = (column(0), column(1));
        let length = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let size = (length(a) * length(b)).sqrt();
        let first = a.map(|v| v / length(a));
        let along: f64 = first.iter().zip(b).map(|(a, b)| a * b).sum();
        let rest = [0, 1, 2].map(|c| b[c] - along * first[c]);
        let second = rest.map(|v| v / length(rest));
        let turn = rotation_vector(first, second)?;
        let scale = size / near;
        (scale.is_finite() && scale > 0.0)
            .then(|| vec![turn[0], turn[1], turn[2], scale.ln(), self.shift[0], self.shift[1]])
    }

    /// How far the target is turned away from the camera, by how much shorter one direction is seen than the one
    /// across, degrees.
    pub fn tilt_degrees(&self, common: &[f64], half: f64) -> f64 {
        let shape = self.camera(common, half).map_or(1.0, |(theta, _)| theta[9].hypot(theta[10]));
        ((1.0 - shape) / (1.0 + shape)).clamp(0.0, 1.0).acos().to_degrees()
    }
}

/// The rotation of a rotation vector.
fn rotation([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    let angle = (x * x + y * y + z * z).sqrt();
    // sin(a)/a and (1 - cos a)/a^2, by their series near zero.
    let (s, c) = match angle < 1e-4 {
        true => (1.0 - angle * angle / 6.0, 0.5 - angle * angle / 24.0),
        false => (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle)),
    };
    let cos = angle.cos();
    [
        [cos + c * x * x, c * x * y - s * z, c * x * z + s * y],
        [c * x * y + s * z, cos + c * y * y, c * y * z - s * x],
        [c * x * z - s * y, c * y * z + s * x, cos + c * z * z],
    ]
}

/// The rotation vector of the rotation whose first two columns are these.
fn rotation_vector(a: [f64; 3], b: [f64; 3]) -> Option<[f64; 3]> {
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let axis = [b[2] - c[1], c[0] - a[2], a[1] - b[0]];
    let twice_sin = axis.iter().map(|v| v * v).sum::<f64>().sqrt();
    let angle = twice_sin.atan2(a[0] + b[1] + c[2] - 1.0);
    let by = if twice_sin < 1e-9 { 0.5 } else { angle / twice_sin };
    // Half a turn, which targets are not numbered by, has no axis of this kind.
    let vector = axis.map(|v| by * v);
    vector.iter().all(|v| v.is_finite()).then_some(vector)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, CameraShape};

    const HALF: f64 = 640.0;
    const COMMONS: [f64; COMMON] = [-0.01, 0.004, 1e-3, -5e-4, 2e-3, 505.0, 380.0, 0.4, 1.003];

    #[test]
    fn the_camera_of_a_pose_sees_what_the_pose_sees() {
        let poses = [
            (Stand::Rigid, vec![0.2, -0.3, 0.5, 3f64.ln(), 40.0, -20.0]),
            (Stand::Free, vec![0.03, -0.05, 0.02, -0.01, 2.7, 0.8, 11.0, 7.0]),
        ];
        for (stand, pose) in poses {
            let homography = Homography::new(stand, &COMMONS, &pose, HALF).unwrap();
            let (theta, size) = homography.camera(&COMMONS, HALF).unwrap();
            let shape =
                CameraShape { theta, focal_px: [HALF, COMMONS[ASPECT] * HALF], ..CameraShape::plain([1024, 768]) };
            let camera = Camera::new(shape).unwrap();
            let mm = [[0.0, 0.0], [40.0, 0.0], [0.0, 30.0], [-50.0, 35.0]];
            let at = mm.map(|at| camera.plane(homography.pixel(&COMMONS, at, HALF).unwrap()).unwrap());
            for (a, mm_a) in at.iter().zip(mm) {
                for (b, mm_b) in at.iter().zip(mm) {
                    let (px, mm) = (crate::plane::distance(*a, *b), crate::plane::distance(mm_a, mm_b));
                    // Newton of the inverse ends at 1e-9 of half a diagonal.
                    assert!((px * size - mm).abs() < 1e-7, "{stand:?}: {} {mm}", px * size);
                }
            }
        }
    }

    #[test]
    fn a_rigid_pose_comes_back_from_what_it_is_seen_as() {
        let pose = vec![0.2, -0.3, 0.5, 3f64.ln(), 40.0, -20.0];
        let homography = Homography::new(Stand::Rigid, &COMMONS, &pose, HALF).unwrap();
        let [u, v] = homography.focal_sums();
        assert!(((v / u).sqrt() * HALF - 0.4).abs() < 1e-9);
        for (found, wanted) in homography.rigid(0.4 / HALF).unwrap().iter().zip(&pose) {
            assert!((found - wanted).abs() < 1e-9, "{found} {wanted}");
        }
    }

    #[test]
    fn the_middle_of_a_disc_is_the_mean_over_what_is_seen_of_it() {
        let homography = Homography::new(Stand::Rigid, &COMMONS, &[0.5, 0.4, 0.0, 3f64.ln(), 0.0, 0.0], HALF).unwrap();
        let (at, radius) = ([20.0, -10.0], 8.0);
        // The mean over the area that is seen, by Green's theorem on its border.
        let n = 4000;
        let border: Vec<Point> = (0..n)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
                homography.pixel(&COMMONS, [at[0] + radius * cos, at[1] + radius * sin], HALF).unwrap()
            })
            .collect();
        let (mut area, mut sum) = (0.0, [0.0; 2]);
        for (a, b) in border.iter().zip(border.iter().cycle().skip(1)) {
            let cross = a[0] * b[1] - a[1] * b[0];
            area += cross / 2.0;
            (0..2).for_each(|c| sum[c] += (a[c] + b[c]) * cross / 6.0);
        }
        let found = homography.disc(&COMMONS, at, radius, HALF).unwrap();
        let middle = homography.pixel(&COMMONS, at, HALF).unwrap();
        let off = |p: Point| (p[0] - sum[0] / area).hypot(p[1] - sum[1] / area);
        // The radius is 24 px here: of the fourth degree little is left.
        assert!(off(found) < 0.02 * off(middle) && off(middle) > 0.1, "{} {}", off(found), off(middle));
    }
}
