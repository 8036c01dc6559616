//! The store of a run: what it says of itself, made or found.

use crate::correlate::Correlate;
use crate::io::store::{STORE, Store, StoreHeader, StoreWriter};
use crate::run::folder::RunFolder;
use crate::run::folder::restart::is_moved;
use crate::run::frames::element_size_px;
use crate::run::plan::Plan;
use crate::run::plan::run_toml::RunToml;
use crate::run::words::Result;

/// The store of a run, made, or found and told of frames that have come since, when it is of the `same_run`.
pub(crate) fn make_or_find(
    folder: &RunFolder,
    header: &StoreHeader,
    correlator: &dyn Correlate,
    same_run: impl Fn(&Store) -> Result<()>,
) -> Result<(StoreWriter, Store)> {
    let writer = StoreWriter::create_or_open(&folder.path().join(STORE), header)?;
    let mut store = Store::open(writer.path())?;
    same_run(&store)?; // another shard may have made it in the meantime
    if is_moved(store.header(), header) {
        writer.rename_files(header)?;
        store = Store::open(writer.path())?;
    }
    if store.n_frames() < header.frames.len() {
        writer.extend(header.frames.iter().skip(store.n_frames()).cloned(), header.case.clone())?;
        store = Store::open(writer.path())?;
    }
    // Each by itself: a start that was stopped may have left one of them, or half of one.
    let has_matrices = store.normal_matrices().is_ok_and(|there| there.is_some());
    let has_noise = store.gradient_noise().is_ok_and(|there| there.is_some());
    if let (false, Some(matrices)) = (has_matrices && has_noise, correlator.normal_matrices()) {
        writer.write_normal_matrices(&matrices)?;
        writer.write_gradient_noise(&correlator.gradient_noise())?;
    }
    if let Some(penalty) = correlator.penalty()
        && !store.penalty().is_ok_and(|there| there.is_some())
    {
        writer.write_penalty(penalty)?;
    }
    Ok((writer, store))
}

/// What the store says of itself.
pub(crate) fn header_of(
    plan: &Plan,
    correlator: &dyn Correlate,
    record: &RunToml,
    reference_sha256: Vec<String>,
    image_size_px: [usize; 2],
) -> StoreHeader {
    StoreHeader {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.device().to_owned(),
        mesh: correlator.mesh().clone(),
        image_size_px,
        reference: plan.reference.iter().map(ToString::to_string).collect(),
        reference_sha256,
        frames: plan.deformed.iter().map(ToString::to_string).collect(),
        pixel_size: plan.pixel_size,
        range_grey: correlator.grey_range(),
        element_size_px: element_size_px(correlator.mesh(), plan.options.element_size),
        strain: plan.strain,
        strain_window: plan.strain_window,
        case: record.without_images(),
    }
}
