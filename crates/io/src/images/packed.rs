//! PNG, BMP, JPEG and PGM/PPM as arrays of samples.

use super::raw::{Accepted, Channels, ImageFault, Raw, check_size};
use super::upright::Orientation;
use crate::imaging::Pixels;
use crate::tiff as tiff_pages;
use image::codecs::pnm::{PnmDecoder, PnmSubtype};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::io::{Cursor, ErrorKind};

/// Decodes PNG, BMP, JPEG and PGM/PPM.
pub(super) fn decode(bytes: &[u8], format: ImageFormat, accepted: Accepted) -> Result<Raw, ImageFault> {
    if format == ImageFormat::Jpeg && !jpeg_is_complete(bytes) {
        return Err(ImageFault::Truncated("its end marker is missing".into()));
    }
    // The decoder takes the palette to end with a whole colour (png 0.18.1 panics).
    if format == ImageFormat::Png
        && let Some(n) = png_palette(bytes).filter(|n| !n.is_multiple_of(3))
    {
        return Err(ImageFault::Corrupt(format!("its palette of {n} bytes ends within a colour")));
    }
    // The decoder's own limit of 512 MiB is too low for large sensors; `check_size` sets ours.
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.no_limits();
    let mut decoder = reader.into_decoder().map_err(problem)?;
    let (width, height) = decoder.dimensions();
    let ratio = match format {
        // A bitmap packs 8 pixels in a byte.
        ImageFormat::Pnm => 8,
        // Deflate shrinks 1032 times; a palette turns one bit into 24.
        _ => 32768,
    };
    let exif = decoder.exif_metadata().ok().flatten();
    let orientation = exif.as_deref().and_then(image::metadata::Orientation::from_exif_chunk);
    let orientation = Orientation::of(orientation.map_or(1, |orientation| orientation.to_exif().into()));
    let accepted = accepted.stored(orientation);
    check_size(accepted, width.into(), height.into(), decoder.total_bytes().into(), ratio, bytes.len())
        .map_err(|fault| fault.upright(orientation))?;
    let taken = exif.and_then(|exif| tiff_pages::taken_of_exif(&exif));
    let mut notes = Vec::new();
    let image = DynamicImage::from_decoder(decoder).map_err(problem)?;
    if format == ImageFormat::Jpeg && ends_alike(&image) && jpeg_ends_early(bytes, &image) {
        return Err(ImageFault::Truncated("the pixel data end early, before its end marker".into()));
    }
    let (n, colour, mut pixels) = match image {
        DynamicImage::ImageLuma8(buffer) => (1, false, Pixels::U8(buffer.into_raw())),
        DynamicImage::ImageLuma16(buffer) => (1, false, Pixels::U16(buffer.into_raw())),
        DynamicImage::ImageLumaA8(buffer) => (2, false, Pixels::U8(buffer.into_raw())),
        DynamicImage::ImageLumaA16(buffer) => (2, false, Pixels::U16(buffer.into_raw())),
        DynamicImage::ImageRgb8(buffer) => (3, true, Pixels::U8(buffer.into_raw())),
        DynamicImage::ImageRgb16(buffer) => (3, true, Pixels::U16(buffer.into_raw())),
        DynamicImage::ImageRgba8(buffer) => (4, true, Pixels::U8(buffer.into_raw())),
        DynamicImage::ImageRgba16(buffer) => (4, true, Pixels::U16(buffer.into_raw())),
        other => return Err(ImageFault::Unsupported(format!("{:?}", other.color()))),
    };
    let mut white = pixels.white();
    if format == ImageFormat::Pnm {
        restore_scale(bytes, &mut pixels, &mut white);
    } else if format == ImageFormat::Png
        && n <= 2
        && let Some(bits @ 1..=4) = bytes.get(24)
    {
        // The header of a PNG file stands at its beginning; the decoder gives no depth below 8 bits.
        notes.push(format!("{bits} bit grey levels are stretched to 0..255"));
    }
    let channels = Channels { n, colour, planar: false };
    Ok(Raw { width: width as usize, height: height as usize, channels, pixels, white, notes, taken, orientation })
}

fn problem(error: image::ImageError) -> ImageFault {
    match error {
        image::ImageError::IoError(reason) if reason.kind() == ErrorKind::UnexpectedEof => {
            ImageFault::Truncated("the pixel data end early".into())
        }
        image::ImageError::Unsupported(reason) => ImageFault::Unsupported(reason.to_string()),
        other => ImageFault::Corrupt(other.to_string()),
    }
}

/// Bytes of the palette of a PNG file, which stands before its pixels; none without one.
fn png_palette(bytes: &[u8]) -> Option<usize> {
    const SIGNATURE: usize = 8;
    const CHECKSUM: usize = 4;
    let mut rest = bytes.get(SIGNATURE..)?;
    loop {
        let (length, after) = rest.split_first_chunk()?;
        let (kind, after) = after.split_first_chunk()?;
        let length = u32::from_be_bytes(*length) as usize;
        match kind {
            b"PLTE" => return Some(length),
            b"IDAT" => return None,
            _ => rest = after.get(length.checked_add(CHECKSUM)?..)?,
        }
    }
}

/// Whether the last scan of a JPEG file has its end marker. The decoder fills what is missing with grey,
/// silently; and a thumbnail ahead of the scan has an end marker of its own.
fn jpeg_is_complete(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    last([0xff, 0xd9]) > last([0xff, 0xda])
}

/// Whether the last two blocks of 8 by 8 pixels are alike: where the data have ended the decoder repeats what it had.
fn ends_alike(image: &DynamicImage) -> bool {
    const SIDE: usize = 8;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (bytes, channels) = (image.as_bytes(), usize::from(image.color().channel_count()));
    let (Some(x), Some(y)) = ((width / SIDE).checked_sub(2), (height / SIDE).checked_sub(1)) else { return true };
    (0..SIDE).all(|row| {
        let at = |column: usize| channels * ((SIDE * y + row) * width + SIDE * column);
        let block = |column: usize| bytes.get(at(column)..at(column + 1));
        block(x) == block(x + 1)
    })
}

/// Whether the data of a JPEG file end before the picture `decoded` does: it is another one when more data follow.
fn jpeg_ends_early(bytes: &[u8], decoded: &DynamicImage) -> bool {
    const MORE: [u8; 256] = [0x55; 256];
    let end = bytes.windows(2).rposition(|pair| pair == [0xff, 0xd9]).unwrap_or(bytes.len());
    let (data, end) = bytes.split_at_checked(end).unwrap_or((bytes, &[]));
    let longer = [data, &MORE, end].concat();
    let again = ImageReader::with_format(Cursor::new(longer), ImageFormat::Jpeg).decode();
    again.is_ok_and(|again| again.as_bytes() != decoded.as_bytes())
}

/// Undoes the stretching of a PGM/PPM decoder, which spreads 0..maxval over all of 8 or 16 bit: 12 bit
/// grey levels stay 12 bit. Exact for maxval up to 15 bit, where stretching at least doubles a level.
fn restore_scale(bytes: &[u8], pixels: &mut Pixels, white: &mut f32) {
    let Ok(decoder) = PnmDecoder::new(Cursor::new(bytes)) else { return };
    if matches!(decoder.subtype(), PnmSubtype::Bitmap(_)) {
        return;
    }
    let (_, header) = decoder.into_inner();
    let highest = f64::from(header.maximal_sample());
    *white = white.min(highest as f32);
    match pixels {
        Pixels::U8(levels) if highest < 255.0 => {
            levels.iter_mut().for_each(|v| *v = (f64::from(*v) * highest / 255.0).round() as u8);
        }
        Pixels::U16(levels) if highest < 65535.0 => {
            levels.iter_mut().for_each(|v| *v = (f64::from(*v) * highest / 65535.0).round() as u16);
        }
        _ => {}
    }
}
