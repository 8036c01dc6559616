//! The two sides of a line: how each of them moves, and up to where the pixels between follow the one or the other.

use crate::correlate::{affine, bilinear};
use crate::field::{ElementMark, Measurement};
use crate::imaging::Image;
use crate::mesh::{point_along, project};
use crate::plane::distance;
use crate::units::Px;

/// Nodes this far along the line and across it tell how a side moves, in elements.
const ALONG: f64 = 2.5;
const ACROSS: f64 = 3.5;
/// and those of so many elements beyond the nearest.
const DEPTH: f64 = 2.6;
/// Nodes that are needed, for an affine motion.
const NODES: usize = 5;
/// Half width of the band in which the path is looked for, in elements.
const BAND: f64 = 1.75;
/// Half width of the strip beside the path that has to follow its own side, in elements.
const STRIP: f64 = 0.75;
/// What one side has to leave unexplained beyond both together, and what both may.
const WORSE_ALONE: f64 = 1.6;
const LEFT: f64 = 0.55;
/// Price of a step of the path by a pixel across, in the variance of the grey levels.
const STEP_PRICE: f64 = 0.7;

/// A path between two sides that move differently.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Between {
    /// Points of the path from the first to the last place where both sides are followed, at steps of an element.
    pub path: Vec<[f64; 2]>,
    /// How far the sides have moved apart at each of them, px, where both are measured.
    pub apart: Vec<Option<f64>>,
    /// Share of the places between that are.
    pub share: f64,
    /// Pixels across the line that follow the other side than the one that the line itself has them on, for each pixel
    /// along: those that do not match there count in full.
    pub beside: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sides {
    /// Two sides that move differently.
    Two(Between),
    /// Too little is measured beside it.
    NotMeasured,
    /// The pixels between follow neither side, or both alike.
    One,
}

/// Affine motions of the side `+` (above a line to the right) and of the other, in stations half an element apart.
struct Station([[[f64; 3]; 2]; 2]);

impl Station {
    fn displacement(&self, side: usize, [x, y]: [f64; 2]) -> [f64; 2] {
        self.0[side].map(|[a, b, c]| a + b * x + c * y)
    }
}

/// A place beside a line: how far along, how far to the side `+`.
pub(super) fn place_beside(line: &[[f64; 2]], at: [f64; 2]) -> Option<[f64; 2]> {
    let found = project(line, at)?;
    let (on, [tx, ty]) = point_along(line, found.along)?;
    let d = [at[0] - on[0], at[1] - on[1]];
    // What lies beyond an end is on neither side.
    ((d[0] * tx + d[1] * ty).abs() < 0.5 * found.distance.max(1.0)).then_some([found.along, d[0] * ty - d[1] * tx])
}

/// The stations along a line; none where one of the sides is not measured.
fn stations(line: &[[f64; 2]], length: f64, field: &Measurement<Px>) -> Vec<Option<Station>> {
    let mesh = &field.mesh;
    let size = mesh.element_size();
    // Measured, and of no element in the sums that does not match.
    let mut good = field.measured.clone();
    for (nodes, mark) in mesh.elements().iter().zip(field.marks.as_deref().unwrap_or_default()) {
        if matches!(mark, ElementMark::Misfit | ElementMark::Still) {
            nodes.iter().for_each(|&node| good[node as usize] = false);
        }
    }
    let near: Vec<([f64; 2], usize)> = (0..mesh.n_nodes())
        .filter(|&node| good[node])
        .filter_map(|node| Some((place_beside(line, mesh.nodes()[node])?, node)))
        .filter(|([_, across], _)| across.abs() < 2.0 * ACROSS * size)
        .collect();
    let n = (2.0 * length / size).ceil() as usize + 1;
    let motion = |along: f64, sign: f64| {
        let is_own = |([s, t], _): &&([f64; 2], usize)| (s - along).abs() < ALONG * size && t * sign > 1.0;
        let own = || near.iter().filter(is_own);
        let nearest = own().map(|([_, t], _)| t.abs()).fold(f64::INFINITY, f64::min);
        let reach = (nearest + DEPTH * size).min((ACROSS + DEPTH) * size);
        let points: Vec<_> = own()
            .filter(|([_, t], _)| nearest < ACROSS * size && t.abs() <= reach)
            .map(|&(_, node)| (mesh.nodes()[node], field.displacement[node]))
            .collect();
        (points.len() >= NODES).then(|| {
            let motion = affine(&points);
            // As a + b x + c y.
            let (o, x, y) = (motion([0.0; 2]), motion([1.0, 0.0]), motion([0.0, 1.0]));
            [0, 1].map(|c| [o[c], x[c] - o[c], y[c] - o[c]])
        })
    };
    let station = |k: usize| {
        let along = 0.5 * size * k as f64;
        Some(Station([motion(along, 1.0)?, motion(along, -1.0)?]))
    };
    (0..n).map(station).collect()
}

/// Squares of what each side leaves at places along and across the line, px by px, and how many pixels fell there.
struct Costs {
    half: i64,
    n_across: usize,
    n_along: usize,
    of_side: [Vec<f64>; 2],
    n: Vec<f64>,
    /// Variance of the grey levels of the reference.
    variance: f64,
}

impl Costs {
    fn of(
        line: &[[f64; 2]],
        length: f64,
        stations: &[Option<Station>],
        [reference, deformed]: [&Image; 2],
        size: f64,
    ) -> Option<Self> {
        let half = (BAND * size).round() as i64;
        let (n_across, n_along) = (2 * half as usize, length.ceil() as usize + 1);
        let mut pixels: Vec<(usize, f64, [Option<f64>; 2])> = Vec::new();
        // Beyond an end a place beside the line may be further from it than it is across.
        for [x, y] in around(line, 1.2 * half as f64, reference) {
            let at = [x as f64, y as f64];
            let Some([s, t]) = place_beside(line, at) else { continue };
            let bin = (t + half as f64).floor();
            let Some(Some(station)) = stations.get((2.0 * s / size).round() as usize) else { continue };
            if bin < 0.0 || bin >= n_across as f64 {
                continue;
            }
            let moved = |side: usize| {
                let u = station.displacement(side, at);
                bilinear(deformed, [at[0] + u[0], at[1] + u[1]])
            };
            let place = (s.floor() as usize).min(n_along - 1) * n_across + bin as usize;
            pixels.push((place, f64::from(reference.grey(x, y)), [moved(0), moved(1)]));
        }
        // Gain and offset by the outermost third of either side, which is its own.
        let third = n_across / 6;
        let own = pixels.iter().filter_map(|&(place, f, g)| match place % n_across {
            across if across < third => Some([f, g[1]?]),
            across if across >= n_across - third => Some([f, g[0]?]),
            _ => None,
        });
        let (mut sums, mut n) = ([0.0; 4], 0.0f64);
        for [f, g] in own {
            sums = [sums[0] + f, sums[1] + g, sums[2] + f * f, sums[3] + g * g];
            n += 1.0;
        }
        let mean = [sums[0] / n, sums[1] / n];
        let [variance, of_g] = [0, 1].map(|k| sums[2 + k] / n - mean[k] * mean[k]);
        if !(variance > 0.0 && of_g > 0.0) {
            return None;
        }
        let gain = (variance / of_g).sqrt();
        let mut costs = Self {
            half,
            n_across,
            n_along,
            of_side: [0, 1].map(|_| vec![0.0; n_across * n_along]),
            n: vec![0.0; n_across * n_along],
            variance,
        };
        for (place, f, g) in pixels {
            costs.n[place] += 1.0;
            for (cost, g) in costs.of_side.iter_mut().zip(g) {
                let left = g.map_or(f64::INFINITY, |g| f - mean[0] - gain * (g - mean[1]));
                // What matches nowhere says nothing.
                cost[place] += (left * left).min(variance);
            }
        }
        Some(costs)
    }

    /// The sum over places across, from `from` up to `to`.
    fn sum(values: &[f64], from: usize, to: usize) -> f64 {
        values[from..to.max(from)].iter().sum()
    }

    /// Where the border between the sides runs, px across at each place along, by dynamic programming.
    fn border(&self) -> Vec<usize> {
        let (n, price) = (self.n_across + 1, STEP_PRICE * self.variance);
        let mut best = vec![0.0; n];
        let mut from: Vec<Vec<i8>> = Vec::new();
        for along in 0..self.n_along {
            let row = along * self.n_across..(along + 1) * self.n_across;
            let (plus, minus) = (&self.of_side[0][row.clone()], &self.of_side[1][row]);
            // Below the border the side `-`.
            let mut own = Vec::with_capacity(n);
            own.push(plus.iter().sum::<f64>());
            for k in 0..self.n_across {
                own.push(own[k] + minus[k] - plus[k]);
            }
            let mut came = vec![0i8; n];
            let mut next = vec![0.0; n];
            for b in 0..n {
                let mut least = best[b];
                for step in [-1i8, 1] {
                    let Some(other) = b.checked_add_signed(isize::from(step)).filter(|&other| other < n) else {
                        continue;
                    };
                    if best[other] + price < least {
                        (least, came[b]) = (best[other] + price, step);
                    }
                }
                next[b] = least + own[b];
            }
            best = next;
            from.push(came);
        }
        let mut at = (0..n).min_by(|&a, &b| best[a].total_cmp(&best[b])).unwrap_or(0);
        let mut border = vec![0; self.n_along];
        for along in (0..self.n_along).rev() {
            border[along] = at;
            at = at.saturating_add_signed(isize::from(from[along][at]));
        }
        border
    }

    /// What the pixels at the places `along` leave less of where the border parts them than where the line does, in the
    /// variance of the grey levels.
    fn gained(&self, border: &[usize], along: std::ops::Range<usize>) -> f64 {
        let of_place = |s: usize| {
            let row = s * self.n_across;
            let [line, at] = [self.half as usize, border[s]];
            let (low, high) = (row + line.min(at), row + line.max(at));
            let [plus, minus] = self.of_side.each_ref().map(|side| Self::sum(side, low, high));
            if at > line { plus - minus } else { minus - plus }
        };
        along.map(of_place).sum::<f64>() / self.variance
    }

    /// Whether the pixels beside the border at the places `along` follow each its own side; none where there are none.
    fn follows(&self, border: &[usize], along: std::ops::Range<usize>, strip: usize) -> Option<bool> {
        let (mut both, mut alone, mut n) = (0.0, [0.0; 2], 0.0);
        for s in along {
            let row = s * self.n_across;
            let (low, middle, high) =
                (row + border[s].saturating_sub(strip), row + border[s], row + (border[s] + strip).min(self.n_across));
            let [plus, minus] = &self.of_side;
            both += Self::sum(minus, low, middle) + Self::sum(plus, middle, high);
            alone = [alone[0] + Self::sum(plus, low, high), alone[1] + Self::sum(minus, low, high)];
            n += Self::sum(&self.n, low, high);
        }
        let least = alone[0].min(alone[1]);
        (n > 0.5 * (strip * strip) as f64).then_some(least > WORSE_ALONE * both && both < LEFT * self.variance * n)
    }
}

/// The pixels within `reach` of a line and some more, row by row: those in boxes around its pieces, not around all.
fn around(line: &[[f64; 2]], reach: f64, image: &Image) -> Vec<[usize; 2]> {
    let mut pixels = Vec::new();
    for piece in line.windows(2) {
        let [columns, rows] = [0, 1].map(|c| {
            let n = [image.width(), image.height()][c];
            let low = (piece[0][c].min(piece[1][c]) - reach).max(0.0) as usize;
            let high = (piece[0][c].max(piece[1][c]) + reach).max(0.0) as usize + 1;
            low.min(n)..high.min(n)
        });
        pixels.extend(rows.flat_map(|y| columns.clone().map(move |x| [x, y])));
    }
    pixels.sort_unstable_by_key(|&[x, y]| (y, x));
    pixels.dedup();
    pixels
}

/// Looks at the two sides of `line` in a field and its images, reference and deformed.
pub(super) fn sides(line: &[[f64; 2]], field: &Measurement<Px>, images: [&Image; 2]) -> Sides {
    let size = field.mesh.element_size();
    let length: f64 = line.windows(2).map(|two| distance(two[0], two[1])).sum();
    let stations = stations(line, length, field);
    let measured = stations.iter().flatten().count();
    if 3 * measured < stations.len() || measured < 3 {
        return Sides::NotMeasured;
    }
    let Some(costs) = Costs::of(line, length, &stations, images, size) else { return Sides::NotMeasured };
    let border = costs.border();
    let strip = (STRIP * size).round() as usize;
    let step = size.round() as usize;
    let blocks: Vec<Option<bool>> = (0..costs.n_along)
        .step_by(step)
        .map(|s| costs.follows(&border, s..(s + step).min(costs.n_along), strip))
        .collect();
    let yes = |k: &usize| blocks[*k] == Some(true);
    let (Some(first), Some(last)) = ((0..blocks.len()).find(yes), (0..blocks.len()).rev().find(yes)) else {
        return Sides::One;
    };
    let followed = first * step..((last + 1) * step).min(costs.n_along);
    let beside = costs.gained(&border, followed.clone()) / followed.len() as f64;
    let known = blocks[first..=last].iter().flatten().count();
    let n = blocks[first..=last].iter().filter(|block| **block == Some(true)).count();
    if n < 3 {
        return Sides::One;
    }
    let place = |k: usize| {
        let (begin, end) = (k * step, ((k + 1) * step).min(costs.n_along));
        let mean = border[begin..end].iter().sum::<usize>() as f64 / (end - begin) as f64 - costs.half as f64;
        let (on, [tx, ty]) = point_along(line, 0.5 * (begin + end) as f64)?;
        // The normal of `+` is (ty, -tx).
        Some([on[0] + mean * ty, on[1] - mean * tx])
    };
    let apart = |k: usize, at: [f64; 2]| {
        let station = stations.get(2 * k + 1)?.as_ref()?;
        Some(distance(station.displacement(0, at), station.displacement(1, at)))
    };
    let places = (first..=last).filter(|&k| blocks[k] != Some(false)).filter_map(|k| Some((k, place(k)?)));
    let (path, apart) = places.map(|(k, at)| (at, apart(k, at))).unzip();
    Sides::Two(Between { path, apart, share: n as f64 / known.max(1) as f64, beside })
}
