//! `quadrille simulate`: the forward model of a joint from a case file.

use super::args::SimulateArgs;
use super::{Outcome, Result, plural};
use crate::report::joint::JointSummary;
use crate::run::{Event, simulate};
use std::path::Path;

/// Runs the command.
pub(super) fn run(args: &SimulateArgs) -> Result<Outcome> {
    let mut watcher = |event: Event<'_>| match event {
        Event::Simulated { summary, folder } if !args.talk.quiet => say(summary, folder),
        _ => {}
    };
    let (_, outcome) =
        simulate(&args.case, &args.results.output, args.results.overwrite, &args.threads.pool()?, &mut watcher)?;
    Ok(outcome)
}

/// What a user has to know at once.
pub(super) fn say(summary: &JointSummary, output: &Path) {
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
