//! Repeated measurements.

use quadrille_base::clock::{Elapsed, Stopwatch};
use serde::Serialize;

/// Seconds of several repetitions.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spread {
    /// The shortest: what the work takes when nothing disturbs it.
    pub fastest: f64,
    /// The one in the middle.
    pub median: f64,
    /// The longest: shows the neighbours on the machine.
    pub slowest: f64,
}

impl Spread {
    /// That of `values`; zeros if there are none.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |k: usize| values.get(k).copied().unwrap_or(0.0);
        Self { fastest: at(0), median: at(values.len() / 2), slowest: at(values.len().saturating_sub(1)) }
    }

    /// All three times `factor`.
    pub fn scaled(self, factor: f64) -> Self {
        Self { fastest: factor * self.fastest, median: factor * self.median, slowest: factor * self.slowest }
    }
}

/// Seconds of several repetitions, by every clock.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Times {
    /// On the wall.
    pub wall: Spread,
    /// Of the processor, all threads.
    pub cpu: Spread,
    /// Of the processor, the thread that asked for the work.
    pub thread: Spread,
}

impl Times {
    /// Those of `all`.
    pub fn of(all: &[Elapsed]) -> Self {
        let spread = |clock: fn(&Elapsed) -> f64| Spread::of(all.iter().map(clock).collect());
        Self { wall: spread(|e| e.wall_s), cpu: spread(|e| e.cpu_s), thread: spread(|e| e.thread_s) }
    }
}

/// Does `work` once, with nothing before it that would warm it up.
///
/// # Errors
/// That of `work`.
pub fn once<T, E>(work: impl FnOnce() -> Result<T, E>) -> Result<Times, E> {
    let watch = Stopwatch::start();
    let result = std::hint::black_box(work()?);
    let elapsed = watch.elapsed();
    drop(result);
    Ok(Times::of(&[elapsed]))
}

/// Does `work` once unmeasured and then `runs` times.
///
/// # Errors
/// The first error of `work`.
pub fn repeat<T, E>(runs: usize, mut work: impl FnMut() -> Result<T, E>) -> Result<Times, E> {
    work()?;
    let mut all = Vec::with_capacity(runs);
    for _ in 0..runs.max(1) {
        let watch = Stopwatch::start();
        let result = std::hint::black_box(work()?);
        all.push(watch.elapsed());
        drop(result); // freeing is not part of it
    }
    Ok(Times::of(&all))
}
