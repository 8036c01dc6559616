//! The parameters of an adhesive from measured displacements: what `quadrille identify` does.

use crate::identify::{Case, CutShort, Ended, Fit, FitStatus, fit, profile};
use crate::io::case::CaseFit;
use crate::io::joint::JointInput;
use crate::reduction::Traction;
use crate::report::fit::{FitRecord, FitReport};
use crate::report::joint::JointReport;
use crate::report::{Picture, direct_plot};
use crate::run::folder::read::read_json;
use crate::run::folder::run_folder::REDUCTION;
use crate::run::folder::{FORCE, RunFolder};
use crate::run::joint::tournament::compare_in;
use crate::run::joint::write_solution;
use crate::run::plan::{Outcome, Stop};
use crate::run::words::{Event, Heard, Result, Watcher, absolute};
use rayon::ThreadPool;
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// What was found, in the folder of the results.
pub(crate) const FIT: &str = "fit.json";
/// What a change of each parameter does to the law, and along the joint.
pub(crate) const LAW_SENSITIVITIES: &str = "law-sensitivities.csv";
pub(crate) const JOINT_SENSITIVITIES: &str = "joint-sensitivities.csv";

/// Fits the case `input` of the file `case` and writes everything into `output`: what `fit.json` holds, and whether the
/// fit converged. When `stop` is asked, the fit ends at the best point so far.
///
/// # Errors
/// See [`crate::run::RunError`]. A fit that does not converge is a result.
pub fn identify(
    input: &JointInput,
    case: &Path,
    output: &Path,
    overwrite: bool,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(FitRecord, Outcome)> {
    let mut joint = Case::joint(input)?;
    let mut of_case = Case::new(&joint, input, case)?;
    // What hardly anything has is known before the fit, which may take long for that very reason.
    joint.remarks.iter().chain(&of_case.remarks).for_each(|remark| watcher(Event::Remark(remark)));
    of_case.options.direct = direct_in(input.case.fit.as_ref(), &input.case.base)?.map(Arc::new);
    let folder = RunFolder::for_joint(output, overwrite, true)?;
    let begin = Instant::now();
    let (heard, watch) = Heard::new(of_case.max_seconds, stop);
    of_case.problem.watch = watch.clone();
    let mut found = heard.during(pool, watcher, || fit(&of_case.problem, &of_case.options))?;
    let seconds = begin.elapsed().as_secs_f64();
    let profile =
        of_case.profile.map(|k| heard.during(pool, watcher, || profile(&of_case.problem, &of_case.options, &found, k)));
    let profile = match (profile, watch.ended()) {
        (Some(_), Some(ended)) => {
            let cut = found.cut_short.get_or_insert(CutShort { ended, missing: Vec::new() });
            cut.missing.push("the profile likelihood");
            None
        }
        (profile, _) => profile.transpose()?,
    };
    let report = pool.install(|| FitReport::new(&of_case, &found, profile))?;
    let mut json = report.json(absolute(case), seconds);
    json.remarks.splice(0..0, joint.remarks.iter().cloned());
    let beside = of_case.options.direct.clone();
    if let Some(direct) = &beside {
        let fitted = of_case.problem.unknowns.law_at(&found.evaluation.x)?;
        json.remarks.extend(direct.differs(&*fitted, |separation| report.std_along(direct, separation)));
    }
    // First of all: when a figure fails, the result is there.
    folder.write_json(FIT, &json)?;
    folder.write("fit-history.csv", |out| report.write_history(out))?;
    if !joint.model.mesh().interfaces().is_empty() {
        folder.write("traction-bands.csv", |out| report.write_bands(out))?;
        folder.write("law.csv", |out| report.write_law(out))?;
        folder.write(LAW_SENSITIVITIES, |out| report.write_law_sensitivities(out))?;
        folder.write(JOINT_SENSITIVITIES, |out| report.write_joint_sensitivities(out))?;
    }
    folder.write("budget.csv", |out| report.write_budget(out))?;
    if let Some(force) = &report.force {
        folder.write(FORCE, |out| force.write(out))?;
    }
    let save = |name: String, picture: Picture| folder.save_figure(&name, &picture);
    let asked = input.case.output.figures.as_deref();
    let chosen = JointReport::new(&joint, found.solution()).chosen(asked);
    report.draw(&chosen, save)?;
    if let Some(direct) = &beside {
        let fitted = of_case.problem.unknowns.law_at(&found.evaluation.x)?;
        folder.save_figure("direct-law", &direct_plot(direct, &*fitted).draw()?)?;
    }
    if !of_case.laws.is_empty() && found.cut_short.is_none() {
        compare_in(&mut of_case, &folder, absolute(case), json.remarks.clone(), pool, stop, watcher)?;
    }
    // The joint of the fit, for everything that `simulate` writes.
    let law = of_case.problem.unknowns.law_at(&found.evaluation.x)?;
    let fitted_model = found.evaluation.fitted_model();
    joint.law = law;
    fitted_model.into_iter().for_each(|model| joint.model = model);
    let j_integrals = joint.model.j_integrals(&*joint.law, found.solution());
    let (force, j_integrals) = (json.force.as_ref(), j_integrals.as_slice());
    let of_joint = JointReport { force, j_integrals, ..JointReport::new(&joint, found.solution()) };
    write_solution(&folder, &of_joint)?;
    folder.write_summary(&of_joint.summary(absolute(case), seconds, json.remarks.clone()))?;
    of_joint.draw(&chosen, save)?;
    watcher(Event::Identified { fit: &json, folder: output });
    let outcome = outcome_of(&found, &json);
    Ok((json, outcome))
}

/// The traction of the reduced test that `[fit] direct` names.
#[derive(Deserialize)]
struct Reduced {
    tractions: Vec<Traction>,
}

/// The direct traction that a fit names, of the folder of `quadrille reduce`.
///
/// # Errors
/// A folder that has none.
pub(crate) fn direct_in(fit: Option<&CaseFit>, base: &Path) -> Result<Option<Traction>> {
    let Some(folder) = fit.and_then(|fit| fit.direct.as_ref()).map(|name| base.join(name)) else { return Ok(None) };
    let reduced: Reduced = read_json(&folder.join(REDUCTION))?;
    let none = || format!("[fit] direct: {} has no traction that a law can be compared with", folder.display());
    let whole = reduced.tractions.into_iter().next().filter(Traction::is_whole);
    Ok(Some(whole.ok_or_else(none)?))
}

/// What a fit came to whose record is `json`.
pub(crate) fn outcome_of(fit: &Fit, json: &FitRecord) -> Outcome {
    match &fit.cut_short {
        Some(CutShort { ended: Ended::Stopped, .. }) => Outcome::Stopped,
        None if fit.status == FitStatus::Converged && !json.verdict.conditional => Outcome::Fine,
        _ => Outcome::Incomplete,
    }
}
