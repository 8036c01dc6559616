//! What a camera is given by, and what may be wrong with it.

use crate::linalg::Dense;
use thiserror::Error;

/// Distortion at the corner of an image that a usual lens has, of the radius: what is taken where none is stated.
pub const USUAL_DISTORTION: f64 = 1e-3;
/// Relative change of the distance of a usual specimen during a test: 0.03 mm at 300 mm.
pub const USUAL_DISTANCE: f64 = 1e-4;

/// Names of the parameters in files, in order: distortion in OpenCV's order and meaning, centre (px), perspective of
/// the plane (1/px), and how much longer than high (`stretch`), how skew (`shear`) a tilted plane is seen.
pub const PARAMETERS: [&str; 11] =
    ["k1", "k2", "p1", "p2", "k3", "centre_x", "centre_y", "tilt_x", "tilt_y", "stretch", "shear"];

/// Values of [`PARAMETERS`].
pub type Theta = [f64; PARAMETERS.len()];

/// Covariance of some parameters; the others are exact.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Covariance {
    /// Places among [`PARAMETERS`], ascending.
    pub of: Vec<usize>,
    /// A row for each of them.
    pub matrix: Vec<Vec<f64>>,
}

impl Covariance {
    /// Of independent parameters with these standard uncertainties; zero is exact.
    pub fn of_std(std: &Theta) -> Self {
        let of: Vec<usize> = (0..std.len()).filter(|&k| std[k] != 0.0).collect();
        let entry = |i: usize, j: usize| if i == j { std[i] * std[i] } else { 0.0 };
        Self { matrix: of.iter().map(|&i| of.iter().map(|&j| entry(i, j)).collect()).collect(), of }
    }

    /// Columns `L` of `L L^T`, one for each of its parameters: squares of all columns add up to the whole.
    pub(super) fn columns(&self) -> Result<Vec<Theta>, CameraError> {
        let n = self.of.len();
        let fits = self.matrix.len() == n && self.matrix.iter().all(|row| row.len() == n);
        if !fits || self.of.iter().any(|&k| k >= PARAMETERS.len()) {
            return Err(CameraError::CovarianceSize { parameters: n, rows: self.matrix.len() });
        }
        let finite = self.matrix.iter().flatten().all(|v| v.is_finite());
        // Scaled to ones on the diagonal: parameters differ by orders of magnitude.
        let scale: Vec<f64> = (0..n).map(|k| self.matrix[k][k].sqrt()).collect();
        let symmetric =
            |i: usize, j: usize| (self.matrix[i][j] - self.matrix[j][i]).abs() <= 1e-9 * scale[i] * scale[j];
        if !finite || scale.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(CameraError::Covariance("it has a variance that is not above zero"));
        }
        if !(0..n).all(|i| (0..i).all(|j| symmetric(i, j))) {
            return Err(CameraError::Covariance("it is not symmetric"));
        }
        let scaled = Dense::from_fn(n, n, |i, j| self.matrix[i][j] / (scale[i] * scale[j]));
        let factor = scaled.cholesky().map_err(|_| CameraError::Covariance("it is not positive definite"))?;
        let lower = factor.half_times(&Dense::from_fn(n, n, |i, j| if i == j { 1.0 } else { 0.0 }));
        let column = |j: usize| {
            let mut theta = [0.0; PARAMETERS.len()];
            (j..n).for_each(|i| theta[self.of[i]] = scale[i] * lower[(i, j)]);
            theta
        };
        Ok((0..n).map(column).collect())
    }
}

/// What a camera is given by; [`Camera::new`](super::Camera::new) checks it.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraShape {
    /// Columns and rows of the images.
    pub image_size_px: [usize; 2],
    /// Length by which coordinates are divided before distortion is applied, along x and y, px: OpenCV's focal lengths.
    /// Where none is known any length does, such as half a diagonal: the coefficients are then those of that length.
    pub focal_px: [f64; 2],
    /// The parameters.
    pub theta: Theta,
    /// Their covariance.
    pub covariance: Covariance,
    /// Standard uncertainty of a relative change of the distance from frame to frame, `dZ/Z`; of no account where zones
    /// that stay as they are show it.
    pub distance_std: f64,
    /// Names of the zones in the plane of the specimen that do not deform.
    pub still: Vec<String>,
}

impl CameraShape {
    /// A camera that sees the plane as it is, exactly: centre in the middle, lengths by half a diagonal.
    pub fn plain(image_size_px: [usize; 2]) -> Self {
        let [width, height] = image_size_px.map(|n| n as f64);
        let mut theta = [0.0; PARAMETERS.len()];
        (theta[5], theta[6]) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
        let focal_px = [0.5 * width.hypot(height); 2];
        Self { image_size_px, focal_px, theta, covariance: Covariance::default(), distance_std: 0.0, still: Vec::new() }
    }
}

/// Why something is no camera, or not one for these images.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A number that cannot be.
    #[error("{what} is {value}; give a finite number{}", if *.positive { " above zero" } else { "" })]
    Number {
        /// Which.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Whether it must be positive as well.
        positive: bool,
    },
    /// A standard uncertainty below zero, or none.
    #[error("the standard uncertainty of {what} is {value}; give a finite number, or 0 where it is exact")]
    Std {
        /// Of which parameter.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Covariance of another size than its parameters.
    #[error("the covariance has {rows} rows for {parameters} parameters; give a row and a column for each")]
    CovarianceSize {
        /// How many parameters.
        parameters: usize,
        /// How many rows.
        rows: usize,
    },
    /// A matrix that is no covariance.
    #[error("the covariance cannot be one: {0}")]
    Covariance(&'static str),
    /// The map is not one to one inside the image.
    #[error(
        "the distortion folds inside the image, at ({x:.0}, {y:.0}) px: two places of the specimen fall on one pixel; check the \
         coefficients and the length they are for (focal_px)"
    )]
    Folds {
        /// Where, px.
        x: f64,
        /// Where, px.
        y: f64,
    },
    /// A still zone that is not there.
    #[error("still: there is no zone '{name}'; there are {}", .zones.join(", "))]
    NoZone {
        /// Its name.
        name: String,
        /// Those of the mesh.
        zones: Vec<String>,
    },
    /// A camera for other images.
    #[error(
        "the camera is of images of {} x {} px, these have {} x {} px{}",
        camera[0], camera[1], images[0], images[1],
        if camera[0] == images[1] && camera[1] == images[0] {
            ": they are turned; turn them as those of the calibration"
        } else {
            "; calibrate with images of this size, without cropping or binning"
        }
    )]
    ImageSize {
        /// Of the camera.
        camera: [usize; 2],
        /// Of the images.
        images: [usize; 2],
    },
}
