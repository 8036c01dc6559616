//! Elements in pixels.

use super::backdrop::png;
use super::scale::{Palette, Range};
use super::scene::Rgb;
use crate::mesh::InverseMap;
use image::ExtendedColorType;

/// Distance of the lines of a hatch, pixels along a row.
const HATCH: u32 = 6;

/// A transparent sheet of pixels.
pub(super) struct Layer {
    width: u32,
    height: u32,
    rgba: Vec<u8>,
}

impl Layer {
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, rgba: vec![0; 4 * width as usize * height as usize] }
    }

    /// One row with all colours of a palette.
    pub fn bar(palette: Palette, width: u32) -> Self {
        let pixel = |k: u32| {
            let [r, g, b] = palette.colour(f64::from(k) / f64::from((width - 1).max(1)));
            [r, g, b, 255]
        };
        Self { width, height: 1, rgba: (0..width).flat_map(pixel).collect() }
    }

    /// Colours the pixels whose centres lie in the element with these corners (in pixels of the layer, from its
    /// upper left corner); `colour` is given the shape functions there.
    pub fn fill(&mut self, corners: [[f64; 2]; 4], mut colour: impl FnMut([f64; 4]) -> Rgb) {
        self.paint(corners, |_, shape| Some(colour(shape)));
    }

    /// The same with the colours of values at the corners.
    pub fn fill_values(&mut self, corners: [[f64; 2]; 4], values: [f64; 4], palette: Palette, range: Range) {
        self.fill(corners, |shape| range.colour(palette, shape.iter().zip(values).map(|(n, v)| n * v).sum()));
    }

    /// Colours pixels of the element, by their column and row and the shape functions there.
    fn paint(&mut self, corners: [[f64; 2]; 4], mut colour: impl FnMut([u32; 2], [f64; 4]) -> Option<Rgb>) {
        let cells = |axis: usize, n: u32| {
            let ends = corners.iter().map(|c| c[axis]);
            let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            let cell = |v: f64| v.clamp(0.0, f64::from(n)) as u32;
            cell((low - 0.5 - 1e-6).ceil())..cell((high - 0.5 + 1e-6).floor() + 1.0)
        };
        let element = InverseMap::new(corners);
        for row in cells(1, self.height) {
            for column in cells(0, self.width) {
                let Some(shape) = element.shape([f64::from(column) + 0.5, f64::from(row) + 0.5]) else { continue };
                let Some([r, g, b]) = colour([column, row], shape) else { continue };
                let at = 4 * (row as usize * self.width as usize + column as usize);
                self.rgba[at..at + 4].copy_from_slice(&[r, g, b, 255]);
            }
        }
    }

    /// Draws lines of `colours[0]` with `colours[1]` beside them over the element, from lower left to upper right, at
    /// the same places whatever is hatched.
    pub fn hatch(&mut self, corners: [[f64; 2]; 4], colours: [Rgb; 2]) {
        self.paint(corners, |[column, row], _| colours.get(((column + row) % HATCH) as usize).copied());
    }

    /// Mixes the layer into `rgb` of the same size, of which it hides the share `opacity`.
    pub fn over(&self, rgb: &mut [u8], opacity: f64) {
        // Shares of 255 levels in 1/65536 of a level.
        let shares =
            |part: f64| -> [u32; 256] { std::array::from_fn(|level| (65536.0 * part * level as f64).round() as u32) };
        let (under, over) = (shares(1.0 - opacity), shares(opacity));
        for (pixel, top) in rgb.chunks_exact_mut(3).zip(self.rgba.chunks_exact(4)).filter(|(_, top)| top[3] > 0) {
            for (level, &on_top) in pixel.iter_mut().zip(top) {
                *level = ((under[usize::from(*level)] + over[usize::from(on_top)] + 32768) >> 16) as u8;
            }
        }
    }

    /// The layer as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        png(&self.rgba, self.width, self.height, ExtendedColorType::Rgba8)
    }
}
