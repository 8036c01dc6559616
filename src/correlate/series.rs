//! Starts along a series.

use super::chosen::Correlate;
use super::correlation::Correlation;
use super::error::CorrelationError;
use super::start::Start;
use crate::backend::GreyTransfer;
use crate::field::{StartFrom, Status};
use crate::imaging::Image;
use std::sync::Arc;

/// The last converged frames of a series, from which the next one is predicted.
#[derive(Debug, Clone)]
pub struct History {
    start: StartFrom,
    /// Fields, the latest first, with their frame numbers.
    fields: Vec<(usize, Vec<[f64; 2]>)>,
    transfer: Vec<GreyTransfer>,
}

impl History {
    /// Fields that a prediction is made of.
    pub const FIELDS: usize = 2;

    /// A history that knows no frame yet; with [`StartFrom::Independent`] nothing is ever predicted.
    pub fn new(start: StartFrom) -> Self {
        Self { start, fields: Vec::new(), transfer: Vec::new() }
    }

    /// The history that knows these fields, the latest first, and the transfer of the latest.
    pub(super) fn of(start: StartFrom, fields: Vec<(usize, Vec<[f64; 2]>)>, transfer: Vec<GreyTransfer>) -> Self {
        Self { start, fields, transfer }
    }

    /// The fields it knows, the latest first, with their frame numbers.
    pub(super) fn fields(&self) -> &[(usize, Vec<[f64; 2]>)] {
        &self.fields
    }

    /// Linear extrapolation of the last two converged fields to frame `number`, or the last one.
    pub fn predict(&self, number: usize) -> Option<Start> {
        if self.start == StartFrom::Independent {
            return None;
        }
        let (last_number, last) = self.fields.first()?;
        let displacement = match self.fields.get(1) {
            None => last.clone(),
            Some((before_number, before)) => {
                let ahead = number.saturating_sub(*last_number) as f64 / (last_number - before_number) as f64;
                let extrapolate =
                    |(a, b): (&[f64; 2], &[f64; 2])| std::array::from_fn(|c| a[c] + ahead * (a[c] - b[c]));
                last.iter().zip(before).map(extrapolate).collect()
            }
        };
        Some(Start { displacement, transfer: self.transfer.clone() })
    }

    /// Remembers frame `number` (numbers must rise), if it converged.
    pub fn note(&mut self, number: usize, correlation: &Correlation) {
        if correlation.measurement.status == Status::Converged {
            let transfer = correlation.zones.iter().map(|zone| zone.transfer).collect();
            self.note_field(number, Start { displacement: correlation.full_displacement.clone(), transfer });
        }
    }

    /// Remembers the field of frame `number` (numbers must rise), which converged: of one that was done before.
    pub fn note_field(&mut self, number: usize, Start { displacement, transfer }: Start) {
        self.transfer = transfer;
        self.fields.insert(0, (number, displacement));
        self.fields.truncate(Self::FIELDS);
    }
}

/// Correlates the frames of a series one after the other, each starting from the extrapolation of those
/// before it.
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
    /// When the image has another size than the reference, or the device fails. A frame that does not
    /// converge is a result, not an error.
    pub fn correlate(&mut self, number: usize, image: Arc<Image>) -> Result<Correlation, CorrelationError> {
        let start = self.history.predict(number);
        let correlation = self.correlator.correlate_uploaded(self.correlator.upload(image)?, start.as_ref())?;
        self.history.note(number, &correlation);
        Ok(correlation)
    }
}
