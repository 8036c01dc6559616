//! A record joined with frames by time.

use super::clock::{DAY, clock_time, days_of};
use super::error::LoadError;
use super::raw::{RawTable, Wanted};
use super::remarks::{clock_times, outside};
use super::source::Source;
use super::{LoadColumn, LoadTable};
use std::path::Path;

/// When the deformed images were taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTimes {
    /// Of each deformed image, from frame 1 on, s; `None` where it is not known.
    seconds: Vec<Option<f64>>,
    /// Of the reference, where it is known.
    reference: Option<f64>,
    /// Whether they are clock times.
    clock: bool,
}

impl FrameTimes {
    /// A frame every `interval_s`, the reference at `start_s`: frame n of `n_frames` at `start_s + n interval_s`.
    pub fn every(interval_s: f64, start_s: f64, n_frames: usize) -> Self {
        let seconds = (1..=n_frames).map(|n| Some(start_s + n as f64 * interval_s)).collect();
        Self { seconds, reference: Some(start_s), clock: false }
    }

    /// A column of a table of loads.
    pub(super) fn column(&self, name: String) -> LoadColumn {
        LoadColumn { name, values: self.seconds.clone(), reference: self.reference }
    }

    /// The times of the frames, s.
    pub fn seconds(&self) -> &[Option<f64>] {
        &self.seconds
    }

    /// The same times, `seconds` later.
    #[must_use]
    pub fn later(mut self, seconds: f64) -> Self {
        self.seconds.iter_mut().chain([&mut self.reference]).flatten().for_each(|time| *time += seconds);
        self
    }
}

/// The file of times `text`; `path` stands in messages. See [`read_frame_times`](super::read_frame_times).
pub fn parse_frame_times(text: &str, path: &Path, n_frames: usize) -> Result<FrameTimes, LoadError> {
    frame_times_of(&Source::of(text), path, n_frames)
}

pub(super) fn frame_times_of(source: &Source, path: &Path, n_frames: usize) -> Result<FrameTimes, LoadError> {
    const NAMES: [&str; 3] = ["time", "timestamp", "t"];
    // Beside the times a camera may write names and settings.
    let table = match RawTable::parse(source, path, Wanted::Only(&NAMES)) {
        Err(LoadError::Empty(_, "column of values")) => RawTable::parse(source, path, Wanted::All)?,
        table => table?,
    };
    if table.columns.len() > 1 {
        let columns = table.columns.clone();
        return Err(LoadError::NoTime(path.to_owned(), "time".to_owned(), columns));
    }
    let column = 0;
    let frames = table.frames(n_frames)?;
    let Times { seconds, clock } = Times::of(&table, column)?;
    let (mut of_frames, mut reference) = (vec![None; n_frames], None);
    for (frame, time) in frames.into_iter().zip(seconds) {
        let of_frame = match frame.checked_sub(1) {
            None => Some(&mut reference),
            Some(at) => of_frames.get_mut(at),
        };
        if let Some(of_frame) = of_frame {
            *of_frame = time;
        }
    }
    Ok(FrameTimes { seconds: of_frames, reference, clock })
}

struct Times {
    seconds: Vec<Option<f64>>,
    clock: bool,
}

impl Times {
    #[expect(clippy::indexing_slicing, reason = "columns are counted by the callers")]
    fn of(table: &RawTable, column: usize) -> Result<Self, LoadError> {
        let cells = || (0..table.n_rows()).map(|row| table.cell(row, column));
        let clock = cells().find(|cell| !cell.is_empty()).is_some_and(|cell| clock_time(cell).is_some());
        let name = &table.columns[column];
        if !clock && !name.ends_with("_s") {
            return Err(LoadError::TimeUnit(table.path().to_owned(), name.clone()));
        }
        let time = |row: usize| match (table.cell(row, column), clock) {
            ("", true) => Ok(None),
            (cell, true) => clock_time(cell).map(Some).ok_or_else(|| LoadError::Number {
                path: table.path().to_owned(),
                line: table.line(row),
                column: name.clone(),
                text: cell.to_owned(),
            }),
            (_, false) => table.value(row, column),
        };
        let mut seconds: Vec<Option<f64>> = (0..table.n_rows()).map(time).collect::<Result<_, _>>()?;
        if clock && !cells().any(|cell| days_of(cell).is_some()) {
            pass_midnight(&mut seconds);
        }
        Ok(Self { seconds, clock })
    }
}

/// See [`parse_record`](super::parse_record).
pub(super) fn join(table: &RawTable, time: &str, frames: &FrameTimes) -> Result<LoadTable, LoadError> {
    let path = || table.path().to_owned();
    let found = table.called(time).and_then(|column| Some((column, table.columns.get(column)?.clone())));
    let Some((column, name)) = found else {
        return Err(LoadError::NoTime(path(), time.to_owned(), table.columns.clone()));
    };
    let times = Times::of(table, column)?;
    let mut rows: Vec<f64> = Vec::with_capacity(table.n_rows());
    for (row, time) in times.seconds.iter().enumerate() {
        match time {
            Some(time) if rows.last().is_none_or(|last| last <= time) => rows.push(*time),
            _ => return Err(LoadError::TimeOrder { path: path(), line: table.line(row), column: name }),
        }
    }
    let mut remarks = table.remarks.clone();
    match (times.clock, frames.clock) {
        (false, true) => return Err(LoadError::Clocks(path(), name)),
        (true, false) => {
            remarks.push(clock_times(&name, table.cell(0, column)));
            let first = rows.first().copied().unwrap_or(0.0);
            rows.iter_mut().for_each(|time| *time -= first);
        }
        _ => {}
    }
    let (Some(&from), Some(&to)) = (rows.first(), rows.last()) else {
        return Err(LoadError::Empty(path(), "row"));
    };
    let within = |time: &f64| (from..=to).contains(time);
    let known = || frames.seconds.iter().flatten();
    if let (Some(first), Some(last)) = (known().copied().reduce(f64::min), known().copied().reduce(f64::max))
        && !known().any(within)
    {
        return Err(LoadError::Apart { path: path(), from, to, first, last });
    }
    remarks.extend(outside(&frames.seconds, within, from, to));
    let joined = |k: usize, name: String| -> Result<LoadColumn, LoadError> {
        let cells = (0..rows.len()).map(|row| table.value(row, k)).collect::<Result<Vec<_>, _>>()?;
        let of = |time: &Option<f64>| at(&rows, &cells, (*time)?);
        Ok(LoadColumn { name, values: frames.seconds.iter().map(of).collect(), reference: of(&frames.reference) })
    };
    let mut columns = Vec::with_capacity(table.columns.len());
    for (k, column_name) in table.columns.iter().enumerate() {
        columns.push(match k == column {
            true if name.ends_with("_s") => frames.column(name.clone()),
            true => frames.column(format!("{name}_s")),
            false => joined(k, column_name.clone())?,
        });
    }
    Ok(LoadTable { columns, remarks })
}

/// The value at `time` between the rows at `rows`; `None` outside of them, and between cells of which one is empty.
fn at(rows: &[f64], cells: &[Option<f64>], time: f64) -> Option<f64> {
    let after = rows.partition_point(|&row| row < time);
    if rows.get(after) == Some(&time) {
        return cells.get(after).copied().flatten();
    }
    let before = after.checked_sub(1)?;
    let (low, high) = ((*cells.get(before)?)?, (*cells.get(after)?)?);
    let (from, to) = (rows.get(before)?, rows.get(after)?);
    Some(low + (high - low) * (time - from) / (to - from))
}

/// Adds a day to the clock times behind midnight: where they fall by more than half a day.
fn pass_midnight(seconds: &mut [Option<f64>]) {
    let (mut day, mut last) = (0.0, f64::NEG_INFINITY);
    for time in seconds.iter_mut().flatten() {
        if *time + day < last - 0.5 * DAY {
            day += DAY;
        }
        *time += day;
        last = *time;
    }
}
