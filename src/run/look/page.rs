//! The report of a run, from what its steps have written.

use crate::camera::Rectifier;
use crate::field::{Measurement, Status};
use crate::imaging::Image;
use crate::io::images::{Accepted, sha256};
use crate::io::joint::read_joint;
use crate::io::run_case::RunCase;
use crate::io::series::Frame;
use crate::io::store::Store;
use crate::mechanics::Joint;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::remark::Remark;
use crate::report::fit::{FitRecord, read_bands, read_law};
use crate::report::identification::{IdentificationReport, OtherRigidMotion};
use crate::report::page::Page;
use crate::report::summary::Summary;
use crate::report::tournament::{TournamentRecord, TournamentReport};
use crate::report::{Backdrop, ReducedTest};
use crate::run::folder::read::{fields, frames_that, read_json};
use crate::run::folder::record::Record;
use crate::run::folder::steps::Steps;
use crate::run::folder::{RIGID_MOTION, TOURNAMENT, TOURNAMENT_TRACTIONS, correlation_in};
use crate::run::joint::FIT;
use crate::run::look::explore::Explored;
use crate::run::look::{FitOfRun, Off, off_at};
use crate::run::words::remarks::zones_matched;
use crate::run::words::{Result, RunError, absolute, chain, file_name};
use crate::units::Px;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// What `truth.json` of a virtual test says of the parameters.
#[derive(Deserialize)]
struct Truth {
    parameters: BTreeMap<String, f64>,
}

/// The report, as HTML, from what the steps have written; and why the fields cannot be looked around in, where it is
/// so.
pub(crate) fn page(
    file: &Path,
    folder: &Path,
    case: &RunCase,
    joint_case: &Path,
    steps: &Steps,
    reduced: Option<&ReducedTest>,
) -> Result<(String, Option<RunError>)> {
    let correlation_folder = correlation_in(folder);
    let store = Store::open(&correlation_folder)?;
    let header = store.header();
    let pixel_size = header.pixel_size.ok_or(RunError::Bug("the correlation has no pixel size"))?;
    let camera = Rectifier::new(header.camera()?, store.mesh())?;
    let correlation: Summary = read_json(&correlation_folder.join("summary.json"))?;
    let mut frames: Vec<(usize, Measurement<Px>)> = Vec::new();
    for number in 1..=store.n_frames() {
        let field = store.frame(number)?.map(|frame| camera.displaced(&frame.measurement));
        frames.extend(field.filter(|field| field.status == Status::Converged).map(|field| (number, field)));
    }
    let page = Record::of(header).page();
    let reference = header.reference.first().ok_or("the correlation names no reference image")?;
    let reference = Frame::named(reference, page).read(Accepted::ANY)?.image;
    let joint = Joint::new(&read_joint(joint_case)?)?;
    let found = case.has_fit().then(|| folder.join(FIT)).filter(|path| path.exists());
    let fit: Option<FitRecord> = found.map(|path| read_json(&path)).transpose()?;
    let law = law_of_fit(&*joint.law, fit.as_ref())?;
    let computed = fields(folder, &joint, frames.len())?;
    let bands = if fit.is_some() { read_bands(&folder.join("traction-bands.csv"))? } else { Vec::new() };
    let law_bands = fit.is_some().then(|| read_law(&folder.join("law.csv"))).transpose()?;
    let truth = file.parent().map(|folder| folder.join("truth.json")).filter(|path| path.exists());
    let truth: Option<Truth> = truth.map(|path| read_json(&path)).transpose()?;
    let mut provenance = vec![("quadrille".to_owned(), env!("CARGO_PKG_VERSION").to_owned())];
    provenance.push(("case file".into(), absolute(file)));
    provenance.extend(fs::read(file).ok().map(|bytes| ("SHA-256 of the case file".to_owned(), sha256(&bytes))));
    for (step, entry) in &steps.done {
        let (seconds, inputs) = (entry.seconds.unwrap_or(0.0), entry.inputs.as_deref().unwrap_or(""));
        provenance.push((format!("step {step}"), format!("{seconds:.2} s; inputs {inputs}")));
    }
    let hashes =
        header.reference.iter().zip(&header.reference_sha256).map(|(file, hash)| (file_name(file), hash.clone()));
    provenance.extend(hashes);
    for number in 1..=store.n_frames() {
        let of_frame = header.frames.get(number - 1).zip(store.frame_sha256(number));
        provenance.extend(of_frame.map(|(file, hash)| (file_name(file), hash.to_owned())));
    }
    let mut remarks: Vec<Remark> = case.notes.iter().map(|note| zones_matched(note)).collect();
    for remark in joint.remarks.iter().chain(fit.iter().flat_map(|fit| &fit.remarks)) {
        if !remarks.contains(remark) {
            remarks.push(remark.clone());
        }
    }
    let laws = if fit.is_some() { laws(folder, case)? } else { None };
    let other = folder.join(RIGID_MOTION);
    let other: Option<OtherRigidMotion> = if other.exists() { Some(read_json(&other)?) } else { None };
    let report = IdentificationReport {
        case: file_name(file),
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
        laws: laws.as_ref(),
        truth: truth.as_ref().map(|truth| &truth.parameters),
        other_rigid_motion: other.as_ref(),
        remarks,
        provenance,
    };
    let mut page = report.page()?;
    if let Some(reduced) = reduced {
        // Behind the result and how far to trust it.
        let at = page.sections.len().min(2);
        page.sections.insert(at, reduced.section(fit.as_ref().map(|_| &*law))?);
    }
    let fault = look_around(&mut page, folder, &store, &reference, &joint, &frames, &computed).err();
    Ok((page.html(), fault))
}

/// Puts the fields to look around in into `page`, with the fit of the run in `folder`.
fn look_around(
    page: &mut Page,
    folder: &Path,
    store: &Store,
    reference: &Image,
    joint: &Joint,
    frames: &[(usize, Measurement<Px>)],
    computed: &[Vec<[f64; 2]>],
) -> Result<()> {
    let numbers = frames_that(|status| status.is_some_and(Status::has_field), store)?;
    let (fit, fault) = match FitOfRun::read(folder) {
        Ok(fit) => (fit, None),
        Err(error) => (None, Some(chain(&error))),
    };
    let mut model = Off::new();
    if let Some(pixel_size) = store.header().pixel_size.filter(|_| fit.is_some()) {
        for (at, ((number, field), computed)) in frames.iter().zip(computed).enumerate() {
            model.extend(off_at(joint, pixel_size, at, computed, field).map(|off| (*number, off)));
        }
    }
    let explored = Explored {
        folder: &correlation_in(folder),
        store,
        numbers: &numbers,
        reference: &Backdrop::new(reference, 1),
        faults: fault.into_iter().collect(),
        fit: fit.as_ref(),
        model: (!model.is_empty()).then_some(&model),
    };
    explored.put_into(page)
}

/// What the comparison of laws left that `case` asks for; none where its fit was cut short.
fn laws(folder: &Path, case: &RunCase) -> Result<Option<TournamentReport>> {
    let compared = folder.join(TOURNAMENT);
    if case.joint.fit.iter().all(|fit| fit.laws.is_empty()) || !compared.exists() {
        return Ok(None);
    }
    let record: TournamentRecord = read_json(&compared)?;
    Ok(Some(TournamentReport::read(record, &folder.join(TOURNAMENT_TRACTIONS))?))
}

/// `law` with the values of `fit.json`.
fn law_of_fit(law: &dyn CohesiveLaw, fit: Option<&FitRecord>) -> Result<Box<dyn CohesiveLaw>> {
    let values: Vec<f64> = (law.parameters().iter().zip(law.values()))
        .map(|(parameter, given)| {
            fit.and_then(|fit| fit.parameters.get(parameter.name)).map_or(given, |found| found.value)
        })
        .collect();
    Ok(law.with_values(&values)?)
}
