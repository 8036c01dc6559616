//! Values as a command line has them, read.

use super::{CaseGuard, CrackPath};
use std::num::ParseFloatError;
use std::str::FromStr;

/// `N` numbers separated by commas.
///
/// # Errors
/// More or fewer of them, one that is not finite, in words.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    let values = values.map_err(|_| format!("'{text}' is not a list of {N} numbers separated by commas"))?;
    let n = values.len();
    if values.iter().any(|v| !v.is_finite()) {
        return Err(format!("'{text}' holds a number that is not finite"));
    }
    values.try_into().map_err(|_| format!("'{text}' has {n} numbers instead of {N}"))
}

/// The corners of a polygon, separated by blanks.
///
/// # Errors
/// Fewer than three, or no points, in words.
pub fn polygon(text: &str) -> Result<Vec<[f64; 2]>, String> {
    let corners: Vec<[f64; 2]> = text.split_whitespace().map(numbers).collect::<Result<_, _>>()?;
    match corners.len() {
        0..=2 => Err(format!("'{text}' has fewer than three corners; write x,y x,y x,y")),
        _ => Ok(corners),
    }
}

impl FromStr for CrackPath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == Self::AUTO {
            return Ok(Self::Auto);
        }
        let points: Vec<[f64; 2]> = text.split_whitespace().map(numbers).collect::<Result<_, _>>()?;
        match points.len() {
            0 | 1 => Err(format!("'{text}' has fewer than two points; write x,y x,y ... along the crack")),
            _ => Ok(Self::Along(points)),
        }
    }
}

impl FromStr for CaseGuard {
    type Err = ParseFloatError;

    /// The same width everywhere.
    fn from_str(text: &str) -> Result<Self, ParseFloatError> {
        text.parse().map(Self::All)
    }
}
