//! Videos as stacks of images: uncompressed and MJPEG AVI, the raw films of Phantom (cine) and Photron (mraw) cameras,
//! and what the program ffmpeg reads, where it is installed.

mod avi;
mod cine;
mod ffmpeg;
mod mraw;

use super::foreign::Foreign;
use super::packed::decode;
use super::raw::{Accepted, Channels, ImageFault, Raw, check_size};
use super::upright::Orientation;
use crate::imaging::Pixels;
use crate::tiff::{Bytes, LargeFile, split_bits};
use ffmpeg::Ffmpeg;
use image::ImageFormat;
use std::io;
use std::path::Path;

/// A video that is open.
#[derive(Debug)]
pub(super) enum Film {
    Recorded(Recorded),
    /// Frames come from ffmpeg.
    Piped(Ffmpeg),
}

/// A file whose frames lie in it one by one.
#[derive(Debug)]
pub(super) struct Recorded {
    file: Box<dyn Bytes + Send>,
    /// Where each frame begins, and its bytes.
    frames: Vec<(usize, usize)>,
    coding: Coding,
    frames_per_second: Option<f64>,
}

/// What the bytes of a frame are.
#[derive(Debug)]
enum Coding {
    Jpeg,
    Rows(Rows),
}

/// Rows of uncompressed pixels.
#[derive(Debug)]
struct Rows {
    width: usize,
    height: usize,
    /// Of a pixel: 8 or 16 of grey, 24 or 32 of colours (blue first), 48 of colours of 16 bit; 10 and 12 are packed, rows
    /// without a gap.
    bits: usize,
    /// Rows begin at multiples of so many bytes.
    aligned: usize,
    bottom_up: bool,
    /// Blue, green, red and nothing of each level.
    palette: Option<Vec<u8>>,
    /// The largest level that there can be, where it is known.
    white: Option<f32>,
}

impl Film {
    /// Opens the video `path` in `file`, which `foreign` says it is.
    pub fn open(path: &Path, file: LargeFile, foreign: Foreign) -> Result<Self, ImageFault> {
        let unreadable = |why: String| ImageFault::Film(foreign.what, why, foreign.remedy(path));
        match Recorded::of(path, Box::new(file)) {
            Ok(recorded) => Ok(Self::Recorded(recorded)),
            Err(ImageFault::Unsupported(what)) => match Ffmpeg::open(path, foreign.has_index()).map_err(unreadable)? {
                Some(ffmpeg) => Ok(Self::Piped(ffmpeg)),
                None => Err(unreadable(format!("{what}, for which ffmpeg is needed, and it is not installed"))),
            },
            Err(fault) => Err(fault),
        }
    }

    /// The same of bytes at hand, without another program; `None` where they are no film that is read so.
    pub fn of(path: &Path, bytes: &[u8]) -> Option<Result<Self, ImageFault>> {
        Foreign::of(path, bytes).filter(|foreign| foreign.is_film())?;
        match Recorded::of(path, Box::new(bytes.to_vec())) {
            Err(ImageFault::Unsupported(_)) => None,
            recorded => Some(recorded.map(Self::Recorded)),
        }
    }

    pub fn len(&self) -> usize {
        match self {
            Self::Recorded(recorded) => recorded.frames.len(),
            Self::Piped(ffmpeg) => ffmpeg.len(),
        }
    }

    /// Seconds from the first frame to frame `page`.
    pub fn time_s(&self, page: usize) -> Option<f64> {
        match self {
            Self::Recorded(recorded) => recorded.frames_per_second.map(|rate| page as f64 / rate),
            Self::Piped(ffmpeg) => ffmpeg.time_s(page),
        }
    }

    pub fn take_error(&mut self) -> Option<io::Error> {
        match self {
            Self::Recorded(recorded) => recorded.file.take_error(),
            Self::Piped(_) => None,
        }
    }

    /// Decodes the frame `page`.
    pub fn decode(&mut self, page: usize, accepted: Accepted) -> Result<Raw, ImageFault> {
        let pages = self.len();
        if page >= pages {
            return Err(ImageFault::NoSuchPage { pages });
        }
        match self {
            Self::Recorded(recorded) => recorded.decode(page, accepted),
            Self::Piped(ffmpeg) => ffmpeg.decode(page, accepted),
        }
    }
}

impl Recorded {
    fn of(path: &Path, file: Box<dyn Bytes + Send>) -> Result<Self, ImageFault> {
        let head = file.piece(0, file.len().min(16)).unwrap_or_default();
        match head.as_ref() {
            [b'R', b'I', b'F', b'F', ..] => avi::read(file),
            [b'C', b'I', ..] => cine::read(file),
            _ if has_ending(path, &["mraw", "cih", "cihx"]) => mraw::read(path, file),
            _ => Err(ImageFault::Unsupported("its frames are compressed".into())),
        }
    }

    fn decode(&self, page: usize, accepted: Accepted) -> Result<Raw, ImageFault> {
        let cut = || ImageFault::Truncated(format!("frame {page} is not complete"));
        let &(at, len) = self.frames.get(page).ok_or_else(cut)?;
        if let Coding::Rows(rows) = &self.coding {
            let unpacked = rows.bytes().ok_or_else(cut)?;
            check_size(accepted, rows.width as u64, rows.height as u64, unpacked as u128, 1, len)?;
        }
        let bytes = self.file.piece(at, len).ok_or_else(cut)?;
        match &self.coding {
            Coding::Jpeg => decode(&bytes, ImageFormat::Jpeg, accepted),
            Coding::Rows(rows) => rows.decode(&bytes),
        }
    }
}

impl Rows {
    /// Bytes of a row, those that fill it up included.
    fn stride(&self) -> Option<usize> {
        self.width.checked_mul(self.bits)?.div_ceil(8).checked_next_multiple_of(self.aligned)
    }

    /// Bytes of an image.
    fn bytes(&self) -> Option<usize> {
        match self.bits {
            10 | 12 => Some(self.width.checked_mul(self.height)?.checked_mul(self.bits)?.div_ceil(8)),
            _ => self.stride()?.checked_mul(self.height),
        }
    }

    /// The image of these `bytes`, which are as many as [`Rows::bytes`] or more.
    fn decode(&self, bytes: &[u8]) -> Result<Raw, ImageFault> {
        let Self { width, height, bits, bottom_up, .. } = *self;
        let cut = || ImageFault::Truncated("the pixel data end early".into());
        let (size, stride) = (self.bytes().ok_or_else(cut)?, self.stride().ok_or_else(cut)?);
        let bytes = bytes.get(..size).ok_or_else(cut)?;
        let (mut channels, mut notes) = (Channels::GREY, Vec::new());
        let upright = || {
            let row = move |y: usize| if bottom_up { height - 1 - y } else { y };
            (0..height).filter_map(move |y| bytes.get(row(y) * stride..)?.get(..(width * bits).div_ceil(8)))
        };
        let pixels = match (bits, &self.palette) {
            (10 | 12, _) => {
                notes.push(format!("{bits} bit grey levels, kept as 16 bit numbers"));
                split_bits(bytes, width * height, 1, bits)?
            }
            (8, None) => Pixels::U8(upright().flatten().copied().collect()),
            (8, Some(palette)) => {
                let colour =
                    |&level: &u8| palette.get(4 * usize::from(level)..).and_then(|rest| rest.first_chunk::<3>());
                let colours: Option<Vec<_>> = upright().flatten().map(colour).collect();
                let colours = colours.ok_or_else(|| ImageFault::Corrupt("a colour is not in its palette".into()))?;
                channels = Channels { n: 3, colour: true, planar: false };
                Pixels::U8(colours.into_iter().flat_map(|&[blue, green, red]| [red, green, blue]).collect())
            }
            (16 | 48, _) => {
                let row = |row: &[u8]| row.as_chunks::<2>().0.iter().map(|&level| u16::from_le_bytes(level)).collect();
                let mut levels: Vec<u16> = upright().flat_map(|bytes| -> Vec<u16> { row(bytes) }).collect();
                if bits == 48 {
                    channels = Channels { n: 3, colour: true, planar: false };
                    levels.as_chunks_mut::<3>().0.iter_mut().for_each(|colour| colour.reverse());
                }
                Pixels::U16(levels)
            }
            (24 | 32, _) => {
                channels = Channels { n: 3, colour: true, planar: false };
                let colours = upright().flat_map(|row| row.chunks_exact(bits / 8));
                Pixels::U8(
                    colours.filter_map(|colour| colour.first_chunk::<3>()).flat_map(|&[b, g, r]| [r, g, b]).collect(),
                )
            }
            _ => return Err(ImageFault::Unsupported(format!("{bits} bits per pixel"))),
        };
        let white = if matches!(bits, 10 | 12) { ((1_u32 << bits) - 1) as f32 } else { pixels.white() };
        let (white, orientation) = (self.white.unwrap_or(white), Orientation::UPRIGHT);
        Ok(Raw { width, height, channels, pixels, white, notes, taken: None, orientation })
    }
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| endings.iter().any(|known| known.eq_ignore_ascii_case(ending)))
}

/// The little endian numbers of a file.
struct Numbers<'a>(&'a dyn Bytes);

impl Numbers<'_> {
    fn u16(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(*self.0.piece(at, 2)?.first_chunk()?))
    }

    fn u32(&self, at: usize) -> Option<u32> {
        Some(u32::from_le_bytes(*self.0.piece(at, 4)?.first_chunk()?))
    }

    fn usize(&self, at: usize) -> Option<usize> {
        usize::try_from(self.u32(at)?).ok()
    }
}
