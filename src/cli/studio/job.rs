//! A run that goes on while the page looks on.

use crate::cli::{allocator, chain, plural};
use crate::io::case::read_case;
use crate::report::summary::Trust;
use crate::run::{CaseRun, Event, Existing, Outcome, Plan, Request, RunFolder, Session, Stop, run_case, run_series};
use rayon::ThreadPool;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// How long the page waits for news before it asks again.
const NEWS: Duration = Duration::from_secs(5);
/// Frames that are told at once.
const FRAMES_AT_ONCE: usize = 500;

pub(super) struct Wanted {
    pub case: PathBuf,
    pub output: PathBuf,
    /// Whether results of another run there are replaced.
    pub replace: bool,
    /// Whether it goes on to the law of an adhesive.
    pub is_joint: bool,
    /// Device and the like.
    pub asked: Request,
    pub pool: Arc<ThreadPool>,
}

#[derive(Default)]
struct Going {
    /// Rises with every change.
    version: usize,
    running: bool,
    stop: Stop,
    total: Option<usize>,
    before: usize,
    frames: Vec<Value>,
    notes: Vec<Value>,
    /// How a fit goes.
    fitting: Option<String>,
    /// How far the displacements can be trusted.
    trust: Option<String>,
    /// `fine`, `incomplete`, `stopped`, or `failed`.
    outcome: Option<&'static str>,
    error: Option<String>,
}

/// The run of the page: none, one that goes on, or the last one.
#[derive(Default)]
pub(super) struct Job {
    going: Mutex<Going>,
    news: Condvar,
}

impl Job {
    fn going(&self) -> MutexGuard<'_, Going> {
        self.going.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut Going)) {
        let mut going = self.going();
        change(&mut going);
        going.version += 1;
        self.news.notify_all();
    }

    pub fn is_running(&self) -> bool {
        self.going().running
    }

    pub fn n_done(&self) -> usize {
        let going = self.going();
        going.frames.iter().filter_map(|frame| frame["number"].as_u64()).max().unwrap_or(0) as usize
    }

    pub fn stop(&self) {
        self.change(|going| going.stop.ask());
    }

    /// How it goes since `version`: waits a while for news. Frames from the `from`th on.
    pub fn news(&self, version: usize, from: usize) -> Value {
        let going = self.going();
        let old = |going: &mut Going| going.version == version;
        let (going, _) = self.news.wait_timeout_while(going, NEWS, old).unwrap_or_else(PoisonError::into_inner);
        let frames = going.frames.get(from..).unwrap_or(&[]);
        json!({
            "version": going.version,
            "running": going.running,
            "stopping": going.running && going.stop.is_asked(),
            "total": going.total,
            "before": going.before,
            "done": going.frames.len(),
            "frames": &frames[..frames.len().min(FRAMES_AT_ONCE)],
            "notes": going.notes,
            "fitting": going.fitting,
            "trust": going.trust,
            "outcome": going.outcome,
            "error": going.error,
        })
    }

    /// Begins a run; false while another one goes on.
    pub fn begin(self: &Arc<Self>, wanted: Wanted) -> bool {
        let stop = Stop::default();
        {
            let mut going = self.going();
            if going.running {
                return false;
            }
            let version = going.version + 1;
            *going = Going { version, running: true, stop: stop.clone(), ..Going::default() };
        }
        self.news.notify_all();
        let job = Arc::clone(self);
        std::thread::spawn(move || {
            let ran = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| job.run(&wanted, &stop)));
            job.change(|going| {
                going.running = false;
                match ran {
                    Ok(Ok(outcome)) => going.outcome = Some(word(outcome)),
                    Ok(Err(_)) if stop.is_asked() => going.outcome = Some("stopped"),
                    Ok(Err(error)) => (going.outcome, going.error) = (Some("failed"), Some(chain(error.as_ref()))),
                    Err(_) => (going.outcome, going.error) = (Some("failed"), Some(BUG.to_owned())),
                }
            });
            allocator::give_back();
        });
        true
    }

    fn run(&self, wanted: &Wanted, stop: &Stop) -> crate::cli::Result<Outcome> {
        let mut watcher = |event: Event<'_>| self.hear(event);
        if wanted.is_joint {
            let asked = CaseRun {
                overwrite: wanted.replace,
                device: wanted.asked.device.clone(),
                gpu: wanted.asked.gpu.clone(),
                stop: stop.clone(),
                ..CaseRun::new(&wanted.case, &wanted.output)
            };
            return Ok(run_case(&asked, &wanted.pool, &mut watcher)?);
        }
        let plan = Plan::of(&wanted.asked, &read_case(&wanted.case)?)?;
        let folder = RunFolder::writable(&wanted.output)?;
        let existing = if wanted.replace { Existing::Replace } else { Existing::Continue };
        let session = Session { stop: stop.clone(), ..Session::new(existing) };
        Ok(run_series(&plan, &folder, &wanted.pool, session, &mut watcher)?.outcome)
    }

    fn hear(&self, event: Event<'_>) {
        self.change(|going| match event {
            Event::Begun { total, before } => (going.total, going.before) = (total, before),
            Event::Note(note) => going.notes.push(json!({ "text": note })),
            Event::Remark(remark) => going.notes.push(json!(remark)),
            Event::Frame { summary, .. } => going.frames.push(json!({
                "number": summary.number,
                "file": Path::new(&summary.file).file_name().map(|name| name.to_string_lossy()),
                "status": summary.status.name().replace('_', " "),
                "iterations": summary.iterations,
                "residual_grey": summary.residual_grey,
                "remarks": summary.remarks,
            })),
            Event::Finished { frames, .. } => going.trust = Trust::of(frames).map(|trust| format!("Trust: {trust}.")),
            Event::Fitting(progress) => {
                let (doing, runs, seconds) = (progress.doing, progress.evaluation, progress.seconds);
                going.fitting = Some(format!("fit: {doing}, {}, {seconds:.0} s", plural(runs, "forward run")));
            }
            _ => {}
        });
    }
}

/// Said where a run ended as it never should.
const BUG: &str = "the run ended by a fault of the program: see the terminal";

fn word(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Fine => "fine",
        Outcome::Incomplete => "incomplete",
        Outcome::Stopped => "stopped",
    }
}
