//! `quadrille simulate`: the forward model of a joint from a case file.

use crate::cli::args::{ProgressKind, SimulateArgs};
use crate::cli::talk::{Paint, Progress, Talk};
use crate::cli::{Outcome, Result, signals};
use crate::run::{Event, simulate};

pub(crate) fn run(args: &SimulateArgs, paint: Paint) -> Result<Outcome> {
    args.drawn.choose();
    let mut progress = Progress::new(Talk::of(ProgressKind::Text, args.talk.quiet), paint);
    let (output, pool, stop) = (&args.results.output, args.threads.pool()?, signals::listen()?);
    let mut watcher = |event: Event<'_>| progress.take(event);
    let (_, outcome) = simulate(&args.case, output, args.results.overwrite, &pool, &stop, &mut watcher)?;
    Ok(outcome)
}
