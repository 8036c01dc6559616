//! Zones that were found by their texture are parted by motion: what stays still beside the specimen is a zone of its own.

use crate::correlate::{Correlate, StillGround};
use crate::imaging::Image;
use crate::io::case::parse_case;
use crate::io::store::Store;
use crate::run::plan::Plan;
use crate::run::plan::found::Found;
use crate::run::words::Result;
use std::iter::successors;
use std::path::Path;
use std::sync::Arc;

/// Frames are looked at until one shows that something moves: the first, and each this many times as far into the test.
const EVERY: usize = 4;
/// Something moves when a measured node does so by more than this, px.
const MOVES_PX: f64 = 2.0;

/// What becomes of the zones `found`, and their mesh on `correlator`, once it is known what of them moves; `None` where
/// all of it does or nothing is known. A run that goes on has the zones of `there`.
pub(crate) fn part(
    plan: &Plan,
    (there, folder): (Option<&Store>, &Path),
    found: &Found,
    reference: &Image,
    correlator: &dyn Correlate,
) -> Result<Option<Found>> {
    let before = there.and_then(|there| parse_case(&there.header().case, Path::new("run.toml")).ok());
    if before.is_some_and(|before| before.zones.len() == found.cases.len()) || !plan.drawn.cracks.is_empty() {
        return Ok(None);
    }
    // Always the same frames, also of a series that has grown.
    for number in successors(Some(1), |number| Some(number * EVERY)) {
        let Some(frame) = plan.deformed.get(number - 1) else { break };
        let Ok(loaded) = frame.read(plan.accepted.of_size(reference.width(), reference.height())) else { continue };
        let image = Arc::new(loaded.image);
        let field = correlator.upload(Arc::clone(&image)).and_then(|image| correlator.correlate_uploaded(image, None));
        let Some(field) = field.ok().map(|found| found.measurement).filter(|field| field.status.has_field()) else {
            continue;
        };
        if let Some(ground) = StillGround::find(&field, [reference, &image]) {
            return found.part(&ground, &field.mesh, reference, plan, folder).map(Some);
        }
        let moves = |(u, measured): (&[f64; 2], &bool)| *measured && u[0].hypot(u[1]) > MOVES_PX;
        if field.displacement.iter().zip(&field.measured).any(moves) {
            break;
        }
    }
    Ok(None)
}
