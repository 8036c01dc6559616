//! Where the field is not followed: the residual names the elements, and the estimated model error holds the error of
//! the nodes. Against exact fields, with noise.

use crate::common;
use common::scenes::{self, SPOT_PX, Spots};
use common::*;
use quadrille::correlate::{Correlation, CorrelationError, Options, Regularisation};
use quadrille::field::{ElementMark, Measurement, Status};
use quadrille::imaging::Image;
use quadrille::synth::{Affine, Motion, Translation};
use quadrille::units::Px;
use std::f64::consts::TAU;
use std::sync::Arc;

const SIDE: usize = 288;
const ELEMENT: f64 = 16.0;
const NOISE: f32 = 2.0;

/// `u_x = a sin(2 pi x / L + 1)`, `u_y = a sin(2 pi y / L + 2)`.
#[derive(Clone, Copy, Debug)]
struct Wave {
    amplitude: f64,
    length: f64,
}

impl Motion for Wave {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|c| self.amplitude * (TAU * x[c] / self.length + 1.0 + c as f64).sin())
    }

    fn at(&self, fraction: f64) -> Self {
        Self { amplitude: fraction * self.amplitude, ..*self }
    }

    fn is_smooth(&self) -> bool {
        false
    }
}

/// A band `width` px wide along x, over which `u_y` grows by `jump`.
#[derive(Clone, Copy, Debug)]
struct Band {
    jump: f64,
    width: f64,
}

/// Inside an element: the nodes lie at 16, 32, ..
const BAND_AT: f64 = 148.0;

impl Motion for Band {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        [0.0, 0.5 * self.jump * ((x[0] - BAND_AT) / (0.5 * self.width)).tanh()]
    }

    fn at(&self, fraction: f64) -> Self {
        Self { jump: fraction * self.jump, ..*self }
    }

    fn is_smooth(&self) -> bool {
        false
    }
}

fn photographed<M: Motion>(motion: &M, seed: u64) -> Arc<Image> {
    noisy(&picture(motion, &float(SIDE, SIDE)), NOISE, seed)
}

#[track_caller]
fn measured<M: Motion>(motion: &M, options: Options) -> Correlation {
    let correlator = prepared(&photographed(&REST, 1), &inside(SIDE, SIDE, 16), options);
    let found = cold(&correlator, &photographed(motion, 2));
    assert_eq!(found.measurement.status, Status::Converged);
    found
}

fn model(measurement: &Measurement<Px>) -> &[[f64; 2]] {
    &measurement.model_error.as_ref().unwrap().nodes
}

fn rms(values: &[[f64; 2]]) -> f64 {
    (values.as_flattened().iter().map(|v| v * v).sum::<f64>() / (2 * values.len()) as f64).sqrt()
}

/// Share of the measured displacements off by more than three times sigma and model error together.
fn share_beyond<M: Motion>(field: &Measurement<Px>, motion: &M) -> f64 {
    let errors = node_errors(&field.mesh, &field.displacement, motion);
    let model = model(field);
    let (mut beyond, mut n) = (0usize, 0usize);
    for node in (0..errors.len()).filter(|&node| field.measured[node]) {
        for c in 0..2 {
            n += 1;
            beyond += usize::from(errors[node][c].abs() > 3.0 * field.sigma[node][c].hypot(model[node][c]));
        }
    }
    beyond as f64 / n as f64
}

#[test]
fn errors_of_waves_from_one_and_a_half_elements_on_lie_within_sigma_and_model_error() {
    for (elements, amplitude) in
        [(1.5, 0.2), (1.5, 0.7), (2.0, 0.2), (2.0, 0.7), (3.0, 0.2), (3.0, 2.0), (4.0, 0.7), (6.0, 2.0), (16.0, 2.0)]
    {
        let wave = Wave { amplitude, length: elements * ELEMENT };
        let found = measured(&wave, Options::default());
        let field = &found.measurement;
        let errors = node_errors(&field.mesh, &field.displacement, &wave);
        let (error, estimate, sigma) = (rms(&errors), rms(model(field)), rms(&field.sigma));
        let beyond = share_beyond(field, &wave);
        println!(
            "{amplitude} px over {elements} elements: error {error:.4}, model error {estimate:.4}, sigma {sigma:.4} px, beyond \
             {:.2} %, {:?}",
            100.0 * beyond,
            field.misfit()
        );
        // 1 % is asked for; one node in 289 may lie beyond.
        assert!(beyond <= 0.01, "{wave:?}: {beyond}");
        // An estimate, not a bound: a small factor of the error that noise does not explain.
        assert!(estimate <= 2.0 * error.max(sigma), "{wave:?}: {estimate} px for {error} px");
    }
}

#[test]
fn smooth_strain_is_estimated_right_within_a_third() {
    // Five elements a wave: the error of the nodes is u'' h^2 / 12 up to a tenth, far above noise.
    let wave = Wave { amplitude: 1.5, length: 5.0 * ELEMENT };
    let found = measured(&wave, Options::default());
    let field = &found.measurement;
    let errors = node_errors(&field.mesh, &field.displacement, &wave);
    let noise_off = (rms(&errors).powi(2) - rms(&field.sigma).powi(2)).sqrt();
    let ratio = rms(model(field)) / noise_off;
    assert!((0.75..1.33).contains(&ratio), "{ratio}");
}

#[test]
fn a_rigid_motion_has_no_misfit_and_next_to_no_model_error() {
    for (shift, seed) in [([0.0, 0.0], 3), ([0.3, 0.4], 4), ([5.5, -3.5], 5), ([0.5, 0.25], 6)] {
        let correlator = prepared(&photographed(&REST, seed), &inside(SIDE, SIDE, 16), Options::default());
        let found = cold(&correlator, &photographed(&Translation(shift), 10 * seed));
        let field = &found.measurement;
        assert_eq!(field.misfit(), None, "{shift:?}");
        let mut ratios: Vec<f64> =
            field.sigma.iter().zip(model(field)).flat_map(|(s, m)| [m[0] / s[0], m[1] / s[1]]).collect();
        ratios.sort_by(f64::total_cmp);
        // Second differences scatter by 2.9 sigma, a twelfth of which is a quarter.
        assert!(ratios[ratios.len() / 2] < 0.3, "{shift:?}: {}", ratios[ratios.len() / 2]);
        assert!(ratios[ratios.len() * 98 / 100] < 1.0, "{shift:?}: {}", ratios[ratios.len() * 98 / 100]);
    }
}

#[test]
fn a_band_narrower_than_an_element_is_named_with_its_place() {
    let band = Band { jump: 1.5, width: 3.0 };
    let found = measured(&band, Options::default());
    let field = &found.measurement;
    let misfit = field.misfit().expect("a band within an element is misfit");
    println!("{misfit}");
    // One column of sixteen; its neighbours bend with it.
    assert!((4.0..20.0).contains(&misfit.percent), "{misfit:?}");
    assert!((misfit.at[0] - BAND_AT).abs() <= ELEMENT, "{misfit:?}");
    // Within its element the band leaves up to half the jump to follow, on average some 0.2 of it.
    assert!((0.1..0.8).contains(&misfit.displacement), "{misfit:?}");
    let of = field.model_error.as_ref().unwrap();
    for (element, &px) in of.misfit.iter().enumerate().filter(|(_, px)| **px > 0.0) {
        let x = field.mesh.corners(element)[0][0] + 0.5 * ELEMENT;
        assert!((x - BAND_AT).abs() <= 1.6 * ELEMENT, "element {element} at {x}: {px} px");
    }
    assert!(share_beyond(field, &band) <= 0.01);
}

#[test]
fn a_band_in_a_mesh_that_is_only_sampled_is_named_as_well() {
    // 1600 elements, of which less than half are in the sample, and a band in one column of forty.
    const WIDE: usize = 672;
    let band = Band { jump: 1.5, width: 3.0 };
    let photographed = |motion: &Band, seed| noisy(&picture(motion, &float(WIDE, WIDE)), NOISE, seed);
    let correlator = prepared(&photographed(&band.at(0.0), 1), &inside(WIDE, WIDE, 16), Options::default());
    let field = solved(&correlator, &photographed(&band, 2));
    let marks = field.marks.as_ref().unwrap();
    let [mut named, mut false_marks] = [0usize; 2];
    for element in (0..marks.len()).filter(|&element| marks[element] == ElementMark::Misfit) {
        let x = field.mesh.corners(element)[0][0] + 0.5 * ELEMENT;
        // Beside the band elements bend with it.
        *(if (x - BAND_AT).abs() <= 1.6 * ELEMENT { &mut named } else { &mut false_marks }) += 1;
    }
    println!("{named} named, {false_marks} of {} marked elsewhere", marks.len());
    assert!(named >= 38 && false_marks <= marks.len() / 50, "{named} and {false_marks}");
}

#[test]
fn focus_that_is_lost_is_no_displacement() {
    let reference = photographed(&REST, 1);
    let shift = Translation([0.3, 0.4]);
    let sharp = picture(&shift, &float(SIDE, SIDE));
    let blurred = noisy(&blur(&sharp, 1.5), NOISE, 2);
    let correlator = prepared(&reference, &inside(SIDE, SIDE, 16), Options::default());
    let found = cold(&correlator, &blurred);
    let misfit = found.measurement.misfit().map_or(0.0, |misfit| misfit.percent);
    assert!(misfit < 2.0, "{misfit} %");
    assert!(share_beyond(&found.measurement, &shift) <= 0.01);
}

/// Share of the elements that are marked as misfit, and root mean square of the model error over sigma, of two images by
/// another renderer.
fn marked(spots: &Spots, deformed: &Spots, material: impl Fn([f64; 2]) -> [f64; 2] + Sync, noise: f64) -> [f64; 2] {
    let reference = scenes::photographed(SIDE, noise, 1, |x| spots.grey(x));
    let image = scenes::photographed(SIDE, noise, 2, |y| deformed.grey(material(y)));
    let found = solved(&prepared(&reference, &inside(SIDE, SIDE, 16), Options::default()), &image);
    let marks = found.marks.as_ref().unwrap();
    let share = marks.iter().filter(|mark| **mark == ElementMark::Misfit).count() as f64 / marks.len() as f64;
    let ratios: Vec<[f64; 2]> =
        found.sigma.iter().zip(model(&found)).map(|(s, m)| [m[0] / s[0], m[1] / s[1]]).collect();
    [share, rms(&ratios)]
}

#[test]
fn only_displacements_that_are_not_followed_are_marked() {
    let affine = scenes::AffineMotion { shift: [0.5, 0.5], gradient: [[0.01, 0.004], [-0.003, -0.005]], centre: 144.0 };
    let wave = |length: f64| {
        move |y: [f64; 2]| {
            // u = 0.5 sin(2 pi x / L) along x: the material by fixed points.
            let u = |x: f64| 0.5 * (TAU * x / length).sin();
            [(0..20).fold(y[0], |x, _| y[0] - u(x)), y[1]]
        }
    };
    // Speckles of 2.4 px leave most to the interpolation, a blur as much as noise; both went for displacements once.
    let [sharp, soft] = [0.9, SPOT_PX].map(|width| Spots::new(8, SIDE, width));
    let of_affine = |y| affine.material(y);
    for (what, found) in [
        ("sharp", marked(&sharp, &sharp, of_affine, 1.0)),
        ("soft", marked(&soft, &soft, of_affine, 1.0)),
        ("blurred", marked(&soft, &soft.blurred(0.6), of_affine, 1.0)),
        ("wave of 512 px", marked(&soft, &soft, wave(512.0), 1.0)),
    ] {
        println!("{what}: {found:.2?}");
        // A fiftieth, and a model error below noise: of second differences alone it is a quarter.
        assert!(found[0] <= 0.02 && found[1] < 0.8, "{what}: {found:?}");
    }
    for length in [64.0, 48.0] {
        let [share, ratio] = marked(&soft, &soft, wave(length), 1.0);
        println!("wave of {length} px: {share:.2}, {ratio:.2}");
        // Four and three elements a wave: off by 0.07 and 0.11 px at the nodes where sigma is 0.015.
        assert!(share > 0.95 && ratio > 3.0, "wave of {length} px: {share} marked, model error {ratio} sigma");
    }
}

/// The image convolved with a Gaussian of standard deviation `s` px.
fn blur(image: &Image, s: f64) -> Arc<Image> {
    let reach = (4.0 * s).ceil() as isize;
    let weights: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / s).powi(2)).exp()).collect();
    let total: f64 = weights.iter().sum();
    let pass = |image: &Image, along: [isize; 2]| {
        let inside = |v: usize, d: isize, n: usize| (v as isize + d).clamp(0, n as isize - 1) as usize;
        drawn(image.width(), image.height(), |x, y| {
            let at =
                |k: isize| image.grey(inside(x, k * along[0], image.width()), inside(y, k * along[1], image.height()));
            let sum: f64 = (-reach..=reach).zip(&weights).map(|(k, w)| w * f64::from(at(k))).sum();
            (sum / total) as f32
        })
    };
    pass(&pass(image, [1, 0]), [0, 1])
}

#[test]
fn the_bias_of_a_regularisation_stands_in_the_model_error() {
    let stretch = Affine::new([[0.01, 0.002], [-0.004, -0.006]], SIDE, SIDE);
    let wave = Wave { amplitude: 0.5, length: 128.0 };
    let tikhonov = Regularisation::Tikhonov { cutoff_px: 64.0 };
    let gap = Regularisation::EquilibriumGap { cutoff_px: 64.0, poisson: 0.33 };
    let mut worst = 0.0f64;
    // Where the estimated bias passes through zero the true one does so nearby: a few nodes on that line lie beyond, at
    // most five times sigma and model error together (1.4 and 1.2 %, 0 and 4.5 % of the displacements seen). The
    // equilibrium gap damps this longitudinal wave, of 1.2 effective cut-off lengths, to two thirds.
    for (regularisation, allowed) in [(tikhonov, [0.02, 0.02]), (gap, [0.01, 0.06])] {
        let options = Options { regularisation, ..Options::default() };
        let found = measured(&stretch, options.clone());
        let beyond = share_beyond(&found.measurement, &stretch);
        let errors = node_errors(&found.measurement.mesh, &found.measurement.displacement, &stretch);
        worst = errors.iter().zip(&found.measurement.sigma).fold(worst, |worst, (e, s)| worst.max(e[0].abs() / s[0]));
        assert!(beyond <= allowed[0], "{regularisation:?}, strain: {beyond}");
        let found = measured(&wave, options);
        let beyond = share_beyond(&found.measurement, &wave);
        assert!(beyond <= allowed[1], "{regularisation:?}, wave: {beyond}");
    }
    // By sigma alone the edges of Tikhonov's field are far off: the estimate is needed.
    assert!(worst > 5.0, "{worst}");
}

/// A picture with a square of `side` px without texture around `at`.
fn with_blank(motion: &Translation, at: [usize; 2], side: usize) -> Arc<Image> {
    let [dx, dy] = motion.0.map(|u| u.round() as usize);
    let around = |v: usize, middle: usize, d: usize| (v + side / 2).wrapping_sub(middle + d) < side;
    let image = picture(motion, &float(SIDE, SIDE));
    let blank = changed(&image, |x, y, grey| if around(x, at[0], dx) && around(y, at[1], dy) { 90.0 } else { grey });
    noisy(&blank, 0.5, 7 + dx as u64)
}

#[test]
fn a_few_nodes_without_texture_are_left_out_and_more_are_refused() {
    let shift = Translation([2.0, 1.0]);
    let zones = inside(SIDE, SIDE, 16);
    let [reference, deformed] = [REST, shift].map(|motion| with_blank(&motion, [144, 144], 40));
    let correlator = prepared(&reference, &zones, Options::default());
    let dropped: Vec<usize> = correlator.dropped().iter().map(|fault| fault.node).collect();
    assert!((1..=57).contains(&dropped.len()), "{dropped:?}"); // a fifth of 289
    let field = solved(&correlator, &deformed);
    for node in 0..field.mesh.n_nodes() {
        assert_eq!(field.measured[node], !dropped.contains(&node), "node {node}");
    }
    assert!(share_beyond(&field, &shift) <= 0.01);
    let large = with_blank(&REST, [144, 144], 160);
    let error = refusal(&large, &zones, Options::default());
    let CorrelationError::NoTexture { faults, .. } = &error else { panic!("{error}") };
    assert!(faults.len() > 57 && error.to_string().contains("--drop-textureless"), "{error}");
}

#[test]
fn no_node_is_left_out_on_a_border_that_has_to_be_whole() {
    let zones = inside(SIDE, SIDE, 16);
    let reference = with_blank(&REST, [144, 16], 40);
    assert!(!prepared(&reference, &zones, Options::default()).dropped().is_empty());
    let whole = Options { whole_borders: vec!["all".into()], ..Options::default() };
    let error = refusal(&reference, &zones, whole.clone());
    let CorrelationError::FaceWithoutTexture { zone, faults } = &error else { panic!("{error}") };
    assert!(zone == "all" && faults.iter().all(|fault| fault.at[1] == 16.0), "{error}");
    assert!(error.to_string().contains("the face of a joint"), "{error}");
    // Inside the zone they may.
    assert!(!prepared(&with_blank(&REST, [144, 144], 40), &zones, whole).dropped().is_empty());
    let share = Options { textureless_share: 1.5, ..Options::default() };
    assert!(matches!(refusal(&reference, &zones, share), CorrelationError::Option { .. }));
}
