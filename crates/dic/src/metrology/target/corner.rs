//! Corners of a chessboard: saddles of the grey level, sharpened by a model of two edges that cross.

use super::grid::{Found, largest, shorter};
use super::plain::Plain;
use crate::linalg::Dense;
use crate::plane::Point;

/// Blur before saddles are looked for, px.
const BLUR: f32 = 1.5;
/// Blur in which corners are sharpened, px.
const SOFT: f32 = 1.0;
/// A saddle counts from this share of the one that would be the last of the board.
const SHARE: f32 = 0.15;
/// Saddles that are looked at.
const MOST: usize = 20_000;
/// Radius of the ring about a corner, px, and its points.
const RING: f64 = 5.0;
const AROUND: usize = 32;
/// How alike opposite sides of the ring are, and how unlike sides a quarter of a turn apart.
const OPPOSITE: f32 = 0.6;
const QUARTER: f32 = -0.2;
/// Half the window in which edges are fitted, by the shorter step, and its least and largest size, px.
const WINDOW: f64 = 0.45;
const LEAST: f64 = 3.0;
const LARGEST: f64 = 16.0;
/// Numbers of the model: the place, two angles, the width of the edges, their height, and a plane of grey.
const MODEL: usize = 9;
/// Share of the grey levels of a window that two edges must explain.
const EXPLAINED: f64 = 0.5;

/// The largest chessboard of an image, with corners at whole pixels.
pub(super) fn find(image: &Plain, wanted: [usize; 2]) -> Option<Found> {
    if image.width.min(image.height) < 16 {
        return None;
    }
    let blurred = image.blurred(BLUR);
    let saddles = saddles(&blurred, wanted[0] * wanted[1]);
    let (points, rings): (Vec<Point>, Vec<[f32; AROUND]>) =
        saddles.into_iter().filter_map(|at| Some((at, ring(&blurred, at)?))).unzip();
    // A neighbour has light and dark exchanged.
    let fits = |a: usize, b: usize| rings[a].iter().zip(&rings[b]).map(|(a, b)| a * b).sum::<f32>() < 0.0;
    largest(&points, fits, wanted)
}

/// How much of a saddle the grey level is at a pixel: `Ixy^2 - Ixx Iyy`.
fn saddle(image: &Plain, x: usize, y: usize) -> f32 {
    let [xx, xy, yy] = curvature(image, x, y);
    xy * xy - xx * yy
}

fn curvature(image: &Plain, x: usize, y: usize) -> [f32; 3] {
    let at = |dx: usize, dy: usize| image.at(x + dx - 1, y + dy - 1);
    let xx = at(2, 1) - 2.0 * at(1, 1) + at(0, 1);
    let yy = at(1, 2) - 2.0 * at(1, 1) + at(1, 0);
    [xx, 0.25 * (at(2, 2) - at(2, 0) - at(0, 2) + at(0, 0)), yy]
}

/// The places where it is largest among its surroundings, the largest first.
fn saddles(image: &Plain, n_wanted: usize) -> Vec<Point> {
    let (width, height) = (image.width, image.height);
    let inside = |x: usize, y: usize| x > 0 && y > 0 && x + 1 < width && y + 1 < height;
    let value = |k: usize| if inside(k % width, k / width) { saddle(image, k % width, k / width) } else { 0.0 };
    let map: Vec<f32> = (0..width * height).map(value).collect();
    let mut list: Vec<(f32, usize)> = Vec::new();
    for y in 3..height.saturating_sub(3) {
        for x in 3..width - 3 {
            let (at, own) = (y * width + x, map[y * width + x]);
            let around = || (y - 2..=y + 2).flat_map(|row| (x - 2..=x + 2).map(move |column| row * width + column));
            if own > 0.0 && around().all(|k| map[k] < own || (map[k] == own && k >= at)) {
                list.push((own, at));
            }
        }
    }
    list.sort_by(|a, b| b.0.total_cmp(&a.0));
    let least = list.get(n_wanted.saturating_sub(1)).map_or(0.0, |(value, _)| SHARE * value);
    let taken = list.into_iter().take(MOST).filter(|(value, _)| *value >= least);
    taken.map(|(_, at)| [(at % width) as f64, (at / width) as f64]).collect()
}

/// Grey levels around a place, less their mean, of the length one, where they are those of a corner: two light and two
/// dark sectors.
fn ring(image: &Plain, [x, y]: Point) -> Option<[f32; AROUND]> {
    let mut ring = [0.0; AROUND];
    for (k, v) in ring.iter_mut().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / AROUND as f64).sin_cos();
        *v = image.between([x + RING * cos, y + RING * sin])?;
    }
    let mean = ring.iter().sum::<f32>() / AROUND as f32;
    ring.iter_mut().for_each(|v| *v -= mean);
    let length = ring.iter().map(|v| v * v).sum::<f32>().sqrt();
    if length <= 0.0 {
        return None;
    }
    ring.iter_mut().for_each(|v| *v /= length);
    let turned = |by: usize| (0..AROUND).map(|k| ring[k] * ring[(k + by) % AROUND]).sum::<f32>();
    (turned(AROUND / 2) > OPPOSITE && turned(AROUND / 4) < QUARTER).then_some(ring)
}

/// The image in which corners are sharpened: edges that were sampled more coarsely than they are sharp are shifted.
pub(super) fn softened(image: &Plain) -> Plain {
    image.blurred(SOFT)
}

/// The corner near a place where neighbours are `steps` away, in what [`softened`] gives; `None` where there is none.
pub(super) fn refined(image: &Plain, near: Point, steps: [Point; 2]) -> Option<Point> {
    let reach = (WINDOW * shorter(steps)).min(LARGEST);
    if reach < LEAST {
        return None;
    }
    let mut at = near;
    // The window follows the corner.
    for _ in 0..2 {
        // Weights fall to zero: which pixels are just inside is of no account.
        let pixel = |(x, y)| {
            let (dx, dy): (f64, f64) = (x as f64 - at[0], y as f64 - at[1]);
            let rest = 1.0 - (dx * dx + dy * dy) / (reach * reach);
            (rest > 0.0).then(|| Pixel { at: [dx, dy], grey: f64::from(image.at(x, y)), weight: rest * rest })
        };
        let pixels: Vec<Pixel> = image.window(at, reach).filter_map(pixel).collect();
        let start = start(&pixels, steps)?;
        let [dx, dy, ..] = fitted(&pixels, start)?;
        if dx.hypot(dy) > reach {
            return None;
        }
        at = [at[0] + dx, at[1] + dy];
    }
    Some(at)
}

/// A pixel of a window.
struct Pixel {
    /// Away from its middle.
    at: Point,
    grey: f64,
    weight: f64,
}

/// Mean grey level of a window.
fn mean_grey(pixels: &[Pixel]) -> f64 {
    pixels.iter().map(|p| p.weight * p.grey).sum::<f64>() / pixels.iter().map(|p| p.weight).sum::<f64>()
}

/// Edges along the steps of the grid: at a corner squares meet along them.
fn start(pixels: &[Pixel], steps: [Point; 2]) -> Option<[f64; MODEL]> {
    let normal = |[x, y]: Point| x.atan2(-y);
    let mean = mean_grey(pixels);
    let mut model = [0.0, 0.0, normal(steps[0]), normal(steps[1]), 1.0, 0.0, mean, 0.0, 0.0];
    // The height that explains most.
    let (mut along, mut square) = (0.0, 0.0);
    for p in pixels {
        let [.., product] = edges(&model, p.at);
        along += p.weight * product * (p.grey - mean);
        square += p.weight * product * product;
    }
    model[5] = along / square;
    model[5].is_finite().then_some(model)
}

/// Distances from the two edges, how far through each a point is, and the product of these.
fn edges(model: &[f64; MODEL], p: Point) -> [f64; 5] {
    let (dx, dy) = (p[0] - model[0], p[1] - model[1]);
    let far = |angle: f64| angle.cos() * dx + angle.sin() * dy;
    let (a, b) = (far(model[2]), far(model[3]));
    let (ta, tb) = (error_function(a / model[4]), error_function(b / model[4]));
    [a, b, ta, tb, ta * tb]
}

/// `erf`, within 2e-7 (Abramowitz and Stegun, 7.1.26).
fn error_function(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let sum = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    (1.0 - sum * (-x * x).exp()).copysign(x)
}

/// Levenberg-Marquardt on the model of two edges; `None` where it does not describe the pixels.
fn fitted(pixels: &[Pixel], mut model: [f64; MODEL]) -> Option<[f64; MODEL]> {
    let left = |model: &[f64; MODEL], p: &Pixel| {
        p.grey - (model[6] + model[7] * p.at[0] + model[8] * p.at[1] + model[5] * edges(model, p.at)[4])
    };
    let squares = |model: &[f64; MODEL]| pixels.iter().map(|p| p.weight * left(model, p).powi(2)).sum::<f64>();
    let (mut before, mut damping) = (squares(&model), 1e-3);
    for _ in 0..40 {
        let (mut normal, mut pull) = ([[0.0; MODEL]; MODEL], [0.0; MODEL]);
        for p in pixels {
            let (slope, left) = (slope(&model, p.at), left(&model, p));
            for (i, a) in slope.iter().enumerate() {
                slope.iter().enumerate().for_each(|(j, b)| normal[i][j] += p.weight * a * b);
                pull[i] += p.weight * a * left;
            }
        }
        let damped = Dense::from_fn(MODEL, MODEL, |i, j| normal[i][j] * if i == j { 1.0 + damping } else { 1.0 });
        let step = damped.cholesky().ok()?.solve(&Dense::from_fn(MODEL, 1, |i, _| pull[i]));
        let mut then = model;
        then.iter_mut().enumerate().for_each(|(k, v)| *v += step[(k, 0)]);
        // Sharper than a pixel shows nothing more.
        then[4] = then[4].clamp(0.2, 20.0);
        let after = squares(&then);
        if after <= before {
            let moved = step[(0, 0)].hypot(step[(1, 0)]);
            (model, before, damping) = (then, after, 0.1 * damping);
            if moved < 1e-5 {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    let mean = mean_grey(pixels);
    let whole: f64 = pixels.iter().map(|p| p.weight * (p.grey - mean).powi(2)).sum();
    (before < (1.0 - EXPLAINED) * whole && model.iter().all(|v| v.is_finite())).then_some(model)
}

/// Derivatives of the grey level by the numbers of the model.
fn slope(model: &[f64; MODEL], p: Point) -> [f64; MODEL] {
    let (dx, dy) = (p[0] - model[0], p[1] - model[1]);
    let [a, b, ta, tb, product] = edges(model, p);
    let (width, height) = (model[4], model[5]);
    let bell = |far: f64| 2.0 / std::f64::consts::PI.sqrt() * (-(far / width).powi(2)).exp();
    let (by_a, by_b) = (height * bell(a) * tb / width, height * bell(b) * ta / width);
    let ((sin_a, cos_a), (sin_b, cos_b)) = (model[2].sin_cos(), model[3].sin_cos());
    [
        -by_a * cos_a - by_b * cos_b,
        -by_a * sin_a - by_b * sin_b,
        by_a * (cos_a * dy - sin_a * dx),
        by_b * (cos_b * dy - sin_b * dx),
        -(by_a * a + by_b * b) / width,
        product,
        1.0,
        p[0],
        p[1],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_of_the_edges_are_differences() {
        let model = [0.3, -0.2, 0.4, 1.8, 1.3, 60.0, 120.0, 0.5, -0.3];
        let p = [1.1, 0.7];
        let grey = |m: &[f64; MODEL]| m[6] + m[7] * p[0] + m[8] * p[1] + m[5] * edges(m, p)[4];
        for (k, of) in slope(&model, p).into_iter().enumerate() {
            let by = |h: f64| {
                let mut moved = model;
                moved[k] += h;
                grey(&moved)
            };
            // The error function is an approximation with slopes that are off by some 1e-6, times 60 grey levels.
            assert!((of - (by(1e-3) - by(-1e-3)) / 2e-3).abs() < 2e-3, "{k}: {of}");
        }
    }
}
