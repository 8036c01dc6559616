//! Measured scatter against THEORY 2 and against the printed standard uncertainty.
//!
//! Monte Carlo: both images carry noise of their own, so every sample has its own reference.

use crate::common;
use common::dense::Dense;
use common::*;
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlation, Correlator, Options};
use quadrille::field::{Brightness, NOISE_CONTRADICTED, Noise, NoiseCorrelation, Status};
use quadrille::imaging::{Image, Interpolation, Pixels};
use quadrille::linalg::{BlockMatrix, Pattern};
use quadrille::mesh::{Mesh, Zone};
use quadrille::synth::{RenderOptions, Texture, Translation, render};
use quadrille::units::Px;
use std::sync::Arc;

/// Standard deviation of the noise, grey levels.
const NOISE: f32 = 2.0;
/// Speckles so fine that an element of 12 px holds several, px: the autocorrelation is 4.5 px wide.
const FINE_PX: f64 = 3.2;
/// Elements along each side of a zone: the nodes in the middle do not feel the edge.
const ELEMENTS: usize = 6;

/// Where a node stands in its zone.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Place {
    /// Two elements or more from the edge: what is less far differs from the theory of an endless mesh.
    Inside,
    /// On an edge, two elements or more from its ends.
    Edge,
    Corner,
}

const PLACES: [Place; 3] = [Place::Inside, Place::Edge, Place::Corner];

fn place(mesh: &Mesh<Px>, node: usize) -> Option<Place> {
    let grid = mesh.whole_grid(mesh.node_zone()[node] as usize).expect("a rectangle");
    let at = node - grid.first_node;
    let from_edge = |k: usize, n: usize| k.min(n - k);
    let [i, j] = [from_edge(at % (grid.nx + 1), grid.nx), from_edge(at / (grid.nx + 1), grid.ny)];
    match (i.min(j), i.max(j)) {
        (0, 0) => Some(Place::Corner),
        (0, 2..) => Some(Place::Edge),
        (2.., _) => Some(Place::Inside),
        _ => None,
    }
}

/// As many square zones as fit a picture of `side` px, a few px apart.
fn many_zones(side: usize, element_size: usize) -> Vec<Zone> {
    const GAP: usize = 8;
    let pitch = ELEMENTS * element_size + GAP;
    let count = (side - GAP) / pitch;
    let corners = (0..count).flat_map(|j| (0..count).map(move |i| [GAP + i * pitch, GAP + j * pitch]));
    corners
        .enumerate()
        .map(|(k, corner)| {
            let [x0, y0] = corner.map(|x| x as f64);
            let size = (ELEMENTS * element_size) as f64;
            zone(&k.to_string(), [x0, y0, x0 + size, y0 + size])
        })
        .collect()
}

/// Images of one texture at rest and displaced, without noise.
struct Pair {
    reference: Arc<Image>,
    deformed: Arc<Image>,
    motion: Translation,
}

impl Pair {
    fn new(side: usize, speckle_px: f64, shift: [f64; 2]) -> Self {
        let motion = Translation(shift);
        let options: RenderOptions = float(side, side);
        let texture = Texture::new(2024, speckle_px).unwrap();
        let [reference, deformed] = [REST, motion].map(|motion| Arc::new(render(&texture, &motion, &options).unwrap()));
        Self { reference, deformed, motion }
    }

    /// One sample of the noise in both images, correlated.
    #[track_caller]
    fn sample(&self, seed: u64, zones: &[Zone], options: &Options) -> (Correlator<CpuBackend>, Correlation) {
        let reference = noisy(&self.reference, NOISE, 2 * seed);
        let deformed = noisy(&self.deformed, NOISE, 2 * seed + 1);
        let correlator = prepared(&reference, zones, options.clone());
        let correlation = cold(&correlator, &deformed);
        assert!(correlation.measurement.measured.iter().all(|&measured| measured), "seed {seed}");
        (correlator, correlation)
    }
}

/// Components of nodal vectors by [`Place`].
#[derive(Default)]
struct Nodal([Vec<f64>; 3]);

impl Nodal {
    fn add(&mut self, place: Place, vector: [f64; 2]) {
        self.0[place as usize].extend(vector);
    }

    fn rms(&self, place: Place) -> f64 {
        let values = &self.0[place as usize];
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    /// Standard deviation of the typical node: half of a normal distribution lies within 0.6745 of it.
    fn typical(&self, place: Place) -> f64 {
        let mut sizes: Vec<f64> = self.0[place as usize].iter().map(|v| v.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        sizes[sizes.len() / 2] / 0.6745
    }
}

/// Errors, and printed standard uncertainties, of `n_samples` samples.
#[track_caller]
fn samples(pair: &Pair, n_samples: u64, zones: &[Zone], options: &Options) -> [Nodal; 2] {
    let mut found = [Nodal::default(), Nodal::default()];
    for seed in 0..n_samples {
        let (correlator, correlation) = pair.sample(seed, zones, options);
        let mesh = correlator.mesh();
        let errors = node_errors(mesh, &correlation.measurement.displacement, &pair.motion);
        for (node, (error, sigma)) in errors.into_iter().zip(&correlation.measurement.sigma).enumerate() {
            if let Some(place) = place(mesh, node) {
                found[0].add(place, error);
                found[1].add(place, *sigma);
            }
        }
    }
    found
}

#[test]
fn nodal_noise_is_that_of_the_theory() {
    const SIDE: usize = 1024;
    let pair = Pair::new(SIDE, FINE_PX, [0.0, 0.0]);
    // The numbers of samples give at least 1500 components at corners: 3 % statistical error there, less
    // elsewhere.
    for (element_size, n_samples) in [(12, 3), (16, 4), (32, 8)] {
        let zones = many_zones(SIDE, element_size);
        let [scatter, _] = samples(&pair, n_samples, &zones, &Options { element_size, ..Options::default() });
        let mesh = Mesh::on_zones(&zones, element_size, SIDE, SIDE).unwrap();
        let g_x = plain::gradient_rms(&pair.reference, &mesh)[0];
        let theory = 6f64.sqrt() * f64::from(NOISE) / (element_size as f64 * g_x);
        for (place, factor) in PLACES.into_iter().zip([1.0, 2f64.sqrt(), 2.0]) {
            // The theory is that of a texture spread evenly. A corner that happens to hold little scatters
            // much more than the others, so the typical node is compared.
            let ratio = scatter.typical(place) / (factor * theory);
            println!("{element_size} px, {place:?}: noise {ratio:.3} of the theory");
            // The requirement; an independent implementation confirmed the theory within 7 %.
            assert!((ratio - 1.0).abs() <= 0.1, "{element_size} px, {place:?}: {ratio} of the theory");
        }
    }
}

#[test]
fn printed_uncertainty_is_the_scatter() {
    const SIDE: usize = 640;
    let zones = many_zones(SIDE, 16);
    let ways = [
        (Some(f64::from(NOISE)), Brightness::Zone, Interpolation::Cubic),
        (None, Brightness::Zone, Interpolation::Quintic),
        (None, Brightness::Element, Interpolation::Cubic),
    ];
    // Every way at a shift of any size; at whole and half pixels, where interpolation damps noise least and most, one
    // of them.
    for (shift, ways) in [([0.0, 0.0], &ways[..1]), ([0.25, -0.4], &ways[..]), ([0.5, 0.5], &ways[..1])] {
        let pair = Pair::new(SIDE, FINE_PX, shift);
        for &(noise, brightness, interpolation) in ways {
            let options = Options { noise: noise.into(), brightness, interpolation, ..Options::default() };
            // 36 zones hold 288 components at corners: 8 samples give 2 % statistical error.
            let [scatter, printed] = samples(&pair, 8, &zones, &options);
            for place in PLACES {
                let ratio = printed.rms(place) / scatter.rms(place);
                let what = format!("{place:?}, shift {shift:?}, noise {noise:?}, {brightness}, {interpolation:?}");
                println!("{what}: printed uncertainty {ratio:.3} of the scatter");
                assert!((ratio - 1.0).abs() <= 0.1, "{what}: {ratio} of the scatter"); // the requirement
            }
        }
    }
}

#[test]
fn noise_is_estimated_from_the_residual_at_any_sub_pixel_shift() {
    const SIDE: usize = 512;
    for shift in [[0.0, 0.0], [1.0, -2.0], [0.25, 0.25], [0.5, 0.0], [0.5, 0.5], [-0.25, 0.75]] {
        let pair = Pair::new(SIDE, SPECKLE_PX, shift);
        for interpolation in [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys] {
            let options = Options { interpolation, ..Options::default() };
            let (_, correlation) = pair.sample(1, &inside(SIDE, SIDE, 16), &options);
            let ratio = correlation.zones[0].noise / f64::from(NOISE);
            // The requirement. 230 000 pixels leave a statistical error of 0.2 %; what is left is
            // interpolation error, which counts as noise.
            assert!((ratio - 1.0).abs() <= 0.05, "{interpolation:?}, shift {shift:?}: {ratio} of the noise");
        }
    }
}

#[test]
fn uncertainty_is_that_of_the_dense_inverse() {
    let (width, height) = (232, 240);
    let reference = picture(&REST, &float(width, height));
    let zones = [
        zone("left", [4.0, 4.0, 116.0, 156.0]),
        zone("right", [117.5, 20.0, 229.5, 116.0]),
        zone("strip", [4.0, 160.0, 228.0, 176.0]),
        zone("two by three", [4.0, 180.0, 36.0, 228.0]),
        zone("one", [60.0, 180.0, 76.0, 196.0]),
    ];
    let correlator = prepared(&reference, &zones, Options { brightness: Brightness::Off, ..Options::default() });
    let mesh = correlator.mesh();
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let matrix = BlockMatrix::assemble(&pattern, mesh.elements(), &plain::normal_matrices(&reference, mesh));
    let inverse = Dense::of(&matrix).inverse();
    for (node, sigma) in correlator.unit_sigma().into_iter().enumerate() {
        for c in 0..2 {
            let ratio = sigma[c] / (2.0 * inverse[2 * node + c][2 * node + c]).sqrt();
            // 1.5 % is what is asked for: loads five steps apart leak into each other (`inverse_diagonal`).
            assert!((ratio - 1.0).abs() <= 0.015, "node {node}, component {c}: {ratio} of the exact one");
        }
    }
}

#[test]
fn uncertainty_beside_lost_elements_is_that_of_a_zone_without_them() {
    // Three elements to the right and two up, whole pixels: what stays in the image is the same in both.
    const SIDE: usize = 400;
    let pair = Pair::new(SIDE, FINE_PX, [48.0, -32.0]);
    let noise_correlation = NoiseCorrelation::Off;
    let options = Options { noise: Noise::Constant(NOISE.into()), noise_correlation, ..Options::default() };
    let side = SIDE as f64;
    let [whole, without] = [[0.0, 0.0, side, side], [0.0, 32.0, side - 48.0, side]].map(|roi| {
        let correlator = prepared(&pair.reference, &one(roi), options.clone());
        cold(&correlator, &pair.deformed).measurement
    });
    let mut compared = 0;
    for (node, x) in without.mesh.nodes().iter().enumerate() {
        let other = whole.mesh.nodes().iter().position(|other| other == x).expect("the same grid");
        assert!(whole.measured[other], "{x:?}");
        for c in 0..2 {
            let ratio = whole.sigma[other][c] / without.sigma[node][c];
            // Both are probed, to 1 % at worst and 0.2 % typically; nodes that are not done anew add less than 0.1 %.
            assert!((ratio - 1.0).abs() <= 0.015, "node at {x:?}, component {c}: {ratio} of the other");
        }
        compared += 1;
    }
    assert_eq!(compared, 23 * 24);
}

#[test]
fn the_mean_of_several_references_lowers_the_printed_and_the_real_scatter_alike() {
    const REFERENCES: usize = 4;
    let zones = inside(200, 200, 20);
    let (mut squares, mut predicted, mut estimated) = (0.0, 0.0, 0.0);
    let trials = 12;
    let mut n = 0.0;
    let exact = picture(&REST, &float(200, 200));
    for trial in 0..trials {
        let shots: Vec<_> = (0..=REFERENCES).map(|k| noisy(&exact, 2.0, (100 * trial + k) as u64)).collect();
        let mean =
            |x: usize, y: usize| shots[..REFERENCES].iter().map(|s| s.grey(x, y)).sum::<f32>() / REFERENCES as f32;
        let reference = drawn(200, 200, mean);
        let options = Options { n_references: REFERENCES, ..Options::default() };
        let correlator = prepared(&reference, &zones, options);
        let found = cold(&correlator, &shots[REFERENCES]);
        estimated += found.zones[0].noise / trials as f64;
        for (u, sigma) in found.measurement.displacement.iter().zip(&found.measurement.sigma) {
            squares += u[0] * u[0] + u[1] * u[1];
            predicted += sigma[0] * sigma[0] + sigma[1] * sigma[1];
            n += 2.0;
        }
    }
    let (scatter, predicted) = ((squares / n).sqrt(), (predicted / n).sqrt());
    // 12 frames of 242 correlated numbers: the scatter is known to about 3 %. Two equal images would give 1.26 times.
    assert!((scatter / predicted - 1.0).abs() < 0.08, "scatter {scatter}, predicted {predicted} px");
    assert!((estimated - 2.0).abs() < 0.05, "noise {estimated} grey levels");
}

/// Errors over printed standard uncertainties, by [`Place`], and how the frames went.
#[derive(Default)]
struct Study {
    z: Nodal,
    most_iterations: usize,
    converged: usize,
    frames: usize,
    /// Mean over frames and zones.
    noise: f64,
    at_bound: usize,
    /// Elements whose residual was called beyond noise.
    misfit: usize,
    gain: f64,
}

/// An image of `bits` bits (0: floats) with a texture of `contrast` grey levels rms about 128 and with noise, grey
/// levels of the 0..255 scale.
#[track_caller]
fn shot(picture: &Image, contrast: f64, noise: f64, bits: u32, seed: u64) -> Arc<Image> {
    let (width, height) = (picture.width(), picture.height());
    let greys: Vec<f64> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f64::from(picture.grey(x, y))).collect();
    let n = greys.len() as f64;
    let mean = greys.iter().sum::<f64>() / n;
    let rms = (greys.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / n).sqrt();
    let scaled = changed(picture, |_, _, grey| (128.0 + contrast / rms * (f64::from(grey) - mean)) as f32);
    let noisy = noisy(&scaled, noise as f32, seed);
    let level = |x: usize, y: usize| noisy.grey(x, y);
    let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels = match bits {
        8 => Pixels::U8(places().map(|(x, y)| (level(x, y) + 0.5) as u8).collect()),
        16 => Pixels::U16(places().map(|(x, y)| (257.0 * level(x, y) + 0.5) as u16).collect()),
        _ => return noisy,
    };
    Arc::new(Image::new(width, height, pixels).unwrap())
}

#[track_caller]
fn study(
    pair: &Pair,
    contrast: f64,
    noise: f64,
    bits: u32,
    n_samples: u64,
    zones: &[Zone],
    options: &Options,
) -> Study {
    let mut study = Study::default();
    for seed in 0..n_samples {
        let reference = shot(&pair.reference, contrast, noise, bits, 2 * seed);
        let deformed = shot(&pair.deformed, contrast, noise, bits, 2 * seed + 1);
        let correlator = prepared(&reference, zones, options.clone());
        let found = cold(&correlator, &deformed);
        study.most_iterations = study.most_iterations.max(found.iterations);
        study.converged += usize::from(found.measurement.status == Status::Converged);
        study.frames += 1;
        study.at_bound += found.nodes_at_bound;
        study.misfit += found.measurement.misfit().map_or(0, |misfit| misfit.elements);
        let n = found.zones.len() as f64 * n_samples as f64;
        let scale = if bits == 16 { 257.0 } else { 1.0 };
        study.noise += found.zones.iter().map(|zone| zone.noise / scale / n).sum::<f64>();
        study.gain += found.zones.iter().map(|zone| zone.transfer.gain / n).sum::<f64>();
        let mesh = correlator.mesh();
        let errors = node_errors(mesh, &found.measurement.displacement, &pair.motion);
        for (node, (error, sigma)) in errors.into_iter().zip(&found.measurement.sigma).enumerate() {
            if let Some(place) = place(mesh, node).filter(|_| found.measurement.measured[node]) {
                study.z.add(place, [0, 1].map(|c| error[c] / sigma[c]));
            }
        }
    }
    study
}

#[test]
fn printed_uncertainty_is_the_error_at_noise_that_is_not_small() {
    // Noise of 4 and 8 grey levels at a contrast of 30 was 1.7 and 3.7 times what was printed.
    const SIDE: usize = 432;
    let zones = many_zones(SIDE, 16);
    let pair = Pair::new(SIDE, SPECKLE_PX, [0.25, -0.4]);
    for noise in [4.0, 8.0] {
        let found = study(&pair, 30.0, noise, 8, 6, &zones, &Options::default());
        for (place, within) in PLACES.into_iter().zip([0.05, 0.1, 0.1]) {
            let ratio = found.z.rms(place);
            println!("noise {noise}, {place:?}: error {ratio:.3} of the printed uncertainty");
            // 16 zones and 6 samples leave 1.5 % of statistical error inside and at edges, 3 % at corners.
            assert!((ratio - 1.0).abs() <= within, "noise {noise}, {place:?}: {ratio} of the printed uncertainty");
        }
    }
}

#[test]
fn frames_as_noisy_as_a_third_of_their_contrast_converge_in_twenty_iterations_at_most() {
    const SIDE: usize = 320;
    let pair = Pair::new(SIDE, SPECKLE_PX, [1.3, -0.6]);
    // One zone, several elements deep: no frame of a virtual test at this noise converged in 50.
    for noise in [12.0, 16.0] {
        let found = study(&pair, 43.0, noise, 8, 4, &inside(SIDE, SIDE, 32), &Options::default());
        println!("noise {noise}: {} iterations, gain {:.4}", found.most_iterations, found.gain);
        assert_eq!(found.converged, found.frames, "noise {noise}");
        // Of 4 times 256 elements that all are followed the test names at most one in a hundred zones; two make it more
        // than chance.
        assert!(found.misfit <= 1, "noise {noise}: {} elements with misfit", found.misfit);
        // A dozen for most; from the twentieth on the few nodes that have not settled are not waited for.
        assert!(found.most_iterations <= 20, "noise {noise}: {} iterations", found.most_iterations);
        // Light did not change: 4 samples of 65 000 pixels know the gain to 0.3 %, and interpolation, which takes noise
        // from one of the two images alone, leaves 2 %; the gain of least squares would be 0.93 and 0.88.
        assert!((found.gain - 1.0).abs() < 0.03, "noise {noise}: gain {}", found.gain);
    }
}

#[test]
fn a_stated_noise_is_held_to_the_residual() {
    let pair = Pair::new(200, SPECKLE_PX, [0.25, 0.5]);
    for (stated, contradicted) in [(0.2, true), (2.0, false), (3.0, true)] {
        let options = Options { noise: stated.into(), ..Options::default() };
        let (_, found) = pair.sample(1, &inside(200, 200, 20), &options);
        let zone = &found.zones[0];
        assert_eq!(zone.noise, stated);
        // 25 000 pixels, and what interpolation adds.
        assert!((zone.residual_noise / f64::from(NOISE) - 1.0).abs() < 0.05, "{}", zone.residual_noise);
        let [least, most] = NOISE_CONTRADICTED;
        assert_eq!(!(least..=most).contains(&(zone.residual_noise / zone.noise)), contradicted, "{stated}");
    }
}

#[test]
fn a_change_of_light_counts_the_noise_of_the_deformed_image_with_its_gain() {
    // The deformed image is darker by half: its noise is brought to twice its size, and sqrt((1 + 4)/2) is in sigma.
    const SIDE: usize = 432;
    let pair = Pair::new(SIDE, FINE_PX, [0.25, -0.4]);
    let zones = many_zones(SIDE, 16);
    let mut z = Nodal::default();
    for seed in 0..6 {
        let reference = noisy(&pair.reference, NOISE, 2 * seed);
        let dark = changed(&pair.deformed, |_, _, grey| 0.5 * grey + 10.0);
        let correlator = prepared(&reference, &zones, Options::default());
        let found = cold(&correlator, &noisy(&dark, NOISE, 2 * seed + 1));
        assert!(found.zones.iter().all(|zone| (zone.noise / f64::from(NOISE) - 1.0).abs() < 0.1), "seed {seed}");
        let mesh = correlator.mesh();
        let errors = node_errors(mesh, &found.measurement.displacement, &pair.motion);
        for (node, (error, sigma)) in errors.into_iter().zip(&found.measurement.sigma).enumerate() {
            if let Some(place) = place(mesh, node) {
                z.add(place, [0, 1].map(|c| error[c] / sigma[c]));
            }
        }
    }
    for (place, within) in PLACES.into_iter().zip([0.05, 0.1, 0.1]) {
        let ratio = z.rms(place);
        println!("gain 2, {place:?}: error {ratio:.3} of the printed uncertainty");
        // 16 zones and 6 samples leave 1.5 % of statistical error inside and at edges, 3 % at corners; 1.58 without
        // gain.
        assert!((ratio - 1.0).abs() <= within, "{place:?}: {ratio}");
    }
}

#[test]
#[ignore = "the table of docs/correlation.md, some minutes: make study"]
fn study_of_the_printed_uncertainty_over_noise_contrast_and_depth() {
    const SIDE: usize = 640;
    let n_samples = std::env::var("QUADRILLE_STUDY_SAMPLES").ok().and_then(|n| n.parse().ok()).unwrap_or(10);
    println!(
        "contrast noise depth shift element: z inside, edge, corner; iterations, converged, noise found, at the bound"
    );
    for shift in [[0.25, -0.4], [0.0, 0.0], [0.5, 0.5]] {
        let pair = Pair::new(SIDE, SPECKLE_PX, shift);
        for (contrast, noise, bits, element_size) in [43.0, 20.0].into_iter().flat_map(|contrast| {
            [0.5, 2.0, 4.0, 8.0, 16.0].into_iter().flat_map(move |noise| {
                let element_size = if contrast < 30.0 && noise > 10.0 { 32 } else { 16 };
                [8, 16].into_iter().map(move |bits| (contrast, noise, bits, element_size))
            })
        }) {
            let zones = many_zones(SIDE, element_size);
            // Larger elements leave fewer nodes in the picture.
            let n_samples = n_samples * (element_size as u64 / 16).pow(2);
            let options = Options { element_size, ..Options::default() };
            let found = study(&pair, contrast, noise, bits, n_samples, &zones, &options);
            let [inside, edge, corner] = PLACES.map(|place| found.z.rms(place));
            println!(
                "{contrast:4} {noise:4} {bits:2} {shift:?} {element_size}: {inside:.3} {edge:.3} {corner:.3}; {:2}, {} of {}, \
                 {:.3}, {} (gain {:.4})",
                found.most_iterations, found.converged, found.frames, found.noise, found.at_bound, found.gain
            );
        }
    }
}
