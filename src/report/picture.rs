//! A finished picture.

use super::{Look, ReportError};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use resvg::{tiny_skia, usvg};
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::OnceLock;

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

impl Area {
    fn times(self, ratio: u32) -> Self {
        let [x, y, width, height] = [self.x, self.y, self.width, self.height].map(|v| v * ratio);
        Self { x, y, width, height }
    }
}

/// Pixels of a picture per unit of its SVG, at most.
pub(super) const LARGEST_RATIO: u32 = 4;

/// A picture, to be written as SVG or as PNG, and where the image and the colour bar stand in it.
///
/// Both come from one description: the PNG is what the SVG shows. Text stands there as outlines, so that no
/// font is looked for.
#[derive(Clone)]
pub struct Picture {
    svg: String,
    size: [u32; 2],
    ratio: u32,
    map: Area,
    bar: Option<Area>,
    /// Warnings that are not drawn.
    beside: Vec<String>,
    /// Red, green, blue of each pixel, once they were asked for.
    rgb: OnceLock<Vec<u8>>,
}

impl PartialEq for Picture {
    fn eq(&self, other: &Self) -> bool {
        (&self.svg, self.ratio, self.map, self.bar) == (&other.svg, other.ratio, other.map, other.bar)
    }
}

impl fmt::Debug for Picture {
    /// All but the drawing.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut picture = f.debug_struct("Picture");
        picture.field("width", &self.width()).field("height", &self.height());
        picture.field("map", &self.map).field("bar", &self.bar).finish_non_exhaustive()
    }
}

impl Picture {
    pub(super) fn new(svg: String, size: [u32; 2], map: Area, bar: Option<Area>, ratio: u32) -> Self {
        Self { svg, size, ratio: ratio.clamp(1, LARGEST_RATIO), map, bar, beside: Vec::new(), rgb: OnceLock::new() }
    }

    /// The same picture with what `look` does not draw of its warnings.
    pub(super) fn with_warnings(self, warnings: Vec<String>, look: Look) -> Self {
        Self { beside: if look.has_warnings() { Vec::new() } else { warnings }, ..self }
    }

    /// Warnings that belong to it and are not drawn.
    pub fn warnings_beside(&self) -> &[String] {
        &self.beside
    }

    /// The same picture with `ratio` (1 to 4) pixels per unit of the SVG: for print.
    pub fn with_ratio(self, ratio: u32) -> Self {
        Self { beside: self.beside, ..Self::new(self.svg, self.size, self.map, self.bar, ratio) }
    }

    /// Size of the sheet that it was drawn on, units.
    pub(super) fn sheet(&self) -> [u32; 2] {
        self.size
    }

    /// Where the image, or the curves, stand on it.
    pub(super) fn map_on_sheet(&self) -> Area {
        self.map
    }

    /// Columns.
    pub fn width(&self) -> u32 {
        self.size[0] * self.ratio
    }

    /// Rows.
    pub fn height(&self) -> u32 {
        self.size[1] * self.ratio
    }

    /// The drawing as SVG.
    pub fn svg(&self) -> &str {
        &self.svg
    }

    /// Red, green, blue of each pixel, row by row. The drawing is turned into pixels the first time.
    pub fn rgb(&self) -> &[u8] {
        self.rgb.get_or_init(|| pixels(&self.svg, self.width(), self.height()))
    }

    /// The colour at column `x`, row `y`; `None` outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        let at = 3 * (y as usize * self.width() as usize + x as usize);
        let inside = x < self.width() && y < self.height();
        if inside { self.rgb()[at..].first_chunk().copied() } else { None }
    }

    /// Where the image, or the curves, stand, without frame and axes.
    pub fn map_area(&self) -> Area {
        self.map.times(self.ratio)
    }

    /// Where the colours of the bar stand; `None` when nothing was measured, and without a bar.
    pub fn bar_area(&self) -> Option<Area> {
        self.bar.map(|bar| bar.times(self.ratio))
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_png<W: Write>(&self, out: W) -> Result<(), ReportError> {
        // A user waits for it: a fifth of the time of the next levels, for a tenth more bytes; of speckles alone it is
        // two thirds more.
        let encoder = PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive);
        encoder
            .write_image(self.rgb(), self.width(), self.height(), ExtendedColorType::Rgb8)
            .map_err(ReportError::Encode)
    }

    /// Writes the picture as a file; the ending of its name, `.png` or `.svg`, says what as. Warnings that are not drawn
    /// stand in `NAME.warnings.txt` beside it.
    ///
    /// # Errors
    /// Another ending; the file cannot be made or written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), ReportError> {
        let path = path.as_ref();
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        let is_png = match ending.as_deref() {
            Some("png") => true,
            Some("svg") => false,
            _ => return Err(ReportError::Ending { path: path.to_owned() }),
        };
        // Under another name first: a file is there whole or not at all.
        let unfinished = &path.with_added_extension("part");
        let failed = |source| ReportError::Write { path: path.to_owned(), source };
        let write = || {
            let mut file = BufWriter::new(File::create(unfinished).map_err(failed)?);
            if is_png {
                self.write_png(&mut file)?
            } else {
                file.write_all(self.svg.as_bytes()).map_err(failed)?
            }
            file.flush().map_err(failed)?;
            std::fs::rename(unfinished, path).map_err(failed)?;
            let beside = path.with_extension("warnings.txt");
            match self.beside.is_empty() {
                false => std::fs::write(beside, self.beside.join("\n") + "\n").map_err(failed),
                true if beside.exists() => std::fs::remove_file(beside).map_err(failed),
                true => Ok(()),
            }
        };
        write().inspect_err(|_| {
            // What is left of it helps nobody.
            let _ = std::fs::remove_file(unfinished);
        })
    }
}

/// The drawing in pixels.
fn pixels(svg: &str, width: u32, height: u32) -> Vec<u8> {
    let tree = usvg::Tree::from_str(svg, &usvg::Options::default()).expect("an SVG written here is one");
    let mut map = tiny_skia::Pixmap::new(width, height).expect("a sheet has an extent");
    // Its size may be in millimetres.
    let scale = width as f32 / tree.size().width();
    resvg::render(&tree, tiny_skia::Transform::from_scale(scale, scale), &mut map.as_mut());
    // The sheet is white and opaque: nothing to divide by.
    map.data().chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
}
