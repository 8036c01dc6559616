//! Where the frames of a run go: the store, tables, records.

use crate::camera::Rectifier;
use crate::correlate::{Correlation, ZoneResult};
use crate::field::{StartFrom, StrainField, StrainWindows};
use crate::io::store::{Store, StoreWriter};
use crate::report::summary::FrameSummary;
use crate::run::folder::{About, FrameRecord, Kept, RunFolder, frame_in_words};
use crate::run::frames::computing::Computing;
use crate::run::frames::{Engine, Spent};
use crate::run::plan::Plan;
use crate::run::words::{Result, RunError, thread};
use rayon::ThreadPool;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Scope, ScopedJoinHandle};
use std::time::Instant;

/// A frame on its way to the disk; without a result when it could not be read.
pub(crate) struct ToWrite {
    pub summary: FrameSummary,
    pub sha256: Option<String>,
    pub result: Option<Correlation>,
    pub kept: Option<Kept>,
}

pub(crate) struct Output<'a> {
    pub plan: &'a Plan,
    /// What computes, and the threads that it does so with.
    pub engine: &'a Engine,
    pub pool: &'a ThreadPool,
    pub folder: &'a RunFolder,
    pub store: &'a StoreWriter,
    /// The same store, for reading.
    pub fields: &'a Store,
    pub about: &'a About,
    /// Maps fields into the plane of the specimen.
    pub camera: &'a Rectifier,
    /// Makes the strains over a window, where one is asked for.
    pub windows: Option<StrainWindows>,
    /// Whether this process does all frames.
    pub alone: bool,
    /// Frames with a field.
    pub in_series: Mutex<BTreeSet<usize>>,
    pub writing: &'a Spent,
    pub to_write: Mutex<Receiver<ToWrite>>,
    /// Whether writing has failed: nothing more is to be begun.
    pub failed: &'a AtomicBool,
}

type Writer<'scope> = ScopedJoinHandle<'scope, Result<()>>;

/// Waits until `writers` have written all; the first of their errors.
pub(crate) fn end(writers: Vec<Writer<'_>>) -> Result<()> {
    let end = |writer: Writer<'_>| writer.join().map_err(|_| RunError::Bug("a writer stopped"))?;
    writers.into_iter().map(end).collect::<Vec<_>>().into_iter().collect()
}

impl<'a> Output<'a> {
    /// Begins to write with `n` threads. They alone hold what the frames come through: when all have stopped, nobody
    /// can send another.
    pub fn begin<'scope>(self, scope: &'scope Scope<'scope, '_>, n: usize) -> Result<Vec<Writer<'scope>>>
    where
        'a: 'scope,
    {
        let output = Arc::new(self);
        let writer = |_| {
            let output = output.clone();
            thread(scope, move || output.write_all())
        };
        (0..n).map(writer).collect()
    }

    /// Writes the frames as they come; several threads share them.
    fn write_all(&self) -> Result<()> {
        loop {
            let next = self.to_write.lock().unwrap_or_else(PoisonError::into_inner).recv();
            let Ok(frame) = next else { return Ok(()) };
            let (begin, mut computing) = (Instant::now(), Computing::new(self.engine, self.pool));
            self.write(frame, &mut computing).inspect_err(|_| self.failed.store(true, Ordering::SeqCst))?;
            self.writing.add(computing.busy_since(begin));
        }
    }

    /// Writes a frame: field, tables, record, and its status last, which says that it is done.
    fn write(&self, to_write: ToWrite, computing: &mut Computing<'_>) -> Result<()> {
        let ToWrite { mut summary, sha256, result, kept } = to_write;
        let Self { plan, folder, store, about, .. } = self;
        let (number, status) = (summary.number, summary.status);
        let file = frame_in_words(&summary.file, summary.reference_frame);
        let mut files = Vec::new();
        // A diverged field is no measurement: its numbers are not spread.
        if let Some(Correlation { measurement, zones, .. }) = result.as_ref().filter(|_| status.has_field()) {
            // The length is the one that the store says, to the last digit.
            let length_px = about.header.element_size_px;
            let (in_plane, strain, encoded) = computing.compute(|| {
                let plane = self.camera.rectify(measurement);
                let window = self.windows.as_ref().map(|windows| windows.of(&plane, plan.strain));
                let strain = StrainField { length_px, window, ..StrainField::of(&plane, plan.strain) };
                let encoded = store.encode_field(number, measurement, &strain);
                (plane, strain, encoded)
            });
            store.write_encoded(encoded?)?;
            summary.flattened = strain.window.as_ref().and_then(|window| window.flattened);
            let rms = |of: fn(&ZoneResult) -> f64| {
                (zones.iter().map(|zone| of(zone).powi(2)).sum::<f64>() / zones.len().max(1) as f64).sqrt()
            };
            store.write_noise(number, [rms(|zone| zone.noise), rms(|zone| zone.residual_noise)])?;
            let mut of_store = self.fields.field_files(number);
            if kept.is_some() {
                store.write_reference_frame(number, summary.reference_frame)?;
                of_store.push(self.fields.reference_frame_file(number));
            }
            files.extend(of_store.iter().filter_map(|path| path.strip_prefix(folder.path()).ok()).map(Path::to_owned));
            let tables = [plan.csv, plan.vtu];
            files.extend(folder.write_tables(tables, number, about, &file, [measurement, &*in_plane], &strain)?);
        }
        if let Some(Correlation { measurement, .. }) = result.as_ref().filter(|_| !status.has_field()) {
            store.write_residual(number, measurement)?;
        }
        let tracked = result.as_ref().filter(|_| plan.options.start == StartFrom::Previous);
        let image = plan.deformed.get(number - 1).map(|frame| frame.path.as_path());
        let record = FrameRecord::new(folder.path(), summary, (image, sha256), tracked, files)?;
        folder.write(&FrameRecord::name(number), |out| Ok(serde_json::to_writer(out, &record)?))?;
        if let Some(kept) = &kept {
            folder.write(&Kept::name(number), |out| kept.write(out))?;
        }
        store.mark(number, status)?;
        if kept.is_some() {
            Kept::remove_before(folder.path(), number);
        }
        if plan.vtu && status.has_field() {
            let mut in_series = self.in_series.lock().unwrap_or_else(PoisonError::into_inner);
            in_series.insert(number);
            if self.alone && in_series.len().is_multiple_of(100) {
                folder.write_series(&in_series.iter().copied().collect::<Vec<_>>())?;
            }
        }
        Ok(())
    }
}
