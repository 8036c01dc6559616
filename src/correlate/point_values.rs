//! Values at points beside the coefficients of a frame (THEORY 17).

use super::correlation::Correlation;
use crate::field::{PointFilter, PointFilters};

/// What makes values at points of the fields of one reference.
#[derive(Debug)]
pub(super) struct PointValuesOf {
    filters: PointFilters,
    /// Coefficients of regularised fields stay as they are.
    is_regularised: bool,
}

impl PointValuesOf {
    pub fn new(is_regularised: bool) -> Self {
        Self { filters: PointFilters::default(), is_regularised }
    }

    /// The frame with them, where it has a field.
    pub fn given(&self, mut found: Correlation) -> Correlation {
        let field = &mut found.measurement;
        field.points = field.status.has_field().then(|| match self.is_regularised {
            true => PointFilter::none().of(field),
            false => self.filters.for_field(field).of(field),
        });
        found
    }
}
