//! Whole frames on the GPU against the CPU: the same field, uncertainty and outcome, with few words between host
//! and device; bad input and failing devices included.

#![cfg(feature = "gpu")]

use crate::common;
use common::gpu::{device, device_with};
use common::*;
use quadrille::backend::gpu::{GpuBackend, GpuOptions};
use quadrille::backend::{Backend, BackendError, GreyTransfer};
use quadrille::correlate::{
    Correlate, Correlation, CorrelationError, Correlator, Options, Regularisation, Start, StartUsed, TextureFault,
    Tracker,
};
use quadrille::field::{Brightness, Elements, StartFrom, Status};
use quadrille::imaging::{Image, Interpolation, Levels, Pixels};
use quadrille::io::images::read_image;
use quadrille::linalg::SolverChoice;
use quadrille::mesh::{Guard, Mask, Zone};
use quadrille::synth::{
    Accuracy, Affine, Depth, Motion, Peel, RenderOptions, Rotation, Sinusoids, Texture, Translation, render,
};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// Both sides iterate to this; the requirement on their difference says so.
const TOLERANCE_PX: f64 = 1e-5;

fn tight(options: Options) -> Options {
    Options { tolerance_px: TOLERANCE_PX, tolerance_by_sigma: 0.0, ..options }
}

// ---- Comparing ---------------------------------------------------------------------------------------

/// Largest difference of a node's displacement, px, and the largest in parts of what is allowed there: the larger
/// of 2e-5 px and a thousandth of the node's standard uncertainty (the requirement).
fn apart(cpu: &Correlation, gpu: &Correlation) -> (f64, f64) {
    let (a, b) = (&cpu.measurement, &gpu.measurement);
    let (mut largest, mut by_allowed) = (0.0f64, 0.0f64);
    // Light that does not settle bends with what is little known of the displacement, and magnifies round-off there.
    let share = if cpu.zones.iter().any(|zone| zone.light.is_some()) { 3e-3 } else { 1e-3 };
    for (node, (a_u, b_u)) in a.displacement.iter().zip(&b.displacement).enumerate() {
        for c in 0..2 {
            let difference = (a_u[c] - b_u[c]).abs();
            largest = largest.max(difference);
            by_allowed = by_allowed.max(difference / (share * a.sigma[node][c]).max(2e-5));
        }
    }
    (largest, by_allowed)
}

#[track_caller]
fn assert_near(what: &str, [a, b]: [f64; 2], allowed: f64) {
    assert!((a - b).abs() <= allowed, "{what}: CPU {a}, GPU {b}, which may differ by {allowed:e}");
}

/// Everything of a frame that a user is told. Numbers of single precision that follow from sums over thousands of
/// pixels agree to 1e-4.
#[track_caller]
fn assert_same(what: &str, cpu: &Correlation, gpu: &Correlation, grey_range: f64) {
    let (a, b) = (&cpu.measurement, &gpu.measurement);
    assert_eq!(a.status, b.status, "{what}");
    assert_finite(gpu);
    assert_eq!(a.measured, b.measured, "{what}: nodes measured");
    let (largest, by_allowed) = apart(cpu, gpu);
    println!(
        "{what}: {largest:.1e} px ({by_allowed:.2} of what is allowed), {} + {} iterations, CPU {} + {}, {:?}",
        gpu.coarse_iterations, gpu.iterations, cpu.coarse_iterations, cpu.iterations, a.status
    );
    assert!(by_allowed <= 1.0, "{what}: {largest} px, {by_allowed} times what is allowed");
    assert_eq!(cpu.poor_elements, gpu.poor_elements, "{what}: poor elements");
    assert_eq!(cpu.nodes_left, gpu.nodes_left, "{what}: nodes left");
    assert_eq!(cpu.start, gpu.start, "{what}: where it started");
    assert_near(what, [cpu.residual_rms, gpu.residual_rms], 1e-4 * cpu.residual_rms + 1e-6 * grey_range);
    for (a, b) in a.sigma.iter().flatten().zip(b.sigma.iter().flatten()) {
        // Of a node that the texture hardly determines the part of the noise is taken off, which magnifies round-off.
        assert_near(what, [*a, *b], 1e-3 * a);
    }
    for (a, b) in a.element_residual.iter().zip(&b.element_residual) {
        // An element of a few pixels feels 2e-5 px of displacement times its gradient.
        assert_near(what, [*a, *b], 1e-3 * a + 1e-5 * grey_range);
    }
    for (a, b) in cpu.zones.iter().zip(&gpu.zones) {
        assert_near(what, [a.transfer.gain, b.transfer.gain], 1e-4 * a.transfer.gain.abs());
        assert_near(what, [a.transfer.offset, b.transfer.offset], 1e-4 * grey_range);
        assert_near(what, [a.correlation, b.correlation], 1e-4);
        assert_near(what, [a.residual_rms, b.residual_rms], 1e-4 * a.residual_rms + 1e-6 * grey_range);
        assert_near(what, [a.noise, b.noise], 1e-4 * a.noise + 1e-6 * grey_range);
    }
}

/// The requirement on what goes between host and device: one wait per iteration and two more (a cold frame asks for
/// the match of its first starts too), and 20 bytes per node where it may be the end, after three, four and five
/// iterations, and at the end, with 64 per iteration.
#[track_caller]
fn assert_few_words(what: &str, found: &Correlation, image: &Image) {
    let traffic = found.traffic.expect("a GPU counts its traffic");
    let iterations = found.iterations + found.coarse_iterations;
    let nodes = found.measurement.mesh.n_nodes();
    // One at the end: what the residual follows beyond the field, 96 bytes per element.
    assert!(traffic.readbacks <= iterations + 3, "{what}: {traffic:?}, {iterations} iterations");
    let ends = 1 + found.iterations.saturating_sub(3).min(3);
    let bent = 96 * found.measurement.mesh.n_elements();
    assert!(traffic.bytes_down <= 20 * nodes * ends + 64 * iterations + bent, "{what}: {traffic:?}, {nodes} nodes");
    let pixels = image.width() * image.height();
    let bytes = match image.pixels() {
        Levels::U8(_) => pixels,
        Levels::U16(_) => 2 * pixels,
        Levels::F32(_) => 4 * pixels,
    };
    // The image once, in its own depth; starts of 16 bytes per node.
    assert!((bytes..=bytes + 64 * nodes + 4096).contains(&traffic.bytes_up), "{what}: {traffic:?}");
}

/// The nodes of faults, and what they lack.
fn named(faults: &[TextureFault]) -> Vec<(usize, &'static str)> {
    faults.iter().map(|fault| (fault.node, fault.lack.name())).collect()
}

/// Correlates `deformed` cold on both devices and compares.
#[track_caller]
fn assert_parity(
    gpu: &GpuBackend,
    what: &str,
    pair: &[Arc<Image>; 2],
    zones: &[Zone],
    options: Options,
) -> Correlation {
    let [reference, deformed] = pair;
    let options = tight(options);
    let on_cpu = prepared(reference, zones, options.clone());
    let on_gpu = prepared_on(gpu.clone(), reference, zones, options.clone());
    assert_eq!(named(on_cpu.dropped()), named(on_gpu.dropped()), "{what}: nodes dropped");
    assert_eq!(named(on_cpu.held()), named(on_gpu.held()), "{what}: nodes held");
    let cpu = on_cpu.correlate(deformed.clone(), None).unwrap();
    let gpu = on_gpu.correlate(deformed.clone(), None).unwrap();
    assert_same(what, &cpu, &gpu, on_cpu.grey_range());
    gpu
}

/// A pair of pictures at rest and under a motion, with noise of two grey levels.
fn noisy_pair<M: Motion>(motion: &M, options: &RenderOptions) -> [Arc<Image>; 2] {
    let options = RenderOptions { noise: 2.0, ..*options };
    [picture(&REST, &options), picture(motion, &RenderOptions { frame: 1, ..options })]
}

// ---- Fields ------------------------------------------------------------------------------------------

#[test]
fn fields_of_every_kind_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 352;
    let motion = Accuracy::about([176.0; 2], Sinusoids { amplitude: 1.0, wavelength: 256.0 }, 0.005, 1.0);
    let pair = noisy_pair(&motion, &eight_bit(side, side));
    for (interpolation, brightness, element_size) in [
        (Interpolation::Cubic, Brightness::Zone, 16),
        (Interpolation::Cubic, Brightness::Element, 12),
        (Interpolation::Quintic, Brightness::Element, 17),
        (Interpolation::Quintic, Brightness::Zone, 32),
        (Interpolation::Keys, Brightness::Off, 10),
        (Interpolation::Bilinear, Brightness::Zone, 24),
        (Interpolation::Cubic, Brightness::Off, 128),
    ] {
        let options = Options { interpolation, brightness, element_size, ..Options::default() };
        let what = format!("{}, brightness {brightness}, {element_size} px", interpolation.name());
        let found = assert_parity(&gpu, &what, &pair, &inside(side, side, 8), options);
        assert_few_words(&what, &found, &pair[1]);
    }
}

#[test]
fn small_elements_on_odd_images_of_every_depth_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let (width, height) = (147, 109);
    let motion = Affine::new([[0.004, -0.003], [0.002, -0.005]], width, height);
    for (depth, element_size) in [(Depth::U8, 8), (Depth::U16, 5), (Depth::F32, 4), (Depth::U16, 16)] {
        let pair = noisy_pair(&motion, &RenderOptions { depth, ..RenderOptions::new(width, height) });
        let what = format!("{depth:?}, {element_size} px");
        let options = Options { element_size, drop_textureless: true, ..Options::default() };
        let found = assert_parity(&gpu, &what, &pair, &inside(width, height, 6), options);
        assert_few_words(&what, &found, &pair[1]);
    }
}

#[test]
fn large_motions_are_caught_as_by_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 512;
    // No margin for the translation: an edge of the specimen leaves the image, and the frame has its own matrix.
    let pair = noisy_pair(&Translation([60.0, -0.3]), &eight_bit(side, side));
    assert_parity(&gpu, "60 px", &pair, &inside(side, side, 0), Options::default());
    let pair = noisy_pair(&Translation([-42.3, 42.6]), &eight_bit(side, side));
    let found = assert_parity(&gpu, "-42.3, 42.6 px", &pair, &inside(side, side, 64), Options::default());
    assert_few_words("-42.3, 42.6 px", &found, &pair[1]);
    let pair = noisy_pair(&Rotation::new(5.0, 384, 384), &eight_bit(384, 384));
    assert_parity(&gpu, "5 degrees", &pair, &inside(384, 384, 32), Options::default());
    assert_parity(&gpu, "5 degrees, no margin", &pair, &inside(384, 384, 0), Options::default());
}

#[test]
fn zones_that_part_are_found_as_by_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 416;
    let motion = Peel { band_px: 60.0, opening_px: 30.0, slide_px: 6.0, ..Peel::new(side, side) };
    let options = RenderOptions { noise: 2.0, ..eight_bit(side, side) };
    let pair = [picture(&motion.at(0.0), &options), picture(&motion, &RenderOptions { frame: 1, ..options })];
    let zones = [
        Zone { guard: Guard::All(3.0), ..zone("upper", [16.0, 40.0, 400.0, 168.0]) },
        zone("lower", [16.5, 248.0, 399.0, 376.0]),
    ];
    for brightness in [Brightness::Zone, Brightness::Element] {
        assert_parity(
            &gpu,
            &format!("peel, {brightness}"),
            &pair,
            &zones,
            Options { brightness, ..Options::default() },
        );
    }
}

#[test]
fn a_change_of_light_is_followed_as_by_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 320;
    let [reference, deformed] = noisy_pair(&Accuracy::new(side, side), &float(side, side));
    let dimmed = changed(&deformed, |_, _, grey| 0.7 * grey + 20.0);
    let shaded = changed(&deformed, |x, y, grey| grey * (0.7 + 0.001 * x as f32) + 0.1 * y as f32);
    for (what, image, brightness) in [
        ("dimmed, zone", &dimmed, Brightness::Zone),
        ("dimmed, element", &dimmed, Brightness::Element),
        ("shaded, element", &shaded, Brightness::Element),
        ("shaded, smooth", &shaded, Brightness::Smooth),
        ("shaded, auto", &shaded, Brightness::Auto),
    ] {
        let pair = [reference.clone(), image.clone()];
        assert_parity(&gpu, what, &pair, &inside(side, side, 16), Options { brightness, ..Options::default() });
    }
}

/// A blank hole in a picture that moves by (3, 2) px.
fn holed(side: usize) -> [Arc<Image>; 2] {
    [[0, 0], [3, 2]].map(|[dx, dy]| {
        let image = picture(&Translation([dx as f64, dy as f64]), &float(side, side));
        let hole = |x: usize, y: usize| (76..140).contains(&x) && (92..150).contains(&y);
        rounded(&changed(&image, |x, y, grey| if hole(x - dx.min(x), y - dy.min(y)) { 90.0 } else { grey }))
    })
}

#[test]
fn places_without_texture_are_dropped_or_held_as_by_the_cpu() {
    let Some(gpu) = device() else { return };
    let pair = holed(224);
    let zones = inside(224, 224, 12);
    let options = Options { drop_textureless: true, ..Options::default() };
    assert_parity(&gpu, "dropped", &pair, &zones, options);
    for (what, regularisation) in [
        ("held by Tikhonov", Regularisation::Tikhonov { cutoff_px: 60.0 }),
        ("held by equilibrium", Regularisation::EquilibriumGap { cutoff_px: 80.0, poisson: 0.33 }),
    ] {
        let found = assert_parity(&gpu, what, &pair, &zones, Options { regularisation, ..Options::default() });
        // The host solves: one more wait per iteration, and right-hand side and field go down.
        let traffic = found.traffic.unwrap();
        let iterations = found.iterations + found.coarse_iterations;
        assert!(traffic.readbacks <= 2 * iterations + 3, "{what}: {traffic:?}, {iterations} iterations");
    }
}

#[test]
fn the_direct_solver_gives_the_field_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let pair = noisy_pair(&Accuracy::new(320, 320), &eight_bit(320, 320));
    let options = Options { solver: SolverChoice::Direct, ..Options::default() };
    assert_parity(&gpu, "direct", &pair, &inside(320, 320, 16), options);
}

#[test]
fn cubic_splines_give_the_field_of_the_cpu_on_rectangles_and_masks_that_lose_pixels() {
    let Some(gpu) = device() else { return };
    let pair = noisy_pair(&Accuracy::new(320, 320), &eight_bit(320, 320));
    let polygon = vec![[0.0, 3.0], [320.0, 0.0], [290.0, 310.0], [130.0, 240.0], [5.0, 320.0]];
    let shapes = [
        ("splines inside", inside(320, 320, 16)),
        ("splines, whole image", inside(320, 320, 0)),
        ("splines in a polygon", vec![Zone { name: "poly".into(), polygon, ..Zone::default() }]),
    ];
    for (what, zones) in shapes {
        let options = Options { elements: Elements::CubicSpline, ..Options::default() };
        let found = assert_parity(&gpu, what, &pair, &zones, options);
        // The host solves, as with a regularisation.
        let traffic = found.traffic.unwrap();
        if what == "splines inside" {
            assert!(traffic.readbacks <= 3 * (found.iterations + found.coarse_iterations) + 4, "{what}: {traffic:?}");
        }
    }
}

const SIZE: [usize; 2] = [261, 203];
const INSIDE: [f64; 4] = [18.0, 20.0, 242.0, 180.0];

#[test]
fn regions_of_every_shape_give_the_field_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let [width, height] = SIZE;
    let pair = noisy_pair(&Sinusoids { amplitude: 0.8, wavelength: 96.0 }, &eight_bit(width, height));
    let disc = |k: usize| ((k % width) as f64 - 130.0).hypot((k / width) as f64 - 100.0) < 80.0;
    let bits = (0..width * height).map(disc).collect();
    let polygon = vec![[20.3, 17.0], [240.0, 30.0], [220.0, 190.0], [120.0, 150.0], [15.0, 185.0]];
    let hole = vec![[90.0, 70.0], [140.0, 75.0], [120.0, 120.0]];
    let shapes = [
        ("mask", Zone { name: "disc".into(), mask: Mask::new(width, height, bits).map(Arc::new), ..Zone::default() }),
        (
            "polygon",
            Zone { name: "poly".into(), polygon, exclude: vec![hole], guard: Guard::All(2.0), ..Zone::default() },
        ),
        ("free quadrilaterals", free_zone(free_mesh(INSIDE, 16.0, 3.0, false))),
        ("triangles", free_zone(free_mesh(INSIDE, 32.0, 5.0, true))),
    ];
    for (what, zone) in shapes {
        for (brightness, interpolation) in
            [(Brightness::Smooth, Interpolation::Cubic), (Brightness::Element, Interpolation::Quintic)]
        {
            let options =
                Options { brightness, interpolation, element_size: 13, drop_textureless: true, ..Options::default() };
            assert_parity(&gpu, &format!("{what}, {brightness}"), &pair, std::slice::from_ref(&zone), options);
        }
    }
}

// ---- Images of real tests ----------------------------------------------------------------------------

#[track_caller]
fn read(folder: &Path, name: &str) -> Arc<Image> {
    Arc::new(read_image(&folder.join(name), 0).expect("an image of the data folder").image)
}

/// The part of a real image, 512 px a side at most, in its own depth.
#[track_caller]
fn part(image: &Image, (x0, y0): (usize, usize), width: usize, height: usize) -> Arc<Image> {
    fn of<T: Copy>(all: &[T], stride: usize, (x0, y0): (usize, usize), width: usize, height: usize) -> Vec<T> {
        (y0..y0 + height).flat_map(|y| all[y * stride + x0..][..width].to_vec()).collect()
    }
    let (stride, at) = (image.width(), (x0, y0));
    let pixels = match image.pixels() {
        Levels::U8(p) => Pixels::U8(of(p, stride, at, width, height)),
        Levels::U16(p) => Pixels::U16(of(p, stride, at, width, height)),
        Levels::F32(p) => Pixels::F32(of(p, stride, at, width, height)),
    };
    Arc::new(Image::new(width, height, pixels).unwrap())
}

#[test]
fn real_images_give_the_field_of_the_cpu() {
    let Some(gpu) = device() else { return };
    type Case = (&'static str, &'static str, &'static [&'static str], (usize, usize), [usize; 2], [f64; 4], f64);
    // Folder, reference, frames, the part taken, its size, the zone in it, cut-off length of a regularisation.
    let cases: [Case; 9] = [
        ("pixel-shift", "ref.tif", &["def_5.tif", "def_15.tif"], (0, 0), [512, 512], [32.0, 32.0, 480.0, 480.0], 0.0),
        (
            "dicchallenge-s05-contrast",
            "Sample5 Reference.tif",
            &["Sample5-000 X0.00 Y0.00 N2 C75 R10.tif", "Sample5-001 X0.10 Y0.10 N2 C100 R20.tif"],
            (0, 0),
            [512, 512],
            [16.0, 16.0, 496.0, 496.0],
            0.0,
        ),
        (
            "dicchallenge-s14-sinusoid",
            "Sample14 Reference.tif",
            &["Sample14 L1 Amp0.1b.tif", "Sample14 L5 Amp0.1b.tif"],
            (1300, 60),
            [512, 400],
            [16.0, 16.0, 496.0, 384.0],
            0.0,
        ),
        (
            "dicchallenge-s12-openhole",
            "oht_cfrp_00.tiff",
            &["oht_cfrp_04.tiff", "oht_cfrp_09.tiff"],
            (0, 300),
            [400, 480],
            [50.0, 20.0, 340.0, 460.0],
            0.0,
        ),
        ("openhole-bmp", "oht_cfrp_0.bmp", &["oht_cfrp_4.bmp"], (0, 0), [280, 500], [20.0, 20.0, 240.0, 440.0], 0.0),
        (
            "crack-heterogeneous",
            "img_0000 .png",
            &["img_0030 .png", "img_0120 .png"],
            (300, 330),
            [500, 500],
            [20.0, 40.0, 480.0, 460.0],
            0.0,
        ),
        (
            "sundic-necking",
            "img_0.tif",
            &["img_1.tif", "img_2.tif"],
            (500, 40),
            [512, 500],
            [20.0, 20.0, 490.0, 480.0],
            0.0,
        ),
        (
            "dicchallenge2-star",
            "DIC_Challenge_Star_Noise_Ref.tiff",
            &["DIC_Challenge_Star_Noise_Def.tiff"],
            (3000, 0),
            [512, 501],
            [8.0, 8.0, 504.0, 492.0],
            0.0,
        ),
        ("format-multipage", "ref.tif", &["def2.tif"], (0, 0), [512, 512], [32.0, 32.0, 480.0, 480.0], 64.0),
    ];
    for (folder, reference, frames, at, [width, height], zone_at, cutoff_px) in cases {
        let Some(path) = data::folder(folder) else { continue };
        let regularisation =
            if cutoff_px > 0.0 { Regularisation::Tikhonov { cutoff_px } } else { Regularisation::None };
        let options = tight(Options { drop_textureless: true, regularisation, ..Options::default() });
        let reference = part(&read(&path, reference), at, width, height);
        let on_cpu = prepared(&reference, &one(zone_at), options.clone());
        let on_gpu = prepared_on(gpu.clone(), &reference, &one(zone_at), options);
        assert_eq!(named(on_cpu.dropped()), named(on_gpu.dropped()), "{folder}: nodes dropped");
        for name in frames {
            let image = part(&read(&path, name), at, width, height);
            let cpu = on_cpu.correlate(image.clone(), None).unwrap();
            let gpu = on_gpu.correlate(image, None).unwrap();
            assert_same(&format!("{folder}, {name}"), &cpu, &gpu, on_cpu.grey_range());
        }
    }
}

// ---- Runs and devices --------------------------------------------------------------------------------

/// Everything of a result that is printed.
fn bits(correlation: &Correlation) -> Vec<u64> {
    let field = &correlation.measurement;
    let mut numbers: Vec<f64> = field.displacement.iter().chain(&field.sigma).flatten().copied().collect();
    numbers.extend(&field.element_residual);
    numbers.extend([correlation.residual_rms, correlation.correction_px, correlation.iterations as f64]);
    for zone in &correlation.zones {
        numbers.extend([zone.correlation, zone.residual_rms, zone.noise, zone.transfer.gain, zone.transfer.offset]);
    }
    numbers.into_iter().map(f64::to_bits).collect()
}

#[test]
fn an_image_that_lies_on_a_device_of_another_kind_is_brought_to_the_right_one() {
    let Some(gpu) = device() else { return };
    let pair = noisy_pair(&Translation([0.3, -0.2]), &eight_bit(96, 96));
    let zones = inside(96, 96, 16);
    let cpu = prepared(&pair[0], &zones, Options::default());
    let gpu = prepared_on(gpu, &pair[0], &zones, Options::default());
    for [on, of] in [[&cpu as &dyn Correlate, &gpu], [&gpu, &cpu]] {
        let uploaded = of.upload(pair[1].clone()).unwrap();
        let own = on.correlate_uploaded(on.upload(pair[1].clone()).unwrap(), None).unwrap();
        assert!(bits(&on.correlate_uploaded(uploaded, None).unwrap()) == bits(&own), "{}", on.device());
    }
}

#[test]
fn every_run_of_one_device_gives_the_same_bits() {
    let Some(gpu) = device() else { return };
    let side = 340;
    let pair = noisy_pair(&Accuracy::new(side, side), &eight_bit(side, side));
    let zones = [zone("a", [0.0, 0.0, 340.0, 200.0]), zone("b", [3.5, 210.0, 300.0, 330.0])];
    for brightness in [Brightness::Zone, Brightness::Element] {
        let options = Options { brightness, ..Options::default() };
        let run = || bits(&cold(&prepared_on(gpu.clone(), &pair[0], &zones, options.clone()), &pair[1]));
        let want = run();
        // One after the other, and several at a time, which share the queue and the memory.
        assert!(run() == want, "{brightness}: another run gives other bits");
        let all = std::thread::scope(|scope| {
            let runs: Vec<_> = (0..3).map(|_| scope.spawn(run)).collect();
            runs.into_iter().map(|run| run.join().unwrap()).collect::<Vec<_>>()
        });
        assert!(all.iter().all(|bits| *bits == want), "{brightness}: runs at the same time give other bits");
    }
}

#[test]
fn images_larger_than_a_binding_give_the_field_of_the_whole() {
    let Some(whole) = device() else { return };
    let (width, height) = (301, 347);
    let pair = noisy_pair(&Rotation::new(2.0, width, height), &eight_bit(width, height));
    let polygon = vec![[20.3, 17.0], [280.0, 30.0], [260.0, 330.0], [15.0, 300.0]];
    let shapes = [
        ("rectangle", inside(width, height, 4), Brightness::Zone),
        ("polygon", vec![Zone { name: "p".into(), polygon, ..Zone::default() }], Brightness::Element),
    ];
    // Rows of this image are 1.25 KiB, those of the reference 3.75 KiB; the prefilter needs 65 rows of 1.5 KiB at once.
    for bytes in [176 << 10, 300 << 10] {
        let options = GpuOptions { max_binding_bytes: Some(bytes), ..GpuOptions::default() };
        let Some(split) = device_with(&options) else { return };
        for (what, zones, brightness) in &shapes {
            let options = tight(Options { brightness: *brightness, drop_textureless: true, ..Options::default() });
            let [a, b] =
                [&whole, &split].map(|gpu| cold(&prepared_on(gpu.clone(), &pair[0], zones, options.clone()), &pair[1]));
            assert_same(&format!("{what} in windows of {bytes} bytes"), &a, &b, 255.0);
        }
    }
}

#[test]
fn an_image_that_no_window_can_hold_is_refused_with_its_size() {
    let Some(gpu) = device_with(&GpuOptions { max_binding_bytes: Some(20 << 10), ..GpuOptions::default() }) else {
        return;
    };
    let pair = noisy_pair(&REST, &eight_bit(300, 300));
    let error = match Correlator::new(gpu, pair[0].clone(), &inside(300, 300, 0), Options::default()) {
        Ok(_) => panic!("it is accepted"),
        Err(error) => error,
    };
    let CorrelationError::Backend(BackendError::OutOfMemory { what }) = &error else { panic!("{error}") };
    assert!(what.contains("300"), "{what}");
}

#[test]
fn a_tracked_frame_waits_once_per_iteration_and_is_that_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 320;
    let frames: Vec<Arc<Image>> = (0..6)
        .map(|k| {
            let options = RenderOptions { noise: 2.0, frame: k, ..eight_bit(side, side) };
            picture(&Accuracy::new(side, side).at(k as f64 / 5.0), &options)
        })
        .collect();
    for start in [StartFrom::Previous, StartFrom::Independent] {
        let options = tight(Options { start, ..Options::default() });
        let on_cpu = prepared(&frames[0], &inside(side, side, 16), options.clone());
        let on_gpu = prepared_on(gpu.clone(), &frames[0], &inside(side, side, 16), options);
        let (mut cpu, mut gpu) = (Tracker::new(&on_cpu), Tracker::new(&on_gpu));
        for (number, frame) in frames.iter().enumerate() {
            let [cpu, gpu] = [cpu.correlate(number, frame.clone()), gpu.correlate(number, frame.clone())]
                .map(|result| result.unwrap());
            assert_same(&format!("{start}, frame {number}"), &cpu, &gpu, on_cpu.grey_range());
            assert_few_words(&format!("{start}, frame {number}"), &gpu, frame);
        }
    }
}

// ---- Bad input ---------------------------------------------------------------------------------------

/// Why a reference is refused.
#[track_caller]
fn refused<B: Backend>(backend: B, reference: &Arc<Image>, zones: &[Zone], options: &Options) -> String {
    match Correlator::new(backend, reference.clone(), zones, options.clone()) {
        Ok(_) => panic!("the reference is accepted"),
        Err(error) => error.to_string(),
    }
}

#[test]
fn references_are_refused_in_the_words_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let zones = inside(128, 112, 16);
    let good = picture(&REST, &eight_bit(128, 112));
    let references = [
        ("constant", drawn(128, 112, |_, _| 100.0)),
        ("black", drawn(128, 112, |_, _| 0.0)),
        ("stripes", drawn(128, 112, |x, _| if x % 9 < 4 { 30.0 } else { 200.0 })),
        ("noise", noisy(&drawn(128, 112, |_, _| 100.0), 2.0, 77)),
        ("blank half", changed(&good, |x, _, grey| if x < 64 { 50.0 } else { grey })),
        ("huge levels", changed(&good, |_, _, grey| grey * 1e30)),
    ];
    for (what, reference) in &references {
        for drop_textureless in [false, true] {
            let options = Options { drop_textureless, ..Options::default() };
            let cpu = Correlator::new(
                quadrille::backend::cpu::CpuBackend::default(),
                reference.clone(),
                &zones,
                options.clone(),
            );
            let gpu = Correlator::new(gpu.clone(), reference.clone(), &zones, options);
            match (cpu, gpu) {
                (Ok(cpu), Ok(gpu)) => assert_eq!(named(cpu.dropped()), named(gpu.dropped()), "{what}"),
                (Err(cpu), Err(gpu)) => assert_eq!(cpu.to_string(), gpu.to_string(), "{what}"),
                (cpu, gpu) => panic!("{what}: CPU {:?}, GPU {:?}", cpu.err(), gpu.err()),
            }
        }
    }
    for options in [
        Options { tolerance_px: f64::NAN, ..Options::default() },
        Options { element_size: 3, ..Options::default() },
        Options { element_size: 128, ..Options::default() },
    ] {
        let cpu = refused(quadrille::backend::cpu::CpuBackend::default(), &good, &zones, &options);
        assert_eq!(refused(gpu.clone(), &good, &zones, &options), cpu);
    }
}

#[test]
fn frames_without_a_match_end_as_on_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 176;
    let options = eight_bit(side, side);
    let reference = picture(&REST, &options);
    let zones = inside(side, side, 0);
    let texture = Texture::new(99, SPECKLE_PX).unwrap();
    let frames: [(&str, Arc<Image>); 8] = [
        ("another specimen", Arc::new(render(&texture, &REST, &options).unwrap())),
        ("moved out", picture(&Translation([200.0, 0.0]), &options)),
        ("moved out of a corner", picture(&Translation([140.0, 145.0]), &options)),
        ("far away", picture(&Translation([0.0, -1000.0]), &options)),
        ("noise", noisy(&drawn(side, side, |_, _| 100.0), 2.0, 5)),
        ("half black, half negative", changed(&reference, |x, _, grey| if x < 64 { 0.0 } else { 255.0 - grey })),
        ("one bright pixel", drawn(side, side, |x, y| if (x, y) == (60, 60) { 255.0 } else { 0.0 })),
        ("huge levels", changed(&reference, |_, _, grey| grey * 1e12)),
    ];
    for brightness in [Brightness::Zone, Brightness::Element, Brightness::Off] {
        let options = Options { brightness, ..Options::default() };
        let on_cpu = prepared(&reference, &zones, options.clone());
        let on_gpu = prepared_on(gpu.clone(), &reference, &zones, options);
        // All kinds once; how light is followed decides little where nothing matches.
        let step = if brightness == Brightness::Zone { 1 } else { 3 };
        for (what, image) in frames.iter().step_by(step) {
            let (cpu, gpu) =
                (on_cpu.correlate(image.clone(), None).unwrap(), on_gpu.correlate(image.clone(), None).unwrap());
            assert_finite(&cpu);
            assert_finite(&gpu);
            let (cpu, gpu) = (cpu.measurement.status, gpu.measurement.status);
            println!("{what}, {brightness}: {cpu:?}, {gpu:?}");
            // Where nothing matches, round-off decides which way a search is lost, not whether.
            let lost = |status| status != Status::Converged;
            assert_eq!(lost(cpu), lost(gpu), "{what}, {brightness}: CPU {cpu:?}, GPU {gpu:?}");
        }
        for bad in [drawn(side, side, |_, _| 7.0), drawn(side, 100, |x, _| x as f32)] {
            let cpu = on_cpu.correlate(bad.clone(), None).unwrap_err();
            let gpu = on_gpu.correlate(bad, None).unwrap_err();
            assert_eq!((cpu.to_string(), cpu.is_of_the_frame()), (gpu.to_string(), gpu.is_of_the_frame()));
        }
    }
}

#[test]
fn starts_that_are_wild_end_as_on_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 160;
    let pair = [picture(&REST, &eight_bit(side, side)), picture(&Accuracy::new(side, side), &eight_bit(side, side))];
    let options = tight(Options::default());
    let on_cpu = prepared(&pair[0], &inside(side, side, 8), options.clone());
    let on_gpu = prepared_on(gpu, &pair[0], &inside(side, side, 8), options);
    let n = on_cpu.mesh().n_nodes();
    let known = cold(&on_cpu, &pair[1]).zones.iter().map(|zone| zone.transfer).collect::<Vec<_>>();
    for u in [[0.0, 0.0], [1e4, -1e4], [1e9, 0.0], [1e300, -1e300], [f64::INFINITY, 0.0], [f64::NAN, 0.0]] {
        let start = Start::new(vec![u; n], known.clone());
        let cpu = on_cpu.correlate(pair[1].clone(), Some(&start)).unwrap();
        let gpu = on_gpu.correlate(pair[1].clone(), Some(&start)).unwrap();
        assert_same(&format!("started at {u:?}"), &cpu, &gpu, 255.0);
    }
    let start = Start::new(vec![[0.0; 2]; n - 1], known);
    let [cpu, gpu] = [
        on_cpu.correlate(pair[1].clone(), Some(&start)).unwrap_err().to_string(),
        on_gpu.correlate(pair[1].clone(), Some(&start)).unwrap_err().to_string(),
    ];
    assert_eq!(cpu, gpu);
}

#[test]
fn a_zone_that_has_turned_further_than_expected_is_put_right_as_on_the_cpu() {
    let Some(gpu) = device() else { return };
    let side = 192;
    let [turned, expected] = [12.0, 7.0].map(|degrees| Rotation::new(degrees, side, side));
    let pair = noisy_pair(&turned, &eight_bit(side, side));
    let options = tight(Options::default());
    let on_cpu = prepared(&pair[0], &inside(side, side, 48), options.clone());
    let on_gpu = prepared_on(gpu, &pair[0], &inside(side, side, 48), options);
    let displacement = on_cpu.mesh().nodes().iter().map(|&x| expected.displacement(x)).collect();
    let start = Start::new(displacement, vec![GreyTransfer::NONE]);
    let cpu = on_cpu.correlate(pair[1].clone(), Some(&start)).unwrap();
    let gpu = on_gpu.correlate(pair[1].clone(), Some(&start)).unwrap();
    assert_same("turned by 5 degrees more", &cpu, &gpu, 255.0);
    assert!(gpu.iterations <= 8, "{} iterations", gpu.iterations);
}

// ---- Failing devices ---------------------------------------------------------------------------------

/// A reference and a frame on a device that fails after some readbacks: the error, if any came.
fn whole_run(
    gpu: &GpuBackend,
    pair: &[Arc<Image>; 2],
    zones: &[Zone],
    options: &Options,
) -> Result<Correlation, CorrelationError> {
    let correlator = Correlator::new(gpu.clone(), pair[0].clone(), zones, options.clone())?;
    correlator.correlate(pair[1].clone(), None)
}

#[test]
fn a_device_that_fails_anywhere_says_so_and_stays_failed() {
    // Both ways of solving, and a frame with a matrix of its own: every kind of readback.
    let pair = noisy_pair(&Translation([20.4, -3.0]), &eight_bit(128, 128));
    let zones = inside(128, 128, 0);
    let mut n_failures = 0;
    for solver in [SolverChoice::Iterative, SolverChoice::Direct] {
        let options = Options { solver, ..Options::default() };
        // The first ones prepare the reference; the steps of an iteration are alike.
        for readbacks in (0..8).chain((8..).step_by(3)) {
            let Some(gpu) = device_with(&GpuOptions { fail_after: Some(readbacks), ..GpuOptions::default() }) else {
                return;
            };
            match whole_run(&gpu, &pair, &zones, &options) {
                Ok(correlation) => {
                    assert_eq!(correlation.measurement.status, Status::Converged);
                    break;
                }
                Err(CorrelationError::Backend(error)) => {
                    let BackendError::Device { message, .. } = &error else { panic!("{error}") };
                    assert!(message.contains("injected failure"), "after {readbacks}: {error}");
                }
                Err(error) => panic!("after {readbacks}: {error}, {:?}", error.source()),
            }
            n_failures += 1;
            // It does not come back to life.
            let again = whole_run(&gpu, &pair, &zones, &options);
            assert!(matches!(again, Err(CorrelationError::Backend(BackendError::Device { .. }))), "after {readbacks}");
            assert!(gpu.wait().is_err(), "after {readbacks}");
            assert!(readbacks < 100, "the frame never ends");
        }
    }
    assert!(n_failures > 10, "{n_failures} failures only");
}

#[test]
fn a_frame_from_its_prediction_makes_the_host_wait_three_times_at_most() {
    let Some(gpu) = device() else { return };
    const SIDE: usize = 320;
    let [reference, deformed] = noisy_pair(&Accuracy::new(SIDE, SIDE), &eight_bit(SIDE, SIDE));
    // Inside: three iterations at once, and one more where it takes one. Where the border loses pixels the frame has a
    // matrix of its own: what is lost, what is left of it, its correction, the iterations after it, and one more. Then
    // once for what the residual follows beyond the field.
    for (margin, most) in [(16, 3), (0, 7)] {
        let zones = inside(SIDE, SIDE, margin);
        let (on_gpu, on_cpu) = (
            prepared_on(gpu.clone(), &reference, &zones, Options::default()),
            prepared(&reference, &zones, Options::default()),
        );
        let cold = on_cpu.correlate(deformed.clone(), None).unwrap();
        let off = |[x, y]: [f64; 2]| [x + 0.1, y - 0.05];
        let displacement: Vec<[f64; 2]> = cold.full_displacement().iter().map(|&u| off(u)).collect();
        let start = Start::new(displacement, cold.zones.iter().map(|zone| zone.transfer).collect());
        let found = on_gpu.correlate(deformed.clone(), Some(&start)).unwrap();
        let twin = on_cpu.correlate(deformed.clone(), Some(&start)).unwrap();
        assert_eq!((found.start, found.measurement.status), (StartUsed::Predicted, Status::Converged));
        let apart = largest_difference(&found.measurement.displacement, &twin.measurement.displacement);
        // Each has settled to 1e-4 px.
        assert!(apart < 2e-4, "margin {margin}: {apart} px apart");
        let traffic = found.traffic.unwrap();
        println!("margin {margin}: {} iterations, {traffic:?}", found.iterations);
        assert!(found.iterations >= 3, "{} iterations", found.iterations);
        assert!(traffic.readbacks <= most, "margin {margin}: {traffic:?}");
    }
}
