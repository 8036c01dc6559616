//! How the noise of neighbouring nodes goes together.

use crate::field::{ElementMark, Measurement, PointFilter};
use crate::mesh::{Mesh, corners_of};
use crate::units::{Length, Px};
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Correlations are known this many elements away from a node; beyond they are below 1e-4.
const REACH: usize = 6;
/// A column of the inverse is solved on a patch this much wider than its reach, so that the cut does not show.
const MARGIN: usize = 4;
/// The residual at which a column is solved, relative to its load.
const PRECISION: f64 = 1e-9;

/// The correlation between the errors of the nodes' displacements.
///
/// Noise that is white in the images, on a texture spread evenly, makes the covariance of each component proportional
/// to the inverse of the mass matrix of the mesh (docs/correlation.md, section 2.7): neighbours along a mesh line are
/// correlated by -0.268, the next by +0.072, and so on; zones are independent, and so are the two components. Their
/// *sizes* are taken from the standard uncertainties of each field; only the *correlations* come from this model. It
/// knows borders, distorted elements, triangles and nodes without measurement.
///
/// A regularised field has other correlations: [`NodalNoise::unknown`] then bounds every standard uncertainty.
///
/// What is read at points with it ([`at_point`](crate::field::at_point), extensometers, openings) is made of values at
/// points ([`PointFilter`]), each a sum over the coefficients nearby; of regularised fields, and after
/// [`of_coefficients`](NodalNoise::of_coefficients), of the coefficients themselves.
///
/// ```
/// # use quadrille_base as quadrille;
/// # use quadrille::{field::NodalNoise, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 320.0, y1: 320.0 };
/// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 320, 320).unwrap(); // 21 x 21 nodes
/// let noise = NodalNoise::new(&mesh, &vec![true; mesh.n_nodes()]);
/// let centre = 10 * 21 + 10;
/// assert!((noise.correlation(centre, centre + 1) - (3f64.sqrt() - 2.0)).abs() < 1e-4);
/// assert_eq!(noise.correlation(centre, centre), 1.0);
/// ```
#[derive(Debug, Clone)]
pub struct NodalNoise {
    /// Rows of the mass matrix over the elements with all nodes measured; `None` when correlations are unknown.
    mass: Option<Arc<Rows>>,
    /// Elements with all nodes measured around each node.
    around: Arc<Vec<Vec<u32>>>,
    measured: Vec<bool>,
    /// Marks of the elements, where they are known.
    marks: Option<Vec<ElementMark>>,
    /// Whether what is read is made of coefficients as they stand.
    reads_coefficients: bool,
    /// The mesh in the image, where fields are mapped into a plane: what makes values at points belongs to the image.
    of_image: Option<Arc<Mesh<Px>>>,
    /// Whether standard uncertainties are wanted.
    is_wanted: bool,
    points: Arc<OnceLock<PointFilter>>,
    columns: Arc<Mutex<HashMap<usize, Arc<Column>>>>,
}

/// Rows of a sparse matrix.
type Rows = Vec<Vec<(u32, f64)>>;

/// Column of the inverse mass matrix near its node, by the numbers of the nodes.
type Column = Vec<(usize, f64)>;

fn entry(column: &Column, node: usize) -> Option<f64> {
    let at = column.binary_search_by_key(&node, |(other, _)| *other).ok()?;
    column.get(at).map(|(_, value)| *value)
}

impl NodalNoise {
    /// The correlations on `mesh` when `measured` tells which nodes are measured.
    pub fn new<U: Length>(mesh: &Mesh<U>, measured: &[bool]) -> Self {
        let mut noise = Self::unknown(mesh, measured);
        let mut rows = vec![BTreeMap::new(); mesh.n_nodes()];
        for element in (0..mesh.n_elements()).filter(|&element| is_whole(mesh, measured, element)) {
            let mass = mesh.geometry(element).mass_matrix();
            let nodes = mesh.elements()[element];
            for (i, &row) in nodes.iter().enumerate() {
                for (j, &column) in nodes.iter().enumerate() {
                    if mass[i][j] != 0.0 {
                        *rows[row as usize].entry(column).or_insert(0.0) += mass[i][j];
                    }
                }
            }
        }
        noise.mass = Some(Arc::new(rows.into_iter().map(|row| row.into_iter().collect()).collect()));
        noise.reads_coefficients = false;
        noise
    }

    /// The correlations in `field`; where its elements are marked, those left out give nothing to values at points.
    pub fn of<U: Length>(field: &Measurement<U>) -> Self {
        Self { marks: field.marks.clone(), ..Self::new(&field.mesh, &field.measured) }
    }

    /// The same, but that what is read at points is made of coefficients as they stand.
    pub fn of_coefficients(self) -> Self {
        Self { reads_coefficients: true, ..self }
    }

    /// The same for fields that a camera maps from the mesh `of_image` into the plane.
    pub fn mapped_from(self, of_image: &Arc<Mesh<Px>>) -> Self {
        Self { of_image: Some(Arc::clone(of_image)), ..self }
    }

    /// The same, for which every standard uncertainty is zero: for values that are read to see what changes them.
    pub fn values_only(&self) -> Self {
        Self { is_wanted: false, ..self.clone() }
    }

    /// Nothing is known of the correlations: standard uncertainties become upper bounds, `sum |weight| sigma`.
    pub fn unknown<U: Length>(mesh: &Mesh<U>, measured: &[bool]) -> Self {
        let mut around = vec![Vec::new(); mesh.n_nodes()];
        for element in (0..mesh.n_elements()).filter(|&element| is_whole(mesh, measured, element)) {
            for &node in corners_of(&mesh.elements()[element]) {
                around[node as usize].push(element as u32);
            }
        }
        Self {
            mass: None,
            around: Arc::new(around),
            measured: measured.to_vec(),
            marks: None,
            reads_coefficients: true,
            of_image: None,
            is_wanted: true,
            points: Arc::default(),
            columns: Arc::default(),
        }
    }

    /// The same of `field`; what is read at points is made of values there if the field has any, as that of splines.
    pub fn unknown_of<U: Length>(field: &Measurement<U>) -> Self {
        let has_values = field.points.as_ref().is_some_and(|points| points.is_value.contains(&true));
        let unknown = Self::unknown(&field.mesh, &field.measured);
        Self { marks: field.marks.clone(), reads_coefficients: !has_values, ..unknown }
    }

    /// That of a field of a series: `kept` from the field before where it holds for this one too, since which nodes are
    /// measured seldom changes, else made anew. Of nodes that are bound to each other nothing is known; `of_image` is the
    /// mesh from which a camera maps the fields.
    pub fn along<U: Length>(
        kept: Option<Self>,
        field: &Measurement<U>,
        are_bound: bool,
        of_image: Option<&Arc<Mesh<Px>>>,
    ) -> Self {
        kept.filter(|kept| kept.is_of(field)).unwrap_or_else(|| {
            let made = if are_bound { Self::unknown_of(field) } else { Self::of(field) };
            match of_image {
                Some(of_image) => made.mapped_from(of_image),
                None => made,
            }
        })
    }

    /// Whether what is read at points is made of coefficients as they stand.
    pub(super) fn reads_coefficients(&self) -> bool {
        self.reads_coefficients
    }

    /// The elements around a node that have all their nodes measured.
    pub(super) fn around(&self, node: usize) -> impl Iterator<Item = usize> {
        self.around[node].iter().map(|&element| element as usize)
    }

    /// Whether this is for a field with these measured nodes.
    pub fn is_for(&self, measured: &[bool]) -> bool {
        self.measured == measured
    }

    /// Whether this is what [`of`](Self::of) makes of the field.
    pub fn is_of<U: Length>(&self, field: &Measurement<U>) -> bool {
        let left_out = |marks: &Option<Vec<ElementMark>>| -> Vec<bool> {
            marks.iter().flatten().map(|mark| mark.is_left_out()).collect()
        };
        self.is_for(&field.measured) && left_out(&self.marks) == left_out(&field.marks)
    }

    /// The displacement at a place as a sum over nodes; `shape` are the bilinear weights of the nodes around it.
    pub(super) fn at<U: Length>(&self, mesh: &Mesh<U>, shape: &[(usize, f64)]) -> Vec<(usize, f64)> {
        if self.reads_coefficients {
            return shape.to_vec();
        }
        let (measured, marks) = (&self.measured, self.marks.as_deref());
        match &self.of_image {
            Some(raw) => self.points.get_or_init(|| PointFilter::new(raw, measured, marks)).at(raw, shape),
            None => self.points.get_or_init(|| PointFilter::new(mesh, measured, marks)).at(mesh, shape),
        }
    }

    /// Whether standard uncertainties are upper bounds only.
    pub fn is_bound(&self) -> bool {
        self.mass.is_none()
    }

    /// Correlation, -1 to 1, of the errors of a component at two nodes; 0 beyond six elements, and between zones.
    pub fn correlation(&self, a: usize, b: usize) -> f64 {
        if a == b {
            return 1.0;
        }
        let (of_a, of_b) = (self.column(a), self.column(b));
        let variance = |column: &Column, node: usize| entry(column, node).unwrap_or(0.0);
        let product = variance(&of_a, a) * variance(&of_b, b);
        if product > 0.0 { variance(&of_a, b) / product.sqrt() } else { 0.0 }
    }

    /// Standard deviation of `sum (w_x u_x + w_y u_y)` over nodes, in order of their numbers, with the standard
    /// uncertainties `sigma`.
    pub(super) fn sigma(&self, weights: &[(usize, [f64; 2])], sigma: &[[f64; 2]]) -> f64 {
        if !self.is_wanted {
            return 0.0;
        }
        let sizes: Vec<[f64; 2]> = weights.iter().map(|&(node, w)| [0, 1].map(|c| w[c] * sigma[node][c])).collect();
        if self.mass.is_none() {
            return sizes.iter().flatten().map(|size| size.abs()).sum();
        }
        // The columns once: a value at a point is a sum over some sixteen nodes.
        let columns: Vec<Arc<Column>> = weights.iter().map(|&(node, _)| self.column(node)).collect();
        let own: Vec<f64> =
            columns.iter().zip(weights).map(|(column, (node, _))| entry(column, *node).unwrap_or(0.0)).collect();
        // Of many nodes, where each stands among the weights; 0: nowhere.
        let is_long = columns.iter().any(|column| column.len() < weights.len());
        let mut places = vec![0; weights.last().filter(|_| is_long).map_or(0, |(node, _)| node + 1)];
        (1..).zip(weights).filter(|_| is_long).for_each(|(place, (node, _))| places[*node] = place);
        let mut variance = 0.0;
        for i in 0..weights.len() {
            variance += sizes[i][0] * sizes[i][0] + sizes[i][1] * sizes[i][1];
            let mut add = |j: usize, covariance: f64| {
                let products = sizes[i][0] * sizes[j][0] + sizes[i][1] * sizes[j][1];
                let both = own[i] * own[j];
                if products != 0.0 && both > 0.0 {
                    variance += 2.0 * products * covariance / both.sqrt();
                }
            };
            // Of few nodes all before this one, of many those that it reaches.
            if i < columns[i].len() {
                (0..i).filter_map(|j| Some((j, entry(&columns[i], weights[j].0)?))).for_each(|(j, v)| add(j, v));
            } else {
                let before = columns[i].iter().take_while(|(node, _)| *node < weights[i].0);
                before.filter(|(node, _)| places[*node] > 0).for_each(|&(node, v)| add(places[node] - 1, v));
            }
        }
        // Rounding, and correlations cut at their reach, may leave less than nothing.
        variance.max(0.0).sqrt()
    }

    fn column(&self, node: usize) -> Arc<Column> {
        let mut columns = self.columns.lock().unwrap_or_else(PoisonError::into_inner);
        columns.entry(node).or_insert_with(|| Arc::new(self.solve(node))).clone()
    }

    /// Column `node` of the inverse, by conjugate gradients on the patch around it.
    fn solve(&self, node: usize) -> Column {
        let Some(mass) = self.mass.as_ref().filter(|mass| !mass[node].is_empty()) else { return Column::new() };
        let mut patch = vec![node];
        let mut local = HashMap::from([(node, 0)]);
        let mut ring = 0..1;
        let mut n_reached = 1;
        for distance in 1..=REACH + MARGIN {
            for at in ring.clone() {
                for &(neighbour, _) in &mass[patch[at]] {
                    local.entry(neighbour as usize).or_insert_with(|| {
                        patch.push(neighbour as usize);
                        patch.len() - 1
                    });
                }
            }
            ring = ring.end..patch.len();
            if distance == REACH {
                n_reached = patch.len();
            }
        }
        let rows: Vec<Vec<(usize, f64)>> = patch
            .iter()
            .map(|&row| mass[row].iter().filter_map(|&(k, m)| Some((*local.get(&(k as usize))?, m))).collect())
            .collect();
        let mut load = vec![0.0; patch.len()];
        load[0] = 1.0;
        let solution = solve_spd(&rows, load);
        let mut column: Column = patch[..n_reached].iter().copied().zip(solution).collect();
        column.sort_unstable_by_key(|(node, _)| *node);
        column
    }
}

/// Conjugate gradients with the diagonal as preconditioner: the condition of fair elements is ten, steps some twenty.
pub(in crate::field) fn solve_spd(rows: &[Vec<(usize, f64)>], load: Vec<f64>) -> Vec<f64> {
    let n = load.len();
    let diagonal: Vec<f64> = (0..n).map(|i| rows[i].iter().find(|&&(k, _)| k == i).map_or(1.0, |&(_, m)| m)).collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let scaled = |r: &[f64]| r.iter().zip(&diagonal).map(|(r, d)| r / d).collect::<Vec<f64>>();
    let mut x = vec![0.0; n];
    let mut residual = load;
    let mut z = scaled(&residual);
    let mut direction = z.clone();
    let mut rho = dot(&residual, &z);
    let goal = PRECISION * PRECISION * rho;
    for _ in 0..200 {
        let image: Vec<f64> = rows.iter().map(|row| row.iter().map(|&(k, m)| m * direction[k]).sum()).collect();
        let step = rho / dot(&direction, &image);
        if !step.is_finite() {
            break;
        }
        for i in 0..n {
            x[i] += step * direction[i];
            residual[i] -= step * image[i];
        }
        z = scaled(&residual);
        let next = dot(&residual, &z);
        if next <= goal {
            break;
        }
        let turn = next / rho;
        rho = next;
        for i in 0..n {
            direction[i] = z[i] + turn * direction[i];
        }
    }
    x
}

/// Whether all nodes of an element are measured.
fn is_whole<U: Length>(mesh: &Mesh<U>, measured: &[bool], element: usize) -> bool {
    mesh.elements()[element].iter().all(|&node| measured[node as usize])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Grid;

    fn grid(nx: usize, ny: usize) -> Mesh<Px> {
        let grid = Grid { x0: 0.0, y0: 0.0, hx: 16.0, hy: 16.0, nx, ny, first_node: 0, first_element: 0 };
        Mesh::from_grids(vec!["all".into()], vec![grid])
    }

    #[test]
    fn correlations_are_those_of_the_symbol_and_of_its_reflection_at_a_border() {
        let (mesh, n) = (grid(24, 24), 25);
        let noise = NodalNoise::new(&mesh, &vec![true; mesh.n_nodes()]);
        let r = 3f64.sqrt() - 2.0;
        // In one dimension the inverse of a half-infinite chain is r^|i-j| + r^(i+j), times a constant: the
        // reflected part makes the variance at the end twice that inside.
        let along = |i: i32, j: i32| {
            let g = |i: i32, j: i32| r.powi((i - j).abs()) + r.powi(i + j);
            g(i, j) / (g(i, i) * g(j, j)).sqrt()
        };
        let node = |i: i32, j: i32| (j * n + i) as usize;
        for (a, b) in
            [((12, 12), (13, 12)), ((12, 12), (13, 13)), ((12, 12), (12, 14)), ((0, 12), (1, 12)), ((0, 0), (1, 2))]
        {
            let want = along(a.0, b.0) * along(a.1, b.1);
            let found = noise.correlation(node(a.0, a.1), node(b.0, b.1));
            // The other ends are 12 elements away: 0.268^24; the patch is cut 10 elements away.
            assert!((found - want).abs() < 1e-6, "{a:?}, {b:?}: {found}, {want}");
        }
        assert_eq!(noise.correlation(node(0, 0), node(20, 20)), 0.0);
    }

    #[test]
    fn the_mean_of_a_row_has_the_noise_of_the_whole_inverse() {
        // Against a dense inverse of the same mass matrix, with a hole in the measured nodes.
        let mesh = grid(7, 5);
        let mut measured = vec![true; mesh.n_nodes()];
        measured[2 * 8 + 3] = false;
        let noise = NodalNoise::new(&mesh, &measured);
        let n = mesh.n_nodes();
        let kept: Vec<usize> = (0..n).filter(|&node| measured[node]).collect();
        let rows: Vec<Vec<(usize, f64)>> = kept
            .iter()
            .map(|&i| {
                let row = &noise.mass.as_ref().unwrap()[i];
                row.iter().map(|&(k, m)| (kept.iter().position(|&node| node == k as usize).unwrap(), m)).collect()
            })
            .collect();
        let inverse: Vec<Vec<f64>> = (0..kept.len())
            .map(|i| {
                let mut load = vec![0.0; kept.len()];
                load[i] = 1.0;
                solve_spd(&rows, load)
            })
            .collect();
        let mut sigma = vec![[0.0; 2]; n];
        for (i, &node) in kept.iter().enumerate() {
            sigma[node] = [inverse[i][i].sqrt(), 2.0 * inverse[i][i].sqrt()];
        }
        let row: Vec<usize> = (0..7).map(|i| kept[8 + i]).collect();
        let weights: Vec<_> = row.iter().map(|&node| (node, [1.0 / 7.0, 0.0])).collect();
        let want: f64 = (0..7).flat_map(|i| (0..7).map(move |j| (8 + i, 8 + j))).map(|(i, j)| inverse[i][j]).sum();
        let want = want.sqrt() / 7.0;
        let found = noise.sigma(&weights, &sigma);
        assert!((found / want - 1.0).abs() < 1e-3, "{found}, {want}"); // correlations beyond the reach
        // Negative neighbours: less than independent nodes would have; and never more than the bound.
        let independent = row.iter().map(|&node| sigma[node][0].powi(2)).sum::<f64>().sqrt() / 7.0;
        let bound = NodalNoise::unknown(&mesh, &measured).sigma(&weights, &sigma);
        assert!(found < 0.8 * independent && independent < bound, "{found}, {independent}, {bound}");
    }
}
