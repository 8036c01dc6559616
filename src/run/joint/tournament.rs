//! Several laws on the same data: what `quadrille identify --tournament` does, and a fit whose case names other laws.

use crate::identify::{Case, tournament};
use crate::io::joint::JointInput;
use crate::remark::Remark;
use crate::report::Picture;
use crate::report::tournament::{TournamentRecord, TournamentReport};
use crate::run::folder::{FIGURES, RunFolder, TOURNAMENT, TOURNAMENT_TRACTIONS};
use crate::run::plan::{Outcome, Stop};
use crate::run::words::{Event, Heard, Result, Watcher, absolute};
use rayon::ThreadPool;
use std::path::Path;
use std::time::Instant;

/// Fits all laws that the case `input` of the file `case` names and writes what comes of it into `output`: what
/// `tournament.json` holds, and whether a law is left and every fit converged.
///
/// # Errors
/// See [`crate::run::RunError`]. A law whose fit fails or that the data reject is a result.
pub fn compare_laws(
    input: &JointInput,
    case: &Path,
    output: &Path,
    overwrite: bool,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(TournamentRecord, Outcome)> {
    let joint = Case::joint(input)?;
    let mut of_case = Case::new(&joint, input, case)?;
    let remarks: Vec<Remark> = joint.remarks.iter().chain(&of_case.remarks).cloned().collect();
    remarks.iter().for_each(|remark| watcher(Event::Remark(remark)));
    let folder = RunFolder::for_joint(output, overwrite, false)?;
    compare_in(&mut of_case, &folder, absolute(case), remarks, pool, stop, watcher)
}

/// The same of a case that is made already, into a folder that is ready.
pub(crate) fn compare_in(
    of_case: &mut Case<'_>,
    folder: &RunFolder,
    name: String,
    remarks: Vec<Remark>,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(TournamentRecord, Outcome)> {
    folder.make(FIGURES)?;
    let begin = Instant::now();
    let (heard, watch) = Heard::new(of_case.max_seconds, stop);
    of_case.problem.watch = watch;
    let found = heard.during(pool, watcher, || tournament(&of_case.problem, &of_case.options, &of_case.laws))?;
    let report = TournamentReport::new(&found, name, of_case.about.clone(), begin.elapsed().as_secs_f64(), remarks);
    folder.write_json(TOURNAMENT, &report.record)?;
    folder.write(TOURNAMENT_TRACTIONS, |out| report.write_tractions(out))?;
    report.draw(|name: String, picture: Picture| folder.save_figure(&name, &picture))?;
    let page = report.page()?.html();
    folder.write(RunFolder::REPORT, |out| std::io::Write::write_all(out, page.as_bytes()))?;
    watcher(Event::Compared { tournament: &report.record, folder: folder.path() });
    let converged = found.laws.iter().all(crate::identify::LawFit::converged);
    let outcome = match (stop.is_asked(), converged && !found.alike.is_empty()) {
        (true, _) => Outcome::Stopped,
        (false, true) => Outcome::Fine,
        (false, false) => Outcome::Incomplete,
    };
    Ok((report.record, outcome))
}
