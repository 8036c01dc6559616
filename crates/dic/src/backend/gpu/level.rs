//! A reference prepared at one scale.

use super::device::{Bound, Buffer, Gpu, values};
use super::layout::{self, Element, WHOLE};
use super::plane::{GpuFrame, Reference, too_wide, windows};
use super::shader::Kernel;
use crate::backend::cpu::HostReference;
use crate::backend::{
    BackendError, ElementMoments, KernelOptions, LOST_SHARE, Place, STAYS_OUT, Traffic, kept_and_back_share,
};
use crate::field::Brightness;
use crate::imaging::Image;
use crate::linalg::Pattern;
use crate::mesh::{ElementPixels, Mesh, PixelMap, PixelMesh};
use crate::units::Px;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Rows of the reference, and the first rows of the elements that they hold whole.
type RowsAndElements = (Range<usize>, Range<i32>);

/// Elements summed by one workgroup of the tally.
const TOGETHER: usize = 256;
/// Values per element of the moments kernel.
const MOMENTS: usize = 48;
/// Elements whose moments are fetched at once.
const MOMENTS_AT_ONCE: usize = 1 << 17;
/// Values per element of the residual kernels.
pub(super) const SUMS: usize = 16;
/// Values per group of elements.
pub(super) const TALLIES: usize = 12;

/// Elements and pixels that one dispatch of a residual pass does.
#[derive(Debug)]
pub(super) struct Window {
    /// Image rows of the reference that it sees.
    pub reference: Range<usize>,
    /// Image rows of the deformed image whose taps it sees.
    pub deformed: Range<usize>,
    pub pass: Buffer,
}

/// A reference prepared at one scale.
#[derive(Debug)]
pub struct GpuLevel {
    pub(super) mesh: Arc<Mesh<Px>>,
    pub(super) level: usize,
    pub(super) options: KernelOptions,
    pub(super) reference: Reference,
    pixels: Arc<PixelMap>,
    /// On the host, as on the device: elements left out have no pixels.
    elements: Vec<Element>,
    /// Pixels, sum of f and of f^2 of each element.
    whole: Vec<[f32; 4]>,
    pub(super) n_zones: usize,
    pub(super) n_groups: usize,
    /// Threads per element.
    pub(super) lanes: u32,
    /// Elements that are rectangles of pixels, and those that are runs.
    pub(super) has_rectangles: bool,
    pub(super) n_listed: usize,
    pub(super) windows: Vec<Window>,
    pub(super) element_buffer: Buffer,
    pub(super) whole_buffer: Buffer,
    pub(super) shape: Buffer,
    pub(super) incidence: Buffer,
    pub(super) groups: Buffer,
    pub(super) zone_groups: Buffer,
    pub(super) tally: Buffer,
    /// The zone of each node.
    pub(super) node_zone: Buffer,
    pub(super) gather: Buffer,
    pub(super) report: Buffer,
    pub(super) places: Option<Buffer>,
    shape_places: ShapePlaces,
    image: Arc<Image>,
    smoothed: Option<Arc<Image>>,
    host: OnceLock<HostReference>,
}

/// Where the parts of the `shape` buffer begin.
#[derive(Debug, Clone, Copy)]
struct ShapePlaces {
    runs_at: u32,
    points_at: u32,
}

impl GpuLevel {
    /// Prepares a level of `frame` and sums the moments of the elements.
    pub(super) fn new(
        gpu: &Gpu,
        frame: &mut GpuFrame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(Self, Vec<ElementMoments>), BackendError> {
        let reference = Reference::new(gpu, frame, level, options, smoothed)?;
        let PixelMesh { mesh, pixels, .. } = mesh;
        let elements: Vec<Element> = (0..mesh.n_elements())
            .map(|e| element(&pixels.elements()[e], mesh.elements()[e], mesh.element_zone()[e]))
            .collect();
        let widest = elements.iter().map(|e| e.size[0]).max().unwrap_or(0);
        let listed: Vec<u32> = (0..).zip(&elements).filter(|(_, e)| e.n_runs > 0).map(|(at, _)| at).collect();
        let (shape, shape_places) = shape_of(&listed, pixels);
        let mut groups = Vec::new();
        let mut zone_groups = Vec::new();
        for zone in 0..mesh.zones().len() {
            let of_zone = mesh.zone_elements(zone);
            let first = groups.len();
            groups.extend(
                of_zone
                    .clone()
                    .step_by(TOGETHER)
                    .map(|from| layout::Group { first: from as u32, count: TOGETHER.min(of_zone.end - from) as u32 }),
            );
            zone_groups.push(layout::ZoneGroups {
                first: first as u32,
                count: (groups.len() - first) as u32,
                n_elements: of_zone.len() as u32,
                unused: 0,
            });
        }
        let n_nodes = mesh.n_nodes() as u32;
        let n_elements = elements.len() as u32;
        let [kept, back] = kept_and_back_share(mesh.element_size());
        let tally = layout::Tally {
            n_elements,
            n_groups: groups.len() as u32,
            kept_share: kept as f32,
            back_share: back as f32,
            lossy_share: (1.0 - LOST_SHARE) as f32,
            own_transfer: u32::from(options.brightness == Brightness::Element),
            stays_out: STAYS_OUT as f32,
            unused: 0,
        };
        let pattern = Pattern::new(mesh.n_nodes(), mesh.elements());
        let whole_buffer = gpu.visible(16 * u64::from(n_elements), "sums of the elements")?;
        let mut prepared = Self {
            level,
            options: *options,
            n_zones: mesh.zones().len(),
            n_groups: groups.len(),
            lanes: widest.next_power_of_two().clamp(4, gpu.most_lanes),
            has_rectangles: listed.len() < elements.len(),
            n_listed: listed.len(),
            windows: Vec::new(),
            element_buffer: gpu.filled(&elements, "the elements")?,
            whole_buffer,
            shape: gpu.filled(&shape, "the pixels of elements of any shape")?,
            incidence: gpu.filled(&incidence_of(&pattern), "the elements of the nodes")?,
            groups: gpu.filled(&groups, "groups of elements")?,
            zone_groups: gpu.filled(&zone_groups, "zones")?,
            tally: gpu.uniform(&tally),
            node_zone: gpu.filled(mesh.node_zone(), "the zones of the nodes")?,
            gather: gpu.uniform(&layout::Gather { n_nodes, unused0: 0, unused1: 0, unused2: 0 }),
            report: gpu.uniform(&layout::Report { n_elements, n_nodes, unused: [0; 2] }),
            places: None,
            whole: Vec::new(),
            mesh: mesh.clone(),
            pixels: pixels.clone(),
            elements,
            reference,
            shape_places,
            image: frame.host.image.clone(),
            smoothed: smoothed.cloned(),
            host: OnceLock::new(),
        };
        prepared.windows = prepared.split(gpu)?;
        let all: Vec<u32> = (0..n_elements).collect();
        let moments = prepared.moments(gpu, &all, None, &mut frame.traffic)?;
        prepared.whole = moments.iter().map(|m| [m.n as f32, m.f as f32, m.ff as f32, 0.0]).collect();
        gpu.write(&prepared.whole_buffer, &prepared.whole);
        Ok((prepared, moments))
    }

    /// Its pixels on the host, made when first asked for.
    pub(super) fn on_host(&self) -> Result<&HostReference, BackendError> {
        if let Some(host) = self.host.get() {
            return Ok(host);
        }
        let made = HostReference::new(self.image.clone(), &self.pixels, &self.options, self.smoothed.as_ref())?;
        // Another thread may have been first: both are alike.
        Ok(self.host.get_or_init(|| made))
    }

    /// Whether each element has a gain and offset of its own.
    pub(super) fn own_transfer(&self) -> bool {
        self.options.brightness == Brightness::Element
    }

    /// Pixels, sum of f and of f^2 of each element.
    pub(super) fn whole(&self, element: usize) -> [f64; 3] {
        let [n, f, ff, _] = self.whole[element];
        [n, f, ff].map(f64::from)
    }

    /// Pixels of each element.
    pub(super) fn pixels_of(&self, element: usize) -> f64 {
        f64::from(self.whole[element][0])
    }

    /// Whether the share of its pixels that an element has kept, packed, tells that a single one is lost.
    pub(super) fn is_told_by_shares(&self) -> bool {
        self.whole.iter().all(|whole| whole[0] < f32::from(WHOLE))
    }

    fn pass(&self, elements: Range<i32>, reference_first: usize) -> layout::Pass {
        layout::Pass {
            image: [self.reference.width as i32, self.reference.height as i32],
            stride: self.reference.stride as i32,
            n_elements: self.elements.len() as u32,
            reference_first: reference_first as i32,
            elements_from: elements.start,
            elements_to: elements.end,
            deformed_first: 0,
            floors_from: i32::MIN,
            floors_to: i32::MAX,
            own_transfer: u32::from(self.own_transfer()),
            accumulate: 0,
            n_listed: self.n_listed as u32,
            runs_at: self.shape_places.runs_at,
            points_at: self.shape_places.points_at,
            weighted: 0,
            unit: self.options.gradient_unit,
            unused0: 0,
            unused1: 0,
            unused2: 0,
        }
    }

    /// Windows of reference rows and the first rows of the elements that each holds whole.
    fn reference_windows(&self, gpu: &Gpu) -> Result<Vec<RowsAndElements>, BackendError> {
        let height = self.reference.height;
        let highest = self.elements.iter().map(|e| e.size[1]).max().unwrap_or(0) as usize;
        let split = windows(height, 0, highest, self.reference.rows_seen(gpu));
        let split = split.ok_or_else(|| too_wide(gpu, self.reference.width))?;
        let last = split.len() - 1;
        Ok(split
            .into_iter()
            .enumerate()
            .map(|(at, rows)| {
                let from = if at == 0 { i32::MIN } else { rows.start as i32 };
                let to = if at == last { i32::MAX } else { rows.end as i32 };
                (rows.start..(rows.end + highest).min(height), from..to)
            })
            .collect())
    }

    /// The dispatches of a residual pass.
    fn split(&self, gpu: &Gpu) -> Result<Vec<Window>, BackendError> {
        const REACH: usize = super::plane::BORDER;
        let (height, stride) = (self.reference.height, self.reference.stride as u64);
        let rows_seen = (gpu.max_binding_bytes / (4 * stride)) as usize;
        let deformed = windows(height, REACH, REACH, rows_seen);
        let deformed = deformed.ok_or_else(|| too_wide(gpu, self.reference.width))?;
        let mut all = Vec::new();
        for (reference, elements) in self.reference_windows(gpu)? {
            for (at, floors) in deformed.iter().enumerate() {
                let pass = layout::Pass {
                    // The plane's own border comes before its rows.
                    deformed_first: floors.start as i32,
                    floors_from: floors.start as i32,
                    floors_to: floors.end as i32,
                    accumulate: u32::from(at > 0),
                    ..self.pass(elements.clone(), reference.start)
                };
                all.push(Window { reference: reference.clone(), deformed: floors.clone(), pass: gpu.uniform(&pass) });
            }
        }
        Ok(all)
    }

    /// Moments of the elements of `list`; with a field, only of their pixels inside the deformed image.
    pub(super) fn moments(
        &self,
        gpu: &Gpu,
        list: &[u32],
        displacement: Option<&Buffer>,
        traffic: &mut Traffic,
    ) -> Result<Vec<ElementMoments>, BackendError> {
        let pipeline = gpu.pipeline(Kernel::NormalMatrix, self.options.interpolation, 0);
        let none = gpu.storage(16, "nothing")?;
        // How grey levels that change as a whole are coupled with the displacement: of all pixels, in elements and in
        // zones.
        let of_zones = displacement.is_none() && self.options.brightness != Brightness::Off;
        let own_transfer = u32::from(self.own_transfer() || of_zones);
        let mut moments = Vec::with_capacity(list.len());
        for list in list.chunks(MOMENTS_AT_ONCE) {
            let numbers = gpu.filled(list, "numbers of elements")?;
            traffic.bytes_up += size_of_val(list);
            let bytes = (4 * MOMENTS * list.len()) as u64;
            let results = gpu.visible(bytes, "moments of the elements")?;
            let mut recorder = gpu.record();
            for (rows, elements) in self.reference_windows(gpu)? {
                let pass = layout::Pass {
                    n_listed: list.len() as u32,
                    weighted: u32::from(displacement.is_some()),
                    own_transfer,
                    ..self.pass(elements, rows.start)
                };
                let uniform = gpu.uniform(&pass);
                let bound = gpu.bind(
                    &pipeline,
                    &[
                        uniform.whole(),
                        self.reference.rows(rows.start, rows.end),
                        self.element_buffer.whole(),
                        displacement.unwrap_or(&none).whole(),
                        self.shape.whole(),
                        numbers.whole(),
                        results.whole(),
                    ],
                );
                recorder.run(&bound, (list.len() as u32).div_ceil(4));
            }
            let bytes = recorder.fetch(&[(&results, bytes)], traffic)?;
            moments.extend(values::<f32>(&bytes).chunks_exact(MOMENTS).map(|sums| self.moments_of(sums)));
        }
        Ok(moments)
    }

    /// What the kernel has summed, gradients in their unit.
    fn moments_of(&self, sums: &[f32]) -> ElementMoments {
        let at = |k: usize| f64::from(sums[k]);
        let unit = f64::from(self.options.gradient_unit);
        let mut moments = ElementMoments { n: at(27), f: at(28), ff: at(29), ..Default::default() };
        for (p, of_product) in moments.gradient.iter_mut().enumerate() {
            for (q, of_eta) in of_product.iter_mut().enumerate() {
                *of_eta = std::array::from_fn(|w| unit * unit * at(9 * p + 3 * q + w));
            }
        }
        moments.transfer = [0, 1].map(|t| std::array::from_fn(|k| unit * at(30 + 8 * t + k)));
        moments
    }

    /// Leaves the elements where `active` is false out of all sums.
    pub(super) fn restrict(&mut self, gpu: &Gpu, active: &[bool]) -> Result<(), BackendError> {
        if active.iter().all(|&active| active) {
            return Ok(());
        }
        for (at, active) in active.iter().enumerate() {
            if !active {
                let Element { nodes, zone, .. } = self.elements[at];
                self.elements[at] = element(&ElementPixels::NONE, nodes, zone);
                self.whole[at] = [0.0; 4];
            }
        }
        let listed: Vec<u32> = (0..).zip(&self.elements).filter(|(_, e)| e.n_runs > 0).map(|(at, _)| at).collect();
        let (shape, places) = shape_of(&listed, &self.pixels);
        self.has_rectangles = listed.len() < self.elements.len();
        self.n_listed = listed.len();
        self.shape = gpu.filled(&shape, "the pixels of elements of any shape")?;
        self.shape_places = places;
        gpu.write(&self.element_buffer, &self.elements);
        gpu.write(&self.whole_buffer, &self.whole);
        self.windows = self.split(gpu)?;
        Ok(())
    }

    /// Notes where the nodes lie in the next coarser level.
    pub(super) fn link(&mut self, gpu: &Gpu, places: &[Place]) -> Result<(), BackendError> {
        let narrow = |place: &Place| layout::Place { nodes: place.nodes, weights: place.weights.map(|w| w as f32) };
        let places: Vec<layout::Place> = places.iter().map(narrow).collect();
        self.places = Some(gpu.filled(&places, "places of the nodes")?);
        Ok(())
    }

    /// Workgroups of a residual pass over `n` elements.
    pub(super) fn residual_groups(&self, n: usize) -> u32 {
        (n as u32).div_ceil(64 / self.lanes)
    }

    /// The residual kernels of a pass at a field, with their workgroups; `light` says where in `transfer` the light
    /// of the nodes begins, 0 that there is none.
    pub(super) fn residual_kernels(
        &self,
        gpu: &Gpu,
        frame: &mut GpuFrame,
        buffers: [&Buffer; 3],
        light: u32,
    ) -> Result<Vec<(Bound, u32)>, BackendError> {
        let kernels = [(Kernel::Residual, self.elements.len()), (Kernel::ResidualRuns, self.n_listed)];
        let kernels = if self.has_rectangles { &kernels[..] } else { &kernels[1..] };
        self.pixel_kernels(gpu, frame, buffers, light, kernels)
    }

    /// Kernels, each of so many elements, that read the pixels of both images.
    pub(super) fn pixel_kernels(
        &self,
        gpu: &Gpu,
        frame: &mut GpuFrame,
        [displacement, transfer, sums]: [&Buffer; 3],
        light: u32,
        of: &[(Kernel, usize)],
    ) -> Result<Vec<(Bound, u32)>, BackendError> {
        let deformed = frame.coefficients(gpu, self.level)?;
        let mut kernels = Vec::new();
        for window in &self.windows {
            let reach = super::plane::BORDER as isize;
            let (from, to) = (window.deformed.start as isize, window.deformed.end as isize);
            let (taps, _) = deformed.rows(from - reach, to + reach);
            let bindings = [
                window.pass.whole(),
                self.reference.rows(window.reference.start, window.reference.end),
                taps,
                self.element_buffer.whole(),
                displacement.whole(),
                transfer.whole(),
                sums.whole(),
                self.shape.whole(),
            ];
            for &(kernel, n) in of.iter().filter(|(_, n)| *n > 0) {
                let pipeline = gpu.pipeline_in_light(kernel, self.options.interpolation, self.lanes, light);
                let bound = gpu.bind(&pipeline, &bindings[..kernel.bindings().len()]);
                kernels.push((bound, self.residual_groups(n)));
            }
        }
        Ok(kernels)
    }
}

fn element(pixels: &ElementPixels, nodes: [u32; 4], zone: u32) -> Element {
    Element {
        nodes,
        corner: [pixels.x, pixels.y],
        size: [u32::from(pixels.nx), u32::from(pixels.ny)],
        local: [pixels.xi0, pixels.dxi, pixels.eta0, pixels.deta],
        first_run: pixels.first_run,
        n_runs: pixels.n_runs,
        zone,
        unused: 0,
    }
}

/// Numbers of the elements with runs, their runs and the local coordinates of their pixels, in one buffer.
fn shape_of(listed: &[u32], pixels: &PixelMap) -> (Vec<u32>, ShapePlaces) {
    let mut shape = listed.to_vec();
    let runs_at = shape.len() as u32;
    shape.extend(pixels.runs().iter().flat_map(|run| [run.x as u32, run.y as u32, run.n, run.at]));
    let points_at = shape.len() as u32;
    if !pixels.runs().is_empty() {
        shape.extend(pixels.xi().iter().zip(pixels.eta()).flat_map(|(xi, eta)| [xi.to_bits(), eta.to_bits()]));
    }
    shape.push(0); // never empty
    (shape, ShapePlaces { runs_at, points_at })
}

/// Where each node's elements begin, then 4 element + corner.
fn incidence_of(pattern: &Pattern) -> Vec<u32> {
    let n = pattern.n_nodes();
    let mut incidence = Vec::with_capacity(6 * n);
    let mut at = n as u32 + 1;
    for node in 0..n {
        incidence.push(at);
        at += pattern.elements_of(node).len() as u32;
    }
    incidence.push(at);
    for node in 0..n {
        incidence.extend(pattern.elements_of(node).iter().map(|&(element, corner)| 4 * element + u32::from(corner)));
    }
    incidence
}
