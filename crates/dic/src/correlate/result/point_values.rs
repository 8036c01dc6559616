//! Values at points beside the coefficients of a frame (THEORY 17).

use crate::correlate::{Correlation, Options, Regularisation, noise_of_values};
use crate::field::{Elements, PointFilter, PointFilters};
use crate::mesh::Mesh;
use crate::units::Px;

/// What makes values at points of the fields of one reference.
pub(crate) struct PointValuesOf {
    filters: PointFilters,
    /// Coefficients of regularised fields stay as they are.
    is_regularised: bool,
    /// Of splines, the uncertainty of a value at each node over that of its coefficient.
    of_splines: Option<Vec<f64>>,
}

impl PointValuesOf {
    pub fn new(options: &Options, mesh: &Mesh<Px>) -> Self {
        let is_regularised = options.regularisation != Regularisation::None;
        let of_splines = (options.elements == Elements::CubicSpline).then(|| noise_of_values(mesh));
        Self { filters: PointFilters::default(), is_regularised, of_splines }
    }

    /// The frame with them, where it has a field.
    pub fn add_to(&self, mut found: Correlation) -> Correlation {
        let field = &mut found.measurement;
        field.points = field.status.has_field().then(|| match self.is_regularised {
            true => PointFilter::none().of(field),
            false => self.filters.for_field(field).of(field),
        });
        if let (Some(points), Some(factors)) = (&mut field.points, &self.of_splines) {
            let of_node = |((of_value, of_coefficient), factor): ((&mut [f64; 2], &[f64; 2]), &f64)| {
                *of_value = of_coefficient.map(|sigma| factor * sigma);
            };
            points.sigma.iter_mut().zip(&field.sigma).zip(factors).for_each(of_node);
        }
        found
    }
}
