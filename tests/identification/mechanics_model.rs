//! The model of a joint by what must hold of it: patches, rigid motions, orders of convergence, refinement, regions
//! cut out of larger joints, derivatives, refusals.

use crate::mechanics_common;
use mechanics_common::*;
use quadrille::linalg::LuChoice;
use quadrille::mechanics::cohesive::{CohesiveLaw, Jump, Traction, XuNeedleman, law_by_name};
use quadrille::mechanics::substrate::{LinearElastic, PlaneState, RambergOsgood, Stress, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryFault, BoundaryHistory, ForwardOptions, JointMesh, JointParts, Kinematics, MeshFault, Model, ModelError,
    ModelOptions, Quadrature, Solution, Status,
};
use std::sync::Arc;

const SIZE: f64 = 0.0309;
const GAP: f64 = 0.06;

fn options(kinematics: Kinematics, quadrature: Quadrature) -> ModelOptions {
    ModelOptions { kinematics, quadrature, solver: LuChoice::Auto }
}

/// A number in -1..1 that depends on `k` alone.
fn scatter(k: usize) -> f64 {
    (0.5 + 1.7 * k as f64).sin() * (2.3 + 0.9 * k as f64).cos()
}

/// 6 columns, 3 rows per strip, inner nodes out of place, face nodes shifted along the joint.
fn distorted(angle: f64) -> JointMesh {
    let mesh = JointMesh::rectangular(6, 3, SIZE, GAP).unwrap();
    let outer = mesh.outer_nodes();
    let pairs = mesh.pairs().to_vec();
    moved(&mesh, |k, [x, y]| {
        let pair = pairs.iter().position(|pair| pair.contains(&(k as u32)));
        let x = if outer.contains(&(k as u32)) {
            [x, y]
        } else if let Some(pair) = pair {
            [x + 0.2 * SIZE * scatter(pair), y]
        } else {
            [x + 0.2 * SIZE * scatter(2 * k), y + 0.2 * SIZE * scatter(2 * k + 1)]
        };
        rotated([x[0] + 0.3, x[1] - 0.1], angle)
    })
}

/// Strain of the material under a stress in the plane, by its compliance (plane stress).
fn strain_under([x, y, shear]: [f64; 3], [young, nu, sigma_0, alpha, n]: [f64; 5]) -> [f64; 3] {
    let q = (x * x - x * y + y * y + 3.0 * shear * shear).sqrt();
    let h = 1.5 * alpha / young * (q / sigma_0).powf(n - 1.0);
    let mean = (x + y) / 3.0;
    let plastic = [h * (x - mean), h * (y - mean), 2.0 * h * shear];
    [
        (x - nu * y) / young + plastic[0],
        (y - nu * x) / young + plastic[1],
        2.0 * (1.0 + nu) / young * shear + plastic[2],
    ]
}

fn laws() -> Vec<Box<dyn CohesiveLaw>> {
    vec![
        Box::new(adhesive([1.0; 4])),
        Box::new(XuNeedleman::new(1.0, 0.005, 0.05, 4.0, 0.0).unwrap()),
        law_by_name("bilinear-benzeggagh-kenane", &[4e5, 60.0, 90.0, 0.4, 1.1, 1.7]).unwrap(),
    ]
}

#[track_caller]
fn solve(model: &Model, law: &dyn CohesiveLaw, boundary: &BoundaryHistory) -> Solution {
    let solution = model.forward(law, boundary, &ForwardOptions::default()).unwrap();
    for (k, instant) in solution.instants.iter().enumerate() {
        assert_eq!(instant.status, Status::Converged, "instant {}: {:?}", k + 1, instant.residuals);
    }
    solution
}

/// The field `of` at the nodes, in `steps` equal increments.
fn ramp(field: &[[f64; 2]], nodes: &[u32], steps: usize) -> BoundaryHistory {
    let at = |share: f64| nodes.iter().map(|&node| field[node as usize].map(|u| share * u)).collect();
    BoundaryHistory::new(nodes.to_vec(), (1..=steps).map(|k| at(k as f64 / steps as f64)).collect()).unwrap()
}

#[test]
fn a_uniform_plastic_stress_and_a_uniform_jump_are_reproduced_on_distorted_meshes_of_any_orientation() {
    // The exact solution: the stress that holds the traction of the jump, a linear field in each strip.
    let aluminium = [72000.0, 0.33, 180.0, 0.06, 7.0];
    for law in laws() {
        for angle in [0.0, 0.5, -2.0] {
            for quadrature in [Quadrature::NewtonCotes, Quadrature::Gauss] {
                let mesh = distorted(angle);
                let jump = Jump { normal: 0.0021, tangential: -0.0013 };
                let Traction { normal, tangential } = law.response(jump).traction;
                // In the axes of the joint (tangent, normal), with a stress along it that makes the strips yield.
                let strain = strain_under([230.0, normal, tangential], aluminium);
                let field: Vec<[f64; 2]> = (0..mesh.nodes().len())
                    .map(|k| {
                        let [x, y] = rotated(mesh.nodes()[k], -angle);
                        let side = if mesh.strip()[k] == 1 { 0.5 } else { -0.5 };
                        let u = [
                            strain[0] * x + 0.5 * strain[2] * y + side * jump.tangential,
                            0.5 * strain[2] * x + strain[1] * y + side * jump.normal,
                        ];
                        // The gap itself stretches by nothing: its share of the linear field is taken off.
                        let gap = side * GAP;
                        rotated([u[0] - 0.5 * strain[2] * gap, u[1] - strain[1] * gap], angle)
                    })
                    .collect();
                // The jump of the paper sees the face displacements as they are.
                let model = Model::new(
                    mesh.clone(),
                    aluminium_of(aluminium),
                    &mesh.outer_nodes(),
                    options(Kinematics::Paper, quadrature),
                )
                .unwrap();
                let solution = solve(&model, &*law, &ramp(&field, &mesh.outer_nodes(), 4));
                let found = &solution.instants[3].displacement;
                let off = difference(found, &field) / largest(&field);
                assert!(off < 1e-11, "{} at {angle}, {quadrature:?}: {off:e}", law.name());
                for stresses in model.stresses(found) {
                    for Stress([x, y, shear]) in stresses {
                        let (sin, cos) = angle.sin_cos();
                        let along = cos * cos * x + sin * sin * y + 2.0 * sin * cos * shear;
                        assert_close(along, 230.0, 1e-7, "stress along the joint");
                    }
                }
                for found in model.jumps(found) {
                    assert_close(found.normal, jump.normal, 1e-12, "normal jump");
                    assert_close(found.tangential, jump.tangential, 1e-12, "tangential jump");
                }
            }
        }
    }
}

fn aluminium_of(values: [f64; 5]) -> Vec<Arc<dyn SubstrateLaw>> {
    let law: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(values, PlaneState::PlaneStress).unwrap());
    vec![law; 2]
}

/// A mesh whose joint is an arc about the origin.
fn arc() -> JointMesh {
    let mesh = JointMesh::rectangular(12, 3, SIZE, GAP).unwrap();
    moved(&mesh, |_, [x, y]| {
        let (radius, angle) = (0.5 + y, 2.0 - x / 0.5);
        [radius * angle.cos(), radius * angle.sin()]
    })
}

#[test]
fn a_translation_gives_no_jump_and_no_force_and_a_rotation_only_what_the_kinematics_say() {
    let rotation = 0.003;
    for (mesh, is_arc) in [(distorted(0.0), false), (distorted(0.7), false), (arc(), true)] {
        for quadrature in [Quadrature::NewtonCotes, Quadrature::Gauss] {
            for kinematics in [Kinematics::Paper, Kinematics::Objective] {
                let model =
                    Model::new(mesh.clone(), aluminium(2), &mesh.outer_nodes(), options(kinematics, quadrature))
                        .unwrap();
                let law = adhesive([1.0; 4]);
                let shift = vec![[0.013, -0.021]; mesh.nodes().len()];
                // Every sum of an element cancels up to its round-off: E eps |u|.
                let floor = 100.0 * 72000.0 * f64::EPSILON * 0.02;
                assert!(largest(&model.forces(&law, &shift)) < floor);
                for jump in model.jumps(&shift) {
                    assert!(jump.normal.abs() + jump.tangential.abs() < 1e-16);
                }
                let turned: Vec<[f64; 2]> = mesh.nodes().iter().map(|&[x, y]| [-rotation * y, rotation * x]).collect();
                let slide = if kinematics == Kinematics::Paper { -rotation * mesh.gap() } else { 0.0 };
                // On the arc the normals of the chords lean by up to 0.031 against the line between the pairs: so does
                // what the jump of the paper makes of a rotation.
                let lean = if is_arc { 0.04 * slide.abs() } else { 0.0 };
                for jump in model.jumps(&turned) {
                    assert_close(jump.normal, 0.0, 1e-16 + lean, "normal jump under a rotation");
                    assert_close(jump.tangential, slide, 1e-16 + lean, "sliding under a rotation");
                }
                let force = largest(&model.forces(&law, &turned));
                match kinematics {
                    Kinematics::Objective => assert!(force < floor, "{force:e}"),
                    Kinematics::Paper => assert!(force > 1e-3),
                    Kinematics::Finite => unreachable!("in mechanics_rotation"),
                }
            }
        }
    }
}

#[test]
fn quadratic_convergence_of_the_displacement_and_linear_of_the_strain_under_refinement() {
    // The gradient of a harmonic function is in equilibrium without volume forces.
    let k = 6.0;
    let exact = |[x, y]: [f64; 2]| [1e-4 * (k * x).exp() * (k * y).cos(), -1e-4 * (k * x).exp() * (k * y).sin()];
    let elastic = |plane| Arc::new(LinearElastic::new(72000.0, 0.33, plane).unwrap()) as Arc<dyn SubstrateLaw>;
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        let coarse = distorted(0.3);
        let mut errors = Vec::new();
        for refinement in [2, 4, 8, 16] {
            let (mesh, _) = coarse.refined(refinement).unwrap();
            let field: Vec<[f64; 2]> = mesh.nodes().iter().map(|&x| exact(x)).collect();
            let mut nodes = mesh.outer_nodes();
            nodes.extend(mesh.pairs().iter().flatten());
            nodes.sort_unstable();
            nodes.dedup();
            let model = Model::new(mesh.clone(), vec![elastic(plane); 2], &nodes, ModelOptions::default()).unwrap();
            let solution = solve(&model, &adhesive([1.0; 4]), &ramp(&field, &nodes, 1));
            let found = &solution.instants[0].displacement;
            let squares: f64 = found.iter().flatten().zip(field.iter().flatten()).map(|(a, b)| (a - b).powi(2)).sum();
            let displacement = (squares / field.len() as f64).sqrt();
            // Strain in the first Gauss point against the exact second derivatives.
            let mut strain = 0.0_f64;
            for (element, corners) in mesh.elements().iter().enumerate() {
                let at = corners.map(|node| mesh.nodes()[node as usize]);
                let middle = [0, 1].map(|c| at.iter().map(|p| p[c]).sum::<f64>() / 4.0);
                let wanted = k * exact(middle)[0];
                let stress = model.stresses(found)[element];
                let mean = stress.iter().map(|s| s.0[0] - s.0[1]).sum::<f64>() / 4.0;
                // sxx - syy = 2 G (exx - eyy) in both plane states, eyy = -exx.
                strain = strain.max((mean * 1.33 / 72000.0 - 2.0 * wanted).abs());
                if element > 40 {
                    break; // stresses() is asked again and again: a few elements will do
                }
            }
            errors.push([displacement, strain]);
        }
        for pair in errors.windows(2) {
            let orders = [0, 1].map(|k| (pair[0][k] / pair[1][k]).log2());
            println!("{plane:?}: orders of displacement and strain {orders:.2?}");
            assert!((orders[0] - 2.0).abs() < 0.15, "{orders:?}");
            assert!(orders[1] > 0.9, "{orders:?}");
        }
    }
}

#[test]
fn refinement_by_two_hardly_changes_the_tractions_of_the_debonding_test() {
    let Some((mesh, boundary)) = virtual_r4() else { return };
    let law = adhesive([1.0; 4]);
    let coarse = model_of(&mesh, &boundary, ModelOptions::default());
    let (fine_mesh, carry) = mesh.refined(2).unwrap();
    let fine_boundary = mesh.carry_boundary(&carry, &boundary);
    let fine = model_of(&fine_mesh, &fine_boundary, ModelOptions::default());
    let (a, b) = (solve(&coarse, &law, &boundary), solve(&fine, &law, &fine_boundary));
    for instant in [0, 6, 12, 18] {
        let of = |model: &Model, solution: &Solution| model.tractions(&law, &solution.instants[instant].displacement);
        let (coarse_t, fine_t) = (of(&coarse, &a), of(&fine, &b));
        let largest = coarse_t.iter().fold(0.0_f64, |m, t| m.max(t.normal.abs()));
        let place = |mesh: &JointMesh, pair: [u32; 2]| mesh.pairs().iter().position(|&p| p == pair).unwrap();
        let mut off = 0.0_f64;
        // The end pairs are prescribed and do not count.
        for (k, &pair) in mesh.pairs().iter().enumerate().skip(1).take(mesh.pairs().len() - 2) {
            off = off.max((coarse_t[k].normal - fine_t[place(&fine_mesh, pair)].normal).abs());
        }
        println!("instant {}: T_n changes by {:.3} % of {largest:.1} MPa", instant + 1, 100.0 * off / largest);
        assert!(off < 0.005 * largest, "instant {}: {off} of {largest} MPa", instant + 1);
    }
}

/// A joint that is larger than any region that is looked at, pulled open from its right end over eight instants.
fn larger_joint() -> (JointMesh, BoundaryHistory) {
    let mesh = JointMesh::rectangular(60, 12, SIZE, GAP).unwrap();
    let nodes = mesh.outer_nodes();
    let length = 60.0 * SIZE;
    let instants = (1..=8)
        .map(|k| {
            let opening = 0.004 * f64::from(k);
            let at = |&node: &u32| {
                let [x, y] = mesh.nodes()[node as usize];
                let side = if y > 0.0 { 1.0 } else { -1.0 };
                let share = x / length;
                [
                    -side * 0.2 * opening * share * (1.0 + y),
                    0.5 * side * opening * share * share + 0.1 * opening * share,
                ]
            };
            nodes.iter().map(at).collect()
        })
        .collect();
    (mesh, BoundaryHistory::new(nodes, instants).unwrap())
}

#[test]
fn a_region_cut_out_of_a_larger_joint_gives_its_inside() {
    let (mesh, boundary) = larger_joint();
    let law = adhesive([1.0; 4]);
    for kinematics in [Kinematics::Paper, Kinematics::Objective] {
        let whole = model_of(&mesh, &boundary, options(kinematics, Quadrature::NewtonCotes));
        let solution = solve(&whole, &law, &boundary);
        // Columns 11..50 and the seven rows on either side of the adhesive.
        let inside = |element: usize| {
            let corners = mesh.elements()[element].map(|node| mesh.nodes()[node as usize]);
            let [x, y] = [0, 1].map(|c| corners.iter().map(|p| p[c]).sum::<f64>() / 4.0);
            (11.0..50.0).contains(&(x / SIZE)) && y.abs() < 0.5 * GAP + 7.0 * SIZE
        };
        let (region, of) = mesh.part(inside).unwrap();
        assert_eq!((region.elements().len(), region.interfaces().len()), (546, 39));
        let nodes = region.outer_nodes();
        let cut = |u: &[[f64; 2]]| -> Vec<[f64; 2]> { of.iter().map(|&node| u[node as usize]).collect() };
        let fields: Vec<_> = solution.instants.iter().map(|instant| cut(&instant.displacement)).collect();
        let values = |u: &Vec<[f64; 2]>| nodes.iter().map(|&node| u[node as usize]).collect();
        let prescribed = BoundaryHistory::new(nodes.clone(), fields.iter().map(values).collect()).unwrap();
        let model = model_of(&region, &prescribed, options(kinematics, Quadrature::NewtonCotes));
        let found = solve(&model, &law, &prescribed);
        let opened = model.jumps(&found.instants[7].displacement).iter().fold(0.0_f64, |m, jump| m.max(jump.normal));
        assert!(opened > 0.01, "opens by {opened} mm only");
        for (instant, field) in found.instants.iter().zip(&fields) {
            // The objective jump of an end pair knows only the elements inside: its neighbours differ.
            let off = difference(&instant.displacement, field) / largest(field);
            assert!(off < 1e-11, "{kinematics:?}: {off:e}");
        }
    }
}

#[test]
fn the_laws_and_solvers_give_the_same_field_where_they_are_the_same() {
    // The extended law is the original one when q = r = 1: opening without compression.
    let mesh = JointMesh::rectangular(8, 3, SIZE, GAP).unwrap();
    let field: Vec<[f64; 2]> =
        mesh.nodes().iter().map(|&[x, y]| [0.002 * y.signum(), y.signum() * (0.002 + 0.02 * x)]).collect();
    let boundary = ramp(&field, &mesh.outer_nodes(), 3);
    let extended = adhesive([1.0, 1.0, 1.0, 0.25]);
    let original = XuNeedleman::new(1.0, 0.005, 0.05, 1.0, 0.0).unwrap();
    let solutions: Vec<Solution> = [LuChoice::Banded, LuChoice::Sparse, LuChoice::Nested]
        .into_iter()
        .flat_map(|solver| {
            let model = model_of(&mesh, &boundary, ModelOptions { solver, ..ModelOptions::default() });
            [solve(&model, &extended, &boundary), solve(&model, &original, &boundary)]
        })
        .collect();
    for solution in &solutions[1..] {
        for (a, b) in solutions[0].instants.iter().zip(&solution.instants) {
            assert!(difference(&a.displacement, &b.displacement) < 1e-13 * largest(&a.displacement));
        }
    }
}

#[test]
fn derivatives_by_material_and_by_the_border_are_differences_of_solutions() {
    let (mesh, boundary) = larger_joint();
    let boundary = boundary.up_to(8);
    let law = adhesive([1.0; 4]);
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        let values = [72000.0, 0.33, 60.0, 0.06, 7.0];
        let of = |values: [f64; 5]| Arc::new(RambergOsgood::new(values, plane).unwrap()) as Arc<dyn SubstrateLaw>;
        let build = |lower: [f64; 5], upper: [f64; 5]| {
            Model::new(mesh.clone(), vec![of(lower), of(upper)], boundary.nodes(), ModelOptions::default()).unwrap()
        };
        let model = build(values, values);
        let options = ForwardOptions { substrate_sensitivities: true, ..ForwardOptions::default() };
        let solution = model.forward(&law, &boundary, &options).unwrap();
        assert!(solution.converged() && solution.parameters.len() == 10);
        let last = solution.instants.last().unwrap();
        let yielded = model.states(&last.displacement).iter().flatten().any(|s| s.plastic_strain > 1e-4);
        assert!(yielded, "nothing yields");
        for (k, sensitivity) in solution.parameters.iter().enumerate().skip(3) {
            let (group, parameter) = (sensitivity.group.unwrap(), k % 5);
            let h = 1e-3 * values[parameter];
            let at = |step: f64| {
                let mut changed = [values, values];
                changed[group][parameter] += step * h;
                let model = build(changed[0], changed[1]);
                solve(&model, &law, &boundary).instants.pop().unwrap().displacement
            };
            let fields = [-2.0, -1.0, 1.0, 2.0].map(at);
            let wanted: Vec<[f64; 2]> = (0..mesh.nodes().len())
                .map(|n| {
                    [0, 1].map(|c| {
                        let u = |field: usize| fields[field][n][c];
                        (8.0 * (u(2) - u(1)) - (u(3) - u(0))) / (12.0 * h)
                    })
                })
                .collect();
            let off = difference(&last.sensitivities[k], &wanted) / largest(&wanted);
            assert!(off < 1e-8, "{} of group {group}: {off:e}", sensitivity.parameter.name);
        }
        // The border: two columns, each against a difference.
        let linearised = model.linearise(&law, &last.displacement).unwrap();
        let columns: Vec<Vec<[f64; 2]>> = (0..2)
            .map(|c| boundary.nodes().iter().map(|&n| [scatter(c + 2 * n as usize), scatter(7 + n as usize)]).collect())
            .collect();
        let follow = linearised.by_boundary(&columns);
        for (column, found) in columns.iter().zip(&follow) {
            let h = 1e-8; // small, for no pair to pass the kink at zero opening
            let at = |step: f64| {
                let mut instants = boundary.instants().to_vec();
                for (u, v) in instants.last_mut().unwrap().iter_mut().zip(column) {
                    *u = [u[0] + step * h * v[0], u[1] + step * h * v[1]];
                }
                let boundary = BoundaryHistory::new(boundary.nodes().to_vec(), instants).unwrap();
                solve(&model, &law, &boundary).instants.pop().unwrap().displacement
            };
            let (plus, minus) = (at(1.0), at(-1.0));
            let wanted: Vec<[f64; 2]> =
                plus.iter().zip(&minus).map(|(a, b)| [0, 1].map(|c| (a[c] - b[c]) / (2.0 * h))).collect();
            let off = difference(found, &wanted) / largest(&wanted);
            assert!(off < 1e-5, "border: {off:e}");
        }
    }
}

#[test]
fn results_have_the_same_bits_for_any_number_of_threads() {
    let (mesh, boundary) = larger_joint();
    let law = adhesive([1.0; 4]);
    let options = ForwardOptions { law_sensitivities: true, ..ForwardOptions::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| model_of(&mesh, &boundary, ModelOptions::default()).forward(&law, &boundary, &options).unwrap())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn strips_are_paired_by_geometry_wherever_the_joint_runs() {
    for mesh in [distorted(0.0), distorted(0.4), arc(), JointMesh::rectangular(5, 2, 0.1, 0.0).unwrap()] {
        let parts = JointParts {
            nodes: mesh.nodes().to_vec(),
            elements: mesh.elements().to_vec(),
            groups: mesh.groups().to_vec(),
            element_group: mesh.element_group().to_vec(),
            ..JointParts::default()
        };
        let found = JointMesh::from_strips(parts).unwrap();
        let mut wanted = mesh.interfaces().to_vec();
        let mut found = found.interfaces().to_vec();
        wanted.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, wanted);
    }
}

fn parts() -> JointParts {
    let mesh = JointMesh::rectangular(3, 2, 1.0, 0.5).unwrap();
    JointParts {
        nodes: mesh.nodes().to_vec(),
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        ..JointParts::default()
    }
}

#[track_caller]
fn fault(change: impl FnOnce(&mut JointParts)) -> MeshFault {
    let mut parts = parts();
    change(&mut parts);
    JointMesh::new(parts).unwrap_err()
}

#[test]
fn wrong_meshes_are_refused_by_name() {
    assert!(JointMesh::new(parts()).is_ok());
    assert_eq!(fault(|p| p.elements.clear()), MeshFault::Empty);
    assert_eq!(fault(|p| p.element_group = vec![1; 12]), MeshFault::Groups);
    assert_eq!(fault(|p| p.nodes[5][1] = f64::NAN), MeshFault::NotFinite { node: 5 });
    assert_eq!(fault(|p| p.elements[3][2] = 99), MeshFault::MissingNode { element: 3, node: 99, n_nodes: 24 });
    assert!(matches!(fault(|p| p.elements[4].reverse()), MeshFault::BadElement { element: 4, .. }));
    assert!(matches!(fault(|p| p.nodes[5] = [-3.0, 0.0]), MeshFault::BadElement { .. }));
    assert!(matches!(fault(|p| p.nodes.push([9.0, 9.0])), MeshFault::DanglingNode { node: 24, .. }));
    assert_eq!(fault(|p| p.interfaces.clear()), MeshFault::NoInterface);
    assert!(matches!(fault(|p| p.interfaces[1][0] = 77), MeshFault::InterfaceNode { element: 1, node: 77, .. }));
    let swapped = |p: &mut JointParts| {
        let [l1, l2, u1, u2] = p.interfaces[2];
        p.interfaces[2] = [u1, u2, l1, l2];
    };
    assert!(matches!(fault(swapped), MeshFault::BadInterface { element: 2, .. }));
    let turned = |p: &mut JointParts| p.interfaces[1].reverse();
    assert!(matches!(fault(turned), MeshFault::FacesSwapped { element: 1, .. }));
    let twice = |p: &mut JointParts| p.elements.push(p.elements[4]);
    assert_eq!(fault(twice), MeshFault::SameNodes { kind: "element", element: 12, other: 4 });
    let twice = |p: &mut JointParts| p.interfaces.push(p.interfaces[2]);
    assert_eq!(fault(twice), MeshFault::SameNodes { kind: "interface element", element: 3, other: 2 });
    assert!(matches!(fault(|p| p.interfaces[0].swap(2, 3)), MeshFault::BadInterface { element: 0, .. }));
    assert!(matches!(fault(|p| p.interfaces[0] = [8, 9, 8, 9]), MeshFault::SelfPair { node: 8 }));
    assert!(matches!(JointMesh::rectangular(0, 2, 1.0, 0.5), Err(MeshFault::Size { columns: 0, .. })));
    assert!(matches!(JointMesh::rectangular(3, 2, f64::NAN, 0.5), Err(MeshFault::Size { .. })));
    assert!(matches!(JointMesh::new(parts()).unwrap().refined(0), Err(MeshFault::Refinement { k: 0 })));
    // One strip alone; strips cut differently.
    let mut one = parts();
    one.elements.truncate(6);
    one.nodes.truncate(12);
    assert_eq!(JointMesh::from_strips(one).unwrap_err(), MeshFault::OneStrip);
    let (coarse, fine) =
        (JointMesh::rectangular(2, 1, 1.0, 0.5).unwrap(), JointMesh::rectangular(4, 2, 0.5, 0.5).unwrap());
    let mut mixed = JointParts {
        nodes: coarse.nodes()[..6].to_vec(),
        elements: coarse.elements()[..2].to_vec(),
        ..JointParts::default()
    };
    mixed.nodes.extend(&fine.nodes()[15..]);
    mixed.elements.extend(fine.elements()[8..].iter().map(|corners| corners.map(|node| node - 15 + 6)));
    let error = JointMesh::from_strips(mixed).unwrap_err();
    assert!(matches!(error, MeshFault::NoFaces | MeshFault::FacesDoNotPair { .. }), "{error}");
}

#[test]
fn wrong_boundaries_and_models_are_refused_by_name() {
    let rest = vec![[0.0; 2]; 2];
    assert_eq!(BoundaryHistory::new(vec![], vec![rest.clone()]).unwrap_err(), BoundaryFault::NoNode);
    assert_eq!(BoundaryHistory::new(vec![1, 2], vec![]).unwrap_err(), BoundaryFault::NoInstant);
    assert_eq!(BoundaryHistory::new(vec![1, 1], vec![rest.clone()]).unwrap_err(), BoundaryFault::Twice { node: 1 });
    assert_eq!(
        BoundaryHistory::new(vec![1, 2], vec![rest.clone(), vec![[0.0; 2]]]).unwrap_err(),
        BoundaryFault::Count { instant: 2, needed: 2, given: 1 }
    );
    assert_eq!(
        BoundaryHistory::new(vec![4, 7], vec![vec![[0.0; 2], [0.0, f64::INFINITY]]]).unwrap_err(),
        BoundaryFault::NotFinite { instant: 1, node: 7 }
    );
    let mesh = JointMesh::rectangular(3, 2, 1.0, 0.5).unwrap();
    let model =
        |materials, nodes: &[u32]| Model::new(mesh.clone(), aluminium(materials), nodes, ModelOptions::default());
    assert_eq!(model(1, &[0]).unwrap_err(), ModelError::Materials { needed: 2, given: 1 });
    assert_eq!(model(2, &[24]).unwrap_err(), ModelError::PrescribedNode { node: 24, n_nodes: 24 });
    assert!(matches!(model(2, &[0, 1, 23]).unwrap_err(), ModelError::StripNotHeld { prescribed: 1, .. }));
    let model = model(2, &mesh.outer_nodes()).unwrap();
    let other = BoundaryHistory::new(vec![0, 1], vec![rest]).unwrap();
    let law = adhesive([1.0; 4]);
    assert_eq!(model.forward(&law, &other, &ForwardOptions::default()).unwrap_err(), ModelError::OtherNodes);
    assert_eq!(model.linearise(&law, &[]).unwrap_err(), ModelError::FieldSize { needed: 24, given: 0 });
}

#[test]
fn removing_the_overall_rigid_motion_leaves_what_a_rotated_joint_shows_without_it() {
    let (mesh, boundary) = larger_joint();
    let angle = 0.02;
    let turned = boundary.instants().iter().map(|field| {
        let place = |(&node, u): (&u32, &[f64; 2])| {
            let [x, y] = mesh.nodes()[node as usize];
            let [a, b] = rotated([x + u[0], y + u[1]], angle);
            [a + 0.5 - x, b - 0.2 - y]
        };
        boundary.nodes().iter().zip(field).map(place).collect()
    });
    let turned = BoundaryHistory::new(boundary.nodes().to_vec(), turned.collect()).unwrap();
    let (a, _) = boundary.without_rigid_motion(mesh.nodes());
    let (b, motions) = turned.without_rigid_motion(mesh.nodes());
    for (a, b) in a.instants().iter().zip(b.instants()) {
        assert!(difference(a, b) < 1e-14);
    }
    assert!(motions.iter().all(|motion| (motion.rotation_rad - angle).abs() < 0.01));
}

#[test]
fn what_cannot_be_solved_says_where_and_leaves_no_nan() {
    // Displacements a thousand times too large tear everything apart at once; an unlimited step must not give NaN.
    let (mesh, boundary) = larger_joint();
    let scaled = boundary.instants().iter().map(|field| field.iter().map(|u| u.map(|u| 1e3 * u)).collect()).collect();
    let boundary = BoundaryHistory::new(boundary.nodes().to_vec(), scaled).unwrap();
    let model = model_of(&mesh, &boundary, ModelOptions::default());
    let mut options = ForwardOptions::default();
    options.newton.max_halvings = 1;
    options.newton.max_rescue = 5;
    let law = adhesive([3.0, 0.1, 0.1, 1.0]);
    let solution = model.forward(&law, &boundary, &options).unwrap();
    for instant in &solution.instants {
        assert!(instant.displacement.iter().flatten().all(|u| u.is_finite()));
        match instant.status {
            Status::NotConverged => assert!(instant.failure.is_some() && !instant.snapped.is_empty()),
            Status::NotReached => assert!(instant.displacement.is_empty()),
            Status::Converged | Status::Rescued => {}
        }
    }
    assert!(!solution.converged());
}
