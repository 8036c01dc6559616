//! Identification against the reference test: recovery, derivatives, an independent minimiser, statistics, verdict.

use crate::mechanics_common;
use mechanics_common::{adhesive, border_table, virtual_r4};
use quadrille::identify::{
    Band, Case, Fit, FitOptions, FitStatus, InverseCovariance, Local, NORMAL_95, Noise, Outcome, Precision, StepRegion,
    TrustRegionOptions, WeightKind, Weights, bands, cone_step, first_order, fit, largest_without_rigid_motion,
    latin_hypercube, minimise, profile, sweep,
};
use quadrille::io::joint::{BoundaryInput, JointInput, MeasurementInput, read_joint};
use quadrille::linalg::Dense;
use quadrille::mechanics::cohesive::Traction;
use quadrille::mechanics::{ForwardOptions, Joint};
use rayon::prelude::*;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::OnceLock;

const TRUTH: [f64; 3] = [1.0, 0.005, 0.05];
/// 1 px of the reference test, mm.
const PX: f64 = 0.00193125;

/// The seven starts, as factors of the truth.
const STARTS: [[f64; 3]; 7] = [
    [0.4, 0.4, 0.4],
    [3.0, 3.0, 3.0],
    [0.4, 3.0, 1.0],
    [3.0, 0.4, 0.4],
    [0.5, 2.5, 3.0],
    [2.0, 0.5, 2.0],
    [1.3, 0.8, 1.2],
];

/// Displacements of all nodes at every instant of the reference test.
fn truth() -> &'static Vec<Vec<[f64; 2]>> {
    static TRUTH: OnceLock<Vec<Vec<[f64; 2]>>> = OnceLock::new();
    TRUTH.get_or_init(|| {
        let (mesh, boundary) = virtual_r4().unwrap();
        let model = mechanics_common::model_of(&mesh, &boundary, Default::default());
        let solution = model.forward(&adhesive([1.0; 4]), &boundary, &ForwardOptions::default()).unwrap();
        solution.instants.into_iter().map(|instant| instant.displacement).collect()
    })
}

/// A standard normal number (Box and Muller) from a generator of its own, so that a seed means the same for ever.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn draw(&mut self) -> f64 {
        let (u, v) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    }
}

/// Fields with noise of standard deviation `sigma` (mm, of one frame) whose half comes from the common reference.
fn noisy(sigma: f64, seed: u64) -> Vec<Vec<[f64; 2]>> {
    let mut normal = Normal(seed.wrapping_mul(0x2545_F491_4F6C_DD1D));
    let share = sigma * 0.5_f64.sqrt();
    let n = truth()[0].len();
    let common: Vec<[f64; 2]> = (0..n).map(|_| [0, 1].map(|_| share * normal.draw())).collect();
    let mut add = |u: &[f64; 2], e: &[f64; 2]| [0, 1].map(|c| u[c] - e[c] + share * normal.draw());
    truth().iter().map(|field| field.iter().zip(&common).map(|(u, e)| add(u, e)).collect()).collect()
}

/// A case of the reference test, whose constants are exact because its data are computed: the measurement's table and
/// the fit's table are given, files stand in `folder`.
fn case_text(base: &Path, measurement: &str, fit: &str, border: &str) -> String {
    format!(
        "[mesh]\nfile = \"{0}/mesh.json\"\n[boundary]\nfile = \"{border}\"\n[substrate]\nmodel = \"ramberg-osgood\"\n\
         E_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\nexact = true\n[cohesive]\nphi_n_N_per_mm = 1.0\n\
         delta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\nexact = true\n[measurement]\nfile = \"measured.csv\"\n{measurement}\n[fit]\nexact = true\n{fit}\n",
        base.display()
    )
}

fn write_fields(folder: &Path, fields: &[Vec<[f64; 2]>]) {
    let mut text = "instant,node,ux_mm,uy_mm\n".to_owned();
    for (k, field) in fields.iter().enumerate() {
        for (node, u) in field.iter().enumerate() {
            writeln!(text, "{},{node},{:.17e},{:.17e}", k + 1, u[0], u[1]).unwrap();
        }
    }
    std::fs::write(folder.join("measured.csv"), text).unwrap();
}

const THREE: &str = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\"]";

/// The input of an identification of `fields`; with `noisy_border` the border is prescribed as measured.
fn input(fields: &[Vec<[f64; 2]>], measurement: &str, fit: &str, noisy_border: bool) -> Option<JointInput> {
    let base = mechanics_common::reference_folder()?.join("virtual_r4").canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_fields(folder.path(), fields);
    let border =
        if noisy_border { "border.csv".to_owned() } else { format!("{}/boundary_displacements.csv", base.display()) };
    if noisy_border {
        let (mesh, boundary) = virtual_r4().unwrap();
        std::fs::write(folder.path().join("border.csv"), border_table(&mesh, boundary.nodes(), fields)).unwrap();
    }
    let case = folder.path().join("case.toml");
    std::fs::write(&case, case_text(&base, measurement, fit, &border)).unwrap();
    Some(read_joint(&case).unwrap())
}

fn joint_of(input: &JointInput) -> Joint {
    Case::joint(input).unwrap()
}

fn case_of<'a>(joint: &'a Joint, input: &JointInput) -> Case<'a> {
    Case::new(joint, input, Path::new("case.toml")).unwrap()
}

/// How a case is fitted, without the tests of the model (tests/identification/doubt.rs): these are many fits.
fn undoubted(case: &Case<'_>) -> FitOptions {
    FitOptions { doubt: false, ..case.options.clone() }
}

fn fitted(input: &JointInput) -> Fit {
    let joint = joint_of(input);
    let case = case_of(&joint, input);
    fit(&case.problem, &undoubted(&case)).unwrap()
}

#[test]
fn noise_free_data_give_the_parameters_back_from_seven_starts() {
    let starts: Vec<String> =
        STARTS.iter().map(|f| format!("[{}, {}, {}]", f[0] * TRUTH[0], f[1] * TRUTH[1], f[2] * TRUTH[2])).collect();
    let fit = format!(
        "{THREE}\nstarts = [{}]\n[fit.start]\nphi_n = 1.3\ndelta_n = 0.004\ndelta_t = 0.06",
        starts[..6].join(", ")
    );
    let Some(_) = mechanics_common::reference_folder() else { return };
    let Some(input) = input(truth(), "weights = \"paper\"", &fit, false) else { return };
    let begin = std::time::Instant::now();
    let fit = fitted(&input);
    println!("{:.1} s", begin.elapsed().as_secs_f64());
    assert_eq!(fit.starts.len(), 7);
    for start in &fit.starts {
        println!("{start:?}");
    }
    for start in &fit.starts {
        assert_eq!(start.status, FitStatus::Converged, "{start:?}");
        for (end, truth) in start.end.iter().zip(TRUTH) {
            // The figure; Gauss-Newton on data without noise converges quadratically.
            assert!((end / truth - 1.0).abs() < 1e-9, "{start:?}");
        }
        assert!(start.evaluations <= 25 || start.rescued > 0, "{start:?}");
    }
    // The reference's figure for three parameters, 80 nodes and the paper's weights.
    assert!((fit.condition() - 4.5).abs() < 0.05, "{}", fit.condition());
    let verdict = fit.verdict;
    assert!(verdict.determined() && verdict.sentences[0].contains("are determined"), "{verdict:?}");
    assert!(verdict.sentences[0].contains("given r = 4, E = 72 GPa, nu = 0.33"), "{verdict:?}");
    assert!(verdict.thresholds.contains("25 %"), "{verdict:?}");
}

#[test]
fn four_parameters_are_not_determined_by_this_test_and_the_verdict_says_which_are_known_only_together() {
    let more = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\", \"r\"]\n[fit.start]\nphi_n = 1.2\nr = 5";
    mechanics_common::reference_folder();
    let Some(exact) = mechanics_common::reference_folder().and_then(|_| input(truth(), "", more, false)) else {
        return;
    };
    let fit = fitted(&exact);
    for (p, truth) in fit.parameters.iter().zip([1.0, 0.005, 0.05, 4.0]) {
        // Without noise even r comes back; the condition of 85 costs two digits.
        assert!((p.value / truth - 1.0).abs() < 1e-8, "{p:?}");
    }
    // The reference's figures: condition 85, correlation of delta_t and r 0.99.
    assert!((fit.condition() - 85.0).abs() < 2.0, "{}", fit.condition());
    let correlation = fit.correlation.unwrap()[(2, 3)];
    assert!((correlation.abs() - 0.99).abs() < 0.006, "{correlation}");
    // Known to a few per cent is known, whatever condition and correlation: 52 % at 0.1 px are 0.5 % at 0.001 px.
    let fit_at = |px: f64| fitted(&input(&noisy(px * PX, 1), "", more, false).expect("the reference is there"));
    let quiet = fit_at(0.001).verdict;
    assert_eq!(quiet.outcome, Outcome::Determined, "{quiet:?}");
    let loud = fit_at(0.1).verdict;
    let text = loud.sentences.join(". ");
    assert_eq!(loud.outcome, Outcome::NotDetermined, "{text}");
    for words in ["r is not determined", "known only together with", "(correlation 0.99", "another mode mixity"] {
        assert!(text.contains(words), "'{words}' is not in: {text}");
    }
}

#[test]
fn a_parameter_that_ends_on_its_bound_is_flagged_and_no_bound_is_ever_passed() {
    mechanics_common::reference_folder();
    let fit = format!(
        "{THREE}\nintervals = \"linear\"\n[fit.start]\nphi_n = 1.5\ndelta_n = 0.0045\n[fit.lower]\ndelta_t = 0.03\n[fit.upper]\ndelta_n = 0.0047"
    );
    let Some(input) = mechanics_common::reference_folder().and_then(|_| input(truth(), "", &fit, false)) else {
        return;
    };
    let fit = fitted(&input);
    assert_eq!(fit.status, FitStatus::Converged, "{}", fit.reason);
    assert_eq!(fit.parameters.iter().map(|p| p.at_bound).collect::<Vec<_>>(), [false, true, false]);
    assert_eq!(fit.parameters[1].value, 0.0047);
    for iteration in &fit.history {
        assert!(iteration.z[1] <= 0.0047 && iteration.z[2] >= 0.03, "{iteration:?}");
    }
}

#[test]
fn a_sweep_over_r_keeps_the_initial_normal_stiffness_and_the_objective_while_the_parameters_move() {
    let Some(input) = near("weights = \"paper\"", "") else { return };
    let input = with_fields(&input, &noisy(0.5 * PX, 5));
    let joint = joint_of(&input);
    let case = case_of(&joint, &input);
    let begin = std::time::Instant::now();
    let rows = sweep(&case.problem, &case.options, 3, &[3.0, 4.0, 5.0, 6.0]).unwrap();
    println!("sweep of four values: {:.1} s", begin.elapsed().as_secs_f64());
    for pair in rows.windows(2) {
        let [a, b] = [0, 1].map(|k| pair[k].fit.parameters.iter().map(|p| p.value).collect::<Vec<_>>());
        // The paper's Table 2: phi_n and delta_n fall with r, delta_t and phi_t rise.
        assert!(b[0] < a[0] && b[1] < a[1] && b[2] > a[2], "{a:?} {b:?}");
        assert!(pair[1].value * b[0] > pair[0].value * a[0]);
        let stiffness = (a[0] / (a[1] * a[1])) / (b[0] / (b[1] * b[1]));
        assert!((stiffness - 1.0).abs() < 0.02, "{stiffness}");
        // The figure: omega flat within 1e-3 under noise.
        assert!((pair[0].fit.omega / pair[1].fit.omega - 1.0).abs() < 1e-3);
    }
}

#[test]
fn the_effect_of_the_element_size_is_what_a_refit_on_a_finer_mesh_moves() {
    let Some(mut input) = reference_input("weights = \"paper\"\nboundary = \"exact\"\nnoise_mm = 1e-5") else { return };
    let found = fitted(&input);
    input.case.mesh.refine = Some(2);
    let finer = fitted(&input);
    for (p, fine) in found.parameters.iter().zip(&finer.parameters) {
        let (told, moved) = (p.discretisation.unwrap(), fine.value - p.value);
        // First order: the change is up to 2 %, its second order some per cent of it.
        assert!(moved.abs() > 1e-3 * p.value, "{}: {moved}", p.parameter.name);
        assert!((told - moved).abs() < 0.1 * moved.abs(), "{}: {told} told, {moved} found", p.parameter.name);
        // Included: one more standard uncertainty.
        let half = NORMAL_95 * p.std.unwrap().hypot(told);
        let [low, high] = p.interval95.unwrap();
        assert!((high - p.value - half).abs() < 1e-12 && (p.value - low - half).abs() < 1e-12, "{p:?}");
        // Elements half as large leave about a quarter of it.
        assert!(fine.discretisation.unwrap().abs() < 0.5 * told.abs(), "{}: {fine:?}", p.parameter.name);
    }
}

/// Data without noise, the effect of the element size in the intervals.
fn reference_input(measurement: &str) -> Option<JointInput> {
    mechanics_common::reference_folder()?;
    input(truth(), measurement, &format!("{THREE}\ndiscretisation = \"included\"\nintervals = \"linear\""), false)
}

#[test]
fn one_step_from_nearby_is_the_fit_to_second_order() {
    let Some(input) = reference_input("weights = \"paper\"\nboundary = \"exact\"") else { return };
    let joint = joint_of(&input);
    let case = case_of(&joint, &input);
    let error = |off: f64| {
        let x = [TRUTH[0] * (1.0 + off), TRUTH[1] * (1.0 - off), TRUTH[2] * (1.0 + off)];
        let end = first_order(&case.problem, WeightKind::Paper, &x).unwrap();
        end.iter().zip(TRUTH).map(|(end, truth)| (end / truth - 1.0).abs()).fold(0.0, f64::max)
    };
    let [far, near] = [0.04, 0.02].map(error);
    println!("off by 4 %: {far:.2e}; by 2 %: {near:.2e}");
    assert!(far < 0.01 && (3.0..5.5).contains(&(far / near)), "{far} and {near}");
}

#[test]
fn where_a_large_residual_stays_the_minimum_is_found_in_few_evaluations() {
    // r = (z + 1, l z^2 + z - 1) of Dennis and Schnabel (1983, section 10.2): with l = -0.9 plain Gauss-Newton gains a
    // factor of 0.9 a step about z = 0, which makes two hundred steps to 1e-9.
    let evaluate = |z: &[f64]| {
        let (z, l) = (z[0], -0.9);
        let (r, j) = ([z + 1.0, l * z * z + z - 1.0], [1.0, 2.0 * l * z + 1.0]);
        let b = -(0..2).map(|k| j[k] * r[k]).sum::<f64>();
        let h = Dense::from_fn(1, 1, |_, _| j[0] * j[0] + j[1] * j[1]);
        Some(Local { omega: r[0] * r[0] + r[1] * r[1], b: vec![b], h, rescued: false })
    };
    let end = minimise(&[0.3], [&[-5.0], &[5.0]], &TrustRegionOptions::default(), evaluate);
    println!("{} evaluations, z = {:e}", end.evaluations, end.z[0]);
    assert_eq!(end.status, FitStatus::Converged, "{}", end.reason);
    assert!(end.z[0].abs() < 1e-8 && end.evaluations < 20, "{end:?}");
}

#[test]
fn a_fit_that_stands_still_ends() {
    // A slope that lowers an objective of 10 by 1e-12 a step, for ever: each step is accepted, and nothing is gained.
    let evaluate = |z: &[f64]| {
        let h = Dense::from_fn(1, 1, |_, _| 1e-30);
        Some(Local { omega: 10.0 - 1e-12 * z[0], b: vec![5e-13], h, rescued: false })
    };
    let end = minimise(&[0.0], [&[-1e6], &[1e6]], &TrustRegionOptions::default(), evaluate);
    assert!(end.status == FitStatus::Converged && end.evaluations == 11, "{end:?}");
    assert!(end.reason.contains("nothing beside the noise"), "{}", end.reason);
}

#[test]
fn the_profile_of_a_parameter_is_its_interval_where_the_problem_is_nearly_linear() {
    let Some(input) = near("weights = \"uniform\"\nboundary = \"exact\"\nnoise_mm = 5e-5", "profile = \"delta_n\"")
    else {
        return;
    };
    let joint = joint_of(&input);
    let case = case_of(&joint, &input);
    let found = fit(&case.problem, &undoubted(&case)).unwrap();
    let profile = profile(&case.problem, &case.options, &found, case.profile.unwrap()).unwrap();
    let p = &found.parameters[1];
    let half = NORMAL_95 * p.std.unwrap();
    let interval = [p.value - half, p.value + half];
    for side in 0..2 {
        // The noise is small: what is left is the curvature, and that of the straight pieces between points.
        assert!((profile.interval95[side].unwrap() - interval[side]).abs() < 0.03 * half, "{profile:?} {interval:?}");
    }
}

/// The same input with other measured fields, the border prescribed as they say.
fn with_fields(input: &JointInput, fields: &[Vec<[f64; 2]>]) -> JointInput {
    let mut input = input.clone();
    let BoundaryInput::Table(border) = &mut input.boundary else { panic!("a table") };
    for (values, field) in border.instants.iter_mut().zip(fields) {
        values.iter_mut().zip(&border.nodes).for_each(|(u, &node)| *u = field[node as usize]);
    }
    let Some(MeasurementInput::Table(table)) = &mut input.measurement else { panic!("a table") };
    for (rows, field) in table.instants.values_mut().zip(fields) {
        *rows = (0..).zip(field.iter().copied()).collect();
    }
    input
}

/// The case of all statistics: it starts near the truth.
fn near(measurement: &str, more: &str) -> Option<JointInput> {
    mechanics_common::reference_folder()?;
    let fit = format!(
        "{THREE}\ndiscretisation = \"off\"\nintervals = \"linear\"\n{more}\n[fit.start]\nphi_n = 1.01\ndelta_n = 0.00498\ndelta_t = 0.0502"
    );
    input(truth(), measurement, &fit, true)
}

#[test]
fn gradient_and_normal_matrix_are_the_differences_of_objective_and_residual() {
    let Some(input) = near("weights = \"paper\"", "") else { return };
    let input = with_fields(&input, &noisy(0.1 * PX, 3));
    let joint = joint_of(&input);
    let problem = case_of(&joint, &input).problem;
    let z = problem.unknowns.scaled(&[1.2, 0.0045, 0.055]);
    let at = |z: &[f64]| problem.evaluate(&problem.unknowns.unscaled(z), &joint.boundary).unwrap().unwrap();
    let here = at(&z);
    let by_boundary = problem.by_boundary(&here).unwrap();
    let full = InverseCovariance::new(&problem.noise, 19, by_boundary).unwrap();
    let kinds = [
        problem.diagonal_weights(WeightKind::Paper),
        problem.diagonal_weights(WeightKind::Uniform),
        Weights::Inverse(full),
    ];
    let moved = |k: usize, h: f64| {
        let mut z = z.clone();
        z[k] += h;
        at(&z)
    };
    let h = 2e-4; // of a logarithm: five points leave h^4 = 1.6e-15, round-off 1e-12/h
    let points: Vec<Vec<_>> = (0..3).map(|k| [-2.0, -1.0, 1.0, 2.0].map(|s| moved(k, s * h)).into()).collect();
    let five = |values: [f64; 4]| (8.0 * (values[2] - values[1]) - (values[3] - values[0])) / (12.0 * h);
    for weights in &kinds {
        let local = here.local(weights, &problem.noise);
        let mut jacobian: Vec<Dense> = here.jacobian();
        for k in 0..3 {
            let omega: Vec<f64> = points[k].iter().map(|e| e.local(weights, &problem.noise).omega).collect();
            let wanted = -0.5 * five([omega[0], omega[1], omega[2], omega[3]]);
            let scale = (local.omega * local.h[(k, k)]).sqrt();
            assert!((local.b[k] - wanted).abs() < 1e-7 * scale, "{k}: {} {wanted} of {scale}", local.b[k]);
            for (i, block) in jacobian.iter_mut().enumerate() {
                for row in 0..block.n_rows() {
                    let value = |p: usize| -points[k][p].blocks[i][(row, 0)];
                    block[(row, k)] = five([value(0), value(1), value(2), value(3)]);
                }
            }
        }
        let weighted = weights.times(&problem.noise, &jacobian);
        let mut h = Dense::zeros(3, 3);
        jacobian.iter().zip(&weighted).for_each(|(j, wj)| h.add(1.0, &j.transposed_times(wj)));
        for r in 0..3 {
            for c in 0..3 {
                let scale = (local.h[(r, r)] * local.h[(c, c)]).sqrt();
                assert!(
                    (local.h[(r, c)] - h[(r, c)]).abs() < 1e-7 * scale,
                    "{r} {c}: {} {}",
                    local.h[(r, c)],
                    h[(r, c)]
                );
            }
        }
    }
}

#[test]
fn a_minimiser_without_derivatives_ends_at_the_same_place_on_noisy_data() {
    let Some(input) = near("weights = \"paper\"", "") else { return };
    let input = with_fields(&input, &noisy(0.2 * PX, 11));
    let joint = joint_of(&input);
    let case = case_of(&joint, &input);
    let found = fit(&case.problem, &undoubted(&case)).unwrap();
    assert_eq!(found.status, FitStatus::Converged, "{}", found.reason);
    let (problem, unknowns) = (&case.problem, &case.problem.unknowns);
    let weights = problem.diagonal_weights(WeightKind::Paper);
    let omega = |z: &[f64]| {
        let evaluation = problem.evaluate(&unknowns.unscaled(z), &joint.boundary).unwrap().unwrap();
        let weighted = weights.times(&problem.noise, &evaluation.blocks);
        let of = |(x, wx): (&Dense, &Dense)| x.column(0).iter().zip(wx.column(0)).map(|(a, b)| a * b).sum::<f64>();
        evaluation.blocks.iter().zip(&weighted).map(of).sum::<f64>()
    };
    // Minimum of the parabola through ten values, again and again: it knows the objective alone.
    let end = unknowns.scaled(&found.parameters.iter().map(|p| p.value).collect::<Vec<_>>());
    let mut z: Vec<f64> = end.iter().zip([0.06, -0.05, 0.04]).map(|(z, off)| z + off).collect();
    let mut h = 0.02;
    for _ in 0..5 {
        let at = |moves: &[(usize, f64)]| {
            let mut z = z.clone();
            moves.iter().for_each(|&(k, step)| z[k] += step);
            omega(&z)
        };
        let middle = at(&[]);
        let mut curvature = Dense::zeros(3, 3);
        let mut slope = [0.0; 3];
        let single: Vec<[f64; 2]> = (0..3).map(|k| [at(&[(k, h)]), at(&[(k, -h)])]).collect();
        for k in 0..3 {
            slope[k] = (single[k][0] - single[k][1]) / (2.0 * h);
            curvature[(k, k)] = (single[k][0] + single[k][1] - 2.0 * middle) / (h * h);
            for j in 0..k {
                let both = at(&[(k, h), (j, h)]);
                let mixed = (both - single[k][0] - single[j][0] + middle) / (h * h);
                (curvature[(k, j)], curvature[(j, k)]) = (mixed, mixed);
            }
        }
        let step = curvature.cholesky().unwrap().solve(&Dense::from_fn(3, 1, |k, _| -slope[k]));
        (0..3).for_each(|k| z[k] += step[(k, 0)]);
        h = (0.3 * h).max(3e-4);
    }
    for (k, (brute, end)) in z.iter().zip(&end).enumerate() {
        // The figure; parabolas of h = 3e-4 are off by h^2 = 1e-7.
        assert!((brute - end).abs() < 1e-6, "parameter {k}: {} from the truth, {} apart", end, brute - end);
    }
    assert!(found.omega <= omega(&z) * (1.0 + 1e-12));
}

/// Fits of many draws of noise: the predicted standard deviations, the errors, and the share of intervals and bands
/// that hold. Draws whose fit did not converge inside its bounds are counted and left out.
struct Draws {
    converged: usize,
    predicted: [f64; 3],
    scatter: [f64; 3],
    bias: [f64; 3],
    covered: f64,
    in_band: f64,
    omega: f64,
}

/// Errors and predicted standard deviations of the parameters, share of tractions in their bands, omega over its
/// expected value.
type Row = (Vec<[f64; 2]>, f64, f64);

fn draws(input: &JointInput, sigma_px: f64, seeds: u64, with_bands: bool) -> Draws {
    let law = adhesive([1.0; 4]);
    let (mesh, boundary) = virtual_r4().unwrap();
    let model = mechanics_common::model_of(&mesh, &boundary, Default::default());
    let tractions: Vec<Vec<Traction>> = truth().iter().map(|u| model.tractions(&law, u)).collect();
    let rows: Vec<Row> = (1..=seeds)
        .into_par_iter()
        .filter_map(|seed| {
            let input = with_fields(input, &noisy(sigma_px * PX, seed));
            let joint = joint_of(&input);
            let case = case_of(&joint, &input);
            let found = fit(&case.problem, &undoubted(&case)).unwrap();
            if found.status != FitStatus::Converged || found.parameters.iter().any(|p| p.at_bound) {
                return None;
            }
            let of = |(p, truth): (&quadrille::identify::FittedParameter, f64)| {
                [p.value / truth - 1.0, p.std.unwrap() / truth]
            };
            let bands: Vec<Band> = if with_bands { bands(&case.problem, &found).unwrap() } else { Vec::new() };
            let (mut inside, mut n) = (0.0, 0.0);
            for band in &bands {
                for (k, t) in tractions[band.instant - 1].iter().enumerate() {
                    n += 1.0;
                    let off = (band.traction[k].normal - t.normal).abs();
                    inside += f64::from(off <= NORMAL_95 * band.std[k].normal);
                }
            }
            let expected = found.statistics.as_ref().unwrap().expected_omega;
            let errors = found.parameters.iter().zip(TRUTH).map(of).collect();
            Some((errors, inside / f64::max(n, 1.0), found.omega / expected))
        })
        .collect();
    let n = rows.len() as f64;
    let mean = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>() / n;
    let bias = [0, 1, 2].map(|k| mean(&|row| row.0[k][0]));
    let covered = |row: &Row| row.0.iter().filter(|[off, std]| off.abs() <= NORMAL_95 * std).count() as f64 / 3.0;
    let draws = Draws {
        converged: rows.len(),
        predicted: [0, 1, 2].map(|k| mean(&|row| row.0[k][1].powi(2)).sqrt()),
        scatter: [0, 1, 2].map(|k| (mean(&|row| (row.0[k][0] - bias[k]).powi(2)) * n / (n - 1.0)).sqrt()),
        bias,
        covered: mean(&covered),
        in_band: mean(&|row| row.1),
        omega: mean(&|row| row.2),
    };
    println!(
        "{sigma_px} px, {n} of {seeds} draws converged: predicted {:.3?} %, scatter {:.3?} %, bias {:.3?} %, covered {:.1} %, T_n in band {:.1} %, \
         omega over expected {:.3}",
        draws.predicted.map(|v| 100.0 * v),
        draws.scatter.map(|v| 100.0 * v),
        draws.bias.map(|v| 100.0 * v),
        100.0 * draws.covered,
        100.0 * draws.in_band,
        draws.omega
    );
    draws
}

#[test]
fn predicted_uncertainties_are_the_scatter_of_twenty_draws_and_intervals_and_bands_hold() {
    assert_predicted(20, 0.3);
}

#[test]
#[ignore = "a minute: make study"]
fn predicted_uncertainties_are_the_scatter_of_forty_draws_and_intervals_and_bands_hold() {
    assert_predicted(40, 0.15);
    let Some(input) = near("weights = \"paper\"", "") else { return };
    // Beyond what a linear prediction covers: reported, and nothing else than that most fits end.
    assert!(draws(&input, 0.4, 10, false).converged > 5);
}

/// At 0.05 px; the figure is 0.15 of forty draws, whose scatter is itself known to 11 % (that of 20 to 16 %).
/// At 0.1 px: `make study`.
#[track_caller]
fn assert_predicted(n: u64, within: f64) {
    let Some(input) = near("weights = \"paper\"\nnoise_mm = 9.65625e-5", "") else { return };
    let low = draws(&input, 0.05, n, true);
    assert_eq!(low.converged as u64, n);
    for k in 0..3 {
        assert!((low.predicted[k] / low.scatter[k] - 1.0).abs() < within, "parameter {k}");
    }
    // What the intervals of 20 draws hold, three in each that hang together, is known to 5 %: two of these below 95 %.
    assert!(low.covered >= 0.85 && low.in_band >= 0.85, "{} and {} held", low.covered, low.in_band);
    assert!((low.omega - 1.0).abs() < 0.1, "{}", low.omega);
}

#[test]
#[ignore = "ten minutes: make study"]
fn four_hundred_draws_for_the_table_in_the_documentation() {
    for (sigma_px, bands) in [(0.05, true), (0.1, true), (0.4, false)] {
        let Some(input) = near("weights = \"paper\"", "") else { return };
        draws(&input, sigma_px, 400, bands);
        let Some(input) = near("nodes = \"free\"\nweights = \"covariance\"", "") else { return };
        draws(&input, sigma_px, 40, bands);
        let Some(input) = near("nodes = \"free\"\nweights = \"covariance\"\nboundary = \"estimated\"", "") else {
            return;
        };
        draws(&input, sigma_px, 40, bands);
    }
}

#[test]
fn covariance_weights_have_smaller_uncertainties_that_hold_and_an_estimated_boundary_changes_little() {
    let measurement = "nodes = \"free\"\nweights = \"covariance\"\nnoise_mm = 9.65625e-5";
    let Some(free) = near(&format!("{measurement}\nborder = \"free\""), "") else { return };
    for (p, truth) in fitted(&free).parameters.iter().zip(TRUTH) {
        assert!((p.value / truth - 1.0).abs() < 1e-9, "{p:?}");
    }
    // What smoothing cuts off the border of data without noise is nothing beside the noise that was stated.
    let Some(input) = near(measurement, "") else { return };
    for (p, truth) in fitted(&input).parameters.iter().zip(TRUTH) {
        let off = (p.value - truth).abs() / p.std.unwrap();
        assert!((1e-6..0.3).contains(&off), "{off}: {p:?}");
    }
    let full = draws(&input, 0.05, 4, true);
    let estimated = format!("{measurement}\nboundary = \"estimated\"");
    let Some(input) = near(&estimated, "") else { return };
    let with_boundary = draws(&input, 0.05, 2, true);
    assert_eq!((full.converged, with_boundary.converged), (4, 2));
    for draws in [&full, &with_boundary] {
        for k in 0..3 {
            // Few draws: their scatter is known to 40 %; a bias or a wrong weight shows all the same.
            let error = (draws.scatter[k].powi(2) + draws.bias[k].powi(2)).sqrt();
            assert!(error < 2.5 * draws.predicted[k], "parameter {k}: {error} for {}", draws.predicted[k]);
        }
        assert!((draws.omega - 1.0).abs() < 0.05, "{}", draws.omega);
    }
    // The bands of one draw are right or wrong together along the joint: two draws cannot tell a coverage.
    assert!(full.in_band > 0.85, "{}", full.in_band);
}

#[test]
fn the_weights_with_boundary_and_common_reference_eliminated_are_the_dense_formula() {
    // W = P - P T (T^T P T)^-1 T^T P of THEORY 7, written out, for three instants of four rows and two boundary
    // unknowns.
    let (rows, instants, n_border) = (4, 3, 2);
    let mut normal = Normal(7);
    let mut random = |r: usize, c: usize| {
        let values: Vec<f64> = (0..r * c).map(|_| normal.draw()).collect();
        Dense::from_fn(r, c, |i, j| values[i + j * r])
    };
    let root = random(rows, rows);
    let mut m = root.transposed_times(&root);
    (0..rows).for_each(|k| m[(k, k)] += 1.0);
    let t: Vec<Dense> = (0..instants).map(|_| random(rows, n_border)).collect();
    let x: Vec<Dense> = (0..instants).map(|_| random(rows, 2)).collect();
    for common in [0.0, 1.0, 0.25] {
        let covariance = m.cholesky().unwrap().inverse();
        let noise = Noise {
            precision: Precision::Marginal { covariance, matrix: m.clone() },
            common,
            on_boundary: true,
            sigma: Some(0.5),
            ratio: None,
            source: String::new(),
        };
        let weights = Weights::Inverse(InverseCovariance::new(&noise, instants, t.clone()).unwrap());
        let found = weights.times(&noise, &x);
        let n = rows * instants;
        let share = common / (1.0 + common * instants as f64);
        let tie = |i: usize, j: usize| 4.0 * (f64::from(i == j) - share);
        let p = Dense::from_fn(n, n, |r, c| tie(r / rows, c / rows) * m[(r % rows, c % rows)]);
        let all_t = Dense::from_fn(n, n_border * instants, |r, c| {
            if r / rows == c / n_border { t[r / rows][(r % rows, c % n_border)] } else { 0.0 }
        });
        let pt = p.times(&all_t);
        let inner = all_t.transposed_times(&pt).cholesky().unwrap();
        let all_x = Dense::from_fn(n, 2, |r, c| x[r / rows][(r % rows, c)]);
        let mut wanted = p.times(&all_x);
        wanted.add(-1.0, &pt.times(&inner.solve(&pt.transposed_times(&all_x))));
        for r in 0..n {
            for c in 0..2 {
                let (found, wanted) = (found[r / rows][(r % rows, c)], wanted[(r, c)]);
                // Matrices of condition 100 at most.
                assert!((found - wanted).abs() < 1e-11, "common {common}, row {r}: {found} {wanted}");
            }
        }
    }
}

#[test]
fn the_step_of_the_cone_program_is_the_best_of_its_region() {
    let mut normal = Normal(21);
    for case in 0..200 {
        let mut random = |n: usize| -> Vec<f64> { (0..n).map(|_| normal.draw()).collect() };
        let (root, b) = (random(9), random(3));
        let root = Dense::from_fn(3, 3, |r, c| root[r + 3 * c]);
        let mut h = root.transposed_times(&root);
        (0..3).for_each(|k| h[(k, k)] += 0.05);
        // Sizes from 1e-8 to 1: the tolerances of the solver are absolute.
        let size = 10f64.powi(-(case % 9));
        let b: Vec<f64> = b.iter().map(|b| b * size).collect();
        let bounds: Vec<f64> = random(6).iter().map(|v| v.abs() * size).collect();
        let lower: Vec<f64> = bounds[..3].iter().map(|v| -v).collect();
        let (upper, radius) = (&bounds[3..], (0.2 + random(1)[0].abs()) * size);
        let step = cone_step(&h, &b, &StepRegion { lower: &lower, upper, radius }).unwrap();
        let length = step.iter().map(|s| s * s).sum::<f64>().sqrt();
        assert!(length <= radius * (1.0 + 1e-12), "case {case}");
        assert!((0..3).all(|k| step[k] >= lower[k] && step[k] <= upper[k]), "case {case}");
        let value = |s: &[f64]| {
            let quadratic = |r: usize| (0..3).map(|c| s[r] * h[(r, c)] * s[c]).sum::<f64>();
            (0..3).map(|r| 0.5 * quadratic(r) - b[r] * s[r]).sum::<f64>()
        };
        // Projected gradient, slowly, as the second opinion.
        let mut other = vec![0.0; 3];
        let most = (0..3).map(|r| (0..3).map(|c| h[(r, c)].abs()).sum::<f64>()).fold(0.0, f64::max);
        for _ in 0..4000 {
            let slope: Vec<f64> = (0..3).map(|r| b[r] - (0..3).map(|c| h[(r, c)] * other[c]).sum::<f64>()).collect();
            let moved: Vec<f64> = (0..3).map(|k| other[k] + slope[k] / most).collect();
            other = project(&moved, &lower, upper, radius);
        }
        let (found, wanted) = (value(&step), value(&other));
        assert!(found <= wanted + 1e-6 * wanted.abs(), "case {case}: {found:e} for {wanted:e}");
    }
}

/// The nearest point of box and ball, by alternating projections with corrections (Dykstra).
fn project(point: &[f64], lower: &[f64], upper: &[f64], radius: f64) -> Vec<f64> {
    let (mut x, mut p, mut q) = (point.to_vec(), vec![0.0; 3], vec![0.0; 3]);
    for _ in 0..60 {
        let y: Vec<f64> = (0..3).map(|k| (x[k] + p[k]).clamp(lower[k], upper[k])).collect();
        p = (0..3).map(|k| x[k] + p[k] - y[k]).collect();
        let with: Vec<f64> = (0..3).map(|k| y[k] + q[k]).collect();
        let length = with.iter().map(|v| v * v).sum::<f64>().sqrt();
        x = with.iter().map(|v| v * (radius / length.max(radius))).collect();
        q = (0..3).map(|k| with[k] - x[k]).collect();
    }
    x
}

#[test]
fn a_latin_hypercube_has_one_point_in_each_slice_and_a_seed_means_the_same_points() {
    let points = latin_hypercube(9, [&[0.0, -2.0], &[1.0, 4.0]], 5);
    for (c, [low, high]) in [[0.0, 1.0], [-2.0, 4.0]].into_iter().enumerate() {
        let mut slices: Vec<usize> = points.iter().map(|p| ((p[c] - low) / (high - low) * 9.0) as usize).collect();
        slices.sort_unstable();
        assert_eq!(slices, (0..9).collect::<Vec<_>>());
    }
    assert_eq!(points, latin_hypercube(9, [&[0.0, -2.0], &[1.0, 4.0]], 5));
    assert_ne!(points, latin_hypercube(9, [&[0.0, -2.0], &[1.0, 4.0]], 6));
}

#[test]
fn the_scale_of_an_instant_is_what_a_rigid_motion_leaves() {
    // A stretch along x of 1e-3 with a motion that must not count.
    let points: Vec<[f64; 2]> = (0..35).map(|k| [f64::from(k % 7), f64::from(k / 7)]).collect();
    let moved = |&[x, y]: &[f64; 2]| ([x, y], [1e-3 * x + 5.0 - 0.02 * y, -3.0 + 0.02 * x]);
    let largest = largest_without_rigid_motion(&points.iter().map(moved).collect::<Vec<_>>());
    // Round-off of the motion of 5 mm.
    assert!((largest[0] - 3e-3).abs() < 1e-14 && largest[1] < 1e-14, "{largest:?}");
}
