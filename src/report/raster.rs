//! Elements in pixels.

use super::backdrop::png;
use super::scene::Rgb;
use crate::mesh::InverseMap;
use image::ExtendedColorType;

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

    /// Colours the pixels whose centres lie in the element with these corners (in pixels of the layer, from its
    /// upper left corner); `colour` is given the shape functions there.
    pub fn fill(&mut self, corners: [[f64; 2]; 4], mut colour: impl FnMut([f64; 4]) -> Rgb) {
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
                let [r, g, b] = colour(shape);
                let at = 4 * (row as usize * self.width as usize + column as usize);
                self.rgba[at..at + 4].copy_from_slice(&[r, g, b, 255]);
            }
        }
    }

    /// The layer as a PNG file.
    pub fn png(&self) -> Vec<u8> {
        png(&self.rgba, self.width, self.height, ExtendedColorType::Rgba8)
    }
}
