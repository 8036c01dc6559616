//! What the samples of a page mean: numbers of every kind as grey levels.

use crate::images::raw::{ImageFault, luminance};
use crate::imaging::Pixels;
use std::borrow::Cow;
use tiff::decoder::DecodingResult;

/// The samples in one of the depths of an image; what is changed is noted.
pub(super) fn native(samples: DecodingResult, notes: &mut Vec<String>) -> Result<Pixels, ImageFault> {
    use DecodingResult as D;
    Ok(match samples {
        D::U8(samples) => Pixels::U8(samples),
        D::U16(samples) => Pixels::U16(samples),
        D::F32(samples) => Pixels::F32(samples),
        D::F16(samples) => Pixels::F32(samples.into_iter().map(|v| v.to_f32()).collect()),
        D::F64(samples) => {
            notes.push("64-bit floats are rounded to 32-bit".into());
            Pixels::F32(samples.into_iter().map(|v| v as f32).collect())
        }
        D::U32(samples) => whole(&samples, "32 bit", notes),
        D::U64(samples) => whole(&samples, "64 bit", notes),
        D::I8(samples) => whole(&samples, "signed 8 bit", notes),
        D::I16(samples) => whole(&samples, "signed 16 bit", notes),
        D::I32(samples) => whole(&samples, "signed 32 bit", notes),
        D::I64(samples) => whole(&samples, "signed 64 bit", notes),
    })
}

/// Whole numbers as 16 bit when all of them fit, otherwise as floats.
fn whole<T: Copy + TryInto<u16> + TryInto<i128>>(samples: &[T], kind: &str, notes: &mut Vec<String>) -> Pixels {
    let fitting: Option<Vec<u16>> = samples.iter().map(|&v| TryInto::<u16>::try_into(v).ok()).collect();
    if let Some(fitting) = fitting {
        notes.push(format!("{kind} grey levels, all within 0..65535: kept as 16 bit"));
        return Pixels::U16(fitting);
    }
    notes.push(format!("{kind} grey levels are kept as 32-bit floats"));
    // Every integer type of the decoder fits in i128.
    Pixels::F32(samples.iter().map(|&v| TryInto::<i128>::try_into(v).map_or(0.0, |v| v as f32)).collect())
}

/// Numbers of `bits` < 16 bits, most significant bit first, each row from a new byte.
pub(crate) fn split_bits(rows: &[u8], width: usize, height: usize, bits: usize) -> Result<Pixels, ImageFault> {
    let stride = (width * bits).div_ceil(8);
    if rows.len() != stride * height {
        return Err(ImageFault::Corrupt(format!("{} bytes where {} are needed", rows.len(), stride * height)));
    }
    let mask = (1_u32 << bits) - 1;
    let level = move |row: &[u8], x: usize| {
        // A number of up to 15 bits lies within three bytes.
        let (byte, bit) = (x * bits / 8, x * bits % 8);
        let window = (0..3).fold(0_u32, |w, k| w << 8 | u32::from(row.get(byte + k).copied().unwrap_or(0)));
        (window >> (24 - bit - bits)) & mask
    };
    let levels = rows.chunks_exact(stride).flat_map(|row| (0..width).map(move |x| level(row, x)));
    Ok(if bits <= 8 {
        Pixels::U8(levels.map(|v| v as u8).collect())
    } else {
        Pixels::U16(levels.map(|v| v as u16).collect())
    })
}

/// Turns white-is-zero into black-is-zero: whole numbers from `highest`, floats from 1.
pub(super) fn invert(pixels: &mut Pixels, highest: u16) {
    match pixels {
        Pixels::U8(levels) => {
            let highest = highest.min(u16::from(u8::MAX)) as u8;
            levels.iter_mut().for_each(|v| *v = highest - *v);
        }
        Pixels::U16(levels) => levels.iter_mut().for_each(|v| *v = highest - *v),
        Pixels::F32(levels) => levels.iter_mut().for_each(|v| *v = 1.0 - *v),
    }
}

/// Red, green and blue of cyan, magenta, yellow and black, each of which takes light away.
pub(super) fn of_inks(pixels: Pixels) -> Pixels {
    match pixels {
        Pixels::U8(inks) => {
            let left = |ink: u8, black: u8| (u16::from(255 - ink) * u16::from(255 - black) / 255) as u8;
            Pixels::U8(inks.as_chunks().0.iter().flat_map(|&[c, m, y, k]| [c, m, y].map(|ink| left(ink, k))).collect())
        }
        Pixels::U16(inks) => {
            let left = |ink: u16, black: u16| (u32::from(65535 - ink) * u32::from(65535 - black) / 65535) as u16;
            Pixels::U16(inks.as_chunks().0.iter().flat_map(|&[c, m, y, k]| [c, m, y].map(|ink| left(ink, k))).collect())
        }
        floats => floats,
    }
}

/// Spreads fewer than 8 bits over 0..255, as PNG readers do.
pub(super) fn stretch(pixels: &mut Pixels, bits: usize) {
    if let Pixels::U8(levels) = pixels {
        let highest = (1_u32 << bits) - 1;
        levels.iter_mut().for_each(|v| *v = (u32::from(*v) * 255 / highest) as u8);
    }
}

/// The grey levels that the palette `map` (reds, greens, blues) gives to the indices, and the largest possible.
#[expect(clippy::indexing_slicing, reason = "every index is below the number of colours: it has been compared")]
pub(super) fn apply_map(
    index: Pixels,
    map: &[u16],
    bits: usize,
    notes: &mut Vec<String>,
) -> Result<(Pixels, f32), ImageFault> {
    let n = map.len() / 3;
    let index: Cow<[u16]> = match &index {
        Pixels::U8(index) => index.iter().map(|&i| u16::from(i)).collect(),
        Pixels::U16(index) => Cow::Borrowed(index),
        Pixels::F32(_) => return Err(ImageFault::Unsupported("a palette with float indices".into())),
    };
    if let Some(&beyond) = index.iter().find(|&&i| usize::from(i) >= n) {
        return Err(ImageFault::Corrupt(format!("colour {beyond} is not among the {n} of the palette")));
    }
    let (red, rest) = map.split_at(n);
    let (green, blue) = rest.split_at(n);
    let grey = red == green && green == blue[..n].as_ref();
    // Intensities are 16 bit numbers; 8 bit ones come as 257 i, as 256 i, or as they are.
    let step = [257, 256, 1].into_iter().find(|step| red.iter().all(|&v| v % step == 0 && v / step <= 255));
    match step {
        Some(step) if grey => {
            let identity = bits == 8 && red.iter().enumerate().all(|(i, &v)| usize::from(v / step) == i);
            notes.push(if identity {
                "the palette is the identity grey ramp: the index is the grey level".into()
            } else {
                "the grey levels are those of a grey palette".into()
            });
            Ok((Pixels::U8(index.iter().map(|&i| (red[usize::from(i)] / step) as u8).collect()), 255.0))
        }
        None if grey => {
            notes.push("the grey levels are the 16 bit ones of a grey palette".into());
            Ok((Pixels::U16(index.iter().map(|&i| red[usize::from(i)]).collect()), 65535.0))
        }
        _ => {
            let scale = step.map_or(1.0, f32::from);
            let luminance_at = |k: usize| luminance(red[k].into(), green[k].into(), blue[k].into()) / scale;
            let levels: Vec<f32> = (0..n).map(luminance_at).collect();
            notes.push("the grey levels are the luminance of palette colours, as 32-bit floats".into());
            let white = if step.is_some() { 255.0 } else { 65535.0 };
            Ok((Pixels::F32(index.iter().map(|&i| levels[usize::from(i)]).collect()), white))
        }
    }
}
