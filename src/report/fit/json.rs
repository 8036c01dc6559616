//! `fit.json` and `sweep.json`.

use super::FitReport;
use crate::identify::{Case, Discretisation, Fit, IntervalKind, Iteration, SweepRow};
use crate::mechanics::Status;
use serde::Serialize;
use std::collections::BTreeMap;

/// What `fit.json` holds.
#[derive(Debug, Clone, Serialize)]
pub struct FitJson {
    /// Version of the program.
    pub quadrille: &'static str,
    /// The case file.
    pub case: String,
    /// Units and axes.
    pub units: &'static str,
    /// `converged`, `evaluation_limit`, `stalled`.
    pub status: &'static str,
    /// In words.
    pub reason: String,
    /// Time of the fit, all starts, without files.
    pub seconds: f64,
    /// The law that was fitted.
    pub law: &'static str,
    /// What was compared, how.
    pub measurement: MeasurementJson,
    /// The parameters that were fitted.
    pub parameters: BTreeMap<&'static str, ParameterJson>,
    /// Whether the effect of the element size is `included` in the 95 % intervals, `stated` beside them, or `off`.
    pub discretisation: &'static str,
    /// The order of the parameters in all lists.
    pub parameter_order: Vec<&'static str>,
    /// The parameters of the law that were not.
    pub prescribed: BTreeMap<&'static str, f64>,
    /// What follows from the parameters.
    pub derived: BTreeMap<&'static str, QuantityJson>,
    /// What the intervals rest on; null without uncertainties.
    pub intervals: Option<IntervalsJson>,
    /// Correlation of the parameters.
    pub correlation: Option<Vec<Vec<f64>>>,
    /// Their covariance, in their units.
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Singular values of the weighted Jacobian by the scaled unknowns, falling.
    pub singular_values: Vec<f64>,
    /// First over last singular value; null when the last is zero.
    pub condition: Option<f64>,
    /// The objective: the weighted sum of squares.
    pub omega: f64,
    /// What noise of the stated size leaves of it on the average.
    pub omega_expected: Option<f64>,
    /// Standard deviation of the noise of one displacement, in the mean, mm.
    pub noise_mm: Option<f64>,
    /// Whether it was estimated from the residual.
    pub noise_estimated: bool,
    /// Evaluations of the start that was taken.
    pub evaluations: usize,
    /// Of these, forward runs that were rescued (node pairs snapped).
    pub rescued: usize,
    /// Whether the forward run at the result was rescued.
    pub rescued_at_end: bool,
    /// Largest correction of a prescribed displacement, mm, where they are estimated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_boundary_correction_mm: Option<f64>,
    /// Every evaluation of the start that was taken.
    pub history: Vec<IterationJson>,
    /// Every start.
    pub starts: Vec<StartJson>,
    /// Largest distance of the converged ends, in scaled unknowns.
    pub agreement: f64,
    /// Whether the data determine the parameters.
    pub verdict: Option<VerdictJson>,
    /// What each uncertain constant adds: the change of each parameter for one standard uncertainty.
    pub constants: BTreeMap<String, ConstantJson>,
    /// The profile likelihood, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile: Option<ProfileJson>,
    /// What a user should look at.
    pub warnings: Vec<String>,
}

/// What was compared.
#[derive(Debug, Clone, Serialize)]
pub struct MeasurementJson {
    /// In words.
    pub about: String,
    /// Nodes compared.
    pub nodes: usize,
    /// Instants compared, from 1.
    pub instants: Vec<usize>,
    /// Numbers compared.
    pub data: usize,
    /// `paper`, `uniform`, `covariance`.
    pub weights: &'static str,
    /// `measured`, `estimated`, `exact`.
    pub boundary: &'static str,
    /// Where the noise comes from.
    pub noise: String,
}

/// One parameter.
#[derive(Debug, Clone, Serialize)]
pub struct ParameterJson {
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Standard uncertainty, from noise and uncertain constants.
    pub std: Option<f64>,
    /// Its change if the elements were half as large; null where that was not computed.
    pub discretisation: Option<f64>,
    /// 95 % interval; null where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself; null where the data do not bound the parameter on that side.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts the value by on the average (found less true); the interval holds it, the value is not moved.
    pub bias: Option<f64>,
    /// Standard uncertainty of the bias; null where one pair of draws told it.
    pub bias_std: Option<f64>,
    /// Standard deviation of the bootstrap, where one was made.
    pub std_bootstrap: Option<f64>,
    /// Where the fit started.
    pub start: f64,
    /// Lower bound.
    pub lower: f64,
    /// Upper bound.
    pub upper: f64,
    /// Whether it ended on a bound.
    pub at_bound: bool,
}

/// A derived quantity.
#[derive(Debug, Clone, Serialize)]
pub struct QuantityJson {
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
    /// Standard uncertainty, from noise and uncertain constants.
    pub std: Option<f64>,
    /// Its change if the elements were half as large; null where that was not computed.
    pub discretisation: Option<f64>,
    /// 95 % interval; null where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts it by on the average.
    pub bias: Option<f64>,
}

/// What the 95 % intervals rest on.
#[derive(Debug, Clone, Serialize)]
pub struct IntervalsJson {
    /// `linear` or `profile`.
    pub kind: &'static str,
    /// Why linear theory may not describe what the noise does; empty when nothing speaks against it.
    pub doubts: Vec<String>,
    /// Even and odd part of what a pair of opposite draws of the noise does to each scaled parameter beyond linear theory, in
    /// standard uncertainties; null where that was not computed.
    pub probe: Option<[Vec<f64>; 2]>,
    /// Refits of the bootstrap; 0 without one.
    pub draws: usize,
    /// Those of them that failed or did not converge.
    pub failed: usize,
    /// Those of them that ended on a bound.
    pub on_bound: usize,
}

/// One evaluation.
#[derive(Debug, Clone, Serialize)]
pub struct IterationJson {
    /// The run of the minimiser that it belongs to, from 1: each has weights of its own.
    pub stage: usize,
    /// The parameters.
    #[serde(rename = "X")]
    pub x: Vec<f64>,
    /// The objective under the weights of its stage; null where the forward model failed.
    pub omega: Option<f64>,
    /// Trust radius, in scaled unknowns.
    pub radius: f64,
    /// Whether the fit went on from here.
    pub accepted: bool,
    /// Whether the forward run was rescued.
    pub rescued: bool,
}

/// One start.
#[derive(Debug, Clone, Serialize)]
pub struct StartJson {
    /// Where it began.
    pub start: Vec<f64>,
    /// Where it ended.
    pub end: Vec<f64>,
    /// The objective there.
    pub omega: Option<f64>,
    /// How it ended.
    pub status: &'static str,
    /// Evaluations.
    pub evaluations: usize,
    /// Evaluations that were rescued.
    pub rescued: usize,
}

/// The verdict.
#[derive(Debug, Clone, Serialize)]
pub struct VerdictJson {
    /// Whether all parameters are determined.
    pub determined: bool,
    /// In words.
    pub text: String,
    /// The thresholds.
    pub thresholds: String,
}

/// An uncertain constant.
#[derive(Debug, Clone, Serialize)]
pub struct ConstantJson {
    /// Its standard uncertainty.
    pub std: f64,
    /// What each parameter changes by with it.
    pub change: BTreeMap<&'static str, f64>,
}

/// A profile likelihood.
#[derive(Debug, Clone, Serialize)]
pub struct ProfileJson {
    /// The parameter.
    pub parameter: &'static str,
    /// Where it was prescribed.
    pub values: Vec<f64>,
    /// Rise of the objective, in squares of standard deviations.
    pub rise: Vec<f64>,
    /// Where the rise is 1.96^2.
    pub interval95: [Option<f64>; 2],
}

/// One row of `sweep.json`.
#[derive(Debug, Clone, Serialize)]
pub struct SweepJson {
    /// The prescribed value.
    pub value: f64,
    /// `converged` or why not.
    pub status: &'static str,
    /// The parameters that were fitted.
    pub parameters: BTreeMap<&'static str, ParameterJson>,
    /// What follows from them.
    pub derived: BTreeMap<&'static str, QuantityJson>,
    /// The objective.
    pub omega: f64,
    /// Evaluations.
    pub evaluations: usize,
    /// Evaluations that were rescued.
    pub rescued: usize,
}

impl SweepJson {
    /// One row.
    pub fn of(row: &SweepRow) -> Self {
        Self {
            value: row.value,
            status: row.fit.status.name(),
            parameters: parameters(&row.fit),
            derived: quantities(&row.fit),
            omega: row.fit.omega,
            evaluations: row.fit.evaluations,
            rescued: row.fit.rescued,
        }
    }
}

fn parameters(fit: &Fit) -> BTreeMap<&'static str, ParameterJson> {
    let of = |p: &crate::identify::FittedParameter| {
        let json = ParameterJson {
            value: p.value,
            unit: p.parameter.unit,
            meaning: p.parameter.meaning,
            std: p.std,
            discretisation: p.discretisation,
            interval95: p.interval95,
            ends95: p.ends95,
            bias: p.bias,
            bias_std: p.bias_std,
            std_bootstrap: p.std_bootstrap,
            start: p.start,
            lower: p.bounds[0],
            upper: p.bounds[1],
            at_bound: p.at_bound,
        };
        (p.parameter.name, json)
    };
    fit.parameters.iter().map(of).collect()
}

fn quantities(fit: &Fit) -> BTreeMap<&'static str, QuantityJson> {
    let of = |q: &crate::identify::FittedQuantity| {
        let (value, unit, std) = (q.quantity.value, q.quantity.unit, q.std);
        let (discretisation, interval95) = (q.discretisation, q.interval95);
        let (ends95, bias) = (q.ends95, q.bias);
        (q.quantity.name, QuantityJson { value, unit, std, discretisation, interval95, ends95, bias })
    };
    fit.derived.iter().map(of).collect()
}

/// What a user should know of the intervals: that linear theory is in doubt, biases, sides without an end, draws that failed.
fn of_intervals(fit: &Fit) -> Vec<String> {
    let Some(basis) = fit.intervals.as_ref().filter(|basis| basis.linearity.in_doubt()) else { return Vec::new() };
    let mut said = vec![match (basis.kind, &basis.bootstrap) {
        (IntervalKind::Linear, _) => format!("linear intervals are in doubt: {}", basis.linearity.doubts.join("; ")),
        (IntervalKind::Profile, None) => format!(
            "intervals are those of the profile likelihood, without the bias that noise makes: {}",
            basis.linearity.doubts.join("; ")
        ),
        (IntervalKind::Profile, Some(bootstrap)) => format!(
            "intervals are those of the profile likelihood, extended by the bias that {} refits of simulated data show ({} failed, \
             {} on a bound): {}",
            bootstrap.draws,
            bootstrap.failed,
            bootstrap.on_bound,
            basis.linearity.doubts.join("; ")
        ),
    }];
    for p in &fit.parameters {
        let (name, unit) = (p.parameter.name, p.parameter.unit);
        if let (Some(bias), Some(std)) = (p.bias, p.std)
            && bias.abs() > 0.25 * std
        {
            said.push(format!(
                "noise shifts {name} by {:+.1} % on the average ({bias:+.3e} {unit}); the value is as fitted, its interval holds \
                 the shift",
                100.0 * bias / p.value
            ));
        }
        for (end, side) in p.ends95.iter().zip(["lower", "upper"]) {
            if end.is_none() && p.std.is_some() {
                said.push(format!(
                    "the 95 % interval of {name} has no {side} end: the objective does not rise enough within the bounds and a \
                     factor of 20, or the model has no solution on the way"
                ));
            }
        }
    }
    said
}

impl FitReport<'_> {
    /// What `fit.json` holds; the fit of the case file `case` took `seconds`.
    pub fn json(&self, case: String, seconds: f64) -> FitJson {
        let Case { problem, options, about, boundary, doubts, .. } = self.case;
        let fit = self.fit;
        let names: Vec<&'static str> = fit.parameters.iter().map(|p| p.parameter.name).collect();
        let law = problem.unknowns.law();
        let rows = |m: &crate::linalg::Dense| {
            (0..m.n_rows()).map(|r| (0..m.n_columns()).map(|c| m[(r, c)]).collect()).collect()
        };
        let mut warnings = doubts.clone();
        warnings.extend(fit.parameters.iter().filter(|p| p.at_bound).map(|p| {
            let [low, high] = p.bounds;
            format!(
                "{} ended on its bound ({} of {low} to {high}): its interval means little",
                p.parameter.name, p.value
            )
        }));
        let rescued_at_end = fit.solution().instants.iter().any(|instant| instant.status == Status::Rescued);
        if rescued_at_end {
            warnings.push(
                "the forward run at the result was rescued: node pairs snapped, and the objective may jump nearby"
                    .into(),
            );
        }
        if options.discretisation != Discretisation::Off && fit.parameters.iter().any(|p| p.discretisation.is_none()) {
            warnings.push(
                "the effect of the element size could not be computed (no finer mesh, or no solution on it): the \
                 intervals are without it"
                    .into(),
            );
        }
        warnings.extend(of_intervals(fit));
        let agreement = |end: &&crate::identify::StartEnd| end.status == crate::identify::FitStatus::Converged;
        let agreement = fit.starts.iter().filter(agreement).fold(0.0_f64, |most, end| most.max(end.distance));
        if agreement > 1e-6 {
            warnings.push(format!(
                "the starts led to different ends, up to {agreement:.1e} apart in scaled unknowns: the best was taken"
            ));
        }
        let statistics = fit.statistics.as_ref();
        let constants = (fit.constants.iter())
            .map(|effect| {
                let change = (effect.scaled.iter().zip(&names).zip(problem.unknowns.slopes(&fit.evaluation.x)))
                    .map(|((z, name), slope)| (*name, z * slope))
                    .collect();
                (effect.constant.name.clone(), ConstantJson { std: effect.constant.std, change })
            })
            .collect();
        let iteration = |i: &Iteration| IterationJson {
            stage: i.stage,
            x: i.z.clone(),
            omega: i.omega,
            radius: i.radius,
            accepted: i.accepted,
            rescued: i.rescued,
        };
        FitJson {
            quadrille: env!("CARGO_PKG_VERSION"),
            case,
            units: "mm, MPa, N/mm; x to the right, y up; nodes counted from 0, instants from 1",
            status: fit.status.name(),
            reason: fit.reason.clone(),
            seconds,
            law: law.name(),
            measurement: MeasurementJson {
                about: about.clone(),
                nodes: problem.observation.compared.iter().filter(|c| **c).count(),
                instants: problem.observation.instants.iter().map(|i| i.index + 1).collect(),
                data: problem.observation.n_data(),
                weights: options.weights.name(),
                boundary,
                noise: problem.noise.source.clone(),
            },
            parameters: parameters(fit),
            prescribed: (law.parameters().iter().zip(&fit.values))
                .filter(|(p, _)| !names.contains(&p.name))
                .map(|(p, value)| (p.name, *value))
                .collect(),
            discretisation: options.discretisation.name(),
            parameter_order: names,
            derived: quantities(fit),
            intervals: fit.intervals.as_ref().map(|basis| IntervalsJson {
                kind: basis.kind.name(),
                doubts: basis.linearity.doubts.clone(),
                probe: basis.linearity.probe.clone(),
                draws: basis.bootstrap.as_ref().map_or(0, |bootstrap| bootstrap.draws),
                failed: basis.bootstrap.as_ref().map_or(0, |bootstrap| bootstrap.failed),
                on_bound: basis.bootstrap.as_ref().map_or(0, |bootstrap| bootstrap.on_bound),
            }),
            correlation: fit.correlation.as_ref().map(rows),
            covariance: fit.covariance.as_ref().map(rows),
            singular_values: fit.singular_values.clone(),
            condition: Some(fit.condition()).filter(|c| c.is_finite()),
            omega: fit.omega,
            omega_expected: statistics.map(|s| s.expected_omega),
            noise_mm: statistics.map(|s| s.sigma * problem.noise.mean_variance().sqrt()),
            noise_estimated: statistics.is_some_and(|s| s.sigma_estimated),
            evaluations: fit.evaluations,
            rescued: fit.rescued,
            rescued_at_end,
            largest_boundary_correction_mm: fit.largest_correction,
            history: fit.history.iter().map(iteration).collect(),
            starts: (fit.starts.iter())
                .map(|s| StartJson {
                    start: s.start.clone(),
                    end: s.end.clone(),
                    omega: s.omega,
                    status: s.status.name(),
                    evaluations: s.evaluations,
                    rescued: s.rescued,
                })
                .collect(),
            agreement,
            verdict: fit.verdict.as_ref().map(|v| VerdictJson {
                determined: v.determined,
                text: v.sentences.join(". ") + ".",
                thresholds: v.thresholds.clone(),
            }),
            constants,
            profile: self.profile.as_ref().map(|p| ProfileJson {
                parameter: p.name,
                values: p.values.clone(),
                rise: p.rise.clone(),
                interval95: p.interval95,
            }),
            warnings,
        }
    }
}
