//! A prepared reference that correlates deformed images with itself.

use super::border::bare_borders;
use super::correlation::{Correlation, StartUsed, ZoneResult, rigid};
use super::error::CorrelationError;
use super::features::Features;
use super::finest::{Finest, finest_level};
use super::gradient_noise::{AssumedNoise, element_lambda, element_matrices, gradient_sums, mass_matrices};
use super::iterate::{Limits, Outcome, Turn, WILD_ELEMENTS, iterate, nothing};
use super::level::Level;
use super::light::{Light, Seen, is_suspected};
use super::marks::Pair;
use super::misfit::{Look, MisfitTest, Residuals};
use super::model_error::{self, MeshLines, model_error};
use super::noise_correlation::{NoiseProbe, Prepared, factors};
use super::noise_model::Elements;
use super::options::Options;
use super::reference::Reference;
use super::reference_noise::{high_frequency, rounding};
use super::screen::{LEAST_LEFT, continued};
use super::start::Start;
use super::texture::{SeenByNode, lost_in_noise};
use super::uncertainty::{NoiseGain, spread_of};
use crate::backend::{Backend, ElementMatch, Found, GreyMap, GreyTransfer, KernelOptions, PixelSums};
use crate::field::{Brightness, ElementMark, Measurement, ModelError, NoiseCorrelation, Status};
use crate::imaging::Image;
use crate::mesh::{Mesh, PixelMesh, PixelSet, Zone};
use crate::units::Px;
use std::ops::Deref;
use std::sync::{Arc, OnceLock};

/// Below this correlation coefficient a zone does not match the reference, whatever the corrections say.
pub(super) const MATCHED: f64 = 0.5;
/// A level that takes more than this from a zone's correlation coefficient has harmed it.
const WORSE: f64 = 0.02;
/// A prediction this far off (px) may have locked on the wrong speckles: the pyramid checks it.
const PREDICTION_OFF_PX: f64 = 1.0;
/// A frame whose corrections stay below this share of it has converged in every sense that matters.
const ENOUGH_BY_SIGMA: f64 = 0.1;
/// Where noise is more than this share of the mean square gradient it slows the iteration down.
const NOISY: f64 = 0.3;
/// A residual of this many times the noise of the reference says that a zone is misfit everywhere: out of focus, a
/// reflection, another light.
const MISFIT_EVERYWHERE: f64 = 3.0;
/// An element is marked as misfit when the mean square of its residual is beyond noise, and this many times that of its zone
/// (a quarter more in amplitude): less is what interpolation, light and compression leave in real images.
const MARKED_RATIO: f64 = 1.5625;
/// A zone so misfit that has lost more than this share of its elements is not found at all.
const CHOSEN_SHARE: f64 = 0.2;
/// On coarse levels: good enough for the next finer one.
pub(super) const COARSE: Limits<'_> = Limits {
    tolerance_px: 0.03,
    enough_px: &[],
    max_iterations: 12,
    wild_elements: WILD_ELEMENTS,
    turn: Turn::NONE,
    own: false,
    regulariser: None,
};
/// The search works on images of about this many pixels a side.
const SEARCH_SIDE: f64 = 320.0;
/// and zones at least this wide there, px.
const SEARCH_ZONE: f64 = 20.0;

/// A reference image prepared for correlation: levels, factors, uncertainty. Frames are correlated
/// independently of each other; see [`super::Tracker`] for a series.
pub struct Correlator<B: Backend> {
    pub(super) backend: B,
    reference: Reference,
    pub(super) levels: Vec<Level<B>>,
    pub(super) search_map: GreyMap,
    /// The reference image, whose points are found when a frame is first looked for in the whole image, and by which it is
    /// named what is the matter with an element.
    pub(super) image: Arc<Image>,
    pub(super) features: OnceLock<Features>,
    /// The shifts at which each zone of the reference looks like itself, found with the first frame.
    pub(super) periods: OnceLock<Vec<Vec<[f64; 2]>>>,
    /// The pixels of each zone that are summed over on the coarsest level.
    pub(super) search_pixels: Vec<PixelSet>,
    pub(super) noise_gain: NoiseGain,
    /// What looks for noise that is not white, if that is wanted and the zones are large enough.
    probe: Option<NoiseProbe>,
    pub(super) misfit_test: MisfitTest,
    mesh_lines: MeshLines,
    enough_px: Vec<f64>,
    /// What the nodes see; none where the noise is stated or a regularisation holds them.
    seen: Vec<SeenByNode>,
    /// Standard deviation of the rounding to integer grey levels.
    rounding: f64,
}

/// What is known of its reference.
impl<B: Backend> Deref for Correlator<B> {
    type Target = Reference;

    fn deref(&self) -> &Reference {
        &self.reference
    }
}

impl<B: Backend> Correlator<B> {
    /// Prepares `reference` for the given zones: meshes, gradients, normal matrices and factors of all
    /// levels, texture check, uncertainty.
    ///
    /// # Errors
    /// Options, zones or texture that do not allow a measurement; a device that fails.
    pub fn new(backend: B, reference: Arc<Image>, zones: &[Zone], options: Options) -> Result<Self, CorrelationError> {
        let (low, high) = reference.range();
        Self::with_offset(backend, reference, zones, options, 0.5 * (low + high))
    }

    /// As [`Correlator::new`], with the grey level that is subtracted from all images of the series.
    pub(super) fn with_offset(
        backend: B,
        reference: Arc<Image>,
        zones: &[Zone],
        options: Options,
        grey_offset: f32,
    ) -> Result<Self, CorrelationError> {
        options.check()?;
        let size = [reference.width(), reference.height()];
        let mut laid = PixelMesh::on_zones(zones, options.element_size, options.element_share, size)?;
        let (low, high) = reference.range();
        let kernel = KernelOptions {
            interpolation: options.interpolation,
            grey_offset,
            brightness: options.brightness.of_sums(),
        };
        if let Some(wanted) = options.noise.fault(f64::from(high)) {
            let value = options.noise.to_string();
            return Err(CorrelationError::Option { name: "the noise", value, wanted });
        }
        let noise = AssumedNoise::of(&reference, &options);
        let noise_gain = NoiseGain::new(options.interpolation, options.n_references);
        let rounding = rounding(&reference);
        let fine = high_frequency(&reference, &laid.mesh) * (options.n_references.max(1) as f64).sqrt();
        let zone_pixels = laid.zone_pixels.clone();
        let mut frame = backend.frame(reference.clone(), &kernel)?;
        let Finest { level, spread, seen, dropped, held } =
            finest_level(&backend, &mut frame, &laid, &noise, &noise_gain, &kernel, &options)?;
        let bare_borders = bare_borders(&reference, &laid.mesh, zones, &level.keep);
        let sigma: Vec<f64> = {
            let at_rest = noise_gain.at_rest();
            let of_one = noise.of_reference * (options.n_references.max(1) as f64).sqrt();
            let sigma_at = |node, c| at_rest.variance(of_one, spread.at(node, c, at_rest.lambda(of_one)), c).sqrt();
            (0..level.keep.len()).map(|node| sigma_at(node, 0).min(sigma_at(node, 1))).collect()
        };
        let kept = level.keep.iter().zip(&sigma).filter(|(keep, _)| **keep);
        let smallest = kept.map(|(_, sigma)| *sigma).fold(f64::INFINITY, f64::min);
        let tolerance_px = match smallest.is_finite() {
            true => options.tolerance_px.max(options.tolerance_by_sigma * smallest),
            false => options.tolerance_px,
        };
        let power: f64 = level.moments.iter().map(|m| gradient_sums(m)[0] + gradient_sums(m)[2]).sum();
        let of_noise: f64 = 2.0 * level.lambda * level.moments.iter().map(|m| m.n).sum::<f64>();
        let enough_px = match of_noise > NOISY * power {
            true => sigma.iter().map(|sigma| ENOUGH_BY_SIGMA * sigma).collect(),
            false => Vec::new(),
        };
        let prepared = Prepared::of(&reference, &kernel, &options, &level, &zone_pixels);
        let probe = (options.noise_correlation == NoiseCorrelation::Auto).then(|| NoiseProbe::new(&prepared)).flatten();
        let mut levels = vec![level];
        for level in 1..=search_level(&laid.mesh) {
            let size = size.map(|n| n >> level);
            let Some(coarse) = laid.halved(options.element_size, size) else { break };
            let coarse_level =
                Level::coarse(&backend, &mut frame, level, &coarse, &noise, &kernel, options.regularisation)?;
            levels[level - 1].link(&backend, &coarse_level.mesh)?;
            levels.push(coarse_level);
            laid = coarse;
        }
        let search_map = backend.grey_map(&mut frame, levels.len() - 1);
        let finest = &levels[0];
        let gradient_noise = options.interpolation.gradient_noise_gain();
        let image = reference;
        let reference = Reference {
            device: backend.device(),
            frames_in_flight: backend.frames_in_flight(),
            options,
            kernel,
            size,
            mesh: finest.mesh.clone(),
            moments: finest.moments.clone(),
            n_levels: levels.len(),
            solver_name: finest.solver.name(),
            is_regularised: finest.regulariser.is_some(),
            zone_pixels,
            spread,
            tolerance_px,
            dropped,
            held,
            bare_borders,
            grey_range: f64::from(high - low),
        };
        Ok(Self {
            noise_gain,
            probe,
            misfit_test: MisfitTest::new(&finest.mesh, &finest.moments, gradient_noise, fine),
            mesh_lines: MeshLines::new(&finest.mesh),
            enough_px,
            seen: if reference.is_regularised || reference.options.noise.constant().is_some() {
                Vec::new()
            } else {
                seen
            },
            rounding,
            backend,
            reference,
            levels,
            search_map,
            image,
            features: OnceLock::new(),
            periods: OnceLock::new(),
            search_pixels: laid.zone_pixels,
        })
    }

    /// The device.
    pub fn backend(&self) -> &B {
        &self.backend
    }

    /// Correlates one deformed image, from `start` on; when it fails, or there is none, the frame is searched for.
    ///
    /// # Errors
    /// An image of another size or without contrast, a start for another mesh, or a device that fails. Not
    /// converging is a result, not an error.
    pub fn correlate(&self, image: Arc<Image>, start: Option<&Start>) -> Result<Correlation, CorrelationError> {
        self.correlate_frame(self.frame(image)?, start)
    }

    /// Brings a deformed image to the device: worth doing while the frame before it is correlated.
    ///
    /// # Errors
    /// An image of another size or without contrast, or a device that fails.
    pub fn frame(&self, image: Arc<Image>) -> Result<B::Frame, CorrelationError> {
        if [image.width(), image.height()] != self.size {
            return Err(CorrelationError::Size {
                width: image.width(),
                height: image.height(),
                reference_width: self.size[0],
                reference_height: self.size[1],
            });
        }
        if image.is_constant() {
            return Err(CorrelationError::Constant { grey: image.grey(0, 0) });
        }
        Ok(self.backend.frame(image, &self.kernel)?)
    }

    /// As [`Correlator::correlate`], for an image that is on the device.
    ///
    /// # Errors
    /// A start for another mesh, or a device that fails.
    pub fn correlate_frame(&self, mut frame: B::Frame, start: Option<&Start>) -> Result<Correlation, CorrelationError> {
        if let Some(Start { displacement, transfer }) = start {
            let (mesh_nodes, mesh_zones) = (self.mesh().n_nodes(), self.mesh().zones().len());
            let (nodes, zones) = (displacement.len(), transfer.len());
            if (nodes, zones) != (mesh_nodes, mesh_zones) {
                return Err(CorrelationError::Start { nodes, zones, mesh_nodes, mesh_zones });
            }
            let attempt = self.follow_prediction(&mut frame, displacement, transfer)?;
            if attempt.measurement.status == Status::Converged {
                return self.told(&mut frame, attempt, Some(displacement));
            }
            let mut best = attempt;
            if best.worst_zone() > MATCHED {
                // A match but for some elements: without them, before it is looked for elsewhere.
                let again = self.second_try(&mut frame, displacement, transfer, StartUsed::Predicted, 0)?;
                best = better(best, again);
            }
            if best.measurement.status != Status::Converged {
                best = better(best, self.search(&mut frame)?);
            }
            return self.told(&mut frame, best, Some(displacement));
        }
        let found = self.search(&mut frame)?;
        self.told(&mut frame, found, None)
    }

    pub(super) fn limits(&self, turn: Turn) -> Limits<'_> {
        Limits {
            tolerance_px: self.tolerance_px,
            enough_px: &self.enough_px,
            max_iterations: self.options.max_iterations,
            wild_elements: WILD_ELEMENTS,
            turn,
            own: false,
            regulariser: None,
        }
    }

    /// How far a field on a level is turned; not at all with regularisation, whose part of a correction is not.
    pub(super) fn turn(&self, level: &Level<B>, displacement: &[[f64; 2]]) -> Turn {
        if self.is_regularised { Turn::NONE } else { Turn::of(&level.mesh, displacement) }
    }

    fn follow_prediction(
        &self,
        frame: &mut B::Frame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<Correlation, CorrelationError> {
        let finest = &self.levels[0];
        let mut field = self.backend.start(&finest.prepared, frame, displacement, transfer)?;
        let limits = self.limits(self.turn(finest, displacement));
        let outcome = iterate(&self.backend, finest, frame, &mut field, limits, &self.kernel, nothing)?;
        let near = outcome.first_correction_px < PREDICTION_OFF_PX && outcome.first_correlation > MATCHED;
        if near {
            let result = self.finish(frame, &mut field, outcome, StartUsed::Predicted, 0, Vec::new())?;
            if result.measurement.status == Status::Converged {
                return Ok(result);
            }
        }
        let mut coarse = displacement.to_vec();
        for pair in self.levels.windows(2) {
            coarse = pair[1].taken_from_finer(&pair[0].mesh, &coarse);
        }
        self.down_the_pyramid(frame, coarse, transfer.to_vec(), StartUsed::PredictedCoarse)
    }

    /// Iterates from the coarsest level to the finest, from `displacement` on the coarsest.
    pub(super) fn down_the_pyramid(
        &self,
        frame: &mut B::Frame,
        displacement: Vec<[f64; 2]>,
        transfer: Vec<GreyTransfer>,
        start: StartUsed,
    ) -> Result<Correlation, CorrelationError> {
        let top = &self.levels[self.levels.len() - 1];
        let turn = self.turn(top, &displacement);
        let mut field = self.backend.start(&top.prepared, frame, &displacement, &transfer)?;
        let mut coarse_iterations = 0;
        for pair in self.levels.windows(2).rev() {
            let [finer, level] = pair else { continue };
            let outcome =
                iterate(&self.backend, level, frame, &mut field, Limits { turn, ..COARSE }, &self.kernel, nothing)?;
            coarse_iterations += outcome.iterations;
            // A coarse level whose texture is gone can only harm: what it made worse stays as it was.
            let moved = outcome.correction_px.is_finite() && outcome.gained >= -WORSE;
            field = self.backend.start_finer(&finer.prepared, frame, &field, moved)?;
        }
        let limits = self.limits(turn);
        let outcome = iterate(&self.backend, &self.levels[0], frame, &mut field, limits, &self.kernel, nothing)?;
        self.finish(frame, &mut field, outcome, start, coarse_iterations, Vec::new())
    }

    /// Whether brightness and contrast may be smooth fields, and whether they are in every frame.
    fn may_be_smooth(&self) -> Option<bool> {
        match self.options.brightness {
            Brightness::Auto => Some(false),
            Brightness::Smooth => Some(true),
            Brightness::Zone | Brightness::Element | Brightness::Off => None,
        }
    }

    /// What an iteration has found; where the light asks for smooth fields, after iterating on with them, for as many
    /// iterations again at most. The fields follow the displacement one iteration late, as the transfers of the zones do.
    fn found(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        outcome: &mut Outcome<B>,
    ) -> Result<(Found, Option<Light>), CorrelationError> {
        let Level { mesh, prepared, moments, .. } = &self.levels[0];
        let found = self.backend.found(prepared, frame, field)?;
        let Some(always) = self.may_be_smooth() else { return Ok((found, None)) };
        let settled = matches!(outcome.status, Status::Converged | Status::IterationLimit);
        if !settled || !(always || is_suspected(mesh, &found.elements, moments)) {
            return Ok((found, None));
        }
        let of_zone = |zone| self.noise_gain.variances(mesh, zone, &found.displacement);
        let variances: Vec<f64> = (0..mesh.zones().len()).flat_map(of_zone).collect();
        let of_reference = self.noise_gain.of_reference();
        let (sums, transfer) = self.backend.element_sums(prepared, frame, field)?;
        let seen = Seen { mesh, sums: &sums, transfer: &transfer, variances: &variances, of_reference };
        let Some(mut light) = Light::found(&seen, always) else { return Ok((found, None)) };
        self.backend.light(prepared, frame, field, light.nodes())?;
        let follow = |frame: &mut B::Frame, field: &mut B::Field| {
            let (sums, transfer) = self.backend.element_sums(prepared, frame, field)?;
            light.follow(&Seen { mesh, sums: &sums, transfer: &transfer, variances: &variances, of_reference });
            self.backend.light(prepared, frame, field, light.nodes())
        };
        let limits = self.limits(outcome.turn);
        let mut more = iterate(&self.backend, &self.levels[0], frame, field, limits, &self.kernel, follow)?;
        more.iterations += outcome.iterations;
        if outcome.status == Status::Converged && more.status != Status::Converged {
            // What was found with one gain and offset per zone is worth more than a field that does not settle.
            outcome.iterations = more.iterations;
            return Ok((found, None));
        }
        more.own = more.own.or(outcome.own.take());
        *outcome = more;
        Ok((self.backend.found(prepared, frame, field)?, Some(light)))
    }

    /// Status, uncertainty and summary of a finished iteration, without the elements that are `excluded` (an empty list
    /// for none) and those that turn out not to match.
    pub(super) fn finish(
        &self,
        frame: &mut B::Frame,
        field: &mut B::Field,
        mut outcome: Outcome<B>,
        start: StartUsed,
        coarse_iterations: usize,
        mut excluded: Vec<bool>,
    ) -> Result<Correlation, CorrelationError> {
        let level = &self.levels[0];
        let mesh = &level.mesh;
        excluded.resize(mesh.n_elements(), false);
        let (mut found, mut light) = self.found(frame, field, &mut outcome)?;
        self.screen(frame, field, &mut outcome, &mut found, light.as_mut(), &mut excluded)?;
        if excluded.contains(&true) {
            found.displacement = continued(mesh, &found.displacement, &found.elements);
        }
        let Found { displacement: full_displacement, zones: last, elements, transfer: transfers } = found;
        let matches = self.zone_matches(&last, &elements);
        let (mut measured, nodes_left) = self.measured_nodes(&elements, &full_displacement, &excluded);
        let mut status = self.judge(&outcome, &elements, &matches, &excluded);
        let own_spread = outcome.own.as_ref().map(|own| {
            let moments = &outcome.own_moments;
            let (matrices, masses) = (element_matrices(moments, &self.kernel), mass_matrices(mesh, moments));
            let lambda = element_lambda(&matrices, &masses, level.lambda);
            spread_of(self.backend.host_isa(), mesh, own, level.regulariser.as_ref(), &masses, &lambda)
        });
        let spread = own_spread.as_ref().unwrap_or(&self.spread);
        let mut sigma = vec![[0.0; 2]; mesh.n_nodes()];
        let mut zones = Vec::new();
        let mut nodes_at_bound = 0;
        let by_grey = Elements {
            mesh,
            moments: &level.moments,
            matched: &elements,
            displacement: &full_displacement,
            transfer: &transfers,
            grey_offset: f64::from(self.kernel.grey_offset),
            gain: &self.noise_gain,
            least: self.rounding * self.rounding,
        };
        let photon_noise = by_grey.photon(self.options.noise);
        let (mut freedom_left, mut of_pair) = (Vec::new(), Vec::new());
        for (zone, name) in mesh.zones().iter().enumerate() {
            let nodes = mesh.zone_nodes(zone);
            let sums = &last[zone];
            let (transfer, smooth) = match &light {
                Some(light) => light.of_zone(mesh, zone, transfers[zone], |transfer| self.offset_of(transfer)),
                None => (transfers[zone], None),
            };
            let of_light = light.as_ref().map_or(0.0, |light| light.unknowns(zone));
            let n_transfers = match self.options.brightness {
                Brightness::Auto | Brightness::Zone | Brightness::Smooth => 1,
                Brightness::Element => mesh.zone_elements(zone).len(),
                Brightness::Off => 0,
            };
            let taken: f64 = nodes.clone().filter(|&node| measured[node]).map(|node| spread.freedom[node]).sum();
            let unknowns = taken + of_light + 2.0 * n_transfers as f64;
            freedom_left.push(1.0 - unknowns / sums.n.max(1.0));
            let by_sums = self.options.brightness.of_sums() == Brightness::Zone && light.is_none();
            let gain = self.noise_gain.of_zone(mesh, zone, &full_displacement, transfer, by_sums.then_some(sums));
            // Identical images still hold the same rounding.
            of_pair.push(gain.residual * freedom_left[zone].max(f64::MIN_POSITIVE));
            let residual_noise = NoiseGain::noise_of_residual(&gain, sums, unknowns).max(self.rounding);
            let given = photon_noise.map(|noise| by_grey.in_zone(zone, noise)).or(self.options.noise.constant());
            let noise = given.unwrap_or(residual_noise);
            for node in nodes.clone().filter(|&node| measured[node]) {
                let at = [0, 1].map(|c| spread.at(node, c, gain.lambda(noise)));
                nodes_at_bound += usize::from(at.iter().any(|at| at.at_bound));
                let variances = [0, 1].map(|c| gain.variance(noise, at[c], c));
                sigma[node] = outcome.turn.variances(variances).map(f64::sqrt);
            }
            zones.push(ZoneResult {
                name: name.clone(),
                rigid: rigid(mesh, &full_displacement, &measured, nodes),
                transfer,
                light: smooth,
                correlation: matches[zone],
                residual_rms: sums.residual_rms(),
                noise,
                residual_noise,
            });
        }
        // What has no finite uncertainty is not measured.
        for (sigma, measured) in sigma.iter_mut().zip(&mut measured) {
            if sigma.iter().any(|sigma| !sigma.is_finite()) {
                (*sigma, *measured) = ([0.0; 2], false);
            }
        }
        let [x, y] = sigma[outcome.worst_node];
        let enough = !self.enough_px.is_empty() && outcome.correction_px < ENOUGH_BY_SIGMA * x.min(y);
        if status == Status::IterationLimit && enough {
            status = Status::Converged;
        }
        let looked_at = status == Status::Converged;
        let noise_colour = self.probe.as_ref().filter(|_| looked_at).and_then(|probe| {
            let image = self.backend.image(frame);
            probe.look(&by_grey, &image, light.as_ref().map(Light::nodes), &freedom_left)
        });
        let noisy =
            |zone: &ZoneResult| zone.residual_noise > MISFIT_EVERYWHERE * self.misfit_test.fine().max(self.rounding);
        // Noise that is known to be correlated, as that of resampled images, shows little in the fine structure.
        let is_coloured = noise_colour.is_some_and(|colour| colour.to_apply().is_some());
        let everywhere: Vec<bool> = zones.iter().map(|zone| noisy(zone) && !is_coloured).collect();
        // What is misfit everywhere is no noise to be lost in.
        let mut in_noise = self.lost_in_noise(&elements, &of_pair, &measured);
        in_noise.retain(|&node| !everywhere[mesh.node_zone()[node] as usize]);
        in_noise.iter().for_each(|&node| (sigma[node], measured[node]) = ([0.0; 2], false));
        if !in_noise.is_empty() {
            for (zone, result) in zones.iter_mut().enumerate() {
                result.rigid = rigid(mesh, &full_displacement, &measured, mesh.zone_nodes(zone));
            }
        }
        let noise_factor = factors(self.options.noise_correlation, noise_colour.as_ref());
        let own_noise = photon_noise.map(|noise| by_grey.by_node(noise));
        for (node, sigma) in sigma.iter_mut().enumerate() {
            let own = own_noise.as_ref().map_or([1.0; 2], |own| own[node]);
            (0..2).for_each(|c| sigma[c] *= own[c] * noise_factor[c]);
        }
        let of_element = if self.options.brightness == Brightness::Element { 2.0 } else { 0.0 };
        let residuals = Residuals {
            elements: &elements,
            displacement: &full_displacement,
            transfer: &transfers,
            freedom: &spread.freedom,
            freedom_of_element: of_element,
            noise: self.options.noise.constant(),
        };
        let excess = self.misfit_test.excess(mesh, &self.noise_gain, &residuals);
        let found = model_error::Found {
            displacement: &full_displacement,
            sigma: &sigma,
            measured: &measured,
            not_followed: &excess.nodes,
            solver: outcome.own.as_deref().unwrap_or(&level.solver),
        };
        let model_error = ModelError { nodes: model_error(&self.mesh_lines, &found), misfit: excess.not_followed };
        if everywhere.iter().enumerate().any(|(zone, &noisy)| noisy && self.has_lost(zone, &excluded)) {
            // What is left after the choice of the best is no match: anything would have some.
            status = Status::Diverged;
        }
        let image = self.backend.image(frame);
        let pair = Pair { reference: &self.image, deformed: &image, mesh, displacement: &full_displacement };
        let looks = self.misfit_test.looks(mesh, &self.noise_gain, &residuals, &excluded, MATCHED);
        let is_misfit =
            |(look, &misfit): (&Option<Look>, &f64)| misfit > 0.0 && look.is_some_and(|look| look.ratio > MARKED_RATIO);
        let misfit: Vec<bool> = looks.iter().zip(&model_error.misfit).map(is_misfit).collect();
        let marks = self.marks(&pair, &elements, &excluded, &misfit, &everywhere);
        let counted: Vec<bool> = elements.iter().map(|e| e.n > 0.0).collect();
        let mut all = PixelSums::default();
        last.iter().for_each(|sums| all.add(sums));
        let displacement =
            full_displacement.iter().zip(&measured).map(|(u, &m)| if m { *u } else { [0.0; 2] }).collect();
        let rigid = rigid(mesh, &full_displacement, &measured, 0..mesh.n_nodes());
        Ok(Correlation {
            measurement: Measurement {
                mesh: mesh.clone(),
                status,
                displacement,
                sigma,
                measured,
                element_residual: elements.iter().map(|e| e.residual_rms).collect(),
                model_error: Some(model_error),
                marks: Some(marks),
            },
            iterations: outcome.iterations,
            coarse_iterations,
            noise_colour,
            noise_factor,
            photon_noise,
            traffic: self.backend.traffic(frame),
            correction_px: outcome.correction_px,
            correction_at: mesh.nodes()[outcome.worst_node],
            residual_rms: all.residual_rms(),
            residual_percent: 100.0 * all.residual_rms() / self.grey_range.max(f64::MIN_POSITIVE),
            rigid,
            zones,
            start,
            nodes_left,
            nodes_in_noise: in_noise.len(),
            nodes_at_bound,
            ambiguity: None,
            poor_elements: elements.iter().filter(|e| e.n > 0.0 && e.correlation < MATCHED).count(),
            reference_frame: 0,
            full_displacement,
            counted,
            worst_node: outcome.worst_node,
        })
    }

    /// How well each zone matches: its correlation coefficient, or what stands for it.
    fn zone_matches(&self, zones: &[PixelSums], elements: &[ElementMatch]) -> Vec<f64> {
        let mesh = self.mesh();
        let match_of = |(zone, sums): (usize, &PixelSums)| match self.options.brightness {
            Brightness::Element => ElementMatch::mean_correlation(&elements[mesh.zone_elements(zone)]),
            // Without a transfer a change of light is misfit, although it correlates.
            Brightness::Off => sums.explained(),
            Brightness::Auto | Brightness::Zone | Brightness::Smooth => sums.correlation(),
        };
        zones.iter().enumerate().map(match_of).collect()
    }

    /// Nodes beside an element that counted and with a finite displacement, and the number of those all of whose elements
    /// have left the image; those that have lost one because it is `excluded` are not among them.
    fn measured_nodes(
        &self,
        elements: &[ElementMatch],
        displacement: &[[f64; 2]],
        excluded: &[bool],
    ) -> (Vec<bool>, usize) {
        let Level { mesh, keep, .. } = &self.levels[0];
        let mut measured = vec![false; mesh.n_nodes()];
        let mut named = vec![false; mesh.n_nodes()];
        for ((nodes, sums), &excluded) in mesh.elements().iter().zip(elements).zip(excluded) {
            for &node in nodes {
                measured[node as usize] |= sums.n > 0.0;
                named[node as usize] |= excluded;
            }
        }
        let left = (0..keep.len()).filter(|&node| keep[node] && !measured[node] && !named[node]).count();
        for (node, measured) in measured.iter_mut().enumerate() {
            *measured &= keep[node] && displacement[node].iter().all(|u| u.is_finite());
        }
        (measured, left)
    }

    /// The measured nodes whose texture does not stand out of the noise that the residual shows. THEORY 2.
    fn lost_in_noise(&self, elements: &[ElementMatch], of_pair: &[f64], measured: &[bool]) -> Vec<usize> {
        if self.seen.is_empty() {
            return Vec::new();
        }
        let gain = self.options.interpolation.gradient_noise_gain() / self.options.n_references.max(1) as f64;
        lost_in_noise(self.mesh(), &self.seen, elements, of_pair, gain, measured)
    }

    /// Whether a zone has lost so many elements that do not match that those left have been chosen.
    fn has_lost(&self, zone: usize, excluded: &[bool]) -> bool {
        let elements = self.mesh().zone_elements(zone);
        let lost = elements.clone().filter(|&element| excluded[element]).count();
        lost as f64 > CHOSEN_SHARE * elements.len() as f64
    }

    /// What is the matter with each element, by name.
    fn marks(
        &self,
        pair: &Pair<'_>,
        elements: &[ElementMatch],
        excluded: &[bool],
        misfit: &[bool],
        everywhere: &[bool],
    ) -> Vec<ElementMark> {
        let Level { mesh, moments, .. } = &self.levels[0];
        let counts = |element: &usize| elements[*element].n > 0.0;
        // What is nearly everywhere in a zone has one name, and is told by all of it.
        let is_wide = |zone: usize| {
            let counted = || mesh.zone_elements(zone).filter(counts);
            let named = counted().filter(|&element| misfit[element]).count();
            everywhere[zone] || 2 * named > counted().count()
        };
        let of_zone = |zone: usize| match is_wide(zone) {
            true if pair.something_is_still(mesh.zone_elements(zone).filter(counts)) => ElementMark::Still,
            true => ElementMark::Misfit,
            false => ElementMark::None,
        };
        let of_zones: Vec<ElementMark> = (0..mesh.zones().len()).map(of_zone).collect();
        let of_element = |element: usize| match (excluded[element], elements[element].n > 0.0) {
            _ if moments[element].n == 0.0 => ElementMark::NoTexture,
            (true, _) => pair.name(element, ElementMark::NoMatch),
            (false, false) => ElementMark::LeftImage,
            (false, true) => {
                let zone = mesh.element_zone()[element] as usize;
                match of_zones[zone] {
                    mark if everywhere[zone] => mark,
                    _ if !misfit[element] => ElementMark::None,
                    ElementMark::None => pair.name(element, ElementMark::Misfit),
                    mark => mark,
                }
            }
        };
        (0..mesh.n_elements()).map(of_element).collect()
    }

    fn judge(&self, outcome: &Outcome<B>, elements: &[ElementMatch], matches: &[f64], excluded: &[bool]) -> Status {
        let Level { mesh, moments, .. } = &self.levels[0];
        let out = (0..mesh.zones().len()).find_map(|zone| {
            let in_use = || mesh.zone_elements(zone).filter(|&element| moments[element].n > 0.0);
            let (all, out) = (in_use().count(), in_use().filter(|&element| elements[element].n == 0.0).count());
            let mismatched = in_use().filter(|&element| excluded[element]).count();
            let is_gone = out as f64 > (1.0 - LEAST_LEFT) * all as f64;
            is_gone.then_some(if 2 * mismatched > out { Status::Diverged } else { Status::LeftImage })
        });
        if let Some(status) = out {
            status
        } else if outcome.status != Status::Diverged && matches.iter().any(|&m| m <= MATCHED) {
            Status::Diverged
        } else {
            outcome.status
        }
    }
}

/// Of two results of one frame the one that tells more: that which converged, else that which matches better, the
/// second where they match alike.
pub(super) fn better(first: Correlation, second: Correlation) -> Correlation {
    let is_better = second.measurement.status == Status::Converged || second.worst_zone() >= first.worst_zone();
    if is_better { second } else { first }
}

/// The number of halvings after which the largest zone is small enough to be searched, as far as the
/// smallest zone stays wide enough.
fn search_level(mesh: &Mesh<Px>) -> usize {
    let (mut longest, mut shortest) = (0.0f64, f64::INFINITY);
    for zone in 0..mesh.zones().len() {
        let bounds = mesh.bounds(zone);
        let (width, height) = (bounds.x1 - bounds.x0, bounds.y1 - bounds.y0);
        longest = longest.max(width.max(height));
        shortest = shortest.min(width.min(height));
    }
    let mut level = 0;
    while longest > SEARCH_SIDE && shortest / 2.0 >= SEARCH_ZONE {
        longest /= 2.0;
        shortest /= 2.0;
        level += 1;
    }
    level
}
