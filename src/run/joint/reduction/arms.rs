//! The arms of a reduced test beside its tip: from nodes to faces, and J of their sections (THEORY 23).

use super::loads::exact;
use crate::field::{Measurement, NodalNoise, Reading, Value};
use crate::plane::{Point, dot, minus};
use crate::reduction::{ArmPart, ArmSection, Instant};
use crate::units::Px;

/// An arm is a beam by this many of its thicknesses behind the tip, and ahead of a load; and is looked at where so much
/// of it is left.
const FROM_TIP: f64 = 0.5;
const FROM_LOAD: f64 = 1.0;
const SHORTEST: f64 = 2.0;
/// Strains between faces and nodes are taken from nodes so near to the tip, along and across, by the thickness of an
/// arm; where that is not known by elements.
const PATCH: [f64; 2] = [0.5, 0.5];
pub(super) const PATCH_ELEMENTS: f64 = 3.0;
/// The tip and the arms beside it, in the plane of the specimen.
#[derive(Debug, Clone)]
pub(super) struct Beside {
    /// The initial tip, and the place of the joint there.
    pub(super) tip: Point,
    pub(super) origin: Point,
    /// From the lower to the upper arm, and the tangent that goes with it.
    pub(super) normal: Point,
    pub(super) tangent: Point,
    /// Distance of the faces' nodes, and thickness of the adhesive where that is stated, px.
    pub(super) gap: f64,
    pub(super) adhesive: Option<f64>,
    /// Thickness of an arm, by which nodes near the tip are chosen, px.
    pub(super) arm: f64,
    /// The zones of the upper and the lower arm, by number.
    pub(super) zones: [usize; 2],
    pub(super) mm_per_px: f64,
}

/// The parts of both arms behind the tip, while the same nodes are measured: their nodes and what is made of them.
pub(super) type Arms = [(Vec<usize>, ArmSection); 2];

impl Beside {
    /// Makes the jumps at the tip those of the faces, where the thickness of the adhesive is stated: by the slopes of the
    /// displacement across each arm, of a plane through the nodes near the tip.
    pub(super) fn to_faces(&self, field: &Measurement<Px>, noise: &NodalNoise, instant: &mut Instant) {
        let Some(adhesive) = self.adhesive else { return };
        let by = 0.5 * self.mm_per_px * (self.gap - adhesive);
        let off = |node: usize| {
            let off = minus(of_node(field.mesh.nodes(), node), self.origin);
            [dot(off, self.tangent), dot(off, self.normal)]
        };
        let slope = |zone: usize, direction: Point| -> Option<Value> {
            let near = |node: &usize| {
                let [s, n] = off(*node).map(f64::abs);
                field.measured.get(*node) == Some(&true)
                    && s <= PATCH[0] * self.arm
                    && n <= 0.5 * self.gap + PATCH[1] * self.arm
            };
            let nodes: Vec<usize> = field.mesh.zone_nodes(zone).filter(near).collect();
            let weights = slope_across(nodes.iter().map(|&node| off(node)))?;
            Reading::new(nodes.iter().zip(weights).map(|(node, w)| (*node, direction.map(|d| d * w))))
                .read(field, noise)
        };
        let corrected = |jump: Option<Value>, direction: Point| {
            let (jump, upper, lower) = (jump?, slope(self.zones[0], direction)?, slope(self.zones[1], direction)?);
            let sigma = jump.sigma.hypot(by * upper.sigma).hypot(by * lower.sigma);
            Some(Value { value: jump.value - by * (upper.value + lower.value), sigma })
        };
        instant.opening_mm = corrected(instant.opening_mm, self.normal);
        instant.sliding_mm = corrected(instant.sliding_mm, self.tangent);
    }

    /// The parts of both arms behind the tip, for a crack that grows along `growth`; `None` where too little of them is
    /// measured, or loads, so far ahead of the tip, act too near.
    pub(super) fn arms(
        &self,
        field: &Measurement<Px>,
        noise: &NodalNoise,
        growth: Point,
        loads: impl Iterator<Item = f64>,
        moduli: [f64; 2],
    ) -> Option<Arms> {
        // Along from the tip of the case, across from the mid-line.
        let place = |node: usize| {
            let at = of_node(field.mesh.nodes(), node);
            [dot(minus(at, self.tip), growth), dot(minus(at, self.origin), self.normal)]
        };
        let nearest = loads.filter(|at| *at < 0.0).fold(f64::NEG_INFINITY, f64::max) + FROM_LOAD * self.arm;
        let arm = |zone: usize, sign: f64| {
            let nodes = || field.mesh.zone_nodes(zone).filter(|node| field.measured.get(*node) == Some(&true));
            let end = nodes().map(|node| place(node)[0]).fold(f64::INFINITY, f64::min);
            let along = [nearest.max(end), -FROM_TIP * self.arm];
            if along[1] - along[0] < SHORTEST * self.arm {
                return None;
            }
            let face = 0.5 * self.adhesive.unwrap_or(self.gap);
            let [inner, outer] = [sign * face, sign * (face + self.arm)];
            let across = [inner.min(outer), inner.max(outer)];
            let chosen: Vec<usize> = nodes().filter(|&node| (along[0]..=along[1]).contains(&place(node)[0])).collect();
            let mm = |v: Point| v.map(|c| self.mm_per_px * c);
            let places: Vec<Point> = chosen.iter().map(|&node| mm(place(node))).collect();
            let part = ArmPart { along: mm(along), across: mm(across), moduli };
            let section = ArmSection::new(part, &places, |a, b| match (chosen.get(a), chosen.get(b)) {
                (Some(a), Some(b)) => noise.correlation(*a, *b),
                _ => 0.0,
            })?;
            Some((chosen, section))
        };
        Some([arm(self.zones[0], 1.0)?, arm(self.zones[1], -1.0)?])
    }

    /// J of the parts of both arms, N/mm.
    pub(super) fn section(&self, field: &Measurement<Px>, growth: Point, arms: &Arms) -> Value {
        let axes = [growth, self.normal];
        let of_arm = |(nodes, section): &(Vec<usize>, ArmSection)| {
            let mm = |of: Point| axes.map(|axis| self.mm_per_px * dot(of, axis));
            let size = |of: Point| axes.map(|axis| self.mm_per_px * (of[0] * axis[0]).hypot(of[1] * axis[1]));
            let displacement: Vec<Point> = nodes.iter().map(|&node| mm(of_node(&field.displacement, node))).collect();
            let sigma: Vec<Point> = nodes.iter().map(|&node| size(of_node(&field.sigma, node))).collect();
            (1.0, section.j(&displacement, &sigma))
        };
        weighed_sum(arms.iter().map(of_arm))
    }
}

/// What a list by nodes has for one: they are as many as the nodes of their mesh.
pub(super) fn of_node(list: &[Point], node: usize) -> Point {
    list.get(node).copied().unwrap_or([f64::NAN; 2])
}

/// The sum of independent values with weights.
pub(super) fn weighed_sum(values: impl Iterator<Item = (f64, Value)>) -> Value {
    values.fold(exact(0.0), |sum, (weight, part)| Value {
        value: sum.value + weight * part.value,
        sigma: sum.sigma.hypot(weight * part.sigma),
    })
}

/// Weights of values at these places (along, across) that make the slope across of the plane through them; `None` for
/// places on a line.
fn slope_across(places: impl Iterator<Item = Point> + Clone) -> Option<Vec<f64>> {
    let n = places.clone().count() as f64;
    let mean = places.clone().fold([0.0; 2], |sum, at| [sum[0] + at[0] / n, sum[1] + at[1] / n]);
    let off = places.map(move |at| minus(at, mean));
    let [ss, sn, nn] = off.clone().fold([0.0; 3], |sum, [s, n]| [sum[0] + s * s, sum[1] + s * n, sum[2] + n * n]);
    let determinant = ss * nn - sn * sn;
    (determinant > 1e-9 * ss * nn).then(|| off.map(|[s, n]| (ss * n - sn * s) / determinant).collect())
}
