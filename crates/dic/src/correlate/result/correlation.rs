//! What is known of a frame.

use crate::backend::{GreyTransfer, Traffic};
use crate::correlate::{Ambiguity, NoiseColour, PhotonNoise, SLOW, SmoothLight, Start};
use crate::field::{Measurement, ModelError, RigidMotion, Status};
use crate::mesh::Mesh;
use crate::units::Px;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Where a frame's iteration started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartUsed {
    /// At the prediction, on the finest level.
    Predicted,
    /// At the prediction, down the pyramid.
    PredictedCoarse,
    /// From the search.
    Cold,
}

/// What is known of one zone in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ZoneResult {
    /// Zone's name.
    pub name: String,
    /// How it has ended.
    pub status: Status,
    /// Rigid motion of its measured nodes.
    pub rigid: Option<RigidMotion>,
    /// Brightness and contrast found; their mean where they are a field.
    pub transfer: GreyTransfer,
    /// Brightness and contrast as a smooth field; none where one gain and offset are enough for the zone.
    pub light: Option<SmoothLight>,
    /// Correlation coefficient of the reference and the deformed image brought back.
    pub correlation: f64,
    /// Root mean square of the residual, grey levels.
    pub residual_rms: f64,
    /// Noise of one image, grey levels, that the uncertainty is made with.
    pub noise: f64,
    /// What the residual says of that noise, grey levels: the same where none was stated. Misfit makes it larger, so
    /// that a stated noise it is well below, or above by more than misfit explains, is doubtful.
    pub residual_noise: f64,
}

/// The result for one frame.
#[derive(Debug, Clone)]
pub struct Correlation {
    /// Field, uncertainty, status.
    pub measurement: Measurement<Px>,
    /// Gauss-Newton iterations on the finest level.
    pub iterations: usize,
    /// Those on the coarser levels.
    pub coarse_iterations: usize,
    /// Largest nodal correction of the last iteration, px.
    pub correction_px: f64,
    /// Bias of the interpolation for displacements along x and y, root mean square over the measured nodes, px: part of the
    /// model error, alike at nodes that move by the same fraction of a pixel.
    pub interpolation_bias_px: [f64; 2],
    /// Place of the node of that correction in the reference, px: where to look when a frame does not converge.
    pub correction_at: [f64; 2],
    /// Root mean square of the residual over all zones, grey levels, before the last correction.
    pub residual_rms: f64,
    /// The same in per cent of the reference's range of grey levels.
    pub residual_percent: f64,
    /// Rigid motion of all measured nodes.
    pub rigid: Option<RigidMotion>,
    /// Zone by zone.
    pub zones: Vec<ZoneResult>,
    /// Where it started.
    pub start: StartUsed,
    /// Nodes not measured because their elements have left the deformed image.
    pub nodes_left: usize,
    /// Nodes not measured because noise hides their texture (THEORY 2) or has kept them from settling.
    pub nodes_in_noise: usize,
    /// Nodes with so little but noise around them that their uncertainty is a lower bound (THEORY 10).
    pub nodes_at_bound: usize,
    /// Elements with a correlation coefficient below 1/2: they do not match (a crack, a glare, a shadow).
    pub poor_elements: usize,
    /// What the residual says of the colour of the noise; `None` unless the frame converged, it was to be looked for,
    /// and enough whole elements are there.
    pub noise_colour: Option<NoiseColour>,
    /// What standard uncertainties were multiplied by, x and y, because noise is correlated from pixel to pixel.
    pub noise_factor: [f64; 2],
    /// The noise as it rises with the grey level, if it was asked for.
    pub photon_noise: Option<PhotonNoise>,
    /// What went between host and device for the frame so far, when they are two.
    pub traffic: Option<Traffic>,
    /// What is said where the texture repeats, so that the images tell a displacement but for multiples of a period.
    pub ambiguity: Option<Ambiguity>,
    /// Frame that was the reference of residuals and correlation coefficients; 0 for the reference given.
    pub reference_frame: usize,
    /// How far the field is from the one that the CPU finds from there on, px; `None` if not looked at.
    pub device_checked_px: Option<f64>,
    /// Displacement of all nodes, those not measured included: the start of the next frame.
    pub(crate) full_displacement: Vec<[f64; 2]>,
    /// Whether an element counted.
    pub(crate) counted: Vec<bool>,
    /// The elements that did not match, by number.
    pub(crate) left_out: Vec<u32>,
    /// The node of the last correction.
    pub(crate) worst_node: usize,
}

impl Correlation {
    /// Displacement of all nodes, px, those that were not measured too: where a prediction goes on from.
    pub fn full_displacement(&self) -> &[[f64; 2]] {
        &self.full_displacement
    }

    /// Where frames that are predicted from this one go on from; none where nothing was measured.
    pub fn next_start(&self) -> Option<Start> {
        self.measurement.status.is_measured().then(|| Start {
            displacement: self.full_displacement.clone(),
            transfer: self.zones.iter().map(|zone| zone.transfer).collect(),
            left_out: self.left_out.clone(),
        })
    }

    /// How far the field is from that of `other`, px, and how far it may be, at the node of those that both measured
    /// where the former is most of the latter: `allowed_px`; and a standard uncertainty more where the iteration
    /// was so long that nodes in noise may have been taken as they were, with as much still before them. Where they
    /// left out different elements, whose neighbours then differ too, nine tenths of the nodes have less.
    pub fn apart_from(&self, other: &Self, allowed_px: f64) -> [f64; 2] {
        let (here, there) = (&self.measurement, &other.measurement);
        let is_long = self.iterations.max(other.iterations) >= SLOW[0];
        let both = (0..here.mesh.n_nodes()).filter(|&node| here.measured[node] && there.measured[node]);
        let apart = |node: usize| {
            let [a, b] = [here.displacement[node], there.displacement[node]];
            let [x, y] = here.sigma[node];
            let left = if is_long { x.min(y) } else { 0.0 };
            [(a[0] - b[0]).abs().max((a[1] - b[1]).abs()), allowed_px + left]
        };
        let mut apart: Vec<[f64; 2]> = both.map(apart).collect();
        let share_of = |[apart, allowed]: &[f64; 2]| apart / allowed;
        apart.sort_by(|a, b| share_of(a).total_cmp(&share_of(b)));
        let share = if self.counted == other.counted { 1.0 } else { 0.9 };
        apart.get((share * apart.len().saturating_sub(1) as f64) as usize).copied().unwrap_or([0.0, allowed_px])
    }

    /// What was found with all zones, or `rest`, without some of them, where that is better. It does not know why they
    /// were lost.
    pub(crate) fn or_rest(self, rest: Self) -> Self {
        let why: Vec<Status> = self.zones.iter().map(|zone| zone.status).collect();
        let mut better = choose_better(self, rest);
        if better.measurement.status == Status::Converged {
            let lost = better.zones.iter_mut().zip(why).filter(|(zone, _)| zone.status != Status::Converged);
            lost.for_each(|(zone, why)| zone.status = why);
        }
        better
    }

    /// With [`Status::PartlyLost`] where it has converged and a zone, or more than a third of the nodes but those
    /// `dropped` from the reference, is not measured.
    pub(crate) fn concluded(mut self, dropped: usize) -> Self {
        let field = &mut self.measurement;
        if field.status == Status::Converged {
            let measured = field.measured.iter().filter(|measured| **measured).count();
            let all = field.mesh.n_nodes().saturating_sub(dropped);
            let has_lost_zone = self.zones.iter().any(|zone| zone.status != Status::Converged);
            if has_lost_zone || 3 * measured < 2 * all {
                field.status = Status::PartlyLost;
            }
        }
        self
    }

    /// What the field may be off beyond noise: of a correlation it is always known.
    pub(crate) fn model_error(&self) -> Cow<'_, ModelError> {
        match &self.measurement.model_error {
            Some(error) => Cow::Borrowed(error),
            None => {
                let mesh = &self.measurement.mesh;
                Cow::Owned(ModelError { nodes: vec![[0.0; 2]; mesh.n_nodes()], misfit: vec![0.0; mesh.n_elements()] })
            }
        }
    }

    /// Smallest correlation coefficient of a zone that has one.
    pub(crate) fn worst_zone(&self) -> f64 {
        self.zones.iter().filter(|zone| zone.correlation != 0.0).map(|zone| zone.correlation).fold(1.0, f64::min)
    }
}

/// Of two results of one frame the one that converged; where both did, that which left fewer elements out, and where
/// none did, that which matches better; the second where they are alike.
pub(crate) fn choose_better(first: Correlation, second: Correlation) -> Correlation {
    let has_converged = |of: &Correlation| of.measurement.status == Status::Converged;
    let is_better = match (has_converged(&first), has_converged(&second)) {
        (true, true) => second.left_out.len() <= first.left_out.len(),
        (false, false) => second.worst_zone() >= first.worst_zone(),
        (_, second) => second,
    };
    if is_better { second } else { first }
}

/// Rigid motion of those of the `nodes` that are measured.
pub(crate) fn rigid(
    mesh: &Mesh<Px>,
    displacement: &[[f64; 2]],
    measured: &[bool],
    nodes: std::ops::Range<usize>,
) -> Option<RigidMotion> {
    RigidMotion::fit(nodes.filter(|&n| measured[n]).map(|n| (mesh.nodes()[n], displacement[n])))
}
