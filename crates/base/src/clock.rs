//! Stopwatches: wall time, and processor time, which neighbours on the machine disturb less.

use serde::Serialize;
use std::time::Instant;

/// Runs from its start on.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    wall: Instant,
    cpu_s: f64,
    thread_s: f64,
}

/// What a piece of work took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Elapsed {
    /// Seconds on the clock on the wall.
    pub wall_s: f64,
    /// Processor time of all threads of this process, s, a software device's too; zero where the system counts none.
    pub cpu_s: f64,
    /// Seconds of processor time of this thread alone; zero where the system counts none.
    pub thread_s: f64,
}

impl Stopwatch {
    /// Starts one.
    pub fn start() -> Self {
        let [cpu_s, thread_s] = processor_times();
        Self { wall: Instant::now(), cpu_s, thread_s }
    }

    /// What has passed since its start. Ask on the thread that started it.
    pub fn elapsed(&self) -> Elapsed {
        let [cpu_s, thread_s] = processor_times();
        Elapsed {
            wall_s: self.wall.elapsed().as_secs_f64(),
            cpu_s: cpu_s - self.cpu_s,
            thread_s: thread_s - self.thread_s,
        }
    }
}

/// Seconds of processor time of this process and of this thread.
#[cfg(unix)]
fn processor_times() -> [f64; 2] {
    use rustix::time::{ClockId, clock_gettime};
    [ClockId::ProcessCPUTime, ClockId::ThreadCPUTime].map(|clock| {
        let time = clock_gettime(clock);
        time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
    })
}

#[cfg(not(unix))]
fn processor_times() -> [f64; 2] {
    [0.0; 2]
}
