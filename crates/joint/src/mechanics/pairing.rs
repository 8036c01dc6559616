//! Which nodes face each other across the adhesive.

use super::{JointParts, MeshFault, border_edges, strips};
use std::collections::{HashMap, HashSet};

/// Share of the distance of two strips by which their heights may differ and still be one: round-off of their means.
const SAME_HEIGHT: f64 = 1e-6;

/// The interface elements between strips that share no node. Only nodes of `faces` are paired, if there are any.
///
/// Two border nodes of different strips are a pair when each is the other's nearest. An edge of one strip whose
/// two ends are paired with the ends of an edge of the other makes an element. The elements are checked.
pub(super) fn interfaces(parts: &JointParts) -> Result<Vec<[u32; 4]>, MeshFault> {
    let JointParts { nodes, elements, faces, .. } = parts;
    let strip = strips(nodes.len(), elements);
    let mut edges = border_edges(elements);
    if !faces.is_empty() {
        let faces: HashSet<u32> = faces.iter().copied().collect();
        edges.retain(|edge| edge.iter().all(|node| faces.contains(node)));
    }
    let mut border: Vec<u32> = edges.iter().flatten().copied().collect();
    border.sort_unstable();
    border.dedup();
    let n_strips = strip.iter().max().map_or(0, |&last| last as usize + 1);
    if n_strips < 2 {
        return Err(MeshFault::OneStrip);
    }
    let lower = Lower::new(parts, &strip, n_strips);
    let below = |a: u32, b: u32| lower.is(strip[a as usize], strip[b as usize]);
    let nearest = Nearest::new(nodes, &border, &strip);
    let partner: HashMap<u32, u32> = border.iter().filter_map(|&node| Some((node, nearest.of(node)?))).collect();
    let paired = |node: u32| partner.get(&node).copied().filter(|other| partner.get(other) == Some(&node));
    let upper_edges: HashSet<[u32; 2]> = edges.iter().copied().collect();
    let mut found = Vec::new();
    for &[a, b] in &edges {
        let (Some(pa), Some(pb)) = (paired(a), paired(b)) else { continue };
        if !below(a, pa) || strip[pa as usize] != strip[pb as usize] {
            continue;
        }
        // Counter-clockwise: the lower strip goes against the tangent along its upper face, the upper strip along
        // it on its lower face.
        if upper_edges.contains(&[pb, pa]) {
            found.push([b, a, pb, pa]);
        }
    }
    let faced: HashSet<u32> = found.iter().flatten().copied().collect();
    // A border node between two elements of a face that has no pair itself: the faces are cut differently.
    for edge in &edges {
        for (k, &node) in edge.iter().enumerate() {
            let other = edge[1 - k];
            if faced.contains(&other) && !faced.contains(&node) {
                // Leaving the face at its end, or a gap in it? In a gap the partner's face goes on as well.
                if let Some(&near) = partner.get(&node)
                    && faced.contains(&near)
                    && paired(node).is_none()
                    && along_face(nodes, &found, near, node)
                {
                    let [x, y] = nodes[node as usize];
                    return Err(MeshFault::FacesDoNotPair { node, x, y, near });
                }
            }
        }
    }
    if found.is_empty() {
        return Err(MeshFault::NoFaces);
    }
    Ok(in_line(nodes, found))
}

/// Which of two strips that face each other is the lower one.
struct Lower {
    /// Of each strip: whether it is of the group that is said to be lower; empty where none is.
    said: Vec<bool>,
    /// Mean position of each strip.
    mean: Vec<[f64; 2]>,
}

impl Lower {
    fn new(parts: &JointParts, strip: &[u32], n_strips: usize) -> Self {
        let mut mean = vec![[0.0; 3]; n_strips];
        for (&[x, y], &strip) in parts.nodes.iter().zip(strip) {
            let sum = &mut mean[strip as usize];
            *sum = [sum[0] + x, sum[1] + y, sum[2] + 1.0];
        }
        let mean = mean.into_iter().map(|[x, y, n]| [x / n, y / n]).collect();
        let mut said = Vec::new();
        if let Some(group) = parts.lower {
            said.resize(n_strips, false);
            for (corners, &of) in parts.elements.iter().zip(&parts.element_group) {
                said[strip[corners[0] as usize] as usize] |= of == group;
            }
        }
        Self { said, mean }
    }

    /// Whether strip `a` lies below strip `b`.
    fn is(&self, a: u32, b: u32) -> bool {
        let (a, b) = (a as usize, b as usize);
        if let (Some(a), Some(b)) = (self.said.get(a), self.said.get(b))
            && a != b
        {
            return *a;
        }
        let [x, y] = [0, 1].map(|c| self.mean[b][c] - self.mean[a][c]);
        if y.abs() > SAME_HEIGHT * x.abs() { y > 0.0 } else { x > 0.0 }
    }
}

/// The interface elements, one after the other along the tangent, so that rows of results follow the joint; joints that
/// do not hang together from left to right.
fn in_line(nodes: &[[f64; 2]], found: Vec<[u32; 4]>) -> Vec<[u32; 4]> {
    let middle = |corners: &[u32; 4], c: usize| corners.iter().map(|&node| nodes[node as usize][c]).sum::<f64>();
    let order =
        |a: &[u32; 4], b: &[u32; 4]| middle(a, 0).total_cmp(&middle(b, 0)).then(middle(a, 1).total_cmp(&middle(b, 1)));
    let mut starts: HashMap<[u32; 2], usize> = HashMap::new();
    let mut ends: HashSet<[u32; 2]> = HashSet::new();
    for (k, &[l1, l2, u1, u2]) in found.iter().enumerate() {
        starts.insert([l1, u1], k);
        ends.insert([l2, u2]);
    }
    // Beginnings first; what is left after them are rings, which begin at their leftmost element.
    let mut first: Vec<usize> = (0..found.len()).collect();
    let is_inner = |k: usize| ends.contains(&[found[k][0], found[k][2]]);
    first.sort_by(|&a, &b| is_inner(a).cmp(&is_inner(b)).then(order(&found[a], &found[b])));
    let mut taken = vec![false; found.len()];
    let mut line = Vec::with_capacity(found.len());
    for start in first {
        let mut next = Some(start);
        while let Some(k) = next.filter(|&k| !taken[k]) {
            taken[k] = true;
            line.push(found[k]);
            next = starts.get(&[found[k][1], found[k][3]]).copied();
        }
    }
    line
}

/// Whether `node` lies across the gap from the face about `near`, between the ends of that face.
fn along_face(nodes: &[[f64; 2]], interfaces: &[[u32; 4]], near: u32, node: u32) -> bool {
    interfaces.iter().any(|corners| {
        let Some(at) = corners.iter().position(|&corner| corner == near) else { return false };
        let other = nodes[corners[at ^ 1] as usize];
        let (from, to) = (nodes[near as usize], nodes[node as usize]);
        let edge = [other[0] - from[0], other[1] - from[1]];
        let length2 = edge[0].powi(2) + edge[1].powi(2);
        let share = ((to[0] - from[0]) * edge[0] + (to[1] - from[1]) * edge[1]) / length2;
        // Beside the partner of `near` and no further off than that: nodes down the side of a strip are further.
        let opposite = nodes[corners[at ^ 2] as usize];
        let gap2 = (opposite[0] - from[0]).powi(2) + (opposite[1] - from[1]).powi(2);
        let distance2 = (to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2);
        share > 0.1 && share < 0.9 && distance2 < gap2 + 0.36 * length2
    })
}

/// Nearest border node of another strip, by cells.
struct Nearest<'a> {
    nodes: &'a [[f64; 2]],
    strip: &'a [u32],
    cell: f64,
    origin: [f64; 2],
    reach: i64,
    cells: HashMap<[i64; 2], Vec<u32>>,
}

impl<'a> Nearest<'a> {
    fn new(nodes: &'a [[f64; 2]], border: &'a [u32], strip: &'a [u32]) -> Self {
        let bound = |c: usize, pick: fn(f64, f64) -> f64, start: f64| {
            border.iter().map(|&node| nodes[node as usize][c]).fold(start, pick)
        };
        let low = [0, 1].map(|c| bound(c, f64::min, f64::INFINITY));
        let high = [0, 1].map(|c| bound(c, f64::max, f64::NEG_INFINITY));
        let extent = (high[0] - low[0]).max(high[1] - low[1]).max(f64::MIN_POSITIVE);
        let cell = extent / (border.len() as f64 / 4.0).max(1.0);
        let mut made = Self { nodes, strip, cell, origin: low, reach: 0, cells: HashMap::new() };
        made.reach = (extent / cell).ceil() as i64 + 1;
        for &node in border {
            made.cells.entry(made.key(node)).or_default().push(node);
        }
        made
    }

    fn key(&self, node: u32) -> [i64; 2] {
        [0, 1].map(|c| ((self.nodes[node as usize][c] - self.origin[c]) / self.cell).floor() as i64)
    }

    fn of(&self, node: u32) -> Option<u32> {
        let [i, j] = self.key(node);
        let [x, y] = self.nodes[node as usize];
        let mut best: Option<(f64, u32)> = None;
        for ring in 0..=self.reach {
            if let Some((distance, _)) = best
                && distance.sqrt() < (ring - 1) as f64 * self.cell
            {
                break;
            }
            let step = |di: i64| if di.abs() == ring { 1 } else { 2 * ring.max(1) };
            for di in -ring..=ring {
                let mut dj = -ring;
                while dj <= ring {
                    for &other in self.cells.get(&[i + di, j + dj]).into_iter().flatten() {
                        if self.strip[other as usize] == self.strip[node as usize] {
                            continue;
                        }
                        let [ox, oy] = self.nodes[other as usize];
                        let distance = (ox - x).powi(2) + (oy - y).powi(2);
                        if best.is_none_or(|(least, number)| (distance, other) < (least, number)) {
                            best = Some((distance, other));
                        }
                    }
                    dj += step(di);
                }
            }
        }
        best.map(|(_, other)| other)
    }
}
