//! Edges of elements as few long lines.

use crate::mesh::Mesh;
use crate::units::Px;
use std::collections::HashMap;

/// The edges of the elements that `drawn` chooses.
pub(super) struct Edges {
    /// Every edge once.
    pub all: Vec<[u32; 2]>,
    /// Those that belong to one such element only: the border of what is drawn.
    pub border: Vec<[u32; 2]>,
}

impl Edges {
    pub fn new(mesh: &Mesh<Px>, elements: std::ops::Range<usize>, drawn: impl Fn(usize) -> bool) -> Self {
        let mut sides = Vec::new();
        for element in elements.filter(|&element| drawn(element)) {
            let nodes = mesh.elements()[element];
            for k in 0..4 {
                let (a, b) = (nodes[k], nodes[(k + 1) % 4]);
                // A triangle names its last node twice.
                if a != b {
                    sides.push([a.min(b), a.max(b)]);
                }
            }
        }
        sides.sort_unstable();
        let mut edges = Self { all: Vec::new(), border: Vec::new() };
        for same in sides.chunk_by(|a, b| a == b) {
            edges.all.push(same[0]);
            if same.len() == 1 {
                edges.border.push(same[0]);
            }
        }
        edges
    }
}

/// Lines of nodes along every edge once, as straight as can be: a grid becomes rows and columns, a border rings.
pub(super) fn lines(edges: &[[u32; 2]], at: impl Fn(u32) -> [f64; 2]) -> Vec<Vec<u32>> {
    // Edges at each node: where they begin in `spokes`.
    let mut degree: HashMap<u32, u32> = HashMap::new();
    edges.iter().flatten().for_each(|&node| *degree.entry(node).or_default() += 1);
    let mut spokes: HashMap<u32, Vec<usize>> = HashMap::with_capacity(degree.len());
    for (k, edge) in edges.iter().enumerate() {
        edge.iter().for_each(|&node| spokes.entry(node).or_default().push(k));
    }
    let mut used = vec![false; edges.len()];
    let mut lines = Vec::new();
    let turn = |from: u32, over: u32, to: u32| {
        let [a, b, c] = [from, over, to].map(&at);
        let (p, q) = ([b[0] - a[0], b[1] - a[1]], [c[0] - b[0], c[1] - b[1]]);
        (p[0] * q[0] + p[1] * q[1]) / (p[0].hypot(p[1]) * q[0].hypot(q[1])).max(f64::MIN_POSITIVE)
    };
    // A ring may turn as it likes; where lines cross, each goes straight on and ends rather than turn back.
    let least = |node: u32| if degree[&node] <= 2 { -2.0 } else { 0.0 };
    for first in 0..edges.len() {
        if used[first] {
            continue;
        }
        used[first] = true;
        let mut line = std::collections::VecDeque::from(edges[first]);
        for back in [false, true] {
            loop {
                let n = line.len();
                let (from, over) = if back { (line[1], line[0]) } else { (line[n - 2], line[n - 1]) };
                let next = spokes[&over].iter().filter(|&&k| !used[k]).map(|&k| {
                    let [a, b] = edges[k];
                    let to = if a == over { b } else { a };
                    (turn(from, over, to), k, to)
                });
                let Some((_, k, to)) = next.filter(|(cos, ..)| *cos > least(over)).max_by(|a, b| a.0.total_cmp(&b.0))
                else {
                    break;
                };
                used[k] = true;
                if back { line.push_front(to) } else { line.push_back(to) }
            }
        }
        lines.push(line.into());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Roi, Zone};

    fn mesh() -> Mesh<Px> {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: 40.0, y1: 24.0 };
        Mesh::on_zones(&[Zone::rectangle("all", roi)], 8, 64, 64).unwrap() // 5 x 3 elements
    }

    #[test]
    fn a_grid_becomes_its_rows_and_columns() {
        let mesh = mesh();
        let edges = Edges::new(&mesh, 0..15, |_| true);
        assert_eq!((edges.all.len(), edges.border.len()), (5 * 4 + 6 * 3, 2 * (5 + 3)));
        let lines = lines(&edges.all, |node| mesh.nodes()[node as usize]);
        // The outer lines may meet at a corner and go on.
        assert!((7..=10).contains(&lines.len()), "{lines:?}");
        let n: usize = lines.iter().map(|line| line.len() - 1).sum();
        assert_eq!(n, edges.all.len(), "every edge once");
    }

    #[test]
    fn a_border_becomes_closed_rings() {
        let mesh = mesh();
        // Without the element in the middle: a ring outside, a ring inside.
        let edges = Edges::new(&mesh, 0..15, |element| element != 7);
        let mut rings = lines(&edges.border, |node| mesh.nodes()[node as usize]);
        rings.sort_by_key(Vec::len);
        assert_eq!(rings.iter().map(Vec::len).collect::<Vec<_>>(), [5, 17]);
        assert!(rings.iter().all(|ring| ring.first() == ring.last()));
    }
}
