//! Opening and sliding between two zones along the edges that face each other.

use super::{NodalNoise, QuantityError, Reading, Value};
use crate::field::Measurement;
use crate::mesh::Mesh;
use crate::plane::{cross, distance, dot, minus, unit};
use crate::units::Length;
use std::collections::HashMap;

/// Cosine of the largest angle between the outward normal of an edge and the way to the other zone at which the
/// edge still looks at it: 72 degrees, so that one side of each stair of a cut grid does.
const LOOKS_AT: f64 = 0.3;
/// Up to so many edges between edges that look across belong to the face as well: the other sides of stairs.
const STAIR: usize = 3;
/// Cosine of the turn between two edges above which a face is no stair there: 30 degrees.
const SMOOTH: f64 = 0.866;
/// Edges on either side over which the direction of a stair is taken.
const STAIR_WINDOW: usize = 4;
/// Edges on either side of a corner, which has a direction of its own on each: a stair turns back, a corner does not.
const CORNER_WINDOW: usize = 3;
/// Cosine of the angle between both directions: 60 degrees.
const CORNER: f64 = 0.5;
/// Cosine above which an edge looks straight at the other zone.
const STRAIGHT: f64 = 0.9;

/// Pairs of facing points of two zones, `+` (the first, "upper") and `-` (the second, "lower").
///
/// There is a point for each node of the face of `+` that sees the face of `-` across the gap, along the bisector of
/// both normals. The faces are found from the borders of the zones: straight or curved, of any direction,
/// also in several parts; the stairs of a grid cut by a mask are smoothed.
#[derive(Debug, Clone, PartialEq)]
pub struct Facing {
    points: Vec<FacingPoint>,
}

/// A place of the joint between two zones: a node of `+`, and the point of the face of `-` opposite to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacingPoint {
    /// Part of the joint, from 0, where zones face each other in several places.
    pub part: usize,
    /// Distance along the mid-line from the first point of the part.
    pub along: f64,
    /// Half-way between both faces, in the reference.
    pub at: [f64; 2],
    /// Distance of the faces in the reference.
    pub gap: f64,
    /// Unit normal, from `-` to `+`; its tangent is `(-n_y, n_x)`. In the image y points down: for a horizontal joint
    /// with `+` above, the normal is (0, -1) and the tangent (1, 0).
    pub normal: [f64; 2],
    plus: usize,
    minus: [(usize, f64); 2],
}

/// The jump of the displacement between two zones.
///
/// A rotation of the whole specimen carries two faces that stand a gap apart past each other: sliding without
/// any. [`remove_rigid`](crate::field::remove_rigid) with the motion of all nodes takes it off exactly: what
/// is left is `R^T (d + jump) - d`, with `d` from the point of `-` to that of `+`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// Jump `+` minus `-` along the normal from `-` to `+`: positive when the zones move apart.
    pub opening: Value,
    /// Jump `+` minus `-` along the tangent: for a horizontal joint with `+` above, positive when `+` moved along x.
    pub sliding: Value,
}

impl FacingPoint {
    /// Unit tangent.
    pub fn tangent(&self) -> [f64; 2] {
        [-self.normal[1], self.normal[0]]
    }

    /// The node of `+`.
    pub fn node(&self) -> usize {
        self.plus
    }

    /// `direction . (u+ - u-)` as a sum over nodes: of the coefficients as they stand.
    pub fn jump(&self, direction: [f64; 2]) -> Reading {
        let minus = self.minus.map(|(node, w)| (node, direction.map(|d| -w * d)));
        Reading::new([(self.plus, direction)].into_iter().chain(minus))
    }

    /// The same of the values at both points, as `noise` makes them.
    fn jump_at<U: Length>(&self, mesh: &Mesh<U>, noise: &NodalNoise, direction: [f64; 2]) -> Reading {
        let signed = |shape: &[(usize, f64)], sign: f64| {
            noise.at(mesh, shape).into_iter().map(move |(node, w)| (node, direction.map(|d| sign * w * d)))
        };
        Reading::new(signed(&[(self.plus, 1.0)], 1.0).chain(signed(&self.minus, -1.0)))
    }

    /// Opening and sliding here; `None` when a node on either side is not measured.
    ///
    /// The zones share no pixel: variances of both sides add; on each, nodes are correlated as in `noise`.
    pub fn read<U: Length>(&self, field: &Measurement<U>, noise: &NodalNoise) -> Option<Jump> {
        let along = |direction| self.jump_at(&field.mesh, noise, direction).read(field, noise);
        Some(Jump { opening: along(self.normal)?, sliding: along(self.tangent())? })
    }
}

impl Facing {
    /// The facing edges of two zones, by name.
    ///
    /// # Errors
    /// A name that no zone has, one zone twice, zones that do not face each other.
    pub fn between<U: Length>(mesh: &Mesh<U>, plus: &str, minus: &str) -> Result<Self, QuantityError> {
        let number = |name: &str| {
            mesh.zones()
                .iter()
                .position(|zone| zone == name)
                .ok_or_else(|| QuantityError::NoSuchZone(name.to_owned(), mesh.zones().join(", ")))
        };
        let zones = [number(plus)?, number(minus)?];
        if zones[0] == zones[1] {
            return Err(QuantityError::OneZone { zone: plus.to_owned() });
        }
        let borders: Vec<Border> = (0..mesh.zones().len()).map(|zone| Border::new(mesh, zone)).collect();
        let faces = [0, 1].map(|k| borders[zones[k]].facing(&borders[zones[1 - k]], &borders));
        let points = pairs(&borders[zones[0]], &faces[0], &borders[zones[1]], &faces[1]);
        if points.is_empty() {
            return Err(QuantityError::NotFacing(plus.to_owned(), minus.to_owned()));
        }
        Ok(Self { points })
    }

    /// The points, part after part, along the tangent in each.
    pub fn points(&self) -> &[FacingPoint] {
        &self.points
    }

    /// Mean opening and sliding over the measured points, if any, with the uncertainty of correlated neighbours.
    pub fn mean<U: Length>(&self, field: &Measurement<U>, noise: &NodalNoise) -> Option<Jump> {
        let measured: Vec<&FacingPoint> =
            self.points.iter().filter(|point| point.jump(point.normal).value(field).is_some()).collect();
        if measured.is_empty() {
            return None;
        }
        let n = measured.len() as f64;
        let mean = |direction: fn(&FacingPoint) -> [f64; 2]| {
            let jumps = measured.iter().flat_map(|point| {
                let jump = point.jump_at(&field.mesh, noise, direction(point).map(|d| d / n));
                jump.weights().to_vec()
            });
            Reading::new(jumps).read(field, noise)
        };
        Some(Jump { opening: mean(|point| point.normal)?, sliding: mean(FacingPoint::tangent)? })
    }
}

/// The border of a zone: closed loops of edges.
struct Border {
    edges: Vec<Edge>,
    /// The edges of each loop, in order.
    loops: Vec<Vec<usize>>,
}

#[derive(Clone, Copy)]
struct Edge {
    nodes: [usize; 2],
    ends: [[f64; 2]; 2],
    /// Unit, out of the zone.
    normal: [f64; 2],
}

impl Border {
    fn new<U: Length>(mesh: &Mesh<U>, zone: usize) -> Self {
        let at = |node: u32| mesh.nodes()[node as usize];
        let edges: Vec<Edge> = mesh
            .boundary(zone)
            .into_iter()
            .map(|[a, b]| {
                let ends = [at(a), at(b)];
                // Going along an edge the zone is on the side of +y when x is ahead.
                let [dx, dy] = unit(minus(ends[1], ends[0]));
                Edge { nodes: [a as usize, b as usize], ends, normal: [dy, -dx] }
            })
            .collect();
        let mut starting: HashMap<usize, Vec<usize>> = HashMap::new();
        for (edge, Edge { nodes, .. }) in edges.iter().enumerate() {
            starting.entry(nodes[0]).or_default().push(edge);
        }
        let mut taken = vec![false; edges.len()];
        let mut loops = Vec::new();
        for first in 0..edges.len() {
            let mut ring = Vec::new();
            let mut next = (!taken[first]).then_some(first);
            while let Some(edge) = next {
                taken[edge] = true;
                ring.push(edge);
                // Where two elements touch in one node only, either way closes a loop.
                next = starting[&edges[first].nodes[0]]
                    .first()
                    .and(starting.get(&edges[edge].nodes[1]))
                    .and_then(|out| out.iter().copied().find(|&edge| !taken[edge]));
            }
            if !ring.is_empty() {
                loops.push(ring);
            }
        }
        Self { edges, loops }
    }

    /// The faces that look at `other`: runs of edges in order, one for each part.
    fn facing(&self, other: &Border, all: &[Border]) -> Vec<Vec<usize>> {
        let looks: Vec<Look> = self.edges.iter().map(|edge| look(edge, other, all)).collect();
        let mut faces = Vec::new();
        for ring in &self.loops {
            for mut side in self.sides(ring) {
                // A ring without corner begins where it does not look across.
                if let Some(start) = side.iter().position(|&edge| !looks[edge].sees()).filter(|_| self.is_closed(&side))
                {
                    side.rotate_left(start);
                }
                let mut sees: Vec<bool> = side.iter().map(|&edge| looks[edge].sees()).collect();
                // Close short interruptions: the other sides of stairs.
                let seeing: Vec<usize> = (0..side.len()).filter(|&k| sees[k]).collect();
                for two in seeing.windows(2).filter(|two| two[1] - two[0] <= STAIR + 1) {
                    sees[two[0]..two[1]].fill(true);
                }
                let mut start = 0;
                for run in sees.chunk_by(|a, b| a == b) {
                    if run[0] {
                        faces.push(side[start..start + run.len()].to_vec());
                    }
                    start += run.len();
                }
            }
        }
        // Corners of zones that stand diagonally see each other; that is no joint.
        faces.retain(|face| {
            let ends = [self.edges[face[0]].ends[0], self.edges[face[face.len() - 1]].ends[1]];
            let gap = face.iter().map(|&edge| looks[edge].gap).fold(f64::INFINITY, f64::min);
            let straight = face.iter().any(|&edge| looks[edge].cosine > STRAIGHT);
            straight || self.is_closed(face) || distance(ends[0], ends[1]) > gap
        });
        faces
    }

    fn is_closed(&self, face: &[usize]) -> bool {
        face.len() > 2 && self.edges[face[0]].nodes[0] == self.edges[face[face.len() - 1]].nodes[1]
    }

    /// A loop cut at its corners into sides; whole when it has none.
    fn sides(&self, ring: &[usize]) -> Vec<Vec<usize>> {
        let n = ring.len();
        let edge = |k: usize| &self.edges[ring[k % n]];
        let is_corner = |k: usize| {
            let chord = |from: usize, to: usize| unit(minus(edge(to).ends[1], edge(from).ends[0]));
            let (before, after) = (chord(k + n - CORNER_WINDOW, k + n - 1), chord(k, k + CORNER_WINDOW - 1));
            dot(edge(k + n - 1).normal, edge(k).normal) < SMOOTH && dot(before, after) < CORNER
        };
        let corners: Vec<usize> = (0..n).filter(|&k| n > CORNER_WINDOW && is_corner(k)).collect();
        let Some(&first) = corners.first() else { return vec![ring.to_vec()] };
        let ends = corners[1..].iter().copied().chain([first + n]);
        corners.iter().zip(ends).map(|(&from, to)| (from..to).map(|k| ring[k % n]).collect()).collect()
    }

    /// The nodes of a face in order, each with its position and outward normal.
    fn nodes_of(&self, face: &[usize]) -> Vec<(usize, [f64; 2], [f64; 2])> {
        let n = face.len();
        let edge = |k: usize| &self.edges[face[k]];
        let closed = self.is_closed(face);
        let n_nodes = if closed { n } else { n + 1 };
        // Sum of the normals of the edges around a node, weighted by their lengths: that of the chord.
        let chord = |node: usize, window: usize| {
            let mut sum = [0.0; 2];
            for k in 0..2 * window {
                let at = (node + k).wrapping_sub(window) as isize;
                let at = if closed { at.rem_euclid(n as isize) } else { at };
                if let Some(edge) = usize::try_from(at).ok().filter(|&at| at < n).map(edge) {
                    let [a, b] = edge.ends;
                    let length = distance(b, a);
                    sum = [sum[0] + length * edge.normal[0], sum[1] + length * edge.normal[1]];
                }
            }
            unit(sum)
        };
        let turns = |node: usize| {
            let before = if node > 0 { Some(node - 1) } else { closed.then(|| n - 1) };
            before.filter(|_| node < n).is_some_and(|before| dot(edge(before).normal, edge(node).normal) < SMOOTH)
        };
        (0..n_nodes)
            .map(|node| {
                let window = node.saturating_sub(STAIR_WINDOW)..(node + STAIR_WINDOW + 1).min(n_nodes);
                let stair = window.clone().any(turns);
                let (number, at) = match node < n {
                    true => (edge(node).nodes[0], edge(node).ends[0]),
                    false => (edge(n - 1).nodes[1], edge(n - 1).ends[1]),
                };
                (number, at, chord(node, if stair { STAIR_WINDOW } else { 1 }))
            })
            .collect()
    }
}

/// What an edge sees of the other zone.
#[derive(Clone, Copy)]
struct Look {
    /// Cosine of the angle between its outward normal and the way to the nearest point of the other zone.
    cosine: f64,
    /// Distance of that point.
    gap: f64,
    /// Whether nothing stands between.
    free: bool,
}

impl Look {
    fn sees(&self) -> bool {
        self.free && self.cosine > LOOKS_AT
    }
}

fn look(edge: &Edge, other: &Border, all: &[Border]) -> Look {
    let middle = [0, 1].map(|c| 0.5 * (edge.ends[0][c] + edge.ends[1][c]));
    let points = other.edges.iter().map(|theirs| nearest_on(theirs, middle));
    let Some(there) = points.min_by(|a, b| distance(*a, middle).total_cmp(&distance(*b, middle))) else {
        return Look { cosine: -1.0, gap: f64::INFINITY, free: false };
    };
    let cosine = dot(unit(minus(there, middle)), edge.normal);
    let walls = || all.iter().flat_map(|border| &border.edges).filter(|wall| wall.nodes != edge.nodes);
    let free = cosine > LOOKS_AT && !walls().any(|wall| crosses(middle, there, wall));
    Look { cosine, gap: distance(there, middle), free }
}

fn nearest_on(edge: &Edge, point: [f64; 2]) -> [f64; 2] {
    let [a, b] = edge.ends;
    let along = minus(b, a);
    let t = (dot(minus(point, a), along) / dot(along, along).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    [a[0] + t * along[0], a[1] + t * along[1]]
}

/// Whether the open segment from `a` to `b` meets the edge.
fn crosses(a: [f64; 2], b: [f64; 2], wall: &Edge) -> bool {
    const INSIDE: std::ops::Range<f64> = 1e-6..1.0 - 1e-6;
    meeting(a, minus(b, a), wall).is_some_and(|(s, t)| INSIDE.contains(&s) && (0.0..=1.0).contains(&t))
}

/// Where the line `from + s direction` meets the line of the edge: `s`, and the share of the edge.
fn meeting(from: [f64; 2], direction: [f64; 2], edge: &Edge) -> Option<(f64, f64)> {
    let along = minus(edge.ends[1], edge.ends[0]);
    let det = cross(direction, along);
    if det.abs() <= 1e-12 * direction[0].hypot(direction[1]) * along[0].hypot(along[1]) {
        return None;
    }
    let to = minus(edge.ends[0], from);
    Some((cross(to, along) / det, cross(to, direction) / det))
}

/// Each node of the faces of `plus` with the point that it sees on `minus`.
fn pairs(plus: &Border, faces: &[Vec<usize>], lower: &Border, lower_faces: &[Vec<usize>]) -> Vec<FacingPoint> {
    let mut normals: HashMap<usize, [f64; 2]> = HashMap::new();
    for face in lower_faces {
        normals.extend(lower.nodes_of(face).into_iter().map(|(node, _, normal)| (node, normal)));
    }
    // The face of `minus` that `from` sees in this direction, with the share of its edge.
    let hit = |from: [f64; 2], direction: [f64; 2]| {
        const SLACK: f64 = 1e-6; // nodes exactly opposite to the end of a face see that end
        lower_faces
            .iter()
            .flatten()
            .map(|&edge| &lower.edges[edge])
            .filter(|edge| dot(edge.normal, direction) < 0.0)
            .filter_map(|edge| Some((edge, meeting(from, direction, edge)?)))
            .filter(|(_, (s, t))| *s > 0.0 && (-SLACK..=1.0 + SLACK).contains(t))
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0))
            .map(|(edge, (s, t))| (edge, s, t.clamp(0.0, 1.0)))
    };
    let mut points = Vec::new();
    let mut part = 0;
    for face in faces {
        let mut found: Vec<FacingPoint> = Vec::new();
        for (node, at, outward) in plus.nodes_of(face) {
            let Some((edge, _, t)) = hit(at, outward) else { continue };
            let [a, b] = edge.nodes.map(|node| normals.get(&node).copied().unwrap_or(edge.normal));
            let theirs = unit([0, 1].map(|c| (1.0 - t) * a[c] + t * b[c]));
            // The bisector of both normals is that of the mid-line.
            let direction = unit(minus(outward, theirs));
            let Some((edge, gap, t)) = hit(at, direction) else { continue };
            found.push(FacingPoint {
                part,
                along: 0.0,
                at: [0, 1].map(|c| at[c] + 0.5 * gap * direction[c]),
                gap,
                normal: direction.map(|d| 0.0 - d), // no negative zero in tables
                plus: node,
                minus: [(edge.nodes[0], 1.0 - t), (edge.nodes[1], t)],
            });
        }
        let forward: f64 = found.windows(2).map(|two| dot(minus(two[1].at, two[0].at), two[0].tangent())).sum();
        if forward < 0.0 {
            found.reverse();
        }
        for k in 1..found.len() {
            found[k].along = found[k - 1].along + distance(found[k].at, found[k - 1].at);
        }
        if !found.is_empty() {
            points.append(&mut found);
            part += 1;
        }
    }
    points
}
