//! Strain over a window of nodes: the virtual strain gauge of the good practice guides.
//!
//! A plane is fitted by least squares to each component of the displacement of the nodes around a node; its slopes are
//! the displacement gradient there. The noise of the slopes follows from that of the nodes and from how it goes
//! together ([`NodalNoise`](super::NodalNoise) has the same model). What the plane flattens is seen from a cubic over the
//! same nodes ([`flattening`](super::flattening), THEORY 20).

use super::Measurement;
use super::flattening::{Flattened, Slope, cubic};
use super::strain::{StrainDefinition, TensorStrain};
use super::window::{MARGIN, StrainWindow, noise_of, plane};
use crate::mesh::{Mesh, corners_of};
use crate::units::Length;
use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::sync::{Arc, Mutex, PoisonError};

/// Rings that a cubic may take in beyond a window whose nodes do not determine it: 3 x 3 become 5 x 5.
const GROWTH: usize = 1;
/// What coefficients of bilinear elements overshoot: this times the second derivatives, in the size of the elements.
const OVERSHOOT: f64 = 1.0 / 12.0;
/// Places are rounded to this part of an element before noise is computed: windows of one shape have the same bits.
const GRAIN: f64 = 1.0 / 65536.0;

/// Strains over windows of nodes.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowStrains {
    /// The window.
    pub window: StrainWindow,
    /// At each node the strain over the window around it, and the standard uncertainty of exx, eyy and exy; `None`
    /// where the node is not measured, too few of its window are, or they lie on one line.
    pub nodes: Vec<Option<(TensorStrain, [f64; 3])>>,
    /// At each node the correlations of the noise of exx with eyy, exx with exy, eyy with exy; `None` where they are not
    /// known, as of regularised fields and of those that come from a store.
    pub correlations: Option<Vec<[f64; 3]>>,
    /// At each node what exx, eyy and exy may be off beyond noise, without sign (THEORY 20); zero where there is no
    /// strain, and `None` where nothing estimated it, as in earlier stores.
    pub model_error: Option<Vec<[f64; 3]>>,
    /// The windows that flatten by far more than noise; `None` where none does, or nobody looked.
    pub flattened: Option<Flattened>,
}

impl WindowStrains {
    /// The model errors where there is a strain; `None` where nothing estimated them.
    pub fn model_errors(&self) -> Option<Vec<Option<TensorStrain>>> {
        let of_nodes = self.nodes.iter().zip(self.model_error.as_ref()?);
        Some(of_nodes.map(|(at, error)| at.map(|_| TensorStrain::of_components(*error))).collect())
    }
}

/// Makes strains over windows of nodes, of one mesh and of any number of fields on it.
///
/// The window of a node holds the measured nodes of the elements within (N - 1)/2 rings around it, through elements
/// with all nodes measured: N x N nodes of a grid. It does not reach over a hole, a crack or into another zone. All its
/// nodes have one weight. Where the displacement is a polynomial of the first degree the strain is that of the field,
/// to round-off; on a whole window of a grid also of one of the second degree.
#[derive(Debug)]
pub struct StrainWindows {
    window: StrainWindow,
    /// Whether the correlation of nodal noise is not known: standard uncertainties are then upper bounds.
    bound: bool,
    /// Elements around each node.
    around: Vec<Vec<u32>>,
    /// Size of the elements.
    size: f64,
    kept: Mutex<Kept>,
}

/// What holds for all fields with the same measured nodes.
#[derive(Debug, Default)]
struct Kept {
    measured: Vec<bool>,
    places: Vec<Place>,
    /// Patches by their shape: most windows of a grid have one shape.
    shapes: HashMap<[u64; 2], Arc<Shape>>,
}

/// The window of one node.
#[derive(Debug, Clone, Default)]
struct Place {
    /// Its nodes, then those that only the cubic takes in; none where it does not count.
    nodes: Vec<u32>,
    /// How many are its own.
    window: usize,
    shape: Arc<Shape>,
}

/// What holds for all patches of one shape.
#[derive(Debug, Default)]
struct Shape {
    noise: Noise,
    /// Weights of the nodes in the slopes of the cubic; lengths in the size of the elements.
    cubic: Vec<[f64; 2]>,
}

/// What a patch does to noise of unit density; lengths in the size of the elements.
#[derive(Debug, Clone, Copy, Default)]
struct Noise {
    /// Variance of the displacement of the node in the middle.
    node: f64,
    /// Covariance of the slopes along x and y of the fitted plane: xx, xy, yy.
    slopes: [f64; 3],
    /// The same of the slopes of the cubic less those of the plane.
    off: [f64; 3],
}

/// Marks nodes and elements that have been come to, without clearing.
struct Marks {
    nodes: Vec<(u32, u32)>,
    elements: Vec<u32>,
    turn: u32,
}

impl Marks {
    fn new(n_nodes: usize, n_elements: usize) -> Self {
        Self { nodes: vec![(0, 0); n_nodes], elements: vec![0; n_elements], turn: 0 }
    }
}

/// Nodes and elements around a node, by rings.
#[derive(Default)]
struct Patch {
    nodes: Vec<u32>,
    elements: Vec<u32>,
    /// Number of nodes in the window, and in it with one and more rings around.
    ends: Vec<usize>,
}

/// Which elements have all their nodes measured.
fn whole_elements<U: Length>(mesh: &Mesh<U>, measured: &[bool]) -> Vec<bool> {
    mesh.elements().iter().map(|nodes| nodes.iter().all(|&node| measured[node as usize])).collect()
}

impl StrainWindows {
    /// Windows on `mesh`; `regularised` fields have noise whose correlation is not known.
    pub fn new<U: Length>(mesh: &Mesh<U>, window: StrainWindow, regularised: bool) -> Self {
        let mut around = vec![Vec::new(); mesh.n_nodes()];
        for (element, nodes) in mesh.elements().iter().enumerate() {
            for &node in corners_of(nodes) {
                around[node as usize].push(element as u32);
            }
        }
        Self { window, bound: regularised, around, size: mesh.element_size(), kept: Mutex::default() }
    }

    /// The window.
    pub fn window(&self) -> StrainWindow {
        self.window
    }

    /// The strains of `field`, which is on the mesh that these windows are made for.
    ///
    /// Windows are kept from field to field; where other nodes are measured than before they are found anew.
    ///
    /// # Panics
    /// When the field is on a mesh with another number of nodes.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// # use quadrille::{field::*, mesh::{Mesh, Roi, Zone}};
    /// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 64.0, y1: 64.0 };
    /// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
    /// # let displacement: Vec<_> = mesh.nodes().iter().map(|x| [0.01 * x[0], 0.0]).collect();
    /// # let field = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 25], measured: vec![true; 25],
    /// #     marks: None, points: None, element_residual: vec![1.0; 16], model_error: None, mesh: mesh.into(), displacement };
    /// let windows = StrainWindows::new(&field.mesh, StrainWindow::new(3).unwrap(), false);
    /// let strains = windows.of(&field, StrainDefinition::Infinitesimal); // stretched by 1 % along x
    /// let (strain, sigma) = strains.nodes[12].unwrap();
    /// assert!((strain.xx - 0.01).abs() < 1e-12 && sigma[0] < 0.01 / 16.0);
    /// ```
    pub fn of<U: Length>(&self, field: &Measurement<U>, definition: StrainDefinition) -> WindowStrains {
        assert_eq!(field.measured.len(), self.around.len(), "the mesh of the field");
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.measured != field.measured {
            self.prepare(&mut kept, field);
        }
        let places = &kept.places;
        let found: Vec<_> = places.iter().map(|place| self.strain(field, definition, places, place)).collect();
        // The noise of one cubic hides what is not large: the mean is over the windows around with as many nodes, which lie
        // to the same sides. The first is its own.
        let around = |node: usize| {
            found[node].as_ref()?;
            let Place { nodes, window, .. } = &places[node];
            let near = nodes.iter().take(*window).map(|&other| other as usize);
            let alike = near.filter(|&other| places[other].window == *window);
            let slopes = alike.filter_map(|other| Some(found[other]?.1));
            slopes.reduce(|sums, of| [0, 1, 2].map(|c| sums[c].and(of[c])))
        };
        let slopes: Vec<Option<[Slope; 3]>> = (0..found.len()).map(around).collect();
        let known = field.mesh.nodes().iter().zip(&slopes).filter_map(|(&at, slopes)| Some((at, (*slopes)?)));
        let model = slopes.iter().map(|slopes| slopes.map_or([0.0; 3], |slopes| slopes.map(Slope::model_error)));
        let correlations = found.iter().map(|at| at.map_or([0.0; 3], |(.., correlations)| correlations));
        WindowStrains {
            window: self.window,
            model_error: Some(model.collect()),
            flattened: Flattened::of(self.window, &known.collect::<Vec<_>>()),
            correlations: (!self.bound).then(|| correlations.collect()),
            nodes: found.iter().map(|at| at.map(|(strain, slopes, _)| (strain, slopes.map(|s| s.sigma)))).collect(),
        }
    }

    /// The strains of `field` alone, as [`of`](Self::of) has them, without what is known of their errors: a fraction of the
    /// work.
    pub fn values<U: Length>(&self, field: &Measurement<U>, definition: StrainDefinition) -> Vec<Option<TensorStrain>> {
        let (mesh, measured) = (&*field.mesh, &field.measured);
        let mut marks = Marks::new(self.around.len(), mesh.n_elements());
        let whole = whole_elements(mesh, measured);
        let rings = [self.window.rings(); 2];
        let mut at_node = |node: usize| {
            let takes = |element: u32| whole[element as usize];
            let patch = measured[node].then(|| self.patch(mesh, vec![node as u32], rings, &takes, &mut marks))?;
            if patch.elements.is_empty() || patch.nodes.len() < self.least_nodes() {
                return None;
            }
            let points: Vec<[f64; 2]> = patch.nodes.iter().map(|&node| mesh.nodes()[node as usize]).collect();
            let nodes = patch.nodes.iter().map(|&node| node as usize);
            definition.of_gradient(field.gradient(nodes.zip(plane(&points)?)))
        };
        (0..self.around.len()).map(&mut at_node).collect()
    }

    /// Nodes that a window needs at least: a quarter of a whole one.
    fn least_nodes(&self) -> usize {
        self.window.nodes().pow(2).div_ceil(4).max(4)
    }

    fn strain<U: Length>(
        &self,
        field: &Measurement<U>,
        definition: StrainDefinition,
        places: &[Place],
        place: &Place,
    ) -> Option<(TensorStrain, [Slope; 3], [f64; 3])> {
        let points: Vec<[f64; 2]> = place.nodes.iter().map(|&node| field.mesh.nodes()[node as usize]).collect();
        let weights = plane(points.get(..place.window)?)?;
        let nodes = place.nodes.iter().map(|&node| node as usize);
        let gradient = field.gradient(nodes.zip(weights.iter().copied()));
        // Variance of unit noise, by component of the displacement.
        let (mut density, mut total) = ([0.0; 2], 0.0);
        for (&node, w) in place.nodes.iter().zip(&weights) {
            let node = node as usize;
            let sigma = field.sigma[node];
            let square = w[0] * w[0] + w[1] * w[1];
            total += square;
            for c in 0..2 {
                density[c] += square * sigma[c] * sigma[c] / places[node].shape.noise.node;
            }
        }
        let strain = definition.of_gradient(gradient)?;
        let slopes = definition.slopes(gradient)?;
        let (off, bounds) = self.off(field, place, &points, &weights, gradient);
        let covariance = |a: &[[f64; 2]; 2], b: &[[f64; 2]; 2], [xx, xy, yy]: [f64; 3]| {
            let of = |c: usize| {
                let ([ax, ay], [bx, by]) = (a[c], b[c]);
                density[c] / total * (ax * bx * xx + (ax * by + ay * bx) * xy + ay * by * yy)
            };
            of(0) + of(1)
        };
        let sigma_of = |slope: &[[f64; 2]; 2], noise: [f64; 3], bound: &[[f64; 2]; 2]| match self.bound {
            true => (0..4).map(|i| slope[i / 2][i % 2].abs() * bound[i / 2][i % 2]).sum(),
            false => covariance(slope, slope, noise).max(0.0).sqrt() / self.size,
        };
        let noise = &place.shape.noise;
        let correlation = |[a, b]: [usize; 2]| {
            let [ab, aa, bb] = [[a, b], [a, a], [b, b]].map(|[a, b]| covariance(&slopes[a], &slopes[b], noise.slopes));
            if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
        };
        let slope_of = |slope: [[f64; 2]; 2]| Slope {
            sigma: sigma_of(&slope, noise.slopes, &bounds[0]),
            off: (0..4).map(|i| slope[i / 2][i % 2] * off[i / 2][i % 2]).sum::<f64>().powi(2),
            noise: sigma_of(&slope, noise.off, &bounds[1]).powi(2),
            n: 1.0,
        };
        Some((strain, slopes.map(slope_of), [[0, 1], [0, 2], [1, 2]].map(correlation)))
    }

    /// The gradient of the plane less that of the cubic; and upper bounds of the standard uncertainties of the former
    /// and of this difference.
    fn off<U: Length>(
        &self,
        field: &Measurement<U>,
        place: &Place,
        points: &[[f64; 2]],
        plane: &[[f64; 2]],
        gradient: [[f64; 2]; 2],
    ) -> ([[f64; 2]; 2], [[[f64; 2]; 2]; 2]) {
        let (mut off, mut bounds) = ([[0.0; 2]; 2], [[[0.0; 2]; 2]; 2]);
        let Some(&first) = place.nodes.first() else { return (off, bounds) };
        let (start, origin) = (field.displacement[first as usize], points[0]);
        for (at, &node) in place.nodes.iter().enumerate() {
            let (u, sigma) = (field.displacement[node as usize], field.sigma[node as usize]);
            let [x, y] = [0, 1].map(|k| points[at][k] - origin[k]);
            let flat = plane.get(at).copied().unwrap_or_default();
            let cubic = place.shape.cubic.get(at).copied().unwrap_or_default().map(|w| w / self.size);
            for c in 0..2 {
                // From the plane on: its own slope, which is the larger, does not go through the rounded cubic.
                let beside = u[c] - start[c] - gradient[c][0] * x - gradient[c][1] * y;
                for k in 0..2 {
                    off[c][k] -= cubic[k] * beside;
                    bounds[0][c][k] += flat[k].abs() * sigma[c];
                    bounds[1][c][k] += (cubic[k] - flat[k]).abs() * sigma[c];
                }
            }
        }
        (off, bounds)
    }

    /// Finds the windows of the nodes around which other nodes are measured than before: of all at first.
    fn prepare<U: Length>(&self, kept: &mut Kept, field: &Measurement<U>) {
        let (mesh, measured) = (&*field.mesh, &field.measured);
        let n = self.around.len();
        let mut marks = Marks::new(n, mesh.n_elements());
        let reach = self.window.rings() + if self.bound { GROWTH } else { MARGIN };
        let stale: Vec<usize> = match kept.measured.len() == n {
            false => (0..n).collect(),
            true => {
                let changed = (0..n).filter(|&node| kept.measured[node] != measured[node]);
                // One ring more: an element is in it or not by all of its nodes.
                let near =
                    self.patch(mesh, changed.map(|node| node as u32).collect(), [0, reach + 1], &|_| true, &mut marks);
                near.nodes.into_iter().map(|node| node as usize).collect()
            }
        };
        let whole = whole_elements(mesh, measured);
        kept.places.resize(n, Place::default());
        let least = self.least_nodes();
        for node in stale {
            kept.places[node] = Place::default();
            if !measured[node] {
                continue;
            }
            let rings = [self.window.rings(), reach];
            let patch = self.patch(mesh, vec![node as u32], rings, &|element| whole[element as usize], &mut marks);
            if patch.elements.is_empty() {
                continue;
            }
            let shape = self.shape(mesh, &patch, &marks, &mut kept.shapes);
            let window = patch.ends[0];
            let all = if window >= least { window.max(shape.cubic.len()) } else { 0 };
            kept.places[node] = Place { nodes: patch.nodes[..all].to_vec(), window, shape };
        }
        kept.measured.clone_from(measured);
    }

    /// The nodes and elements within rings around `start`; the first number of rings makes the window.
    fn patch<U: Length>(
        &self,
        mesh: &Mesh<U>,
        start: Vec<u32>,
        rings: [usize; 2],
        takes: &dyn Fn(u32) -> bool,
        marks: &mut Marks,
    ) -> Patch {
        marks.turn += 1;
        let turn = marks.turn;
        let mut patch = Patch { nodes: start, ..Patch::default() };
        for (at, &node) in patch.nodes.iter().enumerate() {
            marks.nodes[node as usize] = (turn, at as u32);
        }
        let mut ring = 0..patch.nodes.len();
        for done in 1..=rings[1] {
            for at in ring.clone() {
                for &element in &self.around[patch.nodes[at] as usize] {
                    if marks.elements[element as usize] == turn || !takes(element) {
                        continue;
                    }
                    marks.elements[element as usize] = turn;
                    patch.elements.push(element);
                    for node in mesh.elements()[element as usize] {
                        let mark = &mut marks.nodes[node as usize];
                        if mark.0 != turn {
                            *mark = (turn, patch.nodes.len() as u32);
                            patch.nodes.push(node);
                        }
                    }
                }
            }
            ring = ring.end..patch.nodes.len();
            if done >= rings[0] {
                patch.ends.push(patch.nodes.len());
            }
        }
        patch
    }

    /// What holds for the shape of a patch, rounded.
    fn shape<U: Length>(
        &self,
        mesh: &Mesh<U>,
        patch: &Patch,
        marks: &Marks,
        known: &mut HashMap<[u64; 2], Arc<Shape>>,
    ) -> Arc<Shape> {
        let [x0, y0] = mesh.nodes()[patch.nodes[0] as usize];
        let grains = |v: f64| (v / self.size / GRAIN).round() as i64;
        let places: Vec<[i64; 2]> = patch
            .nodes
            .iter()
            .map(|&node| mesh.nodes()[node as usize])
            .map(|[x, y]| [grains(x - x0), grains(y - y0)])
            .collect();
        let elements: Vec<[u32; 4]> = patch
            .elements
            .iter()
            .map(|&element| mesh.elements()[element as usize].map(|node| marks.nodes[node as usize].1))
            .collect();
        let key = [0u8, 1].map(|salt| {
            let mut hasher = DefaultHasher::new();
            (salt, &patch.ends, &places, &elements).hash(&mut hasher);
            hasher.finish()
        });
        let make = || {
            let places: Vec<[f64; 2]> = places.iter().map(|p| p.map(|v| v as f64 * GRAIN)).collect();
            // Of a regularised field or of splines nodes are no coefficients of a projection.
            let cubic = cubic(&places, &patch.ends[..=GROWTH], if self.bound { 0.0 } else { OVERSHOOT });
            let flat = plane(&places[..patch.ends[0]]).unwrap_or_default();
            let off = cubic.iter().enumerate().map(|(at, w)| {
                let flat = flat.get(at).copied().unwrap_or_default();
                [w[0] - flat[0], w[1] - flat[1]]
            });
            let (node, [slopes, off]) = match self.bound {
                true => (1.0, [[0.0; 3]; 2]),
                false => noise_of(&places, &elements, [&flat, &off.collect::<Vec<_>>()]),
            };
            Arc::new(Shape { noise: Noise { node, slopes, off }, cubic })
        };
        known.entry(key).or_insert_with(make).clone()
    }
}
