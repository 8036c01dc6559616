//! The CPU backend: `f32` kernels on all cores, vectorised for the instruction path found at run time.
//!
//! The unit of parallel work is a fixed number of elements or rows and every sum has a fixed order, so
//! results have the same bits for any number of threads.

mod bend;
mod corners;
mod gradient;
mod lanes;
mod memory;
mod normal_matrix;
mod pass;
mod plane;
mod prefilter;
mod reference;
mod residual;
mod residual_fitted;
mod residual_runs;
mod sample;

use crate::backend::bend::{BentMoments, BentSums};
use crate::backend::pyramid::{Grey, Pyramid};
use crate::backend::relaxation::{Relaxation, is_relaxed};
use crate::backend::spline::{self, Spline};
use crate::backend::{
    Ahead, Backend, BackendError, COUPLED, ElementMatch, ElementMoments, Found, GreyMap, GreyTransfer, KernelOptions,
    LOST_SHARE, PixelSums, Place, STAYS_OUT, Step, kept_and_back_share,
};
use crate::field::Brightness;
use crate::imaging::{Image, Interpolation, Levels};
use crate::isa::Isa;
use crate::linalg::{Pattern, Solver};
use crate::mesh::{ElementPixels, Mesh, PixelMap, PixelMesh};
use crate::parts;
use crate::units::Px;
use corners::{Corners, Light};
use gradient::AtPixel;
use memory::Pool;
use pass::{ElementSums, Pass};
use plane::Plane;
use rayon::prelude::*;
use reference::{PIECE, Reference, Source};
use residual_fitted::Scratch;
use std::sync::Arc;

/// Nodes per piece of parallel work.
const NODES: usize = 2048;

/// The CPU as a correlation device.
#[derive(Debug, Clone)]
pub struct CpuBackend {
    isa: Isa,
    pool: Pool,
}

impl CpuBackend {
    /// The CPU with the given instruction path.
    pub fn new(isa: Isa) -> Self {
        Self { isa, pool: Pool::default() }
    }

    /// Makes the interpolation coefficients of one level now rather than at their first use.
    ///
    /// # Errors
    /// When there is no memory left.
    pub fn prefilter(&self, frame: &mut CpuFrame, level: usize) -> Result<(), BackendError> {
        frame.coefficients(self, level)?;
        Ok(())
    }

    /// The pixels of `map` in an image, and whether eight of them side by side are enough.
    fn prepare(
        &self,
        frame: &mut CpuFrame,
        level: usize,
        map: &Arc<PixelMap>,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(Reference, bool), BackendError> {
        let KernelOptions { interpolation, gradient_unit, .. } = *options;
        // Nothing needs those of a reference any more.
        let own = frame.coefficients.get_mut(level).and_then(Option::take);
        let by = interpolation.of_gradient();
        let own = own.filter(|_| frame.options.interpolation == by);
        let coefficients = match (smoothed, own) {
            (Some(image), _) => self.frame(image.clone(), options)?.filter(self, level, by)?,
            (None, Some(coefficients)) => coefficients,
            (None, None) => frame.filter(self, level, by)?,
        };
        let (coefficients, at_pixel) = (coefficients.view(), AtPixel::new(interpolation, gradient_unit));
        let narrow = map.elements().iter().all(|e| e.nx <= 8);
        let offset = options.grey_offset;
        let reference = if level == 0 {
            match frame.grey.image.pixels() {
                Levels::U8(grey) => self.pixels(&Source { grey, offset, coefficients, at_pixel }, map, narrow),
                Levels::U16(grey) => self.pixels(&Source { grey, offset, coefficients, at_pixel }, map, narrow),
                Levels::F32(grey) => self.pixels(&Source { grey, offset, coefficients, at_pixel }, map, narrow),
            }
        } else {
            let grey = &frame.grey.level(level).values[..];
            self.pixels(&Source { grey, offset: 0.0, coefficients, at_pixel }, map, narrow)
        }?;
        Ok((reference, narrow))
    }

    fn moments_of(&self, reference: &Reference, narrow: bool, elements: &[u32]) -> Vec<BentMoments> {
        let mut moments = vec![BentMoments::default(); elements.len()];
        elements.par_chunks(PIECE).zip(moments.par_chunks_mut(PIECE)).for_each(|(elements, moments)| {
            if narrow {
                bend::bent_moments::<8>(self.isa, reference, elements, moments);
            } else {
                bend::bent_moments::<16>(self.isa, reference, elements, moments);
            }
        });
        moments
    }

    /// The pixels of a reference.
    fn pixels<G: Grey>(
        &self,
        source: &Source<'_, G>,
        map: &Arc<PixelMap>,
        narrow: bool,
    ) -> Result<Reference, BackendError> {
        let new = if narrow { Reference::new::<G, 8> } else { Reference::new::<G, 16> };
        new(&self.pool, self.isa, source, map)
    }
}

impl Default for CpuBackend {
    /// The fastest instruction path of this machine.
    fn default() -> Self {
        Self::new(Isa::detect())
    }
}

/// An image and what has been made of it so far.
#[derive(Debug)]
pub struct CpuFrame {
    grey: Pyramid,
    options: KernelOptions,
    /// Interpolation coefficients per level.
    coefficients: Vec<Option<Plane>>,
}

impl CpuFrame {
    fn coefficients(&mut self, backend: &CpuBackend, level: usize) -> Result<&Plane, BackendError> {
        if self.coefficients.len() <= level {
            self.coefficients.resize_with(level + 1, || None);
        }
        if self.coefficients[level].is_none() {
            self.coefficients[level] = Some(self.filter(backend, level, self.options.interpolation)?);
        }
        Ok(self.coefficients[level].as_ref().expect("made above"))
    }

    /// The coefficients of a level for an interpolation, made anew.
    fn filter(
        &mut self,
        backend: &CpuBackend,
        level: usize,
        interpolation: Interpolation,
    ) -> Result<Plane, BackendError> {
        let offset = self.options.grey_offset;
        let (isa, pool) = (backend.isa, &backend.pool);
        if level > 0 {
            let grey = self.grey.level(level);
            return prefilter::coefficients(pool, isa, &grey.values, grey.width, grey.height, 0.0, interpolation);
        }
        let image = &self.grey.image;
        let (width, height) = (image.width(), image.height());
        match image.pixels() {
            Levels::U8(p) => prefilter::coefficients(pool, isa, p, width, height, offset, interpolation),
            Levels::U16(p) => prefilter::coefficients(pool, isa, p, width, height, offset, interpolation),
            Levels::F32(p) => prefilter::coefficients(pool, isa, p, width, height, offset, interpolation),
        }
    }
}

/// A reference prepared at one scale.
#[derive(Debug)]
pub struct CpuLevel {
    mesh: Arc<Mesh<Px>>,
    pattern: Arc<Pattern>,
    reference: Reference,
    /// Pixels, sum of f and of f^2 of each element.
    whole: Vec<[f64; 3]>,
    /// See [`kept_and_back_share`].
    kept_and_back: [f64; 2],
    pub(super) level: usize,
    narrow: bool,
    options: KernelOptions,
    /// Where the nodes lie in the next coarser level.
    places: Vec<Place>,
}

/// A displacement field under iteration.
#[derive(Debug)]
pub struct CpuField {
    displacement: Vec<[f64; 2]>,
    /// That of the last evaluation, before the correction that was added since.
    evaluated: Vec<[f64; 2]>,
    /// The corrections of the nodes: those before the last evaluation, where they are relaxed, and those after it.
    relaxation: [Vec<Relaxation>; 2],
    /// Steps made since it was placed.
    steps: usize,
    /// Displacement and transfer at the start.
    started: (Vec<[f64; 2]>, Vec<GreyTransfer>),
    /// Correlation coefficients of the zones at the first evaluation.
    first: Vec<f64>,
    /// Per zone.
    transfer: Vec<GreyTransfer>,
    /// What the last evaluation added to it, see [`GreyTransfer::change`].
    change: Vec<[f64; 2]>,
    corners: Vec<Corners>,
    sums: Vec<ElementSums>,
    /// What they come to, per piece of elements.
    tallies: Vec<Tally>,
    /// Gain and offset per element.
    element_transfer: Vec<(f32, f32)>,
    /// Light per element, where it was set.
    light: Option<Vec<Light>>,
    /// Which elements have left the deformed image.
    out: Vec<Out>,
    /// Elements that are left out of all sums; empty where none is. Theirs are kept but for the right-hand side.
    excluded: Vec<bool>,
}

/// Whether an element is left out because too few of its pixels are in the deformed image. Twin: shaders/tally.wgsl.
#[derive(Debug, Clone, Copy, Default)]
struct Out {
    is_out: bool,
    /// How often it has been left out.
    times: u32,
}

impl Out {
    /// With `n` pixels, of which it must keep `kept`, or get `back` once it is left out.
    fn with(self, n: f64, kept: f64, back: f64) -> Self {
        let is_out = match self.is_out {
            true => self.times >= STAYS_OUT || n < back,
            false => n < kept,
        };
        Self { is_out, times: self.times + u32::from(is_out && !self.is_out) }
    }
}

/// What a piece of elements adds to the sums of its zones, and how many of it are lost as a [`Step`] counts them.
#[derive(Debug, Clone, Default)]
struct Tally {
    zones: Vec<(u32, PixelSums)>,
    lost: usize,
}

impl CpuField {
    /// The sums of an element; none of one that is excluded.
    fn sums_of(&self, element: usize) -> ElementSums {
        if is_excluded(&self.excluded, element) { ElementSums::default() } else { self.sums[element] }
    }

    /// Moves the nodes by their corrections, each relaxed, times `(cos, sin)`. The largest component of the
    /// corrections, px, and its node.
    fn move_nodes(&mut self, correction: &[[f64; 2]], [cos, sin]: [f64; 2]) -> (f64, usize) {
        let damping = cos.hypot(sin);
        let [before, latest] = &mut self.relaxation;
        latest.resize(correction.len(), Relaxation::new(None, [0.0; 2]));
        // `max` would drop a NaN; a correction that is not a number must be seen.
        let worse = |worst: (f64, usize), of: (f64, usize)| if of.0 > worst.0 || of.0.is_nan() { of } else { worst };
        let of_piece = |piece: usize, u: &mut [[f64; 2]], du: &[[f64; 2]], latest: &mut [Relaxation]| {
            let mut worst = (0.0, 0);
            for (node, ((u, du), latest)) in (piece * NODES..).zip(u.iter_mut().zip(du).zip(latest)) {
                let relaxed = Relaxation::new(before.get(node), *du);
                let by = relaxed.movement();
                *latest = relaxed.damped(damping);
                let turned = [cos * by[0] - sin * by[1], cos * by[1] + sin * by[0]];
                for c in 0..2 {
                    u[c] += turned[c];
                    worst = worse(worst, (du[c].abs(), node));
                }
            }
            worst
        };
        let mut largest = vec![(0.0, 0); correction.len().div_ceil(NODES)];
        let pieces = self.displacement.chunks_mut(NODES).zip(correction.chunks(NODES));
        let pieces = pieces.zip(latest.chunks_mut(NODES)).zip(&mut largest).enumerate().collect();
        parts::for_each(pieces, |(piece, (((u, du), latest), largest))| *largest = of_piece(piece, u, du, latest));
        largest.into_iter().fold((0.0, 0), worse)
    }
}

/// Whether an element is one of those that are `excluded`; an empty list says that none is.
fn is_excluded(excluded: &[bool], element: usize) -> bool {
    excluded.get(element).is_some_and(|&excluded| excluded)
}

/// The pixels of a reference that lives on another device, for what is done on the host.
#[cfg(feature = "gpu")]
#[derive(Debug)]
pub(super) struct HostReference {
    reference: Reference,
    narrow: bool,
}

#[cfg(feature = "gpu")]
impl HostReference {
    /// Those of `map` in an image.
    pub fn new(
        image: Arc<Image>,
        map: &Arc<PixelMap>,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<Self, BackendError> {
        let cpu = CpuBackend::default();
        let (reference, narrow) = cpu.prepare(&mut cpu.frame(image, options)?, 0, map, options, smoothed)?;
        Ok(Self { reference, narrow })
    }

    /// [`Backend::bent_moments`].
    pub fn bent_moments(&self, elements: &[u32]) -> Vec<BentMoments> {
        CpuBackend::default().moments_of(&self.reference, self.narrow, elements)
    }
}

/// A pass over the pixels of a level, for any interpolation.
trait WithSpline {
    type Output;

    fn run<S: Spline<K>, const K: usize, const L: usize>(self, spline: S) -> Self::Output;
}

/// Residual and sums of all elements.
struct Evaluate<'a> {
    level: &'a CpuLevel,
    isa: Isa,
    deformed: &'a Plane,
    field: &'a mut CpuField,
}

impl WithSpline for Evaluate<'_> {
    type Output = ();

    fn run<S: Spline<K>, const K: usize, const L: usize>(self, spline: S) {
        self.level.run::<S, K, L>(self.isa, self.deformed, self.field, spline);
    }
}

/// What the residual of elements follows beyond their field.
struct Bend<'a> {
    level: &'a CpuLevel,
    isa: Isa,
    deformed: &'a Plane,
    field: &'a CpuField,
    elements: &'a [u32],
}

impl WithSpline for Bend<'_> {
    type Output = Vec<BentSums>;

    fn run<S: Spline<K>, const K: usize, const L: usize>(self, spline: S) -> Vec<BentSums> {
        let Self { level, isa, deformed, field, elements } = self;
        let pass = &Pass::<L>::new(isa, &level.reference, deformed);
        let light = field.light.as_deref();
        let corners_of = |&element: &u32| {
            Corners::new(level.mesh.elements()[element as usize].map(|node| field.displacement[node as usize]))
        };
        let transfer_of = |&element: &u32| {
            if level.own_transfer() {
                return field.element_transfer[element as usize];
            }
            let GreyTransfer { gain, offset } = field.transfer[level.mesh.element_zone()[element as usize] as usize];
            (gain as f32, offset as f32)
        };
        let mut sums = vec![BentSums::default(); elements.len()];
        parts::for_each(sums.chunks_mut(PIECE).zip(elements.chunks(PIECE)).collect(), |(sums, elements)| {
            let corners: Vec<Corners> = elements.iter().map(corners_of).collect();
            let transfer: Vec<(f32, f32)> = elements.iter().map(transfer_of).collect();
            bend::bent_sums::<S, K, L>(isa, pass, elements, &corners, &transfer, light, sums, spline);
        });
        sums
    }
}

impl CpuLevel {
    #[cfg(feature = "testbed")]
    pub(super) fn n_elements(&self) -> usize {
        self.mesh.n_elements()
    }

    fn own_transfer(&self) -> bool {
        self.options.brightness == Brightness::Element
    }

    /// Evaluates residual and sums of all elements at the field's displacement.
    fn evaluate(&self, isa: Isa, deformed: &Plane, field: &mut CpuField) {
        self.with_spline(Evaluate { level: self, isa, deformed, field });
    }

    /// Does a pass over the pixels with the interpolation and the width of lanes of this level.
    fn with_spline<W: WithSpline>(&self, pass: W) -> W::Output {
        match (self.options.interpolation, self.narrow) {
            (Interpolation::Cubic, false) => pass.run::<_, 4, 16>(spline::Cubic),
            (Interpolation::Cubic, true) => pass.run::<_, 4, 8>(spline::Cubic),
            (Interpolation::Quintic, false) => pass.run::<_, 6, 16>(spline::Quintic),
            (Interpolation::Quintic, true) => pass.run::<_, 6, 8>(spline::Quintic),
            (Interpolation::Keys, false) => pass.run::<_, 4, 16>(spline::Keys),
            (Interpolation::Keys, true) => pass.run::<_, 4, 8>(spline::Keys),
            (Interpolation::Bilinear, false) => pass.run::<_, 2, 16>(spline::Bilinear),
            (Interpolation::Bilinear, true) => pass.run::<_, 2, 8>(spline::Bilinear),
        }
    }

    fn run<S: Spline<K>, const K: usize, const L: usize>(
        &self,
        isa: Isa,
        deformed: &Plane,
        field: &mut CpuField,
        spline: S,
    ) {
        let pass = &Pass::<L>::new(isa, &self.reference, deformed);
        let displacement = &field.displacement;
        let light = field.light.as_deref();
        let pieces = field.sums.chunks_mut(PIECE).zip(field.element_transfer.chunks_mut(PIECE));
        let pieces = pieces.zip(field.out.chunks_mut(PIECE)).zip(field.corners.chunks_mut(PIECE));
        let pieces = pieces.zip(&mut field.tallies).enumerate().collect();
        let [kept, back] = self.kept_and_back;
        let (excluded, of_zones, own) = (&field.excluded, &field.transfer, Scratch::default);
        parts::for_each_init(pieces, own, |scratch, (piece, ((((sums, transfer), out), corners), tally))| {
            let first = piece * PIECE;
            for (corners, nodes) in corners.iter_mut().zip(&self.mesh.elements()[first..]) {
                *corners = Corners::new(nodes.map(|node| displacement[node as usize]));
            }
            let corners = &*corners;
            if !self.own_transfer() {
                for (of_element, zone) in transfer.iter_mut().zip(&self.mesh.element_zone()[first..]) {
                    let GreyTransfer { gain, offset } = of_zones[*zone as usize];
                    *of_element = (gain as f32, offset as f32);
                }
            }
            if let Some(light) = light {
                let light = &light[first..];
                residual::residual_sums_in_light::<S, K, L>(isa, pass, first, corners, transfer, light, sums, spline);
            } else if self.own_transfer() {
                residual_fitted::residual_sums_two_passes::<S, K, L>(
                    isa, pass, first, corners, transfer, sums, scratch, spline,
                );
            } else {
                residual::residual_sums::<S, K, L>(isa, pass, first, corners, transfer, sums, spline);
            }
            for (k, sums) in sums.iter_mut().enumerate() {
                let [n_all, f, ff] = self.whole[first + k];
                let before = if is_excluded(excluded, first + k) { Out::default() } else { out[k] };
                out[k] = before.with(f64::from(sums.n), kept * n_all, back * n_all);
                if out[k].is_out {
                    *sums = ElementSums { f_lost: f as f32, ff_lost: ff as f32, ..Default::default() };
                }
            }
            self.tally(first, sums, excluded, tally);
        });
        for (sums, _) in field.sums.iter_mut().zip(&field.excluded).filter(|(_, excluded)| **excluded) {
            sums.b = [0.0; 8];
        }
    }

    fn pixel_sums(&self, element: usize, sums: &ElementSums) -> PixelSums {
        let [n_all, f, ff] = self.whole[element];
        if sums.n == 0.0 {
            return PixelSums { n_all, ..PixelSums::default() };
        }
        PixelSums {
            n: f64::from(sums.n),
            n_all,
            f: f - f64::from(sums.f_lost),
            ff: ff - f64::from(sums.ff_lost),
            g: f64::from(sums.g),
            gg: f64::from(sums.gg),
            fg: f64::from(sums.fg),
            rr: f64::from(sums.rr),
        }
    }

    /// Writes into `tally` what the elements from `first` on come to, but for those that are `excluded`.
    fn tally(&self, first: usize, sums: &[ElementSums], excluded: &[bool], tally: &mut Tally) {
        tally.zones.clear();
        tally.lost = 0;
        for (element, sums) in (first..).zip(sums) {
            let zone = self.mesh.element_zone()[element];
            let none = ElementSums::default();
            let of_element = self.pixel_sums(element, if is_excluded(excluded, element) { &none } else { sums });
            match tally.zones.last_mut().filter(|(last, _)| *last == zone) {
                Some((_, total)) => total.add(&of_element),
                None => tally.zones.push((zone, of_element)),
            }
            let PixelSums { n, n_all, .. } = of_element;
            tally.lost += usize::from(n < (1.0 - LOST_SHARE) * n_all) + usize::from(n == 0.0 && n_all > 0.0);
        }
    }

    fn zone_sums(&self, field: &CpuField) -> Vec<PixelSums> {
        let mut zones = vec![PixelSums::default(); self.mesh.zones().len()];
        for (zone, sums) in field.tallies.iter().flat_map(|tally| &tally.zones) {
            zones[*zone as usize].add(sums);
        }
        zones
    }

    fn right_hand_side(&self, field: &CpuField) -> Vec<[f64; 2]> {
        self.pattern.gather_corners(|element, corner| {
            let b = &field.sums[element].b;
            [f64::from(b[2 * corner]), f64::from(b[2 * corner + 1])]
        })
    }

    /// Corrects the field by the sums of its last evaluation, over `zones`, and by what the transfer has changed since:
    /// the sums are of the residual before that.
    fn correct(&self, field: &mut CpuField, zones: &[PixelSums], solver: &Solver, scale: [f64; 2]) -> Step {
        let correlations: Vec<f64> = zones.iter().map(PixelSums::correlation).collect();
        if field.first.is_empty() {
            field.first = correlations.clone();
        }
        // A zone that is left out says nothing.
        let counted = || zones.iter().zip(correlations.iter().zip(&field.first)).filter(|(sums, _)| sums.n > 0.0);
        let correlation = counted().fold(1.0, |smallest: f64, (_, (now, _))| smallest.min(*now));
        let gained = counted().fold(2.0, |smallest: f64, (_, (now, first))| smallest.min(now - first));
        let mut correction = solver.correction(self.right_hand_side(field), &field.displacement);
        if let Some([by_gain, by_offset]) = solver.responses() {
            for (zone, [of_f, of_one]) in field.change.iter().enumerate() {
                for node in self.mesh.zone_nodes(zone) {
                    for c in 0..2 {
                        correction[node][c] -= of_f * by_gain[node][c] + of_one * by_offset[node][c];
                    }
                }
            }
        }
        let (largest, worst_node) = field.move_nodes(&correction, scale);
        Step {
            correction_px: largest,
            worst_node,
            correlation,
            gained,
            counted: zones.iter().map(|zone| zone.n).sum(),
            lost: field.tallies.iter().map(|tally| tally.lost).sum(),
        }
    }

    /// Transfer of grey levels per zone; the mean over its elements where each has its own.
    fn transfer(&self, field: &CpuField) -> Vec<GreyTransfer> {
        if !self.own_transfer() {
            return field.transfer.clone();
        }
        let mean = |zone: usize| {
            let elements = self.mesh.zone_elements(zone);
            let n = elements.len() as f64;
            let of_zone = &field.element_transfer[elements];
            GreyTransfer {
                gain: of_zone.iter().map(|t| f64::from(t.0)).sum::<f64>() / n,
                offset: of_zone.iter().map(|t| f64::from(t.1)).sum::<f64>() / n,
            }
        };
        (0..self.mesh.zones().len()).map(mean).collect()
    }

    /// The gain and offset of each zone that the last sums ask for (kept where they say nothing).
    fn fit_transfer(&self, zones: &[PixelSums], field: &mut CpuField) {
        if self.options.brightness != Brightness::Zone {
            return;
        }
        for ((transfer, change), sums) in field.transfer.iter_mut().zip(&mut field.change).zip(zones) {
            let fitted = sums.transfer().unwrap_or(*transfer);
            *change = if sums.correlation() < COUPLED { [0.0; 2] } else { transfer.change(fitted) };
            *transfer = fitted;
        }
    }
}

impl Backend for CpuBackend {
    type Frame = CpuFrame;
    type Level = CpuLevel;
    type Field = CpuField;
    type Solver = Arc<Solver>;

    fn device(&self) -> String {
        format!("cpu ({})", self.isa)
    }

    fn host_isa(&self) -> Isa {
        self.isa
    }

    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<CpuFrame, BackendError> {
        let grey = Pyramid::new(image, options.grey_offset);
        Ok(CpuFrame { grey, options: *options, coefficients: Vec::new() })
    }

    fn image(&self, frame: &CpuFrame) -> Arc<Image> {
        frame.grey.image.clone()
    }

    fn grey_map(&self, frame: &mut CpuFrame, level: usize) -> GreyMap {
        frame.grey.level(level).clone()
    }

    fn reference(
        &self,
        frame: &mut CpuFrame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(CpuLevel, Vec<ElementMoments>), BackendError> {
        let (reference, narrow) = self.prepare(frame, level, &mesh.pixels, options, smoothed)?;
        let with_transfer = options.brightness != Brightness::Off;
        let mesh = mesh.mesh.clone();
        let mut moments = vec![ElementMoments::default(); mesh.n_elements()];
        moments.par_chunks_mut(PIECE).enumerate().for_each(|(piece, moments)| {
            let first = piece * PIECE;
            if narrow {
                normal_matrix::element_moments::<8>(self.isa, &reference, first, with_transfer, moments);
            } else {
                normal_matrix::element_moments::<16>(self.isa, &reference, first, with_transfer, moments);
            }
        });
        let whole = moments.iter().map(|m| [m.n, m.f, m.ff]).collect();
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        let places = Vec::new();
        let kept_and_back = kept_and_back_share(mesh.element_size());
        let level =
            CpuLevel { mesh, pattern, reference, whole, kept_and_back, level, narrow, options: *options, places };
        Ok((level, moments))
    }

    fn link(&self, level: &mut CpuLevel, places: Vec<Place>) -> Result<(), BackendError> {
        level.places = places;
        Ok(())
    }

    fn release(&self, frame: &mut CpuFrame) {
        frame.coefficients.clear();
    }

    fn solver(&self, _: &CpuLevel, solver: Solver) -> Result<Arc<Solver>, BackendError> {
        Ok(Arc::new(solver))
    }

    fn reclaim(&self, solver: Arc<Solver>) -> Option<Solver> {
        Arc::into_inner(solver)
    }

    fn start(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<CpuField, BackendError> {
        let n = level.mesh.n_elements();
        Ok(CpuField {
            displacement: displacement.to_vec(),
            evaluated: Vec::new(),
            relaxation: Default::default(),
            steps: 0,
            started: (displacement.to_vec(), transfer.to_vec()),
            first: Vec::new(),
            transfer: transfer.to_vec(),
            change: vec![[0.0; 2]; transfer.len()],
            corners: vec![Corners::new([[0.0; 2]; 4]); n],
            sums: vec![ElementSums::default(); n],
            tallies: vec![Tally::default(); n.div_ceil(PIECE)],
            element_transfer: vec![(1.0, 0.0); n],
            light: None,
            out: vec![Out::default(); n],
            excluded: Vec::new(),
        })
    }

    fn start_finer(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        coarse: &CpuField,
        moved: bool,
    ) -> Result<CpuField, BackendError> {
        let (start, start_transfer) = &coarse.started;
        let (from, transfer) = if moved { (&coarse.displacement, &coarse.transfer) } else { (start, start_transfer) };
        let displacement: Vec<[f64; 2]> = level
            .places
            .iter()
            .map(|place| {
                let mut u = [0.0; 2];
                for (node, weight) in place.nodes.iter().zip(place.weights) {
                    let of_node = from[*node as usize];
                    u = [u[0] + weight * of_node[0], u[1] + weight * of_node[1]];
                }
                u.map(|u| 2.0 * u) // a pixel of the coarser level is two of this one
            })
            .collect();
        self.start(level, frame, &displacement, transfer)
    }

    fn observe(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut CpuField,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        level.evaluate(self.isa, frame.coefficients(self, level.level)?, field);
        let zones = level.zone_sums(field);
        level.fit_transfer(&zones, field);
        Ok(zones.into_iter().zip(level.transfer(field)).collect())
    }

    fn restrict(&self, level: &mut CpuLevel, active: &[bool]) -> Result<(), BackendError> {
        for (at, active) in active.iter().enumerate() {
            if !active {
                level.reference.elements[at] = ElementPixels::NONE;
                level.whole[at] = [0.0; 3];
            }
        }
        Ok(())
    }

    fn step(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut CpuField,
        solver: &Arc<Solver>,
        scale: [f64; 2],
        _: &Ahead,
    ) -> Result<Step, BackendError> {
        level.evaluate(self.isa, frame.coefficients(self, level.level)?, field);
        field.evaluated.clone_from(&field.displacement);
        let zones = level.zone_sums(field);
        level.fit_transfer(&zones, field);
        field.steps += 1;
        field.relaxation.swap(0, 1);
        if !is_relaxed(field.steps, solver) {
            field.relaxation[0].clear();
        }
        Ok(level.correct(field, &zones, solver, scale))
    }

    fn solve_again(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        field: &mut CpuField,
        solver: &Arc<Solver>,
        scale: [f64; 2],
        _: &Ahead,
    ) -> Result<Step, BackendError> {
        field.displacement.clone_from(&field.evaluated);
        Ok(level.correct(field, &level.zone_sums(field), solver, scale))
    }

    fn remaining_moments(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &CpuField,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError> {
        let deformed = frame.coefficients(self, level.level)?;
        let lost = (0..field.sums.len()).filter(|&e| f64::from(field.sums_of(e).n) < level.whole[e][0]);
        let (gone, left): (Vec<usize>, Vec<usize>) = lost.partition(|&element| field.sums_of(element).n == 0.0);
        let mut moments = vec![ElementMoments::default(); left.len()];
        let remaining =
            if level.narrow { normal_matrix::remaining_moments::<8> } else { normal_matrix::remaining_moments::<16> };
        left.par_chunks(PIECE).zip(moments.par_chunks_mut(PIECE)).for_each(|(left, moments)| {
            remaining(self.isa, &level.reference, left, &field.corners, deformed, level.own_transfer(), moments);
        });
        let nothing = gone.into_iter().map(|element| (element, ElementMoments::default()));
        let mut remaining: Vec<_> = left.into_iter().zip(moments).chain(nothing).collect();
        remaining.sort_unstable_by_key(|(element, _)| *element);
        Ok(remaining)
    }

    fn right_hand_side(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        field: &CpuField,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        Ok(level.right_hand_side(field))
    }

    fn element_sums(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        field: &CpuField,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        let sums = (0..field.sums.len()).map(|at| level.pixel_sums(at, &field.sums_of(at))).collect();
        Ok((sums, level.transfer(field)))
    }

    fn exclude(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        field: &mut CpuField,
        excluded: &[bool],
    ) -> Result<(), BackendError> {
        let taken_back =
            |(element, _): &(usize, &mut Out)| is_excluded(&field.excluded, *element) && !excluded[*element];
        field.out.iter_mut().enumerate().filter(taken_back).for_each(|(_, out)| *out = Out::default());
        let any = excluded.contains(&true);
        field.excluded = if any { excluded.to_vec() } else { Vec::new() };
        for (piece, (sums, tally)) in field.sums.chunks(PIECE).zip(&mut field.tallies).enumerate() {
            level.tally(piece * PIECE, sums, &field.excluded, tally);
        }
        for (sums, _) in field.sums.iter_mut().zip(&field.excluded).filter(|(_, excluded)| **excluded) {
            sums.b = [0.0; 8];
        }
        Ok(())
    }

    fn all_sums(&self, level: &CpuLevel, _: &mut CpuFrame, field: &CpuField) -> Result<Vec<PixelSums>, BackendError> {
        Ok(field.sums.iter().enumerate().map(|(at, sums)| level.pixel_sums(at, sums)).collect())
    }

    fn place(
        &self,
        _: &CpuLevel,
        _: &mut CpuFrame,
        field: &mut CpuField,
        displacement: &[[f64; 2]],
    ) -> Result<(), BackendError> {
        field.displacement.copy_from_slice(displacement);
        field.steps = 0;
        Ok(())
    }

    fn read_start(
        &self,
        _: &CpuLevel,
        _: &mut CpuFrame,
        field: &CpuField,
    ) -> Result<(Vec<[f64; 2]>, Vec<GreyTransfer>), BackendError> {
        Ok(field.started.clone())
    }

    fn light(
        &self,
        level: &CpuLevel,
        _: &mut CpuFrame,
        field: &mut CpuField,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        let on = |nodes: &[u32; 4]| Light {
            gain: nodes.map(|node| light[node as usize].gain as f32),
            offset: nodes.map(|node| light[node as usize].offset as f32),
        };
        let any = light.iter().any(|light| *light != GreyTransfer::NONE);
        field.light = any.then(|| level.mesh.elements().iter().map(on).collect());
        Ok(())
    }

    fn bent_moments(&self, level: &CpuLevel, elements: &[u32]) -> Result<Vec<BentMoments>, BackendError> {
        Ok(self.moments_of(&level.reference, level.narrow, elements))
    }

    fn bent_sums(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &CpuField,
        elements: &[u32],
    ) -> Result<Vec<BentSums>, BackendError> {
        let deformed = frame.coefficients(self, level.level)?;
        Ok(level.with_spline(Bend { level, isa: self.isa, deformed, field, elements }))
    }

    fn read_field(&self, level: &CpuLevel, _: &mut CpuFrame, field: &CpuField) -> Result<Found, BackendError> {
        let matched = |at: usize| ElementMatch::from(&level.pixel_sums(at, &field.sums_of(at)));
        Ok(Found {
            displacement: field.displacement.clone(),
            zones: level.zone_sums(field),
            elements: parts::map(field.sums.len(), NODES, ElementMatch::default(), matched),
            transfer: level.transfer(field),
        })
    }
}
