//! Regions that are no rectangles: polygons, masks, guards, meshes of any quadrilaterals and triangles.

use crate::common;
use common::*;
use quadrille::correlate::{CorrelationError, Options};
use quadrille::field::{Brightness, Measurement, NoiseCorrelation, Status};
use quadrille::imaging::{Image, Interpolation};
use quadrille::mesh::{
    ELEMENT_SHARE, Guard, Mask, Mesh, MeshError, PixelMesh, Roi, Zone, ZoneElements, local_coordinates,
};
use quadrille::synth::{Affine, Motion, Peel, RenderOptions, Sinusoids, exact_at, render};
use quadrille::units::Px;
use std::sync::Arc;

const SIZE: [usize; 2] = [260, 200];
const INSIDE: [f64; 4] = [18.0, 20.0, 242.0, 180.0];

fn sized(element_size: usize) -> Options {
    Options { element_size, ..Options::default() }
}

fn rectangle_corners([x0, y0, x1, y1]: [f64; 4]) -> Vec<[f64; 2]> {
    vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
}

fn mask(inside: impl Fn(f64, f64) -> bool) -> Arc<Mask> {
    let [width, height] = SIZE;
    let bits = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| inside(x as f64, y as f64));
    Arc::new(Mask::new(width, height, bits.collect()).unwrap())
}

fn largest_difference(a: &Measurement<Px>, b: &Measurement<Px>) -> f64 {
    assert_eq!(a.displacement.len(), b.displacement.len());
    let pairs = a.displacement.iter().flatten().zip(b.displacement.iter().flatten());
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn a_region_said_in_another_way_gives_the_same_bits() {
    let motion = Affine::new([[0.004, -0.003], [0.002, -0.005]], SIZE[0], SIZE[1]);
    let (reference, deformed) =
        (picture(&REST, &eight_bit(SIZE[0], SIZE[1])), picture(&motion, &eight_bit(SIZE[0], SIZE[1])));
    let [x0, y0, x1, y1] = INSIDE;
    let rectangle = solved(&prepared(&reference, &one(INSIDE), Options::default()), &deformed);
    let polygon = Zone { name: "all".into(), polygon: rectangle_corners(INSIDE), ..Zone::default() };
    let masked = Zone {
        name: "all".into(),
        mask: Some(mask(|x, y| (x0..x1).contains(&x) && (y0..y1).contains(&y))),
        ..Zone::default()
    };
    for zone in [polygon, masked] {
        let found = solved(&prepared(&reference, &[zone], Options::default()), &deformed);
        assert_eq!(found.displacement, rectangle.displacement);
        assert_eq!(found.sigma, rectangle.sigma);
    }
}

#[test]
fn a_grid_read_as_a_free_mesh_gives_the_field_of_the_grid() {
    let motion = Sinusoids { amplitude: 0.8, wavelength: 96.0 };
    let (reference, deformed) =
        (picture(&REST, &eight_bit(SIZE[0], SIZE[1])), picture(&motion, &eight_bit(SIZE[0], SIZE[1])));
    for brightness in [Brightness::Zone, Brightness::Element, Brightness::Off] {
        let noise_correlation = NoiseCorrelation::Off; // it is looked for in other blocks
        let options =
            Options { brightness, tolerance_px: 1e-6, tolerance_by_sigma: 0.0, noise_correlation, ..sized(16) };
        let grid = solved(&prepared(&reference, &one(INSIDE), options.clone()), &deformed);
        let free = solved(&prepared(&reference, &[free_zone(free_mesh(INSIDE, 16.0, 0.0, false))], options), &deformed);
        // Other kernels for the same sums in f32, and another search of the start: both are iterated to 1e-6 px.
        let difference = largest_difference(&grid, &free);
        assert!(difference < 5e-6, "{brightness}: {difference} px");
        for (a, b) in grid.sigma.iter().flatten().zip(free.sigma.iter().flatten()) {
            assert!((a - b).abs() < 0.02 * a, "sigma {a} and {b}: probing is good to 1 %");
        }
    }
}

#[test]
fn every_pixel_of_a_distorted_mesh_belongs_to_one_element_and_knows_its_place() {
    for halved in [false, true] {
        let zone = free_zone(free_mesh(INSIDE, 16.0, 3.5, halved));
        let laid = PixelMesh::on_zones(&[zone], 16, ELEMENT_SHARE, SIZE).unwrap();
        let mut owners = vec![0; SIZE[0] * SIZE[1]];
        for (element, pixels) in laid.pixels.elements().iter().enumerate() {
            laid.pixels.for_each(pixels, |x, y, xi, eta| {
                owners[y as usize * SIZE[0] + x as usize] += 1;
                let place = (element, f64::from(xi), f64::from(eta));
                let back = laid.mesh.interpolate(laid.mesh.nodes(), place);
                // Local coordinates in f32: 6e-8 of an element of 23 px at most.
                assert!((back[0] - f64::from(x)).abs() < 1e-5 && (back[1] - f64::from(y)).abs() < 1e-5, "{back:?}");
            });
        }
        let [x0, y0, x1, y1] = INSIDE.map(|v| v as usize);
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                let inside = (x0..x1).contains(&x) && (y0..y1).contains(&y);
                assert_eq!(owners[y * SIZE[0] + x], u32::from(inside), "pixel ({x}, {y})");
            }
        }
    }
}

#[test]
fn affine_fields_are_recovered_on_distorted_quadrilaterals_and_triangles() {
    let motion = Affine::new([[0.006, -0.004], [0.003, -0.005]], SIZE[0], SIZE[1]);
    let (reference, deformed) = (picture(&REST, &float(SIZE[0], SIZE[1])), picture(&motion, &float(SIZE[0], SIZE[1])));
    for (halved, size) in [(false, 16.0), (true, 32.0)] {
        for brightness in [Brightness::Zone, Brightness::Element] {
            let options = Options { interpolation: Interpolation::Quintic, brightness, ..sized(16) };
            let zone = free_zone(free_mesh(INSIDE, size, 0.2 * size, halved));
            let correlator = prepared(&reference, &[zone], options);
            let found = solved(&correlator, &deformed);
            let error = rms(&node_errors(correlator.mesh(), &found.displacement, &motion));
            // Either shape holds an affine field exactly; what is left is the interpolation of the quintic
            // spline (3e-4 px on elements of this size, see tests/correlation/accuracy.rs) and the iteration, 1e-4 px.
            assert!(error < 6e-4, "halved {halved}, {brightness}: {error} px");
        }
    }
}

#[test]
fn a_distorted_mesh_follows_a_field_as_well_as_a_grid() {
    let motion = Sinusoids { amplitude: 0.8, wavelength: 96.0 };
    let (reference, deformed) = (picture(&REST, &float(SIZE[0], SIZE[1])), picture(&motion, &float(SIZE[0], SIZE[1])));
    let error = |zones: &[Zone]| {
        let correlator = prepared(&reference, zones, sized(16));
        let found = solved(&correlator, &deformed);
        let mesh = correlator.mesh();
        let points: Vec<[f64; 2]> =
            (30..170).step_by(7).flat_map(|y| (30..230).step_by(7).map(move |x| [x as f64, y as f64])).collect();
        let exact = exact_at(&motion, &points);
        let errors: Vec<[f64; 2]> = points
            .iter()
            .zip(exact)
            .map(|(p, u)| {
                let found = mesh.interpolate(&found.displacement, mesh.find(p[0], p[1]).expect("inside"));
                [found[0] - u[0], found[1] - u[1]]
            })
            .collect();
        rms(&errors)
    };
    let (grid, shaken) = (error(&one(INSIDE)), error(&[free_zone(free_mesh(INSIDE, 16.0, 2.5, false))]));
    // Elements stretched by up to a third have an interpolation error (h^2) larger by up to three quarters.
    assert!(shaken < 1.75 * grid, "grid {grid} px, distorted {shaken} px");
}

#[test]
fn what_moves_behind_a_mask_does_not_touch_the_field() {
    let reference = picture(&REST, &eight_bit(SIZE[0], SIZE[1]));
    let plate = picture(&quadrille::synth::Translation([0.6, 0.4]), &eight_bit(SIZE[0], SIZE[1]));
    let disc = picture(&quadrille::synth::Translation([9.0, -7.0]), &eight_bit(SIZE[0], SIZE[1]));
    // Both pictures together: a disc about (130, 100) that moves by (9, -7) px over a plate that does not.
    let deformed = drawn(SIZE[0], SIZE[1], |x, y| {
        let inside = (x as f64 - 139.0).hypot(y as f64 - 93.0) < 40.0;
        if inside { disc.grey(x, y) } else { plate.grey(x, y) }
    });
    let far = |x: f64, y: f64| (x - 130.0).hypot(y - 100.0) > 57.0; // where the disc goes, and the reach of the spline
    let zone = Zone {
        name: "plate".into(),
        mask: Some(mask(far)),
        roi: Some(Roi { x0: 18.0, y0: 20.0, x1: 242.0, y1: 180.0 }),
        ..Zone::default()
    };
    let correlator = prepared(&reference, std::slice::from_ref(&zone), sized(12));
    let found = solved(&correlator, &deformed);
    assert!(correlator.mesh().n_elements() < 18 * 13 - 40, "{} elements", correlator.mesh().n_elements());
    // Rounding to 8 bit is the only noise: six of its standard uncertainties (500 numbers), and the bias of the
    // spline.
    let plate_field = quadrille::synth::Translation([0.6, 0.4]);
    assert!(worst_by_sigma(&found, &plate_field, 2e-3) < 6.0);
    // The same with a polygon and a polygonal hole.
    let hole: Vec<[f64; 2]> = (0..40)
        .map(|k| (f64::from(k) / 40.0 * std::f64::consts::TAU).sin_cos())
        .map(|(s, c)| [130.0 + 57.5 * c, 100.0 + 57.5 * s])
        .collect();
    let zone = Zone { mask: None, roi: None, polygon: rectangle_corners(INSIDE), exclude: vec![hole], ..zone };
    let found = solved(&prepared(&reference, &[zone], sized(12)), &deformed);
    assert!(worst_by_sigma(&found, &plate_field, 2e-3) < 6.0);
}

/// Largest mean over eight pictures of the error of the normal displacement on the faces of a peeling joint.
fn face_bias(guard: Guard) -> f64 {
    let (width, height) = (320, 191);
    let motion = Peel { opening_px: 2.6, slide_px: 0.9, ..Peel::new(width, height) };
    // Element rows that end exactly on the dark band.
    let (top, bottom) = (motion.upper_edge().floor(), motion.lower_edge().ceil());
    let zones = [
        Zone { guard: guard.clone(), ..zone("upper", [16.0, top - 63.0, 304.0, top + 1.0]) },
        Zone { guard, ..zone("lower", [16.0, bottom, 304.0, bottom + 64.0]) },
    ];
    let n_pictures = 8;
    let mut mean: Vec<f64> = Vec::new();
    for seed in 0..n_pictures {
        let texture = quadrille::synth::Texture::new(seed, SPECKLE_PX).unwrap();
        let options = RenderOptions::new(width, height);
        let shot = |motion: &Peel| -> Arc<Image> { Arc::new(render(&texture, motion, &options).unwrap()) };
        let correlator = prepared(&shot(&motion.at(0.0)), &zones, Options::default());
        let result = cold(&correlator, &shot(&motion));
        assert_eq!(result.measurement.status, Status::Converged);
        let mesh = correlator.mesh();
        let exact = |node: usize| {
            let body = mesh.node_zone()[node] as usize;
            motion.body_displacement(body, mesh.nodes()[node])[1]
        };
        let face = |node: &usize| {
            let y = mesh.nodes()[*node][1];
            y == top + 1.0 || y == bottom
        };
        let errors: Vec<f64> = (0..mesh.n_nodes())
            .filter(face)
            .map(|node| result.measurement.displacement[node][1] - exact(node))
            .collect();
        mean.resize(errors.len(), 0.0);
        mean.iter_mut().zip(errors).for_each(|(mean, error)| *mean += error / n_pictures as f64);
    }
    // Upper and lower face, each over its nodes: the bias has opposite signs.
    let half = mean.len() / 2;
    [&mean[..half], &mean[half..]]
        .map(|face| (face.iter().sum::<f64>() / half as f64).abs())
        .into_iter()
        .fold(0.0, f64::max)
}

#[test]
fn a_guard_of_three_pixels_takes_the_bias_from_faces_beside_a_dark_band() {
    let (without, with) = (face_bias(Guard::All(0.0)), face_bias(Guard::Sides(vec![0.0, 3.0, 0.0, 3.0])));
    println!("bias of the face nodes: {without:.4} px without, {with:.4} px with a guard of 3 px");
    // THEORY 9: 0.12 to 0.18 px without, below 0.006 px with.
    assert!(without > 0.08, "without a guard {without} px");
    assert!(with < 0.006, "with a guard {with} px");
}

#[test]
fn a_zone_that_ends_at_a_dark_band_is_warned_of() {
    let motion = Peel::new(320, 191);
    let reference = picture(&motion.at(0.0), &eight_bit(320, 191));
    let (top, bottom) = (motion.upper_edge().floor() + 1.0, motion.lower_edge().ceil());
    let at_the_band =
        [zone("upper", [16.0, top - 64.0, 304.0, top]), zone("lower", [16.0, bottom, 304.0, bottom + 64.0])];
    let found = prepared(&reference, &at_the_band, Options::default()).bare_borders().to_vec();
    assert_eq!(found.iter().map(|b| b.zone.as_str()).collect::<Vec<_>>(), ["upper", "lower"]);
    // The whole face and hardly anything else, in steps of one element.
    assert!(found.iter().all(|b| (256.0..=320.0).contains(&b.length_px)), "{found:?}");
    let guarded = at_the_band.clone().map(|zone| Zone { guard: Guard::All(3.0), ..zone });
    assert_eq!(prepared(&reference, &guarded, Options::default()).bare_borders(), []);
    let away = [
        zone("upper", [16.0, top - 67.0, 304.0, top - 3.0]),
        zone("lower", [16.0, bottom + 3.0, 304.0, bottom + 67.0]),
    ];
    assert_eq!(prepared(&reference, &away, Options::default()).bare_borders(), []);
}

#[track_caller]
fn assert_refused(zones: &[Zone], wanted: &str) {
    let error = PixelMesh::on_zones(zones, 16, ELEMENT_SHARE, SIZE).expect_err("wrong zones").to_string();
    assert!(error.contains(wanted), "{error}\nshould say: {wanted}");
}

#[test]
fn regions_that_make_no_sense_are_refused_with_a_reason() {
    let base = Zone { name: "a".into(), ..Zone::default() };
    let polygon = |corners: &[[f64; 2]]| Zone { polygon: corners.to_vec(), ..base.clone() };
    let bow_tie = [[20.0, 20.0], [120.0, 120.0], [120.0, 20.0], [20.0, 120.0]];
    assert_refused(&[polygon(&bow_tie)], "crosses itself near (70.0, 70.0) px: its sides 0 and 2");
    assert_refused(&[polygon(&bow_tie[..2])], "a polygon of 2 corners encloses nothing");
    assert_refused(&[polygon(&[[20.0, 20.0], [40.0, 20.0], [90.0, 20.0]])], "polygon");
    assert_refused(&[polygon(&[[20.0, 20.0], [f64::NAN, 20.0], [90.0, 90.0]])], "corner 1 of the polygon");
    assert_refused(&[polygon(&[[320.0, 20.0], [400.0, 20.0], [400.0, 90.0]])], "holds no pixel of the image");
    assert_refused(&[polygon(&[[20.0, 20.0], [24.0, 20.0], [24.0, 90.0]])], "no element of 16 px has 50 %");
    let empty = Mask::new(SIZE[0], SIZE[1], vec![false; SIZE[0] * SIZE[1]]).unwrap();
    assert_refused(&[Zone { mask: Some(Arc::new(empty)), ..base.clone() }], "check its rectangle, polygon and mask");
    let small = Mask::new(100, 90, vec![true; 9000]).unwrap();
    assert_refused(
        &[Zone { mask: Some(Arc::new(small)), ..base.clone() }],
        "the mask is 100 x 90 px, the image 260 x 200 px",
    );
    assert_eq!(Mask::new(3, 3, vec![true; 8]), None);
    let guard = |guard| Zone { guard, ..zone("a", INSIDE) };
    assert_refused(&[guard(Guard::All(-1.0))], "the guard is -1 px");
    assert_refused(&[guard(Guard::All(90.0))], "the guard is 90 px");
    // Far beyond any image, also where the border is not straight: refused at once.
    let cut = Zone { guard: Guard::All(1e9), ..polygon(&[[20.0, 20.0], [90.0, 20.0], [90.0, 90.0]]) };
    assert_refused(&[cut], "the guard is 1000000000 px");
    assert_refused(&[guard(Guard::Sides(vec![1.0; 3]))], "3 guards for 4 sides");
    let other = Zone { name: "b".into(), ..polygon(&rectangle_corners([200.0, 100.0, 250.0, 190.0])) };
    assert_refused(&[zone("a", INSIDE), other], "zones 'a' and 'b' overlap");
    let own = |change: &dyn Fn(&mut ZoneElements)| {
        let mut elements = free_mesh(INSIDE, 32.0, 0.0, false);
        change(&mut elements);
        free_zone(elements)
    };
    assert_refused(&[own(&|e| e.elements[3][2] = 999)], "element 3 names node 999");
    assert_refused(&[own(&|e| e.nodes[9] = [200.0, 150.0])], "is folded or has no area");
    assert_refused(&[own(&|e| e.nodes.push([50.0, 50.0]))], "belongs to no element");
    assert_refused(&[own(&|e| e.nodes[0] = [-20.0, 10.0])], "node 0 at (-20, 10) px");
    assert_refused(&[own(&|e| e.elements.clear())], "the mesh has no four-sided");
    for share in [0.0, -0.5, 1.5, f64::NAN] {
        let error = PixelMesh::on_zones(&one(INSIDE), 16, share, SIZE).expect_err("no share");
        assert!(matches!(error, MeshError::ElementShare { .. }), "{error}");
    }
    let reference = picture(&REST, &eight_bit(SIZE[0], SIZE[1]));
    let error = refusal(&reference, &[polygon(&bow_tie)], Options::default());
    assert!(matches!(error, CorrelationError::Mesh(MeshError::CrossedPolygon { .. })), "{error}");
}

#[test]
fn elements_keep_their_share_of_a_region_or_are_left_out() {
    // A half-plane whose edge cuts elements of 16 px at 10 px: 10/16 of their pixels are inside.
    let zone = Zone {
        name: "a".into(),
        roi: Some(Roi { x0: 0.0, y0: 0.0, x1: 90.0, y1: 64.0 }),
        mask: Some(mask(|_, _| true)),
        ..Zone::default()
    };
    let columns = |share: f64| {
        let laid = PixelMesh::on_zones(std::slice::from_ref(&zone), 16, share, SIZE).unwrap();
        let pixels: u32 = laid
            .pixels
            .elements()
            .iter()
            .map(|e| {
                let mut n = 0;
                laid.pixels.for_each(e, |_, _, _, _| n += 1);
                n
            })
            .sum();
        (laid.mesh.n_elements() / 4, pixels)
    };
    assert_eq!(columns(0.6), (6, 90 * 64));
    assert_eq!(columns(0.65), (5, 80 * 64));
}

#[test]
fn local_coordinates_undo_the_shape_functions_and_locate_finds_every_element() {
    let mesh: Mesh<Px> = Mesh::from_zones(vec![free_mesh(INSIDE, 16.0, 3.5, false)]).unwrap();
    for element in 0..mesh.n_elements() {
        for (xi, eta) in [(0.5, 0.5), (0.1, 0.9), (0.97, 0.03)] {
            let p = mesh.interpolate(mesh.nodes(), (element, xi, eta));
            let back = local_coordinates(mesh.corners(element), p).unwrap();
            assert!((back[0] - xi).abs() < 1e-12 && (back[1] - eta).abs() < 1e-12, "{back:?}");
            let (found, ..) = mesh.locate(0, p[0], p[1]).expect("inside");
            assert_eq!(found, element);
        }
    }
    assert_eq!(mesh.locate(0, 10.0, 10.0), None);
    let n_border = 2 * (14 + 10);
    let border = mesh.boundary(0);
    assert_eq!(border.len(), n_border);
    // Twice the enclosed area by the shoelace formula: positive when the inside is to the right, y down.
    let area: f64 = border
        .iter()
        .map(|[a, b]| (mesh.nodes()[*a as usize], mesh.nodes()[*b as usize]))
        .map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0]))
        .sum();
    assert!((area - 224.0 * 160.0).abs() < 1e-9, "{area}");
}
