//! A series of pictures that move: GIF (256 colours a frame) and animated PNG (all colours).

use super::ReportError;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A kind of animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Animated {
    /// For slides and mails: everything shows it.
    Gif,
    /// Without loss; browsers show it.
    Apng,
}

impl Animated {
    /// Ending of the file's name, also the name used in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gif => "gif",
            Self::Apng => "apng",
        }
    }
}

/// A frame of an animation, ready to be written. Made on any thread.
#[derive(Debug)]
pub struct Moved(Kind);

#[derive(Debug)]
enum Kind {
    Gif(gif::Frame<'static>),
    Apng(Vec<u8>),
}

/// Speed of the choice of colours, 1 (best) to 30.
const SPEED: i32 = 10;

impl Moved {
    /// The frame with these pixels (red, green, blue, row by row) of `size` columns and rows, for `ms` milliseconds.
    pub fn new(kind: Animated, rgb: Vec<u8>, size: [u16; 2], ms: u16) -> Self {
        Self(match kind {
            Animated::Apng => Kind::Apng(rgb),
            Animated::Gif => {
                let mut frame = gif::Frame::from_rgb_speed(size[0], size[1], &rgb, SPEED);
                frame.delay = (ms / 10).max(2);
                frame.make_lzw_pre_encoded();
                Kind::Gif(frame)
            }
        })
    }
}

/// An animation that is written, frame after frame. The file is there when it is whole.
pub struct Animation {
    path: PathBuf,
    unfinished: PathBuf,
    out: Out,
}

enum Out {
    Gif(Box<gif::Encoder<BufWriter<File>>>),
    Apng(Box<png::Writer<BufWriter<File>>>),
}

impl std::fmt::Debug for Animation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Animation").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Animation {
    /// One of `n` frames of `size` columns and rows, each shown for `ms` milliseconds, again and again.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn create(path: &Path, kind: Animated, size: [u16; 2], n: usize, ms: u16) -> Result<Self, ReportError> {
        let unfinished = path.with_added_extension("part");
        let failed = |source| ReportError::Write { path: path.to_owned(), source };
        let file = BufWriter::new(File::create(&unfinished).map_err(failed)?);
        let out = match kind {
            Animated::Gif => {
                let encoder = gif::Encoder::new(file, size[0], size[1], &[]).and_then(|mut encoder| {
                    encoder.set_repeat(gif::Repeat::Infinite)?;
                    Ok(encoder)
                });
                Out::Gif(Box::new(encoder.map_err(|error| failed(io::Error::other(error)))?))
            }
            Animated::Apng => {
                let mut encoder = png::Encoder::new(file, size[0].into(), size[1].into());
                encoder.set_color(png::ColorType::Rgb);
                let made = encoder.set_animated(n.max(1) as u32, 0).and_then(|()| encoder.set_frame_delay(ms, 1000));
                let writer = made.and_then(|()| encoder.write_header());
                Out::Apng(Box::new(writer.map_err(|error| failed(io::Error::other(error)))?))
            }
        };
        Ok(Self { path: path.to_owned(), unfinished, out })
    }

    /// Adds the next frame.
    ///
    /// # Errors
    /// A file that cannot be written; a frame of another kind or size.
    pub fn add(&mut self, frame: Moved) -> Result<(), ReportError> {
        let added = match (&mut self.out, frame.0) {
            (Out::Gif(encoder), Kind::Gif(frame)) => {
                encoder.write_lzw_pre_encoded_frame(&frame).map_err(io::Error::other)
            }
            (Out::Apng(writer), Kind::Apng(rgb)) => writer.write_image_data(&rgb).map_err(io::Error::other),
            _ => Err(io::Error::other("a frame of another kind of animation")),
        };
        added.map_err(|source| ReportError::Write { path: self.path.clone(), source })
    }

    /// Ends the file.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self) -> Result<(), ReportError> {
        let Self { path, unfinished, out } = self;
        let ended = match out {
            Out::Gif(encoder) => encoder.into_inner().map_err(io::Error::other).and_then(|mut file| file.flush()),
            Out::Apng(writer) => writer.finish().map_err(io::Error::other),
        };
        let ended = ended.and_then(|()| std::fs::rename(&unfinished, &path));
        ended.map_err(|source| ReportError::Write { path, source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frames_of_an_animation_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let size = [6, 4];
        let shade = |k: usize| -> Vec<u8> { (0..72).map(|at| if at % 3 == k { 250 } else { 10 }).collect() };
        for kind in [Animated::Gif, Animated::Apng] {
            let path = folder.path().join(format!("a.{}", kind.name()));
            let mut animation = Animation::create(&path, kind, size, 3, 200).unwrap();
            assert!(!path.exists());
            (0..3).for_each(|k| animation.add(Moved::new(kind, shade(k), size, 200)).unwrap());
            let other = if kind == Animated::Gif { Animated::Apng } else { Animated::Gif };
            assert!(animation.add(Moved::new(other, shade(0), size, 200)).is_err());
            animation.finish().unwrap();
            let file = std::io::BufReader::new(File::open(&path).unwrap());
            match kind {
                Animated::Gif => {
                    let mut options = gif::DecodeOptions::new();
                    options.set_color_output(gif::ColorOutput::RGBA);
                    let mut reader = options.read_info(file).unwrap();
                    let mut n = 0;
                    while let Some(frame) = reader.read_next_frame().unwrap() {
                        assert_eq!(frame.delay, 20);
                        let rgb: Vec<u8> = frame.buffer.chunks(4).flat_map(|p| p[..3].to_vec()).collect();
                        assert_eq!(rgb, shade(n), "frame {n}");
                        n += 1;
                    }
                    assert_eq!(n, 3);
                }
                Animated::Apng => {
                    let mut reader = png::Decoder::new(file).read_info().unwrap();
                    assert_eq!(reader.info().animation_control().unwrap().num_frames, 3);
                    let mut room = vec![0; 72];
                    for k in 0..3 {
                        reader.next_frame(&mut room).unwrap();
                        assert_eq!(room, shade(k), "frame {k}");
                    }
                }
            }
        }
    }
}
