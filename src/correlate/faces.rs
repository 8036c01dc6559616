//! The faces of a cut where the elements of a frame do not match: their nodes are followed one by one, each by the pixels around it on
//! its own side, with a gain, an offset and an affine motion of their own (docs/correlation.md, section 2.12).
//!
//! Beside a crack that opens wide the light changes and the material turns and stretches from element to element: there one gain for the
//! zone and one start for all may fail where the texture is still to be seen.

use crate::imaging::Image;
use crate::linalg::Dense;
use crate::mesh::{Mesh, PixelSet};
use crate::units::Px;
use std::collections::{BTreeMap, BTreeSet};

/// Correlation coefficient from which on the pixels around a node are found.
const FOUND: f64 = 0.95;
/// and by which they have to be better there than anywhere else nearby.
const UNIQUE: f64 = 0.1;
/// Whole pixels around a start that are tried, each way, and how near to the best another place counts as the same.
const REACH: i32 = 10;
const SAME: i32 = 3;
/// Pixels that are needed: they have eight unknowns.
const PIXELS: usize = 80;
/// Iterations, and the correction at which they end, px.
const ITERATIONS: usize = 40;
const TOLERANCE_PX: f64 = 1e-3;
/// Largest displacement gradient, and how far from the place that was found by whole pixels it may end, px.
const STEEPEST: f64 = 0.6;
const AWAY_PX: f64 = 2.0;
/// What is left is no white noise but of the size of speckles: it counts so many times in the standard uncertainty.
const COLOURED: f64 = 2.0;

/// A node that was followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Followed {
    pub node: usize,
    pub displacement: [f64; 2],
    pub sigma: [f64; 2],
}

/// An affine displacement about a node: its value there and its gradient by rows.
#[derive(Debug, Clone, Copy)]
struct Affine {
    about: [f64; 2],
    p: [f64; 6],
}

impl Affine {
    fn shift(about: [f64; 2], u: [f64; 2]) -> Self {
        Self { about, p: [u[0], u[1], 0.0, 0.0, 0.0, 0.0] }
    }

    fn at(&self, x: [f64; 2]) -> [f64; 2] {
        let d = [x[0] - self.about[0], x[1] - self.about[1]];
        let p = self.p;
        [p[0] + p[2] * d[0] + p[3] * d[1], p[1] + p[4] * d[0] + p[5] * d[1]]
    }

    /// The displacement `u` at a place, turned and stretched as it changes between two others.
    fn turned(about: [f64; 2], u: [f64; 2], [(x, at_x), (y, at_y)]: [([f64; 2], [f64; 2]); 2]) -> Self {
        let (d, du) = ([y[0] - x[0], y[1] - x[1]], [at_y[0] - at_x[0], at_y[1] - at_x[1]]);
        let square = d[0] * d[0] + d[1] * d[1];
        // The quotient of the two as complex numbers.
        let stretch = (du[0] * d[0] + du[1] * d[1]) / square;
        let turn = (du[1] * d[0] - du[0] * d[1]) / square;
        Self { about, p: [u[0], u[1], stretch, -turn, turn, stretch] }
    }

    /// The same about another place.
    fn about(&self, x: [f64; 2]) -> Self {
        let u = self.at(x);
        let mut p = self.p;
        (p[0], p[1]) = (u[0], u[1]);
        Self { about: x, p }
    }
}

/// The pixels around a node on its own side, with their grey levels in the reference: of mean 0 and length 1.
struct Patch {
    about: [f64; 2],
    pixels: Vec<[f64; 2]>,
    grey: Vec<f64>,
}

impl Patch {
    fn new(about: [f64; 2], pixels: Vec<[f64; 2]>, reference: &Image) -> Option<Self> {
        let grey = pixels.iter().map(|p| f64::from(reference.grey(p[0] as usize, p[1] as usize))).collect();
        Some(Self { about, grey: normalised(grey)?.0, pixels }).filter(|patch| patch.pixels.len() >= PIXELS)
    }

    /// Correlation coefficient where whole pixels beside an affine motion put the patch; none outside the image.
    fn coefficient(&self, image: &Image, motion: &Affine, step: [i32; 2]) -> Option<f64> {
        let mut grey = Vec::with_capacity(self.grey.len());
        for p in &self.pixels {
            let u = motion.at(*p);
            let at = [0, 1].map(|c| (p[c] + u[c]).round() as i64 + i64::from(step[c]));
            let inside = at[0] >= 0 && at[1] >= 0 && at[0] < image.width() as i64 && at[1] < image.height() as i64;
            grey.push(f64::from(inside.then(|| image.grey(at[0] as usize, at[1] as usize))?));
        }
        let (grey, _) = normalised(grey)?;
        Some(self.grey.iter().zip(&grey).map(|(f, g)| f * g).sum())
    }

    /// The best place around `start` by whole pixels, and the coefficients there and at the best place that is another one.
    fn nearby(&self, image: &Image, start: &Affine) -> Option<(Affine, [f64; 2])> {
        let steps = || (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| [x, y]));
        let tried: Vec<([i32; 2], f64)> =
            steps().filter_map(|step| Some((step, self.coefficient(image, start, step)?))).collect();
        let (best, first) = tried.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let other = |step: &[i32; 2]| (0..2).any(|c| (step[c] - best[c]).abs() > SAME);
        let second = tried.iter().filter(|(step, _)| other(step)).map(|(_, c)| *c).fold(-1.0, f64::max);
        let mut motion = *start;
        (0..2).for_each(|c| motion.p[c] += f64::from(best[c]));
        Some((motion, [first, second]))
    }

    /// Iterates from `start` by least squares of the grey levels of mean 0 and length 1: motion, coefficient, standard uncertainty.
    fn iterated(&self, image: &Image, start: &Affine) -> Option<(Affine, f64, [f64; 2])> {
        let mut motion = *start;
        for _ in 0..ITERATIONS {
            let mut slopes = Vec::with_capacity(self.pixels.len());
            let mut grey = Vec::with_capacity(self.pixels.len());
            for p in &self.pixels {
                let u = motion.at(*p);
                let [g, gx, gy] = cubic(image, [p[0] + u[0], p[1] + u[1]])?;
                let d = [p[0] - self.about[0], p[1] - self.about[1]];
                slopes.push([gx, gy, gx * d[0], gx * d[1], gy * d[0], gy * d[1]]);
                grey.push(g);
            }
            let (grey, length) = normalised(grey)?;
            let n = slopes.len() as f64;
            // Mean and length of the deformed grey levels follow the motion as well.
            for k in 0..6 {
                let mean = slopes.iter().map(|s| s[k]).sum::<f64>() / n;
                let along = slopes.iter().zip(&grey).map(|(s, g)| (s[k] - mean) * g).sum::<f64>();
                slopes.iter_mut().zip(&grey).for_each(|(s, g)| s[k] = (s[k] - mean - along * g) / length);
            }
            let (mut matrix, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
            let (mut square, mut product) = (0.0, 0.0);
            for ((s, f), g) in slopes.iter().zip(&self.grey).zip(&grey) {
                let left = f - g;
                (square, product) = (square + left * left, product + f * g);
                for i in 0..6 {
                    right[i] += s[i] * left;
                    (0..6).for_each(|j| matrix[i][j] += s[i] * s[j]);
                }
            }
            let inverse = Dense::from_fn(6, 6, |i, j| matrix[i][j]).cholesky().ok()?.inverse();
            let step: [f64; 6] = std::array::from_fn(|i| (0..6).map(|j| inverse.column(j)[i] * right[j]).sum());
            (0..6).for_each(|k| motion.p[k] += step[k]);
            let away = (0..2).map(|c| (motion.p[c] - start.p[c]).abs()).fold(0.0, f64::max);
            if !(away < AWAY_PX && motion.p[2..].iter().all(|g| g.abs() < STEEPEST)) {
                return None;
            }
            if step[0].abs().max(step[1].abs()) < TOLERANCE_PX {
                let variance = square / (n - 8.0);
                let sigma = [0, 1].map(|c| COLOURED * (variance * inverse.column(c)[c]).sqrt());
                return Some((motion, product, sigma));
            }
        }
        None
    }

    fn followed(&self, image: &Image, starts: &[Affine]) -> Option<(Affine, [f64; 2])> {
        let mut best: Option<(Affine, f64, [f64; 2])> = None;
        for start in starts {
            let Some((near, [_, second])) = self.nearby(image, start) else { continue };
            let Some(found) = self.iterated(image, &near) else { continue };
            if found.1 >= FOUND.max(second + UNIQUE) && best.as_ref().is_none_or(|best| found.1 > best.1) {
                best = Some(found);
            }
        }
        best.map(|(motion, _, sigma)| (motion, sigma))
    }
}

/// The values with their mean taken off, divided by their length, which comes with them; none where all are alike.
fn normalised(mut values: Vec<f64>) -> Option<(Vec<f64>, f64)> {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    values.iter_mut().for_each(|v| *v -= mean);
    let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    values.iter_mut().for_each(|v| *v /= length);
    (length > 0.0).then_some((values, length))
}

/// Grey level between pixels and its gradient, by cubic convolution (Keys 1981); none where it would reach beyond the image.
fn cubic(image: &Image, [x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let [i, j] = [x.floor(), y.floor()];
    let inside = i >= 1.0 && j >= 1.0 && i + 2.0 < image.width() as f64 && j + 2.0 < image.height() as f64;
    if !inside {
        return None;
    }
    let weights = |t: f64| {
        let (t2, t3) = (t * t, t * t * t);
        let value =
            [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2];
        let slope = [-1.5 * t2 + 2.0 * t - 0.5, 4.5 * t2 - 5.0 * t, -4.5 * t2 + 4.0 * t + 0.5, 1.5 * t2 - t];
        (value, slope)
    };
    let ((wx, sx), (wy, sy)) = (weights(x - i), weights(y - j));
    let mut sum = [0.0; 3];
    for b in 0..4 {
        for a in 0..4 {
            let grey = f64::from(image.grey(i as usize + a - 1, j as usize + b - 1));
            sum = [sum[0] + wx[a] * wy[b] * grey, sum[1] + sx[a] * wy[b] * grey, sum[2] + wx[a] * sy[b] * grey];
        }
    }
    Some(sum)
}

/// The pixels of `of_zone` in the elements around a node.
fn pixels_around(mesh: &Mesh<Px>, elements: &[usize], of_zone: &PixelSet) -> Vec<[f64; 2]> {
    let mut found = Vec::new();
    for &element in elements {
        let corners = mesh.corners(element);
        let range = |c: usize| {
            let of = |f: fn(f64, f64) -> f64, from: f64| corners.iter().map(|p| p[c]).fold(from, f);
            of(f64::min, f64::INFINITY).ceil().max(0.0) as usize..=of(f64::max, 0.0).floor() as usize
        };
        let holds = |x: f64, y: f64| {
            let side = |k: usize| {
                let (a, b) = (corners[k], corners[(k + 1) % 4]);
                (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
            };
            // Of two elements with a common edge both would have the pixels on it.
            (0..4).all(|k| side(k) >= 0.0) || (0..4).all(|k| side(k) <= 0.0)
        };
        for (y, x) in range(1).flat_map(|y| range(0).map(move |x| (y, x))) {
            if of_zone.contains(x, y) && holds(x as f64, y as f64) {
                found.push([x as f64, y as f64]);
            }
        }
    }
    found.sort_by(|a, b| a[1].total_cmp(&b[1]).then(a[0].total_cmp(&b[0])));
    found.dedup();
    found
}

/// Follows the nodes on the faces of cuts (`doubled`) that see texture (`sees`) and all of whose elements are `gone`, from the `displacement` of
/// those that were measured, from where the frame was started (`expected`: the frames before), and from each other.
pub(super) fn followed(
    [reference, deformed]: [&Image; 2],
    mesh: &Mesh<Px>,
    doubled: &BTreeSet<usize>,
    zone_pixels: &[PixelSet],
    [measured, sees, gone]: [&[bool]; 3],
    displacement: &[[f64; 2]],
    expected: Option<&[[f64; 2]]>,
) -> Vec<Followed> {
    let mut waiting: BTreeMap<usize, (Patch, Vec<usize>)> = BTreeMap::new();
    let mut around: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for node in doubled.iter().copied().filter(|&node| !measured[node] && sees[node]) {
        around.insert(node, Vec::new());
    }
    if around.is_empty() {
        return Vec::new();
    }
    for (element, nodes) in mesh.elements().iter().enumerate() {
        let corners = if nodes[2] == nodes[3] { &nodes[..3] } else { &nodes[..] };
        for &node in corners {
            if let Some(elements) = around.get_mut(&(node as usize)) {
                elements.push(element);
            }
        }
    }
    // Who has an element left and was not measured has no texture beyond the noise.
    around.retain(|_, elements| elements.iter().all(|&element| gone[element]));
    for (node, elements) in around {
        let zone = &zone_pixels[mesh.node_zone()[node] as usize];
        let pixels = pixels_around(mesh, &elements, zone);
        let mut beside: Vec<usize> =
            elements.iter().flat_map(|&element| mesh.elements()[element].map(|node| node as usize)).collect();
        beside.sort_unstable();
        beside.dedup();
        if let Some(patch) = Patch::new(mesh.nodes()[node], pixels, reference) {
            waiting.insert(node, (patch, beside));
        }
    }
    let mut found: BTreeMap<usize, (Affine, [f64; 2])> = BTreeMap::new();
    let mut tried_alone = false;
    loop {
        let mut now = Vec::new();
        for (&node, (patch, beside)) in &waiting {
            let x = mesh.nodes()[node];
            // What is beside it on its own side, and in the first round where the field around would have it.
            let by_found = beside.iter().filter_map(|other| found.get(other)).map(|(motion, _)| motion.about(x));
            let by_measured = beside.iter().filter(|&&other| measured[other]).map(|&other| displacement[other]);
            let alone = by_measured.chain([displacement[node]]).map(|u| Affine::shift(x, u));
            // As in the frames before: the nodes beside it on the face tell how it turns and stretches.
            let before = expected.and_then(|expected| {
                let face = beside.iter().copied().filter(|other| doubled.contains(other));
                let along = |&k: &usize| mesh.nodes()[k][0] + 1e-3 * mesh.nodes()[k][1];
                let (low, high) = face.fold((node, node), |(low, high), k| {
                    (if along(&k) < along(&low) { k } else { low }, if along(&k) > along(&high) { k } else { high })
                });
                let at = |k: usize| (mesh.nodes()[k], expected[k]);
                (low != high).then(|| Affine::turned(x, expected[node], [at(low), at(high)]))
            });
            let alone = alone.chain(before);
            let starts: Vec<Affine> = match tried_alone {
                true => by_found.collect(),
                false => alone.collect(),
            };
            if let Some(result) = patch.followed(deformed, &starts) {
                now.push((node, result));
            }
        }
        if now.is_empty() && tried_alone {
            break;
        }
        tried_alone = true;
        for (node, result) in now {
            waiting.remove(&node);
            found.insert(node, result);
        }
    }
    let of = |(node, (motion, sigma)): (usize, (Affine, [f64; 2]))| Followed {
        node,
        displacement: [motion.p[0], motion.p[1]],
        sigma,
    };
    found.into_iter().map(of).collect()
}
