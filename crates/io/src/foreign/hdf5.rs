//! A field in HDF5: the analysis that Ncorr saves (MATLAB 7.3), the exchange file of the Chair of Forming and Machining
//! Processes, TU Dresden (DIC_Exchange 0.1), and arrays as those of [`super::archive`].

use super::layout::{EXCHANGE, LengthUnit, NCORR, YAxis};
use super::{FieldError, FieldOptions, FieldPoints, Layout, Meaning, archive, mat};
use crate::arrays::Values;
use crate::npz::Array;
use hdf5_reader::{Dataset, Datatype, Hdf5File, OpenOptions};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Group of Ncorr's results.
const ANALYSIS: &str = "data_dic_save";
/// Positions by time step, point and axis in an exchange file; beside it the scatter of single points.
pub(super) const COORDINATES: &str = "vector/coordinates";
pub(super) const SIGMA: &str = "vector/sigma";
/// What [`COORDINATES`] says of itself.
pub(super) const UNIT: &str = "unit";
pub(super) const Y_AXIS: &str = "y_axis";
/// No array is larger, bytes.
const LARGEST: usize = 1 << 32;
/// Deflate shrinks by no more.
const RATIO: usize = 1032;
/// Bytes that an array may have in any file.
const SMALL: usize = 1 << 20;

type Read<T> = Result<T, String>;

/// The frames that a file holds.
pub(super) fn parse(bytes: &[u8], path: &Path, options: &FieldOptions) -> Result<Vec<FieldPoints>, FieldError> {
    let wrong = |reason: String| FieldError::Arrays { path: path.to_owned(), reason };
    // A few damaged bytes would make an array of gigabytes that nobody has written.
    let largest = bytes.len().saturating_mul(RATIO).clamp(SMALL, LARGEST);
    let limits = OpenOptions::default().with_max_read_bytes(largest).with_max_chunk_bytes(largest);
    let file = Hdf5File::from_bytes_with_options(bytes, limits)
        .map_err(|error| wrong(format!("the HDF5 file cannot be read: {error}")))?;
    let layout = |name: &str| {
        let asked = options.layout.or_else(|| Layout::of_name(name)).filter(|asked| asked.name == name);
        asked.ok_or_else(|| wrong(format!("has the layout {name}; leave --layout out")))
    };
    if file.group(ANALYSIS).is_ok() {
        let meaning = Meaning::of(layout(NCORR)?, [None; 2], [ANALYSIS; 2], path, options)?;
        return ncorr(&file, layout(NCORR)?, &meaning).map_err(wrong);
    }
    if let Ok(coordinates) = file.dataset(COORDINATES) {
        let said = |name: &str| coordinates.attribute(name).ok()?.read_string().ok();
        let unit = said(UNIT).and_then(|word| LengthUnit::named(&word));
        let y = options.y.or_else(|| said(Y_AXIS)?.parse::<YAxis>().ok());
        let options = FieldOptions { y, deformed: false, ..*options };
        let meaning = Meaning::of(layout(EXCHANGE)?, [unit; 2], [COORDINATES; 2], path, &options)?;
        return exchange(&file, &coordinates, layout(EXCHANGE)?, &meaning).map_err(wrong);
    }
    archive::parse(arrays(&file, bytes.starts_with(b"MATLAB")), path, options)
}

/// The numbers of a dataset, row by row.
fn numbers(set: &Dataset) -> Read<Vec<f64>> {
    let unread = |error: hdf5_reader::error::Error| format!("{} cannot be read: {error}", set.name());
    let bytes = set.read_native_bytes().map_err(unread)?;
    mat::values(number_of(set.dtype()).unwrap_or(0), &bytes, cfg!(target_endian = "little"))
        .ok_or_else(|| format!("{} holds no numbers", set.name()))
}

/// The kind of a number as MATLAB counts them.
fn number_of(kind: &Datatype) -> Option<u32> {
    Some(match *kind {
        Datatype::FixedPoint { size: 1, signed, .. } => 2 - u32::from(signed),
        Datatype::FixedPoint { size: 2, signed, .. } => 4 - u32::from(signed),
        Datatype::FixedPoint { size: 4, signed, .. } => 6 - u32::from(signed),
        Datatype::FixedPoint { size: 8, signed, .. } => 13 - u32::from(signed),
        Datatype::FloatingPoint { size: 4, .. } => 7,
        Datatype::FloatingPoint { size: 8, .. } => 9,
        _ => return None,
    })
}

/// The arrays of numbers at the root; those of MATLAB lie column by column.
fn arrays(file: &Hdf5File, is_of_matlab: bool) -> Read<BTreeMap<String, Array>> {
    let unread = |error: hdf5_reader::error::Error| format!("the HDF5 file cannot be read: {error}");
    let root = file.root_group().map_err(unread)?;
    let mut arrays = BTreeMap::new();
    for set in root.datasets().map_err(unread)? {
        if number_of(set.dtype()).is_none() {
            continue;
        }
        let (values, mut shape) = (Values::F64(numbers(&set)?), set.shape().to_vec());
        let array = if is_of_matlab {
            shape.reverse();
            Array::by_columns(shape, values)
        } else {
            Array::by_rows(shape, values)
        };
        arrays.insert(set.name().to_owned(), array);
    }
    Ok(arrays)
}

/// The arrays of a field of Ncorr's list of displacements: itself where there is one image, else one for each.
fn of_images(file: &Hdf5File, name: &str) -> Read<Vec<Dataset>> {
    let at = format!("{ANALYSIS}/displacements/{name}");
    let unread = |error: hdf5_reader::error::Error| format!("{at} cannot be read: {error}");
    let set = file.dataset(&at).map_err(unread)?;
    if !matches!(set.dtype(), Datatype::Reference { .. }) {
        return Ok(vec![set]);
    }
    let bytes = set.read_raw_bytes().map_err(unread)?;
    let wanted = hdf5_reader::reference::read_object_references(&bytes, 8).map_err(unread)?;
    let held = file.group("#refs#").and_then(|refs| refs.datasets()).map_err(unread)?;
    let mut held: HashMap<u64, Dataset> = held.into_iter().map(|set| (set.address(), set)).collect();
    let take = |at_byte: u64| held.remove(&at_byte).ok_or_else(|| format!("{at} refers to what is not in the file"));
    wanted.into_iter().map(take).collect()
}

/// Displacements from the reference on a grid of every `spacing + 1` pixels, in units of which a pixel has `pixtounits`;
/// both are zero where nothing was measured.
fn ncorr(file: &Hdf5File, layout: &'static Layout, meaning: &Meaning) -> Read<Vec<FieldPoints>> {
    let one = |name: &str| -> Read<f64> {
        let set = file.dataset(&format!("{ANALYSIS}/dispinfo/{name}"));
        let value = numbers(&set.map_err(|error| error.to_string())?)?.first().copied();
        value.filter(|v| v.is_finite()).ok_or_else(|| format!("{ANALYSIS}/dispinfo/{name} is not a number"))
    };
    let (step, unit) = (one("spacing")? + 1.0, one("pixtounits")?);
    if !(step >= 1.0 && unit > 0.0) {
        return Err(format!("a spacing of {} px and {unit} units per px cannot be", step - 1.0));
    }
    let [u, v] = [of_images(file, "plot_u_ref_formatted")?, of_images(file, "plot_v_ref_formatted")?];
    if u.len() != v.len() {
        return Err(format!("{} images have u, {} have v", u.len(), v.len()));
    }
    let frame = |(u, v): (&Dataset, &Dataset)| -> Read<FieldPoints> {
        let &[columns, rows] = u.shape() else { return Err(format!("{} is no array of rows and columns", u.name())) };
        let (of_u, of_v) = (numbers(u)?, numbers(v)?);
        // MATLAB writes the size of an array that is empty in its place.
        let is_empty = u.attribute("MATLAB_empty").is_ok() || u.shape() != v.shape();
        if is_empty || of_u.len() as u64 != columns.saturating_mul(rows) || of_v.len() != of_u.len() {
            return Err("has no formatted displacements; in Ncorr run Analysis, Format Displacements, and save".into());
        }
        let mut found = FieldPoints { layout, points: Vec::new(), n_invalid: 0 };
        for (k, (&u, &v)) in of_u.iter().zip(&of_v).enumerate() {
            let (column, row) = (k / rows as usize, k % rows as usize);
            match u.is_finite() && v.is_finite() && [u, v] != [0.0; 2] {
                true => found
                    .points
                    .push(meaning.point([column as f64 * step, row as f64 * step, u / unit, v / unit], None)),
                false => found.n_invalid += 1,
            }
        }
        Ok(found)
    };
    u.iter().zip(&v).map(frame).collect()
}

/// Displacements from the first time step.
fn exchange(
    file: &Hdf5File,
    coordinates: &Dataset,
    layout: &'static Layout,
    meaning: &Meaning,
) -> Read<Vec<FieldPoints>> {
    let &[steps, points, axes @ 2..=3] = coordinates.shape() else {
        return Err(format!("{COORDINATES} is not an array of time steps, points and x, y, z"));
    };
    let [steps, points, axes] = [steps, points, axes].map(|n| n as usize);
    if steps < 2 || points == 0 {
        return Err(format!(
            "{COORDINATES} has {steps} time steps of {points} points; a field needs the reference and another"
        ));
    }
    let all = numbers(coordinates)?;
    let sigma = file.dataset(SIGMA).ok().filter(|set| set.shape().starts_with(&[steps as u64, points as u64]));
    let sigma = sigma.map(|set| Ok::<_, String>((numbers(&set)?, set.shape().get(2).map_or(1, |&n| n as usize))));
    let sigma = sigma.transpose()?.filter(|&(_, axes)| axes >= 2);
    let pair = |of: &[f64], axes: usize, step: usize, point: usize| {
        let at = (step * points + point) * axes;
        of.get(at..at + 2).and_then(|pair| pair.first_chunk().copied()).unwrap_or([f64::NAN; 2])
    };
    let frame = |step: usize| {
        let mut found = FieldPoints { layout, points: Vec::new(), n_invalid: 0 };
        for point in 0..points {
            let ([x, y], [xd, yd]) = (pair(&all, axes, 0, point), pair(&all, axes, step, point));
            let sigma = sigma.as_ref().map(|(values, axes)| pair(values, *axes, step, point));
            match [x, y, xd, yd].iter().all(|v| v.is_finite()) {
                true => found.points.push(meaning.point([x, y, xd - x, yd - y], sigma)),
                false => found.n_invalid += 1,
            }
        }
        found
    };
    Ok((1..steps).map(frame).collect())
}
