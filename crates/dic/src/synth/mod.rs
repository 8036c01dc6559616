//! Analytic speckle images whose displacement is known exactly.
//!
//! No image is interpolated: a [`Motion`] moves the points of a [`Texture`], and [`render`] integrates it over each
//! pixel. What a correlation should find is [`exact_at`].
//!
//! ```
//! # use quadrille_dic as quadrille;
//! use quadrille::synth::{RenderOptions, Texture, Translation, render};
//! let texture = Texture::new(7, 4.5).unwrap();
//! let options = RenderOptions::new(64, 48);
//! let reference = render(&texture, &Translation([0.0, 0.0]), &options).unwrap();
//! let deformed = render(&texture, &Translation([3.0, -2.0]), &options).unwrap();
//! assert_eq!(deformed.grey(23, 18), reference.grey(20, 20)); // g(X + u) = f(X)
//! ```

mod inverse;
mod kernel;
mod motion;
mod peel;
mod render;
mod series;
mod strips;
mod texture;

pub use inverse::inverse_at;
pub use motion::{Accuracy, Affine, Motion, Rotation, Sinusoids, Star, Translation, exact_at};
pub use peel::Peel;
pub use render::{Depth, RenderOptions, render};
pub use series::Series;
pub use strips::{GridField, Strips};
pub use texture::Texture;

use crate::imaging::ImageError;
use thiserror::Error;

/// Why an image cannot be rendered.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum SynthError {
    /// The speckle size, px, is outside 2..=32 px.
    #[error("the speckle size is {0} px; choose 2 to 32 px (4.5 is a good start)")]
    Speckle(f64),
    /// The standard deviation of the noise is negative or not finite.
    #[error("the noise is {noise} grey levels; choose a number from 0 (none) on, 2 is that of a fair camera")]
    Noise {
        /// What was asked for, grey levels.
        noise: f32,
    },
    /// The number of points per pixel side is outside 1..=6.
    #[error("{0} points per pixel side; choose 1 to 6 (2 integrates to 0.005 grey levels rms)")]
    Points(usize),
    /// The motion folds the specimen, or its inverse is not found: at this column and row of the deformed image.
    #[error("no material point is found that moves to ({0}, {1}) px: the motion folds; lower its gradient")]
    Folded(f64, f64),
    /// The image of these columns and rows does not fit into the memory.
    #[error("an image of {0} x {1} px does not fit into the memory")]
    TooLarge(usize, usize),
    /// The size asked for is not that of an image.
    #[error(transparent)]
    Image(#[from] ImageError),
}
