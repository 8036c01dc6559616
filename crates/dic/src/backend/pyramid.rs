//! Grey levels of an image and of its halvings, on the host.

use super::GreyMap;
use crate::imaging::{Image, Levels};
use rayon::prelude::*;
use std::sync::Arc;

/// A grey level in its recorded depth.
pub(super) trait Grey: Copy + Send + Sync {
    fn value(self) -> f32;
}

impl Grey for u8 {
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
}

impl Grey for u16 {
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
}

impl Grey for f32 {
    #[inline(always)]
    fn value(self) -> f32 {
        self
    }
}

/// An image and the levels of its pyramid that have been asked for.
#[derive(Debug)]
pub(super) struct Pyramid {
    pub image: Arc<Image>,
    offset: f32,
    levels: Vec<Option<GreyMap>>,
}

impl Pyramid {
    /// The pyramid of `image`, whose grey levels are counted from `offset` on.
    pub fn new(image: Arc<Image>, offset: f32) -> Self {
        Self { image, offset, levels: Vec::new() }
    }

    /// Grey levels of level `level` (0 is the image itself).
    pub fn level(&mut self, level: usize) -> &GreyMap {
        if self.levels.len() <= level {
            self.levels.resize_with(level + 1, || None);
        }
        if self.levels[level].is_none() {
            let (width, height) = (self.image.width(), self.image.height());
            let map = match (level, self.image.pixels()) {
                (0, Levels::U8(p)) => convert(p, width, height, self.offset),
                (0, Levels::U16(p)) => convert(p, width, height, self.offset),
                (0, Levels::F32(p)) => convert(p, width, height, self.offset),
                (1, Levels::U8(p)) => halve(p, width, height, self.offset),
                (1, Levels::U16(p)) => halve(p, width, height, self.offset),
                (1, Levels::F32(p)) => halve(p, width, height, self.offset),
                _ => {
                    let finer = self.level(level - 1);
                    halve(&finer.values, finer.width, finer.height, 0.0)
                }
            };
            self.levels[level] = Some(map);
        }
        self.levels[level].as_ref().expect("made above")
    }
}

/// Grey levels less `offset`.
fn convert<G: Grey>(grey: &[G], width: usize, height: usize, offset: f32) -> GreyMap {
    let mut values = vec![0.0; grey.len()];
    values.par_chunks_mut(width).with_min_len(64).zip(grey.par_chunks(width)).for_each(|(out, row)| {
        for (out, grey) in out.iter_mut().zip(row) {
            *out = grey.value() - offset;
        }
    });
    GreyMap { width, height, values }
}

/// Mean of each 2x2 block of pixels; an odd last column or row is left out.
fn halve<G: Grey>(grey: &[G], width: usize, height: usize, offset: f32) -> GreyMap {
    let (w, h) = (width / 2, height / 2);
    let mut values = vec![0.0; w * h];
    if w > 0 {
        values.par_chunks_mut(w).with_min_len(32).enumerate().for_each(|(y, out)| {
            let upper = &grey[2 * y * width..][..2 * w];
            let lower = &grey[(2 * y + 1) * width..][..2 * w];
            for ((out, a), b) in out.iter_mut().zip(upper.chunks_exact(2)).zip(lower.chunks_exact(2)) {
                *out = 0.25 * ((a[0].value() + a[1].value()) + (b[0].value() + b[1].value())) - offset;
            }
        });
    }
    GreyMap { width: w, height: h, values }
}
