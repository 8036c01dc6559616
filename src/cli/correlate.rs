//! `quadrille correlate`.

use super::args::CorrelateArgs;
use super::plan::{MANY, Plan};
use super::progress::{Progress, Talk};
use super::run_folder::{About, RunFolder};
use super::{Outcome, Result, absolute, chain, plural, pool, probe, quantities};
use crate::backend::Backend;
use crate::backend::cpu::CpuBackend;
use crate::correlate::{Correlation, CorrelationError, Correlator, Tracker};
use crate::field::{Status, StrainField};
use crate::io::case::write_case;
use crate::io::images::{Loaded, ReadError, read_image};
use crate::io::store::{STORE, Store, StoreHeader, StoreWriter};
use crate::mesh::{Mesh, MeshError};
use crate::report::summary::{FrameSummary, ReferenceSummary, Summary, counts, units};
use crate::units::Px;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

/// Decoded images that wait for their turn.
const AHEAD: usize = 2;
/// Results that wait to be written.
const BEHIND: usize = 4;
/// How often the summary is written while the series runs.
const SUMMARY_EVERY: Duration = Duration::from_secs(10);

/// Runs the command.
pub(super) fn run(args: &CorrelateArgs) -> Result<Outcome> {
    let plan = Plan::new(args)?;
    let talk = match (args.quiet, args.verbose) {
        (true, _) => Talk::Quiet,
        (_, true) => Talk::Verbose,
        _ => Talk::Normal,
    };
    let folder = RunFolder::open(&args.output, args.overwrite)?;
    let summary = run_series(&plan, &folder, pool(args.threads)?, talk, |_, _| ())?;
    if let Some(frames) = &args.figures {
        super::figures::of_run(&args.output, frames, args.threads, args.quiet)?;
    }
    let fine = summary.frames.iter().all(|frame| frame.status == Status::Converged);
    Ok(if fine { Outcome::Fine } else { Outcome::Incomplete })
}

/// Correlates the series of `plan` into `folder`; also the heart of `quadrille demo`. Each result is shown
/// to `look` with its frame number before it is written.
pub(super) fn run_series(
    plan: &Plan,
    folder: &RunFolder,
    pool: rayon::ThreadPool,
    talk: Talk,
    mut look: impl FnMut(usize, &Correlation),
) -> Result<Summary> {
    let begin = Instant::now();
    // Before anything is run: a load file that does not fit, or places that mean nothing, are refused now.
    quantities::load(&plan.drawn, plan.deformed.len())?;
    let loaded = read_image(&plan.reference, plan.page)?;
    let (width, height) = (loaded.image.width(), loaded.image.height());
    let zones = plan.zones_on(width, height)?;
    let depth = loaded.image.pixels().depth();
    let reference_image = Arc::new(loaded.image);
    let prepare = Instant::now();
    let backend = CpuBackend::new(plan.isa);
    let correlator = pool
        .install(|| Correlator::new(backend, reference_image, &zones, plan.options.clone()))
        .map_err(|error| about_reference(plan, &error))?;
    let seconds_reference = prepare.elapsed().as_secs_f64();
    quantities::resolve(&plan.drawn, plan.strain, correlator.mesh())?;
    folder.clear(plan.csv, plan.vtu)?;
    quantities::remove(folder.path())?;

    let mut progress = Progress::new(talk, plan.deformed.len());
    let mesh = correlator.mesh();
    progress.say(&format!(
        "reference {} ({width} x {height} px, {depth}), {}, {} elements of {} px, {} nodes; {}, {}",
        plan.reference.display(),
        plural(zones.len(), "zone"),
        mesh.n_elements(),
        plan.options.element_size,
        mesh.n_nodes(),
        correlator.backend().device(),
        plural(pool.current_num_threads(), "thread"),
    ));
    loaded.notes.iter().for_each(|note| progress.say(&format!("{}: {note}", plan.reference.display())));
    if !correlator.dropped().is_empty() {
        progress.say(&format!("{} with too little texture left out", plural(correlator.dropped().len(), "node")));
    }
    if !correlator.held().is_empty() {
        progress.say(&format!(
            "{} with too little texture held by the regularisation",
            plural(correlator.held().len(), "node")
        ));
    }
    let mut summary = Summary {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        threads: pool.current_num_threads(),
        units: units(),
        reference: ReferenceSummary {
            file: plan.reference.display().to_string(),
            width_px: width,
            height_px: height,
            depth,
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
        counts: counts(&[]),
        frames: Vec::with_capacity(plan.deformed.len()),
    };
    let mut record = Record::new(plan, &correlator, &zones, loaded.sha256, pool.current_num_threads());
    folder.write_case(&record.case())?;
    let header = StoreHeader {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.backend().device(),
        mesh: mesh.clone(),
        image_size_px: [width, height],
        reference: vec![plan.reference.display().to_string()],
        reference_sha256: vec![record.reference_sha256.clone()],
        frames: plan.deformed.iter().map(|path| path.display().to_string()).collect(),
        pixel_size: plan.pixel_size,
        range_grey: correlator.grey_range(),
        element_size_px: element_size_px(mesh, plan.options.element_size),
        strain: plan.strain,
        case: record.without_images(),
    };
    let store = folder.store(&header)?;
    let about = About::new(header)?;
    if plan.store_only {
        progress.say(&format!(
            "more than {MANY} frames: fields go to {STORE} alone; `quadrille export` makes tables of them, \
             or --export csv,vtu during the run"
        ));
    }

    let written = std::thread::scope(|scope| -> Result<()> {
        let (decoded_in, decoded) = sync_channel(AHEAD);
        scope.spawn(move || decode_all(&plan.deformed, plan.page, &decoded_in));
        let (finished, to_write) = sync_channel(BEHIND);
        let (store, about) = (&store, &about);
        let writer = scope.spawn(move || write_all(plan, folder, store, about, &to_write));
        let mut tracker = Tracker::new(&correlator);
        let mut last_summary = Instant::now();
        for Decoded { number, path, loaded, seconds } in decoded {
            let (frame, result, sha256) = pool.install(|| one_frame(&mut tracker, number, &path, loaded, seconds))?;
            record.images.push((path, sha256));
            if let Some(result) = &result {
                look(number, result);
            }
            if finished.send(ToWrite { number, file: frame.file.clone(), result }).is_err() {
                break; // the writer has stopped; its error says why
            }
            summary.frames.push(frame);
            progress.frame(number, &summary.frames[number - 1]);
            if last_summary.elapsed() > SUMMARY_EVERY {
                last_summary = Instant::now();
                summary.counts = counts(&summary.frames);
                summary.seconds_total = begin.elapsed().as_secs_f64();
                folder.write_summary(&summary)?;
            }
        }
        drop(finished);
        writer.join().map_err(|_| "the writer stopped: this is a bug in quadrille")?
    });
    summary.counts = counts(&summary.frames);
    summary.seconds_total = begin.elapsed().as_secs_f64();
    // Also when writing has failed: what is known is kept where it can be.
    let closed = folder.write_case(&record.case()).and_then(|()| folder.write_summary(&summary));
    let closed = closed.and_then(|()| Ok(store.finish(record.sha256())?));
    written?;
    closed?;
    if !plan.drawn.is_empty() {
        let numbers: Vec<usize> = (1..=summary.frames.len()).collect();
        let store = Store::open(folder.path())?;
        let drawn = probe::write_of_store(&store, &plan.drawn, None, &numbers, folder.path(), |_, _| ())?;
        drawn.notes.iter().for_each(|note| progress.say(note));
    }
    progress.finish(&summary.frames, summary.seconds_total);
    progress.say(&format!("results in {}", folder.path().display()));
    Ok(summary)
}

/// Size of the elements: the one asked for, or what the mesh of a file has.
fn element_size_px(mesh: &Mesh<Px>, asked: usize) -> f64 {
    let (size, asked) = (mesh.element_size(), asked as f64);
    // Grids that start at a fraction of a pixel miss it in the last digits.
    if (size - asked).abs() < 1e-9 * asked { asked } else { size }
}

/// Why the reference cannot be prepared; its file is named when the fault may be in it.
fn about_reference(plan: &Plan, error: &CorrelationError) -> String {
    use MeshError::{ElementSize, NotARectangle, Overlap, SameName};
    match error {
        CorrelationError::Option { .. }
        | CorrelationError::Mesh(ElementSize { .. } | NotARectangle { .. } | Overlap { .. } | SameName { .. }) => {
            chain(error)
        }
        _ => format!("{}: {}", plan.reference.display(), chain(error)),
    }
}

/// A frame that was read, or not.
struct Decoded {
    number: usize,
    path: PathBuf,
    loaded: std::result::Result<Loaded, ReadError>,
    seconds: f64,
}

fn decode_all(files: &[PathBuf], page: usize, out: &SyncSender<Decoded>) {
    for (at, path) in files.iter().enumerate() {
        let begin = Instant::now();
        let loaded = read_image(path, page);
        let seconds = begin.elapsed().as_secs_f64();
        if out.send(Decoded { number: at + 1, path: path.clone(), loaded, seconds }).is_err() {
            return; // nobody wants more
        }
    }
}

/// Correlates one frame. A frame that cannot be used is a result with its reason.
fn one_frame<B: Backend>(
    tracker: &mut Tracker<'_, B>,
    number: usize,
    path: &Path,
    loaded: std::result::Result<Loaded, ReadError>,
    seconds_decode: f64,
) -> Result<(FrameSummary, Option<Correlation>, Option<String>)> {
    let file = path.display().to_string();
    let loaded = match loaded {
        Ok(loaded) => loaded,
        Err(error) => {
            return Ok((FrameSummary::unreadable(number, file, chain(&error), seconds_decode), None, None));
        }
    };
    let sha256 = Some(loaded.sha256);
    let image = Arc::new(loaded.image);
    let begin = Instant::now();
    match tracker.correlate(number, image) {
        Ok(result) => {
            let seconds = [begin.elapsed().as_secs_f64(), seconds_decode];
            let frame = FrameSummary::of(number, file, loaded.notes, tracker.correlator(), &result, seconds);
            Ok((frame, Some(result), sha256))
        }
        Err(error) if error.is_of_the_frame() => {
            let message = format!("{file}: {}", chain(&error));
            Ok((FrameSummary::unreadable(number, file, message, seconds_decode), None, sha256))
        }
        Err(error) => Err(error.into()),
    }
}

/// A frame on its way to the disk; without a result when it could not be read.
struct ToWrite {
    number: usize,
    file: String,
    result: Option<Correlation>,
}

fn write_all(
    plan: &Plan,
    folder: &RunFolder,
    store: &StoreWriter,
    about: &About,
    frames: &Receiver<ToWrite>,
) -> Result<()> {
    let mut in_series = Vec::new();
    for ToWrite { number, file, result } in frames {
        let Some(Correlation { measurement, .. }) = result else {
            store.mark(number, Status::Unreadable)?;
            continue;
        };
        // A diverged field is no measurement: its numbers are not spread.
        if !measurement.status.has_field() {
            store.mark(number, measurement.status)?;
            continue;
        }
        // The length is the one that the store says, to the last digit.
        let length_px = about.element_size_px();
        let strain = StrainField { length_px, ..StrainField::of(&measurement, plan.strain) };
        store.write(number, &measurement, &strain)?;
        if plan.csv {
            folder.write_csv(number, about, &file, &measurement, &strain)?;
        }
        if plan.vtu {
            folder.write_vtu(number, about, &file, &measurement, &strain)?;
            in_series.push(number);
            if in_series.len() % 100 == 0 {
                folder.write_series(&in_series)?;
            }
        }
    }
    if plan.vtu {
        folder.write_series(&in_series)?;
    }
    Ok(())
}

/// What `run.toml` tells beside the options.
struct Record {
    case: crate::io::case::CaseFile,
    about: toml::Table,
    reference_sha256: String,
    images: Vec<(PathBuf, Option<String>)>,
}

impl Record {
    fn new<B: Backend>(
        plan: &Plan,
        correlator: &Correlator<B>,
        zones: &[crate::mesh::Zone],
        reference_sha256: String,
        threads: usize,
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
        Self { case: plan.resolved(zones), about, reference_sha256, images: Vec::new() }
    }

    /// The case file with the record of the run but for its images: the store names them beside it.
    fn without_images(&self) -> String {
        write_case(&crate::io::case::CaseFile { run: Some(self.about.clone()), ..self.case.clone() })
    }

    /// Of each deformed image that was come to.
    fn sha256(&self) -> Vec<Option<String>> {
        self.images.iter().map(|(_, sha256)| sha256.clone()).collect()
    }

    /// The case file with the record of the run.
    fn case(&self) -> String {
        let image = |path: &Path, sha256: Option<&str>| {
            let mut table = toml::Table::new();
            table.insert("file".into(), absolute(path).into());
            // A file that could not be read has none.
            sha256.map(|sha256| table.insert("sha256".into(), sha256.into()));
            toml::Value::Table(table)
        };
        let reference = self.case.images.reference.clone().unwrap_or_default();
        let mut images = vec![image(Path::new(&reference), Some(&self.reference_sha256))];
        images.extend(self.images.iter().map(|(path, sha)| image(path, sha.as_deref())));
        let mut about = self.about.clone();
        about.insert("image".into(), toml::Value::Array(images));
        write_case(&crate::io::case::CaseFile { run: Some(about), ..self.case.clone() })
    }
}
