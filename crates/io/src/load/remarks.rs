//! What there is to say of a load file.

use crate::case::CaseLoad;
use crate::remark::{About, Code, Remark};

/// Frames that are named, at most.
const NAMED: usize = 4;

fn converted(text: String) -> Remark {
    Remark::new(Code::LoadConverted, About::Load, text)
}

/// The file is no UTF-8 text.
pub(super) fn encoding(name: &str) -> Remark {
    converted(format!("the load file is read as {name}, not as UTF-8"))
}

/// Lines before the header, up to line `last`.
pub(super) fn preamble(last: u64) -> Remark {
    let lines = if last == 1 { "line 1 is".to_owned() } else { format!("lines 1 to {last} are") };
    converted(format!("{lines} before the header of the load file and not read"))
}

/// A column whose numbers have marks between thousands, as in `cell`.
pub(super) fn thousands(name: &str, cell: &str, value: f64) -> Remark {
    converted(format!("{name}: a mark between thousands in the load file, {cell} is {value}"))
}

/// A column in another unit.
pub(super) fn unit(name: &str, given: &str, factor: f64) -> Remark {
    converted(format!("{name}: {given} in the load file, times {factor}")).with("factor", factor)
}

/// The column of stresses, made of the `force` over an area.
pub(super) fn stress(name: &str, force: &str, area_mm2: f64) -> Remark {
    converted(format!("{name}: {force} over {area_mm2} mm2")).with("area_mm2", area_mm2)
}

/// A column of clock times whose first is `begin`.
pub(super) fn clock_times(name: &str, begin: &str) -> Remark {
    converted(format!("{name}: clock times, counted from the first row ({begin})"))
}

/// Where the times of the frames are from.
pub(super) fn joined(load: &CaseLoad) -> Remark {
    let start = load.start_s.unwrap_or(0.0);
    let frames = match (load.frame_interval_s, &load.frame_times) {
        (Some(interval), _) => format!("the reference at {start} s, a frame every {interval} s after it"),
        (None, Some(file)) if start != 0.0 => format!("frames at the times of {file}, {start} s later"),
        (None, file) => format!("frames at the times of {}", file.as_deref().unwrap_or("-")),
    };
    converted(format!("load joined by time, interpolated: {frames}")).with("start_s", start)
}

/// Frames that were not taken during the record, `from` to `to` s; `None` where all were.
pub(super) fn outside(frames: &[Option<f64>], within: impl Fn(&f64) -> bool, from: f64, to: f64) -> Option<Remark> {
    let out: Vec<usize> =
        (1..).zip(frames).filter(|(_, time)| !time.as_ref().is_some_and(&within)).map(|(n, _)| n).collect();
    let first: Vec<String> = out.iter().take(NAMED).map(ToString::to_string).collect();
    let more = match out.len() {
        0 => return None,
        1 => " lies".to_owned(),
        n if n > NAMED => format!(" and {} more lie", n - NAMED),
        _ => " lie".to_owned(),
    };
    let text = format!(
        "frame{} {}{more} outside the load record ({from} to {to} s): cells are empty",
        if out.len() == 1 { "" } else { "s" },
        first.join(", "),
    );
    Some(Remark::new(Code::LoadOutside, About::Frames(out), text).with("from_s", from).with("to_s", to))
}
