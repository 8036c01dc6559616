//! Points that lie on a grid, among others.

use crate::mesh::PointCells;
use crate::plane::{Point, cross, distance};
use std::collections::{BTreeMap, VecDeque};

/// How far a point may be from where its neighbours expect it, by the step.
const NEAR: f64 = 0.3;
/// Sine of the least angle between the two directions of a grid.
const LEAST_SINE: f64 = 0.5;
/// Longest step along one direction, by that along the other.
const LONGEST: f64 = 3.0;
/// Share of a row at the border above which it belongs to the grid.
const ROW_SHARE: f64 = 0.5;

/// Share of the places of a grid that must be taken.
const FILLED: f64 = 0.7;

/// Points with the numbers of their columns and rows, from zero.
#[derive(Debug, Clone)]
pub(super) struct Found {
    size: [usize; 2],
    points: BTreeMap<[usize; 2], Point>,
}

impl Found {
    pub fn n_points(&self) -> usize {
        self.points.len()
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Whether it has so many columns and rows, or rows and columns.
    pub fn has_size(&self, [columns, rows]: [usize; 2]) -> bool {
        self.size == [columns, rows] || self.size == [rows, columns]
    }

    /// Whether most of its places are taken: among points anywhere neighbours are found as well, but no rows.
    pub fn is_filled(&self) -> bool {
        self.points.len() as f64 > FILLED * (self.size[0] * self.size[1]) as f64
    }

    pub fn is_whole(&self, wanted: [usize; 2]) -> bool {
        self.has_size(wanted) && self.points.len() == wanted[0] * wanted[1]
    }

    /// Of an image that has been made smaller by `by`.
    pub fn scaled(mut self, by: f64) -> Self {
        self.points.values_mut().for_each(|point| *point = point.map(|v| by * v + 0.5 * (by - 1.0)));
        self
    }

    /// The points row by row: columns along x, or nearly, rows along y. Of a whole grid.
    pub fn in_order(&self, [columns, rows]: [usize; 2]) -> Vec<Point> {
        let [width, height] = self.size;
        // The corner that the numbers start from, and whether they run along rows first.
        let turns = [(false, false), (true, false), (true, true), (false, true)];
        let lists = turns.into_iter().flat_map(|(right, down)| [(right, down, false), (right, down, true)]);
        let list = |(right, down, across): (bool, bool, bool)| -> Option<Vec<Point>> {
            if [columns, rows] != if across { [height, width] } else { [width, height] } {
                return None;
            }
            let point = |k: usize| {
                let (a, b) = (k % columns, k / columns);
                let (i, j) = if across { (b, a) } else { (a, b) };
                let at = [if right { width - 1 - i } else { i }, if down { height - 1 - j } else { j }];
                self.points.get(&at).copied()
            };
            (0..columns * rows).map(point).collect()
        };
        let is_right_handed = |list: &Vec<Point>| {
            let (along, down) = ends(list, columns);
            cross(along, down) > 0.0
        };
        let along_x = |list: &Vec<Point>| {
            let (along, _) = ends(list, columns);
            along[0] / along[0].hypot(along[1])
        };
        let lists = lists.filter_map(list).filter(is_right_handed);
        lists.max_by(|a, b| along_x(a).total_cmp(&along_x(b))).unwrap_or_default()
    }
}

/// From the first point along the row, and down.
fn ends(list: &[Point], columns: usize) -> (Point, Point) {
    let from = |k: usize| [0, 1].map(|c| list[k][c] - list[0][c]);
    (from(columns - 1), from(list.len() - columns))
}

/// The largest grid among points, in the order of their trust; `fits` says whether two of them may be neighbours. Ends
/// with the first that has the size that is `wanted`.
pub(super) fn largest(points: &[Point], fits: impl Fn(usize, usize) -> bool, wanted: [usize; 2]) -> Option<Found> {
    let spread = crate::plane::bounds(points);
    let size = ((spread[1][0] - spread[0][0]) * (spread[1][1] - spread[0][1]) / points.len().max(1) as f64).sqrt();
    if !(size.is_finite() && size > 0.0) {
        return None;
    }
    let cells = PointCells::new(points, size);
    let mut is_tried = vec![false; points.len()];
    let mut best: Option<Found> = None;
    for seed in 0..points.len() {
        if is_tried[seed] {
            continue;
        }
        let Some(steps) = steps(points, &cells, size, &fits, seed) else { continue };
        let labels = grown(points, &cells, &fits, seed, steps);
        labels.values().for_each(|&(point, _)| is_tried[point] = true);
        let found = trimmed(points, &labels, wanted);
        if found.is_whole(wanted) {
            return Some(found);
        }
        best = [best, Some(found)].into_iter().flatten().max_by_key(Found::n_points);
    }
    best
}

/// The way to the nearest neighbour, and to the nearest in another direction.
fn steps(
    points: &[Point],
    cells: &PointCells<'_>,
    size: f64,
    fits: &impl Fn(usize, usize) -> bool,
    seed: usize,
) -> Option<[Point; 2]> {
    // Far enough for the points of the target where others stand closer together.
    let reaches = [1.0, 3.0, 9.0].map(|by| by * size);
    reaches.into_iter().find_map(|reach| {
        let near = cells.near(points[seed], reach).filter(|&(k, _)| k != seed && fits(seed, k));
        let mut ways: Vec<Point> = near.map(|(_, way)| way).collect();
        let length = |way: &Point| way[0].hypot(way[1]);
        ways.sort_by(|a, b| length(a).total_cmp(&length(b)));
        let first = *ways.first()?;
        let other = |way: &&Point| {
            cross(first, **way).abs() > LEAST_SINE * length(&first) * length(way)
                && length(way) < LONGEST * length(&first)
        };
        ways.iter().find(other).map(|second| [first, *second])
    })
}

/// A point and the steps of the grid there.
type Label = (usize, [Point; 2]);

/// All points that are reached from a first one.
fn grown(
    points: &[Point],
    cells: &PointCells<'_>,
    fits: &impl Fn(usize, usize) -> bool,
    seed: usize,
    steps: [Point; 2],
) -> BTreeMap<[i64; 2], Label> {
    let mut labels: BTreeMap<[i64; 2], Label> = BTreeMap::from([([0, 0], (seed, steps))]);
    let mut is_taken = vec![false; points.len()];
    is_taken[seed] = true;
    let mut queue = VecDeque::from([[0i64, 0]]);
    while let Some(at) = queue.pop_front() {
        let Some(&(point, inherited)) = labels.get(&at) else { continue };
        let steps = [0, 1].map(|axis| step(points, &labels, at, axis).unwrap_or(inherited[axis]));
        for (axis, sign) in [(0, 1), (0, -1), (1, 1), (1, -1)] {
            let mut next = at;
            next[axis] += sign;
            if labels.contains_key(&next) {
                continue;
            }
            let way = steps[axis].map(|v| sign as f64 * v);
            let goal = [0, 1].map(|c| points[point][c] + way[c]);
            let near = cells.near(goal, NEAR * way[0].hypot(way[1]));
            let nearest = near.filter(|&(k, _)| !is_taken[k] && fits(point, k)).min_by(|a, b| {
                let length = |way: Point| way[0].hypot(way[1]);
                length(a.1).total_cmp(&length(b.1))
            });
            if let Some((k, _)) = nearest {
                let mut there = steps;
                there[axis] = [0, 1].map(|c| sign as f64 * (points[k][c] - points[point][c]));
                is_taken[k] = true;
                labels.insert(next, (k, there));
                queue.push_back(next);
            }
        }
    }
    labels
}

/// The step along an axis that is seen next to a label.
fn step(points: &[Point], labels: &BTreeMap<[i64; 2], Label>, at: [i64; 2], axis: usize) -> Option<Point> {
    let beside = |along: i64, across: i64| {
        let mut there = at;
        there[axis] += along;
        there[1 - axis] += across;
        labels.get(&there).map(|&(point, _)| points[point])
    };
    [(-1, 0), (0, 0), (0, 1), (0, -1), (-1, 1), (-1, -1)].into_iter().find_map(|(along, across)| {
        let (a, b) = (beside(along, across)?, beside(along + 1, across)?);
        Some([b[0] - a[0], b[1] - a[1]])
    })
}

/// Numbers from zero, without rows at the border of which little is there where there are more than `wanted`.
fn trimmed(points: &[Point], labels: &BTreeMap<[i64; 2], Label>, wanted: [usize; 2]) -> Found {
    let mut kept: Vec<([i64; 2], Point)> = labels.iter().map(|(at, &(point, _))| (*at, points[point])).collect();
    loop {
        let ends = [0, 1].map(|c| {
            let list = || kept.iter().map(|(at, _)| at[c]);
            (list().min().unwrap_or(0), list().max().unwrap_or(0))
        });
        let size = ends.map(|(low, high)| (high - low + 1) as usize);
        let too_large = size.iter().max() > wanted.iter().max() || size.iter().min() > wanted.iter().min();
        let sparse = [0, 1].into_iter().flat_map(|c| [(c, ends[c].0), (c, ends[c].1)]).map(|(c, end)| {
            let n = kept.iter().filter(|(at, _)| at[c] == end).count();
            (n as f64 / size[1 - c] as f64, c, end)
        });
        let sparsest = sparse.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(share, ..)| too_large && *share < ROW_SHARE);
        let Some((_, c, end)) = sparsest else {
            let place = |(at, point): ([i64; 2], Point)| ([0, 1].map(|c| (at[c] - ends[c].0) as usize), point);
            return Found { size, points: kept.into_iter().map(place).collect() };
        };
        kept.retain(|(at, _)| at[c] != end);
    }
}

/// The shorter of two steps, px.
pub(super) fn shorter(steps: [Point; 2]) -> f64 {
    let [a, b] = steps.map(|step| distance(step, [0.0; 2]));
    a.min(b)
}
