//! Images written as TIFF or PNG.

use crate::imaging::{Image, Levels};
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why an image was not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The name does not end in a format that is written.
    #[error("{}: images are written as .tif, .tiff or .png; choose a name with one of these endings", .0.display())]
    Ending(PathBuf),
    /// PNG has no floats.
    #[error("{}: PNG cannot hold 32-bit floats; write a .tif file", .0.display())]
    FloatPng(PathBuf),
    /// The image does not fit in the format.
    #[error("{}: the image cannot be encoded: {}", .0.display(), .1)]
    Encode(PathBuf, String),
    /// The file system refuses.
    #[error("{}: cannot be written: {}", .0.display(), .1)]
    Io(PathBuf, io::Error),
}

/// Writes `image` to `path` in its own depth: `.tif` and `.tiff` uncompressed, `.png` 8 or 16 bit.
///
/// # Errors
/// Another ending, floats in a PNG file, or a file that cannot be written.
pub fn write_image(path: &Path, image: &Image) -> Result<(), WriteError> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    let encoded = match ending.as_deref() {
        Some("tif" | "tiff") => encode_tiff(image),
        Some("png") if matches!(image.pixels(), Levels::F32(_)) => {
            return Err(WriteError::FloatPng(path.to_owned()));
        }
        Some("png") => png_bytes(image),
        _ => return Err(WriteError::Ending(path.to_owned())),
    };
    let bytes = encoded.map_err(|reason| WriteError::Encode(path.to_owned(), reason))?;
    std::fs::write(path, bytes).map_err(|reason| WriteError::Io(path.to_owned(), reason))
}

fn encode_tiff(image: &Image) -> Result<Vec<u8>, String> {
    use tiff::encoder::{TiffEncoder, colortype};
    let (width, height) = sides(image)?;
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).map_err(|e| e.to_string())?;
    match image.pixels() {
        Levels::U8(levels) => encoder.write_image::<colortype::Gray8>(width, height, levels),
        Levels::U16(levels) => encoder.write_image::<colortype::Gray16>(width, height, levels),
        Levels::F32(levels) => encoder.write_image::<colortype::Gray32Float>(width, height, levels),
    }
    .map_err(|e| e.to_string())?;
    Ok(bytes.into_inner())
}

/// The content of a PNG file with `image`, 8 or 16 bit.
///
/// # Errors
/// An image of floats, or larger than PNG allows, in words.
pub fn png_bytes(image: &Image) -> Result<Vec<u8>, String> {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
    let (width, height) = sides(image)?;
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new(&mut bytes);
    match image.pixels() {
        Levels::U8(levels) => encoder.write_image(levels, width, height, ExtendedColorType::L8),
        Levels::U16(levels) => {
            let native: Vec<u8> = levels.iter().flat_map(|v| v.to_ne_bytes()).collect();
            encoder.write_image(&native, width, height, ExtendedColorType::L16)
        }
        Levels::F32(_) => return Err("PNG cannot hold floats".into()),
    }
    .map_err(|e| e.to_string())?;
    Ok(bytes)
}

fn sides(image: &Image) -> Result<(u32, u32), String> {
    let side = |n: usize| u32::try_from(n).map_err(|_| format!("{n} pixels on one side"));
    Ok((side(image.width())?, side(image.height())?))
}
