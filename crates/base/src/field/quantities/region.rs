//! Means, spread and extremes over a part of the specimen.

use super::point::{PointValues, gradient_weights, model_error_at, shape_at, strain_of};
use super::{NodalNoise, QuantityError, Reading, Value, finite};
use crate::field::{Measurement, StrainDefinition};
use crate::mesh::Mesh;
use crate::plane::Point;
use crate::units::Length;
use std::collections::BTreeMap;

/// Places along a side of an element at which the field is looked at.
const SAMPLES: f64 = 4.0;
/// The most places of a region: of a larger one they are further apart.
const MOST_PLACES: f64 = 20_000.0;

/// A part of the specimen.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    outline: Outline,
}

#[derive(Debug, Clone, PartialEq)]
enum Outline {
    Corners(Vec<Point>),
    Zone(usize),
}

/// What a field says of a region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionValues {
    /// Mean place of what is measured of it.
    pub at: Point,
    /// Share of it that is measured, 0 to 1; all else is of this share.
    pub measured: f64,
    /// Mean displacement, and the strain of the mean gradient, with their uncertainty. The strain is that of the region
    /// as a whole: the mean of local strains holds the square of their noise. Of the model error the mean size.
    pub mean: PointValues,
    /// Standard deviation over the region of `ux`, `uy`: motion, deformation and noise together.
    pub spread: [f64; 2],
    /// Standard deviation, least and largest over the region of exx, eyy, exy of local strains (as at points, over twice
    /// the element size), noise included; `None` where there is no strain.
    pub strain: Option<[Spread; 3]>,
}

/// How a quantity varies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// Standard deviation.
    pub deviation: f64,
    /// Least.
    pub least: f64,
    /// Largest.
    pub largest: f64,
}

impl Region {
    /// Within these corners, in order.
    ///
    /// # Errors
    /// Numbers that are not finite, fewer than three corners, no area.
    pub fn within(corners: Vec<Point>) -> Result<Self, QuantityError> {
        finite("a coordinate of a region", &corners.concat())?;
        let twice: f64 = pairs(&corners).map(|([a, b], [c, d])| a * d - c * b).sum();
        match corners.len() < 3 || twice == 0.0 {
            true => Err(QuantityError::NoArea),
            false => Ok(Self { outline: Outline::Corners(corners) }),
        }
    }

    /// A zone, by its number in the mesh.
    pub fn of_zone(zone: usize) -> Self {
        Self { outline: Outline::Zone(zone) }
    }

    /// Reads it; `None` where none of it is measured.
    pub fn read<U: Length>(
        &self,
        field: &Measurement<U>,
        noise: &NodalNoise,
        definition: StrainDefinition,
    ) -> Option<RegionValues> {
        let mesh = &field.mesh;
        let places = self.places(mesh);
        let n_nodes = mesh.n_nodes();
        let (mut mean, mut of_nodes) = (vec![0.0; n_nodes], BTreeMap::new());
        let (mut displacements, mut strains, mut has_strain) = (Vec::new(), Vec::new(), true);
        let (mut at, mut model) = ([0.0; 2], Some([0.0; 2]));
        for &place in &places {
            let Some(shape) = shape_at(mesh, place).filter(|shape| shape.iter().all(|(node, _)| field.measured[*node]))
            else {
                continue;
            };
            let mut u = [0.0; 2];
            for (node, w) in noise.at(mesh, &shape) {
                mean[node] += w;
                (0..2).for_each(|c| u[c] += w * field.displacement[node][c]);
            }
            displacements.push(u);
            (0..2).for_each(|c| at[c] += place[c]);
            model =
                model.zip(model_error_at(field, noise, place, &shape)).map(|(sum, m)| [sum[0] + m[0], sum[1] + m[1]]);
            let mut gradient = Some([[0.0; 2]; 2]);
            for &(node, weight) in shape.iter().filter(|(_, weight)| *weight != 0.0) {
                let made = || NodeGradient::of(field, noise, node);
                let of_node = of_nodes.entry(node).or_insert_with(made);
                gradient = gradient.zip(of_node.as_mut()).map(|(sum, of_node)| {
                    of_node.weight += weight;
                    [0, 1].map(|c| [0, 1].map(|k| sum[c][k] + weight * of_node.gradient[c][k]))
                });
            }
            let local = gradient.and_then(|gradient| definition.of_gradient(gradient));
            has_strain &= local.is_some();
            strains.extend(local.map(|strain| strain.components()));
        }
        let n = displacements.len() as f64;
        if displacements.is_empty() {
            return None;
        }
        let sum = |along: Point| {
            let weights = mean.iter().enumerate().map(|(node, w)| (node, along.map(|d| d * w / n)));
            Reading::new(weights).read(field, noise)
        };
        let (x, y) = (sum([1.0, 0.0])?, sum([0.0, 1.0])?);
        let length = x.value.hypot(y.value);
        let along = if length > 0.0 { [x.value / length, y.value / length] } else { [1.0, 0.0] };
        let magnitude = Value { value: length, sigma: sum(along)?.sigma };
        let by = of_nodes
            .values()
            .flatten()
            .flat_map(|of_node| of_node.by.iter().map(|(node, d)| (*node, d.map(|d| of_node.weight * d / n))));
        let by = Reading::new(by);
        let whole = if has_strain { strain_of(field, noise, definition, by.weights()) } else { None };
        let over = |values: &mut dyn Iterator<Item = f64>| Spread::of(&values.collect::<Vec<f64>>());
        Some(RegionValues {
            at: at.map(|v| v / n),
            measured: n / places.len() as f64,
            mean: PointValues {
                displacement: [x.value, y.value],
                sigma: [x.sigma, y.sigma],
                model_error: model.map(|sum| sum.map(|v| v / n)),
                magnitude,
                strain: whole.map(|whole| (whole.strain, whole.sigma)),
                invariants: whole.map(|whole| whole.invariants),
                rotation_deg: whole.map(|whole| whole.rotation_deg),
                sum: whole.map(|whole| whole.sum),
                window: None,
                window_model_error: None,
                window_invariants: None,
            },
            spread: [0, 1].map(|c| over(&mut displacements.iter().map(|u| u[c])).deviation),
            strain: has_strain.then(|| [0, 1, 2].map(|c| over(&mut strains.iter().map(|strain| strain[c])))),
        })
    }

    /// Places on a lattice in it.
    fn places<U: Length>(&self, mesh: &Mesh<U>) -> Vec<Point> {
        let ([x0, y0, x1, y1], is_inside): ([f64; 4], Box<dyn Fn(Point) -> bool>) = match &self.outline {
            Outline::Corners(corners) => {
                let bound = |c: usize, by: fn(f64, f64) -> f64| corners.iter().map(|p| p[c]).reduce(by).unwrap_or(0.0);
                let [x, y] = [0, 1].map(|c| [bound(c, f64::min), bound(c, f64::max)]);
                ([x[0], y[0], x[1], y[1]], Box::new(|at| is_within(corners, at)))
            }
            &Outline::Zone(zone) => {
                let bounds = mesh.bounds(zone);
                let of_zone =
                    move |[x, y]: Point| mesh.find(x, y).is_some_and(|at| mesh.zone_elements(zone).contains(&at.0));
                ([bounds.x0, bounds.y0, bounds.x1, bounds.y1], Box::new(of_zone))
            }
        };
        let step = (mesh.element_size() / SAMPLES).max(((x1 - x0) * (y1 - y0) / MOST_PLACES).sqrt());
        let along = |a: f64, b: f64| {
            let n = ((b - a) / step).ceil().max(1.0);
            (0..n as usize).map(move |k| a + (b - a) * (k as f64 + 0.5) / n)
        };
        let all = along(y0, y1).flat_map(|y| along(x0, x1).map(move |x| [x, y]));
        all.filter(|&at| is_inside(at)).collect()
    }
}

/// The gradient at a node: as a sum over nodes, in the field, and how much of it a region holds.
struct NodeGradient {
    by: Vec<(usize, Point)>,
    gradient: [Point; 2],
    weight: f64,
}

impl NodeGradient {
    fn of<U: Length>(field: &Measurement<U>, noise: &NodalNoise, node: usize) -> Option<Self> {
        let by = gradient_weights(&field.mesh, noise, &[(node, 1.0)])?;
        Some(Self { gradient: field.gradient(by.iter().copied()), by, weight: 0.0 })
    }
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        Self {
            deviation: (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt(),
            least: values.iter().copied().fold(f64::INFINITY, f64::min),
            largest: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

fn pairs(corners: &[Point]) -> impl Iterator<Item = (Point, Point)> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Whether a place lies within corners: a ray to the left crosses an odd number of sides.
fn is_within(corners: &[Point], [x, y]: Point) -> bool {
    let crosses = |([a, b], [c, d]): (Point, Point)| (b > y) != (d > y) && x < a + (y - b) * (c - a) / (d - b);
    pairs(corners).filter(|&side| crosses(side)).count() % 2 == 1
}
