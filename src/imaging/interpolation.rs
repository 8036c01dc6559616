//! The sub-pixel interpolations of the deformed image (THEORY 2).

use serde::{Deserialize, Serialize};

/// How grey levels between pixels are found.
///
/// Bias of a displacement by a quarter pixel, speckles of 4 to 5 px: cubic about 7e-4 px, quintic
/// about 6e-5 px. Keys and bilinear need no prefilter and are less accurate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Cubic B-spline through the grey levels (exact recursive prefilter); the default.
    #[default]
    Cubic,
    /// Quintic B-spline through the grey levels: the smallest bias, about twice the work.
    Quintic,
    /// Keys' cubic convolution (a = -1/2).
    Keys,
    /// Bilinear: for looking, not for measuring.
    Bilinear,
}

impl Interpolation {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Interpolation::Cubic => "cubic",
            Interpolation::Quintic => "quintic",
            Interpolation::Keys => "keys",
            Interpolation::Bilinear => "bilinear",
        }
    }
}
