//! A field as arrays of NumPy or MATLAB. As pyALDIC writes them: `coordinates` (points, 2), `disp_u` and `disp_v` (points)
//! or (points, frames). As VIC-2D exports them: `x`, `y`, `u`, `v` and `sigma` of one shape.

use super::layout::{LAYOUTS, Layout};
use super::{FieldError, FieldOptions, FieldPoints, Meaning};
use crate::npz::{Array, read_arrays};
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// Names of the arrays, and of the layout.
const NAMES: [&str; 3] = ["coordinates", "disp_u", "disp_v"];
const LAYOUT: &str = "pyaldic";

/// The arrays of an archive of NumPy.
pub(super) fn of_numpy(bytes: &[u8]) -> Result<BTreeMap<String, Array>, String> {
    read_arrays(Cursor::new(bytes)).map_err(|error| format!("the archive cannot be read: {error}"))
}

/// The frames that arrays hold.
pub(super) fn parse(
    arrays: Result<BTreeMap<String, Array>, String>,
    path: &Path,
    options: &FieldOptions,
) -> Result<Vec<FieldPoints>, FieldError> {
    let wrong = |reason: String| FieldError::Arrays { path: path.to_owned(), reason };
    let arrays = arrays.map_err(wrong)?;
    let is_asked = |layout: &&Layout| options.layout.is_none_or(|asked| asked.name == layout.name);
    let names: Vec<String> = arrays.keys().cloned().collect();
    if let Some(layout) = LAYOUTS.iter().filter(is_asked).find(|layout| layout.is_of(&names)) {
        return of_columns(layout, &arrays, path, options).map(|frame| vec![frame]);
    }
    let there = || arrays.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
    let array = |name: &str| {
        arrays.get(name).ok_or_else(|| wrong(format!("has no array {name}, and no x, y, u, v; found: {}", there())))
    };
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

/// The points of arrays of which each is a column of `layout`.
fn of_columns(
    layout: &'static Layout,
    arrays: &BTreeMap<String, Array>,
    path: &Path,
    options: &FieldOptions,
) -> Result<FieldPoints, FieldError> {
    let all: Vec<(&String, &Array)> = arrays.iter().collect();
    let names: Vec<String> = arrays.keys().cloned().collect();
    let column = |at: usize| all.get(at).map_or(("", None), |(name, array)| (name.as_str(), Some(*array)));
    let [x, y, u, v] = layout.places(&names).unwrap_or_default().map(column);
    let n = x.1.map_or(0, Array::len);
    if let Some((name, _)) = [y, u, v].into_iter().find(|(_, array)| array.is_none_or(|array| array.len() != n)) {
        let reason = format!("{name} has not the {n} numbers of {}", x.0);
        return Err(FieldError::Arrays { path: path.to_owned(), reason });
    }
    let sigma = layout.sigma.and_then(|[u, v]| Some([arrays.get(u)?, arrays.get(v)?]));
    let meaning = Meaning::of(layout, [None; 2], [x.0, u.0], path, options)?;
    let mut found = FieldPoints { layout, points: Vec::with_capacity(n), n_invalid: 0 };
    for point in 0..n {
        let number = |array: Option<&Array>| array.map_or(f64::NAN, |array| array.nth(point));
        let numbers = [number(x.1), number(y.1), number(u.1), number(v.1)];
        let sigma = sigma.map(|sigma| sigma.map(|array| array.nth(point)));
        match numbers.iter().chain(sigma.iter().flatten().take(1)).all(|v| v.is_finite())
            && sigma.is_none_or(|[u, _]| u >= 0.0)
        {
            true => found.points.push(meaning.point(numbers, sigma)),
            false => found.n_invalid += 1,
        }
    }
    Ok(found)
}
