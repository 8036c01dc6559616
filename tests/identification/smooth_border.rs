//! A smooth border: what its noise becomes, when the data ask for it, and what fits with it are worth.

use crate::intervals::{Known, PX, TRUTH, covariance, small};
use quadrille::identify::{
    Border, Evaluation, Fit, FitOptions, Intervals, Noise, Precision, Problem, WeightKind, bands, fit,
};
use quadrille::linalg::Dense;
use quadrille::mechanics::Joint;
use rayon::prelude::*;
use std::sync::Arc;

const SIGMA: f64 = 0.02 * PX;

/// Noise of `SIGMA` mm in each frame, half of its variance from the common reference, that neighbours share.
fn coloured(known: &Known) -> Noise {
    let nodes = known.mesh.nodes();
    let distance = |a: usize, b: usize| (nodes[a][0] - nodes[b][0]).hypot(nodes[a][1] - nodes[b][1]);
    let entry = |r: usize, c: usize| if r % 2 == c % 2 { (-distance(r / 2, c / 2) / 0.03).exp() } else { 0.0 };
    let covariance = Dense::from_fn(2 * nodes.len(), 2 * nodes.len(), entry);
    let matrix = covariance.cholesky().unwrap().inverse();
    let precision = Precision::Marginal { covariance, matrix };
    let (sigma, source) = (Some(SIGMA * 0.5_f64.sqrt()), "coloured".into());
    Noise { precision, common: 1.0, on_boundary: true, sigma, source, ratio: None }
}

/// The same, each displacement on its own.
fn white(known: &Known) -> Noise {
    Noise { precision: Precision::White(2 * known.mesh.nodes().len()), ..coloured(known) }
}

/// `joint` with the measured `fields` and their noise; its border smooth where the data ask for it.
fn problem<'a>(known: &Known, noise: Noise, joint: &'a Joint, fields: &[Vec<[f64; 2]>]) -> Problem<'a> {
    let mut problem = known.problem(joint, fields, SIGMA);
    problem.noise = Arc::new(noise);
    problem.border = Arc::new(Border::by_evidence(joint, &problem.observation, &problem.noise, false).0);
    problem
}

/// What `of` says of draws of the small joint with this noise.
fn over_draws<T: Send>(n: u64, noise: fn(&Known) -> Noise, of: impl Fn(&Known, &Problem<'_>) -> T + Sync) -> Vec<T> {
    let known = small(1.0);
    let draw = |seed: u64| {
        let fields = known.with_noise(&noise(&known), seed);
        let joint = known.joint(&fields);
        of(&known, &problem(&known, noise(&known), &joint, &fields))
    };
    (1..=n).into_par_iter().map(draw).collect()
}

#[test]
fn smoothing_leaves_the_truth_of_the_border_and_the_noise_of_its_coefficients() {
    const DRAWS: u64 = 40;
    // Of each draw the errors of the smooth border, and what is left of the measured one against its expectation.
    let draws: Vec<_> = over_draws(DRAWS, white, |known, problem| {
        let smooth = problem.border.smooth.as_ref()?;
        let boundary = &problem.border.boundary;
        let at = |i: usize, k: usize, c: usize| known.truth.instants[i].displacement[boundary.nodes()[k] as usize][c];
        let error = |i: usize| -> Vec<f64> {
            let u = &boundary.instants()[i];
            (0..2 * u.len()).map(|row| (u[row / 2][row % 2] - at(i, row / 2, row % 2)) / SIGMA).collect()
        };
        let errors: Vec<f64> = (0..boundary.instants().len()).flat_map(error).collect();
        Some((smooth.n_coefficients() as f64, smooth.n_components() as f64, smooth.chi2 / smooth.freedom, errors))
    })
    .into_iter()
    .flatten()
    .collect();
    // One in a hundred is refused by chance.
    assert!(draws.len() as u64 >= DRAWS - 2, "{} are smooth", draws.len());
    assert!(draws.iter().all(|(coefficients, components, ..)| coefficients < components));
    let n = draws.len() as f64;
    // A chi-square of 24 numbers at 4 instants by 40 draws: 0.023.
    let left = draws.iter().map(|draw| draw.2).sum::<f64>() / n;
    assert!((left - 1.0).abs() < 0.1, "{left}");
    let square = |errors: &[f64]| errors.iter().map(|e| e * e).sum::<f64>();
    let mean: Vec<f64> =
        (0..draws[0].3.len()).map(|row| draws.iter().map(|draw| draw.3[row]).sum::<f64>() / n).collect();
    let each = draws.iter().map(|draw| square(&draw.3)).sum::<f64>() / n;
    // Of white noise a projection leaves the share of its columns; 2000 coefficients at 4 tied instants: 0.02.
    let share = draws.iter().map(|draw| draw.0 / draw.1).sum::<f64>() / n;
    assert!((each / mean.len() as f64 / share - 1.0).abs() < 0.1, "{each} {share}");
    // Without a bias the square of the mean is that of one draw by their number; 50 coefficients at 4 instants: 0.13.
    assert!((square(&mean) * n / each - 1.0).abs() < 0.6, "{} {each}", square(&mean));
}

/// Of a fit: squares of the errors by their standard uncertainties, and the objective with its expectation.
fn judge(found: &Fit) -> [f64; 3] {
    let statistics = found.statistics.as_ref().unwrap();
    let z = |k: usize| (found.parameters[k].value - TRUTH[k]) / found.parameters[k].std_noise.unwrap();
    [(0..3).map(|k| z(k) * z(k)).sum(), found.omega, statistics.expected_omega]
}

#[test]
fn statistics_with_a_smooth_border_are_those_of_refits_under_either_kind_of_weights() {
    for weights in [WeightKind::Covariance, WeightKind::Uniform] {
        let options = FitOptions { weights, intervals: Intervals::Linear, ..covariance() };
        let draws = over_draws(40, coloured, |_, problem| judge(&fit(problem, &options).unwrap()));
        let n = draws.len() as f64;
        let mean = |k: usize| draws.iter().map(|draw| draw[k]).sum::<f64>() / n;
        // 120 squares that go together in threes at worst: 0.22; omega of hundreds of numbers a draw: 0.03.
        assert!((mean(0) / 3.0 - 1.0).abs() < 0.6, "{weights:?}: {}", mean(0) / 3.0);
        assert!((mean(1) / mean(2) - 1.0).abs() < 0.1, "{weights:?}: {} {}", mean(1), mean(2));
    }
}

#[test]
fn derivatives_by_the_coefficients_are_differences_of_forward_runs() {
    over_draws(1, coloured, |_, problem| {
        let at = |problem: &Problem<'_>| -> Evaluation {
            problem.evaluate(&TRUTH, &problem.border.boundary).unwrap().unwrap()
        };
        let here = at(problem);
        let by = problem.by_boundary(&here).unwrap();
        assert_eq!(by[0].n_columns(), problem.border.smooth.as_ref().unwrap().n_coefficients());
        // A motion of all of the border along its first coefficient: the change of the border rows says which.
        let h = 1e-8;
        let moved: Vec<Vec<[f64; 2]>> = (problem.border.boundary.instants().iter().zip(&by))
            .map(|(u, t)| {
                let of = |k: usize, c: usize| t[(2 * problem.observation.prescribed[k] + c, 0)];
                (0..u.len()).map(|k| [0, 1].map(|c| u[k][c] + h * of(k, c))).collect()
            })
            .collect();
        let boundary = problem.joint.measured.boundary(moved).unwrap();
        let there = problem.evaluate(&TRUTH, &boundary).unwrap().unwrap();
        for (i, t) in by.iter().enumerate() {
            for row in 0..t.n_rows() {
                let rate = (here.blocks[i][(row, 0)] - there.blocks[i][(row, 0)]) / h;
                // Truncation by h over 1e-3 mm of curvature, round-off 1e-13 / h.
                assert!((rate - t[(row, 0)]).abs() < 1e-4, "instant {i}, row {row}: {rate} {}", t[(row, 0)]);
            }
        }
    });
}

#[test]
fn a_short_wave_makes_the_border_free_and_a_smooth_one_that_is_asked_for_is_called_wrong() {
    let known = small(1.0);
    let noise = coloured(&known);
    let mut fields = known.with_noise(&noise, 1);
    for (i, field) in fields.iter_mut().enumerate() {
        field.iter_mut().enumerate().for_each(|(node, u)| u[1] += [2.0, -2.0][(node + i) % 2] * SIGMA);
    }
    let joint = known.joint(&fields);
    let problem = problem(&known, noise, &joint, &fields);
    assert!(problem.border.smooth.is_none());
    assert_eq!(problem.border.boundary, joint.boundary);
    assert_eq!(problem.n_data(), problem.observation.n_data());
    let (forced, remark) = Border::by_evidence(&joint, &problem.observation, &problem.noise, true);
    assert!(!forced.smooth.unwrap().holds());
    assert_eq!(remark.unwrap().code.name(), "border-not-smooth");
}

#[test]
fn an_estimated_border_and_bands_take_a_smooth_one() {
    let options = FitOptions { weights: WeightKind::Covariance, intervals: Intervals::Linear, ..covariance() };
    let draws = over_draws(8, coloured, |_, problem| {
        let measured = fit(problem, &options).unwrap();
        let estimated = fit(problem, &FitOptions { estimate_boundary: true, ..options.clone() }).unwrap();
        let apart = |k: usize| {
            let p = &measured.parameters[k];
            (p.value - estimated.parameters[k].value).abs() / p.std_noise.unwrap()
        };
        let wide = |found: &Fit| {
            bands(problem, found).unwrap().iter().flat_map(|band| band.std.clone()).map(|t| t.normal).sum::<f64>()
        };
        ((0..3).map(apart).fold(0.0, f64::max), wide(&measured) / wide(&estimated))
    });
    // Both know the border from the same rows; estimated, it also follows the inner ones.
    for (apart, wide) in draws {
        assert!(apart < 0.2 && (0.9..1.2).contains(&wide), "{apart} {wide}");
    }
}
