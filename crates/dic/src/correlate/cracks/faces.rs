//! The faces of a cut where a frame does not match: their nodes are followed one by one, each by the pixels around it
//! on its own side, with a gain, an offset and an affine motion of their own (docs/correlation.md, 2.12).
//!
//! Beside a crack that opens wide, light, turn and stretch change from element to element.

use crate::imaging::Image;
use crate::linalg::Dense;
use crate::mesh::{Mesh, PixelSet};
use crate::units::Px;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// Correlation coefficient from which on the pixels around a node are found.
const FOUND: f64 = 0.9;
/// and by which they have to be better there than anywhere else nearby.
const UNIQUE: f64 = 0.1;
/// Whole pixels around a start that are tried, each way, and how near to the best another place counts as the same.
const REACH: i32 = 10;
const SAME: i32 = 3;
/// Pixels are taken up to so many element sizes from a node, the second where the first do not find it.
const AROUND: [f64; 2] = [1.5, 2.0];
/// Nearer to the cut than this, px, they see what lies behind it, and a path is drawn by hand.
const BESIDE_CUT_PX: f64 = 2.0;
/// Pixels that are needed, and the unknowns that they have: six of the motion, four of the light.
const PIXELS: usize = 80;
const UNKNOWNS: f64 = 10.0;
/// and so many are enough for the search by whole pixels.
const THIN: usize = 150;
/// Iterations, and the correction at which they end, px.
const ITERATIONS: usize = 40;
const TOLERANCE_PX: f64 = 1e-3;
/// Largest displacement gradient, and how far from the place that was found by whole pixels it may end, px.
const STEEPEST: f64 = 0.6;
const AWAY_PX: f64 = 2.0;
/// Starts that are nearer to each other lead to the same place: by this displacement, px, and this gradient.
const SAME_START: (f64, f64) = (4.0, 0.05);
/// Two neighbours have to be where the motion of both has them, px: true ones of a real crack differ by up to 2, false
/// ones by 3.
const AGREE_PX: f64 = 2.5;
/// What is left is no white noise but of the size of speckles: it counts so many times in the standard uncertainty.
const COLOURED: f64 = 2.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Followed {
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

    /// Whether the search from both would see the same.
    fn is_like(&self, other: &Self) -> bool {
        let (px, gradient) = SAME_START;
        self.p.iter().zip(other.p).enumerate().all(|(k, (a, b))| (a - b).abs() < if k < 2 { px } else { gradient })
    }

    fn about(&self, x: [f64; 2]) -> Self {
        let ([x0, y0], [.., a, b, c, d]) = (self.at(x), self.p);
        Self { about: x, p: [x0, y0, a, b, c, d] }
    }
}

/// The pixels around a node on its own side, with their grey levels in the reference: without their plane and of length
/// 1. Light that changes with the place (out of the shadow of a loading block) is a plane, to first order.
struct Patch {
    about: [f64; 2],
    pixels: Vec<[f64; 2]>,
    /// Every second of its columns and rows, for the search by whole pixels.
    thin: Option<Box<Self>>,
    /// Orthonormal values of 1, x and y over the pixels.
    planes: [Vec<f64>; 3],
    grey: Vec<f64>,
}

impl Patch {
    fn new(about: [f64; 2], pixels: Vec<[f64; 2]>, reference: &Image) -> Option<Self> {
        let thinned: Vec<_> = pixels.iter().copied().filter(|p| p[0] % 2.0 == 0.0 && p[1] % 2.0 == 0.0).collect();
        let thin = if thinned.len() >= THIN { Self::of_all(about, thinned, reference).map(Box::new) } else { None };
        Some(Self { thin, ..Self::of_all(about, pixels, reference)? })
    }

    fn of_all(about: [f64; 2], pixels: Vec<[f64; 2]>, reference: &Image) -> Option<Self> {
        if pixels.len() < PIXELS {
            return None;
        }
        let of: [fn(&[f64; 2]) -> f64; 3] = [|_| 1.0, |p| p[0], |p| p[1]];
        let mut planes = of.map(|of| pixels.iter().map(of).collect::<Vec<f64>>());
        for k in 0..3 {
            let (before, rest) = planes.split_at_mut(k);
            before.iter().for_each(|plane| take_off(&mut rest[0], plane));
            scale(&mut rest[0])?;
        }
        let mut patch = Self { about, pixels, thin: None, planes, grey: Vec::new() };
        let grey = patch.pixels.iter().map(|p| f64::from(reference.grey(p[0] as usize, p[1] as usize))).collect();
        patch.grey = patch.normalise(grey)?.0;
        Some(patch)
    }

    /// The values without their plane, divided by their length, which comes with them; none where nothing is left.
    fn normalise(&self, mut values: Vec<f64>) -> Option<(Vec<f64>, f64)> {
        self.planes.iter().for_each(|plane| take_off(&mut values, plane));
        let length = scale(&mut values)?;
        Some((values, length))
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
        let (grey, _) = self.normalise(grey)?;
        Some(self.grey.iter().zip(&grey).map(|(f, g)| f * g).sum())
    }

    /// The best place around `start` by whole pixels, and the coefficient at the best place that is another one.
    fn search_nearby(&self, image: &Image, start: &Affine) -> Option<(Affine, f64)> {
        let thin = self.thin.as_deref().unwrap_or(self);
        let steps = || (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| [x, y]));
        let tried: Vec<([i32; 2], f64)> =
            steps().filter_map(|step| Some((step, thin.coefficient(image, start, step)?))).collect();
        let (best, _) = tried.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let other = |step: &[i32; 2]| (0..2).any(|c| (step[c] - best[c]).abs() > SAME);
        let second = tried.iter().filter(|(step, _)| other(step)).map(|(_, c)| *c).fold(-1.0, f64::max);
        let mut motion = *start;
        (0..2).for_each(|c| motion.p[c] += f64::from(best[c]));
        Some((motion, second))
    }

    /// Least squares, from `start`, of grey levels without plane and of length 1: motion, coefficient, uncertainty.
    fn iterate(&self, image: &Image, start: &Affine) -> Option<(Affine, f64, [f64; 2])> {
        let mut motion = *start;
        for _ in 0..ITERATIONS {
            let mut slopes: [Vec<f64>; 6] = std::array::from_fn(|_| Vec::with_capacity(self.pixels.len()));
            let mut grey = Vec::with_capacity(self.pixels.len());
            for p in &self.pixels {
                let u = motion.at(*p);
                let [g, gx, gy] = cubic(image, [p[0] + u[0], p[1] + u[1]])?;
                let d = [p[0] - self.about[0], p[1] - self.about[1]];
                let of_pixel = [gx, gy, gx * d[0], gx * d[1], gy * d[0], gy * d[1]];
                slopes.iter_mut().zip(of_pixel).for_each(|(slope, value)| slope.push(value));
                grey.push(g);
            }
            let (grey, length) = self.normalise(grey)?;
            // Plane and length of the deformed grey levels follow the motion as well.
            for slope in &mut slopes {
                self.planes.iter().for_each(|plane| take_off(slope, plane));
                take_off(slope, &grey);
                slope.iter_mut().for_each(|s| *s /= length);
            }
            let (mut matrix, mut right) = ([[0.0; 6]; 6], [0.0; 6]);
            let (mut square, mut product) = (0.0, 0.0);
            for (k, (f, g)) in self.grey.iter().zip(&grey).enumerate() {
                let left = f - g;
                (square, product) = (square + left * left, product + f * g);
                for i in 0..6 {
                    right[i] += slopes[i][k] * left;
                    (0..6).for_each(|j| matrix[i][j] += slopes[i][k] * slopes[j][k]);
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
                let variance = square / (self.pixels.len() as f64 - UNKNOWNS);
                let sigma = [0, 1].map(|c| COLOURED * (variance * inverse.column(c)[c]).sqrt());
                return Some((motion, product, sigma));
            }
        }
        None
    }

    fn follow(&self, image: &Image, starts: &[Affine]) -> Option<(Affine, [f64; 2])> {
        let mut best: Option<(Affine, f64, [f64; 2])> = None;
        for (k, start) in starts.iter().enumerate() {
            if starts[..k].iter().any(|before| before.is_like(start)) {
                continue;
            }
            let Some((near, second)) = self.search_nearby(image, start) else { continue };
            let Some(found) = self.iterate(image, &near) else { continue };
            if found.1 >= FOUND.max(second + UNIQUE) && best.as_ref().is_none_or(|best| found.1 > best.1) {
                best = Some(found);
            }
        }
        best.map(|(motion, _, sigma)| (motion, sigma))
    }
}

/// Takes off what the values have of others of length 1.
fn take_off(values: &mut [f64], unit: &[f64]) {
    let along: f64 = values.iter().zip(unit).map(|(v, u)| v * u).sum();
    values.iter_mut().zip(unit).for_each(|(v, u)| *v -= along * u);
}

/// Divides the values by their length and gives it; none where it is zero.
fn scale(values: &mut [f64]) -> Option<f64> {
    let length = values.iter().map(|v| v * v).sum::<f64>().sqrt();
    values.iter_mut().for_each(|v| *v /= length);
    (length > 0.0).then_some(length)
}

/// Grey level between pixels and its gradient, by cubic convolution (Keys 1981); none where it would reach outside.
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

fn nodes_of(mesh: &Mesh<Px>, elements: &[usize]) -> Vec<usize> {
    let nodes = elements.iter().flat_map(|&element| mesh.elements()[element].map(|node| node as usize));
    BTreeSet::from_iter(nodes).into_iter().collect()
}

/// The edges of elements that lie on a cut: both ends are `doubled`.
fn cut_edges(mesh: &Mesh<Px>, elements: &[usize], doubled: &BTreeSet<usize>) -> Vec<[[f64; 2]; 2]> {
    let of_element = |&element: &usize| {
        let nodes = mesh.elements()[element].map(|node| node as usize);
        (0..4).map(move |k| [nodes[k], nodes[(k + 1) % 4]])
    };
    let on_cut = |[a, b]: &[usize; 2]| a != b && doubled.contains(a) && doubled.contains(b);
    elements.iter().flat_map(of_element).filter(on_cut).map(|edge| edge.map(|node| mesh.nodes()[node])).collect()
}

fn distance(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let (d, r) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let along = ((r[0] * d[0] + r[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
    (r[0] - along * d[0]).hypot(r[1] - along * d[1])
}

/// A node not yet followed: the pixels around it, more of them where these do not find it, and the nodes beside it.
struct Waiting {
    patches: Vec<Patch>,
    beside: Vec<usize>,
}

impl Waiting {
    /// The nodes of `doubled` that see texture (`sees`), were not measured and all of whose elements are `gone`.
    fn nodes(
        reference: &Image,
        mesh: &Mesh<Px>,
        doubled: &BTreeSet<usize>,
        zone_pixels: &[PixelSet],
        [measured, sees, gone]: [&[bool]; 3],
    ) -> BTreeMap<usize, Self> {
        let lost = |node: &usize| !measured[*node] && sees[*node];
        if !doubled.iter().any(lost) {
            return BTreeMap::new();
        }
        let mut elements_at: Vec<Vec<usize>> = vec![Vec::new(); mesh.n_nodes()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            let corners = if nodes[2] == nodes[3] { &nodes[..3] } else { &nodes[..] };
            corners.iter().for_each(|&node| elements_at[node as usize].push(element));
        }
        // Who has an element left and was not measured has no texture beyond the noise.
        let all_gone = |node: &usize| elements_at[*node].iter().all(|&element| gone[element]);
        let of_node = |&node: &usize| {
            let beside = nodes_of(mesh, &elements_at[node]);
            // The elements around it and those around these: a cut parts them, so that they are on its side.
            let elements = beside.iter().flat_map(|&other| elements_at[other].iter().copied());
            let elements: Vec<usize> = BTreeSet::from_iter(elements).into_iter().collect();
            let about = mesh.nodes()[node];
            let edges = cut_edges(mesh, &elements, doubled);
            let mut pixels = pixels_around(mesh, &elements, &zone_pixels[mesh.node_zone()[node] as usize]);
            pixels.retain(|&p| edges.iter().all(|&edge| distance(p, edge) >= BESIDE_CUT_PX));
            let within = |sizes: f64| {
                let farthest = sizes * mesh.element_size();
                let near = |p: &&[f64; 2]| (p[0] - about[0]).hypot(p[1] - about[1]) <= farthest;
                Patch::new(about, pixels.iter().filter(near).copied().collect(), reference)
            };
            (node, Self { patches: AROUND.iter().filter_map(|&sizes| within(sizes)).collect(), beside })
        };
        doubled.iter().filter(|node| lost(node) && all_gone(node)).map(of_node).collect()
    }
}

type Found = BTreeMap<usize, (Affine, [f64; 2])>;

/// Follows the nodes on the faces of cuts (`doubled`) that see texture (`sees`) and all of whose elements are `gone`:
/// from the `displacement` of those measured, from where the frame was started (`expected`), and from each other.
pub(crate) fn follow_nodes(
    [reference, deformed]: [&Image; 2],
    mesh: &Mesh<Px>,
    doubled: &BTreeSet<usize>,
    zone_pixels: &[PixelSet],
    [measured, sees, gone]: [&[bool]; 3],
    displacement: &[[f64; 2]],
    expected: Option<&[[f64; 2]]>,
) -> Vec<Followed> {
    let lost = Waiting::nodes(reference, mesh, doubled, zone_pixels, [measured, sees, gone]);
    let mut found = Found::new();
    let mut tried_alone = false;
    loop {
        let find = |(&node, Waiting { patches, beside }): (&usize, &Waiting)| {
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
            let starts: Vec<Affine> = if tried_alone { by_found.collect() } else { alone.chain(before).collect() };
            let motion = patches.iter().find_map(|patch| patch.follow(deformed, &starts))?;
            Some((node, motion))
        };
        let waiting: Vec<_> = lost.iter().filter(|(node, _)| !found.contains_key(node)).collect();
        let now: Vec<_> = waiting.into_par_iter().filter_map(find).collect();
        if now.is_empty() && tried_alone {
            break;
        }
        tried_alone = true;
        found.extend(now);
    }
    // The known nodes beside one that was found, and how far both disagree.
    let beside = |found: &Found, node: usize| -> Vec<(usize, f64)> {
        let known = |&other: &usize| other != node && (found.contains_key(&other) || measured[other]);
        let off = |other| (other, disagreement(mesh, found, displacement, node, other));
        lost[&node].beside.iter().copied().filter(known).map(off).collect()
    };
    for node in against_neighbours(&found, |node| beside(&found, node)) {
        found.remove(&node);
    }
    let of = |(&node, (motion, sigma)): (&usize, &(Affine, [f64; 2]))| {
        // What neighbours disagree by is not of the noise: light, or a motion that is not affine.
        let off = beside(&found, node);
        let square = off.iter().map(|(_, off)| off * off).sum::<f64>() / off.len().max(1) as f64;
        Followed {
            node,
            displacement: [motion.p[0], motion.p[1]],
            sigma: sigma.map(|sigma| (sigma * sigma + square).sqrt()),
        }
    };
    found.iter().map(of).collect()
}

/// How far two neighbours, the first of which was followed, are from where the motion of both has them, px.
fn disagreement(mesh: &Mesh<Px>, found: &Found, displacement: &[[f64; 2]], one: usize, other: usize) -> f64 {
    let (a, _) = &found[&one];
    let ahead = a.at(mesh.nodes()[other]);
    let off = |c: usize| match found.get(&other) {
        // By the mean of both gradients, which is exact for a parabola.
        Some((b, _)) => 0.5 * ((ahead[c] - b.p[c]) - (b.at(mesh.nodes()[one])[c] - a.p[c])),
        None => ahead[c] - displacement[other][c],
    };
    off(0).hypot(off(1))
}

/// The nodes of `found` that do not agree with their neighbours: of groups of nodes that agree the smaller ones beside
/// a larger one. Where the edge of a face is brighter than its texture, the edge may be found anywhere along it.
fn against_neighbours(found: &Found, beside: impl Fn(usize) -> Vec<(usize, f64)>) -> Vec<usize> {
    let followed = |node: usize| beside(node).into_iter().filter(|(other, _)| found.contains_key(other));
    // A group is named by its first node.
    let mut group: BTreeMap<usize, usize> = BTreeMap::new();
    let mut size: BTreeMap<usize, usize> = BTreeMap::new();
    for &first in found.keys() {
        if group.contains_key(&first) {
            continue;
        }
        let mut open = vec![first];
        group.insert(first, first);
        while let Some(node) = open.pop() {
            *size.entry(first).or_default() += 1;
            for (other, _) in followed(node).filter(|(_, off)| *off < AGREE_PX) {
                if group.insert(other, first).is_none() {
                    open.push(other);
                }
            }
        }
    }
    let larger = |own: usize, other: usize| size[&group[&other]] > size[&own];
    let beaten: BTreeSet<usize> = found
        .keys()
        .filter(|node| followed(**node).any(|(other, _)| larger(group[node], other)))
        .map(|node| group[node])
        .collect();
    found.keys().copied().filter(|node| beaten.contains(&group[node])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nodes from 1 on side by side, of which neighbours disagree by what is given.
    fn against(off: &[f64]) -> Vec<usize> {
        let (motion, last) = ((Affine::shift([0.0; 2], [0.0; 2]), [0.1; 2]), off.len() + 1);
        let found: Found = (1..=last).map(|node| (node, motion)).collect();
        against_neighbours(&found, |node| {
            let before = (node > 1).then(|| (node - 1, off[node - 2]));
            before.into_iter().chain((node < last).then(|| (node + 1, off[node - 1]))).collect()
        })
    }

    #[test]
    fn of_nodes_that_disagree_the_smaller_group_is_not_measured() {
        assert!(against(&[0.3; 4]).is_empty());
        assert_eq!(against(&[3.0, 0.1, 0.1, 0.1]), [1]);
        assert_eq!(against(&[0.1, 3.0, 0.1, 0.1]), [1, 2]);
        // The last one is at odds with nobody but one who is wrong.
        assert_eq!(against(&[0.1, 0.1, 3.0, 3.0]), [4]);
        // Nobody can tell which of two is right.
        assert!(against(&[9.0]).is_empty());
    }
}
