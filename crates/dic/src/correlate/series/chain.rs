//! A series whose reference is renewed: large deformation, measured in stages that are added up (THEORY 2).

use crate::backend::GreyTransfer;
use crate::correlate::{
    Correlate, Correlation, CorrelationError, History, LEAST_LEFT, Options, PointValuesOf, Reference, Result, Start,
    UpdateRefused, Uploaded, ZoneResult, rigid,
};
use crate::field::{ElementMark, Measurement, ModelError, Status, UpdateReference};
use crate::imaging::Image;
use crate::mesh::Mesh;
use crate::units::Px;
use std::sync::Arc;

/// A frame has degraded when the residual of a zone exceeds this many times that of the first frame after the last
/// update. Three quarters of its power are then misfit, and the standard uncertainty, which is made with it, has
/// doubled; an update costs far less.
const DEGRADED: f64 = 2.0;
/// and exceeds this share of the reference's range of grey levels: less may be the noise of any camera.
const NOTICEABLE: f64 = 0.01;

/// A frame has degraded as well when this share more of a zone's elements does not match than did then: what is left
/// matches well.
const MORE_LOST: f64 = 0.05;

/// A frame that may be the reference of others, but for its image: all that a chain knows of the stages before.
#[derive(Debug, Clone, PartialEq)]
pub struct Keyframe {
    /// Its number; numbers start above that of the reference given, which is 0.
    pub frame: usize,
    /// Displacement of every node from the reference given, px; of a node that is lost the last one known.
    pub displacement: Vec<[f64; 2]>,
    /// Which elements it still shows.
    pub elements: Vec<bool>,
    /// Variance of each displacement, px^2 along x and y, but for noise that cancels in frames measured from it.
    pub variance: Vec<[f64; 2]>,
    /// What each displacement may be off beyond noise, px.
    pub model_error: Vec<[f64; 2]>,
    /// What brings its grey levels to those of the reference given, per zone, about the offset of the series.
    pub transfer: Vec<GreyTransfer>,
}

/// All that a [`ReferenceChain`] knows after a frame but for images: with it a run goes on with the same bits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ChainState {
    /// The present reference; `None` for the one that was given.
    pub reference: Option<Keyframe>,
    /// The last converged frame: the next reference, should one be needed, and the start of the next frame.
    pub last: Option<Keyframe>,
    /// The converged frame before it, and its displacement of every node, px.
    pub before: Option<(usize, Vec<[f64; 2]>)>,
    /// What to compare with; `None` until a frame has converged: of each zone the residual, root mean square, grey
    /// levels, and then of each the share of elements that do not match.
    pub baseline: Option<Vec<f64>>,
    /// The frames that have become references, in order.
    pub updates: Vec<usize>,
    /// The last frame that was refused as a reference: it is not tried again.
    pub refused: Option<usize>,
}

impl ChainState {
    /// The frames whose images [`ReferenceChain::resume`] asks for; none of them is 0.
    pub fn frames_needed(&self, update: UpdateReference) -> Vec<usize> {
        let last = self.last.as_ref().filter(|_| update != UpdateReference::Never);
        let mut frames: Vec<usize> = self.reference.iter().chain(last).map(|key| key.frame).collect();
        frames.dedup();
        frames
    }
}

struct Stage {
    key: Keyframe,
    correlator: Box<dyn Correlate>,
    /// Numbers of its nodes and elements in the mesh of the reference given.
    nodes: Vec<usize>,
    elements: Vec<usize>,
}

struct Attempt {
    correlation: Correlation,
    /// The frame as a reference, if it was measured.
    key: Option<Keyframe>,
    /// Per zone, the share of elements that do not match, of those that the reference shows.
    unmatched: Vec<f64>,
}

impl Attempt {
    /// What a reference is renewed by, see [`ChainState::baseline`].
    fn signs(&self) -> Vec<f64> {
        self.correlation.zones.iter().map(|zone| zone.residual_rms).chain(self.unmatched.iter().copied()).collect()
    }
}

/// Correlates the frames of a series in order; one becomes the reference of the next when [`UpdateReference`] says so.
///
/// Whatever its reference, the result of a frame is that of the one given: displacements of the nodes of that mesh,
/// with the uncertainty of the whole way. An update at frame k moves every node by its displacement; elements carry the
/// material that they held, and `u(0 -> n) = u(0 -> k) + u(k -> n)`.
///
/// With [`UpdateReference::Never`] results have the bits of a [`crate::correlate::Tracker`]'s.
///
/// # Going on with a run that was stopped
/// After each frame keep what [`ReferenceChain::state`] gives, with all digits, and the images of the frames that
/// [`ChainState::frames_needed`] names. [`ReferenceChain::resume`] makes a chain of them that gives the same bits.
pub struct ReferenceChain {
    original: Arc<dyn Correlate>,
    update: UpdateReference,
    stage: Option<Stage>,
    history: History,
    last: Option<Keyframe>,
    last_image: Option<Arc<Image>>,
    baseline: Option<Vec<f64>>,
    updates: Vec<usize>,
    /// A stage made of the last converged frame that did not help the frame it was made for.
    spare: Option<Stage>,
    refused: Vec<UpdateRefused>,
    /// The last frame that was refused: it is not tried again.
    unfit: Option<usize>,
    point_values: PointValuesOf,
}

impl ReferenceChain {
    /// A chain that begins with the reference of `original`.
    pub fn new(original: Arc<dyn Correlate>, update: UpdateReference) -> Self {
        Self {
            history: History::new(original.options().start),
            point_values: PointValuesOf::new(original.options(), original.mesh()),
            original,
            update,
            stage: None,
            last: None,
            last_image: None,
            baseline: None,
            updates: Vec::new(),
            spare: None,
            refused: Vec::new(),
            unfit: None,
        }
    }

    /// A chain that goes on after `state` was taken; `image` gives what [`ChainState::frames_needed`] names.
    ///
    /// # Errors
    /// A state for another mesh, an image that is not the reference it should be, a device; those of `image`.
    pub fn resume<E: From<CorrelationError>>(
        original: Arc<dyn Correlate>,
        update: UpdateReference,
        state: ChainState,
        mut image: impl FnMut(usize) -> Result<Arc<Image>, E>,
    ) -> Result<Self, E> {
        state.check(original.mesh())?;
        let mut chain = Self::new(original, update);
        let ChainState { reference, last, before, baseline, updates, refused } = state;
        if let Some(key) = reference {
            let picture = image(key.frame)?;
            if last.as_ref().is_some_and(|last| last.frame == key.frame) {
                chain.last_image = Some(picture.clone());
            }
            let stage = chain.stage_of(key, picture)?.map_err(|refused| CorrelationError::Kept(Box::new(refused)))?;
            chain.stage = Some(stage);
        }
        if let Some(last) = last {
            if update != UpdateReference::Never && chain.last_image.is_none() {
                chain.last_image = Some(image(last.frame)?);
            }
            let fields = [Some((last.frame, last.displacement.clone())), before].into_iter().flatten().collect();
            chain.history = History::of(chain.original.options().start, fields, last.transfer.clone());
            chain.last = Some(last);
        }
        (chain.baseline, chain.updates, chain.unfit) = (baseline, updates, refused);
        Ok(chain)
    }

    /// What to keep, see [`ReferenceChain`].
    pub fn state(&self) -> ChainState {
        ChainState {
            reference: self.stage.as_ref().map(|stage| stage.key.clone()),
            last: self.last.clone(),
            before: self.history.fields().get(1).map(|(number, field)| (*number, field.to_vec())),
            baseline: self.baseline.clone(),
            updates: self.updates.clone(),
            refused: self.unfit,
        }
    }

    /// The correlator of the reference that was given.
    pub fn original(&self) -> &Arc<dyn Correlate> {
        &self.original
    }

    /// Number of the frame that is the reference now; 0 for the one that was given.
    pub fn reference_frame(&self) -> usize {
        self.stage.as_ref().map_or(0, |stage| stage.key.frame)
    }

    /// The frames that have become references, in order.
    pub fn updates(&self) -> &[usize] {
        &self.updates
    }

    /// The frames that should have become references and could not, since the last call.
    pub fn take_refused(&mut self) -> Vec<UpdateRefused> {
        std::mem::take(&mut self.refused)
    }

    /// Correlates frame `number` (numbers must rise, from 1 on).
    ///
    /// # Errors
    /// Another size, no contrast, a device. Not converging, and a refused update ([`Self::take_refused`]), are results.
    pub fn correlate(&mut self, number: usize, image: Arc<Image>) -> Result<Correlation> {
        self.correlate_uploaded(number, self.original.upload(image)?)
    }

    /// As [`ReferenceChain::correlate`], with the image uploaded by [`ReferenceChain::original`].
    ///
    /// # Errors
    /// When the device fails.
    pub fn correlate_uploaded(&mut self, number: usize, frame: Uploaded) -> Result<Correlation> {
        let image = frame.image().clone();
        if let UpdateReference::Every(frames) = self.update
            && self.last.as_ref().is_some_and(|last| last.frame >= self.reference_frame() + frames.get())
            && let Some(stage) = self.next_stage()?
        {
            self.adopt(stage);
        }
        let mut attempt = self.attempt(self.stage.as_ref(), number, frame)?;
        if self.update == UpdateReference::Residual && self.has_degraded(&attempt) {
            attempt = self.try_again(number, &image, attempt)?;
        }
        let signs = attempt.signs();
        let Attempt { correlation, key, .. } = attempt;
        self.history.note(number, &correlation);
        if let Some(key) = key {
            self.baseline.get_or_insert(signs);
            self.last = Some(key);
            self.last_image = (self.update != UpdateReference::Never).then_some(image);
            self.spare = None;
        }
        Ok(correlation)
    }

    /// Whether the present reference has served its time. A zone that has left the image does not come back by another.
    fn has_degraded(&self, attempt: &Attempt) -> bool {
        match attempt.correlation.measurement.status {
            Status::IterationLimit | Status::Diverged => true,
            Status::Converged | Status::PartlyLost => {
                let grey_range = self.stage.as_ref().map_or(&*self.original, |stage| &*stage.correlator).grey_range();
                let n_zones = self.original.mesh().zones().len();
                let beyond = |(at, (now, then)): (usize, (f64, &f64))| match at < n_zones {
                    true => now > (DEGRADED * then).max(NOTICEABLE * grey_range),
                    false => now > then + MORE_LOST,
                };
                let baseline = self.baseline.iter().flatten();
                attempt.signs().into_iter().zip(baseline).enumerate().any(beyond)
            }
            // Another reference repeats itself as this one does.
            Status::LeftImage | Status::Unreadable | Status::Ambiguous => false,
        }
    }

    /// Correlates the frame once more, with the last converged one as the reference, and keeps what is better.
    fn try_again(&mut self, number: usize, image: &Arc<Image>, first: Attempt) -> Result<Attempt> {
        let Some(stage) = self.next_stage()? else { return Ok(first) };
        let frame = self.original.upload(image.clone())?;
        let second = self.attempt(Some(&stage), number, frame)?;
        let n_zones = self.original.mesh().zones().len();
        let worst = |attempt: &Attempt| {
            let signs = attempt.signs();
            let largest = |signs: &[f64]| signs.iter().copied().fold(0.0, f64::max);
            [largest(&signs[n_zones..]), largest(&signs[..n_zones])]
        };
        let ([lost, residual], [lost_first, residual_first]) = (worst(&second), worst(&first));
        let is_better = lost < lost_first || (lost == lost_first && residual < residual_first);
        let helped = second.key.is_some() && (first.key.is_none() || is_better);
        if helped {
            self.adopt(stage);
            return Ok(second);
        }
        if first.key.is_some() {
            // It is the frame that has changed, not the reference that has aged: what follows is compared with it.
            self.baseline = Some(first.signs());
        } else {
            self.spare = Some(stage);
        }
        Ok(first)
    }

    fn adopt(&mut self, stage: Stage) {
        self.updates.push(stage.key.frame);
        self.stage = Some(stage);
        self.baseline = None;
    }

    /// The last converged frame as a reference, if it is a later one than the present and fit to be one.
    fn next_stage(&mut self) -> Result<Option<Stage>> {
        if let Some(spare) = self.spare.take() {
            return Ok(Some(spare));
        }
        let (Some(key), Some(image)) = (self.last.clone(), self.last_image.clone()) else { return Ok(None) };
        if key.frame <= self.reference_frame() || self.unfit == Some(key.frame) {
            return Ok(None);
        }
        Ok(match self.stage_of(key, image)? {
            Ok(stage) => Some(stage),
            Err(refused) => {
                self.unfit = Some(refused.frame());
                self.refused.push(refused);
                None
            }
        })
    }

    fn stage_of(&self, key: Keyframe, image: Arc<Image>) -> Result<Result<Stage, UpdateRefused>> {
        let (mesh, original, frame) = (self.original.mesh(), &self.original, key.frame);
        let moved: Vec<[f64; 2]> =
            mesh.nodes().iter().zip(&key.displacement).map(|(x, u)| [x[0] + u[0], x[1] + u[1]]).collect();
        let [width, height] = original.size().map(|n| n as f64);
        let inside = |p: [f64; 2]| p[0] >= -0.5 && p[1] >= -0.5 && p[0] <= width && p[1] <= height;
        let shown = |element: usize| mesh.elements()[element].iter().all(|&node| inside(moved[node as usize]));
        let kept: Vec<bool> = (0..mesh.n_elements()).map(|element| key.elements[element] && shown(element)).collect();
        for (zone, name) in mesh.zones().iter().enumerate() {
            let n_elements = mesh.zone_elements(zone).filter(|&element| original.in_use(element)).count();
            let left = mesh.zone_elements(zone).filter(|&element| kept[element]).count();
            if left == 0 || (left as f64) < LEAST_LEFT * n_elements as f64 {
                return Ok(Err(UpdateRefused::LeftImage { frame, zone: name.clone(), left, of: n_elements }));
            }
        }
        let carried = mesh.carried(&original.zone_pixels, &moved, &kept, original.size());
        let prepared = carried.map_err(CorrelationError::from).and_then(|carried| {
            // A node that is left out does not come back: rather no new reference than one that loses nodes.
            let options = Options { n_references: 1, textureless_share: 0.0, ..original.options().clone() };
            let correlator = original.with_reference(image, &carried.zones, options)?;
            Ok(Stage { key, correlator, nodes: carried.nodes, elements: carried.elements })
        });
        match prepared {
            Ok(stage) => Ok(Ok(stage)),
            Err(CorrelationError::Backend(error)) => Err(error.into()),
            Err(source) => Ok(Err(UpdateRefused::Unfit { frame, source })),
        }
    }

    /// Correlates a frame with the reference of `stage`, or with the one that was given.
    fn attempt(&self, stage: Option<&Stage>, number: usize, frame: Uploaded) -> Result<Attempt> {
        let start = self.history.predict(number, self.original.mesh());
        let Some(stage) = stage else {
            let found = self.original.correlate_uploaded(frame, start.as_ref())?;
            let of_reference = 1.0 - 1.0 / self.original.options().noise_of_both();
            let nothing = vec![[0.0; 2]; self.original.mesh().n_nodes()];
            let key = found.measurement.status.is_measured().then(|| Keyframe {
                frame: number,
                displacement: found.full_displacement.clone(),
                elements: shown_elements(&found),
                variance: carried_variance(&self.original, &found, &nothing, of_reference),
                model_error: found.model_error().nodes.clone(),
                transfer: found.zones.iter().map(|zone| zone.transfer).collect(),
            });
            let unmatched = unmatched(&found);
            return Ok(Attempt { correlation: found, key, unmatched });
        };
        let start = start.map(|start| stage.start(&start));
        let found = stage.correlator.correlate_uploaded(frame, start.as_ref())?;
        Ok(self.compose(stage, number, found))
    }

    /// The result of a frame on the mesh of the reference that was given.
    fn compose(&self, stage: &Stage, number: usize, found: Correlation) -> Attempt {
        let mesh = self.original.mesh();
        let (key, unmatched) = (&stage.key, unmatched(&found));
        let transfer: Vec<GreyTransfer> =
            key.transfer.iter().zip(&found.zones).map(|(before, zone)| concatenate(zone.transfer, *before)).collect();
        let on_stage: Vec<[f64; 2]> = stage.nodes.iter().map(|&node| key.variance[node]).collect();
        let gradients = nodal_gradients(&found);
        let mut displacement = vec![[0.0; 2]; mesh.n_nodes()];
        let mut full_displacement = key.displacement.clone();
        let mut sigma = vec![[0.0; 2]; mesh.n_nodes()];
        let mut measured = vec![false; mesh.n_nodes()];
        // The bias of every stage adds to that of those before.
        let of_stage = found.model_error();
        let mut model_error = ModelError { nodes: key.model_error.clone(), misfit: vec![0.0; mesh.n_elements()] };
        let shares = stage.correlator.noise_shares(&found);
        for (own, &node) in stage.nodes.iter().enumerate() {
            let u = found.full_displacement[own];
            full_displacement[node] = [0, 1].map(|c| key.displacement[node][c] + u[c]);
            if !found.measurement.measured[own] {
                continue;
            }
            [0, 1].iter().for_each(|&c| model_error.nodes[node][c] += of_stage.nodes[own][c]);
            measured[node] = true;
            displacement[node] = full_displacement[node];
            let carried = map_variance(gradients[own], on_stage[own]);
            let share = shares[mesh.node_zone()[node] as usize];
            // Half of the stage's variance is the noise of its reference, of which only this share is new.
            sigma[node] =
                [0, 1].map(|c| (carried[c] + 0.5 * (1.0 + share) * found.measurement.sigma[own][c].powi(2)).sqrt());
        }
        let (mut counted, mut element_residual) = (vec![false; mesh.n_elements()], vec![0.0; mesh.n_elements()]);
        // What a reference before has not shown any more it does not show of this frame either.
        let size = self.original.size().map(|n| n as f64);
        let lost = |element: usize| {
            let out = mesh.elements()[element].iter().any(|&node| {
                let (x, u) = (mesh.nodes()[node as usize], full_displacement[node as usize]);
                (0..2).any(|c| !(-0.5..=size[c]).contains(&(x[c] + u[c])))
            });
            match (self.original.in_use(element), out) {
                (false, _) => ElementMark::NoTexture,
                (true, true) => ElementMark::LeftImage,
                (true, false) => ElementMark::NoMatch,
            }
        };
        let mut marks: Vec<ElementMark> = (0..mesh.n_elements()).map(lost).collect();
        for (own, &element) in stage.elements.iter().enumerate() {
            marks[element] = found.measurement.marks.as_ref().map_or(ElementMark::None, |marks| marks[own]);
            counted[element] = found.counted[own];
            element_residual[element] = found.measurement.element_residual[own];
            model_error.misfit[element] = of_stage.misfit[own];
        }
        let status = match found.measurement.status {
            Status::Converged | Status::PartlyLost | Status::IterationLimit if self.has_left(&counted) => {
                Status::LeftImage
            }
            status => status,
        };
        let next = status.is_measured().then(|| {
            let variance = carried_variance(&stage.correlator, &found, &on_stage, 0.0);
            let mut all = key.variance.clone();
            stage.nodes.iter().zip(variance).for_each(|(&node, variance)| all[node] = variance);
            let shown = shown_elements(&found);
            let mut elements = vec![false; mesh.n_elements()];
            stage.elements.iter().zip(shown).for_each(|(&element, shown)| elements[element] = shown);
            let (displacement, transfer) = (full_displacement.clone(), transfer.clone());
            let model_error = model_error.nodes.clone();
            Keyframe { frame: number, displacement, elements, variance: all, model_error, transfer }
        });
        for (error, _) in model_error.nodes.iter_mut().zip(&measured).filter(|(_, measured)| !**measured) {
            *error = [0.0; 2];
        }

        let n_measured = measured.iter().filter(|&&measured| measured).count();
        let elsewhere = self.original.dropped.len() + n_measured + found.nodes_in_noise;
        let zones = found.zones.into_iter().zip(&transfer).enumerate().map(|(zone, (found, &transfer))| ZoneResult {
            rigid: rigid(mesh, &full_displacement, &measured, mesh.zone_nodes(zone)),
            transfer,
            ..found
        });
        let correlation = Correlation {
            zones: zones.collect(),
            rigid: rigid(mesh, &full_displacement, &measured, 0..mesh.n_nodes()),
            correction_at: mesh.nodes()[stage.nodes[found.worst_node]],
            worst_node: stage.nodes[found.worst_node],
            left_out: found.left_out.iter().map(|&element| stage.elements[element as usize] as u32).collect(),
            nodes_left: mesh.n_nodes().saturating_sub(elsewhere),
            reference_frame: key.frame,
            measurement: Measurement {
                mesh: mesh.clone(),
                status,
                displacement,
                sigma,
                measured,
                element_residual,
                model_error: Some(model_error),
                marks: Some(marks),
                points: None,
            },
            full_displacement,
            counted,
            ..found
        };
        let correlation = self.point_values.add_to(correlation).concluded(self.original.dropped.len());
        Attempt { correlation, key: next, unmatched }
    }

    /// Whether a zone has lost too many of the elements that it had in the reference given.
    fn has_left(&self, counted: &[bool]) -> bool {
        let mesh = self.original.mesh();
        (0..mesh.zones().len()).any(|zone| {
            let n_elements = mesh.zone_elements(zone).filter(|&element| self.original.in_use(element)).count();
            let left = mesh.zone_elements(zone).filter(|&element| counted[element]).count();
            ((n_elements - left.min(n_elements)) as f64) > (1.0 - LEAST_LEFT) * n_elements as f64
        })
    }
}

impl Stage {
    /// A start that belongs to the reference given, as one that belongs to this.
    fn start(&self, start: &Start) -> Start {
        let own = |&node: &usize| [0, 1].map(|c| start.displacement[node][c] - self.key.displacement[node][c]);
        Start::new(
            self.nodes.iter().map(own).collect(),
            start.transfer.iter().zip(&self.key.transfer).map(|(all, first)| rest_after(*all, *first)).collect(),
        )
    }
}

impl ChainState {
    /// Whether it can be that of a chain on `mesh`.
    ///
    /// # Errors
    /// [`CorrelationError::State`] with the first list of another length.
    pub fn check(&self, mesh: &Mesh<Px>) -> Result<()> {
        let check = |what, given: usize, wanted: usize| {
            if given == wanted { Ok(()) } else { Err(CorrelationError::State { what, given, wanted }) }
        };
        for key in self.reference.iter().chain(&self.last) {
            check("displacements", key.displacement.len(), mesh.n_nodes())?;
            check("variances", key.variance.len(), mesh.n_nodes())?;
            check("model errors", key.model_error.len(), mesh.n_nodes())?;
            check("elements", key.elements.len(), mesh.n_elements())?;
            check("grey transfers", key.transfer.len(), mesh.zones().len())?;
        }
        if let Some((_, before)) = &self.before {
            check("displacements", before.len(), mesh.n_nodes())?;
        }
        if let Some(baseline) = &self.baseline {
            check("residuals", baseline.len(), 2 * mesh.zones().len())?;
        }
        Ok(())
    }
}

/// `second` and then `first`, as one transfer.
fn concatenate(second: GreyTransfer, first: GreyTransfer) -> GreyTransfer {
    GreyTransfer { gain: first.gain * second.gain, offset: first.gain * second.offset + first.offset }
}

/// What is left of `all` after `first`: `after(rest(all, first), first)` is `all`.
fn rest_after(all: GreyTransfer, first: GreyTransfer) -> GreyTransfer {
    GreyTransfer { gain: all.gain / first.gain, offset: (all.offset - first.offset) / first.gain }
}

fn unmatched(found: &Correlation) -> Vec<f64> {
    let mesh = &found.measurement.mesh;
    let mut shares = vec![0.0; mesh.zones().len()];
    for &element in &found.left_out {
        shares[mesh.element_zone()[element as usize] as usize] += 1.0;
    }
    shares.iter().enumerate().map(|(zone, n)| n / mesh.zone_elements(zone).len().max(1) as f64).collect()
}

/// The elements that counted and whose nodes were all measured.
fn shown_elements(found: &Correlation) -> Vec<bool> {
    let Measurement { mesh, measured, .. } = &found.measurement;
    let shown = |(nodes, &counted): (&[u32; 4], &bool)| counted && nodes.iter().all(|&node| measured[node as usize]);
    mesh.elements().iter().zip(&found.counted).map(shown).collect()
}

/// The variance of the nodes in a frame, px^2, but for what cancels when it becomes the reference (THEORY 2): that of
/// their positions in the reference, `before`, and the share `of_reference` of that found here, both turned and
/// stretched by the deformation; and what the noise of the gradient makes of the frame's own.
fn carried_variance(
    reference: &Reference,
    found: &Correlation,
    before: &[[f64; 2]],
    of_reference: f64,
) -> Vec<[f64; 2]> {
    let both = reference.options().noise_of_both();
    let shares = reference.noise_shares(found);
    let Measurement { mesh, sigma, .. } = &found.measurement;
    let of_node = |(node, gradient): (usize, [[f64; 2]; 2])| {
        let own = sigma[node].map(|sigma| sigma * sigma);
        let moved = map_variance(gradient, [0, 1].map(|c| before[node][c] + of_reference * own[c]));
        let share = shares[mesh.node_zone()[node] as usize];
        [0, 1].map(|c| moved[c] + share * own[c] / both)
    };
    nodal_gradients(found).into_iter().enumerate().map(of_node).collect()
}

/// `F diag(variance) F^T` on its diagonal: the two components of a node are taken to be uncorrelated.
fn map_variance(f: [[f64; 2]; 2], variance: [f64; 2]) -> [f64; 2] {
    f.map(|row| row[0] * row[0] * variance[0] + row[1] * row[1] * variance[1])
}

/// The deformation gradient `F = I + grad u` at the nodes: the mean of the middles of the elements around that counted.
fn nodal_gradients(found: &Correlation) -> Vec<[[f64; 2]; 2]> {
    const NONE: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];
    let mesh = &found.measurement.mesh;
    let mut sums = vec![([[0.0; 2]; 2], 0.0); mesh.n_nodes()];
    for (element, nodes) in mesh.elements().iter().enumerate().filter(|(element, _)| found.counted[*element]) {
        let minus = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
        let [a, b, c, d] = mesh.corners(element);
        let [ua, ub, uc, ud] = nodes.map(|node| found.full_displacement[node as usize]);
        // Both diagonals before and after: in the middle F maps the ones to the others.
        let (p, q) = (minus(c, a), minus(d, b));
        let (up, uq) = (minus(uc, ua), minus(ud, ub));
        let area = p[0] * q[1] - p[1] * q[0];
        let gradient = [0, 1].map(|k| {
            let (by_x, by_y) = ((up[k] * q[1] - uq[k] * p[1]) / area, (uq[k] * p[0] - up[k] * q[0]) / area);
            [NONE[k][0] + by_x, NONE[k][1] + by_y]
        });
        // Of a triangle the last corner is there twice.
        let corners = if nodes[2] == nodes[3] { 3 } else { 4 };
        for &node in &nodes[..corners] {
            let (sum, n) = &mut sums[node as usize];
            *n += 1.0;
            (0..4).for_each(|k| sum[k / 2][k % 2] += gradient[k / 2][k % 2]);
        }
    }
    sums.into_iter().map(|(sum, n)| if n > 0.0 { sum.map(|row| row.map(|v| v / n)) } else { NONE }).collect()
}
