//! Arrays for NumPy: `.npz`, an archive of one `.npy` file for each array.

use super::arrays::{ArrayFile, ArrayFileError, Number, Open, Shape, Values};
use npyz::{DType, NpyFile, Order, WriteOptions, WriterBuilder};
use std::collections::BTreeMap;
use std::io::{self, Read, Seek, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Writes a `.npz` file that `numpy.load` reads, uncompressed as `numpy.savez` does. It may be of any size.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::arrays::{ArrayFile, Number, Shape, Values};
/// use quadrille::io::npz::NpzWriter;
/// let mut file = NpzWriter::new(std::io::Cursor::new(Vec::new()));
/// file.begin("displacement_px", Number::F64, Shape { frames: Some(2), rows: 3, components: 2 })?;
/// for frame in [0.5, 1.0] {
///     file.block(&Values::F64(vec![frame; 6]))?; // (2, 3, 2) in NumPy
/// }
/// let bytes = file.finish()?.into_inner();
/// assert!(bytes.starts_with(b"PK"));
/// # Ok::<(), quadrille::io::arrays::ArrayFileError>(())
/// ```
///
/// One that is dropped without [`NpzWriter::finish`], as after an error, leaves what it was given as it is.
pub struct NpzWriter<W: Write + Seek> {
    /// Until it is finished.
    zip: Option<ZipWriter<W>>,
    open: Option<Open>,
}

impl<W: Write + Seek> NpzWriter<W> {
    /// A file without any array.
    pub fn new(out: W) -> Self {
        Self { zip: Some(ZipWriter::new(out)), open: None }
    }

    /// Ends the file and gives the writer back.
    ///
    /// # Errors
    /// An array that is not complete, and those of the writer.
    pub fn finish(mut self) -> Result<W, ArrayFileError> {
        self.open.as_ref().map_or(Ok(()), Open::close)?;
        // What a buffer still holds fails here and not within the crate.
        self.zip()?.flush()?;
        match self.zip.take() {
            Some(zip) => Ok(zip.finish().map_err(std::io::Error::other)?),
            None => Err(finished().into()),
        }
    }

    fn zip(&mut self) -> io::Result<&mut ZipWriter<W>> {
        self.zip.as_mut().ok_or_else(finished)
    }

    fn member(&mut self, name: &str, type_word: &str, shape: &[u64]) -> Result<(), ArrayFileError> {
        self.open.take().map_or(Ok(()), |open| open.close())?;
        // No array is known to stay below 4 GB. All members have the format's first time: same arrays, same bytes.
        let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored).large_file(true);
        self.zip()?.start_file(format!("{name}.npy"), options).map_err(std::io::Error::other)?;
        let kind = type_word.parse().map_err(std::io::Error::other)?;
        let header = WriteOptions::new_header_only().dtype(DType::Plain(kind)).shape(shape);
        header.writer(self.zip()?).write_header_only()?;
        Ok(())
    }
}

fn finished() -> io::Error {
    io::Error::other("the archive is finished")
}

impl<W: Write + Seek> Drop for NpzWriter<W> {
    /// Without an end: the crate would write one, even where the disk just refused, at a place it takes for impossible.
    fn drop(&mut self) {
        std::mem::forget(self.zip.take());
    }
}

/// NumPy's word for a kind of numbers.
fn type_word(number: Number) -> &'static str {
    match number {
        Number::F64 => "<f8",
        Number::F32 => "<f4",
        Number::U32 => "<u4",
        Number::U8 => "|u1",
    }
}

/// The arrays of a `.npz` file that [`NpzWriter`] wrote, by name, each as one list; no texts. All of the file is
/// checked: what was changed or cut is no result.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::arrays::{ArrayFile, Values};
/// use quadrille::io::npz::{NpzWriter, read_npz};
/// let mut file = NpzWriter::new(std::io::Cursor::new(Vec::new()));
/// file.table("u", 2, &Values::F64(vec![0.1, -0.0, 1e-300, 4.0]))?;
/// let mut bytes = file.finish()?;
/// assert_eq!(read_npz(&mut bytes)?["u"], Values::F64(vec![0.1, -0.0, 1e-300, 4.0]));
/// bytes.get_mut()[180] ^= 1;
/// assert!(read_npz(&mut bytes).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that is not whole or none of this kind, and those of the reader.
pub fn read_npz(from: impl Read + Seek) -> io::Result<BTreeMap<String, Values>> {
    Ok(read_arrays(from)?.into_iter().map(|(name, array)| (name, array.values)).collect())
}

/// An array with its shape.
#[derive(Debug)]
pub(crate) struct Array {
    /// Length of each axis.
    pub shape: Vec<u64>,
    is_fortran: bool,
    values: Values,
}

impl Array {
    /// Of this shape, numbers column by column.
    pub fn by_columns(shape: Vec<u64>, values: Values) -> Self {
        Self { shape, is_fortran: true, values }
    }

    /// Of this shape, numbers row by row.
    pub fn by_rows(shape: Vec<u64>, values: Values) -> Self {
        Self { shape, is_fortran: false, values }
    }

    /// The number at a place, counted column by column; NaN beyond the end.
    pub fn nth(&self, at: usize) -> f64 {
        let rows = self.shape.first().map_or(1, |&n| n.max(1) as usize);
        self.value(at % rows, at / rows)
    }

    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// The number in a row and column; of an array of one axis the column is 0. NaN beyond the ends.
    pub fn value(&self, row: usize, column: usize) -> f64 {
        let axis = |k: usize| self.shape.get(k).map_or(1, |&n| n as usize);
        let at = if self.is_fortran { row + column * axis(0) } else { row * axis(1) + column };
        self.values.get(at).unwrap_or(f64::NAN)
    }
}

/// The arrays of a `.npz` file, by name; no texts. All of the file is checked.
pub(crate) fn read_arrays(from: impl Read + Seek) -> io::Result<BTreeMap<String, Array>> {
    let mut zip = ZipArchive::new(from).map_err(io::Error::other)?;
    let mut arrays = BTreeMap::new();
    for k in 0..zip.len() {
        let mut member = zip.by_index(k).map_err(io::Error::other)?;
        // To the very end, where the checksum is compared.
        let mut bytes = Vec::new();
        member.read_to_end(&mut bytes)?;
        within(&bytes)?;
        let array = NpyFile::new(bytes.as_slice())?;
        let shape = array.shape().to_vec();
        let is_fortran = array.order() == Order::Fortran;
        let entries = shape.iter().try_fold(1_u64, |n, &axis| n.checked_mul(axis));
        if entries.is_none_or(|n| n > bytes.len() as u64) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "an array claims more numbers than its file has bytes",
            ));
        }
        let kind = array.dtype().descr();
        let is = |number: Number| kind == format!("'{}'", type_word(number));
        let values = if is(Number::F64) {
            Values::F64(array.into_vec()?)
        } else if is(Number::F32) {
            Values::F32(array.into_vec()?)
        } else if is(Number::U32) {
            Values::U32(array.into_vec()?)
        } else if is(Number::U8) {
            Values::U8(array.into_vec()?)
        } else {
            continue;
        };
        let name = member.name().map_err(io::Error::other)?.trim_end_matches(".npy").to_owned();
        arrays.insert(name, Array { shape, is_fortran, values });
    }
    Ok(arrays)
}

/// Refuses a `.npy` file that claims a header longer than itself, for which the reader would make room.
fn within(npy: &[u8]) -> io::Result<()> {
    // Behind the magic word and the version stands the length, from version 2 on in four bytes.
    let header = npy
        .get(8..12)
        .filter(|_| npy.get(6).is_some_and(|&version| version >= 2))
        .and_then(|n| n.try_into().ok())
        .map(u32::from_le_bytes);
    if header.is_some_and(|length| length as usize > npy.len()) {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "the header of an array is longer than its file"));
    }
    Ok(())
}

impl<W: Write + Seek> ArrayFile for NpzWriter<W> {
    const FIRST: u32 = 0;

    fn check(_: &str, _: Number, _: Shape) -> Result<(), ArrayFileError> {
        Ok(())
    }

    fn begin(&mut self, name: &str, number: Number, shape: Shape) -> Result<(), ArrayFileError> {
        let mut axes: Vec<u64> = shape.frames.into_iter().chain([shape.rows]).map(|n| n as u64).collect();
        if shape.components > 1 {
            axes.push(shape.components as u64);
        }
        self.member(name, type_word(number), &axes)?;
        self.open = Some(Open::new(name, number, shape));
        Ok(())
    }

    fn block(&mut self, values: &Values) -> Result<(), ArrayFileError> {
        if let Some(open) = &mut self.open {
            open.take(values)?;
        }
        Ok(self.zip()?.write_all(&values.bytes(0..values.len()))?)
    }

    /// An array of fixed-width Unicode text.
    fn texts(&mut self, name: &str, texts: &[String]) -> Result<(), ArrayFileError> {
        let width = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        self.member(name, &format!("<U{width}"), &[texts.len() as u64])?;
        for text in texts {
            let letters = text.chars().map(u32::from).chain(std::iter::repeat(0)).take(width);
            self.zip()?.write_all(&letters.flat_map(u32::to_le_bytes).collect::<Vec<u8>>())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An archive of one file.
    fn archive(npy: &[u8]) -> io::Cursor<Vec<u8>> {
        let mut zip = ZipWriter::new(io::Cursor::new(Vec::new()));
        let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored);
        zip.start_file("u.npy", options).unwrap();
        zip.write_all(npy).unwrap();
        zip.finish().unwrap()
    }

    /// Takes so many bytes.
    struct Full(io::Cursor<Vec<u8>>, u64);

    impl Write for Full {
        fn write(&mut self, data: &[u8]) -> io::Result<usize> {
            if self.0.position() + data.len() as u64 > self.1 {
                Err(io::ErrorKind::StorageFull.into())
            } else {
                self.0.write(data)
            }
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Full {
        fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn a_disk_that_is_full_at_any_byte_is_an_error_alone() {
        let tables = |room: u64| {
            let mut file = NpzWriter::new(Full(io::Cursor::new(Vec::new()), room));
            file.table("u", 2, &Values::F64(vec![0.1, -0.0, 1e-300, 4.0]))?;
            file.table("v", 1, &Values::U8(vec![1; 40]))?;
            Ok::<_, ArrayFileError>(file)
        };
        let written = tables(u64::MAX).unwrap().finish().unwrap().0.into_inner().len() as u64;
        let enough = (0..written).find(|&room| tables(room).is_ok()).unwrap();
        assert!(enough > 40 + 32 && tables(written - 1).unwrap().finish().is_err());
        assert!(tables(written).unwrap().finish().is_ok());
    }

    #[test]
    fn what_an_array_claims_beyond_its_file_is_refused_before_room_is_made() {
        let text = "{'descr': '<f8', 'fortran_order': False, 'shape': (400000000000,), }";
        let mut claims_entries = b"\x93NUMPY\x01\x00".to_vec();
        claims_entries.extend((text.len() as u16).to_le_bytes());
        claims_entries.extend(text.as_bytes());
        let mut claims_header = b"\x93NUMPY\x02\x00".to_vec();
        claims_header.extend(3_500_000_000_u32.to_le_bytes());
        claims_header.extend(text.as_bytes());
        for (npy, why) in [(claims_entries, "more numbers"), (claims_header, "longer than its file")] {
            let error = read_npz(archive(&npy)).unwrap_err();
            assert!(error.to_string().contains(why), "{error}");
        }
    }
}
