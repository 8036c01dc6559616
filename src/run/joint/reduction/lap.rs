//! A lap joint: the shear traction along it from the strain of its upper adherend (THEORY 23).

use super::arms::of_node;
use super::loads::wrong;
use super::opened::{Opened, open};
use crate::field::{FacingPoint, Measurement, NodalNoise, Reading, Value};
use crate::io::case::{CaseFile, CaseReduction};
use crate::plane::{Point, dot, minus};
use crate::reduction::{Adherend, Specimen, shear_along};
use crate::remark::{About, Code, Remark};
use crate::report::{LapFrame, LapRecord, WithStd};
use crate::run::words::Result;
use crate::units::Px;
use std::path::Path;

/// The force by the strain and the load differ by this many standard uncertainties before it is said, and this share.
const DIFFERENT: f64 = 4.0;
const SHARE: f64 = 0.1;
/// An adherend goes on where it reaches so many elements beyond the lap.
const BEYOND: f64 = 2.0;

/// The record of a lap joint whose fields are in the folder `run`.
///
/// # Errors
/// A run or loads that cannot be read, no modulus, no thickness, nothing measured along the lap.
pub(super) fn record(
    case: &CaseFile,
    asked: &CaseReduction,
    path: &Path,
    specimen: &Specimen,
    run: &Path,
) -> Result<LapRecord> {
    let (Some(young), Some(thickness)) = (specimen.young_mpa, specimen.arm_mm) else {
        return Err(wrong("layout = \"lap\" needs E_MPa and arm_mm, the thickness of the upper adherend"));
    };
    let stiffness = young.value * thickness.value;
    let opened = open(case, asked, specimen, run)?;
    let Opened { store, camera, size, zones, .. } = &opened;
    let points = opened.facing.points();
    let Some(first) = points.first() else { return Err(wrong("an [[opening]] between the adherends is needed")) };
    let (tangent, mm) = (first.tangent(), size.mm_per_px());
    let mut frames = Vec::new();
    let mut noise: Option<NodalNoise> = None;
    // Strains by the scale of the camera are as uncertain as that scale is not: a length cancels.
    let relative = |of: Value| of.sigma / of.value;
    let relative = relative(young).hypot(relative(thickness));
    for frame in 1..=store.n_frames() {
        let Some(load_n) = opened.load(frame) else { continue };
        let has_field = store.status(frame)?.is_some_and(|status| status.has_field());
        let Some(found) = (if has_field { store.frame(frame)? } else { None }) else { continue };
        let plane = camera.rectify(&found.measurement);
        let of_field = NodalNoise::along(noise.take(), &*plane, opened.is_bound, Some(camera.raw_mesh()));
        let noise = noise.insert(of_field);
        let lap = Lap::of(&plane, *zones, first, mm);
        let [upper, lower] = *zones;
        let adherends = [(upper, 1.0), (lower, -1.0)].map(|of| lap.adherend(&plane, noise, of, thickness.value));
        let Some(curve) = shear_along(&adherends, lap.length, stiffness) else { continue };
        let sliding = |at: &f64| {
            let off = |point: &FacingPoint| (lap.along(point.at) - at).abs();
            let nearest = points.iter().min_by(|a, b| off(a).total_cmp(&off(b)))?;
            Some(mm * nearest.jump(tangent).read(&plane, noise)?.value)
        };
        let area = lap.length * specimen.width_mm.value;
        let force = Value { value: area * curve.mean_mpa.value, sigma: area * curve.mean_mpa.sigma };
        frames.push(LapFrame {
            frame,
            load_n,
            force_n: WithStd::with_common(force, relative.hypot(specimen.width_mm.sigma / specimen.width_mm.value)),
            mean_mpa: WithStd::with_common(curve.mean_mpa, relative),
            largest_mpa: WithStd::with_common(curve.largest_mpa, relative),
            sliding_mm: curve.along_mm.iter().map(sliding).collect(),
            curve,
        });
    }
    if frames.is_empty() {
        return Err(wrong("no frame shows eight columns of nodes of the upper adherend along the lap"));
    }
    let mut remarks = opened.loads.remarks.clone();
    remarks.extend(unbalanced(&frames));
    Ok(LapRecord {
        quadrille: env!("CARGO_PKG_VERSION"),
        case: path.display().to_string(),
        layout: specimen.layout.name(),
        stiffness_n_per_mm: WithStd::with_common(Value { value: stiffness, sigma: 0.0 }, relative),
        frames,
        remarks,
    })
}

/// Where both adherends lie side by side.
struct Lap {
    /// Its begin, on the mid-line of the joint, px, the tangent and the normal.
    origin: Point,
    tangent: Point,
    normal: Point,
    /// mm.
    length: f64,
    /// Distance of the faces' nodes, mm.
    gap: f64,
    mm: f64,
}

impl Lap {
    /// That of the zones of both adherends, whose joint has the place `first`.
    fn of(field: &Measurement<Px>, zones: [usize; 2], first: &FacingPoint, mm: f64) -> Self {
        let lap = Self {
            origin: first.at,
            tangent: first.tangent(),
            normal: first.normal,
            length: 0.0,
            gap: mm * first.gap,
            mm,
        };
        let [upper, lower] = zones.map(|zone| lap.extent(field, zone));
        let (from, to) = (upper[0].max(lower[0]), upper[1].min(lower[1]));
        let origin = minus(lap.origin, lap.tangent.map(|c| -from / mm * c));
        Self { origin, length: to - from, ..lap }
    }

    /// Distance along the lap from its begin, mm.
    fn along(&self, at: Point) -> f64 {
        self.mm * dot(minus(at, self.origin), self.tangent)
    }

    /// Where a zone begins and ends along it.
    fn extent(&self, field: &Measurement<Px>, zone: usize) -> [f64; 2] {
        let places = field.mesh.zone_nodes(zone).map(|node| self.along(of_node(field.mesh.nodes(), node)));
        places.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], at| [least.min(at), most.max(at)])
    }

    /// The displacement of the middle of an adherend along the lap, at each of its columns of nodes: what they say there
    /// by a line across the thickness, with what its turn takes off its length put back; and which of its ends is free,
    /// since the zone does not go on beyond it. `side`: 1 for the upper, -1 for the lower.
    fn adherend(
        &self,
        field: &Measurement<Px>,
        noise: &NodalNoise,
        (zone, side): (usize, f64),
        thickness: f64,
    ) -> Adherend {
        let element = self.mm * field.mesh.element_size();
        let [from, to] = self.extent(field, zone);
        let free = match [from < -BEYOND * element, to > self.length + BEYOND * element] {
            [false, true] => Some(0),
            [true, false] => Some(1),
            _ => None,
        };
        let along = |node: usize| self.along(of_node(field.mesh.nodes(), node));
        let across =
            |node: usize| side * self.mm * dot(minus(of_node(field.mesh.nodes(), node), self.origin), self.normal);
        let within = |node: &usize| {
            field.measured.get(*node) == Some(&true) && (-1e-6..=self.length + 1e-6).contains(&along(*node))
        };
        let mut nodes: Vec<usize> = field.mesh.zone_nodes(zone).filter(within).collect();
        nodes.sort_by(|a, b| along(*a).total_cmp(&along(*b)));
        let middle = 0.5 * (self.gap + thickness);
        let column = |nodes: &[usize]| {
            let n = nodes.len() as f64;
            let mean = |of: &dyn Fn(usize) -> f64| nodes.iter().map(|&node| of(node)).sum::<f64>() / n;
            let centre = mean(&across);
            let square = nodes.iter().map(|&node| (across(node) - centre).powi(2)).sum::<f64>();
            let weight = |node: usize| match square > 0.0 {
                true => 1.0 / n + (middle - centre) * (across(node) - centre) / square,
                false => 1.0 / n,
            };
            let read = |direction: Point| {
                let weights = nodes.iter().map(|&node| (node, direction.map(|d| d * weight(node))));
                let Value { value, sigma } = Reading::new(weights).read(field, noise)?;
                Some(Value { value: self.mm * value, sigma: self.mm * sigma })
            };
            Some((mean(&along), read(self.tangent)?, read(self.normal)?.value))
        };
        let columns: Vec<(f64, Value, f64)> =
            nodes.chunk_by(|a, b| along(*b) - along(*a) < 0.5 * element).filter_map(column).collect();
        let (mut before, mut turned): (Option<(f64, f64)>, f64) = (None, 0.0);
        let sample = |(at, u, v): &(f64, Value, f64)| {
            turned += before.map_or(0.0, |(from, w)| 0.5 * (v - w).powi(2) / (at - from));
            before = Some((*at, *v));
            (*at, Value { value: u.value + turned, ..*u })
        };
        Adherend { samples: columns.iter().map(sample).collect(), free }
    }
}

/// The force by the strain is not the load.
fn unbalanced(frames: &[LapFrame]) -> Option<Remark> {
    let of = frames.iter().max_by(|a, b| a.load_n.total_cmp(&b.load_n))?;
    let off = of.force_n.value.abs() - of.load_n.abs();
    let text = format!(
        "the strain of the adherend makes a force of {:.4} \u{b1} {:.2} N over the lap in frame {}, where the load is {:.4} N: check E_MPa, \
         arm_mm, width_mm, and whether the whole thickness and the whole lap are in view",
        of.force_n.value.abs(),
        of.force_n.std,
        of.frame,
        of.load_n.abs()
    );
    let differ = off.abs() > (DIFFERENT * of.force_n.std).max(SHARE * of.load_n.abs());
    differ.then(|| Remark::new(Code::ReductionDisagree, About::Run, text).with("force_by_strain_N", of.force_n.value))
}
