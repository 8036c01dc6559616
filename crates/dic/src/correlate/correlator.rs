//! A prepared reference that correlates deformed images with itself.

use crate::backend::{Backend, GreyMap, GreyTransfer, KernelOptions};
use crate::correlate::{
    AssumedNoise, BendTest, Correlation, CorrelationError, Enough, Features, Finest, HotPixels, InterpolationBias,
    Iterated, LeftOut, Level, Limits, MATCHED, MeshLines, MisfitTest, NodalSpread, NoiseGain, NoiseProbe, Options,
    Overlap, PointValuesOf, Prepared, Reference, Regularisation, Result, SeenByNode, Settled, Start, StartUsed, Turn,
    WILD_ELEMENTS, bare_borders, choose_better, elements_of, finest_level, high_frequency, iterate, named, nothing,
    numbers, replace_outliers, rounding, smooth_reference,
};
use crate::field::{NoiseCorrelation, Status};
use crate::imaging::Image;
use crate::mesh::{Mesh, PixelMesh, PixelSet, Zone};
use crate::units::Px;
use std::collections::BTreeSet;
use std::ops::{Deref, RangeInclusive};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// A level that takes more than this from a zone's correlation coefficient has harmed it.
const WORSE: f64 = 0.02;
/// Ranges of grey levels of which products, summed over millions of pixels, are numbers of single precision.
const GREY_LEVELS: RangeInclusive<f64> = 1e-12..=1e12;
/// A prediction this far off (px) at more than a few nodes may have locked on the wrong speckles: the pyramid checks
/// it.
const PREDICTION_OFF_PX: f64 = 1.0;
/// A few nodes: this share of a zone's, which noise may have put anywhere; and where elements did not match in the
/// frame before, beside which there may be more of them.
const FEW_FAR: [f64; 2] = [1e-3, 1e-2];
/// Where more than this share of the elements does not match that did in the frame before, it is looked for with all of
/// them, and elsewhere.
const FEW_MORE: f64 = 0.05;
/// A frame whose corrections stay below this share of it has converged in every sense that matters.
const ENOUGH_BY_SIGMA: f64 = 0.1;
/// A node less certain than this, px, counts as noisy: it may find no rest where the grey levels do not run straight
/// over its uncertainty.
const UNSURE_PX: f64 = 0.1;
/// On coarse levels: good enough for the next finer one.
pub(super) const COARSE: Limits<'_> = Limits {
    tolerance_px: 0.03,
    enough: &[],
    max_iterations: 12,
    wild_elements: WILD_ELEMENTS,
    turn: Turn::NONE,
    late_light: false,
    near_px: f64::INFINITY,
    few_far: 0.0,
    own: false,
    enough_anywhere: false,
    regulariser: None,
};
/// Elements of coarse levels are at least so large, px of the level: smaller ones are lost in noise, or astray at
/// borders, and larger ones do not follow what the smallest of the finest level can.
const COARSE_ELEMENTS_PX: usize = 8;
/// The search works on images of about this many pixels a side.
const SEARCH_SIDE: f64 = 320.0;
/// and zones at least this wide there, px.
const SEARCH_ZONE: f64 = 20.0;

/// A reference image prepared for correlation. Frames are independent; see [`crate::correlate::Tracker`] for a series.
pub struct Correlator<B: Backend> {
    pub(super) backend: B,
    reference: Reference,
    pub(super) levels: Vec<Level<B>>,
    pub(super) search_map: GreyMap,
    /// The reference image: elements are named by it, and its points are found when a frame is looked for in all of it.
    pub(super) image: Arc<Image>,
    hot_pixels: HotPixels,
    pub(super) features: OnceLock<Features>,
    /// The shifts at which each zone of the reference looks like itself, found with the first frame.
    pub(super) periods: OnceLock<Vec<Vec<[f64; 2]>>>,
    pub(super) cut_nodes: OnceLock<BTreeSet<usize>>,
    /// Whether the field of the last frame was that of its first iteration, so that the next one is told as soon:
    /// whether it is told too soon changes what is done twice, and no result.
    ends_as_iterated: AtomicBool,
    point_values: PointValuesOf,
    /// The pixels of each zone that are summed over on the coarsest level.
    pub(super) search_pixels: Vec<PixelSet>,
    pub(super) noise_gain: NoiseGain,
    /// None where noise that is not white is not looked for, or the zones are too small.
    pub(super) probe: Option<NoiseProbe>,
    pub(super) misfit_test: MisfitTest,
    pub(super) bend_test: BendTest,
    pub(super) mesh_lines: MeshLines,
    pub(super) interpolation_bias: InterpolationBias,
    /// See [`Limits::enough`].
    pub(super) enough: Vec<Enough>,
    /// What the nodes see; none where the noise is stated or they are held.
    pub(super) seen: Vec<SeenByNode>,
    /// Standard deviation of the rounding to integer grey levels.
    pub(super) rounding: f64,
}

/// What is prepared for every level of a reference.
fn kernel_of(reference: &Image, options: &Options, grey_offset: f32) -> Result<KernelOptions> {
    let (low, high) = reference.range();
    let range = f64::from(high) - f64::from(low);
    // A reference without any has no texture, which is said for its nodes.
    if range != 0.0 && !GREY_LEVELS.contains(&range) {
        return Err(CorrelationError::GreyLevels(range));
    }
    if let Some(wanted) = options.noise.fault(f64::from(high)) {
        let value = options.noise.to_string();
        return Err(CorrelationError::Option { name: "the noise", value, wanted });
    }
    let kernel = KernelOptions::new((low, high), options.interpolation, options.brightness.of_sums());
    Ok(KernelOptions { grey_offset, ..kernel })
}

/// Prepares the levels of an image of `size` px that are coarser than the one `laid`, from the finer to the coarser
/// ones; returns them with the pixels of each zone on the coarsest level there is.
fn coarse_levels<B: Backend>(
    backend: &B,
    frame: &mut B::Frame,
    mut laid: PixelMesh,
    size: [usize; 2],
    noise: &AssumedNoise,
    kernel: &KernelOptions,
    options: &Options,
) -> Result<(Vec<Level<B>>, Vec<PixelSet>)> {
    let mut levels = Vec::new();
    for level in 1..=search_level(&laid.mesh) {
        let size = size.map(|n| n >> level);
        let size_there = options.element_size.max(COARSE_ELEMENTS_PX);
        let Some(coarse) = laid.halved(size_there, size) else { break };
        levels.push(Level::coarse(backend, frame, level, &coarse, noise, kernel, options.regularisation)?);
        laid = coarse;
    }
    Ok((levels, laid.zone_pixels))
}

/// Computes the smaller standard uncertainty of each node, px, that the noise of the reference gives both images.
fn assumed_sigma(noise: &AssumedNoise, gain: &NoiseGain, spread: &NodalSpread, n_references: usize) -> Vec<f64> {
    let at_rest = gain.at_rest();
    let of_one = noise.of_reference * (n_references.max(1) as f64).sqrt();
    let sigma_at = |node, c| at_rest.variance(of_one, spread.at(node, c, at_rest.lambda(of_one)), c).sqrt();
    (0..spread.variance.len()).map(|node| sigma_at(node, 0).min(sigma_at(node, 1))).collect()
}

/// The correction, px, at which an iteration has converged.
fn tolerance_px<B: Backend>(options: &Options, level: &Level<B>, sigma: &[f64]) -> f64 {
    let kept = level.keep.iter().zip(sigma).filter(|(keep, _)| **keep);
    let smallest = kept.map(|(_, sigma)| *sigma).fold(f64::INFINITY, f64::min);
    match smallest.is_finite() {
        true => options.tolerance_px.max(options.tolerance_by_sigma * smallest),
        false => options.tolerance_px,
    }
}

/// See [`Limits::enough`].
fn enough_by_node<B: Backend>(level: &Level<B>, seen: &[SeenByNode], sigma: &[f64]) -> Vec<Enough> {
    let is_noisy = |node: usize| {
        level.lambda > 0.0 && level.keep[node] && (seen[node].is_noisy(level.lambda) || sigma[node] > UNSURE_PX)
    };
    let of_node = |node: usize| Enough { px: ENOUGH_BY_SIGMA * sigma[node], is_noisy: is_noisy(node) };
    (0..seen.len()).map(of_node).collect()
}

/// All levels from the finest on, each with what leads to the next.
fn link<B: Backend>(backend: &B, finest: Level<B>, coarse: Vec<Level<B>>) -> Result<Vec<Level<B>>> {
    let mut levels = vec![finest];
    for coarse in coarse {
        if let Some(finer) = levels.last_mut() {
            finer.link(backend, &coarse.mesh)?;
        }
        levels.push(coarse);
    }
    Ok(levels)
}

impl<B: Backend> Deref for Correlator<B> {
    type Target = Reference;

    fn deref(&self) -> &Reference {
        &self.reference
    }
}

impl<B: Backend> Correlator<B> {
    /// Prepares `reference` for the given zones.
    ///
    /// # Errors
    /// Options, zones or texture that do not allow a measurement; a device that fails.
    pub fn new(backend: B, reference: Arc<Image>, zones: &[Zone], options: Options) -> Result<Self> {
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
    ) -> Result<Self> {
        options.check()?;
        let size = [reference.width(), reference.height()];
        let laid = PixelMesh::on_zones(zones, options.mesh_size(), options.element_share, size)?;
        let zone_pixels = laid.zone_pixels.clone();
        let hot_pixels = HotPixels::of(&reference);
        let n_hot_pixels = hot_pixels.count(|x, y| zone_pixels.iter().any(|zone| zone.contains(x, y)));
        let reference = hot_pixels.repair(reference);
        let kernel = kernel_of(&reference, &options, grey_offset)?;
        let ((noise, fine), mut noise_gain) = rayon::join(
            || (AssumedNoise::of(&reference, &zone_pixels, &options), high_frequency(&reference, &zone_pixels)),
            || NoiseGain::new(options.interpolation, options.n_references),
        );
        let smoothed = smooth_reference(&reference, &laid.pixels, &noise, options.interpolation);
        let (coarse_kernel, smoothed) = (kernel, smoothed.as_ref());
        let smoothing_px = smoothed.map_or(0.0, |smoothed| smoothed.width_px);
        let kernel = smoothed.map_or(kernel, |smoothed| smoothed.kernel(kernel));
        noise_gain.gradient = kernel.gradient_noise_gain;
        let smoothed = smoothed.map(|smoothed| &smoothed.image);
        let rounding = rounding(&reference);
        let fine = fine * (options.n_references.max(1) as f64).sqrt();
        let mut frame = backend.frame(reference.clone(), &kernel.of_gradient())?;
        let Finest { level, spread, seen, dropped, held } =
            finest_level(&backend, &mut frame, (&laid, smoothed), &noise, &noise_gain, &kernel, &options)?;
        let bend_test = BendTest::new(&level.mesh, &level.pattern, &level.moments, smoothed.is_some());
        let bare_borders = bare_borders(&reference, (&laid.mesh, &level.pattern), zones, &level.keep);
        let sigma = assumed_sigma(&noise, &noise_gain, &spread, options.n_references);
        let tolerance_px = tolerance_px(&options, &level, &sigma);
        let enough = enough_by_node(&level, &seen, &sigma);
        let (image, pixels, n_references) = (&*reference, &*zone_pixels, options.n_references.max(1));
        let texture = smoothed.map_or(image, |smoothed| smoothed);
        let prepared = Prepared { image, texture, kernel: &kernel, n_references, level: &level, pixels };
        let probe =
            || (options.noise_correlation == NoiseCorrelation::Auto).then(|| NoiseProbe::new(&prepared)).flatten();
        let of_finest = || {
            let misfit_test = MisfitTest::new(&level.mesh, &level.moments, kernel.gradient_noise_gain, fine);
            let kernel = (options.interpolation, smoothing_px);
            let bias = InterpolationBias::new(&reference, &level.mesh, kernel, noise.of_reference);
            (misfit_test, MeshLines::new(&level.mesh), bias)
        };
        let ((probe, (misfit_test, mesh_lines, interpolation_bias)), coarse_levels) = rayon::join(
            || rayon::join(probe, of_finest),
            || coarse_levels(&backend, &mut frame, laid, size, &noise, &coarse_kernel, &options),
        );
        let (coarse_levels, search_pixels) = coarse_levels?;
        let levels = link(&backend, level, coarse_levels)?;
        let search_map = backend.grey_map(&mut frame, levels.len() - 1);
        let finest = &levels[0];
        let point_values = PointValuesOf::new(&options, &finest.mesh);
        let (low, high) = reference.range();
        let grey_range = f64::from(high - low);
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
            zone_pixels,
            spread,
            penalty: finest.solver.penalty().cloned(),
            tolerance_px,
            dropped,
            held,
            bare_borders,
            grey_range,
            smoothing_px,
            n_hot_pixels,
        };
        Ok(Self {
            noise_gain,
            probe,
            misfit_test,
            bend_test,
            mesh_lines,
            interpolation_bias,
            enough,
            seen: match reference.options.is_held() || reference.options.noise.constant().is_some() {
                true => Vec::new(),
                false => seen,
            },
            rounding,
            backend,
            reference,
            levels,
            search_map,
            image,
            hot_pixels,
            features: OnceLock::new(),
            periods: OnceLock::new(),
            cut_nodes: OnceLock::new(),
            ends_as_iterated: AtomicBool::new(true),
            point_values,
            search_pixels,
        })
    }

    /// The device.
    pub fn backend(&self) -> &B {
        &self.backend
    }

    /// Correlates one deformed image, from `start` on; when it fails, or there is none, the frame is searched for.
    ///
    /// # Errors
    /// Another size, no contrast, a start for another mesh, a device that fails. Not converging is a result.
    pub fn correlate(&self, image: Arc<Image>, start: Option<&Start>) -> Result<Correlation> {
        self.correlate_in_series(self.frame(image)?, start, &mut Overlap::default())
    }

    /// Brings a deformed image to the device: worth doing while the frame before it is correlated.
    ///
    /// # Errors
    /// An image of another size or without contrast, or a device that fails.
    pub fn frame(&self, image: Arc<Image>) -> Result<B::Frame> {
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
        Ok(self.backend.frame(self.hot_pixels.repair(image), &self.kernel)?)
    }

    /// As [`Correlator::correlate`], for an image that is on the device, while other frames of a series are under way.
    ///
    /// # Errors
    /// A start for another mesh, or a device that fails.
    pub fn correlate_in_series(
        &self,
        mut frame: B::Frame,
        start: Option<&Start>,
        overlap: &mut Overlap<'_>,
    ) -> Result<Correlation> {
        let found = self.find_from(&mut frame, start, overlap)?;
        let found = self.add_faces(&frame, found, start.map(|start| start.displacement.as_slice()));
        Ok(self.point_values.add_to(found).concluded(self.dropped.len()))
    }

    /// Finds a frame; without the zones that cannot be, once they have been looked for: what one does costs no other.
    fn find_from(&self, frame: &mut B::Frame, start: Option<&Start>, overlap: &mut Overlap<'_>) -> Result<Correlation> {
        let Some(start) = start else {
            let mut lost = vec![false; self.mesh().zones().len()];
            return overlap.share_threads(|_| {
                let mut found = self.search(frame, &lost)?;
                while self.give_up(&found, &mut lost) {
                    found = found.or_rest(self.search(frame, &lost)?);
                }
                let found = self.find_blocks(frame, found, &elements_of(self.mesh(), &lost))?;
                self.resolve_periods(frame, found, None)
            });
        };
        self.check_start(start)?;
        let mut found = self.find_near(frame, start, overlap)?;
        let left_out = named(&start.left_out, self.mesh().n_elements());
        let mut lost = self.lost_zones(&left_out);
        while self.give_up(&found, &mut lost) {
            let both = elements_of(self.mesh(), &lost).into_iter().zip(&left_out).map(|(a, b)| a || *b);
            let rest = Start { left_out: numbers(&both.collect::<Vec<_>>()), ..start.clone() };
            found = found.or_rest(self.find_near(frame, &rest, &mut Overlap::default())?);
        }
        Ok(found)
    }

    /// Adds the zones of a frame that was not found which do not match to those that are `lost`; whether there are any,
    /// and others are left.
    fn give_up(&self, found: &Correlation, lost: &mut [bool]) -> bool {
        let is_over = |status: Status| matches!(status, Status::Diverged | Status::LeftImage);
        if !is_over(found.measurement.status) || !self.may_try_again() {
            return false;
        }
        let before = lost.to_vec();
        lost.iter_mut().zip(&found.zones).for_each(|(lost, zone)| *lost |= is_over(zone.status));
        *lost != before && lost.contains(&false)
    }

    fn check_start(&self, start: &Start) -> Result<()> {
        let Start { displacement, transfer, left_out } = start;
        let (mesh_nodes, mesh_zones) = (self.mesh().n_nodes(), self.mesh().zones().len());
        let (nodes, zones) = (displacement.len(), transfer.len());
        if (nodes, zones) != (mesh_nodes, mesh_zones) {
            let of_mesh = format!("the mesh {mesh_nodes} and {mesh_zones}");
            return Err(CorrelationError::Start(format!("has {nodes} nodes and {zones} zones, {of_mesh}")));
        }
        let n_elements = self.mesh().n_elements();
        if let Some(element) = left_out.iter().find(|&&element| element as usize >= n_elements) {
            let of_mesh = format!("the mesh has {n_elements}: they are counted from 0");
            return Err(CorrelationError::Start(format!("leaves out element {element}, {of_mesh}")));
        }
        Ok(())
    }

    /// Finds a frame from a prediction; searches for it where that is not near. Without the zones that it leaves out.
    fn find_near(&self, frame: &mut B::Frame, start: &Start, overlap: &mut Overlap<'_>) -> Result<Correlation> {
        let Start { displacement, transfer, left_out } = start;
        let n_elements = self.mesh().n_elements();
        let lost = self.lost_zones(&named(left_out, n_elements));
        let found = self.iterate_from_prediction(frame, start, overlap)?;
        overlap.share_threads(|_| {
            if let Some(found) = found {
                return self.resolve_periods(frame, found, Some(displacement));
            }
            let moved = Start { displacement: self.move_by_zone(frame, displacement, transfer)?, ..start.clone() };
            let off = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
            let is_apart = moved.displacement.iter().zip(displacement).any(|pair| off(pair) > PREDICTION_OFF_PX);
            // It may be near now; and what did not match in the frame before would hold up a start with all elements.
            if (!moved.left_out.is_empty() || is_apart)
                && let Some(found) = self.iterate_from_prediction(frame, &moved, &mut Overlap::default())?
            {
                return self.resolve_periods(frame, found, Some(displacement));
            }
            let (coarse, known) = (self.carry_to_coarsest(&moved.displacement), transfer.clone());
            let mut best = self.descend_pyramid(frame, coarse, known, StartUsed::PredictedCoarse, &lost)?;
            if best.measurement.status != Status::Converged && best.worst_zone() > MATCHED && self.may_try_again() {
                // A match but for some elements: without them, before it is looked for elsewhere.
                let moved = Start { left_out: numbers(&elements_of(self.mesh(), &lost)), ..moved };
                let again = self.try_smoothly(frame, &moved, StartUsed::Predicted, 0)?;
                best = choose_better(best, again);
            }
            let n_lost = best.left_out.len().saturating_sub(left_out.len());
            if best.measurement.status != Status::Converged || n_lost as f64 > FEW_MORE * n_elements as f64 {
                best = choose_better(best, self.search(frame, &lost)?);
                best = self.find_blocks(frame, best, &named(left_out, n_elements))?;
            }
            self.resolve_periods(frame, best, Some(displacement))
        })
    }

    pub(super) fn limits(&self, turn: Turn) -> Limits<'_> {
        Limits {
            tolerance_px: self.tolerance_px,
            // Who wants the tolerance whatever the noise is waits for it.
            enough: if self.options.tolerance_by_sigma > 0.0 { &self.enough } else { &[] },
            max_iterations: self.options.max_iterations,
            turn,
            ..COARSE
        }
    }

    /// How far a field on a level is turned; not at all with regularisation, whose part of a correction is not.
    pub(super) fn turn(&self, level: &Level<B>, displacement: &[[f64; 2]]) -> Turn {
        let is_penalised = self.options.regularisation != Regularisation::None;
        if is_penalised { Turn::NONE } else { Turn::of(&level.mesh, displacement) }
    }

    /// What is found by iterating from a prediction that is near; none where it is not, or does not end well.
    fn iterate_from_prediction(
        &self,
        frame: &mut B::Frame,
        start: &Start,
        overlap: &mut Overlap<'_>,
    ) -> Result<Option<Correlation>> {
        let field = overlap.share_threads(|settled| self.settle_from_prediction(frame, start, settled))?;
        let Some(field) = field else { return Ok(None) };
        // What follows looks at the images alone.
        self.backend.release(frame);
        let found = self.measure(frame, field, StartUsed::Predicted, 0);
        Ok((found.measurement.status == Status::Converged).then_some(found))
    }

    /// The field that is found from a prediction that is near.
    fn settle_from_prediction(
        &self,
        frame: &mut B::Frame,
        start: &Start,
        settled: &mut (dyn FnMut(Start) + Send),
    ) -> Result<Option<Settled<B>>> {
        let finest = &self.levels[0];
        let turn = self.turn(finest, &start.displacement);
        let (mut field, left_out) = self.start_field(frame, start)?;
        let is_rest = !start.left_out.is_empty();
        let limits = if is_rest { self.rest_limits(turn) } else { self.limits(turn) };
        let limits = Limits { near_px: PREDICTION_OFF_PX, few_far: FEW_FAR[usize::from(is_rest)], ..limits };
        let outcome = iterate(&self.backend, finest, frame, &mut field, limits, &self.kernel, nothing)?;
        if outcome.is_far || outcome.first_correlation <= MATCHED {
            return Ok(None);
        }
        let mut iterated = self.end_iteration(frame, &mut field, outcome, left_out)?;
        if is_rest && self.may_try_again() && iterated.outcome.status != Status::Converged {
            // Without what keeps it from settling.
            let Iterated { outcome, found, light, mut excluded, lost } = iterated;
            if light.is_some() {
                self.remove_light(frame, &mut field, &found.displacement)?;
            }
            let safe = &start.displacement;
            let outcome = self.iterate_without_astray(frame, &mut field, safe, outcome, &mut excluded)?;
            let left_out = LeftOut { elements: excluded, zones: lost };
            iterated = self.end_iteration(frame, &mut field, outcome, left_out)?;
        }
        // What repeats is looked for a period beside as well, and nodes on cuts are followed by themselves.
        let is_told = self.periods().iter().all(Vec::is_empty) && self.cut_nodes().is_empty();
        let told_early = is_told && self.ends_as_iterated.load(Ordering::Relaxed);
        iterated.start().filter(|_| told_early).into_iter().for_each(&mut *settled);
        let field = self.settle(frame, &mut field, iterated)?;
        let n_out = field.of.excluded.iter().filter(|out| **out).count();
        if is_rest && n_out.saturating_sub(start.left_out.len()) as f64 > FEW_MORE * field.of.excluded.len() as f64 {
            return Ok(None);
        }
        field.start().filter(|_| is_told && !told_early).into_iter().for_each(settled);
        self.ends_as_iterated.store(field.is_as_iterated, Ordering::Relaxed);
        Ok(Some(field))
    }

    /// A field of the finest level at its start, and which elements it begins without.
    pub(super) fn start_field(&self, frame: &mut B::Frame, start: &Start) -> Result<(B::Field, LeftOut)> {
        let prepared = &self.levels[0].prepared;
        let mut field = self.backend.start(prepared, frame, &start.displacement, &start.transfer)?;
        let elements = named(&start.left_out, self.mesh().n_elements());
        if !start.left_out.is_empty() {
            self.backend.exclude(prepared, frame, &mut field, &elements)?;
        }
        let zones = self.lost_zones(&elements);
        Ok((field, LeftOut { elements, zones }))
    }

    pub(super) fn cut_nodes(&self) -> &BTreeSet<usize> {
        self.cut_nodes.get_or_init(|| self.mesh().doubled().into_iter().collect())
    }

    /// A displacement of the finest level's nodes on those of the coarsest.
    pub(super) fn carry_to_coarsest(&self, displacement: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let pairs = self.levels.windows(2);
        pairs.fold(displacement.to_vec(), |coarse, pair| pair[1].carry_from_finer(&pair[0].mesh, &coarse))
    }

    /// Iterates from the coarsest level to the finest, from `displacement` on the coarsest, without the zones `lost`.
    pub(super) fn descend_pyramid(
        &self,
        frame: &mut B::Frame,
        displacement: Vec<[f64; 2]>,
        transfer: Vec<GreyTransfer>,
        start: StartUsed,
        lost: &[bool],
    ) -> Result<Correlation> {
        let top = &self.levels[self.levels.len() - 1];
        let turn = self.turn(top, &displacement);
        let mut field = self.backend.start(&top.prepared, frame, &displacement, &transfer)?;
        let mut coarse_iterations = 0;
        let any_lost = lost.contains(&true);
        for pair in self.levels.windows(2).rev() {
            let [finer, level] = pair else { continue };
            if any_lost {
                self.backend.exclude(&level.prepared, frame, &mut field, &elements_of(&level.mesh, lost))?;
            }
            let limits = Limits { turn, own: any_lost, ..COARSE };
            let outcome = iterate(&self.backend, level, frame, &mut field, limits, &self.kernel, nothing)?;
            coarse_iterations += outcome.iterations;
            if outcome.status != Status::Converged {
                // The finer level would begin where single nodes of this one have gone.
                let displacement = self.backend.read_field(&level.prepared, frame, &field)?.displacement;
                let displacement = replace_outliers(&level.mesh, &level.pattern, &displacement);
                self.backend.place(&level.prepared, frame, &mut field, &displacement)?;
            }
            // A coarse level whose texture is gone can only harm: what it made worse stays as it was.
            let moved = outcome.correction_px.is_finite() && outcome.gained >= -WORSE;
            field = self.backend.start_finer(&finer.prepared, frame, &field, moved)?;
        }
        if any_lost {
            self.backend.exclude(&self.levels[0].prepared, frame, &mut field, &elements_of(self.mesh(), lost))?;
        }
        let limits = Limits { own: any_lost, ..self.limits(turn) };
        let outcome = iterate(&self.backend, &self.levels[0], frame, &mut field, limits, &self.kernel, nothing)?;
        let left_out = LeftOut { elements: elements_of(self.mesh(), lost), zones: lost.to_vec() };
        self.finish(frame, &mut field, outcome, start, coarse_iterations, left_out)
    }
}

/// Halvings after which the largest zone is small enough to be searched, and the smallest still wide enough.
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
