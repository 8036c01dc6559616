//! Image files of every format and depth, and what is said about broken ones.

use crate::common::data;
use image::codecs::bmp::BmpEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::codecs::pnm::{PnmEncoder, PnmSubtype, SampleEncoding};
use image::{ExtendedColorType, ImageEncoder};
use proptest::prelude::*;
use quadrille::imaging::{Image, ImageError, Levels, Pixels};
use quadrille::io::images::{Accepted, Loaded, PagedFile, ReadError, WriteError, pages_of, read_image, write_image};
use quadrille::io::series::{SeriesError, expand_series};
use std::io::Cursor;
use std::path::Path;
use tempfile::TempDir;
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype};

const WIDTH: usize = 21;
const HEIGHT: usize = 13;
const SIZE: usize = WIDTH * HEIGHT;

/// Grey levels that use all bits and repeat now and then, so that every compression has work.
fn levels() -> Vec<u16> {
    (0..SIZE).map(|i| if i % 40 < 15 { 4711 } else { (i * 40503 % 65536) as u16 }).collect()
}

fn bytes_of(levels: &[u16]) -> Vec<u8> {
    levels.iter().map(|v| (v >> 8) as u8).collect()
}

#[track_caller]
fn read_page(name: &str, content: &[u8], page: usize) -> Result<Loaded, ReadError> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    let loaded = read_image(&path, page);
    if let Err(error) = &loaded {
        assert!(error.to_string().starts_with(&path.display().to_string()), "the file is not named first: {error}");
    }
    loaded
}

#[track_caller]
fn read(name: &str, content: &[u8]) -> Loaded {
    read_page(name, content, 0).unwrap()
}

#[track_caller]
fn assert_reads(name: &str, content: &[u8], want: &Pixels) -> Vec<String> {
    let loaded = read(name, content);
    assert_eq!((loaded.image.width(), loaded.image.height()), (WIDTH, HEIGHT), "{name}");
    assert_eq!(loaded.image.pixels(), *want, "{name}");
    loaded.notes
}

#[track_caller]
fn assert_notes(notes: &[String], wanted: &[&str]) {
    assert_eq!(notes.len(), wanted.len(), "{notes:?}");
    for (note, wanted) in notes.iter().zip(wanted) {
        assert!(note.contains(wanted), "{notes:?} should say {wanted:?}");
    }
}

// ---- hand-made TIFF files ----

/// A TIFF page: tags with their numbers (type SHORT unless they need LONG) and its strips or tiles.
#[derive(Clone)]
struct Page {
    tags: Vec<(u16, Vec<u32>)>,
    chunks: Vec<Vec<u8>>,
}

impl Page {
    fn new(bits: u32, photometric: u32, data: Vec<u8>) -> Self {
        let tags = [(256, WIDTH as u32), (257, HEIGHT as u32), (258, bits), (259, 1), (262, photometric)];
        Page { tags: tags.map(|(tag, value)| (tag, vec![value])).into(), chunks: vec![data] }
    }

    fn with(mut self, tag: u16, values: &[u32]) -> Self {
        self.tags.retain(|(there, _)| *there != tag);
        self.tags.push((tag, values.to_vec()));
        self
    }
}

fn tiff_file(big_endian: bool, pages: &[Page]) -> Vec<u8> {
    let number = |value: u32, size: usize| {
        let bytes = value.to_be_bytes()[4 - size..].to_vec();
        if big_endian { bytes } else { bytes.into_iter().rev().collect::<Vec<_>>() }
    };
    let mut file = if big_endian { b"MM\0*".to_vec() } else { b"II*\0".to_vec() };
    file.extend([0; 4]);
    let mut link = 4; // where the offset of the next directory goes
    for page in pages {
        let mut offsets = Vec::new();
        for chunk in &page.chunks {
            offsets.push(file.len() as u32);
            file.extend(chunk);
            file.resize(file.len().next_multiple_of(2), 0);
        }
        let tiled = page.tags.iter().any(|(tag, _)| *tag == 322);
        let mut tags = page.tags.clone();
        tags.push((if tiled { 324 } else { 273 }, offsets));
        tags.push((if tiled { 325 } else { 279 }, page.chunks.iter().map(|chunk| chunk.len() as u32).collect()));
        tags.sort();
        let mut directory = number(tags.len() as u32, 2);
        for (tag, values) in tags {
            // Texts are ASCII, sizes and offsets are LONG, all else is SHORT.
            let size = match tag {
                270 => 1,
                256 | 257 | 273 | 279 | 324 | 325 | 330 => 4,
                _ => 2,
            };
            let mut field: Vec<u8> = values.iter().flat_map(|&v| number(v, size)).collect();
            if field.len() > 4 {
                let at = file.len() as u32;
                file.extend(&field);
                file.resize(file.len().next_multiple_of(2), 0);
                field = number(at, 4);
            }
            field.resize(4, 0);
            directory.extend(number(tag.into(), 2));
            directory.extend(number([0, 2, 3, 0, 4][size], 2));
            directory.extend(number(values.len() as u32, 4));
            directory.extend(field);
        }
        let at = file.len();
        file.splice(link..link + 4, number(at as u32, 4));
        file.extend(&directory);
        link = file.len();
        file.extend([0; 4]);
    }
    file
}

/// Sets the number of `tag` in the first directory of a little-endian file.
fn set(file: &mut [u8], tag: u16, value: u32) {
    let number = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap()) as usize;
    let first = number(4);
    let n = usize::from(u16::from_le_bytes([file[first], file[first + 1]]));
    let mut entries = (0..n).map(|k| first + 2 + 12 * k);
    let entry = entries.find(|&at| file[at..at + 2] == tag.to_le_bytes()).unwrap();
    file[entry + 8..entry + 12].copy_from_slice(&value.to_le_bytes());
}

/// A raw file as cameras write it: a thumbnail, with `picture` in a directory below it.
fn raw_file(thumbnail: Page, picture: Page) -> Vec<u8> {
    let mut file = tiff_file(false, &[thumbnail.with(254, &[1]).with(330, &[0]), picture]);
    let number = |file: &[u8], at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let first = number(&file, 4) as usize;
    let link = first + 2 + 12 * usize::from(u16::from_le_bytes([file[first], file[first + 1]]));
    let second = number(&file, link);
    set(&mut file, 330, second);
    file[link..link + 4].fill(0);
    file
}

/// Numbers of `bits` bits, most significant bit first, rows from new bytes.
fn pack(values: &[u16], bits: usize) -> Vec<u8> {
    let mut packed = Vec::new();
    for row in values.chunks(WIDTH) {
        let mut line = vec![0_u8; (WIDTH * bits).div_ceil(8)];
        for (x, value) in row.iter().enumerate() {
            for k in 0..bits {
                if value >> (bits - 1 - k) & 1 == 1 {
                    line[(x * bits + k) / 8] |= 0x80 >> ((x * bits + k) % 8);
                }
            }
        }
        packed.extend(line);
    }
    packed
}

// ---- hand-made PNG files ----

fn png_file(bits: u8, colour_type: u8, palette: &[u8], rows: &[u8]) -> Vec<u8> {
    fn chunk(file: &mut Vec<u8>, name: &[u8; 4], data: &[u8]) {
        file.extend((data.len() as u32).to_be_bytes());
        let body: Vec<u8> = name.iter().chain(data).copied().collect();
        let crc = !body.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        });
        file.extend(body);
        file.extend(crc.to_be_bytes());
    }
    let stride = rows.len() / HEIGHT;
    let lines: Vec<u8> = rows.chunks(stride).flat_map(|row| [0].into_iter().chain(row.iter().copied())).collect();
    // One stored block of deflate, and its checksum.
    let n = lines.len() as u16;
    let mut packed = vec![0x78, 0x01, 1];
    packed.extend(n.to_le_bytes());
    packed.extend((!n).to_le_bytes());
    packed.extend(&lines);
    let (a, b) = lines.iter().fold((1_u32, 0_u32), |(a, b), &v| {
        let a = (a + u32::from(v)) % 65521;
        (a, (b + a) % 65521)
    });
    packed.extend((b << 16 | a).to_be_bytes());
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut header = (WIDTH as u32).to_be_bytes().to_vec();
    header.extend((HEIGHT as u32).to_be_bytes());
    header.extend([bits, colour_type, 0, 0, 0]);
    chunk(&mut file, b"IHDR", &header);
    if !palette.is_empty() {
        chunk(&mut file, b"PLTE", palette);
    }
    chunk(&mut file, b"IDAT", &packed);
    chunk(&mut file, b"IEND", &[]);
    file
}

fn png(samples: &[u8], colour: ExtendedColorType) -> Vec<u8> {
    let mut file = Vec::new();
    PngEncoder::new(&mut file).write_image(samples, WIDTH as u32, HEIGHT as u32, colour).unwrap();
    file
}

fn native(levels: &[u16]) -> Vec<u8> {
    levels.iter().flat_map(|v| v.to_ne_bytes()).collect()
}

/// Pixels of several samples made of one grey level each.
fn spread<T: Copy>(levels: &[T], pixel: impl Fn(T) -> Vec<T>) -> Vec<T> {
    levels.iter().flat_map(|&v| pixel(v)).collect()
}

// ---- formats and depths ----

#[test]
fn tiff_keeps_every_grey_level_for_each_depth_and_compression() {
    let levels = levels();
    let floats: Vec<f32> = levels.iter().map(|&v| f32::from(v) / 7.0 - 1000.0).collect();
    let bytes = bytes_of(&levels);
    for compression in [
        Compression::Uncompressed,
        Compression::Lzw,
        Compression::Deflate(DeflateLevel::Balanced),
        Compression::Packbits,
    ] {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            if predictor == Predictor::Horizontal && compression == Compression::Packbits {
                continue; // TIFF defines the predictor for LZW and deflate
            }
            let encode = |which: u8| {
                let mut file = Cursor::new(Vec::new());
                let mut encoder = TiffEncoder::new(&mut file)
                    .unwrap()
                    .with_compression(compression)
                    .with_predictor(if which == 32 { Predictor::None } else { predictor });
                let (w, h) = (WIDTH as u32, HEIGHT as u32);
                match which {
                    8 => encoder.write_image::<colortype::Gray8>(w, h, &bytes),
                    16 => encoder.write_image::<colortype::Gray16>(w, h, &levels),
                    _ => encoder.write_image::<colortype::Gray32Float>(w, h, &floats),
                }
                .unwrap();
                file.into_inner()
            };
            assert_notes(&assert_reads("8.tif", &encode(8), &Pixels::U8(bytes.clone())), &[]);
            assert_notes(&assert_reads("16.tif", &encode(16), &Pixels::U16(levels.clone())), &[]);
            assert_notes(&assert_reads("32.tif", &encode(32), &Pixels::F32(floats.clone())), &[]);
        }
    }
}

#[test]
fn big_tiff_is_read() {
    let levels = levels();
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new_big(&mut file).unwrap();
    encoder.write_image::<colortype::Gray16>(WIDTH as u32, HEIGHT as u32, &levels).unwrap();
    encoder.write_image::<colortype::Gray8>(WIDTH as u32, HEIGHT as u32, &bytes_of(&levels)).unwrap();
    let file = file.into_inner();
    assert_eq!(read("big.tif", &file).image.pixels(), Pixels::U16(levels.clone()));
    assert_eq!(read_page("big.tif", &file, 1).unwrap().image.pixels(), Pixels::U8(bytes_of(&levels)));
}

#[test]
fn a_tag_of_a_big_tiff_whose_numbers_lie_beyond_any_file_does_no_harm() {
    // One row of two pixels; the planar configuration (284) claims five numbers at the last address there is.
    let entry = |tag: u16, kind: u16, count: u64, value: u64| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let tags = [(256, 2), (257, 1), (258, 8), (259, 1), (262, 1), (273, 16), (278, 1), (279, 2)];
    let mut entries: Vec<Vec<u8>> = tags.iter().map(|&(tag, value)| entry(tag, 3, 1, value)).collect();
    entries.push(entry(284, 3, 5, u64::MAX));
    let head = [&b"II+\0\x08\0\0\0"[..], &24u64.to_le_bytes(), &[7, 9, 0, 0, 0, 0, 0, 0]].concat();
    let file = [head, (entries.len() as u64).to_le_bytes().to_vec(), entries.concat(), vec![0; 8]].concat();
    // The decoder may refuse the tag; what it may not do is write at the address.
    if let Ok(loaded) = read_page("far.tif", &file, 0) {
        assert_eq!(loaded.image.pixels(), Pixels::U8(vec![7, 9]));
    }
}

#[test]
fn tiff_in_either_byte_order_in_strips_and_in_tiles_is_the_same_image() {
    let levels = levels();
    for big_endian in [false, true] {
        let sample = |v: u16| if big_endian { v.to_be_bytes() } else { v.to_le_bytes() };
        let strips = levels.chunks(5 * WIDTH).map(|rows| rows.iter().flat_map(|&v| sample(v)).collect()).collect();
        let page = Page { chunks: strips, ..Page::new(16, 1, vec![]).with(278, &[5]) };
        assert_reads("strips.tif", &tiff_file(big_endian, &[page]), &Pixels::U16(levels.clone()));

        let tile = |column: usize| -> Vec<u8> {
            let level = |x: usize, y: usize| if x < WIDTH && y < HEIGHT { levels[y * WIDTH + x] } else { 999 };
            (0..256).flat_map(|i| sample(level(16 * column + i % 16, i / 16))).collect()
        };
        let page = Page { chunks: vec![tile(0), tile(1)], ..Page::new(16, 1, vec![]) };
        let page = page.with(322, &[16]).with(323, &[16]);
        assert_reads("tiles.tif", &tiff_file(big_endian, &[page]), &Pixels::U16(levels.clone()));
    }
}

#[test]
fn lzw_tiles_cut_at_the_border_are_read() {
    // One column of the second tile is visible: asked for it alone, row by row, the decoder stumbles.
    let tile: Vec<u8> = (0..256).map(|i| if i % 16 == 0 { ((i * 40503) >> 7) as u8 } else { 0 }).collect();
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap().with_compression(Compression::Lzw);
    let mut strips = encoder.new_image::<colortype::Gray8>(16, 16).unwrap();
    strips.rows_per_strip(16).unwrap();
    strips.write_data(&tile).unwrap();
    let file = file.into_inner();
    let mut decoder = tiff::decoder::Decoder::new(Cursor::new(&file)).unwrap();
    let place = |tag| decoder.get_tag_u32(tag).unwrap() as usize;
    let (start, len) = [tiff::tags::Tag::StripOffsets, tiff::tags::Tag::StripByteCounts].map(place).into();
    let packed = file[start..start + len].to_vec();

    let page = Page { chunks: vec![packed; 2], ..Page::new(8, 1, vec![]).with(259, &[5]) };
    let page = page.with(256, &[17]).with(257, &[16]);
    let page = page.with(322, &[16]).with(323, &[16]);
    let image = read("lzw.tif", &tiff_file(false, &[page])).image;
    for (x, y) in (0..16).flat_map(|y| (0..17).map(move |x| (x, y))) {
        assert_eq!(image.grey(x, y), f32::from(tile[16 * y + x % 16]), "({x}, {y})");
    }
}

#[test]
fn white_is_zero_is_turned_round() {
    let levels = levels();
    let turned: Vec<u16> = levels.iter().map(|v| 65535 - v).collect();
    let sixteen = Page::new(16, 0, levels.iter().flat_map(|v| v.to_le_bytes()).collect());
    assert_reads("16.tif", &tiff_file(false, &[sixteen]), &Pixels::U16(turned.clone()));
    let eight = Page::new(8, 0, bytes_of(&levels));
    assert_reads("8.tif", &tiff_file(false, &[eight]), &Pixels::U8(bytes_of(&turned)));
    let twelve: Vec<u16> = levels.iter().map(|v| v >> 4).collect();
    let page = Page::new(12, 0, pack(&twelve, 12));
    assert_reads("12.tif", &tiff_file(false, &[page]), &Pixels::U16(twelve.iter().map(|v| 4095 - v).collect()));
    let bits: Vec<u16> = levels.iter().map(|v| v >> 15).collect();
    let want = bits.iter().map(|v| 255 * (1 - v) as u8).collect();
    assert_reads("1.tif", &tiff_file(false, &[Page::new(1, 0, pack(&bits, 1))]), &Pixels::U8(want));
}

#[test]
fn tiff_of_ten_to_fourteen_bits_keeps_its_scale_and_fewer_than_eight_are_stretched() {
    for bits in [10, 12, 14] {
        let levels: Vec<u16> = levels().iter().map(|v| v >> (16 - bits)).collect();
        for big_endian in [false, true] {
            let page = Page::new(bits as u32, 1, pack(&levels, bits));
            let notes = assert_reads("packed.tif", &tiff_file(big_endian, &[page]), &Pixels::U16(levels.clone()));
            assert_notes(&notes, &[&format!("{bits} bit")]);
        }
    }
    for bits in [1, 2, 4] {
        let levels: Vec<u16> = levels().iter().map(|v| v >> (16 - bits)).collect();
        let want = levels.iter().map(|&v| (v * 255 / ((1 << bits) - 1)) as u8).collect();
        let page = Page::new(bits as u32, 1, pack(&levels, bits));
        assert_notes(&assert_reads("few.tif", &tiff_file(false, &[page]), &Pixels::U8(want)), &["stretched"]);
    }
}

#[test]
fn twelve_bit_tiles_are_unpacked() {
    let levels: Vec<u16> = levels().iter().map(|v| v >> 4).collect();
    let tile = |column: usize| -> Vec<u8> {
        let level = |x: usize, y: usize| if x < WIDTH && y < HEIGHT { levels[y * WIDTH + x] } else { 999 };
        let tile: Vec<u16> = (0..256).map(|i| level(16 * column + i % 16, i / 16)).collect();
        tile.chunks(2).flat_map(|p| [(p[0] >> 4) as u8, (p[0] << 4 | p[1] >> 8) as u8, p[1] as u8]).collect()
    };
    let page = Page { chunks: vec![tile(0), tile(1)], ..Page::new(12, 1, vec![]).with(322, &[16]).with(323, &[16]) };
    assert_reads("tiles.tif", &tiff_file(false, &[page]), &Pixels::U16(levels.clone()));
}

#[test]
fn other_numbers_in_tiff_become_16_bit_when_they_fit_and_floats_otherwise() {
    let levels = levels();
    let signed = |shift: i32| -> Vec<u8> {
        levels.iter().flat_map(|&v| ((i32::from(v) - shift) as i16).to_le_bytes()).collect()
    };
    let small: Vec<u16> = levels.iter().map(|v| v >> 4).collect();
    let page = Page::new(16, 1, small.iter().flat_map(|v| v.to_le_bytes()).collect()).with(339, &[2]);
    assert_notes(&assert_reads("i16.tif", &tiff_file(false, &[page]), &Pixels::U16(small)), &["signed 16 bit"]);
    let page = Page::new(16, 1, signed(32768)).with(339, &[2]);
    let want = levels.iter().map(|&v| f32::from(v) - 32768.0).collect();
    assert_notes(&assert_reads("i16.tif", &tiff_file(false, &[page]), &Pixels::F32(want)), &["32-bit floats"]);

    let page = Page::new(32, 1, levels.iter().flat_map(|&v| u32::from(v).to_le_bytes()).collect());
    assert_notes(&assert_reads("u32.tif", &tiff_file(false, &[page]), &Pixels::U16(levels.clone())), &["16 bit"]);
    let page = Page::new(64, 1, levels.iter().flat_map(|&v| (f64::from(v) / 8.0).to_le_bytes()).collect());
    let want = levels.iter().map(|&v| f32::from(v) / 8.0).collect();
    assert_notes(&assert_reads("f64.tif", &tiff_file(false, &[page.with(339, &[3])]), &Pixels::F32(want)), &["64-bit"]);
    // Half floats: 0x3c00 is 1, 0xc000 is -2.
    let page = Page::new(16, 1, [[0x00, 0x3c], [0x00, 0xc0]].concat().repeat(SIZE)[..2 * SIZE].to_vec());
    let want = (0..SIZE).map(|i| if i % 2 == 0 { 1.0 } else { -2.0 }).collect();
    assert_reads("f16.tif", &tiff_file(false, &[page.with(339, &[3])]), &Pixels::F32(want));
    // Format 4, "undefined".
    let page = Page::new(8, 1, bytes_of(&levels)).with(339, &[4]);
    assert_reads("void.tif", &tiff_file(false, &[page]), &Pixels::U8(bytes_of(&levels)));
}

#[test]
fn tiff_palettes_are_applied() {
    let index = bytes_of(&levels());
    let map = |colour: &dyn Fn(u32) -> [u32; 3]| -> Vec<u32> {
        (0..3).flat_map(|c| (0..256).map(move |i| colour(i)[c])).collect()
    };
    let page = |map: &[u32]| tiff_file(false, &[Page::new(8, 3, index.clone()).with(320, map)]);
    for step in [257, 256, 1] {
        let notes = assert_reads("ramp.tif", &page(&map(&|i| [i * step; 3])), &Pixels::U8(index.clone()));
        assert_notes(&notes, &["identity"]);
    }
    let notes = assert_reads(
        "inverse.tif",
        &page(&map(&|i| [(255 - i) * 257; 3])),
        &Pixels::U8(index.iter().map(|i| 255 - i).collect()),
    );
    assert_notes(&notes, &["grey palette"]);
    let want = index.iter().map(|&i| u16::from(i) * 200 + 3).collect();
    assert_reads("fine.tif", &page(&map(&|i| [i * 200 + 3; 3])), &Pixels::U16(want));

    let loaded = read("colours.tif", &page(&map(&|i| [i * 257, 0, 65535 - i * 257])));
    assert_notes(&loaded.notes, &["luminance"]);
    let i = f32::from(index[5 * WIDTH + 7]);
    let want = 0.2126 * i + 0.0722 * (255.0 - i);
    assert!((loaded.image.grey(7, 5) - want).abs() < 1e-4, "{} is not {want}", loaded.image.grey(7, 5));

    let four: Vec<u16> = levels().iter().map(|v| v >> 12).collect();
    let ramp: Vec<u32> = [0; 3].iter().flat_map(|_| (0..16).map(|i| i * 4369)).collect();
    let want = four.iter().map(|&v| v as u8 * 17).collect();
    let file = tiff_file(true, &[Page::new(4, 3, pack(&four, 4)).with(320, &ramp)]);
    assert_reads("four.tif", &file, &Pixels::U8(want));
}

#[test]
fn equal_colours_are_grey_and_others_become_luminance() {
    let (levels, bytes) = (levels(), bytes_of(&levels()));
    let grey = "equal";
    let rgb = spread(&bytes, |v| vec![v; 3]);
    let notes = assert_reads("grey.png", &png(&rgb, ExtendedColorType::Rgb8), &Pixels::U8(bytes.clone()));
    assert_notes(&notes, &[grey]);
    let rgba = native(&spread(&levels, |v| vec![v, v, v, 9]));
    let notes = assert_reads("grey.png", &png(&rgba, ExtendedColorType::Rgba16), &Pixels::U16(levels.clone()));
    assert_notes(&notes, &["alpha", grey]);

    let want = |scale: f32| -> Vec<f32> {
        levels.iter().map(|&v| scale * (0.2126 * f32::from(v) + 0.0722 * f32::from(65535 - v))).collect()
    };
    let rgb = native(&spread(&levels, |v| vec![v, 0, 65535 - v]));
    let loaded = read("colour.png", &png(&rgb, ExtendedColorType::Rgb16));
    assert_notes(&loaded.notes, &["luminance"]);
    for (i, want) in want(1.0).iter().enumerate() {
        // Three rounded products of at most 65535 and two sums: below 4 x 65535 x 2^-24.
        assert!((loaded.image.grey(i % WIDTH, i / WIDTH) - want).abs() < 0.02, "pixel {i}");
    }
}

#[test]
fn tiff_colours_are_read_chunky_planar_and_with_alpha_behind_a_predictor() {
    let bytes = bytes_of(&levels());
    let rgb = |v: u8| [v, v / 2, 255 - v];
    let want: Vec<f32> =
        bytes.iter().map(|&v| rgb(v).map(f32::from)).map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect();
    let want = Pixels::F32(want);
    let base = || Page::new(8, 2, vec![]).with(258, &[8, 8, 8]).with(277, &[3]);

    let chunky = Page { chunks: vec![bytes.iter().flat_map(|&v| rgb(v)).collect()], ..base() };
    assert_notes(&assert_reads("chunky.tif", &tiff_file(false, &[chunky]), &want), &["luminance"]);
    let plane = |c: usize| bytes.iter().map(|&v| rgb(v)[c]).collect();
    let planar = Page { chunks: vec![plane(0), plane(1), plane(2)], ..base().with(284, &[2]) };
    assert_notes(&assert_reads("planar.tif", &tiff_file(false, &[planar]), &want), &["luminance"]);

    let tile = |c: usize, column: usize| -> Vec<u8> {
        let level = |x: usize, y: usize| if x < WIDTH && y < HEIGHT { rgb(bytes[y * WIDTH + x])[c] } else { 99 };
        (0..256).map(|i| level(16 * column + i % 16, i / 16)).collect()
    };
    let chunks = (0..6).map(|k| tile(k / 2, k % 2)).collect();
    let tiles = Page { chunks, ..base().with(284, &[2]).with(322, &[16]).with(323, &[16]) };
    assert_notes(&assert_reads("tiles.tif", &tiff_file(false, &[tiles]), &want), &["luminance"]);

    // Four channels, each the difference to the pixel on its left.
    let alpha = |v: u8| [rgb(v)[0], rgb(v)[1], rgb(v)[2], 77];
    let rows = bytes.chunks(WIDTH).flat_map(|row| {
        (0..row.len()).flat_map(move |x| {
            let left = if x == 0 { [0; 4] } else { alpha(row[x - 1]) };
            (0..4).map(move |c| alpha(row[x])[c].wrapping_sub(left[c]))
        })
    });
    for kind in [0, 2] {
        let page = Page { chunks: vec![rows.clone().collect()], ..base() };
        let page = page.with(258, &[8; 4]).with(277, &[4]).with(338, &[kind]).with(317, &[2]);
        assert_notes(&assert_reads("alpha.tif", &tiff_file(false, &[page]), &want), &["alpha", "luminance"]);
    }
    let grey_alpha = Page::new(8, 1, bytes.iter().flat_map(|&v| [v, 3]).collect());
    let grey_alpha = grey_alpha.with(258, &[8, 8]).with(277, &[2]).with(338, &[2]);
    assert_notes(&assert_reads("la.tif", &tiff_file(false, &[grey_alpha]), &Pixels::U8(bytes.clone())), &["alpha"]);
}

#[test]
fn png_keeps_every_grey_level() {
    let (levels, bytes) = (levels(), bytes_of(&levels()));
    assert_notes(&assert_reads("8.png", &png(&bytes, ExtendedColorType::L8), &Pixels::U8(bytes.clone())), &[]);
    let sixteen = png(&native(&levels), ExtendedColorType::L16);
    assert_notes(&assert_reads("16.png", &sixteen, &Pixels::U16(levels.clone())), &[]);
    let alpha = png(&spread(&bytes, |v| vec![v, 255 - v]), ExtendedColorType::La8);
    assert_notes(&assert_reads("alpha.png", &alpha, &Pixels::U8(bytes.clone())), &["alpha"]);

    let palette: Vec<u8> = (0..=255).flat_map(|i: u8| [255 - i; 3]).collect();
    let want = Pixels::U8(bytes.iter().map(|v| 255 - v).collect());
    assert_notes(&assert_reads("palette.png", &png_file(8, 3, &palette, &bytes), &want), &["equal"]);
    let four: Vec<u16> = levels.iter().map(|v| v >> 12).collect();
    let want = Pixels::U8(four.iter().map(|&v| v as u8 * 17).collect());
    assert_notes(&assert_reads("four.png", &png_file(4, 0, &[], &pack(&four, 4)), &want), &["4 bit"]);
}

#[test]
fn bmp_and_jpeg_are_read() {
    let bytes = bytes_of(&levels());
    let mut file = Vec::new();
    let (w, h) = (WIDTH as u32, HEIGHT as u32);
    BmpEncoder::new(&mut file).encode(&bytes, w, h, ExtendedColorType::L8).unwrap();
    assert_reads("grey.bmp", &file, &Pixels::U8(bytes));

    let smooth: Vec<u8> = (0..SIZE).map(|i| (60 + 4 * (i % WIDTH) + 3 * (i / WIDTH)) as u8).collect();
    let mut file = Vec::new();
    JpegEncoder::new_with_quality(&mut file, 100).encode(&smooth, w, h, ExtendedColorType::L8).unwrap();
    let loaded = read("grey.jpg", &file);
    assert!(matches!(loaded.image.pixels(), Levels::U8(_)) && loaded.notes.is_empty());
    for (i, &want) in smooth.iter().enumerate() {
        // At quality 100 the coefficients are rounded to whole numbers: about a grey level.
        assert!((loaded.image.grey(i % WIDTH, i / WIDTH) - f32::from(want)).abs() <= 2.0, "pixel {i}");
    }
}

#[test]
fn pgm_keeps_the_scale_of_its_maxval() {
    let (levels, bytes) = (levels(), bytes_of(&levels()));
    let mut file = Vec::new();
    PnmEncoder::new(&mut file)
        .with_subtype(PnmSubtype::Graymap(SampleEncoding::Binary))
        .encode(bytes.as_slice(), WIDTH as u32, HEIGHT as u32, ExtendedColorType::L8)
        .unwrap();
    assert_reads("8.pgm", &file, &Pixels::U8(bytes));
    for bits in [16, 14, 12, 10] {
        let levels: Vec<u16> = levels.iter().map(|v| v >> (16 - bits)).collect();
        let mut file = format!("P5\n# a comment\n{WIDTH} {HEIGHT}\n{}\n", (1_u32 << bits) - 1).into_bytes();
        file.extend(levels.iter().flat_map(|v| v.to_be_bytes()));
        assert_notes(&assert_reads("16.pgm", &file, &Pixels::U16(levels)), &[]);
    }
    for highest in [254, 200, 100] {
        let levels: Vec<u8> = levels.iter().map(|v| (v % (highest + 1)) as u8).collect();
        let text: Vec<_> = levels.iter().map(u8::to_string).collect();
        let file = format!("P2 {WIDTH} {HEIGHT} {highest}\n{}\n", text.join("\n"));
        assert_reads("text.pgm", file.as_bytes(), &Pixels::U8(levels));
    }
    let file = format!("P3 {WIDTH} {HEIGHT} 255\n{}", "10 20 30\n".repeat(SIZE));
    let loaded = read("colour.ppm", file.as_bytes());
    assert!((loaded.image.grey(3, 3) - (2.126 + 14.304 + 2.166)).abs() < 1e-4);
}

#[test]
fn the_content_decides_the_format_and_a_name_may_hold_blanks() {
    let bytes = bytes_of(&levels());
    let file = png(&bytes, ExtendedColorType::L8);
    assert_reads("img 0001 .tif", &file, &Pixels::U8(bytes.clone()));
    assert_reads("no ending", &file, &Pixels::U8(bytes));
}

#[test]
fn the_checksum_is_that_of_the_file() {
    // The number is what `sha256sum` says of these bytes.
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.pgm");
    std::fs::write(&path, b"P5 1 1 255\nA").unwrap();
    let loaded = read_image(&path, 0).unwrap();
    assert_eq!(loaded.sha256, "ab47e2e0763aa3c57324c0942aea26bc15ef6997f27d159c4a49fc14ab79d168");
    assert_eq!(loaded.pages, 1);
}

#[test]
fn a_page_of_several_is_chosen() {
    let bytes = bytes_of(&levels());
    let page = |k: u8| Page::new(8, 1, bytes.iter().map(|v| v ^ k).collect());
    let file = tiff_file(false, &[page(0), page(1), page(2)]);
    for k in 0..3 {
        let loaded = read_page("pages.tif", &file, usize::from(k)).unwrap();
        assert_eq!(loaded.image.pixels(), Pixels::U8(bytes.iter().map(|v| v ^ k).collect()));
        assert_eq!(loaded.pages, 3);
        assert_notes(&loaded.notes, &[&format!("3 pages: page {k} is read; --page chooses another")]);
    }
    let error = read_page("pages.tif", &file, 3).unwrap_err();
    assert!(matches!(error, ReadError::NoSuchPage { page: 3, pages: 3, .. }), "{error}");
    let error = read_page("one.png", &png(&bytes, ExtendedColorType::L8), 1).unwrap_err();
    assert!(matches!(error, ReadError::NoSuchPage { page: 1, pages: 1, .. }), "{error}");
}

#[test]
fn the_picture_below_a_thumbnail_is_read_and_no_mosaic_is_taken_for_grey() {
    let bytes = bytes_of(&levels());
    let small = Page::new(8, 1, vec![7; 12]).with(256, &[4]).with(257, &[3]);
    let file = raw_file(small.clone(), Page::new(8, 1, bytes.clone()));
    let notes = assert_reads("DSC_1.NEF", &file, &Pixels::U8(bytes.clone()));
    assert_notes(&notes, &["the first page of 4 x 3 px is the thumbnail"]);
    let mut opened = PagedFile::of("DSC_1.NEF".into(), file).unwrap();
    assert_eq!(opened.images().unwrap(), [0]);
    // Of two pages the first of which is a thumbnail, the second is the picture; asked for, a page is itself.
    let file = tiff_file(false, &[small.clone().with(254, &[1]), Page::new(8, 1, bytes.clone())]);
    let notes = assert_reads("two.tif", &file, &Pixels::U8(bytes.clone()));
    assert_notes(&notes, &["thumbnail", "2 pages"]);
    assert_eq!(PagedFile::of("two.tif".into(), file).unwrap().images().unwrap(), [1]);
    // What lies below a picture and is smaller is a preview of it.
    let preview = Page::new(8, 1, bytes.clone()).with(254, &[0]);
    let mut below = raw_file(preview, small.clone());
    set(&mut below, 254, 0);
    assert_notes(&assert_reads("a.tif", &below, &Pixels::U8(bytes.clone())), &[]);
    for (tag, value, wanted) in [(262, 32803, "raw mosaic of a colour camera"), (259, 34713, "Nikon")] {
        let file = raw_file(small.clone(), Page::new(8, 1, bytes.clone()).with(tag, &[value]));
        let error = read_page("DSC_1.NEF", &file, 0).unwrap_err();
        assert!(matches!(error, ReadError::Unsupported { .. }) && error.to_string().contains(wanted), "{error}");
    }
}

#[test]
fn a_stack_under_one_directory_is_as_many_images_as_it_says() {
    let bytes = bytes_of(&levels());
    let image = |k: u8| bytes.iter().map(|v| v ^ k).collect::<Vec<_>>();
    let stack = |description: &str| {
        let text: Vec<u32> = description.bytes().chain([0]).map(u32::from).collect();
        let page = Page::new(8, 1, [image(0), image(1), image(2)].concat()).with(270, &text);
        let mut file = tiff_file(false, &[page]);
        set(&mut file, 279, SIZE as u32);
        file
    };
    let shape = format!("{{\"shape\": [3, {HEIGHT}, {WIDTH}], \"truncated\": true}}");
    for description in ["ImageJ=1.54f\nimages=3\nslices=3\n", &shape] {
        let mut file = PagedFile::of("stack.tif".into(), stack(description)).unwrap();
        assert_eq!(file.images().unwrap(), [0, 1, 2], "{description}");
        for k in [2, 0, 1] {
            let loaded = file.read(k, Accepted::default()).unwrap();
            assert_eq!(loaded.image.pixels(), Pixels::U8(image(k as u8)), "{description}");
        }
        assert!(matches!(file.read(3, Accepted::default()), Err(ReadError::NoSuchPage { pages: 3, .. })));
    }
    let error = read_page("stack.tif", &stack("ImageJ=1.54f\nimages=4\n"), 0).unwrap_err();
    assert!(matches!(error, ReadError::Truncated { .. }) && error.to_string().contains("holds 3"), "{error}");
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("short.tif"), stack("ImageJ=1.54f\nimages=9\n")).unwrap();
    assert!(pages_of(&folder.path().join("short.tif")).is_err(), "a stack that is cut off is no series of one frame");
    // Pages of their own, of which each names the number of all.
    let text: Vec<u32> = b"ImageJ=1.54f\nimages=2\n\0".iter().map(|&v| v.into()).collect();
    let page = |k| Page::new(8, 1, image(k)).with(270, &text);
    let mut file = PagedFile::of("pages.tif".into(), tiff_file(false, &[page(0), page(1)])).unwrap();
    assert_eq!(file.images().unwrap(), [0, 1]);
    assert_eq!(file.read(1, Accepted::default()).unwrap().image.pixels(), Pixels::U8(image(1)));
}

#[test]
fn the_orientation_of_a_page_or_of_exif_is_undone_and_said() {
    let bytes = bytes_of(&levels());
    let upright: Vec<u8> = (0..SIZE).map(|k| bytes[(HEIGHT - 1 - k % HEIGHT) * WIDTH + k / HEIGHT]).collect();
    let exif = |orientation: u8| {
        let mut data = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
        data.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
        data
    };
    let mut jpeg = Vec::new();
    JpegEncoder::new(&mut jpeg).encode(&bytes, WIDTH as u32, HEIGHT as u32, ExtendedColorType::L8).unwrap();
    let plain = read("a.jpg", &jpeg);
    let segment = [&b"Exif\0\0"[..], &exif(6)].concat();
    let head = [&[0xff, 0xe1][..], &(segment.len() as u16 + 2).to_be_bytes(), &segment].concat();
    jpeg.splice(2..2, head);
    let turned = read("b.jpg", &jpeg);
    assert_eq!((turned.image.width(), turned.image.height()), (HEIGHT, WIDTH));
    assert!((0..WIDTH).all(|y| (0..HEIGHT).all(|x| turned.image.grey(x, y) == plain.image.grey(y, HEIGHT - 1 - x))));
    assert_notes(&turned.notes, &["turned by 90 degrees clockwise, as its orientation tag (6) says"]);
    let file = tiff_file(false, &[Page::new(8, 1, bytes.clone()).with(274, &[6])]);
    let loaded = read("c.tif", &file);
    assert_eq!((loaded.image.width(), loaded.image.pixels()), (HEIGHT, quadrille::imaging::Levels::U8(&upright)));
    // The size that is wanted is that of the picture upright, and so is that in a refusal.
    let wanted = |size: [usize; 2]| {
        let mut file = PagedFile::of("c.tif".into(), file.clone()).unwrap();
        file.read(0, Accepted { size: Some(size), ..Accepted::default() })
    };
    assert!(wanted([HEIGHT, WIDTH]).is_ok());
    let error = wanted([WIDTH, HEIGHT]).unwrap_err();
    let said = format!("the image is {HEIGHT} x {WIDTH} px, the reference {WIDTH} x {HEIGHT} px");
    assert!(error.to_string().contains(&said), "{error}");
}

#[test]
fn colours_of_one_luminance_are_named() {
    // Red and green in the proportion that luminance does not see.
    let samples: Vec<u8> =
        levels().iter().flat_map(|v| if v % 3 == 0 { [171, 80, 60] } else { [3, 130, 60] }).collect();
    let notes = read("a.png", &png(&samples, ExtendedColorType::Rgb8)).notes;
    assert!(notes.iter().any(|note| note.contains("hardly differ in luminance")), "{notes:?}");
    let samples: Vec<u8> =
        levels().iter().flat_map(|v| if v % 3 == 0 { [171, 180, 60] } else { [3, 30, 60] }).collect();
    let notes = read("a.png", &png(&samples, ExtendedColorType::Rgb8)).notes;
    assert!(!notes.iter().any(|note| note.contains("hardly differ")), "{notes:?}");
}

#[test]
fn a_broken_list_of_pages_still_gives_the_pages_before() {
    let bytes = bytes_of(&levels());
    let mut file = tiff_file(false, &[Page::new(8, 1, bytes.clone())]);
    let end = file.len();
    let first = file[4..8].to_vec();
    for link in [first, 100_000_u32.to_le_bytes().to_vec()] {
        file.splice(end - 4..end, link);
        assert_notes(&assert_reads("loop.tif", &file, &Pixels::U8(bytes.clone())), &["breaks off"]);
    }
}

// ---- errors ----

#[test]
fn missing_files_folders_and_empty_files_are_named() {
    let folder = TempDir::new().unwrap();
    let error = read_image(&folder.path().join("none.tif"), 0).unwrap_err();
    assert!(matches!(error, ReadError::NotFound { .. }), "{error}");
    let error = read_image(folder.path(), 0).unwrap_err();
    assert!(matches!(error, ReadError::Directory { .. }), "{error}");
    let error = read_page("empty.png", b"", 0).unwrap_err();
    assert!(matches!(error, ReadError::Empty { .. }), "{error}");
    // A file is no folder: the system refuses to look into it.
    std::fs::write(folder.path().join("file"), b"x").unwrap();
    let error = read_image(&folder.path().join("file").join("a.png"), 0).unwrap_err();
    assert!(matches!(error, ReadError::Io { .. }), "{error}");
}

#[test]
fn what_is_no_image_is_shown_by_its_first_bytes() {
    let error = read_page("notes.png", b"hello world", 0).unwrap_err();
    assert!(matches!(&error, ReadError::NotAnImage { begins, .. } if begins.contains("hello world")), "{error}");
    let error = read_page("noise.tif", &[1, 2, 3, 200], 0).unwrap_err();
    assert!(matches!(&error, ReadError::NotAnImage { begins, .. } if begins.contains("01 02 03 c8")), "{error}");
    let error = read_page("film.tif", b"GIF89a----------", 0).unwrap_err();
    assert!(matches!(&error, ReadError::Unsupported { format: "GIF", .. }), "{error}");
}

#[test]
fn a_file_cut_anywhere_is_an_error_and_cut_pixels_are_called_cut_off() {
    let (levels, bytes) = (levels(), bytes_of(&levels()));
    let mut jpeg = Vec::new();
    JpegEncoder::new(&mut jpeg).encode(&bytes, WIDTH as u32, HEIGHT as u32, ExtendedColorType::L8).unwrap();
    let mut bmp = Vec::new();
    BmpEncoder::new(&mut bmp).encode(&bytes, WIDTH as u32, HEIGHT as u32, ExtendedColorType::L8).unwrap();
    let mut pgm = format!("P5 {WIDTH} {HEIGHT} 65535\n").into_bytes();
    pgm.extend(levels.iter().flat_map(|v| v.to_be_bytes()));
    let mut lzw = Cursor::new(Vec::new());
    TiffEncoder::new(&mut lzw)
        .unwrap()
        .with_compression(Compression::Lzw)
        .write_image::<colortype::Gray16>(WIDTH as u32, HEIGHT as u32, &levels)
        .unwrap();
    let tiff = tiff_file(false, &[Page::new(8, 1, bytes.clone())]);
    let png = png(&native(&levels), ExtendedColorType::L16);
    for (name, file) in [("a.jpg", jpeg), ("a.bmp", bmp), ("a.pgm", pgm), ("a.tif", lzw.into_inner()), ("b.tif", tiff)]
    {
        for cut in 1..file.len() - 4 {
            let error = read_page(name, &file[..cut], 0).map(|_| format!("{name} cut at {cut} is read")).unwrap_err();
            if cut > file.len() - 10 {
                assert!(matches!(error, ReadError::Truncated { .. }), "{name} cut at {cut}: {error}");
            }
        }
    }
    // The last chunk of a PNG file (12 bytes) holds nothing.
    for cut in 1..png.len() - 16 {
        let error = read_page("a.png", &png[..cut], 0).map(|_| format!("a.png cut at {cut} is read")).unwrap_err();
        if cut > png.len() / 2 {
            assert!(matches!(error, ReadError::Truncated { .. }), "{cut}: {error}");
        }
    }
}

#[test]
fn absurd_sizes_are_refused_before_anything_is_allocated() {
    let huge = [
        tiff_file(false, &[Page::new(8, 1, vec![0; 64]).with(256, &[1 << 20]).with(257, &[1 << 20])]),
        b"P5 1000000 1000000 255\n0000".to_vec(),
    ];
    for file in huge {
        let error = read_page("huge.tif", &file, 0).unwrap_err();
        assert!(matches!(error, ReadError::TooLarge { .. }), "{error}");
    }
    let bytes = bytes_of(&levels());
    let mut png = png_file(8, 0, &[], &bytes);
    let mut bmp = Vec::new();
    BmpEncoder::new(&mut bmp).encode(&bytes, WIDTH as u32, HEIGHT as u32, ExtendedColorType::L8).unwrap();
    bmp[18..22].copy_from_slice(&30000_u32.to_le_bytes());
    bmp[22..26].copy_from_slice(&30000_u32.to_le_bytes());
    let tiff = |compression| {
        let page = Page::new(8, 1, vec![0; 64]).with(256, &[30_000]).with(257, &[30_000]).with(259, &[compression]);
        tiff_file(false, &[page])
    };
    for file in [bmp, tiff(1), tiff(5), tiff(8), tiff(32773), b"P5 30000 30000 255\n0000".to_vec()] {
        let error = read_page("large.tif", &file, 0).unwrap_err();
        assert!(matches!(error, ReadError::Truncated { .. }), "{error}");
    }
    // A changed header of a PNG file does not match its checksum.
    png[17] = 0xff;
    let error = read_page("large.png", &png, 0).unwrap_err();
    assert!(matches!(error, ReadError::Corrupt { .. }), "{error}");
}

#[test]
fn a_png_palette_that_ends_within_a_colour_is_refused() {
    let bytes = bytes_of(&levels());
    let palette = [7; 3 * 256];
    for n in [1, 2, 535, 767] {
        let error = read_page("palette.png", &png_file(8, 3, &palette[..n], &bytes), 0).unwrap_err();
        assert!(matches!(error, ReadError::Corrupt { .. }) && error.to_string().contains("palette"), "{n}: {error}");
    }
}

#[test]
fn damaged_and_foreign_tiff_pages_are_told_apart() {
    let bytes = bytes_of(&levels());
    let page = || Page::new(8, 1, bytes.clone());
    let mut no_width = page();
    no_width.tags.retain(|(tag, _)| *tag != 256);
    let no_strips = Page { chunks: vec![], ..page() };
    for page in [no_width, no_strips, page().with(257, &[0]), page().with(317, &[9]), page().with(262, &[3])] {
        let mut file = tiff_file(false, &[page]);
        file.extend([0; 300]); // long enough for the pixels
        let error = read_page("damaged.tif", &file, 0).unwrap_err();
        assert!(matches!(error, ReadError::Corrupt { .. }), "{error}");
    }
    let cmyk = page().with(262, &[5]);
    for (page, word) in [
        (cmyk, "CMYK"),
        (page().with(259, &[50001]), "WebP"),
        (page().with(258, &[24]), "24 bits"),
        (page().with(266, &[2]), "bit order"),
        (page().with(277, &[40]), "40 channels"),
        (page().with(339, &[6]), "complex"),
        (page().with(258, &[4]).with(317, &[2]), "predictor"),
    ] {
        let error = read_page("foreign.tif", &tiff_file(false, &[page]), 0).unwrap_err();
        assert!(matches!(&error, ReadError::Unsupported { what, .. } if what.contains(word)), "{word}: {error}");
    }
}

#[test]
fn zstandard_and_inks_are_read() {
    let bytes = bytes_of(&levels());
    // A frame of Zstandard with one block of bytes as they are; sizes from 256 on stand in two bytes, 256 taken off.
    let packed = |block: &[u8]| {
        let mut frame = b"\x28\xb5\x2f\xfd\x60".to_vec();
        frame.extend((SIZE as u16 - 256).to_le_bytes());
        frame.extend(&(block.len() as u32 * 8 + 1).to_le_bytes()[..3]);
        frame.extend(block);
        tiff_file(false, &[Page::new(8, 1, frame).with(259, &[50000])])
    };
    assert_reads("zstd.tif", &packed(&bytes), &Pixels::U8(bytes.clone()));
    assert!(read_page("cut.tif", &packed(&bytes[..SIZE - 20]), 0).is_err());
    let inks = bytes.iter().flat_map(|v| [0, 0, 0, 255 - v]).collect();
    let file = tiff_file(false, &[Page::new(8, 5, inks).with(258, &[8; 4]).with(277, &[4])]);
    assert_reads("inks.tif", &file, &Pixels::U8(bytes));
}

#[test]
fn nan_is_refused_with_its_place() {
    let mut floats = vec![1.0_f32; SIZE];
    floats[2 * WIDTH + 3] = f32::NAN;
    let page = Page::new(32, 1, floats.iter().flat_map(|v| v.to_le_bytes()).collect()).with(339, &[3]);
    let error = read_page("nan.tif", &tiff_file(false, &[page]), 0).unwrap_err();
    let nan = matches!(&error, ReadError::GreyLevels { reason: ImageError::NotFinite { x: 3, y: 2, .. }, .. });
    assert!(nan, "{error}");
}

// ---- writing ----

#[test]
fn what_is_written_is_read_again() {
    let folder = TempDir::new().unwrap();
    let levels = levels();
    let floats = levels.iter().map(|&v| f32::from(v) / 3.0 - 7.0).collect();
    for pixels in [Pixels::U8(bytes_of(&levels)), Pixels::U16(levels.clone()), Pixels::F32(floats)] {
        let image = Image::new(WIDTH, HEIGHT, pixels).unwrap();
        for name in ["a b.tif", "a.TIFF", "a.png"] {
            let path = folder.path().join(name);
            let written = write_image(&path, &image);
            if name == "a.png" && matches!(image.pixels(), Levels::F32(_)) {
                assert!(matches!(written, Err(WriteError::FloatPng { .. })));
                continue;
            }
            written.unwrap();
            assert_eq!(read_image(&path, 0).unwrap().image, image);
        }
    }
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let folder = TempDir::new().unwrap();
    let image = Image::new(1, 1, Pixels::U8(vec![1])).unwrap();
    for name in ["a.jpg", "a"] {
        let error = write_image(&folder.path().join(name), &image).unwrap_err();
        assert!(matches!(error, WriteError::Ending { .. }), "{error}");
    }
    let error = write_image(&folder.path().join("none").join("a.tif"), &image).unwrap_err();
    assert!(matches!(error, WriteError::Io { .. }) && error.to_string().contains("a.tif"), "{error}");
}

// ---- garbage ----

fn seeds() -> Vec<Vec<u8>> {
    let (levels, bytes) = (levels(), bytes_of(&levels()));
    let (w, h) = (WIDTH as u32, HEIGHT as u32);
    let mut files = vec![
        png(&bytes, ExtendedColorType::L8),
        png_file(4, 0, &[], &pack(&vec![3; SIZE], 4)),
        tiff_file(false, &[Page::new(8, 1, bytes.clone()), Page::new(16, 0, native(&levels))]),
        tiff_file(true, &[Page::new(12, 1, pack(&vec![77; SIZE], 12))]),
        tiff_file(false, &[Page::new(8, 3, bytes.clone()).with(320, &[257; 768])]),
        tiff_file(false, &[Page::new(8, 2, spread(&bytes, |v| vec![v; 4])).with(258, &[8; 4]).with(277, &[4])]),
        tiff_file(
            false,
            &[Page { chunks: vec![vec![5; 256]; 2], ..Page::new(8, 1, vec![]).with(322, &[16]).with(323, &[16]) }],
        ),
        {
            let page = Page { chunks: vec![bytes.clone(); 3], ..Page::new(8, 2, vec![]) };
            tiff_file(false, &[page.with(258, &[8; 3]).with(277, &[3]).with(284, &[2])])
        },
        [b"P5 21 13 255\n".as_slice(), &bytes].concat(),
    ];
    for compression in [Compression::Lzw, Compression::Deflate(DeflateLevel::Fast), Compression::Packbits] {
        let mut file = Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut file).unwrap().with_compression(compression);
        encoder.write_image::<colortype::Gray8>(w, h, &bytes).unwrap();
        files.push(file.into_inner());
    }
    let (mut bmp, mut jpeg) = (Vec::new(), Vec::new());
    BmpEncoder::new(&mut bmp).encode(&bytes, w, h, ExtendedColorType::L8).unwrap();
    JpegEncoder::new(&mut jpeg).encode(&bytes, w, h, ExtendedColorType::L8).unwrap();
    files.extend([bmp, jpeg]);
    files
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(400), failure_persistence: None, ..ProptestConfig::default() })]

    /// Overwrites a few bytes of every seed: an error or some image, never a panic.
    #[test]
    fn a_damaged_file_is_an_error_or_an_image(
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), Just(0), Just(255), Just(1)]), 1..6),
        cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
        page in 0_usize..2,
    ) {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("damaged");
        for mut file in seeds() {
            for (at, byte) in &changes {
                let at = at.index(file.len());
                file[at] = *byte;
            }
            if let Some(cut) = cut {
                file.truncate(cut.index(file.len()));
            }
            std::fs::write(&path, &file).unwrap();
            if let Ok(loaded) = read_image(&path, page) {
                prop_assert!(loaded.image.width() * loaded.image.height() == loaded.image.pixels().len());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: cases(2000), failure_persistence: None, ..ProptestConfig::default() })]

    /// Tags that contradict each other: an error or some image, never a panic.
    #[test]
    fn a_tiff_page_with_any_tags_is_an_error_or_an_image(
        tags in prop::collection::vec((tag(), prop::collection::vec(number(), 1..5)), 0..7),
        chunks in 1_usize..5,
        len in 0_usize..2000,
        big_endian: bool,
        jpeg: bool,
    ) {
        let mut page = Page::new(8, 1, vec![]);
        page.chunks = vec![if jpeg { seeds().pop().unwrap() } else { vec![7; len] }; chunks];
        if jpeg {
            page = page.with(259, &[7]);
        }
        for (tag, values) in tags {
            page = page.with(tag, &values);
        }
        if let Err(error) = read_page("tags.tif", &tiff_file(big_endian, &[page]), 0) {
            let foreign = matches!(error, ReadError::NotAnImage { .. } | ReadError::Io { .. });
            prop_assert!(!foreign, "{error}");
        }
    }
}

fn cases(usual: u32) -> u32 {
    std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

fn tag() -> impl Strategy<Value = u16> {
    prop::sample::select(vec![256, 257, 258, 259, 262, 277, 278, 284, 317, 320, 322, 323, 338, 339, 347, 530])
}

fn number() -> impl Strategy<Value = u32> {
    let sizes = vec![0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 13, 15, 16, 21, 32, 64, 255, 256, 32773, 65535];
    prop_oneof![prop::sample::select(sizes), 0_u32..40]
}

// ---- series ----

fn touch(folder: &Path, names: &[&str]) {
    for name in names {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, b"x").unwrap();
    }
}

#[track_caller]
fn expand(folder: &Path, entries: &[&str]) -> Vec<String> {
    let entries: Vec<String> = entries.iter().map(|e| e.to_string()).collect();
    let files = expand_series(&entries, folder).unwrap();
    files.iter().map(|f| f.strip_prefix(folder).unwrap().display().to_string()).collect()
}

#[test]
fn a_glob_lists_files_in_natural_order_without_hidden_ones() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path().join("a [1] folder");
    touch(&folder, &["img_10.tif", "img_2.tif", "img_1.tif", "._img_1.tif", "other.png", "img_3.tif/x"]);
    assert_eq!(expand(&folder, &["img_*.tif"]), ["img_1.tif", "img_2.tif", "img_10.tif"]);
    touch(&folder, &["run 10/img_1.tif", "run 9/img_20.tif", "run 9/img_3.tif"]);
    assert_eq!(expand(&folder, &["run */*.tif"]), ["run 9/img_3.tif", "run 9/img_20.tif", "run 10/img_1.tif"]);
}

#[test]
fn names_with_blanks_and_brackets_are_taken_literally() {
    let folder = TempDir::new().unwrap();
    touch(folder.path(), &["img [1].tif", "img 1.tif", "img_0030 .png", "a1.tif"]);
    assert_eq!(expand(folder.path(), &["img [1].tif"]), ["img [1].tif"]);
    assert_eq!(expand(folder.path(), &["a[1].tif"]), ["a1.tif"]);
    assert_eq!(expand(folder.path(), &["img_0030 .png"]), ["img_0030 .png"]);
    assert_eq!(expand(folder.path(), &["*[0-9] .png"]), ["img_0030 .png"]);
}

#[test]
fn entries_keep_their_order_and_a_file_counts_once() {
    let folder = TempDir::new().unwrap();
    touch(folder.path(), &["b.tif", "a.tif", "c.tif"]);
    assert_eq!(
        expand(folder.path(), &["c.tif", "*.tif", "gone.tif", "b.tif"]),
        ["c.tif", "a.tif", "b.tif", "gone.tif"]
    );
    let absolute = folder.path().join("*.tif").display().to_string();
    assert_eq!(expand_series(&[absolute], Path::new("elsewhere")).unwrap().len(), 3);
}

#[test]
fn a_glob_without_a_file_a_folder_and_a_wrong_pattern_are_errors() {
    let folder = TempDir::new().unwrap();
    touch(folder.path(), &["sub/a.txt", "own/b.tif", "own/a.TIF", "own/.c.tif"]);
    let error = |entry: &str| expand_series(&[entry.to_owned()], folder.path()).unwrap_err();
    let none = error("img_*.tif");
    assert!(matches!(none, SeriesError::NoMatch { .. }) && none.to_string().contains("`img_*.tif`"), "{none}");
    assert!(none.to_string().contains(&folder.path().display().to_string()), "{none}");
    assert!(matches!(error("su*"), SeriesError::NoMatch { .. }));
    assert!(error("").to_string().contains("`./*.tif`"));
    let sub = error("sub/");
    assert!(matches!(sub, SeriesError::Directory { .. }) && sub.to_string().contains("`sub/*.tif`"), "{sub}");
    assert!(matches!(error("a[.tif"), SeriesError::Pattern { .. }));
    assert_eq!(expand(folder.path(), &["own"]), ["own/a.TIF", "own/b.tif"]);
}

// ---- images of real tests ----

/// Reads `name` and compares its size, depth, the sum of all grey levels, and those at (10, 20), in the middle
/// (width/2, height/2) and in the last corner. The numbers are those of Pillow 12 and tifffile.
#[track_caller]
fn assert_file(
    data: &Path,
    name: &str,
    page: usize,
    size: [usize; 2],
    depth: &str,
    sum: f64,
    levels: [f32; 3],
) -> Loaded {
    let loaded = read_image(&data.join(name), page).unwrap();
    let image = &loaded.image;
    let [w, h] = size;
    assert_eq!(([image.width(), image.height()], image.pixels().depth()), (size, depth), "{name}");
    let total: f64 = (0..h).flat_map(|y| (0..w).map(move |x| f64::from(image.grey(x, y)))).sum();
    assert_eq!(total, sum, "{name}");
    assert_eq!([image.grey(10, 20), image.grey(w / 2, h / 2), image.grey(w - 1, h - 1)], levels, "{name}");
    loaded
}

#[test]
fn real_files_have_the_grey_levels_that_other_readers_find() {
    let Some(data) = data::folder("") else { return };
    let data = data.as_path();
    let palette = "dicchallenge-s12-openhole/oht_cfrp_00.tiff";
    let loaded = assert_file(data, palette, 0, [400, 1040], "8 bit", 33461499.0, [22.0, 12.0, 11.0]);
    assert_notes(&loaded.notes, &["identity grey ramp"]);
    let rgb = "rotation-170/rotation_170.tif";
    let loaded = assert_file(data, rgb, 0, [512, 512], "8 bit", 69910134.0 / 3.0, [0.0, 131.0, 0.0]);
    assert_notes(&loaded.notes, &["equal"]);
    let pages = "format-multipage/def.tif";
    let loaded = assert_file(data, pages, 0, [512, 512], "8 bit", 24740189.0, [30.0, 80.0, 51.0]);
    assert_notes(&loaded.notes, &["2 pages: page 0 is read; --page chooses another"]);
    assert_eq!(loaded.sha256, "7b244af1e8fa2447765b6228783d443f1e94e9de1244de24e1100557b5b9c71e");
    assert_file(data, pages, 1, [512, 512], "8 bit", 24762955.0, [28.0, 69.0, 38.0]);
    let packbits = "dicchallenge2-star/DIC_Challenge_Star_Noise_Ref.tiff";
    assert_file(data, packbits, 0, [4000, 501], "8 bit", 231666474.0, [93.0, 143.0, 203.0]);
    let blank = "crack-heterogeneous/img_0030 .png";
    assert_file(data, blank, 0, [800, 1228], "16 bit", 43670414365.0, [65535.0, 28315.0, 65535.0]);
    let sixteen = "crack-heterogeneous/img_0570.tif";
    assert_file(data, sixteen, 0, [822, 1242], "16 bit", 43853590012.0, [0.0, 40149.0, 0.0]);
    let lzw = "sundic-necking/img_4.tif";
    assert_file(data, lzw, 0, [1514, 582], "8 bit", 53609157.0, [7.0, 77.0, 37.0]);
    let bmp = "openhole-bmp/oht_cfrp_4.bmp";
    assert_file(data, bmp, 0, [280, 900], "8 bit", 24964213.0, [80.0, 14.0, 166.0]);
    let plain = "dicchallenge-s14-sinusoid/Sample14 Reference.tif";
    assert_file(data, plain, 0, [2048, 589], "8 bit", 104963732.0, [63.0, 45.0, 98.0]);
}

#[test]
fn the_real_crack_series_is_found_in_order() {
    let Some(data) = data::folder("") else { return };
    let files = expand_series(&["img_* .png".to_owned()], &data.join("crack-heterogeneous")).unwrap();
    assert_eq!(files.len(), 20);
    assert!(files[0].ends_with("img_0000 .png") && files[19].ends_with("img_0570 .png"));
}
