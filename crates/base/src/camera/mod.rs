//! The camera: from the plane of the specimen to raw pixels, and what its uncertainty does to what is measured
//! (THEORY 22).
//!
//! Images are never resampled: a field is correlated in raw pixels, and [`Rectifier::rectify`] maps its coordinates.
//! Beyond that lies **the plane in pixels**: where the specimen is seen squarely and without distortion, at the scale
//! of the centre of the image. Millimetres are [`PixelSize`](crate::units::PixelSize) times these.

pub mod calibrate;
mod even_noise;
mod field;
mod grid;
pub mod marked;
mod model;
mod pose;
mod shape;
mod still;
pub mod target;
mod term;

pub use field::Rectifier;
pub use grid::CameraGrid;
pub use model::Camera;
pub use shape::{CameraError, CameraShape, Covariance, PARAMETERS, Theta, USUAL_DISTANCE, USUAL_DISTORTION};
pub use still::StillMotion;
pub use term::CameraTerm;
