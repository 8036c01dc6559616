//! Nested dissection: of regular grids, and of any nodes in the plane.

use super::blocks::Pattern;
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
    fn cut(mut set: Vec<usize>, pattern: &Pattern, points: &[[f64; 2]], half: &mut [u8], order: &mut Vec<usize>) {
        let extent = |k: usize| {
            let bound = |pick: fn(f64, f64) -> f64, start: f64| set.iter().map(|&n| points[n][k]).fold(start, pick);
            bound(f64::max, f64::NEG_INFINITY) - bound(f64::min, f64::INFINITY)
        };
        if set.len() <= LEAF {
            order.extend(set);
            return;
        }
        let axis = usize::from(extent(1) > extent(0));
        set.sort_by(|&a, &b| points[a][axis].total_cmp(&points[b][axis]).then(a.cmp(&b)));
        // Nodes in line stay together, so that on a grid a straight line separates the halves.
        let middle = points[set[set.len() / 2]][axis];
        let in_line = set.partition_point(|&n| points[n][axis] < middle);
        let upper = set.split_off(if in_line > 0 { in_line } else { set.len() / 2 });
        // 1: lower half, 2: upper half, 0: neither.
        set.iter().for_each(|&n| half[n] = 1);
        upper.iter().for_each(|&n| half[n] = 2);
        let between = |n: usize| pattern.columns()[pattern.row(n)].iter().any(|&other| half[other as usize] == 2);
        let (separator, lower): (Vec<_>, Vec<_>) = set.iter().partition(|&&n| between(n));
        set.iter().chain(&upper).for_each(|&n| half[n] = 0);
        cut(lower, pattern, points, half, order);
        cut(upper, pattern, points, half, order);
        order.extend(separator);
    }
    let mut order = Vec::with_capacity(nodes.len());
    let mut half = vec![0; points.len()];
    cut(nodes.collect(), pattern, points, &mut half, &mut order);
    order
}
