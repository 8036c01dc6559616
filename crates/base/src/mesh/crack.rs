//! Cuts through a mesh: cracks and joints.
//!
//! The nodes of the grid that are nearest to the path are moved onto it, so that edges of elements follow it, and are
//! doubled there (docs/correlation.md, 2.12). A cell that the path crosses from corner to corner becomes two triangles.

use super::element::corners_of;
use super::grid::Grid;
use super::q4::{Mesh, Part, turn};
use crate::plane::{distance, minus, unit};
use crate::units::{Length, Px};
use std::collections::{BTreeMap, HashMap, HashSet};

/// A place of a cut with its node on either side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacePoint {
    /// Distance along the path from its first point.
    pub along: f64,
    /// Position of both nodes in the reference.
    pub at: [f64; 2],
    /// Unit normal, from `-` to `+`; the path goes along `(-n_y, n_x)`: for one to the right `+` is above.
    pub normal: [f64; 2],
    /// The node on the side `+`.
    pub plus: usize,
    /// The node on the side `-`.
    pub minus: usize,
}

/// The cut that a mesh has along a path.
#[derive(Debug, Clone, PartialEq)]
pub struct CutFaces {
    /// The doubled nodes in the order of the path.
    pub points: Vec<FacePoint>,
    /// For the first and the last point of the path: where the mesh is joined, when the path ends inside.
    pub tips: [Option<CutTip>; 2],
}

/// A free end of a cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutTip {
    /// Distance along the path from its first point.
    pub along: f64,
    /// Its position, that of a node that both sides share.
    pub at: [f64; 2],
    /// Unit vector along the path, out of the crack.
    pub ahead: [f64; 2],
}

/// Nodes and the elements between them.
type Elements = (Vec<[f64; 2]>, Vec<[u32; 4]>);

/// A place of the lattice, and where its node comes to stand.
type Moved = ([i64; 2], [f64; 2]);

fn lerp(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    // The end itself keeps its bits.
    if t == 1.0 { b } else { [0, 1].map(|c| a[c] + t * (b[c] - a[c])) }
}

fn length(path: &[[f64; 2]]) -> f64 {
    path.windows(2).map(|two| distance(two[0], two[1])).sum()
}

/// The lattice of a part: which cells there are, and its nodes by their place.
struct Lattice {
    grid: Grid,
    element_at: Vec<u32>,
    node_at: HashMap<[i64; 2], u32>,
}

impl Lattice {
    fn of(part: &Part) -> Option<Self> {
        let (grid, element_at) = part.grid.clone()?;
        let place = |node: u32| grid.column_and_row(part.nodes[node as usize]).map(|k| k as i64);
        let node_at = (0..part.nodes.len() as u32).map(|node| (place(node), node)).collect();
        Some(Self { grid, element_at, node_at })
    }

    fn position(&self, [i, j]: [i64; 2]) -> [f64; 2] {
        [self.grid.x0 + i as f64 * self.grid.hx, self.grid.y0 + j as f64 * self.grid.hy]
    }

    fn nearest(&self, [x, y]: [f64; 2]) -> [i64; 2] {
        [((x - self.grid.x0) / self.grid.hx).round() as i64, ((y - self.grid.y0) / self.grid.hy).round() as i64]
    }

    fn element(&self, [i, j]: [i64; 2]) -> Option<u32> {
        let (nx, ny) = (self.grid.nx as i64, self.grid.ny as i64);
        let inside = (0..nx).contains(&i) && (0..ny).contains(&j);
        inside.then(|| self.element_at[(j * nx + i) as usize]).filter(|&element| element != u32::MAX)
    }

    /// Which of the cells around a node there are: left above, right above, left below, right below.
    fn around(&self, [i, j]: [i64; 2]) -> [bool; 4] {
        [[i - 1, j - 1], [i, j - 1], [i - 1, j], [i, j]].map(|cell| self.element(cell).is_some())
    }

    /// Along which axes a node may be moved so that the border of the mesh stays where it is.
    fn free(&self, node: [i64; 2]) -> [bool; 2] {
        match self.around(node) {
            [true, true, true, true] => [true, true],
            [false, true, false, true] | [true, false, true, false] => [false, true],
            [true, true, false, false] | [false, false, true, true] => [true, false],
            _ => [false, false],
        }
    }

    /// The pieces of a path inside the rectangle of the grid.
    fn clipped(&self, path: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
        let bounds = self.grid.bounds();
        let (low, high) = ([bounds.x0, bounds.y0], [bounds.x1, bounds.y1]);
        let mut pieces: Vec<Vec<[f64; 2]>> = Vec::new();
        let mut goes_on = false;
        for two in path.windows(2) {
            let way = minus(two[1], two[0]);
            let mut range = [0.0, 1.0f64];
            for c in 0..2 {
                if way[c] == 0.0 {
                    if two[0][c] < low[c] || two[0][c] > high[c] {
                        range = [1.0, 0.0];
                    }
                    continue;
                }
                let (a, b) = ((low[c] - two[0][c]) / way[c], (high[c] - two[0][c]) / way[c]);
                range = [range[0].max(a.min(b)), range[1].min(a.max(b))];
            }
            if range[0] >= range[1] {
                goes_on = false;
                continue;
            }
            // Exactly on the border, so that its nodes stay on it.
            let on = |t: f64| {
                let p = lerp(two[0], two[1], t);
                [0, 1].map(|c| p[c].clamp(low[c], high[c]))
            };
            match pieces.last_mut().filter(|_| goes_on && range[0] == 0.0) {
                Some(piece) => piece.push(on(range[1])),
                None => pieces.push(vec![on(range[0]), on(range[1])]),
            }
            goes_on = range[1] == 1.0;
        }
        pieces
    }

    /// Goes on to the border when the end of a path lies beside it: what is left would hang by half an element.
    fn to_border(&self, piece: &mut [[f64; 2]]) {
        for _ in 0..2 {
            let n = piece.len();
            let (end, before) = (piece[n - 1], piece[n - 2]);
            let place = self.nearest(end);
            let on_border = self.node_at.contains_key(&place) && self.free(place) != [true, true];
            if on_border {
                let size = distance(end, before).max(f64::MIN_POSITIVE);
                let reach = 1.5 * self.grid.hx.max(self.grid.hy) / size;
                let further = lerp(before, end, 1.0 + reach);
                if let Some(last) = self.clipped(&[end, further]).first().and_then(|piece| piece.last()) {
                    piece[n - 1] = *last;
                }
            }
            piece.reverse();
        }
    }

    /// The nodes that a piece of path goes along, each with its place on the path; neighbours share a side or a cell.
    fn chain(&self, piece: &[[f64; 2]]) -> Vec<Moved> {
        let mut corners: Vec<Moved> = Vec::new();
        for (k, &at) in piece.iter().enumerate() {
            let place = self.nearest(at);
            let last = k + 1 == piece.len();
            if corners.last().is_some_and(|(other, _)| *other == place) {
                // An end is where the crack ends; a bend within an element is not followed.
                if last && corners.len() > 1 {
                    corners.pop();
                    corners.push((place, at));
                }
                continue;
            }
            // A bend at the border would pull the border in.
            if k > 0 && !last && self.free(place) != [true, true] && self.node_at.contains_key(&place) {
                continue;
            }
            corners.push((place, at));
        }
        let mut chain: Vec<Moved> = corners.first().copied().into_iter().collect();
        for two in corners.windows(2) {
            let ((from, a), (to, b)) = (two[0], two[1]);
            let steps = [to[0] - from[0], to[1] - from[1]];
            let axis = usize::from(steps[1].abs() > steps[0].abs());
            for k in 1..steps[axis].abs() {
                let mut place = from;
                place[axis] += k * steps[axis].signum();
                let on_line = self.position(place)[axis];
                let t = ((on_line - a[axis]) / (b[axis] - a[axis])).clamp(0.0, 1.0);
                let at = lerp(a, b, t);
                place[1 - axis] = self.nearest(at)[1 - axis];
                connect(&mut chain, (place, at));
            }
            connect(&mut chain, (to, b));
        }
        chain
    }
}

/// Adds a node to a chain, with what is needed between.
fn connect(chain: &mut Vec<Moved>, next: Moved) {
    let Some(&(last, at)) = chain.last() else { return chain.push(next) };
    let steps = [next.0[0] - last[0], next.0[1] - last[1]];
    if steps == [0, 0] {
        return;
    }
    if steps.iter().any(|step| step.abs() > 1) {
        let middle = [last[0] + steps[0] / 2, last[1] + steps[1] / 2];
        connect(chain, (middle, lerp(at, next.1, 0.5)));
        // Half of the way is shorter by at least one step.
        return connect(chain, next);
    }
    chain.push(next);
}

/// How far from the path the nodes beside it move along, in elements.
const RINGS: usize = 2;

/// The part of a grid, cut along `paths` if any goes along an edge: nodes on them are doubled, but for ends inside.
pub(super) fn cut(part: &Part, paths: &[Vec<[f64; 2]>]) -> Option<Part> {
    let lattice = Lattice::of(part)?;
    let mut moved: HashMap<[i64; 2], [f64; 2]> = HashMap::new();
    let mut diagonals: HashMap<[i64; 2], [[i64; 2]; 2]> = HashMap::new();
    let mut cut_edges: HashSet<[u32; 2]> = HashSet::new();
    for path in paths {
        for mut piece in lattice.clipped(path) {
            lattice.to_border(&mut piece);
            let chain = lattice.chain(&piece);
            for &(place, at) in &chain {
                moved.entry(place).or_insert(at);
            }
            for two in chain.windows(2) {
                let mut places = vec![two[0].0, two[1].0];
                let [a, b] = [two[0].0, two[1].0];
                if a[0] != b[0] && a[1] != b[1] {
                    let cell = [a[0].min(b[0]), a[1].min(b[1])];
                    let own = *diagonals.entry(cell).or_insert([a, b]);
                    if own != [a, b] && own != [b, a] {
                        places.insert(1, [b[0], a[1]]); // around a cell that another crack has cut across
                    }
                }
                for two in places.windows(2) {
                    if let [Some(&a), Some(&b)] = [lattice.node_at.get(&two[0]), lattice.node_at.get(&two[1])] {
                        cut_edges.insert([a.min(b), a.max(b)]);
                    }
                }
            }
        }
    }
    let nodes = placed(part, &lattice, &moved);
    let elements = divided(part, &lattice, &diagonals, &nodes)?;
    let (nodes, elements) = doubled(nodes, elements, &cut_edges)?;
    Some(Part { name: part.name.clone(), nodes, elements, grid: None })
}

/// The nodes with those on the paths moved onto them, and those beside moved along, so that elements keep their size.
fn placed(part: &Part, lattice: &Lattice, moved: &HashMap<[i64; 2], [f64; 2]>) -> Vec<[f64; 2]> {
    let mut offset: BTreeMap<[i64; 2], [f64; 2]> = BTreeMap::new();
    for (&place, &at) in moved.iter().filter(|(place, _)| lattice.node_at.contains_key(*place)) {
        offset.insert(place, minus(at, lattice.position(place)));
    }
    let beside: BTreeMap<[i64; 2], [bool; 2]> = {
        let reach = RINGS as i64;
        let around =
            |&[i, j]: &[i64; 2]| (-reach..=reach).flat_map(move |b| (-reach..=reach).map(move |a| [i + a, j + b]));
        let near = offset.keys().flat_map(around).filter(|place| !offset.contains_key(place));
        near.filter(|place| lattice.node_at.contains_key(place)).map(|place| (place, lattice.free(place))).collect()
    };
    for _ in 0..4 * RINGS {
        for (&[i, j], free) in &beside {
            let neighbours = [[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]];
            let mean = |c: usize| {
                0.25 * neighbours.iter().filter_map(|place| offset.get(place)).map(|offset| offset[c]).sum::<f64>()
            };
            let own = [0, 1].map(|c| if free[c] { mean(c) } else { 0.0 });
            offset.insert([i, j], own);
        }
    }
    let mut nodes = part.nodes.clone();
    for (place, offset) in offset {
        let node = lattice.node_at[&place] as usize;
        nodes[node] = match moved.get(&place) {
            Some(&at) => at,
            // The same bits where nothing moves.
            None if offset == [0.0; 2] => nodes[node],
            None => [0, 1].map(|c| nodes[node][c] + offset[c]),
        };
    }
    nodes
}

/// The elements, those cut across or not convex any more as two triangles. `None` when one is folded.
fn divided(
    part: &Part,
    lattice: &Lattice,
    diagonals: &HashMap<[i64; 2], [[i64; 2]; 2]>,
    nodes: &[[f64; 2]],
) -> Option<Vec<[u32; 4]>> {
    let mut across: HashMap<u32, u32> = HashMap::new(); // element, and a node at an end of its diagonal
    for (cell, ends) in diagonals {
        if let (Some(element), Some(&node)) = (lattice.element(*cell), lattice.node_at.get(&ends[0])) {
            across.insert(element, node);
        }
    }
    let at = |corners: &[u32]| corners.iter().map(|&node| nodes[node as usize]).collect::<Vec<_>>();
    let convex = |corners: &[u32]| (0..corners.len()).all(|k| turn(&at(corners), k) > 0.0);
    let mut elements = Vec::with_capacity(part.elements.len() + across.len());
    for (element, corners) in part.elements.iter().enumerate() {
        let triangles = |k: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|m| corners[(k + m) % 4]);
            [[a, b, c, c], [a, c, d, d]]
        };
        let fits = |k: usize| triangles(k).iter().all(|t| convex(&t[..3]));
        let diagonal = across.get(&(element as u32)).and_then(|node| corners.iter().position(|corner| corner == node));
        match diagonal {
            Some(k) if fits(k) => elements.extend(triangles(k)),
            Some(_) => return None,
            None if convex(corners) => elements.push(*corners),
            None => elements.extend(triangles((0..2).find(|&k| fits(k))?)),
        }
    }
    Some(elements)
}

/// The nodes on cut edges doubled, once for each group of elements that hold together there. `None` when none is.
fn doubled(mut nodes: Vec<[f64; 2]>, mut elements: Vec<[u32; 4]>, cut_edges: &HashSet<[u32; 2]>) -> Option<Elements> {
    let mut on_cut: Vec<u32> = cut_edges.iter().flatten().copied().collect();
    on_cut.sort_unstable();
    on_cut.dedup();
    let mut around: HashMap<u32, Vec<usize>> = HashMap::new();
    let before = elements.clone();
    for (element, corners) in before.iter().enumerate() {
        for &node in corners_of(corners) {
            around.entry(node).or_default().push(element);
        }
    }
    let n_before = nodes.len();
    for node in on_cut {
        let Some(here) = around.get(&node) else { continue };
        // The other ends of an element's two sides at this node.
        let sides = |element: usize| {
            let mut corners = before[element].to_vec();
            corners.dedup();
            let (n, k) = (corners.len(), corners.iter().position(|&corner| corner == node).unwrap_or_default());
            [corners[(k + 1) % n], corners[(k + n - 1) % n]]
        };
        let mut group: Vec<usize> = (0..here.len()).collect();
        for a in 0..here.len() {
            for b in 0..a {
                let shared = sides(here[a]).into_iter().find(|end| sides(here[b]).contains(end));
                if shared.is_some_and(|end| !cut_edges.contains(&[node.min(end), node.max(end)])) {
                    let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
                    group.iter_mut().filter(|group| **group == from).for_each(|group| *group = to);
                }
            }
        }
        let mut own: BTreeMap<usize, u32> = BTreeMap::from([(group[0], node)]);
        for (k, &element) in here.iter().enumerate() {
            let number = *own.entry(group[k]).or_insert_with(|| {
                nodes.push(nodes[node as usize]);
                nodes.len() as u32 - 1
            });
            elements[element].iter_mut().filter(|corner| **corner == node).for_each(|corner| *corner = number);
        }
    }
    (nodes.len() > n_before).then_some((nodes, elements))
}

impl Mesh<Px> {
    /// For each node a point that tells it from others in its place: itself, or one just inside a cut's own elements.
    pub fn sides(&self) -> Vec<[f64; 2]> {
        const INTO: f64 = 0.25; // of the way to the middle of its elements
        let mut sides = self.nodes().to_vec();
        if (0..self.zones().len()).all(|zone| self.grid(zone).is_some()) {
            return sides;
        }
        let mut doubled = vec![false; self.n_nodes()];
        coincident(self).iter().flatten().for_each(|&node| doubled[node] = true);
        let middles = self.middles_around(&doubled);
        for (node, middle) in middles {
            sides[node] = lerp(sides[node], middle, INTO);
        }
        sides
    }
}

/// Nodes of one zone in the same place, two or more together, in the order of the first.
fn coincident<U: Length>(mesh: &Mesh<U>) -> Vec<Vec<usize>> {
    let mut first: HashMap<(u32, [u64; 2]), usize> = HashMap::new();
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (node, (at, zone)) in mesh.nodes().iter().zip(mesh.node_zone()).enumerate() {
        let first = *first.entry((*zone, at.map(|v| (v + 0.0).to_bits()))).or_insert(node);
        if first != node {
            groups.entry(first).or_insert_with(|| vec![first]).push(node);
        }
    }
    groups.into_values().collect()
}

impl<U: Length> Mesh<U> {
    /// For the nodes that are asked for: the mean of the middles of their elements.
    fn middles_around(&self, wanted: &[bool]) -> Vec<(usize, [f64; 2])> {
        let mut sums: BTreeMap<usize, ([f64; 2], f64)> = BTreeMap::new();
        for (element, nodes) in self.elements().iter().enumerate() {
            for &node in nodes.iter().filter(|&&node| wanted[node as usize]) {
                let corners = self.corners(element);
                let (sum, n) = sums.entry(node as usize).or_default();
                (0..2).for_each(|c| sum[c] += corners.iter().map(|p| 0.25 * p[c]).sum::<f64>());
                *n += 1.0;
            }
        }
        sums.into_iter().map(|(node, (sum, n))| (node, sum.map(|v| v / n))).collect()
    }

    /// The nodes on cuts, those of either side: others of their zone are in the same place.
    pub fn doubled(&self) -> Vec<usize> {
        coincident(self).into_iter().flatten().collect()
    }

    /// The cut along a path: its doubled nodes, each pair by side, and joined ends; none where the mesh is not cut.
    pub fn cut_faces(&self, path: &[[f64; 2]]) -> CutFaces {
        let reach = 0.75 * self.element_size();
        let groups: Vec<Vec<usize>> = coincident(self)
            .into_iter()
            .filter(|group| project(path, self.nodes()[group[0]]).is_some_and(|found| found.distance < reach))
            .collect();
        let mut wanted = vec![false; self.n_nodes()];
        groups.iter().flatten().for_each(|&node| wanted[node] = true);
        let middles: HashMap<usize, [f64; 2]> = self.middles_around(&wanted).into_iter().collect();
        let mut points = Vec::new();
        for group in &groups {
            let at = self.nodes()[group[0]];
            let Some(found) = project(path, at) else { continue };
            // Over an element: at a bend that of both sides.
            let [tx, ty] = chord(path, found.along, reach).unwrap_or(found.tangent);
            let normal = [ty, 0.0 - tx];
            let above = |node: usize| {
                let way = middles.get(&node).map_or([0.0; 2], |&middle| minus(middle, at));
                way[0] * normal[0] + way[1] * normal[1]
            };
            let side = |best: fn(&(f64, usize), &(f64, usize)) -> bool| {
                let all = group.iter().map(|&node| (above(node), node));
                all.reduce(|a, b| if best(&b, &a) { b } else { a })
            };
            let (Some((high, plus)), Some((low, minus))) = (side(|a, b| a.0 > b.0), side(|a, b| a.0 < b.0)) else {
                continue;
            };
            if high > 0.0 && low < 0.0 {
                points.push(FacePoint { along: found.along, at, normal, plus, minus });
            }
        }
        points.sort_by(|a, b| a.along.total_cmp(&b.along));
        let tip = |last: bool| {
            let n = path.len();
            let (end, before) =
                if last { (path.last()?, path.get(n.checked_sub(2)?)?) } else { (path.first()?, path.get(1)?) };
            let zone = (0..self.zones().len()).find(|&zone| self.locate(zone, end[0], end[1]).is_some())?;
            let near = |node: &usize| distance(self.nodes()[*node], *end);
            let node = self.zone_nodes(zone).min_by(|a, b| near(a).total_cmp(&near(b)))?;
            let is_doubled = groups.iter().any(|group| group.contains(&node));
            let size = distance(*end, *before);
            let ahead = minus(*end, *before).map(|v| v / size);
            let along = if last { length(path) } else { 0.0 };
            (!is_doubled && near(&node) < reach && size > 0.0).then_some(CutTip {
                along,
                at: self.nodes()[node],
                ahead,
            })
        };
        let tips = [tip(false), tip(true)];
        CutFaces { points, tips }
    }
}

/// The unit vector between the points of a path at `reach` before and after a place.
fn chord(path: &[[f64; 2]], along: f64, reach: f64) -> Option<[f64; 2]> {
    let ((a, _), (b, _)) = (point_along(path, along - reach)?, point_along(path, along + reach)?);
    (distance(b, a) > 0.0).then(|| unit(minus(b, a)))
}

/// The point of a path nearest to another.
pub struct OnPath {
    /// Distance along the path.
    pub along: f64,
    /// Distance from it.
    pub distance: f64,
    /// Unit tangent there.
    pub tangent: [f64; 2],
}

/// The point of `path` nearest to `at`; `None` for a path without length.
pub fn project(path: &[[f64; 2]], at: [f64; 2]) -> Option<OnPath> {
    let mut best: Option<OnPath> = None;
    let mut before = 0.0;
    for two in path.windows(2) {
        let way = minus(two[1], two[0]);
        let size = way[0].hypot(way[1]);
        if size == 0.0 {
            continue;
        }
        let to = minus(at, two[0]);
        let t = ((to[0] * way[0] + to[1] * way[1]) / (size * size)).clamp(0.0, 1.0);
        let distance = distance(at, lerp(two[0], two[1], t));
        if best.as_ref().is_none_or(|best| distance < best.distance) {
            best = Some(OnPath { along: before + t * size, distance, tangent: way.map(|v| v / size) });
        }
        before += size;
    }
    best
}

/// The point at a distance along a path, with the unit tangent there; the ends beyond them.
pub fn point_along(path: &[[f64; 2]], along: f64) -> Option<([f64; 2], [f64; 2])> {
    let mut before = 0.0;
    let mut last = None;
    for two in path.windows(2) {
        let size = distance(two[0], two[1]);
        if size == 0.0 {
            continue;
        }
        let t = ((along - before) / size).clamp(0.0, 1.0);
        last = Some((lerp(two[0], two[1], t), minus(two[1], two[0]).map(|v| v / size)));
        before += size;
        if along <= before {
            break;
        }
    }
    last
}
