//! `quadrille run`: from images to the report.

use super::args::RunArgs;
use super::progress::{Progress, Talk};
use super::{Outcome, Result, devices, identify, simulate};
use crate::run::{CaseRun, Event, run_case};

/// Runs the command.
pub(super) fn run(args: &RunArgs) -> Result<Outcome> {
    let asked = CaseRun {
        overwrite: args.overwrite,
        device: args.device.clone(),
        gpu: devices::options(),
        ..CaseRun::new(&args.case, &args.output)
    };
    let mut progress = Progress::new(if args.talk.quiet { Talk::Quiet } else { Talk::Normal });
    let mut watcher = |event: Event<'_>| match event {
        Event::Identified { .. } | Event::Simulated { .. } | Event::Reported { .. } if args.talk.quiet => {}
        Event::Identified { fit, folder } => identify::say(fit, folder),
        Event::Simulated { summary, folder } => simulate::say(summary, folder),
        Event::Reported { page } => eprintln!("report: {}", page.display()),
        _ => progress.take(event),
    };
    Ok(run_case(&asked, &args.threads.pool()?, &mut watcher)?)
}
