//! Nested dissection: of regular grids, and of any nodes in the plane.

use super::blocks::Pattern;
use crate::plane::bounds;
use std::ops::Range;

/// Parts of at most this many nodes are not cut further.
const LEAF: usize = 24;

/// An elimination order of the nodes of a grid of `columns` by `rows` nodes, numbered row by row:
/// the grid is cut in two by a line of nodes across its longer side, the halves come first, the line
/// last, recursively. Less fill and a much cheaper analysis than a minimum-degree order (George 1973).
///
/// ```
/// # use quadrille_base as quadrille;
/// let order = quadrille::linalg::nested_dissection(9, 5);
/// let mut sorted = order.clone();
/// sorted.sort();
/// assert_eq!(sorted, (0..45).collect::<Vec<_>>());
/// ```
pub fn nested_dissection(columns: usize, rows: usize) -> Vec<usize> {
    fn cut(x: (usize, usize), y: (usize, usize), columns: usize, order: &mut Vec<usize>) {
        let (nx, ny) = (x.1 - x.0, y.1 - y.0);
        if nx * ny <= LEAF || nx.max(ny) < 3 {
            order.extend((y.0..y.1).flat_map(|j| (x.0..x.1).map(move |i| j * columns + i)));
        } else if nx >= ny {
            let middle = x.0 + nx / 2;
            cut((x.0, middle), y, columns, order);
            cut((middle + 1, x.1), y, columns, order);
            cut((middle, middle + 1), y, columns, order);
        } else {
            let middle = y.0 + ny / 2;
            cut(x, (y.0, middle), columns, order);
            cut(x, (middle + 1, y.1), columns, order);
            cut(x, (middle, middle + 1), columns, order);
        }
    }
    let mut order = Vec::with_capacity(columns * rows);
    cut((0, columns), (0, rows), columns, &mut order);
    order
}

/// An elimination order of the nodes in `nodes`, which may lie anywhere: the set is cut in two halves across
/// its longer side; those nodes of the first half that are coupled to the second come last, recursively. On a
/// pattern that couples neighbours of neighbours what separates two halves of a grid is two lines wide.
pub fn dissection(pattern: &Pattern, points: &[[f64; 2]], nodes: Range<usize>) -> Vec<usize> {
    fn cut(set: Vec<u32>, pattern: &Pattern, points: &[[f64; 2]], is_upper: &mut [bool], order: &mut Vec<usize>) {
        if set.len() <= LEAF {
            order.extend(set.into_iter().map(|node| node as usize));
            return;
        }
        let [lower, upper, separator] = halve(set, points, is_upper, |node| pattern.neighbours(node as usize));
        cut(lower, pattern, points, is_upper, order);
        cut(upper, pattern, points, is_upper, order);
        order.extend(separator.into_iter().map(|node| node as usize));
    }
    let mut order = Vec::with_capacity(nodes.len());
    let mut is_upper = vec![false; points.len()];
    cut(nodes.map(|node| node as u32).collect(), pattern, points, &mut is_upper, &mut order);
    order
}

/// Two halves of a set, cut across its longer side, without those of the first that `neighbours` couples with the
/// second, which come last. `is_upper` is false everywhere, before and after.
pub(super) fn halve<'a>(
    mut set: Vec<u32>,
    points: &[[f64; 2]],
    is_upper: &mut [bool],
    neighbours: impl Fn(u32) -> &'a [u32],
) -> [Vec<u32>; 3] {
    let [low, high] = bounds(set.iter().map(|&k| &points[k as usize]));
    let axis = usize::from(high[1] - low[1] > high[0] - low[0]);
    let place = |k: u32| points[k as usize][axis];
    set.sort_unstable_by(|&a, &b| place(a).total_cmp(&place(b)).then(a.cmp(&b)));
    // What is in line stays together, so that on a grid a straight line separates the halves.
    let middle = place(set[set.len() / 2]);
    let in_line = set.partition_point(|&k| place(k) < middle);
    let upper = set.split_off(if in_line > 0 { in_line } else { set.len() / 2 });
    upper.iter().for_each(|&k| is_upper[k as usize] = true);
    let between = |&k: &u32| neighbours(k).iter().any(|&other| is_upper[other as usize]);
    let (separator, lower) = set.into_iter().partition(between);
    upper.iter().for_each(|&k| is_upper[k as usize] = false);
    [lower, upper, separator]
}
