//! Elements that would count twice, and sides that do not meet: each looks like a mesh and measures something else.

use super::{FileElement, FileNode, MeshFileFault};
use std::collections::HashMap;

/// What counts as touching, of the size of the elements.
const TOUCH: f64 = 1e-6;

type Point = [f64; 2];

/// An element as it lies in the plane.
struct Laid<'a> {
    element: &'a FileElement,
    corners: [Point; 4],
    /// Smallest and largest x and y.
    low: Point,
    high: Point,
}

impl<'a> Laid<'a> {
    fn of(element: &'a FileElement, nodes: &[FileNode]) -> Option<Self> {
        let mut corners = [[0.0; 2]; 4];
        for (corner, &node) in corners.iter_mut().zip(&element.nodes) {
            let [x, y, _] = nodes.get(node)?.at;
            *corner = [x, y];
        }
        let extreme =
            |of: fn(f64, f64) -> f64| corners.iter().fold(corners[0], |[x, y], at| [of(x, at[0]), of(y, at[1])]);
        let [low, high] = [extreme(f64::min), extreme(f64::max)];
        Some(Self { element, corners, low, high })
    }

    fn size(&self) -> f64 {
        (self.high[0] - self.low[0]).max(self.high[1] - self.low[1])
    }

    /// The element as one triangle or two; none where it is folded or has no area.
    fn triangles(&self) -> Vec<[Point; 3]> {
        let [a, b, c, d] = self.corners;
        let is_triangle = self.element.nodes[2] == self.element.nodes[3];
        let halves = if is_triangle {
            vec![vec![[a, b, c]]]
        } else {
            vec![vec![[a, b, c], [a, c, d]], vec![[b, c, d], [b, d, a]]]
        };
        let least = TOUCH * self.size() * self.size();
        let is_whole = |halves: &&Vec<[Point; 3]>| {
            let areas: Vec<f64> = halves.iter().map(|[a, b, c]| cross(to(*a, *b), to(*a, *c))).collect();
            areas.iter().all(|area| *area > least) || areas.iter().all(|area| *area < -least)
        };
        halves.iter().find(is_whole).cloned().unwrap_or_default()
    }

    /// The place in its list of a node of `other` that lies within a side and is no corner.
    fn hanging(&self, other: &Self) -> Option<usize> {
        let of_side = |from: Point, end: Point| {
            let (along, least) = (to(from, end), TOUCH * self.size());
            let length = along[0].hypot(along[1]);
            let is_within = |at: &Point| {
                let off = to(from, *at);
                let place = (off[0] * along[0] + off[1] * along[1]) / length;
                length > least && place > least && place < length - least && (cross(along, off) / length).abs() < least
            };
            other.corners.iter().position(is_within)
        };
        let [a, b, c, d] = self.corners;
        [(a, b), (b, c), (c, d), (d, a)].into_iter().find_map(|(from, end)| of_side(from, end))
    }
}

fn to(a: Point, b: Point) -> Point {
    [b[0] - a[0], b[1] - a[1]]
}

fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Whether two triangles have more than `least` of their width in common along every direction of their sides.
fn overlap(one: &[Point; 3], other: &[Point; 3], least: f64) -> bool {
    let sides = |[a, b, c]: &[Point; 3]| [to(*a, *b), to(*b, *c), to(*c, *a)];
    let extent = |triangle: &[Point; 3], [x, y]: Point| {
        let along = triangle.map(|at| at[0] * x + at[1] * y);
        (along.into_iter().fold(f64::INFINITY, f64::min), along.into_iter().fold(f64::NEG_INFINITY, f64::max))
    };
    sides(one).into_iter().chain(sides(other)).all(|[x, y]| {
        let length = x.hypot(y);
        let normal = [-y / length, x / length];
        let ((a, b), (c, d)) = (extent(one, normal), extent(other, normal));
        b.min(d) - a.max(c) > least
    })
}

/// Refuses a zone with elements that lie twice or over each other, or with a node within the side of an element.
pub(super) fn check(elements: &[&FileElement], nodes: &[FileNode]) -> Result<(), MeshFileFault> {
    let mut seen: HashMap<[usize; 4], u64> = HashMap::with_capacity(elements.len());
    for element in elements {
        let mut same = element.nodes;
        same.sort_unstable();
        if let Some(other) = seen.insert(same, element.number) {
            return Err(MeshFileFault::Twice { element: other, other: element.number });
        }
    }
    let mut laid: Vec<Laid<'_>> = elements.iter().filter_map(|element| Laid::of(element, nodes)).collect();
    laid.sort_by(|a, b| a.low[0].total_cmp(&b.low[0]));
    // From left to right: only those that are not passed yet can meet the next one.
    let mut open: Vec<&Laid<'_>> = Vec::new();
    for next in &laid {
        open.retain(|one| one.high[0] >= next.low[0]);
        for one in &open {
            let least = TOUCH * one.size().min(next.size());
            let meets = one.low[1] <= next.high[1] + least && next.low[1] <= one.high[1] + least;
            if meets {
                pair([one, next], least, nodes)?;
            }
        }
        open.push(next);
    }
    Ok(())
}

fn pair([one, next]: [&Laid<'_>; 2], least: f64, nodes: &[FileNode]) -> Result<(), MeshFileFault> {
    for (whole, other) in [(one, next), (next, one)] {
        let node = whole.hanging(other).and_then(|corner| nodes.get(*other.element.nodes.get(corner)?));
        if let Some(node) = node {
            let (element, other) = (whole.element.number, other.element.number);
            return Err(MeshFileFault::Hanging { node: node.number, element, other });
        }
    }
    let of_next = next.triangles();
    if one.triangles().iter().any(|one| of_next.iter().any(|other| overlap(one, other, least))) {
        return Err(MeshFileFault::Overlap { element: one.element.number, other: next.element.number });
    }
    Ok(())
}
