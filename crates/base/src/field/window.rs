//! The window of nodes over which strains are taken, and what it does to noise and waves.

use super::quantities::noise::solve_spd;
use crate::mesh::ElementGeometry;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Elements around a window that decide about its noise: beyond, correlations change it by less than 1e-4.
pub(super) const MARGIN: usize = 4;

/// A window counts when its nodes spread across at least this part (of the variance) of what they do along.
const LEAST_SPREAD: f64 = 0.01;

/// A window of N x N nodes over which strains are taken, N odd and 3 or more.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::StrainWindow;
/// let window = StrainWindow::new(5).unwrap();
/// assert_eq!((window.nodes(), window.gauge_length(16.0)), (5, 80.0)); // (5 - 1) 16 px + 16 px
/// assert!([0, 1, 2, 4, 53].map(StrainWindow::new).iter().all(Option::is_none));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct StrainWindow(u32);

impl StrainWindow {
    /// The largest: its strains would say little of where they stand.
    pub const MOST: u32 = 51;

    /// A window of `nodes` x `nodes`; `None` unless that is odd, 3 or more, and not above [`MOST`](Self::MOST).
    pub fn new(nodes: u32) -> Option<Self> {
        (nodes % 2 == 1 && (3..=Self::MOST).contains(&nodes)).then_some(Self(nodes))
    }

    /// N: the nodes along a side.
    pub fn nodes(self) -> usize {
        self.0 as usize
    }

    /// Rings of elements around the node in the middle.
    pub(super) fn rings(self) -> usize {
        self.nodes() / 2
    }

    /// Those below, the largest first.
    pub(super) fn smaller(self) -> impl Iterator<Item = Self> {
        (3..self.0).rev().filter_map(Self::new)
    }

    /// Length of the virtual strain gauge, `(N - 1) L_step + L_subset`: N elements of this size, step and subset.
    pub fn gauge_length(self, element_size: f64) -> f64 {
        (self.nodes() - 1) as f64 * element_size + element_size
    }

    /// `sigma_exx l / sigma_ux` of a node far from the borders, with the size l of square elements: as `NODE_NOISE`
    /// (super::NODE_NOISE) is for the mean of the elements around a node. eyy likewise; the shear has half the root of
    /// the sum of both squares.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::StrainWindow;
    /// let factors = [3, 5, 7, 9].map(|nodes| StrainWindow::new(nodes).unwrap().noise());
    /// assert!(factors.windows(2).all(|pair| pair[1] < 0.6 * pair[0]));
    /// ```
    pub fn noise(self) -> f64 {
        // The window and its margin as a grid, from the node in the middle on by rings.
        let reach = (self.rings() + MARGIN) as i64;
        let side = 2 * reach + 1;
        let ring = |at: i64| (at % side - reach).abs().max((at / side - reach).abs());
        let mut nodes: Vec<i64> = (0..side * side).collect();
        nodes.sort_by_key(|&at| ring(at));
        let mut number = vec![0; nodes.len()];
        (0..).zip(&nodes).for_each(|(k, &at)| number[at as usize] = k);
        let places: Vec<[f64; 2]> = nodes.iter().map(|at| [(at % side) as f64, (at / side) as f64]).collect();
        let cells = (0..side * side).filter(|at| at % side + 1 < side && at / side + 1 < side);
        let corners = |at: i64| [at, at + 1, at + 1 + side, at + side].map(|at| number[at as usize]);
        let Some(weights) = plane(&places[..self.nodes() * self.nodes()]) else { return f64::NAN };
        let (node, [[xx, ..]]) = noise_of(&places, &cells.map(corners).collect::<Vec<_>>(), [&weights]);
        (xx / node).sqrt()
    }

    /// Share of its amplitude that a wave of a strain keeps at a node far from the borders, whose displacement the
    /// nodes have exactly: plane fitted to sines. `period` in element sizes; exx varies along x, or `across` it,
    /// along y.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::StrainWindow;
    /// let window = StrainWindow::new(3).unwrap(); // the central difference: sin(t)/t with t = 2 pi/period
    /// let t = std::f64::consts::TAU / 10.0;
    /// assert!((window.wave_gain(10.0, false) - t.sin() / t).abs() < 1e-12);
    /// assert!((window.wave_gain(10.0, true) - (1.0 + 2.0 * t.cos()) / 3.0).abs() < 1e-12); // the mean of three rows
    /// ```
    pub fn wave_gain(self, period: f64, across: bool) -> f64 {
        let reach = self.rings() as i64;
        let rows = || (-reach..=reach).map(|k| k as f64);
        let places: Vec<[f64; 2]> = rows().flat_map(|y| rows().map(move |x| [x, y])).collect();
        let Some(weights) = plane(&places) else { return f64::NAN }; // N x N nodes span a plane
        let wave_number = std::f64::consts::TAU / period;
        // The integral of the strain cos(k x), or cos(k y), along x.
        let displacement = |[x, y]: [f64; 2]| match across {
            false => (wave_number * x).sin() / wave_number,
            true => x * (wave_number * y).cos(),
        };
        places.iter().zip(&weights).map(|(&place, weight)| weight[0] * displacement(place)).sum()
    }

    /// What a file with such strains on elements of `length_px` says about them, without a sign of comment.
    pub fn describe(self, length_px: f64) -> Vec<String> {
        let n = self.nodes();
        vec![
            format!(
                "strain window: plane fitted by least squares to {n} x {n} nodes; virtual strain gauge (N - 1) L_step + L_subset \
                 = {} x {length_px} + {length_px} = {} px",
                n - 1,
                self.gauge_length(length_px)
            ),
            "noise of a strain of the window: sigma from that of its nodes and the correlation of their noise; fewer nodes and \
             more noise at borders and holes; no value where less than a quarter of the nodes is there"
                .to_owned(),
            "model error of a strain of the window: what the plane is off at the node beyond noise, by a cubic over the same \
             nodes; to be added to sigma in squares"
                .to_owned(),
        ]
    }
}

impl TryFrom<u32> for StrainWindow {
    type Error = String;

    fn try_from(nodes: u32) -> Result<Self, String> {
        Self::new(nodes)
            .ok_or_else(|| format!("a strain window of {nodes} nodes; expected an odd number, 3 to {}", Self::MOST))
    }
}

impl From<StrainWindow> for u32 {
    fn from(window: StrainWindow) -> Self {
        window.0
    }
}

impl fmt::Display for StrainWindow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{0} x {0} nodes", self.0)
    }
}

/// Weights of a plane fitted to points: of each, in the slopes along x and y.
pub(super) fn plane(points: &[[f64; 2]]) -> Option<Vec<[f64; 2]>> {
    let n = points.len() as f64;
    let middle = [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    let off = || points.iter().map(|p| [p[0] - middle[0], p[1] - middle[1]]);
    let [xx, xy, yy] = off().fold([0.0; 3], |[xx, xy, yy], [x, y]| [xx + x * x, xy + x * y, yy + y * y]);
    let det = xx * yy - xy * xy;
    // Of the two eigenvalues: their product over the square of their sum, which is above the larger one.
    let is_plane = det > LEAST_SPREAD / (1.0 + LEAST_SPREAD).powi(2) * (xx + yy) * (xx + yy);
    is_plane.then(|| off().map(|[x, y]| [(yy * x - xy * y) / det, (xx * y - xy * x) / det]).collect())
}

/// With inverse mass as covariance of a patch's nodes: the variance of the first, and the covariance (xx, xy, yy) of
/// the sums over nodes with each of these weights.
pub(super) fn noise_of<const N: usize>(
    places: &[[f64; 2]],
    elements: &[[u32; 4]],
    weights: [&[[f64; 2]]; N],
) -> (f64, [[f64; 3]; N]) {
    let mut rows: Vec<Vec<(usize, f64)>> = vec![Vec::new(); places.len()];
    for nodes in elements {
        let nodes = nodes.map(|node| node as usize);
        let mass = ElementGeometry::new(nodes.map(|node| places[node])).mass_matrix();
        for (i, &row) in nodes.iter().enumerate() {
            for (j, &column) in nodes.iter().enumerate() {
                match rows[row].iter_mut().find(|(there, _)| *there == column) {
                    Some((_, sum)) => *sum += mass[i][j],
                    None => rows[row].push((column, mass[i][j])),
                }
            }
        }
    }
    let solved = |load: &dyn Fn(usize) -> f64| solve_spd(&rows, (0..places.len()).map(load).collect());
    let covariance = |weights: &[[f64; 2]]| {
        let [x, y] = [0, 1].map(|k| solved(&|at| weights.get(at).map_or(0.0, |w| w[k])));
        let product = |k: usize, solved: &[f64]| weights.iter().zip(solved).map(|(w, s)| w[k] * s).sum::<f64>();
        [product(0, &x), product(0, &y), product(1, &y)]
    };
    (solved(&|at| f64::from(at == 0))[0], weights.map(covariance))
}
