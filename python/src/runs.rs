//! What the commands do, from Python: series, cases, cameras, joints, metrology, and the command line itself.

use crate::errors::{raise, raised};
use crate::images::{Levels, image_of};
use crate::json::{case_of, record};
use crate::pool::pool;
use crate::watched::watched;
use pyo3::prelude::*;
use quadrille::io::case::{CaseImages, read_case};
use quadrille::io::joint::{CaseFit, IdentifyInput, read_identify, read_joint};
use quadrille::mechanics::Kinematics;
use quadrille::mesh::Roi;
use quadrille::metrology::{Options, Still, measure};
use quadrille::run::{
    Calibrating, CaseRun, Event, Existing, Export, Outcome, Plan, Request, RunError, RunFolder, Session, Shard, Stop,
};
use quadrille::synth::Depth;
use quadrille::virtual_test::{Mixity, VirtualOptions};
use rayon::ThreadPool;
use serde::Serialize;
use std::ffi::OsString;
use std::fmt::Display;
use std::path::PathBuf;
use std::sync::Arc;

/// An outcome and, where there is one, the record of what was found.
type Came<'py> = (&'static str, Bound<'py, PyAny>);

fn name(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Fine => "fine",
        Outcome::Incomplete => "incomplete",
        Outcome::Stopped => "stopped",
    }
}

/// Does `work`, which Python watches and may stop, with so many threads: what it found, as a record.
fn ran<'py, R: Serialize + Send>(
    py: Python<'py>,
    threads: Option<i64>,
    on_event: Option<&Bound<'py, PyAny>>,
    work: impl FnOnce(&ThreadPool, &Stop, &mut dyn FnMut(Event<'_>)) -> Result<(R, Outcome), RunError> + Send,
) -> PyResult<Came<'py>> {
    let (pool, stop) = (pool(threads)?, Stop::default());
    let (found, outcome) = watched(py, on_event, &stop, |watcher| work(&pool, &stop, watcher))?;
    Ok((name(outcome), record(py, &found)?))
}

/// Limits of a fit that were given, over those of its case.
fn limit(fit: &mut CaseFit, max_seconds: Option<f64>, max_evaluations: Option<usize>) {
    fit.max_seconds = max_seconds.or(fit.max_seconds);
    fit.max_evaluations = max_evaluations.or(fit.max_evaluations);
}

/// A series into a store: see `quadrille.run`. `case` is a file, `json` the sections of one; at least one of them.
#[pyfunction]
#[pyo3(signature = (case, json, output, *, reference, deformed, overwrite, shard, export, report, device, isa, threads, on_event))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn run_series<'py>(
    py: Python<'py>,
    case: Option<PathBuf>,
    json: Option<&str>,
    output: PathBuf,
    reference: Vec<String>,
    deformed: Vec<String>,
    overwrite: bool,
    shard: Option<&str>,
    export: Option<Vec<String>>,
    report: bool,
    device: &str,
    isa: Option<String>,
    threads: Option<i64>,
    on_event: Option<Bound<'py, PyAny>>,
) -> PyResult<Came<'py>> {
    let case = match (case, json) {
        (Some(path), None) => read_case(&path).map_err(raised)?,
        (path, json) => case_of(json.unwrap_or("{}"), &path.unwrap_or_else(|| "options".into()))?,
    };
    let shard = shard.map(str::parse::<Shard>).transpose().map_err(|error| raise("OptionError", error.to_string()))?;
    let known = |word: &String| word.parse::<Export>().map_err(|error| raise("OptionError", error));
    let export = export.map(|words| words.iter().map(known).collect::<PyResult<Vec<_>>>()).transpose()?;
    let Ok(device) = device.parse();
    let given = |names: Vec<String>| (!names.is_empty()).then_some(names);
    let (reference, deformed) = (given(reference), given(deformed));
    let images = CaseImages { reference, deformed, ..CaseImages::default() };
    let asked = Request { images, shard, export, no_report: !report, device, isa, ..Request::default() };
    let existing = if overwrite { Existing::Replace } else { Existing::Continue };
    ran(py, threads, on_event.as_ref(), |pool, stop, watcher| {
        let plan = Plan::of(&asked, &case)?;
        let session = Session { shard, stop: stop.clone(), ..Session::new(existing) };
        let done = quadrille::run::run_series(&plan, &RunFolder::writable(&output)?, pool, session, watcher)?;
        Ok((done.summary, done.outcome))
    })
}

/// From the images of a case to its report: see `quadrille.run`.
#[pyfunction]
#[pyo3(signature = (case, output, *, overwrite, max_seconds, max_evaluations, device, threads, on_event))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn run_case(
    py: Python<'_>,
    case: PathBuf,
    output: PathBuf,
    overwrite: bool,
    max_seconds: Option<f64>,
    max_evaluations: Option<usize>,
    device: &str,
    threads: Option<i64>,
    on_event: Option<Bound<'_, PyAny>>,
) -> PyResult<&'static str> {
    let Ok(device) = device.parse();
    let (done, _) = ran(py, threads, on_event.as_ref(), |pool, stop, watcher| {
        let stop = stop.clone();
        let asked = CaseRun { overwrite, device, stop, max_seconds, max_evaluations, ..CaseRun::new(case, output) };
        quadrille::run::run_case(&asked, pool, watcher).map(|outcome| ((), outcome))
    })?;
    Ok(done)
}

/// The camera that images show: see `quadrille.calibrate`. What there is to say of it.
#[pyfunction]
#[pyo3(signature = (json, output, *, images, lengths, points, chessboard, dots, pitch_mm, mark_std_px, overwrite, device, threads, on_event))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn calibrate(
    py: Python<'_>,
    json: &str,
    output: PathBuf,
    images: Vec<String>,
    lengths: Vec<[f64; 5]>,
    points: Vec<[f64; 4]>,
    chessboard: Option<[usize; 2]>,
    dots: Option<[usize; 2]>,
    pitch_mm: Option<f64>,
    mark_std_px: Option<f64>,
    overwrite: bool,
    device: &str,
    threads: Option<i64>,
    on_event: Option<Bound<'_, PyAny>>,
) -> PyResult<Vec<String>> {
    let Ok(device) = device.parse();
    let case = case_of(json, "options".as_ref())?;
    let images = CaseImages { deformed: (!images.is_empty()).then_some(images), ..CaseImages::default() };
    let request = Request { images, device, ..Request::default() };
    let asked = Calibrating { request, case, lengths, points, mark_std_px, chessboard, dots, pitch_mm };
    let existing = if overwrite { Existing::Replace } else { Existing::Continue };
    let (pool, stop) = (pool(threads)?, Stop::default());
    watched(py, on_event.as_ref(), &stop, |watcher| {
        let session = Session { stop: stop.clone(), ..Session::new(existing) };
        quadrille::run::calibrate(&asked, &output, session, &pool, watcher).map(|found| found.said)
    })
}

/// A joint that is pulled apart in the computer: see `quadrille.virtual_test`.
#[pyfunction]
#[pyo3(signature = (output, *, law, instants, seed, depth, noise, mixity, kinematics, overwrite, threads))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn virtual_test<'py>(
    py: Python<'py>,
    output: PathBuf,
    law: &str,
    instants: usize,
    seed: u64,
    depth: u8,
    noise: f32,
    mixity: &str,
    kinematics: &str,
    overwrite: bool,
    threads: Option<i64>,
) -> PyResult<Came<'py>> {
    let wrong = |name: &str, value: &dyn Display, wanted: &str| {
        raise("OptionError", format!("{name} is {value}; give {wanted}"))
    };
    let depth = match depth {
        8 => Depth::U8,
        16 => Depth::U16,
        _ => return Err(wrong("depth", &depth, "8 or 16")),
    };
    let mixities = [Mixity::Opening, Mixity::Mixed, Mixity::Sliding];
    let known = mixities.into_iter().find(|known| known.name() == mixity);
    let mixity = known.ok_or_else(|| wrong("mixity", &mixity, "opening, mixed or sliding"))?;
    let kinematics = match kinematics {
        "paper" => Kinematics::Paper,
        "finite" => Kinematics::Finite,
        _ => return Err(wrong("kinematics", &kinematics, "paper or finite")),
    };
    let options =
        VirtualOptions { seed, depth, noise_grey: noise, instants, mixity, kinematics, ..VirtualOptions::default() };
    ran(py, threads, None, |pool, _, _| {
        quadrille::run::virtual_test(options, law, &output, overwrite, pool).map(|truth| (truth, Outcome::Fine))
    })
}

/// A test of the standards, reduced: see `quadrille.reduce`.
#[pyfunction]
#[pyo3(signature = (case, output, *, overwrite))]
pub fn reduce<'py>(py: Python<'py>, case: PathBuf, output: PathBuf, overwrite: bool) -> PyResult<Came<'py>> {
    ran(py, Some(1), None, |_, _, _| {
        quadrille::run::reduce(&case, &output, overwrite).map(|record| (record, Outcome::Fine))
    })
}

/// The forward model of a joint: see `quadrille.simulate`.
#[pyfunction]
#[pyo3(signature = (case, output, *, overwrite, threads, on_event))]
pub fn simulate<'py>(
    py: Python<'py>,
    case: PathBuf,
    output: PathBuf,
    overwrite: bool,
    threads: Option<i64>,
    on_event: Option<Bound<'py, PyAny>>,
) -> PyResult<Came<'py>> {
    ran(py, threads, on_event.as_ref(), |pool, stop, watcher| {
        quadrille::run::simulate(&case, &output, overwrite, pool, stop, watcher)
    })
}

/// The parameters of an adhesive from measured displacements: see `quadrille.identify`.
#[pyfunction]
#[pyo3(signature = (case, output, *, overwrite, max_seconds, max_evaluations, threads, on_event))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn identify<'py>(
    py: Python<'py>,
    case: PathBuf,
    output: PathBuf,
    overwrite: bool,
    max_seconds: Option<f64>,
    max_evaluations: Option<usize>,
    threads: Option<i64>,
    on_event: Option<Bound<'py, PyAny>>,
) -> PyResult<Came<'py>> {
    ran(py, threads, on_event.as_ref(), |pool, stop, watcher| {
        let mut input = read_identify(&case)?;
        let fits = match &mut input {
            IdentifyInput::One(input) => input.case.fit.iter_mut().collect::<Vec<_>>(),
            IdentifyInput::Several(input) => {
                let of_tests = input.tests.iter_mut().flat_map(|test| &mut test.input.case.fit);
                std::iter::once(&mut input.fit).chain(of_tests).collect()
            }
        };
        fits.into_iter().for_each(|fit| limit(fit, max_seconds, max_evaluations));
        match &input {
            IdentifyInput::One(input) => {
                quadrille::run::identify(input, &case, &output, overwrite, pool, stop, watcher)
            }
            IdentifyInput::Several(input) => {
                quadrille::run::identify_several(input, &case, &output, overwrite, pool, stop, watcher)
            }
        }
    })
}

/// Several laws on the same data: see `quadrille.tournament`.
#[pyfunction]
#[pyo3(signature = (case, output, *, laws, overwrite, max_seconds, max_evaluations, threads, on_event))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn tournament<'py>(
    py: Python<'py>,
    case: PathBuf,
    output: PathBuf,
    laws: Vec<String>,
    overwrite: bool,
    max_seconds: Option<f64>,
    max_evaluations: Option<usize>,
    threads: Option<i64>,
    on_event: Option<Bound<'py, PyAny>>,
) -> PyResult<Came<'py>> {
    ran(py, threads, on_event.as_ref(), |pool, stop, watcher| {
        let mut input = read_joint(&case)?;
        if let Some(fit) = &mut input.case.fit {
            limit(fit, max_seconds, max_evaluations);
            if !laws.is_empty() {
                fit.laws.clone_from(&laws);
            }
            if fit.laws.is_empty() {
                let known = quadrille::mechanics::cohesive::LAW_NAMES.join(", ");
                return Err(RunError::from(format!(
                    "nothing to compare: give laws, or laws in [fit]; there are {known}"
                )));
            }
        }
        quadrille::run::compare_laws(&input, &case, &output, overwrite, pool, stop, watcher)
    })
}

/// What can be measured on images: see `quadrille.metrology`.
#[pyfunction]
#[pyo3(signature = (reference, stills, *, element_sizes, roi, noise, target_sigma_px, resolve_period_px, seed, threads))]
#[expect(clippy::too_many_arguments, reason = "the keywords of Python")]
pub fn metrology<'py>(
    py: Python<'py>,
    reference: &Bound<'py, PyAny>,
    stills: Vec<Bound<'py, PyAny>>,
    element_sizes: Option<Vec<usize>>,
    roi: Option<[f64; 4]>,
    noise: Option<f64>,
    target_sigma_px: f64,
    resolve_period_px: Option<f64>,
    seed: u64,
    threads: Option<i64>,
) -> PyResult<Bound<'py, PyAny>> {
    let reference = Arc::new(image_of(reference, "the reference", Levels::Borrowed)?);
    let still = |(at, array): (usize, &Bound<'_, PyAny>)| {
        let name = format!("static image {}", at + 1);
        Ok(Still { image: Arc::new(image_of(array, &name, Levels::Borrowed)?), name })
    };
    let stills = stills.iter().enumerate().map(still).collect::<PyResult<Vec<_>>>()?;
    let roi = roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 });
    let options = Options { element_sizes, roi, noise, target_sigma_px, resolve_period_px, seed, ..Options::default() };
    let pool = pool(threads)?;
    let found = py.detach(|| pool.install(|| measure(&reference, &stills, &options))).map_err(raised)?;
    record(py, &found)
}

/// The devices of this machine that can do the pixel work: name, kind, and why it cannot be used (`None` where it can).
#[pyfunction]
pub fn devices(py: Python<'_>) -> Vec<(String, String, Option<String>)> {
    let adapters = py.detach(quadrille::backend::gpu::adapters);
    let row = |adapter: quadrille::backend::gpu::GpuAdapter| {
        (adapter.name, format!("{:?}", adapter.kind).to_lowercase(), adapter.unusable.map(|why| why.to_string()))
    };
    adapters.list.into_iter().map(row).collect()
}

/// The command line with these words, the first of which names the program: its exit status.
#[pyfunction]
pub fn command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| quadrille::cli::main_of(words))
}
