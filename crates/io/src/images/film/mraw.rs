//! Films of Photron cameras: frames one behind the other in `NAME.mraw`, described in `NAME.cih` or `NAME.cihx` beside it.

use super::{Bytes, Coding, ImageFault, LargeFile, Recorded, Rows, has_ending};
use crate::text::{decoded, read_regular};
use std::path::{Path, PathBuf};

/// A description is no longer than this.
const LONGEST: usize = 1 << 20;

pub(super) fn read(path: &Path, file: Box<dyn Bytes + Send>) -> Result<Recorded, ImageFault> {
    let beside = |endings: [&str; 4], what: &str| {
        let files: [PathBuf; 4] = endings.map(|ending| path.with_extension(ending));
        let missing = || ImageFault::Corrupt(format!("{what} is not beside it: {}", files[0].display()));
        files.iter().find(|file| file.is_file()).cloned().ok_or_else(missing)
    };
    let unreadable = |path: &Path, reason| ImageFault::Corrupt(format!("{}: {reason}", path.display()));
    let (text, film) = if has_ending(path, &["mraw"]) {
        let about = beside(["cihx", "cih", "CIHX", "CIH"], "its description (cihx or cih)")?;
        (read_regular(&about).map_err(|reason| unreadable(&about, reason))?, file)
    } else {
        let text = file.piece(0, file.len().min(LONGEST)).unwrap_or_default().into_owned();
        let film = beside(["mraw", "MRAW", "Mraw", "MRaw"], "the film that it describes")?;
        let open = LargeFile::open(&film).map_err(|reason| unreadable(&film, reason))?;
        (text, Box::new(open) as Box<dyn Bytes + Send>)
    };
    let (text, _) =
        decoded(&text).map_err(|line| ImageFault::Corrupt(format!("line {line} of its description is no text")))?;
    let (rows, n, frames_per_second) = describe(&text)?;
    let size =
        rows.bytes().filter(|&size| size > 0).ok_or_else(|| ImageFault::Corrupt("its frames have no pixels".into()))?;
    let there = film.len() / size;
    if n == 0 || there < n {
        return Err(ImageFault::Truncated(format!(
            "its description says that it holds {n} frames, and it holds {there}"
        )));
    }
    let frames = (0..n).map(|k| (k * size, size)).collect();
    Ok(Recorded { file: film, frames, coding: Coding::Rows(rows), frames_per_second })
}

/// The pixels, the number of frames, and frames per second that a description gives.
fn describe(text: &str) -> Result<(Rows, usize, Option<f64>), ImageFault> {
    // Lines `Key : value` (cih), or elements (cihx), which may follow other bytes.
    let line = |key: &str| {
        text.lines()
            .find_map(|line| line.split_once(':').filter(|(name, _)| name.trim() == key))
            .map(|(_, value)| value.trim())
    };
    let element = |within: &str, name: &str| {
        let (_, rest) = text.split_once(&format!("<{within}>"))?;
        let (_, rest) = rest.split_once(&format!("<{name}>"))?;
        rest.split_once('<').map(|(value, _)| value.trim())
    };
    let value = |key: &str, within: &str, name: &str| line(key).or_else(|| element(within, name));
    let number = |key: &str, within: &str, name: &str| {
        let found = value(key, within, name).and_then(|value| value.parse::<usize>().ok());
        found.ok_or_else(|| ImageFault::Corrupt(format!("its description does not give `{key}`")))
    };
    let bits = number("Color Bit", "colorInfo", "bit")?;
    let depth = number("EffectiveBit Depth", "effectiveBit", "depth").ok().filter(|depth| (1..16).contains(depth));
    let is_low =
        value("EffectiveBit Side", "effectiveBit", "side").is_none_or(|side| side.eq_ignore_ascii_case("lower"));
    if value("Color Type", "colorInfo", "type").is_some_and(|kind| !kind.to_lowercase().starts_with("mono")) {
        return Err(ImageFault::Unsupported("a film of a colour camera".into()));
    }
    if !matches!(bits, 8 | 10 | 12 | 16) {
        return Err(ImageFault::Unsupported(format!("{bits} bits per pixel")));
    }
    let rows = Rows {
        width: number("Image Width", "resolution", "width")?,
        height: number("Image Height", "resolution", "height")?,
        bits,
        aligned: 1,
        bottom_up: false,
        palette: None,
        white: depth.filter(|_| bits == 16 && is_low).map(|depth| ((1_u32 << depth) - 1) as f32),
    };
    let rate = value("Record Rate(fps)", "recordInfo", "recordRate").and_then(|rate| rate.parse::<f64>().ok());
    let frames_per_second = rate.filter(|rate| rate.is_finite() && *rate > 0.0);
    Ok((rows, number("Total Frame", "frameInfo", "totalFrame")?, frames_per_second))
}
