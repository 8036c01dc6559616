//! `quadrille simulate`: the forward model of a joint from a case file.

use super::args::SimulateArgs;
use super::run_folder::{FIGURES, RunFolder};
use super::{Outcome, Result, plural};
use crate::identify::Case;
use crate::io::joint::read_joint;
use crate::mechanics::ForwardOptions;
use crate::report::joint::{JointReport, JointSummary};
use std::path::Path;
use std::time::Instant;

/// Runs the command.
pub(super) fn run(args: &SimulateArgs) -> Result<Outcome> {
    let input = read_joint(&args.case)?;
    // Uncertainties that [substrate] may state are for `identify`.
    let joint = Case::joint(&input)?;
    let folder = RunFolder::open(&args.output, args.overwrite)?;
    folder.clear(false, true)?;
    folder.make(FIGURES)?;

    let options = ForwardOptions {
        law_sensitivities: true,
        substrate_sensitivities: input.case.output.substrate_sensitivities,
        ..ForwardOptions::default()
    };
    let pool = super::pool(args.threads)?;
    let begin = Instant::now();
    let solution = pool.install(|| joint.model.forward(&*joint.law, &joint.boundary, &options))?;
    let seconds = begin.elapsed().as_secs_f64();

    let report = JointReport { joint: &joint, solution: &solution };
    let asked = input.case.output.figures.as_deref();
    let mut warnings = joint.doubts.clone();
    let solved = |number: &usize| report.solved().any(|(solved, _)| solved == *number);
    for instant in asked.unwrap_or_default().iter().filter(|number| !solved(number)) {
        warnings.push(format!("[output] figures names instant {instant}, which has no solution"));
    }
    let summary = report.summary(super::absolute(&args.case), seconds, warnings);
    write_solution(&folder, &report)?;
    folder.write_summary(&summary)?;
    report.draw(&report.chosen(asked), |name, picture| -> Result<()> {
        let path = folder.path().join(FIGURES);
        picture.save(path.join(format!("{name}.png")))?;
        Ok(picture.save(path.join(format!("{name}.svg")))?)
    })?;
    if !args.quiet {
        say(&summary, &args.output);
    }
    Ok(if solution.converged() { Outcome::Fine } else { Outcome::Incomplete })
}

/// Tables and grids.
pub(super) fn write_solution(folder: &RunFolder, report: &JointReport) -> Result<()> {
    folder.write("solution.csv", |out| report.write_solution(out))?;
    folder.write("tractions.csv", |out| report.write_tractions(out))?;
    folder.write("sensitivities.csv", |out| report.write_sensitivities(out))?;
    let mut numbers = Vec::new();
    for (number, instant) in report.solved() {
        folder.write(&format!("vtu/{number:06}.vtu"), |out| report.write_strips(out, number, instant))?;
        folder.write(&format!("vtu/{number:06}-interface.vtu"), |out| report.write_interface(out, number, instant))?;
        numbers.push(number);
    }
    folder.write_series(&numbers)?;
    folder.write_interface_series(&numbers)
}

/// What a user has to know at once.
fn say(summary: &JointSummary, output: &Path) {
    summary.warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    // Those of the instants grow with the test: the last says it all, summary.json has each.
    if let Some(worst) = summary.instants.iter().rfind(|instant| !instant.warnings.is_empty()) {
        worst.warnings.iter().for_each(|warning| eprintln!("warning: instant {}: {warning}", worst.instant));
    }
    // Of the instants without a solution the first says why.
    if let Some(message) = summary.instants.iter().find_map(|instant| instant.message.as_ref()) {
        eprintln!("{message}");
    }
    let n = summary.instants.iter().filter(|instant| instant.message.is_none()).count();
    let total = plural(summary.instants.len(), "instant");
    eprintln!("{n} of {total} converged in {:.3} s, results in {}", summary.seconds, output.display());
}
