//! Images as they are decoded: samples and their channels, before they are grey levels.

use super::upright::Orientation;
use crate::imaging::Pixels;

/// One colour that varies so many times as much as the luminance is what the picture shows.
const ONE_LUMINANCE: f64 = 10.0;

/// What an image file may hold to be decoded: a file of a few hundred bytes can claim, and unpack to, gigabytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Accepted {
    /// The most pixels, in millions.
    pub max_mpx: u32,
    /// The only size, width and height in px, where it is known: that of the reference.
    pub size: Option<[usize; 2]>,
}

impl Accepted {
    /// The most pixels that can be asked for, in millions: 46 000 x 46 000, where 32 bits count pixels.
    pub const MOST_MPX: u32 = 2147;

    /// Whatever can be read: of files that a run has read before.
    pub const ANY: Self = Self { max_mpx: Self::MOST_MPX, size: None };

    /// Of these the images of this size alone.
    pub fn of_size(self, width: usize, height: usize) -> Self {
        Self { size: Some([width, height]), ..self }
    }
}

impl Accepted {
    /// The same before the image is turned.
    pub(crate) fn stored(self, orientation: Orientation) -> Self {
        match self.size {
            Some([width, height]) if orientation.is_across() => Self { size: Some([height, width]), ..self },
            _ => self,
        }
    }
}

impl ImageFault {
    /// The same of the image as it is seen.
    pub fn upright(self, orientation: Orientation) -> Self {
        match self {
            Self::OtherSize { width, height, wanted: [columns, rows] } if orientation.is_across() => {
                Self::OtherSize { width: height, height: width, wanted: [rows, columns] }
            }
            fault => fault,
        }
    }
}

impl Default for Accepted {
    /// A billion pixels of any shape.
    fn default() -> Self {
        Self { max_mpx: 1000, size: None }
    }
}

/// What a decoder can find wrong, before the file's name is known.
#[derive(Debug)]
pub(crate) enum ImageFault {
    Truncated(String),
    Corrupt(String),
    Unsupported(String),
    TooLarge {
        width: u64,
        height: u64,
        max_mpx: u32,
    },
    OtherSize {
        width: u64,
        height: u64,
        wanted: [usize; 2],
    },
    Memory {
        width: u64,
        height: u64,
        bytes: u128,
    },
    NoSuchPage {
        pages: usize,
    },
    /// A video of which no frame can be read: what it is, why, and what to do.
    Film(&'static str, String, String),
}

/// How the samples of an image lie in memory.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Channels {
    /// Channels of a pixel.
    pub n: usize,
    /// Whether the first three are red, green and blue; otherwise the first is grey.
    pub colour: bool,
    /// Whether each channel is a plane of its own.
    pub planar: bool,
}

pub(crate) struct Raw {
    pub width: usize,
    pub height: usize,
    pub channels: Channels,
    pub pixels: Pixels,
    /// The largest grey level that there can be.
    pub white: f32,
    pub notes: Vec<String>,
    /// As the file says.
    pub taken: Option<String>,
    /// How the pixels lie.
    pub orientation: Orientation,
}

/// Refuses a size that cannot be meant, before anything is allocated for it.
///
/// `decoded` are the bytes of the unpacked image; no method of the format shrinks data by more than `ratio`.
pub(crate) fn check_size(
    accepted: Accepted,
    width: u64,
    height: u64,
    decoded: u128,
    ratio: u32,
    len: usize,
) -> Result<(), ImageFault> {
    if width == 0 || height == 0 {
        return Err(ImageFault::Corrupt(format!("the image is {width} x {height} px")));
    }
    if let Some(wanted) = accepted.size
        && wanted.map(|side| side as u64) != [width, height]
    {
        return Err(ImageFault::OtherSize { width, height, wanted });
    }
    let max_mpx = accepted.max_mpx.min(Accepted::MOST_MPX);
    if width.checked_mul(height).is_none_or(|pixels| pixels > u64::from(max_mpx) * 1_000_000) {
        return Err(ImageFault::TooLarge { width, height, max_mpx });
    }
    if decoded > len as u128 * u128::from(ratio) {
        return Err(ImageFault::Truncated(format!("{len} bytes cannot hold the {width} x {height} px of its header")));
    }
    // Decoders do not ask whether there is so much memory: where it is limited, they would end the process.
    let room = usize::try_from(decoded).ok().and_then(|bytes| Vec::<u8>::new().try_reserve_exact(bytes).ok());
    room.ok_or(ImageFault::Memory { width, height, bytes: decoded })
}

/// Luminance of linear red, green and blue with the weights of Rec. 709.
pub(crate) fn luminance(red: f32, green: f32, blue: f32) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

impl Channels {
    pub(crate) const GREY: Channels = Channels { n: 1, colour: false, planar: false };

    /// The grey levels of the samples; what is lost is noted.
    pub(crate) fn grey(self, samples: Pixels, notes: &mut Vec<String>) -> Pixels {
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
        let (luminances, are_one) = match &samples {
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
                if are_one {
                    notes.push(
                        "the colours hardly differ in luminance, but in red, green or blue: save that one as a grey image"
                            .into(),
                    );
                }
                let scale = if depth == "32-bit float" { String::new() } else { format!(" in the {depth} scale") };
                notes.push(format!("colours become luminance (Rec. 709), a 32-bit float{scale}"));
                Pixels::F32(levels)
            }
        }
    }

    pub(crate) fn first(self, samples: Pixels) -> Pixels {
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

    /// Whether red, green or blue varies so much more than the `luminances` made of them that these show little.
    fn have_one_luminance<T: Copy + Into<f32>>(self, samples: &[T], luminances: &[f32]) -> bool {
        let spread = |levels: &mut dyn Iterator<Item = f32>| {
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for level in levels.map(f64::from) {
                (n, sum, squares) = (n + 1.0, sum + level, squares + level * level);
            }
            (squares / n - (sum / n) * (sum / n)).max(0.0).sqrt()
        };
        let of_channel = |channel: usize| spread(&mut self.channel(samples, channel).map(Into::into));
        (0..3).any(|channel| {
            of_channel(channel) > ONE_LUMINANCE * spread(&mut luminances.iter().copied()).max(f64::MIN_POSITIVE)
        })
    }

    /// The luminance of each pixel, `None` when no pixel has a colour; and whether it is much the same for all.
    fn luminances<T: Copy + PartialEq + Into<f32>>(self, samples: &[T]) -> (Option<Vec<f32>>, bool) {
        let colours = || self.channel(samples, 0).zip(self.channel(samples, 1)).zip(self.channel(samples, 2));
        if colours().all(|((red, green), blue)| red == green && green == blue) {
            return (None, false);
        }
        let levels: Vec<f32> =
            colours().map(|((red, green), blue)| luminance(red.into(), green.into(), blue.into())).collect();
        let are_one = self.have_one_luminance(samples, &levels);
        (Some(levels), are_one)
    }
}
