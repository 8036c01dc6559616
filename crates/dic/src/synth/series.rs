//! A series of images: the reference and the frames of a growing motion.

use super::{Motion, RenderOptions, SynthError, Texture, exact_at, render};
use crate::imaging::Image;

/// A reference image (frame 0) and `n_frames` deformed ones (1 to `n_frames`).
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::synth::{RenderOptions, Series, Texture, Translation};
/// let series = Series {
///     texture: Texture::new(1, 4.5).unwrap(),
///     motion: Translation([2.0, 0.0]),
///     n_frames: 4,
///     options: RenderOptions::new(32, 32),
/// };
/// assert_eq!(series.motion_at(1).0, [0.5, 0.0]);
/// assert_eq!(series.image(0).unwrap().width(), 32);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Series<M> {
    /// What is seen.
    pub texture: Texture,
    /// The motion of the last frame.
    pub motion: M,
    /// Number of deformed images.
    pub n_frames: usize,
    /// How the images are rendered; `frame` is replaced by the number of each.
    pub options: RenderOptions,
}

impl<M: Motion> Series<M> {
    /// The motion of frame `k`: `k / n_frames` of the way; none for the reference.
    pub fn motion_at(&self, k: usize) -> M {
        self.motion.at(k as f64 / self.n_frames.max(1) as f64)
    }

    /// The image of frame `k`.
    ///
    /// # Errors
    /// Those of [`render`].
    pub fn image(&self, k: usize) -> Result<Image, SynthError> {
        render(&self.texture, &self.motion_at(k), &RenderOptions { frame: k as u64, ..self.options })
    }

    /// The exact displacements of `points` (reference coordinates, px) in frame `k`.
    pub fn exact_at(&self, k: usize, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        exact_at(&self.motion_at(k), points)
    }
}
