//! Points in square cells, so that those near a place are found.

use crate::plane::Point;
use std::collections::HashMap;

/// Points in square cells.
#[derive(Debug)]
pub struct PointCells<'a> {
    points: &'a [Point],
    size: f64,
    cells: HashMap<[i64; 2], Vec<usize>>,
}

impl<'a> PointCells<'a> {
    /// The points in cells of a `size` above zero.
    pub fn new(points: &'a [Point], size: f64) -> Self {
        let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
        for (k, point) in points.iter().enumerate() {
            cells.entry(point.map(|v| (v / size).floor() as i64)).or_default().push(k);
        }
        Self { points, size, cells }
    }

    /// Numbers of the points within `radius` of a place, and the way to them, in an order that depends on places alone.
    pub fn near(&self, [x, y]: Point, radius: f64) -> impl Iterator<Item = (usize, Point)> {
        let size = self.size;
        let ends = move |v: f64| ((v - radius) / size).floor() as i64..=((v + radius) / size).floor() as i64;
        let keys = ends(y).flat_map(move |j| ends(x).map(move |i| [i, j]));
        let listed = keys.filter_map(|key| self.cells.get(&key)).flatten();
        let way = move |&k: &usize| (k, [self.points[k][0] - x, self.points[k][1] - y]);
        listed.map(way).filter(move |(_, [dx, dy])| dx.hypot(*dy) <= radius)
    }
}
