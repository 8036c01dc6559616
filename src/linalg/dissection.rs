//! Nested dissection: of regular grids, and of any nodes in the plane.

use super::blocks::Pattern;

/// Parts of at most this many nodes are not cut further.
const LEAF: usize = 24;

/// An elimination order of the nodes of a grid of `columns` by `rows` nodes, numbered row by row:
/// the grid is cut in two by a line of nodes across its longer side, the halves come first, the line
/// last, recursively. Less fill and a much cheaper analysis than a minimum-degree order (George 1973).
///
/// ```
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

/// An elimination order for any pattern, by the places of its nodes: the nodes are cut in two at the median of
/// their longer extent, and those of one half that are coupled with the other come last, recursively. On a
/// pattern that couples neighbours of neighbours the separators are two lines wide.
///
/// # Panics
/// When there are fewer places than nodes.
pub fn geometric_dissection(pattern: &Pattern, places: &[[f64; 2]]) -> Vec<usize> {
    let n = pattern.n_nodes();
    let mut order = Vec::with_capacity(n);
    let mut part: Vec<u32> = (0..n as u32).collect();
    // The half of each node in the cut at work; 0 outside it.
    let mut half = vec![0u8; n];
    halve(&mut part, pattern, places, &mut half, &mut order);
    order
}

fn halve(part: &mut [u32], pattern: &Pattern, places: &[[f64; 2]], half: &mut [u8], order: &mut Vec<usize>) {
    if part.len() <= LEAF {
        order.extend(part.iter().map(|&node| node as usize));
        return;
    }
    let extent = [0, 1].map(|axis| {
        let along = || part.iter().map(|&node| places[node as usize][axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    });
    let axis = usize::from(extent[1] > extent[0]);
    let place = |node: u32| (places[node as usize][axis], places[node as usize][1 - axis], node);
    part.sort_unstable_by(|&a, &b| {
        let (a, b) = (place(a), place(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
    });
    // Nodes in line belong to the same half, so that the separator is a straight line of them.
    let middle = part.len() / 2;
    let first = part.partition_point(|&node| place(node).0 < place(part[middle]).0);
    let at = if first > 0 { first } else { middle };
    let (low, high) = part.split_at_mut(at);
    low.iter().for_each(|&node| half[node as usize] = 1);
    high.iter().for_each(|&node| half[node as usize] = 2);
    let mut separator: Vec<u32> = Vec::new();
    let mut rest: Vec<u32> = Vec::with_capacity(high.len());
    for &node in high.iter() {
        let touches = pattern.neighbours(node as usize).iter().any(|&near| half[near as usize] == 1);
        if touches { separator.push(node) } else { rest.push(node) }
    }
    low.iter().chain(high.iter()).for_each(|&node| half[node as usize] = 0);
    halve(low, pattern, places, half, order);
    halve(&mut rest, pattern, places, half, order);
    order.extend(separator.iter().map(|&node| node as usize));
}
