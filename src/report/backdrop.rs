//! The image that a field is drawn over.

use super::look::Look;
use super::picture::LARGEST_RATIO;
use crate::imaging::{Image, Levels};
use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::F32;
use fast_image_resize::{FilterType, ResizeAlg, ResizeOptions, Resizer};
use image::codecs::png::{CompressionType, FilterType as Filter, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Longer side of the image in the picture.
pub(super) const LONGER_SIDE: f64 = 900.0;

/// An image made ready to draw over: in the size of a picture, stretched from black to white, with the
/// darkest and brightest 0.2 % of the pixels cut off. Made once, it serves any number of figures.
#[derive(Clone)]
pub struct Backdrop {
    /// Columns and rows of the image.
    size: [usize; 2],
    look: Look,
    ratio: u32,
    drawn: Option<Drawn>,
}

#[derive(Clone)]
struct Drawn {
    grey: Vec<u8>,
    width: usize,
    height: usize,
    png: Vec<u8>,
    mean: u8,
}

impl std::fmt::Debug for Backdrop {
    /// All but the pixels.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Backdrop").field("size", &self.size).field("ratio", &self.ratio).finish_non_exhaustive()
    }
}

impl Backdrop {
    /// Prepares `image` for pictures with at least `ratio` (1 to 4) pixels per unit, in the look that is chosen.
    pub fn new(image: &Image, ratio: u32) -> Self {
        Self::made_for(Look::chosen(), image, ratio)
    }

    /// [`Backdrop::new`] for a screen, a column or a slide, whatever is chosen.
    pub fn made_for(look: Look, image: &Image, ratio: u32) -> Self {
        let ratio = ratio.clamp(1, LARGEST_RATIO).max(look.ratio());
        let size = [image.width(), image.height()];
        let factor = look.side(LONGER_SIDE) / size[0].max(size[1]) as f64;
        let [width, height] = size.map(|side| (side as f64 * factor).round().max(1.0) as u32 * ratio);
        let drawn = Some(Drawn::new(image, width, height));
        Self { size, look, ratio, drawn }
    }

    /// A white sheet of `width` x `height` px of an image that is not there.
    pub fn blank(width: usize, height: usize, ratio: u32) -> Self {
        let look = Look::chosen();
        let ratio = ratio.clamp(1, LARGEST_RATIO).max(look.ratio());
        Self { size: [width.max(1), height.max(1)], look, ratio, drawn: None }
    }

    /// What pictures over it are for.
    pub(super) fn look(&self) -> Look {
        self.look
    }

    /// Columns and rows of the image, px.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Pixels of a picture per unit.
    pub fn ratio(&self) -> u32 {
        self.ratio
    }

    /// The picture of the image, as a PNG file.
    pub(super) fn png(&self) -> Option<&[u8]> {
        self.drawn.as_ref().map(|drawn| drawn.png.as_slice())
    }

    /// Length of its picture, as a PNG file.
    pub fn n_bytes(&self) -> usize {
        self.png().map_or(0, <[u8]>::len)
    }

    /// Mean grey; white without an image.
    pub(super) fn mean(&self) -> u8 {
        self.drawn.as_ref().map_or(255, |drawn| drawn.mean)
    }

    /// The grey at a point of the image (px), bilinear; white without an image.
    pub(super) fn grey(&self, x: f64, y: f64) -> u8 {
        let Some(drawn) = &self.drawn else { return 255 };
        let cell = |v: f64, side: usize, n: usize| {
            let at = ((v + 0.5) * n as f64 / side as f64 - 0.5).clamp(0.0, (n - 1) as f64);
            let first = (at.floor() as usize).min(n.saturating_sub(2));
            (first, (first + 1).min(n - 1), at - first as f64)
        };
        let (i, i1, s) = cell(x, self.size[0], drawn.width);
        let (j, j1, t) = cell(y, self.size[1], drawn.height);
        let grey = |i: usize, j: usize| f64::from(drawn.grey[j * drawn.width + i]);
        let row = |j: usize| (1.0 - s) * grey(i, j) + s * grey(i1, j);
        ((1.0 - t) * row(j) + t * row(j1) + 0.5) as u8
    }
}

impl Drawn {
    fn new(image: &Image, width: u32, height: u32) -> Self {
        let (columns, rows) = (image.width() as u32, image.height() as u32);
        let source: Vec<F32> = match image.pixels() {
            Levels::U8(grey) => grey.iter().map(|&v| F32::new(v.into())).collect(),
            Levels::U16(grey) => grey.iter().map(|&v| F32::new(v.into())).collect(),
            Levels::F32(grey) => grey.iter().map(|&v| F32::new(v)).collect(),
        };
        // Few pixels are shown as the squares they are; many are averaged, or moire would appear.
        let by = if width >= 4 * columns { ResizeAlg::Nearest } else { ResizeAlg::Convolution(FilterType::Bilinear) };
        let values = resize(&source, [columns, rows], [width, height], by);
        // A few hot or dead pixels must not decide the contrast.
        let mut partly_sorted = values.clone();
        let mut quantile = |part: f64| {
            let at = ((partly_sorted.len() - 1) as f64 * part).round() as usize;
            f64::from(*partly_sorted.select_nth_unstable_by(at, f32::total_cmp).1)
        };
        let (mut low, mut high) = (quantile(0.002), quantile(0.998));
        if low >= high {
            (low, high) = (quantile(0.0), quantile(1.0));
        }
        let stretch = |v: f32| if low < high { (f64::from(v) - low) / (high - low) } else { 0.5 };
        let grey: Vec<u8> = values.iter().map(|&v| (255.0 * stretch(v).clamp(0.0, 1.0) + 0.5) as u8).collect();
        let mean = grey.iter().map(|&v| u64::from(v)).sum::<u64>() / grey.len() as u64;
        let png = png(&grey, width, height, ExtendedColorType::L8);
        Self { grey, width: width as usize, height: height as usize, png, mean: mean as u8 }
    }
}

/// An image of `from` columns and rows in those of `to`.
fn resize(pixels: &[F32], from: [u32; 2], to: [u32; 2], by: ResizeAlg) -> Vec<f32> {
    let source = TypedImageRef::new(from[0], from[1], pixels).expect("as many pixels as columns times rows");
    let mut resized = TypedImage::<F32>::new(to[0], to[1]);
    let options = ResizeOptions::new().resize_alg(by);
    Resizer::new().resize_typed(&source, &mut resized, &options).expect("the whole of the source");
    resized.pixels().iter().map(|pixel| pixel.0).collect()
}

/// Pixels as a PNG file, to stand inside a picture.
pub(super) fn png(pixels: &[u8], width: u32, height: u32, colour: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Speckles hardly compress, and a user waits for it.
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(1), Filter::Adaptive)
        .write_image(pixels, width, height, colour)
        .expect("memory takes any picture");
    bytes
}
