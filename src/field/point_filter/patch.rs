//! Projections and their covariance near a node: on a rectangle of regular elements, and on any patch.

use super::functional::{Around, MONOMIALS, N_MONOMIALS, REACH};
use super::neighbours::{Extent, FAR, Neighbours};
use crate::linalg::Envelope;
use crate::mesh::{ElementGeometry, Mesh, shape_functions};
use crate::units::Length;
use std::collections::HashMap;

/// Elements from a node to the end of its patch: what is cut off there is felt to 0.268^6 at the node, 0.0004.
const PATCH: usize = 6;
/// Where a line that goes on is cut off instead: 0.268^12.
const LONG: usize = 12;
/// Three Gauss points along an axis and their weights: exact up to the fifth degree.
const POINTS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// A line of elements of length 1 through a node at 0.
#[derive(Debug)]
pub(super) struct Line {
    /// Places of the nodes within [`REACH`].
    pub places: Vec<i32>,
    /// Projections of the powers 0 to 3 there.
    projected: Vec<[f64; 4]>,
    /// Covariance of the coefficients, row by row.
    covariance: Vec<f64>,
}

impl Line {
    /// With so many elements before and after the node, [`FAR`] standing for many.
    pub fn new(before: u8, after: u8) -> Option<Self> {
        let length = |n: u8| if n == FAR { LONG as i32 } else { i32::from(n) };
        let (first, last) = (-length(before), length(after));
        let n = (last - first) as usize + 1;
        let rows: Vec<Vec<(usize, f64)>> = (0..n)
            .map(|k| {
                let sides = usize::from(k > 0) + usize::from(k + 1 < n);
                let beside = (k > 0).then(|| (k - 1, 1.0 / 6.0));
                beside.into_iter().chain([(k, sides as f64 / 3.0)]).collect()
            })
            .collect();
        let factor = Envelope::new(&rows)?;
        let within = |place: i32| place.unsigned_abs() as usize <= REACH;
        let places: Vec<i32> = (first..=last).filter(|&place| within(place)).collect();
        let index = |place: i32| (place - first) as usize;
        // The deviation of a power from the straight lines between its values at the nodes, against each shape function.
        let powers = [2, 3].map(|power| {
            let mut deviation = vec![0.0; n];
            for k in 0..n - 1 {
                let [a, b] = [f64::from(first + k as i32), f64::from(first + k as i32 + 1)];
                for (t, weight) in POINTS {
                    let off = (a + t).powi(power) - (1.0 - t) * a.powi(power) - t * b.powi(power);
                    deviation[k] += weight * off * (1.0 - t);
                    deviation[k + 1] += weight * off * t;
                }
            }
            factor.solve(&mut deviation);
            deviation
        });
        let projected = places
            .iter()
            .map(|&place| {
                let (x, k) = (f64::from(place), index(place));
                [1.0, x, x * x + powers[0][k], x * x * x + powers[1][k]]
            })
            .collect();
        let mut covariance = Vec::with_capacity(places.len() * places.len());
        for &place in &places {
            let mut column = vec![0.0; n];
            column[index(place)] = 1.0;
            factor.solve(&mut column);
            covariance.extend(places.iter().map(|&other| column[index(other)]));
        }
        Some(Self { places, projected, covariance })
    }
}

/// What is around a node in a rectangle of regular elements: the product of two lines. The nodes within [`REACH`] are in rows along
/// the first direction.
pub(super) fn of_rectangle(extent: Extent) -> Option<Around> {
    let [x, y] = [Line::new(extent.before[0], extent.after[0])?, Line::new(extent.before[1], extent.after[1])?];
    let nodes: Vec<[usize; 2]> = (0..y.places.len()).flat_map(|j| (0..x.places.len()).map(move |i| [i, j])).collect();
    let ring = |&[i, j]: &[usize; 2]| x.places[i].unsigned_abs().max(y.places[j].unsigned_abs()) as u8;
    let rings: Vec<u8> = nodes.iter().map(ring).collect();
    let own = rings.iter().position(|&ring| ring == 0)?;
    let projected =
        |&[i, j]: &[usize; 2]| MONOMIALS.map(|[p, q]| x.projected[i][p as usize] * y.projected[j][q as usize]);
    let projected = nodes.iter().map(projected).collect();
    let (nx, ny) = (x.places.len(), y.places.len());
    let covariance = nodes
        .iter()
        .flat_map(|&[i, j]| nodes.iter().map(move |&[k, l]| [i * nx + k, j * ny + l]))
        .map(|[a, b]| x.covariance[a] * y.covariance[b])
        .collect();
    Some(Around { rings, own, projected, covariance })
}

/// The numbers of the nodes of [`of_rectangle`] among those of the whole rectangle.
pub(super) fn within_reach(extent: Extent, nodes: &[u32]) -> Vec<u32> {
    let [left, up] = extent.before.map(usize::from);
    let columns = left + usize::from(extent.after[0]) + 1;
    let rows = nodes.len() / columns;
    let near = |k: usize, middle: usize| k.abs_diff(middle) <= REACH;
    let places = (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
    places.filter(|&[i, j]| near(i, left) && near(j, up)).map(|[i, j]| nodes[j * columns + i]).collect()
}

/// The live elements around a node, in coordinates of their own.
#[derive(Debug)]
pub(super) struct Patch {
    /// Numbers of its nodes, the node itself first, then ring by ring.
    pub nodes: Vec<u32>,
    rings: Vec<u8>,
    /// Places in the frame: `place = F t`.
    places: Vec<[f64; 2]>,
    /// Corners of the elements, by their number in the patch.
    elements: Vec<[u16; 4]>,
    /// The columns of F.
    pub frame: [[f64; 2]; 2],
    /// Whether all elements are regular: the patch is then the same wherever its elements hang together in the same way.
    pub is_regular: bool,
}

/// The coordinates of a vector in a frame given by its columns.
pub(super) fn in_frame(frame: [[f64; 2]; 2], v: [f64; 2]) -> [f64; 2] {
    let [[ax, ay], [bx, by]] = frame;
    let determinant = ax * by - ay * bx;
    [(v[0] * by - v[1] * bx) / determinant, (ax * v[1] - ay * v[0]) / determinant]
}

impl Patch {
    /// Around `node`; `None` where it has no live element.
    pub fn new<U: Length>(mesh: &Mesh<U>, neighbours: &Neighbours, node: usize) -> Option<Self> {
        let mut nodes = vec![node as u32];
        let mut local: HashMap<u32, u16> = HashMap::from([(node as u32, 0)]);
        let mut rings = vec![0u8];
        let mut elements: Vec<u32> = Vec::new();
        let mut ring = 0..1;
        for distance in 1..=PATCH {
            for at in ring.clone() {
                for &element in neighbours.around(nodes[at] as usize) {
                    if !elements.contains(&element) {
                        elements.push(element);
                    }
                    for &other in &mesh.elements()[element as usize] {
                        local.entry(other).or_insert_with(|| {
                            nodes.push(other);
                            rings.push(distance as u8);
                            nodes.len() as u16 - 1
                        });
                    }
                }
            }
            ring = ring.end..nodes.len();
        }
        let &first = elements.first()?;
        let is_regular = elements.iter().all(|&element| neighbours.is_regular(element as usize));
        let frame = if is_regular {
            let [a, b, _, d] = mesh.corners(first as usize);
            [[b[0] - a[0], b[1] - a[1]], [d[0] - a[0], d[1] - a[1]]]
        } else {
            let around = neighbours.around(node);
            let area: f64 = around.iter().map(|&element| mesh.geometry(element as usize).area()).sum();
            let size = (area / around.len() as f64).sqrt();
            [[size, 0.0], [0.0, size]]
        };
        let origin = mesh.nodes()[node];
        let place = |&other: &u32| {
            let at = mesh.nodes()[other as usize];
            let t = in_frame(frame, [at[0] - origin[0], at[1] - origin[1]]);
            // Whole numbers there: the same bits wherever the patch lies.
            if is_regular { t.map(f64::round) } else { t }
        };
        let places = nodes.iter().map(place).collect();
        let elements =
            elements.iter().map(|&element| mesh.elements()[element as usize].map(|node| local[&node])).collect();
        Some(Self { nodes, rings, places, elements, frame, is_regular })
    }

    /// What tells a regular patch from all others.
    pub fn key(&self) -> Vec<u16> {
        self.elements.iter().flatten().copied().collect()
    }

    /// Number of nodes within [`REACH`]: the first ones.
    pub fn n_near(&self) -> usize {
        self.rings.iter().filter(|&&ring| usize::from(ring) <= REACH).count()
    }

    /// The projections of polynomials on the patch and their covariance; `None` where the mass matrix has no factor.
    pub fn around(&self) -> Option<Around> {
        let n = self.nodes.len();
        // Neighbours near each other: row by row.
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| {
            let ([xa, ya], [xb, yb]) = (self.places[a], self.places[b]);
            ya.total_cmp(&yb).then(xa.total_cmp(&xb)).then(a.cmp(&b))
        });
        let mut row_of = vec![0; n];
        order.iter().enumerate().for_each(|(row, &node)| row_of[node] = row);
        let mut mass: Vec<Vec<(usize, f64)>> = vec![Vec::new(); n];
        let mut deviations = vec![vec![0.0; n]; N_MONOMIALS];
        let value = |[p, q]: [i32; 2], [t, s]: [f64; 2]| t.powi(p) * s.powi(q);
        for corners in &self.elements {
            let nodes = corners.map(usize::from);
            let places = nodes.map(|node| self.places[node]);
            let geometry = ElementGeometry::new(places);
            let of = geometry.mass_matrix();
            for i in 0..4 {
                for j in 0..4 {
                    let (row, column) = (row_of[nodes[i]], row_of[nodes[j]]);
                    if column <= row {
                        match mass[row].iter_mut().find(|(k, _)| *k == column) {
                            Some((_, sum)) => *sum += of[i][j],
                            None => mass[row].push((column, of[i][j])),
                        }
                    }
                }
            }
            let at_corners = MONOMIALS.map(|power| places.map(|place| value(power, place)));
            for (xi, of_xi) in POINTS {
                for (eta, of_eta) in POINTS {
                    let psi = shape_functions(xi, eta);
                    let weight = of_xi * of_eta * geometry.map_at([xi, eta]).determinant.abs();
                    let place = geometry.place([xi, eta]);
                    // The straight ones are no deviation.
                    for k in 3..N_MONOMIALS {
                        let line: f64 = psi.iter().zip(at_corners[k]).map(|(psi, v)| psi * v).sum();
                        let off = weight * (value(MONOMIALS[k], place) - line);
                        (0..4).for_each(|i| deviations[k][row_of[nodes[i]]] += psi[i] * off);
                    }
                }
            }
        }
        let factor = Envelope::new(&mass)?;
        deviations[3..].iter_mut().for_each(|deviation| factor.solve(deviation));
        let near = self.n_near();
        let projected = (0..near)
            .map(|node| std::array::from_fn(|k| value(MONOMIALS[k], self.places[node]) + deviations[k][row_of[node]]))
            .collect();
        let mut covariance = Vec::with_capacity(near * near);
        for node in 0..near {
            let mut column = vec![0.0; n];
            column[row_of[node]] = 1.0;
            factor.solve(&mut column);
            covariance.extend((0..near).map(|other| column[row_of[other]]));
        }
        Some(Around { rings: self.rings[..near].to_vec(), own: 0, projected, covariance })
    }
}
