//! Virtual extensometers.

use super::point::shape_at;
use super::{NodalNoise, QuantityError, Reading, Value, finite};
use crate::field::Measurement;
use crate::mesh::Mesh;
use crate::plane::{distance, minus};
use crate::units::Length;

/// Samples of a gauge line per element size: the field between them is as good as straight.
const SAMPLES: f64 = 4.0;

/// Two points, or two gauge lines across the line that joins them, whose distance is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extensometer {
    from: [f64; 2],
    to: [f64; 2],
    width: f64,
}

/// What an extensometer reads in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elongation {
    /// Distance in the reference, in the unit of the field.
    pub reference_length: f64,
    /// Distance now less distance in the reference.
    pub elongation: Value,
    /// Engineering strain: elongation over the distance in the reference.
    pub engineering: Value,
    /// True strain: logarithm of the ratio of the distances.
    pub logarithmic: Value,
}

impl Extensometer {
    /// Between two points; with a `width`, displacements are averaged over gauge lines of that length, across
    /// the extensometer and centred on its points.
    ///
    /// # Errors
    /// A number that is not finite, a negative width, points that coincide.
    pub fn new(from: [f64; 2], to: [f64; 2], width: f64) -> Result<Self, QuantityError> {
        finite("a coordinate of an extensometer", &[from[0], from[1], to[0], to[1]])?;
        if !width.is_finite() || width < 0.0 {
            return Err(QuantityError::Number { what: "the width of an extensometer", value: width, positive: true });
        }
        if from == to {
            return Err(QuantityError::NoLength { what: "an extensometer", x: from[0], y: from[1] });
        }
        Ok(Self { from, to, width })
    }

    /// Its ends.
    pub fn ends(&self) -> [[f64; 2]; 2] {
        [self.from, self.to]
    }

    /// Length of its gauge lines; 0 for points.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// Reads it; `None` when a point lies outside the mesh or on a node without measurement, or the ends meet.
    ///
    /// The mean over a gauge line is a sum over nodes like any other: its standard uncertainty contains the
    /// correlation of neighbouring nodes. That of the distance is to first order.
    pub fn read<U: Length>(&self, field: &Measurement<U>, noise: &NodalNoise) -> Option<Elongation> {
        let (along, reference_length) = (minus(self.to, self.from), distance(self.to, self.from));
        let [start, end] = [self.gauge(&field.mesh, noise, self.from)?, self.gauge(&field.mesh, noise, self.to)?];
        let difference = |direction: [f64; 2]| {
            let signed = |gauge: &[(usize, f64)], sign: f64| -> Vec<_> {
                gauge.iter().map(|&(node, w)| (node, direction.map(|d| sign * w * d))).collect()
            };
            Reading::new(signed(&end, 1.0).into_iter().chain(signed(&start, -1.0)))
        };
        let u = [difference([1.0, 0.0]).value(field)?, difference([0.0, 1.0]).value(field)?];
        let now = [along[0] + u[0], along[1] + u[1]];
        let length = now[0].hypot(now[1]);
        // (|L + u|^2 - |L|^2)/(|L + u| + |L|): without the cancellation of the difference of two lengths.
        let elongation = (u[0] * (along[0] + now[0]) + u[1] * (along[1] + now[1])) / (length + reference_length);
        let sigma = difference(now.map(|v| v / length)).read(field, noise)?.sigma;
        let logarithmic = (elongation / reference_length).ln_1p();
        if length == 0.0 || !logarithmic.is_finite() {
            return None;
        }
        Some(Elongation {
            reference_length,
            elongation: Value { value: elongation, sigma },
            engineering: Value { value: elongation / reference_length, sigma: sigma / reference_length },
            logarithmic: Value { value: logarithmic, sigma: sigma / length },
        })
    }

    /// Where it is read: the places on both gauge lines.
    pub(super) fn places<U: Length>(&self, mesh: &Mesh<U>) -> Vec<[f64; 2]> {
        [self.from, self.to].into_iter().flat_map(|centre| self.line(mesh, centre)).collect()
    }

    /// The places on the gauge line through `centre`.
    fn line<U: Length>(&self, mesh: &Mesh<U>, centre: [f64; 2]) -> Vec<[f64; 2]> {
        let (along, length) = (minus(self.to, self.from), distance(self.to, self.from));
        let across = [-along[1] / length, along[0] / length];
        let n = (SAMPLES * self.width / mesh.element_size()).ceil().clamp(1.0, 10_000.0);
        let place = |k: usize| {
            let t = ((k as f64 + 0.5) / n - 0.5) * self.width;
            [centre[0] + t * across[0], centre[1] + t * across[1]]
        };
        (0..n as usize).map(place).collect()
    }

    /// Nodes and weights of the mean over the gauge line through `centre`.
    fn gauge<U: Length>(&self, mesh: &Mesh<U>, noise: &NodalNoise, centre: [f64; 2]) -> Option<Vec<(usize, f64)>> {
        let (places, mut weights) = (self.line(mesh, centre), Vec::new());
        for &place in &places {
            let value = noise.at(mesh, &shape_at(mesh, place)?);
            weights.extend(value.into_iter().map(|(node, w)| (node, w / places.len() as f64)));
        }
        Some(weights)
    }
}
