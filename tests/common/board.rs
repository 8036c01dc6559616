//! Flat targets before a pinhole camera with a lens, drawn ray by ray; owes nothing to the program.

use super::spots::numbers;
use quadrille::imaging::{Image, Pixels};
use std::sync::Arc;

/// What is printed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Print {
    /// Squares.
    Chessboard,
    /// Dots with this radius, mm.
    Dots(f64),
}

/// A target with `n` columns and rows of points, the first of them at zero, on a white board with a margin.
#[derive(Debug, Clone, Copy)]
pub struct Board {
    pub print: Print,
    pub n: [usize; 2],
    pub pitch_mm: f64,
}

/// A camera: focal length and centre in px, the distortion of the first order for the focal length.
#[derive(Debug, Clone, Copy)]
pub struct Pinhole {
    pub size: [usize; 2],
    pub focal: f64,
    pub centre: [f64; 2],
    pub k1: f64,
}

/// How the middle of a board stands: turned by degrees about x, then y, then z, at a place in mm.
#[derive(Debug, Clone, Copy)]
pub struct Pose {
    pub degrees: [f64; 3],
    pub at: [f64; 3],
}

impl Board {
    fn middle(&self) -> [f64; 2] {
        self.n.map(|n| 0.5 * self.pitch_mm * (n as f64 - 1.0))
    }

    /// Grey level at a place, mm.
    fn grey(&self, at: [f64; 2]) -> f64 {
        let [x, y] = at.map(|v| v / self.pitch_mm);
        let [columns, rows] = self.n.map(|n| n as f64);
        let dark = match self.print {
            Print::Chessboard => {
                let is_on = (-1.0..columns).contains(&x) && (-1.0..rows).contains(&y);
                is_on && (x.floor() as i64 + y.floor() as i64).rem_euclid(2) == 0
            }
            Print::Dots(radius) => {
                let (i, j) = (x.round().clamp(0.0, columns - 1.0), y.round().clamp(0.0, rows - 1.0));
                (x - i).hypot(y - j) < radius / self.pitch_mm
            }
        };
        let is_board = (-2.0..columns + 1.0).contains(&x) && (-2.0..rows + 1.0).contains(&y);
        match (is_board, dark) {
            (false, _) => 90.0,
            (true, true) => 40.0,
            (true, false) => 200.0,
        }
    }

    /// Where its points are seen, px, row by row.
    pub fn points(&self, camera: &Pinhole, pose: &Pose) -> Vec<[f64; 2]> {
        let middle = self.middle();
        let [a, b, _] = pose.axes();
        let point = |k: usize| {
            let (column, row) = (k % self.n[0], k / self.n[0]);
            let (x, y) = (self.pitch_mm * column as f64 - middle[0], self.pitch_mm * row as f64 - middle[1]);
            let p = [0, 1, 2].map(|c| pose.at[c] + x * a[c] + y * b[c]);
            let (u, v) = (p[0] / p[2], p[1] / p[2]);
            let grown = camera.focal * (1.0 + camera.k1 * (u * u + v * v));
            [camera.centre[0] + grown * u, camera.centre[1] + grown * v]
        };
        (0..self.n[0] * self.n[1]).map(point).collect()
    }

    /// The image without noise.
    pub fn drawn(&self, camera: &Pinhole, pose: &Pose) -> Vec<f64> {
        let [width, height] = camera.size;
        let [a, b, normal] = pose.axes();
        let dot = |p: [f64; 3], q: [f64; 3]| p.iter().zip(q).map(|(p, q)| p * q).sum::<f64>();
        let middle = self.middle();
        let grey = |x: f64, y: f64| {
            let (dx, dy) = ((x - camera.centre[0]) / camera.focal, (y - camera.centre[1]) / camera.focal);
            let (mut u, mut v) = (dx, dy);
            for _ in 0..6 {
                let grown = 1.0 + camera.k1 * (u * u + v * v);
                (u, v) = (dx / grown, dy / grown);
            }
            let ray = [u, v, 1.0];
            let far = dot(pose.at, normal) / dot(ray, normal);
            let off = [0, 1, 2].map(|c| far * ray[c] - pose.at[c]);
            self.grey([middle[0] + dot(off, a), middle[1] + dot(off, b)])
        };
        // Where the corners of a pixel are alike so is what is between: what is printed is larger.
        let at_corners: Vec<f64> = (0..(width + 1) * (height + 1))
            .map(|k| grey((k % (width + 1)) as f64 - 0.5, (k / (width + 1)) as f64 - 0.5))
            .collect();
        let pixel = |k: usize| {
            let (x, y) = (k % width, k / width);
            let corner = |i: usize, j: usize| at_corners[(y + j) * (width + 1) + x + i];
            let first = corner(0, 0);
            if [corner(1, 0), corner(0, 1), corner(1, 1)].iter().all(|v| *v == first) {
                return first;
            }
            // Points of a lattice that no edge runs along, so that edges along the pixels are not seen in steps.
            const FINE: usize = 144;
            let inside = |k: usize| [k, k * 89 % FINE].map(|k| (k as f64 + 0.5) / FINE as f64 - 0.5);
            let point = |k: usize| grey(x as f64 + inside(k)[0], y as f64 + inside(k)[1]);
            (0..FINE).map(point).sum::<f64>() / FINE as f64
        };
        let sharp: Vec<f64> = (0..width * height).map(pixel).collect();
        // A lens that is not sharper than its pixels.
        let blurred = |grey: &[f64], step: usize, n: usize, k: usize| {
            let at = k / step % n;
            let before = if at > 0 { grey[k - step] } else { grey[k] };
            let behind = if at + 1 < n { grey[k + step] } else { grey[k] };
            0.25 * before + 0.5 * grey[k] + 0.25 * behind
        };
        let rows: Vec<f64> = (0..sharp.len()).map(|k| blurred(&sharp, 1, width, k)).collect();
        (0..rows.len()).map(|k| blurred(&rows, width, height, k)).collect()
    }
}

impl Pose {
    /// The axes of the board, and what stands on it.
    fn axes(&self) -> [[f64; 3]; 3] {
        let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (axis, degrees) in self.degrees.into_iter().enumerate() {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            for v in &mut axes {
                (v[i], v[j]) = (cos * v[i] - sin * v[j], sin * v[i] + cos * v[j]);
            }
        }
        axes
    }
}

/// 8 bit, with noise of `noise` grey levels.
pub fn photographed(grey: &[f64], [width, height]: [usize; 2], noise: f64, seed: u64) -> Arc<Image> {
    let mut number = numbers(seed);
    let mut normal = || (0..12).map(|_| number()).sum::<f64>() - 6.0;
    let pixels = grey.iter().map(|g| (g + noise * normal()).round().clamp(0.0, 255.0) as u8).collect();
    Arc::new(Image::new(width, height, Pixels::U8(pixels)).unwrap())
}
