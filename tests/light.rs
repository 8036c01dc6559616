//! Light that changes over the specimen: what gradients and shadows cost, with smooth fields of brightness and contrast
//! and without.

mod common;

use common::*;
use quadrille::backend::Backend;
use quadrille::correlate::{Correlation, Correlator, Options};
use quadrille::field::{Brightness, Status};
use quadrille::imaging::Image;
use quadrille::synth::Translation;
use std::sync::Arc;

/// Standard deviation of the noise, grey levels of 255.
const NOISE: f32 = 2.0;
const SIDE: usize = 352;
/// Elements of 16 px along a side of the zone.
const ELEMENTS: usize = 20;

/// Errors of all nodes over their printed standard uncertainty, and alone: rms over the inner nodes and those on edges.
struct Errors {
    inner: [f64; 2],
    edges: [f64; 2],
}

fn errors<B: Backend>(correlator: &Correlator<B>, found: &Correlation, motion: &Translation) -> Errors {
    let mesh = correlator.mesh();
    let grid = mesh.whole_grid(0).unwrap();
    let errors = node_errors(mesh, &found.measurement.displacement, motion);
    let rms = |on_edge: bool| {
        let (mut of_error, mut by_sigma, mut n) = (0.0, 0.0, 0.0);
        for j in 0..=grid.ny {
            for i in 0..=grid.nx {
                let node = grid.node(i, j);
                if (i == 0 || j == 0 || i == grid.nx || j == grid.ny) != on_edge {
                    continue;
                }
                for c in 0..2 {
                    of_error += errors[node][c].powi(2);
                    by_sigma += (errors[node][c] / found.measurement.sigma[node][c]).powi(2);
                    n += 1.0;
                }
            }
        }
        [(of_error / n).sqrt(), (by_sigma / n).sqrt()]
    };
    Errors { inner: rms(false), edges: rms(true) }
}

/// The light of the deformed image: a factor and what is added, by place.
type Lit = fn(f32, f32) -> (f32, f32);

/// From 0 to 1 over `width` px about the middle, with continuous slope.
fn step(from_middle: f32, width: f32) -> f32 {
    let t = (from_middle / width + 0.5).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

const LIGHTS: [(&str, Lit); 5] = [
    ("constant", |_, _| (1.0, 0.0)),
    ("dimmed", |_, _| (0.85, 5.0)),
    // 15 % over the picture.
    ("gradient", |x, _| (0.925 + 0.15 * x / SIDE as f32, 0.0)),
    // 25 % darker behind an oblique edge of 80 px.
    ("shadow", |x, y| (1.0 - 0.25 * step(0.8 * x + 0.6 * y - 0.7 * SIDE as f32, 80.0), 0.0)),
    ("contrast and brightness", |x, y| (0.9 + 0.15 * y / SIDE as f32, 20.0 * x / SIDE as f32 - 10.0)),
];

fn pictures(lit: Lit, seed: u64) -> ([Arc<Image>; 2], Translation) {
    let motion = Translation([3.37, -1.62]);
    let reference = noisy(&picture(&REST, &float(SIDE, SIDE)), NOISE, 2 * seed);
    let deformed = changed(&picture(&motion, &float(SIDE, SIDE)), |x, y, grey| {
        let (gain, offset) = lit(x as f32, y as f32);
        gain * grey + offset
    });
    ([reference, noisy(&deformed, NOISE, 2 * seed + 1)], motion)
}

#[test]
#[ignore = "prints"]
fn study() {
    for (what, lit) in LIGHTS {
        let ([reference, deformed], motion) = pictures(lit, 1);
        for brightness in [Brightness::Zone, Brightness::Auto, Brightness::Smooth, Brightness::Element] {
            let roi = inside(SIDE, SIDE, (SIDE - 16 * ELEMENTS) / 2);
            let correlator = prepared(&reference, &roi, Options { brightness, ..Options::default() });
            let now = std::time::Instant::now();
            let found = cold(&correlator, &deformed);
            let seconds = now.elapsed().as_secs_f64();
            let Errors { inner, edges } = errors(&correlator, &found, &motion);
            assert_eq!(found.measurement.status, Status::Converged);
            println!(
                "{what:24} {brightness:8} inner {:.5} px {:.3}, edges {:.5} px {:.3}; noise {:.3}, {} its, {seconds:.3} s, {:?}",
                inner[0], inner[1], edges[0], edges[1], found.zones[0].noise, found.iterations, found.zones[0].light
            );
        }
    }
}
