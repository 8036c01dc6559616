//! Loads of a joint (THEORY 15): reactions, where the work goes, groups of nodes.

use crate::mechanics_common;
use mechanics_common::*;
use quadrille::mechanics::cohesive::{CohesiveLaw, law_by_name};
use quadrille::mechanics::substrate::{
    EngineeringStrain, LinearElastic, Orthotropic, PlaneState, RambergOsgood, Stress, SubstrateLaw, Tabulated,
};
use quadrille::mechanics::{
    BoundaryHistory, EnergyOptions, ForwardOptions, JointMesh, Kinematics, ModelOptions, NodeGroup, Quadrature, Status,
    select_nodes,
};
use std::sync::Arc;

const SIZE: f64 = 0.0309;
const GAP: f64 = 0.06;

/// Two strips that open from the right end and slide, over `n` instants.
fn opening(n: u32, factor: f64) -> (JointMesh, BoundaryHistory) {
    let mesh = JointMesh::rectangular(12, 3, SIZE, GAP).unwrap();
    let nodes = mesh.outer_nodes();
    let instants = (1..=n)
        .map(|k| {
            let t = factor * f64::from(k) / f64::from(n);
            let at = |&node: &u32| {
                let [x, y] = mesh.nodes()[node as usize];
                [y.signum() * 0.01 * t, y.signum() * t * (0.05 * x - 0.001)]
            };
            nodes.iter().map(at).collect()
        })
        .collect();
    (mesh, BoundaryHistory::new(nodes, instants).unwrap())
}

fn options(kinematics: Kinematics) -> ModelOptions {
    ModelOptions { kinematics, ..ModelOptions::default() }
}

fn laws() -> Vec<Box<dyn CohesiveLaw>> {
    vec![
        Box::new(adhesive([1.0; 4])),
        law_by_name("smith-ferrante", &[1.0, 0.005, 0.7]).unwrap(),
        law_by_name("bilinear-benzeggagh-kenane", &[2e4, 40.0, 30.0, 0.4, 1.1, 1.7]).unwrap(),
    ]
}

#[test]
fn the_reaction_of_a_strip_is_the_traction_of_its_face_and_both_strips_hold_each_other() {
    let (mesh, boundary) = opening(3, 1.0);
    let groups = NodeGroup::of_strips(&mesh, boundary.nodes());
    assert_eq!(groups.iter().map(|group| group.name.as_str()).collect::<Vec<_>>(), ["lower", "upper"]);
    for kinematics in [Kinematics::Paper, Kinematics::Finite] {
        let model = model_of(&mesh, &boundary, options(kinematics));
        for law in laws() {
            let solution = model.forward(&*law, &boundary, &ForwardOptions::default()).unwrap();
            assert!(solution.converged());
            let u = &solution.instants[2].displacement;
            let [lower, upper] = model.reactions(&*law, u, &groups)[..] else { panic!("two groups") };
            let size = upper[0].hypot(upper[1]);
            assert!(size > 1.0, "{upper:?}");
            (0..2).for_each(|c| assert_close(lower[c], -upper[c], 1e-10 * size, "both strips"));
            if kinematics == Kinematics::Paper {
                // Every pair for itself, weighted by the length that is nearer to it than to others.
                let tractions = model.tractions(&*law, u);
                let last = tractions.len() - 1;
                let of = |pick: fn(&quadrille::mechanics::cohesive::Traction) -> f64| -> f64 {
                    let weight = |k: usize| if k == 0 || k == last { 0.5 * SIZE } else { SIZE };
                    tractions.iter().enumerate().map(|(k, t)| weight(k) * pick(t)).sum()
                };
                assert_close(upper[1], of(|t| t.normal), 1e-10 * size, "normal");
                assert_close(upper[0], of(|t| t.tangential), 1e-10 * size, "along the joint");
            }
        }
    }
}

#[test]
fn the_work_of_the_reactions_is_stored_in_the_strips_or_done_on_the_adhesive() {
    for (kinematics, quadrature) in
        [(Kinematics::Paper, Quadrature::Gauss), (Kinematics::Finite, Quadrature::NewtonCotes)]
    {
        let (mesh, boundary) = opening(4, 1.0);
        let model = model_of(&mesh, &boundary, ModelOptions { kinematics, quadrature, ..ModelOptions::default() });
        for law in laws() {
            let solution = model.forward(&*law, &boundary, &ForwardOptions::default()).unwrap();
            assert!(solution.instants.iter().all(|instant| instant.status == Status::Converged), "{}", law.name());
            let energies = model.energies(&*law, &boundary, &solution, &EnergyOptions::default(), &|| true);
            let last = energies[3].unwrap();
            assert!(last.work > 0.1 && last.elastic > 0.0 && last.adhesive > 0.2 * last.work, "{last:?}");
            for energies in energies.into_iter().flatten() {
                // Each sum has settled to 1e-7 of the work.
                let off = energies.imbalance().abs() / last.work;
                assert!(energies.settled && off < 1e-6, "{kinematics:?}, {}: {off:e} {energies:?}", law.name());
            }
            // What a trapezoid from instant to instant gives is no balance: the test would see a wrong sum.
            let coarse = EnergyOptions { max_halvings: 0, ..EnergyOptions::default() };
            let coarse = model.energies(&*law, &boundary, &solution, &coarse, &|| true)[3].unwrap();
            assert!(!coarse.settled && coarse.imbalance().abs() > 1e-4 * last.work, "{coarse:?}");
        }
    }
}

#[test]
fn a_joint_that_is_pulled_apart_evenly_takes_the_work_of_separation() {
    let mesh = JointMesh::rectangular(4, 2, SIZE, GAP).unwrap();
    let nodes = mesh.outer_nodes();
    let open = 0.1;
    let at =
        |share: f64| nodes.iter().map(|&n| [0.0, 0.5 * share * open * mesh.nodes()[n as usize][1].signum()]).collect();
    let boundary = BoundaryHistory::new(nodes.clone(), (1..=20).map(|k| at(f64::from(k) / 20.0)).collect()).unwrap();
    let model = model_of(&mesh, &boundary, options(Kinematics::Finite));
    let law = adhesive([1.0; 4]);
    let solution = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
    let energies = model.energies(&law, &boundary, &solution, &EnergyOptions::default(), &|| true);
    let last = energies[19].unwrap();
    // phi_n = 1 N/mm over the length; e^-20 of it is left.
    let length = 4.0 * SIZE;
    assert_close(last.adhesive, length, 1e-6 * length, "adhesive");
    assert_close(last.work, length, 1e-6 * length, "work");
}

#[test]
fn a_snap_is_told_by_the_energy_that_is_lost_in_it() {
    // A strong and brittle adhesive.
    let (mesh, boundary) = opening(4, 4.0);
    let model = model_of(&mesh, &boundary, options(Kinematics::Paper));
    let law = adhesive([1.0, 0.1, 0.1, 1.0]);
    let solution = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged() && solution.instants.iter().any(|instant| instant.status == Status::Rescued));
    let options = EnergyOptions { max_halvings: 2, ..EnergyOptions::default() };
    let energies = model.energies(&law, &boundary, &solution, &options, &|| true);
    let last = energies[3].unwrap();
    assert!(!last.settled && last.imbalance() > 1e-3 * last.work, "{last:?}");
}

#[test]
fn the_energy_of_a_material_is_the_integral_of_its_stress() {
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        let curve = [[0.0025, 180.0], [0.004, 200.0], [0.02, 260.0]];
        let n = if plane == PlaneState::PlaneStress { 5 } else { 8 };
        let fibres = [140e3, 10e3, 0.3, 5e3, 30.0, 9e3, 0.25, 0.4];
        let laws: [Arc<dyn SubstrateLaw>; 4] = [
            Arc::new(Tabulated::new([72_000.0, 0.33, 1.0], &curve, plane).unwrap()),
            Arc::new(Orthotropic::new(&fibres[..n], plane).unwrap()),
            Arc::new(RambergOsgood::new([72_000.0, 0.33, 180.0, 0.06, 7.0], plane).unwrap()),
            Arc::new(LinearElastic::new(72_000.0, 0.33, plane).unwrap()),
        ];
        for law in laws {
            let end = EngineeringStrain { xx: 0.006, yy: -0.001, gamma_xy: 0.004 };
            let at = |share: f64| EngineeringStrain {
                xx: share * end.xx,
                yy: share * end.yy,
                gamma_xy: share * end.gamma_xy,
            };
            let power = |share: f64| {
                let Stress([x, y, shear]) = law.stress(at(share));
                x * end.xx + y * end.yy + shear * end.gamma_xy
            };
            // Simpson's rule with 2000 pieces: error far below 1e-9.
            let n = 2000;
            let sum: f64 = (0..n)
                .map(|k| {
                    let [a, b] = [k, k + 1].map(|k| f64::from(k) / f64::from(n));
                    (power(a) + 4.0 * power(0.5 * (a + b)) + power(b)) / (6.0 * f64::from(n))
                })
                .sum();
            let found = law.energy(end);
            assert_close(found.elastic + found.plastic, sum, 1e-9 * sum, law.name());
            if law.name() == Orthotropic::NAME {
                continue;
            }
            // The elastic part is that of the stress by Hooke's law.
            let hooke = LinearElastic::new(72_000.0, 0.33, plane).unwrap();
            let Stress([x, y, shear]) = law.stress(end);
            let compliance = hooke.secant(end).try_inverse().unwrap();
            let stress = nalgebra::Vector3::new(x, y, shear);
            let elastic = 0.5 * stress.dot(&(compliance * stress));
            if plane == PlaneState::PlaneStress {
                assert_close(found.elastic, elastic, 1e-9 * sum, "elastic");
            }
            assert!(found.plastic >= 0.0 && (found.plastic > 0.1 * sum) == (law.name() != LinearElastic::NAME));
        }
    }
}

#[test]
fn nodes_are_selected_by_their_place() {
    let mesh = JointMesh::rectangular(3, 2, 1.0, 0.5).unwrap();
    let selected = |text: &str| select_nodes(text, &mesh).unwrap();
    assert_eq!(selected("x = 0"), [0, 4, 8, 12, 16, 20]);
    assert_eq!(selected("x>=3 and y<0"), [3, 7, 11]);
    assert_eq!(selected("y = max and x < 1.5"), [20, 21]);
    assert_eq!(selected("y > max"), [0u32; 0]);
    for text in ["", "x", "x 0", "z = 0", "x = zero", "x = 0 and", "x == 0", "x = inf"] {
        assert!(select_nodes(text, &mesh).is_err(), "{text}");
    }
}
