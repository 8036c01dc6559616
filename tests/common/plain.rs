//! A plain global Q4 correlation in `f64`: nothing is shared with the library but the numbering of the
//! mesh. B-spline coefficients by elimination of the banded interpolation equations (no recursive
//! filter), weights by the recurrence of Cox and de Boor, dense normal equations.

use super::dense::Dense;
use quadrille::field::Brightness;
use quadrille::imaging::Image;
use quadrille::linalg::{BlockMatrix, ElementMatrix, Pattern, Solver, SolverChoice};
use quadrille::mesh::{Mesh, shape_functions};
use quadrille::synth::Motion;
use quadrille::units::Px;
use std::sync::Arc;

/// A pixel of a mesh.
pub struct Pixel {
    pub x: usize,
    pub y: usize,
    /// The element that holds its centre.
    pub element: usize,
    pub nodes: [usize; 4],
    pub xi: f64,
    pub eta: f64,
}

/// Visits the pixels whose centre lies in a half-open element, each once.
pub fn for_each_pixel(mesh: &Mesh<Px>, mut visit: impl FnMut(&Pixel)) {
    for (element, nodes) in mesh.elements().iter().enumerate() {
        let nodes = nodes.map(|node| node as usize);
        let ([x0, y0], [x1, y1]) = (mesh.nodes()[nodes[0]], mesh.nodes()[nodes[2]]);
        for y in y0.ceil().max(0.0) as usize..y1.ceil() as usize {
            for x in x0.ceil().max(0.0) as usize..x1.ceil() as usize {
                let (xi, eta) = ((x as f64 - x0) / (x1 - x0), (y as f64 - y0) / (y1 - y0));
                visit(&Pixel { x, y, element, nodes, xi, eta });
            }
        }
    }
}

/// Values, in `[0, 1)` at `t`, of the `degree + 1` B-splines on whole knots that do not vanish there.
pub fn basis(degree: usize, t: f64) -> Vec<f64> {
    let mut values = vec![1.0];
    for d in 1..=degree {
        let old = |k: usize| if k < d { values[k] } else { 0.0 };
        let rise = |k: usize| if k > 0 { (t + (d - k) as f64) * old(k - 1) } else { 0.0 };
        values = (0..=d).map(|k| (rise(k) + ((k + 1) as f64 - t) * old(k)) / d as f64).collect();
    }
    values
}

/// Their derivatives.
pub fn basis_slopes(degree: usize, t: f64) -> Vec<f64> {
    let lower = basis(degree - 1, t);
    (0..=degree).map(|k| (if k > 0 { lower[k - 1] } else { 0.0 }) - if k < degree { lower[k] } else { 0.0 }).collect()
}

/// The B-spline of odd degree through the grey levels of an image, continued through its outermost pixels.
pub struct Spline {
    degree: usize,
    width: usize,
    height: usize,
    coefficients: Vec<f64>,
}

impl Spline {
    pub fn new(image: &Image, degree: usize) -> Self {
        let (width, height) = (image.width(), image.height());
        let mut coefficients: Vec<f64> =
            (0..height).flat_map(|y| (0..width).map(move |x| f64::from(image.grey(x, y)))).collect();
        let rows = Banded::interpolation(degree, width);
        for row in coefficients.chunks_mut(width) {
            rows.solve(row);
        }
        let columns = Banded::interpolation(degree, height);
        let mut column = vec![0.0; height];
        for x in 0..width {
            for y in 0..height {
                column[y] = coefficients[y * width + x];
            }
            columns.solve(&mut column);
            for y in 0..height {
                coefficients[y * width + x] = column[y];
            }
        }
        Self { degree, width, height, coefficients }
    }

    fn sum(&self, x: [f64; 2], weights: [fn(usize, f64) -> Vec<f64>; 2]) -> f64 {
        let whole = x.map(f64::floor);
        let [wx, wy] = [0, 1].map(|c| weights[c](self.degree, x[c] - whole[c]));
        let first = whole.map(|x| x as isize - (self.degree as isize - 1) / 2);
        let mut sum = 0.0;
        for (j, wy) in wy.iter().enumerate() {
            for (row, row_share) in continued(first[1] + j as isize, self.height) {
                for (i, wx) in wx.iter().enumerate() {
                    for (column, share) in continued(first[0] + i as isize, self.width) {
                        sum += row_share * share * wy * wx * self.coefficients[row * self.width + column];
                    }
                }
            }
        }
        sum
    }

    pub fn value(&self, x: [f64; 2]) -> f64 {
        self.sum(x, [basis, basis])
    }

    pub fn gradient(&self, x: [f64; 2]) -> [f64; 2] {
        [self.sum(x, [basis_slopes, basis]), self.sum(x, [basis, basis_slopes])]
    }
}

/// Places and shares that make up the value at `k`: beyond an end, twice the end less the value mirrored
/// about it.
fn continued(k: isize, n: usize) -> [(usize, f64); 2] {
    let last = n as isize - 1;
    match k {
        _ if k < 0 => [(0, 2.0), (k.unsigned_abs(), -1.0)],
        _ if k > last => [(n - 1, 2.0), ((2 * last - k) as usize, -1.0)],
        _ => [(k as usize, 1.0), (k as usize, 0.0)],
    }
}

/// LU factors of a banded matrix, without pivots (the interpolation equations are diagonally dominant).
struct Banded {
    half: usize,
    rows: Vec<Vec<f64>>,
}

impl Banded {
    /// The equations that make the spline pass through `n` samples.
    fn interpolation(degree: usize, n: usize) -> Self {
        let half = (degree - 1) / 2;
        let at_pixel = basis(degree, 0.0);
        let mut rows = vec![vec![0.0; 2 * half + 1]; n];
        for (i, row) in rows.iter_mut().enumerate() {
            for (k, weight) in at_pixel.iter().take(2 * half + 1).enumerate() {
                for (column, share) in continued((i + k) as isize - half as isize, n) {
                    row[column + half - i] += share * weight;
                }
            }
        }
        for k in 0..n {
            for i in k + 1..(k + half + 1).min(n) {
                let factor = rows[i][k + half - i] / rows[k][half];
                rows[i][k + half - i] = factor;
                for j in k + 1..(k + half + 1).min(n) {
                    rows[i][j + half - i] -= factor * rows[k][j + half - k];
                }
            }
        }
        Self { half, rows }
    }

    fn solve(&self, x: &mut [f64]) {
        let (n, half) = (x.len(), self.half);
        for i in 0..n {
            for j in i.saturating_sub(half)..i {
                x[i] -= self.rows[i][j + half - i] * x[j];
            }
        }
        for i in (0..n).rev() {
            for j in i + 1..(i + half + 1).min(n) {
                x[i] -= self.rows[i][j + half - i] * x[j];
            }
            x[i] /= self.rows[i][half];
        }
    }
}

/// `(psi_i . grad f)` of the eight unknowns of the element of a pixel: unknown `2 k + c`.
fn slopes(pixel: &Pixel, gradient: [f64; 2]) -> [f64; 8] {
    let psi = shape_functions(pixel.xi, pixel.eta);
    std::array::from_fn(|i| psi[i / 2] * gradient[i % 2])
}

/// Correlates `deformed`, through which goes a spline of `degree`, with `reference`, which has the gradient of the cubic
/// one, from `start` until the corrections are below 1e-9 px.
///
/// Gain and offset are fitted at every displacement, so that at the end both are at their optimum.
pub fn correlate(
    reference: &Image,
    deformed: &Image,
    mesh: &Mesh<Px>,
    degree: usize,
    brightness: Brightness,
    mut displacement: Vec<[f64; 2]>,
) -> Vec<[f64; 2]> {
    let f = Spline::new(reference, 3);
    let g = Spline::new(deformed, degree);
    let mut pixels = Vec::new();
    let mut matrix = Dense::zero(2 * mesh.n_nodes());
    for_each_pixel(mesh, |pixel| {
        let slopes = slopes(pixel, f.gradient([pixel.x as f64, pixel.y as f64]));
        let unknowns: [usize; 8] = std::array::from_fn(|i| 2 * pixel.nodes[i / 2] + i % 2);
        for i in 0..8 {
            for j in 0..8 {
                *matrix.at(unknowns[i], unknowns[j]) += slopes[i] * slopes[j];
            }
        }
        let group = match brightness {
            Brightness::Element => pixel.element,
            _ => mesh.element_zone()[pixel.element] as usize,
        };
        let psi = shape_functions(pixel.xi, pixel.eta);
        let grey = f64::from(reference.grey(pixel.x, pixel.y));
        pixels.push(([pixel.x as f64, pixel.y as f64], pixel.nodes, psi, unknowns, slopes, group, grey));
    });
    let inverse = matrix.inverse();
    let n_groups = 1 + pixels.iter().map(|p| p.5).max().unwrap();
    for _ in 0..60 {
        let greys: Vec<f64> = pixels
            .iter()
            .map(|(x, nodes, psi, ..)| {
                g.value([0, 1].map(|c| x[c] + (0..4).map(|k| psi[k] * displacement[nodes[k]][c]).sum::<f64>()))
            })
            .collect();
        // Gain and offset about the means: of a zone the line closest to the pairs in both directions, of an element by
        // least squares.
        let mut sums = vec![[0.0; 3]; n_groups];
        for (pixel, g) in pixels.iter().zip(&greys) {
            for (sum, value) in sums[pixel.5].iter_mut().zip([1.0, pixel.6, *g]) {
                *sum += value;
            }
        }
        let means: Vec<[f64; 2]> = sums.iter().map(|s| [s[1] / s[0], s[2] / s[0]]).collect();
        let mut products = vec![[0.0; 3]; n_groups];
        for (pixel, g) in pixels.iter().zip(&greys) {
            let [mean_f, mean_g] = means[pixel.5];
            products[pixel.5][0] += (pixel.6 - mean_f) * (g - mean_g);
            products[pixel.5][1] += (g - mean_g).powi(2);
            products[pixel.5][2] += (pixel.6 - mean_f).powi(2);
        }
        let mut rhs = vec![0.0; 2 * mesh.n_nodes()];
        for ((_, _, _, unknowns, slopes, group, f), g) in pixels.iter().zip(&greys) {
            let [mean_f, mean_g] = means[*group];
            let [fg, gg, ff] = products[*group];
            let half = 0.5 * (ff - gg) / fg;
            let gain = if brightness == Brightness::Element { fg / gg } else { half + half.hypot(1.0) };
            let brought = if brightness == Brightness::Off { *g } else { mean_f + gain * (g - mean_g) };
            for i in 0..8 {
                rhs[unknowns[i]] += slopes[i] * (f - brought);
            }
        }
        let correction: Vec<f64> =
            inverse.iter().map(|column| column.iter().zip(&rhs).map(|(a, b)| a * b).sum()).collect();
        for (unknown, du) in correction.iter().enumerate() {
            displacement[unknown / 2][unknown % 2] += du;
        }
        if correction.iter().all(|du| du.abs() < 1e-9) {
            return displacement;
        }
    }
    panic!("the plain correlation did not converge");
}

/// The field on `mesh` closest to `motion` as the texture sees it: minimises the sum over the pixels of
/// `[grad f . (u_exact - sum N a) + e]^2`. Without an error `e(x)` of the grey levels (of the reference
/// less the deformed image brought back) no correlation on this mesh can do better.
pub fn projection<M: Motion>(
    reference: &Image,
    mesh: &Mesh<Px>,
    motion: &M,
    error: impl Fn([usize; 2]) -> f64,
) -> Vec<[f64; 2]> {
    let f = Spline::new(reference, 3);
    let mut matrices: Vec<ElementMatrix> = vec![[0.0; 36]; mesh.n_elements()];
    let mut vectors = vec![[0.0; 8]; mesh.n_elements()];
    for_each_pixel(mesh, |pixel| {
        let x = [pixel.x as f64, pixel.y as f64];
        let gradient = f.gradient(x);
        let (slopes, u) = (slopes(pixel, gradient), motion.displacement(x));
        let seen = gradient[0] * u[0] + gradient[1] * u[1] + error([pixel.x, pixel.y]);
        add_product(&mut matrices[pixel.element], &slopes);
        for i in 0..8 {
            vectors[pixel.element][i] += slopes[i] * seen;
        }
    });
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let matrix = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
    let solver = Solver::new(matrix, SolverChoice::Direct, || (0..mesh.n_nodes()).collect()).unwrap();
    solver.solve(pattern.gather(|element| vectors[element]))
}

/// The normal matrix of each element, `sum (psi_i . grad f)(psi_j . grad f)`.
pub fn normal_matrices(reference: &Image, mesh: &Mesh<Px>) -> Vec<ElementMatrix> {
    let f = Spline::new(reference, 3);
    let mut matrices: Vec<ElementMatrix> = vec![[0.0; 36]; mesh.n_elements()];
    for_each_pixel(mesh, |pixel| {
        let slopes = slopes(pixel, f.gradient([pixel.x as f64, pixel.y as f64]));
        add_product(&mut matrices[pixel.element], &slopes);
    });
    matrices
}

fn add_product(matrix: &mut ElementMatrix, slopes: &[f64; 8]) {
    let pairs = (0..8).flat_map(|i| (i..8).map(move |j| (i, j)));
    for (entry, (i, j)) in matrix.iter_mut().zip(pairs) {
        *entry += slopes[i] * slopes[j];
    }
}

/// Root mean square of each component of the gradient over the pixels of all zones, grey levels per px.
pub fn gradient_rms(reference: &Image, mesh: &Mesh<Px>) -> [f64; 2] {
    let f = Spline::new(reference, 3);
    let (mut sums, mut n) = ([0.0; 2], 0.0);
    for_each_pixel(mesh, |pixel| {
        let gradient = f.gradient([pixel.x as f64, pixel.y as f64]);
        for c in 0..2 {
            sums[c] += gradient[c].powi(2);
        }
        n += 1.0;
    });
    sums.map(|sum| (sum / n).sqrt())
}
