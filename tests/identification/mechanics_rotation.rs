//! Strips and joint that turn by any angle (THEORY 14): rotations that give nothing, patches, derivatives, small
//! rotations.

use crate::mechanics_common;
use mechanics_common::*;
use quadrille::linalg::LuChoice;
use quadrille::mechanics::cohesive::{CohesiveLaw, Jump, Traction, law_by_name};
use quadrille::mechanics::substrate::{LinearElastic, PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryHistory, ForwardOptions, JointMesh, Kinematics, Model, ModelOptions, Quadrature, Solution,
};
use std::sync::Arc;

const SIZE: f64 = 0.0309;
const GAP: f64 = 0.06;
const E: f64 = 72_000.0;

fn finite(quadrature: Quadrature) -> ModelOptions {
    ModelOptions { kinematics: Kinematics::Finite, quadrature, solver: LuChoice::Auto }
}

/// A number in -1..1 that depends on `k` alone.
fn scatter(k: usize) -> f64 {
    (0.5 + 1.7 * k as f64).sin() * (2.3 + 0.9 * k as f64).cos()
}

/// A joint that runs at an angle, with inner nodes out of place.
fn distorted(angle: f64) -> JointMesh {
    let mesh = JointMesh::rectangular(6, 3, SIZE, GAP).unwrap();
    let outer = mesh.outer_nodes();
    let pairs = mesh.pairs().to_vec();
    moved(&mesh, |k, [x, y]| {
        let pair = pairs.iter().position(|pair| pair.contains(&(k as u32)));
        let x = match pair {
            _ if outer.contains(&(k as u32)) => [x, y],
            Some(pair) => [x + 0.2 * SIZE * scatter(pair), y],
            None => [x + 0.2 * SIZE * scatter(2 * k), y + 0.2 * SIZE * scatter(2 * k + 1)],
        };
        rotated([x[0] + 0.3, x[1] - 0.1], angle)
    })
}

/// A joint along an arc.
fn arc() -> JointMesh {
    let mesh = JointMesh::rectangular(12, 3, SIZE, GAP).unwrap();
    moved(&mesh, |_, [x, y]| {
        let (radius, angle) = (0.5 + y, 2.0 - x / 0.5);
        [radius * angle.cos(), radius * angle.sin()]
    })
}

fn model(mesh: &JointMesh, quadrature: Quadrature) -> Model {
    Model::new(mesh.clone(), aluminium(mesh.groups().len()), &mesh.outer_nodes(), finite(quadrature)).unwrap()
}

/// The field after `u` that turns everything by `angle` about a point beside the joint.
fn turned(mesh: &JointMesh, u: &[[f64; 2]], angle: f64) -> Vec<[f64; 2]> {
    let turn = |(&[x, y], u): (&[f64; 2], &[f64; 2])| {
        let [a, b] = rotated([x + u[0] - 0.4, y + u[1] + 0.2], angle);
        [a + 0.6 - x, b - 0.1 - y]
    };
    mesh.nodes().iter().zip(u).map(turn).collect()
}

#[track_caller]
fn solve(model: &Model, law: &dyn CohesiveLaw, boundary: &BoundaryHistory) -> Solution {
    let options = ForwardOptions { law_sensitivities: true, ..ForwardOptions::default() };
    let solution = model.forward(law, boundary, &options).unwrap();
    for (k, instant) in solution.instants.iter().enumerate() {
        assert!(instant.status.converged(), "instant {}: {:?}", k + 1, instant.residuals);
    }
    solution
}

/// The border of `mesh` as each of `fields` has it.
fn border_of(mesh: &JointMesh, fields: &[Vec<[f64; 2]>]) -> BoundaryHistory {
    let nodes = mesh.outer_nodes();
    let at = |field: &Vec<[f64; 2]>| nodes.iter().map(|&node| field[node as usize]).collect();
    let instants = fields.iter().map(at).collect();
    BoundaryHistory::new(nodes, instants).unwrap()
}

/// A field that opens and slides the joint and bends its strips, times `factor`; largest rotation 0.04.
fn opened(mesh: &JointMesh, factor: f64) -> Vec<[f64; 2]> {
    let of = |(node, &[x, y]): (usize, &[f64; 2])| {
        let side = if mesh.strip()[node] == 0 { -1.0 } else { 1.0 };
        let bent = 0.5 * side * x * x + 0.01 * x;
        [factor * side * (0.003 - 0.06 * (x + 0.1) * (side * y).abs()), factor * (side * 0.003 + 0.1 * bent)]
    };
    mesh.nodes().iter().enumerate().map(of).collect()
}

/// Stress of both kinds and force, the largest of each: MPa, MPa, N/mm.
fn largest_of(model: &Model, law: &dyn CohesiveLaw, u: &[[f64; 2]]) -> [f64; 3] {
    let stress = model.stresses(u).iter().flatten().flat_map(|stress| stress.0).fold(0.0, |m: f64, s| m.max(s.abs()));
    let traction = |t: &Traction| t.normal.abs().max(t.tangential.abs());
    let traction = model.tractions(law, u).iter().map(traction).fold(0.0, f64::max);
    [stress, traction, largest(&model.forces(law, u))]
}

#[test]
fn a_rotation_by_any_angle_leaves_no_stress_no_traction_and_no_reaction() {
    let law = adhesive([1.0; 4]);
    for mesh in [distorted(0.0), distorted(0.7), arc()] {
        for quadrature in [Quadrature::NewtonCotes, Quadrature::Gauss] {
            let model = model(&mesh, quadrature);
            let still = vec![[0.0; 2]; mesh.nodes().len()];
            for degrees in [1.0_f64, 30.0, 170.0] {
                let u = turned(&mesh, &still, degrees.to_radians());
                let [stress, traction, force] = largest_of(&model, &law, &u);
                // Round-off of the positions (2 mm) over the size of an element, times the stiffness; 8 roundings.
                let strain = 8.0 * f64::EPSILON * 2.0 / (0.3 * SIZE);
                let allowed = [E * strain, 4e4 * 8.0 * f64::EPSILON * 2.0, E * strain * SIZE];
                assert!(stress < allowed[0], "{degrees}: {stress:e} MPa");
                assert!(traction < allowed[1], "{degrees}: {traction:e} MPa");
                assert!(force < allowed[2], "{degrees}: {force:e} N/mm");
            }
        }
    }
}

#[test]
fn a_loaded_joint_that_is_turned_keeps_stresses_and_tractions_and_its_forces_turn_along() {
    let law = adhesive([1.0; 4]);
    let mesh = distorted(0.3);
    let model = model(&mesh, Quadrature::NewtonCotes);
    let u = opened(&mesh, 1.0);
    let before = largest_of(&model, &law, &u);
    assert!(before[0] > 100.0 && before[1] > 20.0, "{before:?}");
    let forces = model.forces(&law, &u);
    for angle in [0.02, 0.5, 2.9] {
        let after = turned(&mesh, &u, angle);
        for (a, b) in model.tractions(&law, &u).iter().zip(model.tractions(&law, &after)) {
            assert_close(a.normal, b.normal, 1e-9, "normal traction");
            assert_close(a.tangential, b.tangential, 1e-9, "tangential traction");
        }
        for (a, b) in model.stresses(&u).iter().flatten().zip(model.stresses(&after).iter().flatten()) {
            (0..3).for_each(|k| assert_close(a.0[k], b.0[k], 1e-8, "stress"));
        }
        let turned: Vec<[f64; 2]> = forces.iter().map(|&force| rotated(force, angle)).collect();
        assert!(difference(&turned, &model.forces(&law, &after)) < 1e-9 * largest(&forces));
        // No forces nor moments come from nowhere, large jumps included.
        let mut sums = [0.0; 3];
        for (([x, y], u), [fx, fy]) in mesh.nodes().iter().zip(&after).zip(model.forces(&law, &after)) {
            sums = [sums[0] + fx, sums[1] + fy, sums[2] + (x + u[0]) * fy - (y + u[1]) * fx];
        }
        assert!(sums.iter().all(|sum| sum.abs() < 1e-10 * largest(&forces)), "{sums:?}");
    }
}

#[test]
fn a_border_that_turns_by_170_degrees_in_steps_takes_the_joint_along() {
    let mesh = distorted(0.2);
    let still = vec![[0.0; 2]; mesh.nodes().len()];
    let fields: Vec<Vec<[f64; 2]>> = (1..=17).map(|k| turned(&mesh, &still, f64::from(10 * k).to_radians())).collect();
    let model = model(&mesh, Quadrature::NewtonCotes);
    let law = adhesive([1.0; 4]);
    let solution = solve(&model, &law, &border_of(&mesh, &fields));
    let last = &solution.instants[16].displacement;
    assert!(difference(last, &fields[16]) < 1e-12, "{:e}", difference(last, &fields[16]));
    let [stress, traction, force] = largest_of(&model, &law, last);
    assert!(stress < 1e-7 && traction < 1e-7 && force < 1e-8, "{stress:e} {traction:e} {force:e}");
}

/// Green-Lagrange strain of the material under a second Piola-Kirchhoff stress, by its compliance (plane stress).
fn strain_under([x, y, shear]: [f64; 3]) -> [f64; 3] {
    let [young, nu, sigma_0, alpha, n] = [E, 0.33, 180.0, 0.06, 7.0];
    let q = (x * x - x * y + y * y + 3.0 * shear * shear).sqrt();
    let h = 1.5 * alpha / young * (q / sigma_0).powf(n - 1.0);
    let mean = (x + y) / 3.0;
    [
        (x - nu * y) / young + h * (x - mean),
        (y - nu * x) / young + h * (y - mean),
        2.0 * (1.0 + nu) / young * shear + 2.0 * h * shear,
    ]
}

/// The symmetric `U` with `U^2 = 2 E + I`.
fn stretch([xx, yy, gamma]: [f64; 3]) -> [[f64; 2]; 2] {
    let (a, b, c) = (1.0 + 2.0 * xx, 1.0 + 2.0 * yy, gamma);
    let s = (a * b - c * c).sqrt();
    let t = (a + b + 2.0 * s).sqrt();
    [[(a + s) / t, c / t], [c / t, (b + s) / t]]
}

#[test]
fn a_uniform_plastic_stress_and_a_uniform_jump_are_reproduced_at_any_rotation() {
    // Axes of the joint at rest: tangent, normal. In them F = U, turned by `angle`; the traction of the jump, seen from
    // the mid-line, is what U S n gives.
    let law = adhesive([1.0; 4]);
    let jump = Jump { normal: 0.0021, tangential: -0.0013 };
    let Traction { normal, tangential } = law.response(jump).traction;
    let mut stress = [230.0, normal, tangential];
    let (mut u, mut line) = ([[1.0, 0.0], [0.0, 1.0]], [1.0, 0.0]);
    for _ in 0..50 {
        u = stretch(strain_under(stress));
        let length = f64::hypot(u[0][0], u[1][0]);
        line = [u[0][0] / length, u[1][0] / length];
        let of_normal = [u[0][1], u[1][1]];
        let across = -line[1] * of_normal[0] + line[0] * of_normal[1];
        let along = line[0] * of_normal[0] + line[1] * of_normal[1];
        stress[1] = normal / across;
        stress[2] = (tangential - stress[1] * along) / length;
    }
    for joint in [0.0, 0.5] {
        for angle in [0.0, 0.5, 2.9] {
            for quadrature in [Quadrature::NewtonCotes, Quadrature::Gauss] {
                let mesh = distorted(joint);
                let apart = [GAP + jump.normal, jump.tangential];
                let apart = [apart[1] * line[0] - apart[0] * line[1], apart[1] * line[1] + apart[0] * line[0]];
                let field: Vec<[f64; 2]> = (0..mesh.nodes().len())
                    .map(|k| {
                        let at = mesh.nodes()[k];
                        let [x, y] = rotated(at, -joint);
                        let side = if mesh.strip()[k] == 1 { 0.5 } else { -0.5 };
                        let y = y - side * GAP;
                        let now =
                            [u[0][0] * x + u[0][1] * y + side * apart[0], u[1][0] * x + u[1][1] * y + side * apart[1]];
                        let now = rotated(now, joint + angle);
                        [now[0] - at[0], now[1] - at[1]]
                    })
                    .collect();
                let model = model(&mesh, quadrature);
                let forces = model.forces(&law, &field);
                let inner = (0..forces.len()).filter(|&node| model.unknown(node, 0).is_some());
                let residual = inner.map(|node| forces[node][0].hypot(forces[node][1])).fold(0.0, f64::max);
                let scale = largest(&forces);
                assert!(residual < 1e-11 * scale, "{joint} {angle} {quadrature:?}: {residual:e} of {scale}");
                for found in model.jumps(&field) {
                    assert_close(found.normal, jump.normal, 1e-14, "normal jump");
                    assert_close(found.tangential, jump.tangential, 1e-14, "tangential jump");
                }
                if angle == 0.0 {
                    // And it is what the iteration finds.
                    let steps: Vec<Vec<[f64; 2]>> =
                        (1..=4).map(|k| field.iter().map(|u| u.map(|u| 0.25 * f64::from(k) * u)).collect()).collect();
                    let found = solve(&model, &law, &border_of(&mesh, &steps));
                    let off = difference(&found.instants[3].displacement, &field) / largest(&field);
                    assert!(off < 1e-11, "{off:e}");
                }
            }
        }
    }
}

/// `(f(-2h), f(-h), f(h), f(2h))` put together.
fn five(fields: &[Vec<[f64; 2]>], h: f64) -> Vec<[f64; 2]> {
    let at = |n: usize, c: usize| {
        let u = |field: usize| fields[field][n][c];
        (8.0 * (u(2) - u(1)) - (u(3) - u(0))) / (12.0 * h)
    };
    (0..fields[0].len()).map(|n| [at(n, 0), at(n, 1)]).collect()
}

#[test]
fn the_tangent_of_a_turned_joint_is_the_difference_of_its_forces() {
    let bilinear = law_by_name("bilinear-benzeggagh-kenane", &[4e4, 60.0, 90.0, 0.4, 1.1, 1.7]).unwrap();
    for law in [Box::new(adhesive([1.0; 4])) as Box<dyn CohesiveLaw>, bilinear] {
        for quadrature in [Quadrature::NewtonCotes, Quadrature::Gauss] {
            let mesh = distorted(0.3);
            let model = model(&mesh, quadrature);
            let u = turned(&mesh, &opened(&mesh, 1.0), 0.8);
            let tangent = model.linearise(&*law, &u).unwrap();
            for seed in 0..3 {
                let direction: Vec<[f64; 2]> = (0..u.len())
                    .map(|n| [0, 1].map(|c| model.unknown(n, c).map_or(0.0, |_| scatter(100 * seed + 2 * n + c))))
                    .collect();
                let h = 1e-6;
                let at = |step: f64| {
                    let add = |(u, v): (&[f64; 2], &[f64; 2])| [0, 1].map(|c| u[c] + step * h * v[c]);
                    model.forces(&*law, &u.iter().zip(&direction).map(add).collect::<Vec<_>>())
                };
                let wanted = five(&[-2.0, -1.0, 1.0, 2.0].map(at), h);
                let columns: Vec<f64> = (0..u.len())
                    .filter(|&n| model.unknown(n, 0).is_some())
                    .map(|n| (model.unknown(n, 0).unwrap(), n))
                    .collect::<std::collections::BTreeMap<_, _>>()
                    .values()
                    .flat_map(|&n| direction[n])
                    .collect();
                let found = tangent.tangent().times(&columns);
                let scale = found.iter().fold(0.0_f64, |most, f| most.max(f.abs()));
                for (n, wanted) in wanted.iter().enumerate() {
                    for c in 0..2 {
                        let Some(place) = model.unknown(n, c) else { continue };
                        assert_close(found[place], wanted[c], 1e-8 * scale, format!("{} node {n}", law.name()));
                    }
                }
            }
        }
    }
}

/// A joint that is peeled: its arms turn against each other, by up to 0.15 rad at the right end, and the whole turns
/// too.
fn peeled() -> (JointMesh, BoundaryHistory) {
    let mesh = JointMesh::rectangular(16, 3, SIZE, GAP).unwrap();
    let length = 16.0 * SIZE;
    let fields: Vec<Vec<[f64; 2]>> = (1..=5)
        .map(|k| {
            let t = f64::from(k) / 5.0;
            let of = |(node, &[x, y]): (usize, &[f64; 2])| {
                let side = if mesh.strip()[node] == 0 { -1.0 } else { 1.0 };
                // Each strip on an arc about its middle.
                let middle = side * (0.5 * GAP + 1.5 * SIZE);
                let curvature = side * 0.15 * t / length;
                let angle = curvature * x;
                let (sin, cos) = angle.sin_cos();
                let [a, b] =
                    [sin / curvature - (y - middle) * sin, (1.0 - cos) / curvature + middle + (y - middle) * cos];
                let [a, b] = rotated([a + side * 0.006 * t, b + side * 0.001 * t], 0.3 * t);
                [a - x, b - y]
            };
            mesh.nodes().iter().enumerate().map(of).collect()
        })
        .collect();
    let boundary = border_of(&mesh, &fields);
    (mesh, boundary)
}

#[test]
fn sensitivities_of_a_joint_that_turns_are_differences_of_solutions() {
    let (mesh, boundary) = peeled();
    let law = adhesive([1.0; 4]);
    let values = [E, 0.33, 180.0, 0.06, 7.0];
    let build = |values: [f64; 5]| {
        let law: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(values, PlaneState::PlaneStress).unwrap());
        Model::new(mesh.clone(), vec![Arc::clone(&law), law], boundary.nodes(), finite(Quadrature::NewtonCotes))
            .unwrap()
    };
    let model = build(values);
    let options =
        ForwardOptions { law_sensitivities: true, substrate_sensitivities: true, ..ForwardOptions::default() };
    let solution = model.forward(&law, &boundary, &options).unwrap();
    assert!(solution.converged());
    let last = solution.instants.last().unwrap();
    let most = model.jumps(&last.displacement).iter().fold(0.0_f64, |m, jump| m.max(jump.normal));
    assert!(most > 0.02, "opens by {most} mm only");
    let end = |model: &Model, law: &dyn CohesiveLaw| solve(model, law, &boundary).instants.pop().unwrap().displacement;
    for (k, value) in law.values().into_iter().enumerate() {
        let h = 1e-3 * value;
        let fields = [-2.0, -1.0, 1.0, 2.0].map(|step| end(&model, &*with_value(&law, k, value + step * h)));
        let wanted = five(&fields, h);
        let off = difference(&last.sensitivities[k], &wanted) / largest(&wanted);
        assert!(off < 1e-8, "parameter {k} of the law: {off:e}");
    }
    for k in [0, 2, 4] {
        let h = 1e-3 * values[k];
        let fields = [-2.0, -1.0, 1.0, 2.0].map(|step| {
            let mut values = values;
            values[k] += step * h;
            end(&build(values), &law)
        });
        let wanted = five(&fields, h);
        // Of both groups at once.
        let both: Vec<[f64; 2]> = (last.sensitivities[4 + k].iter().zip(&last.sensitivities[9 + k]))
            .map(|(a, b)| [a[0] + b[0], a[1] + b[1]])
            .collect();
        let off = difference(&both, &wanted) / largest(&wanted);
        assert!(off < 1e-8, "parameter {k} of the material: {off:e}");
    }
    // The border moves: one column.
    let column: Vec<[f64; 2]> =
        boundary.nodes().iter().map(|&n| [scatter(n as usize), scatter(7 + n as usize)]).collect();
    let found = model.linearise(&law, &last.displacement).unwrap().by_boundary(std::slice::from_ref(&column)).remove(0);
    let h = 1e-7;
    let at = |step: f64| {
        let mut instants = boundary.instants().to_vec();
        for (u, v) in instants.last_mut().unwrap().iter_mut().zip(&column) {
            *u = [u[0] + step * h * v[0], u[1] + step * h * v[1]];
        }
        let boundary = BoundaryHistory::new(boundary.nodes().to_vec(), instants).unwrap();
        solve(&model, &law, &boundary).instants.pop().unwrap().displacement
    };
    let wanted = five(&[-2.0, -1.0, 1.0, 2.0].map(at), h);
    let off = difference(&found, &wanted) / largest(&wanted);
    assert!(off < 1e-7, "border: {off:e}");
}

#[test]
fn jumps_change_as_their_derivative_says_and_where_rotations_are_small_as_those_of_the_change() {
    let mesh = distorted(0.3);
    let u = turned(&mesh, &opened(&mesh, 1.0), 0.8);
    let by: Vec<[f64; 2]> = (0..u.len()).map(|n| [scatter(n), scatter(3 * n + 1)]).collect();
    let model = model(&mesh, Quadrature::NewtonCotes);
    let h = 1e-6;
    let at = |step: f64| {
        let add = |(u, v): (&[f64; 2], &[f64; 2])| [0, 1].map(|c| u[c] + step * h * v[c]);
        let jumps = model.jumps(&u.iter().zip(&by).map(add).collect::<Vec<_>>());
        jumps.into_iter().map(|jump| [jump.normal, jump.tangential]).collect::<Vec<_>>()
    };
    let wanted = five(&[-2.0, -1.0, 1.0, 2.0].map(at), h);
    for (found, wanted) in model.jump_changes(&u, &by).iter().zip(&wanted) {
        assert_close(found.normal, wanted[0], 1e-8, "normal");
        assert_close(found.tangential, wanted[1], 1e-8, "tangential");
    }
    for kinematics in [Kinematics::Paper, Kinematics::Objective] {
        let options = ModelOptions { kinematics, ..ModelOptions::default() };
        let small = Model::new(mesh.clone(), aluminium(2), &mesh.outer_nodes(), options).unwrap();
        assert_eq!(small.jump_changes(&u, &by), small.jumps(&by));
    }
}

#[test]
fn results_of_small_rotations_come_back_with_the_square_of_the_load() {
    let mesh = distorted(0.0);
    let elastic: Arc<dyn SubstrateLaw> = Arc::new(LinearElastic::new(E, 0.33, PlaneState::PlaneStress).unwrap());
    let law = adhesive([1.0; 4]);
    let off = |factor: f64| {
        let boundary = border_of(&mesh, &[opened(&mesh, factor)]);
        let [a, b] = [Kinematics::Objective, Kinematics::Finite].map(|kinematics| {
            let options = ModelOptions { kinematics, ..ModelOptions::default() };
            let materials = vec![Arc::clone(&elastic); mesh.groups().len()];
            let model = Model::new(mesh.clone(), materials, boundary.nodes(), options).unwrap();
            solve(&model, &law, &boundary).instants.pop().unwrap().displacement
        });
        difference(&a, &b)
    };
    let [large, small] = [off(0.02), off(0.002)];
    assert!(small > 0.0 && (80.0..120.0).contains(&(large / small)), "{large:e} {small:e}");
}

/// A peel test whose arms turn by `degrees`: `folder` gets the border and the measured displacements (mm, noise of 0.02
/// px) of a mesh of 24 x 4 elements in each strip, computed with finite rotations on one twice as fine.
#[cfg(feature = "cli")]
fn peel_files(folder: &std::path::Path, degrees: f64) {
    use rand::{RngExt, SeedableRng};
    let coarse = JointMesh::rectangular(24, 4, SIZE, GAP).unwrap();
    let (fine, _) = coarse.refined(2).unwrap();
    let (theta, width, pieces) = (degrees.to_radians(), 0.1, 200);
    let fields: Vec<Vec<[f64; 2]>> = (1..=6)
        .map(|k| {
            let front = 0.62 - 0.08 * f64::from(k);
            let of = |&[x, y]: &[f64; 2]| {
                let side = y.signum();
                let middle = side * (0.5 * GAP + 2.0 * SIZE);
                let angle = |x: f64| side * theta / (1.0 + (-(x - front) / width).exp());
                // The middle of the strip keeps its length; it is summed from the left end.
                let step = x / f64::from(pieces);
                let places = (0..pieces).map(|i| angle((f64::from(i) + 0.5) * step));
                let [a, b] = places.fold([0.0; 2], |[a, b], w| [a + step * w.cos(), b + step * w.sin()]);
                let (sin, cos) = angle(x).sin_cos();
                [a - (y - middle) * sin + side * 4e-4 * f64::from(k) - x, b + middle + (y - middle) * cos - y]
            };
            fine.nodes().iter().map(of).collect()
        })
        .collect();
    let boundary = border_of(&fine, &fields);
    let model = Model::new(fine.clone(), aluminium(2), boundary.nodes(), finite(Quadrature::NewtonCotes)).unwrap();
    let solution = solve(&model, &adhesive([1.0; 4]), &boundary);
    // Nodes keep their numbers in the finer mesh. A sum of twelve is normal enough.
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(17);
    let noise = || 0.02 * SIZE / 16.0 * ((0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0);
    let fields: Vec<Vec<[f64; 2]>> =
        solution.instants.iter().map(|instant| instant.displacement[..coarse.nodes().len()].to_vec()).collect();
    std::fs::write(folder.join("border.csv"), border_table(&coarse, &coarse.outer_nodes(), &fields)).unwrap();
    std::fs::write(folder.join("measured.csv"), measured_table(&fields, noise)).unwrap();
}

/// `fit.json` of the peel test with `kinematics`, and what the program said.
#[cfg(feature = "cli")]
#[track_caller]
fn fitted(folder: &std::path::Path, kinematics: &str) -> (serde_json::Value, String) {
    let noise = 0.02 * SIZE / 16.0;
    let case = format!(
        "[mesh]\nelement_size_mm = {SIZE}\ncolumns = 24\nrows = 4\ngap_mm = {GAP}\n[boundary]\nfile = \"border.csv\"\n\
         [substrate]\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\nexact = true\n\
         [cohesive]\nphi_n_N_per_mm = 1.2\ndelta_n_mm = 0.0045\ndelta_t_mm = 0.06\nr = 4.0\nexact = true\n\
         kinematics = \"{kinematics}\"\n\
         [measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\nweights = \"uniform\"\nboundary = \"exact\"\n\
         noise_mm = {noise}\ncommon_reference = false\n\
         [fit]\nparameters = [\"phi_n\", \"delta_n\", \"delta_t\"]\ndiscretisation = \"included\"\nintervals = \"linear\"\n\
         bootstrap = 0\nexact = [\"thickness\", \"faces\", \"pixel_size\", \"noise_level\"]\n"
    );
    let path = folder.join(format!("{kinematics}.toml"));
    std::fs::write(&path, case).unwrap();
    let out = folder.join(kinematics);
    let ran = std::process::Command::new(env!("CARGO_BIN_EXE_quadrille"))
        .args(["identify", path.to_str().unwrap(), "--output", out.to_str().unwrap()])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&ran.stderr).into_owned();
    let text = std::fs::read_to_string(out.join("fit.json")).unwrap_or_else(|_| panic!("{said}"));
    (serde_json::from_str(&text).unwrap(), said)
}

#[cfg(feature = "cli")]
#[test]
fn a_peel_test_is_identified_with_finite_rotations_and_small_ones_say_what_they_cost() {
    let folder = tempfile::tempdir().unwrap();
    peel_files(folder.path(), 2.0);
    let truth = [("phi_n", 1.0), ("delta_n", 0.005), ("delta_t", 0.05)];
    let (fit, said) = fitted(folder.path(), "finite");
    println!("{said}");
    for (name, truth) in truth {
        let p = &fit["parameters"][name];
        println!("finite {name}: {p}");
        let [low, high] = [0, 1].map(|k| number(&p["interval95"][k]));
        assert!(low < truth && truth < high, "{name}: {p}");
    }
    assert!(fit["change_by_finite_rotations"].is_null() && !said.contains("small rotations"), "{said}");
    let (fit, said) = fitted(folder.path(), "objective");
    println!("{said}");
    // The parameters are off by many standard uncertainties, the warning says so and points the right way.
    for (name, truth) in truth {
        let p = &fit["parameters"][name];
        println!("objective {name}: {p} change {}", fit["change_by_finite_rotations"][name]);
        if name == "phi_n" {
            let (off, std) = (truth - get(p, "value"), get(p, "std"));
            assert!(off.abs() > 3.0 * std, "{name}: {p}");
            let told = get(&fit["change_by_finite_rotations"], name);
            assert!(told * off > 0.0 && told.abs() > std, "{told} for {off}");
        }
    }
    assert!(said.contains("small rotations do not hold") && said.contains("phi_n by"), "{said}");
    let warned = fit["remarks"].as_array().unwrap().iter().any(|remark| remark["code"] == "rotations-matter");
    assert!(warned, "{}", fit["remarks"]);
    // Nobody reads that something is determined.
    let verdict = &fit["verdict"];
    assert!(verdict["outcome"] != "determined" && verdict["determined"] == false, "{verdict}");
    assert!(verdict["text"].as_str().unwrap().contains("small rotations do not hold"), "{verdict}");
}
