//! Nested dissection of regular grids.

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
