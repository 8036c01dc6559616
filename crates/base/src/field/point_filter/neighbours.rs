//! Who stands beside whom on the elements that count.

use crate::linalg::by_key;
use crate::mesh::{Mesh, corners_of};
use crate::units::Length;

/// No element.
const NONE: u32 = u32::MAX;
/// Two elements are alike when their corners differ by less than this share of their sides.
const ALIKE: f64 = 1e-6;

/// Elements and nodes around each node, as far as the elements are live.
#[derive(Debug)]
pub(super) struct Neighbours {
    /// For each node the live parallelogram whose corner 0, 1, 2, 3 it is.
    quadrants: Vec<[u32; 4]>,
    /// Live elements of each node: those of node `n` from `first[n]` on.
    first: Vec<u32>,
    elements: Vec<u32>,
    /// Whether an element is live and has the sides of the first live one of its zone.
    regular: Vec<bool>,
    /// Elements between a node and the nearest that is not in the middle of four regular ones; as far as [`FAR`].
    depth: Vec<u8>,
}

/// Depth from which a node knows nothing of borders: what they do to a coefficient falls to 0.268 from node to node.
pub(super) const FAR: u8 = 4;

/// What lies around a node that is the middle of a rectangle of regular elements: elements to its sides (towards corner
/// 1 the last of the first pair), each at most [`FAR`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Extent {
    pub before: [u8; 2],
    pub after: [u8; 2],
}

/// The sides of the first live parallelogram of each zone, from its corner 0 to 1 and 3.
pub(super) type Sides = Vec<Option<[[f64; 2]; 2]>>;

impl Neighbours {
    /// Those of a mesh with these live elements, and the sides of elements that count as regular.
    pub fn new<U: Length>(mesh: &Mesh<U>, live: &[bool]) -> (Self, Sides) {
        let n_nodes = mesh.n_nodes();
        let corners = |element: usize| corners_of(&mesh.elements()[element]);
        let live_elements = || (0..mesh.n_elements()).filter(|&element| live[element]);
        let of_nodes =
            live_elements().flat_map(|element| corners(element).iter().map(move |&node| (node, element as u32)));
        let (first, elements) = by_key(n_nodes, of_nodes);
        let mut quadrants = vec![[NONE; 4]; n_nodes];
        let mut regular = vec![false; mesh.n_elements()];
        let mut sides: Sides = vec![None; mesh.zones().len()];
        for element in live_elements() {
            let [a, b, c, d] = mesh.corners(element);
            let own = [[b[0] - a[0], b[1] - a[1]], [d[0] - a[0], d[1] - a[1]]];
            let size = own.iter().flatten().fold(0.0f64, |size, v| size.max(v.abs()));
            let near = |p: f64, q: f64| (p - q).abs() <= ALIKE * size;
            let opposite = [0, 1].into_iter().all(|k| near(c[k] - a[k], own[0][k] + own[1][k]));
            if corners(element).len() < 4 || !opposite {
                continue;
            }
            let of_zone = sides[mesh.element_zone()[element] as usize].get_or_insert(own);
            if own.iter().flatten().zip(of_zone.iter().flatten()).all(|(&p, &q)| near(p, q)) {
                regular[element] = true;
                for (corner, &node) in mesh.elements()[element].iter().enumerate() {
                    quadrants[node as usize][corner] = element as u32;
                }
            }
        }
        let mut neighbours = Self { quadrants, first, elements, regular, depth: Vec::new() };
        neighbours.depth = neighbours.depths(mesh);
        (neighbours, sides)
    }

    /// Live elements around a node.
    pub fn around(&self, node: usize) -> &[u32] {
        &self.elements[self.first[node] as usize..self.first[node + 1] as usize]
    }

    /// Whether a live element has the sides of the first one of its zone.
    pub fn is_regular(&self, element: usize) -> bool {
        self.regular[element]
    }

    /// Whether no border is within [`FAR`] elements.
    pub fn is_far(&self, node: usize) -> bool {
        self.depth[node] >= FAR
    }

    fn depths<U: Length>(&self, mesh: &Mesh<U>) -> Vec<u8> {
        let is_core = |node: usize| self.around(node).len() == 4 && !self.quadrants[node].contains(&NONE);
        let mut depth: Vec<u8> = (0..mesh.n_nodes()).map(|node| if is_core(node) { FAR } else { 0 }).collect();
        let mut ring: Vec<u32> = (0..mesh.n_nodes() as u32).filter(|&node| depth[node as usize] == 0).collect();
        for distance in 1..FAR {
            let mut next = Vec::new();
            for &node in &ring {
                for &element in self.around(node as usize) {
                    for &other in &mesh.elements()[element as usize] {
                        if depth[other as usize] > distance {
                            depth[other as usize] = distance;
                            next.push(other);
                        }
                    }
                }
            }
            ring = next;
        }
        depth
    }

    /// The node one side away along direction 0 (from corner 0 to 1) or 1 (from 0 to 3), forward or back.
    fn step<U: Length>(&self, mesh: &Mesh<U>, node: usize, direction: usize, forward: bool) -> Option<usize> {
        // Corner of the node and of the one beside it, in either of the two elements at the side.
        let pairs = match (direction, forward) {
            (0, true) => [(0, 1), (3, 2)],
            (0, false) => [(1, 0), (2, 3)],
            (_, true) => [(0, 3), (1, 2)],
            (_, false) => [(3, 0), (2, 1)],
        };
        pairs.into_iter().find_map(|(own, other)| {
            let element = self.quadrants[node][own];
            (element != NONE).then(|| mesh.elements()[element as usize][other] as usize)
        })
    }

    /// The nine nodes around one in the middle of four regular elements, row by row.
    pub fn nine<U: Length>(&self, mesh: &Mesh<U>, node: usize) -> [u32; 9] {
        let of = |quadrant: usize| mesh.elements()[self.quadrants[node][quadrant] as usize];
        let ([_, e, se, s], [w, _, _, sw], [nw, n, ..], [_, ne, ..]) = (of(0), of(1), of(2), of(3));
        [nw, n, ne, w, node as u32, e, sw, s, se]
    }

    /// The rectangle of regular elements, with its nodes row by row, that all within [`FAR`] elements of a node may be.
    pub fn rectangle<U: Length>(&self, mesh: &Mesh<U>, node: usize) -> Option<(Extent, Vec<u32>)> {
        let count = |direction: usize, forward: bool| {
            let mut at = node;
            for n in 0..FAR {
                match self.step(mesh, at, direction, forward) {
                    Some(next) => at = next,
                    None => return (n, at),
                }
            }
            (FAR, at)
        };
        let ((left, _), (right, _)) = (count(0, false), count(0, true));
        let ((up, top), (down, _)) = (count(1, false), count(1, true));
        if left + right == 0 || up + down == 0 {
            return None;
        }
        let extent = Extent { before: [left, up], after: [right, down] };
        let (columns, rows) = (usize::from(left + right), usize::from(up + down));
        let mut nodes = Vec::with_capacity((columns + 1) * (rows + 1));
        let mut row_at = top;
        for j in 0..=rows {
            let mut at = row_at;
            for _ in 0..left {
                at = self.step(mesh, at, 0, false)?;
            }
            for i in 0..=columns {
                // Elements to the four sides: there within the rectangle, and not there beyond an end of it.
                let wanted = |inside: [bool; 2], beyond_far: [bool; 2]| match inside {
                    [true, true] => Some(true),
                    _ if beyond_far.contains(&true) => None,
                    _ => Some(false),
                };
                let [west, east, north, south] = [i > 0, i < columns, j > 0, j < rows];
                let far = [(i == 0 && left == FAR), (i == columns && right == FAR)];
                let far_y = [(j == 0 && up == FAR), (j == rows && down == FAR)];
                let quadrants = [
                    wanted([east, south], [far[1], far_y[1]]),
                    wanted([west, south], [far[0], far_y[1]]),
                    wanted([west, north], [far[0], far_y[0]]),
                    wanted([east, north], [far[1], far_y[0]]),
                ];
                let fits = (0..4).all(|k| quadrants[k].is_none_or(|there| there == (self.quadrants[at][k] != NONE)));
                let n_wanted = quadrants.iter().filter(|there| **there == Some(true)).count();
                let is_known = !quadrants.contains(&None);
                if !fits || is_known && self.around(at).len() != n_wanted {
                    return None;
                }
                nodes.push(at as u32);
                if i < columns {
                    at = self.step(mesh, at, 0, true)?;
                }
            }
            if j < rows {
                row_at = self.step(mesh, row_at, 1, true)?;
            }
        }
        // Rows that do not hang together, as around the tip of a cut, have nodes twice or elements of others.
        let is_row = |j: usize| {
            let row = |j: usize, i: usize| nodes[j * (columns + 1) + i];
            (0..columns).all(|i| {
                let element = self.quadrants[row(j, i) as usize][0];
                mesh.elements()[element as usize] == [row(j, i), row(j, i + 1), row(j + 1, i + 1), row(j + 1, i)]
            })
        };
        (0..rows).all(is_row).then_some((extent, nodes))
    }
}
