//! The forward model of a joint: what `quadrille simulate` does.

use crate::identify::{Case, implausible_simulation};
use crate::io::case::CasePathControl;
use crate::io::joint::{JointInput, read_joint};
use crate::mechanics::{EnergyOptions, FollowOptions, Followed, ForwardOptions, Joint, PathEnd, Solution};
use crate::remark::Remark;
use crate::report::ForceRecord;
use crate::report::joint::{JointReport, JointSummary};
use crate::run::folder::{FORCE, J_INTEGRAL, RunFolder};
use crate::run::plan::{Outcome, Stop};
use crate::run::words::remarks::{figure_missing, path_ended, path_goes_back};
use crate::run::words::{Event, Heard, Result, Watcher, absolute};
use rayon::ThreadPool;
use std::path::Path;
use std::time::Instant;

/// Unknowns up to which the energies are computed without being asked for: that takes several solutions for each
/// instant.
const ENERGIES_UP_TO: usize = 20_000;

/// Computes the joint of the case file `case` and writes displacements, tractions, sensitivities and figures into
/// `output`; when `stop` is asked, of the instants so far.
///
/// # Errors
/// See [`crate::run::RunError`]. An instant without a solution is a result.
pub fn simulate(
    case: &Path,
    output: &Path,
    overwrite: bool,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(JointSummary, Outcome)> {
    let input = read_joint(case)?;
    // Uncertainties that [substrate] may state are for `identify`.
    let mut joint = Case::joint(&input)?;
    joint.remarks.extend(implausible_simulation(&joint)?);
    let follow = follow_options(&input)?;
    let folder = RunFolder::for_joint(output, overwrite, true)?;

    let options = ForwardOptions {
        law_sensitivities: true,
        substrate_sensitivities: input.case.output.substrate_sensitivities,
        ..ForwardOptions::default()
    };
    let begin = Instant::now();
    let (heard, watch) = Heard::new(None, stop);
    watch.begins("simulation");
    let n_instants = joint.boundary.instants().len();
    let go_on = |instant: usize| {
        watch.at(instant, n_instants.max(instant), Vec::new);
        watch.ended().is_none()
    };
    let (mut times, mut whole) = (Vec::new(), true);
    let solution = match follow {
        None => {
            heard.during(pool, watcher, || joint.model.forward_while(&*joint.law, &joint.boundary, &options, &go_on))?
        }
        Some(how) => {
            let found = heard
                .during(pool, watcher, || joint.model.follow(&*joint.law, &joint.boundary, &options, &how, &go_on))?;
            joint.remarks.extend(remark_path(&found, n_instants)?);
            whole = matches!(found.end, PathEnd::Last | PathEnd::Rest);
            (times, joint.boundary) = (found.times, found.boundary);
            found.solution
        }
    };
    let seconds = begin.elapsed().as_secs_f64();
    // Between the points of a path that goes back no displacement leads to the next.
    let wanted = input.case.output.energies.unwrap_or(joint.model.n_unknowns() <= ENERGIES_UP_TO && follow.is_none());
    let energies = match wanted {
        true => heard.during(pool, watcher, || {
            let go_on = || watch.ended().is_none();
            joint.model.energies(&*joint.law, &joint.boundary, &solution, &EnergyOptions::default(), &go_on)
        }),
        false => Vec::new(),
    };

    let mut remarks = joint.remarks.clone();
    // The points of a path are no instants of the record.
    let force = if follow.is_none() { force(&input, &joint, &solution, &mut remarks)? } else { None };
    let force = force.as_ref();
    let j_integrals = joint.model.j_integrals(&*joint.law, &solution);
    let (energies, j_integrals) = (energies.as_slice(), j_integrals.as_slice());
    let report = JointReport { energies, times: &times, force, j_integrals, ..JointReport::new(&joint, &solution) };
    let asked = input.case.output.figures.as_deref();
    let solved = |number: &usize| report.solved().any(|(solved, _)| solved == *number);
    for instant in asked.unwrap_or_default().iter().filter(|number| !solved(number)) {
        remarks.push(figure_missing(*instant));
    }
    let summary = report.summary(absolute(case), seconds, remarks);
    write_solution(&folder, &report)?;
    write_loads(&folder, &report)?;
    folder.write_summary(&summary)?;
    report.draw(&report.chosen(asked), |name, picture| folder.save_figure(&name, &picture))?;
    watcher(Event::Simulated { summary: &summary, folder: output });
    let outcome = match solution.converged() && whole {
        true => Outcome::Fine,
        false if stop.is_asked() => Outcome::Stopped,
        false => Outcome::Incomplete,
    };
    Ok((summary, outcome))
}

/// Energies and load cell, where there are such.
fn write_loads(folder: &RunFolder, report: &JointReport<'_>) -> Result<()> {
    if !report.energies.is_empty() {
        folder.write("energies.csv", |out| report.write_energies(out))?;
    }
    if let Some(force) = report.force {
        folder.write(FORCE, |out| force.write(out))?;
        for (name, picture) in force.draw()? {
            folder.save_figure(name, &picture)?;
        }
    }
    Ok(())
}

/// How the path is to be followed; `None` where it is gone from instant to instant.
fn follow_options(input: &JointInput) -> Result<Option<FollowOptions>> {
    let path = &input.case.path;
    let default = FollowOptions::default();
    let (step, max_points) = (path.step.unwrap_or(default.step), path.max_points.unwrap_or(default.max_points));
    if !(step > 0.0 && step <= 10.0) || max_points == 0 {
        return Err(format!(
            "[path] step = {step}, max_points = {max_points}: give a step above 0, up to 10, and a point at least"
        )
        .into());
    }
    Ok((path.control == Some(CasePathControl::ArcLength)).then_some(FollowOptions { step, max_points }))
}

/// What a user should know of a path: where it goes back, and how it ended.
fn remark_path(Followed { times, end, .. }: &Followed, n_instants: usize) -> Result<Vec<Remark>> {
    if times.is_empty() {
        let what = "[path] control = \"arc-length\": no point was found; try a smaller step, or leave [path] out";
        return Err(what.into());
    }
    let mut said = Vec::new();
    let back: Vec<usize> = (2..)
        .zip(times.iter().zip(times.iter().skip(1)))
        .filter(|(_, (before, time))| time < before)
        .map(|(point, _)| point)
        .collect();
    if let (Some(first), Some(last)) = (back.first(), back.last()) {
        said.push(path_goes_back(back.len(), times.len(), [*first, *last]));
    }
    let at = times.last().copied().unwrap_or(0.0);
    said.extend(path_ended(*end, times.len(), at, n_instants));
    Ok(said)
}

/// What the load cell measured beside the prediction.
fn force(
    input: &JointInput,
    joint: &Joint,
    solution: &Solution,
    remarks: &mut Vec<Remark>,
) -> Result<Option<ForceRecord>> {
    let Some(cell) = Case::load_cell(joint, input, remarks)? else { return Ok(None) };
    let comparison = cell.compare(&joint.model, &*joint.law, solution);
    let record = comparison.map(|comparison| ForceRecord::of(&cell, &comparison, false));
    remarks.extend(record.as_ref().and_then(|record| record.remark.clone()));
    Ok(record)
}

/// Tables and grids.
pub(crate) fn write_solution(folder: &RunFolder, report: &JointReport) -> Result<()> {
    let has_adhesive = report.has_adhesive();
    folder.write("solution.csv", |out| report.write_solution(out))?;
    folder.write("reactions.csv", |out| report.write_reactions(out))?;
    if has_adhesive {
        folder.write("tractions.csv", |out| report.write_tractions(out))?;
        folder.write("mode-mixity.csv", |out| report.write_mode_mixity(out))?;
    }
    if report.has_j_integral() {
        folder.write(J_INTEGRAL, |out| report.write_j_integral(out))?;
    }
    folder.write("sensitivities.csv", |out| report.write_sensitivities(out))?;
    let mut numbers = Vec::new();
    for (number, instant) in report.solved() {
        folder.write(&format!("vtu/{number:06}.vtu"), |out| report.write_strips(out, number, instant))?;
        if has_adhesive {
            folder
                .write(&format!("vtu/{number:06}-interface.vtu"), |out| report.write_interface(out, number, instant))?;
        }
        numbers.push(number);
    }
    folder.write_series(&numbers)?;
    if has_adhesive { folder.write_interface_series(&numbers) } else { Ok(()) }
}
