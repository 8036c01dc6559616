//! How much the stages of a run have had to do.

use crate::report::summary::FrameSummary;
use crate::run::frames::Widths;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Time that one thread has spent with something, for others to see.
#[derive(Debug, Default)]
pub(crate) struct Spent(AtomicU64);

impl Spent {
    pub fn add(&self, time: Duration) {
        self.0.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }

    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// How much the stages of a run have had to do, in seconds of their threads.
#[derive(Debug, Clone)]
pub struct Busy {
    decode: f64,
    correlate: f64,
    write: f64,
    /// Without anything to do.
    camera: f64,
    /// Frames that each stage does at a time.
    widths: Widths,
}

impl Busy {
    pub(crate) fn new(widths: Widths) -> Self {
        Self { decode: 0.0, correlate: 0.0, write: 0.0, camera: 0.0, widths }
    }

    /// Adds a frame; `writing` and `waiting` for a camera are those of all frames so far.
    pub(crate) fn add(&mut self, frame: &FrameSummary, writing: Duration, waiting: Duration) {
        self.decode += frame.seconds_decode;
        self.correlate += frame.seconds;
        self.write = writing.as_secs_f64();
        self.camera = waiting.as_secs_f64();
    }

    /// The seconds of each stage, for each of the frames that it does at a time.
    fn stages(&self) -> [(&'static str, f64); 4] {
        let Widths { decoded, correlated, written } = self.widths;
        [
            ("correlate", self.correlate / correlated as f64),
            ("decode", self.decode / decoded as f64),
            ("write", self.write / written as f64),
            ("camera", self.camera),
        ]
    }

    /// How busy each stage was in a run of `seconds`, percent; of one without a camera.
    pub fn percent_of(&self, seconds: f64) -> [(&'static str, f64); 3] {
        let [correlate, decode, write, _] = self.stages();
        [correlate, decode, write].map(|(name, busy)| (name, 100.0 * busy / seconds))
    }

    /// The stage that the others wait for: the one that has had most to do for its width.
    pub fn limiting(&self) -> &'static str {
        let stages = self.stages();
        stages.into_iter().fold(stages[0], |most, stage| if stage.1 > most.1 { stage } else { most }).0
    }
}
