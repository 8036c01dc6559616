//! `quadrille correlate`.

use super::args::{CorrelateArgs, ProgressKind};
use super::kept::Kept;
use super::lock::Lock;
use super::plan::{self, MANY, Plan};
use super::progress::{Busy, Progress, Talk};
use super::restart::{self, Earlier, FrameRecord};
use super::run_folder::{About, RunFolder, csv_name, vtu_name};
use super::series::{self, Engine};
use super::shard::Shard;
use super::stop::Stop;
use super::watch::Camera;
use super::zones::Zones;
use super::{Outcome, Result, absolute, chain, plural, pool, probe, quantities};
use crate::backend::Backend;
use crate::correlate::{BareBorder, Correlation, CorrelationError, Correlator};
use crate::field::{StartFrom, Status, StrainField, UpdateReference};
use crate::imaging::{GreyDepth, Image, Mean, Saturation, small_shift};
use crate::io::case::{CaseFile, CaseImages, write_case};
use crate::io::series::Frame;
use crate::io::store::{STORE, Store, StoreHeader, StoreWriter};
use crate::isa::Isa;
use crate::mesh::{Mesh, MeshError};
use crate::report::summary::{
    FrameSummary, ReferenceSummary, Summary, counts, reference_updates, saturation_message, units,
};
use crate::units::Px;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
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
    // The same bits as before, where this machine can.
    let isa = there.as_ref().filter(|_| !plan.isa_asked).and_then(|store| isa_of(store.header()));
    let mut plan = Plan { isa: isa.unwrap_or(plan.isa), ..plan.clone() };
    if let Some((csv, vtu)) = there.as_ref().filter(|_| !plan.export_asked).and_then(|store| tables_of(store.header()))
    {
        plan = Plan { csv, vtu, store_only: false, ..plan };
    }
    let plan = &plan;
    // Before anything is run: a load file that does not fit, or places that mean nothing, are refused now.
    if session.camera.is_none() {
        quantities::load(&plan.drawn, plan.deformed.len())?;
    }
    let Reference { image, sha256, notes } = Reference::read(&plan.reference)?;
    let (width, height) = (image.width(), image.height());
    let Zones { zones, notes: zone_notes, files: zone_files } = Zones::on(&plan.zones, plan.guard_px, width, height)?;
    let depth = image.pixels().depth();
    let reference_image = Arc::new(image);
    let prepare = Instant::now();
    let device = plan.device()?;
    let begin_preparation = || Engine::new(device, Arc::clone(&reference_image), zones, plan.options.clone());
    let engine = pool.install(begin_preparation).map_err(|error| about_reference(plan, &error))?;
    let correlator = engine.correlator();
    let seconds_reference = prepare.elapsed().as_secs_f64();
    quantities::resolve(&plan.drawn, plan.strain, correlator.mesh())?;
    let mesh = correlator.mesh();
    let mut record = Record::new(plan, &*correlator, [width, height], pool.current_num_threads(), &sha256, zone_files);
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
    progress.say(&format!(
        "reference {} ({width} x {height} px, {depth}), {}, {} elements of {} px, {} nodes; {}, {}",
        plan.reference_name(),
        plural(mesh.zones().len(), "zone"),
        mesh.n_elements(),
        plan.options.element_size,
        mesh.n_nodes(),
        correlator.backend().device(),
        plural(pool.current_num_threads(), "thread"),
    ));
    let saturation = Saturation::of(&reference_image, &windows(mesh));
    let about_grey =
        [GreyDepth::of(&reference_image).and_then(GreyDepth::remark), saturation.and_then(saturation_message)];
    let about_grey = about_grey.into_iter().flatten().map(|note| format!("{}: {note}", plan.reference_name()));
    let notes = notes.into_iter().chain(about_grey).chain(zone_notes).chain(lock.remark.clone());
    notes.for_each(|note| progress.say(&note));
    if !correlator.dropped().is_empty() {
        progress.say(&format!("{} with too little texture left out", plural(correlator.dropped().len(), "node")));
    }
    if !correlator.held().is_empty() {
        progress.say(&format!(
            "{} with too little texture held by the regularisation",
            plural(correlator.held().len(), "node")
        ));
    }
    if !earlier.is_empty() {
        let to_do = if numbers.is_empty() { "nothing is missing".into() } else { format!("{} to do", numbers.len()) };
        progress.say(&format!("{} done before, {to_do}", plural(earlier.len(), "frame")));
    }
    if !damaged.is_empty() {
        let list = super::status::ranges(&damaged);
        progress.say(&format!(
            "what is stored of {} is not whole and is done again: {list}",
            plural(damaged.len(), "frame")
        ));
    }
    if !depending.is_empty() {
        let list = super::status::ranges(&depending);
        progress.say(&format!("done again, since the reference depends on all frames before: {list}"));
    }
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
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        threads: pool.current_num_threads(),
        units: units(),
        reference: ReferenceSummary {
            file: plan.reference[0].to_string(),
            mean_of: match plan.reference.as_slice() {
                [_] => Vec::new(),
                several => several.iter().map(ToString::to_string).collect(),
            },
            width_px: width,
            height_px: height,
            depth,
            bits_used: GreyDepth::of(&reference_image).map(|depth| depth.used),
            saturated_percent: saturation.map(Saturation::percent),
            range_grey: correlator.grey_range(),
        },
        n_nodes: mesh.n_nodes(),
        n_elements: mesh.n_elements(),
        n_levels: correlator.n_levels(),
        solver: correlator.solver_name(),
        tolerance_px: plan.options.tolerance_px,
        seconds_reference,
        seconds_total: 0.0,
        nodes_left_out: correlator.dropped().iter().map(Into::into).collect(),
        nodes_held: correlator.held().iter().map(Into::into).collect(),
        messages: border_notes,
        reference_updates: reference_updates(&frames),
        counts: counts(&frames),
        frames,
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
    let [writing_ns, waiting_ns] = &[AtomicU64::new(0), AtomicU64::new(0)];
    let mut feed = Feed {
        to_do: numbers.iter().map(|&number| (number, plan.deformed[number - 1].clone())).collect(),
        camera: session.camera.as_mut(),
        record: &mut record,
        store: &writer,
        engine: &engine,
        waiting_ns,
    };
    let written = std::thread::scope(|scope| -> Result<()> {
        let (finished, to_write) = sync_channel(BEHIND);
        let about = &about;
        let alone = session.shard.is_none();
        let output = Output { plan, folder, store: &writer, fields: &store, about, alone, in_series, writing_ns };
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
            let [writing, waiting] =
                [writing_ns, waiting_ns].map(|ns| Duration::from_nanos(ns.load(Ordering::Relaxed)));
            busy.add(&frame, writing, waiting);
            progress.frame(&frame, &busy);
            summary.frames.push(frame.clone());
            if alone && last_summary.elapsed() > summary_every {
                let writing = Instant::now();
                write_summary(folder, &mut summary, begin)?;
                summary_every = SUMMARY_EVERY.max(SUMMARY_SHARE * writing.elapsed());
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

/// Writes the summary of the frames so far, in order.
fn write_summary(folder: &RunFolder, summary: &mut Summary, begin: Instant) -> Result<()> {
    summary.frames.sort_by_key(|frame| frame.number);
    summary.counts = counts(&summary.frames);
    summary.reference_updates = reference_updates(&summary.frames);
    summary.seconds_total = begin.elapsed().as_secs_f64();
    folder.write_summary(summary)
}

/// What the section `[run]` of an earlier start says under `key`.
fn recorded(header: &StoreHeader, key: &str) -> Option<toml::Value> {
    header.case.parse::<toml::Table>().ok()?.get("run")?.get(key).cloned()
}

/// The instruction path of an earlier start, when this machine has it.
fn isa_of(header: &StoreHeader) -> Option<Isa> {
    Isa::named(recorded(header, "isa")?.as_str()?)
}

/// Whether an earlier start wrote CSV and VTU files.
fn tables_of(header: &StoreHeader) -> Option<(bool, bool)> {
    let names = recorded(header, "export")?;
    let has = |name: &str| names.as_array().is_some_and(|names| names.iter().any(|one| one.as_str() == Some(name)));
    Some((has("csv"), has("vtu")))
}

/// Size of the elements: the one asked for, or what the mesh of a file has.
fn element_size_px(mesh: &Mesh<Px>, asked: usize) -> f64 {
    let (size, asked) = (mesh.element_size(), asked as f64);
    // Grids that start at a fraction of a pixel miss it in the last digits.
    if (size - asked).abs() < 1e-9 * asked { asked } else { size }
}

/// What a zone that ends at a place without texture should be told.
fn bare_border_note(border: &BareBorder) -> String {
    let BareBorder { zone, length_px, at: [x, y] } = border;
    format!(
        "warning: zone '{zone}' borders on {length_px:.0} px without texture (about ({x:.0}, {y:.0}) px): what lies beyond \
         is mixed into its outermost pixels and pulls the nodes there; leave these out with --guard 3 or guard_px"
    )
}

/// Why the reference cannot be prepared; its file is named when the fault may be in it.
fn about_reference(plan: &Plan, error: &CorrelationError) -> String {
    use MeshError::{
        CrossedPolygon, ElementShare, ElementSize, GuardSides, NoPolygon, NotARectangle, NotFinite, Overlap, SameName,
    };
    match error {
        CorrelationError::Option { .. }
        | CorrelationError::Backend(_)
        | CorrelationError::Mesh(
            ElementSize { .. }
            | ElementShare { .. }
            | NotARectangle { .. }
            | Overlap { .. }
            | SameName { .. }
            | NoPolygon { .. }
            | CrossedPolygon { .. }
            | NotFinite { .. }
            | GuardSides { .. },
        ) => chain(error),
        _ => format!("{}: {}", plan.reference_name(), chain(error)),
    }
}

/// The frames that a run has to do: those of its plan, then those of its camera.
struct Feed<'a> {
    to_do: VecDeque<series::Numbered>,
    camera: Option<&'a mut Camera>,
    record: &'a mut Record,
    store: &'a StoreWriter,
    engine: &'a Engine,
    /// Time without anything to do.
    waiting_ns: &'a AtomicU64,
}

impl Feed<'_> {
    /// The next of them; waits for the camera while the frame is `wanted`.
    fn next(&mut self, wanted: &dyn Fn() -> bool) -> Result<Option<series::Numbered>> {
        let Some(camera) = &mut self.camera else { return Ok(self.to_do.pop_front()) };
        let begin = Instant::now();
        let come = camera.take(self.to_do.is_empty(), wanted);
        self.waiting_ns.fetch_add(nanoseconds(begin.elapsed()), Ordering::Relaxed);
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

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// The reference image, or the mean of several.
struct Reference {
    image: Image,
    /// Of each file.
    sha256: Vec<String>,
    /// What is worth knowing, each with its file.
    notes: Vec<String>,
}

impl Reference {
    /// References further apart than this are said to have moved, px: averaging them blurs the texture.
    const STILL_PX: f64 = 0.02;

    fn read(frames: &[Frame]) -> Result<Self> {
        let mut first: Option<(Image, &Frame)> = None;
        let mut mean: Option<Mean> = None;
        let (mut sha256, mut notes) = (Vec::new(), Vec::new());
        for frame in frames {
            let loaded = frame.read()?;
            sha256.push(loaded.sha256);
            notes.extend(loaded.notes.iter().map(|note| format!("{frame}: {note}")));
            let Some((before, name)) = &first else {
                first = Some((loaded.image, frame));
                continue;
            };
            let mean = mean.get_or_insert_with(|| Mean::new(before));
            if !mean.add(&loaded.image) {
                let size = |image: &Image| format!("{} x {} px", image.width(), image.height());
                let sizes = [size(&loaded.image), size(before)];
                return Err(format!(
                    "{frame}: the image is {}, the reference {name} {}; the mean needs images of one size",
                    sizes[0], sizes[1]
                )
                .into());
            }
            if let Some([x, y]) = small_shift(before, &loaded.image)
                && x.hypot(y) > Self::STILL_PX
            {
                notes.push(format!(
                    "{frame}: moved by about ({x:.2}, {y:.2}) px against {name}: their mean is blurred; take references \
                     between which nothing moves"
                ));
            }
        }
        let (first, _) = first.ok_or("no reference image is given")?;
        let image = mean.map_or(first, Mean::image);
        Ok(Self { image, sha256, notes })
    }
}

/// The rectangles that hold the zones, px: x0, y0, x1, y1.
fn windows(mesh: &Mesh<Px>) -> Vec<[usize; 4]> {
    let window = |zone: usize| {
        let bounds = mesh.bounds(zone);
        // Negative corners are cut at 0.
        [bounds.x0.ceil(), bounds.y0.ceil(), bounds.x1.ceil(), bounds.y1.ceil()].map(|v| v as usize)
    };
    (0..mesh.zones().len()).map(window).collect()
}

/// A frame on its way to the disk; without a result when it could not be read.
struct ToWrite {
    summary: FrameSummary,
    sha256: Option<String>,
    result: Option<Correlation>,
    kept: Option<Kept>,
}

/// Where the frames of a run go.
struct Output<'a> {
    plan: &'a Plan,
    folder: &'a RunFolder,
    store: &'a StoreWriter,
    /// The same store, for reading.
    fields: &'a Store,
    about: &'a About,
    /// Whether this process does all frames.
    alone: bool,
    /// Frames with a field.
    in_series: BTreeSet<usize>,
    /// Time spent with writing.
    writing_ns: &'a AtomicU64,
}

impl Output<'_> {
    fn write_all(mut self, frames: &Receiver<ToWrite>) -> Result<()> {
        for frame in frames {
            let begin = Instant::now();
            self.write(frame)?;
            self.writing_ns.fetch_add(nanoseconds(begin.elapsed()), Ordering::Relaxed);
        }
        Ok(())
    }

    /// Writes a frame: field, tables, record, and its status last, which says that it is done.
    fn write(&mut self, ToWrite { summary, sha256, result, kept }: ToWrite) -> Result<()> {
        let Self { plan, folder, store, about, .. } = self;
        let (number, file, status) = (summary.number, summary.file.clone(), summary.status);
        let mut files = Vec::new();
        // A diverged field is no measurement: its numbers are not spread.
        if let Some(Correlation { measurement, .. }) = result.as_ref().filter(|_| status.has_field()) {
            // The length is the one that the store says, to the last digit.
            let length_px = about.element_size_px();
            let strain = StrainField { length_px, ..StrainField::of(measurement, plan.strain) };
            store.write_field(number, measurement, &strain)?;
            let mut of_store = self.fields.field_files(number);
            if kept.is_some() {
                store.write_reference_frame(number, summary.reference_frame)?;
                of_store.push(self.fields.reference_frame_file(number));
            }
            files.extend(of_store.iter().filter_map(|path| path.strip_prefix(folder.path()).ok()).map(Path::to_owned));
            if plan.csv {
                folder.write_csv(number, about, &file, measurement, &strain)?;
                files.push(csv_name(number).into());
            }
            if plan.vtu {
                folder.write_vtu(number, about, &file, measurement, &strain)?;
                files.push(vtu_name(number).into());
            }
        }
        let tracked = result.as_ref().filter(|_| plan.options.start == StartFrom::Previous);
        let record = FrameRecord::new(folder.path(), summary, sha256, tracked, files)?;
        folder.write(&FrameRecord::name(number), |out| Ok(serde_json::to_writer(out, &record)?))?;
        if let Some(kept) = &kept {
            folder.write(&Kept::name(number), |out| kept.write(out))?;
        }
        store.mark(number, status)?;
        if kept.is_some() {
            Kept::remove_before(folder.path(), number);
        }
        if plan.vtu && status.has_field() {
            self.in_series.insert(number);
            if self.alone && self.in_series.len().is_multiple_of(100) {
                folder.write_series(&self.in_series.iter().copied().collect::<Vec<_>>())?;
            }
        }
        Ok(())
    }
}

/// What `run.toml` tells beside the options.
struct Record {
    case: CaseFile,
    about: toml::Table,
    reference: Vec<(Frame, String)>,
    deformed: Vec<Frame>,
    zone_files: toml::value::Array,
}

impl Record {
    fn new<B: Backend>(
        plan: &Plan,
        correlator: &Correlator<B>,
        [width, height]: [usize; 2],
        threads: usize,
        sha256: &[String],
        zone_files: Vec<(PathBuf, String)>,
    ) -> Self {
        let mut about = toml::Table::new();
        about.insert("quadrille".into(), env!("CARGO_PKG_VERSION").into());
        about.insert("device".into(), correlator.backend().device().into());
        about.insert("isa".into(), plan.isa.name().into());
        about.insert("threads".into(), (threads as i64).into());
        let exports = [(plan.csv, "csv"), (plan.vtu, "vtu")];
        let exports = exports.iter().filter(|(on, _)| *on).map(|(_, name)| (*name).into());
        about.insert("export".into(), toml::Value::Array(exports.collect()));
        about.insert(
            "units".into(),
            units().into_iter().map(|(k, v)| (k.to_owned(), v.into())).collect::<toml::Table>().into(),
        );
        Self {
            case: plan.resolved(width, height),
            about,
            reference: plan.reference.iter().cloned().zip(sha256.iter().cloned()).collect(),
            deformed: plan.deformed.clone(),
            zone_files: zone_files.iter().map(|(path, sha256)| Self::entry(path, None, Some(sha256))).collect(),
        }
    }

    fn entry(path: &Path, page: Option<usize>, sha256: Option<&str>) -> toml::Value {
        let mut table = toml::Table::new();
        table.insert("file".into(), absolute(path).into());
        page.map(|page| table.insert("page".into(), (page as i64).into()));
        // A file that could not be read has none.
        sha256.map(|sha256| table.insert("sha256".into(), sha256.into()));
        toml::Value::Table(table)
    }

    /// The case file with the record of the run but for its images: the store names them beside it.
    fn without_images(&self) -> String {
        self.written(None)
    }

    /// The case file with the record of the run, and the deformed images that were come to, with their SHA-256.
    fn case(&self, sha256: &BTreeMap<usize, Option<String>>) -> String {
        let page = |frame: &Frame| frame.is_page.then_some(frame.page);
        let references =
            self.reference.iter().map(|(frame, sha256)| Self::entry(&frame.path, page(frame), Some(sha256)));
        let deformed = sha256.iter().map(|(number, sha256)| {
            let frame = &self.deformed[number - 1];
            Self::entry(&frame.path, page(frame), sha256.as_deref())
        });
        self.written(Some(references.chain(deformed).collect()))
    }

    fn written(&self, images: Option<toml::value::Array>) -> String {
        let mut about = self.about.clone();
        if let Some(images) = images {
            about.insert("image".into(), toml::Value::Array(images));
        }
        if !self.zone_files.is_empty() {
            about.insert("zone_file".into(), toml::Value::Array(self.zone_files.clone()));
        }
        // More of them may have come than were planned.
        let images = CaseImages { deformed: Some(plan::files(&self.deformed)), ..self.case.images.clone() };
        write_case(&CaseFile { images, run: Some(about), ..self.case.clone() })
    }
}
