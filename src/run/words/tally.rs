//! What has come of a run so far.

use crate::remark::{Code, Remark};
use crate::report::summary::{FrameSummary, Summary, Trust, counts, reference_updates};
use crate::run::folder::RunFolder;
use crate::run::frames::{Busy, Engine};
use crate::run::words::{Event, Result, Watcher};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

pub(crate) struct Tally {
    /// SHA-256 of each image, where it could be read.
    pub hashes: BTreeMap<usize, Option<String>>,
    pub summary: Summary,
    pub busy: Busy,
    /// Frames with a field.
    pub in_series: BTreeSet<usize>,
    /// What was said of files: of the reference first, then of the first frame that it holds for.
    pub notes: BTreeSet<String>,
}

/// How often the summary is written while the series runs.
const EVERY: Duration = Duration::from_secs(10);
/// Share of the time that this may take: that of a long series grows with it.
const SHARE: u32 = 50;

/// When the summary is written while the series runs.
pub(crate) struct Summaries {
    last: Instant,
    every: Duration,
}

impl Summaries {
    pub fn begin() -> Self {
        Self { last: Instant::now(), every: EVERY }
    }

    /// Writes it where it is time to; `begin` is when the run began.
    pub fn write(&mut self, tally: &mut Tally, folder: &RunFolder, begin: Instant) -> Result<()> {
        if self.last.elapsed() > self.every {
            let begun = Instant::now();
            tally.write_summary(folder, begin)?;
            self.every = EVERY.max(SHARE * begun.elapsed());
            self.last = Instant::now();
        }
        Ok(())
    }
}

impl Tally {
    /// Says how the file of a frame was read, where neither the reference nor a frame before was read so.
    pub fn say_of_file(&mut self, frame: &FrameSummary, watcher: Watcher<'_>) {
        for remark in frame.remarks.iter().filter(|remark| remark.code == Code::ImageFile) {
            let is_new = |note: &&str| self.notes.insert((*note).to_owned());
            let notes: Vec<&str> = remark.text.split("; ").filter(is_new).collect();
            if !notes.is_empty() {
                let text = format!("frame {} ({}): {}", frame.number, frame.file, notes.join("; "));
                watcher(Event::Remark(&Remark::new(remark.code, remark.about.clone(), text)));
            }
        }
    }

    /// Says and keeps what the engine has found worth saying.
    pub fn take_remarks(&mut self, engine: &Engine, watcher: Watcher<'_>) {
        let remarks = engine.take_remarks();
        remarks.iter().for_each(|remark| watcher(Event::Remark(remark)));
        self.summary.remarks.extend(remarks);
    }

    /// Writes the summary of the frames so far, in order.
    pub fn write_summary(&mut self, folder: &RunFolder, begin: Instant) -> Result<()> {
        let summary = &mut self.summary;
        summary.frames.sort_by_key(|frame| frame.number);
        summary.counts = counts(&summary.frames);
        summary.trust = Trust::of(&summary.frames);
        summary.reference_updates = reference_updates(&summary.frames);
        summary.seconds_total = begin.elapsed().as_secs_f64();
        folder.write_summary(summary)
    }
}
