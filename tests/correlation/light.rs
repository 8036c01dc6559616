//! Light that changes over the specimen: what gradients and shadows cost, with smooth fields of brightness and contrast
//! and without.

use crate::common;
use common::data::folder;
use common::*;
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlation, Correlator, Options};
use quadrille::field::{Brightness, Status};
use quadrille::imaging::Image;
use quadrille::io::images::read_image;
use quadrille::remark::Code;
use quadrille::report::summary::FrameSummary;
use quadrille::synth::Translation;
use std::sync::Arc;

/// Standard deviation of the noise, grey levels of 255.
const NOISE: f32 = 2.0;
const SIDE: usize = 352;
const MARGIN: usize = 16;
const SHIFT: Translation = Translation([3.37, -1.62]);
/// Draws of the noise.
const DRAWS: u64 = 3;

/// The light of the deformed image: a factor and what is added, by place.
type Lit = fn(f32, f32) -> (f32, f32);

/// From 0 to 1 over `width` px about the middle, with continuous slope.
fn step(from_middle: f32, width: f32) -> f32 {
    let t = (from_middle / width + 0.5).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// As the reference.
const CONSTANT: Lit = |_, _| (1.0, 0.0);
/// 15 % over the picture.
const GRADIENT: Lit = |x, _| (0.925 + 0.15 * x / SIDE as f32, 0.0);
/// 18 % darker behind an oblique edge of 100 px. About as much of the picture is brighter as is darker: the noise of
/// the camera stays, and against less light it weighs more, which no method can help.
const SHADOW: Lit = |x, y| (1.1 - 0.2 * step(0.8 * x + 0.6 * y - 0.7 * SIDE as f32, 100.0), 0.0);
/// Contrast along one axis and brightness along the other.
const BOTH: Lit = |x, y| (0.9 + 0.15 * y / SIDE as f32, 20.0 * x / SIDE as f32 - 10.0);

/// The reference and the deformed image in some light, with noise of their own in every draw.
struct Pictures {
    reference: Arc<Image>,
    deformed: Arc<Image>,
}

impl Pictures {
    fn new() -> Self {
        let [reference, deformed] = [REST, SHIFT].map(|motion| picture(&motion, &float(SIDE, SIDE)));
        Self { reference, deformed }
    }

    fn reference(&self, draw: u64) -> Arc<Image> {
        noisy(&self.reference, NOISE, 2 * draw)
    }

    /// The noise is that of the camera: it does not change with the light.
    fn deformed(&self, lit: Lit, draw: u64) -> Arc<Image> {
        let in_light = changed(&self.deformed, |x, y, grey| {
            let (gain, offset) = lit(x as f32, y as f32);
            gain * grey + offset
        });
        noisy(&in_light, NOISE, 2 * draw + 1)
    }
}

fn correlator(reference: &Arc<Image>, brightness: Brightness) -> Correlator<CpuBackend> {
    prepared(reference, &inside(SIDE, SIDE, MARGIN), Options { brightness, ..Options::default() })
}

/// Mean squares over the nodes: errors, px, and errors over the printed standard uncertainty.
#[derive(Default, Clone, Copy)]
struct Squares {
    error: f64,
    by_sigma: f64,
    n: f64,
}

/// Of the inner nodes and of those on edges.
fn add_errors(all: &mut [Squares; 2], correlator: &Correlator<CpuBackend>, found: &Correlation) {
    let mesh = correlator.mesh();
    let grid = mesh.whole_grid(0).unwrap();
    let errors = node_errors(mesh, &found.measurement.displacement, &SHIFT);
    for (node, (error, sigma)) in errors.iter().zip(&found.measurement.sigma).enumerate() {
        let [i, j] = [node % (grid.nx + 1), node / (grid.nx + 1)];
        let of_place = &mut all[usize::from(i == 0 || j == 0 || i == grid.nx || j == grid.ny)];
        for c in 0..2 {
            of_place.error += error[c].powi(2);
            of_place.by_sigma += (error[c] / sigma[c]).powi(2);
            of_place.n += 1.0;
        }
    }
}

impl Squares {
    fn rms(&self) -> [f64; 2] {
        [self.error, self.by_sigma].map(|sum| (sum / self.n).sqrt())
    }
}

#[test]
fn gradients_of_light_and_shadows_cost_nothing_and_sigma_stays_right() {
    let pictures = Pictures::new();
    let references: Vec<_> = (0..DRAWS).map(|draw| pictures.reference(draw)).collect();
    let of_all = |brightness: Brightness, lit: Lit| {
        let (mut all, mut iterations) = ([Squares::default(); 2], Vec::new());
        for (draw, reference) in (0..).zip(&references) {
            let correlator = correlator(reference, brightness);
            let found = cold(&correlator, &pictures.deformed(lit, draw));
            assert_eq!(found.measurement.status, Status::Converged, "{brightness}, draw {draw}");
            let smooth = found.zones[0].light.is_some();
            // No light that changes is overlooked, and none is seen where it does not.
            assert_eq!(smooth, brightness != Brightness::Zone && lit as usize != CONSTANT as usize, "{brightness}");
            add_errors(&mut all, &correlator, &found);
            iterations.push(found.iterations);
        }
        (all.map(|squares| squares.rms()), iterations)
    };
    let (clear, _) = of_all(Brightness::Zone, CONSTANT);
    for (what, lit) in [("gradient", GRADIENT), ("shadow", SHADOW), ("contrast and brightness", BOTH)] {
        for brightness in [Brightness::Auto, Brightness::Smooth] {
            let (found, iterations) = of_all(brightness, lit);
            for (place, [of_place, clear]) in [("inner", [found[0], clear[0]]), ("edges", [found[1], clear[1]])] {
                let ratio = of_place[0] / clear[0];
                println!(
                    "{what}, {brightness}, {place}: error {:.4} px, {ratio:.3} of that in constant light, {:.3} sigma \
                     (there {:.3}), iterations {iterations:?}",
                    of_place[0], of_place[1], clear[1]
                );
                // The requirement. Draws are the same with and without the light, so that their scatter cancels.
                assert!(ratio <= 1.1, "{what}, {brightness}, {place}: {ratio}");
                // Of 2166 inner components and 480 on edges, neighbours alike: 3 and 6 %.
                assert!((0.9..=1.1).contains(&of_place[1]), "{what}, {brightness}, {place}: {} sigma", of_place[1]);
            }
        }
    }
}

#[test]
fn light_that_does_not_settle_with_the_displacement_is_told_of() {
    // Up and down by 30 % within 100 px: elements of 8 px see slopes of light as steep as those of the texture.
    const WAVES: Lit = |x, y| (1.0 + 0.3 * (0.063 * x).sin() * (0.063 * y).cos(), 0.0);
    let pictures = Pictures::new();
    let reference = pictures.reference(0);
    let options = Options { element_size: 8, ..Options::default() };
    let correlator = prepared(&reference, &inside(SIDE, SIDE, MARGIN), options);
    let told = |lit: Lit| {
        let found = cold(&correlator, &pictures.deformed(lit, 0));
        let summary = FrameSummary::of(1, "frame".into(), Vec::new(), &correlator, &found, [0.0; 2]);
        let remarks = summary.remarks.into_iter().filter(|remark| remark.code == Code::LightUnsettled);
        (found, remarks.collect::<Vec<_>>())
    };
    let (found, remarks) = told(GRADIENT);
    assert!(found.zones[0].light.is_some_and(|light| !light.unsettled) && remarks.is_empty(), "{remarks:?}");
    let (found, remarks) = told(WAVES);
    let light = found.zones[0].light.expect("smooth fields");
    assert!(light.unsettled && remarks.len() == 1, "{light:?}, {remarks:?}");
    // What it says is true: the standard uncertainty is too small.
    let measured = |node: &usize| found.measurement.measured[*node];
    let errors = node_errors(correlator.mesh(), &found.measurement.displacement, &SHIFT);
    let by_sigma: Vec<f64> = (0..errors.len())
        .filter(measured)
        .flat_map(|node| [0, 1].map(|c| (errors[node][c] / found.measurement.sigma[node][c]).powi(2)))
        .collect();
    let scatter = (by_sigma.iter().sum::<f64>() / by_sigma.len() as f64).sqrt();
    println!(
        "{:?}, {} iterations, {scatter:.2} of the standard uncertainty",
        found.measurement.status, found.iterations
    );
    assert!(scatter > 1.2, "{scatter}");
}

fn bits(found: &Correlation) -> Vec<u64> {
    let Correlation { measurement, zones, .. } = found;
    let of_zones = zones.iter().flat_map(|zone| [zone.transfer.gain, zone.transfer.offset, zone.noise]);
    let numbers = measurement.displacement.iter().chain(&measurement.sigma).flatten().copied().chain(of_zones);
    numbers.map(f64::to_bits).collect()
}

#[test]
fn in_constant_light_the_default_gives_the_bits_of_one_gain_and_offset_per_zone() {
    let pictures = Pictures::new();
    let dimmed: Lit = |_, _| (0.8, 12.0);
    for draw in 0..DRAWS {
        let reference = pictures.reference(draw);
        let [auto, zone, smooth] =
            [Brightness::Auto, Brightness::Zone, Brightness::Smooth].map(|b| correlator(&reference, b));
        for lit in [CONSTANT, dimmed] {
            let deformed = pictures.deformed(lit, draw);
            let [auto, zone, smooth] = [&auto, &zone, &smooth].map(|correlator| cold(correlator, &deformed));
            assert_eq!(auto.iterations, zone.iterations);
            assert!(bits(&auto) == bits(&zone) && auto.zones[0].light.is_none(), "draw {draw}");
            // Fields that are not needed do no harm: a dozen unknowns among 700 take little from the displacement.
            let by_sigma = moved(&smooth, &zone);
            println!("draw {draw}: smooth fields move the displacement by {by_sigma:.3} sigma");
            assert!(by_sigma < 0.2, "{by_sigma} sigma");
        }
    }
}

/// Root mean square difference of two results, in the standard uncertainties of the second.
fn moved(a: &Correlation, b: &Correlation) -> f64 {
    let (a, b) = (&a.measurement, &b.measurement);
    let mut by_sigma = Vec::new();
    for node in (0..a.displacement.len()).filter(|&node| a.measured[node] && b.measured[node]) {
        by_sigma.push([0, 1].map(|c| (a.displacement[node][c] - b.displacement[node][c]) / b.sigma[node][c]));
    }
    rms(&by_sigma) / 2f64.sqrt()
}

#[test]
fn a_crack_through_the_zone_is_not_taken_for_light() {
    let pictures = Pictures::new();
    let reference = pictures.reference(7);
    // The lower half moves by 1.5 px more: one row of elements holds both.
    let lower = picture(&Translation([3.37, -0.12]), &float(SIDE, SIDE));
    let cracked = changed(&pictures.deformed, |x, y, grey| if y > 180 { lower.grey(x, y) } else { grey });
    let cracked = noisy(&cracked, NOISE, 15);
    let [auto, zone, smooth] = [Brightness::Auto, Brightness::Zone, Brightness::Smooth]
        .map(|brightness| cold(&correlator(&reference, brightness), &cracked));
    println!(
        "auto {:?}, {:.3} sigma; smooth {:.3} sigma",
        auto.zones[0].light,
        moved(&auto, &zone),
        moved(&smooth, &zone)
    );
    // Sigma is that of noise and misfit together; beside the crack alone the fields differ.
    assert!(moved(&auto, &zone) < 0.2 && moved(&smooth, &zone) < 0.2);
}

#[test]
fn fields_of_light_do_not_move_real_images_in_constant_light() {
    let Some(folder) = folder("dicchallenge-s14-sinusoid") else { return };
    let read = |name: &str| Arc::new(read_image(&folder.join(name), 0).expect("an image of the data folder").image);
    let (reference, deformed) = (read("Sample14 Reference.tif"), read("Sample14 L5 Amp0.1b.tif"));
    let [zone, smooth, auto] = [Brightness::Zone, Brightness::Smooth, Brightness::Auto].map(|brightness| {
        let options = Options { brightness, drop_textureless: true, ..Options::default() };
        cold(&prepared(&reference, &one([100.0, 100.0, 1956.0, 484.0]), options), &deformed)
    });
    println!("smooth {:.3} sigma, {:?}; auto {:?}", moved(&smooth, &zone), smooth.zones[0].light, auto.zones[0].light);
    assert!(moved(&smooth, &zone) < 0.2);
    assert!(bits(&auto) == bits(&zone), "the light of this sample does not change");
}
