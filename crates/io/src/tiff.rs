//! TIFF pages as arrays of samples.
//!
//! The `tiff` crate unpacks strips and tiles; what the samples mean is decided here. For that, the copy of
//! the file in memory is edited before it is decoded: the header is pointed at the page asked for, and the
//! page is declared plain grey. So the decoder hands out every sample as stored, also of palette images,
//! which it refuses, and of colour images with extra channels, where it undoes the predictor wrongly.
//! Tiles are declared a single column of whole tiles: cut at the border they would be read piece by piece,
//! on which the LZW decoder stumbles (image-rs/weezl issue 68).

mod alone;
mod bytes;
mod samples;
mod taken;

pub(super) use bytes::{Bytes, LargeFile};
pub(super) use samples::split_bits;
pub(super) use taken::taken_of_exif;

use super::images::raw::{Accepted, Channels, ImageFault, Raw, check_size};
use super::images::upright::Orientation;
use crate::imaging::Pixels;
use samples::{apply_map, invert, native, of_inks, stretch};
use std::collections::HashSet;
use std::io::{Cursor, ErrorKind};
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::{TiffError, TiffUnsupportedError};

const SUBFILE: u16 = 254;
const WIDTH: u16 = 256;
const HEIGHT: u16 = 257;
const BITS: u16 = 258;
const COMPRESSION: u16 = 259;
const PHOTOMETRIC: u16 = 262;
const FILL_ORDER: u16 = 266;
const DESCRIPTION: u16 = 270;
const STRIPS: u16 = 273;
const ORIENTATION: u16 = 274;
const SAMPLES: u16 = 277;
const STRIP_BYTES: u16 = 279;
const PLANAR: u16 = 284;
const PREDICTOR: u16 = 317;
const COLOUR_MAP: u16 = 320;
const TILE_WIDTH: u16 = 322;
const TILE_HEIGHT: u16 = 323;
const TILES: u16 = 324;
const TILE_BYTES: u16 = 325;
const SUB_DIRECTORIES: u16 = 330;
const SAMPLE_FORMAT: u16 = 339;

/// The photometric interpretation of pixels that have one colour each.
const COLOUR_FILTERS: u64 = 32803;

/// Whether `bytes` begin as a TIFF or BigTIFF file does.
pub(super) fn is_tiff(bytes: &[u8]) -> bool {
    [b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"].iter().any(|magic| bytes.starts_with(*magic))
}

/// One image of a file.
#[derive(Debug, Clone, Copy)]
struct Page {
    /// Its directory.
    offset: usize,
    /// Which of the images that the directory stands for, one behind the other.
    image: usize,
}

/// Where the pages of a file are.
#[derive(Debug, Clone)]
pub(super) struct PageList {
    file: ByteLayout,
    pages: Vec<Page>,
    /// Directory of the picture whose thumbnail is the first page, where it is elsewhere in the file.
    picture: Option<usize>,
    /// Whether the list ends properly.
    complete: bool,
}

impl PageList {
    pub(super) fn of<B: Bytes + ?Sized>(bytes: &B) -> Result<Self, ImageFault> {
        let file = ByteLayout::of(bytes)?;
        let (offsets, complete) = file.pages(bytes)?;
        let of_one = |offset: usize| Page { offset, image: 0 };
        let mut pages: Vec<Page> = offsets.iter().copied().map(of_one).collect();
        if let [offset] = offsets.as_slice()
            && let Ok(directory) = Directory::read(file, bytes, *offset)
        {
            let images = directory.stack(bytes)?;
            pages = (0..images).map(|image| Page { offset: *offset, image }).collect();
        }
        let picture = picture_of(file, bytes, &offsets);
        Ok(Self { file, pages, picture, complete })
    }

    pub(super) fn len(&self) -> usize {
        self.pages.len()
    }

    /// The pages that are images of their own: no thumbnails and no masks of another page. At least one.
    pub(super) fn images<B: Bytes + ?Sized>(&self, bytes: &B) -> Vec<usize> {
        let whole = |&(_, page): &(usize, &Page)| {
            Directory::read(self.file, bytes, page.offset).map_or(true, |directory| directory.is_whole(bytes))
        };
        let whole: Vec<usize> = self.pages.iter().enumerate().filter(whole).map(|(page, _)| page).collect();
        if whole.is_empty() { vec![0] } else { whole }
    }

    /// Decodes page `page` of the file `bytes`; where these are at hand, they are edited and put right again.
    pub(super) fn decode<B>(&self, bytes: &mut B, page: usize, accepted: Accepted) -> Result<Raw, ImageFault>
    where
        B: Bytes + ?Sized,
    {
        let pages = self.len();
        let Some(&Page { offset: first, image }) = self.pages.get(page) else {
            return Err(ImageFault::NoSuchPage { pages });
        };
        let picture = self.picture.filter(|_| page == 0);
        let offset = picture.unwrap_or(first);
        let directory = Directory::read(self.file, bytes, offset)?;
        let head = Directory::read(self.file, bytes, first)?;
        let taken = taken::read_time(&directory, bytes).or_else(|| taken::read_time(&head, bytes));
        // What is turned is noted at the thumbnail too, or there alone.
        let orientation = [&directory, &head].into_iter().find_map(|directory| directory.value(bytes, ORIENTATION));
        let orientation = Orientation::of(orientation.unwrap_or(1));
        let accepted = accepted.stored(orientation);
        let decoded = match bytes.at_hand() {
            Some(bytes) if image == 0 => {
                let entries = offset..directory.next.min(bytes.len());
                let kept = bytes.get(entries.clone()).unwrap_or_default().to_vec();
                let decoded = directory.decode(bytes, accepted);
                if let Some(entries) = bytes.get_mut(entries) {
                    entries.copy_from_slice(&kept);
                }
                decoded
            }
            _ => directory
                .alone(bytes, image, accepted)
                .and_then(|(alone, mut bytes)| alone.decode(&mut bytes, accepted)),
        };
        let raw = decoded.map_err(|fault| fault.upright(orientation))?;
        let mut raw = Raw { taken, orientation, ..raw };
        if picture.is_some() {
            let size = head.size(bytes).map_or(String::new(), |[width, height]| format!(" of {width} x {height} px"));
            raw.notes.push(format!("the first page{size} is the thumbnail of the picture that is read"));
        }
        if !self.complete {
            raw.notes.push(format!("the list of pages breaks off after page {}", pages - 1));
        }
        Ok(raw)
    }
}

/// The directory of the picture of which the first page is a thumbnail: the largest of those that belong to it (as in
/// raw files of cameras), or of the other pages. `None` where the first page is the picture.
fn picture_of<B: Bytes + ?Sized>(file: ByteLayout, bytes: &B, offsets: &[usize]) -> Option<usize> {
    let (&first, others) = offsets.split_first()?;
    let head = Directory::read(file, bytes, first).ok()?;
    let pixels =
        |directory: &Directory| directory.size(bytes).map_or(0, |[width, height]| width.saturating_mul(height));
    let is_thumbnail = !head.is_whole(bytes);
    let beyond = if is_thumbnail { 0 } else { pixels(&head) };
    let largest = |offsets: &mut dyn Iterator<Item = usize>| {
        let found = offsets.filter_map(|offset| Some((offset, Directory::read(file, bytes, offset).ok()?)));
        let whole =
            found.filter(|(_, directory)| directory.is_whole(bytes)).map(|(at, directory)| (at, pixels(&directory)));
        // Of several of one size the first.
        whole.filter(|(_, pixels)| *pixels > beyond).reduce(|best, next| if next.1 > best.1 { next } else { best })
    };
    let inner =
        largest(&mut head.numbers(bytes, SUB_DIRECTORIES).into_iter().filter_map(|at| usize::try_from(at).ok()));
    let found = inner.or_else(|| is_thumbnail.then(|| largest(&mut others.iter().copied())).flatten());
    found.map(|(offset, _)| offset)
}

/// Byte order and offset size of a file.
#[derive(Debug, Clone, Copy)]
struct ByteLayout {
    little: bool,
    big: bool,
}

impl ByteLayout {
    fn of<B: Bytes + ?Sized>(bytes: &B) -> Result<Self, ImageFault> {
        let magic = bytes.piece(0, 4).ok_or_else(|| ImageFault::Truncated("the header is not complete".into()))?;
        let file = ByteLayout { little: magic.starts_with(b"I"), big: magic.contains(&b'+') };
        // BigTIFF says its offset size, which is always 8, and a zero.
        if file.big && (file.number(bytes, 4, 2), file.number(bytes, 6, 2)) != (Some(8), Some(0)) {
            return Err(ImageFault::Corrupt("the BigTIFF header is not valid".into()));
        }
        Ok(file)
    }

    /// The unsigned number in `size` bytes at `at`; `None` beyond the end of the file.
    fn number<B: Bytes + ?Sized>(self, bytes: &B, at: usize, size: usize) -> Option<u64> {
        Some(self.value(&bytes.piece(at, size)?))
    }

    /// The unsigned number that the bytes of `field` are.
    fn value(self, field: &[u8]) -> u64 {
        let add = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        if self.little { field.iter().rev().fold(0, add) } else { field.iter().fold(0, add) }
    }

    /// Writes `value` in `size` bytes at `at`; nothing beyond the end of the file.
    fn set(self, bytes: &mut [u8], at: usize, size: usize, value: u64) {
        let Some(field) = at.checked_add(size).and_then(|end| bytes.get_mut(at..end)) else { return };
        field.iter_mut().zip(value.to_le_bytes()).for_each(|(byte, value)| *byte = value);
        if !self.little {
            field.reverse();
        }
    }

    /// Size of an offset, and the place of that of the first page.
    fn word(self) -> usize {
        if self.big { 8 } else { 4 }
    }

    /// Size of the number of entries at the head of a directory, and of one entry.
    fn entry(self) -> (usize, usize) {
        if self.big { (8, 20) } else { (2, 12) }
    }

    /// The offsets of the pages, and whether the list ends properly.
    fn pages<B: Bytes + ?Sized>(self, bytes: &B) -> Result<(Vec<usize>, bool), ImageFault> {
        let missing = || ImageFault::Truncated("the directory of the first page is missing".into());
        let (head, size) = self.entry();
        let mut at = self.number(bytes, self.word(), self.word()).ok_or_else(missing)?;
        let (mut pages, mut seen) = (Vec::new(), HashSet::new());
        while at != 0 {
            // The next offset stands behind the last entry.
            let next = usize::try_from(at).ok().and_then(|at| {
                let n = usize::try_from(self.number(bytes, at, head)?).ok()?;
                let behind = at.checked_add(head)?.checked_add(n.checked_mul(size)?)?;
                Some((at, self.number(bytes, behind, self.word())?))
            });
            match next {
                Some((page, next)) if seen.insert(page) => {
                    pages.push(page);
                    at = next;
                }
                _ if pages.is_empty() => return Err(missing()),
                _ => return Ok((pages, false)),
            }
        }
        if pages.is_empty() { Err(ImageFault::Corrupt("the file holds no page".into())) } else { Ok((pages, true)) }
    }
}

/// The numbers of one tag.
#[derive(Debug, Clone, Copy)]
struct Field {
    tag: u16,
    /// Place of the entry in the directory.
    entry: usize,
    /// Place of the first number.
    at: usize,
    /// Bytes of one number.
    size: usize,
    count: usize,
    /// Whether they are whole numbers or text; of others nothing is needed here.
    is_whole: bool,
}

/// The description of a page.
struct Directory {
    file: ByteLayout,
    offset: usize,
    /// Place of the offset of the next page.
    next: usize,
    fields: Vec<Field>,
}

impl Directory {
    fn read<B: Bytes + ?Sized>(file: ByteLayout, bytes: &B, offset: usize) -> Result<Self, ImageFault> {
        let cut = || ImageFault::Truncated("the directory of the page is not complete".into());
        let (head, entry) = file.entry();
        let n = usize::try_from(file.number(bytes, offset, head).ok_or_else(cut)?).map_err(|_| cut())?;
        let entries = n.checked_mul(entry).and_then(|len| bytes.piece(offset + head, len)).ok_or_else(cut)?;
        let mut fields = Vec::new();
        for (k, data) in entries.chunks_exact(entry).enumerate() {
            let number = |at: usize, size: usize| file.number(data, at, size).ok_or_else(cut);
            let place = offset + head + k * entry;
            let (size, is_whole) = match number(2, 2)? {
                1 | 2 => (1, true), // bytes, text
                3 => (2, true),
                4 | 13 => (4, true), // 13 and 18: the place of a directory
                16 | 18 => (8, true),
                6 | 7 => (1, false),
                8 => (2, false),
                9 | 11 => (4, false),
                5 | 10 | 12 | 17 => (8, false),
                _ => continue,
            };
            let count = usize::try_from(number(4, file.word())?).map_err(|_| cut())?;
            // Numbers that fit are in the entry itself, others elsewhere.
            let inside = 4 + file.word();
            let at = if count.saturating_mul(size) <= file.word() {
                place + inside
            } else {
                usize::try_from(number(inside, file.word())?).map_err(|_| cut())?
            };
            fields.push(Field { tag: number(0, 2)? as u16, entry: place, at, size, count, is_whole });
        }
        Ok(Directory { file, offset, next: offset + head + n * entry, fields })
    }

    fn field(&self, tag: u16) -> Option<Field> {
        self.fields.iter().copied().find(|field| field.tag == tag && field.is_whole)
    }

    fn value<B: Bytes + ?Sized>(&self, bytes: &B, tag: u16) -> Option<u64> {
        let field = self.field(tag)?;
        self.file.number(bytes, field.at, field.size)
    }

    /// All numbers of `tag` that are there; at most as many as an image can have pieces.
    fn numbers<B: Bytes + ?Sized>(&self, bytes: &B, tag: u16) -> Vec<u64> {
        const MOST: usize = 1 << 22;
        let Some(Field { at, size, count, .. }) = self.field(tag) else { return Vec::new() };
        let there = bytes.len().saturating_sub(at) / size;
        let all = bytes.piece(at, size * count.min(there).min(MOST)).unwrap_or_default();
        all.chunks_exact(size).map(|number| self.file.value(number)).collect()
    }

    /// Columns and rows.
    fn size<B: Bytes + ?Sized>(&self, bytes: &B) -> Option<[u64; 2]> {
        Some([self.value(bytes, WIDTH)?, self.value(bytes, HEIGHT)?])
    }

    /// Whether it is a picture of its own: no thumbnail and no mask.
    fn is_whole<B: Bytes + ?Sized>(&self, bytes: &B) -> bool {
        self.value(bytes, SUBFILE).unwrap_or(0) & 0b101 == 0
    }

    /// How many images the directory stands for, one behind the other: programs write stacks with one directory and
    /// their number in its description (ImageJ `images=N`; tifffile a shape that it calls truncated).
    fn stack<B: Bytes + ?Sized>(&self, bytes: &B) -> Result<usize, ImageFault> {
        let description =
            self.field(DESCRIPTION).and_then(|Field { at, size, count, .. }| bytes.piece(at, count.checked_mul(size)?));
        let images = said_images(&String::from_utf8_lossy(&description.unwrap_or_default())).unwrap_or(1);
        if images <= 1 {
            return Ok(1);
        }
        let is_plain = self.value(bytes, COMPRESSION).unwrap_or(1) == 1;
        let Some(first) = self.image_bytes(bytes).filter(|_| is_plain) else {
            let what = format!("a stack of {images} images under one directory that are packed or in pieces");
            return Err(ImageFault::Unsupported(what));
        };
        let there = bytes.len().saturating_sub(first.start) / first.len().max(1);
        if there < images {
            return Err(ImageFault::Truncated(format!("it says that it holds {images} images, and holds {there}")));
        }
        Ok(images)
    }

    /// Where the first image lies, if that is in one piece.
    fn image_bytes<B: Bytes + ?Sized>(&self, bytes: &B) -> Option<std::ops::Range<usize>> {
        let offsets = self.numbers(bytes, STRIPS);
        let lengths = self.numbers(bytes, STRIP_BYTES);
        let ends: Vec<u64> =
            offsets.iter().zip(&lengths).map(|(offset, length)| offset.saturating_add(*length)).collect();
        let is_one_piece = offsets.iter().skip(1).zip(&ends).all(|(next, end)| next == end);
        let (first, last) = (*offsets.first()?, *ends.last()?);
        let range = usize::try_from(first).ok()?..usize::try_from(last).ok()?;
        (is_one_piece && offsets.len() == lengths.len() && !range.is_empty() && range.end <= bytes.len())
            .then_some(range)
    }

    /// The text of `tag`, up to its end.
    fn text<B: Bytes + ?Sized>(&self, bytes: &B, tag: u16) -> Option<String> {
        let Field { at, size, count, .. } = self.field(tag)?;
        let field = bytes.piece(at, count.checked_mul(size)?)?;
        field.split(|&byte| byte == 0).next().and_then(|text| String::from_utf8(text.to_vec()).ok())
    }

    /// Replaces each number of `tag`, when the page has it.
    fn replace(&self, bytes: &mut [u8], tag: u16, value: u64) {
        if let Some(field) = self.field(tag) {
            for k in 0..field.count.min(usize::from(u16::MAX)) {
                self.file.set(bytes, field.at.saturating_add(k * field.size), field.size, value);
            }
        }
    }

    /// Makes `tag` the one number `value`, of 32 bits whatever it was.
    fn declare(&self, bytes: &mut [u8], tag: u16, value: u32) {
        if let Some(Field { entry, .. }) = self.field(tag) {
            let word = self.file.word();
            self.file.set(bytes, entry + 2, 2, 4);
            self.file.set(bytes, entry + 4, word, 1);
            self.file.set(bytes, entry + 4 + word, 4, value.into());
        }
    }

    fn decode(&self, bytes: &mut [u8], accepted: Accepted) -> Result<Raw, ImageFault> {
        let stored = self.storage(bytes, accepted)?;
        let Storage { width, height, bits, samples, photometric, .. } = stored;
        self.simplify(&stored, bytes)?;
        let orientation = Orientation::UPRIGHT; // the caller knows
        let mut notes = Vec::new();
        let mut pixels = match unpack_strips(bytes, stored.unpacked)? {
            DecodingResult::U8(rows) if stored.packed() => split_bits(&rows, stored.columns, stored.rows, bits)?,
            // Of two entries for the bits the decoder may believe the other one.
            _ if stored.packed() => {
                return Err(ImageFault::Corrupt(format!("its samples are not of the {bits} bits that it says")));
            }
            decoded => native(decoded, &mut notes)?,
        };
        let wanted = stored.columns * stored.rows * samples;
        if pixels.len() != wanted {
            return Err(ImageFault::Corrupt(format!("{} samples where {wanted} are needed", pixels.len())));
        }
        if stored.tile.is_some() {
            pixels = match pixels {
                Pixels::U8(tiles) => Pixels::U8(stored.join(&tiles)),
                Pixels::U16(tiles) => Pixels::U16(stored.join(&tiles)),
                Pixels::F32(tiles) => Pixels::F32(stored.join(&tiles)),
            };
        }
        if photometric == 0 {
            invert(&mut pixels, if stored.packed() { (1 << bits) - 1 } else { u16::MAX });
        }
        let channels = match photometric {
            5 => Channels { n: 3, colour: true, planar: false },
            _ => Channels { n: samples, colour: photometric == 2, planar: stored.planar },
        };
        if photometric == 3 {
            let index = channels.first(pixels);
            let map = self.colour_map(bytes)?;
            let (pixels, white) = apply_map(index, &map, bits, &mut notes)?;
            return Ok(Raw { width, height, channels: Channels::GREY, pixels, white, notes, taken: None, orientation });
        }
        if photometric == 5 {
            pixels = of_inks(pixels);
            notes.push("inks (CMYK) become red, green and blue".into());
        }
        if photometric == 6 {
            notes.push("Y Cb Cr colours: the grey levels are Y".into());
        }
        if bits < 8 {
            notes.push(format!("{bits} bit grey levels are stretched to 0..255"));
            stretch(&mut pixels, bits);
        } else if stored.packed() {
            notes.push(format!("{bits} bit grey levels, kept as 16 bit numbers"));
        }
        let white = if bits > 8 && stored.packed() { ((1_u32 << bits) - 1) as f32 } else { pixels.white() };
        Ok(Raw { width, height, channels, pixels, white, notes, taken: None, orientation })
    }

    /// How the page is stored; what cannot be read or cannot be meant is refused here.
    fn storage<B: Bytes + ?Sized>(&self, bytes: &B, accepted: Accepted) -> Result<Storage, ImageFault> {
        let missing = |what| ImageFault::Corrupt(format!("the page does not say its {what}"));
        let width = self.value(bytes, WIDTH).ok_or_else(|| missing("width"))?;
        let height = self.value(bytes, HEIGHT).ok_or_else(|| missing("height"))?;
        let photometric = self.value(bytes, PHOTOMETRIC).ok_or_else(|| missing("photometric interpretation"))?;
        let bits = self.value(bytes, BITS).unwrap_or(1);
        let samples = self.value(bytes, SAMPLES).unwrap_or(1);
        let compression = self.value(bytes, COMPRESSION).unwrap_or(1);

        let unsupported = |what| Err(ImageFault::Unsupported(what));
        if photometric == COLOUR_FILTERS {
            return unsupported("the raw mosaic of a colour camera (Bayer), before it is developed,".into());
        }
        // The largest factor by which each method can shrink data.
        let ratio = match compression {
            1 => 1,
            32773 => 64,
            8 | 32946 => 1100,
            5 | 7 => 4096,
            50000 => 32768,
            other => return unsupported(format!("compression {other}{}", compression_name(other))),
        };
        match photometric {
            0 | 1 | 3 => {}
            2 if samples >= 3 => {}
            5 if samples == 4 && matches!(bits, 8 | 16) && compression != 7 && self.value(bytes, PLANAR) != Some(2) => {
            }
            6 if compression == 7 => {} // Y of Y Cb Cr is the grey level
            other => return unsupported(format!("photometric interpretation {other}{}", photometric_name(other))),
        }
        if !(1..=16).contains(&samples) {
            return unsupported(format!("{samples} channels per pixel"));
        }
        if !matches!(bits, 1..=16 | 32 | 64) {
            return unsupported(format!("{bits} bits per sample"));
        }
        if self.value(bytes, FILL_ORDER) == Some(2) {
            return unsupported("the reversed bit order (fill order 2)".into());
        }
        let predicted = self.value(bytes, PREDICTOR).is_some_and(|p| p != 1);
        if !matches!(bits, 8 | 16 | 32 | 64) && (samples > 1 || predicted) {
            return unsupported(format!("{bits} bits per sample with a predictor or several channels"));
        }

        let tile = match (self.value(bytes, TILE_WIDTH), self.value(bytes, TILE_HEIGHT)) {
            (Some(0), _) | (_, Some(0)) => return Err(ImageFault::Corrupt("a tile without pixels".into())),
            (Some(w), Some(h)) => Some((w, h)),
            _ => None,
        };
        // What the decoder is asked for: the image, or its tiles above each other.
        let (columns, rows) = match tile {
            None => (width, u128::from(height)),
            Some((w, h)) => {
                let column = u128::from(height.div_ceil(h)) * u128::from(h);
                (w, column.saturating_mul(width.div_ceil(w).into()))
            }
        };
        let row = (u128::from(columns) * u128::from(samples) * u128::from(bits)).div_ceil(8);
        let unpacked = row.saturating_mul(rows);
        check_size(accepted, width, height, unpacked, ratio, bytes.len())?;
        // What remains fits in memory, and so in these types, but for tiles of absurd shape.
        let odd = |_| ImageFault::Unsupported("tiles of this shape".into());
        let small = |n: u128| u32::try_from(n).map(|n| n as usize).map_err(odd);
        Ok(Storage {
            width: small(width.into())?,
            height: small(height.into())?,
            bits: bits as usize,
            samples: samples as usize,
            photometric,
            planar: self.value(bytes, PLANAR) == Some(2) && samples > 1,
            tile: tile.map(|(w, h)| Ok::<_, ImageFault>((small(w.into())?, small(h.into())?))).transpose()?,
            columns: small(columns.into())?,
            rows: small(rows)?,
            unpacked: usize::try_from(unpacked).unwrap_or(usize::MAX),
        })
    }

    /// Edits the file so that the decoder sees this page alone: whole bytes, in strips or one column of tiles.
    fn simplify(&self, stored: &Storage, bytes: &mut [u8]) -> Result<(), ImageFault> {
        self.file.set(bytes, self.file.word(), self.file.word(), self.offset as u64);
        self.file.set(bytes, self.next, self.file.word(), 0); // a list that ends here has no loops
        self.replace(bytes, PHOTOMETRIC, 1);
        if stored.samples == 1 {
            self.replace(bytes, PLANAR, 1);
        }
        if self.value(bytes, SAMPLE_FORMAT) == Some(4) {
            self.replace(bytes, SAMPLE_FORMAT, 1); // "undefined" data are unsigned numbers in practice
        }
        let mut columns = stored.columns;
        if stored.packed() && stored.bits > 8 {
            // The decoder has no 9 to 15 bits: it is asked for the bytes that hold them.
            columns = (columns * stored.bits).div_ceil(8);
            self.replace(bytes, BITS, 8);
            self.replace(bytes, SAMPLE_FORMAT, 1);
        }
        let side = |n: usize| u32::try_from(n).map_err(|_| ImageFault::Unsupported("rows of this length".into()));
        self.declare(bytes, WIDTH, side(columns)?);
        if stored.tile.is_some() {
            self.declare(bytes, TILE_WIDTH, side(columns)?);
            self.declare(bytes, HEIGHT, side(stored.rows)?);
        }
        Ok(())
    }

    /// The colours of a palette: all reds, all greens, all blues.
    fn colour_map(&self, bytes: &[u8]) -> Result<Vec<u16>, ImageFault> {
        let field = self.field(COLOUR_MAP).ok_or_else(|| ImageFault::Corrupt("the palette is missing".into()))?;
        let colour = |k: usize| self.file.number(bytes, field.at.checked_add(k * field.size)?, field.size);
        (0..field.count.min(3 << 16))
            .map(|k| colour(k).map(|value| value.min(u64::from(u16::MAX)) as u16))
            .collect::<Option<_>>()
            .ok_or_else(|| ImageFault::Truncated("the palette is not complete".into()))
    }
}

struct Storage {
    width: usize,
    height: usize,
    bits: usize,
    /// Samples of a pixel.
    samples: usize,
    photometric: u64,
    /// Whether each channel is a plane of its own.
    planar: bool,
    /// Width and height of the tiles; `None` for strips.
    tile: Option<(usize, usize)>,
    /// Width and height of what is unpacked: the image, or a column of all tiles.
    columns: usize,
    rows: usize,
    /// Its bytes.
    unpacked: usize,
}

impl Storage {
    /// Whether samples do not fill whole bytes.
    fn packed(&self) -> bool {
        !matches!(self.bits, 8 | 16 | 32 | 64)
    }

    /// The rows of the image, plane by plane, from tiles above each other.
    #[expect(clippy::indexing_slicing, reason = "all rows of all tiles are there: `decode` has compared their number")]
    fn join<T: Copy>(&self, stored: &[T]) -> Vec<T> {
        let (tile_width, tile_height) = self.tile.unwrap_or((self.width, self.height));
        let (n, planes) = if self.planar { (1, self.samples) } else { (self.samples, 1) };
        let across = self.width.div_ceil(tile_width);
        let tiles = across * self.height.div_ceil(tile_height);
        let mut image = Vec::with_capacity(self.width * self.height * self.samples);
        for plane in 0..planes {
            for y in 0..self.height {
                for column in 0..across {
                    let tile = plane * tiles + y / tile_height * across + column;
                    let start = (tile * tile_height + y % tile_height) * tile_width * n;
                    let visible = tile_width.min(self.width - column * tile_width) * n;
                    image.extend_from_slice(&stored[start..start + visible]);
                }
            }
        }
        image
    }
}

/// The number of images in the description of a stack under one directory.
fn said_images(description: &str) -> Option<usize> {
    if description.starts_with("ImageJ=") {
        return description.lines().find_map(|line| line.strip_prefix("images=")?.trim().parse().ok());
    }
    let about: serde_json::Value = serde_json::from_str(description.trim_end_matches('\0')).ok()?;
    let is_truncated = about.get("truncated").and_then(serde_json::Value::as_bool) == Some(true);
    let shape = about.get("shape").filter(|_| is_truncated)?.as_array()?;
    // The last two are rows and columns.
    let mut stacked = shape.iter().rev().skip(2).map(|n| usize::try_from(n.as_u64()?).ok());
    stacked.try_fold(1_usize, |product, n| product.checked_mul(n?))
}

fn compression_name(code: u64) -> &'static str {
    match code {
        2..=4 => " (fax)",
        6 => " (old JPEG)",
        32767 => " (raw file of a Sony camera)",
        34712 => " (JPEG 2000)",
        34713 => " (raw file of a Nikon camera)",
        34887 => " (LERC)",
        34925 => " (LZMA)",
        50001 => " (WebP)",
        50002 | 52546 => " (JPEG XL)",
        _ => "",
    }
}

fn photometric_name(code: u64) -> &'static str {
    match code {
        2 => " (RGB with fewer than three channels)",
        4 => " (mask)",
        5 => " (CMYK packed as JPEG, or in planes)",
        6 => " (Y Cb Cr without JPEG)",
        8..=10 => " (Lab)",
        34892 => " (linear raw)",
        _ => "",
    }
}

/// All samples of the first page of `bytes`, as stored: `unpacked` bytes.
fn unpack_strips(bytes: &[u8], unpacked: usize) -> Result<DecodingResult, ImageFault> {
    // The decoder's own limits are for smaller images. The samples were checked against the file; a list of numbers, of
    // which the decoder holds each in some tens of bytes, is no longer than the file either, whatever it claims.
    let mut limits = Limits::unlimited();
    limits.decoding_buffer_size = unpacked.max(bytes.len().saturating_mul(64)).max(1 << 16);
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(problem)?.with_limits(limits);
    let mut samples = DecodingResult::U8(Vec::new());
    decoder.read_image_to_buffer(&mut samples).map_err(problem)?;
    Ok(samples)
}

fn problem(error: TiffError) -> ImageFault {
    match error {
        TiffError::IoError(reason) if reason.kind() == ErrorKind::UnexpectedEof => {
            ImageFault::Truncated("the pixel data end early".into())
        }
        TiffError::UnsupportedError(TiffUnsupportedError::UnsupportedSampleFormat(_)) => {
            ImageFault::Unsupported("this kind of numbers (complex or mixed)".into())
        }
        TiffError::UnsupportedError(reason) => ImageFault::Unsupported(reason.to_string()),
        TiffError::FormatError(reason) => ImageFault::Corrupt(reason.to_string()),
        other => ImageFault::Corrupt(other.to_string()),
    }
}
