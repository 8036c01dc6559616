//! Zones that were found by their texture are parted by motion: bodies that move apart are zones of their own, and so is
//! what stays still beside them.

use crate::correlate::{Apart, Correlate};
use crate::imaging::Image;
use crate::io::case::parse_case;
use crate::io::store::Store;
use crate::run::look::frame::look_at;
use crate::run::plan::Plan;
use crate::run::plan::found::Found;
use crate::run::words::Result;
use std::iter::successors;
use std::path::Path;

/// Frames are looked at until one shows that something moves: the first, and each this many times as far into the test.
const EVERY: usize = 4;
/// Something moves when more than this share of the measured nodes does so by more than `MOVES_PX`: single nodes in noise
/// may be anywhere.
const MOVING: f64 = 0.05;
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
    let numbers = successors(Some(1), |number| Some(number * EVERY));
    for number in numbers.take_while(|&number| number <= plan.deformed.len()) {
        let Some((image, field)) = look_at(plan, number, reference, correlator) else { continue };
        match Apart::find(&field, [reference, &image]) {
            Apart::Bodies(bodies) => return found.part(&bodies, &field.mesh, reference, plan, folder).map(Some),
            Apart::NotYet => continue,
            Apart::One => {}
        }
        let measured = field.displacement.iter().zip(&field.measured).filter(|(_, measured)| **measured);
        let moving = measured.clone().filter(|(u, _)| u[0].hypot(u[1]) > MOVES_PX).count();
        if moving as f64 > MOVING * measured.count() as f64 {
            break;
        }
    }
    Ok(None)
}
