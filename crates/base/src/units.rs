//! Units of length as types, so that pixels and millimetres cannot be mixed.

use std::fmt::Debug;
use std::marker::PhantomData;

/// A unit of length with the axes it is counted along, carried as a type parameter by meshes and measurements.
pub trait Length: Copy + Clone + Debug + Send + Sync + 'static {
    /// How the unit is written in column names and on axes: `px` or `mm`.
    const UNIT: &'static str;
}

/// Pixels of the reference image: x to the right, y down, origin at the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Px;

/// Millimetres on the specimen: x to the right, y **up**, origin at the centre of an image's top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mm;

impl Length for Px {
    const UNIT: &'static str = "px";
}

impl Length for Mm {
    const UNIT: &'static str = "mm";
}

/// A place or a displacement in the plane, along the axes of `U`: with y down in [`Px`], with y up in [`Mm`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector<U: Length> {
    /// To the right, in `U`.
    pub x: f64,
    /// Down in [`Px`], up in [`Mm`]; in `U`.
    pub y: f64,
    unit: PhantomData<U>,
}

impl<U: Length> Vector<U> {
    /// The vector with these components, in `U` and along its axes.
    pub fn new([x, y]: [f64; 2]) -> Self {
        Self { x, y, unit: PhantomData }
    }

    /// `[x, y]`.
    pub fn components(self) -> [f64; 2] {
        [self.x, self.y]
    }
}

/// Signs that the components of a vector take from the axes of [`Mm`] to those of [`Px`], or back: y turns.
pub const TURN: [f64; 2] = [1.0, -1.0];

/// The scale of an image series, in millimetres per pixel.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::units::PixelSize;
/// let scale = PixelSize::new(0.00193125).unwrap();
/// assert!((scale.mm_from_px(16.0) - 0.0309).abs() < 1e-12);
/// assert!(PixelSize::new(0.0).is_none());
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSize(f64);

impl PixelSize {
    /// `mm_per_px` must be a length that images can have, from 1e-12 to 1e12 mm (squares of others leave the range of
    /// numbers); otherwise `None`.
    pub const fn new(mm_per_px: f64) -> Option<Self> {
        if mm_per_px >= 1e-12 && mm_per_px <= 1e12 { Some(Self(mm_per_px)) } else { None }
    }

    /// Millimetres per pixel.
    pub fn mm_per_px(self) -> f64 {
        self.0
    }

    /// A length in pixels, in millimetres.
    pub fn mm_from_px(self, px: f64) -> f64 {
        px * self.0
    }

    /// A place or a displacement of the image, on the specimen: the one function in which y turns up.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::units::{PixelSize, Px, Vector};
    /// let scale = PixelSize::new(0.5).unwrap();
    /// let there = scale.to_mm(Vector::<Px>::new([3.0, 8.0]));
    /// assert_eq!(there.components(), [1.5, -4.0]);
    /// assert_eq!(scale.to_px(there).components(), [3.0, 8.0]);
    /// ```
    pub fn to_mm(self, px: Vector<Px>) -> Vector<Mm> {
        Vector::new([self.mm_from_px(TURN[0] * px.x), self.mm_from_px(TURN[1] * px.y)])
    }

    /// The inverse of [`PixelSize::to_mm`].
    pub fn to_px(self, mm: Vector<Mm>) -> Vector<Px> {
        Vector::new([TURN[0] * mm.x / self.0, TURN[1] * mm.y / self.0])
    }
}
