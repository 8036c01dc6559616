//! What a run tells whoever watches it.

use crate::identify::FitProgress;
use crate::remark::Remark;
use crate::report::fit::FitRecord;
use crate::report::joint::JointSummary;
use crate::report::summary::FrameSummary;
use crate::report::tournament::TournamentRecord;
use crate::run::frames::Busy;
use std::path::Path;

/// What happens in a run. Events come on the thread that carries it out, one after the other.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Event<'a> {
    /// The first frame is about to be read.
    Begun {
        /// Frames of this process; `None` while nobody knows how many will come.
        total: Option<usize>,
        /// Those of them that were done before.
        before: usize,
    },
    /// How the run goes, a line.
    Note(&'a str),
    /// Something that a user should know.
    Remark(&'a Remark),
    /// A frame is done; it may still be on its way to the disk.
    Frame {
        /// What came of it.
        summary: &'a FrameSummary,
        /// What the stages have had to do so far.
        busy: &'a Busy,
    },
    /// All frames of this process are done, or it was asked to stop.
    Finished {
        /// Its frames, those of before too.
        frames: &'a [FrameSummary],
        /// Duration of this start, s.
        seconds: f64,
    },
    /// The forward model was run and its results are written.
    Simulated {
        /// What came of it.
        summary: &'a JointSummary,
        /// Where the results are.
        folder: &'a Path,
    },
    /// A fit goes on.
    Fitting(&'a FitProgress),
    /// A fit has ended and its results are written.
    Identified {
        /// What `fit.json` holds.
        fit: &'a FitRecord,
        /// Where the results are.
        folder: &'a Path,
    },
    /// Laws were compared and the results are written.
    Compared {
        /// What `tournament.json` holds.
        tournament: &'a TournamentRecord,
        /// Where the results are.
        folder: &'a Path,
    },
    /// The report is written.
    Reported {
        /// Its page.
        page: &'a Path,
    },
}

/// Who watches a run.
pub type Watcher<'a> = &'a mut dyn FnMut(Event<'_>);
