//! How a plan is carried out, and what comes of it.

use crate::report::summary::Summary;
use crate::run::frames::Busy;
use crate::run::plan::{Shard, Stop};

/// What to do about results that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Go on with them when they are of the same run.
    Continue,
    /// Replace them.
    Replace,
}

/// How a plan is carried out; none of it changes a result.
#[derive(Debug)]
pub struct Session {
    /// What to do about results that are there already.
    pub existing: Existing,
    /// The share of the frames that is done.
    pub shard: Option<Shard>,
    /// The wish to stop.
    pub stop: Stop,
}

impl Session {
    /// One that does all frames.
    pub fn new(existing: Existing) -> Self {
        Self { existing, shard: None, stop: Stop::default() }
    }
}

/// What a run came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything asked for is there.
    Fine,
    /// It ran, but some frame or fit did not converge, or the data reject the model.
    Incomplete,
    /// It was asked to stop before it was done.
    Stopped,
}

/// What came of a series.
#[derive(Debug, Clone)]
pub struct Ran {
    /// Whether its own frames converged.
    pub outcome: Outcome,
    /// Whether every frame of the series is done, those of other shards too.
    pub complete: bool,
    /// Its own frames, done now or before.
    pub summary: Summary,
    /// What the stages have had to do.
    pub busy: Busy,
}
