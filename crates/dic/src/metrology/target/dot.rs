//! Round dots: spots that stand out from their surroundings, and the middle of what is dark, or light, of them.

use super::grid::{Found, largest, shorter};
use super::plain::Plain;
use crate::linalg::Dense;
use crate::plane::Point;

/// By how much a pixel differs from its surroundings, by the range of grey levels.
const CONTRAST: f32 = 0.15;
/// Fewest pixels of a dot.
const LEAST: usize = 12;
/// How far the area of a spot may be from that of an ellipse with its moments.
const ROUND: f64 = 0.15;
/// Longest axis of the ellipse by the shortest.
const LONGEST: f64 = 3.0;
/// How far around a dot its edge is blurred, by what is free between neighbours, and most of it, px.
const EDGE: f64 = 0.3;
const LARGEST_EDGE: f64 = 4.0;

/// A spot.
struct Spot {
    at: Point,
    n: usize,
}

/// The largest grid of dots, dark or light, with places at some tenths of a pixel.
pub(super) fn find(image: &Plain, wanted: [usize; 2]) -> Option<Found> {
    let found = [-1.0, 1.0].into_iter().filter_map(|sign| {
        let spots = spots(image, sign, wanted);
        let alike = |a: usize, b: usize| {
            let (a, b) = (spots[a].n as f64, spots[b].n as f64);
            a.max(b) < 2.5 * a.min(b)
        };
        let points: Vec<Point> = spots.iter().map(|spot| spot.at).collect();
        largest(&points, alike, wanted)
    });
    found.max_by_key(|found| (found.is_whole(wanted), found.n_points()))
}

/// Round spots that are darker (-1) or lighter than their surroundings, the largest first.
fn spots(image: &Plain, sign: f32, wanted: [usize; 2]) -> Vec<Spot> {
    let (width, height) = (image.width, image.height);
    let (long, short) = (wanted[0].max(wanted[1]), wanted[0].min(wanted[1]));
    // The largest distance of dots with which all of them are in the image.
    let pitch = (width.max(height) / long).min(width.min(height) / short).max(8);
    let means = local_means(image, pitch);
    let mut sorted = image.grey.clone();
    sorted.sort_unstable_by(f32::total_cmp);
    let of_rank = |share: f64| sorted.get((share * (sorted.len().max(1) - 1) as f64) as usize).copied().unwrap_or(0.0);
    let least = CONTRAST * (of_rank(0.98) - of_rank(0.02));
    let mut is_in: Vec<bool> = image.grey.iter().zip(&means).map(|(v, mean)| sign * (v - mean) > least).collect();
    let mut list = Vec::new();
    for start in 0..is_in.len() {
        if !std::mem::replace(&mut is_in[start], false) {
            continue;
        }
        let mut pixels = vec![start];
        let mut next = 0;
        while let Some(&at) = pixels.get(next) {
            next += 1;
            let (x, y) = (at % width, at / width);
            let beside =
                [(x > 0, 1, false), (x + 1 < width, 1, true), (y > 0, width, false), (y + 1 < height, width, true)];
            for (is_there, far, forth) in beside {
                let there = if forth { at + far } else { at.wrapping_sub(far) };
                if is_there && std::mem::replace(&mut is_in[there], false) {
                    pixels.push(there);
                }
            }
        }
        list.extend(round(&pixels, width, height).filter(|spot| spot.n < pitch * pitch));
    }
    list.sort_by_key(|spot| std::cmp::Reverse(spot.n));
    list
}

/// Means over squares of `2 reach + 1` pixels, cut at the border.
fn local_means(image: &Plain, reach: usize) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let mut sums = vec![0.0f64; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(image.at(x, y));
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
    }
    let mean = |k: usize| {
        let (x, y) = (k % width, k / width);
        let (x0, y0) = (x.saturating_sub(reach), y.saturating_sub(reach));
        let (x1, y1) = ((x + reach + 1).min(width), (y + reach + 1).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        ((at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0)) / ((x1 - x0) * (y1 - y0)) as f64) as f32
    };
    (0..width * height).map(mean).collect()
}

/// Pixels that are a filled ellipse inside the image.
fn round(pixels: &[usize], width: usize, height: usize) -> Option<Spot> {
    let n = pixels.len() as f64;
    let place = |&at: &usize| [(at % width) as f64, (at / width) as f64];
    let (w, h) = ((width - 1) as f64, (height - 1) as f64);
    if pixels.len() < LEAST || pixels.iter().map(place).any(|[x, y]| x < 1.0 || y < 1.0 || x > w - 1.0 || y > h - 1.0) {
        return None;
    }
    let mean = [0, 1].map(|c| pixels.iter().map(|at| place(at)[c]).sum::<f64>() / n);
    let moment = |i: usize, j: usize| {
        let sum: f64 = pixels.iter().map(|at| (place(at)[i] - mean[i]) * (place(at)[j] - mean[j])).sum();
        // A pixel has an extent of its own.
        sum / n + if i == j { 1.0 / 12.0 } else { 0.0 }
    };
    let (xx, xy, yy) = (moment(0, 0), moment(0, 1), moment(1, 1));
    let determinant = xx * yy - xy * xy;
    let ellipse = 4.0 * std::f64::consts::PI * determinant.max(0.0).sqrt();
    let (half, apart) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    let is_round = (n / ellipse - 1.0).abs() < ROUND && half + apart < LONGEST * LONGEST * (half - apart);
    is_round.then_some(Spot { at: mean, n: pixels.len() })
}

/// The middle of the dot near a place where neighbours are `steps` away, weighed by how much each pixel differs from
/// what is around, and its radius by that distance; `None` where there is none.
pub(super) fn refined(image: &Plain, near: Point, steps: [Point; 2]) -> Option<(Point, f64)> {
    let [[ax, ay], [bx, by]] = steps;
    let cell = (ax * by - ay * bx).abs();
    let inverse = [[by, -bx], [-ay, ax]].map(|row| row.map(|v| v / (ax * by - ay * bx)));
    // Distance by the steps: round dots are round in it.
    let far = |x: f64, y: f64| {
        let d = inverse.map(|row| row[0] * x + row[1] * y);
        d[0].hypot(d[1])
    };
    let mut at = near;
    let mut radius = 0.25;
    for round in 0..4 {
        let edge = (EDGE * (1.0 - 2.0 * radius)).min(LARGEST_EDGE / shorter(steps));
        let (inner, outer) = (radius + edge, radius + 1.6 * edge);
        // Half the square that holds the ring.
        let reach = outer * (ax.abs() + bx.abs()).max(ay.abs() + by.abs());
        let pixels = || {
            let list =
                image.window(at, reach).map(|(x, y)| (x as f64 - at[0], y as f64 - at[1], f64::from(image.at(x, y))));
            list.map(|(x, y, v)| (x, y, v, far(x, y)))
        };
        let ring = pixels().filter(|(.., far)| (inner..outer).contains(far));
        let (mut normal, mut pull) = (Dense::zeros(3, 3), Dense::zeros(3, 1));
        for (x, y, v, _) in ring {
            let row = [1.0, x, y];
            for i in 0..3 {
                (0..3).for_each(|j| normal[(i, j)] += row[i] * row[j]);
                pull[(i, 0)] += row[i] * v;
            }
        }
        let around = normal.cholesky().ok()?.solve(&pull);
        let level = |x: f64, y: f64| around[(0, 0)] + around[(1, 0)] * x + around[(2, 0)] * y;
        // The depth of the dot is that of its core.
        let core: Vec<f64> = pixels().filter(|of| of.3 < 0.5 * radius).map(|(x, y, v, _)| v - level(x, y)).collect();
        let depth = core.iter().sum::<f64>() / core.len() as f64;
        let (mut sum, mut first) = (0.0, [0.0; 2]);
        for (x, y, v, _) in pixels().filter(|of| of.3 < inner) {
            let weight = (v - level(x, y)) / depth;
            sum += weight;
            first = [first[0] + weight * x, first[1] + weight * y];
        }
        let moved = first.map(|v| v / sum);
        at = [at[0] + moved[0], at[1] + moved[1]];
        let found = (sum / (std::f64::consts::PI * cell)).sqrt();
        let is_dot = found.is_finite() && (0.03..0.48).contains(&found) && at.iter().all(|v| v.is_finite());
        if !is_dot || far(at[0] - near[0], at[1] - near[1]) > 0.25 {
            return None;
        }
        radius = if round == 0 { found } else { 0.5 * (radius + found) };
    }
    Some((at, radius))
}
