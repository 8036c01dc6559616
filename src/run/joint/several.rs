//! One law from several tests: what `quadrille identify` does with a case of `[[test]]`.

use crate::identify::{CombinedCase, CombinedFit, FitError, fit_combined};
use crate::io::joint::TestsInput;
use crate::mechanics::{Joint, Solution};
use crate::report::Picture;
use crate::report::fit::{FitRecord, FitReport, several_json, several_page, write_tests};
use crate::report::joint::JointReport;
use crate::run::folder::{FORCE, RunFolder};
use crate::run::joint::identification::direct_in;
use crate::run::joint::{FIT, outcome_of, write_solution};
use crate::run::plan::{Outcome, Stop};
use crate::run::words::{Event, Heard, Result, RunError, Watcher, absolute};
use rayon::ThreadPool;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Fits one law to the tests of `input`, the case file `case`, and writes everything into `output`, what belongs to one
/// test into its folder there: what `fit.json` holds, and whether the fit converged.
///
/// # Errors
/// See [`RunError`]. A fit that does not converge is a result.
pub fn identify_several(
    input: &TestsInput,
    case: &Path,
    output: &Path,
    overwrite: bool,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(FitRecord, Outcome)> {
    let mut joints = CombinedCase::joints(input)?;
    let mut of_case = CombinedCase::new(&joints, input)?;
    let direct = direct_in(Some(&input.fit), case.parent().unwrap_or(Path::new("")))?.map(Arc::new);
    of_case.tests.iter_mut().for_each(|test| test.case.options.direct.clone_from(&direct));
    of_case.remarks.iter().for_each(|remark| watcher(Event::Remark(remark)));
    let folder = RunFolder::for_joint(output, overwrite, false)?;
    let begin = Instant::now();
    let (heard, watch) = Heard::new(of_case.max_seconds, stop);
    of_case.tests.iter_mut().for_each(|test| test.case.problem.watch = watch.clone());
    let found = heard.during(pool, watcher, || fit_combined(&of_case))?;
    let seconds = begin.elapsed().as_secs_f64();
    let reports = pool.install(|| {
        let pairs = of_case.tests.iter().zip(&found.tests);
        pairs
            .map(|(test, of)| FitReport::new(&test.case, &of.fit, None))
            .collect::<std::result::Result<Vec<_>, FitError>>()
    })?;
    let json = several_json(&of_case, &found, &reports, &absolute(case), seconds);
    write_common(&folder, &json, &found, &reports)?;
    let asked = input.output.figures.as_deref();
    for ((report, joint), test) in reports.iter().zip(&joints).zip(&found.tests) {
        let own = RunFolder::for_joint(&output.join(&test.share.name), true, true)?;
        own.write("traction-bands.csv", |out| report.write_bands(out))?;
        if let Some(force) = &report.force {
            own.write(FORCE, |out| force.write(out))?;
        }
        let chosen = JointReport::new(joint, test.fit.solution()).chosen(asked);
        report.draw(&chosen, |name: String, picture: Picture| own.save_figure(&name, &picture))?;
    }
    let of_tests = of_case.tests.iter().zip(&found.tests);
    let laws = of_tests
        .map(|(of, test)| {
            let (problem, evaluation) = (&of.case.problem, &test.fit.evaluation);
            problem.unknowns.law_at(&evaluation.x).map(|law| (law, evaluation.fitted_model()))
        })
        .collect::<std::result::Result<Vec<_>, _>>()?;
    drop(reports);
    drop(of_case);
    for ((joint, (law, model)), test) in joints.iter_mut().zip(laws).zip(&found.tests) {
        joint.law = law;
        model.into_iter().for_each(|model| joint.model = model);
        let own = RunFolder::for_export(&output.join(&test.share.name))?;
        write_test(&own, joint, test.fit.solution(), &absolute(case), seconds, asked)?;
    }
    watcher(Event::Identified { fit: &json, folder: output });
    let outcome = outcome_of(found.fit(), &json);
    Ok((json, outcome))
}

/// What belongs to all tests.
fn write_common(folder: &RunFolder, json: &FitRecord, found: &CombinedFit, reports: &[FitReport<'_>]) -> Result<()> {
    let first = reports.first().ok_or(RunError::Bug("a fit of several tests has none"))?;
    // First of all: when a figure fails, the result is there.
    folder.write_json(FIT, json)?;
    folder.write("tests.csv", |out| write_tests(out, found))?;
    folder.write("fit-history.csv", |out| first.write_history(out))?;
    folder.write("law.csv", |out| first.write_law(out))?;
    folder.write("budget.csv", |out| first.write_budget(out))?;
    first.draw(&[], |name: String, picture: Picture| folder.save_figure(&name, &picture))?;
    let page = several_page(json, reports)?.html();
    folder.write(RunFolder::REPORT, |out| out.write_all(page.as_bytes()))
}

/// The model of one test with the law that was found.
fn write_test(
    folder: &RunFolder,
    joint: &Joint,
    solution: &Solution,
    case: &str,
    seconds: f64,
    asked: Option<&[usize]>,
) -> Result<()> {
    let j_integrals = joint.model.j_integrals(&*joint.law, solution);
    let report = JointReport { j_integrals: &j_integrals, ..JointReport::new(joint, solution) };
    write_solution(folder, &report)?;
    folder.write_summary(&report.summary(case.to_owned(), seconds, joint.remarks.clone()))?;
    report.draw(&report.chosen(asked), |name, picture| folder.save_figure(&name, &picture))
}
