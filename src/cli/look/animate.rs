//! Figures of a series that move: `quadrille figures --format gif|apng|mp4`.

use crate::cli::args::FileKind;
use crate::cli::{Result, plural};
use crate::report::{Animated, Animation, Figure, Moved, Picture};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Frames that are drawn at a time.
const AT_A_TIME: usize = 16;
/// How long a whole series takes, ms, and the least and the most of a frame.
const WHOLE_MS: usize = 8000;
const LEAST_MS: usize = 40;
const MOST_MS: usize = 500;

/// How one frame of a figure comes to be a picture.
pub(crate) type Draw<'a> = &'a (dyn Fn(usize, Figure, Option<(f64, f64)>) -> Result<Option<Picture>> + Sync);
/// Its values: between which ends they lie.
pub(crate) type Ends<'a> = &'a (dyn Fn(usize, Figure) -> Result<Option<[f64; 2]>> + Sync);

/// A figure of a series as files that move.
pub(crate) struct Moving<'a> {
    pub numbers: &'a [usize],
    pub folder: &'a Path,
    pub pool: &'a ThreadPool,
    /// Ends of the colours, where they were asked for.
    pub range: Option<(f64, f64)>,
    pub draw: Draw<'a>,
    pub ends: Ends<'a>,
}

impl Moving<'_> {
    /// Writes `figure` in each of `kinds`; gives the files.
    pub fn write(&self, figure: Figure, kinds: &[FileKind]) -> Result<Vec<PathBuf>> {
        let range = self.range.map_or_else(|| self.common_range(figure), |range| Ok(Some(range)))?;
        let n = self.numbers.len();
        let ms = (WHOLE_MS / n.max(1)).clamp(LEAST_MS, MOST_MS) as u16;
        // As large as the largest: notes below a map need more lines in some frames.
        let mut size = [0, 0];
        let mut pictures: Vec<Picture> = Vec::new();
        for numbers in self.numbers.chunks(AT_A_TIME) {
            pictures.extend(self.drawn(numbers, figure, range)?);
        }
        for picture in &pictures {
            size = [size[0].max(picture.width()), size[1].max(picture.height())];
        }
        if pictures.is_empty() {
            return Ok(Vec::new());
        }
        let size = size.map(|side| side.min(u32::from(u16::MAX)) as u16);
        let mut files = Vec::new();
        std::fs::create_dir_all(self.folder)?;
        for &kind in kinds {
            let path = self.folder.join(format!("{figure}.{}", kind.name()));
            match kind.animated() {
                Some(animated) => self.animation(&path, animated, &pictures, size, ms)?,
                None => video(&path, &pictures, size, ms)?,
            }
            files.push(path);
        }
        Ok(files)
    }

    fn drawn(&self, numbers: &[usize], figure: Figure, range: Option<(f64, f64)>) -> Result<Vec<Picture>> {
        let drawn = self.pool.install(|| {
            numbers.par_iter().map(|&number| (self.draw)(number, figure, range)).collect::<Result<Vec<_>>>()
        });
        Ok(drawn?.into_iter().flatten().collect())
    }

    /// Ends that hold the values of all frames; of a strain the same on both sides of zero.
    fn common_range(&self, figure: Figure) -> Result<Option<(f64, f64)>> {
        let all = || self.numbers.par_iter().map(|&number| (self.ends)(number, figure)).collect::<Result<Vec<_>>>();
        let ends = self.pool.install(all)?.into_iter().flatten();
        let Some([low, high]) = ends.reduce(|[a, b], [low, high]| [a.min(low), b.max(high)]) else { return Ok(None) };
        let most = low.abs().max(high.abs());
        let (low, high) = if figure.is_strain() { (-most, most) } else { (low, high) };
        Ok((high > low).then_some((low, high)))
    }

    fn animation(&self, path: &Path, kind: Animated, pictures: &[Picture], size: [u16; 2], ms: u16) -> Result<()> {
        let mut animation = Animation::create(path, kind, size, pictures.len(), ms)?;
        for some in pictures.chunks(AT_A_TIME) {
            let made: Vec<Moved> = self.pool.install(|| {
                some.par_iter().map(|picture| Moved::new(kind, on_sheet(picture, size), size, ms)).collect()
            });
            for frame in made {
                animation.add(frame)?;
            }
        }
        Ok(animation.finish()?)
    }
}

/// The pixels of a picture on a white sheet of `size`.
fn on_sheet(picture: &Picture, [width, height]: [u16; 2]) -> Vec<u8> {
    let (width, height) = (usize::from(width), usize::from(height));
    let mut sheet = vec![u8::MAX; 3 * width * height];
    let own = 3 * picture.width() as usize;
    for (from, to) in picture.rgb().chunks_exact(own).zip(sheet.chunks_exact_mut(3 * width)) {
        to[..own.min(3 * width)].copy_from_slice(&from[..own.min(3 * width)]);
    }
    sheet
}

/// A video, by the program ffmpeg.
fn video(path: &Path, pictures: &[Picture], size: [u16; 2], ms: u16) -> Result<()> {
    let missing = |error: std::io::Error| {
        format!(
            "--format mp4 needs the program ffmpeg, which does not start ({error}); install it, or take gif or apng"
        )
    };
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-s", &format!("{}x{}", size[0], size[1]), "-r", &format!("1000/{ms}"), "-i", "-"])
        // Its usual coding wants even sides.
        .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"])
        .arg(path)
        .stdin(Stdio::piped())
        .spawn()
        .map_err(missing)?;
    // That it has ended shows in its status.
    let _ = fed(&mut ffmpeg, pictures, size);
    let status = ffmpeg.wait()?;
    if !status.success() {
        return Err(format!("{}: ffmpeg could not write it ({status})", path.display()).into());
    }
    Ok(())
}

fn fed(ffmpeg: &mut Child, pictures: &[Picture], size: [u16; 2]) -> std::io::Result<()> {
    let Some(mut stdin) = ffmpeg.stdin.take() else { return Ok(()) };
    pictures.iter().try_for_each(|picture| stdin.write_all(&on_sheet(picture, size)))
}

/// What is said of files that move.
pub(crate) fn said(files: &[PathBuf], n_frames: usize) -> String {
    let names: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    format!("{} of {}: {}", plural(files.len(), "animation"), plural(n_frames, "frame"), names.join(", "))
}
