//! One page as a file of its own.

use super::{Bytes, Directory, STRIP_BYTES, STRIPS, TILE_BYTES, TILES};
use crate::images::raw::{Accepted, ImageFault};

impl Directory {
    /// A file in memory with this page alone, or of a stack under one directory with its image of number `image`; and
    /// the directory there. It holds no more than the page needs.
    pub fn alone<B>(&self, bytes: &B, image: usize, accepted: Accepted) -> Result<(Self, Vec<u8>), ImageFault>
    where
        B: Bytes + ?Sized,
    {
        let cut = || ImageFault::Truncated("the pixel data end early".into());
        let unpacked = self.storage(bytes, accepted)?.unpacked;
        let piece = |at: usize, len: usize| bytes.piece(at, len).ok_or_else(cut);
        let header = 2 * self.file.word();
        let mut alone = piece(0, header)?.into_owned();
        alone.extend_from_slice(&piece(self.offset, self.next - self.offset)?);
        alone.extend_from_slice(&[0; 8]); // no next page
        let mut moved = Self::read(self.file, alone.as_slice(), header)?;
        // No method makes data much longer than they are.
        let mut most = unpacked.saturating_mul(2).saturating_add(1 << 20);
        for (from, to) in self.fields.iter().zip(&mut moved.fields) {
            let len = from.size.saturating_mul(from.count);
            // What does not fit is in no image: texts of programs, or damaged.
            if len > self.file.word()
                && len < most
                && let Some(data) = bytes.piece(from.at, len)
            {
                to.at = append(&mut alone, &data);
                self.file.set(&mut alone, to.entry + 4 + self.file.word(), self.file.word(), to.at as u64);
                most -= len;
            }
        }
        let skip = self.image_bytes(bytes).map_or(0, |first| first.len().saturating_mul(image));
        for (places, lengths) in [(STRIPS, STRIP_BYTES), (TILES, TILE_BYTES)] {
            let numbers =
                |tag| self.numbers(bytes, tag).into_iter().map(|number| usize::try_from(number).map_err(|_| cut()));
            let Some(field) = moved.field(places) else { continue };
            for (k, (place, len)) in numbers(places).zip(numbers(lengths)).enumerate() {
                let (place, len) = (place?.saturating_add(skip), len?);
                most = most.checked_sub(len).ok_or_else(|| {
                    ImageFault::Corrupt(format!(
                        "its pixel data are longer than the {unpacked} bytes that they stand for"
                    ))
                })?;
                let place = append(&mut alone, &piece(place, len)?);
                self.file.set(&mut alone, field.at + k * field.size, field.size, place as u64);
            }
        }
        Ok((moved, alone))
    }
}

/// Where the data lie that are added.
fn append(file: &mut Vec<u8>, data: &[u8]) -> usize {
    file.resize(file.len().next_multiple_of(2), 0);
    let at = file.len();
    file.extend_from_slice(data);
    at
}
