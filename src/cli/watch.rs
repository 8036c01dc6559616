//! `quadrille watch`: correlates images as a camera writes them.

use super::args::WatchArgs;
use super::correlate::{draw, request, session, talk};
use super::paint::Paint;
use super::progress::Progress;
use super::{Outcome, Result};
use crate::io::case::read_case;
use crate::run::{Event, Watching, watch};

/// Runs the command.
pub(super) fn run(args: &WatchArgs, paint: Paint) -> Result<Outcome> {
    let WatchArgs { correlate: args, pattern, settle, timeout } = args;
    let case = args.case.as_deref().map(read_case).transpose()?.unwrap_or_default();
    let watching = Watching { pattern: pattern.clone(), settle: *settle, timeout: *timeout };
    let mut progress = Progress::new(talk(args), paint);
    let pool = args.threads.pool()?;
    let mut watcher = |event: Event<'_>| progress.take(event);
    let ran = watch(&request(args), &case, &watching, &args.output, &pool, session(args)?, &mut watcher)?;
    let Some(ran) = ran else { return Ok(Outcome::Stopped) };
    draw(args, ran.complete)?;
    Ok(ran.outcome)
}
