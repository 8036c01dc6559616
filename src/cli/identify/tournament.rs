//! `quadrille identify --tournament`: several laws on the same data.

use crate::cli::args::IdentifyArgs;
use crate::cli::identify::case::or_stopped;
use crate::cli::talk::{Paint, Progress, Talk};
use crate::cli::{Outcome, Result, signals};
use crate::io::joint::read_joint;
use crate::run::{Event, compare_laws};

pub(crate) fn run(args: &IdentifyArgs, laws: &[String], paint: Paint) -> Result<Outcome> {
    let mut input = read_joint(&args.case)?;
    if let Some(fit) = &mut input.case.fit {
        args.limits.over(fit);
        if !laws.is_empty() {
            fit.laws = laws.to_vec();
        }
        if fit.laws.is_empty() {
            let laws = crate::mechanics::cohesive::LAW_NAMES.join(", ");
            return Err(format!("nothing to compare: give --tournament A,B, or laws in [fit]; there are {laws}").into());
        }
    }
    let mut progress = Progress::new(Talk::of(args.progress, args.talk.quiet), paint);
    let (output, pool, stop) = (&args.results.output, args.threads.pool()?, signals::listen()?);
    let mut watcher = |event: Event<'_>| progress.take(event);
    let ran = compare_laws(&input, &args.case, output, args.results.overwrite, &pool, &stop, &mut watcher);
    or_stopped(ran.map(|(_, outcome)| outcome), &stop)
}
