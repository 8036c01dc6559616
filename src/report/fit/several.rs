//! `fit.json` and `tests.csv` of a fit of several tests.

use super::FitReport;
use super::json::{ConsistencyRecord, FitRecord, MisfitRecord, TestParameterRecord, TestRecord};
use crate::identify::{CombinedCase, CombinedFit, Consistency, TestFit};
use crate::io::joint::write_table;
use crate::report::{Name, to_strings, version};
use std::io::{self, Write};

/// What `fit.json` holds of a fit of several tests, whose `reports` are those of each; the fit of the case file `path`
/// took `seconds`.
///
/// # Panics
/// When there is no report.
pub fn several_json(
    case: &CombinedCase<'_>,
    fit: &CombinedFit,
    reports: &[FitReport<'_>],
    path: &str,
    seconds: f64,
) -> FitRecord {
    let mut records: Vec<FitRecord> = reports.iter().map(|report| report.json(path.to_owned(), seconds)).collect();
    let mut remarks = case.remarks.clone();
    for ((record, report), test) in records.iter().zip(reports).zip(&fit.tests) {
        // Those of the case are there already, with the name of the test.
        for remark in record.remarks.iter().filter(|remark| !report.case.remarks.contains(remark)) {
            let of_test = report.fit.remarks.contains(remark);
            let remark = if of_test { remark.clone().of_test(&test.share.name) } else { remark.clone() };
            if !remarks.contains(&remark) {
                remarks.push(remark);
            }
        }
    }
    let tests: Vec<TestRecord> =
        (fit.tests.iter().zip(&records).zip(reports)).map(|((t, r), p)| test(t, r, p)).collect();
    let mut record = records.swap_remove(0);
    let sum = |of: fn(&TestRecord) -> usize| tests.iter().map(of).sum::<usize>();
    record.measurement.nodes = sum(|test| test.measurement.nodes);
    record.measurement.data = sum(|test| test.measurement.data);
    record.measurement.instants = Vec::new();
    let of_each = |of: fn(&TestRecord) -> &str| -> String {
        tests.iter().map(|test| format!("{}: {}", test.name, of(test))).collect::<Vec<_>>().join("; ")
    };
    record.measurement.noise = of_each(|test| &test.measurement.noise);
    record.measurement.about = of_each(|test| &test.measurement.about);
    let mixed = |of: fn(&TestRecord) -> &Name| -> Name {
        let first = of(&tests[0]);
        if tests.iter().all(|test| of(test) == first) { first.clone() } else { "of each test".into() }
    };
    record.measurement.weights = mixed(|test| &test.measurement.weights);
    record.measurement.boundary = mixed(|test| &test.measurement.boundary);
    record.omega = fit.omega;
    record.omega_expected = fit.tests.iter().map(|t| t.fit.statistics.as_ref().map(|s| s.expected_omega)).sum();
    (record.noise_mm, record.force, record.measurement.border) = (None, None, None);
    record.noise_estimated = tests.iter().any(|test| test.noise_estimated);
    record.misfit = fit.misfit.as_ref().map(MisfitRecord::of);
    record.consistency = fit.consistency.as_ref().map(ConsistencyRecord::of);
    (record.tests, record.remarks) = (tests, remarks);
    record
}

fn test(test: &TestFit, record: &FitRecord, report: &FitReport<'_>) -> TestRecord {
    let share = &test.share;
    let stds = share.std_alone.iter().zip(&share.std_without);
    let parameters = (record.parameter_order.iter().cloned().zip(stds))
        .map(|(name, (&std_alone, &std_without))| (name, TestParameterRecord { std_alone, std_without }))
        .collect();
    TestRecord {
        name: share.name.clone(),
        measurement: record.measurement.clone(),
        omega: share.omega,
        noise_mm: record.noise_mm,
        noise_estimated: record.noise_estimated,
        pixel_size_mm: report.case.problem.observation.pixel_size_mm,
        opening_share: share.opening_share,
        adds_nothing: share.adds_nothing,
        parameters,
        misfit: record.misfit.clone(),
        force: record.force.clone(),
    }
}

impl ConsistencyRecord {
    fn of(consistency: &Consistency) -> Self {
        Self {
            contradicted: consistency.contradicted(),
            omega_falls_by: consistency.gain,
            expected: consistency.expected,
            z: consistency.z,
            z_limit: consistency.limit,
        }
    }
}

/// Writes `tests.csv`: of each test what it tells; NaN where it says nothing.
///
/// # Errors
/// Those of `out`.
pub fn write_tests<W: Write>(out: W, fit: &CombinedFit) -> io::Result<()> {
    let names: Vec<String> =
        (1..).zip(&fit.tests).map(|(k, test): (usize, _)| format!("{k} = {}", test.share.name)).collect();
    let notes = [
        version(),
        format!("several tests, one law: {}", names.join(", ")),
        "standard uncertainties by the noise: of all tests, of one alone, of all others without it".to_owned(),
    ];
    let mut columns = to_strings(&["test", "data", "adds_nothing", "omega", "misfit_z", "opening_share"]);
    for p in &fit.fit().parameters {
        let key = p.parameter.key();
        columns.extend(["std", "std_alone", "std_without"].map(|what| format!("{key}_{what}")));
    }
    let rows = (1u64..).zip(&fit.tests).map(|(k, TestFit { share, fit })| {
        let z = fit.misfit.as_ref().map_or(f64::NAN, |misfit| misfit.z);
        let mut values = vec![share.omega, z, share.opening_share.unwrap_or(f64::NAN)];
        for ((p, alone), without) in fit.parameters.iter().zip(&share.std_alone).zip(&share.std_without) {
            values.extend([p.std_noise, *alone, *without].map(|std| std.unwrap_or(f64::NAN)));
        }
        (vec![k, share.n_data as u64, u64::from(share.adds_nothing)], values)
    });
    write_table(out, &notes, &columns, rows)
}
