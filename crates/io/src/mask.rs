//! Masks: images whose white pixels say where to measure.

use super::images::{Accepted, Loaded, PagedFile, ReadError, read_accepted};
use crate::imaging::Levels;
use crate::mesh::Mask;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Share of grey pixels above which a file is no mask.
const MOSTLY_GREY: f64 = 0.5;
/// Share of grey pixels above which it is said what was taken.
const SOME_GREY: f64 = 0.01;

/// A mask and what is worth knowing about its file.
#[derive(Debug, Clone)]
pub struct LoadedMask {
    /// Where to measure.
    pub mask: Mask,
    /// Share of the image that is white, 0 to 1.
    pub share: f64,
    /// What a user should know: grey pixels and where they were put. Often empty.
    pub notes: Vec<String>,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
}

/// Why a file gives no mask.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MaskError {
    /// The file gives no image.
    #[error("the mask cannot be used: {0}")]
    Read(#[from] ReadError),
    /// The mask is for another image.
    #[error(
        "{}: the mask is {width} x {height} px, the reference image {image_width} x {image_height} px; draw it on the reference",
        path.display()
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Columns of the mask.
        width: usize,
        /// Rows of the mask.
        height: usize,
        /// Columns of the image.
        image_width: usize,
        /// Rows of the image.
        image_height: usize,
    },
    /// No pixel is white.
    #[error(
        "{}: the mask is black everywhere: its largest grey level is {largest}, white is above {limit}; paint white \
         what is to be measured{}", path.display(), if *.largest > 0.0 { ", or multiply it" } else { "" }
    )]
    Black {
        /// The file.
        path: PathBuf,
        /// Largest grey level.
        largest: f32,
        /// Grey level above which a pixel is white.
        limit: f32,
    },
    /// Most pixels are neither black nor white: their share, per cent.
    #[error("{}: {:.0} % of the pixels are grey, neither black nor white: this looks like a photograph, not like a \
         mask; paint white what is to be measured and black the rest", .0.display(), .1)]
    Grey(PathBuf, f64),
}

/// Reads the image file `path` as the mask of an image of `width` x `height` px: pixels above half of the largest
/// grey level that the file can hold are measured. Any depth and kind of image that
/// [`read_image`](super::images::read_image) reads; of colours the luminance counts.
///
/// # Errors
/// A file that is no image, has another size, is black everywhere, or is mostly grey.
pub fn read_mask(path: &Path, width: usize, height: usize) -> Result<LoadedMask, MaskError> {
    // Another size is seen in the header, before anything is unpacked.
    mask_of(read_accepted(path, 0, Accepted::ANY.of_size(width, height)), path, width, height)
}

/// The mask with the content `bytes`; `path` stands in messages. See [`read_mask`].
pub fn parse_mask(bytes: Vec<u8>, path: &Path, width: usize, height: usize) -> Result<LoadedMask, MaskError> {
    let read = |mut file: PagedFile| file.read_one(0, Accepted::ANY.of_size(width, height));
    mask_of(PagedFile::of(path.to_owned(), bytes).and_then(read), path, width, height)
}

/// The mask that the image is.
fn mask_of(
    loaded: Result<Loaded, ReadError>,
    path: &Path,
    width: usize,
    height: usize,
) -> Result<LoadedMask, MaskError> {
    let loaded = match loaded {
        Err(ReadError::OtherSize { path, width: mask_width, height: mask_height, .. }) => {
            return Err(MaskError::Size {
                path,
                width: mask_width as usize,
                height: mask_height as usize,
                image_width: width,
                image_height: height,
            });
        }
        loaded => loaded?,
    };
    let image = &loaded.image;
    let named = || path.to_owned();
    let limit = loaded.white / 2.0;
    let levels = |keep: &dyn Fn(f32) -> bool| -> Vec<bool> {
        match image.pixels() {
            Levels::U8(levels) => levels.iter().map(|&v| keep(v.into())).collect(),
            Levels::U16(levels) => levels.iter().map(|&v| keep(v.into())).collect(),
            Levels::F32(levels) => levels.iter().map(|&v| keep(v)).collect(),
        }
    };
    let bits = levels(&|v| v > limit);
    let n = bits.len() as f64;
    let share = bits.iter().filter(|&&white| white).count() as f64 / n;
    let (black, white) = (0.1 * loaded.white, 0.9 * loaded.white);
    let grey = levels(&|v| v > black && v < white).iter().filter(|&&grey| grey).count() as f64 / n;
    if grey > MOSTLY_GREY {
        return Err(MaskError::Grey(named(), 100.0 * grey));
    }
    if share == 0.0 {
        return Err(MaskError::Black { path: named(), largest: image.range().1, limit });
    }
    let mut notes = loaded.notes;
    if grey > SOME_GREY {
        let percent = 100.0 * grey;
        notes.push(format!("{percent:.1} % of the mask is neither black nor white; above {limit} is measured"));
    }
    // The length is that of an image.
    #[expect(clippy::unreachable, reason = "the size has been compared")]
    let mask = Mask::new(width, height, bits).unwrap_or_else(|| unreachable!("a mask as large as its image"));
    Ok(LoadedMask { mask, share, notes, sha256: loaded.sha256 })
}
