//! The load cell: the force on a group of nodes beside the displacements, in the objective or held against the
//! prediction (THEORY 15).

use crate::identify::cases::error::{positive, refuse_if};
use crate::identify::doubt::remarks;
use crate::identify::{FitError, wrong};
use crate::io::case::{CaseDirection, CaseForce};
use crate::io::joint::ForceInput;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::mechanics::{Instant, Joint, Model, NodeGroup, ReactionAt, ReactionGauge, Solution};
use crate::remark::Remark;

/// Rotation of the rigid motion that is taken off, rad, above which the direction of the force is named.
const TURNED: f64 = 0.01;
/// Measured over computed force from which a wrong width, unit or group is named.
const OFF: f64 = 0.05;

/// Of the changes that explain a difference those are named that leave up to so many times what the best one does.
const AS_GOOD: f64 = 1.5;

/// What the load cell measured, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadCell {
    /// The nodes whose reaction it is, of the mesh of the model.
    pub group: NodeGroup,
    /// The direction in which it counts.
    pub direction: [f64; 2],
    /// Width of the specimen, mm: reactions of the model are by mm of width.
    pub width_mm: f64,
    /// Standard uncertainty of a force, N; `None` where the case states none, and the force is only compared.
    pub std_n: Option<f64>,
    /// Force at each instant of the border, N; `None` where it is not known.
    pub values: Vec<Option<f64>>,
    /// The column of the load file.
    pub column: String,
    gauge: ReactionGauge,
}

/// Measured force beside that of the model.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadComparison {
    /// Instant (from 1), measured and computed force, N.
    pub points: Vec<(usize, f64, f64)>,
    /// At the same instants, the opening of the joint where it opens most, mm; and where that is.
    pub openings: (Vec<f64>, [f64; 2]),
    /// Root mean square of the difference, N.
    pub rms_n: f64,
    /// The largest magnitude of a measured force, N.
    pub peak_n: f64,
    /// The largest difference, measured less computed, N, and its instant.
    pub largest: (f64, usize),
    /// The factor that brings the computed forces closest to the measured ones; `None` where all are zero.
    pub scale: Option<f64>,
}

impl LoadCell {
    /// What `[force]` and its file say about the load cell of `joint`; `needs_std` where it takes part in a fit.
    ///
    /// # Errors
    /// A group that there is not, no width, no standard uncertainty where one is needed, numbers that are not above
    /// zero, a file without a force.
    pub fn new(
        joint: &Joint,
        asked: &CaseForce,
        input: &ForceInput,
        needs_std: bool,
        found: &mut Vec<Remark>,
    ) -> Result<Self, FitError> {
        let refused = |key: &str, what: String| wrong("force", key, what);
        let names: Vec<&str> = joint.groups.iter().map(|group| group.name.as_str()).collect();
        let there = || names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
        let group = match (&asked.group, joint.groups.as_slice()) {
            (Some(name), groups) => groups.iter().find(|group| group.name == *name).ok_or_else(|| {
                refused("group", format!("group = \"{name}\": there is no such group of nodes; there are {}", there()))
            })?,
            (None, [only]) => only,
            (None, _) => {
                return Err(refused("group", format!("group is missing: whose reaction is it? There are {}", there())));
            }
        };
        let Some(width_mm) = asked.width_mm else {
            let what = "width_mm is missing: reactions of the model are by mm of width; give that of the specimen";
            return Err(refused("width_mm", what.to_owned()));
        };
        let width_mm = positive("force", "width_mm", width_mm)?;
        let std_n = asked.std_n.map(|std| positive("force", "std_N", std)).transpose()?;
        let what = "std_N is missing: the fit weighs the force by its standard uncertainty (N); or give use = false";
        refuse_if(needs_std && std_n.is_none(), "force", "std_N", what)?;
        let file = format!("{}: ", input.path.display());
        found.extend(input.remarks.iter().map(|remark| remark.clone().after(&file)));
        let what = format!("{}: column '{}' has no value at any instant", input.path.display(), input.column);
        refuse_if(input.values.iter().flatten().next().is_none(), "force", "column", what)?;
        let turned = joint.removed.iter().fold(0.0_f64, |most, motion| most.max(motion.rotation_rad.abs()));
        if turned > TURNED {
            found.push(remarks::force_turned(turned));
        }
        let direction = asked.direction.unwrap_or(CaseDirection::Degrees(90.0)).unit();
        let direction = direction.map(|part| if part.abs() < 1e-15 { 0.0 } else { part });
        let gauge = joint.model.reaction_gauge(group, direction);
        let (group, values, column) = (group.clone(), input.values.clone(), input.column.clone());
        Ok(Self { group, direction, width_mm, std_n, values, column, gauge })
    }

    /// The force at the instant number `index` (from 0) of the border, N.
    pub fn at(&self, index: usize) -> Option<f64> {
        self.values.get(index).copied().flatten()
    }

    /// The reaction under `u`, by mm of width.
    pub(crate) fn reaction(&self, model: &Model, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> ReactionAt {
        model.reaction_at(&self.gauge, law, u)
    }

    /// Derivatives of the force by the parameters of the material of `group` at fixed displacements, N.
    pub(crate) fn by_material(&self, model: &Model, group: usize, u: &[[f64; 2]]) -> Vec<f64> {
        model.reaction_by_material(&self.gauge, group, u).iter().map(|by| self.width_mm * by).collect()
    }

    /// The force under `u` on `model`, another one of the same joint, whose nodes of the group are `nodes`, N.
    pub(crate) fn force_on(&self, model: &Model, nodes: Vec<u32>, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> f64 {
        let gauge = model.reaction_gauge(&NodeGroup::new("", nodes), self.direction);
        self.width_mm * model.reaction_at(&gauge, law, u).value
    }

    /// The measured forces beside those of `solution`; `None` where no instant has both.
    pub fn compare(&self, model: &Model, law: &dyn CohesiveLaw, solution: &Solution) -> Option<LoadComparison> {
        let point = |(index, instant): (usize, &Instant)| {
            let measured = self.at(index).filter(|_| instant.status.converged())?;
            let computed = self.width_mm * self.reaction(model, law, &instant.displacement).value;
            Some((index + 1, measured, computed))
        };
        let points: Vec<(usize, f64, f64)> = solution.instants.iter().enumerate().filter_map(point).collect();
        let openings = Self::openings(model, solution, &points)?;
        let off = |(_, measured, computed): &(usize, f64, f64)| measured - computed;
        let n = points.len() as f64;
        let rms_n = (points.iter().map(|point| off(point).powi(2)).sum::<f64>() / n).sqrt();
        let worst = points.iter().max_by(|a, b| off(a).abs().total_cmp(&off(b).abs()))?;
        let largest = (off(worst), worst.0);
        let peak_n = points.iter().fold(0.0_f64, |most, (_, measured, _)| most.max(measured.abs()));
        let (both, square) = points.iter().fold((0.0, 0.0), |(both, square), (_, m, c)| (both + m * c, square + c * c));
        Some(LoadComparison { rms_n, peak_n, largest, scale: (square > 0.0).then(|| both / square), points, openings })
    }

    /// The opening at the instants of `points`, of the pair of nodes that opens most in the last of them; and its place.
    /// Zero of a body without an adhesive.
    fn openings(model: &Model, solution: &Solution, points: &[(usize, f64, f64)]) -> Option<(Vec<f64>, [f64; 2])> {
        if model.mesh().pairs().is_empty() {
            return Some((vec![0.0; points.len()], [0.0; 2]));
        }
        let jumps = |&(instant, ..): &(usize, f64, f64)| {
            Some(model.jumps(&solution.instants.get(instant.checked_sub(1)?)?.displacement))
        };
        let last = jumps(points.last()?)?;
        let pair = (0..last.len()).max_by(|&a, &b| last[a].normal.abs().total_cmp(&last[b].normal.abs()))?;
        let (at, _) = *model.pair_positions().get(pair)?;
        Some((points.iter().map(|point| Some(jumps(point)?.get(pair)?.normal)).collect::<Option<_>>()?, at))
    }
}

impl LoadComparison {
    /// In words: one line.
    pub fn text(&self, cell: &LoadCell) -> String {
        let share = |force: f64| if self.peak_n > 0.0 { 100.0 * force / self.peak_n } else { 0.0 };
        let (largest, instant) = self.largest;
        format!(
            "load of {} ({}): measured and computed differ by {:.3} N rms ({:.2} % of the largest measured), at most {largest:+.3} N \
             ({:+.2} %) at instant {instant}",
            cell.group.name,
            cell.column,
            self.rms_n,
            share(self.rms_n),
            share(largest)
        )
    }

    /// What one change alone leaves of the difference, N rms, and in words which: the least first.
    fn causes(&self, cell: &LoadCell) -> Vec<(f64, String)> {
        let points = &self.points;
        let n = points.len() as f64;
        let rms = |off: &dyn Fn(usize) -> f64| ((0..points.len()).map(|k| off(k).powi(2)).sum::<f64>() / n).sqrt();
        let off = |k: usize| points[k].1 - points[k].2;
        // Of the computed force from instant to instant.
        let slope = |k: usize| {
            let (low, high) = (&points[k.saturating_sub(1)], &points[(k + 1).min(points.len() - 1)]);
            if high.0 == low.0 { 0.0 } else { (high.2 - low.2) / (high.0 - low.0) as f64 }
        };
        let (both, square) = (0..points.len())
            .fold((0.0, 0.0), |(both, square), k| (both + off(k) * slope(k), square + slope(k) * slope(k)));
        let zero = (0..points.len()).map(off).sum::<f64>() / n;
        let mut causes = vec![(rms(&|k| off(k) - zero), format!("a load cell whose zero is {zero:+.4} N"))];
        causes.extend(self.scale.map(|scale| {
            let width = scale * cell.width_mm;
            let what =
                format!("width_mm = {width:.4} in place of {}, or moduli {scale:.3} times as large", cell.width_mm);
            (rms(&|k| points[k].1 - scale * points[k].2), what)
        }));
        if square > 0.0 {
            let (later, way) = (both / square, if both > 0.0 { "later" } else { "earlier" });
            let what = format!("loads of {:.2} instants {way} than the images", later.abs());
            causes.push((rms(&|k| off(k) - later * slope(k)), what));
        }
        causes.sort_by(|a, b| a.0.total_cmp(&b.0));
        causes
    }

    /// What is to be looked at: forces of the other sign, or another course than the computed ones.
    pub fn remark(&self, cell: &LoadCell) -> Option<Remark> {
        let scale = self.scale?;
        if scale < 0.0 {
            return Some(remarks::force_opposite(&cell.group.name));
        }
        // What the noise of the load cell makes of the factor counts.
        let square: f64 = self.points.iter().map(|(_, _, computed)| computed * computed).sum();
        let by_noise = cell.std_n.map_or(0.0, |std| 3.0 * std / square.sqrt());
        let causes = self.causes(cell);
        let least = causes.first()?.0;
        let by_chance = 3.0 * cell.std_n.unwrap_or(0.0);
        let is_explained = self.rms_n > by_chance.max(OFF * self.peak_n) && least < 0.5 * self.rms_n;
        let is_off = is_explained || (scale - 1.0).abs() > OFF.max(by_noise);
        let likely = causes.iter().filter(|(left, _)| *left <= AS_GOOD * least);
        let likely: Vec<String> = likely.map(|(left, what)| format!("{what} (leaves {left:.3} N rms)")).collect();
        is_off.then(|| remarks::force_scaled(&cell.group.name, scale, cell.width_mm, &likely.join(", or ")))
    }
}
