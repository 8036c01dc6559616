//! Strains over a window of nodes: against fields whose gradient is known, and their noise against draws of it.

use crate::common;
use common::dense::Dense;
use quadrille::field::{Measurement, Status, StrainDefinition, StrainField, StrainWindow, StrainWindows};
use quadrille::mesh::{ElementGeometry, Mesh, Roi, Zone};
use quadrille::units::Px;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

pub const SIZE: f64 = 16.0;

/// A grid of `nx` x `ny` elements of 16 px.
pub fn grid(nx: usize, ny: usize) -> Arc<Mesh<Px>> {
    let [x1, y1] = [nx, ny].map(|n| SIZE * n as f64);
    let zone = Zone::rectangle("all", Roi { x0: 0.0, y0: 0.0, x1, y1 });
    Arc::new(Mesh::on_zones(&[zone], 16, x1 as usize + 1, y1 as usize + 1).unwrap())
}

pub fn field(mesh: &Arc<Mesh<Px>>, u: impl Fn([f64; 2]) -> [f64; 2]) -> Measurement<Px> {
    Measurement {
        status: Status::Converged,
        displacement: mesh.nodes().iter().map(|&x| u(x)).collect(),
        sigma: vec![[0.01, 0.02]; mesh.n_nodes()],
        measured: vec![true; mesh.n_nodes()],
        element_residual: vec![1.0; mesh.n_elements()],
        model_error: None,
        marks: None,
        points: None,
        mesh: Arc::clone(mesh),
    }
}

pub fn windows(mesh: &Mesh<Px>, nodes: u32) -> StrainWindows {
    StrainWindows::new(mesh, StrainWindow::new(nodes).unwrap(), false)
}

/// The node nearest to a place.
pub fn node_at(mesh: &Mesh<Px>, at: [f64; 2]) -> usize {
    let distance = |k: &usize| (mesh.nodes()[*k][0] - at[0]).hypot(mesh.nodes()[*k][1] - at[1]);
    (0..mesh.n_nodes()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
}

#[test]
fn a_linear_field_has_its_strain_in_every_window_borders_and_holes_included() {
    let mesh = grid(9, 7);
    let gradient = [[0.02, -0.01], [0.005, 0.03]];
    let mut linear = field(&mesh, |[x, y]| gradient.map(|[a, b]| 0.7 + a * x + b * y));
    linear.measured[node_at(&mesh, [64.0, 48.0])] = false;
    for definition in [StrainDefinition::Infinitesimal, StrainDefinition::GreenLagrange, StrainDefinition::Hencky] {
        let want = definition.of_gradient(gradient).unwrap().components();
        for n in [3, 5, 7] {
            let found = windows(&mesh, n).of(&linear, definition);
            let known = found.nodes.iter().flatten().count();
            // Three windows see the hole's ring from a corner of which less than a quarter is left.
            assert!(known >= mesh.n_nodes() - 5, "{known} of {} with {n} x {n}", mesh.n_nodes());
            assert_eq!(found.nodes[node_at(&mesh, [64.0, 48.0])], None);
            for (strain, _) in found.nodes.iter().flatten() {
                for (e, want) in strain.components().into_iter().zip(want) {
                    // Sums of 49 terms of size 0.05 with weights up to 0.1: some 1e-16 each.
                    assert!((e - want).abs() < 1e-14, "{definition}, {n}: {e}, {want}");
                }
            }
        }
    }
}

#[test]
fn a_quadratic_field_has_its_strain_in_whole_windows_and_that_of_the_middle_of_the_nodes_in_others() {
    let mesh = grid(10, 10);
    let bent = field(&mesh, |[x, y]| [1e-4 * x * x + 2e-4 * x * y, 3e-4 * y * y]);
    let found = windows(&mesh, 5).of(&bent, StrainDefinition::Infinitesimal);
    let at = |x: f64, y: f64| found.nodes[node_at(&mesh, [x, y])].unwrap().0;
    let exact = |x: f64, y: f64| [2e-4 * x + 2e-4 * y, 6e-4 * y, 1e-4 * x];
    for [x, y] in [[80.0, 80.0], [32.0, 128.0], [112.0, 48.0]] {
        for (e, want) in at(x, y).components().into_iter().zip(exact(x, y)) {
            assert!((e - want).abs() < 1e-14, "({x}, {y}): {e}, {want}");
        }
    }
    // At the left border the window has its columns 0 to 2: the slope of a parabola fitted there is that of column 1.
    let exx = at(0.0, 80.0).xx;
    assert!((exx - exact(16.0, 80.0)[0]).abs() < 1e-14, "{exx}");
    // The third degree is where a window begins to flatten: x^3 over 2k + 1 nodes has the slope l^2 (3 k^2 + 3 k -
    // 1)/5.
    let cubic = field(&mesh, |[x, _]| [1e-6 * (x - 80.0).powi(3), 0.0]);
    for (n, k) in [(3, 1.0), (5, 2.0), (7, 3.0f64)] {
        let found = windows(&mesh, n).of(&cubic, StrainDefinition::Infinitesimal);
        let want = 1e-6 * SIZE * SIZE * (3.0 * k * k + 3.0 * k - 1.0) / 5.0;
        let exx = found.nodes[node_at(&mesh, [80.0, 80.0])].unwrap().0.xx;
        assert!((exx - want).abs() < 1e-12, "{n}: {exx}, {want}");
    }
}

/// The mass matrix of the elements with all nodes measured, on those nodes; and the nodes.
fn mass(field: &Measurement<Px>) -> (Dense, Vec<usize>) {
    let mesh = &field.mesh;
    let whole = |e: &usize| mesh.elements()[*e].iter().all(|&node| field.measured[node as usize]);
    let kept: Vec<usize> = (0..mesh.n_nodes()).filter(|&node| field.measured[node]).collect();
    let place = |node: u32| kept.iter().position(|&kept| kept == node as usize).unwrap();
    let mut dense = Dense::zero(kept.len());
    for element in (0..mesh.n_elements()).filter(whole) {
        let mass = ElementGeometry::new(mesh.corners(element)).mass_matrix();
        let nodes = mesh.elements()[element].map(place);
        for i in 0..4 {
            for j in 0..4 {
                *dense.at(nodes[i], nodes[j]) += mass[i][j];
            }
        }
    }
    (dense, kept)
}

/// Draws of nodal noise with the inverse of the mass matrix as covariance: a Cholesky factor times white noise.
pub struct Draws {
    kept: Vec<usize>,
    factor: Vec<Vec<f64>>,
    amplitude: [f64; 2],
    rng: ChaCha8Rng,
}

impl Draws {
    /// Of `field`, whose standard uncertainties become those of such noise.
    pub fn of(field: &mut Measurement<Px>, amplitude: [f64; 2], seed: u64) -> Self {
        let (dense, kept) = mass(field);
        let n = kept.len();
        let unit = |k: usize| (0..n).map(|i| f64::from(i == k)).collect::<Vec<f64>>();
        let inverse = dense.solve(&(0..n).map(unit).collect::<Vec<_>>());
        for (k, &node) in kept.iter().enumerate() {
            field.sigma[node] = amplitude.map(|a| a * inverse[k][k].sqrt());
        }
        let mut factor = vec![vec![0.0; n]; n];
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
                let left = inverse[i][j] - known;
                factor[i][j] = if i == j { left.sqrt() } else { left / factor[j][j] };
            }
        }
        Self { kept, factor, amplitude, rng: ChaCha8Rng::seed_from_u64(seed) }
    }

    fn normal(&mut self) -> f64 {
        let [a, b]: [f64; 2] = [self.rng.random(), self.rng.random()];
        (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
    }

    /// Adds a draw to the displacements.
    pub fn add_to(&mut self, field: &mut Measurement<Px>) {
        for c in 0..2 {
            let white: Vec<f64> = (0..self.kept.len()).map(|_| self.normal()).collect();
            for (&node, row) in self.kept.iter().zip(&self.factor) {
                let value: f64 = row.iter().zip(&white).map(|(l, w)| l * w).sum();
                field.displacement[node][c] += self.amplitude[c] * value;
            }
        }
    }
}

#[test]
fn the_noise_of_a_window_is_that_of_draws_with_the_covariance_of_the_nodes() {
    const DRAWS: usize = 4000;
    let mesh = grid(8, 6);
    let mut still = field(&mesh, |_| [0.0; 2]);
    still.measured[node_at(&mesh, [80.0, 48.0])] = false;
    let mut noise = Draws::of(&mut still, [0.05, 0.1], 5);
    let windows = windows(&mesh, 5);
    let predicted = windows.of(&still, StrainDefinition::Infinitesimal);
    let mut squares = vec![[0.0; 3]; mesh.n_nodes()];
    let mut drawn = still.clone();
    for _ in 0..DRAWS {
        drawn.displacement.fill([0.0; 2]);
        noise.add_to(&mut drawn);
        for (sum, at) in squares.iter_mut().zip(windows.of(&drawn, StrainDefinition::Infinitesimal).nodes) {
            if let Some((strain, _)) = at {
                sum.iter_mut().zip(strain.components()).for_each(|(sum, e)| *sum += e * e);
            }
        }
    }
    let mut worst = 0.0f64;
    for (sum, at) in squares.iter().zip(&predicted.nodes) {
        let Some((_, sigma)) = at else { continue };
        for c in 0..3 {
            let ratio = sigma[c] / (sum[c] / DRAWS as f64).sqrt();
            worst = worst.max((ratio - 1.0).abs());
        }
    }
    // 1/sqrt(2 DRAWS) = 1.1 % each; of 180 numbers the largest is off by three to four times that.
    assert!(worst < 0.05, "predicted noise is off by {worst}");
}

#[test]
fn strains_alone_are_those_that_come_with_their_errors_borders_and_holes_included() {
    let mesh = grid(9, 7);
    let mut bent = field(&mesh, |[x, y]| [1e-4 * x * y + 2e-6 * x.powi(3), 3e-4 * y * y - 1e-4 * x]);
    for at in [[64.0, 48.0], [0.0, 0.0], [128.0, 96.0]] {
        bent.measured[node_at(&mesh, at)] = false;
    }
    for definition in [StrainDefinition::Infinitesimal, StrainDefinition::GreenLagrange] {
        for n in [3, 5, 9] {
            let both = windows(&mesh, n);
            let with_errors = both.of(&bent, definition).nodes.into_iter().map(|at| at.map(|(strain, _)| strain));
            assert_eq!(both.values(&bent, definition), with_errors.collect::<Vec<_>>(), "{n} x {n}");
        }
    }
}

#[test]
fn the_noise_inside_is_that_of_the_factor_and_falls_with_the_gauge() {
    let mesh = grid(24, 24);
    let still = field(&mesh, |_| [0.0; 2]);
    let middle = node_at(&mesh, [192.0, 192.0]);
    let mut before = f64::INFINITY;
    for n in [3, 5, 7, 9] {
        let window = StrainWindow::new(n).unwrap();
        let (_, sigma) = windows(&mesh, n).of(&still, StrainDefinition::Infinitesimal).nodes[middle].unwrap();
        let [x, y] = [0.01, 0.02].map(|sigma_u| window.noise() * sigma_u / SIZE);
        for (found, want) in sigma.into_iter().zip([x, y, 0.5 * x.hypot(y)]) {
            assert!((found / want - 1.0).abs() < 1e-6, "{n}: {found}, {want}"); // places are rounded to 2^-16
        }
        assert!(window.noise() < before, "{n}");
        before = window.noise();
        assert_eq!(window.gauge_length(SIZE), f64::from(n) * SIZE);
    }
    // A regularised field says more than that, never less.
    let bound = StrainWindows::new(&mesh, StrainWindow::new(5).unwrap(), true);
    let (_, upper) = bound.of(&still, StrainDefinition::Infinitesimal).nodes[middle].unwrap();
    let (_, sigma) = windows(&mesh, 5).of(&still, StrainDefinition::Infinitesimal).nodes[middle].unwrap();
    assert!(upper.iter().zip(&sigma).all(|(upper, sigma)| upper > sigma), "{upper:?}, {sigma:?}");
}

#[test]
fn windows_do_not_reach_over_what_is_not_measured_and_follow_it_from_frame_to_frame() {
    // Two halves that move apart, with a column between them that is not measured.
    let mesh = grid(12, 8);
    let apart = |[x, _]: [f64; 2]| if x < 96.0 { [-1.0, 0.0] } else { [1.0, 0.0] };
    let mut torn = field(&mesh, apart);
    for (node, place) in mesh.nodes().iter().enumerate() {
        torn.measured[node] = place[0] != 96.0;
    }
    let reused = windows(&mesh, 5);
    let whole = field(&mesh, apart);
    assert!(reused.of(&whole, StrainDefinition::Infinitesimal).nodes.iter().flatten().any(|(e, _)| e.xx > 0.01));
    let found = reused.of(&torn, StrainDefinition::Infinitesimal);
    assert!(found.nodes.iter().flatten().all(|(e, _)| e.xx.abs() < 1e-14), "a window reaches over the gap");
    assert!(found.nodes.iter().flatten().count() > 80);
    // What is kept from other fields changes no bit.
    assert_eq!(found, windows(&mesh, 5).of(&torn, StrainDefinition::Infinitesimal));
    let mut small = torn.clone();
    small.measured[node_at(&mesh, [32.0, 32.0])] = false;
    assert_eq!(
        reused.of(&small, StrainDefinition::Infinitesimal),
        windows(&mesh, 5).of(&small, StrainDefinition::Infinitesimal)
    );
}

#[test]
fn too_few_nodes_or_nodes_on_a_line_are_no_window() {
    let mesh = grid(8, 8);
    let mut lonely = field(&mesh, |[x, _]| [0.01 * x, 0.0]);
    // One element is left: 4 of 25 nodes are less than a quarter, 4 of 9 are enough.
    for (node, &[x, y]) in mesh.nodes().iter().enumerate() {
        lonely.measured[node] = (32.0..=48.0).contains(&x) && (32.0..=48.0).contains(&y);
    }
    let known = |n: u32| windows(&mesh, n).of(&lonely, StrainDefinition::Infinitesimal).nodes.iter().flatten().count();
    assert_eq!([known(3), known(5)], [4, 0]);
    // A strip of one element: two rows of nodes, 18 of 81 are less than a quarter; 10 of 25 are enough.
    let strip = grid(20, 1);
    let field = field(&strip, |[x, _]| [0.01 * x, 0.0]);
    let known = |n: u32| windows(&strip, n).of(&field, StrainDefinition::Infinitesimal).nodes.iter().flatten().count();
    assert_eq!([known(5) > 0, known(9) > 0], [true, false]);
}

#[test]
fn the_strain_of_elements_and_nodes_is_what_it_is_without_a_window() {
    let mesh = grid(4, 4);
    let field = field(&mesh, |[x, y]| [0.01 * x, 0.02 * y]);
    let strain = StrainField::of(&field, StrainDefinition::GreenLagrange);
    assert!(strain.window.is_none() && strain.elements.iter().all(Option::is_some));
}
