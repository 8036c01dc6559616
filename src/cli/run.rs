//! `quadrille run`: from images to the report, step by step; steps that were done with the same inputs are not done again.

use super::args::{Cli, Command, CorrelateArgs, RunArgs, SimulateArgs};
use super::correlate::{Existing, Session, run_series};
use super::plan::Plan;
use super::progress::Talk;
use super::run_folder::RunFolder;
use super::{Outcome, Result, identify, plural, pool, simulate};
use crate::field::{Measurement, Status};
use crate::identify::{Case, first_order};
use crate::io::images::sha256;
use crate::io::joint::{JointInput, read_joint, read_table};
use crate::io::run_case::{RunCase, read_run_case};
use crate::io::series::Frame;
use crate::io::store::{STORE, Store};
use crate::mechanics::Joint;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::report::fit::{read_bands, read_law};
use crate::report::identification::IdentificationReport;
use crate::units::Px;
use clap::Parser;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Folder of the correlation in that of the run.
const CORRELATION: &str = "correlation";
/// What was done with which inputs.
const STEPS: &str = "steps.json";
const FIT: &str = "fit.json";
const REPORT: &str = "report.html";
/// What the parameters are when the rigid motion is treated the other way.
const RIGID_MOTION: &str = "rigid-motion.json";

/// The correlation of the run in `folder`.
pub(super) fn correlation_in(folder: &Path) -> PathBuf {
    folder.join(CORRELATION)
}

/// Runs the command.
pub(super) fn run(args: &RunArgs) -> Result<Outcome> {
    let done = of_case(args)?;
    if !args.quiet {
        eprintln!("report: {}", args.output.join(REPORT).display());
    }
    Ok(done)
}

/// Everything from the images of a case to its report.
pub(super) fn of_case(args: &RunArgs) -> Result<Outcome> {
    let case = read_run_case(&args.case)?;
    let say = |line: &str| {
        if !args.quiet {
            eprintln!("{line}");
        }
    };
    case.notes.iter().for_each(|note| say(note));
    let mut steps = Steps::open(&args.output, args.overwrite)?;
    let correlation = args.output.join(CORRELATION);

    let mut plan = Plan::of(&correlate_args(args, &correlation)?, &case.correlation)?;
    // The faces of the joint carry what is looked for, and the rest of the border is prescribed to the mechanics.
    plan.options.whole_borders = case.interface.zones.to_vec();
    let inputs = inputs_of(&plan)?;
    let complete = || {
        Store::open(&correlation).is_ok_and(|store| {
            (1..=store.n_frames()).all(|number| store.status(number).is_ok_and(|status| status.is_some()))
        })
    };
    if steps.done("correlation", &inputs) && complete() {
        say("correlation: done before with the same images and options, taken from there");
    } else {
        let existing = if steps.begin("correlation", &inputs)? { Existing::Continue } else { Existing::Replace };
        let begin = Instant::now();
        let folder = RunFolder::open(&correlation, true)?;
        let talk = if args.quiet { Talk::Quiet } else { Talk::Normal };
        run_series(&plan, &folder, pool(args.threads)?, Session { existing, ..Session::replacing(talk) })?;
        steps.note("correlation", &inputs, begin)?;
    }

    let text = case.joint_case(&format!("{CORRELATION}/{STORE}"), true);
    let text = if case.has_fit() { text } else { case.joint_case(&format!("{CORRELATION}/{STORE}"), false) };
    let (name, step) =
        if case.has_fit() { ("identify.toml", "identification") } else { ("simulate.toml", "simulation") };
    let joint_case = args.output.join(name);
    let inputs = sha256(format!("{}\n{inputs}\n{text}", env!("CARGO_PKG_VERSION")).as_bytes());
    let result = args.output.join(if case.has_fit() { FIT } else { "solution.csv" });
    // A fit of an earlier version has no bands to draw.
    let has_bands = || !case.has_fit() || read_bands(&args.output.join("traction-bands.csv")).is_ok();
    let outcome = if steps.done(step, &inputs) && result.exists() && has_bands() {
        say(&format!("{step}: done before with the same measurement and options, taken from there"));
        steps.outcome(step)
    } else {
        steps.forget(step)?;
        fs::write(&joint_case, &text)
            .map_err(|error| format!("{}: cannot be written: {error}", joint_case.display()))?;
        let begin = Instant::now();
        let outcome = mechanics(args, &joint_case, case.has_fit())?;
        steps.note_with(step, &inputs, begin, outcome)?;
        outcome
    };

    let page = report(args, &case, &joint_case, &steps)?;
    RunFolder::open(&args.output, true)?.write(REPORT, |out| std::io::Write::write_all(out, page.as_bytes()))?;
    let left_out = left_out(&correlation)?;
    if left_out > 0 {
        say(&format!("{} did not converge and are left out: see the report", plural(left_out, "frame")));
    }
    Ok(if left_out > 0 { Outcome::Incomplete } else { outcome })
}

/// The step from the measured displacements to the result: the fit, or the model with the given law when nothing is to
/// be found.
fn mechanics(args: &RunArgs, case: &Path, has_fit: bool) -> Result<Outcome> {
    let effect = args.output.join(RIGID_MOTION);
    // That of an earlier fit.
    let _ = fs::remove_file(&effect);
    if !has_fit {
        let (output, case) = (args.output.clone(), case.to_owned());
        return simulate::run(&SimulateArgs {
            case,
            output,
            overwrite: true,
            threads: args.threads,
            quiet: args.quiet,
        });
    }
    let input = read_joint(case)?;
    let pool = pool(args.threads)?;
    let (found, outcome) = identify::identify(&input, case, &args.output, true, &pool)?;
    if !args.quiet {
        identify::say(&found, &args.output);
    }
    let values: BTreeMap<&str, f64> = found.parameters.iter().map(|(&name, entry)| (name, entry.value)).collect();
    let other = pool.install(|| with_other_rigid_motion(&input, case, &values));
    let json = match other {
        Ok((removed, other)) => {
            json!({ "other_choice": if removed { "overall" } else { "none" }, "parameters": other })
        }
        Err(error) => json!({ "failed": super::chain(error.as_ref()) }),
    };
    fs::write(&effect, format!("{json:#}\n"))
        .map_err(|error| format!("{}: cannot be written: {error}", effect.display()))?;
    Ok(outcome)
}

/// The fit that ended at `found` if the rigid motion were removed where it was kept, and the other way round, to first order:
/// whether it is removed, and the parameters then.
fn with_other_rigid_motion(
    input: &JointInput,
    case: &Path,
    found: &BTreeMap<&str, f64>,
) -> Result<(bool, BTreeMap<String, f64>)> {
    let remove = input.case.boundary.remove_rigid_motion.as_deref() != Some("overall");
    let ends = [!remove, remove].map(|remove| -> Result<Vec<(String, f64)>> {
        let mut input = input.clone();
        input.case.boundary.remove_rigid_motion = Some(if remove { "overall" } else { "none" }.to_owned());
        let joint = Case::joint(&input)?;
        let case = Case::new(&joint, &input, case)?;
        let names: Vec<&str> = case.problem.unknowns.list().iter().map(|unknown| unknown.parameter.name).collect();
        let x: Vec<f64> = names.iter().map(|name| found[name]).collect();
        let end = first_order(&case.problem, case.options.weights, &x)?;
        Ok(names.into_iter().map(str::to_owned).zip(end).collect())
    });
    let [this, other] =
        [ends[0].as_ref(), ends[1].as_ref()].map(|end| end.map_err(|error| super::chain(error.as_ref())));
    let change =
        this?.iter().zip(other?).map(|((name, this), (_, other))| (name.clone(), found[name.as_str()] * other / this));
    Ok((remove, change.collect()))
}

/// Flags of the correlation that a run has too; all others have the values of the case file.
pub(super) fn correlate_args(args: &RunArgs, output: &Path) -> Result<CorrelateArgs> {
    let flags = ["quadrille", "correlate", "--output"].map(std::ffi::OsString::from);
    let flags = flags.into_iter().chain([output.as_os_str().to_owned()]);
    match Cli::try_parse_from(flags)?.command {
        Command::Correlate(parsed) => {
            Ok(CorrelateArgs { device: args.device.clone(), threads: args.threads, ..*parsed })
        }
        _ => Err("the flags of a run are not those of a correlation: this is a bug in quadrille".into()),
    }
}

/// One hash of all that the measurement depends on: version, options, images.
fn inputs_of(plan: &Plan) -> Result<String> {
    let files: Vec<&Frame> = plan.reference.iter().chain(&plan.deformed).collect();
    let mut hashes: BTreeMap<&Path, String> = BTreeMap::new();
    for frame in &files {
        if !hashes.contains_key(frame.path.as_path()) {
            // A file that cannot be read has no hash: the correlation says what is the matter.
            let hash = fs::read(&frame.path).map_or_else(|_| "unreadable".to_owned(), |bytes| sha256(&bytes));
            hashes.insert(&frame.path, hash);
        }
    }
    let images: Vec<String> = files.iter().map(|frame| format!("{frame} {}", hashes[frame.path.as_path()])).collect();
    let options = crate::io::case::write_case(&plan.resolved(0, 0));
    let about = format!("{} {:?} {}", env!("CARGO_PKG_VERSION"), plan.device, plan.isa.name());
    Ok(sha256(format!("{about}\n{options}\n{}", images.join("\n")).as_bytes()))
}

/// Frames of the correlation without a converged field.
fn left_out(correlation: &Path) -> Result<usize> {
    let store = Store::open(correlation)?;
    let mut n = 0;
    for number in 1..=store.n_frames() {
        n += usize::from(store.status(number)? != Some(Status::Converged));
    }
    Ok(n)
}

/// `steps.json`: which steps were done, with which inputs.
struct Steps {
    path: PathBuf,
    done: serde_json::Map<String, Value>,
}

impl Steps {
    /// The record in `folder`, which is made when it is not there. A folder with other results is refused unless `overwrite`,
    /// which also forgets all steps.
    fn open(folder: &Path, overwrite: bool) -> Result<Self> {
        let path = folder.join(STEPS);
        let text = fs::read_to_string(&path).ok();
        RunFolder::open(folder, overwrite || text.is_some())?;
        let read = text.filter(|_| !overwrite).and_then(|text| serde_json::from_str(&text).ok());
        let done = match read {
            Some(Value::Object(done)) => done,
            _ => serde_json::Map::new(),
        };
        let steps = Self { path, done };
        steps.write()?;
        Ok(steps)
    }

    fn write(&self) -> Result<()> {
        let text = format!("{:#}\n", Value::Object(self.done.clone()));
        Ok(fs::write(&self.path, text)
            .map_err(|error| format!("{}: cannot be written: {error}", self.path.display()))?)
    }

    fn done(&self, step: &str, inputs: &str) -> bool {
        self.done.get(step).is_some_and(|entry| entry["inputs"] == inputs)
    }

    fn forget(&mut self, step: &str) -> Result<()> {
        self.done.remove(step);
        self.write()
    }

    /// Notes that a step is begun, and tells whether it has been before with the same inputs: what is there of it is good.
    fn begin(&mut self, step: &str, inputs: &str) -> Result<bool> {
        let before = self.done.get(step).is_some_and(|entry| entry["inputs"] == inputs || entry["begun"] == inputs);
        self.done.insert(step.to_owned(), json!({ "begun": inputs }));
        self.write()?;
        Ok(before)
    }

    fn note(&mut self, step: &str, inputs: &str, begin: Instant) -> Result<()> {
        self.note_with(step, inputs, begin, Outcome::Fine)
    }

    fn note_with(&mut self, step: &str, inputs: &str, begin: Instant, outcome: Outcome) -> Result<()> {
        let entry = json!({
            "inputs": inputs,
            "seconds": begin.elapsed().as_secs_f64(),
            "complete": outcome == Outcome::Fine,
            "quadrille": env!("CARGO_PKG_VERSION"),
        });
        self.done.insert(step.to_owned(), entry);
        self.write()
    }

    /// What a step that was done came to.
    fn outcome(&self, step: &str) -> Outcome {
        let complete = self.done.get(step).is_some_and(|entry| entry["complete"] == true);
        if complete { Outcome::Fine } else { Outcome::Incomplete }
    }
}

pub(super) fn read_json(path: &Path) -> Result<Value> {
    let text = fs::read_to_string(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
    Ok(serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?)
}

/// The report, as HTML, from what the steps have written.
fn report(args: &RunArgs, case: &RunCase, joint_case: &Path, steps: &Steps) -> Result<String> {
    let folder = &args.output;
    let store = Store::open(folder.join(CORRELATION))?;
    let header = store.header();
    let pixel_size = header.pixel_size.ok_or("the correlation has no pixel size: this is a bug in quadrille")?;
    let correlation = read_json(&folder.join(CORRELATION).join("summary.json"))?;
    let mut frames: Vec<(usize, Measurement<Px>)> = Vec::new();
    for number in 1..=store.n_frames() {
        let field = store.frame(number)?.map(|frame| frame.measurement);
        frames.extend(field.filter(|field| field.status == Status::Converged).map(|field| (number, field)));
    }
    let page = super::record::Record::of(header).page();
    let file = header.reference.first().ok_or("the correlation names no reference image")?;
    let reference = Frame::named(file, page).read()?.image;
    let joint = Joint::new(&read_joint(joint_case)?)?;
    let found = case.has_fit().then(|| folder.join(FIT)).filter(|path| path.exists());
    let fit = found.map(|path| read_json(&path)).transpose()?;
    let law = identified(&*joint.law, fit.as_ref())?;
    let computed = fields(folder, &joint, frames.len())?;
    let bands = if fit.is_some() { read_bands(&folder.join("traction-bands.csv"))? } else { Vec::new() };
    let law_bands = fit.is_some().then(|| read_law(&folder.join("law.csv"))).transpose()?;
    let truth = args.case.parent().map(|folder| folder.join("truth.json")).filter(|path| path.exists());
    let truth = truth.map(|path| read_json(&path)).transpose()?;
    let mut provenance = vec![("quadrille".to_owned(), env!("CARGO_PKG_VERSION").to_owned())];
    provenance.push(("case file".into(), super::absolute(&args.case)));
    provenance.extend(fs::read(&args.case).ok().map(|bytes| ("SHA-256 of the case file".to_owned(), sha256(&bytes))));
    for (step, entry) in &steps.done {
        let seconds = entry["seconds"].as_f64().unwrap_or(0.0);
        let inputs = entry["inputs"].as_str().unwrap_or("");
        provenance.push((format!("step {step}"), format!("{seconds:.2} s; inputs {inputs}")));
    }
    let short =
        |path: &str| Path::new(path).file_name().map_or(path.to_owned(), |name| name.to_string_lossy().into_owned());
    let hashes = header.reference.iter().zip(&header.reference_sha256).map(|(file, hash)| (short(file), hash.clone()));
    provenance.extend(hashes);
    for number in 1..=store.n_frames() {
        if let Some(hash) = store.frame_sha256(number) {
            provenance.push((short(&header.frames[number - 1]), hash.to_owned()));
        }
    }
    let mut notes = case.notes.clone();
    notes.extend(joint.doubts.iter().cloned());
    let warnings = fit.as_ref().and_then(|fit| fit["warnings"].as_array()).into_iter().flatten();
    notes.extend(warnings.filter_map(|line| line.as_str().map(str::to_owned)));
    let mut seen = std::collections::BTreeSet::new();
    notes.retain(|note| seen.insert(note.clone()));
    let other = folder.join(RIGID_MOTION);
    let other = if other.exists() { Some(read_json(&other)?) } else { None };
    let report = IdentificationReport {
        case: args.case.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        reference: &reference,
        correlation: &correlation,
        pixel_size,
        element_px: header.element_size_px,
        thickness_mm: case.thickness_mm,
        frames: &frames,
        joint: &joint,
        law: &*law,
        computed: &computed,
        bands: &bands,
        law_bands: law_bands.as_ref(),
        fit: fit.as_ref(),
        truth: truth.as_ref().map(|truth| &truth["parameters"]),
        other_rigid_motion: other.as_ref(),
        notes,
        provenance,
    };
    Ok(report.page()?.html())
}

/// `law` with the values of `fit.json`.
fn identified(law: &dyn CohesiveLaw, fit: Option<&Value>) -> Result<Box<dyn CohesiveLaw>> {
    let values: Vec<f64> = (law.parameters().iter().zip(law.values()))
        .map(|(parameter, given)| {
            fit.and_then(|fit| fit["parameters"][parameter.name]["value"].as_f64()).unwrap_or(given)
        })
        .collect();
    Ok(law.with_values(&values)?)
}

/// Displacements by instant and node.
type Fields = Vec<Vec<[f64; 2]>>;

/// The computed displacements, from `solution.csv`.
fn fields(folder: &Path, joint: &Joint, n: usize) -> Result<Fields> {
    let n_nodes = joint.model.mesh().nodes().len();
    let n_instants = n.max(joint.boundary.instants().len());
    let path = folder.join("solution.csv");
    let (columns, rows) = read_table(&path)?;
    let at = ["ux_mm", "uy_mm"].map(|name| columns.iter().position(|column| column == name));
    let [Some(x), Some(y)] = at else { return Err(format!("{}: no columns ux_mm and uy_mm", path.display()).into()) };
    let mut fields: Fields = vec![Vec::new(); n_instants];
    for row in rows {
        let (instant, node) = (row[0] as usize, row[1] as usize);
        if let Some(field) = instant.checked_sub(1).and_then(|k| fields.get_mut(k)).filter(|_| node < n_nodes) {
            field.resize(n_nodes, [0.0; 2]);
            field[node] = [row[x], row[y]];
        }
    }
    Ok(fields)
}
