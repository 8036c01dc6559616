//! The image that a field is drawn over.

use super::look::Look;
use super::picture::LARGEST_RATIO;
use crate::imaging::{Image, Levels};
use image::codecs::png::{CompressionType, FilterType as Filter, PngEncoder};
use image::imageops::{self, FilterType};
use image::{ExtendedColorType, ImageBuffer, ImageEncoder, Luma};
use rayon::prelude::*;

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
        ((1.0 - t) * row(j) + t * row(j1)).round() as u8
    }
}

impl Drawn {
    fn new(image: &Image, width: u32, height: u32) -> Self {
        let (columns, rows) = (image.width() as u32, image.height() as u32);
        // From 0 to 1 first: `resize` clips floats to that.
        let (darkest, brightest) = image.range();
        let extent = if brightest > darkest { f64::from(brightest) - f64::from(darkest) } else { 1.0 };
        let stretched = |v: f64| ((v - f64::from(darkest)) / extent) as f32;
        // Few pixels are shown as the squares they are; many are averaged, or moire would appear.
        let values = if width >= 4 * columns || (width, height) == (columns, rows) {
            let grey = |x: u32, y: u32| Luma([stretched(f64::from(image.grey(x as usize, y as usize)))]);
            imageops::resize(&ImageBuffer::from_fn(columns, rows, grey), width, height, FilterType::Nearest).into_raw()
        } else {
            let size = [image.width(), image.height(), width as usize, height as usize];
            // A table of levels for what has few of them.
            let table = |n: usize| (0..n).map(|v| stretched(v as f64)).collect::<Vec<f32>>();
            match image.pixels() {
                Levels::U8(p) => averaged(p, size, &with_table(table(1 << 8), |v: u8| usize::from(v))),
                Levels::U16(p) => averaged(p, size, &with_table(table(1 << 16), |v: u16| usize::from(v))),
                Levels::F32(p) => averaged(p, size, &|v| stretched(f64::from(v))),
            }
        };
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
        let grey: Vec<u8> = values.iter().map(|&v| (255.0 * stretch(v).clamp(0.0, 1.0)).round() as u8).collect();
        let mean = grey.iter().map(|&v| u64::from(v)).sum::<u64>() / grey.len() as u64;
        let png = png(&grey, width, height, ExtendedColorType::L8);
        Self { grey, width: width as usize, height: height as usize, png, mean: mean as u8 }
    }
}

fn with_table<G>(table: Vec<f32>, place: impl Fn(G) -> usize) -> impl Fn(G) -> f32 {
    move |level| table[place(level)]
}

/// Grey levels by `value` in another size (columns and rows before and after), averaged with weights that fall to nothing at the
/// distance of a pixel of the coarser of both: what `image::imageops::resize` does with `Triangle`, which holds four floats
/// for each pixel, to the last bit.
fn averaged<G: Copy + Sync>(
    grey: &[G],
    [columns, rows, width, height]: [usize; 4],
    value: &(impl Fn(G) -> f32 + Sync),
) -> Vec<f32> {
    let (across, down) = (weights(columns, width), weights(rows, height));
    let mut out = vec![0.0; width * height];
    out.par_chunks_mut(width).zip(&down).for_each_init(
        || vec![0.0f32; columns],
        |along, (out, (first, weights))| {
            along.fill(0.0);
            for (row, weight) in grey.chunks_exact(columns).skip(*first).zip(weights) {
                along.iter_mut().zip(row).for_each(|(sum, &grey)| *sum += value(grey) * weight);
            }
            for (out, (first, weights)) in out.iter_mut().zip(&across) {
                let mut sum = 0.0f32;
                along[*first..].iter().zip(weights).for_each(|(value, weight)| sum += value * weight);
                *out = sum.clamp(0.0, 1.0);
            }
        },
    );
    out
}

/// For each of `to` pixels in place of `from` the first one that counts and the weights from it on.
fn weights(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let ratio = from as f32 / to as f32;
    let reach = ratio.max(1.0);
    let of = |k: usize| {
        let at = (k as f32 + 0.5) * ratio;
        let first = ((at - reach).floor().max(0.0) as usize).min(from - 1);
        let end = ((at + reach).ceil().max(0.0) as usize).clamp(first + 1, from);
        let distance = |k: usize| ((k as f32 - (at - 0.5)) / reach).abs();
        let mut weights: Vec<f32> = (first..end).map(|k| (1.0 - distance(k)).max(0.0)).collect();
        let sum: f32 = weights.iter().fold(0.0, |sum, weight| sum + weight);
        weights.iter_mut().for_each(|weight| *weight /= sum);
        (first, weights)
    };
    (0..to).map(of).collect()
}

/// Pixels as a PNG file, to stand inside a picture.
pub(super) fn png(pixels: &[u8], width: u32, height: u32, colour: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Speckles hardly compress, and a user waits for it.
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Level(2), Filter::Adaptive)
        .write_image(pixels, width, height, colour)
        .expect("memory takes any picture");
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::Pixels;

    #[test]
    fn an_image_is_averaged_as_the_crate_image_does_it_to_the_last_bit() {
        for (size, wanted) in [([64, 48], [20, 15]), ([50, 70], [31, 44]), ([33, 20], [90, 55]), ([7, 3], [3, 7])] {
            let levels: Vec<u8> = (0..size[0] * size[1]).map(|k| (k * 7919 % 251) as u8).collect();
            let image = Image::new(size[0], size[1], Pixels::U8(levels.clone())).unwrap();
            let value = |grey: u8| f32::from(grey) / 255.0;
            let [width, height] = wanted;
            let own = averaged(&levels, [size[0], size[1], width, height], &value);
            let source = ImageBuffer::from_fn(size[0] as u32, size[1] as u32, |x, y| {
                Luma([value(image.grey(x as usize, y as usize) as u8)])
            });
            let theirs = imageops::resize(&source, width as u32, height as u32, FilterType::Triangle).into_raw();
            assert_eq!(own, theirs, "{size:?} to {wanted:?}");
        }
    }
}
