//! Units of length as types, so that pixels and millimetres cannot be mixed.

use std::fmt::Debug;

/// A unit of length, carried as a type parameter by meshes and measurements.
pub trait Length: Copy + Clone + Debug + Send + Sync + 'static {
    /// How the unit is written in column names and on axes: `px` or `mm`.
    const UNIT: &'static str;
}

/// Pixels of the reference image: x to the right, y down, origin at the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Px;

/// Millimetres on the specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mm;

impl Length for Px {
    const UNIT: &'static str = "px";
}

impl Length for Mm {
    const UNIT: &'static str = "mm";
}

/// The scale of an image series, in millimetres per pixel.
///
/// ```
/// use quadrille::units::PixelSize;
/// let scale = PixelSize::new(0.00193125).unwrap();
/// assert!((scale.mm_from_px(16.0) - 0.0309).abs() < 1e-12);
/// assert!(PixelSize::new(0.0).is_none());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSize(f64);

impl PixelSize {
    /// `mm_per_px` must be positive and finite; otherwise `None`.
    pub fn new(mm_per_px: f64) -> Option<Self> {
        (mm_per_px.is_finite() && mm_per_px > 0.0).then_some(Self(mm_per_px))
    }

    /// Millimetres per pixel.
    pub fn mm_per_px(self) -> f64 {
        self.0
    }

    /// A length in pixels, in millimetres.
    pub fn mm_from_px(self, px: f64) -> f64 {
        px * self.0
    }
}
