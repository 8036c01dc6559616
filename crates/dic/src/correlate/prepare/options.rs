//! Choices of a correlation.

use crate::correlate::{CorrelationError, KNOT_ELEMENTS, Regularisation, Result};
use crate::field::{Brightness, Elements, Noise, NoiseCorrelation, StartFrom};
use crate::imaging::Interpolation;
use crate::linalg::SolverChoice;
use std::fmt::Display;

/// Choices of a correlation; the defaults suit a first try.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Element size, px (4..=128); of cubic splines the distance of the knots.
    pub element_size: usize,
    /// What the displacement is between the nodes.
    pub elements: Elements,
    /// Share of their pixels, 0..=1, that elements need inside their zone; rectangles hold whole elements.
    pub element_share: f64,
    /// Interpolation of the deformed image.
    pub interpolation: Interpolation,
    /// Largest error left at a node, by the corrections, of a frame that converged, px (docs/correlation.md, 2.2).
    pub tolerance_px: f64,
    /// The same as a share of the smallest standard uncertainty of a node: the larger counts (THEORY 10); 0 for none.
    pub tolerance_by_sigma: f64,
    /// Gauss-Newton iterations on the finest level after which a frame is given up.
    pub max_iterations: usize,
    /// How brightness and contrast are followed.
    pub brightness: Brightness,
    /// Where frames of a series start.
    pub start: StartFrom,
    /// The noise of one image.
    pub noise: Noise,
    /// What becomes of noise that is correlated from pixel to pixel.
    pub noise_correlation: NoiseCorrelation,
    /// How many images the reference is the mean of: its noise is less by the square root of that.
    pub n_references: usize,
    /// Leave nodes without texture out, however many, instead of refusing the reference.
    pub drop_textureless: bool,
    /// Share of the nodes of a zone, 0..=1, left out for want of texture unasked; more refuse the reference.
    pub textureless_share: f64,
    /// Standard uncertainty, px, above which a node of the reference is not measured but left out.
    pub sigma_most_px: f64,
    /// Zones of whose border no node is left out so, such as those whose edges are the faces of a joint.
    pub whole_borders: Vec<String>,
    /// What holds the displacement beside the images.
    pub regularisation: Regularisation,
    /// Solver of the normal equations; with regularisation always the direct one.
    pub solver: SolverChoice,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            element_size: 16,
            elements: Elements::default(),
            element_share: crate::mesh::ELEMENT_SHARE,
            interpolation: Interpolation::default(),
            tolerance_px: 1e-4,
            tolerance_by_sigma: 0.01,
            max_iterations: 50,
            brightness: Brightness::default(),
            start: StartFrom::default(),
            noise: Noise::default(),
            noise_correlation: NoiseCorrelation::default(),
            n_references: 1,
            drop_textureless: false,
            textureless_share: 0.2,
            sigma_most_px: 0.5,
            whole_borders: Vec::new(),
            regularisation: Regularisation::default(),
            solver: SolverChoice::default(),
        }
    }
}

impl Options {
    /// Noise variance of both images together, in that of one: `1 + 1/k` for the mean of k references (THEORY 2: 2).
    pub(crate) fn noise_of_both(&self) -> f64 {
        1.0 + 1.0 / self.n_references.max(1) as f64
    }

    /// Size of the elements of the mesh, px: half of that asked for where the field is a cubic spline.
    pub fn mesh_size(&self) -> usize {
        match self.elements {
            Elements::Bilinear => self.element_size,
            Elements::CubicSpline => self.element_size / KNOT_ELEMENTS,
        }
    }

    /// Whether anything but the images holds the nodes of the mesh.
    pub fn is_held(&self) -> bool {
        self.regularisation != Regularisation::None || self.elements == Elements::CubicSpline
    }

    /// Whether the numbers among the options make sense (the element size is checked with the mesh).
    ///
    /// # Errors
    /// [`CorrelationError::Option`] with the first that does not.
    pub fn check(&self) -> Result<()> {
        let fault = |name, value: &dyn Display, wanted| {
            Err(CorrelationError::Option { name, value: value.to_string(), wanted })
        };
        if !(self.tolerance_px > 0.0 && self.tolerance_px <= 1.0) {
            return fault("the tolerance", &self.tolerance_px, "a positive number of pixels up to 1");
        }
        if !(0.0..=0.1).contains(&self.tolerance_by_sigma) {
            return fault("the tolerance by the uncertainty", &self.tolerance_by_sigma, "a number from 0 to 0.1");
        }
        if self.max_iterations == 0 {
            return fault("the largest number of iterations", &0, "at least 1");
        }
        if !(0.0..=1.0).contains(&self.textureless_share) {
            return fault("the share of nodes without texture", &self.textureless_share, "a number from 0 to 1");
        }
        if !(self.sigma_most_px > 0.0 && self.sigma_most_px <= 100.0) {
            return fault(
                "the largest standard uncertainty",
                &self.sigma_most_px,
                "a positive number of pixels up to 100",
            );
        }
        if let Some(wanted) = self.noise.fault(f64::MAX) {
            return fault("the noise", &self.noise, wanted);
        }
        if let NoiseCorrelation::Factor(factor) = self.noise_correlation
            && self.noise_correlation.is_fault()
        {
            return fault("the noise correlation", &factor, "a factor from 0.1 to 100");
        }
        if self.elements == Elements::CubicSpline {
            if self.element_size < 8 || !self.element_size.is_multiple_of(KNOT_ELEMENTS) {
                let wanted = "an even number of pixels from 8 on: the mesh has nodes half as far apart";
                return fault("the element size of cubic splines", &self.element_size, wanted);
            }
            if self.regularisation != Regularisation::None {
                let wanted = "none with cubic-spline elements, or bilinear elements";
                return fault("the regularisation", &self.regularisation.kind(), wanted);
            }
        }
        self.regularisation.check(self.element_size)
    }
}
