//! Projections and their covariance near a node: on a rectangle of regular elements, and on any patch.

use super::functional::{Around, MONOMIALS, N_MONOMIALS, REACH, STRAIGHT};
use super::neighbours::{Extent, FAR, Neighbours};
use crate::linalg::Envelope;
use crate::mesh::{ElementGeometry, Mesh, shape_functions};
use crate::units::Length;
use std::sync::LazyLock;

/// Elements from a node to the end of its patch: what is cut off there is felt to 0.268^6 at the node, 0.0004.
pub(super) const PATCH: usize = 6;
/// Where a line that goes on is cut off instead: 0.268^12.
const LONG: usize = 12;
/// Right-hand sides that are solved for side by side.
const LANES: usize = 8;
/// Monomials that bilinear elements do not have.
const CURVED: usize = N_MONOMIALS - STRAIGHT;
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
        let mass: Vec<(usize, usize, f64)> = (0..n)
            .flat_map(|k| {
                let sides = usize::from(k > 0) + usize::from(k + 1 < n);
                let beside = (k > 0).then(|| (k, k - 1, 1.0 / 6.0));
                beside.into_iter().chain([(k, k, sides as f64 / 3.0)])
            })
            .collect();
        let factor = Envelope::new(n, &mass)?;
        let within = |place: i32| place.unsigned_abs() as usize <= REACH;
        let places: Vec<i32> = (first..=last).filter(|&place| within(place)).collect();
        let index = |place: i32| (place - first) as usize;
        // Deviation of a power from the straight lines between its values at the nodes, against each shape function.
        let mut deviations = vec![[0.0; 2]; n];
        for k in 0..n - 1 {
            let [a, b] = [f64::from(first + k as i32), f64::from(first + k as i32 + 1)];
            for (t, weight) in POINTS {
                for (c, power) in [2, 3].into_iter().enumerate() {
                    let off = (a + t).powi(power) - (1.0 - t) * a.powi(power) - t * b.powi(power);
                    deviations[k][c] += weight * off * (1.0 - t);
                    deviations[k + 1][c] += weight * off * t;
                }
            }
        }
        factor.solve(&mut deviations);
        let projected = places
            .iter()
            .map(|&place| {
                let (x, k) = (f64::from(place), index(place));
                [1.0, x, x * x + deviations[k][0], x * x * x + deviations[k][1]]
            })
            .collect();
        let rows: Vec<usize> = places.iter().map(|&place| index(place)).collect();
        let covariance = inverse_of(&factor, n, &rows);
        Some(Self { places, projected, covariance })
    }
}

/// What is around a node in a rectangle of regular elements, a product of two lines: [`REACH`] nodes in rows along one.
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

/// What a patch has met so far.
pub(super) struct Seen {
    /// Number in the patch of each node of the mesh.
    number: Vec<u16>,
    elements: Vec<bool>,
}

/// Number of a node that is not in the patch.
const UNSEEN: u16 = u16::MAX;

impl Seen {
    /// Nothing, on meshes of so many nodes and elements.
    pub fn nothing(n_nodes: usize, n_elements: usize) -> Self {
        Self { number: vec![UNSEEN; n_nodes], elements: vec![false; n_elements] }
    }
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
    /// Whether all elements are regular: the patch is then the same wherever its elements hang together alike.
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
    pub fn new<U: Length>(mesh: &Mesh<U>, neighbours: &Neighbours, seen: &mut Seen, node: usize) -> Option<Self> {
        let mut nodes = vec![node as u32];
        let mut rings = vec![0u8];
        let mut elements: Vec<u32> = Vec::new();
        seen.number[node] = 0;
        let mut ring = 0..1;
        for distance in 1..=PATCH {
            for at in ring.clone() {
                for &element in neighbours.around(nodes[at] as usize) {
                    if std::mem::replace(&mut seen.elements[element as usize], true) {
                        continue;
                    }
                    elements.push(element);
                    for &other in &mesh.elements()[element as usize] {
                        let number = &mut seen.number[other as usize];
                        if *number == UNSEEN {
                            *number = nodes.len() as u16;
                            nodes.push(other);
                            rings.push(distance as u8);
                        }
                    }
                }
            }
            ring = ring.end..nodes.len();
        }
        let by_number = |&element: &u32| mesh.elements()[element as usize].map(|node| seen.number[node as usize]);
        let corners = elements.iter().map(by_number).collect();
        nodes.iter().for_each(|&node| seen.number[node as usize] = UNSEEN);
        elements.iter().for_each(|&element| seen.elements[element as usize] = false);
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
        Some(Self { nodes, rings, places, elements: corners, frame, is_regular })
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
        let mut mass: Vec<(usize, usize, f64)> = Vec::with_capacity(10 * self.elements.len());
        let mut deviations = vec![[0.0; CURVED]; n];
        for corners in &self.elements {
            let nodes = corners.map(usize::from);
            let (rows, places) = (nodes.map(|node| row_of[node]), nodes.map(|node| self.places[node]));
            let own;
            let of = match OfElement::unit(places[0]).filter(|_| self.is_regular) {
                Some(unit) => unit,
                None => {
                    own = OfElement::new(places);
                    &own
                }
            };
            for (i, &row) in rows.iter().enumerate() {
                let lower = rows.iter().zip(of.mass[i]).filter(|(column, _)| **column <= row);
                mass.extend(lower.map(|(&column, entry)| (row, column, entry)));
                deviations[row].iter_mut().zip(of.deviations[i]).for_each(|(sum, of)| *sum += of);
            }
        }
        let factor = Envelope::new(n, &mass)?;
        factor.solve(&mut deviations);
        let near = self.n_near();
        let projected = (0..near)
            .map(|node| {
                let (at, off) = (monomials(self.places[node]), &deviations[row_of[node]]);
                std::array::from_fn(|k| if k < STRAIGHT { at[k] } else { at[k] + off[k - STRAIGHT] })
            })
            .collect();
        let covariance = inverse_of(&factor, n, &row_of[..near]);
        Some(Around { rings: self.rings[..near].to_vec(), own: 0, projected, covariance })
    }
}

/// What one element brings to the equations of a projection.
struct OfElement {
    mass: [[f64; 4]; 4],
    /// Of each curved monomial, what deviates from the bilinear field between the corners, against each shape function.
    deviations: [[f64; CURVED]; 4],
}

/// Units that are kept reach so far from the middle of a patch.
const UNITS: i32 = PATCH as i32;

impl OfElement {
    fn new(places: [[f64; 2]; 4]) -> Self {
        let geometry = ElementGeometry::new(places);
        let at_corners = places.map(monomials);
        let mut deviations = [[0.0; CURVED]; 4];
        for (xi, of_xi) in POINTS {
            for (eta, of_eta) in POINTS {
                let psi = shape_functions(xi, eta);
                let weight = of_xi * of_eta * geometry.map_at([xi, eta]).determinant.abs();
                let here = monomials(geometry.place([xi, eta]));
                for k in 0..CURVED {
                    let line: f64 = psi.iter().zip(&at_corners).map(|(psi, of)| psi * of[STRAIGHT + k]).sum();
                    let off = weight * (here[STRAIGHT + k] - line);
                    (0..4).for_each(|i| deviations[i][k] += psi[i] * off);
                }
            }
        }
        Self { mass: geometry.mass_matrix(), deviations }
    }

    /// That of a square of side 1 whose first corner is at a place of whole numbers; `None` far from the middle.
    fn unit(place: [f64; 2]) -> Option<&'static Self> {
        static UNIT_SQUARES: LazyLock<Vec<OfElement>> = LazyLock::new(|| {
            let corner = |x: i32, y: i32| [f64::from(x), f64::from(y)];
            let square =
                |x, y| OfElement::new([corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)]);
            (-UNITS..UNITS).flat_map(|y| (-UNITS..UNITS).map(move |x| square(x, y))).collect()
        });
        let [x, y] = place.map(|v| v as i32 + UNITS);
        let is_near = [x, y].iter().all(|v| (0..2 * UNITS).contains(v));
        is_near.then(|| &UNIT_SQUARES[(y * 2 * UNITS + x) as usize])
    }
}

/// [`MONOMIALS`] at a place.
fn monomials([t, s]: [f64; 2]) -> [f64; N_MONOMIALS] {
    let powers = |x: f64| [1.0, x, x * x, x * (x * x)];
    let (of_t, of_s) = (powers(t), powers(s));
    MONOMIALS.map(|[p, q]| of_t[p as usize] * of_s[q as usize])
}

/// The inverse of a matrix of size `n` at some rows and the same columns, row by row.
fn inverse_of(factor: &Envelope, n: usize, rows: &[usize]) -> Vec<f64> {
    let mut inverse = Vec::with_capacity(rows.len() * rows.len());
    for some in rows.chunks(LANES) {
        let mut columns = vec![[0.0; LANES]; n];
        some.iter().enumerate().for_each(|(lane, &row)| columns[row][lane] = 1.0);
        factor.solve(&mut columns);
        for lane in 0..some.len() {
            inverse.extend(rows.iter().map(|&row| columns[row][lane]));
        }
    }
    inverse
}
