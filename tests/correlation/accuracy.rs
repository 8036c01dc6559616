//! How close measured fields come to exact ones. Numbers to reach: the errors of the best open global codes on the same
//! pair.
//!
//! "rms" of a displacement error is the root mean square of its length, `sqrt(mean(ex^2 + ey^2))`: for the
//! analytic pair, whose two components carry the same wave, this is the number that those codes were measured by.

use crate::common;
use common::*;
use quadrille::correlate::Options;
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation};
use quadrille::mesh::Mesh;
use quadrille::synth::{Accuracy, Affine, Motion, RenderOptions, Texture, Translation, exact_at, render};
use quadrille::units::Px;
use std::sync::Arc;

fn sized(element_size: usize) -> Options {
    Options { element_size, ..Options::default() }
}

fn interpolated(interpolation: Interpolation) -> Options {
    Options { interpolation, ..Options::default() }
}

/// Side of the analytic pair, and the margin of its zone, px. The zone is the same for both element
/// sizes: at its edge the field bends little there, which is what the limit for 32 px supposes.
const SIDE: usize = 1024;
const MARGIN: usize = 16;

/// Reference and deformed image of the analytic pair, not rounded. Its speckles are 4.5 px wide by their
/// autocorrelation, `sqrt(2)` times the width of one blob, and its contrast fills 8 bits (1..254): with
/// these the projection has the errors that were measured beside those codes.
fn analytic_pair() -> [Arc<Image>; 2] {
    let texture = Texture::new(2024, 3.2).unwrap();
    let exposed = |image: Image| changed(&image, |_, _, grey| 1.13 * (grey - 120.0) + 127.5);
    let options: RenderOptions = float(SIDE, SIDE);
    [
        exposed(render(&texture, &REST, &options).unwrap()),
        exposed(render(&texture, &Accuracy::new(SIDE, SIDE), &options).unwrap()),
    ]
}

/// Node and field rms.
fn errors(mesh: &Mesh<Px>, u: &[[f64; 2]]) -> [f64; 2] {
    let motion = Accuracy::new(SIDE, SIDE);
    [rms(&node_errors(mesh, u, &motion)), field_rms(mesh, u, &motion)]
}

#[track_caller]
fn assert_analytic_pair(element_size: usize, limits: [f64; 2]) {
    let motion = Accuracy::new(SIDE, SIDE);
    let [f, g] = analytic_pair();
    let [f8, g8] = [rounded(&f), rounded(&g)];
    let zones = inside(SIDE, SIDE, MARGIN);

    let correlator = prepared(&f8, &zones, sized(element_size));
    let found = errors(correlator.mesh(), &solved(&correlator, &g8).displacement);
    let best = errors(correlator.mesh(), &plain::projection(&f8, correlator.mesh(), &motion, |_| 0.0));
    // What rounding does: its error in the reference less that in the deformed image, brought back.
    let rounding = plain::Spline::new(&changed(&g, |x, y, grey| g8.grey(x, y) - grey), 3);
    let error = |[x, y]: [usize; 2]| {
        let x_exact = [x as f64, y as f64];
        let u = motion.displacement(x_exact);
        f64::from(f8.grey(x, y) - f.grey(x, y)) - rounding.value([x_exact[0] + u[0], x_exact[1] + u[1]])
    };
    let best_rounded = errors(correlator.mesh(), &plain::projection(&f8, correlator.mesh(), &motion, error));

    let correlator = prepared(&f, &zones, sized(element_size));
    let found_float = errors(correlator.mesh(), &solved(&correlator, &g).displacement);
    for (k, what) in ["node", "field"].into_iter().enumerate() {
        let [found, best, best_rounded, found_float] = [&found, &best, &best_rounded, &found_float].map(|e| e[k]);
        println!(
            "{element_size} px, {what}: {found:.5}, projection {best:.5}, rounded {best_rounded:.5}, float {found_float:.5}"
        );
        // The best of the other global codes, 2 to 5 % above the projection.
        assert!(found <= limits[k], "{what} rms {found} px");
        // The requirement: what correlation adds (interpolation, linearisation) is within 3 % of the
        // projection. Rounding to 8 bits, which no code can undo, adds up to 5 % more at 16 px.
        assert!((found_float / best - 1.0).abs() <= 0.03, "{what} rms {found_float} px, projection {best}");
        assert!((found / best_rounded - 1.0).abs() <= 0.03, "{what} rms {found} px, with rounding {best_rounded}");
    }
}

#[test]
fn analytic_pair_is_measured_to_its_projection_with_16_px_elements() {
    assert_analytic_pair(16, [0.0140, 0.0066]);
}

#[test]
fn analytic_pair_is_measured_to_its_projection_with_32_px_elements() {
    assert_analytic_pair(32, [0.0535, 0.0253]);
}

/// Largest component of the mean error over translations by 0.1 to 0.9 px, along x, y and both.
#[track_caller]
fn largest_bias(interpolation: Interpolation, options: &RenderOptions) -> f64 {
    let (width, height) = (options.width, options.height);
    let correlator = prepared(&picture(&REST, options), &inside(width, height, 16), interpolated(interpolation));
    let mut worst = 0.0f64;
    for step in 1..=9 {
        let t = 0.1 * f64::from(step);
        for shift in [[t, 0.0], [0.0, t], [t, t]] {
            let motion = Translation(shift);
            let found = solved(&correlator, &picture(&motion, options));
            let bias = mean(&node_errors(correlator.mesh(), &found.displacement, &motion));
            worst = worst.max(largest(&[bias]));
        }
    }
    println!("{interpolation:?}, {:?}: largest bias {worst:.1e} px", options.depth);
    worst
}

#[test]
fn translations_of_float_images_are_biased_by_less_than_8e_4_px_with_the_cubic_spline() {
    // The requirement; THEORY 2 has 7e-4 px at a quarter pixel.
    assert!(largest_bias(Interpolation::Cubic, &float(512, 512)) <= 8e-4);
}

#[test]
fn translations_of_float_images_are_biased_by_less_than_8e_5_px_with_the_quintic_spline() {
    // The requirement; THEORY 2 has 6e-5 px.
    assert!(largest_bias(Interpolation::Quintic, &float(512, 512)) <= 8e-5);
}

#[test]
fn rounding_to_8_bits_adds_less_than_15e_5_px_to_the_bias() {
    // The requirement: twice the scatter of the mean over 512 x 512 px by rounding, 7e-5 px (THEORY 2).
    assert!(largest_bias(Interpolation::Cubic, &eight_bit(512, 512)) <= 8e-4 + 1.5e-4);
    assert!(largest_bias(Interpolation::Quintic, &eight_bit(512, 512)) <= 8e-5 + 1.5e-4);
}

#[test]
fn whole_pixel_translations_of_identical_pixels_are_exact() {
    for options in [eight_bit(256, 192), float(256, 192)] {
        for interpolation in
            [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        {
            let correlator = prepared(&picture(&REST, &options), &inside(256, 192, 32), interpolated(interpolation));
            let mut worst = 0.0f64;
            for shift in [[0.0, 0.0], [3.0, -2.0], [-1.0, 0.0], [0.0, 1.0], [-17.0, 11.0]] {
                let motion = Translation(shift);
                let found = solved(&correlator, &picture(&motion, &options));
                let error = largest(&node_errors(correlator.mesh(), &found.displacement, &motion));
                // The requirement. The residual vanishes at the solution, so Gauss-Newton converges
                // quadratically and only the round-off of f32 is left.
                assert!(error <= 1e-6, "{interpolation:?}, {:?}, {shift:?}: {error} px", options.depth);
                worst = worst.max(error);
            }
            println!("{interpolation:?}, {:?}, whole pixels: {worst:.1e} px", options.depth);
        }
    }
}

#[track_caller]
fn assert_agrees_with_plain(interpolation: Interpolation, degree: usize, brightness: Brightness) {
    let (width, height) = (256, 208);
    let motion = Accuracy::new(width, height);
    let reference = picture(&REST, &eight_bit(width, height));
    let deformed = changed(&picture(&motion, &eight_bit(width, height)), |_, _, grey| 0.9 * grey + 14.0);
    // Tighter than the 1e-5 px asked for by more than the contraction of an iteration, about ninefold.
    let options = Options { interpolation, brightness, tolerance_px: 5e-7, ..Options::default() };
    let correlator = prepared(&reference, &one([4.0, 4.0, 244.0, 196.0]), options);
    let found = solved(&correlator, &deformed).displacement;
    let start = exact_at(&motion, correlator.mesh().nodes());
    let want = plain::correlate(&reference, &deformed, correlator.mesh(), degree, brightness, start);
    let difference = largest_difference(&found, &want);
    println!("{interpolation:?}, {brightness:?}, f32 against f64: {difference:.1e} px");
    // The requirement: f32 kernel against f64 within 1e-5 px.
    assert!(difference <= 1e-5, "{interpolation:?}, {brightness:?}: {difference} px");
}

#[test]
fn f32_kernels_agree_with_a_plain_f64_correlation() {
    assert_agrees_with_plain(Interpolation::Cubic, 3, Brightness::Zone);
    assert_agrees_with_plain(Interpolation::Cubic, 3, Brightness::Element);
    assert_agrees_with_plain(Interpolation::Quintic, 5, Brightness::Zone);
}

/// Root mean square error, grey levels, of the quintic spline half-way between the pixels.
fn interpolation_error(options: &RenderOptions) -> f64 {
    let spline = plain::Spline::new(&picture(&REST, options), 5);
    let exact = picture(&Translation([-0.5, -0.5]), options);
    let inner = (16..options.height - 16).flat_map(|y| (16..options.width - 16).map(move |x| (x, y)));
    let errors: Vec<[f64; 2]> = inner
        .map(|(x, y)| [spline.value([x as f64 + 0.5, y as f64 + 0.5]) - f64::from(exact.grey(x, y)), 0.0])
        .collect();
    rms(&errors)
}

#[test]
fn affine_fields_are_recovered_with_elements_of_any_size() {
    let (width, height) = (420, 300);
    let motion = Affine::new([[0.004, -0.003], [0.002, -0.005]], width, height);
    let reference = picture(&REST, &float(width, height));
    let deformed = picture(&motion, &float(width, height));
    let interpolation_error = interpolation_error(&float(width, height));
    for element_size in [4, 5, 8, 16, 17, 24, 32, 128] {
        for roi in [[12.0, 9.0, 402.0, 285.0], [12.3, 8.75, 401.6, 284.9]] {
            let options = Options { interpolation: Interpolation::Quintic, ..sized(element_size) };
            let correlator = prepared(&reference, &one(roi), options);
            let found = solved(&correlator, &deformed);
            let error = rms(&node_errors(correlator.mesh(), &found.displacement, &motion));
            // Q4 holds an affine field exactly. What interpolation adds to the deformed image acts like noise
            // in one image (THEORY 2: sqrt(3) e / (l g_x) per component); half-way between pixels it is at
            // its worst, which covers the edges. Iteration stops at 1e-4 px.
            let g_x = plain::gradient_rms(&reference, correlator.mesh())[0];
            let tolerance = 6f64.sqrt() * interpolation_error / (element_size as f64 * g_x) + 1e-4;
            assert!(error <= tolerance, "{element_size} px, {roi:?}: {error} px, tolerance {tolerance}");
        }
    }
}
