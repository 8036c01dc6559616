//! Meshes cut along cracks: pixels, opening, sliding, tip and stress intensity against known fields. The images are
//! drawn by a renderer of this file: sums of Gaussian blobs at material points that are found by fixed-point iteration
//! on either side.

use crate::common::gpu;
use crate::program;
use program::Desk;
use quadrille::backend::Backend;
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{CrackLine, CrackValues, Elasticity, Measurement, NodalNoise, Status, TipState};
use quadrille::imaging::{Image, Pixels};
use quadrille::isa::Isa;
use quadrille::mesh::{Crack, Mesh, MeshError, PixelMesh, Roi, Zone};
use quadrille::units::Px;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;
use std::sync::Arc;

/// Side of the blobs, px: their standard deviation.
const BLOB: f64 = 1.7;

/// Displacement of the material point on the side `+1` (above the crack on the screen) or `-1`.
type Field<'a> = &'a dyn Fn([f64; 2], f64) -> [f64; 2];

/// Random blobs, and the side of a material point.
struct Scene {
    size: [usize; 2],
    blobs: Vec<Vec<[f64; 3]>>,
}

impl Scene {
    const BIN: f64 = 8.0;

    fn new(size: [usize; 2], seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let bins = size.map(|n| n / 8 + 1);
        let mut blobs = vec![Vec::new(); bins[0] * bins[1]];
        for _ in 0..size[0] * size[1] / 14 {
            let at = [0, 1].map(|c| random.random_range(0.0..size[c] as f64));
            let bin = (at[1] / Self::BIN) as usize * bins[0] + (at[0] / Self::BIN) as usize;
            blobs[bin].push([at[0], at[1], random.random_range(40.0..140.0)]);
        }
        Self { size, blobs }
    }

    fn grey(&self, [x, y]: [f64; 2]) -> f64 {
        let columns = self.size[0] / 8 + 1;
        let reach =
            |v: f64, n: usize| ((v / Self::BIN) as usize).saturating_sub(1)..=((v / Self::BIN) as usize + 1).min(n / 8);
        let (x, y) = (x.max(0.0), y.max(0.0));
        let near = reach(y, self.size[1]).flat_map(|j| reach(x, self.size[0]).map(move |i| j * columns + i));
        let sum: f64 = near
            .filter_map(|bin| self.blobs.get(bin))
            .flatten()
            .map(|[a, b, h]| h * (-((x - a).powi(2) + (y - b).powi(2)) / (2.0 * BLOB * BLOB)).exp())
            .sum();
        20.0 + sum.min(230.0)
    }

    /// The image under `field`; `side` tells on which side of the crack a material point lies (0 where there is none).
    /// What no material moves to is dark: the gap.
    fn image(&self, field: Field<'_>, side: &dyn Fn([f64; 2]) -> f64, noise: f64, seed: u64) -> Arc<Image> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut pixels = Vec::new();
        for (y, x) in (0..self.size[1]).flat_map(|y| (0..self.size[0]).map(move |x| (y, x))) {
            let mut sum = 0.0;
            for k in 0..4 {
                let at = [x as f64 - 0.25 + 0.5 * f64::from(k % 2), y as f64 - 0.25 + 0.5 * f64::from(k / 2)];
                let material = [1.0, -1.0].into_iter().find_map(|which| {
                    let mut from = at;
                    for _ in 0..40 {
                        let u = field(from, which);
                        from = [at[0] - u[0], at[1] - u[1]];
                    }
                    (side(from) * which >= 0.0).then_some(from)
                });
                sum += 0.25 * material.map_or(5.0, |from| self.grey(from));
            }
            // Sum of twelve even numbers: near enough to a normal one.
            let shake: f64 = (0..12).map(|_| random.random_range(-0.5..0.5)).sum();
            pixels.push((sum + noise * shake) as f32);
        }
        Arc::new(Image::new(self.size[0], self.size[1], Pixels::F32(pixels)).unwrap())
    }
}

fn at_rest(_: [f64; 2], _: f64) -> [f64; 2] {
    [0.0; 2]
}

fn zone(roi: [f64; 4], path: &[[f64; 2]], guard: f64) -> Zone {
    let [x0, y0, x1, y1] = roi;
    let crack = Crack { path: path.to_vec(), guard };
    Zone { cracks: vec![crack], ..Zone::rectangle("plate", Roi { x0, y0, x1, y1 }) }
}

#[track_caller]
fn laid(roi: [f64; 4], path: &[[f64; 2]], guard: f64, size: [usize; 2]) -> PixelMesh {
    PixelMesh::on_zones(&[zone(roi, path, guard)], 16, 0.5, size).unwrap()
}

#[track_caller]
fn measured<B: Backend>(backend: B, zone: Zone, images: [&Arc<Image>; 2]) -> Measurement<Px> {
    let correlator = Correlator::new(backend, Arc::clone(images[0]), &[zone], Options::default()).unwrap();
    let found = correlator.correlate(Arc::clone(images[1]), None).unwrap().measurement;
    assert_eq!(found.status, Status::Converged);
    found
}

#[track_caller]
fn read(path: &[[f64; 2]], field: &Measurement<Px>, elasticity: Option<Elasticity>) -> (CrackLine, CrackValues) {
    let line = CrackLine::on(&field.mesh, path.to_vec(), elasticity).unwrap();
    let values = line.read(field, &NodalNoise::new(&field.mesh, &field.measured));
    (line, values)
}

/// Twice the area between `at` and the straight line of a path: positive on the side `+`, above a path that goes right.
fn above(path: &[[f64; 2]], at: [f64; 2]) -> f64 {
    let (a, b) = (path[0], path[path.len() - 1]);
    -((b[0] - a[0]) * (at[1] - a[1]) - (b[1] - a[1]) * (at[0] - a[0]))
}

#[test]
fn every_pixel_beside_the_guard_belongs_to_one_element_on_its_own_side() {
    let size = [260, 220];
    let roi = [10.0, 12.0, 250.0, 204.0];
    for path in [
        [[0.0, 101.3], [300.0, 117.9]],
        [[0.0, 30.0], [300.0, 190.0]],
        [[131.0, 0.0], [120.0, 250.0]],
        [[60.0, 250.0], [180.0, 0.0]],
        [[300.0, 199.0], [0.0, 20.0]],
        [[10.0, 108.0], [250.0, 108.0]],
    ] {
        for guard in [0.0, 3.0] {
            let laid = laid(roi, &path, guard, size);
            let mut owners = vec![0; size[0] * size[1]];
            for (element, of) in laid.pixels.elements().iter().enumerate() {
                let corners = laid.mesh.corners(element);
                let middle = [0, 1].map(|c| corners.iter().map(|p| 0.25 * p[c]).sum::<f64>());
                laid.pixels.for_each(of, |x, y, xi, eta| {
                    owners[y as usize * size[0] + x as usize] += 1;
                    let p = [f64::from(x), f64::from(y)];
                    // A path straight through the zone is followed exactly.
                    let sides = [above(&path, p), above(&path, middle)];
                    assert!(sides[0] * sides[1] > -1e-6, "({x}, {y}) is across {path:?}");
                    assert!((0.0..=1.0).contains(&xi) && (0.0..=1.0).contains(&eta));
                });
            }
            let length = (path[1][0] - path[0][0]).hypot(path[1][1] - path[0][1]);
            for (y, x) in (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (y, x))) {
                let inside = (10..250).contains(&x) && (12..204).contains(&y);
                let distance = above(&path, [x as f64, y as f64]).abs() / length;
                if (distance - guard).abs() < 1e-9 && guard > 0.0 {
                    continue; // round-off decides
                }
                let kept = inside && distance >= guard;
                assert_eq!(owners[y * size[0] + x], u32::from(kept), "({x}, {y}), {path:?}, guard {guard}");
            }
        }
    }
}

#[test]
fn the_elements_along_a_cut_keep_their_size_and_the_ends_inside_are_joined() {
    let size = [400, 400];
    for angle in [0.0, 0.2, 0.5, 0.785, 1.1, 1.5, 2.2, 3.0] {
        let (sin, cos) = f64::sin_cos(angle);
        let end = |s: f64| [203.0 + s * cos, 198.0 + s * sin];
        let path = [end(-70.0), end(75.0)];
        let mesh = laid([8.0, 8.0, 392.0, 392.0], &path, 3.0, size).mesh;
        for element in 0..mesh.n_elements() {
            let [a, b, c, d] = mesh.elements()[element];
            let area = mesh.geometry(element).area();
            // A free end stands where the path ends, up to half an element from its place on the grid.
            let least = if c == d { 0.12 } else { 0.45 };
            assert!(area > least * 256.0, "{a} {b}: {area} at {angle}");
        }
        let faces = mesh.cut_faces(&path);
        let tips: Vec<_> = faces.tips.iter().flatten().map(|tip| tip.at).collect();
        assert_eq!(tips.len(), 2, "{angle}");
        for (tip, end) in tips.iter().zip(path) {
            assert!((tip[0] - end[0]).hypot(tip[1] - end[1]) < 1e-9, "{tip:?} {end:?}");
        }
        assert!((6..10).contains(&faces.points.len()), "{} at {angle}", faces.points.len());
        for point in &faces.points {
            assert!(above(&path, point.at).abs() < 1e-6, "on the path");
        }
    }
}

#[test]
fn a_path_with_bends_is_followed_and_a_path_that_ends_beside_the_border_goes_on_to_it() {
    let path = [[3.0, 100.0], [90.0, 104.0], [130.0, 140.0], [240.0, 150.0]];
    let mesh = laid([0.0, 0.0, 320.0, 240.0], &path, 3.0, [320, 240]).mesh;
    let faces = mesh.cut_faces(&path);
    assert!(faces.tips[0].is_none(), "it reaches the border");
    assert_eq!(faces.tips[1].unwrap().at, path[3]);
    let first = faces.points[0];
    assert!(first.at[0] == 0.0 && first.along == 0.0, "{first:?}");
    // Bends stand on nodes of their own.
    for bend in &path[1..3] {
        assert!(faces.points.iter().any(|point| point.at == *bend), "{bend:?}");
    }
    assert!(faces.points.windows(2).all(|two| two[1].along > two[0].along));
}

#[test]
fn a_crack_that_cuts_nothing_is_refused_with_the_reason() {
    let refused = |path: &[[f64; 2]], guard: f64| {
        PixelMesh::on_zones(&[zone([8.0, 8.0, 200.0, 200.0], path, guard)], 16, 0.5, [220, 220]).unwrap_err()
    };
    assert!(matches!(refused(&[[100.0, 100.0], [108.0, 100.0]], 3.0), MeshError::CrackCutsNothing { .. }));
    assert!(matches!(refused(&[[100.0, 205.0], [150.0, 215.0]], 3.0), MeshError::CrackCutsNothing { .. }));
    assert!(matches!(refused(&[[100.0, 100.0], [100.0, 100.0]], 3.0), MeshError::CrackShort { .. }));
    assert!(matches!(refused(&[[100.0, f64::NAN], [150.0, 100.0]], 3.0), MeshError::NotFinite { corner: 0, .. }));
    assert!(matches!(refused(&[[0.0, 100.0], [150.0, 100.0]], -1.0), MeshError::Guard { .. }));
}

/// Two blocks on either side of an inclined joint move apart and past each other, one of them stretched.
#[test]
fn opening_and_sliding_of_an_inclined_joint_are_found_within_their_uncertainty_on_both_devices() {
    let size = [224, 208];
    let path = [[0.0, 80.0], [224.0, 132.0]];
    let length = 224f64.hypot(52.0);
    let normal = [52.0 / length, -224.0 / length];
    let tangent = [224.0 / length, 52.0 / length];
    // Opens from 2 to 6 px along it, and slides by 1.5 px.
    let field = |x: [f64; 2], side: f64| {
        let s = x[0] * tangent[0] + x[1] * tangent[1];
        let (open, slide) = (0.5 * side * (2.0 + 0.018 * s), 0.5 * side * 1.5);
        [0, 1].map(|c| open * normal[c] + slide * tangent[c] + [0.3, -0.4][c])
    };
    let side = |x: [f64; 2]| above(&path, x).signum();
    let scene = Scene::new(size, 5);
    let images = [scene.image(&at_rest, &|_| 0.0, 1.0, 1), scene.image(&field, &side, 1.0, 2)];
    let zone = zone([16.0, 16.0, 208.0, 192.0], &path, Crack::GUARD);
    let check = |found: &Measurement<Px>| {
        let (line, values) = read(&path, found, None);
        assert!(line.joined().next().is_none());
        let (mut sum, mut n) = (0.0, 0.0);
        for (point, jump) in line.points().iter().zip(&values.points) {
            let jump = jump.unwrap();
            let s = point.at[0] * tangent[0] + point.at[1] * tangent[1];
            for (found, want) in [(jump.opening, 2.0 + 0.018 * s), (jump.sliding, 1.5)] {
                let off = found.value - want;
                // 0.01 px: what the interpolation and sub-sampled drawing leave.
                assert!(off.abs() < 4.0 * found.sigma + 0.01, "{off} at {:?}, sigma {}", point.at, found.sigma);
                sum += (off / found.sigma).powi(2);
                n += 1.0;
            }
        }
        let ratio = f64::sqrt(sum / n);
        assert!((0.6..1.5).contains(&ratio), "error over sigma {ratio} of {n}");
    };
    let cpu = measured(CpuBackend::new(Isa::detect()), zone.clone(), [&images[0], &images[1]]);
    check(&cpu);
    if let Some(device) = gpu::device() {
        let found = measured(device, zone, [&images[0], &images[1]]);
        check(&found);
        let worst = cpu.displacement.iter().zip(&found.displacement).flat_map(|(a, b)| [a[0] - b[0], a[1] - b[1]]);
        let worst = worst.fold(0.0, |worst: f64, v| worst.max(v.abs()));
        assert!(worst < 2e-3, "the devices differ by {worst} px");
    }
}

/// Young's modulus 1000 MPa, Poisson's ratio 0.3, 0.1 mm per px.
const PLATE: Elasticity = Elasticity { young_mpa: 1000.0, poisson: 0.3, mm_per_unit: 0.1, radius: None };

/// The field of Williams about a `tip` with the crack behind the unit vector `ahead`; K in MPa sqrt(m), displacement in
/// px.
fn williams(tip: [f64; 2], ahead: [f64; 2], [k1, k2]: [f64; 2], x: [f64; 2], side: f64) -> [f64; 2] {
    let Elasticity { young_mpa, poisson, mm_per_unit, .. } = PLATE;
    let (dx, dy) = (x[0] - tip[0], x[1] - tip[1]);
    let across = [ahead[1], -ahead[0]];
    let (a, b) = (dx * ahead[0] + dy * ahead[1], dx * across[0] + dy * across[1]);
    let mut theta = b.atan2(a);
    // The side decides behind the tip, also a little beyond the face.
    if a < 0.0 && theta * side < 0.0 {
        theta += 2.0 * PI * side;
    }
    let r_m = a.hypot(b) * mm_per_unit / 1000.0;
    let kappa = (3.0 - poisson) / (1.0 + poisson);
    let shear = 0.5 * young_mpa / (1.0 + poisson);
    let root = (r_m / (2.0 * PI)).sqrt() / (2.0 * shear);
    let (s, c) = (0.5 * theta).sin_cos();
    let cos = theta.cos();
    let u1 = root * (k1 * c * (kappa - cos) + k2 * s * (kappa + 2.0 + cos));
    let u2 = root * (k1 * s * (kappa - cos) - k2 * c * (kappa - 2.0 + cos));
    let px = 1000.0 / mm_per_unit;
    [0, 1].map(|i| px * (u1 * ahead[i] + u2 * across[i]))
}

#[test]
fn stress_intensity_of_the_exact_singular_field_is_found_to_one_per_cent_in_every_direction() {
    let size = [640, 640];
    for (angle, k) in [(0.0, [1.0, 0.0]), (0.4, [0.7, 0.5]), (1.2, [0.2, -1.0]), (2.5, [1.0, 0.3]), (4.0, [0.5, 0.5])] {
        let (sin, cos) = f64::sin_cos(angle);
        let (tip, ahead) = ([322.0, 318.0], [cos, sin]);
        let path = [[tip[0] - 500.0 * cos, tip[1] - 500.0 * sin], tip];
        let mesh = laid([0.0, 0.0, 640.0, 640.0], &path, 3.0, size).mesh;
        let mut side = vec![0.0; mesh.n_nodes()];
        for point in &mesh.cut_faces(&path).points {
            (side[point.plus], side[point.minus]) = (1.0, -1.0);
        }
        // A rotation and a pull along the crack beside it: they have no stress intensity.
        let spin = |x: [f64; 2]| [-3e-3 * (x[1] - 100.0) + 1e-3 * x[0], 3e-3 * x[0] - PLATE.poisson * 1e-3 * x[1]];
        let displacement = mesh.nodes().iter().zip(&side).map(|(&x, &side)| {
            let u = williams(tip, ahead, k, x, side);
            if angle == 0.0 { [0, 1].map(|c| u[c] + spin(x)[c]) } else { u }
        });
        let field = Measurement {
            displacement: displacement.collect(),
            sigma: vec![[0.001; 2]; mesh.n_nodes()],
            measured: vec![true; mesh.n_nodes()],
            element_residual: vec![0.0; mesh.n_elements()],
            model_error: None,
            marks: None,
            points: None,
            status: Status::Converged,
            mesh: Arc::clone(&mesh),
        };
        let (_, values) = read(&path, &field, Some(PLATE));
        let found = values.tips[0].intensity.unwrap();
        let size = k[0].hypot(k[1]);
        for (found, want) in [(found.k1, k[0]), (found.k2, k[1])] {
            assert!((found.value - want).abs() < 0.01 * size, "{found:?} at {angle}, {k:?}");
            assert!(found.sigma > 0.0 && found.sigma < 0.01, "{found:?}");
        }
    }
}

#[test]
fn stress_intensity_and_tip_are_found_on_images_of_a_crack() {
    let size = [336, 320];
    let (tip, ahead) = ([170.0, 158.0], [1.0, 0.0]);
    let k = [0.7, 0.25];
    let field = |x: [f64; 2], side: f64| williams(tip, ahead, k, x, side);
    let side = |x: [f64; 2]| if x[0] < tip[0] { (tip[1] - x[1]).signum() } else { 0.0 };
    let scene = Scene::new(size, 11);
    let images = [scene.image(&at_rest, &|_| 0.0, 1.0, 3), scene.image(&field, &side, 1.0, 4)];
    // The path goes on beyond the tip, as a user would draw it.
    let path = [[0.0, tip[1]], [tip[0] + 60.0, tip[1]]];
    let found =
        measured(CpuBackend::new(Isa::detect()), zone([8.0, 8.0, 328.0, 312.0], &path, 3.0), [&images[0], &images[1]]);
    let (line, values) = read(&path, &found, Some(PLATE));
    let of_tip = values.tips[0];
    assert_eq!(of_tip.state, TipState::Found);
    let at = of_tip.at.unwrap();
    // An element either way: the opening of the singular field ends where a linear element does.
    assert!((at[0] - tip[0]).abs() < 16.0 && (at[1] - tip[1]).abs() < 1e-6, "{of_tip:?}");
    let found = of_tip.intensity.unwrap();
    for (found, want) in [(found.k1, k[0]), (found.k2, k[1])] {
        let off = (found.value - want).abs();
        assert!(off < 0.02 * k[0] + 3.0 * found.sigma, "{off}: {found:?}, {want} wanted");
    }
    // The opening behind the tip, away from the first element: 8 K / E sqrt(r / 2 pi).
    for (point, jump) in line.points().iter().zip(&values.points) {
        let r = tip[0] - point.at[0];
        if r > 32.0 {
            let want = [1.0, -1.0].map(|side| williams(tip, ahead, k, point.at, side));
            let jump = jump.unwrap();
            let (open, slide) = (want[1][1] - want[0][1], want[0][0] - want[1][0]);
            for (found, want) in [(jump.opening, open), (jump.sliding, slide)] {
                assert!((found.value - want).abs() < 4.0 * found.sigma + 0.02, "{found:?}, {want} wanted at r = {r}");
            }
        }
    }
}

/// Elements beyond the tip hold together within their noise: a path that is too long opens nothing.
#[test]
fn a_crack_drawn_where_there_is_none_is_closed() {
    let size = [200, 176];
    let scene = Scene::new(size, 2);
    let field = |x: [f64; 2], _: f64| [0.4 + 0.002 * x[0], -0.3 + 0.001 * x[1]];
    let images = [scene.image(&at_rest, &|_| 0.0, 2.0, 5), scene.image(&field, &|_| 0.0, 2.0, 6)];
    let path = [[0.0, 92.0], [130.0, 84.0]];
    let found =
        measured(CpuBackend::new(Isa::detect()), zone([8.0, 8.0, 184.0, 168.0], &path, 3.0), [&images[0], &images[1]]);
    let (_, values) = read(&path, &found, None);
    assert_eq!(values.tips[0].state, TipState::Closed, "{values:?}");
}

fn crack_of(desk: &Desk) -> Arc<Mesh<Px>> {
    quadrille::io::store::Store::open(desk.path("out")).unwrap().mesh().clone()
}

#[test]
fn the_program_writes_openings_tips_stress_intensity_and_their_figures() {
    let size = [208, 192];
    let (tip, ahead) = ([110.0, 94.0], [1.0, 0.0]);
    let side = |x: [f64; 2]| if x[0] < tip[0] { (tip[1] - x[1]).signum() } else { 0.0 };
    let scene = Scene::new(size, 7);
    let desk = Desk::new();
    desk.image("0.tif", &scene.image(&at_rest, &|_| 0.0, 1.0, 1));
    for (name, k1) in [("1.tif", 0.8), ("2.tif", 1.6)] {
        let field = |x: [f64; 2], side: f64| williams(tip, ahead, [k1, 0.0], x, side);
        desk.image(name, &scene.image(&field, &side, 1.0, 9));
    }
    let flags =
        ["correlate", "--output", "out", "--roi", "8,8,200,184", "--crack", "0,94 150,94", "--crack-young", "1000"];
    let more = ["--crack-poisson", "0.3", "--pixel-size", "0.1", "--element-size", "12", "0.tif", "1.tif", "2.tif"];
    desk.run_words(&[&flags[..], &more].concat()).fine();
    let summary = desk.json("out/summary.json");
    let frames = summary["cracks"][0]["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 2);
    for (frame, want) in frames.iter().zip([0.8, 1.6]) {
        let tip = &frame["tips"][0];
        let k1 = tip["K_I_MPa_sqrt_m"][0].as_f64().unwrap();
        let sigma = tip["K_I_MPa_sqrt_m"][1].as_f64().unwrap();
        assert!((k1 - want).abs() < 0.03 * want + 3.0 * sigma, "{k1} +- {sigma}, {want} wanted");
        assert_eq!(tip["state"], "found");
        assert!((tip["at_px"][0].as_f64().unwrap() - 110.0).abs() < 16.0, "{tip}");
    }
    let table = desk.read("out/quantities/crack_tips.csv");
    assert!(
        table.contains("K_I_MPa_sqrt_m")
            && table.lines().any(|line| line.starts_with("2,converged,crack1,last,found,"))
    );
    let places = desk.read("out/quantities/cracks.csv");
    assert!(
        places.contains("crack,mark,along_px") && places.contains("opening_px,sigma_opening_px,sliding_px"),
        "{places}"
    );
    assert!(places.lines().any(|line| line.starts_with("2,converged,crack1,none,")), "{places}");
    for name in ["crack1-opening", "crack1-tip", "crack1-stress-intensity"] {
        assert!(desk.path(&format!("out/figures/{name}.png")).exists(), "{name}");
    }
    assert!(!crack_of(&desk).cut_faces(&[[0.0, 94.0], [150.0, 94.0]]).points.is_empty(), "the store keeps the cut");
    // The record of the run makes the same run, and its numbers can be drawn again.
    let again = desk.read("out/run.toml");
    assert!(again.contains("[[crack]]") && again.contains("E_MPa = 1000"), "{again}");
    desk.run("probe out --output again").fine();
    let plain =
        |name: &str| desk.read(name).lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n");
    assert_eq!(plain("again/quantities/crack_tips.csv"), plain("out/quantities/crack_tips.csv"));
}

#[test]
fn what_is_asked_of_a_crack_is_refused_in_words_where_it_cannot_be() {
    let desk = Desk::with_series();
    let correlate = |more: &[&str]| {
        let first = ["correlate", "--output", "out", "--roi", "16,16,112,80", "ref.png", "a.png"];
        desk.run_words(&[&first[..], more].concat())
    };
    correlate(&["--crack", "20,30"]).refused(&["fewer than two points"]);
    correlate(&["--crack", "0,46 100,46", "--crack-young", "1000"]).refused(&["Poisson", "give both or none"]);
    let both = ["--crack", "0,46 100,46", "--crack-young", "1000", "--crack-poisson", "0.3"];
    correlate(&both).refused(&["--pixel-size"]);
    correlate(&["--crack", "0,46 100,46", "--crack-young", "-2", "--crack-poisson", "0.3"]).refused(&["-2 MPa"]);
    correlate(&["--crack-guard", "4"]).refused(&["--crack-guard, is given but no crack"]);
    correlate(&["--crack", "20,85 40,90"]).refused(&["cuts no zone", "(20, 85)"]);
}
