//! What a camera is to be found from, and what was found.

use crate::io::case::CaseFile;
use crate::run::plan::Request;
use std::path::PathBuf;

/// What a camera is to be found from.
#[derive(Debug, Default)]
pub struct Calibrating {
    /// The images, and how they are correlated.
    pub request: Request,
    /// The case below it, with marks where none are given here.
    pub case: CaseFile,
    /// Lengths in the plane: the ends on the first image, px, and mm.
    pub lengths: Vec<[f64; 5]>,
    /// Points whose place is known: px on the first image, and mm along any axes of the plane.
    pub points: Vec<[f64; 4]>,
    /// Standard uncertainty of what was marked, px.
    pub mark_std_px: Option<f64>,
    /// Columns and rows of the inner corners of a chessboard that the images show.
    pub chessboard: Option<[usize; 2]>,
    /// Columns and rows of a grid of dots that they show.
    pub dots: Option<[usize; 2]>,
    /// Distance of neighbouring points of the target, mm.
    pub pitch_mm: Option<f64>,
}

/// What was found.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The file of the camera.
    pub file: PathBuf,
    /// What these images determine, and what is missing, in sentences.
    pub said: Vec<String>,
}
