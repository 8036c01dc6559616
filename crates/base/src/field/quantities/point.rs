//! Displacement and strain at points and along lines.

use super::{NodalNoise, QuantityError, Reading, Value, finite, positive};
use crate::field::strain::slopes_of_rotation;
use crate::field::strain_field::StrainElement;
use crate::field::{Invariant, Measurement, StrainDefinition, TensorStrain, WindowStrains, rotation_deg};
use crate::mesh::{Mesh, shape_functions};
use crate::plane::distance;
use crate::units::Length;

/// The most points of a line.
const MOST_POINTS: usize = 100_000;

/// What a field says at one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointValues {
    /// Displacement, in the unit of the field.
    pub displacement: [f64; 2],
    /// Its standard uncertainty.
    pub sigma: [f64; 2],
    /// What it may be off beyond noise ([`ModelError`](crate::field::ModelError)); `None` where it is not known.
    pub model_error: Option<[f64; 2]>,
    /// Length of the displacement.
    pub magnitude: Value,
    /// The strain, and the standard uncertainty of exx, eyy and exy; `None` where no element with all nodes
    /// measured lies around a corner of the point's element, or where the field folds.
    pub strain: Option<(TensorStrain, [f64; 3])>,
    /// Its invariants, in the order of [`Invariant::ALL`]. Where the principal strains differ by less than
    /// noise, `e1` is too large and `e2` too small by about as much.
    pub invariants: Option<[Value; 5]>,
    /// Rotation, degrees from x towards y; there where a strain is.
    pub rotation_deg: Option<Value>,
    /// `exx + eyy`; there where a strain is.
    pub sum: Option<Value>,
    /// The same as `strain` over a window of nodes, interpolated between those of the element (its standard uncertainty
    /// as well: windows of neighbours share most of their noise); `None` where it is not known at one of them, or not
    /// asked for.
    pub window: Option<(TensorStrain, [f64; 3])>,
    /// What exx, eyy and exy over the window may be off beyond noise, interpolated likewise (THEORY 20).
    pub window_model_error: Option<[f64; 3]>,
    /// The invariants of the strain over the window.
    pub window_invariants: Option<[Value; 5]>,
}

impl PointValues {
    /// The same with the strain over a window of nodes, at the place `at` of the mesh.
    pub(super) fn with_window<U: Length>(self, mesh: &Mesh<U>, at: [f64; 2], strains: &WindowStrains) -> Self {
        let mut correlations = [0.0; 3];
        let mut mean = || {
            let (mut strain, mut sigma, mut model) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            for (node, weight) in shape_at(mesh, at)?.into_iter().filter(|(_, weight)| *weight != 0.0) {
                let (of_node, noise) = strains.nodes[node]?;
                let off = strains.model_error.as_ref().map_or([0.0; 3], |errors| errors[node]);
                let together = strains.correlations.as_ref().map_or([0.0; 3], |of_nodes| of_nodes[node]);
                (0..3).for_each(|c| correlations[c] += weight * together[c]);
                for (c, e) in of_node.components().into_iter().enumerate() {
                    strain[c] += weight * e;
                    sigma[c] += weight * noise[c];
                    model[c] += weight * off[c];
                }
            }
            Some(((TensorStrain::of_components(strain), sigma), model))
        };
        let (window, model) = mean().unzip();
        let invariants = window.map(|(strain, sigma)| {
            Invariant::ALL.map(|which| {
                let by = strain.slopes_of(which);
                let [x, y, xy] = [0, 1, 2].map(|c| by[c] * sigma[c]);
                let [with_y, with_xy, y_with_xy] = correlations;
                let square = x * x + y * y + xy * xy + 2.0 * (with_y * x * y + with_xy * x * xy + y_with_xy * y * xy);
                // Where nothing is known of how they go together, the sum is a bound.
                let sigma = match strains.correlations {
                    Some(_) => square.max(0.0).sqrt(),
                    None => x.abs() + y.abs() + xy.abs(),
                };
                Value { value: strain.invariant(which), sigma }
            })
        });
        let window_model_error = model.filter(|_| strains.model_error.is_some());
        Self { window, window_model_error, window_invariants: invariants, ..self }
    }
}

/// The field at `at` (reference coordinates); `None` outside the mesh and where a node of the element is not measured.
///
/// The displacement is the value there ([`PointFilter`](crate::field::PointFilter)), not the bilinear field of the
/// coefficients, unless `noise` says that they stand for themselves ([`NodalNoise`]). The strain is made of the
/// gradients at the corners of the element ([`StrainField`](crate::field::StrainField) says how), carried to the point
/// by the shape functions: continuous along a line, over a length of twice the element size.
///
/// ```
/// # use quadrille_base as quadrille;
/// # use quadrille::{field::{Measurement, NodalNoise, Status, StrainDefinition, at_point}, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 32.0, y1: 32.0 };
/// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 64, 64).unwrap();
/// # let displacement: Vec<_> = mesh.nodes().iter().map(|x| [0.01 * x[0], 0.0]).collect();
/// # let field = Measurement { status: Status::Converged, sigma: vec![[0.01; 2]; 9], measured: vec![true; 9],
/// #     element_residual: vec![1.0; 4], model_error: None, marks: None, points: None, mesh: mesh.into(), displacement };
/// let noise = NodalNoise::new(&field.mesh, &field.measured);
/// let there = at_point(&field, &noise, StrainDefinition::Infinitesimal, [10.0, 7.0]).unwrap();
/// assert!((there.displacement[0] - 0.1).abs() < 1e-12 && there.sigma[0] < 0.01);
/// assert!((there.strain.unwrap().0.xx - 0.01).abs() < 1e-12);
/// assert!(at_point(&field, &noise, StrainDefinition::Infinitesimal, [40.0, 7.0]).is_none());
/// ```
pub fn at_point<U: Length>(
    field: &Measurement<U>,
    noise: &NodalNoise,
    definition: StrainDefinition,
    at: [f64; 2],
) -> Option<PointValues> {
    let mesh = &field.mesh;
    let weights = shape_at(mesh, at)?;
    let value = noise.at(mesh, &weights);
    let [x, y] = [0, 1].map(|c| {
        let along = |w: f64| if c == 0 { [w, 0.0] } else { [0.0, w] };
        Reading::new(value.iter().map(|&(node, w)| (node, along(w)))).read(field, noise)
    });
    let (x, y) = (x?, y?);
    let (displacement, sigma) = ([x.value, y.value], [x.sigma, y.sigma]);
    // Of no displacement the direction does not matter.
    let length = x.value.hypot(y.value);
    let [c, s] = if length > 0.0 { displacement.map(|u| u / length) } else { [1.0, 0.0] };
    let along = Reading::new(value.iter().map(|&(node, w)| (node, [c * w, s * w])));
    let magnitude = Value { value: length, sigma: noise.sigma(along.weights(), &field.sigma) };
    let by = gradient_weights(mesh, noise, &weights);
    let there = by.and_then(|by| strain_of(field, noise, definition, &by));
    let model_error = model_error_at(field, noise, at, &weights);
    Some(PointValues {
        displacement,
        sigma,
        model_error,
        magnitude,
        strain: there.map(|there| (there.strain, there.sigma)),
        invariants: there.map(|there| there.invariants),
        rotation_deg: there.map(|there| there.rotation_deg),
        sum: there.map(|there| there.sum),
        window: None,
        window_model_error: None,
        window_invariants: None,
    })
}

/// What the displacement at a point may be off beyond noise: what its element does not follow, and where it is read from
/// coefficients what these are off. Values at points are without what coefficients overshoot (THEORY 17).
pub(super) fn model_error_at<U: Length>(
    field: &Measurement<U>,
    noise: &NodalNoise,
    [x, y]: [f64; 2],
    weights: &[(usize, f64); 4],
) -> Option<[f64; 2]> {
    let error = field.model_error.as_ref()?;
    let misfit = error.misfit[field.mesh.find(x, y)?.0];
    let of_nodes = |c: usize| weights.iter().map(|&(node, weight)| weight * error.nodes[node][c].powi(2)).sum::<f64>();
    Some([0, 1].map(|c| if noise.reads_coefficients() { (of_nodes(c) + misfit * misfit).sqrt() } else { misfit }))
}

/// The nodes of the element that holds a point, with their weights there.
pub(super) fn shape_at<U: Length>(mesh: &Mesh<U>, [x, y]: [f64; 2]) -> Option<[(usize, f64); 4]> {
    let (element, xi, eta) = mesh.find(x, y)?;
    let psi = shape_functions(xi, eta);
    let nodes = mesh.elements()[element];
    Some([0, 1, 2, 3].map(|k| (nodes[k] as usize, psi[k])))
}

/// `du/dx` and `du/dy` at a point as sums over nodes: the gradients at the corners of its element, each the mean over
/// the measured elements around weighted by their areas, times the weights of the corners.
pub(super) fn gradient_weights<U: Length>(
    mesh: &Mesh<U>,
    noise: &NodalNoise,
    weights: &[(usize, f64)],
) -> Option<Vec<(usize, [f64; 2])>> {
    let mut sum = Vec::new();
    for &(node, weight) in weights.iter().filter(|(_, weight)| *weight != 0.0) {
        let mut by_corner = Vec::new();
        let mut area = 0.0;
        for element in noise.around(node) {
            let geometry = StrainElement::new(mesh, element);
            let Some((_, at)) = geometry.corners().find(|&(corner, _)| geometry.nodes[corner] == node) else {
                continue;
            };
            let Some(by) = geometry.gradients(at) else { continue };
            area += geometry.area;
            by_corner.extend((0..4).map(|i| (geometry.nodes[i], by[i].map(|d| geometry.area * d))));
        }
        if area == 0.0 {
            return None;
        }
        sum.extend(by_corner.into_iter().map(|(node, d)| (node, d.map(|d| weight * d / area))));
    }
    Some(sum)
}

/// What follows from a displacement gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct OfGradient {
    pub strain: TensorStrain,
    /// Of exx, eyy, exy.
    pub sigma: [f64; 3],
    pub invariants: [Value; 5],
    pub rotation_deg: Value,
    /// `exx + eyy`.
    pub sum: Value,
}

/// The strain of the gradient with these weights, and its invariants with the rotation; uncertainties to first order.
pub(super) fn strain_of<U: Length>(
    field: &Measurement<U>,
    noise: &NodalNoise,
    definition: StrainDefinition,
    by: &[(usize, [f64; 2])],
) -> Option<OfGradient> {
    let gradient = field.gradient(by.iter().copied());
    let strain = definition.of_gradient(gradient)?;
    let slopes = definition.slopes(gradient)?;
    let sigma_of = |slope: [[f64; 2]; 2]| {
        let weights = by.iter().map(|&(node, d)| (node, [0, 1].map(|c| slope[c][0] * d[0] + slope[c][1] * d[1])));
        noise.sigma(Reading::new(weights).weights(), &field.sigma)
    };
    let invariant = |which: Invariant| {
        let by_strain = strain.slopes_of(which);
        let by_gradient = [0, 1].map(|c| [0, 1].map(|k| (0..3).map(|e| by_strain[e] * slopes[e][c][k]).sum::<f64>()));
        Value { value: strain.invariant(which), sigma: sigma_of(by_gradient) }
    };
    let rotation = Value { value: rotation_deg(gradient), sigma: sigma_of(slopes_of_rotation(gradient)) };
    let [of_exx, of_eyy, _] = slopes;
    let both = [0, 1].map(|c| [0, 1].map(|k| of_exx[c][k] + of_eyy[c][k]));
    Some(OfGradient {
        strain,
        sigma: slopes.map(sigma_of),
        invariants: Invariant::ALL.map(invariant),
        rotation_deg: rotation,
        sum: Value { value: strain.xx + strain.yy, sigma: sigma_of(both) },
    })
}

/// A straight line with points at equal distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    from: [f64; 2],
    to: [f64; 2],
    step: f64,
}

impl Segment {
    /// From one point to another, a point every `step`, the first one at `from`.
    ///
    /// # Errors
    /// A number that is not finite, a step that is not positive, ends that coincide, more than 100 000 points.
    pub fn new(from: [f64; 2], to: [f64; 2], step: f64) -> Result<Self, QuantityError> {
        finite("a coordinate of a line", &[from[0], from[1], to[0], to[1]])?;
        positive("the step of a line", step)?;
        let segment = Self { from, to, step };
        let length = segment.length();
        if length == 0.0 {
            return Err(QuantityError::NoLength { what: "a line", x: from[0], y: from[1] });
        }
        if length / step >= MOST_POINTS as f64 {
            return Err(QuantityError::TooManyPoints { length_px: length, step_px: step, limit: MOST_POINTS });
        }
        Ok(segment)
    }

    /// Its length.
    pub fn length(&self) -> f64 {
        distance(self.to, self.from)
    }

    /// Distance from the start, and position, of each point.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::Segment;
    /// let points = Segment::new([0.0, 5.0], [10.0, 5.0], 4.0).unwrap().points();
    /// assert_eq!(points, [(0.0, [0.0, 5.0]), (4.0, [4.0, 5.0]), (8.0, [8.0, 5.0])]);
    /// ```
    pub fn points(&self) -> Vec<(f64, [f64; 2])> {
        let length = self.length();
        // The end counts when it is missed by rounding only.
        let n = (length / self.step * (1.0 + 1e-12)).floor() as usize;
        let at = |k: usize| {
            let s = k as f64 * self.step;
            let share = (s / length).min(1.0);
            (s, [0, 1].map(|c| self.from[c] + share * (self.to[c] - self.from[c])))
        };
        (0..=n).map(at).collect()
    }
}
