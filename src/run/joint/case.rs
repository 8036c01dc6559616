//! From images to the report, step by step: what `quadrille run` does.

use crate::backend::choice::DeviceChoice;
use crate::backend::gpu::GpuOptions;
use crate::field::Status;
use crate::identify::{Case, first_order};
use crate::io::case::CaseRigidMotion;
use crate::io::images::{PagedFile, sha256};
use crate::io::joint::{JointInput, read_joint};
use crate::io::series::Frame;
use crate::io::store::{STORE, Store};
use crate::report::fit::read_bands;
use crate::report::identification::OtherRigidMotion;
use crate::run::folder::read::{frames_that, write_file};
use crate::run::folder::steps::Steps;
use crate::run::folder::{CORRELATION, RIGID_MOTION, RunFolder, correlation_in};
use crate::run::joint::strips::case_with_strips;
use crate::run::joint::{FIT, check_reduction, identify, reduce_run, simulate};
use crate::run::look::page::page;
use crate::run::plan::rehearsal::rehearse;
use crate::run::plan::{Existing, Outcome, Plan, Request, Session, Stop};
use crate::run::series::files::run_series;
use crate::run::words::remarks::{report_missing, zones_matched};
use crate::run::words::{Event, Result, Watcher, chain, plural};
use rayon::ThreadPool;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of the test without a model, where the case asks for it.
const REDUCED: &str = "reduction";
/// Stands for the inputs of a step that did not come to its end.
const CUT_SHORT: &str = "cut short";

/// What a run from images to the report is given.
#[derive(Debug, Clone, Default)]
pub struct CaseRun {
    /// The case file.
    pub case: PathBuf,
    /// Folder of the results.
    pub output: PathBuf,
    /// Whether the results of another run there are replaced.
    pub overwrite: bool,
    /// Where the pixel work is done.
    pub device: DeviceChoice,
    /// How a graphics device is opened.
    pub gpu: GpuOptions,
    /// The wish to stop, heard between frames and between the steps of a fit.
    pub stop: Stop,
    /// Time after which the fit ends at the best point so far, s; over what the case says.
    pub max_seconds: Option<f64>,
    /// Forward runs that one start of the fit may take; over what the case says.
    pub max_evaluations: Option<usize>,
}

impl CaseRun {
    /// The run of `case` into `output`, which continues what is there of it.
    pub fn new(case: impl Into<PathBuf>, output: impl Into<PathBuf>) -> Self {
        Self { case: case.into(), output: output.into(), ..Self::default() }
    }
}

/// Everything from the images of a case to its report. Steps that were done before with the same inputs are taken from
/// there.
///
/// # Errors
/// See [`crate::run::RunError`]. Frames and a fit that do not converge, and a model that the data reject, are results.
pub fn run_case(asked: &CaseRun, pool: &ThreadPool, watcher: Watcher<'_>) -> Result<Outcome> {
    let CaseRun { case: file, output, overwrite, device, gpu, stop, .. } = asked;
    let request = Request { device: device.clone(), gpu: gpu.clone(), ..Request::default() };
    let (mut case, found) = case_with_strips(file, &request)?;
    if let Some(fit) = &mut case.joint.fit {
        fit.max_seconds = asked.max_seconds.or(fit.max_seconds);
        fit.max_evaluations = asked.max_evaluations.or(fit.max_evaluations);
    }
    // Not after hours of correlation.
    Case::check(&case)?;
    check_reduction(&case.correlation)?;
    found.iter().for_each(|found| watcher(Event::Note(found)));
    case.notes.iter().for_each(|note| watcher(Event::Remark(&zones_matched(note))));
    let mut plan = Plan::of(&request, &case.correlation)?;
    // That of the whole run says the same and more.
    plan.report = false;
    // The faces of the joint carry what is looked for, and the rest of the border is prescribed to the mechanics.
    plan.options.whole_borders = case.interface.zones.to_vec();
    rehearse(&case, &plan)?.iter().for_each(|remark| watcher(Event::Remark(remark)));
    let mut steps = Steps::open(output, *overwrite)?;
    let correlation = correlation_in(output);
    let inputs = inputs_of(&plan)?;
    let complete = || {
        Store::open(&correlation).is_ok_and(|store| {
            (1..=store.n_frames()).all(|number| store.status(number).is_ok_and(|status| status.is_some()))
        })
    };
    if steps.is_done("correlation", &inputs) && complete() {
        watcher(Event::Note("correlation: done before with the same images and options, taken from there"));
    } else {
        let existing = if steps.begin("correlation", &inputs)? { Existing::Continue } else { Existing::Replace };
        let begin = Instant::now();
        let folder = RunFolder::open(&correlation, true)?;
        let session = Session { stop: stop.clone(), ..Session::new(existing) };
        if run_series(&plan, &folder, pool, session, watcher)?.outcome == Outcome::Stopped {
            return Ok(Outcome::Stopped);
        }
        steps.note("correlation", &inputs, begin, Outcome::Fine)?;
    }

    let reduced = reduce_run(&case.correlation, file, &correlation, &output.join(REDUCED))?;
    if let Some(reduced) = &reduced {
        reduced.remarks().iter().for_each(|remark| watcher(Event::Remark(remark)));
        let direct = reduced.has_traction().then(|| REDUCED.to_owned());
        case.joint.fit.iter_mut().for_each(|fit| fit.direct.clone_from(&direct));
    }
    let text = case.joint_case(&format!("{CORRELATION}/{STORE}"), case.has_fit());
    let (name, step, result) = match case.has_fit() {
        true => ("identify.toml", "identification", FIT),
        false => ("simulate.toml", "simulation", "solution.csv"),
    };
    let (joint_case, result) = (output.join(name), output.join(result));
    let inputs = sha256(format!("{}\n{inputs}\n{text}", env!("CARGO_PKG_VERSION")).as_bytes());
    // A fit of an earlier version has no bands to draw.
    let has_bands = || !case.has_fit() || read_bands(&output.join("traction-bands.csv")).is_ok();
    let outcome = if steps.is_done(step, &inputs) && result.exists() && has_bands() {
        watcher(Event::Note(&format!("{step}: done before with the same measurement and options, taken from there")));
        steps.outcome(step)
    } else {
        steps.forget(step)?;
        write_file(&joint_case, &text)?;
        let begin = Instant::now();
        let (outcome, cut_short) = mechanics(&joint_case, output, case.has_fit(), pool, stop, watcher)?;
        // What its limit of time ended, or somebody, is not done: the same command tries again.
        steps.note(step, if cut_short { CUT_SHORT } else { &inputs }, begin, outcome)?;
        outcome
    };

    let (page, fault) = pool.install(|| page(file, output, &case, &joint_case, &steps, reduced.as_ref()))?;
    if let Some(error) = fault {
        let what = format!("{} has no fields to look around in", RunFolder::REPORT);
        watcher(Event::Remark(&report_missing(&what, &error)));
    }
    RunFolder::open(output, true)?.write(RunFolder::REPORT, |out| std::io::Write::write_all(out, page.as_bytes()))?;
    let left_out = frames_that(|status| status != Some(Status::Converged), &Store::open(&correlation)?)?.len();
    if left_out > 0 {
        let line = format!("{} did not converge and are left out: see the report", plural(left_out, "frame"));
        watcher(Event::Note(&line));
    }
    watcher(Event::Reported { page: &output.join(RunFolder::REPORT) });
    Ok(if left_out > 0 && outcome == Outcome::Fine { Outcome::Incomplete } else { outcome })
}

/// The step from the measured displacements to the result: the fit, or the model with the given law when nothing is to
/// be found. Also whether it was ended before its time.
fn mechanics(
    case: &Path,
    output: &Path,
    has_fit: bool,
    pool: &ThreadPool,
    stop: &Stop,
    watcher: Watcher<'_>,
) -> Result<(Outcome, bool)> {
    let effect = output.join(RIGID_MOTION);
    // That of an earlier fit.
    let _ = fs::remove_file(&effect);
    if !has_fit {
        let outcome = simulate(case, output, true, pool, stop, watcher)?.1;
        return Ok((outcome, outcome == Outcome::Stopped));
    }
    let input = read_joint(case)?;
    let (found, outcome) = identify(&input, case, output, true, pool, stop, watcher)?;
    if found.cut_short {
        return Ok((outcome, true));
    }
    let values: BTreeMap<&str, f64> = found.parameters.iter().map(|(name, entry)| (&**name, entry.value)).collect();
    let other = pool.install(|| with_other_rigid_motion(&input, case, &values));
    let other = match other {
        Ok((removed, parameters)) => {
            let other_choice = if removed { "overall" } else { "none" }.into();
            OtherRigidMotion::Found { other_choice, parameters }
        }
        Err(error) => OtherRigidMotion::Failed { failed: chain(&error) },
    };
    RunFolder::open(output, true)?.write_json(RIGID_MOTION, &other)?;
    Ok((outcome, false))
}

/// The fit that ended at `found` if the rigid motion were removed where it was kept, and the other way round, to first
/// order: whether it is removed, and the parameters then.
fn with_other_rigid_motion(
    input: &JointInput,
    case: &Path,
    found: &BTreeMap<&str, f64>,
) -> Result<(bool, BTreeMap<String, f64>)> {
    let remove = input.case.boundary.remove_rigid_motion != Some(CaseRigidMotion::Overall);
    let ends = [!remove, remove].map(|remove| -> Result<Vec<(String, f64)>> {
        let mut input = input.clone();
        input.case.boundary.remove_rigid_motion =
            Some(if remove { CaseRigidMotion::Overall } else { CaseRigidMotion::None });
        let joint = Case::joint(&input)?;
        let case = Case::new(&joint, &input, case)?;
        let names: Vec<&str> = case.problem.unknowns.list().iter().map(|unknown| unknown.parameter.name).collect();
        let x: Vec<f64> = names.iter().map(|name| found[name]).collect();
        let end = first_order(&case.problem, case.options.weights, &x)?;
        Ok(names.into_iter().map(str::to_owned).zip(end).collect())
    });
    let [this, other] = [ends[0].as_ref(), ends[1].as_ref()].map(|end| end.map_err(|error| chain(error)));
    let change =
        this?.iter().zip(other?).map(|((name, this), (_, other))| (name.clone(), found[name.as_str()] * other / this));
    Ok((remove, change.collect()))
}

/// One hash of all that the measurement depends on: version, options, images.
fn inputs_of(plan: &Plan) -> Result<String> {
    let files: Vec<&Frame> = plan.reference.iter().chain(&plan.deformed).collect();
    let (mut images, mut open) = (Vec::new(), None);
    for frame in files {
        if !matches!(&open, Some((path, _)) if *path == &frame.path) {
            open = Some((&frame.path, PagedFile::open(&frame.path).ok()));
        }
        // A file that cannot be read has no hash: the correlation says what is the matter.
        let file = open.as_mut().and_then(|(_, file)| file.as_mut());
        let hash = file.and_then(|file| file.sha256(frame.page).ok());
        images.push(format!("{frame} {}", hash.as_deref().unwrap_or("unreadable")));
    }
    let options = crate::io::case::write_case(&plan.to_case_file());
    let about = format!("{} {:?} {}", env!("CARGO_PKG_VERSION"), plan.device, plan.isa.name());
    Ok(sha256(format!("{about}\n{options}\n{}", images.join("\n")).as_bytes()))
}
