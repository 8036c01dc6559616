//! A record joined with frames by time.

use super::error::LoadError;
use super::raw::{RawTable, Wanted};
use super::remarks::{clock_times, outside};
use super::{LoadColumn, LoadTable};
use std::path::Path;

/// When the deformed images were taken.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameTimes {
    /// Of each deformed image, from frame 1 on, s; `None` where it is not known.
    seconds: Vec<Option<f64>>,
    /// Whether they are clock times.
    clock: bool,
}

impl FrameTimes {
    /// A frame every `interval_s`, the reference at `start_s`: frame n of `n_frames` at `start_s + n interval_s`.
    pub fn every(interval_s: f64, start_s: f64, n_frames: usize) -> Self {
        Self { seconds: (1..=n_frames).map(|n| Some(start_s + n as f64 * interval_s)).collect(), clock: false }
    }

    /// The times of the frames, s.
    pub fn seconds(&self) -> &[Option<f64>] {
        &self.seconds
    }

    /// The same times, `seconds` later.
    #[must_use]
    pub fn later(mut self, seconds: f64) -> Self {
        self.seconds.iter_mut().flatten().for_each(|time| *time += seconds);
        self
    }
}

/// The file of times `text`; `path` stands in messages. See [`read_frame_times`](super::read_frame_times).
pub fn parse_frame_times(text: &str, path: &Path, n_frames: usize) -> Result<FrameTimes, LoadError> {
    const NAMES: [&str; 3] = ["time", "timestamp", "t"];
    // Beside the times a camera may write names and settings.
    let table = match RawTable::parse(text, path, Wanted::Only(&NAMES)) {
        Err(LoadError::Empty(_, "column of values")) => RawTable::parse(text, path, Wanted::All)?,
        table => table?,
    };
    if table.columns.len() > 1 {
        let columns = table.columns.clone();
        return Err(LoadError::NoTime(path.to_owned(), "time".to_owned(), columns));
    }
    let column = 0;
    let frames = table.frames(n_frames)?;
    let Times { seconds, clock } = Times::of(&table, column)?;
    let mut of_frames = vec![None; n_frames];
    for (frame, time) in frames.into_iter().zip(seconds) {
        if let Some(of_frame) = frame.checked_sub(1).and_then(|at| of_frames.get_mut(at)) {
            *of_frame = time;
        }
    }
    Ok(FrameTimes { seconds: of_frames, clock })
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
        Ok(Self { seconds: (0..table.n_rows()).map(time).collect::<Result<_, _>>()?, clock })
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
    let values = |k: usize| -> Result<Vec<Option<f64>>, LoadError> {
        let cells = (0..rows.len()).map(|row| table.value(row, k)).collect::<Result<Vec<_>, _>>()?;
        Ok(frames.seconds.iter().map(|time| at(&rows, &cells, (*time)?)).collect())
    };
    let mut columns = Vec::with_capacity(table.columns.len());
    for (k, column_name) in table.columns.iter().enumerate() {
        let (name, values) = match k == column {
            true if name.ends_with("_s") => (name.clone(), frames.seconds.clone()),
            true => (format!("{name}_s"), frames.seconds.clone()),
            false => (column_name.clone(), values(k)?),
        };
        columns.push(LoadColumn { name, values });
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

/// Seconds of a clock time, `10:31:05.20`, behind a day (`2024-05-07 10:31:05`, `07.05.2024`, T, Z) since 1970.
fn clock_time(cell: &str) -> Option<f64> {
    let cell = cell.trim().trim_end_matches('Z');
    let (day, clock) = match cell.split_once([' ', 'T']) {
        Some((day, clock)) => (days(day)?, clock.trim()),
        None => (0.0, cell),
    };
    let parts: Vec<&str> = clock.split(':').collect();
    let whole = |text: &str| text.parse::<u32>().ok().map(f64::from);
    let (hours, minutes, seconds) = match parts.as_slice() {
        [h, m] => (whole(h)?, whole(m)?, 0.0),
        [h, m, s] => (whole(h)?, whole(m)?, s.replacen(',', ".", 1).parse::<f64>().ok()?),
        _ => return None,
    };
    let fits = minutes < 60.0 && (0.0..61.0).contains(&seconds);
    fits.then_some(86400.0 * day + 3600.0 * hours + 60.0 * minutes + seconds)
}

/// Days since 1970 of `2024-05-07`, `2024/05/07` or `07.05.2024`.
fn days(text: &str) -> Option<f64> {
    let parts: Vec<i64> = text.split(['-', '/', '.']).map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let [a, month, c] = parts.as_slice() else { return None };
    // 05/07/2024 may be May or July: not guessed.
    let (year, day) = match (*a > 31, text.contains('.')) {
        (true, _) => (*a, *c),
        (false, true) => (*c, *a),
        _ => return None,
    };
    if !(1..=12).contains(month) || !(1..=31).contains(&day) || !(0..=9999).contains(&year) {
        return None;
    }
    // Days from civil, counted from March so that the leap day is the last of its year.
    let (y, m) = if *month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let era = y.div_euclid(400);
    let of_era = y - 400 * era;
    let of_year = (153 * m + 2) / 5 + day - 1;
    Some((146_097 * era + 365 * of_era + of_era / 4 - of_era / 100 + of_year - 719_468) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_times_count_seconds_and_days() {
        assert_eq!(clock_time("10:31:05.20"), Some(10.0 * 3600.0 + 31.0 * 60.0 + 5.2));
        assert_eq!(clock_time("10:31:05,5"), Some(10.0 * 3600.0 + 31.0 * 60.0 + 5.5));
        // date -u -d '2024-02-29 00:00:10' +%s
        assert_eq!(clock_time("2024-02-29T00:00:10Z"), Some(1_709_164_810.0));
        assert_eq!(clock_time("29.02.2024 00:00:10"), Some(1_709_164_810.0));
        for text in ["12.5", "10:61:00", "05/07/2024 10:00", "10:00:00:00", "", "abc", "5316520459965841-05-07 10:31"] {
            assert_eq!(clock_time(text), None, "{text}");
        }
    }
}
