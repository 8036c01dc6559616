//! Videos of every other kind, by the program ffmpeg: it lists the frames with their times, and sends them through a
//! pipe as PGM images.

use crate::images::packed::decode;
use crate::images::raw::{Accepted, ImageFault, Raw, check_size};
use image::ImageFormat;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// So many frames are rather passed over than sought.
const NEAR: usize = 100;

#[derive(Debug)]
pub(crate) struct Ffmpeg {
    path: PathBuf,
    /// Of each frame, as they are shown.
    times_s: Vec<f64>,
    /// Whether levels have more than 8 bits.
    is_deep: bool,
    /// Whether the file has an index: streams without one are searched inexactly.
    has_index: bool,
    /// The option with which frames are neither doubled nor dropped to keep a rate: its name has changed with version 5.
    every_frame: [&'static str; 2],
    running: Option<Running>,
}

/// A process, and the frame that it sends next.
#[derive(Debug)]
struct Running {
    process: Child,
    pipe: BufReader<ChildStdout>,
    next: usize,
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Ffmpeg {
    /// Lists the frames of the video `path`; `None` where there is no such program.
    pub fn open(path: &Path, has_index: bool) -> Result<Option<Self>, String> {
        let mut command = command(path, None);
        // Nothing is decoded: packets with their times, and a checksum that nobody needs.
        let output = match command.args(["-map", "0:v:0", "-c", "copy", "-f", "framecrc", "-"]).output() {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("ffmpeg does not start: {error}")),
            Ok(output) => output,
        };
        let [listed, said] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
        let times_s = times(&listed);
        if !output.status.success() || times_s.is_empty() {
            let why = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it finds no frame");
            return Err(format!("ffmpeg: {}", why.trim()));
        }
        let is_old =
            said.lines().next().is_some_and(|line| (1..5).any(|n| line.contains(&format!("ffmpeg version {n}."))));
        let every_frame = if is_old { ["-vsync", "0"] } else { ["-fps_mode", "passthrough"] };
        let is_deep = said.lines().find(|line| line.contains("Video:")).is_some_and(is_deep);
        Ok(Some(Self { path: path.to_owned(), times_s, is_deep, has_index, every_frame, running: None }))
    }

    pub fn len(&self) -> usize {
        self.times_s.len()
    }

    pub fn time_s(&self, page: usize) -> Option<f64> {
        Some(self.times_s.get(page)? - self.times_s.first()?)
    }

    pub fn decode(&mut self, page: usize, accepted: Accepted) -> Result<Raw, ImageFault> {
        let near = if self.has_index { NEAR } else { usize::MAX / 2 };
        let is_near = |running: &Running| (running.next..=running.next + near).contains(&page);
        let mut running = match self.running.take().filter(is_near) {
            Some(running) => running,
            None => self.start(if self.has_index { page } else { 0 })?,
        };
        loop {
            let image = next_image(&mut running.pipe, accepted)?.ok_or_else(|| {
                let (n, next) = (self.len(), running.next);
                ImageFault::Truncated(format!(
                    "ffmpeg lists {n} frames and gives none after frame {}",
                    next.saturating_sub(1)
                ))
            })?;
            running.next += 1;
            if running.next > page {
                self.running = Some(running);
                return decode(&image, ImageFormat::Pnm, accepted);
            }
        }
    }

    /// A process that begins with the frame `page`.
    fn start(&self, page: usize) -> Result<Running, ImageFault> {
        // Between the frame before and this one: times are rounded.
        let before = page.checked_sub(1).and_then(|before| self.times_s.get(before)).copied();
        let from = before.zip(self.times_s.get(page).copied()).map(|(before, time)| (before + time) / 2.0);
        let mut command = command(&self.path, from);
        command.args(["-map", "0:v:0", "-f", "image2pipe", "-c:v", "pgm"]).args(self.every_frame);
        command.args(["-pix_fmt", if self.is_deep { "gray16be" } else { "gray" }, "-"]);
        let failed = |error| ImageFault::Corrupt(format!("ffmpeg does not start: {error}"));
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().map_err(failed)?;
        let pipe = process.stdout.take().ok_or_else(|| failed(ErrorKind::BrokenPipe.into()))?;
        Ok(Running { process, pipe: BufReader::new(pipe), next: page })
    }
}

/// ffmpeg on the file `path` alone, from `from_s` on; the name is never taken for an option or an address.
fn command(path: &Path, from_s: Option<f64>) -> Command {
    let mut command = Command::new("ffmpeg");
    command.stdin(Stdio::null()).arg("-nostdin");
    if let Some(from) = from_s {
        command.args(["-ss", &format!("{from:.6}")]);
    }
    let mut name = OsString::from("file:");
    name.push(path);
    command.arg("-i").arg(name);
    command
}

/// The times of the frames of a list of packets, as they are shown.
fn times(listed: &str) -> Vec<f64> {
    let unit = listed.lines().find_map(|line| {
        let (numerator, denominator) = line.strip_prefix("#tb 0:")?.trim().split_once('/')?;
        Some((numerator.parse::<f64>().ok()?, denominator.parse::<f64>().ok()?))
    });
    let time = |line: &str| {
        let mut fields = line.split(',').map(|field| field.trim().parse::<i64>().ok());
        let (decoded, shown) = (fields.nth(1)??, fields.next()??);
        // A packet may not say when it is shown.
        let (numerator, denominator) = unit?;
        Some(if shown == i64::MIN { decoded } else { shown } as f64 * numerator / denominator)
    };
    let mut times: Vec<f64> = listed.lines().filter(|line| !line.starts_with('#')).filter_map(time).collect();
    times.sort_by(f64::total_cmp);
    times
}

/// Whether a line about a stream names pixels of more than 8 bits: `yuv420p10le`, `gray12be`.
fn is_deep(line: &str) -> bool {
    const DEPTHS: [&str; 6] = ["p9", "10", "12", "14", "16", "48"];
    let bare = |word: &str| word.strip_suffix("le").or_else(|| word.strip_suffix("be")).map(str::to_owned);
    let mut words = line.split(|letter: char| !letter.is_ascii_alphanumeric()).filter_map(bare);
    words.any(|word| DEPTHS.iter().any(|depth| word.ends_with(depth)))
}

/// The next image of the pipe, its header included; `None` at its end.
fn next_image(pipe: &mut impl BufRead, accepted: Accepted) -> Result<Option<Vec<u8>>, ImageFault> {
    let cut = |_| ImageFault::Truncated("what ffmpeg sends ends within a frame".into());
    let mut image = Vec::new();
    for _ in 0..3 {
        // `P5`, columns and rows, and the largest level: a line each.
        pipe.take(64).read_until(b'\n', &mut image).map_err(cut)?;
    }
    if image.is_empty() {
        return Ok(None);
    }
    let header = String::from_utf8_lossy(&image);
    let sizes: Vec<u64> = header.split_whitespace().skip(1).filter_map(|number| number.parse().ok()).collect();
    let &[width, height, largest] = sizes.as_slice() else {
        return Err(ImageFault::Corrupt("what ffmpeg sends is no PGM image".into()));
    };
    let size = u128::from(width) * u128::from(height) * if largest > 255 { 2 } else { 1 };
    check_size(accepted, width, height, size, 1, usize::MAX)?;
    let wanted = image.len() as u128 + size;
    pipe.take(size as u64).read_to_end(&mut image).map_err(cut)?;
    if (image.len() as u128) < wanted {
        return Err(ImageFault::Truncated("what ffmpeg sends ends within a frame".into()));
    }
    Ok(Some(image))
}
