//! Stopwatches: wall time, and processor time, which neighbours on the machine disturb less.

use cpu_time::{ProcessTime, ThreadTime};
use serde::Serialize;
use std::time::Instant;

/// Runs from its start on.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    cpu: ProcessTime,
    thread: ThreadTime,
}

/// What a piece of work took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Elapsed {
    /// Seconds on the clock on the wall.
    pub wall_s: f64,
    /// Seconds of processor time of all threads of this process; those of a software device are among them.
    pub cpu_s: f64,
    /// Seconds of processor time of this thread alone.
    pub thread_s: f64,
}

impl Stopwatch {
    /// Starts one.
    pub fn start() -> Self {
        Self { wall: Instant::now(), cpu: ProcessTime::now(), thread: ThreadTime::now() }
    }

    /// What has passed since its start. Ask on the thread that started it.
    pub fn elapsed(&self) -> Elapsed {
        Elapsed {
            wall_s: self.wall.elapsed().as_secs_f64(),
            cpu_s: self.cpu.elapsed().as_secs_f64(),
            thread_s: self.thread.elapsed().as_secs_f64(),
        }
    }
}
