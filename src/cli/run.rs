//! `quadrille run`: from images to the report.

use super::args::{RunArgs, Threads};
use super::progress::{Progress, Talk};
use super::{Outcome, Result, devices, identify, simulate};
use crate::run::{CaseRun, Event, run_case};
use std::path::Path;

/// Runs the command.
pub(super) fn run(args: &RunArgs) -> Result<Outcome> {
    let asked = CaseRun {
        overwrite: args.overwrite,
        device: args.device.clone(),
        gpu: devices::options(),
        ..CaseRun::new(&args.case, &args.output)
    };
    let report = |page: &Path| eprintln!("report: {}", page.display());
    of_case(&asked, args.threads, args.talk.quiet, report)
}

/// Runs a case and says how it goes; `reported` gets the page.
pub(super) fn of_case(asked: &CaseRun, threads: Threads, quiet: bool, reported: impl Fn(&Path)) -> Result<Outcome> {
    let mut progress = Progress::new(if quiet { Talk::Quiet } else { Talk::Normal });
    let mut watcher = |event: Event<'_>| match event {
        Event::Identified { .. } | Event::Simulated { .. } | Event::Reported { .. } if quiet => {}
        Event::Identified { fit, folder } => identify::say(fit, folder),
        Event::Simulated { summary, folder } => simulate::say(summary, folder),
        Event::Reported { page } => reported(page),
        _ => progress.take(event),
    };
    Ok(run_case(asked, &threads.pool()?, &mut watcher)?)
}
