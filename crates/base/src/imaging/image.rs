//! A grey-level image as it was recorded.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use thiserror::Error;

/// Grey levels in the depth in which they were recorded, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum Pixels {
    /// 8 bit: 0..255.
    U8(Vec<u8>),
    /// 16 bit: 0..65535 (also 10 and 12 bit data stored in 16).
    U16(Vec<u16>),
    /// 32-bit float, any scale.
    F32(Vec<f32>),
}

impl Pixels {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        self.levels().len()
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Name of the depth: `8 bit`, `16 bit` or `32-bit float`.
    pub fn depth(&self) -> &'static str {
        self.levels().depth()
    }

    /// The largest grey level of the depth; 1 for floats, which have none.
    pub fn white(&self) -> f32 {
        self.levels().white()
    }

    /// As slices.
    pub fn levels(&self) -> Levels<'_> {
        match self {
            Pixels::U8(p) => Levels::U8(p),
            Pixels::U16(p) => Levels::U16(p),
            Pixels::F32(p) => Levels::F32(p),
        }
    }
}

/// Grey levels of somebody else, such as an array of Python, that do not change while an image of them lives.
#[derive(Clone)]
pub enum SharedPixels {
    /// 8 bit: 0..255.
    U8(Arc<dyn AsRef<[u8]> + Send + Sync>),
    /// 16 bit: 0..65535.
    U16(Arc<dyn AsRef<[u16]> + Send + Sync>),
    /// 32-bit float, any scale.
    F32(Arc<dyn AsRef<[f32]> + Send + Sync>),
}

impl SharedPixels {
    fn levels(&self) -> Levels<'_> {
        match self {
            SharedPixels::U8(p) => Levels::U8((**p).as_ref()),
            SharedPixels::U16(p) => Levels::U16((**p).as_ref()),
            SharedPixels::F32(p) => Levels::F32((**p).as_ref()),
        }
    }
}

/// The grey levels of an image, row by row, wherever they lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Levels<'a> {
    /// 8 bit: 0..255.
    U8(&'a [u8]),
    /// 16 bit: 0..65535 (also 10 and 12 bit data stored in 16).
    U16(&'a [u16]),
    /// 32-bit float, any scale.
    F32(&'a [f32]),
}

impl Levels<'_> {
    /// Number of pixels.
    pub fn len(&self) -> usize {
        match self {
            Levels::U8(p) => p.len(),
            Levels::U16(p) => p.len(),
            Levels::F32(p) => p.len(),
        }
    }

    /// Whether there are no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Name of the depth: `8 bit`, `16 bit` or `32-bit float`.
    pub fn depth(&self) -> &'static str {
        match self {
            Levels::U8(_) => "8 bit",
            Levels::U16(_) => "16 bit",
            Levels::F32(_) => "32-bit float",
        }
    }

    /// The largest grey level of the depth; 1 for floats, which have none.
    pub fn white(&self) -> f32 {
        match self {
            Levels::U8(_) => 255.0,
            Levels::U16(_) => 65535.0,
            Levels::F32(_) => 1.0,
        }
    }

    /// Some of them as floats.
    pub fn floats(self, pixels: Range<usize>) -> Vec<f32> {
        match self {
            Levels::U8(p) => p[pixels].iter().map(|&v| f32::from(v)).collect(),
            Levels::U16(p) => p[pixels].iter().map(|&v| f32::from(v)).collect(),
            Levels::F32(p) => p[pixels].to_vec(),
        }
    }

    fn to_pixels(self) -> Pixels {
        match self {
            Levels::U8(p) => Pixels::U8(p.to_vec()),
            Levels::U16(p) => Pixels::U16(p.to_vec()),
            Levels::F32(p) => Pixels::F32(p.to_vec()),
        }
    }
}

impl PartialEq<Pixels> for Levels<'_> {
    fn eq(&self, other: &Pixels) -> bool {
        *self == other.levels()
    }
}

/// What makes an array of grey levels no image.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ImageError {
    /// Width or height is zero.
    #[error("the image is {width} x {height} px: it holds no pixel")]
    Empty {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The number of grey levels is not width x height.
    #[error("{len} grey levels do not fill {width} x {height} px")]
    Length {
        /// Grey levels given.
        len: usize,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A float image holds NaN or infinity.
    #[error("the grey level at ({x}, {y}) px is {value}: replace or mask it before correlating")]
    NotFinite {
        /// Column.
        x: usize,
        /// Row.
        y: usize,
        /// The grey level found there.
        value: f32,
    },
}

/// A grey-level image: row-major, pixel centres at integer coordinates, x to the right, y down,
/// origin at the centre of the top-left pixel (THEORY 1). Every grey level is finite.
#[derive(Clone)]
pub struct Image {
    width: usize,
    height: usize,
    grey: Grey,
}

/// Whose the grey levels are.
#[derive(Clone)]
enum Grey {
    Own(Pixels),
    Shared(SharedPixels),
}

impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { width, height, .. } = self;
        f.debug_struct("Image").field("width", width).field("height", height).field("pixels", &self.pixels()).finish()
    }
}

impl PartialEq for Image {
    fn eq(&self, other: &Self) -> bool {
        (self.width, self.height, self.pixels()) == (other.width, other.height, other.pixels())
    }
}

impl Image {
    /// Checks and keeps `pixels`.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::imaging::{Image, Pixels};
    /// let image = Image::new(2, 1, Pixels::U8(vec![7, 9])).unwrap();
    /// assert_eq!(image.grey(1, 0), 9.0);
    /// assert!(Image::new(2, 1, Pixels::F32(vec![0.0, f32::NAN])).is_err());
    /// ```
    ///
    /// # Errors
    /// No pixel, a length that is not `width * height`, or a float that is not finite.
    pub fn new(width: usize, height: usize, pixels: Pixels) -> Result<Self, ImageError> {
        Self::checked(width, height, Grey::Own(pixels))
    }

    /// The same of grey levels that are not copied.
    ///
    /// # Errors
    /// As [`Image::new`].
    pub fn shared(width: usize, height: usize, pixels: SharedPixels) -> Result<Self, ImageError> {
        Self::checked(width, height, Grey::Shared(pixels))
    }

    fn checked(width: usize, height: usize, grey: Grey) -> Result<Self, ImageError> {
        let image = Self { width, height, grey };
        let pixels = image.pixels();
        if width == 0 || height == 0 {
            return Err(ImageError::Empty { width, height });
        }
        if width.checked_mul(height) != Some(pixels.len()) {
            return Err(ImageError::Length { len: pixels.len(), width, height });
        }
        if let Levels::F32(values) = pixels
            && let Some(at) = values.iter().position(|v| !v.is_finite())
        {
            return Err(ImageError::NotFinite { x: at % width, y: at / width, value: values[at] });
        }
        Ok(image)
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The grey levels, row by row.
    pub fn pixels(&self) -> Levels<'_> {
        match &self.grey {
            Grey::Own(pixels) => pixels.levels(),
            Grey::Shared(pixels) => pixels.levels(),
        }
    }

    /// The grey levels, row by row, without the image: copied where they are somebody else's.
    pub fn into_pixels(self) -> Pixels {
        match self.grey {
            Grey::Own(pixels) => pixels,
            Grey::Shared(pixels) => pixels.levels().to_pixels(),
        }
    }

    /// The grey level at column `x`, row `y`.
    ///
    /// # Panics
    /// When the pixel is outside the image.
    #[inline]
    pub fn grey(&self, x: usize, y: usize) -> f32 {
        assert!(x < self.width && y < self.height, "pixel ({x}, {y}) is outside the image");
        let at = y * self.width + x;
        match self.pixels() {
            Levels::U8(p) => f32::from(p[at]),
            Levels::U16(p) => f32::from(p[at]),
            Levels::F32(p) => p[at],
        }
    }

    /// Smallest and largest grey level.
    pub fn range(&self) -> (f32, f32) {
        // In the recorded type: integer minima run in vectors.
        fn ends<T: Copy + Ord + Default + Into<f32>>(levels: &[T], most: T) -> (f32, f32) {
            let (low, high) = levels.iter().fold((most, T::default()), |(low, high), &v| (v.min(low), v.max(high)));
            (low.into(), high.into())
        }
        match self.pixels() {
            Levels::U8(p) => ends(p, u8::MAX),
            Levels::U16(p) => ends(p, u16::MAX),
            Levels::F32(p) => {
                p.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
            }
        }
    }

    /// Whether all pixels have one grey level. Looks no further than the first that differs.
    pub fn is_constant(&self) -> bool {
        fn all_equal<T: PartialEq>(values: &[T]) -> bool {
            values.iter().all(|v| *v == values[0])
        }
        match self.pixels() {
            Levels::U8(p) => all_equal(p),
            Levels::U16(p) => all_equal(p),
            Levels::F32(p) => all_equal(p),
        }
    }
}
