//! `quadrille watch`: correlates images as a camera writes them.

use crate::cli::args::WatchArgs;
use crate::cli::measure::correlate::{draw, request, session, talk};
use crate::cli::talk::{Paint, Progress};
use crate::cli::{Outcome, Result};
use crate::io::case::read_case;
use crate::run::{Event, Watching, watch};

pub(crate) fn run(args: &WatchArgs, paint: Paint) -> Result<Outcome> {
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
