//! Joints that are held and loaded by component: rollers, rigid blocks, forces, cracked faces, and what is refused.

use crate::mechanics_common;
use mechanics_common::*;
use quadrille::mechanics::cohesive::{CohesiveLaw, law_by_name};
use quadrille::mechanics::substrate::{LinearElastic, PlaneState, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryFault, BoundaryHistory, Drives, EnergyOptions, ForwardOptions, JointMesh, Kinematics, Model, ModelError,
    ModelOptions, NodeGroup, RigidBlock, Solution, Status, select_nodes,
};
use std::sync::Arc;

const SIZE: f64 = 0.05;
const E: f64 = 2000.0;

fn mesh() -> JointMesh {
    JointMesh::rectangular(16, 2, SIZE, 0.01).unwrap()
}

fn elastic() -> Vec<Arc<dyn SubstrateLaw>> {
    let law = LinearElastic::new(E, 0.3, PlaneState::PlaneStress).unwrap();
    vec![Arc::new(law) as Arc<dyn SubstrateLaw>; 2]
}

fn options(kinematics: Kinematics) -> ModelOptions {
    ModelOptions { kinematics, ..ModelOptions::default() }
}

fn nodes(mesh: &JointMesh, text: &str) -> Vec<u32> {
    select_nodes(text, mesh).unwrap()
}

/// `values` of component `c` at the nodes that `text` selects.
fn support(mesh: &JointMesh, text: &str, c: usize, values: &[f64]) -> Vec<(u32, usize, Vec<f64>, String)> {
    nodes(mesh, text).into_iter().map(|node| (node, c, values.to_vec(), text.to_owned())).collect()
}

/// A bilinear law, and one whose softening is smooth.
fn laws() -> Vec<Box<dyn CohesiveLaw>> {
    vec![
        law_by_name("bilinear-benzeggagh-kenane", &[1e4, 20.0, 30.0, 0.1, 0.3, 1.7]).unwrap(),
        law_by_name("smith-ferrante", &[0.2, 0.005, 0.7]).unwrap(),
    ]
}

/// A double cantilever beam: clamped on the right, a rigid block on the left end of the upper arm and one of the lower.
/// `held` blocks are pulled apart over `n` instants.
fn cantilevers(mesh: &JointMesh, values: &[f64], held: bool) -> Drives {
    let rest = vec![0.0; values.len()];
    let mut drives = Drives {
        supports: [support(mesh, "x = max", 0, &rest), support(mesh, "x = max", 1, &rest)].concat(),
        ..Drives::default()
    };
    for (k, (text, sign)) in [("y = max and x <= 0.1", 1.0), ("y = min and x <= 0.1", -1.0)].into_iter().enumerate() {
        let block = RigidBlock {
            name: text.to_owned(),
            nodes: nodes(mesh, text),
            tied: [true; 2],
            point: [0.05, sign * 0.2],
            held: [false, held],
        };
        let moved: Vec<[f64; 2]> = values.iter().map(|v| [0.0, sign * v]).collect();
        drives.blocks.push((block, if held { moved.clone() } else { vec![[0.0; 2]; values.len()] }));
        if !held {
            drives.block_loads.push((k, moved));
        }
    }
    drives
}

fn solved(model: &Model, law: &dyn CohesiveLaw, boundary: &BoundaryHistory) -> Solution {
    let options = ForwardOptions { law_sensitivities: true, substrate_sensitivities: true, ..Default::default() };
    let solution = model.forward(law, boundary, &options).unwrap();
    assert!(solution.instants.iter().all(|instant| instant.status == Status::Converged));
    solution
}

#[test]
fn a_strip_on_rollers_under_an_even_traction_has_hookes_strain() {
    let mesh = mesh();
    let pull = 3.0; // MPa
    let mut drives = Drives {
        supports: [support(&mesh, "x = 0", 0, &[0.0]), support(&mesh, "x = 0 and y = min", 1, &[0.0])].concat(),
        ..Drives::default()
    };
    // Half an edge for the ends of each strip, a whole for the node between.
    for (node, share) in [("y = min", 0.5), ("y > -0.1 and y < -0.01", 1.0), ("y > -0.01 and y < 0", 0.5)] {
        for node in nodes(&mesh, &format!("x = max and {node}")) {
            drives.loads.push((node, vec![[share * SIZE * pull, 0.0]]));
        }
    }
    for (node, share) in [("y = max", 0.5), ("y < 0.1 and y > 0.01", 1.0), ("y < 0.01 and y > 0", 0.5)] {
        for node in nodes(&mesh, &format!("x = max and {node}")) {
            drives.loads.push((node, vec![[share * SIZE * pull, 0.0]]));
        }
    }
    let boundary = BoundaryHistory::of_drives(&drives, 1).unwrap();
    let model = Model::supported(mesh.clone(), elastic(), boundary.supports(), ModelOptions::default()).unwrap();
    let law = &*laws()[0];
    let solution = solved(&model, law, &boundary);
    let u = &solution.instants[0].displacement;
    for (at, u) in mesh.nodes().iter().zip(u) {
        // Both strips shrink about themselves: the adhesive carries nothing, and opens nothing.
        let y = if at[1] < 0.0 { at[1] + 0.105 } else { at[1] + 0.105 - 0.01 };
        assert_close(u[0], pull / E * at[0], 1e-13, "u_x");
        assert_close(u[1], -0.3 * pull / E * y, 1e-13, "u_y");
    }
    let wall = NodeGroup::new("wall", nodes(&mesh, "x = 0"));
    let [wall] = model.reactions(law, u, &[wall])[..] else { panic!("one group") };
    assert_close(wall[0], -pull * 4.0 * SIZE, 1e-12, "reaction");
    assert_close(wall[1], 0.0, 1e-12, "reaction across");
}

#[test]
fn prescribing_a_blocks_displacement_and_applying_its_reaction_are_one_and_leave_it_rigid() {
    let mesh = mesh();
    for kinematics in [Kinematics::Objective, Kinematics::Finite] {
        for law in laws() {
            // Up to the peak the force rises with the opening.
            let held = BoundaryHistory::of_drives(&cantilevers(&mesh, &[0.0005, 0.001], true), 2).unwrap();
            let model = Model::supported(mesh.clone(), elastic(), held.supports(), options(kinematics)).unwrap();
            let given = solved(&model, &*law, &held);
            let upper = NodeGroup::new("upper", nodes(&mesh, "y = max and x <= 0.1"));
            let force =
                |k: usize| model.reactions(&*law, &given.instants[k].displacement, std::slice::from_ref(&upper))[0];
            assert!(force(1)[1] > 0.01, "{:?}", force(1));
            assert_close(force(1)[0], 0.0, 1e-9 * force(1)[1], "nothing holds it along x");
            let forces = [force(0)[1], force(1)[1]];
            let loaded = BoundaryHistory::of_drives(&cantilevers(&mesh, &forces, false), 2).unwrap();
            let free = Model::supported(mesh.clone(), elastic(), loaded.supports(), options(kinematics)).unwrap();
            let found = solved(&free, &*law, &loaded);
            let (a, b) = (&given.instants[1].displacement, &found.instants[1].displacement);
            // The iteration leaves 1e-11 of the forces; the arms are soft.
            assert!(difference(a, b) < 1e-8 * largest(a), "{kinematics:?} {:e}", difference(a, b));
            let nodes = &upper.nodes;
            let length = |u: &[[f64; 2]]| {
                let at = |node: u32| [0, 1].map(|c| mesh.nodes()[node as usize][c] + u[node as usize][c]);
                let (p, q) = (at(nodes[0]), at(nodes[2]));
                (p[0] - q[0]).hypot(p[1] - q[1])
            };
            let turn = (a[nodes[2] as usize][1] - a[nodes[0] as usize][1]).abs() / 0.1;
            assert!(turn > 1e-4, "{turn:e}");
            // With small rotations a body grows by half the square of its rotation.
            let allowed = if kinematics == Kinematics::Finite { 1e-15 } else { 0.1 * turn * turn };
            assert_close(length(a), 0.1, allowed, "length of the block");
        }
    }
}

#[test]
fn derivatives_with_rollers_blocks_and_forces_are_their_differences() {
    let mesh = mesh();
    for kinematics in [Kinematics::Objective, Kinematics::Finite] {
        let mut drives = cantilevers(&mesh, &[0.002, 0.004], true);
        drives.blocks[0].0.held = [false; 2];
        drives.block_loads.push((0, vec![[0.02, 0.03], [0.01, 0.08]]));
        drives.loads.push((nodes(&mesh, "y = max and x = 0.4")[0], vec![[0.0, 0.01], [-0.02, 0.03]]));
        let boundary = BoundaryHistory::of_drives(&drives, 2).unwrap();
        let model = Model::supported(mesh.clone(), elastic(), boundary.supports(), options(kinematics)).unwrap();
        let law = law_by_name("smith-ferrante", &[0.2, 0.005, 0.7]).unwrap();
        let solution = solved(&model, &*law, &boundary);
        let n_law = law.parameters().len();
        let differ = |k: usize, found: &[[f64; 2]], again: &dyn Fn(f64) -> Vec<[f64; 2]>, value: f64| {
            let h = 1e-3 * value;
            let fields: Vec<Vec<[f64; 2]>> = [-2.0, -1.0, 1.0, 2.0].iter().map(|s| again(value + s * h)).collect();
            let scale = largest(found);
            assert!(scale > 0.0);
            for node in 0..found.len() {
                for c in 0..2 {
                    let f = |k: usize| fields[k][node][c];
                    let want = (8.0 * (f(2) - f(1)) - (f(3) - f(0))) / (12.0 * h);
                    assert_close(
                        found[node][c],
                        want,
                        1e-8 * scale,
                        format!("parameter {k}, node {node}, {kinematics:?}"),
                    );
                }
            }
        };
        let last = |model: &Model, law: &dyn CohesiveLaw| {
            let solution = model.forward(law, &boundary, &ForwardOptions::default()).unwrap();
            solution.instants[1].displacement.clone()
        };
        for k in 0..n_law {
            let again = |value: f64| last(&model, &*with_value(&*law, k, value));
            differ(k, &solution.instants[1].sensitivities[k], &again, law.values()[k]);
        }
        // Young's modulus of the lower strip.
        let again = |young: f64| {
            let mut materials = elastic();
            materials[0] = Arc::new(LinearElastic::new(young, 0.3, PlaneState::PlaneStress).unwrap());
            let model = Model::supported(mesh.clone(), materials, boundary.supports(), options(kinematics)).unwrap();
            last(&model, &*law)
        };
        differ(n_law, &solution.instants[1].sensitivities[n_law], &again, E);
    }
}

#[test]
fn the_work_of_loads_and_blocks_is_stored_or_done_on_the_adhesive() {
    let mesh = mesh();
    for kinematics in [Kinematics::Objective, Kinematics::Finite] {
        let mut drives = cantilevers(&mesh, &[0.002, 0.005, 0.012], true);
        drives.blocks[1].0.held = [true, false];
        drives.block_loads.push((1, vec![[0.0, -0.02], [0.0, -0.05], [0.0, -0.06]]));
        drives.loads.push((nodes(&mesh, "y = max and x = 0.4")[0], vec![[0.01, 0.03], [0.0, 0.03], [0.02, -0.01]]));
        let boundary = BoundaryHistory::of_drives(&drives, 3).unwrap();
        let model = Model::supported(mesh.clone(), elastic(), boundary.supports(), options(kinematics)).unwrap();
        let law = law_by_name("smith-ferrante", &[0.05, 0.003, 0.7]).unwrap();
        let solution = solved(&model, &*law, &boundary);
        let energies = model.energies(&*law, &boundary, &solution, &EnergyOptions::default(), &|| true);
        let last = energies[2].unwrap();
        assert!(last.work > 0.0 && last.adhesive > 0.01 * last.work, "{last:?}");
        for energies in energies.into_iter().flatten() {
            // Each sum has settled to 1e-7 of the work.
            let off = energies.imbalance().abs() / last.work;
            assert!(energies.settled && off < 1e-6, "{kinematics:?}: {off:e} {energies:?}");
        }
    }
}

#[test]
fn energies_balance_along_a_growing_crack_with_few_states_between_the_instants() {
    // Mixed mode, by a law without a potential; in an instant the crack passes more than one element.
    let mesh = JointMesh::rectangular(40, 2, SIZE, 0.01).unwrap();
    let law = law_by_name("bilinear-benzeggagh-kenane", &[500.0, 2.0, 3.0, 0.02, 0.05, 1.7]).unwrap();
    let values: Vec<f64> = (1..=10).map(|k| 0.025 * f64::from(k)).collect();
    for kinematics in [Kinematics::Objective, Kinematics::Finite] {
        let mut drives = cantilevers(&mesh, &values, true);
        drives.blocks[1].1.iter_mut().for_each(|u| *u = [0.0; 2]);
        let boundary = BoundaryHistory::of_drives(&drives, values.len()).unwrap();
        let model = Model::supported(mesh.clone(), elastic(), boundary.supports(), options(kinematics)).unwrap();
        let solution = solved(&model, &*law, &boundary);
        let front = |k: usize| model.crack_front(&*law, &solution.instants[k].displacement).unwrap_or(0.0);
        assert!(front(9) > front(4) + 5.0 * SIZE, "{} {}", front(4), front(9));
        let options = EnergyOptions { max_states: 100 * values.len(), ..EnergyOptions::default() };
        let energies = model.energies(&*law, &boundary, &solution, &options, &|| true);
        let last = energies[9].unwrap();
        for energies in energies.into_iter().flatten() {
            let off = energies.imbalance().abs() / last.work;
            assert!(energies.settled && off < 1e-6, "{kinematics:?}: {off:e} {energies:?}");
        }
    }
}

#[test]
fn nodes_held_by_component_are_those_of_a_border_when_both_are() {
    let mesh = mesh();
    let border = mesh.outer_nodes();
    let at = |&node: &u32| {
        let [x, y] = mesh.nodes()[node as usize];
        [1e-4 * y, y.signum() * (1e-3 + 2e-3 * x)]
    };
    let values: Vec<[f64; 2]> = border.iter().map(at).collect();
    let whole = BoundaryHistory::new(border.clone(), vec![values.clone()]).unwrap();
    let one = |(&node, u): (&u32, &[f64; 2])| [0, 1].map(|c| (node, c, vec![u[c]], "border".to_owned()));
    let supports = border.iter().zip(&values).flat_map(one).collect();
    let parts = BoundaryHistory::of_drives(&Drives { supports, ..Drives::default() }, 1).unwrap();
    assert_eq!(whole, parts);
    let law = &*laws()[1];
    let model = Model::new(mesh.clone(), elastic(), &border, ModelOptions::default()).unwrap();
    let other = Model::supported(mesh.clone(), elastic(), parts.supports(), ModelOptions::default()).unwrap();
    assert_eq!(solved(&model, law, &whole), solved(&other, law, &parts));
}

#[test]
fn faces_of_a_crack_press_on_each_other_and_hold_nothing_else() {
    let cracked = mesh().with_crack(&nodes(&mesh(), "x <= 0.4")).unwrap();
    let law = &*laws()[0];
    for (side, slide) in [(1.0, 1e-4), (-1.0, 1e-4)] {
        // The strips move as wholes: the upper one by (slide, side) against the lower one.
        let border = cracked.outer_nodes();
        let at = |&node: &u32| {
            let upper = cracked.nodes()[node as usize][1] > 0.0;
            if upper { [slide, side * 2e-4] } else { [0.0; 2] }
        };
        let boundary = BoundaryHistory::new(border.clone(), vec![border.iter().map(at).collect()]).unwrap();
        let model = Model::new(cracked.clone(), elastic(), &border, ModelOptions::default()).unwrap();
        let u = &solved(&model, law, &boundary).instants[0].displacement.clone();
        let (jumps, tractions) = (model.jumps(u), model.tractions(law, u));
        for (k, is_cracked) in cracked.cracked_pairs().into_iter().enumerate() {
            let whole = law.response(jumps[k]).traction;
            match (is_cracked, side > 0.0) {
                (false, _) => assert_eq!(tractions[k], whole),
                (true, true) => assert_eq!([tractions[k].normal, tractions[k].tangential], [0.0; 2]),
                (true, false) => {
                    assert!(tractions[k].normal < -0.1, "{:?}", tractions[k]);
                    assert_eq!(tractions[k].tangential, 0.0);
                }
            }
        }
    }
}

#[test]
fn what_does_not_hold_a_joint_or_contradicts_itself_is_refused_by_name() {
    let mesh = mesh();
    let model = |drives: &Drives, kinematics| {
        let boundary = BoundaryHistory::of_drives(drives, 1).unwrap();
        Model::supported(mesh.clone(), elastic(), boundary.supports(), options(kinematics)).map(|_| ())
    };
    let refused = |drives: &Drives, words: &[&str]| {
        let message = model(drives, Kinematics::Paper).unwrap_err().to_string();
        words.iter().for_each(|word| assert!(message.contains(word), "'{word}' in: {message}"));
    };
    let wall = support(&mesh, "x = max", 0, &[0.0]);
    let foot = support(&mesh, "x = max and y = min", 1, &[0.0]);
    // Held along x alone: it slides along the wall.
    refused(&Drives { supports: wall.clone(), ..Drives::default() }, &["body with node 0", "move along y"]);
    // One node: it turns about it.
    let pin = [foot.clone(), support(&mesh, "x = max and y = min", 0, &[0.0])].concat();
    refused(&Drives { supports: pin, ..Drives::default() }, &["turn"]);
    // The adhesive joins both strips: this holds them.
    let supports = [wall, foot].concat();
    model(&Drives { supports: supports.clone(), ..Drives::default() }, Kinematics::Paper).unwrap();
    let lever = |nodes: Vec<u32>, tied| RigidBlock {
        name: "lever".to_owned(),
        nodes,
        tied,
        point: [0.0, 1.0],
        held: [false; 2],
    };
    let with =
        |block| Drives { supports: supports.clone(), blocks: vec![(block, vec![[0.0; 2]])], ..Drives::default() };
    let column = nodes(&mesh, "x = 0 and y > 0");
    // Nodes above each other do not turn against each other along y.
    refused(&with(lever(column.clone(), [false, true])), &["lever", "two nodes"]);
    let row = nodes(&mesh, "y = max and x <= 0.1");
    model(&with(lever(row.clone(), [false, true])), Kinematics::Paper).unwrap();
    assert_eq!(
        model(&with(lever(row, [false, true])), Kinematics::Finite).unwrap_err(),
        ModelError::LeverTurns { block: "lever".to_owned() }
    );
    let wall = nodes(&mesh, "x = max");
    refused(&with(lever(wall, [true; 2])), &["lever", "another block"]);
    // The same component twice: with one value it is said twice, with two it is a contradiction.
    let twice = |second: f64| {
        let supports = [supports.clone(), support(&mesh, "y = min", 1, &[second])].concat();
        BoundaryHistory::of_drives(&Drives { supports, ..Drives::default() }, 1)
    };
    twice(0.0).unwrap();
    let fault = twice(0.5).unwrap_err();
    assert!(matches!(fault, BoundaryFault::Contradiction { node: 16, component: "y", .. }), "{fault:?}");
    let message = fault.to_string();
    ["\"x = max and y = min\"", "\"y = min\"", "0.5 mm"].iter().for_each(|w| assert!(message.contains(w), "{message}"));
    // Forces on nodes of a block would be lost.
    let mut drives = with(lever(column.clone(), [true; 2]));
    drives.loads.push((column[0], vec![[1.0, 0.0]]));
    assert_eq!(BoundaryHistory::of_drives(&drives, 1).unwrap_err(), BoundaryFault::LoadedBlock { node: column[0] });
}
