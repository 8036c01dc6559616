//! Points of a speckled image that are found again wherever it was moved or turned to: extrema of the difference of two
//! Gaussian blurs, each with a direction and with the gradients around it (Lowe 2004), on a few scales.

use crate::imaging::Image;
use crate::mesh::PixelSet;
use rayon::prelude::*;
use std::f32::consts::TAU;

/// The first scale halves the image until it has at most this many pixels.
const MOST_PIXELS: usize = 1_300_000;
/// Scales, each half of the one before; none with a shorter side than [`LEAST_SIDE`].
const OCTAVES: usize = 4;
const LEAST_SIDE: usize = 48;
/// Standard deviations of the two blurs, px of the scale: their difference answers to spots of about 4 px.
const BLUR: [f32; 2] = [1.2, 2.0];
/// Points are taken in squares of this side, px of the scale, so that all of the image has some.
const SQUARE: usize = 24;
/// About so many points per scale.
const POINTS: usize = 2400;
/// Side of one of the 4 x 4 cells around a point that gradients are counted in, px of the scale.
const CELL: f32 = 5.0;
/// Radius around a point that its direction is made of, px of the scale, and the standard deviation of its weights.
const AROUND: isize = 10;
const AROUND_SIGMA: f32 = 5.0;
/// Directions, of the point and of the gradients in a cell.
const DIRECTIONS: usize = 36;
const GRADIENTS: usize = 8;
const NUMBERS: usize = 16 * GRADIENTS;
/// A match counts when the next best is this much farther away.
const UNLIKE: f32 = 0.85;

pub(crate) struct Features {
    octaves: Vec<Octave>,
}

struct Octave {
    /// Pixels of the image along one of this scale.
    px: f64,
    points: Vec<Point>,
}

struct Point {
    /// Place in the image, px.
    at: [f64; 2],
    /// Its direction, radians.
    angle: f32,
    /// The gradients around it, of length 1.
    gradients: Box<[f32; NUMBERS]>,
}

/// A point of the reference and the one of the deformed image that looks like it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    /// Place in the reference, px.
    pub from: [f64; 2],
    /// Place in the deformed image, px.
    pub to: [f64; 2],
    /// How far it seems to be turned, radians.
    pub turn: f64,
    /// Pixels along one of the scale that it was found on: places are good to about that.
    pub px: f64,
}

struct Map {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Map {
    fn of(image: &Image) -> Self {
        let (width, height) = (image.width(), image.height());
        let values = (0..width * height).into_par_iter().map(|k| image.grey(k % width, k / width)).collect();
        Self { width, height, values }
    }

    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let mean = |k: usize| {
            let (x, y) = (2 * (k % width), 2 * (k / width));
            0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
        };
        Self { width, height, values: (0..width * height).into_par_iter().map(mean).collect() }
    }

    /// Blurred by a Gaussian; beyond the border the outermost pixel repeats.
    fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weights: Vec<f32> = (-reach..=reach).map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let weights: Vec<f32> = weights.iter().map(|w| w / sum).collect();
        let (width, height) = (self.width, self.height);
        let along = |values: &[f32], by_x: bool| -> Vec<f32> {
            let of_row = |(y, out): (usize, &mut [f32])| {
                for (x, out) in out.iter_mut().enumerate() {
                    *out = (-reach..=reach)
                        .zip(&weights)
                        .map(|(k, weight)| {
                            let clamped = |v: usize, n: usize| (v as isize + k).clamp(0, n as isize - 1) as usize;
                            let at = if by_x { y * width + clamped(x, width) } else { clamped(y, height) * width + x };
                            weight * values[at]
                        })
                        .sum();
                }
            };
            let mut out = vec![0.0; values.len()];
            out.par_chunks_mut(width).enumerate().for_each(of_row);
            out
        };
        Self { width, height, values: along(&along(&self.values, true), false) }
    }

    fn gradient(&self, x: isize, y: isize) -> Option<[f32; 2]> {
        let inside = x >= 1 && y >= 1 && x + 1 < self.width as isize && y + 1 < self.height as isize;
        let at = |x: isize, y: isize| self.values[y as usize * self.width + x as usize];
        inside.then(|| [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)])
    }
}

impl Features {
    pub fn of(image: &Image) -> Self {
        let (mut map, mut px) = (Map::of(image), 1.0);
        while map.values.len() > MOST_PIXELS {
            (map, px) = (map.halved(), 2.0 * px);
        }
        let mut octaves = Vec::new();
        for _ in 0..OCTAVES {
            if map.width.min(map.height) < LEAST_SIDE {
                break;
            }
            octaves.push(Octave::of(&map, px));
            (map, px) = (map.halved(), 2.0 * px);
        }
        Self { octaves }
    }

    /// The points of this image in a zone, each with its like in `deformed` where that is told from others.
    pub fn pairs(&self, deformed: &Self, zone: &PixelSet) -> Vec<Pair> {
        let of_octave = |(own, other): (&Octave, &Octave)| {
            let inside =
                |p: &&Point| p.at.iter().all(|v| *v >= 0.0) && zone.contains(p.at[0] as usize, p.at[1] as usize);
            let points: Vec<&Point> = own.points.iter().filter(inside).collect();
            let pair = |point: &&Point| {
                let found = other.like(point)?;
                let turn = f64::from(found.angle - point.angle);
                Some(Pair { from: point.at, to: found.at, turn, px: own.px })
            };
            points.par_iter().filter_map(pair).collect::<Vec<_>>()
        };
        self.octaves.iter().zip(&deformed.octaves).flat_map(of_octave).collect()
    }
}

impl Octave {
    fn of(map: &Map, px: f64) -> Self {
        let [narrow, wide] = BLUR.map(|sigma| map.blurred(sigma));
        let (width, height) = (map.width, map.height);
        let spot: Vec<f32> = narrow.values.iter().zip(&wide.values).map(|(a, b)| a - b).collect();
        let squares = [width.div_ceil(SQUARE), height.div_ceil(SQUARE)];
        let per_square = (POINTS / (squares[0] * squares[1])).clamp(1, 8);
        let border = 6;
        let of_square = |square: usize| {
            let (x0, y0) = (SQUARE * (square % squares[0]), SQUARE * (square / squares[0]));
            let end = |v: usize, n: usize| (v + SQUARE).min(n.saturating_sub(border));
            let mut found: Vec<(f32, usize, usize)> = Vec::new();
            for y in y0.max(border)..end(y0, height) {
                for x in x0.max(border)..end(x0, width) {
                    let value = spot[y * width + x];
                    let around = || {
                        (y - 1..=y + 1)
                            .flat_map(move |v| (x - 1..=x + 1).map(move |u| (u, v)))
                            .filter(move |&at| at != (x, y))
                    };
                    let at = |(u, v): (usize, usize)| spot[v * width + u];
                    if around().all(|n| at(n) < value) || around().all(|n| at(n) > value) {
                        found.push((value.abs(), x, y));
                    }
                }
            }
            found.sort_by(|a, b| b.0.total_cmp(&a.0));
            found.truncate(per_square);
            found.into_iter().map(|(_, x, y)| (x, y)).collect::<Vec<_>>()
        };
        let places: Vec<(usize, usize)> =
            (0..squares[0] * squares[1]).into_par_iter().flat_map_iter(of_square).collect();
        let points_at = |&(x, y): &(usize, usize)| {
            let at = |dx: isize, dy: isize| spot[(y as isize + dy) as usize * width + (x as isize + dx) as usize];
            // The top of a parabola through three values.
            let top = |before: f32, middle: f32, after: f32| {
                let bend = before - 2.0 * middle + after;
                if bend == 0.0 { 0.0 } else { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) }
            };
            let rest = [top(at(-1, 0), at(0, 0), at(1, 0)), top(at(0, -1), at(0, 0), at(0, 1))];
            // A pixel of this scale is the mean of px x px of the image: its centre lies in their middle.
            let full =
                [(x, rest[0]), (y, rest[1])].map(|(v, rest)| px * (v as f64 + f64::from(rest)) + 0.5 * (px - 1.0));
            directions(&narrow, [x, y])
                .into_iter()
                .map(|angle| Point { at: full, angle, gradients: gradients(&narrow, [x, y], rest, angle) })
                .collect::<Vec<_>>()
        };
        Self { px, points: places.par_iter().flat_map_iter(points_at).collect() }
    }

    /// The point that looks most like `point`, unless another one elsewhere does nearly as much.
    fn like(&self, point: &Point) -> Option<&Point> {
        let mut best: Option<(f32, &Point)> = None;
        let mut second = f32::NEG_INFINITY;
        for other in &self.points {
            let like: f32 = point.gradients.iter().zip(other.gradients.iter()).map(|(a, b)| a * b).sum();
            match best {
                Some((most, at)) if like <= most => {
                    // The same place with another direction is no other place.
                    if like > second && at.at != other.at {
                        second = like;
                    }
                }
                Some((most, at)) => {
                    if at.at != other.at {
                        second = most;
                    }
                    best = Some((like, other));
                }
                None => best = Some((like, other)),
            }
        }
        let apart = |like: f32| (2.0 - 2.0 * like).max(0.0).sqrt();
        best.filter(|(like, _)| apart(*like) < UNLIKE * apart(second.max(-1.0))).map(|(_, found)| found)
    }
}

/// The directions of the gradients around a place: the strongest, and another one that is nearly as strong.
fn directions(map: &Map, [x, y]: [usize; 2]) -> Vec<f32> {
    let mut counts = [0.0f32; DIRECTIONS];
    for dy in -AROUND..=AROUND {
        for dx in -AROUND..=AROUND {
            let r2 = (dx * dx + dy * dy) as f32;
            if r2 > (AROUND * AROUND) as f32 {
                continue;
            }
            let Some([gx, gy]) = map.gradient(x as isize + dx, y as isize + dy) else { continue };
            let place = gy.atan2(gx).rem_euclid(TAU) / TAU * DIRECTIONS as f32;
            let weight = gx.hypot(gy) * (-0.5 * r2 / (AROUND_SIGMA * AROUND_SIGMA)).exp();
            let (low, part) = (place.floor(), place - place.floor());
            counts[low as usize % DIRECTIONS] += weight * (1.0 - part);
            counts[(low as usize + 1) % DIRECTIONS] += weight * part;
        }
    }
    for _ in 0..3 {
        let before = counts;
        for k in 0..DIRECTIONS {
            counts[k] = (before[(k + DIRECTIONS - 1) % DIRECTIONS] + before[k] + before[(k + 1) % DIRECTIONS]) / 3.0;
        }
    }
    let most = counts.iter().copied().fold(0.0, f32::max);
    let mut peaks: Vec<(f32, f32)> = (0..DIRECTIONS)
        .filter_map(|k| {
            let (before, here, after) =
                (counts[(k + DIRECTIONS - 1) % DIRECTIONS], counts[k], counts[(k + 1) % DIRECTIONS]);
            let peak = here > before && here >= after && here >= 0.8 * most;
            let bend = before - 2.0 * here + after;
            let rest = if bend == 0.0 { 0.0 } else { 0.5 * (before - after) / bend };
            peak.then(|| (here, (k as f32 + rest) / DIRECTIONS as f32 * TAU))
        })
        .collect();
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.truncate(2);
    peaks.into_iter().map(|(_, angle)| angle).collect()
}

/// The gradients around a place as seen from the direction `angle`, counted by cell and direction, of length 1.
fn gradients(map: &Map, [x, y]: [usize; 2], rest: [f32; 2], angle: f32) -> Box<[f32; NUMBERS]> {
    let mut numbers = Box::new([0.0f32; NUMBERS]);
    let (sin, cos) = angle.sin_cos();
    let reach = (2.5 * CELL * std::f32::consts::SQRT_2).ceil() as isize;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let (px, py) = (dx as f32 - rest[0], dy as f32 - rest[1]);
            let (u, v) = ((cos * px + sin * py) / CELL, (cos * py - sin * px) / CELL);
            if u.abs() >= 2.5 || v.abs() >= 2.5 {
                continue;
            }
            let Some([gx, gy]) = map.gradient(x as isize + dx, y as isize + dy) else { continue };
            let weight = gx.hypot(gy) * (-(u * u + v * v) / 8.0).exp();
            let direction = (gy.atan2(gx) - angle).rem_euclid(TAU) / TAU * GRADIENTS as f32;
            let (d0, dp) = (direction.floor(), direction - direction.floor());
            let (cu, cv) = (u + 1.5, v + 1.5);
            let (u0, v0) = (cu.floor(), cv.floor());
            for (row, wv) in [(v0, 1.0 - (cv - v0)), (v0 + 1.0, cv - v0)] {
                for (column, wu) in [(u0, 1.0 - (cu - u0)), (u0 + 1.0, cu - u0)] {
                    if !(0.0..4.0).contains(&row) || !(0.0..4.0).contains(&column) {
                        continue;
                    }
                    let cell = GRADIENTS * (4 * row as usize + column as usize);
                    numbers[cell + d0 as usize % GRADIENTS] += weight * wu * wv * (1.0 - dp);
                    numbers[cell + (d0 as usize + 1) % GRADIENTS] += weight * wu * wv * dp;
                }
            }
        }
    }
    let scale = |numbers: &mut [f32; NUMBERS]| {
        let length = numbers.iter().map(|v| v * v).sum::<f32>().sqrt().max(f32::MIN_POSITIVE);
        numbers.iter_mut().for_each(|v| *v /= length);
    };
    scale(&mut numbers);
    // One strong edge, a glare, shall not be all.
    numbers.iter_mut().for_each(|v| *v = v.min(0.2));
    scale(&mut numbers);
    numbers
}
