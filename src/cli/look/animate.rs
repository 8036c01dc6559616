//! Figures of a series that move: `quadrille figures --format gif|apng|mp4`.

use crate::cli::Result;
use crate::cli::args::FileKind;
use crate::report::{Animated, Animation, Figure, Moved, Picture};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Pictures that are coded at a time.
const AT_A_TIME: usize = 16;
/// How long a whole series takes, ms, and the least and the most of a frame.
const WHOLE_MS: usize = 8000;
const LEAST_MS: usize = 40;
const MOST_MS: usize = 500;

/// Writes the `pictures` of `figure` into `folder`, one after the other, in each of `kinds`; gives the files. They were
/// drawn of `n_frames`.
pub(crate) fn write_moving(
    pictures: &[Picture],
    n_frames: usize,
    (folder, figure): (&Path, Figure),
    kinds: &[FileKind],
    pool: &ThreadPool,
) -> Result<Vec<PathBuf>> {
    if pictures.is_empty() {
        return Ok(Vec::new());
    }
    let ms = (WHOLE_MS / n_frames.max(1)).clamp(LEAST_MS, MOST_MS) as u16;
    // As large as the largest: notes below a map need more lines in some frames.
    let largest =
        |side: fn(&Picture) -> u32| pictures.iter().map(side).max().unwrap_or(0).min(u32::from(u16::MAX)) as u16;
    let size = [largest(Picture::width), largest(Picture::height)];
    std::fs::create_dir_all(folder)?;
    let write = |kind: &FileKind| -> Result<PathBuf> {
        let path = folder.join(format!("{figure}.{}", kind.name()));
        match kind.animated() {
            Some(animated) => write_animation(&path, animated, pictures, size, ms, pool)?,
            None => write_video(&path, pictures, size, ms)?,
        }
        Ok(path)
    };
    kinds.iter().map(write).collect()
}

fn write_animation(
    path: &Path,
    kind: Animated,
    pictures: &[Picture],
    size: [u16; 2],
    ms: u16,
    pool: &ThreadPool,
) -> Result<()> {
    let mut animation = Animation::create(path, kind, size, pictures.len(), ms)?;
    for some in pictures.chunks(AT_A_TIME) {
        let one = |picture: &Picture| Moved::new(kind, on_sheet(picture, size), size, ms);
        let made: Vec<Moved> = pool.install(|| some.par_iter().map(one).collect());
        for frame in made {
            animation.add(frame)?;
        }
    }
    Ok(animation.finish()?)
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

/// By the program ffmpeg.
fn write_video(path: &Path, pictures: &[Picture], size: [u16; 2], ms: u16) -> Result<()> {
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
    let _ = feed(&mut ffmpeg, pictures, size);
    let status = ffmpeg.wait()?;
    if !status.success() {
        return Err(format!("{}: ffmpeg could not write it ({status})", path.display()).into());
    }
    Ok(())
}

fn feed(ffmpeg: &mut Child, pictures: &[Picture], size: [u16; 2]) -> std::io::Result<()> {
    let Some(mut stdin) = ffmpeg.stdin.take() else { return Ok(()) };
    pictures.iter().try_for_each(|picture| stdin.write_all(&on_sheet(picture, size)))
}
