//! Images as they are decoded: samples and their channels, before they are grey levels.

use crate::imaging::Pixels;

/// The most pixels that an image may have: 46 000 x 46 000.
const MAX_PIXELS: u64 = 1 << 31;

/// What a decoder can find wrong, before the file's name is known.
#[derive(Debug)]
pub(in crate::io) enum ImageFault {
    Truncated(String),
    Corrupt(String),
    Unsupported(String),
    TooLarge { width: u64, height: u64 },
    NoSuchPage { pages: usize },
}

/// How the samples of an image lie in memory.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct Channels {
    /// Channels of a pixel.
    pub n: usize,
    /// Whether the first three are red, green and blue; otherwise the first is grey.
    pub colour: bool,
    /// Whether each channel is a plane of its own.
    pub planar: bool,
}

/// Samples as decoded.
pub(in crate::io) struct Raw {
    pub width: usize,
    pub height: usize,
    pub channels: Channels,
    pub pixels: Pixels,
    /// The largest grey level that there can be.
    pub white: f32,
    pub notes: Vec<String>,
}

/// Refuses a size that cannot be meant, before anything is allocated for it.
///
/// `decoded` are the bytes of the unpacked image; no method of the format shrinks data by more than `ratio`.
pub(in crate::io) fn check_size(
    width: u64,
    height: u64,
    decoded: u128,
    ratio: u32,
    len: usize,
) -> Result<(), ImageFault> {
    if width == 0 || height == 0 {
        return Err(ImageFault::Corrupt(format!("the image is {width} x {height} px")));
    }
    if width.checked_mul(height).is_none_or(|pixels| pixels > MAX_PIXELS) {
        return Err(ImageFault::TooLarge { width, height });
    }
    if decoded > len as u128 * u128::from(ratio) {
        return Err(ImageFault::Truncated(format!("{len} bytes cannot hold the {width} x {height} px of its header")));
    }
    Ok(())
}

/// Luminance of linear red, green and blue with the weights of Rec. 709.
pub(in crate::io) fn luminance(red: f32, green: f32, blue: f32) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

impl Channels {
    /// One grey level per pixel.
    pub(in crate::io) const GREY: Channels = Channels { n: 1, colour: false, planar: false };

    /// The grey levels of the samples; what is lost is noted.
    pub(in crate::io) fn grey(self, samples: Pixels, notes: &mut Vec<String>) -> Pixels {
        let needed = if self.colour { 3 } else { 1 };
        match self.n - needed {
            0 => {}
            1 => notes.push("the alpha channel is ignored".into()),
            more => notes.push(format!("{more} further channels are ignored")),
        }
        if !self.colour {
            return self.first(samples);
        }
        let depth = samples.depth();
        let luminances = match &samples {
            Pixels::U8(samples) => self.luminances(samples),
            Pixels::U16(samples) => self.luminances(samples),
            Pixels::F32(samples) => self.luminances(samples),
        };
        match luminances {
            None => {
                notes.push(format!("red, green and blue are equal: kept as {depth} grey levels"));
                self.first(samples)
            }
            Some(levels) => {
                let scale = if depth == "32-bit float" { String::new() } else { format!(" in the {depth} scale") };
                notes.push(format!("colours become luminance (Rec. 709), a 32-bit float{scale}"));
                Pixels::F32(levels)
            }
        }
    }

    /// The first channel.
    pub(in crate::io) fn first(self, samples: Pixels) -> Pixels {
        if self.n == 1 {
            return samples;
        }
        match samples {
            Pixels::U8(samples) => Pixels::U8(self.channel(&samples, 0).collect()),
            Pixels::U16(samples) => Pixels::U16(self.channel(&samples, 0).collect()),
            Pixels::F32(samples) => Pixels::F32(self.channel(&samples, 0).collect()),
        }
    }

    fn channel<T: Copy>(self, samples: &[T], channel: usize) -> impl Iterator<Item = T> {
        let plane = samples.len() / self.n;
        let (start, step) = if self.planar { (channel * plane, 1) } else { (channel, self.n) };
        samples.iter().skip(start).step_by(step).take(plane).copied()
    }

    /// The luminance of each pixel; `None` when no pixel has a colour.
    fn luminances<T: Copy + PartialEq + Into<f32>>(self, samples: &[T]) -> Option<Vec<f32>> {
        let colours = || self.channel(samples, 0).zip(self.channel(samples, 1)).zip(self.channel(samples, 2));
        if colours().all(|((red, green), blue)| red == green && green == blue) {
            return None;
        }
        Some(colours().map(|((red, green), blue)| luminance(red.into(), green.into(), blue.into())).collect())
    }
}
