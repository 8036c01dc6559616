//! Starts along a series.

use crate::backend::GreyTransfer;
use crate::correlate::{Correlate, Correlation, Result, Start};
use crate::field::{RigidMotion, StartFrom};
use crate::imaging::Image;
use crate::mesh::Mesh;
use crate::units::Px;
use std::sync::Arc;

/// The last converged frames of a series, from which the next one is predicted.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    start: StartFrom,
    /// Fields, the latest first, with their frame numbers; shared by what is known after one frame and the next.
    fields: Vec<(usize, Arc<Vec<[f64; 2]>>)>,
    transfer: Vec<GreyTransfer>,
    /// The elements that the latest was found without.
    left_out: Vec<u32>,
}

/// Every so many frames one begins with all elements again: those that are left out come back where they match at the
/// place where the field around them puts them, and this place may be too far off.
const WITH_ALL: usize = 10;

impl History {
    /// Fields that a prediction is made of.
    pub const FIELDS: usize = 2;

    /// A history that knows no frame yet; with [`StartFrom::Independent`] nothing is ever predicted.
    pub fn new(start: StartFrom) -> Self {
        Self::of(start, Vec::new(), Vec::new())
    }

    /// The history that knows these fields, the latest first, and the transfer of the latest; all elements matched.
    pub(crate) fn of(start: StartFrom, fields: Vec<(usize, Vec<[f64; 2]>)>, transfer: Vec<GreyTransfer>) -> Self {
        let fields = fields.into_iter().map(|(number, field)| (number, Arc::new(field))).collect();
        Self { start, fields, transfer, left_out: Vec::new() }
    }

    /// The fields it knows, the latest first, with their frame numbers.
    pub(crate) fn fields(&self) -> &[(usize, Arc<Vec<[f64; 2]>>)] {
        &self.fields
    }

    /// What the last two converged frames, or the last one, say of frame `number`; `mesh` is that of their fields.
    ///
    /// Each zone goes on to turn as a whole, else linearly: on a straight line a turn by w would be w^2 r off at
    /// distance r.
    pub fn predict(&self, number: usize, mesh: &Mesh<Px>) -> Option<Start> {
        if self.start == StartFrom::Independent {
            return None;
        }
        let (last_number, last) = self.fields.first()?;
        let mut displacement = last.to_vec();
        if let Some((before_number, before)) = self.fields.get(1) {
            let ahead = number.saturating_sub(*last_number) as f64 / (last_number - before_number) as f64;
            for zone in 0..mesh.zones().len() {
                let nodes = mesh.zone_nodes(zone);
                let points = mesh.nodes()[nodes.clone()].iter().zip(&before[nodes.clone()]).zip(&last[nodes.clone()]);
                let steps = points
                    .map(|((x, before), last)| ([0, 1].map(|k| x[k] + before[k]), [0, 1].map(|k| last[k] - before[k])));
                let Some(motion) = RigidMotion::fit(steps.clone()) else { continue };
                let turn = RigidMotion { translation: [0.0; 2], rotation_rad: ahead * motion.rotation_rad, ..motion };
                let (rigid_at, turned_at) = (motion.field(), turn.field());
                for (displacement, (x, step)) in displacement[nodes].iter_mut().zip(steps) {
                    // From the middle of the zone after the step: the place, and what of its step is no rigid motion.
                    let rigid = rigid_at(x);
                    let rest = [0, 1].map(|k| step[k] - rigid[k]);
                    let place = [0, 1].map(|k| x[k] + step[k] - motion.translation[k] + ahead * rest[k]);
                    let turned = turned_at(place);
                    (0..2).for_each(|k| displacement[k] += ahead * (motion.translation[k] + rest[k]) + turned[k]);
                }
            }
        }
        let left_out = if number.is_multiple_of(WITH_ALL) { Vec::new() } else { self.left_out.clone() };
        Some(Start { displacement, transfer: self.transfer.clone(), left_out })
    }

    /// Remembers frame `number` (numbers must rise), if it converged.
    pub fn note(&mut self, number: usize, correlation: &Correlation) {
        correlation.next_start().into_iter().for_each(|start| self.note_field(number, start));
    }

    /// Remembers the field of frame `number` (numbers must rise), which converged: of one that was done before.
    pub fn note_field(&mut self, number: usize, Start { displacement, transfer, left_out }: Start) {
        (self.transfer, self.left_out) = (transfer, left_out);
        self.fields.insert(0, (number, Arc::new(displacement)));
        self.fields.truncate(Self::FIELDS);
    }
}

/// Correlates the frames of a series one after the other, each starting from the extrapolation of those before it.
pub struct Tracker<'a> {
    correlator: &'a dyn Correlate,
    history: History,
}

impl<'a> Tracker<'a> {
    /// A tracker that knows no frame yet.
    pub fn new(correlator: &'a dyn Correlate) -> Self {
        Self { correlator, history: History::new(correlator.options().start) }
    }

    /// What it correlates with.
    pub fn correlator(&self) -> &'a dyn Correlate {
        self.correlator
    }

    /// Correlates frame `number` (numbers must rise). With [`StartFrom::Independent`] nothing is remembered.
    ///
    /// # Errors
    /// Another size than the reference, a device that fails. Not converging is a result.
    pub fn correlate(&mut self, number: usize, image: Arc<Image>) -> Result<Correlation> {
        let start = self.history.predict(number, self.correlator.mesh());
        let correlation = self.correlator.correlate_uploaded(self.correlator.upload(image)?, start.as_ref())?;
        self.history.note(number, &correlation);
        Ok(correlation)
    }
}
