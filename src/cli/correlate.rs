//! `quadrille correlate`.

use super::args::{CorrelateArgs, ProgressKind};
use super::kept::Kept;
use super::lock::Lock;
use super::output::{Output, ToWrite};
use super::plan::{MANY, Plan};
use super::progress::{Busy, Progress, Spent, Talk};
use super::reference::{Reference, about_reference, bare_border_note, element_size_px, windows};
use super::restart::{self, Earlier};
use super::run_folder::{About, RunFolder, csv_name, vtu_name};
use super::run_toml::RunToml;
use super::series::{self, Engine};
use super::shard::Shard;
use super::stop::Stop;
use super::watch::Camera;
use super::zones::Zones;
use super::{Outcome, Result, chain, plural, pool, probe, quantities};
use crate::backend::{AnyBackend, Backend};
use crate::correlate::{Correlator, TextureFault};
use crate::field::{Status, UpdateReference};
use crate::imaging::{GreyDepth, Image, Saturation};
use crate::io::store::{STORE, Store, StoreHeader, StoreWriter};
use crate::report::summary::{
    FrameSummary, ReferenceSummary, Summary, counts, reference_updates, saturation_message, units,
};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

/// Results that wait to be written.
const BEHIND: usize = 4;
/// How often the summary is written while the series runs.
const SUMMARY_EVERY: Duration = Duration::from_secs(10);
/// Share of the time that this may take: that of a long series grows with it.
const SUMMARY_SHARE: u32 = 50;
/// Share of the time that telling the store of new frames may take: its list of them grows with the series.
const EXTEND_SHARE: u32 = 20;

/// What to do about results that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Existing {
    /// Go on with them when they are of the same run.
    Continue,
    /// Replace them.
    Replace,
}

/// How a plan is carried out; none of it changes a result.
#[derive(Debug)]
pub(super) struct Session {
    pub existing: Existing,
    pub shard: Option<Shard>,
    pub talk: Talk,
    pub stop: Stop,
    /// What gives further frames when those of the plan are done.
    pub camera: Option<Camera>,
}

impl Session {
    /// One as the arguments ask for.
    pub fn of(args: &CorrelateArgs) -> Result<Self> {
        let talk = match (args.progress, args.quiet, args.verbose) {
            (_, true, _) => Talk::Quiet,
            (ProgressKind::Json, ..) => Talk::Json,
            (_, _, true) => Talk::Verbose,
            _ => Talk::Normal,
        };
        let existing = if args.overwrite { Existing::Replace } else { Existing::Continue };
        Ok(Self { existing, shard: args.shard, talk, stop: Stop::listen()?, camera: None })
    }

    /// One that replaces what is there and ends with the process.
    pub fn replacing(talk: Talk) -> Self {
        Self { existing: Existing::Replace, shard: None, talk, stop: Stop::default(), camera: None }
    }
}

/// Runs the command.
pub(super) fn run(args: &CorrelateArgs) -> Result<Outcome> {
    let plan = Plan::new(args)?;
    carry_out(&plan, args, &RunFolder::writable(&args.output)?, Session::of(args)?)
}

/// Correlates the series of `plan` and draws the figures that the arguments ask for.
pub(super) fn carry_out(plan: &Plan, args: &CorrelateArgs, folder: &RunFolder, session: Session) -> Result<Outcome> {
    let ran = run_series(plan, folder, pool(args.threads)?, session)?;
    if let Some(frames) = args.figures.as_ref().filter(|_| ran.complete) {
        super::figures::of_run(&args.output, frames, args.threads, args.quiet)?;
    }
    Ok(ran.outcome)
}

/// What came of a series.
pub(super) struct Ran {
    pub outcome: Outcome,
    /// Whether every frame of the series is done, those of other shards too.
    pub complete: bool,
    /// Its own frames, done now or before.
    pub summary: Summary,
    /// What the stages have had to do.
    pub busy: Busy,
}

/// Correlates the series of `plan` into `folder`: what is missing of it, or all; and what the camera of the session adds.
pub(super) fn run_series(
    plan: &Plan,
    folder: &RunFolder,
    pool: rayon::ThreadPool,
    mut session: Session,
) -> Result<Ran> {
    let begin = Instant::now();
    let watches = session.camera.as_ref().map(Camera::folder);
    let lock = Lock::take(&folder.locks(), session.shard, watches)?;
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
    let plan = &there.as_ref().map_or_else(|| plan.clone(), |store| plan.as_before(store.header()));
    // Before anything is run: a load file that does not fit, or places that mean nothing, are refused now.
    if session.camera.is_none() {
        quantities::load(&plan.drawn, plan.deformed.len())?;
    }
    let Reference { image, sha256, notes } = Reference::read(&plan.reference)?;
    let (width, height) = (image.width(), image.height());
    let Zones { zones, notes: zone_notes, files: zone_files } = Zones::on(&plan.zones, plan.guard_px, width, height)?;
    let reference_image = Arc::new(image);
    let prepare = Instant::now();
    let device = plan.device()?;
    let begin_preparation = || Engine::new(device, Arc::clone(&reference_image), zones, plan.options.clone());
    let engine = pool.install(begin_preparation).map_err(|error| about_reference(plan, &error))?;
    let correlator = engine.correlator();
    let seconds_reference = prepare.elapsed().as_secs_f64();
    quantities::resolve(&plan.drawn, plan.strain, correlator.mesh())?;
    let mesh = correlator.mesh();
    let mut record = RunToml::new(plan, &*correlator, [width, height], pool.current_num_threads(), &sha256, zone_files);
    let header = StoreHeader {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        mesh: mesh.clone(),
        image_size_px: [width, height],
        reference: plan.reference.iter().map(ToString::to_string).collect(),
        reference_sha256: sha256.clone(),
        frames: plan.deformed.iter().map(ToString::to_string).collect(),
        pixel_size: plan.pixel_size,
        range_grey: correlator.grey_range(),
        element_size_px: element_size_px(mesh, plan.options.element_size),
        strain: plan.strain,
        case: record.without_images(),
    };
    let may_grow = session.shard.is_none();
    let same_run = |store: &Store| match restart::differences(store.header(), &header, may_grow) {
        differences if differences.is_empty() => Ok(()),
        differences => Err(folder.holds_another(Some(differences.join("; ")))),
    };
    there.as_ref().map_or(Ok(()), same_run)?;
    if there.is_none() && session.shard.is_none() {
        folder.clear(plan.csv, plan.vtu)?;
        quantities::remove(folder.path())?;
    }
    folder.make_folders(plan.csv, plan.vtu)?;
    let (writer, store) = {
        let _alone = session.shard.map(|_| lock.common()).transpose()?;
        let writer = folder.store(&header)?;
        let mut store = Store::open(writer.path())?;
        same_run(&store)?; // another shard may have made it in the meantime
        if store.n_frames() < header.frames.len() {
            writer.extend(header.frames[store.n_frames()..].iter().cloned(), header.case.clone())?;
            store = Store::open(writer.path())?;
        }
        if let (None, Some(matrices)) = (store.normal_matrices().unwrap_or(None), correlator.normal_matrices()) {
            writer.write_normal_matrices(&matrices)?;
            writer.write_gradient_noise(&correlator.gradient_noise())?;
        }
        if !folder.has_case() {
            folder.write_case(&record.case(&BTreeMap::new()))?;
        }
        (writer, store)
    };

    let shard = session.shard;
    let own_of = |n_frames| -> Vec<usize> {
        (1..=n_frames).filter(|&number| shard.is_none_or(|shard| shard.has(number))).collect()
    };
    let own = own_of(plan.deformed.len());
    let tables: Vec<restart::Name> = [(plan.csv, csv_name as restart::Name), (plan.vtu, vtu_name)]
        .into_iter()
        .filter_map(|(wanted, name)| wanted.then_some(name))
        .collect();
    let earlier = pool.install(|| Earlier::find(&store, folder.path(), &own, &tables));
    let mut depending = Vec::new();
    let (Earlier { done: earlier, damaged, .. }, kept) = match plan.update {
        UpdateReference::Never => (earlier, Kept::default()),
        update => {
            let (earlier, kept) = earlier.of_chain(folder.path(), &plan.deformed, update, mesh);
            // They are of another chain now, also should this start be killed before it comes to them.
            for number in (kept.number + 1..=plan.deformed.len()).filter(|&number| store.status_file(number).exists()) {
                writer.unmark(number)?;
                depending.extend((!earlier.damaged.contains(&number)).then_some(number));
            }
            folder.make(RunFolder::CHAIN)?;
            Kept::tidy(folder.path(), kept.number);
            (earlier, kept)
        }
    };
    let numbers: Vec<usize> = own.iter().copied().filter(|number| !earlier.contains_key(number)).collect();

    let total = session.camera.is_none().then_some(own.len());
    let mut progress = Progress::new(session.talk, total, earlier.len());
    let saturation = Saturation::of(&reference_image, &windows(mesh));
    let threads = pool.current_num_threads();
    progress.say(&begin_line(plan, &correlator, &reference_image, threads));
    let about_grey =
        [GreyDepth::of(&reference_image).and_then(GreyDepth::remark), saturation.and_then(saturation_message)];
    let about_grey = about_grey.into_iter().flatten().map(|note| format!("{}: {note}", plan.reference_name()));
    let notes = notes.into_iter().chain(about_grey).chain(zone_notes).chain(lock.remark.clone());
    notes.chain(about_nodes(&correlator)).for_each(|note| progress.say(&note));
    about_earlier(earlier.len(), numbers.len(), &damaged, &depending).iter().for_each(|line| progress.say(line));
    let border_notes: Vec<String> = correlator.bare_borders().iter().map(bare_border_note).collect();
    border_notes.iter().for_each(|note| progress.say(note));
    let mut hashes: BTreeMap<usize, Option<String>> = BTreeMap::new();
    let mut frames: Vec<FrameSummary> = Vec::with_capacity(own.len());
    let mut in_series = BTreeSet::new();
    for (number, (summary, sha256)) in earlier {
        hashes.insert(number, sha256);
        in_series.extend(summary.status.has_field().then_some(number));
        frames.push(summary);
    }
    let mut summary = Summary {
        seconds_reference,
        messages: border_notes,
        counts: counts(&frames),
        reference_updates: reference_updates(&frames),
        frames,
        ..empty_summary(plan, &correlator, &reference_image, threads, saturation)
    };
    let about = About::new(header)?;
    for note in engine.take_notes() {
        progress.say(&note);
        summary.messages.extend(note.starts_with("warning").then_some(note));
    }
    if plan.store_only {
        let why = if session.camera.is_none() { format!("more than {MANY} frames: ") } else { String::new() };
        progress.say(&format!(
            "{why}fields go to {STORE} alone; `quadrille export` makes tables of them, or --export csv,vtu during the run"
        ));
    }

    if session.shard.is_some() {
        let _alone = lock.common()?;
        if !folder.has_summary() {
            // For `quadrille status`, should the last of the shards be killed before it has written it.
            folder.write_summary(&Summary { frames: Vec::new(), ..summary.clone() })?;
        }
    }
    let windows = windows(mesh);
    let frames = series::Frames {
        known: &plan.deformed,
        settle: session.camera.as_ref().map(Camera::settle),
        windows: &windows,
        start: plan.options.start,
        update: plan.update,
        kept: &kept,
        stored: &|number| restart::stored_start(&store, folder.path(), number),
        stop: &session.stop,
    };
    let (n_decoders, in_flight) = series::widths(&engine, &pool, plan.options.start);
    let mut busy = Busy::new(n_decoders, in_flight);
    let [writing, waiting] = &[Spent::default(), Spent::default()];
    let mut feed = Feed {
        to_do: numbers.iter().map(|&number| (number, plan.deformed[number - 1].clone())).collect(),
        camera: session.camera.as_mut(),
        record: &mut record,
        store: &writer,
        engine: &engine,
        waiting,
    };
    let written = std::thread::scope(|scope| -> Result<()> {
        let (finished, to_write) = sync_channel(BEHIND);
        let about = &about;
        let alone = session.shard.is_none();
        let output = Output { plan, folder, store: &writer, fields: &store, about, alone, in_series, writing };
        let writer = scope.spawn(move || output.write_all(&to_write));
        let mut last_summary = Instant::now();
        let mut summary_every = SUMMARY_EVERY;
        let next = |wanted: &dyn Fn() -> bool| feed.next(wanted);
        let done = series::run(&engine, &pool, &frames, next, |done| {
            let series::Done { sha256, summary: frame, result, news, kept } = done;
            hashes.insert(frame.number, sha256.clone());
            news.iter().for_each(|line| progress.say(line));
            engine.take_notes().into_iter().for_each(|note| {
                progress.say(&note);
                summary.messages.push(note);
            });
            busy.add(&frame, writing.time(), waiting.time());
            progress.frame(&frame, &busy);
            summary.frames.push(frame.clone());
            if alone && last_summary.elapsed() > summary_every {
                let begun = Instant::now();
                write_summary(folder, &mut summary, begin)?;
                summary_every = SUMMARY_EVERY.max(SUMMARY_SHARE * begun.elapsed());
                last_summary = Instant::now();
            }
            // When the writer has stopped, its error says why.
            Ok(finished.send(ToWrite { summary: frame, sha256, result, kept }).is_ok())
        });
        drop(finished);
        writer.join().map_err(|_| "the writer stopped: this is a bug in quadrille")??;
        done
    });

    for note in engine.take_notes() {
        progress.say(&note);
        summary.messages.push(note);
    }
    // A camera may have added frames.
    let n_frames = record.deformed.len();
    let n_own = own_of(n_frames).len();
    let own_converged = summary.frames.iter().filter(|frame| frame.status == Status::Converged).count();
    let outcome = match own_converged {
        _ if session.stop.is_asked() && summary.frames.len() < n_own => Outcome::Stopped,
        n if n == n_own && n > 0 => Outcome::Fine,
        _ => Outcome::Incomplete,
    };
    let _alone = session.shard.map(|_| lock.common()).transpose()?;
    let complete = written.is_ok() && n_frames > 0 && (1..=n_frames).all(|number| store.status_file(number).exists());
    let own_frames = if session.shard.is_some() { summary.frames.clone() } else { Vec::new() };
    if session.shard.is_some() && complete {
        // The last of the shards writes what is of the whole.
        summary.frames.clear();
        for (number, frame) in (1..).zip(pool.install(|| restart::all_frames(folder.path(), n_frames))) {
            let (frame, sha256) =
                frame.ok_or(format!("frame {number}: its record is lost: give the same command again"))?;
            summary.frames.push(frame);
            hashes.insert(number, sha256);
        }
    }
    if session.shard.is_none() || complete {
        // Also when writing has failed: what is known is kept where it can be.
        let closed = folder.write_case(&record.case(&hashes)).and_then(|()| write_summary(folder, &mut summary, begin));
        let sha256 = (1..=n_frames).map(|number| hashes.get(&number).cloned().flatten()).collect();
        let closed = closed.and_then(|()| Ok(writer.finish(sha256)?));
        if written.is_ok() && plan.vtu {
            let with_field = summary.frames.iter().filter(|frame| frame.status.has_field());
            folder.write_series(&with_field.map(|frame| frame.number).collect::<Vec<_>>())?;
        }
        written?;
        closed?;
    } else {
        written?;
        summary.frames.sort_by_key(|frame| frame.number);
        summary.seconds_total = begin.elapsed().as_secs_f64();
    }
    if !plan.drawn.is_empty() && complete {
        let numbers: Vec<usize> = (1..=n_frames).collect();
        let store = Store::open(folder.path())?;
        match probe::write_of_store(&store, &plan.drawn, None, &numbers, folder.path(), |_, _| ()) {
            Ok(drawn) => drawn.notes.iter().for_each(|note| progress.say(note)),
            // How long the load file has to be is known only now.
            Err(error) if session.camera.is_some() => {
                progress.say(&format!("warning: no numbers are drawn from the fields: {}", chain(error.as_ref())));
            }
            Err(error) => return Err(error),
        }
    }
    if session.shard.is_some() {
        summary.frames = own_frames;
        summary.frames.sort_by_key(|frame| frame.number);
    }
    progress.finish(&summary.frames, summary.seconds_total);
    if let Some(camera) = &mut session.camera {
        camera.ending(session.stop.is_asked()).iter().for_each(|line| progress.say(line));
    }
    if outcome == Outcome::Stopped {
        let (done, all) = (summary.frames.len(), n_own);
        progress.say(&format!("stopped with {done} of {all} frames done: the same command goes on from here"));
    }
    progress.say(&format!("results in {}", folder.path().display()));
    Ok(Ran { outcome, complete, summary, busy })
}

/// What a run begins with, on one line.
fn begin_line(plan: &Plan, correlator: &Correlator<AnyBackend>, reference: &Image, threads: usize) -> String {
    let mesh = correlator.mesh();
    format!(
        "reference {} ({} x {} px, {}), {}, {} elements of {} px, {} nodes; {}, {}",
        plan.reference_name(),
        reference.width(),
        reference.height(),
        reference.pixels().depth(),
        plural(mesh.zones().len(), "zone"),
        mesh.n_elements(),
        plan.options.element_size,
        mesh.n_nodes(),
        correlator.backend().device(),
        plural(threads, "thread"),
    )
}

/// What to say of nodes without texture.
fn about_nodes(correlator: &Correlator<AnyBackend>) -> impl Iterator<Item = String> {
    const NAMED: usize = 3;
    let said = |faults: &[TextureFault], begin: &str, what: &str| {
        let mut places: Vec<String> = faults.iter().take(NAMED).map(ToString::to_string).collect();
        if faults.len() > NAMED {
            places.push(format!("{} more in summary.json", faults.len() - NAMED));
        }
        let n = plural(faults.len(), "node");
        (!faults.is_empty()).then(|| format!("{begin}{n} with too little texture {what}: {}", places.join("; ")))
    };
    let dropped = said(correlator.dropped(), "warning: ", "left out");
    let held = said(correlator.held(), "", "held by the regularisation");
    [dropped, held].into_iter().flatten()
}

/// What to say of an earlier start: frames that are done, and those that are done again because they are `damaged` or
/// depend on such.
fn about_earlier(done: usize, to_do: usize, damaged: &[usize], depending: &[usize]) -> Vec<String> {
    let mut said = Vec::new();
    if done > 0 {
        let to_do = if to_do == 0 { "nothing is missing".into() } else { format!("{to_do} to do") };
        said.push(format!("{} done before, {to_do}", plural(done, "frame")));
    }
    let list = super::status::ranges;
    if !damaged.is_empty() {
        let frames = plural(damaged.len(), "frame");
        said.push(format!("what is stored of {frames} is not whole and is done again: {}", list(damaged)));
    }
    if !depending.is_empty() {
        let list = list(depending);
        said.push(format!("done again, since the reference depends on all frames before: {list}"));
    }
    said
}

/// The summary of a run before its first frame.
fn empty_summary(
    plan: &Plan,
    correlator: &Correlator<AnyBackend>,
    reference: &Image,
    threads: usize,
    saturation: Option<Saturation>,
) -> Summary {
    Summary {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        threads,
        units: units(),
        reference: ReferenceSummary {
            file: plan.reference[0].to_string(),
            mean_of: match plan.reference.as_slice() {
                [_] => Vec::new(),
                several => several.iter().map(ToString::to_string).collect(),
            },
            width_px: reference.width(),
            height_px: reference.height(),
            depth: reference.pixels().depth(),
            bits_used: GreyDepth::of(reference).map(|depth| depth.used),
            saturated_percent: saturation.map(Saturation::percent),
            range_grey: correlator.grey_range(),
        },
        n_nodes: correlator.mesh().n_nodes(),
        n_elements: correlator.mesh().n_elements(),
        n_levels: correlator.n_levels(),
        solver: correlator.solver_name(),
        tolerance_px: plan.options.tolerance_px,
        tolerance_in_effect_px: (correlator.tolerance_px() > plan.options.tolerance_px)
            .then(|| correlator.tolerance_px()),
        seconds_reference: 0.0,
        seconds_total: 0.0,
        nodes_left_out: correlator.dropped().iter().map(Into::into).collect(),
        nodes_held: correlator.held().iter().map(Into::into).collect(),
        messages: Vec::new(),
        counts: BTreeMap::new(),
        reference_updates: Vec::new(),
        frames: Vec::new(),
    }
}

/// Writes the summary of the frames so far, in order.
fn write_summary(folder: &RunFolder, summary: &mut Summary, begin: Instant) -> Result<()> {
    summary.frames.sort_by_key(|frame| frame.number);
    summary.counts = counts(&summary.frames);
    summary.reference_updates = reference_updates(&summary.frames);
    summary.seconds_total = begin.elapsed().as_secs_f64();
    folder.write_summary(summary)
}

/// The frames that a run has to do: those of its plan, then those of its camera.
struct Feed<'a> {
    to_do: VecDeque<series::Numbered>,
    camera: Option<&'a mut Camera>,
    record: &'a mut RunToml,
    store: &'a StoreWriter,
    engine: &'a Engine,
    /// Time without anything to do.
    waiting: &'a Spent,
}

impl Feed<'_> {
    /// The next of them; waits for the camera while the frame is `wanted`.
    fn next(&mut self, wanted: &dyn Fn() -> bool) -> Result<Option<series::Numbered>> {
        let Some(camera) = &mut self.camera else { return Ok(self.to_do.pop_front()) };
        let begin = Instant::now();
        let come = camera.take(self.to_do.is_empty(), wanted);
        self.waiting.add(begin.elapsed());
        camera.take_notes().into_iter().for_each(|note| self.engine.note(note));
        if !come.is_empty() {
            // The store names a frame before anything of it is done: what is stored under a number stays that frame's,
            // however this process ends.
            let begin = Instant::now();
            let first = self.record.deformed.len() + 1;
            self.record.deformed.extend(come.iter().cloned());
            self.store.extend(come.iter().map(ToString::to_string), self.record.without_images())?;
            camera.rest(EXTEND_SHARE * begin.elapsed());
            self.to_do.extend((first..).zip(come));
        }
        Ok(self.to_do.pop_front())
    }
}
