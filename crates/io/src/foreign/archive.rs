//! A field as arrays of NumPy, as pyALDIC writes them: `coordinates` (points, 2), `disp_u` and `disp_v` (points) or
//! (points, frames).

use super::layout::Layout;
use super::{FieldError, FieldOptions, FieldPoints, Meaning};
use crate::npz::{Array, read_arrays};
use std::io::Cursor;
use std::path::Path;

/// Names of the arrays, and of the layout.
const NAMES: [&str; 3] = ["coordinates", "disp_u", "disp_v"];
const LAYOUT: &str = "pyaldic";

/// Reads the frames of an archive.
pub(super) fn parse(bytes: &[u8], path: &Path, options: &FieldOptions) -> Result<Vec<FieldPoints>, FieldError> {
    let wrong = |reason: String| FieldError::Arrays { path: path.to_owned(), reason };
    let arrays =
        read_arrays(Cursor::new(bytes)).map_err(|error| wrong(format!("the archive cannot be read: {error}")))?;
    let there = || arrays.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
    let array = |name: &str| arrays.get(name).ok_or_else(|| wrong(format!("has no array {name}; found: {}", there())));
    let [at, u, v] = [array(NAMES[0])?, array(NAMES[1])?, array(NAMES[2])?];
    let of_shape = |array: &Array| array.shape.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
    let n = match at.shape.as_slice() {
        &[n, 2] => n as usize,
        _ => return Err(wrong(format!("coordinates has the shape {}, not points x 2", of_shape(at)))),
    };
    let n_frames = match *u.shape.as_slice() {
        [points] if points as usize == n => 1,
        [points, frames] if points as usize == n => frames as usize,
        _ => return Err(wrong(format!("disp_u has the shape {}, not {n} points x frames", of_shape(u)))),
    };
    if v.shape != u.shape {
        return Err(wrong(format!("disp_v has the shape {}, disp_u {}", of_shape(v), of_shape(u))));
    }
    let layout = options.layout.or_else(|| Layout::of_name(LAYOUT)).filter(|layout| layout.name == LAYOUT);
    let layout = layout.ok_or_else(|| wrong(format!("an archive of arrays is read with --layout {LAYOUT}")))?;
    let meaning = Meaning::of(layout, [None; 2], [NAMES[0], NAMES[1]], path, options)?;
    let frame = |frame: usize| {
        let mut found = FieldPoints { layout, points: Vec::with_capacity(n), n_invalid: 0 };
        for point in 0..n {
            let numbers = [at.value(point, 0), at.value(point, 1), u.value(point, frame), v.value(point, frame)];
            match numbers.iter().all(|v| v.is_finite()) {
                true => found.points.push(meaning.point(numbers, None)),
                false => found.n_invalid += 1,
            }
        }
        found
    };
    Ok((0..n_frames).map(frame).collect())
}
