//! `quadrille run`: from images to the report.

use crate::cli::about::devices;
use crate::cli::args::{RunArgs, Threads};
use crate::cli::talk::{Paint, Progress, Talk};
use crate::cli::{Outcome, Result, chain, signals};
use crate::run::{CaseRun, Event, RunError, Stop, run_case};
use std::path::Path;

pub(crate) fn run(args: &RunArgs, paint: Paint) -> Result<Outcome> {
    args.drawn.choose();
    let asked = CaseRun {
        overwrite: args.overwrite,
        device: args.device.clone(),
        gpu: devices::options(args.trust_device),
        max_seconds: args.limits.max_seconds,
        max_evaluations: args.limits.max_evaluations,
        stop: signals::listen()?,
        ..CaseRun::new(&args.case, &args.output)
    };
    let talk = Talk::of(args.progress, args.talk.quiet);
    let report = |page: &Path| match talk {
        Talk::Quiet => {}
        Talk::Json => eprintln!("{}", serde_json::json!({ "report": page })),
        _ => eprintln!("report: {}", page.display()),
    };
    of_case(&asked, args.threads, (talk, paint), report)
}

/// Runs a case and says how it goes; `reported` gets the page.
pub(crate) fn of_case(
    asked: &CaseRun,
    threads: Threads,
    (talk, paint): (Talk, Paint),
    reported: impl Fn(&Path),
) -> Result<Outcome> {
    let mut progress = Progress::new(talk, paint);
    let mut watcher = |event: Event<'_>| match event {
        Event::Reported { page } => reported(page),
        _ => progress.take(event),
    };
    or_stopped(run_case(asked, &threads.pool()?, &mut watcher), &asked.stop)
}

/// What a run came to; one that could not go on because it was asked to stop was stopped, and says where.
pub(crate) fn or_stopped(ran: std::result::Result<Outcome, RunError>, stop: &Stop) -> Result<Outcome> {
    match ran {
        Err(error) if stop.is_asked() => {
            eprintln!("quadrille: {}", chain(&error));
            Ok(Outcome::Stopped)
        }
        ran => Ok(ran?),
    }
}
