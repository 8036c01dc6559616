//! The forward model against an independent implementation: the small finite-element cases, and the 19-instant
//! debonding test.

use crate::mechanics_common;
use mechanics_common::*;
use quadrille::mechanics::cohesive::CohesiveLaw;
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, Instant, ModelOptions, Solution, Status};

const WITH_LAW: fn() -> ForwardOptions = || ForwardOptions { law_sensitivities: true, ..ForwardOptions::default() };

#[track_caller]
fn assert_converged(solution: &Solution) {
    for (k, instant) in solution.instants.iter().enumerate() {
        assert_eq!(instant.status, Status::Converged, "instant {}: {:?}", k + 1, instant.residuals);
    }
}

#[test]
fn the_small_cases_have_the_values_of_the_reference() {
    let Some(file) = reference("small_fe.json") else { return };
    let law = adhesive([1.0; 4]);
    for case in file["cases"].as_array().unwrap() {
        let mesh = joint_of(&case["mesh"]);
        let fixed: Vec<usize> = numbers(&case["fixed_dofs"]).into_iter().map(|dof| dof as usize).collect();
        let nodes: Vec<u32> = fixed.chunks(2).map(|pair| (pair[0] / 2) as u32).collect();
        assert!(fixed.chunks(2).all(|pair| pair[0] % 2 == 0 && pair[1] == pair[0] + 1));
        let steps = case["steps"].as_array().unwrap();
        let pairs = |values: Vec<f64>| -> Vec<[f64; 2]> { values.chunks(2).map(|u| [u[0], u[1]]).collect() };
        let instants = steps.iter().map(|step| pairs(numbers(&step["dirichlet"]))).collect();
        let boundary = BoundaryHistory::new(nodes, instants).unwrap();
        let model = model_of(&mesh, &boundary, ModelOptions::default());
        let solution = model.forward(&law, &boundary, &WITH_LAW()).unwrap();
        assert_converged(&solution);
        for (step, instant) in steps.iter().zip(&solution.instants) {
            let what =
                |quantity: &str| format!("{quantity}, pinned {}, factor {}", case["face_ends_pinned"], step["factor"]);
            let u = &instant.displacement;
            let wanted = pairs(numbers(&step["u"]));
            assert!(difference(u, &wanted) <= 1e-12 * largest(&wanted), "{}: {:e}", what("u"), difference(u, &wanted));
            let jumps = table(&step["jumps"]);
            let (found, tractions) = (model.jumps(u), model.tractions(&law, u));
            let peak = law.peak();
            for (k, wanted) in table(&step["tractions"]).iter().enumerate() {
                assert_close(found[k].normal, jumps[0][k], 1e-12 * largest(u), what("normal jump"));
                assert_close(found[k].tangential, jumps[1][k], 1e-12 * largest(u), what("tangential jump"));
                assert_close(tractions[k].normal, wanted[0], 1e-10 * peak.normal, what("T_n"));
                assert_close(tractions[k].tangential, wanted[1], 1e-10 * peak.tangential, what("T_t"));
            }
            let forces = model.forces(&law, u);
            let reactions = numbers(&step["reactions"]);
            let strongest = reactions.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            for (&dof, &wanted) in fixed.iter().zip(&reactions) {
                assert_close(forces[dof / 2][dof % 2], wanted, 1e-10 * strongest, what("reaction"));
            }
            let stresses = model.stresses(u);
            for (element, wanted) in step["gauss_stress"].as_array().unwrap().iter().enumerate() {
                for (point, wanted) in table(wanted).iter().enumerate() {
                    for c in 0..3 {
                        let scale = 1e-10 * 180.0;
                        assert_close(stresses[element][point].0[c], wanted[c], scale, what("stress"));
                    }
                }
            }
            let sensitivities = table(&step["sensitivities"]);
            for k in 0..4 {
                let wanted: Vec<f64> = sensitivities.iter().map(|row| row[k]).collect();
                let wanted = pairs(wanted);
                let off = difference(&instant.sensitivities[k], &wanted);
                assert!(off <= 1e-9 * largest(&wanted), "{} {k}: off by {off:e}", what("sensitivity"));
            }
            if let Some(tangent) = step.get("tangent_free") {
                let wanted = table(tangent);
                let free: Vec<usize> =
                    (0..2 * mesh.nodes().len()).filter(|&dof| model.unknown(dof / 2, dof % 2).is_some()).collect();
                let linearised = model.linearise(&law, u).unwrap();
                let place = |dof: usize| model.unknown(dof / 2, dof % 2).unwrap();
                let matrix = linearised.tangent();
                let stiffest = wanted.iter().flatten().fold(0.0_f64, |m, v| m.max(v.abs()));
                let loads = linearised.pseudo_loads();
                let wanted_loads = table(&step["pseudo_load_free"]);
                let parameters = wanted_loads.len() == 4;
                for (i, &row) in free.iter().enumerate() {
                    for (j, &column) in free.iter().enumerate() {
                        let at = matrix.pattern().place(place(row), place(column));
                        let found = at.map_or(0.0, |at| matrix.values()[at]);
                        assert_close(found, wanted[i][j], 1e-12 * stiffest, what("tangent"));
                    }
                    for k in 0..4 {
                        let wanted = if parameters { wanted_loads[k][i] } else { wanted_loads[i][k] };
                        let scale = loads[k].iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                        assert_close(loads[k][place(row)], wanted, 1e-10 * scale, what("pseudo-load"));
                    }
                }
            }
        }
    }
}

#[test]
fn the_debonding_test_converges_from_rest_at_all_instants() {
    let Some((mesh, boundary)) = virtual_r4() else { return };
    let model = model_of(&mesh, &boundary, ModelOptions::default());
    let law = adhesive([1.0; 4]);
    println!("{} unknowns, half bandwidth {}, {}", model.n_unknowns(), model.half_bandwidth(), model.solver());
    let begin = std::time::Instant::now();
    let solution = model.forward(&law, &boundary, &WITH_LAW()).unwrap();
    println!("19 instants with four sensitivities: {:.4} s", begin.elapsed().as_secs_f64());
    assert_converged(&solution);
    for (k, instant) in solution.instants.iter().enumerate() {
        let Instant { iterations, halvings, residual, residuals, displacement, .. } = instant;
        let residuals: Vec<String> = residuals.iter().map(|r| format!("{r:.1e}")).collect();
        let front = model.crack_front(&law, displacement);
        println!(
            "{}: {iterations} iterations, {halvings} halvings, {residual:.1e}, front {front:?}, {residuals:?}",
            k + 1
        );
        assert_eq!(*halvings, 0);
        assert!(*iterations <= 8);
    }
    // Quadratic: each residual is the square of the one before, up to a factor, until round-off.
    for instant in &solution.instants {
        let near = instant.residuals.windows(2).filter(|r| r[0] < 2e-3);
        for r in near {
            assert!(r[1] <= 5.0 * r[0] * r[0] + 1e-12, "{:e} after {:e}", r[1], r[0]);
        }
    }
}

#[test]
fn direct_differentiation_is_the_difference_of_solutions() {
    let Some((mesh, boundary)) = virtual_r4() else { return };
    let model = model_of(&mesh, &boundary, ModelOptions::default());
    let law = adhesive([1.0; 4]);
    let solution = model.forward(&law, &boundary, &WITH_LAW()).unwrap();
    for (k, value) in law.values().into_iter().enumerate() {
        // Truncation ~ h^4 of the relative step, round-off ~ 1e-14/h.
        let h = 1e-3 * value;
        let at = |x: f64| model.forward(&*with_value(&law, k, x), &boundary, &ForwardOptions::default()).unwrap();
        let fields = [-2.0, -1.0, 1.0, 2.0].map(|step| at(value + step * h));
        for instant in [1, 7, 13, 19] {
            let u = |field: usize, node: usize, c: usize| fields[field].instants[instant - 1].displacement[node][c];
            let found = &solution.instants[instant - 1].sensitivities[k];
            let wanted: Vec<[f64; 2]> = (0..found.len())
                .map(|n| [0, 1].map(|c| (8.0 * (u(2, n, c) - u(1, n, c)) - (u(3, n, c) - u(0, n, c))) / (12.0 * h)))
                .collect();
            let off = difference(found, &wanted) / largest(&wanted);
            println!("{} at instant {instant}: {off:.1e}", law.parameters()[k].name);
            assert!(off <= 1e-9, "{} at instant {instant}: {off:e}", law.parameters()[k].name);
        }
    }
}

#[test]
fn brittle_sets_converge_or_say_where_they_do_not() {
    let Some((mesh, boundary)) = virtual_r4() else { return };
    let model = model_of(&mesh, &boundary, ModelOptions::default());
    for factors in [[3.0, 0.4, 0.4, 1.0], [5.0, 0.2, 0.2, 1.0]] {
        let law = adhesive(factors);
        let solution = model.forward(&law, &boundary, &WITH_LAW()).unwrap();
        let linear_solves: u32 = solution.instants.iter().map(|i| i.iterations + i.rescue_iterations).sum();
        println!("{factors:?}: T_n,max {:.0} MPa, {linear_solves} iterations", law.peak().normal);
        for (k, instant) in solution.instants.iter().enumerate() {
            let Instant { status, iterations, halvings, rescue_iterations, residual, snapped, .. } = instant;
            println!(
                "  {}: {} {iterations} it, {halvings} halvings, {rescue_iterations} secant, {residual:.0e}, {snapped:?} {:?}",
                k + 1,
                status.name(),
                instant.failure
            );
            assert!(instant.displacement.iter().flatten().all(|u| u.is_finite()));
            assert!(instant.sensitivities.iter().flatten().flatten().all(|u| u.is_finite()));
            if *status == Status::NotConverged {
                assert!(!snapped.is_empty() && instant.failure.is_some());
            }
        }
        if factors[..3] == [3.0, 0.4, 0.4] {
            assert!(solution.converged() && linear_solves < 4000);
        }
    }
}
