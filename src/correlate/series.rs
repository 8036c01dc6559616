//! Starts along a series.

use super::correlator::{Correlation, Correlator};
use super::error::CorrelationError;
use crate::backend::{Backend, GreyTransfer};
use crate::field::{StartFrom, Status};
use crate::imaging::Image;
use std::sync::Arc;

/// Correlates the frames of a series one after the other, each starting from the extrapolation of those
/// before it.
pub struct Tracker<'a, B: Backend> {
    correlator: &'a Correlator<B>,
    /// Fields of the last converged frames, the latest first, with their frame numbers.
    history: Vec<(usize, Vec<[f64; 2]>)>,
    transfer: Vec<GreyTransfer>,
}

impl<'a, B: Backend> Tracker<'a, B> {
    /// A tracker that knows no frame yet.
    pub fn new(correlator: &'a Correlator<B>) -> Self {
        Self { correlator, history: Vec::new(), transfer: Vec::new() }
    }

    /// What it correlates with.
    pub fn correlator(&self) -> &'a Correlator<B> {
        self.correlator
    }

    /// Correlates frame `number` (numbers must rise). With [`StartFrom::Cold`] nothing is remembered.
    ///
    /// # Errors
    /// When the image has another size than the reference, or the device fails. A frame that does not
    /// converge is a result, not an error.
    pub fn correlate(&mut self, number: usize, image: Arc<Image>) -> Result<Correlation, CorrelationError> {
        let start = self.predict(number).map(|u| (u, self.transfer.as_slice()));
        let correlation = self.correlator.correlate(image, start)?;
        if correlation.measurement.status == Status::Converged {
            self.transfer = correlation.zones.iter().map(|zone| zone.transfer).collect();
            self.history.insert(0, (number, correlation.full_displacement.clone()));
            self.history.truncate(2);
        }
        Ok(correlation)
    }

    /// Linear extrapolation of the last two converged fields, or the last one.
    fn predict(&self, number: usize) -> Option<Vec<[f64; 2]>> {
        if self.correlator.options().start == StartFrom::Cold {
            return None;
        }
        let (last_number, last) = self.history.first()?;
        let Some((before_number, before)) = self.history.get(1) else { return Some(last.clone()) };
        let ahead = number.saturating_sub(*last_number) as f64 / (last_number - before_number) as f64;
        let extrapolate = |(a, b): (&[f64; 2], &[f64; 2])| std::array::from_fn(|c| a[c] + ahead * (a[c] - b[c]));
        Some(last.iter().zip(before).map(extrapolate).collect())
    }
}
