//! What ends a fit from outside (a limit of time, a wish to stop), and who hears how it goes.

use crate::identify::FitStatus;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Seconds between two words on one forward run.
const EVERY: Duration = Duration::from_millis(500);

/// Where a fit stands.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FitProgress {
    /// What it is at: `fit`, `element size`, `intervals`, ....
    pub doing: &'static str,
    /// Forward runs that have ended, those of all starts and of all that comes after.
    pub evaluation: usize,
    /// The instant, from 1, at which the forward run is that goes on; `None` when one has just ended.
    pub instant: Option<usize>,
    /// Instants of that run.
    pub n_instants: usize,
    /// The objective that was found; `None` where there was no solution, or where it is not looked at.
    pub omega: Option<f64>,
    /// The parameters that were tried.
    pub parameters: Vec<(&'static str, f64)>,
    /// Since the fit began.
    pub seconds: f64,
}

/// Why a fit was ended before its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ended {
    /// Its limit of time, s.
    Time(f64),
    /// Somebody wished it.
    Stopped,
}

impl Ended {
    /// As the end of a fit.
    pub fn status(self) -> FitStatus {
        match self {
            Self::Time(_) => FitStatus::TimeLimit,
            Self::Stopped => FitStatus::Stopped,
        }
    }

    /// In words.
    pub fn reason(self) -> String {
        match self {
            Self::Time(seconds) => format!("the limit of {seconds} s (max_seconds) was reached"),
            Self::Stopped => "it was asked to stop".to_owned(),
        }
    }
}

/// Who hears how a fit goes; from any thread.
type Hear = Box<dyn Fn(FitProgress) + Send + Sync>;

/// Watches a fit. Copies watch the same one; the default one knows no limit and tells nobody.
#[derive(Clone, Default)]
pub struct FitWatch(Option<Arc<Watched>>);

struct Watched {
    begin: Instant,
    max_seconds: Option<f64>,
    stop: Option<Arc<AtomicBool>>,
    hear: Hear,
    evaluations: AtomicUsize,
    /// What is being done, and when somebody last heard of it.
    now: Mutex<(&'static str, Instant)>,
}

impl fmt::Debug for FitWatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FitWatch").field("ended", &self.ended()).finish_non_exhaustive()
    }
}

impl FitWatch {
    /// Begins now: ends a fit after `max_seconds`, or when `stop` is set, and tells `hear` how it goes.
    pub fn new(
        max_seconds: Option<f64>,
        stop: Option<Arc<AtomicBool>>,
        hear: impl Fn(FitProgress) + Send + Sync + 'static,
    ) -> Self {
        let (begin, hear) = (Instant::now(), Box::new(hear));
        let now = Mutex::new(("fit", begin));
        Self(Some(Arc::new(Watched { begin, max_seconds, stop, hear, evaluations: AtomicUsize::new(0), now })))
    }

    /// Why the fit has to end; `None` while it may go on.
    pub fn ended(&self) -> Option<Ended> {
        let watched = self.0.as_ref()?;
        if watched.stop.as_ref().is_some_and(|stop| stop.load(Ordering::SeqCst)) {
            return Some(Ended::Stopped);
        }
        let over = |seconds: &f64| watched.begin.elapsed().as_secs_f64() >= *seconds;
        watched.max_seconds.filter(over).map(Ended::Time)
    }

    /// Something else begins.
    pub fn begins(&self, doing: &'static str) {
        if let Some(watched) = &self.0 {
            watched.now().0 = doing;
        }
    }

    /// A forward run is at `instant` of `n_instants`.
    pub fn at(&self, instant: usize, n_instants: usize, parameters: impl Fn() -> Vec<(&'static str, f64)>) {
        let Some(watched) = &self.0 else { return };
        if watched.now().1.elapsed() >= EVERY {
            watched.tell(Some(instant), n_instants, None, parameters());
        }
    }

    /// A forward run has ended.
    pub(crate) fn note_evaluation(&self) {
        if let Some(watched) = &self.0 {
            watched.evaluations.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// A point of the minimiser has the objective `omega`.
    pub(crate) fn note_trial(&self, omega: Option<f64>, parameters: Vec<(&'static str, f64)>) {
        if let Some(watched) = &self.0 {
            watched.tell(None, 0, omega, parameters);
        }
    }
}

impl Watched {
    fn now(&self) -> MutexGuard<'_, (&'static str, Instant)> {
        self.now.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(
        &self,
        instant: Option<usize>,
        n_instants: usize,
        omega: Option<f64>,
        parameters: Vec<(&'static str, f64)>,
    ) {
        let doing = {
            let mut now = self.now();
            now.1 = Instant::now();
            now.0
        };
        let evaluation = self.evaluations.load(Ordering::Relaxed);
        let seconds = self.begin.elapsed().as_secs_f64();
        (self.hear)(FitProgress { doing, evaluation, instant, n_instants, omega, parameters, seconds });
    }
}
