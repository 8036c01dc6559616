//! What has come of a run so far.

use super::busy::Busy;
use super::engine::Engine;
use super::error::Result;
use super::event::{Event, Watcher};
use super::folder::RunFolder;
use crate::report::summary::{Summary, counts, reference_updates};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

/// What has come so far.
pub(super) struct Tally {
    /// SHA-256 of each image, where it could be read.
    pub hashes: BTreeMap<usize, Option<String>>,
    pub summary: Summary,
    pub busy: Busy,
    /// Frames with a field.
    pub in_series: BTreeSet<usize>,
}

impl Tally {
    /// Says and keeps what the engine has found worth saying.
    pub fn take_notes(&mut self, engine: &Engine, watcher: Watcher<'_>) {
        for note in engine.take_notes() {
            watcher(Event::Note(&note));
            self.summary.messages.push(note);
        }
    }

    /// Writes the summary of the frames so far, in order.
    pub fn write_summary(&mut self, folder: &RunFolder, begin: Instant) -> Result<()> {
        let summary = &mut self.summary;
        summary.frames.sort_by_key(|frame| frame.number);
        summary.counts = counts(&summary.frames);
        summary.reference_updates = reference_updates(&summary.frames);
        summary.seconds_total = begin.elapsed().as_secs_f64();
        folder.write_summary(summary)
    }
}
