//! Identification: what one fit, seven starts and a sweep cost.
//!
//! `cargo bench --bench identification`. 19 instants, 546 elements and 39 of the adhesive, 3 parameters, noise of 0.1
//! px; without files.

use quadrille::identify::{
    Discretisation, Fit, FitOptions, Noise, Observation, ObservedInstant, Precision, Problem, WeightKind, fit, sweep,
    tournament,
};
use quadrille_testbed::paper::{Experiment, PRESCRIBED_R};
use std::sync::Arc;
use std::time::Instant;

const NOISE_PX: f64 = 0.1;
/// One law of each kind.
const LAWS: [&str; 6] = [
    "extended-xu-needleman",
    "xu-needleman",
    "bilinear-power",
    "trapezoidal-power",
    "park-paulino-roesler",
    "smith-ferrante",
];
/// Place of r among the parameters of the law.
const R: usize = 3;

/// Median and range of `n` runs, seconds, and what the last one gave.
fn timed<T>(n: usize, mut run: impl FnMut() -> T) -> (T, [f64; 3]) {
    let mut times = Vec::with_capacity(n);
    let mut last = None;
    for _ in 0..n {
        let begin = Instant::now();
        last = Some(run());
        times.push(begin.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    (last.expect("a run"), [times[n / 2], times[0], times[n - 1]])
}

/// All nodes, the prescribed ones among them, with noise of a common reference.
fn all_nodes<'a>(problem: Problem<'a>, experiment: &'a Experiment, mm: f64) -> Problem<'a> {
    let mesh = experiment.joint().model.mesh();
    let prescribed: Vec<usize> = experiment.joint().boundary.nodes().iter().map(|&node| node as usize).collect();
    let instants = (experiment.truth().instants.iter().enumerate())
        .map(|(index, instant)| ObservedInstant {
            index,
            // A pattern in the place of noise: the time does not depend on which.
            displacement: (instant.displacement.as_flattened().iter().enumerate())
                .map(|(k, u)| if prescribed.contains(&(k / 2)) { *u } else { u + mm * (1.7 * k as f64).sin() })
                .collect(),
            largest: problem.observation.instants[index].largest,
            factor: 1.0,
        })
        .collect();
    let nodes: Vec<u32> = (0..mesh.nodes().len() as u32).collect();
    let observation = Observation {
        compared: vec![true; nodes.len()],
        nodes,
        prescribed,
        instants,
        pixel_size_mm: None,
        force: None,
        held: None,
        camera: Vec::new(),
    };
    let noise = Noise {
        precision: Precision::White(observation.n_rows()),
        common: 1.0,
        on_boundary: true,
        sigma: Some(mm),
        source: "white".into(),
        ratio: None,
    };
    Problem {
        joint: experiment.joint(),
        observation: Arc::new(observation),
        border: problem.border,
        noise: Arc::new(noise),
        unknowns: problem.unknowns,
        watch: problem.watch,
    }
}

fn row(what: &str, fits: &[&Fit], [median, least, most]: [f64; 3]) {
    let evaluations: usize = fits.iter().map(|fit| fit.starts.iter().map(|s| s.evaluations).max().unwrap_or(0)).sum();
    let all: usize = fits.iter().map(|fit| fit.evaluations).sum();
    let status: Vec<&str> = fits.iter().map(|fit| fit.status.name()).collect();
    println!("| {what} | {} | {} | {median:.2} ({least:.2} to {most:.2}) |", status.join(", "), all.max(evaluations));
}

fn main() {
    // Cargo also runs benches to see that they build.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    println!("quadrille {}, {} threads", env!("CARGO_PKG_VERSION"), rayon::current_num_threads());
    println!("\n| what | status | evaluations | s: median of 5 (range) |\n|---|---|---|---|");
    let experiment = Experiment::new([1.0, 0.005, 0.05, 4.0]).expect("a joint");
    let problem = experiment.problem(NOISE_PX, 1).expect("noise");
    let paper = Experiment::options();
    let (found, times) = timed(5, || fit(&problem, &paper).expect("a fit"));
    row("one start, 80 nodes, paper weights", &[&found], times);
    let stated = FitOptions { discretisation: Discretisation::Stated, ..paper.clone() };
    let (found, times) = timed(5, || fit(&problem, &stated).expect("a fit"));
    row("the same with the effect of the element size", &[&found], times);
    let doubted = FitOptions { doubt: true, ..stated.clone() };
    let (found, times) = timed(5, || fit(&problem, &doubted).expect("a fit"));
    row("the same, tested for misfit and with r released", &[&found], times);
    let truth = experiment.law();
    let factors =
        [[0.4, 0.4, 0.4], [3.0, 3.0, 3.0], [0.4, 3.0, 1.0], [3.0, 0.4, 0.4], [0.5, 2.5, 3.0], [2.0, 0.5, 2.0]];
    let starts = factors.map(|f| (0..3).map(|k| f[k] * truth[k]).collect()).to_vec();
    let seven = FitOptions { starts, ..paper.clone() };
    let (found, times) = timed(5, || fit(&problem, &seven).expect("a fit"));
    row("seven starts", &[&found], times);
    let (rows, times) = timed(5, || sweep(&problem, &paper, R, &PRESCRIBED_R).expect("a sweep"));
    row("sweep of 4 values of r", &rows.iter().map(|row| &row.fit).collect::<Vec<_>>(), times);
    let full = all_nodes(problem, &experiment, NOISE_PX * 1.93125e-3);
    for (what, estimate_boundary, doubt) in [
        ("boundary measured", false, false),
        ("boundary measured, tested for misfit and with r released", false, true),
        ("boundary estimated", true, false),
    ] {
        let options = FitOptions { weights: WeightKind::Covariance, estimate_boundary, doubt, ..paper.clone() };
        let (found, times) = timed(5, || fit(&full, &options).expect("a fit"));
        row(&format!("all nodes, covariance weights, {what}"), &[&found], times);
    }
    let options = FitOptions { weights: WeightKind::Covariance, doubt: true, ..paper };
    let (found, times) = timed(3, || tournament(&full, &options, &LAWS.map(str::to_owned)).expect("a comparison"));
    let fits: Vec<&Fit> = found.laws.iter().filter_map(|law| law.fit.as_ref().ok()).collect();
    row("the same with boundary measured, tested, six laws compared (median of 3)", &fits, times);
}
