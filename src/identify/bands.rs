//! Confidence bands: tractions along the joint, and the law itself.

use super::FitError;
use super::constants::ConstantEffect;
use super::fit::Fit;
use super::objective::Problem;
use crate::linalg::Dense;
use crate::mechanics::cohesive::{CohesiveLaw, Jump, Traction};
use rayon::prelude::*;

/// Tractions of one instant, with their standard uncertainties.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// The instant, from 1.
    pub instant: usize,
    /// Traction at each node pair, MPa.
    pub traction: Vec<Traction>,
    /// Standard uncertainty of its components, MPa.
    pub std: Vec<Traction>,
}

/// Traction against separation in pure opening and pure sliding.
#[derive(Debug, Clone, PartialEq)]
pub struct CurveBand {
    /// The jumps, mm: in opening `normal`, in sliding `tangential`.
    pub jumps: Vec<Jump>,
    /// Traction along the jump, MPa.
    pub traction: Vec<f64>,
    /// Its standard uncertainty, MPa.
    pub std: Vec<f64>,
}

/// Tractions along the joint at every instant compared, with what the noise of the measurement (through the parameters and,
/// where the boundary is noisy, through the prescribed displacements, the two correlated) and the uncertain constants do
/// to them. Empty without covariance.
///
/// To first order: `dT = g^T dz + h^T d_i` with `dz = A sum_j v_j^T e_j` and `d_i` the error of the prescribed displacements.
///
/// # Errors
/// A tangent without inverse.
pub fn bands(problem: &Problem<'_>, fit: &Fit) -> Result<Vec<Band>, FitError> {
    let (Some(statistics), Some(_)) = (&fit.statistics, &fit.covariance) else { return Ok(Vec::new()) };
    let law = problem.unknowns.law_at(&fit.evaluation.x)?;
    let model = &problem.joint.model;
    let (noise, observation) = (&*problem.noise, &*problem.observation);
    let n = problem.unknowns.n();
    let slopes = problem.unknowns.slopes(&fit.evaluation.x);
    let columns = problem.unit_motions();
    let c = &noise.precision;
    let sigma2 = statistics.sigma * statistics.sigma;
    let mut all = Dense::zeros(observation.n_rows(), n);
    statistics.v.iter().for_each(|v| all.add(1.0, v));
    let of_parameters = statistics.covariance.clone();
    let estimated = fit.largest_correction.is_some();
    let of = |(i, observed): (usize, &super::observation::ObservedInstant)| -> Result<Band, FitError> {
        let instant = &fit.solution().instants[observed.index];
        let u = &instant.displacement;
        let jumps = model.jumps(u);
        let by_unknown: Vec<Vec<Jump>> = (problem.unknowns.list().iter())
            .map(|unknown| model.jumps(&instant.sensitivities[unknown.index]))
            .collect();
        let by_boundary: Vec<Vec<Jump>> = match observation.prescribed.is_empty() {
            true => Vec::new(),
            false => {
                let fields = model.linearise(&*law, u)?.by_boundary(columns.instants());
                fields.iter().map(|field| model.jumps(field)).collect()
            }
        };
        let n_pairs = jumps.len();
        // Columns: T_n and T_t of every pair.
        let mut g = Dense::zeros(n, 2 * n_pairs);
        let mut h = Dense::zeros(observation.n_rows(), 2 * n_pairs);
        let mut h_border = Dense::zeros(by_boundary.len(), 2 * n_pairs);
        for (pair, &jump) in jumps.iter().enumerate() {
            let tangent = law.response(jump).tangent;
            let along = |moved: Jump, d: usize| tangent[d][0] * moved.normal + tangent[d][1] * moved.tangential;
            let mut at_fixed_jump = vec![Traction::default(); law.parameters().len()];
            law.by_parameters(jump, &mut at_fixed_jump);
            for (k, unknown) in problem.unknowns.list().iter().enumerate() {
                let direct = at_fixed_jump[unknown.index];
                for (d, direct) in [direct.normal, direct.tangential].into_iter().enumerate() {
                    g[(k, 2 * pair + d)] = slopes[k] * (direct + along(by_unknown[k][pair], d));
                }
            }
            for (k, moved) in by_boundary.iter().enumerate() {
                for d in 0..2 {
                    let row = 2 * observation.prescribed[k / 2] + k % 2;
                    h[(row, 2 * pair + d)] = along(moved[pair], d);
                    h_border[(k, 2 * pair + d)] = along(moved[pair], d);
                }
            }
        }
        let variance = match (by_boundary.is_empty(), estimated) {
            (true, _) => squares(&g, &of_parameters.times(&g)),
            (false, false) => {
                let ch = c.inverse_times(&h);
                let own = squares(&h, &ch);
                let mut cross = statistics.v[i].transposed_times(&ch);
                cross.add(noise.common, &all.transposed_times(&ch));
                let cross = squares(&g, &statistics.a.times(&cross));
                let of_parameters = squares(&g, &of_parameters.times(&g));
                (0..2 * n_pairs)
                    .map(|k| of_parameters[k] + sigma2 * (2.0 * cross[k] + (1.0 + noise.common) * own[k]))
                    .collect()
            }
            (false, true) => joint_variance(problem, fit, i, &g, &h_border, &of_parameters),
        };
        // A constant moves the parameters, the law where it is one of its own, and the jumps: together, they hardly differ.
        let mut of_constants = vec![0.0; 2 * n_pairs];
        for effect in &fit.constants {
            for (pair, &jump) in jumps.iter().enumerate() {
                let change = law_change(&*law, problem, effect, jump);
                let moved = effect.jumps[i][pair];
                let tangent = law.response(jump).tangent;
                for (d, change) in [change.normal, change.tangential].into_iter().enumerate() {
                    let by_parameters: f64 = (0..n).map(|k| g[(k, 2 * pair + d)] * effect.scaled[k]).sum();
                    let by_jump = tangent[d][0] * moved.normal + tangent[d][1] * moved.tangential;
                    of_constants[2 * pair + d] += (by_parameters + change + by_jump).powi(2);
                }
            }
        }
        let std = |k: usize| (variance[k].max(0.0) + of_constants[k]).sqrt();
        Ok(Band {
            instant: observed.index + 1,
            traction: jumps.iter().map(|&jump| law.response(jump).traction).collect(),
            std: (0..n_pairs).map(|p| Traction { normal: std(2 * p), tangential: std(2 * p + 1) }).collect(),
        })
    };
    observation.instants.par_iter().enumerate().map(of).collect()
}

/// Change of the traction at `jump` by the prescribed parameters of the law that `effect` moves.
fn law_change(law: &dyn CohesiveLaw, problem: &Problem<'_>, effect: &ConstantEffect, jump: Jump) -> Traction {
    let mut by = vec![Traction::default(); law.parameters().len()];
    law.by_parameters(jump, &mut by);
    let fitted = |index: usize| problem.unknowns.list().iter().any(|unknown| unknown.index == index);
    let prescribed = by.iter().zip(&effect.law).enumerate().filter(|(index, _)| !fitted(*index));
    prescribed.fold(Traction::default(), |sum, (_, (by, change))| Traction {
        normal: sum.normal + by.normal * change,
        tangential: sum.tangential + by.tangential * change,
    })
}

/// `(a^T b)_kk` for each column.
fn squares(a: &Dense, b: &Dense) -> Vec<f64> {
    (0..a.n_columns()).map(|k| a.column(k).iter().zip(b.column(k)).map(|(a, b)| a * b).sum()).collect()
}

/// Variance of `g^T dz + h^T d_i` when the boundary was estimated with the parameters: `d_i` then follows `z`, and what is
/// left is the uncertainty of the boundary given the parameters, with that of the common error.
fn joint_variance(problem: &Problem<'_>, fit: &Fit, i: usize, g: &Dense, h: &Dense, of_parameters: &Dense) -> Vec<f64> {
    let Some(statistics) = &fit.statistics else { return Vec::new() };
    let noise = &*problem.noise;
    let sigma2 = statistics.sigma * statistics.sigma;
    let t = &statistics.by_boundary[i];
    let mt = noise.precision.times(t);
    let Ok(factor) = t.transposed_times(&mt).cholesky() else { return vec![0.0; g.n_columns()] };
    // d_i = N^-1 T^T M (r - J z - e): by z, and by the common error e whose own estimate is good to sigma^2 common.
    let back = factor.solve(h);
    let jacobian = fit.evaluation.jacobian();
    let by_z = jacobian[i].transposed_times(&mt.times(&back));
    let mut total = g.clone();
    total.add(-1.0, &by_z);
    let of_z = squares(&total, &of_parameters.times(&total));
    let given_z = squares(h, &back);
    let pushed = mt.times(&back);
    let of_common = squares(&pushed, &noise.precision.inverse_times(&pushed));
    // The common error is known better than before by the number of instants.
    let m = problem.observation.instants.len() as f64;
    let common = if noise.common > 0.0 { 1.0 / (m + 1.0 / noise.common) } else { 0.0 };
    (0..g.n_columns()).map(|k| of_z[k] + sigma2 * (given_z[k] + common * of_common[k])).collect()
}

/// The law in pure opening and in pure sliding, up to where it has nearly no traction left, with its uncertainty.
///
/// # Errors
/// Values that the law does not allow.
pub fn curve_bands(problem: &Problem<'_>, fit: &Fit) -> Result<[CurveBand; 2], FitError> {
    let law: Box<dyn CohesiveLaw> = problem.unknowns.law_at(&fit.evaluation.x)?;
    let opening = law.front_opening();
    // Sliding goes on until its traction is a hundredth of the peak.
    let peak = law.peak().tangential;
    let mut sliding = opening;
    let traction = |s: f64| law.response(Jump { normal: 0.0, tangential: s }).traction.tangential;
    for _ in 0..60 {
        if traction(sliding) < 0.01 * peak && sliding > opening {
            break;
        }
        sliding *= 1.3;
    }
    let (list, scale) = (problem.unknowns.list(), problem.unknowns.slopes(&fit.evaluation.x));
    let band = |largest: f64, normal: bool| {
        let jumps: Vec<Jump> = (0..=100)
            .map(|k| {
                let s = largest * f64::from(k) / 100.0;
                if normal { Jump { normal: s, tangential: 0.0 } } else { Jump { normal: 0.0, tangential: s } }
            })
            .collect();
        let pick = |t: Traction| if normal { t.normal } else { t.tangential };
        let std = |&jump: &Jump| {
            let Some(statistics) = &fit.statistics else { return 0.0 };
            let mut by = vec![Traction::default(); law.parameters().len()];
            law.by_parameters(jump, &mut by);
            let g: Vec<f64> = list.iter().zip(&scale).map(|(unknown, z)| z * pick(by[unknown.index])).collect();
            let of = |r: usize| (0..g.len()).map(|k| g[r] * statistics.covariance[(r, k)] * g[k]).sum::<f64>();
            let noise = (0..g.len()).map(of).sum::<f64>().max(0.0);
            let of = |effect: &ConstantEffect| effect.law.iter().zip(&by).map(|(p, &by)| p * pick(by)).sum::<f64>();
            (noise + fit.constants.iter().map(|effect| of(effect).powi(2)).sum::<f64>()).sqrt()
        };
        CurveBand {
            traction: jumps.iter().map(|&jump| pick(law.response(jump).traction)).collect(),
            std: jumps.iter().map(std).collect(),
            jumps,
        }
    };
    Ok([band(opening, true), band(sliding, false)])
}
