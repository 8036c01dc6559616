//! Tables 1 and 2: fits over many draws, and what they come to.

use super::published::PRESCRIBED_R;
use super::{Experiment, PaperError};
use quadrille::identify::{Fit, FitStatus, SweepRow, fit, sweep};
use rayon::prelude::*;

/// Place of `r` among the parameters of the law.
const R: usize = 3;

/// The fits of one level of noise, one for each draw.
#[derive(Debug)]
pub struct LevelFits {
    /// Standard deviation of the noise, px.
    pub s_px: f64,
    /// Seed of each draw, and its fit.
    pub fits: Vec<(u64, Fit)>,
}

/// Mean and spread over the draws of one level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelSummary {
    /// Draws.
    pub n: usize,
    /// Of them, those whose fit converged inside the bounds.
    pub inside: usize,
    /// Mean of `phi_n` (N/mm), `delta_n`, `delta_t` (mm) and the objective over all draws.
    pub mean: [f64; 4],
    /// Their standard deviation over the draws; zero for one.
    pub spread: [f64; 4],
    /// Most evaluations of a fit.
    pub evaluations: usize,
}

/// Fits the draws `first_seed`, `first_seed + 1`, ... at one level of noise.
///
/// # Errors
/// See [`PaperError`].
pub fn noisy_fits(experiment: &Experiment, s_px: f64, first_seed: u64, seeds: usize) -> Result<LevelFits, PaperError> {
    let one = |k: usize| {
        let seed = first_seed.wrapping_add(k as u64);
        Ok((seed, fit(&experiment.problem(s_px, seed)?, &Experiment::options())?))
    };
    Ok(LevelFits { s_px, fits: (0..seeds).into_par_iter().map(one).collect::<Result<_, PaperError>>()? })
}

/// The three parameters and the objective of a fit.
fn numbers(fit: &Fit) -> [f64; 4] {
    [fit.parameters[0].value, fit.parameters[1].value, fit.parameters[2].value, fit.omega]
}

/// Mean and standard deviation of rows.
fn mean_and_spread<const N: usize>(rows: &[[f64; N]]) -> ([f64; N], [f64; N]) {
    let n = rows.len().max(1) as f64;
    let mean: [f64; N] = std::array::from_fn(|k| rows.iter().map(|row| row[k]).sum::<f64>() / n);
    let spread = std::array::from_fn(|k| {
        let sum: f64 = rows.iter().map(|row| (row[k] - mean[k]).powi(2)).sum();
        (sum / (n - 1.0).max(1.0)).sqrt()
    });
    (mean, spread)
}

/// What the fits of a level come to.
pub fn summary(level: &LevelFits) -> LevelSummary {
    let rows: Vec<[f64; 4]> = level.fits.iter().map(|(_, fit)| numbers(fit)).collect();
    let (mean, spread) = mean_and_spread(&rows);
    let inside = |fit: &Fit| fit.status == FitStatus::Converged && fit.parameters.iter().all(|p| !p.at_bound);
    LevelSummary {
        n: rows.len(),
        inside: level.fits.iter().filter(|(_, fit)| inside(fit)).count(),
        mean,
        spread,
        evaluations: level.fits.iter().map(|(_, fit)| fit.evaluations).max().unwrap_or(0),
    }
}

/// The fits with r prescribed at each of [`PRESCRIBED_R`], for each draw.
///
/// # Errors
/// See [`PaperError`].
pub fn sweeps(
    experiment: &Experiment,
    s_px: f64,
    first_seed: u64,
    seeds: usize,
) -> Result<Vec<(u64, Vec<SweepRow>)>, PaperError> {
    let one = |k: usize| {
        let seed = first_seed.wrapping_add(k as u64);
        let problem = experiment.problem(s_px, seed)?;
        Ok((seed, sweep(&problem, &Experiment::options(), R, &PRESCRIBED_R)?))
    };
    (0..seeds).into_par_iter().map(one).collect()
}

/// Mean and spread over the draws at one prescribed `r`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepSummary {
    /// The prescribed value.
    pub r: f64,
    /// Mean of `phi_n`, `phi_t` (N/mm), `delta_n`, `delta_t` (mm), the initial normal and tangential stiffness
    /// (MPa/mm), and the objective.
    pub mean: [f64; 7],
    /// Their standard deviation over the draws; zero for one.
    pub spread: [f64; 7],
}

/// What must hold over `r`, of one draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trends {
    /// Whether `phi_n` and `delta_n` fall and `delta_t` and `phi_t` rise from each `r` to the next.
    pub monotonic: bool,
    /// Largest less smallest initial normal stiffness over their mean.
    pub normal_stiffness: f64,
    /// The same of the tangential one.
    pub tangential_stiffness: f64,
    /// The same of the objective.
    pub omega: f64,
}

fn sweep_numbers(row: &SweepRow) -> [f64; 7] {
    let [phi_n, delta_n, delta_t, omega] = numbers(&row.fit);
    let phi_t = row.value * phi_n;
    // THEORY 4: the slopes of the law at the origin.
    [phi_n, phi_t, delta_n, delta_t, phi_n / (delta_n * delta_n), 2.0 * phi_t / (delta_t * delta_t), omega]
}

/// What the sweeps come to: a row for each `r`, and the trends of each draw.
pub fn sweep_summary(sweeps: &[(u64, Vec<SweepRow>)]) -> (Vec<SweepSummary>, Vec<Trends>) {
    let tables: Vec<Vec<[f64; 7]>> = sweeps.iter().map(|(_, rows)| rows.iter().map(sweep_numbers).collect()).collect();
    let rows = (PRESCRIBED_R.iter().enumerate())
        .map(|(k, &r)| {
            let (mean, spread) = mean_and_spread(&tables.iter().map(|table| table[k]).collect::<Vec<_>>());
            SweepSummary { r, mean, spread }
        })
        .collect();
    let trends = tables.iter().map(|table| trends(table)).collect();
    (rows, trends)
}

/// The trends of the means over the draws.
pub fn trends_of_means(rows: &[SweepSummary]) -> Trends {
    trends(&rows.iter().map(|row| row.mean).collect::<Vec<_>>())
}

fn trends(table: &[[f64; 7]]) -> Trends {
    let rises = |k: usize| table.windows(2).all(|pair| pair[1][k] > pair[0][k]);
    let falls = |k: usize| table.windows(2).all(|pair| pair[1][k] < pair[0][k]);
    let range = |k: usize| {
        let (low, high) = table
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), row| (low.min(row[k]), high.max(row[k])));
        let mean = table.iter().map(|row| row[k]).sum::<f64>() / table.len().max(1) as f64;
        if mean > 0.0 { (high - low) / mean } else { 0.0 }
    };
    Trends {
        monotonic: falls(0) && rises(1) && falls(2) && rises(3),
        normal_stiffness: range(4),
        tangential_stiffness: range(5),
        omega: range(6),
    }
}
