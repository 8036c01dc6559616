//! Films of Phantom cameras: a header, a bitmap header, the settings of the camera, and the places of the frames.

use super::{Bytes, Coding, ImageFault, Numbers, Recorded, Rows};

/// Places in the header of the file.
const KIND: usize = 4;
const N_FRAMES: usize = 20;
const BITMAP: usize = 24;
const SETTINGS: usize = 28;
const PLACES: usize = 32;
/// Places in the settings.
const FLIPPED: usize = 760;
const RATE: usize = 768;
const REAL_BITS: usize = 896;

pub(super) fn read(file: Box<dyn Bytes + Send>) -> Result<Recorded, ImageFault> {
    let cut = || ImageFault::Truncated("its header is not complete".into());
    let numbers = Numbers(&*file);
    let at = |place: usize| numbers.usize(place).ok_or_else(cut);
    let (n, bitmap, settings, places) = (at(N_FRAMES)?, at(BITMAP)?, at(SETTINGS)?, at(PLACES)?);
    match numbers.u16(KIND) {
        Some(0) => {}
        Some(2) => {
            let what = "the raw mosaic of a colour camera (Bayer), before it is developed,";
            return Err(ImageFault::Unsupported(what.into()));
        }
        _ => return Err(ImageFault::Unsupported("its frames are compressed".into())),
    }
    let [width, height] = [at(bitmap + 4)?, at(bitmap + 8)?];
    let bits = usize::from(numbers.u16(bitmap + 14).ok_or_else(cut)?);
    let packed = at(bitmap + 16)?;
    if packed != 0 || !matches!(bits, 8 | 16 | 24 | 48) {
        return Err(ImageFault::Unsupported(format!("its frames are packed ({packed}, {bits} bits)")));
    }
    let real_bits = numbers.u32(settings + REAL_BITS).filter(|real| (9..16).contains(real) && bits == 16);
    let rows = Rows {
        width,
        height,
        bits,
        aligned: if bits == 24 { 4 } else { 1 },
        bottom_up: numbers.u32(settings + FLIPPED).unwrap_or(0) == 0,
        palette: None,
        white: real_bits.map(|bits| ((1_u32 << bits) - 1) as f32),
    };
    let frames_per_second = numbers.u32(settings + RATE).filter(|&rate| rate > 0).map(f64::from);
    let table = n.checked_mul(8).and_then(|len| file.piece(places, len)).ok_or_else(cut)?;
    let frame = |(k, place): (usize, &[u8; 8])| {
        let missing = || ImageFault::Truncated(format!("it says that it holds {n} frames, and frame {k} is missing"));
        let place = usize::try_from(u64::from_le_bytes(*place)).ok();
        // Notes come first: their length with this number, and the length of the image behind them.
        let image = place.and_then(|place| place.checked_add(numbers.usize(place)?.max(8))).ok_or_else(missing)?;
        let len = numbers.usize(image - 4).ok_or_else(missing)?;
        let end = image.checked_add(len).ok_or_else(missing)?;
        if end <= file.len() { Ok((image, len)) } else { Err(missing()) }
    };
    let frames = table.as_chunks::<8>().0.iter().enumerate().map(frame).collect::<Result<Vec<_>, _>>()?;
    drop(table);
    if frames.is_empty() {
        return Err(ImageFault::Corrupt("it holds no frame".into()));
    }
    Ok(Recorded { file, frames, coding: Coding::Rows(rows), frames_per_second })
}
