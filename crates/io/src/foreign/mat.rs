//! Arrays of numbers in a file of MATLAB, level 5: elements of a type, a length and data, packed or not
//! (MathWorks, "MAT-File Format", chapter 1).

use crate::arrays::Values;
use crate::npz::Array;
use flate2::read::ZlibDecoder;
use std::collections::BTreeMap;
use std::io::Read;

const HEADER: usize = 128;
const MATRIX: u32 = 14;
const PACKED: u32 = 15;
/// Classes of arrays of numbers, floats and whole ones.
const NUMBERS: std::ops::RangeInclusive<u8> = 6..=15;
/// No array of this level is larger.
const LARGEST: u64 = 1 << 31;

/// The arrays of numbers, by name; others (texts, structures) are passed over.
pub(super) fn read_arrays(bytes: &[u8]) -> Result<BTreeMap<String, Array>, String> {
    let cut = || "the file is cut off; copy it again".to_owned();
    let is_little = bytes.get(126..HEADER) == Some(b"IM");
    let mut rest = bytes.get(HEADER..).ok_or_else(cut)?;
    let mut arrays = BTreeMap::new();
    while !rest.is_empty() {
        let (kind, data) = Elements { rest, is_little }.next().ok_or_else(cut)?;
        // A packed element is not filled up to eight bytes.
        rest = rest.get(8 + data.len()..).unwrap_or_default();
        if kind == PACKED {
            let mut unpacked = Vec::new();
            let read = ZlibDecoder::new(data).take(LARGEST).read_to_end(&mut unpacked);
            read.map_err(|error| format!("an array cannot be unpacked: {error}"))?;
            let element = Elements { rest: &unpacked, is_little }.next();
            arrays.extend(element.and_then(|(kind, data)| array(kind, data, is_little)));
        } else {
            arrays.extend(array(kind, data, is_little));
        }
    }
    Ok(arrays)
}

/// Elements one behind the other.
struct Elements<'a> {
    rest: &'a [u8],
    is_little: bool,
}

impl Elements<'_> {
    fn number(&self, bytes: &[u8]) -> u32 {
        let four = bytes.first_chunk().copied().unwrap_or_default();
        if self.is_little { u32::from_le_bytes(four) } else { u32::from_be_bytes(four) }
    }
}

impl<'a> Iterator for Elements<'a> {
    type Item = (u32, &'a [u8]);

    /// Type and data of the next one.
    fn next(&mut self) -> Option<Self::Item> {
        let (tag, behind) = self.rest.split_at_checked(8)?;
        let kind = self.number(tag);
        if kind > 0xffff {
            // A small one: length, type and data within eight bytes.
            self.rest = behind;
            return Some((kind & 0xffff, tag.get(4..)?.get(..(kind >> 16) as usize)?));
        }
        let len = self.number(tag.get(4..)?) as usize;
        let data = behind.get(..len)?;
        self.rest = behind.get(len.next_multiple_of(8)..).unwrap_or_default();
        Some((kind, data))
    }
}

/// Name and numbers of an array; `None` where it holds something else.
fn array(kind: u32, data: &[u8], is_little: bool) -> Option<(String, Array)> {
    let mut parts = Elements { rest: data, is_little };
    let (_, flags) = parts.next().filter(|_| kind == MATRIX)?;
    let class = *if is_little { flags.first() } else { flags.get(3) }?;
    if !NUMBERS.contains(&class) {
        return None;
    }
    let (_, axes) = parts.next()?;
    let shape: Vec<u64> = axes.chunks_exact(4).map(|axis| parts.number(axis).into()).collect();
    let (_, name) = parts.next()?;
    let name = String::from_utf8(name.to_vec()).ok()?;
    let (number, data) = parts.next()?;
    let values = values(number, data, is_little)?;
    let n = shape.iter().try_fold(1_u64, |n, &axis| n.checked_mul(axis))?;
    (n == values.len() as u64).then(|| (name, Array::by_columns(shape, Values::F64(values))))
}

/// The numbers of a type, of whatever size they were stored in.
pub(super) fn values(kind: u32, data: &[u8], is_little: bool) -> Option<Vec<f64>> {
    macro_rules! all {
        ($number:ty) => {{
            let number = |bytes: &[u8]| {
                let mut own = [0; size_of::<$number>()];
                own.copy_from_slice(bytes);
                if is_little { <$number>::from_le_bytes(own) } else { <$number>::from_be_bytes(own) }
            };
            Some(data.chunks_exact(size_of::<$number>()).map(|bytes| number(bytes) as f64).collect())
        }};
    }
    match kind {
        1 => all!(i8),
        2 => all!(u8),
        3 => all!(i16),
        4 => all!(u16),
        5 => all!(i32),
        6 => all!(u32),
        7 => all!(f32),
        9 => all!(f64),
        12 => all!(i64),
        13 => all!(u64),
        _ => None,
    }
}
