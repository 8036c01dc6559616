//! A series of images, from its files to its store: opened, resumed, correlated, closed.

use crate::camera::Rectifier;
use crate::correlate::Correlate;
use crate::field::{Status, UpdateReference};
use crate::imaging::{FlatBlocks, Image, Saturation};
use crate::io::quantities::QuantitySummary;
use crate::io::store::{STORE, Store, StoreWriter};
use crate::remark::{Code, Remark};
use crate::report::summary::{FrameSummary, Summary, Trust, counts, reference_updates};
use crate::report::{CrackSummary, crack_figures, tension_lines};
use crate::run::folder::read::make_folder;
use crate::run::folder::restart;
use crate::run::folder::store_of_run::{header_of, make_or_find};
use crate::run::folder::{About, Earlier, FIGURES, Kept, Lock, RunFolder, locks_in};
use crate::run::frames::feed::Feed;
use crate::run::frames::output::{self, Output, ToWrite};
use crate::run::frames::{Busy, Done, Engine, Frames, Reference, Spent, pipeline, windows};
use crate::run::look::{quantities, report};
use crate::run::plan::found::{self, Found};
use crate::run::plan::run_toml::RunToml;
use crate::run::plan::{Existing, Outcome, Plan, Ran, Session};
use crate::run::series::camera::Camera;
use crate::run::series::prepared::Prepared;
use crate::run::words::tally::{Summaries, Tally};
use crate::run::words::{Event, Result, RunError, Watcher, chain, doubts, remarks, said, thread};
use rayon::ThreadPool;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::time::Instant;

const BEHIND: usize = 4;

/// Correlates the series of `plan` into `folder`: what is missing of it, or all. What is done stays done, however this
/// ends: the same call goes on from there.
///
/// # Errors
/// See [`RunError`]. A frame that cannot be read or does not converge is a result.
pub fn run_series(
    plan: &Plan,
    folder: &RunFolder,
    pool: &ThreadPool,
    session: Session,
    watcher: Watcher<'_>,
) -> Result<Ran> {
    carry_out(plan, folder, pool, session, None, watcher)
}

/// The same; `camera` gives further frames when those of the plan are done.
pub(crate) fn carry_out(
    plan: &Plan,
    folder: &RunFolder,
    pool: &ThreadPool,
    session: Session,
    camera: Option<Camera>,
    watcher: Watcher<'_>,
) -> Result<Ran> {
    let mut series = PreparedSeries::open(plan, folder, pool, session, camera)?;
    let earlier = series.earlier()?;
    let tally = series.begin(&earlier, watcher)?;
    let (tally, written) = series.correlate(tally, &earlier, watcher);
    series.close(tally, written, watcher)
}

/// A series whose folder is taken and whose reference is prepared.
struct PreparedSeries<'a> {
    begin: Instant,
    plan: Plan,
    folder: &'a RunFolder,
    pool: &'a ThreadPool,
    session: Session,
    camera: Option<Camera>,
    lock: Lock,
    reference: Arc<Image>,
    engine: Engine,
    /// That of the beginning: the engine may come to another.
    correlator: Arc<dyn Correlate>,
    /// Maps fields into the plane of the specimen.
    rectifier: Rectifier,
    seconds_reference: f64,
    /// What is to be said of reference and zones.
    remarks: Vec<Remark>,
    saturation: Option<Saturation>,
    /// What is said below the picture of the mesh, where zones or cracks were found.
    drawn: Vec<String>,
    record: RunToml,
    about: About,
    writer: StoreWriter,
    /// The same store, for reading.
    store: Store,
}

/// What an earlier start has left.
struct Before {
    done: BTreeMap<usize, (FrameSummary, Option<String>)>,
    damaged: Vec<usize>,
    /// Frames whose image is another than the one that was measured.
    replaced: Vec<usize>,
    /// Frames that are done again because their reference is another now.
    depending: Vec<usize>,
    kept: Kept,
    /// Frames of this process, and those of them that are to be done.
    own: Vec<usize>,
    to_do: Vec<usize>,
}

impl<'a> PreparedSeries<'a> {
    /// Takes the folder, prepares the reference, and makes or finds the store.
    fn open(
        plan: &Plan,
        folder: &'a RunFolder,
        pool: &'a ThreadPool,
        session: Session,
        camera: Option<Camera>,
    ) -> Result<Self> {
        let begin = Instant::now();
        let lock = Lock::take(&locks_in(folder.path()), session.shard, camera.as_ref().map(Camera::folder))?;
        if session.shard.is_none() {
            folder.tidy();
        }
        let there = match session.existing {
            Existing::Continue if folder.holds_run() => {
                let store = Store::open(folder.path().join(STORE));
                Some(store.map_err(|error| folder.holds_another(Some(chain(&error))))?)
            }
            _ => None,
        };
        if session.existing == Existing::Continue {
            folder.spare_files_of_others()?;
        }
        let mut plan = there.as_ref().map_or_else(|| plan.clone(), |store| plan.as_before(store.header()));
        // Before anything is run: a load file that does not fit, or places that mean nothing, are refused now.
        if camera.is_none() {
            quantities::load(&plan.drawn, plan.deformed.len())?;
        }
        let Reference { image, sha256, mut remarks } = Reference::of(&plan)?;
        let (width, height) = (image.width(), image.height());
        let there_in = (there.as_ref(), folder.path());
        let Prepared { reference, engine, found, zone_files, remarks: of_zones, drawn, seconds } =
            pool.install(|| Prepared::new(&mut plan, there_in, image))?;
        let correlator = engine.correlator();
        let record = RunToml::new(&plan, &correlator, pool.current_num_threads(), &sha256, zone_files);
        let header = header_of(&plan, &*correlator, &record, sha256, [width, height]);
        let rectifier = Rectifier::new(header.camera()?, correlator.mesh())?;
        quantities::resolve(&plan.drawn, plan.strain, plan.pixel_size, &rectifier)?;
        let same_run = |store: &Store| match restart::differences(store.header(), &header, session.shard.is_none()) {
            differences if differences.is_empty() => Ok(()),
            differences => Err(folder.holds_another(Some(differences.join("; ")))),
        };
        there.as_ref().map_or(Ok(()), same_run)?;
        if there.is_none() && session.shard.is_none() {
            folder.clear(plan.csv, plan.vtu)?;
            quantities::remove(folder.path())?;
        }
        folder.make_folders(plan.csv, plan.vtu).and_then(|()| found.as_ref().map_or(Ok(()), Found::write))?;
        let (writer, store) = {
            let _alone = session.shard.map(|_| lock.common()).transpose()?;
            let made = make_or_find(folder, &header, &*correlator, same_run)?;
            if !folder.has(RunFolder::CASE) {
                folder.write_case(&record.case(&BTreeMap::new()))?;
            }
            made
        };
        let saturation = Saturation::of(&reference, &windows(correlator.mesh()));
        remarks.extend(remarks::of_grey(&plan.reference_name(), &reference, saturation));
        remarks.extend(remarks::hot_pixels(&plan.reference_name(), correlator.n_hot_pixels()));
        remarks.extend(of_zones);
        Ok(Self {
            begin,
            drawn,
            remarks,
            plan,
            folder,
            pool,
            session,
            camera,
            lock,
            reference,
            engine,
            correlator,
            rectifier,
            seconds_reference: seconds,
            saturation,
            record,
            about: About::new(header)?,
            writer,
            store,
        })
    }

    /// The frames of this process among the first `n_frames`.
    fn own(&self, n_frames: usize) -> Vec<usize> {
        let shard = self.session.shard;
        (1..=n_frames).filter(|&number| shard.is_none_or(|shard| shard.has(number))).collect()
    }

    /// What an earlier start has left, and what is to be done.
    fn earlier(&self) -> Result<Before> {
        let Self { plan, folder, store, .. } = self;
        let own = self.own(plan.deformed.len());
        let earlier =
            self.pool.install(|| Earlier::find(store, folder.path(), (&plan.deformed, &own), [plan.csv, plan.vtu]));
        let mut depending = Vec::new();
        let (Earlier { done, damaged, replaced, .. }, kept) = match plan.update {
            UpdateReference::Never => (earlier, Kept::default()),
            update => {
                let accepted = plan.accepted.of_size(self.reference.width(), self.reference.height());
                let (earlier, kept) =
                    earlier.of_chain(folder.path(), (&plan.deformed, accepted), update, self.correlator.mesh());
                // They are of another chain now, also should this start be killed before it comes to them.
                let after = kept.number + 1..=plan.deformed.len();
                for number in after.filter(|&number| store.status_file(number).exists()) {
                    self.writer.unmark(number)?;
                    let is_named = earlier.damaged.contains(&number) || earlier.replaced.contains(&number);
                    depending.extend((!is_named).then_some(number));
                }
                folder.make(RunFolder::CHAIN)?;
                Kept::tidy(folder.path(), kept.number);
                (earlier, kept)
            }
        };
        let to_do = own.iter().copied().filter(|number| !done.contains_key(number)).collect();
        Ok(Before { done, damaged, replaced, depending, kept, own, to_do })
    }

    /// Says what is about to happen, and counts what was done before.
    fn begin(&self, before: &Before, watcher: Watcher<'_>) -> Result<Tally> {
        let Self { plan, folder, session, camera, correlator, engine, reference, .. } = self;
        let total = camera.is_none().then_some(before.own.len());
        watcher(Event::Begun { total, before: before.done.len() });
        let threads = self.pool.current_num_threads();
        watcher(Event::Note(&said::begin_line(plan, correlator, reference, threads)));
        let left_over = remarks::left_over(plan.named_zones(), plan.options.mesh_size());
        let of_nodes: Vec<Remark> = remarks::of_nodes(correlator).collect();
        let at_begin =
            plan.said.iter().chain(&self.remarks).chain(&self.lock.remark).chain(&left_over).chain(&of_nodes);
        at_begin.for_each(|remark| watcher(Event::Remark(remark)));
        let again = [&before.damaged, &before.replaced, &before.depending].map(Vec::as_slice);
        let earlier = said::about_earlier(before.done.len(), before.to_do.len(), again);
        earlier.iter().for_each(|line| watcher(Event::Note(line)));
        let borders: Vec<Remark> = correlator.bare_borders().iter().map(remarks::of_border).collect();
        borders.iter().for_each(|remark| watcher(Event::Remark(remark)));
        let frames: Vec<FrameSummary> = before.done.values().map(|(summary, _)| summary.clone()).collect();
        let mut summary = Summary {
            seconds_reference: self.seconds_reference,
            remarks: plan.said.iter().cloned().chain(left_over).chain(borders).collect(),
            counts: counts(&frames),
            trust: Trust::of(&frames),
            reference_updates: reference_updates(&frames),
            frames,
            ..said::empty_summary(plan, correlator, reference, threads, self.saturation)
        };
        for remark in engine.take_remarks() {
            watcher(Event::Remark(&remark));
            summary.remarks.extend(remark.is_warning().then_some(remark));
        }
        if plan.store_only {
            watcher(Event::Note(&said::store_only(camera.is_none())));
        }
        if session.shard.is_some() {
            let _alone = self.lock.common()?;
            if !folder.has(RunFolder::SUMMARY) {
                // For `quadrille status`, should the last of the shards be killed before it has written it.
                folder.write_summary(&Summary { frames: Vec::new(), ..summary.clone() })?;
            }
        }
        let widths = pipeline::widths(engine, self.pool, plan.options.start, plan.update);
        let with_field = before.done.iter().filter(|(_, (frame, _))| frame.status.has_field());
        Ok(Tally {
            hashes: before.done.iter().map(|(&number, (_, sha256))| (number, sha256.clone())).collect(),
            summary,
            busy: Busy::new(widths),
            in_series: with_field.map(|(&number, _)| number).collect(),
            notes: self.remarks.iter().filter_map(|remark| Some(remark.text.split_once(": ")?.1.to_owned())).collect(),
        })
    }

    /// Correlates what is to be done and writes it, until all is done, it shall stop, or something fails.
    fn correlate(&mut self, mut tally: Tally, before: &Before, watcher: Watcher<'_>) -> (Tally, Result<()>) {
        let Self {
            begin,
            plan,
            folder,
            pool,
            session,
            camera,
            correlator,
            rectifier,
            engine,
            record,
            about,
            writer,
            store,
            ..
        } = self;
        let (reference, drawn) = (&self.reference, self.drawn.as_slice());
        let Session { stop, shard, .. } = session;
        let windows = windows(correlator.mesh());
        let frames = Frames {
            known: &plan.deformed,
            settle: camera.as_ref().map(Camera::settle),
            accepted: plan.accepted.of_size(self.reference.width(), self.reference.height()),
            windows: &windows,
            range: self.reference.range(),
            flat: &FlatBlocks::of(&self.reference),
            start: plan.options.start,
            update: plan.update,
            kept: &before.kept,
            stored: &|number| restart::stored_start(store, folder.path(), number),
            stop,
        };
        let [writing, waiting] = &[Spent::default(), Spent::default()];
        let failed = &AtomicBool::new(false);
        let planned = |&number: &usize| Some((number, plan.deformed.get(number - 1)?.clone()));
        let to_do = before.to_do.iter().filter_map(planned).collect();
        let mut feed = Feed { to_do, camera: camera.as_mut(), record, store: writer, engine, waiting };
        let alone = shard.is_none();
        let written = std::thread::scope(|scope| -> Result<()> {
            let (finished, to_write) = sync_channel(BEHIND);
            let output = Output {
                plan,
                engine,
                pool,
                folder,
                store: writer,
                fields: store,
                about,
                camera: rectifier,
                windows: plan.strain_windows(rectifier.mesh()),
                alone,
                in_series: Mutex::new(std::mem::take(&mut tally.in_series)),
                writing,
                to_write: Mutex::new(to_write),
                failed,
            };
            let n_writers = pipeline::widths(engine, pool, plan.options.start, plan.update).written;
            let writers = output.begin(scope, n_writers)?;
            // The mesh, where zones or cracks were found: the first of the shards draws it.
            let is_drawn = !drawn.is_empty() && shard.is_none_or(|shard| shard.i == 1);
            let draw = || found::draw(plan, reference, correlator, folder.path(), drawn);
            let drawing = is_drawn.then(|| thread(scope, draw)).transpose()?;
            let mut summaries = Summaries::begin();
            let next = |wanted: &dyn Fn() -> bool| feed.next(wanted);
            let done = pipeline::run(engine, pool, &frames, next, |done| {
                let Done { sha256, summary: frame, result, news, kept } = done;
                tally.hashes.insert(frame.number, sha256.clone());
                news.iter().for_each(|line| watcher(Event::Note(line)));
                tally.take_remarks(engine, watcher);
                tally.say_of_file(&frame, watcher);
                tally.busy.add(&frame, writing.time(), waiting.time());
                watcher(Event::Frame { summary: &frame, busy: &tally.busy });
                tally.summary.frames.push(frame.clone());
                if alone {
                    summaries.write(&mut tally, folder, *begin)?;
                }
                // When a writer has stopped, its error says why.
                Ok(!failed.load(Ordering::SeqCst)
                    && finished.send(ToWrite { summary: frame, sha256, result, kept }).is_ok())
            });
            drop(finished);
            output::end(writers)?;
            if let Some(drawing) = drawing {
                drawing.join().map_err(|_| RunError::Bug("what draws the mesh stopped"))??;
            }
            done
        });
        tally.take_remarks(engine, watcher);
        (tally, written)
    }

    /// Writes what is of the whole, and says what came of it.
    fn close(mut self, mut tally: Tally, written: Result<()>, watcher: Watcher<'_>) -> Result<Ran> {
        let (folder, shard, begin) = (self.folder, self.session.shard, self.begin);
        // A camera may have added frames.
        let n_frames = self.record.deformed.len();
        let n_own = self.own(n_frames).len();
        let converged = tally.summary.frames.iter().filter(|frame| frame.status == Status::Converged).count();
        let outcome = match converged {
            _ if self.session.stop.is_asked() && tally.summary.frames.len() < n_own => Outcome::Stopped,
            n if n == n_own && n > 0 => Outcome::Fine,
            _ => Outcome::Incomplete,
        };
        let _alone = shard.map(|_| self.lock.common()).transpose()?;
        let is_done = |number| self.store.status_file(number).exists();
        let complete = written.is_ok() && n_frames > 0 && (1..=n_frames).all(is_done);
        let own_frames = if shard.is_some() { tally.summary.frames.clone() } else { Vec::new() };
        if shard.is_some() && complete {
            // The last of the shards writes what is of the whole.
            tally.summary.frames.clear();
            for (number, frame) in (1..).zip(self.pool.install(|| restart::all_frames(folder.path(), n_frames))) {
                let remedy = "give the same command again";
                let (frame, sha256) = frame.ok_or(RunError::RecordLost { number, remedy })?;
                tally.summary.frames.push(frame);
                tally.hashes.insert(number, sha256);
            }
        }
        let mut doubts = Vec::new();
        if shard.is_none() || complete {
            tally.summary.frames.sort_by_key(|frame| frame.number);
            let (references, is_named) = (&self.store.header().reference_sha256, self.plan.reference_named);
            doubts = doubts::about_series(&tally.summary, &tally.hashes, references, is_named);
            doubts.extend(remarks::of_camera(&self.rectifier, self.plan.camera.as_ref(), &tally.summary.frames));
            tally.summary.remarks.extend(doubts.iter().cloned());
            // Also when writing has failed: what is known is kept where it can be.
            let closed = folder.write_case(&self.record.case(&tally.hashes));
            let closed = closed.and_then(|()| tally.write_summary(folder, begin));
            let sha256 = (1..=n_frames).map(|number| tally.hashes.get(&number).cloned().flatten()).collect();
            let closed = closed.and_then(|()| Ok(self.writer.finish(sha256)?));
            if written.is_ok() && self.plan.vtu {
                let with_field = tally.summary.frames.iter().filter(|frame| frame.status.has_field());
                folder.write_series(&with_field.map(|frame| frame.number).collect::<Vec<_>>())?;
            }
            written?;
            closed?;
        } else {
            written?;
            tally.summary.frames.sort_by_key(|frame| frame.number);
            tally.summary.seconds_total = begin.elapsed().as_secs_f64();
        }
        if complete {
            self.look_back(n_frames, &mut tally.summary, watcher)?;
        }
        if shard.is_some() {
            tally.summary.frames = own_frames;
            tally.summary.frames.sort_by_key(|frame| frame.number);
        }
        let Tally { summary, busy, .. } = tally;
        watcher(Event::Finished { frames: &summary.frames, seconds: summary.seconds_total });
        doubts.iter().for_each(|remark| watcher(Event::Remark(remark)));
        if let Some(camera) = &mut self.camera {
            camera.take_remarks().iter().for_each(|remark| watcher(Event::Remark(remark)));
            let stopped = self.session.stop.is_asked();
            camera.ending(stopped).iter().for_each(|line| watcher(Event::Note(line)));
        }
        if outcome == Outcome::Stopped {
            let done = summary.frames.len();
            let line = format!("stopped with {done} of {n_own} frames done: the same command goes on from here");
            watcher(Event::Note(&line));
        }
        watcher(Event::Note(&format!("results in {}", folder.path().display())));
        Ok(Ran { outcome, complete, summary, busy })
    }

    /// What is made of a series as a whole: the quantities that are asked for, and the report.
    fn look_back(&self, n_frames: usize, summary: &mut Summary, watcher: Watcher<'_>) -> Result<()> {
        let drawn = match quantities::is_drawn(&self.plan.drawn, &self.rectifier) {
            true => self.draw_quantities(n_frames, summary, watcher)?,
            false => QuantitySummary::default(),
        };
        if !self.plan.report {
            return Ok(());
        }
        let (folder, plan, reference) = (self.folder, &self.plan, &self.reference);
        let mut warn = |what: &str, error: &RunError| {
            watcher(Event::Remark(&remarks::report_missing(what, error)));
        };
        match self.pool.install(|| report::write(folder, plan, summary, reference, &drawn)) {
            // A disk that takes no more.
            Err(error @ RunError::File { .. }) => return Err(error),
            // The measurement is there.
            Err(error) => warn("there is no report.html", &error),
            Ok(fault) => fault.iter().for_each(|error| warn("report.html has no fields to look around in", error)),
        }
        Ok(())
    }

    /// Tells of cracks and still zones in the summary, and draws the cracks.
    fn tell_of(&self, summary: &mut Summary, QuantitySummary { cracks, remarks, .. }: &QuantitySummary) -> Result<()> {
        if cracks.is_empty() && !self.rectifier.has_still() {
            return Ok(());
        }
        let of_still = |remark: &&Remark| matches!(remark.code, Code::StillZones | Code::DistanceChanged);
        summary.remarks.extend(remarks.iter().filter(of_still).cloned());
        summary.cracks = cracks.iter().map(CrackSummary::of).collect();
        self.folder.write_summary(summary)?;
        cracks.first().map_or(Ok(()), |_| make_folder(&self.folder.path().join(FIGURES)))?;
        cracks.iter().flat_map(crack_figures).try_for_each(|(name, plot)| self.folder.save_figure(&name, &plot.draw()?))
    }

    /// Draws the quantities that the plan asks for from all fields.
    fn draw_quantities(&self, n_frames: usize, summary: &mut Summary, watcher: Watcher<'_>) -> Result<QuantitySummary> {
        let (store, folder) = (Store::open(self.folder.path())?, self.folder.path());
        let numbers: Vec<usize> = (1..=n_frames).collect();
        let drawn =
            match quantities::write_of_store(&store, &self.plan.drawn, (None, None), &numbers, folder, |_, _| ()) {
                // How long the load file has to be is known only now.
                Err(error) if self.camera.is_some() => {
                    watcher(Event::Remark(&remarks::curves_missing(&error)));
                    return Ok(QuantitySummary::default());
                }
                drawn => drawn?,
            };
        drawn.remarks.iter().for_each(|remark| watcher(Event::Remark(remark)));
        tension_lines(&drawn).for_each(|line| watcher(Event::Note(&line)));
        self.tell_of(summary, &drawn)?;
        Ok(drawn)
    }
}
