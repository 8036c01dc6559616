//! A load file as a case asks for it: a row for each frame, or joined with the frames by time.

use super::error::LoadError;
use super::remarks::joined;
use super::source::Source;
use super::{FrameTimes, LoadTable, load_of, read_frame_times, record_of};
use crate::case::CaseLoad;
use std::path::Path;

/// The load file that `load` asks for, a row for each of `n_frames`; names of files are relative to the current folder.
///
/// # Errors
/// A file that cannot be read or joined, and times that are missing or given twice.
pub fn read_as_asked(load: &CaseLoad, n_frames: usize) -> Result<LoadTable, LoadError> {
    let wrong = |what: String| Err(LoadError::Times(what));
    let path = Path::new(&load.file);
    for (name, value, least) in [
        ("the interval of the frames (--frame-interval, frame_interval_s)", load.frame_interval_s, 0.0),
        ("the area of the cross-section (--area, area_mm2)", load.area_mm2, 0.0),
        ("the time of the reference (--load-start, start_s)", load.start_s, f64::NEG_INFINITY),
    ] {
        if let Some(value) = value.filter(|value| !(value.is_finite() && *value > least)) {
            let above = if least == 0.0 { " above 0" } else { "" };
            return wrong(format!("{name} is {value}; give a finite number{above}"));
        }
    }
    let start_s = load.start_s.unwrap_or(0.0);
    let times = match (&load.frame_times, load.frame_interval_s) {
        (Some(_), Some(_)) => {
            return wrong(
                "the times of the frames are given twice; give either their interval or a file of times".to_owned(),
            );
        }
        (Some(file), None) => Some(read_frame_times(Path::new(file), n_frames)?.later(start_s)),
        (None, Some(interval_s)) => Some(FrameTimes::every(interval_s, start_s, n_frames)),
        (None, None) => None,
    };
    if load.file.is_empty() {
        let asks_for_more = load.time.is_some() || load.area_mm2.is_some() || load.decimal.is_some();
        return match times.filter(|_| !asks_for_more) {
            Some(times) => Ok(LoadTable { columns: vec![times.column("time_s".to_owned())], remarks: Vec::new() }),
            None => {
                wrong("no load file is named; give --load FILE (file), or the times of the frames alone".to_owned())
            }
        };
    }
    let table = match (&load.time, times) {
        (Some(time), Some(times)) => {
            let mut table = record_of(&Source::read(path, load.decimal)?, path, time, &times)?;
            table.remarks.insert(0, joined(load));
            table
        }
        (None, None) if load.start_s.is_none() => load_of(&Source::read(path, load.decimal)?, path, n_frames)?,
        (Some(_), None) => {
            return wrong(format!(
                "{}: rows are joined with the frames by time, but nobody knows when the frames were taken; give \
                 --frame-interval S (frame_interval_s) or --frame-times FILE (frame_times)",
                path.display()
            ));
        }
        (None, _) => {
            return wrong(format!(
                "{}: times of the frames are given, but not the column of the load file to join them with; give --load-time \
                 COLUMN (time), or leave them out",
                path.display()
            ));
        }
    };
    Ok(match load.area_mm2 {
        Some(area_mm2) => table.with_stress(area_mm2, path)?,
        None => table,
    })
}
