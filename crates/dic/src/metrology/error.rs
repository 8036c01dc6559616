//! What keeps a metrology from being made.

use crate::correlate::CorrelationError;
use crate::field::Status;
use crate::imaging::ImageError;
use crate::mesh::Roi;
use thiserror::Error;

/// Why nothing can be said about the images.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MetrologyError {
    /// A number among the options makes no sense.
    #[error("{name} is {value}; give {wanted}")]
    Option {
        /// The option.
        name: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        wanted: &'static str,
    },
    /// The list of element sizes is empty.
    #[error("there is no element size to try; give some from 4 to 128 px")]
    NoSize,
    /// An element size is outside 4..=128 px.
    #[error("the element size is {size} px; choose 4 to 128 px (16 is a good start)")]
    ElementSize {
        /// What was asked for, px.
        size: usize,
    },
    /// Two elements of this size side by side do not fit the zone.
    #[error(
        "elements of {size} px do not fit two by two into the {} px that are looked at \
         (the region less a band of 18 px at the image border); enlarge the region or choose smaller elements",
        by(zone)
    )]
    ElementTooLarge {
        /// What was asked for, px.
        size: usize,
        /// Width and height of the zone, px.
        zone: [usize; 2],
    },
    /// The region is not a rectangle.
    #[error("the region {} is not a rectangle; give x0 < x1 and y0 < y1", corners(.0))]
    NotARectangle(Roi),
    /// The region reaches beyond the image, of these columns and rows.
    #[error("the region {} reaches outside the image of {} px", corners(.0), by(.1))]
    OutsideImage(Roi, [usize; 2]),
    /// Too few pixels.
    #[error(
        "the region holds {} px of the image; at least {least} x {least} px are needed \
         (18 px on every side if it ends at the image border)",
        by(size)
    )]
    TooSmall {
        /// Its columns and rows in the image.
        size: [usize; 2],
        /// The least, px.
        least: usize,
    },
    /// No contrast at all.
    #[error("every pixel of the region has the grey level {grey}: there is no texture to measure on")]
    Constant {
        /// The grey level.
        grey: f32,
    },
    /// The gradients along an axis can be explained by the noise.
    #[error(
        "the region holds nothing but noise of {0:.2} grey levels along x or y: no texture is left to \
         measure on; check the focus and the region, or --noise if it was given"
    )]
    OnlyNoise(f64),
    /// A static image of another size.
    #[error("{name}: the image is {} px, the reference {} px", by(size), by(reference))]
    StaticSize {
        /// The image.
        name: String,
        /// Its columns and rows.
        size: [usize; 2],
        /// Those of the reference.
        reference: [usize; 2],
    },
    /// A static image that is the reference once more.
    #[error(
        "{0}: has the same pixels as the reference, so it says nothing about noise; give another image of the specimen at rest"
    )]
    StaticIsReference(String),
    /// A static image without contrast.
    #[error("{name}: every pixel of the region has the grey level {grey}: this is not an image of the specimen")]
    StaticConstant {
        /// The image.
        name: String,
        /// The grey level.
        grey: f32,
    },
    /// A static image that does not match the reference.
    #[error("{name}: cannot be brought to match the reference ({}); give images of the specimen at rest", status.name())]
    StaticLost {
        /// The image.
        name: String,
        /// How its correlation ended.
        status: Status,
    },
    /// The correlation refuses the image.
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// A copy of the image cannot be made.
    #[error("a copy of the image cannot be made")]
    Image(#[from] ImageError),
}

fn by([width, height]: &[usize; 2]) -> String {
    format!("{width} x {height}")
}

fn corners(Roi { x0, y0, x1, y1 }: &Roi) -> String {
    format!("({x0}, {y0}) to ({x1}, {y1}) px")
}
