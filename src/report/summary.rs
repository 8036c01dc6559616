//! `summary.json`: what a series of correlations gave, frame by frame.

use super::words::significant;
use super::{Name, frame_remarks, number};
use crate::backend::Traffic;
use crate::correlate::{
    Ambiguity, Correlation, FixedPattern, NoiseColour, Reference, SmoothLight, StartUsed, TextureFault,
};
use crate::field::{ElementMark, Flattened, Marked, Measurement, Misfit, RigidMotion, Status, uniform_strain};
use crate::imaging::{Blank, Saturation};
use crate::remark::{About, Remark};
use crate::units::Px;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// Everything that `summary.json` holds. Lengths are in px of the reference image (y down), grey levels
/// in the images' own scale.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Summary {
    /// Version of quadrille.
    pub quadrille: String,
    /// Device and instruction path.
    pub device: String,
    /// Threads of the correlation.
    pub threads: usize,
    /// Units of the numbers, by the ending of their names.
    pub units: BTreeMap<Name, Name>,
    /// The reference image.
    pub reference: ReferenceSummary,
    /// Nodes of the mesh.
    pub n_nodes: usize,
    /// Elements of the mesh.
    pub n_elements: usize,
    /// Scales of the pyramid, the image itself included.
    pub n_levels: usize,
    /// Solver of the normal equations on the finest level: `direct` or `iterative`.
    pub solver: Name,
    /// Error that is left, as the corrections tell, below which a frame counts as converged.
    pub tolerance_px: f64,
    /// The one in effect: a hundredth of the smallest standard uncertainty where that is more, absent where it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_in_effect_px: Option<f64>,
    /// Standard deviation of the Gaussian by which a noisy reference is smoothed for its gradient, absent where it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gradient_smoothing_px: Option<f64>,
    /// Pixels of the zones that stand alone in the reference, as hot ones do, and are mended; absent without any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hot_pixels: Option<usize>,
    /// Decoded reference to factorised matrix, pyramid and uncertainty of all nodes, seconds.
    pub seconds_reference: f64,
    /// The whole run so far, files included, seconds.
    pub seconds_total: f64,
    /// Nodes without texture that were left out.
    pub nodes_left_out: Vec<NodeWithoutTexture>,
    /// Nodes without texture that a regularisation or splines hold.
    pub nodes_held: Vec<NodeWithoutTexture>,
    /// What to know about the series as a whole, its zones and its files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<Remark>,
    /// The frames that have become references, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reference_updates: Vec<usize>,
    /// Number of frames by status.
    pub counts: BTreeMap<Name, usize>,
    /// How far the displacements can be trusted; absent where no frame has any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trust: Option<Trust>,
    /// The cracks along which the mesh is cut, when the series is done.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cracks: Vec<super::CrackSummary>,
    /// The frames, in series order.
    pub frames: Vec<FrameSummary>,
}

/// The reference image.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ReferenceSummary {
    /// Its file, or the first of several.
    pub file: String,
    /// The files whose mean it is, when there are several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mean_of: Vec<String>,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Depth of its grey levels.
    pub depth: Name,
    /// Bits of a pixel that are used; none for floats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bits_used: Option<u32>,
    /// Share of the pixels in the zones that are black or white without any difference left; none for floats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub saturated_percent: Option<f64>,
    /// Largest less smallest grey level: 100 % of the residual.
    pub range_grey: f64,
}

/// A node without texture.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NodeWithoutTexture {
    /// Its number.
    pub node: usize,
    /// Column.
    pub x_px: f64,
    /// Row.
    pub y_px: f64,
    /// Why.
    pub reason: String,
}

impl From<&TextureFault> for NodeWithoutTexture {
    fn from(fault: &TextureFault) -> Self {
        Self { node: fault.node, x_px: fault.at[0], y_px: fault.at[1], reason: fault.lack.name().into() }
    }
}

/// One frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameSummary {
    /// Deformed frames count from 1, in series order.
    pub number: usize,
    /// Its file.
    pub file: String,
    /// When it was taken, where its file says so, by the clock of the camera: `2024-05-01T10:11:12.25`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub taken: Option<String>,
    /// Columns and rows of an image that is not as large as the reference.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_px: Option<[u64; 2]>,
    /// Seconds since the first frame of its video.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
    /// How it ended.
    pub status: Status,
    /// What to know about it: why it could not be read, what its file is like, or that tracking lost it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<Remark>,
    /// Number of the frame that it was measured from; absent where that is the reference given.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub reference_frame: usize,
    /// Gauss-Newton iterations on the finest level.
    pub iterations: usize,
    /// Those on the coarser levels.
    pub iterations_coarse: usize,
    /// Largest nodal correction of the last iteration.
    pub correction_px: Option<f64>,
    /// Place of the node of that correction in the reference image.
    pub correction_at_px: Option<[f64; 2]>,
    /// Root mean square of the residual.
    pub residual_grey: Option<f64>,
    /// The same in per cent of the reference's range of grey levels.
    pub residual_percent: Option<f64>,
    /// Rigid motion of all measured nodes.
    pub rigid_motion: Option<RigidSummary>,
    /// Strain of the zone `still`, else of all measured nodes, where it is alike in all directions and places; absent
    /// where it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uniform_strain: Option<f64>,
    /// Zone by zone.
    pub zones: Vec<ZoneSummary>,
    /// Nodes with a result.
    pub nodes_measured: usize,
    /// The same, per cent of those that see texture in the reference. Absent without a field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_percent: Option<f64>,
    /// Nodes without one because they moved out of the image.
    pub nodes_left_image: usize,
    /// Nodes without one because their texture does not stand out of the noise that the residual shows.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub nodes_in_noise: usize,
    /// Nodes whose standard uncertainty is a lower bound: there is little beside noise around them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub nodes_at_noise_bound: usize,
    /// Elements whose pixels do not match (correlation coefficient below 1/2).
    pub elements_poor: usize,
    /// The period of a texture that repeats: the displacement is known but for multiples of it. Absent without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ambiguity: Option<Ambiguity>,
    /// The elements that cannot follow the displacement. Absent when there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<Misfit>,
    /// How many elements are marked, by what is the matter with them; absent where none is.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marked: Vec<Marked>,
    /// What the displacements may be off beyond noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model_error: Option<ModelErrorSummary>,
    /// Bias of the interpolation for displacements along x and y, root mean square over the measured nodes, px: part of the
    /// model error that is alike at all nodes and does not average out. Absent without a field.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolation_bias_px: Option<[f64; 2]>,
    /// The windows of nodes that flatten the strain by far more than noise; absent where none does or none was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flattened: Option<Flattened>,
    /// Share of the pixels in the zones that are black or white without any difference left; none for floats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub saturated_percent: Option<f64>,
    /// Rows or columns of one grey level where the reference has texture; absent of an image that is whole.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blank: Option<Blank>,
    /// What standard uncertainties were multiplied by, x and y, for noise correlated between pixels; absent where 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_correlation_factor: Option<[f64; 2]>,
    /// What the residual says of it; absent where it was not looked for, or too few whole elements are there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_colour: Option<NoiseColourSummary>,
    /// What stays with the camera while the specimen moves: standard deviation `grey`, grey levels, and the `share` (0 to
    /// 1) by which it draws displacements below half a pixel to zero. Absent where it does not show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed_pattern: Option<FixedPattern>,
    /// The noise as it rises with the grey level, `[a, b]` of the variance `a + b grey`; absent unless asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_photon: Option<[f64; 2]>,
    /// Where the iteration started.
    pub start: Option<StartUsed>,
    /// From decoded pixels to the final field with its uncertainty, seconds.
    pub seconds: f64,
    /// Reading and decoding, seconds.
    pub seconds_decode: f64,
    /// Of a frame that a graphics device measured and the CPU checked: how far apart their fields are, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device_checked_px: Option<f64>,
    /// What went to a graphics device and back: `submissions`, `readbacks`, `bytes_up`, `bytes_down`.
    #[serde(flatten)]
    pub traffic: Option<Traffic>,
    /// The device that did the frame, when it is not that of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
}

/// What the residual of a frame says of its noise.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct NoiseColourSummary {
    /// `white`, `correlated`, or `misfit`: the residual is a displacement that is not followed, and does not tell.
    pub verdict: String,
    /// Standard uncertainties, x and y, in those that white noise would give.
    pub factor: [f64; 2],
    /// Standard deviation of the factors.
    pub factor_sigma: f64,
    /// Correlation of neighbouring pixels of the residual along x and y, less that of white noise.
    pub neighbours: [f64; 2],
}

impl From<NoiseColour> for NoiseColourSummary {
    fn from(colour: NoiseColour) -> Self {
        let verdict = match colour.to_apply() {
            _ if colour.is_misfit => "misfit",
            Some(_) => "correlated",
            None => "white",
        };
        let NoiseColour { factor, factor_sigma, neighbours, .. } = colour;
        Self { verdict: verdict.into(), factor, factor_sigma, neighbours }
    }
}

/// What the displacements of a frame may be off beyond noise, beside their standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ModelErrorSummary {
    /// Root mean square of the estimates over the components of the measured nodes.
    pub rms_px: f64,
    /// The largest.
    pub largest_px: f64,
    /// Place of its node in the reference image.
    pub at_px: [f64; 2],
    /// Root mean square of the standard uncertainties, to compare with.
    pub sigma_rms_px: f64,
}

impl ModelErrorSummary {
    fn of(measurement: &Measurement<Px>) -> Option<Self> {
        let model = measurement.model_error.as_ref()?;
        let measured = || (0..model.nodes.len()).filter(|&node| measurement.measured[node]);
        let n = 2.0 * measured().count() as f64;
        let rms = |values: &[[f64; 2]]| (measured().flat_map(|k| values[k]).map(|v| v * v).sum::<f64>() / n).sqrt();
        let larger = |node: usize| model.nodes[node][0].max(model.nodes[node][1]);
        let worst = measured().max_by(|&a, &b| larger(a).total_cmp(&larger(b)))?;
        Some(Self {
            rms_px: rms(&model.nodes),
            largest_px: larger(worst),
            at_px: measurement.mesh.nodes()[worst],
            sigma_rms_px: rms(&measurement.sigma),
        })
    }
}

/// A rigid motion: translation of `centre`, and rotation about it (positive from x to y, y down).
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RigidSummary {
    /// Mean of the reference positions.
    pub centre_px: [f64; 2],
    /// Displacement of the centre.
    pub translation_px: [f64; 2],
    /// Angle, degrees.
    pub rotation_deg: f64,
}

impl From<RigidMotion> for RigidSummary {
    fn from(motion: RigidMotion) -> Self {
        Self {
            centre_px: motion.centre,
            translation_px: motion.translation,
            rotation_deg: motion.rotation_rad.to_degrees(),
        }
    }
}

/// One zone of one frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ZoneSummary {
    /// Its name.
    pub name: String,
    /// How it ended, where that is not `converged`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Status>,
    /// Rigid motion of its measured nodes; absent where none is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rigid_motion: Option<RigidSummary>,
    /// Correlation coefficient of the reference and the deformed image brought back.
    #[serde(deserialize_with = "number")]
    pub correlation: f64,
    /// Root mean square of the residual.
    #[serde(deserialize_with = "number")]
    pub residual_grey: f64,
    /// Noise of one image that the uncertainty is made with.
    #[serde(deserialize_with = "number")]
    pub noise_grey: f64,
    /// What the residual says of that noise; absent where it is where the noise is from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_residual_grey: Option<f64>,
    /// Factor that brings the deformed image to the reference's contrast, `1 + c`.
    #[serde(deserialize_with = "number")]
    pub gain: f64,
    /// Grey levels added after that, `d`.
    #[serde(deserialize_with = "number")]
    pub offset_grey: f64,
    /// Where brightness and contrast are a smooth field, of which `gain` and `offset_grey` are the mean.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<LightSummary>,
}

/// Brightness and contrast of one zone as a smooth field.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct LightSummary {
    /// Nodes of the coarse grid along x and y, between which it is bilinear.
    pub nodes: [usize; 2],
    /// Smallest and largest gain.
    pub gain: [f64; 2],
    /// Smallest and largest offset.
    pub offset_grey: [f64; 2],
    /// Whether it did not come to rest with the displacement; absent where it did.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub unsettled: bool,
}

impl From<SmoothLight> for LightSummary {
    fn from(SmoothLight { nodes, gain, offset, unsettled }: SmoothLight) -> Self {
        Self { nodes, gain, offset_grey: offset, unsettled }
    }
}

/// How far the displacements of the nodes of a series can be trusted: root mean squares over the frame that is known
/// worst.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Trust {
    /// Its number.
    pub frame: usize,
    /// Standard uncertainty.
    pub sigma_px: f64,
    /// Model error.
    pub model_error_px: f64,
    /// Size of the elements, in that of now, at which both would be alike: noise goes with its inverse, what elements do
    /// not follow with its square. Absent where noise is more, or the model error is that of a few elements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element_size_factor: Option<f64>,
}

impl Trust {
    /// Share of its elements, per cent, from which on the model error of a frame is that of the mesh.
    const WIDE_PERCENT: f64 = 20.0;

    /// That of these frames; none where none has a field.
    pub fn of(frames: &[FrameSummary]) -> Option<Self> {
        let known = |model: &ModelErrorSummary| model.sigma_rms_px.hypot(model.rms_px);
        let with = frames.iter().filter_map(|frame| Some((frame, frame.model_error.as_ref()?)));
        let (frame, model) = with.max_by(|a, b| known(a.1).total_cmp(&known(b.1)))?;
        let (sigma_px, model_error_px) = (model.sigma_rms_px, model.rms_px);
        let is_wide = frame.misfit.is_some_and(|misfit| misfit.percent > Self::WIDE_PERCENT);
        let element_size_factor = (is_wide && model_error_px > sigma_px).then(|| (sigma_px / model_error_px).cbrt());
        Some(Self { frame: frame.number, sigma_px, model_error_px, element_size_factor })
    }
}

impl fmt::Display for Trust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { frame, sigma_px, model_error_px, element_size_factor } = self;
        let [known, sigma, model] =
            [sigma_px.hypot(*model_error_px), *sigma_px, *model_error_px].map(|px| significant(px, 2));
        write!(
            f,
            "displacements of measured nodes are known to about {known} px (frame {frame}: standard uncertainty {sigma}, model error \
             {model} px)"
        )?;
        element_size_factor
            .map_or(Ok(()), |factor| write!(f, "; elements {factor:.1} times as large would make both alike"))
    }
}

/// The frame with most misfit, its number first; none where no frame has any.
pub(crate) fn worst_misfit(frames: &[FrameSummary]) -> Option<(usize, Misfit)> {
    let with = frames.iter().filter_map(|frame| Some((frame.number, frame.misfit?)));
    with.max_by(|(_, a), (_, b)| a.percent.total_cmp(&b.percent).then(a.displacement.total_cmp(&b.displacement)))
}

/// Name of the zone of what stays still while the specimen moves: it has no part in the motion of a frame.
pub const STILL: &str = "still";

fn rigid_of(result: &Correlation) -> Option<RigidMotion> {
    let any_still = result.zones.iter().any(|zone| zone.name == STILL);
    let moving = result.zones.iter().find(|zone| zone.name != STILL).filter(|_| any_still);
    moving.map_or(result.rigid, |zone| zone.rigid)
}

fn uniform_strain_of(field: &Measurement<Px>) -> Option<f64> {
    let Measurement { mesh, measured, displacement, .. } = field;
    let still = mesh.zones().iter().position(|zone| zone == STILL);
    let nodes = still.map_or(0..mesh.n_nodes(), |zone| mesh.zone_nodes(zone));
    uniform_strain(nodes.filter(|&node| measured[node]).map(|node| (mesh.nodes()[node], displacement[node])))
}

impl FrameSummary {
    /// A frame that gave no field, because of `why`.
    pub fn unreadable(number: usize, file: String, why: String, seconds_decode: f64) -> Self {
        Self {
            number,
            file,
            taken: None,
            size_px: None,
            time_s: None,
            status: Status::Unreadable,
            remarks: vec![frame_remarks::unreadable(number, why)],
            reference_frame: 0,
            iterations: 0,
            iterations_coarse: 0,
            correction_px: None,
            correction_at_px: None,
            residual_grey: None,
            residual_percent: None,
            rigid_motion: None,
            uniform_strain: None,
            zones: Vec::new(),
            nodes_measured: 0,
            measured_percent: None,
            nodes_left_image: 0,
            nodes_in_noise: 0,
            nodes_at_noise_bound: 0,
            elements_poor: 0,
            ambiguity: None,
            misfit: None,
            marked: Vec::new(),
            model_error: None,
            interpolation_bias_px: None,
            flattened: None,
            saturated_percent: None,
            blank: None,
            noise_correlation_factor: None,
            noise_colour: None,
            fixed_pattern: None,
            noise_photon: None,
            start: None,
            seconds: 0.0,
            seconds_decode,
            device_checked_px: None,
            traffic: None,
            device: None,
        }
    }

    /// The summary of a correlated frame.
    pub fn of(
        number: usize,
        file: String,
        mut remarks: Vec<Remark>,
        reference: &Reference,
        result: &Correlation,
        [seconds, seconds_decode]: [f64; 2],
    ) -> Self {
        // A field that is no measurement is not judged.
        let field = Some(&result.measurement).filter(|field| field.status.has_field());
        // JSON has no infinity: a number that is none is left out.
        let finite = |v: f64| v.is_finite().then_some(v);
        remarks.extend(frame_remarks::of_result(number, result));
        let nodes_measured = result.measurement.measured.iter().filter(|&&m| m).count();
        let with_texture = reference.mesh().n_nodes().saturating_sub(reference.dropped().len());
        let zones = result.zones.iter().map(|zone| ZoneSummary {
            name: zone.name.clone(),
            status: Some(zone.status).filter(|&status| status != Status::Converged),
            rigid_motion: zone.rigid.map(Into::into),
            correlation: zone.correlation,
            residual_grey: zone.residual_rms,
            noise_grey: zone.noise,
            noise_residual_grey: (zone.residual_noise != zone.noise).then_some(zone.residual_noise),
            gain: zone.transfer.gain,
            offset_grey: reference.offset_of(zone.transfer),
            light: zone.light.map(Into::into),
        });
        Self {
            number,
            file,
            taken: None,
            size_px: None,
            time_s: None,
            status: result.measurement.status,
            remarks,
            reference_frame: result.reference_frame,
            iterations: result.iterations,
            iterations_coarse: result.coarse_iterations,
            correction_px: finite(result.correction_px),
            correction_at_px: Some(result.correction_at),
            residual_grey: finite(result.residual_rms),
            residual_percent: finite(result.residual_percent),
            rigid_motion: rigid_of(result).map(Into::into),
            uniform_strain: field.and_then(uniform_strain_of),
            zones: zones.collect(),
            nodes_measured,
            measured_percent: field.map(|_| 100.0 * nodes_measured as f64 / with_texture.max(1) as f64),
            nodes_left_image: result.nodes_left,
            nodes_in_noise: result.nodes_in_noise,
            nodes_at_noise_bound: result.nodes_at_bound,
            elements_poor: result.poor_elements,
            ambiguity: result.ambiguity.clone(),
            misfit: field.and_then(Measurement::misfit),
            marked: result.measurement.marked(),
            model_error: field.and_then(ModelErrorSummary::of),
            interpolation_bias_px: field.map(|_| result.interpolation_bias_px),
            flattened: None,
            saturated_percent: None,
            blank: None,
            noise_correlation_factor: (result.noise_factor != [1.0; 2]).then_some(result.noise_factor),
            noise_colour: result.noise_colour.map(Into::into),
            fixed_pattern: result.noise_colour.and_then(|colour| colour.pattern),
            noise_photon: result.photon_noise.map(|noise| [noise.a, noise.b]),
            start: Some(result.start),
            seconds,
            seconds_decode,
            device_checked_px: result.device_checked_px,
            traffic: result.traffic,
            device: None,
        }
    }
}

impl FrameSummary {
    /// The same with the saturation of the deformed image, which is said when it is much.
    pub fn with_saturation(mut self, found: Option<Saturation>) -> Self {
        self.saturated_percent = found.map(Saturation::percent);
        let about = || About::Frames(vec![self.number]);
        self.remarks.extend(found.and_then(|found| frame_remarks::saturated(about(), found)));
        self
    }

    /// The same with what is not there of the deformed image, which is said; a specimen that was found whole has only
    /// moved off what is blank.
    pub fn with_blank(mut self, found: Option<Blank>) -> Self {
        let is_lost = |marked: &Marked| marked.mark.is_left_out() && marked.mark != ElementMark::NoTexture;
        let is_whole = self.status == Status::Converged && !self.marked.iter().any(is_lost);
        self.blank = found.filter(|_| !is_whole);
        let found = self.blank;
        self.remarks.extend(found.map(|blank| frame_remarks::incomplete(self.number, blank)));
        self
    }
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// The frames that others were measured from, in order.
pub fn reference_updates(frames: &[FrameSummary]) -> Vec<usize> {
    let references = frames.iter().map(|frame| frame.reference_frame).filter(|&frame| frame > 0);
    references.collect::<BTreeSet<_>>().into_iter().collect()
}

/// Number of frames by status.
pub fn counts(frames: &[FrameSummary]) -> BTreeMap<Name, usize> {
    let mut counts = BTreeMap::new();
    for frame in frames {
        *counts.entry(frame.status.name().into()).or_insert(0) += 1;
    }
    counts
}

/// What the endings of names mean.
pub fn units() -> BTreeMap<Name, Name> {
    let units = [
        ("_px", "pixels of the reference image; x right, y down, origin at the centre of the top-left pixel"),
        ("_grey", "grey levels in the scale of the images"),
        ("_percent", "per cent; of residuals: of the reference's range of grey levels"),
        ("_deg", "degrees, positive from x to y (clockwise on the screen)"),
        ("seconds", "seconds of wall-clock time"),
    ];
    units.map(|(ending, meaning)| (ending.into(), meaning.into())).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_frame_is_that_with_most_elements_off_and_of_these_the_one_furthest_off() {
        let frame = |(number, off): (usize, Option<(f64, f64)>)| FrameSummary {
            misfit: off.map(|(percent, displacement)| Misfit { elements: 1, percent, at: [0.0; 2], displacement }),
            ..FrameSummary::unreadable(number, String::new(), String::new(), 0.0)
        };
        let frames = [(1, Some((2.0, 9.0))), (2, Some((30.0, 0.1))), (3, None), (4, Some((30.0, 0.2)))].map(frame);
        assert_eq!(worst_misfit(&frames).map(|(number, _)| number), Some(4));
        assert_eq!(worst_misfit(&frames[2..3]), None);
    }

    #[test]
    fn trust_is_that_of_the_frame_known_worst_and_advises_on_elements_where_most_do_not_follow() {
        let frame = |(number, sigma_rms_px, rms_px, percent): (usize, f64, f64, f64)| FrameSummary {
            model_error: Some(ModelErrorSummary { rms_px, largest_px: 1.0, at_px: [0.0; 2], sigma_rms_px }),
            misfit: Some(Misfit { elements: 1, percent, at: [0.0; 2], displacement: 0.1 }),
            ..FrameSummary::unreadable(number, String::new(), String::new(), 0.0)
        };
        // A crack: a few elements; waves: all of them.
        let crack = [(1, 0.01, 0.002, 0.5), (2, 0.01, 0.08, 5.0)].map(frame);
        let trust = Trust::of(&crack).unwrap();
        assert_eq!((trust.frame, trust.element_size_factor), (2, None));
        let waves = Trust::of(&[frame((1, 0.01, 0.08, 100.0))]).unwrap();
        // Noise 1/0.5 as large, the model error 0.5^2: both 0.02 px.
        assert!((waves.element_size_factor.unwrap() - 0.5).abs() < 1e-12);
        assert!(waves.to_string().contains("known to about 0.081 px"), "{waves}");
        let unreadable = FrameSummary::unreadable(1, String::new(), String::new(), 0.0);
        assert_eq!(Trust::of(&[unreadable]), None);
    }
}
