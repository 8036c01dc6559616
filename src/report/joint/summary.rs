//! `summary.json` of a run of the mechanics.

use super::JointReport;
use super::grids::softens;
use super::loads::{Balance, EnergySummary, ReactionSummary};
use super::release::JSummary;
use super::remarks;
use crate::field::RigidMotion;
use crate::mechanics::cohesive::{Jump, Parameter};
use crate::mechanics::{Instant, Joint, Status};
use crate::remark::Remark;
use crate::report::ForceRecord;
use serde::Serialize;
use std::collections::BTreeMap;

/// Share of the yield strain that half the square of a strip's rotation may reach (THEORY 7).
const SMALL_ROTATION: f64 = 0.1;

/// What a run came to.
#[derive(Debug, Clone, Serialize)]
pub struct JointSummary {
    /// Version of the program.
    pub quadrille: &'static str,
    /// The case file.
    pub case: String,
    /// Time of the solution with its sensitivities, without files.
    pub seconds: f64,
    /// Units and axes.
    pub units: &'static str,
    /// Elements of the strips.
    pub elements: usize,
    /// Elements of the interface.
    pub interface_elements: usize,
    /// Unknown components.
    pub unknowns: usize,
    /// Which factor of the tangent was made.
    pub solver: &'static str,
    /// The adhesive.
    pub cohesive: LawSummary,
    /// The material of each group of elements.
    pub substrate: BTreeMap<String, LawSummary>,
    /// What counts as jump.
    pub kinematics: &'static str,
    /// Where tractions are evaluated.
    pub quadrature: &'static str,
    /// `none` or `overall`.
    pub remove_rigid_motion: &'static str,
    /// What was taken off at each instant.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rigid_motion_removed: Vec<RigidMotion>,
    /// Why there is no J-integral, where there is none at any instant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_j_integral: Option<String>,
    /// How the energies balance; absent where they were not computed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy_balance: Option<Balance>,
    /// The load cell beside the prediction, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force: Option<ForceRecord>,
    /// What a user should look at.
    pub remarks: Vec<Remark>,
    /// Every instant.
    pub instants: Vec<InstantSummary>,
}

/// A law with its values.
#[derive(Debug, Clone, Serialize)]
pub struct LawSummary {
    /// Its name.
    pub model: &'static str,
    /// Its parameters by the keys of a case file.
    pub parameters: BTreeMap<String, f64>,
}

impl LawSummary {
    fn of(model: &'static str, parameters: &[Parameter], values: &[f64]) -> Self {
        Self { model, parameters: parameters.iter().map(Parameter::key).zip(values.iter().copied()).collect() }
    }
}

/// What became of one instant.
#[derive(Debug, Clone, Serialize)]
pub struct InstantSummary {
    /// Its number, from 1.
    pub instant: usize,
    /// `converged`, `rescued`, `not_converged` or `not_reached`.
    pub status: &'static str,
    /// Newton iterations over all increments, failed ones included.
    pub newton_iterations: u32,
    /// How often the increment was halved.
    pub halvings: u32,
    /// Whether node pairs snapped and were carried over.
    pub rescue: bool,
    /// Steps that this took.
    pub rescue_steps: u32,
    /// Largest residual force over the largest nodal force.
    pub residual: f64,
    /// Place of the crack front, from the first node pair along the joint.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crack_front_mm: Option<f64>,
    /// Rotation of the strip that turns most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_strip_rotation_rad: Option<f64>,
    /// Reactions by group of nodes.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub reactions: BTreeMap<String, ReactionSummary>,
    /// Energies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub energy: Option<EnergySummary>,
    /// The energy that flows to the front of the joint when it moves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub j_integral: Option<JSummary>,
    /// Share of sliding in the work of separation at the pair that is nearest to the crack front.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sliding_share_at_front: Option<f64>,
    /// Node pairs (lower, upper) that snapped, or moved most where the instant failed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub snapped_pairs: Vec<[u32; 2]>,
    /// Why there is no solution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub message: Option<String>,
    /// Of a path followed by its length: where in the history of the case it is, 0 at rest, k at its instant k.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<f64>,
    /// What a user should look at.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<Remark>,
}

impl JointReport<'_> {
    /// The summary of a run of the case file `case` that took `seconds`.
    pub fn summary(&self, case: String, seconds: f64, remarks: Vec<Remark>) -> JointSummary {
        let Joint { model, law, removed, .. } = self.joint;
        let shares = self.sliding_at_front();
        let of_instant = |(k, instant)| self.summary_of(k, instant, shares.get(&k).copied());
        JointSummary {
            quadrille: env!("CARGO_PKG_VERSION"),
            case,
            seconds,
            units: "mm, MPa, N/mm; x to the right, y up; nodes counted from 0, instants from 1",
            elements: model.mesh().elements().len(),
            interface_elements: model.mesh().interfaces().len(),
            unknowns: model.n_unknowns(),
            solver: model.solver(),
            cohesive: LawSummary::of(law.name(), law.parameters(), &law.values()),
            substrate: (model.mesh().groups().iter().zip(model.materials()))
                .map(|(group, law)| (group.clone(), LawSummary::of(law.name(), law.parameters(), &law.values())))
                .collect(),
            kinematics: model.options().kinematics.name(),
            quadrature: model.options().quadrature.name(),
            remove_rigid_motion: if removed.is_empty() { "none" } else { "overall" },
            rigid_motion_removed: removed.clone(),
            no_j_integral: self.no_j_integral(),
            energy_balance: self.balance(),
            force: self.force.cloned(),
            remarks,
            instants: (1..).zip(&self.solution.instants).map(of_instant).collect(),
        }
    }

    fn summary_of(&self, number: usize, instant: &Instant, sliding_share_at_front: Option<f64>) -> InstantSummary {
        let Joint { model, law, .. } = self.joint;
        let snapped_pairs: Vec<[u32; 2]> = instant.snapped.iter().map(|&k| model.mesh().pairs()[k]).collect();
        let converged = instant.status.converged();
        let rotation = converged.then(|| largest_rotation(self.joint, &instant.displacement));
        let message = match instant.status {
            Status::NotConverged => Some(format!(
                "instant {number} did not converge beyond {:.1} % of its step; node pairs (lower, upper) {} moved most. \
                 Give instants closer together, a finer mesh, or a law whose peak traction ({:.0} MPa) is lower",
                100.0 * instant.failure.map_or(0.0, |failure| failure.share),
                snapped_pairs.iter().map(|[lower, upper]| format!("({lower}, {upper})")).collect::<Vec<_>>().join(" "),
                law.peak().normal
            )),
            Status::NotReached => Some("an earlier instant did not converge".to_owned()),
            Status::Converged | Status::Rescued => None,
        };
        InstantSummary {
            instant: number,
            status: instant.status.name(),
            newton_iterations: instant.iterations,
            halvings: instant.halvings,
            rescue: instant.status == Status::Rescued,
            rescue_steps: instant.rescue_iterations,
            residual: instant.residual,
            crack_front_mm: if converged { model.crack_front(&**law, &instant.displacement) } else { None },
            largest_strip_rotation_rad: rotation,
            reactions: if converged { self.reactions_of(instant) } else { BTreeMap::new() },
            energy: self.energies.get(number - 1).copied().flatten().map(EnergySummary::from),
            j_integral: self.j_integral(number),
            sliding_share_at_front,
            snapped_pairs,
            message,
            time: self.times.get(number - 1).copied(),
            remarks: (rotation.and_then(|w| too_large(self.joint, number, w)).into_iter())
                .chain(converged.then(|| beyond_curve(self.joint, number, &instant.displacement)).flatten())
                .chain(self.closing(number))
                .collect(),
        }
    }

    /// What is to be said of an instant at which pairs beyond their peak close.
    fn closing(&self, number: usize) -> Option<Remark> {
        let Joint { model, law, .. } = self.joint;
        let of = |k: usize| self.solution.instants.get(k).filter(|instant| instant.status.converged());
        let (before, now) = (of(number.checked_sub(2)?)?, of(number - 1)?);
        let (before, now) = (model.jumps(&before.displacement), model.jumps(&now.displacement));
        // Less is round-off of a state that stands still.
        let little = 1e-3 * law.front_opening();
        let cracked = model.mesh().cracked_pairs();
        let closes = |&k: &usize| {
            let size = |jump: &Jump| jump.normal.max(0.0).hypot(jump.tangential);
            !cracked[k] && size(&now[k]) < size(&before[k]) - little && softens(&law.response(before[k]))
        };
        let pairs: Vec<usize> = (0..now.len()).filter(closes).collect();
        Some(remarks::pairs_close(number, pairs.len(), model.mesh().pairs()[*pairs.first()?]))
    }
}

/// The rotation of the strip that turns most, radians.
fn largest_rotation(joint: &Joint, u: &[[f64; 2]]) -> f64 {
    let mesh = joint.model.mesh();
    let rotation = |strip: usize| {
        let nodes = || (0..mesh.nodes().len()).filter(move |&node| mesh.strip()[node] as usize == strip);
        RigidMotion::fit(nodes().map(|node| (mesh.nodes()[node], u[node]))).map_or(0.0, |motion| motion.rotation_rad)
    };
    (0..mesh.n_strips()).map(rotation).fold(0.0, |most: f64, w| if w.abs() > most.abs() { w } else { most })
}

/// What is to be said where a strip is strained beyond the curve that its material was measured up to.
fn beyond_curve(joint: &Joint, number: usize, u: &[[f64; 2]]) -> Option<Remark> {
    let model = &joint.model;
    if model.materials().iter().all(|law| law.known_up_to().is_none()) {
        return None;
    }
    let mut worst: Option<(f64, f64, usize)> = None;
    for (states, &group) in model.states(u).iter().zip(model.mesh().element_group()) {
        let Some(end) = model.materials()[group as usize].known_up_to() else { continue };
        let strain = states.iter().map(|state| state.plastic_strain).fold(0.0, f64::max);
        if strain > end && worst.is_none_or(|(most, ..)| strain > most) {
            worst = Some((strain, end, group as usize));
        }
    }
    let (strain, end, group) = worst?;
    Some(remarks::strain_beyond_curve(number, &model.mesh().groups()[group], strain, end))
}

/// What is to be said when small strains do not hold under the rotation `w` of a strip.
fn too_large(joint: &Joint, number: usize, w: f64) -> Option<Remark> {
    if !joint.model.options().kinematics.is_small() {
        return None;
    }
    let yields = joint.model.materials().iter().filter_map(|law| law.yield_strain()).fold(f64::INFINITY, f64::min);
    (0.5 * w * w > SMALL_ROTATION * yields).then(|| remarks::rotation_large(number, w, yields))
}
