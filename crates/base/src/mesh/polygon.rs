//! Polygons of the reference image.

use super::pixel_set::PixelSet;
use super::{MeshError, Zone};
use crate::plane::{Point, cross, minus};

/// The sides of a polygon, the last one back to its first corner.
pub(super) fn sides(corners: &[Point]) -> impl Iterator<Item = [Point; 2]> + '_ {
    (0..corners.len()).map(|k| [corners[k], corners[(k + 1) % corners.len()]])
}

/// Distance of a point from a line between two points.
pub(super) fn distance(p: Point, [a, b]: [Point; 2]) -> f64 {
    let (d, e) = (minus(b, a), minus(p, a));
    let length = d[0] * d[0] + d[1] * d[1];
    let t = if length > 0.0 { ((e[0] * d[0] + e[1] * d[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
    (e[0] - t * d[0]).hypot(e[1] - t * d[1])
}

/// The pixels of `frame` whose centre lies in the polygon. Left and upper sides belong to it, right and
/// lower ones do not: a polygon that is a rectangle holds the pixels of that rectangle.
pub(super) fn fill(zone: &Zone, corners: &[Point], frame: [usize; 4]) -> Result<PixelSet, MeshError> {
    check(zone, corners)?;
    let [x0, y0, x1, y1] = frame;
    let width = x1.saturating_sub(x0);
    let mut bits = vec![false; width * y1.saturating_sub(y0)];
    let mut crossings = Vec::new();
    for y in y0..y1 {
        let row = y as f64;
        crossings.clear();
        crossings.extend(
            sides(corners)
                .filter(|[a, b]| (a[1] <= row) != (b[1] <= row))
                .map(|[a, b]| a[0] + (row - a[1]) / (b[1] - a[1]) * (b[0] - a[0])),
        );
        crossings.sort_by(f64::total_cmp);
        for pair in crossings.chunks_exact(2) {
            let column = |x: f64| x.ceil().clamp(x0 as f64, x1 as f64) as usize - x0;
            bits[(y - y0) * width..][column(pair[0])..column(pair[1])].fill(true);
        }
    }
    Ok(PixelSet::Raster { x0, y0, width, bits })
}

fn check(zone: &Zone, corners: &[Point]) -> Result<(), MeshError> {
    let name = || zone.name.clone();
    if let Some(corner) = corners.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(MeshError::NotFinite { zone: name(), corner });
    }
    let n = corners.len();
    let area: f64 = sides(corners).map(|[a, b]| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum();
    let no_polygon = MeshError::NoPolygon(name(), n);
    if n < 3 {
        return Err(no_polygon);
    }
    let all: Vec<_> = sides(corners).collect();
    for first in 0..n {
        for second in first + 1..n {
            let neighbours = second == first + 1 || (first == 0 && second == n - 1);
            if let Some([x, y]) = meeting(all[first], all[second]).filter(|_| !neighbours) {
                return Err(MeshError::CrossedPolygon { zone: name(), first, second, x, y });
            }
        }
    }
    if area.abs() < 1e-9 { Err(no_polygon) } else { Ok(()) }
}

/// Where two lines between points meet.
fn meeting([a, b]: [Point; 2], [c, d]: [Point; 2]) -> Option<Point> {
    let (r, s, q) = (minus(b, a), minus(d, c), minus(c, a));
    let denominator = cross(r, s);
    if denominator == 0.0 {
        // In line: they meet when an end of one lies on the other.
        let touches = [c, d].into_iter().find(|&p| distance(p, [a, b]) == 0.0);
        return touches.or_else(|| [a, b].into_iter().find(|&p| distance(p, [c, d]) == 0.0));
    }
    let (t, u) = (cross(q, s) / denominator, cross(q, r) / denominator);
    let between = |v: f64| (0.0..=1.0).contains(&v);
    (between(t) && between(u)).then(|| [a[0] + t * r[0], a[1] + t * r[1]])
}
