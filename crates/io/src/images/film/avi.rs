//! AVI: chunks of a name, a length and data; the frames are those of the first stream of pictures.

use super::{Bytes, Coding, ImageFault, Numbers, Recorded, Rows};

/// The fields of a bitmap header that is needed, from its beginning.
const WIDTH: usize = 4;
const HEIGHT: usize = 8;
const BITS: usize = 14;
const COMPRESSION: usize = 16;
const COLOURS: usize = 32;

#[derive(Default)]
struct Found {
    /// Frames that the head promises; of a file of several parts those of the first.
    promised: usize,
    streams: usize,
    /// The stream of pictures, by its number.
    pictures: Option<usize>,
    frames_per_second: Option<f64>,
    coding: Option<Coding>,
    frames: Vec<(usize, usize)>,
}

pub(super) fn read(file: Box<dyn Bytes + Send>) -> Result<Recorded, ImageFault> {
    let mut found = Found::default();
    let mut at = 0;
    while let Some(head) = file.piece(at, 8) {
        let (Some(&name), Some(&len)) = (head.first_chunk::<4>(), head.last_chunk::<4>()) else { break };
        if &name == b"RIFF" || &name == b"LIST" {
            at += 12; // the name of the list, and what is in it
            continue;
        }
        let len = usize::try_from(u32::from_le_bytes(len)).unwrap_or(usize::MAX);
        found.take(&*file, name, at + 8, len)?;
        let Some(next) = len.checked_next_multiple_of(2).and_then(|len| at.checked_add(8)?.checked_add(len)) else {
            break;
        };
        at = next;
    }
    let Found { promised, frames_per_second, coding, frames, .. } = found;
    let coding = coding.ok_or_else(|| ImageFault::Corrupt("it has no stream of pictures".into()))?;
    if frames.len() < promised.max(1) {
        let there = frames.len();
        return Err(ImageFault::Truncated(format!("it says that it holds {promised} frames, and holds {there}")));
    }
    Ok(Recorded { file, frames, coding, frames_per_second })
}

impl Found {
    /// Takes what is needed of the chunk `name`, whose `len` bytes begin at `at`.
    fn take(&mut self, file: &dyn Bytes, name: [u8; 4], at: usize, len: usize) -> Result<(), ImageFault> {
        let numbers = Numbers(file);
        match &name {
            b"avih" => self.promised = numbers.usize(at + 16).unwrap_or(0),
            b"strh" => {
                let is_first = self.pictures.is_none() && file.piece(at, 4).as_deref() == Some(b"vids");
                if is_first {
                    self.pictures = Some(self.streams);
                    let rate = numbers
                        .u32(at + 24)
                        .zip(numbers.u32(at + 20))
                        .map(|(rate, scale)| f64::from(rate) / f64::from(scale));
                    self.frames_per_second = rate.filter(|rate| rate.is_finite() && *rate > 0.0);
                }
                self.streams += 1;
            }
            b"strf" if self.pictures.is_some_and(|stream| stream + 1 == self.streams) => {
                self.coding = Some(coding(&numbers, at, len)?);
            }
            &[tens @ b'0'..=b'9', ones @ b'0'..=b'9', b'd', b'b' | b'c'] => {
                let stream = usize::from(tens - b'0') * 10 + usize::from(ones - b'0');
                if self.pictures != Some(stream) {
                    return Ok(());
                }
                if at.checked_add(len).is_none_or(|end| end > file.len()) {
                    return Err(ImageFault::Truncated(format!("frame {} is not complete", self.frames.len())));
                }
                // A frame without data is the one before.
                self.frames.extend(if len > 0 { Some((at, len)) } else { self.frames.last().copied() });
            }
            _ => {}
        }
        Ok(())
    }
}

/// How pictures with the bitmap header at `at` are stored.
fn coding(numbers: &Numbers<'_>, at: usize, len: usize) -> Result<Coding, ImageFault> {
    let cut = || ImageFault::Truncated("its header is not complete".into());
    let signed = numbers.u32(at + HEIGHT).ok_or_else(cut)?.cast_signed();
    let bits = usize::from(numbers.u16(at + BITS).ok_or_else(cut)?);
    let name = numbers.u32(at + COMPRESSION).ok_or_else(cut)?.to_le_bytes();
    let plain = |bits: usize, aligned: usize, bottom_up: bool| {
        let width = numbers.usize(at + WIDTH).ok_or_else(cut)?;
        let n = numbers.usize(at + COLOURS).filter(|n| (1..=256).contains(n)).unwrap_or(256);
        let palette = (bits == 8 && bottom_up && len >= 40 + 4 * n).then(|| numbers.0.piece(at + 40, 4 * n)).flatten();
        let palette = palette.map(|palette| palette.into_owned());
        let height = signed.unsigned_abs() as usize;
        Ok(Coding::Rows(Rows { width, height, bits, aligned, bottom_up, palette, white: None }))
    };
    match &name.map(|letter| letter.to_ascii_uppercase()) {
        b"MJPG" => Ok(Coding::Jpeg),
        b"\0\0\0\0" | b"DIB " | b"RGB " if matches!(bits, 8 | 24 | 32) => plain(bits, 4, signed > 0),
        b"Y800" | b"Y8  " | b"GREY" => plain(8, 1, false),
        b"Y16 " => plain(16, 1, false),
        _ => Err(ImageFault::Unsupported(format!("its frames are packed as {} of {bits} bits", name.escape_ascii()))),
    }
}
