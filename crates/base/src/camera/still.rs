//! Zones in the plane of the specimen that do not deform. How they seem to move in a frame is not the specimen's: the
//! camera moved, or the distance changed (THEORY 22).

use super::even_noise::EvenNoise;
use super::marked::inverse_of;
use super::model::times;
use super::shape::CameraError;
use super::term::CameraTerm;
use crate::field::{Measurement, Value};
use crate::linalg::Dense;
use crate::mesh::Mesh;
use crate::plane::Point;
use crate::units::Px;

/// Unknowns of a similarity: growth, turn, shift along x and y; then the stretch and the shear that it has not.
const UNKNOWNS: usize = 6;
const OF_SIMILARITY: usize = 4;
/// Names of their terms in budgets.
const NAMES: [&str; OF_SIMILARITY] = ["distance", "still_turn", "still_x", "still_y"];

/// How the still zones seem to move in a frame: a point `X` goes to `centre + shift + (1 + growth) R (X - centre)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StillMotion {
    /// Middle of the zones, px of the plane.
    pub centre: Point,
    /// Shift of the centre, px, with its standard uncertainty.
    pub shift: [Value; 2],
    /// Turn, radians.
    pub turn_rad: Value,
    /// By how much larger all is seen: `-dZ/Z`.
    pub growth: Value,
    /// What the zones are strained beside: the larger of `(exx - eyy)/2` and `exy`, by its standard uncertainty.
    pub strain: Value,
    /// Sum of squares of what is left by its degrees of freedom: 1 where noise is all. Variances are scaled by it where
    /// it is larger.
    pub squares: f64,
    /// Nodes that show it.
    pub n_nodes: usize,
}

impl StillMotion {
    /// Relative change of the distance to the specimen, `dZ/Z`.
    pub fn distance_change(&self) -> Value {
        let seen = 1.0 + self.growth.value;
        Value { value: 1.0 / seen - 1.0, sigma: self.growth.sigma / (seen * seen) }
    }
}

/// The zones, and how the noise of their nodes goes together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StillZones {
    elements: Vec<StillElement>,
    /// Diagonal of the inverse of the mass matrix, by the number of the node; zero where a node is of no such zone.
    variance: Vec<Point>,
    centre: Point,
}

#[derive(Debug, Clone, PartialEq)]
struct StillElement {
    nodes: [usize; 4],
    mass: [[f64; 4]; 4],
}

/// A similarity as it was found: its unknowns and their covariance.
pub(super) struct Similarity {
    centre: Point,
    unknowns: [f64; OF_SIMILARITY],
    covariance: Dense,
    strain: Value,
    squares: f64,
    n_nodes: usize,
}

impl StillZones {
    /// The zones with these names on a mesh whose nodes lie at `places` in the plane; none without a name.
    pub fn new(names: &[String], raw: &Mesh<Px>, places: &[Point]) -> Result<Option<Self>, CameraError> {
        let zone = |name: &String| {
            let at = raw.zones().iter().position(|zone| zone == name);
            at.ok_or_else(|| CameraError::NoZone { name: name.clone(), zones: raw.zones().to_vec() })
        };
        let zones = names.iter().map(zone).collect::<Result<Vec<_>, _>>()?;
        if zones.is_empty() {
            return Ok(None);
        }
        let numbers: Vec<usize> = zones.iter().flat_map(|&zone| raw.zone_elements(zone)).collect();
        let noise = EvenNoise::new(raw, &numbers);
        let mut variance = vec![[0.0; 2]; raw.n_nodes()];
        noise.numbers.iter().zip(&noise.variance).for_each(|(&node, v)| variance[node] = *v);
        let element = |&element: &usize| StillElement {
            nodes: raw.elements()[element].map(|node| node as usize),
            mass: raw.geometry(element).mass_matrix(),
        };
        let n = noise.numbers.len().max(1) as f64;
        let centre = [0, 1].map(|c| noise.numbers.iter().map(|&node| places[node][c]).sum::<f64>() / n);
        Ok(Some(Self { elements: numbers.iter().map(element).collect(), variance, centre }))
    }

    /// The similarity that explains the `displacement` of the still nodes best, weighed with the inverse covariance of
    /// their noise; `None` where too little of them is measured.
    pub fn fit(&self, field: &Measurement<Px>, displacement: &[Point]) -> Option<Similarity> {
        let is_known = |&node: &usize| field.measured[node] && field.sigma[node].iter().all(|s| *s > 0.0);
        let mut is_used = vec![false; field.measured.len()];
        let mut normal = [[0.0; UNKNOWNS + 1]; UNKNOWNS + 1];
        for StillElement { nodes, mass } in self.elements.iter().filter(|of| of.nodes.iter().all(is_known)) {
            let rows = nodes.map(|node| {
                is_used[node] = true;
                let white = [0, 1].map(|c| self.variance[node][c].sqrt() / field.sigma[node][c]);
                let d = self.about_centre(field.mesh.nodes()[node]);
                let [x, y] = columns(d);
                let [u, v] = displacement[node];
                let whole = |of: [f64; UNKNOWNS], u: f64, white: f64| {
                    std::array::from_fn::<f64, { UNKNOWNS + 1 }, _>(|k| white * of.get(k).copied().unwrap_or(u))
                };
                [whole(x, u, white[0]), whole(y, v, white[1])]
            });
            for (i, a) in rows.iter().enumerate() {
                for (j, b) in rows.iter().enumerate() {
                    for (row, of_row) in normal.iter_mut().enumerate() {
                        for (column, sum) in of_row.iter_mut().enumerate() {
                            *sum += mass[i][j] * (a[0][row] * b[0][column] + a[1][row] * b[1][column]);
                        }
                    }
                }
            }
        }
        let n_nodes = is_used.iter().filter(|used| **used).count();
        let freedom = 2.0 * n_nodes as f64 - OF_SIMILARITY as f64;
        let part = |n: usize| inverse_of(&Dense::from_fn(n, n, |r, c| normal[r][c]));
        let solved = |inverse: &Dense, row: usize, n: usize| -> f64 {
            (0..n).map(|k| inverse[(row, k)] * normal[k][UNKNOWNS]).sum()
        };
        let (covariance, with_strain) = (part(OF_SIMILARITY)?, part(UNKNOWNS)?);
        let unknowns = std::array::from_fn(|k| solved(&covariance, k, OF_SIMILARITY));
        let explained: f64 = unknowns.iter().enumerate().map(|(k, q)| q * normal[k][UNKNOWNS]).sum();
        let squares = (normal[UNKNOWNS][UNKNOWNS] - explained).max(0.0) / freedom.max(1.0);
        let scale = squares.max(1.0);
        let strains = [OF_SIMILARITY, OF_SIMILARITY + 1]
            .map(|k| Value { value: solved(&with_strain, k, UNKNOWNS), sigma: (scale * with_strain[(k, k)]).sqrt() });
        let by_std = |of: &Value| (of.value / of.sigma).abs();
        let strain = if by_std(&strains[0]) > by_std(&strains[1]) { strains[0] } else { strains[1] };
        let covariance = Dense::from_fn(OF_SIMILARITY, OF_SIMILARITY, |r, c| scale * covariance[(r, c)]);
        Some(Similarity { centre: self.centre, unknowns, covariance, strain, squares, n_nodes })
    }

    fn about_centre(&self, at: Point) -> Point {
        [at[0] - self.centre[0], at[1] - self.centre[1]]
    }
}

/// Displacements along x and y at `d` from the centre by each unknown.
fn columns([x, y]: Point) -> [[f64; UNKNOWNS]; 2] {
    [[x, -y, 1.0, 0.0, x, y], [y, x, 0.0, 1.0, -y, x]]
}

impl Similarity {
    /// Its displacement at a point of the plane.
    pub fn displacement(&self, at: Point) -> Point {
        moved(&self.unknowns, self.centre, at)
    }

    /// From where it seems to have brought a point, and what turns a small displacement there.
    pub fn undone(&self, at: Point) -> (Point, [[f64; 2]; 2]) {
        let [growth, turn, x, y] = self.unknowns;
        let (a, b) = (1.0 + growth, turn);
        let square = a * a + b * b;
        let inverse = [[a / square, b / square], [-b / square, a / square]];
        let d = times(inverse, [0, 1].map(|c| at[c] - self.centre[c] - [x, y][c]));
        ([self.centre[0] + d[0], self.centre[1] + d[1]], inverse)
    }

    /// What the uncertainty of each unknown does to the displacements of nodes that are at `places`: independent terms.
    pub fn terms(&self, places: &[Point]) -> Vec<CameraTerm> {
        let n = OF_SIMILARITY;
        let scale: Vec<f64> = (0..n).map(|k| self.covariance[(k, k)].sqrt()).collect();
        let scaled = Dense::from_fn(n, n, |r, c| self.covariance[(r, c)] / (scale[r] * scale[c]));
        let unit = Dense::from_fn(n, n, |r, c| if r == c { 1.0 } else { 0.0 });
        let Ok(factor) = scaled.cholesky() else { return Self::no_terms(places.len()) };
        let lower = factor.half_times(&unit);
        let term = |k: usize| {
            let column = std::array::from_fn(|row| if row < k { 0.0 } else { -scale[row] * lower[(row, k)] });
            let change = places.iter().map(|&at| moved(&column, self.centre, at)).collect();
            CameraTerm { name: NAMES[k], change }
        };
        (0..n).map(term).collect()
    }

    /// The terms of a frame that shows nothing.
    pub fn no_terms(n_nodes: usize) -> Vec<CameraTerm> {
        NAMES.map(|name| CameraTerm { name, change: vec![[0.0; 2]; n_nodes] }).to_vec()
    }

    /// In numbers that mean something.
    pub fn motion(&self) -> StillMotion {
        let [growth, turn, x, y] = self.unknowns;
        let std = |k: usize| self.covariance[(k, k)].sqrt();
        let of = |value: f64, k: usize| Value { value, sigma: std(k) };
        StillMotion {
            centre: self.centre,
            shift: [of(x, 2), of(y, 3)],
            turn_rad: of(turn.atan2(1.0 + growth), 1),
            growth: of((1.0 + growth).hypot(turn) - 1.0, 0),
            strain: self.strain,
            squares: self.squares,
            n_nodes: self.n_nodes,
        }
    }
}

fn moved(unknowns: &[f64; OF_SIMILARITY], centre: Point, at: Point) -> Point {
    let [x, y] = columns([at[0] - centre[0], at[1] - centre[1]]);
    let along = |of: [f64; UNKNOWNS]| unknowns.iter().zip(of).map(|(q, by)| q * by).sum();
    [along(x), along(y)]
}
