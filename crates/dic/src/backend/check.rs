//! Whether a graphics device computes what the CPU does: small pairs of images through every kernel of both.
//!
//! An iteration on a device that is wrong in its matrix ends late or never. On one that is wrong in its residual (a sum
//! that loses a lane, a place of sampling that is off, a wrong gain of the prefilter) it ends as converged, somewhere
//! else, with nothing to tell: only another device can.

use super::cpu::CpuBackend;
use super::{Ahead, Backend, BackendError, ElementMoments, GreyTransfer, KernelOptions, PixelSums, Place, couple};
use crate::field::Brightness;
use crate::imaging::{Image, Interpolation, Pixels};
use crate::linalg::{BlockMatrix, ElementMatrix, Pattern, Solver};
use crate::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone, shape_functions};
use serde::Serialize;
use std::sync::Arc;

/// Columns and rows of the images: odd, and no whole number of elements, groups or words.
const SIZE: [usize; 2] = [131, 97];
/// Side of the elements, px.
const ELEMENT: usize = 12;
/// Steps of an iteration, after which less is left than the devices may differ by.
const STEPS: usize = 20;
/// What sums of single-precision numbers may differ by, as a share of the largest of them: some hundred roundings.
const SUMS: f64 = 3e-5;
/// The same of moments of gradients: one that lies between two whole numbers of its unit is rounded either way.
const MOMENTS: f64 = 3e-4;
/// The same of sums of residuals, which are small differences of grey levels.
const RESIDUALS: f64 = 3e-4;
/// What displacements may differ by, px.
const DISPLACEMENTS_PX: f64 = 2e-5;

/// One kind of numbers, on a device and on the CPU.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// What they are, and in which of the settings.
    pub what: String,
    /// Their unit; empty for sums, whose differences are shares of the largest.
    pub unit: &'static str,
    /// The largest difference of the two devices; infinite where one of them gives no number, or another count.
    pub difference: f64,
    /// What round-off may make of it.
    pub allowed: f64,
}

impl Compared {
    fn share(&self) -> f64 {
        self.difference / self.allowed
    }
}

/// What the comparison of a device with the CPU found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DeviceCheck {
    /// Every kind of numbers that were compared.
    pub compared: Vec<Compared>,
}

impl DeviceCheck {
    /// Compares `backend` with the CPU.
    ///
    /// # Errors
    /// When the device fails.
    pub fn of<B: Backend>(backend: &B) -> Result<Self, BackendError> {
        let mut compared = Vec::new();
        for setting in settings() {
            let (found, wanted) =
                (setting.compute_on(backend)?, setting.compute_on(&CpuBackend::new(backend.host_isa()))?);
            compared
                .extend(found.into_iter().zip(wanted).map(|(found, wanted)| found.compare_with(&wanted, setting.name)));
        }
        Ok(Self { compared })
    }

    /// The numbers that differ most, by what they may.
    pub fn worst(&self) -> Option<&Compared> {
        self.compared.iter().max_by(|a, b| a.share().total_cmp(&b.share()))
    }

    /// Whether all differ by no more than round-off.
    pub fn is_right(&self) -> bool {
        self.compared.iter().all(|compared| compared.share() <= 1.0)
    }

    /// The same as a fault of `device`, where it is one.
    ///
    /// # Errors
    /// [`BackendError::Wrong`].
    pub fn right(&self, device: String) -> Result<(), BackendError> {
        let wrong = self.worst().filter(|_| !self.is_right());
        wrong.map_or(Ok(()), |Compared { what, unit, difference, allowed }| {
            let unit = if unit.is_empty() { "of the largest" } else { unit };
            let (difference, allowed) = (format!("{difference:.1e} {unit}"), format!("{allowed:.1e}"));
            Err(BackendError::Wrong { device, what: what.clone(), difference, allowed })
        })
    }
}

/// Numbers of one kind on one device.
struct Seen {
    what: &'static str,
    values: Vec<f64>,
    tolerance: Tolerance,
}

#[derive(Clone, Copy)]
enum Tolerance {
    /// A share of the largest.
    Share(f64),
    Px(f64),
}

impl Seen {
    fn compare_with(self, wanted: &Self, setting: &str) -> Compared {
        let largest = wanted.values.iter().fold(f64::MIN_POSITIVE, |largest, v| largest.max(v.abs()));
        let (unit, scale, allowed) = match self.tolerance {
            Tolerance::Share(share) => ("", largest, share),
            Tolerance::Px(px) => ("px", 1.0, px),
        };
        let apart = |(a, b): (&f64, &f64)| if a.is_finite() { (a - b).abs() / scale } else { f64::INFINITY };
        let difference = match self.values.len() == wanted.values.len() {
            true => self.values.iter().zip(&wanted.values).map(apart).fold(0.0, f64::max),
            false => f64::INFINITY,
        };
        Compared { what: format!("{} ({setting})", self.what), unit, difference, allowed }
    }
}

/// What devices are asked to do.
struct Setting {
    name: &'static str,
    images: [Arc<Image>; 2],
    zones: Vec<Zone>,
    options: KernelOptions,
    /// Whether the matrix is that of the data with a penalty.
    regularised: bool,
}

fn settings() -> [Setting; 2] {
    let rectangle = Zone::rectangle("rectangle", Roi { x0: 1.0, y0: 1.0, x1: 70.0, y1: 95.0 });
    let polygon = vec![[75.5, 4.0], [128.0, 11.0], [123.0, 91.0], [78.0, 85.0]];
    let polygon = Zone { name: "polygon".into(), polygon, ..Zone::default() };
    let setting = |name, depth: u32, interpolation, brightness, zones, regularised| {
        let white = (1u32 << depth) - 1;
        let options = KernelOptions::new((0.0, white as f32), interpolation, brightness);
        Setting { name, images: [0.0, 1.0].map(|moved| Arc::new(image(moved, depth))), zones, options, regularised }
    };
    let zones = vec![rectangle.clone(), polygon];
    [
        setting("8 bit, cubic, brightness of zones", 8, Interpolation::Cubic, Brightness::Zone, zones, false),
        setting(
            "16 bit, quintic, brightness of elements",
            16,
            Interpolation::Quintic,
            Brightness::Element,
            vec![rectangle],
            true,
        ),
    ]
}

/// The displacement of a place of the images, px.
fn motion([x, y]: [f64; 2]) -> [f64; 2] {
    [2.3 + 0.6 * (0.05 * x + 0.03 * y).sin(), -1.6 + 0.5 * (0.04 * y - 0.02 * x).cos()]
}

/// Waves of 5 to 14 px across each other, of `depth` bits; all of the motion where `moved` is 1.
fn image(moved: f64, depth: u32) -> Image {
    const WAVES: [[f64; 3]; 6] = [
        [1.21, 0.16, 0.3],
        [-0.31, 0.97, 1.7],
        [0.62, 0.71, 2.9],
        [0.83, -0.55, 0.8],
        [0.20, -0.47, 4.1],
        [-0.44, -0.11, 5.3],
    ];
    let white = f64::from((1u32 << depth) - 1);
    let light = if moved > 0.0 { [0.93, 0.02] } else { [1.0, 0.0] };
    let grey = |at: usize| {
        let place = [(at % SIZE[0]) as f64, (at / SIZE[0]) as f64];
        let u = motion(place);
        let [x, y] = [place[0] - moved * u[0], place[1] - moved * u[1]];
        let waves: f64 = WAVES.iter().map(|[kx, ky, phase]| (kx * x + ky * y + phase).sin()).sum();
        white * (light[0] * (0.5 + 0.07 * waves) + light[1])
    };
    let all = 0..SIZE[0] * SIZE[1];
    let pixels = match depth {
        8 => Pixels::U8(all.map(|at| grey(at).round() as u8).collect()),
        _ => Pixels::U16(all.map(|at| grey(at).round() as u16).collect()),
    };
    Image::new(SIZE[0], SIZE[1], pixels).expect("as many pixels as it has")
}

impl Setting {
    /// What `backend` makes of it.
    fn compute_on<B: Backend>(&self, backend: &B) -> Result<Vec<Seen>, BackendError> {
        let fine = PixelMesh::on_zones(&self.zones, ELEMENT, ELEMENT_SHARE, SIZE).expect("zones that fit");
        let coarse = fine.halved(ELEMENT, SIZE.map(|n| n / 2)).expect("a coarser level");
        let mut frames = [None, None];
        for (frame, image) in frames.iter_mut().zip(&self.images) {
            *frame = Some(backend.frame(image.clone(), &self.options)?);
        }
        let [Some(mut reference), Some(mut deformed)] = frames else { unreachable!("both were made") };
        let mut seen = Vec::new();
        let mut add = |what, values, tolerance| seen.push(Seen { what, values, tolerance });

        // The coarser level: a start from the host, an iteration.
        let (coarser, moments) = backend.reference(&mut reference, 1, &coarse, &self.options, None)?;
        add("moments of elements, level 1", of_moments(&moments), Tolerance::Share(MOMENTS));
        let solver = backend.solver(&coarser, self.solver(&coarse, &moments))?;
        let start: Vec<[f64; 2]> = coarse.mesh.nodes().iter().map(|[x, y]| motion([2.0 * x, 2.0 * y])).collect();
        let start: Vec<[f64; 2]> = start.iter().map(|u| [0.5 * u[0] + 0.2, 0.5 * u[1] - 0.15]).collect();
        let transfer = vec![GreyTransfer { gain: 1.04, offset: -1.5 }; self.zones.len()];
        let mut field = backend.start(&coarser, &mut deformed, &start, &transfer)?;
        backend.observe(&coarser, &mut deformed, &mut field)?;
        let rhs = backend.right_hand_side(&coarser, &mut deformed, &field)?;
        add("right-hand side, level 1", rhs.into_flattened(), Tolerance::Share(RESIDUALS));
        for _ in 0..STEPS {
            backend.step(&coarser, &mut deformed, &mut field, &solver, [1.0, 0.0], &Ahead::NONE)?;
        }
        let found = backend.read_field(&coarser, &mut deformed, &field)?;
        add("displacement, level 1", found.displacement.into_flattened(), Tolerance::Px(DISPLACEMENTS_PX));

        // The image itself: from the coarser field on, with elements at the border that have lost pixels.
        let (mut level, moments) = backend.reference(&mut reference, 0, &fine, &self.options, None)?;
        add("moments of elements", of_moments(&moments), Tolerance::Share(MOMENTS));
        backend.link(&mut level, places(&fine, &coarse))?;
        let solver = backend.solver(&level, self.solver(&fine, &moments))?;
        let mut field = backend.start_finer(&level, &mut deformed, &field, true)?;
        let began = backend.read_field(&level, &mut deformed, &field)?;
        // The double of what the coarser level differs by.
        add("displacement of a start", began.displacement.into_flattened(), Tolerance::Px(2.0 * DISPLACEMENTS_PX));
        // From the same numbers on both devices.
        let start: Vec<[f64; 2]> = fine.mesh.nodes().iter().map(|&at| motion(at)).collect();
        let start: Vec<[f64; 2]> = start.iter().map(|u| [u[0] + 0.23, u[1] - 0.31]).collect();
        backend.place(&level, &mut deformed, &mut field, &start)?;
        let zones = backend.observe(&level, &mut deformed, &mut field)?;
        add("sums of zones", of_sums(zones.iter().map(|(sums, _)| sums)), Tolerance::Share(SUMS));
        add("residual of zones", zones.iter().map(|(sums, _)| sums.rr).collect(), Tolerance::Share(RESIDUALS));
        let rhs = backend.right_hand_side(&level, &mut deformed, &field)?;
        add("right-hand side", rhs.into_flattened(), Tolerance::Share(RESIDUALS));
        let (sums, _) = backend.element_sums(&level, &mut deformed, &field)?;
        add("sums of elements", of_sums(sums.iter()), Tolerance::Share(SUMS));
        add("residual of elements", sums.iter().map(|sums| sums.rr).collect(), Tolerance::Share(RESIDUALS));
        let remaining = backend.remaining_moments(&level, &mut deformed, &field)?;
        let numbers = remaining.iter().map(|(element, _)| *element as f64).collect();
        add("elements that have lost pixels", numbers, Tolerance::Share(0.1 / fine.mesh.n_elements() as f64));
        let remaining: Vec<ElementMoments> = remaining.into_iter().map(|(_, moments)| moments).collect();
        add("moments of what is left of them", of_moments(&remaining), Tolerance::Share(MOMENTS));
        let mut ahead = Ahead::NONE;
        for left in (0..STEPS).rev() {
            let step = backend.step(&level, &mut deformed, &mut field, &solver, [1.0, 0.0], &ahead)?;
            // The others follow without a word from the host, unless elements are lost or come back.
            ahead = Ahead {
                steps: left.saturating_sub(1),
                correction_px: [0.0, f64::INFINITY],
                lost: step.lost,
                counted: [0.0, f64::INFINITY],
            };
        }
        let found = backend.read_field(&level, &mut deformed, &field)?;
        let matches = found.elements.iter().flat_map(|e| [e.correlation, e.n / (ELEMENT * ELEMENT) as f64]);
        // They come as 16-bit numbers.
        add("match of elements", matches.collect(), Tolerance::Share(1e-4));
        add("displacement", found.displacement.into_flattened(), Tolerance::Px(DISPLACEMENTS_PX));
        let at = (&*start, &*transfer);
        let mut three_steps = |together| three_steps(backend, (&level, &mut deformed), &solver, at, together);
        let (one_by_one, together) = (three_steps(0)?, three_steps(2)?);
        let apart = one_by_one.iter().zip(&together).map(|(one, other)| one - other).collect();
        add("steps made together and one by one", apart, Tolerance::Px(DISPLACEMENTS_PX));

        // Elements left out, and in another light.
        let excluded: Vec<bool> = (0..fine.mesh.n_elements()).map(|element| element % 5 == 0).collect();
        backend.exclude(&level, &mut deformed, &mut field, &excluded)?;
        backend.place(&level, &mut deformed, &mut field, &start)?;
        backend.observe(&level, &mut deformed, &mut field)?;
        let sums = backend.all_sums(&level, &mut deformed, &field)?;
        add("sums of all elements", of_sums(sums.iter()), Tolerance::Share(SUMS));
        if self.options.brightness != Brightness::Element {
            let nodes = fine.mesh.nodes().iter();
            let light = nodes.map(|[x, y]| GreyTransfer { gain: 1.0 + 1e-3 * (x - y), offset: 0.02 * (x + y) });
            backend.light(&level, &mut deformed, &mut field, &light.collect::<Vec<_>>())?;
            backend.observe(&level, &mut deformed, &mut field)?;
            let (sums, _) = backend.element_sums(&level, &mut deformed, &field)?;
            add("sums of elements in another light", of_sums(sums.iter()), Tolerance::Share(SUMS));
        }
        Ok(seen)
    }

    fn solver(&self, mesh: &PixelMesh, moments: &[ElementMoments]) -> Solver {
        let (mesh, of_elements) = (&mesh.mesh, self.options.brightness == Brightness::Element);
        let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
        let matrix = |moments: &ElementMoments| match of_elements {
            true => moments.matrix_without_transfer(),
            false => moments.matrix(),
        };
        let matrices: Vec<ElementMatrix> = moments.iter().map(matrix).collect();
        let data = BlockMatrix::assemble(&pattern, mesh.elements(), &matrices);
        let coupled = |solver: Solver| couple(solver, &pattern, moments, self.options.brightness);
        if !self.regularised {
            return coupled(Solver::iterative(data));
        }
        // Neighbours are drawn together by a thirtieth of what the data hold them with.
        let weight = 3e-2 * matrices.iter().map(|matrix| matrix[0]).sum::<f64>() / matrices.len().max(1) as f64;
        let together = std::array::from_fn(|a| std::array::from_fn(|b| if a == b { 0.75 } else { -0.25 }));
        let penalty = vec![crate::linalg::alike(together, weight); mesh.n_elements()];
        let penalty = Arc::new(BlockMatrix::assemble(&pattern, mesh.elements(), &penalty));
        let order: Vec<usize> = (0..mesh.n_nodes()).collect();
        // A device that is wrong may give moments of nothing; they are compared all the same.
        coupled(Solver::regularised(data.clone(), penalty, &order).unwrap_or_else(|_| Solver::iterative(data)))
    }
}

/// Where three steps from a start end, of which so many may follow the first `together`, without a word from the host.
fn three_steps<B: Backend>(
    backend: &B,
    (level, frame): (&B::Level, &mut B::Frame),
    solver: &B::Solver,
    (displacement, transfer): (&[[f64; 2]], &[GreyTransfer]),
    together: usize,
) -> Result<Vec<f64>, BackendError> {
    let scale = [1.0, 0.0];
    // What is lost where they begin, to which they are bound.
    let mut field = backend.start(level, frame, displacement, transfer)?;
    let lost = backend.step(level, frame, &mut field, solver, scale, &Ahead::NONE)?.lost;
    let mut field = backend.start(level, frame, displacement, transfer)?;
    for left in (0..3).rev() {
        let steps = together.min(left);
        let ahead = Ahead { steps, correction_px: [0.0, f64::INFINITY], lost, counted: [0.0, f64::INFINITY] };
        backend.step(level, frame, &mut field, solver, scale, &ahead)?;
    }
    Ok(backend.read_field(level, frame, &field)?.displacement.into_flattened())
}

/// Where the nodes of the fine mesh lie in the coarse one.
fn places(fine: &PixelMesh, coarse: &PixelMesh) -> Vec<Place> {
    let place = |(at, &zone): (&[f64; 2], &u32)| {
        let [x, y] = at.map(|v| 0.5 * v - 0.25);
        let (element, xi, eta) = coarse.mesh.nearest(zone as usize, x, y);
        Place { nodes: coarse.mesh.elements()[element], weights: shape_functions(xi, eta) }
    };
    fine.mesh.nodes().iter().zip(fine.mesh.node_zone()).map(place).collect()
}

/// Numbers of moments, each kind by its own scale: products of gradients, and pixels.
fn of_moments(moments: &[ElementMoments]) -> Vec<f64> {
    moments.iter().flat_map(|of| of.gradient.into_iter().flatten().flatten()).collect()
}

/// Numbers of sums of grey levels, by the mean square of a pixel.
fn of_sums<'a>(sums: impl Iterator<Item = &'a PixelSums>) -> Vec<f64> {
    sums.flat_map(|of| [of.n, of.f, of.ff, of.g, of.gg, of.fg]).collect()
}
