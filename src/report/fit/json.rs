//! `fit.json` and `sweep.json`.

use super::{FitReport, remarks};
use crate::identify::{
    BudgetLine, Case, CutShort, Discretisation, Fit, FitStatus, FittedParameter, FittedQuantity, Iteration, Misfit,
    MisfitGroup, Outcome, Profile, Released, ReleasedParameter, Smooth, StartEnd, SweepRow, Verdict,
};
use crate::mechanics::Status;
use crate::remark::Remark;
use crate::report::{ForceRecord, Name, number, numbers};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What `fit.json` holds.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FitRecord {
    /// Version of the program.
    pub quadrille: Name,
    /// The case file.
    pub case: String,
    /// Units and axes.
    pub units: Name,
    /// `converged`, `evaluation_limit`, `stalled`; `time_limit`, `stopped` where it was ended from outside.
    pub status: Name,
    /// In words.
    pub reason: String,
    /// Whether a limit of time or a wish to stop ended it or what comes after it: the verdict says what is missing.
    #[serde(default)]
    pub cut_short: bool,
    /// Time of the fit, all starts, without files.
    pub seconds: f64,
    /// The law that was fitted.
    pub law: Name,
    /// What was compared, how.
    pub measurement: MeasurementRecord,
    /// The parameters that were fitted.
    pub parameters: BTreeMap<Name, ParameterRecord>,
    /// Whether the effect of the element size is `included` in the 95 % intervals, `stated` beside them, or `off`.
    pub discretisation: Name,
    /// The order of the parameters in all lists.
    pub parameter_order: Vec<Name>,
    /// The parameters of the law that were not.
    pub prescribed: BTreeMap<Name, f64>,
    /// What follows from the parameters.
    pub derived: BTreeMap<Name, QuantityRecord>,
    /// Opening and sliding, mm, of the pair on which the law has done the most work, which is `work_reached`.
    #[serde(default)]
    pub furthest_mm: Option<[f64; 2]>,
    /// What the intervals rest on; null without uncertainties.
    pub intervals: Option<IntervalsRecord>,
    /// Correlation of the parameters.
    pub correlation: Option<Vec<Vec<f64>>>,
    /// Their covariance, in their units.
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Singular values of the weighted Jacobian by the scaled unknowns, falling.
    #[serde(deserialize_with = "numbers")]
    pub singular_values: Vec<f64>,
    /// First over last singular value; null when the last is zero.
    pub condition: Option<f64>,
    /// The objective: the weighted sum of squares.
    #[serde(deserialize_with = "number")]
    pub omega: f64,
    /// What noise of the stated size leaves of it on average.
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_boundary_correction_mm: Option<f64>,
    /// Every evaluation of the start that was taken.
    pub history: Vec<IterationRecord>,
    /// Every start.
    pub starts: Vec<StartRecord>,
    /// Largest distance of the converged ends, in scaled unknowns.
    #[serde(deserialize_with = "number")]
    pub agreement: f64,
    /// What it all comes to.
    pub verdict: VerdictRecord,
    /// Whether the data contradict the model.
    pub misfit: Option<MisfitRecord>,
    /// What the prescribed parameters of the law would be as unknowns.
    pub released: Option<ReleasedRecord>,
    /// The error budget: what noise, each constant and the size of the elements add to the intervals.
    pub budget: Vec<BudgetRecord>,
    /// What finite rotations would change of each parameter of a fit with small ones, to first order, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change_by_finite_rotations: Option<BTreeMap<Name, f64>>,
    /// The load cell beside the prediction, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<ForceRecord>,
    /// The profile likelihood, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub profile: Option<ProfileRecord>,
    /// What each of several tests tells, in the order of the case. Parameters, budget and verdict are those of all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tests: Vec<TestRecord>,
    /// Whether several tests want the same parameters; missing where the noise is not known or no two tell the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub consistency: Option<ConsistencyRecord>,
    /// What a user should look at.
    pub remarks: Vec<Remark>,
}

/// What was compared.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MeasurementRecord {
    /// In words.
    pub about: String,
    /// Nodes compared.
    pub nodes: usize,
    /// Instants compared, from 1.
    pub instants: Vec<usize>,
    /// Numbers compared.
    pub data: usize,
    /// `paper`, `uniform`, `covariance`.
    pub weights: Name,
    /// `measured`, `estimated`, `exact`.
    pub boundary: Name,
    /// How the border is smoothed; missing where it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub border: Option<BorderRecord>,
    /// Where the noise comes from.
    pub noise: String,
}

/// A smooth border.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BorderRecord {
    /// Of the polynomials along and across the joint.
    pub degrees: [usize; 2],
    /// Coefficients of an instant.
    pub coefficients: usize,
    /// Components of the border at an instant.
    pub components: usize,
    /// Root mean square of what smoothing leaves, by that of the noise.
    pub times_noise: f64,
}

impl BorderRecord {
    fn of(smooth: &Smooth) -> Self {
        Self {
            degrees: smooth.degrees,
            coefficients: smooth.n_coefficients(),
            components: smooth.n_components(),
            times_noise: smooth.ratio(),
        }
    }
}

/// One of several tests.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TestRecord {
    /// Its name: also that of the folder of its tables and figures.
    pub name: String,
    /// What was compared.
    pub measurement: MeasurementRecord,
    /// Its part of the objective, in units of its noise.
    #[serde(deserialize_with = "number")]
    pub omega: f64,
    /// Standard deviation of the noise of one displacement, in the mean, mm.
    pub noise_mm: Option<f64>,
    /// Whether it was estimated from the residual.
    pub noise_estimated: bool,
    /// Size of a pixel, mm, where it is known.
    pub pixel_size_mm: Option<f64>,
    /// Share of opening in the work of separation.
    pub opening_share: Option<f64>,
    /// Whether without it every standard uncertainty is the same to 1 %.
    pub adds_nothing: bool,
    /// What it tells of each parameter.
    pub parameters: BTreeMap<Name, TestParameterRecord>,
    /// Whether it contradicts the model with the parameters that all share.
    pub misfit: Option<MisfitRecord>,
    /// Its load cell beside the prediction, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub force: Option<ForceRecord>,
}

/// What one of several tests tells of a parameter.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TestParameterRecord {
    /// Standard uncertainty by the noise if the test were alone; null where it says nothing of the parameter.
    pub std_alone: Option<f64>,
    /// The same of all other tests together.
    pub std_without: Option<f64>,
}

/// Whether several tests want the same parameters.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ConsistencyRecord {
    /// Whether they contradict each other.
    pub contradicted: bool,
    /// What omega would fall by with parameters of its own in each test, to first order.
    pub omega_falls_by: f64,
    /// What noise, constants and element size make of that on average.
    pub expected: f64,
    /// Its normal deviate.
    pub z: f64,
    /// That above which they contradict each other.
    pub z_limit: f64,
}

/// One parameter.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ParameterRecord {
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: Name,
    /// What it is.
    pub meaning: Name,
    /// Standard uncertainty, from noise and uncertain constants.
    pub std: Option<f64>,
    /// The part of the noise alone.
    pub std_noise: Option<f64>,
    /// Its change if the elements were half as large; null where that was not computed.
    pub discretisation: Option<f64>,
    /// 95 % interval; null where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself; null where the data do not bound the parameter on that side.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts the value by on average (found less true); the interval holds it, the value is not moved.
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
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct QuantityRecord {
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: Name,
    /// Standard uncertainty, from noise and uncertain constants.
    pub std: Option<f64>,
    /// The part of the noise alone.
    pub std_noise: Option<f64>,
    /// Its change if the elements were half as large; null where that was not computed.
    pub discretisation: Option<f64>,
    /// 95 % interval; null where it has not two ends.
    pub interval95: Option<[f64; 2]>,
    /// Its ends, each for itself.
    pub ends95: [Option<f64>; 2],
    /// What noise shifts it by on average.
    pub bias: Option<f64>,
}

/// What the 95 % intervals rest on.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct IntervalsRecord {
    /// `linear` or `profile`.
    pub kind: Name,
    /// Why linear theory may not describe what the noise does; empty when nothing speaks against it.
    pub doubts: Vec<String>,
    /// Even and odd part of what a pair of opposite draws of the noise does to each scaled parameter beyond linear
    /// theory, in standard uncertainties; null where that was not computed.
    pub probe: Option<[Vec<f64>; 2]>,
    /// Refits of the bootstrap; 0 without one.
    pub draws: usize,
    /// Those of them that failed or did not converge.
    pub failed: usize,
    /// Those of them that ended on a bound.
    pub on_bound: usize,
}

/// One evaluation.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct IterationRecord {
    /// The run of the minimiser that it belongs to, from 1: each has weights of its own.
    pub stage: usize,
    /// The parameters.
    #[serde(rename = "X", deserialize_with = "numbers")]
    pub x: Vec<f64>,
    /// The objective under the weights of its stage; null where the forward model failed.
    pub omega: Option<f64>,
    /// Trust radius, in scaled unknowns.
    #[serde(deserialize_with = "number")]
    pub radius: f64,
    /// Whether the fit went on from here.
    pub accepted: bool,
    /// Whether the forward run was rescued.
    pub rescued: bool,
}

/// One start.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StartRecord {
    /// Where it began.
    pub start: Vec<f64>,
    /// Where it ended.
    #[serde(deserialize_with = "numbers")]
    pub end: Vec<f64>,
    /// The objective there.
    pub omega: Option<f64>,
    /// How it ended.
    pub status: Name,
    /// Evaluations.
    pub evaluations: usize,
    /// Evaluations that were rescued.
    pub rescued: usize,
}

/// The verdict.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct VerdictRecord {
    /// `determined`, `not determined` or `model rejected`.
    pub outcome: Name,
    /// Whether all parameters are determined.
    pub determined: bool,
    /// Whether all intervals are conditional on a model that the data contradict.
    pub conditional: bool,
    /// In words.
    pub text: String,
    /// The same, sentence by sentence.
    pub sentences: Vec<String>,
    /// The prescribed values that all intervals suppose.
    pub given: Vec<String>,
    /// The thresholds.
    pub thresholds: String,
}

/// The misfit test.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct MisfitRecord {
    /// Whether the model is rejected, by the whole or by a group.
    pub rejected: bool,
    /// Whether the noise is known beside the residual, so that the whole is a test.
    pub tested: bool,
    /// Sum of squares of the whitened residual.
    #[serde(deserialize_with = "number")]
    pub omega: f64,
    /// What noise alone leaves of it on average.
    pub freedom: f64,
    /// What the element size adds; null where it could not be computed.
    pub floor: Option<f64>,
    /// What the constants of the error budget add on average.
    pub constants: f64,
    /// The excess over all of them in standard deviations of omega, the noise's own uncertainty counted in.
    pub z: f64,
    /// `z` above which the model is rejected.
    pub z_limit: f64,
    /// The relative excess.
    pub excess: f64,
    /// `z` above which a group is significant.
    pub z_limit_of_groups: f64,
    /// The groups that contradict the model, the worst first, in words.
    pub worst: Vec<String>,
    /// Plain residual over its expectation, instant by instant.
    pub by_instant: Vec<GroupRecord>,
    /// Region by region: strip, distance from the adhesive, third along the joint.
    pub by_region: Vec<GroupRecord>,
    /// Region by region in each quarter of the test.
    pub by_region_and_time: Vec<GroupRecord>,
}

/// One group of the misfit test.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct GroupRecord {
    /// Where and when.
    pub name: String,
    /// First and last instant, from 1.
    pub instants: [usize; 2],
    /// Numbers compared.
    pub n: usize,
    /// Root mean square of the residual over its expectation.
    pub times_expected: f64,
    /// The excess of the squares in standard deviations.
    pub z: f64,
}

impl GroupRecord {
    fn all(groups: &[MisfitGroup]) -> Vec<Self> {
        let record =
            |MisfitGroup { name, instants, n, ratio: times_expected, z }| Self { name, instants, n, times_expected, z };
        groups.iter().cloned().map(record).collect()
    }
}

impl VerdictRecord {
    fn of(verdict: &Verdict) -> Self {
        Self {
            outcome: verdict.outcome.name().into(),
            determined: verdict.determined(),
            conditional: verdict.outcome == Outcome::Rejected,
            text: verdict.sentences.join(". ") + ".",
            sentences: verdict.sentences.clone(),
            given: verdict.given.clone(),
            thresholds: verdict.thresholds.clone(),
        }
    }
}

impl MisfitRecord {
    pub(super) fn of(misfit: &Misfit) -> Self {
        Self {
            rejected: misfit.rejected(),
            tested: misfit.tested,
            omega: misfit.omega,
            freedom: misfit.freedom,
            floor: misfit.floor,
            constants: misfit.constants,
            z: misfit.z,
            z_limit: misfit.limit,
            excess: misfit.excess,
            z_limit_of_groups: misfit.group_limit,
            worst: misfit.worst(),
            by_instant: GroupRecord::all(&misfit.by_instant),
            by_region: GroupRecord::all(&misfit.by_region),
            by_region_and_time: GroupRecord::all(&misfit.by_both),
        }
    }
}

/// The prescribed parameters of the law as unknowns.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ReleasedRecord {
    /// What omega falls by, in units of the noise's variance.
    pub omega_falls_by: f64,
    /// A fall that right prescriptions exceed in one of a thousand cases.
    pub limit: f64,
    /// Whether the trial converged.
    pub converged: bool,
    /// Of each parameter: prescribed value, the one that the data prefer, and its standard uncertainty by the noise.
    pub parameters: BTreeMap<Name, ReleasedParameterRecord>,
}

/// One prescribed parameter as an unknown.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ReleasedParameterRecord {
    /// The prescribed value.
    pub prescribed: f64,
    /// The value that the data prefer.
    pub value: f64,
    /// Its standard uncertainty by the noise.
    pub std: Option<f64>,
}

impl ReleasedRecord {
    fn of(released: &Released) -> Self {
        let &Released { gain, limit, converged, .. } = released;
        let parameter = |&ReleasedParameter { name, prescribed, value, std }: &ReleasedParameter| {
            (name.into(), ReleasedParameterRecord { prescribed, value, std })
        };
        let parameters = released.parameters.iter().map(parameter).collect();
        Self { omega_falls_by: gain, limit, converged, parameters }
    }
}

/// A line of the error budget; the lines of an interval add up as squares.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct BudgetRecord {
    /// `noise`, the name of a constant, or `element_size`.
    pub name: String,
    /// Where its standard uncertainty comes from: `stated`, `default`, `exact`, `not stated`, `computed`.
    pub source: Name,
    /// The value of the constant, where it is a number.
    pub value: Option<f64>,
    /// Its standard uncertainty; null where nothing is known, and of noise and element size.
    pub std: Option<f64>,
    /// The unit of both.
    pub unit: Name,
    /// Whether it is part of the intervals.
    pub included: bool,
    /// What it does to each parameter per standard uncertainty, in the unit of the parameter.
    pub parameters: BTreeMap<Name, f64>,
    /// What it does to each derived quantity.
    pub derived: BTreeMap<Name, f64>,
}

impl BudgetRecord {
    fn list(fit: &Fit) -> Vec<Self> {
        let names = || fit.parameters.iter().map(|p| p.parameter.name.into());
        let derived_names = || fit.derived.iter().map(|q| q.quantity.name.into());
        let record = |BudgetLine { name, source, value, unit, std, included, parameters, derived }| Self {
            name,
            source: source.name().into(),
            value,
            std,
            unit: unit.into(),
            included,
            parameters: names().zip(parameters).collect(),
            derived: derived_names().zip(derived).collect(),
        };
        fit.budget.lines.iter().cloned().map(record).collect()
    }
}

/// A profile likelihood.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ProfileRecord {
    /// The parameter.
    pub parameter: Name,
    /// Where it was prescribed.
    pub values: Vec<f64>,
    /// Rise of the objective, in squares of standard deviations.
    #[serde(deserialize_with = "numbers")]
    pub rise: Vec<f64>,
    /// Where the rise is 1.96^2.
    pub interval95: [Option<f64>; 2],
}

/// One row of `sweep.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SweepRecord {
    /// The prescribed value.
    pub value: f64,
    /// `converged` or why not.
    pub status: Name,
    /// The parameters that were fitted.
    pub parameters: BTreeMap<Name, ParameterRecord>,
    /// What follows from them.
    pub derived: BTreeMap<Name, QuantityRecord>,
    /// The objective.
    #[serde(deserialize_with = "number")]
    pub omega: f64,
    /// Evaluations.
    pub evaluations: usize,
    /// Evaluations that were rescued.
    pub rescued: usize,
    /// What ended the fit before its time, and what it is therefore without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cut_short: Option<String>,
}

impl SweepRecord {
    /// One row.
    pub fn of(row: &SweepRow) -> Self {
        Self {
            value: row.value,
            status: row.fit.status.name().into(),
            parameters: parameters(&row.fit),
            derived: quantities(&row.fit),
            omega: row.fit.omega,
            evaluations: row.fit.evaluations,
            rescued: row.fit.rescued,
            cut_short: row.fit.cut_short.as_ref().map(CutShort::text),
        }
    }
}

fn parameters(fit: &Fit) -> BTreeMap<Name, ParameterRecord> {
    let record = |p: &FittedParameter| {
        let record = ParameterRecord {
            value: p.value,
            unit: p.parameter.unit.into(),
            meaning: p.parameter.meaning.into(),
            std: p.std,
            std_noise: p.std_noise,
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
        (p.parameter.name.into(), record)
    };
    fit.parameters.iter().map(record).collect()
}

fn quantities(fit: &Fit) -> BTreeMap<Name, QuantityRecord> {
    let record = |&FittedQuantity { quantity, std, std_noise, discretisation, interval95, ends95, bias }: &_| {
        let (value, unit) = (quantity.value, quantity.unit.into());
        let record = QuantityRecord { value, unit, std, std_noise, discretisation, interval95, ends95, bias };
        (quantity.name.into(), record)
    };
    fit.derived.iter().map(record).collect()
}

impl FitReport<'_> {
    /// What a reader has to know of the result next to its verdict.
    fn remarks(&self) -> Vec<Remark> {
        let fit = self.fit;
        let mut found: Vec<Remark> = fit.cut_short.iter().map(remarks::cut_short).collect();
        found.extend(self.case.remarks.iter().chain(&fit.remarks).cloned());
        found.extend(remarks::effects_missing(&fit.budget.missing()));
        found.extend(fit.parameters.iter().filter(|p| p.at_bound).map(remarks::on_bound));
        found.extend(self.is_rescued_at_end().then(remarks::rescued));
        let asked = self.case.options.discretisation != Discretisation::Off;
        if asked && fit.parameters.iter().any(|p| p.discretisation.is_none()) {
            found.push(remarks::discretisation_missing());
        }
        found.extend(remarks::of_intervals(fit));
        found.extend(fit.rotations.as_ref().and_then(|rotations| rotations.remark(&fit.parameters)));
        found.extend(self.force.as_ref().and_then(|force| force.remark.clone()));
        let agreement = self.agreement();
        found.extend((agreement > 1e-6).then(|| remarks::starts_differ(agreement)));
        found
    }

    /// Whether the forward run at the result needed a rescue.
    fn is_rescued_at_end(&self) -> bool {
        self.fit.solution().instants.iter().any(|instant| instant.status == Status::Rescued)
    }

    /// How far apart starts that converged ended, in scaled unknowns.
    fn agreement(&self) -> f64 {
        let converged = self.fit.starts.iter().filter(|end| end.status == FitStatus::Converged);
        converged.fold(0.0_f64, |most, end| most.max(end.distance))
    }

    /// What `fit.json` holds; the fit of the case file `case` took `seconds`.
    pub fn json(&self, case: String, seconds: f64) -> FitRecord {
        let Case { problem, options, about, boundary, .. } = self.case;
        let fit = self.fit;
        let names: Vec<Name> = fit.parameters.iter().map(|p| p.parameter.name.into()).collect();
        let law = problem.unknowns.law();
        let rows = |m: &crate::linalg::Dense| {
            (0..m.n_rows()).map(|r| (0..m.n_columns()).map(|c| m[(r, c)]).collect()).collect()
        };
        let statistics = fit.statistics.as_ref();
        let iteration = |Iteration { stage, z: x, omega, radius, accepted, rescued }| IterationRecord {
            stage,
            x,
            omega,
            radius,
            accepted,
            rescued,
        };
        let start = |StartEnd { start, end, omega, status, evaluations, rescued, .. }| StartRecord {
            start,
            end,
            omega,
            status: status.name().into(),
            evaluations,
            rescued,
        };
        let profile = |Profile { name, values, rise, interval95 }| ProfileRecord {
            parameter: name.into(),
            values,
            rise,
            interval95,
        };
        let change = fit.rotations.as_ref().and_then(|rotations| rotations.change.as_ref());
        FitRecord {
            quadrille: env!("CARGO_PKG_VERSION").into(),
            case,
            units: "mm, MPa, N/mm; x to the right, y up; nodes counted from 0, instants from 1".into(),
            status: fit.status.name().into(),
            reason: fit.reason.clone(),
            cut_short: fit.cut_short.is_some(),
            seconds,
            law: law.name().into(),
            measurement: MeasurementRecord {
                about: about.clone(),
                nodes: problem.observation.compared.iter().filter(|c| **c).count(),
                instants: problem.observation.instants.iter().map(|i| i.index + 1).collect(),
                data: problem.n_data(),
                weights: options.weights.name().into(),
                boundary: boundary.to_string().into(),
                border: problem.border.smooth.as_ref().map(BorderRecord::of),
                noise: problem.noise.source.clone(),
            },
            parameters: parameters(fit),
            prescribed: (law.parameters().iter().zip(&fit.values))
                .filter(|(p, _)| !names.iter().any(|name| name == p.name))
                .map(|(p, value)| (p.name.into(), *value))
                .collect(),
            discretisation: options.discretisation.name().into(),
            parameter_order: names.clone(),
            derived: quantities(fit),
            furthest_mm: fit.furthest.map(|jump| [jump.normal, jump.tangential.abs()]),
            intervals: fit.intervals.as_ref().map(|basis| IntervalsRecord {
                kind: basis.kind.name().into(),
                doubts: basis.linearity.doubts.clone(),
                probe: basis.linearity.probe.clone(),
                draws: basis.draws,
                failed: basis.failed(),
                on_bound: basis.bootstrap.as_ref().map_or(0, |bootstrap| bootstrap.on_bound),
            }),
            correlation: fit.correlation.as_ref().map(rows),
            covariance: fit.covariance.as_ref().map(rows),
            singular_values: fit.singular_values.clone(),
            condition: Some(fit.condition()).filter(|c| c.is_finite()),
            omega: fit.omega,
            omega_expected: statistics.map(|s| s.expected_omega),
            noise_mm: statistics.map(|s| s.sigma * problem.noise.mean_variance().sqrt()).filter(|noise| *noise > 0.0),
            noise_estimated: statistics.is_some_and(|s| s.sigma_estimated),
            evaluations: fit.evaluations,
            rescued: fit.rescued,
            rescued_at_end: self.is_rescued_at_end(),
            largest_boundary_correction_mm: fit.largest_correction,
            history: fit.history.iter().cloned().map(iteration).collect(),
            starts: fit.starts.iter().cloned().map(start).collect(),
            agreement: self.agreement(),
            verdict: VerdictRecord::of(&fit.verdict),
            misfit: fit.misfit.as_ref().map(MisfitRecord::of),
            released: fit.released.as_ref().map(ReleasedRecord::of),
            budget: BudgetRecord::list(fit),
            change_by_finite_rotations: change
                .map(|change| names.iter().cloned().zip(change.iter().copied()).collect()),
            force: self.force.clone(),
            profile: self.profile.clone().map(profile),
            tests: Vec::new(),
            consistency: None,
            remarks: self.remarks(),
        }
    }
}
