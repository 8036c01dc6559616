//! Lines of elements that do not match: where a crack may be.

use crate::mesh::{Mesh, PointCells};
use crate::plane::distance;
use crate::units::Px;

/// Elements with at most one matching element between them belong together: middles this near, in elements.
const TOGETHER: f64 = 2.3;
/// A line is longer than this, in elements: less is dust.
const SHORTEST: f64 = 4.0;
/// and narrower than this, and than this share of its length: more is a block, a hole, a shadow.
const WIDEST: f64 = 4.0;
const SLENDER: f64 = 0.34;

/// Elements of one zone that do not match and hang together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub zone: usize,
    pub n_elements: usize,
    /// Mean of their middles.
    pub middle: [f64; 2],
    /// Length and width, px.
    pub length_px: f64,
    pub width_px: f64,
    /// The line along its middle, from end to end and to the right or downwards; none where the group is no line.
    pub line: Option<Vec<[f64; 2]>>,
}

/// The groups of the elements that are `bad`, the longest first; those of a few elements are left out.
pub(super) fn groups(mesh: &Mesh<Px>, bad: &[bool]) -> Vec<Group> {
    let size = mesh.element_size();
    let mut found = Vec::new();
    for zone in 0..mesh.zones().len() {
        let middles: Vec<[f64; 2]> = mesh.zone_elements(zone).filter(|&e| bad[e]).map(|e| middle(mesh, e)).collect();
        for members in connect(&middles, TOGETHER * size) {
            if members.len() as f64 >= SHORTEST {
                let own: Vec<[f64; 2]> = members.iter().map(|&k| middles[k]).collect();
                found.push(group(zone, &own, size));
            }
        }
    }
    found.sort_by(|a, b| b.length_px.total_cmp(&a.length_px));
    found
}

pub(super) fn middle(mesh: &Mesh<Px>, element: usize) -> [f64; 2] {
    let corners = mesh.corners(element);
    [0, 1].map(|c| 0.25 * corners.iter().map(|p| p[c]).sum::<f64>())
}

/// The points that hang together by steps of `reach`.
fn connect(points: &[[f64; 2]], reach: f64) -> Vec<Vec<usize>> {
    let cells = PointCells::new(points, reach);
    let mut seen = vec![false; points.len()];
    let mut all = Vec::new();
    for first in 0..points.len() {
        if seen[first] {
            continue;
        }
        seen[first] = true;
        let mut members = vec![first];
        let mut next = 0;
        while let Some(&at) = members.get(next) {
            next += 1;
            for (other, _) in cells.near(points[at], reach) {
                if !seen[other] {
                    seen[other] = true;
                    members.push(other);
                }
            }
        }
        members.sort_unstable();
        all.push(members);
    }
    all
}

fn group(zone: usize, middles: &[[f64; 2]], size: f64) -> Group {
    let n = middles.len();
    let middle = [0, 1].map(|c| middles.iter().map(|p| p[c]).sum::<f64>() / n as f64);
    let path = longest(middles, TOGETHER * size);
    let line = centre(&path, middles, size);
    let length_px = line.windows(2).map(|two| distance(two[0], two[1])).sum::<f64>();
    let width_px = n as f64 * size * size / length_px.max(size);
    let is_line = length_px >= SHORTEST * size && width_px <= WIDEST * size && width_px <= SLENDER * length_px;
    Group { zone, n_elements: n, middle, length_px, width_px, line: is_line.then_some(line) }
}

/// The points of the longest of the shortest ways between two of them: going to the furthest twice finds its ends.
fn longest(points: &[[f64; 2]], reach: f64) -> Vec<[f64; 2]> {
    let cells = PointCells::new(points, reach);
    let (from_any, _) = ways(points, &cells, reach, 0);
    let (from, before) = ways(points, &cells, reach, furthest(&from_any));
    let mut at = furthest(&from);
    let mut path = vec![points[at]];
    while let Some(next) = before[at] {
        at = next;
        path.push(points[at]);
    }
    // To the right, or downwards where it is steep.
    let way = [0, 1].map(|c| path[path.len() - 1][c] - path[0][c]);
    if (way[0].abs() >= way[1].abs() && way[0] < 0.0) || (way[0].abs() < way[1].abs() && way[1] < 0.0) {
        path.reverse();
    }
    path
}

fn furthest(distances: &[f64]) -> usize {
    (0..distances.len()).max_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(0)
}

/// Lengths of the shortest ways from `start` in steps of up to `reach`, and the point before each. Long steps cost more: none is passed over.
fn ways(points: &[[f64; 2]], cells: &PointCells<'_>, reach: f64, start: usize) -> (Vec<f64>, Vec<Option<usize>>) {
    let mut best = vec![f64::INFINITY; points.len()];
    let mut before = vec![None; points.len()];
    let mut waiting = std::collections::BTreeSet::from([(0u64, start)]);
    best[start] = 0.0;
    while let Some((bits, at)) = waiting.pop_first() {
        // Numbers above zero are in the order of their bits.
        if f64::from_bits(bits) > best[at] {
            continue;
        }
        for (other, _) in cells.near(points[at], reach).filter(|&(other, _)| other != at) {
            let step = distance(points[at], points[other]);
            let length = best[at] + step * step / reach;
            if length < best[other] {
                (best[other], before[other]) = (length, Some(at));
                waiting.insert((length.to_bits(), other));
            }
        }
    }
    // Points that are near without a way between them: none, they hang together.
    best.iter_mut().filter(|length| !length.is_finite()).for_each(|length| *length = 0.0);
    (best, before)
}

/// The path moved into the middle of the points around, at steps of an element, half an element longer at both ends.
fn centre(path: &[[f64; 2]], points: &[[f64; 2]], size: f64) -> Vec<[f64; 2]> {
    let reach = 1.8 * size;
    let around = PointCells::new(points, reach);
    let mean = |at: [f64; 2]| {
        let (mut sum, mut n) = ([0.0; 2], 0.0);
        for (k, _) in around.near(at, reach) {
            sum = [0, 1].map(|c| sum[c] + points[k][c]);
            n += 1.0;
        }
        if n > 0.0 { sum.map(|v| v / n) } else { at }
    };
    let last = path.len() - 1;
    let mut line: Vec<[f64; 2]> =
        path.iter().enumerate().map(|(k, &at)| if k == 0 || k == last { at } else { mean(at) }).collect();
    for _ in 0..2 {
        let before = line.clone();
        for k in 1..last {
            line[k] = [0, 1].map(|c| 0.25 * before[k - 1][c] + 0.5 * before[k][c] + 0.25 * before[k + 1][c]);
        }
    }
    // The ends of a thick group are at its corners: they follow the line.
    for (end, one, two) in [(0, 1, 3), (last, last.wrapping_sub(1), last.wrapping_sub(3))] {
        let (Some(&near), Some(&far)) = (line.get(one), line.get(two)) else { continue };
        let (step, reach) = (distance(near, far), distance(line[end], near) + 0.5 * size);
        if step > 0.0 {
            line[end] = [0, 1].map(|c| near[c] + reach * (near[c] - far[c]) / step);
        }
    }
    line.dedup_by(|a, b| distance(*a, *b) < 1e-6);
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(keep: impl Fn(i32, i32) -> bool) -> Vec<[f64; 2]> {
        let all = (0..24).flat_map(|j| (0..24).map(move |i| (i, j)));
        all.filter(|&(i, j)| keep(i, j)).map(|(i, j)| [16.0 * f64::from(i), 16.0 * f64::from(j)]).collect()
    }

    #[test]
    fn a_row_of_elements_is_a_line_and_a_block_is_none() {
        let of = |points: &[[f64; 2]]| group(0, points, 16.0);
        let straight = of(&grid(|_, j| j == 7));
        assert!((straight.length_px - 24.0 * 16.0).abs() < 16.0, "{}", straight.length_px);
        for [_, y] in straight.line.unwrap() {
            assert!((y - 112.0).abs() < 1e-9, "{y}");
        }
        // Two elements wide, with gaps, and slanting.
        let slanting = of(&grid(|i, j| (2 * j - i - 10).abs() <= 1 && i % 5 != 0));
        for [x, y] in slanting.line.unwrap() {
            assert!((y - 0.5 * x - 80.0).abs() < 12.0, "{x} {y}");
        }
        assert_eq!(of(&grid(|i, j| i < 9 && j < 7)).line, None);
        assert_eq!(connect(&grid(|_, j| j == 7 || j == 11), TOGETHER * 16.0).len(), 2);
    }
}
