//! `quadrille status`: how far a run is.

use crate::cli::args::StatusArgs;
use crate::cli::talk::{Paint, wrapped};
use crate::cli::{Outcome, Result, plural};
use crate::field::Status;
use crate::io::store::Store;
use crate::report::summary::{Summary, Trust, counts};
use crate::run::words::text::{in_words, runs};
use crate::run::{Holder, RunFolder, all_frames, holders, locks_in};
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

/// Frames that the rate is taken over.
const RATE_OVER: usize = 100;

/// How far a run is.
#[derive(Debug, Serialize)]
struct Standing {
    complete: bool,
    frames: usize,
    /// With any status.
    done: usize,
    converged: usize,
    /// Those that are done and did not converge, by status.
    failed: BTreeMap<&'static str, Vec<[usize; 2]>>,
    /// Not done yet, in ranges with both ends.
    missing: Vec<[usize; 2]>,
    /// Over the last frames that were done; none before two of them are.
    frames_per_second: Option<f64>,
    /// At that rate, while somebody works on it.
    seconds_left: Option<f64>,
    /// Versions of this program and of the one that made the store.
    quadrille: &'static str,
    quadrille_of_store: String,
    device: String,
    /// Who works on it.
    workers: Vec<Holder>,
}

pub(crate) fn run(args: &StatusArgs, paint: Paint) -> Result<Outcome> {
    let store = Store::open(&args.run)?;
    // Also where the store itself was named.
    let folder = store.path().parent().unwrap_or(&args.run).to_owned();
    let standing = Standing::of(&store, &locks_in(&folder));
    if standing.complete && standing.workers.is_empty() {
        complete_summary(&folder, store.n_frames())?;
    }
    if args.json {
        println!("{}", serde_json::to_string_pretty(&standing)?);
    } else {
        standing.print(&args.run, paint);
    }
    let fine = standing.converged == standing.frames;
    Ok(if fine { Outcome::Fine } else { Outcome::Incomplete })
}

impl Standing {
    fn of(store: &Store, locks: &Path) -> Self {
        let n = store.n_frames();
        let (mut missing, mut converged) = (Vec::new(), 0);
        let mut failed: BTreeMap<&'static str, Vec<usize>> = BTreeMap::new();
        let mut times: Vec<SystemTime> = Vec::new();
        for number in 1..=n {
            // A mark that is damaged counts as none: the frame will be done again.
            match store.status(number).unwrap_or(None) {
                None => missing.push(number),
                Some(status) => {
                    if status == Status::Converged {
                        converged += 1;
                    } else {
                        failed.entry(status.name()).or_default().push(number);
                    }
                    times.extend(fs::metadata(store.status_file(number)).and_then(|about| about.modified()));
                }
            }
        }
        times.sort_unstable();
        let last = &times[times.len().saturating_sub(RATE_OVER)..];
        let span = || last.last()?.duration_since(*last.first()?).ok().filter(|span| !span.is_zero());
        let frames_per_second = span().map(|span| (last.len() - 1) as f64 / span.as_secs_f64());
        let workers = holders(locks);
        let header = store.header();
        Self {
            complete: missing.is_empty(),
            frames: n,
            done: n - missing.len(),
            converged,
            failed: failed.into_iter().map(|(status, numbers)| (status, runs(&numbers))).collect(),
            frames_per_second,
            // A camera may go on for as long as it likes.
            seconds_left: frames_per_second
                .filter(|_| workers.iter().any(|one| one.watches.is_none()))
                .map(|rate| missing.len() as f64 / rate),
            missing: runs(&missing),
            quadrille: env!("CARGO_PKG_VERSION"),
            quadrille_of_store: header.quadrille.clone(),
            device: header.device.clone(),
            workers,
        }
    }

    fn print(&self, run: &Path, paint: Paint) {
        let converged = format!("{} converged", self.converged);
        let converged = if self.failed.is_empty() { paint.good(&converged) } else { converged };
        let (done, frames) = (self.done, plural(self.frames, "frame"));
        println!("{}: {done} of {frames} done, {converged}", run.display());
        for (status, frames) in &self.failed {
            let status = paint.bad(&status.replace('_', " "));
            println!("{}", wrapped(&format!("{status}: {}", in_words(frames)), 2));
        }
        if !self.missing.is_empty() {
            let missing = paint.doubtful("missing");
            println!("{}", wrapped(&format!("{missing}: {}", in_words(&self.missing)), 2));
        }
        if let Some(rate) = self.frames_per_second {
            let left = self.seconds_left.map_or(String::new(), |left| format!(", {left:.0} s left"));
            println!("{rate:.2} frames/s{left}");
        }
        println!("quadrille {}, {}", self.quadrille_of_store, self.device);
        for worker in &self.workers {
            println!("in work: {worker}");
        }
        if self.workers.is_empty() && !self.missing.is_empty() {
            println!("no process works on it: the same `quadrille correlate` command resumes it");
        }
    }
}

/// Makes the summary whole where the last of several shards could not: when it lists fewer frames than are done.
fn complete_summary(folder: &Path, n_frames: usize) -> Result<()> {
    /// A summary of which only the number of frames is looked at: that of a long series is large.
    #[derive(Deserialize)]
    struct Listed {
        frames: Vec<IgnoredAny>,
    }
    let Ok(text) = fs::read(folder.join(RunFolder::SUMMARY)) else { return Ok(()) };
    if serde_json::from_slice::<Listed>(&text).map_or(true, |listed| listed.frames.len() == n_frames) {
        return Ok(());
    }
    let mut summary: Summary = serde_json::from_slice(&text)?;
    let frames: Option<Vec<_>> = all_frames(folder, n_frames).into_iter().collect();
    let Some(frames) = frames else { return Ok(()) };
    summary.frames = frames.into_iter().map(|(frame, _)| frame).collect();
    summary.counts = counts(&summary.frames);
    summary.trust = Trust::of(&summary.frames);
    Ok(RunFolder::writable(folder)?.write_summary(&summary)?)
}
