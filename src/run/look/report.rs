//! The report of a series, from its store and its summary.

use crate::field::Status;
use crate::imaging::Image;
use crate::io::case::{CaseFile, parse_case};
use crate::io::quantities::QuantitySummary;
use crate::io::store::Store;
use crate::report::Backdrop;
use crate::report::correlation::{CorrelationReport, DrawnFrame, SAMPLED, SeriesPoint, choose_frames, spread};
use crate::report::summary::Summary;
use crate::run::folder::RunFolder;
use crate::run::look::explore::Explored;
use crate::run::plan::Plan;
use crate::run::words::{Result, RunError, absolute};
use std::io::Write;
use std::path::Path;

/// Writes `report.html`. What it reads and draws is bounded, however long the series is. Returns why the fields cannot
/// be looked around in, where it is so.
pub(crate) fn write(
    folder: &RunFolder,
    plan: &Plan,
    summary: &Summary,
    reference: &Image,
    quantities: &QuantitySummary,
) -> Result<Option<RunError>> {
    let store = Store::open(folder.path())?;
    let header = store.header();
    // What is said of the test may be said anew.
    let case = CaseFile { report: plan.setup.clone(), ..parse_case(&header.case, Path::new("run.toml"))? };
    let of = |takes: &dyn Fn(Status) -> bool| -> Vec<usize> {
        summary.frames.iter().filter(|frame| takes(frame.status)).map(|frame| frame.number).collect()
    };
    let with_field = of(&Status::has_field);
    let converged = of(&Status::is_measured);
    let shown = if converged.is_empty() { &with_field } else { &converged };
    let lost = |number| RunError::RecordLost { number, remedy: "run the same command again" };
    let read = |number: usize| -> Result<DrawnFrame> {
        let (frame, strain) = store.frame(number)?.zip(store.strain(number)?).ok_or_else(|| lost(number))?;
        Ok(DrawnFrame { number, field: frame.measurement, strain })
    };
    let drawn = choose_frames(shown.len())
        .into_iter()
        .filter_map(|k| shown.get(k))
        .map(|&number| read(number))
        .collect::<Result<Vec<_>>>()?;
    let mut sampled = Vec::new();
    for &number in spread(with_field.len(), SAMPLED).into_iter().filter_map(|k| with_field.get(k)) {
        let frame = read(number)?;
        sampled.extend(SeriesPoint::new(frame.number, &frame.field, &frame.strain));
    }
    let mut provenance = vec![
        ("quadrille".to_owned(), header.quadrille.clone()),
        ("results".to_owned(), absolute(folder.path())),
        ("tables of the fields".to_owned(), "fields.zarr; csv/ and vtu/ where they were asked for".to_owned()),
    ];
    for (file, sha256) in header.reference.iter().zip(&header.reference_sha256) {
        provenance.push((file.clone(), format!("SHA-256 {sha256}")));
    }
    provenance.push(("SHA-256 of the deformed images".to_owned(), "in run.toml, a line each".to_owned()));
    let reference = &Backdrop::new(reference, 1);
    let (faults, fit, model) = (Vec::new(), None, None);
    let explored =
        Explored { folder: folder.path(), store: &store, numbers: &with_field, reference, faults, fit, model };
    let report = CorrelationReport {
        summary,
        case: &case,
        reference,
        pixel_size: header.pixel_size,
        element_px: header.element_size_px,
        drawn: &drawn,
        sampled: &sampled,
        quantities,
        provenance,
    };
    let mut page = report.page()?;
    let fault = explored.put_into(&mut page).err();
    let page = page.html();
    folder.write(RunFolder::REPORT, |out| out.write_all(page.as_bytes()))?;
    Ok(fault)
}
