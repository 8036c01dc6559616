//! The reference image of a run, read again.

use crate::imaging::Image;
use crate::io::images::Accepted;
use crate::io::series::Frame;
use crate::io::store::StoreHeader;
use crate::run::words::chain;

/// The reference image of the run, when it is still there and the same.
pub(crate) fn reference(header: &StoreHeader, page: usize) -> std::result::Result<Image, String> {
    let file = header.reference.first().ok_or("the run names no reference image")?;
    let loaded = Frame::named(file, page).read(Accepted::ANY).map_err(|error| chain(&error))?;
    if header.reference_sha256.first().is_some_and(|sha256| *sha256 != loaded.sha256) {
        return Err(format!("{file}: the file has changed since the run"));
    }
    of_size(file, loaded.image, header.image_size_px)
}

/// The image, when it is as large as those of the run.
pub(crate) fn of_size(file: &str, image: Image, [width, height]: [usize; 2]) -> std::result::Result<Image, String> {
    let found = [image.width(), image.height()];
    if found == [width, height] {
        return Ok(image);
    }
    Err(format!("{file}: the image has {} x {} px, the run {width} x {height}", found[0], found[1]))
}
