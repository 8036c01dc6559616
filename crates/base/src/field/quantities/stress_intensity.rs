//! Stress intensity factors by the interaction integral in its domain form, plane stress (docs/correlation.md, 2.12).

use super::{NodalNoise, Reading, Value};
use crate::field::Measurement;
use crate::mesh::{FacePoint, Mesh, project};
use crate::plane::{self, dot, minus};
use crate::units::Length;
use std::collections::HashSet;
use std::f64::consts::PI;

/// Elastic constants of the specimen around a crack, and its scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elasticity {
    /// Young's modulus, MPa.
    pub young_mpa: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Millimetres per unit of length of the field.
    pub mm_per_unit: f64,
    /// Outer radius of the domain, in the unit of the field; the largest that fits, up to twelve elements, without.
    pub radius: Option<f64>,
}

/// Stress intensity at a tip, MPa sqrt(m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StressIntensity {
    /// Opening mode.
    pub k1: Value,
    /// Sliding mode, of the sign of the sliding behind the tip.
    pub k2: Value,
    /// Outer radius of the domain, in the unit of the field.
    pub radius: f64,
}

/// The largest outer radius that is taken by itself, in elements.
const LARGEST: f64 = 12.0;
/// The smallest outer radius, in elements: between it and the inner one there are two elements.
const SMALLEST: f64 = 4.0;
/// The inner radius, of the outer one, at least [`NEAREST`] elements: those near the tip miss the singular field.
const INNER: f64 = 0.4;
const NEAREST: f64 = 2.0;
/// Points per direction of an element that the integral is summed over.
const POINTS: usize = 8;
/// Cosine of the bend of the path, 5 degrees, that ends the straight piece behind a tip.
const STRAIGHT: f64 = 0.9962;

/// Strain (11, 22, 12) and `du_i/dx_1` of a field, linear in what makes it.
#[derive(Clone, Copy)]
struct Local {
    strain: [f64; 3],
    slope: [f64; 2],
}

impl Local {
    /// From `du_i/dx_j`.
    fn of(gradient: [[f64; 2]; 2]) -> Self {
        let shear = 0.5 * (gradient[0][1] + gradient[1][0]);
        Self { strain: [gradient[0][0], gradient[1][1], shear], slope: [gradient[0][0], gradient[1][0]] }
    }

    /// Stress (11, 22, 12) in plane stress for E = 1.
    fn stress(&self, poisson: f64) -> [f64; 3] {
        let [e11, e22, e12] = self.strain;
        let c = 1.0 / (1.0 - poisson * poisson);
        [c * (e11 + poisson * e22), c * (e22 + poisson * e11), e12 / (1.0 + poisson)]
    }
}

/// `du_i/dx_j` of the singular field of mode 1 or 2, K = 1 and E = 1, in plane stress, at polar coordinates of the tip.
fn williams(mode: usize, poisson: f64, r: f64, theta: f64) -> [[f64; 2]; 2] {
    let kappa = (3.0 - poisson) / (1.0 + poisson);
    let shear = 0.5 / (1.0 + poisson);
    let scale = 1.0 / (2.0 * shear) / (2.0 * PI).sqrt();
    let (s, c) = (0.5 * theta).sin_cos();
    let (sin, cos) = theta.sin_cos();
    // u_i = scale sqrt(r) g_i(theta)
    let (g, d) = match mode {
        1 => (
            [c * (kappa - cos), s * (kappa - cos)],
            [-0.5 * s * (kappa - cos) + c * sin, 0.5 * c * (kappa - cos) + s * sin],
        ),
        _ => (
            [s * (kappa + 2.0 + cos), -c * (kappa - 2.0 + cos)],
            [0.5 * c * (kappa + 2.0 + cos) - s * sin, 0.5 * s * (kappa - 2.0 + cos) + c * sin],
        ),
    };
    [0, 1].map(|i| {
        let (radial, around) = (0.5 * g[i], d[i]);
        [radial * cos - around * sin, radial * sin + around * cos].map(|v| scale * v / r.sqrt())
    })
}

/// The stress intensity of `field` at a tip `at`, with the unit vector `ahead` out of the crack.
///
/// With a weight `q` that falls from 1 at the inner to 0 at the outer radius, and the singular field of K = 1 of each
/// mode beside the measured one, `K = E/2 I`, `I = sum over elements of (s u' + s' u - s' e delta) grad q`. It is
/// linear in the nodal displacements, so that its standard uncertainty follows from theirs. Faces are taken for
/// straight and free of traction within the radius, the material for elastic and even. `None` when less than four
/// elements fit between the tip and the next border, bend or node that is not measured.
pub(super) fn stress_intensity<U: Length>(
    field: &Measurement<U>,
    noise: &NodalNoise,
    elasticity: &Elasticity,
    path: &[[f64; 2]],
    faces: &[FacePoint],
    at: [f64; 2],
    ahead: [f64; 2],
) -> Option<StressIntensity> {
    let mesh = &*field.mesh;
    let size = mesh.element_size();
    let fits = free_radius(field, path, faces, at, ahead).min(LARGEST * size);
    let outer = elasticity.radius.unwrap_or(fits);
    if outer < SMALLEST * size {
        return None;
    }
    let inner = (INNER * outer).max(NEAREST * size);
    let frame = Frame { at, ahead, across: [ahead[1], -ahead[0]], inner, outer };
    let weights = frame.weights(mesh, elasticity.poisson);
    // MPa sqrt(mm) / sqrt(1000) = MPa sqrt(m)
    let scale = 0.5 * elasticity.young_mpa * (elasticity.mm_per_unit / 1000.0).sqrt();
    let [k1, k2] = weights.map(|weights| {
        let scaled = weights.into_iter().map(|(node, w)| (node, w.map(|v| scale * v)));
        Reading::new(scaled).read(field, noise)
    });
    Some(StressIntensity { k1: k1?, k2: k2?, radius: outer })
}

/// Distance from a tip to a border that is no face of the crack, a bend of the path, or nodes not measured.
fn free_radius<U: Length>(
    field: &Measurement<U>,
    path: &[[f64; 2]],
    faces: &[FacePoint],
    at: [f64; 2],
    ahead: [f64; 2],
) -> f64 {
    let mesh = &*field.mesh;
    let distance = |p: [f64; 2]| plane::distance(p, at);
    let own: HashSet<usize> = faces.iter().flat_map(|point| [point.plus, point.minus]).collect();
    let borders = (0..mesh.zones().len()).flat_map(|zone| mesh.boundary(zone));
    // An edge of a face has at least one doubled node; the other may be that of a tip.
    let others = borders.filter(|edge| !edge.iter().any(|&node| own.contains(&(node as usize))));
    let border = others.flatten().map(|node| distance(mesh.nodes()[node as usize])).fold(f64::INFINITY, f64::min);
    let missing = (0..mesh.n_nodes()).filter(|&node| !field.measured[node]);
    let missing = missing.map(|node| distance(mesh.nodes()[node])).fold(f64::INFINITY, f64::min);
    let mut bend = f64::INFINITY;
    let here = project(path, at).map_or(0.0, |found| found.along);
    let mut along = 0.0;
    for two in path.windows(2) {
        let length = plane::distance(two[1], two[0]);
        let cosine = dot(minus(two[1], two[0]), ahead).abs() / length.max(f64::MIN_POSITIVE);
        if length > 0.0 && cosine < STRAIGHT {
            bend = bend.min((along - here).max(here - along - length).max(0.0));
        }
        along += length;
    }
    // The other end may lie inside: a tip as well.
    let forwards = project(path, at).is_none_or(|found| dot(found.tangent, ahead) > 0.0);
    let behind = if forwards { here } else { along - here };
    border.min(missing).min(bend).min(behind)
}

/// A tip with its axes: 1 ahead, 2 across, towards the side `+` of a path that ends here; and its ring.
struct Frame {
    at: [f64; 2],
    ahead: [f64; 2],
    across: [f64; 2],
    inner: f64,
    outer: f64,
}

impl Frame {
    /// What each node gives to `I` of both modes, for E = 1.
    fn weights<U: Length>(&self, mesh: &Mesh<U>, poisson: f64) -> [Vec<(usize, [f64; 2])>; 2] {
        let mut weights = [Vec::new(), Vec::new()];
        let step = 1.0 / POINTS as f64;
        for (element, nodes) in mesh.elements().iter().enumerate() {
            let corners = mesh.corners(element);
            let r = corners.map(|p| plane::distance(p, self.at));
            let size = (0..4).map(|k| plane::distance(corners[k], corners[(k + 2) % 4])).fold(0.0, f64::max);
            if r.iter().all(|&r| r > self.outer + size) || r.iter().all(|&r| r < self.inner) {
                continue;
            }
            let geometry = mesh.geometry(element);
            let mut own = [[[0.0; 2]; 4]; 2];
            for k in 0..POINTS * POINTS {
                let local = [(k % POINTS) as f64 + 0.5, (k / POINTS) as f64 + 0.5].map(|v| v * step);
                let way = minus(geometry.place(local), self.at);
                let x = [dot(way, self.ahead), dot(way, self.across)];
                let r = x[0].hypot(x[1]);
                if r <= self.inner || r >= self.outer {
                    continue;
                }
                let fall = -1.0 / (self.outer - self.inner);
                let slope = x.map(|v| fall * v / r);
                let map = geometry.map_at(local);
                let (gradients, area) = (map.gradients(), map.determinant.abs());
                for (mode, own) in own.iter_mut().enumerate() {
                    let auxiliary = Local::of(williams(mode + 1, poisson, r, x[1].atan2(x[0])));
                    for (node, gradient) in gradients.iter().enumerate() {
                        let gradient = [dot(*gradient, self.ahead), dot(*gradient, self.across)];
                        for c in 0..2 {
                            let mut of_node = [[0.0; 2]; 2];
                            of_node[c] = gradient;
                            let share = interaction(&Local::of(of_node), &auxiliary, poisson, slope);
                            own[node][c] += share * area * step * step;
                        }
                    }
                }
            }
            for (mode, own) in own.iter().enumerate() {
                for (&node, w) in nodes.iter().zip(own) {
                    let global = [0, 1].map(|c| w[0] * self.ahead[c] + w[1] * self.across[c]);
                    weights[mode].push((node as usize, global));
                }
            }
        }
        weights
    }
}

/// `(s u' + s' u - s' e delta) grad q` at a point.
fn interaction(field: &Local, auxiliary: &Local, poisson: f64, slope: [f64; 2]) -> f64 {
    let (s, t) = (field.stress(poisson), auxiliary.stress(poisson));
    let [e11, e22, e12] = field.strain;
    let energy = t[0] * e11 + t[1] * e22 + 2.0 * t[2] * e12;
    let flow = |s: [f64; 3], u: [f64; 2]| [s[0] * u[0] + s[2] * u[1], s[2] * u[0] + s[1] * u[1]];
    let (a, b) = (flow(s, auxiliary.slope), flow(t, field.slope));
    (a[0] + b[0] - energy) * slope[0] + (a[1] + b[1]) * slope[1]
}
