//! What the field may be off beyond noise (THEORY 11): an estimate for every node, without any pixel.
//!
//! Four parts, added as squares:
//! - **The mesh is too coarse.** A smooth displacement that the elements only follow with straight lines is overshot at
//!   the nodes by `h^2 u''/12` (projection of a parabola on linear elements; at an end as well): a twelfth of the
//!   second difference of the nodal values.
//! - **What the residual shows** ([`crate::correlate::noise::bend`]): waves of a few elements, cracks. The larger of this
//!   and the first counts, since both see the same.
//! - **A regularisation** draws the field to what it prefers: `a = A^-1 M a_true`, `A = M + w R`, is short of the truth
//!   by `A^-1 w R a_true`. Of that the first two terms of the series in the field found are taken.
//! - **The interpolation** is biased by the fraction of a pixel ([`InterpolationBias`]), alike at all nodes.

use crate::correlate::InterpolationBias;
use crate::linalg::Solver;
use crate::mesh::Mesh;
use crate::units::Px;

/// Error of a node in its second difference along a mesh line.
const OF_SECOND_DIFFERENCE: f64 = 1.0 / 12.0;
/// Variance of a second difference over the sum of its squared weights times variances: neighbouring nodes scatter
/// against each other (correlation -0.27 along a line of elements).
const CORRELATED: f64 = 1.38;
/// Cosine below which two edges of a node are one line.
const STRAIGHT: f64 = -0.8;

struct SecondDifference {
    nodes: [u32; 3],
    weights: [f64; 3],
}

pub(crate) struct MeshLines {
    differences: Vec<SecondDifference>,
    /// The second differences of each node, those of the lines through it.
    through: Vec<Vec<u32>>,
    /// Of the lines that end at it the next two: half a wave may hide in one.
    ending: Vec<Vec<[u32; 2]>>,
}

impl MeshLines {
    pub fn new(mesh: &Mesh<Px>) -> Self {
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); mesh.n_nodes()];
        for (nodes, k) in mesh.elements().iter().flat_map(|nodes| (0..4).map(move |k| (nodes, k))) {
            let [a, b] = [nodes[k], nodes[(k + 1) % 4]];
            if a != b {
                neighbours[a as usize].push(b);
                neighbours[b as usize].push(a);
            }
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let way = |from: usize, to: u32| {
            let (a, b) = (mesh.nodes()[from], mesh.nodes()[to as usize]);
            let d = [b[0] - a[0], b[1] - a[1]];
            (d, d[0].hypot(d[1]))
        };
        let n_nodes = mesh.n_nodes();
        let mut lines =
            Self { differences: Vec::new(), through: vec![Vec::new(); n_nodes], ending: vec![Vec::new(); n_nodes] };
        // Where a line goes on from a node: (node, neighbour) -> its second difference.
        let mut onwards: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n_nodes];
        for (node, around) in neighbours.iter().enumerate() {
            let opposite = |p: u32| -> Option<u32> {
                let (a, length_a) = way(node, p);
                let cosine = |q: u32| {
                    let (b, length_b) = way(node, q);
                    (a[0] * b[0] + a[1] * b[1]) / (length_a * length_b)
                };
                let straight = around.iter().copied().filter(|&q| cosine(q) < STRAIGHT);
                straight.min_by(|&q, &r| cosine(q).total_cmp(&cosine(r)))
            };
            for &p in around {
                let Some(q) = opposite(p).filter(|&q| p < q && opposite(q) == Some(p)) else { continue };
                let (h1, h2) = (way(node, p).1, way(node, q).1);
                let h = 0.5 * (h1 + h2);
                let at = lines.differences.len() as u32;
                let weights = [h / h1, -h / h1 - h / h2, h / h2];
                lines.differences.push(SecondDifference { nodes: [p, node as u32, q], weights });
                lines.through[node].push(at);
                onwards[node].extend([(p, at), (q, at)]);
            }
        }
        for (node, around) in neighbours.iter().enumerate() {
            for &p in around.iter().filter(|&&p| !onwards[node].iter().any(|&(to, _)| to == p)) {
                let from =
                    |node: u32, p: u32| onwards[p as usize].iter().find(|&&(to, _)| to == node).map(|&(_, at)| at);
                let Some(first) = from(node as u32, p) else { continue };
                let [a, _, b] = lines.differences[first as usize].nodes;
                let next = from(p, if a as usize == node { b } else { a });
                lines.ending[node].push([first, next.unwrap_or(first)]);
            }
        }
        lines
    }

    /// Square of the error of each displacement for want of nodes, px^2, less noise of `sigma` where it is `white`.
    fn coarseness(
        &self,
        displacement: &[[f64; 2]],
        sigma: &[[f64; 2]],
        measured: &[bool],
        white: bool,
    ) -> Vec<[f64; 2]> {
        let square_of = |SecondDifference { nodes, weights }: &SecondDifference| {
            if !nodes.iter().all(|&node| measured[node as usize]) {
                return [0.0; 2];
            }
            [0, 1].map(|c| {
                let terms = || nodes.iter().zip(weights);
                let difference: f64 = terms().map(|(&node, w)| w * displacement[node as usize][c]).sum();
                let noise: f64 = terms().map(|(&node, w)| (w * sigma[node as usize][c]).powi(2)).sum();
                difference * difference - if white { CORRELATED * noise } else { 0.0 }
            })
        };
        let squares: Vec<[f64; 2]> = self.differences.iter().map(square_of).collect();
        let of_node = |(through, ending): (&Vec<u32>, &Vec<[u32; 2]>)| {
            [0, 1].map(|c| {
                let square = |at: u32| squares[at as usize][c];
                let through: f64 = through.iter().map(|&at| square(at)).sum();
                let ending: f64 = ending.iter().map(|&[first, next]| square(first).max(square(next))).sum();
                OF_SECOND_DIFFERENCE.powi(2) * (through + ending).max(0.0)
            })
        };
        self.through.iter().zip(&self.ending).map(of_node).collect()
    }

    /// The error of each displacement beyond noise, px; zero at nodes that were not measured. `by_bending` is what the
    /// displacement that bends within the elements does to each node, px, and `solver` that of the frame.
    pub fn estimate_errors(
        &self,
        displacement: &[[f64; 2]],
        sigma: &[[f64; 2]],
        measured: &[bool],
        by_bending: &[[f64; 2]],
        solver: &Solver,
        of_interpolation: &InterpolationBias,
    ) -> Vec<[f64; 2]> {
        let coarse = self.coarseness(displacement, sigma, measured, !solver.is_held());
        let bias = bias_of_penalty(solver, displacement);
        let at = |node: usize| {
            if !measured[node] {
                return [0.0; 2];
            }
            let interpolated = of_interpolation.at(displacement[node]);
            [0, 1].map(|c| {
                let bias = bias.as_ref().map_or(0.0, |bias| bias[node][c]);
                let not_followed = coarse[node][c].max(by_bending[node][c].powi(2));
                (not_followed + bias * bias + interpolated[c].powi(2)).sqrt()
            })
        };
        (0..measured.len()).map(at).collect()
    }
}

/// What the penalty keeps from the field, `A^-1 w R (a + A^-1 w R a)`; none without a penalty.
fn bias_of_penalty(solver: &Solver, displacement: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    let penalty = solver.penalty()?;
    if !displacement.as_flattened().iter().all(|u| u.is_finite()) {
        return None;
    }
    let short =
        |field: &[[f64; 2]]| solver.solve((0..field.len()).map(|node| penalty.row_times(node, field)).collect());
    let first = short(displacement);
    let nearer: Vec<[f64; 2]> = displacement.iter().zip(&first).map(|(u, b)| [u[0] + b[0], u[1] + b[1]]).collect();
    Some(short(&nearer))
}
