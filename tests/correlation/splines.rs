//! Cubic-spline elements: closer to the displacement at the same noise than bilinear ones, with the scatter that their
//! standard uncertainty states, whatever the zone loses; and what they are refused for.

use crate::common;
use common::*;
use quadrille::backend::GreyTransfer;
use quadrille::correlate::{CorrelationError, Options, Regularisation, Start};
use quadrille::field::{Elements, Measurement, Status};
use quadrille::imaging::Image;
use quadrille::mesh::{Crack, Zone};
use quadrille::synth::{Accuracy, Motion, Rotation, Sinusoids, Texture, Translation, render};
use quadrille::units::Px;
use std::sync::Arc;

fn splines(element_size: usize) -> Options {
    Options { elements: Elements::CubicSpline, element_size, ..Options::default() }
}

/// Root mean square error of a component of the values at points of nodes more than `margin` px inside, px.
fn rms_of_values<M: Motion>(found: &Measurement<Px>, motion: &M, side: usize, margin: f64) -> f64 {
    let points = found.points.as_ref().unwrap();
    let is_inside = |at: &[f64; 2]| at.iter().all(|&v| v > margin && v < side as f64 - margin);
    let errors: Vec<[f64; 2]> = (found.mesh.nodes().iter().zip(&points.displacement))
        .filter(|(at, _)| is_inside(at))
        .map(|(&at, u)| {
            let want = motion.displacement(at);
            [u[0] - want[0], u[1] - want[1]]
        })
        .collect();
    rms(&errors) / 2f64.sqrt()
}

#[test]
fn waves_of_four_elements_are_followed_as_closely_by_splines_as_by_bilinear_elements_of_less_than_their_size() {
    const SIDE: usize = 480;
    let texture = Texture::new(2024, 3.2).unwrap();
    let wave = Sinusoids { amplitude: 0.5, wavelength: 64.0 };
    let [f, g] = [
        Arc::new(render(&texture, &REST, &float(SIDE, SIDE)).unwrap()),
        Arc::new(render(&texture, &wave, &float(SIDE, SIDE)).unwrap()),
    ];
    let zones = inside(SIDE, SIDE, 16);
    let rms_with = |options: Options| {
        let correlator = prepared(&f, &zones, options);
        rms_of_values(&solved(&correlator, &g), &wave, SIDE, 50.0)
    };
    let [bilinear, smaller] = [16, 12].map(|element_size| rms_with(Options { element_size, ..Options::default() }));
    let found = rms_with(splines(16));
    println!("bilinear 16 px {bilinear:.4} px, 12 px {smaller:.4} px, splines 16 px {found:.4} px");
    // Of a wave of four elements bilinear elements lose 6 % at their nodes and 30 % between, splines 1 to 2 %
    // (`scripts/noise_resolution.py`).
    assert!(found < 0.6 * bilinear && found < smaller, "{found} against {bilinear} and {smaller}");
}

#[test]
fn the_scatter_of_splines_over_repeated_noise_is_that_of_their_standard_uncertainty() {
    const SIDE: usize = 272; // 16 x 16 knots
    const REPEATS: u64 = 40;
    let texture = Texture::new(77, 3.2).unwrap();
    let still = render(&texture, &REST, &float(SIDE, SIDE)).unwrap();
    // Sums of squares of errors and of standard uncertainties: inside, beside edges, on edges, in corners; of values
    // and coefficients.
    let mut sums = [[0.0f64; 4]; 4];
    for seed in 0..REPEATS {
        let [f, g] = [0, 1].map(|image| noisy(&still, 2.0, 2 * seed + image));
        let found = solved(&prepared(&f, &inside(SIDE, SIDE, 8), splines(16)), &g);
        let points = found.points.as_ref().unwrap();
        for (node, at) in found.mesh.nodes().iter().enumerate() {
            let from_end = at.map(|v| (v - 8.0).min(SIDE as f64 - 8.0 - v));
            let ends = from_end.iter().filter(|&&d| d < 1.0).count();
            let place = if ends == 0 && from_end.iter().any(|&d| d < 15.0) { 1 } else { ends + usize::from(ends > 0) };
            for c in 0..2 {
                sums[place][0] += points.displacement[node][c].powi(2);
                sums[place][1] += points.sigma[node][c].powi(2);
                sums[place][2] += found.displacement[node][c].powi(2);
                sums[place][3] += found.sigma[node][c].powi(2);
            }
        }
    }
    // Nodes beside each other scatter alike, so that 40 repeats are some 20 000 numbers inside, 1 300 beside and on
    // edges, 160 in corners. In corners second differences hold what hardly any data does, which scatters less than
    // is stated.
    let ratios = |[points, sigma, coefficients, of_coefficients]: [f64; 4]| {
        [(points / sigma).sqrt(), (coefficients / of_coefficients).sqrt()]
    };
    let places = ["inside", "beside edges", "on edges", "corners"];
    for (what, [values, coefficients]) in places.iter().zip(sums.map(ratios)) {
        println!("{what}: scatter over sigma, values {values:.3}, coefficients {coefficients:.3}");
    }
    for ((what, [values, coefficients]), tolerance) in places.iter().zip(sums.map(ratios)).zip([0.03, 0.08, 0.08, 0.25])
    {
        assert!((coefficients - 1.0).abs() < tolerance, "{what}: {coefficients}");
        // Towards borders what is stated for values is that of the coefficients, more than theirs.
        let least = if *what == "inside" { 1.0 - tolerance } else { 0.7 };
        assert!((least..1.0 + tolerance).contains(&values), "{what}, values: {values}");
    }
}

/// A pair with noise of two grey levels.
fn noisy_pair<M: Motion>(motion: &M, side: usize) -> [Arc<Image>; 2] {
    let texture = Texture::new(5, 3.2).unwrap();
    let drawn = |motion: &dyn Fn() -> Image, seed| noisy(&motion(), 2.0, seed);
    [
        drawn(&|| render(&texture, &REST, &float(side, side)).unwrap(), 1),
        drawn(&|| render(&texture, motion, &float(side, side)).unwrap(), 2),
    ]
}

#[test]
fn the_whole_image_that_loses_pixels_at_its_border_takes_no_more_iterations_and_errs_by_its_uncertainty() {
    const SIDE: usize = 400;
    let motion = Translation([-17.3, 9.6]);
    let [f, g] = noisy_pair(&motion, SIDE);
    let correlator = prepared(&f, &inside(SIDE, SIDE, 0), splines(16));
    let found = cold(&correlator, &g);
    assert_eq!(found.measurement.status, Status::Converged);
    let field = &found.measurement;
    let worst = worst_by_sigma(field, &motion, 1e-3);
    println!("{} iterations, {} nodes left, worst {worst:.2} sigma", found.iterations, found.nodes_left);
    assert!(found.iterations <= 8, "{}", found.iterations);
    assert!(found.nodes_left > 50, "{}", found.nodes_left);
    // Of 2500 nodes, 2 components each, of which neighbours scatter alike.
    assert!(worst < 4.5, "{worst}");
    // A start that is no spline at all ends in the same field.
    let rough = |k: usize| f64::from((k as u32).wrapping_mul(2_654_435_769) >> 16) / 65536.0 - 0.5;
    let start = Start {
        displacement: (0..field.mesh.n_nodes()).map(|k| [-17.3 + rough(2 * k), 9.6 + rough(2 * k + 1)]).collect(),
        transfer: vec![GreyTransfer::NONE],
        left_out: Vec::new(),
    };
    let again = correlator.correlate(g, Some(&start)).unwrap();
    assert_eq!(again.measurement.status, Status::Converged);
    let both = |node: &usize| field.measured[*node] && again.measurement.measured[*node];
    for node in (0..field.mesh.n_nodes()).filter(both) {
        for c in 0..2 {
            let apart = (field.displacement[node][c] - again.measurement.displacement[node][c]).abs();
            // What the tolerance and round-off in single precision leave.
            assert!(apart < 5e-4 + 0.1 * field.sigma[node][c], "{node}: {apart}");
        }
    }
}

#[test]
fn masks_zones_that_part_and_rotations_are_measured_within_their_uncertainty() {
    const SIDE: usize = 320;
    let polygon = vec![[20.3, 17.0], [300.0, 30.0], [280.0, 290.0], [160.0, 230.0], [15.0, 285.0]];
    let hole = vec![[110.0, 90.0], [170.0, 95.0], [140.0, 150.0]];
    let masked = Zone { name: "poly".into(), polygon, exclude: vec![hole], ..Zone::default() };
    let two = vec![zone("left", [20.0, 20.0, 148.0, 300.0]), zone("right", [165.0, 24.0, 300.0, 297.0])];
    let strain = Accuracy::about([160.0; 2], Sinusoids { amplitude: 0.0, wavelength: 256.0 }, 0.005, 1.0);
    for (what, zones) in [("mask", vec![masked]), ("two zones", two)] {
        let [f, g] = noisy_pair(&strain, SIDE);
        let found = solved(&prepared(&f, &zones, splines(16)), &g);
        let worst = worst_by_sigma(&found, &strain, 1e-3);
        println!("{what}: worst {worst:.2} sigma");
        assert!(worst < 5.0, "{what}: {worst}");
    }
    let turned = Rotation::about([160.0; 2], 25.0);
    let [f, g] = noisy_pair(&turned, SIDE);
    let correlator = prepared(&f, &one([90.0, 90.0, 230.0, 230.0]), splines(16));
    let found = cold(&correlator, &g);
    assert_eq!(found.measurement.status, Status::Converged);
    let worst = worst_by_sigma(&found.measurement, &turned, 2e-3);
    println!("25 degrees: {} iterations, worst {worst:.2} sigma", found.iterations);
    assert!(worst < 5.0 && found.iterations <= 10, "{worst}, {}", found.iterations);
}

#[test]
fn what_splines_cannot_be_laid_on_is_refused_in_words() {
    let [f, _] = noisy_pair(&REST, 160);
    let zones = inside(160, 160, 8);
    let said = |zones: &[Zone], options: Options| refusal(&f, zones, options).to_string();
    for size in [6, 15] {
        let error = said(&zones, splines(size));
        assert!(error.contains("even number of pixels from 8 on") && error.contains(&size.to_string()), "{error}");
    }
    let regularisation = Regularisation::Tikhonov { cutoff_px: 64.0 };
    let error = said(&zones, Options { regularisation, ..splines(16) });
    assert!(error.contains("tikhonov") && error.contains("cubic-spline"), "{error}");
    let cut = Zone { cracks: vec![Crack { path: vec![[0.0, 80.0], [90.0, 82.0]], guard: 0.0 }], ..zones[0].clone() };
    let free = free_zone(free_mesh([16.0, 16.0, 144.0, 144.0], 16.0, 2.0, false));
    for zone in [cut, free] {
        let error = refusal(&f, std::slice::from_ref(&zone), splines(16));
        assert!(matches!(&error, CorrelationError::Splines { zone: of } if *of == zone.name), "{error}");
        assert!(error.to_string().contains("leave --elements out"), "{error}");
    }
}
