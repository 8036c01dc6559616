//! Points of a measured field as the nodes of four-node elements.

use super::cells::PointCells;
use super::{Neighbours, ZoneElements};
use crate::plane::{Point, bounds};

/// Distance within which a point stands where the grid expects it, of the shorter step.
const NEAR: f64 = 0.3;
/// How far a neighbour is looked for, in distances of nearest points: grids are seldom longer than so in one direction.
const REACH: f64 = 4.0;
/// Points from which the steps are estimated.
const SAMPLE: usize = 2000;
/// Share of the elements from which on a connected part is a zone of its own.
const ZONE_SHARE: f64 = 0.02;

/// The point closest to a place within `radius`.
fn closest(cells: &PointCells<'_>, at: Point, radius: f64) -> Option<u32> {
    cells.near(at, radius).min_by(|a, b| square(&a.1).total_cmp(&square(&b.1))).map(|(k, _)| k as u32)
}

fn square([x, y]: &Point) -> f64 {
    x * x + y * y
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The two steps of the grid on which `points` lie, the first towards x, the second towards y; nothing where most have
/// no neighbours that agree.
fn steps(points: &[[f64; 2]]) -> Option<[[f64; 2]; 2]> {
    let [[x0, y0], [x1, y1]] = bounds(points);
    let guess = ((x1 - x0) * (y1 - y0) / points.len() as f64).sqrt();
    if !(guess.is_finite() && guess > 0.0) {
        return None;
    }
    let rough = PointCells::new(points, guess);
    let sampled = || points.iter().step_by(points.len().div_ceil(SAMPLE));
    let nearest = |&at: &[f64; 2]| -> Option<[f64; 2]> {
        let others = |radius| rough.near(at, radius).map(|(_, d)| d).filter(|d| *d != [0.0; 2]);
        [1.0, REACH].into_iter().find_map(|far| others(far * guess).min_by(|a, b| square(a).total_cmp(&square(b))))
    };
    let offsets: Vec<[f64; 2]> = sampled().filter_map(nearest).collect();
    let distance = median(offsets.iter().map(|[dx, dy]| dx.hypot(*dy)).collect())?;
    // A grid looks the same after a quarter of a turn: the mean of its direction is that of four times the angle.
    let (sum_cos, sum_sin) = offsets.iter().fold((0.0, 0.0), |(c, s), [dx, dy]| {
        let four = 4.0 * dy.atan2(*dx);
        (c + four.cos(), s + four.sin())
    });
    let turned = sum_sin.atan2(sum_cos) / 4.0;
    let cells = PointCells::new(points, distance);
    let along = |angle: f64| -> Option<[f64; 2]> {
        let (sin, cos) = angle.sin_cos();
        // Within 30 degrees of the direction.
        let ahead = |[dx, dy]: &[f64; 2]| {
            let (along, across) = (dx * cos + dy * sin, dy * cos - dx * sin);
            along > 0.0 && across.abs() < 0.58 * along
        };
        let next = |&at: &[f64; 2]| {
            let of_sector = cells.near(at, REACH * distance).map(|(_, d)| d).filter(ahead);
            of_sector.min_by(|a, b| a[0].hypot(a[1]).total_cmp(&b[0].hypot(b[1])))
        };
        let found: Vec<[f64; 2]> = sampled().filter_map(next).collect();
        Some([median(found.iter().map(|d| d[0]).collect())?, median(found.iter().map(|d| d[1]).collect())?])
    };
    Some([along(turned)?, along(turned + std::f64::consts::FRAC_PI_2)?])
}

/// The four-node elements between `points` that lie on a grid, which may be turned, slightly uneven and have holes; or
/// nothing where fewer than half of them do.
///
/// An element is made where all four corners are there. Parts that do not touch are zones, named `1`, `2`, ... from top
/// to bottom (y down), or `all` if there is one; small islands belong to the zone whose rectangle is nearest. The second
/// list has the place of each node of the zones, one after the other, in `points`.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::mesh::elements_of_points;
/// let points: Vec<[f64; 2]> = (0..12).map(|k| [10.0 + 5.0 * (k % 4) as f64, 7.0 + 6.0 * (k / 4) as f64]).collect();
/// let (zones, places) = elements_of_points(&points).unwrap();
/// assert_eq!((zones[0].elements.len(), places.len()), (6, 12));
/// assert!(elements_of_points(&[[0.0, 0.0], [1.0, 0.3], [0.2, 5.0], [7.0, 1.0]]).is_none());
/// ```
pub fn elements_of_points(points: &[[f64; 2]]) -> Option<(Vec<ZoneElements>, Vec<usize>)> {
    let [a, b] = steps(points)?;
    let (step_a, step_b) = (a[0].hypot(a[1]), b[0].hypot(b[1]));
    let near = NEAR * step_a.min(step_b);
    let cells = PointCells::new(points, step_a.min(step_b));
    let beside = |k: u32, step: [f64; 2]| {
        let [x, y] = points[k as usize];
        closest(&cells, [x + step[0], y + step[1]], near)
    };
    let element = |k: u32| {
        let (right, below) = (beside(k, a)?, beside(k, b)?);
        let across = beside(right, b)?;
        (beside(below, a) == Some(across)).then_some([k, right, across, below])
    };
    let elements: Vec<[u32; 4]> = (0..points.len() as u32).filter_map(element).collect();
    let mut is_used = vec![false; points.len()];
    elements.iter().flatten().for_each(|&k| is_used[k as usize] = true);
    if elements.is_empty() || 2 * is_used.iter().filter(|&&used| used).count() < points.len() {
        return None;
    }
    Some(in_zones(points, &elements))
}

/// The elements as zones; and the place in `points` of each node.
fn in_zones(points: &[[f64; 2]], elements: &[[u32; 4]]) -> (Vec<ZoneElements>, Vec<usize>) {
    let parts = Neighbours::among(points.len(), elements).bodies(|_| true);
    let bounds_of =
        |part: &Vec<usize>| bounds(part.iter().flat_map(|&element| elements[element]).map(|k| &points[k as usize]));
    let least = (ZONE_SHARE * elements.len() as f64).ceil() as usize;
    let mut large: Vec<[Point; 2]> = parts.iter().filter(|part| part.len() >= least).map(bounds_of).collect();
    large.sort_by(|[p, _], [q, _]| p[1].total_cmp(&q[1]).then(p[0].total_cmp(&q[0])));
    // A part that is large is its own zone, also where it lies within the rectangle of another.
    let gap = |[low, high]: &[Point; 2], [low_q, high_q]: &[Point; 2]| {
        let along = |c: usize| (low[c] - high_q[c]).max(low_q[c] - high[c]).max(0.0);
        along(0).hypot(along(1))
    };
    let n_zones = large.len().max(1);
    let mut zone_of = vec![0; elements.len()];
    for part in &parts {
        let own = bounds_of(part);
        let distances = large.iter().map(|other| if *other == own { -1.0 } else { gap(&own, other) });
        let zone = distances.enumerate().min_by(|p, q| p.1.total_cmp(&q.1)).map_or(0, |(zone, _)| zone);
        part.iter().for_each(|&element| zone_of[element] = zone);
    }
    let name = |zone: usize| if n_zones == 1 { "all".to_owned() } else { (zone + 1).to_string() };
    let mut zones: Vec<ZoneElements> =
        (0..n_zones).map(|zone| ZoneElements { name: name(zone), ..ZoneElements::default() }).collect();
    let (mut number, mut places) = (vec![u32::MAX; points.len()], vec![Vec::new(); n_zones]);
    for (corners, &zone) in elements.iter().zip(&zone_of) {
        for k in corners.map(|k| k as usize) {
            if number[k] == u32::MAX {
                number[k] = zones[zone].nodes.len() as u32;
                zones[zone].nodes.push(points[k]);
                places[zone].push(k);
            }
        }
        zones[zone].elements.push(corners.map(|k| number[k as usize]));
    }
    (zones, places.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid of 12 by 9 points, turned, every place shifted by a little.
    fn points(degrees: f64, steps: [f64; 2], uneven: f64) -> Vec<[f64; 2]> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let place = |k: usize| {
            let (i, j) = ((k % 12) as f64 * steps[0], (k / 12) as f64 * steps[1]);
            let off = uneven * (k as f64 * 2.399).sin();
            [300.0 + cos * i - sin * j + off, 200.0 + sin * i + cos * j - off]
        };
        (0..108).map(place).collect()
    }

    #[test]
    fn a_grid_is_found_turned_uneven_and_stretched_in_any_order_of_its_points() {
        for (degrees, steps, uneven) in
            [(0.0, [5.0, 5.0], 0.0), (30.0, [5.0, 5.0], 0.2), (-44.0, [7.0, 7.0], 0.0), (3.0, [4.0, 9.0], 0.3)]
        {
            let mut list = points(degrees, steps, uneven);
            list.reverse();
            list.swap(3, 70);
            let (zones, places) = elements_of_points(&list).unwrap();
            assert_eq!((zones.len(), zones[0].name.as_str()), (1, "all"), "{degrees}");
            assert_eq!((zones[0].elements.len(), places.len()), (11 * 8, 108), "{degrees}");
            assert!(places.iter().zip(&zones[0].nodes).all(|(&place, node)| list[place] == *node));
        }
    }

    #[test]
    fn a_hole_has_no_element_and_parts_that_do_not_touch_are_zones_from_top_to_bottom() {
        let mut list = points(0.0, [5.0, 5.0], 0.0);
        list.remove(5 + 4 * 12);
        assert_eq!(elements_of_points(&list).unwrap().0[0].elements.len(), 11 * 8 - 4);
        list.retain(|[_, y]| *y != 220.0);
        let (zones, _) = elements_of_points(&list).unwrap();
        let named: Vec<_> = zones.iter().map(|zone| (zone.name.as_str(), zone.elements.len())).collect();
        assert_eq!(named, [("1", 33), ("2", 33)]);
        assert!(zones[0].nodes.iter().all(|node| node[1] < 220.0));
    }

    #[test]
    fn points_at_random_and_on_a_line_form_no_grid() {
        // The golden angle: evenly spread, nowhere on a grid.
        let spread = |k: usize| {
            let (radius, angle) = ((k as f64).sqrt(), k as f64 * 2.399_963);
            [radius * angle.cos(), radius * angle.sin()]
        };
        assert!(elements_of_points(&(0..300).map(spread).collect::<Vec<_>>()).is_none());
        assert!(elements_of_points(&(0..30).map(|k| [k as f64, 2.0]).collect::<Vec<_>>()).is_none());
        assert!(elements_of_points(&[]).is_none());
    }
}
