//! What the tests of the engine share: pictures, the calls to the library, errors against the exact
//! field; and, to compare with, a plain correlation in `f64` and dense linear algebra.
#![allow(dead_code)] // each test program uses its own part

pub mod blobs;
pub mod board;
pub mod data;
pub mod dense;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod plain;
pub mod round_off;
pub mod scenes;
pub mod schema;
pub mod shared;
pub mod spots;

use quadrille::backend::Backend;
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlation, CorrelationError, Correlator, Options};
use quadrille::field::{Measurement, Status};
use quadrille::imaging::{Image, Pixels};
use quadrille::isa::Isa;
use quadrille::mesh::{Mesh, Roi, Zone, ZoneElements, shape_functions};
use quadrille::synth::{Depth, Motion, RenderOptions, Texture, Translation, render};
use quadrille::units::Px;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Mean speckle size of all pictures, px: THEORY 2 gives its biases for 4 to 5 px.
pub const SPECKLE_PX: f64 = 4.5;
/// Nothing moves.
pub const REST: Translation = Translation([0.0, 0.0]);

pub fn texture() -> Texture {
    Texture::new(2024, SPECKLE_PX).unwrap()
}

/// 0..255 in whole grey levels.
pub fn eight_bit(width: usize, height: usize) -> RenderOptions {
    RenderOptions::new(width, height)
}

/// 0..255, not rounded.
pub fn float(width: usize, height: usize) -> RenderOptions {
    RenderOptions { depth: Depth::F32, ..RenderOptions::new(width, height) }
}

#[track_caller]
pub fn picture<M: Motion>(motion: &M, options: &RenderOptions) -> Arc<Image> {
    Arc::new(render(&texture(), motion, options).unwrap())
}

/// A float image with the grey level `grey(x, y)` at each pixel.
#[track_caller]
pub fn drawn(width: usize, height: usize, grey: impl Fn(usize, usize) -> f32) -> Arc<Image> {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| grey(x, y)).collect();
    Arc::new(Image::new(width, height, Pixels::F32(pixels)).unwrap())
}

/// The image with every grey level changed to `change(x, y, grey)`, as floats.
#[track_caller]
pub fn changed(image: &Image, change: impl Fn(usize, usize, f32) -> f32) -> Arc<Image> {
    drawn(image.width(), image.height(), |x, y| change(x, y, image.grey(x, y)))
}

/// The image in whole grey levels, 0..255.
#[track_caller]
pub fn rounded(image: &Image) -> Arc<Image> {
    let (width, height) = (image.width(), image.height());
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (image.grey(x, y) + 0.5) as u8)).collect();
    Arc::new(Image::new(width, height, Pixels::U8(pixels)).unwrap())
}

/// The part of `image` of `width` x `height` px whose first pixel is `(x0, y0)`, as floats.
#[track_caller]
pub fn cropped(image: &Image, (x0, y0): (usize, usize), width: usize, height: usize) -> Arc<Image> {
    drawn(width, height, |x, y| image.grey(x0 + x, y0 + y))
}

pub fn zone(name: &str, [x0, y0, x1, y1]: [f64; 4]) -> Zone {
    Zone::rectangle(name, Roi { x0, y0, x1, y1 })
}

/// One zone.
pub fn one(roi: [f64; 4]) -> Vec<Zone> {
    vec![zone("all", roi)]
}

/// The whole of a picture but `margin` px on every side.
pub fn inside(width: usize, height: usize, margin: usize) -> Vec<Zone> {
    one([margin as f64, margin as f64, (width - margin) as f64, (height - margin) as f64])
}

#[track_caller]
pub fn prepared(reference: &Arc<Image>, zones: &[Zone], options: Options) -> Correlator<CpuBackend> {
    prepared_on(CpuBackend::default(), reference, zones, options)
}

#[track_caller]
pub fn prepared_on<B: Backend>(backend: B, reference: &Arc<Image>, zones: &[Zone], options: Options) -> Correlator<B> {
    match Correlator::new(backend, reference.clone(), zones, options) {
        Ok(correlator) => correlator,
        Err(error) => panic!("the reference is refused: {error:?}"),
    }
}

/// Why a reference is refused.
#[track_caller]
pub fn refusal(reference: &Arc<Image>, zones: &[Zone], options: Options) -> CorrelationError {
    match Correlator::new(CpuBackend::new(Isa::detect()), reference.clone(), zones, options) {
        Ok(_) => panic!("the reference is accepted"),
        Err(error) => error,
    }
}

/// Correlates a frame about which nothing is known, however it ends.
#[track_caller]
pub fn cold<B: Backend>(correlator: &Correlator<B>, image: &Arc<Image>) -> Correlation {
    let correlation = correlator.correlate(image.clone(), None).unwrap();
    assert_finite(&correlation);
    correlation
}

/// Correlates a frame about which nothing is known and that must converge, with every node measured.
#[track_caller]
pub fn solved<B: Backend>(correlator: &Correlator<B>, image: &Arc<Image>) -> Measurement<Px> {
    let correlation = cold(correlator, image);
    let (status, correction) = (correlation.measurement.status, correlation.correction_px);
    assert_eq!(status, Status::Converged, "after {} iterations, correction {correction} px", correlation.iterations);
    let lost = correlation.measurement.measured.iter().filter(|&&measured| !measured).count();
    assert_eq!(lost, correlator.dropped().len(), "nodes lost");
    correlation.measurement
}

/// Fails if anything in the result is NaN or infinite.
#[track_caller]
pub fn assert_finite(correlation: &Correlation) {
    let Correlation { measurement, zones, rigid, .. } = correlation;
    let mut numbers = vec![correlation.residual_rms, correlation.residual_percent];
    assert!(numbers.iter().all(|v| v.is_finite()), "the residual is not finite");
    numbers.extend(measurement.displacement.iter().chain(&measurement.sigma).flatten());
    assert!(numbers.iter().all(|v| v.is_finite()), "a displacement or its uncertainty is not finite");
    numbers.extend(&measurement.element_residual);
    assert!(numbers.iter().all(|v| v.is_finite()), "the residual of an element is not finite");
    for zone in zones {
        numbers.extend([zone.correlation, zone.residual_rms, zone.noise, zone.transfer.gain, zone.transfer.offset]);
    }
    for rigid in rigid.iter().chain(zones.iter().filter_map(|zone| zone.rigid.as_ref())) {
        numbers.extend(rigid.translation.iter().chain(&rigid.centre));
        numbers.push(rigid.rotation_rad);
    }
    assert!(numbers.iter().all(|v| v.is_finite()), "a number of the result is not finite");
}

/// Error of each node's displacement against the exact motion, px.
pub fn node_errors<M: Motion>(mesh: &Mesh<Px>, displacement: &[[f64; 2]], motion: &M) -> Vec<[f64; 2]> {
    let error = |(&x, u): (&[f64; 2], &[f64; 2])| {
        let exact = motion.displacement(x);
        [u[0] - exact[0], u[1] - exact[1]]
    };
    mesh.nodes().iter().zip(displacement).map(error).collect()
}

/// Largest error of a component at the measured nodes, in its standard uncertainties; `bias` px are
/// taken off each error first.
pub fn worst_by_sigma<M: Motion>(measurement: &Measurement<Px>, motion: &M, bias: f64) -> f64 {
    let errors = node_errors(&measurement.mesh, &measurement.displacement, motion);
    let nodes = (0..errors.len()).filter(|&node| measurement.measured[node]);
    let components = nodes.flat_map(|node| [0, 1].map(|c| (errors[node][c], measurement.sigma[node][c])));
    components.fold(0.0, |worst, (error, sigma)| ((error.abs() - bias).max(0.0) / sigma).max(worst))
}

/// Root mean square length of vectors: `sqrt(mean(x^2 + y^2))`.
pub fn rms(vectors: &[[f64; 2]]) -> f64 {
    (vectors.iter().map(|v| v[0] * v[0] + v[1] * v[1]).sum::<f64>() / vectors.len() as f64).sqrt()
}

/// Mean of vectors.
pub fn mean(vectors: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|c| vectors.iter().map(|v| v[c]).sum::<f64>() / vectors.len() as f64)
}

/// Largest component of vectors, in magnitude.
pub fn largest(vectors: &[[f64; 2]]) -> f64 {
    vectors.iter().flatten().fold(0.0, |largest, v| if v.abs() > largest { v.abs() } else { largest })
}

/// Largest difference of a component between two lists of vectors.
#[track_caller]
pub fn largest_difference(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences: Vec<[f64; 2]> = a.iter().zip(b).map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect();
    largest(&differences)
}

/// Root mean square length of the error of the bilinear field over the pixels of all zones, px.
pub fn field_rms<M: Motion>(mesh: &Mesh<Px>, displacement: &[[f64; 2]], motion: &M) -> f64 {
    let (mut sum, mut n) = (0.0, 0);
    plain::for_each_pixel(mesh, |pixel| {
        let psi = shape_functions(pixel.xi, pixel.eta);
        let exact = motion.displacement([pixel.x as f64, pixel.y as f64]);
        for c in 0..2 {
            let u: f64 = pixel.nodes.iter().zip(psi).map(|(&node, psi)| psi * displacement[node][c]).sum();
            sum += (u - exact[c]).powi(2);
        }
        n += 1;
    });
    (sum / f64::from(n)).sqrt()
}

/// The image as floats, with white Gaussian noise of standard deviation `noise` added.
#[track_caller]
pub fn noisy(image: &Image, noise: f32, seed: u64) -> Arc<Image> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut greys = Vec::with_capacity(image.width() * image.height());
    for y in 0..image.height() {
        for x in 0..image.width() {
            let normal: f32 = StandardNormal.sample(&mut random);
            greys.push(image.grey(x, y) + noise * normal);
        }
    }
    Arc::new(Image::new(image.width(), image.height(), Pixels::F32(greys)).unwrap())
}

/// The elements of a grid on `[x0, y0, x1, y1]`, every inner node moved by up to `shake` px; each as two triangles when
/// `halved`.
pub fn free_mesh([x0, y0, x1, y1]: [f64; 4], size: f64, shake: f64, halved: bool) -> ZoneElements {
    let (nx, ny) = (((x1 - x0) / size) as usize, ((y1 - y0) / size) as usize);
    let mut nodes = Vec::new();
    for j in 0..=ny {
        for i in 0..=nx {
            let inner = i > 0 && i < nx && j > 0 && j < ny;
            let by = |a: f64, b: f64| if inner { shake * (a * i as f64 + b * j as f64).sin() } else { 0.0 };
            nodes.push([x0 + i as f64 * size + by(12.9898, 78.233), y0 + j as f64 * size + by(39.346, 11.135)]);
        }
    }
    let node = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let mut elements = Vec::new();
    for j in 0..ny {
        for i in 0..nx {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            if halved {
                elements.extend([[a, b, c, c], [a, c, d, d]]);
            } else {
                elements.push([a, b, c, d]);
            }
        }
    }
    ZoneElements { name: "free".into(), nodes, elements }
}

/// A zone of them.
pub fn free_zone(elements: ZoneElements) -> Zone {
    Zone { name: "free".into(), elements: Some(Arc::new(elements)), ..Zone::default() }
}
