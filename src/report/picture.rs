//! A finished picture.

use super::ReportError;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// A rectangle of whole pixels of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Area {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A picture in 8-bit RGB, and where the image and the colour bar stand in it.
#[derive(Clone, PartialEq)]
pub struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) rgb: Vec<u8>,
    pub(super) map: Area,
    pub(super) bar: Option<Area>,
}

impl fmt::Debug for Picture {
    /// All but the millions of colours.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut picture = f.debug_struct("Picture");
        picture.field("width", &self.width).field("height", &self.height);
        picture.field("map", &self.map).field("bar", &self.bar).finish_non_exhaustive()
    }
}

impl Picture {
    /// Columns.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Red, green, blue of each pixel, row by row.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// The colour at column `x`, row `y`; `None` outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        let at = 3 * (y as usize * self.width as usize + x as usize);
        let inside = x < self.width && y < self.height;
        if inside { self.rgb[at..].first_chunk().copied() } else { None }
    }

    /// Where the image stands, without its frame and axes.
    pub fn map_area(&self) -> Area {
        self.map
    }

    /// Where the colours of the bar stand; `None` when nothing was measured.
    pub fn bar_area(&self) -> Option<Area> {
        self.bar
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_png<W: Write>(&self, out: W) -> Result<(), ReportError> {
        let encoder = PngEncoder::new_with_quality(out, CompressionType::Default, FilterType::Adaptive);
        encoder.write_image(&self.rgb, self.width, self.height, ExtendedColorType::Rgb8).map_err(ReportError::Encode)
    }

    /// Writes the picture as a PNG file.
    ///
    /// # Errors
    /// The file cannot be made or written.
    pub fn save_png(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        let path = path.as_ref();
        let failed = |source| ReportError::Write { path: path.to_owned(), source };
        let mut file = BufWriter::new(File::create(path).map_err(failed)?);
        self.write_png(&mut file)?;
        file.flush().map_err(failed)
    }
}
