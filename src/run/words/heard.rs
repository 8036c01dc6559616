//! A fit that is watched while it runs.

use crate::identify::{FitProgress, FitWatch};
use crate::run::plan::Stop;
use crate::run::words::{Event, Watcher};
use rayon::ThreadPool;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

/// What comes from the threads of a fit: how it goes, or nothing more.
type Word = Option<FitProgress>;

/// Hears how a fit goes that others compute, and tells it to a watcher, who is of one thread.
pub(crate) struct Heard {
    tell: Sender<Word>,
    words: Receiver<Word>,
}

/// Says at its end, whatever that is, that nothing more comes.
struct Last(Sender<Word>);

impl Drop for Last {
    fn drop(&mut self) {
        let _ = self.0.send(None); // nobody listens any more
    }
}

impl Heard {
    /// With the watch for the fit, which ends it after `max_seconds` or when `stop` is asked.
    pub fn new(max_seconds: Option<f64>, stop: &Stop) -> (Self, FitWatch) {
        let (tell, words) = channel();
        let of_fit = tell.clone();
        let watch = FitWatch::new(max_seconds, Some(stop.flag()), move |progress| {
            let _ = of_fit.send(Some(progress)); // nobody listens any more
        });
        (Self { tell, words }, watch)
    }

    /// What `work` gives, which is done on the pool.
    pub fn during<T: Send>(&self, pool: &ThreadPool, watcher: Watcher<'_>, work: impl FnOnce() -> T + Send) -> T {
        let last = Last(self.tell.clone());
        let working = || {
            let _last = last;
            pool.install(work)
        };
        thread::scope(|scope| {
            let at_work = scope.spawn(working);
            while let Ok(Some(progress)) = self.words.recv() {
                watcher(Event::Fitting(&progress));
            }
            at_work.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }
}
