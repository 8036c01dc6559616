//! Points, lines, extensometers, openings and rigid motions: exact on fields that are known, and their printed
//! uncertainty against repeated noisy images.

use crate::common;
use common::*;
use quadrille::correlate::Options;
use quadrille::field::{
    Extensometer, Facing, Measurement, NodalNoise, PointFilter, PointValues, Quantities, QuantityError, Reading,
    Region, RemoveRigid, Segment, Status, StrainDefinition, StrainField, StrainWindow, StrainWindows, Value, at_point,
    remove_rigid,
};
use quadrille::io::load::{LoadTable, parse_load};
use quadrille::io::quantities::{QuantityPlane, QuantityTables};
use quadrille::mesh::{Mesh, ZoneElements};
use quadrille::remark::{About, Code, Remark};
use quadrille::synth::{Affine, Motion, Peel, RenderOptions, Texture, exact_at, render};
use quadrille::units::{PixelSize, Px};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The displacement `u(zone, x)` on the nodes of a mesh, all measured to 0.01 px.
fn field(mesh: Mesh<Px>, u: impl Fn(usize, [f64; 2]) -> [f64; 2]) -> Measurement<Px> {
    let displacement = mesh.nodes().iter().zip(mesh.node_zone()).map(|(&x, &zone)| u(zone as usize, x)).collect();
    Measurement {
        status: Status::Converged,
        displacement,
        sigma: vec![[0.01; 2]; mesh.n_nodes()],
        measured: vec![true; mesh.n_nodes()],
        element_residual: vec![1.0; mesh.n_elements()],
        model_error: None,
        marks: None,
        points: None,
        mesh: Arc::new(mesh),
    }
}

fn noise_of(field: &Measurement<Px>) -> NodalNoise {
    NodalNoise::new(&field.mesh, &field.measured)
}

fn grid(zones: &[[f64; 4]]) -> Mesh<Px> {
    let zones: Vec<_> = zones.iter().enumerate().map(|(k, &roi)| zone(&format!("z{k}"), roi)).collect();
    Mesh::on_zones(&zones, 16, 400, 400).unwrap()
}

/// A free zone: a grid of `nx` x `ny` unit cells carried to the plane by `map`.
fn mapped(name: &str, [nx, ny]: [usize; 2], map: impl Fn(f64, f64) -> [f64; 2]) -> ZoneElements {
    let number = |i: usize, j: usize| (j * (nx + 1) + i) as u32;
    let nodes = (0..=ny).flat_map(|j| (0..=nx).map(move |i| (i, j)));
    let cells = (0..ny).flat_map(|j| (0..nx).map(move |i| (i, j)));
    ZoneElements {
        name: name.into(),
        nodes: nodes.map(|(i, j)| map(i as f64 / nx as f64, j as f64 / ny as f64)).collect(),
        elements: cells
            .map(|(i, j)| [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)])
            .collect(),
    }
}

#[track_caller]
fn assert_near(found: f64, want: f64, tolerance: f64, what: &str) {
    assert!((found - want).abs() <= tolerance, "{what}: {found}, not {want}");
}

#[test]
fn points_and_lines_are_exact_on_affine_fields() {
    let gradient = [[0.01, 0.02], [-0.015, -0.004]];
    let u = |[x, y]: [f64; 2]| [1.0 + 0.01 * x + 0.02 * y, -2.0 - 0.015 * x - 0.004 * y];
    let distorted =
        mapped("free", [6, 5], |s, t| [20.0 + 120.0 * s + 9.0 * (3.0 * t).sin() * s, 30.0 + 90.0 * t + 8.0 * s * t]);
    for mesh in [grid(&[[10.0, 10.0, 200.0, 200.0]]), Mesh::from_zones(vec![distorted]).unwrap()] {
        let field = field(mesh, |_, x| u(x));
        let noise = noise_of(&field);
        for definition in [StrainDefinition::Infinitesimal, StrainDefinition::GreenLagrange, StrainDefinition::Hencky] {
            let want = definition.of_gradient(gradient).unwrap();
            let line = Segment::new([30.0, 41.0], [111.0, 97.0], 7.3).unwrap();
            for (s, x) in line.points() {
                let there = at_point(&field, &noise, definition, x).unwrap();
                let (strain, sigma) = there.strain.unwrap();
                for c in 0..2 {
                    assert_near(there.displacement[c], u(x)[c], 1e-12, "displacement");
                    assert!(there.sigma[c] > 0.003 && there.sigma[c] <= 0.01, "{:?} at {s}", there.sigma);
                }
                for k in 0..3 {
                    assert_near(strain.components()[k], want.components()[k], 1e-12, "strain");
                    assert!(sigma[k] > 1e-5 && sigma[k] < 1e-3, "{sigma:?} at {s}");
                }
            }
        }
    }
}

#[test]
fn a_point_on_a_node_reads_what_the_node_has() {
    let field =
        field(grid(&[[10.0, 10.0, 100.0, 100.0]]), |_, [x, y]| [0.3 * (x / 20.0).sin(), 0.2 * (x * y / 900.0).cos()]);
    let points = PointFilter::new(&field.mesh, &field.measured, None).of(&field);
    let [at_points, of_coefficients] = [noise_of(&field), noise_of(&field).of_coefficients()];
    for definition in [StrainDefinition::GreenLagrange, StrainDefinition::Hencky] {
        let strains = StrainField::of(&field, definition);
        for (node, &x) in field.mesh.nodes().iter().enumerate() {
            let value = at_point(&field, &at_points, definition, x).unwrap();
            // Sums of the same weights in another order, of numbers below one.
            assert!((0..2).all(|c| (value.displacement[c] - points.displacement[node][c]).abs() < 1e-13));
            let there = at_point(&field, &of_coefficients, definition, x).unwrap();
            let want = strains.nodes[node].unwrap();
            assert!((0..2).all(|c| (there.displacement[c] - field.displacement[node][c]).abs() < 1e-14));
            assert!((0..2).all(|c| (there.sigma[c] - field.sigma[node][c]).abs() < 1e-14));
            assert_eq!(there.strain, value.strain);
            assert!(
                (0..3).all(|k| (there.strain.unwrap().0.components()[k] - want.components()[k]).abs() < 1e-12),
                "node {node}"
            );
        }
    }
}

#[test]
fn outside_and_unmeasured_places_have_no_value() {
    let mut field = field(grid(&[[10.0, 10.0, 100.0, 100.0]]), |_, x| x);
    field.measured[0] = false;
    field.displacement[0] = [f64::NAN; 2];
    let noise = noise_of(&field);
    let at = |x| at_point(&field, &noise, StrainDefinition::Infinitesimal, x);
    for nowhere in [[5.0, 50.0], [50.0, 300.0], [15.0, 15.0], [f64::NAN, 20.0], [f64::INFINITY, 20.0]] {
        assert!(at(nowhere).is_none(), "{nowhere:?}");
    }
    let next = at([27.0, 15.0]).unwrap(); // the element beside; its strain uses what is measured
    assert_near(next.strain.unwrap().0.xx, 1.0, 1e-12, "strain");
    let read = |from, to, width| Extensometer::new(from, to, width).unwrap().read(&field, &noise);
    assert!(read([15.0, 15.0], [60.0, 60.0], 0.0).is_none());
    assert!(read([50.0, 50.0], [300.0, 50.0], 0.0).is_none());
    assert!(read([50.0, 50.0], [80.0, 50.0], 400.0).is_none());
    assert!(read([50.0, 50.0], [80.0, 50.0], 20.0).is_some());
}

#[test]
fn an_extensometer_does_not_see_rotation() {
    let (sin, cos) = 30f64.to_radians().sin_cos();
    // Stretched by 3 % along (4, 3)/5, then turned by 30 degrees.
    let u = |[x, y]: [f64; 2]| {
        let along = 0.03 * (0.8 * x + 0.6 * y);
        let [a, b] = [x + 0.8 * along, y + 0.6 * along];
        [cos * a - sin * b - x, sin * a + cos * b - y]
    };
    let field = field(grid(&[[10.0, 10.0, 200.0, 200.0]]), |_, x| u(x));
    let noise = noise_of(&field);
    for width in [0.0, 25.0] {
        let read = Extensometer::new([50.0, 50.0], [130.0, 110.0], width).unwrap().read(&field, &noise).unwrap();
        assert_near(read.reference_length, 100.0, 1e-12, "length");
        assert_near(read.elongation.value, 3.0, 1e-10, "elongation");
        assert_near(read.engineering.value, 0.03, 1e-12, "engineering strain");
        assert_near(read.logarithmic.value, 1.03f64.ln(), 1e-12, "true strain");
        assert_near(read.engineering.sigma, read.elongation.sigma / 100.0, 1e-15, "sigma");
        assert_near(read.logarithmic.sigma, read.elongation.sigma / 103.0, 1e-15, "sigma");
        // Two points inside elements: at most that of two nodes, 0.01 sqrt 2; gauge lines average.
        let most = if width == 0.0 { 0.015 } else { 0.008 };
        assert!(read.elongation.sigma > 0.001 && read.elongation.sigma < most, "{width}: {read:?}");
    }
}

#[test]
fn uncertainty_without_known_correlation_is_an_upper_bound() {
    let field = field(grid(&[[10.0, 10.0, 200.0, 200.0]]), |_, [x, y]| [0.001 * x, 0.002 * y]);
    let (known, unknown) = (noise_of(&field), NodalNoise::unknown(&field.mesh, &field.measured));
    assert!(unknown.is_bound() && !known.is_bound());
    assert!(known.is_for(&field.measured) && !known.is_for(&[]));
    for x in [[50.0, 50.0], [58.0, 58.0], [61.3, 52.9]] {
        let [a, b] = [&known, &unknown].map(|noise| at_point(&field, noise, StrainDefinition::Hencky, x).unwrap());
        (0..2).for_each(|c| assert_near(a.displacement[c], b.displacement[c], 1e-14, "a linear field"));
        assert!(a.sigma[0] <= b.sigma[0] && b.sigma[0] <= 0.01 + 1e-15, "{:?}, {:?}", a.sigma, b.sigma);
        assert!((0..3).all(|k| a.strain.unwrap().1[k] < b.strain.unwrap().1[k]));
    }
    // One node: both know all.
    let one = Reading::new([(17, [1.0, 0.0])]);
    assert_eq!(one.read(&field, &known).unwrap().sigma, 0.01);
    assert_eq!(one.read(&field, &unknown).unwrap().sigma, 0.01);
}

#[test]
fn rigid_motion_is_removed_exactly_together_and_by_zone() {
    let zones = [[10.0, 10.0, 200.0, 90.0], [10.0, 120.0, 200.0, 200.0]];
    let turn = |degrees: f64, [x, y]: [f64; 2], shift: [f64; 2]| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [(cos - 1.0) * x - sin * y + shift[0], sin * x + (cos - 1.0) * y + shift[1]]
    };
    // Each zone moves in its own way.
    let apart = field(grid(&zones), |zone, x| turn([20.0, -7.0][zone], x, [[30.0, 4.0], [-2.0, 1.0]][zone]));
    let (left, removed) = remove_rigid(&apart, RemoveRigid::Zone);
    assert!(largest(&left.displacement) < 1e-11, "{}", largest(&left.displacement));
    assert_eq!(removed.iter().map(|r| r.zone).collect::<Vec<_>>(), [Some(0), Some(1)]);
    assert_near(removed[0].motion.rotation_rad.to_degrees(), 20.0, 1e-10, "rotation");
    assert_near(removed[1].motion.rotation_rad.to_degrees(), -7.0, 1e-10, "rotation");
    assert!(removed[0].left_rms < 1e-11 && removed[0].largest > 30.0, "{removed:?}");

    // A deformed specimen that turns as a whole: Green-Lagrange strains stay, a stretch is left.
    let bent = field(grid(&zones), |_, [x, y]| {
        let moved = [1.01 * x, y + 1e-4 * x * x];
        let u = turn(12.0, moved, [5.0, 6.0]);
        [moved[0] - x + u[0], moved[1] - y + u[1]]
    });
    let (left, removed) = remove_rigid(&bent, RemoveRigid::All);
    assert_eq!((removed.len(), removed[0].zone), (1, None));
    let [before, after] = [&bent, &left].map(|field| StrainField::of(field, StrainDefinition::GreenLagrange));
    for (a, b) in before.nodes.iter().zip(&after.nodes) {
        assert!((0..3).all(|k| (a.unwrap().components()[k] - b.unwrap().components()[k]).abs() < 1e-12));
    }
    let [again, _] = [RemoveRigid::All, RemoveRigid::Zone].map(|which| remove_rigid(&left, which).1[0]);
    assert!(again.motion.rotation_rad.abs() < 1e-12 && again.largest < 1e-10, "{again:?}");
    assert!((removed[0].left_rms - rms(&left.displacement)).abs() < 1e-12);

    // A rotated sigma is rotated; a node that was not measured is left alone.
    let mut skewed = field(grid(&zones), |_, x| turn(90.0, x, [0.0; 2]));
    skewed.sigma.fill([0.01, 0.03]);
    skewed.measured[3] = false;
    skewed.displacement[3] = [0.0; 2];
    let (left, _) = remove_rigid(&skewed, RemoveRigid::All);
    assert_near(left.sigma[0][0], 0.03, 1e-12, "sigma");
    assert_near(left.sigma[0][1], 0.01, 1e-12, "sigma");
    assert_eq!(left.displacement[3], [0.0; 2]);
    skewed.measured.fill(false);
    assert!(remove_rigid(&skewed, RemoveRigid::Zone).1.is_empty());
}

/// Opening and sliding at every point of a joint, when `+` moves by `opening` along the normal and `sliding` along the
/// tangent of each point of its face.
#[track_caller]
fn assert_jumps(field: &Measurement<Px>, facing: &Facing, want: impl Fn([f64; 2]) -> [f64; 2], tolerance: f64) {
    let noise = noise_of(field);
    for point in facing.points() {
        let jump = point.read(field, &noise).unwrap();
        let [opening, sliding] = want(point.at);
        assert_near(jump.opening.value, opening, tolerance, &format!("opening at {:?}", point.at));
        assert_near(jump.sliding.value, sliding, tolerance, &format!("sliding at {:?}", point.at));
        // A value has at most twice the noise of its coefficient; 1.12 of it in a corner of a grid.
        assert!(jump.opening.sigma > 0.005 && jump.opening.sigma <= 2.0 * 0.0142, "{jump:?}");
    }
}

#[test]
fn a_horizontal_joint_opens_upwards_and_slides_along_x() {
    let mesh = grid(&[[16.0, 16.0, 192.0, 96.0], [16.0, 127.0, 192.0, 207.0]]);
    let facing = Facing::between(&mesh, "z0", "z1").unwrap();
    assert_eq!(facing.points().len(), 12);
    for (k, point) in facing.points().iter().enumerate() {
        assert_eq!(point.at, [16.0 + 16.0 * k as f64, 111.5]);
        assert_eq!((point.part, point.along, point.gap), (0, 16.0 * k as f64, 31.0));
        assert_eq!((point.normal, point.tangent()), ([0.0, -1.0], [1.0, 0.0]));
    }
    // The upper strip moves up by 3 px and 0.5 px further to the right.
    let upper = field(mesh.clone(), |zone, [x, _]| [[0.1 * x + 0.5, 7.0 - 3.0], [0.1 * x, 7.0]][zone]);
    assert_jumps(&upper, &facing, |_| [3.0, 0.5], 1e-12);
    // From below, the other zone is `+`: the opening is the same, and so is the sliding (both ways are turned).
    let from_below = Facing::between(&mesh, "z1", "z0").unwrap();
    assert_jumps(&upper, &from_below, |_| [3.0, 0.5], 1e-12);
    assert_eq!(from_below.points()[0].normal, [0.0, 1.0]);
    let noise = noise_of(&upper);
    let mean = facing.mean(&upper, &noise).unwrap();
    assert_near(mean.opening.value, 3.0, 1e-12, "mean");
    // 12 nodes on two sides, values with 1.12 times the noise of their coefficients here, neighbours with negative
    // correlation: better than independent ones.
    assert!(mean.opening.sigma < 0.0158 / 12f64.sqrt() && mean.opening.sigma > 0.001, "{mean:?}");
}

#[test]
fn only_what_overlaps_faces() {
    // The lower zone is shifted and its nodes stand between those of the upper one.
    let mesh = grid(&[[16.0, 16.0, 192.0, 96.0], [90.0, 110.0, 330.0, 190.0]]);
    let facing = Facing::between(&mesh, "z0", "z1").unwrap();
    let x: Vec<f64> = facing.points().iter().map(|point| point.at[0]).collect();
    assert_eq!(x, [96.0, 112.0, 128.0, 144.0, 160.0, 176.0, 192.0]);
    let jump = field(mesh, |zone, [x, _]| [[0.0, -0.01 * x], [0.0, 0.02 * x]][zone]);
    assert_jumps(&jump, &facing, |[x, _]| [0.03 * x, 0.0], 1e-12);
}

#[test]
fn vertical_slanted_and_curved_joints_have_their_normals() {
    let vertical = grid(&[[120.0, 16.0, 200.0, 96.0], [16.0, 16.0, 96.0, 96.0]]);
    let facing = Facing::between(&vertical, "z0", "z1").unwrap();
    assert_eq!(facing.points().len(), 6);
    assert!(facing.points().iter().all(|point| point.normal == [1.0, 0.0] && point.tangent() == [0.0, 1.0]));
    let right = field(vertical, |zone, _| [[2.0, 0.25], [0.0, 0.0]][zone]);
    assert_jumps(&right, &facing, |_| [2.0, 0.25], 1e-12);

    // Two strips on either side of a joint turned by 25 degrees, y down.
    let (sin, cos) = 25f64.to_radians().sin_cos();
    let turned = |x: f64, y: f64| [100.0 + cos * x - sin * y, 50.0 + sin * x + cos * y];
    let slanted = Mesh::from_zones(vec![
        mapped("upper", [8, 3], |s, t| turned(120.0 * s, 45.0 * t)),
        mapped("lower", [7, 3], |s, t| turned(120.0 * s, 60.0 + 45.0 * t)),
    ])
    .unwrap();
    let facing = Facing::between(&slanted, "upper", "lower").unwrap();
    assert_eq!(facing.points().len(), 9);
    for point in facing.points() {
        assert_near(point.normal[0], sin, 1e-9, "normal");
        assert_near(point.normal[1], -cos, 1e-9, "normal");
        assert_near(point.gap, 15.0, 1e-9, "gap");
    }
    let moved = field(slanted, |zone, _| [[3.0 * sin + 0.5 * cos, -3.0 * cos + 0.5 * sin], [0.0; 2]][zone]);
    assert_jumps(&moved, &facing, |_| [3.0, 0.5], 1e-9);

    // Two rings: the inner one shrinks, so the outer one is `+` and the joint opens by 1 px everywhere. It is closed.
    let ring = |name: &str, n: usize, from: f64, to: f64| {
        let around = std::f64::consts::TAU;
        let mut ring = mapped(name, [n, 2], |s, t| {
            let (r, angle) = (from + (to - from) * t, -around * s);
            [200.0 + r * angle.cos(), 200.0 + r * angle.sin()]
        });
        // The last column is the first.
        let row = n as u32 + 1;
        ring.elements.iter_mut().flatten().filter(|node| **node % row == row - 1).for_each(|node| *node -= row - 1);
        let used: Vec<u32> = (0..ring.nodes.len() as u32).filter(|node| node % row != row - 1).collect();
        let place: BTreeMap<u32, u32> = used.iter().zip(0..).map(|(&node, k)| (node, k)).collect();
        ring.elements.iter_mut().flatten().for_each(|node| *node = place[node]);
        ring.nodes = used.iter().map(|&node| ring.nodes[node as usize]).collect();
        ring
    };
    let rings = Mesh::from_zones(vec![ring("outer", 60, 120.0, 150.0), ring("inner", 50, 60.0, 90.0)]).unwrap();
    let facing = Facing::between(&rings, "outer", "inner").unwrap();
    assert_eq!(facing.points().len(), 60);
    let shrunk = field(rings, |zone, x| {
        let r = (x[0] - 200.0).hypot(x[1] - 200.0);
        if zone == 1 { [-(x[0] - 200.0) / r, -(x[1] - 200.0) / r] } else { [0.0; 2] }
    });
    // Polygons of 50 sides: the sagitta of the displacement and of the normals is below 1 % of the jump.
    assert_jumps(&shrunk, &facing, |_| [1.0, 0.0], 0.01);
    for point in facing.points() {
        let out = [point.at[0] - 200.0, point.at[1] - 200.0];
        let r = out[0].hypot(out[1]);
        assert!((out[0] * point.normal[0] + out[1] * point.normal[1]) / r > 0.999, "{point:?}");
    }
}

#[test]
fn stairs_of_a_cut_grid_face_along_the_mean_direction() {
    // Elements on either side of the line y = 200 - (x - 200)/2 (upper) and 40 px below it.
    let grid = |name: &str, keep: &dyn Fn(f64, f64) -> bool| {
        let mut nodes: Vec<[f64; 2]> = Vec::new();
        let mut number = BTreeMap::new();
        let mut elements = Vec::new();
        for j in 0..24 {
            for i in 0..24 {
                let (x, y) = (16.0 * i as f64, 16.0 * j as f64);
                if keep(x + 8.0, y + 8.0) {
                    elements.push([(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                        *number.entry((i, j)).or_insert_with(|| {
                            nodes.push([16.0 * i as f64, 16.0 * j as f64]);
                            nodes.len() as u32 - 1
                        })
                    }));
                }
            }
        }
        ZoneElements { name: name.into(), nodes, elements }
    };
    let line = |x: f64| 200.0 - 0.5 * (x - 200.0);
    let mesh: Mesh<Px> =
        Mesh::from_zones(vec![grid("upper", &|x, y| y < line(x) - 20.0), grid("lower", &|x, y| y > line(x) + 20.0)])
            .unwrap();
    let facing = Facing::between(&mesh, "upper", "lower").unwrap();
    assert!(facing.points().len() > 20, "{}", facing.points().len());
    assert_eq!(facing.points().last().unwrap().part, 0);
    // The joint rises to the right: its normal is that of the line but for some stairs at the ends.
    let normal = [-0.447, -0.894];
    let cosines: Vec<f64> = facing.points().iter().map(|p| p.normal[0] * normal[0] + p.normal[1] * normal[1]).collect();
    assert!(cosines.iter().all(|cosine| *cosine > 0.97), "{cosines:?}");
    assert!(cosines.iter().filter(|cosine| **cosine > 0.995).count() > facing.points().len() / 2, "{cosines:?}");
    assert!(facing.points().windows(2).all(|two| two[1].along > two[0].along && two[1].at[0] > two[0].at[0] - 8.0));
    assert!(facing.points().iter().all(|point| point.gap > 15.0 && point.gap < 75.0));
}

#[test]
fn zones_that_do_not_see_each_other_have_no_joint() {
    let refused = |mesh: &Mesh<Px>, plus, minus| Facing::between(mesh, plus, minus).unwrap_err();
    // Diagonal neighbours, and a zone between.
    let diagonal = grid(&[[16.0, 16.0, 96.0, 96.0], [120.0, 120.0, 200.0, 200.0]]);
    assert!(matches!(refused(&diagonal, "z0", "z1"), QuantityError::NotFacing { .. }));
    let stacked = grid(&[[16.0, 16.0, 96.0, 96.0], [10.0, 110.0, 106.0, 190.0], [16.0, 210.0, 96.0, 290.0]]);
    assert!(matches!(refused(&stacked, "z0", "z2"), QuantityError::NotFacing { .. }));
    assert!(Facing::between(&stacked, "z0", "z1").is_ok());
    assert_eq!(refused(&stacked, "z1", "z1"), QuantityError::OneZone { zone: "z1".into() });
    let error = refused(&stacked, "z1", "top");
    assert!(matches!(error, QuantityError::NoSuchZone { .. }) && error.to_string().contains("z0, z1, z2"), "{error}");
}

#[test]
fn a_joint_around_corners_is_cut_there() {
    // A zone like a clamp around another: they face on three sides.
    let hook = {
        let mut hook = mapped("hook", [10, 10], |s, t| [16.0 + 160.0 * s, 16.0 + 160.0 * t]);
        hook.elements.retain(|element| {
            let [x, y] = hook.nodes[element[0] as usize];
            x < 40.0 || !(40.0..140.0).contains(&y)
        });
        let used: std::collections::BTreeSet<u32> = hook.elements.iter().flatten().copied().collect();
        let place: BTreeMap<u32, u32> = used.iter().zip(0..).map(|(&node, k)| (node, k)).collect();
        hook.elements.iter_mut().flatten().for_each(|node| *node = place[node]);
        hook.nodes = used.iter().map(|&node| hook.nodes[node as usize]).collect();
        hook
    };
    let block = mapped("block", [6, 3], |s, t| [80.0 + 96.0 * s, 64.0 + 48.0 * t]);
    let facing = Facing::between(&Mesh::<Px>::from_zones(vec![block, hook]).unwrap(), "block", "hook").unwrap();
    let normals: Vec<[f64; 2]> = facing.points().iter().map(|point| point.normal).collect();
    for wanted in [[0.0, -1.0], [0.0, 1.0], [1.0, 0.0]] {
        let near = |n: &&[f64; 2]| n[0] * wanted[0] + n[1] * wanted[1] > 0.99;
        assert!(normals.iter().filter(near).count() > 2, "{wanted:?} is missing in {normals:?}");
    }
    assert_eq!(facing.points().last().unwrap().part, 2);
}

#[test]
fn a_region_of_a_linear_field_has_its_strain_and_the_displacement_of_its_middle() {
    let field = field(grid(&[[16.0, 16.0, 208.0, 144.0]]), |_, [x, y]| [0.01 * x + 0.02 * y, 0.5 - 0.003 * y]);
    let noise = noise_of(&field);
    let read = |region: Region| region.read(&field, &noise, StrainDefinition::Infinitesimal).unwrap();
    let of = read(Region::within(vec![[40.0, 30.0], [136.0, 30.0], [136.0, 94.0], [40.0, 94.0]]).unwrap());
    let near = |a: f64, b: f64, what: &str| assert!((a - b).abs() < 1e-10, "{what}: {a}, {b}");
    near(of.at[0], 88.0, "x");
    near(of.at[1], 62.0, "y");
    near(of.measured, 1.0, "share");
    near(of.mean.displacement[0], 0.88 + 1.24, "ux");
    near(of.mean.displacement[1], 0.5 - 0.186, "uy");
    for (k, exact) in [0.01, -0.003, 0.01].into_iter().enumerate() {
        let (strain, varies) = (of.mean.strain.unwrap().0.components()[k], of.strain.unwrap()[k]);
        near(strain, exact, "strain");
        near(varies.least, exact, "least");
        near(varies.largest, exact, "largest");
        near(varies.deviation, 0.0, "spread");
    }
    // Of a rectangle each direction gives its slope times the side over sqrt(12), but for the lattice of 4 px.
    let exact = (0.01f64 * 96.0).hypot(0.02 * 64.0) / 12f64.sqrt();
    assert!((of.spread[0] / exact - 1.0).abs() < 3e-3, "{} {exact}", of.spread[0]);
    // The mean of 192 x 128 px is known far better than a node.
    let whole = read(Region::of_zone(0));
    assert!(whole.mean.sigma[0] < 0.1 * 0.01 && whole.measured == 1.0, "{:?}", whole.mean.sigma);
    near(whole.at[0], 112.0, "middle of the zone");
    // Half beside the mesh: the mean is of what is measured, and the share says so.
    let half = read(Region::within(vec![[144.0, 32.0], [272.0, 32.0], [272.0, 96.0], [144.0, 96.0]]).unwrap());
    near(half.measured, 0.5, "share");
    near(half.at[0], 176.0, "x of the half");
    let beside = Region::within(vec![[300.0, 30.0], [360.0, 30.0], [360.0, 90.0]]).unwrap();
    assert_eq!(beside.read(&field, &noise, StrainDefinition::Infinitesimal), None);
}

#[test]
fn wrong_quantities_are_refused() {
    let says = |error: QuantityError, wanted: &str| assert!(error.to_string().contains(wanted), "{error}");
    says(Segment::new([0.0, f64::NAN], [1.0, 1.0], 1.0).unwrap_err(), "a coordinate of a line is NaN");
    says(Segment::new([0.0; 2], [1.0, 1.0], 0.0).unwrap_err(), "the step of a line is 0; give a finite number above 0");
    says(Segment::new([3.0, 4.0], [3.0, 4.0], 1.0).unwrap_err(), "a line from (3, 4) px to the same point");
    says(Segment::new([0.0; 2], [1e9, 1.0], 1.0).unwrap_err(), "more than 100000 points");
    says(Extensometer::new([0.0; 2], [0.0; 2], 0.0).unwrap_err(), "an extensometer from (0, 0) px to the same point");
    says(Extensometer::new([0.0; 2], [1.0, 0.0], -1.0).unwrap_err(), "the width of an extensometer is -1");
    says(Extensometer::new([0.0; 2], [f64::INFINITY, 0.0], 1.0).unwrap_err(), "is inf");
    says(Region::within(vec![[0.0; 2], [1.0, 1.0], [2.0, 2.0]]).unwrap_err(), "a region has no area");
    says(Region::within(vec![[0.0, f64::NAN], [1.0, 1.0], [2.0, 0.0]]).unwrap_err(), "a coordinate of a region is NaN");
    let error = "each".parse::<RemoveRigid>().unwrap_err().to_string();
    assert!(error.contains("`each`") && error.contains("all or zone"), "{error}");
}

/// Errors over their printed standard uncertainty.
#[derive(Default)]
struct Calibration(BTreeMap<String, [f64; 3]>);

impl Calibration {
    fn add(&mut self, what: &str, error: f64, sigma: f64) {
        let [squares, variances, n] = self.0.entry(what.to_owned()).or_default();
        *squares += error * error;
        *variances += sigma * sigma;
        *n += 1.0;
    }

    fn add_value(&mut self, what: &str, value: Value, exact: f64) {
        self.add(what, value.value - exact, value.sigma);
    }

    /// Checks that predicted and found standard deviation agree to `share`, or to three statistical errors.
    #[track_caller]
    fn assert_within(&self, share: f64) {
        for (what, [squares, variances, n]) in &self.0 {
            let ratio = (variances / squares).sqrt();
            let found = (squares / n).sqrt();
            println!("{what}: scatter {found:.3e}, printed {ratio:.3} of it ({n} values)");
            let tolerance = share.max(3.0 / (2.0 * n).sqrt());
            assert!((ratio - 1.0).abs() <= tolerance, "{what}: printed uncertainty {ratio} of the scatter, {n} values");
        }
    }
}

#[test]
fn printed_uncertainty_of_quantities_is_their_scatter() {
    const SIDE: usize = 640;
    const NOISE: f32 = 2.0;
    const ELEMENTS: f64 = 6.0;
    let pitch = ELEMENTS * 16.0 + 8.0;
    let corners: Vec<[f64; 2]> =
        (0..6).flat_map(|j| (0..6).map(move |i| [8.0 + pitch * f64::from(i), 8.0 + pitch * f64::from(j)])).collect();
    let end = ELEMENTS * 16.0;
    let zones: Vec<_> =
        corners.iter().enumerate().map(|(k, &[x, y])| zone(&k.to_string(), [x, y, x + end, y + end])).collect();
    let options: RenderOptions = float(SIDE, SIDE);
    let picture = Arc::new(render(&Texture::new(2024, 3.2).unwrap(), &REST, &options).unwrap());
    let mut found = Calibration::default();
    for seed in 0..8 {
        let noise = Some(f64::from(NOISE));
        let correlator =
            prepared(&noisy(&picture, NOISE, 2 * seed), &zones, Options { noise: noise.into(), ..Options::default() });
        let field = solved(&correlator, &noisy(&picture, NOISE, 2 * seed + 1));
        let noise = noise_of(&field);
        for (zone, &[x, y]) in corners.iter().enumerate() {
            let part = [[8.0, 20.0], [80.0, 20.0], [60.0, 76.0], [8.0, 76.0]].map(|[a, b]| [x + a, y + b]);
            let part = Region::within(part.to_vec()).unwrap();
            for (what, region) in [("zone", Region::of_zone(zone)), ("part of a zone", part)] {
                let region = region.read(&field, &noise, StrainDefinition::GreenLagrange).unwrap();
                assert_eq!(region.measured, 1.0);
                let (strain, sigma) = region.mean.strain.unwrap();
                (0..2).for_each(|c| {
                    found.add(&format!("mean, {what}"), region.mean.displacement[c], region.mean.sigma[c]);
                });
                (0..3).for_each(|k| found.add(&format!("mean strain {k}, {what}"), strain.components()[k], sigma[k]));
            }
            let at = |what: &str, [dx, dy]: [f64; 2]| {
                let there = at_point(&field, &noise, StrainDefinition::GreenLagrange, [x + dx, y + dy]).unwrap();
                (what.to_owned(), there)
            };
            let places = [
                at("node", [48.0, 48.0]),
                at("middle of an edge", [40.0, 48.0]),
                at("centre of an element", [40.0, 40.0]),
                at("node on the border", [48.0, 0.0]),
                at("corner", [0.0, 0.0]),
            ];
            for (what, PointValues { displacement, sigma, strain, .. }) in places {
                (0..2).for_each(|c| found.add(&format!("displacement, {what}"), displacement[c], sigma[c]));
                let (strain, sigma) = strain.unwrap();
                // On a border exx and eyy differ: along and across.
                for (k, name) in ["exx", "eyy", "exy"].into_iter().enumerate() {
                    found.add(&format!("{name}, {what}"), strain.components()[k], sigma[k]);
                }
            }
            for (width, what) in [(0.0, "extensometer"), (40.0, "extensometer, gauge lines")] {
                for (from, to) in [([24.0, 50.0], [72.0, 50.0]), ([45.0, 24.0], [45.0, 70.0])] {
                    let moved = |[dx, dy]: [f64; 2]| [x + dx, y + dy];
                    let read = Extensometer::new(moved(from), moved(to), width).unwrap().read(&field, &noise).unwrap();
                    found.add_value(what, read.engineering, 0.0);
                }
            }
        }
    }
    // The requirement for printed uncertainties; more where corners make few values.
    found.assert_within(0.1);
}

#[test]
fn invariants_and_rotation_scatter_about_those_of_the_deformation_gradient_by_what_is_printed() {
    const SIDE: usize = 640;
    const NOISE: f32 = 2.0;
    let gradient: [[f64; 2]; 2] = [[0.015, 0.010], [-0.006, -0.012]];
    // C = F^T F = U^2 and R = F U^-1, by the closed forms of 2 x 2: principal strains apart by 60 times their noise.
    let f = [[1.0 + gradient[0][0], gradient[0][1]], [gradient[1][0], 1.0 + gradient[1][1]]];
    let c = |i: usize, j: usize| f[0][i] * f[0][j] + f[1][i] * f[1][j];
    let (half_trace, det) = (0.5 * (c(0, 0) + c(1, 1)), c(0, 0) * c(1, 1) - c(0, 1) * c(0, 1));
    let root = (half_trace * half_trace - det).sqrt();
    let [e1, e2] = [root, -root].map(|root| 0.5 * (half_trace + root - 1.0));
    let direction = c(0, 1).atan2(half_trace + root - c(1, 1)).to_degrees();
    let u = [[c(0, 0) + det.sqrt(), c(0, 1)], [c(0, 1), c(1, 1) + det.sqrt()]];
    // R is F times the adjugate of U, but for a factor.
    let rotation = (f[1][0] * u[1][1] - f[1][1] * u[1][0]).atan2(f[0][0] * u[1][1] - f[0][1] * u[1][0]).to_degrees();
    let von_mises = (2.0 / 3.0 * (e1 * e1 + e2 * e2 + (e1 + e2).powi(2))).sqrt();
    let exact = [e1, e2, direction, 0.5 * (e1 - e2), von_mises, rotation];
    let motion = Affine::new(gradient, SIDE, SIDE);
    let texture = Texture::new(2024, 3.2).unwrap();
    let options: RenderOptions = float(SIDE, SIDE);
    let rest = Arc::new(render(&texture, &REST, &options).unwrap());
    let pulled = Arc::new(render(&texture, &motion, &options).unwrap());
    let zones = [zone("all", [24.0, 24.0, 616.0, 616.0])];
    let mut found = Calibration::default();
    for seed in 0..2 {
        let options = Options { noise: Some(f64::from(NOISE)).into(), ..Options::default() };
        let correlator = prepared(&noisy(&rest, NOISE, 2 * seed), &zones, options);
        let field = solved(&correlator, &noisy(&pulled, NOISE, 2 * seed + 1));
        let noise = noise_of(&field);
        let windows = StrainWindows::new(&field.mesh, StrainWindow::new(5).unwrap(), false);
        // Six elements apart noise has nothing in common.
        for at in (0..36).map(|k| [72.0 + 96.0 * f64::from(k % 6), 72.0 + 96.0 * f64::from(k / 6)]) {
            let there = at_point(&field, &noise, StrainDefinition::GreenLagrange, at).unwrap();
            let names = ["e1", "e2", "direction", "shear_max", "von_mises", "rotation"];
            let values = there.invariants.unwrap().into_iter().chain(there.rotation_deg);
            for ((name, value), exact) in names.into_iter().zip(values).zip(exact) {
                found.add_value(name, value, exact);
            }
            let [x, y] = exact_at(&motion, &[at])[0];
            found.add_value("magnitude", there.magnitude, x.hypot(y));
            let points = vec![("at".to_owned(), at)];
            let over = Quantities { points, ..Quantities::default() }.draw(&field, &noise, Some(&windows)).points[0];
            for ((name, value), exact) in names.into_iter().zip(over.unwrap().window_invariants.unwrap()).zip(exact) {
                found.add_value(&format!("{name} over a window"), value, exact);
            }
        }
    }
    found.assert_within(0.1);
}

#[test]
fn openings_of_a_peeling_joint_are_the_truth_within_their_uncertainty() {
    const NOISE: f32 = 2.0;
    let (width, height) = (640, 400);
    let options = RenderOptions { noise: NOISE, ..RenderOptions::new(width, height) };
    // Whole elements, three pixels away from the dark band.
    let middle = 0.5 * (height as f64 - 1.0);
    let (above, below) = ((middle - 18.5).floor(), (middle + 18.5).ceil());
    let zones =
        [zone("upper", [16.0, above - 160.0, 624.0, above]), zone("lower", [16.0, below, 624.0, below + 160.0])];
    let mut found = Calibration::default();
    let mut bias = [0.0; 2];
    let mut n = 0.0;
    for seed in 0..16 {
        let texture = Texture::new(100 + seed, SPECKLE_PX).unwrap();
        let options = RenderOptions { seed, ..options };
        let peel = Peel::new(width, height);
        let image = |frame: u64, motion: &Peel| {
            Arc::new(render(&texture, motion, &RenderOptions { frame, ..options }).unwrap())
        };
        let correlator = prepared(&image(0, &peel.at(0.0)), &zones, Options::default());
        let facing = Facing::between(correlator.mesh(), "upper", "lower").unwrap();
        assert_eq!(facing.points().len(), 39);
        for (frame, fraction) in [(1, 0.0), (2, 0.3), (3, 0.6)] {
            let motion = peel.at(fraction);
            let field = solved(&correlator, &image(frame, &motion));
            let noise = noise_of(&field);
            let (mut opening, mut sliding) = (0.0, 0.0);
            for point in facing.points() {
                let jump = point.read(&field, &noise).unwrap();
                let face = |body: usize, side: f64| {
                    motion
                        .body_displacement(body, [0, 1].map(|c| point.at[c] + side * 0.5 * point.gap * point.normal[c]))
                };
                let (up, down) = (face(0, 1.0), face(1, -1.0));
                // y is down: the joint opens when the upper strip moves up.
                let exact = [down[1] - up[1], up[0] - down[0]];
                found.add_value("opening", jump.opening, exact[0]);
                found.add_value("sliding", jump.sliding, exact[1]);
                opening += exact[0] / 39.0;
                sliding += exact[1] / 39.0;
                bias[0] += jump.opening.value - exact[0];
                bias[1] += jump.sliding.value - exact[1];
                n += 1.0;
            }
            let mean = facing.mean(&field, &noise).unwrap();
            found.add_value("mean opening", mean.opening, opening);
            found.add_value("mean sliding", mean.sliding, sliding);
            if seed == 0 {
                println!(
                    "fraction {fraction}: mean opening {opening:.4} px exact, {:.4} +- {:.4}",
                    mean.opening.value, mean.opening.sigma
                );
            }
        }
    }
    println!("bias of opening and sliding: {:.4}, {:.4} px", bias[0] / n, bias[1] / n);
    found.assert_within(0.1);
    // 16 references with 39 points of 0.05 px: 0.002 px of statistics. Three pixels are left out beside the band.
    assert!(bias.iter().all(|bias| (bias / n).abs() < 0.006), "{bias:?}");
}

/// The tables that a series of two fields and one frame without field gives, and what is said about them.
fn tables(
    quantities: &Quantities,
    load: &LoadTable,
    fields: &[Option<&Measurement<Px>>],
    mm: bool,
) -> (BTreeMap<String, String>, Vec<Remark>, Vec<quadrille::field::Curve>) {
    let folder = tempfile::tempdir().unwrap();
    let open = |name: &str| std::fs::File::create(folder.path().join(name));
    let pixel_size = mm.then(|| PixelSize::new(0.01).unwrap());
    let plane = QuantityPlane { pixel_size, ..QuantityPlane::default() };
    let mut tables =
        QuantityTables::new(quantities, load, plane, false, 16.0, &["a test\nof two lines".into()], open).unwrap();
    for (number, field) in (1..).zip(fields) {
        let status = field.map_or(Status::Diverged, |field| field.status);
        tables.frame(number, Some(status), *field, None).unwrap();
    }
    let summary = tables.finish().unwrap();
    let files = std::fs::read_dir(folder.path()).unwrap().map(|entry| {
        let entry = entry.unwrap();
        (entry.file_name().into_string().unwrap(), std::fs::read_to_string(entry.path()).unwrap())
    });
    (files.collect(), summary.remarks, summary.curves)
}

/// The rows of a table as maps from column to cell.
fn rows(table: &str) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(table.as_bytes());
    reader.deserialize().map(|row| row.unwrap()).collect()
}

#[test]
fn tables_hold_every_frame_with_units_definitions_and_empty_cells() {
    let mesh = grid(&[[16.0, 16.0, 192.0, 96.0], [16.0, 127.0, 192.0, 207.0]]);
    let first = field(mesh.clone(), |zone, [x, _]| [[0.01 * x, -1.0], [0.01 * x, 1.0]][zone]);
    let mut second = field(mesh.clone(), |zone, [x, _]| [[0.02 * x, -2.0], [0.02 * x, 2.0]][zone]);
    second.measured[0] = false;
    let quantities = Quantities {
        strain: StrainDefinition::Hencky,
        points: vec![("inside".into(), [50.0, 50.0]), ("corner".into(), [24.0, 20.0]), ("gap".into(), [50.0, 110.0])],
        lines: vec![("down".into(), Segment::new([50.0, 90.0], [50.0, 130.0], 10.0).unwrap())],
        extensometers: vec![("along".into(), Extensometer::new([30.0, 50.0], [130.0, 50.0], 0.0).unwrap())],
        openings: vec![("joint".into(), Facing::between(&mesh, "z0", "z1").unwrap())],
        ..Quantities::default()
    };
    let load = parse_load("load_N,time_s\n10,1\n20,2\n,3\n", Path::new("l.csv"), 3).unwrap();
    let (files, remarks, curves) = tables(&quantities, &load, &[Some(&first), Some(&second), None], true);
    let names: Vec<_> = files.keys().map(String::as_str).collect();
    assert_eq!(names, ["extensometers", "lines", "openings", "openings_mean", "points"]);
    for (name, text) in &files {
        assert!(text.starts_with("# a test\n# of two lines\n"), "{name}: {text}");
        assert!(text.contains("y down") && text.contains("1 px = 0.01 mm") && !text.contains("NaN"), "{name}");
        let head = text.lines().find(|line| !line.starts_with('#')).unwrap();
        assert!(head.starts_with("frame,status,load_N,time_s,"), "{head}");
    }
    assert!(files["points"].contains("hencky") && files["points"].contains("tensor shear"));
    assert!(files["openings"].contains("positive when they move apart"));

    let points = rows(&files["points"]);
    assert_eq!(points.len(), 9);
    assert_eq!((points[0]["ux_px"].as_str(), points[0]["ux_mm"].as_str()), ("0.5", "0.005"));
    assert_eq!((points[0]["load_N"].as_str(), points[0]["status"].as_str()), ("10.0", "converged"));
    assert_near(points[0]["exx"].parse().unwrap(), 1.01f64.ln(), 1e-12, "strain");
    assert_near(points[1]["ux_px"].parse().unwrap(), 0.24, 1e-14, "the corner");
    assert!(points[4]["ux_px"].is_empty(), "the corner is lost");
    for row in [&points[2], &points[5], &points[6]] {
        assert!(row["ux_px"].is_empty() && row["exx"].is_empty() && row["sigma_exx"].is_empty(), "{row:?}");
        assert!(!row["x_px"].is_empty());
    }
    assert_eq!((points[6]["load_N"].as_str(), points[6]["time_s"].as_str()), ("", "3.0"));
    assert_eq!(points[6]["status"], "diverged");
    let lines = rows(&files["lines"]);
    assert_eq!(
        lines.iter().take(5).map(|row| row["uy_px"].is_empty()).collect::<Vec<_>>(),
        [false, true, true, true, false]
    );
    let lengths = rows(&files["extensometers"]);
    assert_near(lengths[1]["strain_engineering"].parse().unwrap(), 0.02, 1e-12, "strain");
    assert_near(lengths[1]["elongation_mm"].parse().unwrap(), 0.02, 1e-12, "elongation");
    let openings = rows(&files["openings"]);
    assert_eq!(openings.len(), 36);
    assert_eq!((openings[3]["opening_px"].as_str(), openings[3]["along_px"].as_str()), ("2.0", "48.0"));
    let means = rows(&files["openings_mean"]);
    assert_near(means[1]["opening_px"].parse().unwrap(), 4.0, 1e-12, "mean opening");
    assert_eq!(means[2]["opening_px"], "");

    assert!(remarks.iter().all(|remark| remark.code == Code::CellsEmpty), "{remarks:?}");
    assert!(remarks.iter().any(|remark| remark.about == About::Frames(vec![3])), "{remarks:?}");
    // Of two fields: the gap and the line have no value in either, the corner is lost in one.
    for (place, fields) in [("point 'gap' (50, 110) px", 2.0), ("point 'corner' (24, 20) px", 1.0)] {
        let of_place = |remark: &&Remark| remark.values.get("place") == Some(&place.into());
        let found = remarks.iter().find(of_place).unwrap_or_else(|| panic!("{place}: {remarks:?}"));
        assert_eq!(found.number("fields"), Some(fields), "{place}");
    }
    assert!(remarks.iter().any(|remark| remark.text.starts_with("line 'down'")), "{remarks:?}");
    let curve =
        curves.iter().find(|c| c.name == "joint" && c.quantity == "opening_px" && c.against == "load_N").unwrap();
    assert_eq!(curve.x, [10.0, 20.0]);
    assert!((curve.y[0] - 2.0).abs() < 1e-12 && (curve.y[1] - 4.0).abs() < 1e-12, "{curve:?}");
    assert!(curves.iter().all(|c| c.name != "gap" && c.x.len() == c.sigma.len()));
    // Without a load file the frame is the abscissa.
    let (_, _, curves) = tables(&quantities, &LoadTable::default(), &[Some(&first)], false);
    assert!(curves.iter().all(|curve| curve.against == "frame"));
    // At the reference, where all is zero, a curve begins; over a load where the file has that of the reference.
    assert!(curves.iter().all(|curve| curve.x == [0.0, 1.0] && curve.y[0] == 0.0 && curve.sigma[0] == 0.0));
    let with_rest = parse_load("load_N\n3\n10\n20\n30\n", Path::new("l.csv"), 3).unwrap();
    let (_, _, curves) = tables(&quantities, &with_rest, &[Some(&first), Some(&second), None], false);
    let opening = curves.iter().find(|c| c.name == "joint" && c.quantity == "opening_px").unwrap();
    assert_eq!((opening.x[0], opening.x[1], opening.y[0]), (3.0, 10.0, 0.0));
}

#[test]
fn profiles_and_removed_motions_are_there_for_pictures_and_tables() {
    let mesh = grid(&[[16.0, 16.0, 192.0, 96.0], [16.0, 127.0, 192.0, 207.0]]);
    let (sin, cos) = 3f64.to_radians().sin_cos();
    let turned = field(mesh.clone(), |zone, [x, y]| {
        let y = y + [-1.0, 1.0][zone]; // open by 2 px, then turned as a whole
        [cos * x - sin * y - x, sin * x + cos * y - (y - [-1.0, 1.0][zone])]
    });
    let quantities = Quantities {
        remove_rigid: Some(RemoveRigid::All),
        lines: vec![("across".into(), Segment::new([20.0, 60.0], [180.0, 60.0], 40.0).unwrap())],
        openings: vec![("joint".into(), Facing::between(&mesh, "z0", "z1").unwrap())],
        ..Quantities::default()
    };
    assert!(!quantities.is_empty() && Quantities::default().is_empty());
    let drawn = quantities.draw(&turned, &noise_of(&turned), None);
    let profiles = quantities.profiles(&drawn);
    let opening = profiles.iter().find(|curve| curve.quantity == "opening_px").unwrap();
    // Rotation of the gap by 3 degrees would show as 1.7 px of sliding.
    assert!(opening.y.iter().all(|v| (v - 2.0).abs() < 1e-9) && opening.x.len() == 12, "{opening:?}");
    let sliding = profiles.iter().find(|curve| curve.quantity == "sliding_px").unwrap();
    assert!(sliding.y.iter().all(|v| v.abs() < 1e-9), "{sliding:?}");
    assert_eq!(profiles.iter().filter(|curve| curve.name == "across").count(), 5);

    let (files, _, _) = tables(&quantities, &LoadTable::default(), &[Some(&turned)], false);
    let rigid = rows(&files["rigid_motions"]);
    assert_eq!(rigid[0]["zone"], "all");
    assert_near(rigid[0]["rotation_deg"].parse().unwrap(), 3.0, 1e-9, "rotation");
    let (files, _, _) = tables(
        &Quantities { remove_rigid: Some(RemoveRigid::Zone), ..Quantities::default() },
        &LoadTable::default(),
        &[Some(&turned)],
        true,
    );
    let rigid = rows(&files["rigid_motions"]);
    assert_eq!((rigid[0]["zone"].as_str(), rigid[1]["zone"].as_str()), ("z0", "z1"));
    assert!(rigid[1]["left_rms_px"].parse::<f64>().unwrap() < 1e-9);
}
