//! Displacements at points from the coefficients of a projection (THEORY 17).
//!
//! What image correlation finds at a node is no value of the displacement there: it is the coefficient of the bilinear
//! field that is nearest to the displacement over the elements, which overshoots at the nodes by `h^2 u''/12`. A sum
//! over the coefficients nearby takes that off, and has less noise.

mod functional;
mod neighbours;
mod patch;

use super::{ElementMark, Measurement, PointField};
use crate::mesh::Mesh;
use crate::units::Length;
use functional::Fit;
use neighbours::{Extent, Neighbours, Sides};
use patch::{PATCH, Patch, Seen, in_frame, of_rectangle, within_reach};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Weight of the coefficient itself along an axis of a regular mesh; a twelfth is on either neighbour.
const OWN: f64 = 10.0 / 12.0;
const BESIDE: f64 = 1.0 / 12.0;
/// Correlation of neighbouring coefficients along an axis of a regular mesh, `sqrt(3) - 2`.
const CORRELATION: f64 = -0.267_949_192_431_122_7;
/// Nodes that one thread takes at a time.
const PIECE: usize = 512;

/// What makes values at points of the coefficients of one mesh with the same live elements.
///
/// Inside a regular mesh it is the filter (1, 10, 1)/12 along both axes; elsewhere (borders, masks, cuts, distorted
/// elements, nodes without measurement) the least change of the coefficient, among those within three elements, that is
/// right for polynomials up to the third degree. No coefficient is taken from beyond a cut or from another zone.
///
/// ```
/// # use quadrille_base as quadrille;
/// # use quadrille::{field::{Measurement, PointFilter, Status}, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 160.0, y1: 160.0 };
/// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 160, 160).unwrap(); // 11 x 11 nodes
/// // The coefficients of u = x^2: too low by h^2/6.
/// let displacement: Vec<_> = mesh.nodes().iter().map(|x| [x[0] * x[0] - 256.0 / 6.0, 0.0]).collect();
/// # let field = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 121], measured: vec![true; 121],
/// #     element_residual: vec![1.0; 100], model_error: None, marks: None, points: None, mesh: mesh.into(), displacement };
/// let points = PointFilter::new(&field.mesh, &field.measured, None).of(&field);
/// for (node, x) in field.mesh.nodes().iter().enumerate() {
///     assert!(points.is_value[node] && (points.displacement[node][0] - x[0] * x[0]).abs() < 1e-6);
/// }
/// assert!((points.sigma[60][0] / field.sigma[60][0] - 0.635).abs() < 1e-3); // less noise in the middle
/// ```
#[derive(Debug)]
pub struct PointFilter {
    /// Whether an element is in the field, with all its nodes measured; empty where all coefficients are kept.
    live: Vec<bool>,
    /// The sides of elements that count as regular.
    sides: Sides,
    rows: Vec<Row>,
    made: Arc<Made>,
}

/// What makes the value of one node.
#[derive(Debug, Clone)]
enum Row {
    /// The coefficient stays.
    Coefficient,
    /// The filter of a regular mesh on the nine nodes around, row by row.
    Inside([u32; 9]),
    /// A fit, in a frame given by its columns.
    Near { nodes: Arc<[u32]>, fit: Arc<Fit>, frame: [[f64; 2]; 2] },
}

/// Fits that many nodes share, also of several fields.
#[derive(Debug, Default)]
struct Made {
    rectangles: Mutex<HashMap<Extent, Option<Arc<Fit>>>>,
    patches: Mutex<HashMap<Vec<u16>, Option<Arc<Fit>>>>,
    /// How many patches there were when those that nobody uses any more were last thrown away.
    left: AtomicUsize,
}

impl Made {
    /// What is made for a key, once; made twice at the same time it has the same bits.
    fn of<K: std::hash::Hash + Eq>(
        made: &Mutex<HashMap<K, Option<Arc<Fit>>>>,
        key: K,
        make: impl FnOnce() -> Option<Fit>,
    ) -> Option<Arc<Fit>> {
        let known = made.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        known.unwrap_or_else(|| {
            let fit = make().map(Arc::new);
            made.lock().unwrap_or_else(PoisonError::into_inner).entry(key).or_insert(fit).clone()
        })
    }

    /// Throws unused patches away once they may be more than half: where nodes are lost in noise frames differ.
    fn thin_out(&self) {
        const FEW: usize = 4096;
        let mut patches = self.patches.lock().unwrap_or_else(PoisonError::into_inner);
        if patches.len() > FEW.max(2 * self.left.load(Ordering::Relaxed)) {
            patches.retain(|_, fit| fit.as_ref().is_some_and(|fit| Arc::strong_count(fit) > 1));
            patches.shrink_to_fit();
            self.left.store(patches.len(), Ordering::Relaxed);
        }
    }
}

impl PointFilter {
    /// For fields on `mesh` where these nodes are measured; elements whose mark says they are left out do not count.
    pub fn new<U: Length>(mesh: &Mesh<U>, measured: &[bool], marks: Option<&[ElementMark]>) -> Self {
        Self::after(mesh, live_elements(mesh, measured, marks), None)
    }

    /// For fields that were regularised: all coefficients stay. They are none of a projection: what the penalty takes
    /// from a wave is of the size of what the projection adds, or more.
    pub fn none() -> Self {
        Self { live: Vec::new(), sides: Sides::new(), rows: Vec::new(), made: Arc::default() }
    }

    /// As [`PointFilter::new`], with the rows that it has in common with another filter for the same mesh.
    fn after<U: Length>(mesh: &Mesh<U>, live: Vec<bool>, other: Option<&Self>) -> Self {
        let (neighbours, sides) = Neighbours::new(mesh, &live);
        let made = other.map_or_else(Arc::default, |other| Arc::clone(&other.made));
        let (rows, changed) = match other.filter(|other| other.sides == sides) {
            Some(other) => (&*other.rows, near_changes(mesh, &live, &other.live)),
            None => (&[][..], Vec::new()),
        };
        let row = |seen: &mut Seen, node: usize| match (rows.get(node), changed.get(node)) {
            (Some(row), Some(false)) => row.clone(),
            _ => Row::new(mesh, &neighbours, &made, seen, node),
        };
        let nothing = || Seen::nothing(mesh.n_nodes(), mesh.n_elements());
        let rows = (0..mesh.n_nodes()).into_par_iter().with_min_len(PIECE / 2).map_init(nothing, row).collect();
        made.thin_out();
        Self { live, sides, rows, made }
    }

    /// The values of a field whose live elements are those that this was made for.
    ///
    /// # Panics
    /// When the field is on another mesh.
    pub fn of<U: Length>(&self, field: &Measurement<U>) -> PointField {
        let n = field.displacement.len();
        if self.rows.is_empty() {
            let (displacement, sigma) = (field.displacement.clone(), field.sigma.clone());
            return PointField { displacement, sigma, is_value: vec![false; n] };
        }
        assert_eq!(n, self.rows.len(), "the mesh that the filter was made for");
        let of_node = |node: usize| self.rows[node].of(field, node);
        let all: Vec<_> = (0..n).into_par_iter().with_min_len(PIECE).map(of_node).collect();
        let mut points = PointField::default();
        for (displacement, sigma, is_value) in all {
            points.displacement.push(displacement);
            points.sigma.push(sigma);
            points.is_value.push(is_value);
        }
        points
    }

    /// The value at a node as a sum over coefficients.
    pub fn at_node(&self, node: usize) -> Vec<(usize, f64)> {
        self.rows.get(node).map_or_else(|| vec![(node, 1.0)], |row| row.value(node))
    }

    /// The value at a place between nodes as a sum over coefficients; `shape` are the bilinear weights there of the
    /// corners of an element, or of the ends of an edge. It follows their values and second derivatives, so that it
    /// is right for polynomials up to the third degree too, and continuous from element to element.
    pub fn at<U: Length>(&self, mesh: &Mesh<U>, shape: &[(usize, f64)]) -> Vec<(usize, f64)> {
        let at = |c: usize| shape.iter().map(|&(node, psi)| psi * mesh.nodes()[node][c]).sum::<f64>();
        let place = [at(0), at(1)];
        let corners: Vec<(usize, f64, [f64; 2])> = shape
            .iter()
            .filter(|(_, psi)| *psi != 0.0)
            .map(|&(node, psi)| (node, psi, [0, 1].map(|c| mesh.nodes()[node][c] - place[c])))
            .collect();
        // sum psi_j u_j - u is half of sum psi_j d_j H d_j for a parabola; two thirds of H from the place and one
        // from the node make it right for the third degree.
        let mean: [f64; 3] = corners.iter().fold([0.0; 3], |sum, (_, psi, [x, y])| {
            [sum[0] + psi * x * x, sum[1] + 2.0 * psi * x * y, sum[2] + psi * y * y]
        });
        let mut sum = Vec::new();
        for (node, psi, [x, y]) in corners {
            sum.extend(self.at_node(node).into_iter().map(|(other, w)| (other, psi * w)));
            let own = [x * x, 2.0 * x * y, y * y];
            let of_second: [f64; 3] = std::array::from_fn(|k| -psi * (own[k] / 6.0 + mean[k] / 3.0));
            if of_second != [0.0; 3]
                && let Some(row) = self.rows.get(node)
            {
                row.add_second(mesh, of_second, &mut sum);
            }
        }
        sum
    }

    /// Whether it was made for fields like this one.
    pub fn is_for<U: Length>(&self, field: &Measurement<U>) -> bool {
        self.live == live_elements(&field.mesh, &field.measured, field.marks.as_deref())
    }
}

/// Which elements are in a field, with all their nodes measured.
fn live_elements<U: Length>(mesh: &Mesh<U>, measured: &[bool], marks: Option<&[ElementMark]>) -> Vec<bool> {
    let is_in = |element: usize| marks.is_none_or(|marks| !marks[element].is_left_out());
    let is_whole = |nodes: &[u32; 4]| nodes.iter().all(|&node| measured[node as usize]);
    mesh.elements().iter().enumerate().map(|(element, nodes)| is_in(element) && is_whole(nodes)).collect()
}

/// The nodes within a patch of an element that lives in one of two fields alone; all others have the same row in both.
fn near_changes<U: Length>(mesh: &Mesh<U>, live: &[bool], other: &[bool]) -> Vec<bool> {
    let mut near = vec![false; mesh.n_nodes()];
    for ((nodes, a), b) in mesh.elements().iter().zip(live).zip(other) {
        if a != b {
            nodes.iter().for_each(|&node| near[node as usize] = true);
        }
    }
    for _ in 0..PATCH {
        let ring = near.clone();
        for nodes in mesh.elements() {
            if nodes.iter().any(|&node| ring[node as usize]) {
                nodes.iter().for_each(|&node| near[node as usize] = true);
            }
        }
    }
    near
}

/// Weights of the filter of a regular mesh, row by row.
fn of_nine() -> [f64; 9] {
    let along = [BESIDE, OWN, BESIDE];
    std::array::from_fn(|k| along[k % 3] * along[k / 3])
}

impl Row {
    fn new<U: Length>(mesh: &Mesh<U>, neighbours: &Neighbours, made: &Made, seen: &mut Seen, node: usize) -> Self {
        if neighbours.around(node).is_empty() {
            return Self::Coefficient;
        }
        if neighbours.is_far(node) {
            return Self::Inside(neighbours.nine(mesh, node));
        }
        if let Some((extent, nodes)) = neighbours.rectangle(mesh, node) {
            let fit = Made::of(&made.rectangles, extent, || of_rectangle(extent)?.fit());
            let element = neighbours.around(node)[0] as usize;
            let [a, b, _, d] = mesh.corners(element);
            let frame = [[b[0] - a[0], b[1] - a[1]], [d[0] - a[0], d[1] - a[1]]];
            let nodes = within_reach(extent, &nodes);
            return fit.map_or(Self::Coefficient, |fit| Self::Near { nodes: nodes.into(), fit, frame });
        }
        let Some(patch) = Patch::new(mesh, neighbours, seen, node) else { return Self::Coefficient };
        let make = || patch.around()?.fit();
        let fit = match patch.is_regular {
            true => Made::of(&made.patches, patch.key(), make),
            false => make().map(Arc::new),
        };
        let nodes = &patch.nodes[..patch.n_near()];
        fit.map_or(Self::Coefficient, |fit| Self::Near { nodes: nodes.into(), fit, frame: patch.frame })
    }

    fn of<U: Length>(&self, field: &Measurement<U>, node: usize) -> ([f64; 2], [f64; 2], bool) {
        let (u, sigma) = (field.displacement[node], field.sigma[node]);
        // The difference from the coefficient: a translation keeps its bits.
        let value = |nodes: &[u32], weights: &[f64]| {
            let mut value = u;
            for (&other, w) in nodes.iter().zip(weights) {
                let other = field.displacement[other as usize];
                (0..2).for_each(|c| value[c] += w * (other[c] - u[c]));
            }
            value
        };
        match self {
            _ if !field.measured[node] => ([0.0; 2], [0.0; 2], false),
            Self::Coefficient => (u, sigma, false),
            Self::Inside(nodes) => {
                let weights = of_nine();
                let of_component = |c: usize| {
                    let part: [f64; 9] = std::array::from_fn(|k| weights[k] * field.sigma[nodes[k] as usize][c]);
                    sigma_inside(&part)
                };
                (value(nodes, &weights), [of_component(0), of_component(1)], true)
            }
            Self::Near { nodes, fit, .. } => {
                let of_component = |c: usize| fit.sigma(|k| field.sigma[nodes[k] as usize][c]);
                (value(nodes, &fit.value), [of_component(0), of_component(1)], true)
            }
        }
    }

    fn value(&self, node: usize) -> Vec<(usize, f64)> {
        let pairs = |nodes: &[u32], weights: &[f64]| {
            nodes.iter().zip(weights).map(|(&other, &w)| (other as usize, w)).collect::<Vec<_>>()
        };
        match self {
            Self::Coefficient => vec![(node, 1.0)],
            Self::Inside(nodes) => pairs(nodes, &of_nine()),
            Self::Near { nodes, fit, .. } => pairs(nodes, &fit.value),
        }
    }

    /// Adds `by[0] u_xx + by[1] u_xy + by[2] u_yy` at the node to a sum over coefficients.
    fn add_second<U: Length>(&self, mesh: &Mesh<U>, by: [f64; 3], sum: &mut Vec<(usize, f64)>) {
        let (nodes, second, frame): (&[u32], [&[f64]; 3], _) = match self {
            Self::Coefficient => return,
            Self::Inside(nodes) => {
                let at = |k: usize| mesh.nodes()[nodes[k] as usize];
                let side = |k: usize| [at(k)[0] - at(4)[0], at(k)[1] - at(4)[1]];
                (nodes, SECOND_INSIDE.each_ref().map(<[f64; 9]>::as_slice), [side(5), side(7)])
            }
            Self::Near { nodes, fit, frame } => (nodes, fit.second.each_ref().map(Vec::as_slice), *frame),
        };
        // d/dx = t_x d/dt + s_x d/ds, and so on.
        let ([tx, sx], [ty, sy]) = (in_frame(frame, [1.0, 0.0]), in_frame(frame, [0.0, 1.0]));
        let of_tt = by[0] * tx * tx + by[1] * tx * ty + by[2] * ty * ty;
        let of_ts = 2.0 * by[0] * tx * sx + by[1] * (tx * sy + sx * ty) + 2.0 * by[2] * ty * sy;
        let of_ss = by[0] * sx * sx + by[1] * sx * sy + by[2] * sy * sy;
        let [tt, ts, ss] = second;
        sum.extend(
            nodes.iter().enumerate().map(|(k, &node)| (node as usize, of_tt * tt[k] + of_ts * ts[k] + of_ss * ss[k])),
        );
    }
}

/// Second differences of nine nodes along the first axis, both, and the second.
const SECOND_INSIDE: [[f64; 9]; 3] = [
    [0.0, 0.0, 0.0, 1.0, -2.0, 1.0, 0.0, 0.0, 0.0],
    [0.25, 0.0, -0.25, 0.0, 0.0, 0.0, -0.25, 0.0, 0.25],
    [0.0, 1.0, 0.0, 0.0, -2.0, 0.0, 0.0, 1.0, 0.0],
];

/// Standard deviation of a sum of nine with these, correlated by the product of what they are along both axes.
fn sigma_inside(part: &[f64; 9]) -> f64 {
    const R: f64 = CORRELATION;
    let correlated = |[a, b, c]: [f64; 3]| [a + R * b + R * R * c, R * (a + c) + b, R * R * a + R * b + c];
    let rows: [[f64; 3]; 3] = std::array::from_fn(|j| correlated([part[3 * j], part[3 * j + 1], part[3 * j + 2]]));
    let mut variance = 0.0;
    for i in 0..3 {
        let column = correlated([rows[0][i], rows[1][i], rows[2][i]]);
        variance += (0..3).map(|j| part[3 * j + i] * column[j]).sum::<f64>();
    }
    variance.max(0.0).sqrt()
}

/// The filters of a series of fields on one mesh: the last one is kept, and what it was made of.
#[derive(Debug, Default)]
pub struct PointFilters {
    last: Mutex<Option<Arc<PointFilter>>>,
}

impl PointFilters {
    /// The filter for a field: the last one where it fits.
    pub fn for_field<U: Length>(&self, field: &Measurement<U>) -> Arc<PointFilter> {
        let live = live_elements(&field.mesh, &field.measured, field.marks.as_deref());
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let last = last.filter(|last| last.rows.len() == field.mesh.n_nodes());
        if let Some(last) = &last
            && last.live == live
        {
            return Arc::clone(last);
        }
        let filter = Arc::new(PointFilter::after(&field.mesh, live, last.as_deref()));
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&filter));
        filter
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Status;
    use crate::mesh::{Roi, Zone};
    use crate::units::Px;

    #[test]
    fn patches_of_frames_that_are_gone_are_not_kept() {
        let roi = Roi { x0: 0.0, y0: 0.0, x1: 100.0, y1: 100.0 };
        let mesh: Arc<Mesh<Px>> = Arc::new(Mesh::on_zones(&[Zone::rectangle("all", roi)], 4, 100, 100).unwrap());
        let (n, filters) = (mesh.n_nodes(), PointFilters::default());
        let mut most = 0;
        for frame in 0..20usize {
            let mut measured = vec![true; n];
            // Other nodes are lost in every frame, one in 30 or so, so that hardly a patch is like another.
            (0..n).filter(|node| (node * 7919 + frame * 104_729).wrapping_mul(2_654_435_761) >> 7 & 31 == 0).for_each(
                |node| {
                    measured[node] = false;
                },
            );
            let field = Measurement {
                status: Status::Converged,
                displacement: vec![[0.0; 2]; n],
                sigma: vec![[0.01; 2]; n],
                measured,
                element_residual: vec![1.0; mesh.n_elements()],
                model_error: None,
                marks: None,
                points: None,
                mesh: Arc::clone(&mesh),
            };
            let filter = filters.for_field(&field);
            most = most.max(filter.made.patches.lock().unwrap().len());
        }
        // 20 frames of some 600 patches would be 12 000. Up to 4096, or twice those of the last frames, are kept, and
        // those of a frame come on top.
        assert!((400..5000).contains(&most), "{most} patches");
    }
}
