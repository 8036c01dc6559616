//! A frame that is looked at before the series begins.

use crate::correlate::Correlate;
use crate::field::Measurement;
use crate::imaging::Image;
use crate::run::plan::Plan;
use crate::units::Px;
use std::sync::Arc;

/// Image `number` of the series of `plan` and its field, searched for without the frames before; `None` where one of
/// them is not there.
pub(crate) fn look_at(
    plan: &Plan,
    number: usize,
    reference: &Image,
    correlator: &dyn Correlate,
) -> Option<(Arc<Image>, Measurement<Px>)> {
    let frame = plan.deformed.get(number.checked_sub(1)?)?;
    let loaded = frame.read(plan.accepted.of_size(reference.width(), reference.height())).ok()?;
    let image = Arc::new(loaded.image);
    let found = correlator.correlate_uploaded(correlator.upload(Arc::clone(&image)).ok()?, None).ok()?;
    Some((image, found.measurement)).filter(|(_, field)| field.status.has_field())
}
