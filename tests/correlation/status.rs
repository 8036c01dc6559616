//! What counts as measured: a frame, a zone, a node (docs/correlation.md, 2.2, 2.6 and 2.8). The pictures are of a
//! renderer of the tests' own.

use crate::common::scenes::{SPOT_PX, Spots, photographed};
use crate::common::{cold, data, mean, prepared, rms, zone};
use crate::program::{Desk, remarks};
use quadrille::correlate::{Apart, CorrelationError, Options, ReferenceChain, Tracker};
use quadrille::field::{ElementMark, Status, UpdateReference};
use quadrille::imaging::{Image, Pixels, Specimen};
use quadrille::io::images::read_image;
use quadrille::mesh::Zone;
use quadrille::remark::Code;
use std::collections::HashMap;
use std::sync::Arc;

const SIDE: usize = 320;

/// A specimen on the left that moves by `u`, and another body on the right that moves by `beside`, or is covered.
fn two_bodies(u: [f64; 2], beside: Option<[f64; 2]>, seed: u64) -> Arc<Image> {
    let spots = Spots::new(5, SIDE, SPOT_PX);
    photographed(SIDE, 1.5, seed, |y| match (y[0] < 210.0, beside) {
        (true, _) => spots.grey([y[0] - u[0], y[1] - u[1]]),
        (false, Some(v)) if y[0] > 222.0 => spots.grey([y[0] - v[0], y[1] - v[1]]),
        _ => 40.0,
    })
}

fn two_zones() -> Vec<Zone> {
    vec![zone("specimen", [20.0, 20.0, 196.0, 292.0]), zone("label", [240.0, 100.0, 304.0, 228.0])]
}

#[test]
fn a_zone_that_vanishes_costs_no_other_and_is_found_again_when_it_is_back() {
    let correlator = prepared(&two_bodies([0.0; 2], Some([0.0; 2]), 1), &two_zones(), Options::default());
    let mut tracker = Tracker::new(&correlator);
    let mut iterations = 0;
    for number in 1..=10 {
        let u = [0.4 * number as f64, 0.1 * number as f64];
        // It is looked for with every tenth frame.
        let is_there = number == 1 || number == 10;
        let image = two_bodies(u, is_there.then_some([0.3, -0.2]), number as u64 + 1);
        let found = tracker.correlate(number, image).unwrap();
        let (field, mesh) = (&found.measurement, correlator.mesh());
        let status = if is_there { Status::Converged } else { Status::PartlyLost };
        assert_eq!(field.status, status, "frame {number}");
        let of_zones: Vec<Status> = found.zones.iter().map(|zone| zone.status).collect();
        assert_eq!(of_zones[0], Status::Converged, "frame {number}");
        assert_eq!(of_zones[1] == Status::Converged, is_there, "frame {number}");
        let errors = mesh.zone_nodes(0).filter(|&node| field.measured[node]).map(|node| {
            let found = field.displacement[node];
            [found[0] - u[0], found[1] - u[1]]
        });
        let errors: Vec<[f64; 2]> = errors.collect();
        assert_eq!(errors.len(), mesh.zone_nodes(0).len(), "frame {number}");
        // 187 nodes of sigma 0.025 px: five standard uncertainties of their mean.
        assert!(mean(&errors).iter().all(|error| error.abs() < 0.01), "frame {number}: {:?}", mean(&errors));
        assert!(is_there || mesh.zone_nodes(1).all(|node| !field.measured[node]), "frame {number}");
        iterations += if number > 2 && !is_there { found.iterations } else { 0 };
    }
    // What is lost already is not looked for in every frame: those between begin where the one before ended.
    assert!(iterations <= 7 * 8, "{iterations} iterations of 7 frames");
}

#[test]
fn a_body_before_a_still_ground_of_the_same_zone_is_found_with_large_steps_and_with_small_ones() {
    let (body, ground) = (Spots::new(5, SIDE, SPOT_PX), Spots::new(77, SIDE, SPOT_PX));
    const PLACE: [f64; 4] = [90.0, 70.0, 220.0, 230.0];
    let image = |u: [f64; 2], seed: u64| {
        photographed(SIDE, 1.5, seed, |y| {
            let x = [y[0] - u[0], y[1] - u[1]];
            let is_body = (PLACE[0]..PLACE[2]).contains(&x[0]) && (PLACE[1]..PLACE[3]).contains(&x[1]);
            if is_body { body.grey(x) } else { ground.grey(y) }
        })
    };
    let zones = vec![zone("all", [20.0, 20.0, 308.0, 308.0])];
    let correlator = prepared(&image([0.0; 2], 1), &zones, Options::default());
    for (step, frames) in [([15.0, 8.0], 2), ([0.8, 0.4], 16)] {
        let mut tracker = Tracker::new(&correlator);
        let mut iterations = 0;
        for number in 1..=frames {
            let u = step.map(|step| step * number as f64);
            let found = tracker.correlate(number, image(u, number as u64 + 1)).unwrap();
            iterations += found.iterations;
            let field = &found.measurement;
            assert_eq!(field.status, Status::Converged, "{step:?}, frame {number}");
            // Of nodes two elements from the edge of the body all elements, and those around them, are of one body, and
            // not of what the body covers now.
            let errors = |is_in: bool, v: [f64; 2]| -> Vec<[f64; 2]> {
                let nodes = correlator.mesh().nodes().iter().enumerate().filter(|(_, x)| {
                    let beside = |c: usize| (PLACE[c] - x[c]).max(x[c] - PLACE[c + 2]);
                    let off = beside(0).max(beside(1));
                    if is_in { off < -34.0 } else { off > 34.0 + u[0] }
                });
                let nodes = nodes.filter(|(node, _)| field.measured[*node]);
                nodes
                    .map(|(node, _)| [field.displacement[node][0] - v[0], field.displacement[node][1] - v[1]])
                    .collect()
            };
            for (what, errors) in [("body", errors(true, u)), ("ground", errors(false, [0.0; 2]))] {
                assert!(
                    errors.len() > 15 && rms(&errors) < 0.05,
                    "{step:?}, {number}, {what}: {} {}",
                    errors.len(),
                    rms(&errors)
                );
            }
        }
        println!("steps of {step:?} px: {} iterations a frame", iterations / frames);
        assert!(iterations <= 20 * frames, "{step:?}: {iterations}");
    }
}

#[test]
fn what_stays_still_is_told_from_the_body_before_it_and_from_the_clamped_end_of_a_specimen() {
    let (body, ground) = (Spots::new(5, SIDE, SPOT_PX), Spots::new(77, SIDE, SPOT_PX));
    const PLACE: [f64; 4] = [90.0, 70.0, 220.0, 230.0];
    let before_ground = |u: f64, seed: u64| {
        photographed(SIDE, 1.5, seed, |y| {
            let x = [y[0] - u, y[1]];
            let is_body = (PLACE[0]..PLACE[2]).contains(&x[0]) && (PLACE[1]..PLACE[3]).contains(&x[1]);
            if is_body { body.grey(x) } else { ground.grey(y) }
        })
    };
    // Still up to the middle, then stretched by 3 %.
    let clamped = |stretch: f64, seed: u64| {
        photographed(SIDE, 1.5, seed, |y| body.grey([y[0], y[1] - (y[1] - 160.0).max(0.0) * stretch / (1.0 + stretch)]))
    };
    let zones = vec![zone("all", [20.0, 20.0, 308.0, 308.0])];
    let find = |pair: [Arc<Image>; 2]| {
        let [reference, deformed] = pair;
        let correlator = prepared(&reference, &zones, Options::default());
        let field = cold(&correlator, &deformed).measurement;
        (Apart::find(&field, [&reference, &deformed]), correlator.mesh().clone())
    };
    assert_eq!(find([clamped(0.0, 1), clamped(0.03, 2)]).0, Apart::One);
    assert_eq!(find([before_ground(0.0, 1), before_ground(1.2, 2)]).0, Apart::One, "too close to be told apart");
    for u in [2.4, 12.0] {
        let (found, mesh) = find([before_ground(0.0, 1), before_ground(u, 2)]);
        let Apart::Bodies(bodies) = found else { panic!("a body and its ground: {found:?}") };
        assert_eq!((bodies.moving, bodies.has_still), (1, true));
        let still: Vec<bool> = (0..mesh.n_elements()).map(|element| bodies.is_of(element, 1)).collect();
        let between: Vec<bool> = bodies.of.iter().map(Option::is_none).collect();
        for element in 0..mesh.n_elements() {
            let corners = mesh.corners(element);
            // Share of it over which the body lies or has gone, and over which it lies in both images.
            let along =
                |low: f64, high: f64, c: usize| (corners[2][c].min(high) - corners[0][c].max(low)).max(0.0) / 16.0;
            let over = |low: f64, high: f64| along(low, high, 0) * along(PLACE[1], PLACE[3], 1);
            let (swept, inside) = (over(PLACE[0], PLACE[2] + u), over(PLACE[0], PLACE[2]));
            assert!(inside < 1.0 || !still[element], "{u}: {corners:?} of the body");
            assert!(swept > 0.0 || still[element] || between[element], "{u}: {corners:?} of the ground");
            assert!(swept < 0.3 || !still[element], "{u}: {corners:?} is hardly of the ground");
        }
        let n = |list: &[bool]| list.iter().filter(|is| **is).count();
        // 80 elements lie inside the body, 190 outside; 52 along its edge belong to neither.
        assert!(n(&still) > 150 && n(&between) < 80, "{u}: {} still, {} between", n(&still), n(&between));
    }
}

#[test]
fn two_bodies_that_move_apart_are_told_and_a_stripe_of_glare_makes_no_two_of_one() {
    let spots = Spots::new(5, SIDE, SPOT_PX);
    // The upper half is moved by `u`, the lower one by `v`; between them the ground is bare. One of them is stretched.
    let halves = |u: [f64; 2], v: [f64; 2], seed: u64| {
        photographed(SIDE, 1.5, seed, |y| {
            let (above, below) = ([y[0] - u[0], y[1] - u[1]], [y[0] - v[0] - 0.01 * (y[0] - 160.0), y[1] - v[1]]);
            match (above[1] < 150.0, below[1] >= 150.0) {
                (true, _) => spots.grey(above),
                (_, true) => spots.grey(below),
                _ => 40.0,
            }
        })
    };
    let rest = photographed(SIDE, 1.5, 1, |y| spots.grey(y));
    let correlator = prepared(&rest, &[zone("all", [20.0, 20.0, 308.0, 308.0])], Options::default());
    let find = |deformed: &Arc<Image>| Apart::find(&cold(&correlator, deformed).measurement, [&rest, deformed]);
    for (u, v) in [([3.0, -2.0], [-1.0, 3.0]), ([12.0, 0.5], [-9.0, 2.0])] {
        let found = find(&halves(u, v, 2));
        let Apart::Bodies(bodies) = found else { panic!("two bodies: {found:?}") };
        assert_eq!((bodies.moving, bodies.has_still), (2, false));
        let mesh = correlator.mesh();
        for (element, of) in bodies.of.iter().enumerate() {
            let corners = mesh.corners(element);
            let (is_above, is_below) = (corners[2][1] <= 150.0, corners[0][1] >= 150.0);
            assert!(
                of.is_none() || (*of == Some(0) && !is_below) || (*of == Some(1) && !is_above),
                "{corners:?}: {of:?}"
            );
        }
        // 324 elements, 18 of them on the border, and as many lose their other side.
        assert!(bodies.of.iter().filter(|of| of.is_some()).count() > 280, "{bodies:?}");
    }
    // Both move, and not yet apart from each other; one body that moves behind a white stripe.
    assert_eq!(find(&halves([4.0, 0.0], [4.0, 1.0], 3)), Apart::NotYet);
    let glare = photographed(SIDE, 1.5, 4, |y| {
        let x = [y[0] - 3.0, y[1] - 1.0 - 0.01 * y[1]];
        if (140.0..180.0).contains(&y[1]) { 250.0 } else { spots.grey(x) }
    });
    let found = find(&glare);
    assert!(!matches!(found, Apart::Bodies(_)), "{found:?}");
}

#[test]
fn a_frame_without_any_zone_is_diverged_and_one_that_has_left_says_so() {
    let correlator = prepared(&two_bodies([0.0; 2], Some([0.0; 2]), 1), &two_zones(), Options::default());
    let other = Spots::new(99, SIDE, SPOT_PX);
    let found = cold(&correlator, &photographed(SIDE, 1.5, 7, |y| other.grey(y)));
    assert_eq!(found.measurement.status, Status::Diverged);
    // The label moves out of the image.
    let left = cold(&correlator, &two_bodies([0.3, 0.0], Some([75.0, 0.0]), 9));
    assert_eq!(left.measurement.status, Status::PartlyLost);
    assert!(left.zones[0].status == Status::Converged && left.zones[1].status != Status::Converged);
}

#[test]
fn a_frame_that_has_lost_more_than_a_third_of_its_nodes_is_not_converged() {
    let spots = Spots::new(5, SIDE, SPOT_PX);
    let other = Spots::new(77, SIDE, SPOT_PX);
    let whole = |u: f64, covered: f64, seed: u64| {
        photographed(SIDE, 1.5, seed, |y| match y[1] < covered {
            true => other.grey(y),
            false => spots.grey([y[0] - u, y[1]]),
        })
    };
    let zones = vec![zone("plate", [20.0, 20.0, 292.0, 292.0])];
    let correlator = prepared(&whole(0.0, 0.0, 1), &zones, Options::default());
    for (covered, status) in [(70.0, Status::Converged), (160.0, Status::PartlyLost)] {
        let found = cold(&correlator, &whole(0.4, covered, 2));
        let field = &found.measurement;
        assert_eq!(field.status, status, "{covered} px are covered");
        let below = |node: &usize| correlator.mesh().nodes()[*node][1] > covered + 34.0;
        let errors: Vec<[f64; 2]> = (0..field.displacement.len())
            .filter(below)
            .map(|node| [field.displacement[node][0] - 0.4, field.displacement[node][1]])
            .collect();
        assert!(mean(&errors).iter().all(|error| error.abs() < 0.01), "{covered}: {:?}", mean(&errors));
    }
}

#[test]
fn large_speckles_are_measured_although_noise_hides_the_gradient_of_each_pixel() {
    // Speckles of some 25 and 45 px with noise 2, on elements that hold two of them.
    for (scale, most) in [(5.0, 0.1), (9.0, 0.25)] {
        let spots = Spots::new(4, SIDE, SPOT_PX);
        let image = |u: [f64; 2], seed: u64| {
            photographed(SIDE, 2.0, seed, |y| spots.grey([(y[0] - u[0]) / scale, (y[1] - u[1]) / scale]))
        };
        let (reference, u) = (image([0.0; 2], 1), [4.2, 2.1]);
        let specimen = Specimen::find(&reference, 64, 16);
        assert!(specimen.share(&reference) > 0.5, "{scale}: {:?}", specimen.left_out);
        let zones = vec![zone("all", [20.0, 20.0, 276.0, 276.0])];
        let correlator = prepared(&reference, &zones, Options { element_size: 64, ..Options::default() });
        let found = cold(&correlator, &image(u, 2));
        let field = &found.measurement;
        assert_eq!(field.status, Status::Converged, "{scale}");
        assert!(field.measured.iter().all(|measured| *measured), "{scale}");
        for (node, found) in field.displacement.iter().enumerate() {
            for c in 0..2 {
                let (error, sigma) = (found[c] - u[c], field.sigma[node][c]);
                assert!(error.abs() < 4.5 * sigma && sigma < 0.6, "{scale}, node {node}: {error}, {sigma}");
            }
        }
        let errors: Vec<[f64; 2]> = field.displacement.iter().map(|v| [v[0] - u[0], v[1] - u[1]]).collect();
        let (mean, n) = (mean(&errors), errors.len());
        println!("speckles of {scale} times 5 px: mean error {mean:?} px over {n} nodes, rms {:.3} px", rms(&errors));
        // The standard uncertainty inside would be 0.04 and 0.08 px; twice that in the corners.
        assert!(mean.iter().all(|error| error.abs() < 0.05) && rms(&errors) < most, "{scale}: {mean:?}");
    }
}

#[test]
fn nodes_less_certain_than_asked_for_are_left_out_and_the_elements_that_would_do_are_named() {
    let spots = Spots::new(4, SIDE, SPOT_PX);
    let reference = photographed(SIDE, 1.5, 1, |y| spots.grey(y));
    let zones = vec![zone("all", [20.0, 20.0, 276.0, 276.0])];
    let options = |sigma_most_px: f64| Options { sigma_most_px, drop_textureless: true, ..Options::default() };
    // Their standard uncertainties are 0.03 to 0.08 px with elements of 16 px.
    assert!(prepared(&reference, &zones, options(0.3)).dropped().is_empty());
    match crate::common::refusal(&reference, &zones, options(0.02)) {
        CorrelationError::Textureless { larger: Some(size), .. } => {
            let larger = Options { element_size: size, ..options(0.02) };
            let prepared = prepared(&reference, &zones, larger);
            assert!(2 * prepared.dropped().len() < prepared.mesh().n_nodes(), "{size} px");
        }
        error => panic!("{error}"),
    }
}

#[test]
fn a_necking_bar_is_followed_to_its_last_frame_by_renewed_references() {
    let Some(folder) = data::folder("sundic-necking") else { return };
    let read = |k: usize| Arc::new(read_image(&folder.join(format!("img_{k}.tif")), 0).unwrap().image);
    let images: Vec<Arc<Image>> = (0..5).map(read).collect();
    // Displacements along x at y = 300 by square subsets of 33 px (PROVENANCE.md), good to some 0.3 px.
    let seen = [(300.0, -41.3), (850.0, -32.4), (1350.0, -7.2)];
    for element_size in [32, 48] {
        let options = Options { element_size, drop_textureless: true, ..Options::default() };
        let bar = vec![zone("bar", [24.0, 72.0, 1490.0, 536.0])];
        let correlator = Arc::new(prepared(&images[0], &bar, options));
        let mut chain = ReferenceChain::new(correlator.clone(), UpdateReference::Residual);
        let mut last = None;
        for number in 1..images.len() {
            last = Some(chain.correlate(number, images[number].clone()).unwrap());
        }
        let field = last.unwrap().measurement;
        assert_eq!(field.status, Status::Converged, "{element_size} px");
        let unmatched = field.marks.as_ref().unwrap().iter().filter(|mark| **mark == ElementMark::NoMatch).count();
        assert!(unmatched * 10 < field.mesh.n_elements(), "{element_size} px: {unmatched}");
        for (x, u) in seen {
            let (element, xi, eta) = field.mesh.nearest(0, x, 300.0);
            let nodes = field.mesh.elements()[element].map(|node| node as usize);
            assert!(nodes.iter().all(|&node| field.measured[node]), "{element_size} px at {x}");
            let psi = quadrille::mesh::shape_functions(xi, eta);
            let found: f64 = (0..4).map(|k| psi[k] * field.displacement[nodes[k]][0]).sum();
            assert!((found - u).abs() < 0.5, "{element_size} px at {x}: {found}");
        }
    }
}

#[test]
fn a_pattern_that_stays_with_the_camera_is_named_with_its_size_and_with_what_it_does() {
    let spots = Spots::new(8, SIDE, SPOT_PX);
    let zones = vec![zone("all", [24.0, 24.0, 280.0, 280.0])];
    for (size, moved) in [(2.0, [6.3, 0.2]), (4.0, [-4.4, 5.7]), (2.0, [0.4, 7.5]), (0.0, [6.3, 0.2])] {
        let camera = photographed(SIDE, size, 99, |_| 128.0);
        let fixed = |k: usize| f64::from(camera.grey(k % SIDE, k / SIDE)) - 128.0;
        let image = |u: [f64; 2], seed: u64| {
            let seen = photographed(SIDE, 1.0, seed, |y| 0.5 * spots.grey([y[0] - u[0], y[1] - u[1]]) + 60.0);
            let grey = |k: usize| (f64::from(seen.grey(k % SIDE, k / SIDE)) + fixed(k)).clamp(0.0, 255.0) as u8;
            Arc::new(Image::new(SIDE, SIDE, Pixels::U8((0..SIDE * SIDE).map(grey).collect())).unwrap())
        };
        let correlator = prepared(&image([0.0; 2], 1), &zones, Options::default());
        let pattern = |u: [f64; 2]| {
            let found = cold(&correlator, &image(u, 2));
            let errors = found.measurement.displacement.iter().map(|v| [v[0] - u[0], v[1] - u[1]]);
            (found.noise_colour.unwrap().pattern, mean(&errors.collect::<Vec<_>>()))
        };
        let (shown, _) = pattern(moved);
        if size == 0.0 {
            assert_eq!(shown, None);
            continue;
        }
        let shown = shown.unwrap();
        assert!((shown.grey - size).abs() < 0.3 * size, "{size}: {shown:?}");
        // Where nothing has moved by pixels it does not show, and does its harm.
        let (hidden, error) = pattern([0.2, 0.2]);
        assert_eq!(hidden, None);
        let drawn = -0.5 * (error[0] + error[1]) / 0.2;
        assert!((0.5..2.0).contains(&(shown.share / drawn)), "{size}: {} for {drawn}", shown.share);
    }
}

#[test]
fn a_body_that_leaves_a_black_ground_is_no_torn_image_and_a_stated_noise_is_named_where_it_hides_the_texture() {
    let desk = Desk::new();
    let spots = Spots::new(3, SIDE, SPOT_PX);
    for k in 0..3 {
        let u = 20.0 * k as f64;
        let on_body = |y: [f64; 2]| (40.0..200.0).contains(&(y[0] - u)) && (60.0..240.0).contains(&y[1]);
        let image = photographed(SIDE, 0.0, 1 + k, |y| if on_body(y) { spots.grey([y[0] - u, y[1]]) } else { 0.0 });
        desk.image(&format!("img_{k}.png"), &image);
    }
    let ran = desk.correlate("--output out img_0.png img_1.png img_2.png").fine();
    assert!(desk.remarks("out", Code::ImageIncomplete).is_empty(), "{ran}");
    let ran = desk.correlate("--output two --noise 60 img_0.png img_1.png");
    assert!(ran.code == Some(2) && ran.stderr.contains("the noise is stated as 60.00 grey levels"), "{ran}");
}

/// Position, displacement, its standard uncertainty, and mark.
type Node = ([f64; 2], [f64; 2], [f64; 2], String);

/// The measured nodes of a frame.
fn nodes(desk: &Desk, number: usize) -> Vec<Node> {
    let text = desk.read(&format!("out/csv/{number:06}.csv"));
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let rows = reader.deserialize::<HashMap<String, String>>().map(|row| {
        let row = row.unwrap();
        let pair = |names: [&str; 2]| names.map(|name| row[name].parse().unwrap());
        (pair(["x_px", "y_px"]), pair(["ux_px", "uy_px"]), pair(["sigma_ux_px", "sigma_uy_px"]), row["mark"].clone())
    });
    rows.collect()
}

#[test]
fn the_bar_of_a_microscope_below_the_picture_is_left_out_and_the_specimen_is_right() {
    let desk = Desk::new();
    let spots = Spots::new(8, SIDE, SPOT_PX);
    // Half an element may lie on the bar; what lies on its text stays still, and is marked.
    const BAR: f64 = 272.0;
    const TEXT: f64 = 294.0;
    for (k, u) in [[0.0, 0.0], [1.3, -0.6], [12.4, 3.1]].into_iter().enumerate() {
        let image = photographed(SIDE, 3.0, 1 + k as u64, |y| {
            // Text, a clock that goes on, and a line for the scale.
            let is_text = (TEXT..306.0).contains(&y[1]) && (y[0] as usize / 6).is_multiple_of(2) && y[0] < 160.0;
            let is_clock =
                (TEXT..306.0).contains(&y[1]) && (180.0 + 9.0 * k as f64..200.0 + 9.0 * k as f64).contains(&y[0]);
            let is_line = (310.0..314.0).contains(&y[1]) && (200.0..300.0).contains(&y[0]);
            match y[1] < BAR {
                true => spots.grey([y[0] - u[0], y[1] - u[1]]),
                false if is_text || is_clock || is_line => 250.0,
                false => 8.0,
            }
        });
        desk.image(&format!("sem_{k}.png"), &image);
    }
    desk.correlate("--output out sem_0.png sem_1.png sem_2.png").fine();
    for (number, u) in [(1, [1.3, -0.6]), (2, [12.4, 3.1])] {
        let mut nodes = nodes(&desk, number);
        nodes.retain(|(.., mark)| mark == "none");
        let z = nodes.iter().map(|(_, found, sigma, _)| [0, 1].map(|c| (found[c] - u[c]) / sigma[c]));
        let z = rms(&z.collect::<Vec<_>>()) / 2f64.sqrt();
        assert!(nodes.len() > 100 && nodes.iter().all(|(at, ..)| at[1] < TEXT), "frame {number}: {}", nodes.len());
        // 300 nodes: a twentieth by chance.
        assert!(z < 1.2, "frame {number}: {z} standard uncertainties");
    }
}

#[test]
fn a_disc_that_turns_before_a_still_plate_gives_no_unmarked_node_that_is_wrong() {
    let desk = Desk::new();
    let (disc, plate) = (Spots::new(21, SIDE, SPOT_PX), Spots::new(22, SIDE, SPOT_PX));
    const CENTRE: [f64; 2] = [120.0, 110.0];
    const SIDE: usize = 240;
    let turned = |[x, y]: [f64; 2], degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let [x, y] = [x - CENTRE[0], y - CENTRE[1]];
        [CENTRE[0] + cos * x - sin * y, CENTRE[1] + sin * x + cos * y]
    };
    for k in 0..3 {
        let image = photographed(SIDE, 2.0, 1 + k, |y| {
            let is_disc = (y[0] - CENTRE[0]).hypot(y[1] - CENTRE[1]) < 80.0;
            if is_disc { disc.grey(turned(y, -17.0 * k as f64)) } else { plate.grey(y) }
        });
        desk.image(&format!("img_{k}.png"), &image);
    }
    desk.correlate("--output out img_0.png img_1.png img_2.png");
    for number in 1..=2 {
        let nodes = nodes(&desk, number);
        let unmarked = nodes.iter().filter(|(.., mark)| mark == "none");
        let mut n_on_disc = 0;
        for &(at, [u, v], sigma, _) in unmarked {
            let to = turned(at, 17.0 * number as f64);
            let off = (u - (to[0] - at[0])).hypot(v - (to[1] - at[1]));
            let most = (5.0 * sigma[0].hypot(sigma[1])).max(0.1);
            n_on_disc += usize::from(off < most);
            // It may as well be one of the plate.
            assert!(
                off < most || u.hypot(v) < most,
                "frame {number}: {at:?} moved by ({u}, {v}) +- {sigma:?}, not to {to:?}"
            );
        }
        assert!(n_on_disc >= 5, "frame {number}: {n_on_disc} nodes of the disc");
    }
}

#[test]
fn a_lost_zone_is_in_the_exit_status_the_closing_table_and_the_summary() {
    let desk = Desk::new();
    for (k, beside) in [(0, Some([0.0; 2])), (1, Some([0.3, -0.2])), (2, None)] {
        desk.image(&format!("img_{k}.png"), &two_bodies([0.4 * k as f64, 0.0], beside, k + 1));
    }
    // Rectangles of 11 x 17 elements but for round-off, and of 4 x 8 with a strip of 5 px at the right.
    let zones = "--roi 20,20,195.9999999,292 --roi 240,100,309,228";
    let ran = desk.correlate(&format!("--output out {zones} img_0.png img_1.png img_2.png"));
    assert_eq!(ran.code, Some(1), "{ran}");
    let row = ran.stderr.lines().find(|line| line.contains("partly lost") && !line.contains("img")).unwrap();
    // 216 of 216 + 45 nodes.
    assert_eq!(row.split_whitespace().rev().nth(1), Some("82.8"), "{ran}");
    let summary = desk.json("out/summary.json");
    assert_eq!(summary["n_elements"], 11 * 17 + 4 * 8, "{ran}");
    assert_eq!(summary["counts"], serde_json::json!({ "converged": 1, "partly_lost": 1 }));
    let zones = summary["frames"][1]["zones"].as_array().unwrap();
    assert_eq!([zones[0].get("status"), zones[1].get("status")], [None, Some(&"diverged".into())]);
    assert_eq!(remarks(&summary["frames"][1], Code::ZoneLost).len(), 1, "{summary}");
    let strips = desk.remarks("out", Code::ZoneLeftOver);
    assert!(strips.len() == 1 && strips[0].text.contains("zone2: 5 px at the right, 0 px below"), "{strips:?}");
}
