//! What a user waits for: a cold pair, a frame of a series.

use super::scene::Scene;
use super::times::{Spread, Times, repeat};
use super::{BenchError, Subject};
use quadrille::backend::Traffic;
use quadrille::correlate::{Correlation, Correlator, Tracker};
use quadrille::field::Status;
use quadrille_base::clock::{Elapsed, Stopwatch};
use serde::Serialize;

/// A reference and a deformed image in host memory, nothing known: from there to displacement and uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairCost {
    /// Reference: upload, gradient, pyramid, matrices, factor, texture check, uncertainty.
    pub reference_s: Times,
    /// Frame: upload, coefficients, pyramid, search, all iterations, results on the host.
    pub frame_s: Times,
    /// Iterations on the finest level.
    pub iterations: usize,
    /// Those on the coarser ones.
    pub coarse_iterations: usize,
    /// What went between host and device for the frame, when they are two.
    pub traffic: Option<Traffic>,
}

/// Part of a frame's time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Share {
    /// What is done.
    pub part: &'static str,
    /// Seconds, on the device's clock.
    pub seconds: f64,
    /// Per cent of all parts.
    pub percent: f64,
}

/// Frames in host memory that follow each other, each started at the prediction from those before.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeriesCost {
    /// Frames measured, after two that start the series.
    pub frames: usize,
    /// Per frame: from the image in host memory to displacement and uncertainty.
    pub frame_s: Times,
    /// Frames per second, by the wall and the median.
    pub frames_per_s: f64,
    /// Iterations per frame, mean.
    pub iterations: f64,
    /// Processor time of the host's own work per frame, seconds: of the thread that drives the device. None on the
    /// CPU, and none where the driver computes in that thread.
    pub host_s: Option<Spread>,
    /// Where the time of a frame goes: every piece of work waited for, so that nothing overlaps.
    pub shares: Vec<Share>,
    /// What went between host and device for one frame, when they are two.
    pub traffic: Option<Traffic>,
}

fn converged(correlation: Correlation, frame: usize, scene: &Scene) -> Result<Correlation, BenchError> {
    if correlation.measurement.status != Status::Converged {
        return Err(BenchError::NotConverged { frame, size: scene.size, element: scene.element });
    }
    Ok(correlation)
}

/// A cold pair.
///
/// # Errors
/// When the device fails, or the frame does not converge.
pub fn pair_cost<B: Subject>(backend: &B, scene: &Scene, runs: usize) -> Result<PairCost, BenchError> {
    let prepare = || Correlator::new(backend.clone(), scene.reference.clone(), &scene.zone(), scene.options());
    let reference_s = repeat(runs, prepare)?;
    let correlator = prepare()?;
    let frame_s = repeat(runs, || correlator.correlate(scene.frame(0).clone(), None))?;
    let found = converged(correlator.correlate(scene.frame(0).clone(), None)?, 0, scene)?;
    let Correlation { iterations, coarse_iterations, traffic, .. } = found;
    Ok(PairCost { reference_s, frame_s, iterations, coarse_iterations, traffic })
}

/// A series of `frames` frames.
///
/// # Errors
/// When the device fails, or a frame does not converge.
pub fn series_cost<B: Subject>(backend: &B, scene: &Scene, frames: usize) -> Result<SeriesCost, BenchError> {
    let correlator = Correlator::new(backend.clone(), scene.reference.clone(), &scene.zone(), scene.options())?;
    let mut tracker = Tracker::new(&correlator);
    let mut number = 0;
    let mut next = || -> Result<(Elapsed, Correlation), BenchError> {
        let watch = Stopwatch::start();
        let found = tracker.correlate(number, scene.frame(number).clone())?;
        let elapsed = watch.elapsed();
        number += 1;
        Ok((elapsed, converged(found, number - 1, scene)?))
    };
    for _ in 0..2 {
        next()?;
    }
    let (mut all, mut iterations, mut traffic) = (Vec::new(), 0, None);
    for _ in 0..frames.max(1) {
        let (elapsed, found) = next()?;
        iterations += found.iterations;
        traffic = found.traffic;
        all.push(elapsed);
    }
    let frame_s = Times::of(&all);
    let shares = backend.shares(|| next().map(|_| ()))?;
    Ok(SeriesCost {
        frames: all.len(),
        frames_per_s: 1.0 / frame_s.wall.median,
        iterations: iterations as f64 / all.len() as f64,
        host_s: backend.is_graphics().then_some(frame_s.thread),
        frame_s,
        shares,
        traffic,
    })
}
