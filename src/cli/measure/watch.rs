//! `quadrille watch`: correlates images as a camera writes them.

use crate::cli::args::WatchArgs;
use crate::cli::measure::correlate::{draw, request, session, talk};
use crate::cli::talk::{Paint, Progress};
use crate::cli::{Outcome, Result, allocator};
use crate::io::case::read_case;
use crate::run::{Event, Watching, watch};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// After so long without a frame the camera may be silent for hours.
const SILENT: Duration = Duration::from_secs(10);

pub(crate) fn run(args: &WatchArgs, paint: Paint) -> Result<Outcome> {
    let WatchArgs { correlate: args, pattern, settle, timeout } = args;
    let case = args.case.as_deref().map(read_case).transpose()?.unwrap_or_default();
    let watching = Watching { pattern: pattern.clone(), settle: *settle, timeout: *timeout };
    let mut progress = Progress::new(talk(args), paint);
    let pool = args.threads.pool()?;
    let heard = Arc::new(Mutex::new(Some(Instant::now())));
    let mut watcher = |event: Event<'_>| {
        *heard.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        progress.take(event);
    };
    give_back_when_silent(&heard);
    let ran = watch(&request(args), &case, &watching, &args.output, &pool, session(args)?, &mut watcher)?;
    let Some(ran) = ran else { return Ok(Outcome::Stopped) };
    draw(args, ran.complete)?;
    Ok(ran.outcome)
}

/// Gives memory back to the system, once in every silence. Ends with the process.
fn give_back_when_silent(heard: &Arc<Mutex<Option<Instant>>>) {
    let heard = Arc::clone(heard);
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(SILENT / 10);
            let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
            if heard.take_if(|last| last.elapsed() >= SILENT).is_some() {
                drop(heard);
                allocator::give_back();
            }
        }
    });
}
