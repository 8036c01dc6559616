//! Analytic speckle images whose displacement is known exactly.
//!
//! No image is interpolated: a [`Texture`] has a grey level at every point of the plane, a [`Motion`]
//! moves its points, and [`render`] integrates the moved texture over the area of each pixel. What a
//! correlation should find is [`exact_at`].
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
    /// The speckle size is outside 2..=32 px.
    #[error("the speckle size is {speckle_px} px; choose 2 to 32 px (4.5 is a good start)")]
    Speckle {
        /// What was asked for, px.
        speckle_px: f64,
    },
    /// The standard deviation of the noise is negative or not finite.
    #[error("the noise is {noise} grey levels; choose a number from 0 (none) on, 2 is that of a fair camera")]
    Noise {
        /// What was asked for, grey levels.
        noise: f32,
    },
    /// The number of points per pixel side is outside 1..=6.
    #[error("{points} points per pixel side; choose 1 to 6 (2 integrates to 0.005 grey levels rms)")]
    Points {
        /// What was asked for.
        points: usize,
    },
    /// The motion folds the specimen, or its inverse is not found.
    #[error("no material point is found that moves to ({x}, {y}) px: the motion folds; lower its gradient")]
    Folded {
        /// Column in the deformed image.
        x: f64,
        /// Row in the deformed image.
        y: f64,
    },
    /// The image does not fit into the memory.
    #[error("an image of {width} x {height} px does not fit into the memory")]
    TooLarge {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// The size asked for is not that of an image.
    #[error(transparent)]
    Image(#[from] ImageError),
}
