//! What chance may do: levels and tails of the tests.

use statrs::distribution::{ContinuousCDF, Normal};

/// How far off the noise's own level may be, as a standard uncertainty relative to it: residuals of images tell it to
/// about that (rounding, interpolation, texture), whatever the number of pixels.
pub const NOISE_LEVEL_STD: f64 = 0.02;
/// The share of right models that a test may reject.
pub(crate) const FALSE_REJECTIONS: f64 = 0.01;

/// The value that a standard normal variable exceeds with probability `tail`.
pub(crate) fn normal_tail(tail: f64) -> f64 {
    Normal::standard().inverse_cdf(1.0 - tail)
}

/// The normal deviate of a sum of squares that is `ratio` times its expectation, as of a chi-square of `freedom`
/// degrees (Wilson and Hilferty 1931): a sum over few numbers is far from normal.
pub(crate) fn as_normal(ratio: f64, freedom: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    (ratio.cbrt() - (1.0 - spread)) / spread.sqrt()
}
