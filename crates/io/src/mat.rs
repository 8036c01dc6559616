//! Arrays for MATLAB: `.mat`, level 5.
//!
//! The format is that of MathWorks' "MAT-File Format", chapter 1: a header of 128 bytes, then one element for
//! each variable, made of a tag (type, bytes) and data padded to 8 bytes. Numbers stand column by column.

#![expect(clippy::indexing_slicing, reason = "writes: pads to eight bytes, and a tag is of eight")]

use super::arrays::{ArrayFile, ArrayFileError, Number, Open, Shape, Values};
use std::io::Write;

// Types of data elements.
const INT8: u32 = 1;
const UINT8: u32 = 2;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const SINGLE: u32 = 7;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
const UTF16: u32 = 17;
// Classes of arrays.
const CELL_CLASS: u32 = 1;
const CHAR_CLASS: u32 = 4;
const DOUBLE_CLASS: u32 = 6;
const SINGLE_CLASS: u32 = 7;
const UINT8_CLASS: u32 = 9;
const UINT32_CLASS: u32 = 13;

/// Bytes that a variable of this level may have: MATLAB reads none of 2^31 or more.
const LARGEST: u128 = (1 << 31) - 1;

/// Writes a `.mat` file of level 5, uncompressed, that MATLAB, Octave and `scipy.io.loadmat` read.
///
/// The axis of frames comes **last**, `displacement_px(node, component, frame)`, so that the field of a frame is
/// `displacement_px(:, :, k)`; nodes, elements and zones are counted from 1. Lists of texts are cell arrays; a
/// character beyond U+FFFF becomes U+FFFD.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::arrays::{ArrayFile, Values};
/// use quadrille::io::mat::MatWriter;
/// let mut file = MatWriter::new(Vec::new(), "quadrille")?;
/// file.table("node_position_px", 2, &Values::F64(vec![0.0, 0.0, 16.0, 0.0]))?; // 2 x 2
/// assert_eq!(file.finish()?.len() % 8, 0);
/// # Ok::<(), quadrille::io::arrays::ArrayFileError>(())
/// ```
pub struct MatWriter<W: Write> {
    out: W,
    open: Option<Open>,
    /// Zeros that follow the array begun, to the next multiple of 8 bytes.
    padding: usize,
}

impl<W: Write> MatWriter<W> {
    /// A file without any variable; the first 100 or so characters of `text` stand at its head.
    pub fn new(mut out: W, text: &str) -> Result<Self, ArrayFileError> {
        let about = format!("MATLAB 5.0 MAT-file, {text}");
        let mut head: Vec<u8> = about.chars().map(|c| if c.is_ascii_graphic() { c as u8 } else { b' ' }).collect();
        head.resize(116, b' ');
        head.extend([0; 8]); // no data of subsystems
        head.extend(0x0100u16.to_le_bytes());
        head.extend(b"IM"); // the lowest byte first
        out.write_all(&head)?;
        Ok(Self { out, open: None, padding: 0 })
    }

    /// Ends the file and gives the writer back.
    ///
    /// # Errors
    /// An array that is not complete, and those of the writer.
    pub fn finish(mut self) -> Result<W, ArrayFileError> {
        self.close()?;
        self.out.flush()?;
        Ok(self.out)
    }

    fn close(&mut self) -> Result<(), ArrayFileError> {
        if let Some(open) = self.open.take() {
            open.close()?;
            self.out.write_all(&[0; 8][..self.padding])?;
        }
        Ok(())
    }
}

fn tag(kind: u32, n_bytes: usize) -> [u8; 8] {
    let mut tag = [0; 8];
    tag[..4].copy_from_slice(&kind.to_le_bytes());
    tag[4..].copy_from_slice(&(n_bytes as u32).to_le_bytes());
    tag
}

fn padding(n_bytes: usize) -> usize {
    n_bytes.wrapping_neg() % 8
}

fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut bytes = tag(kind, data.len()).to_vec();
    bytes.extend(data);
    bytes.extend(&[0; 8][..padding(data.len())]);
    bytes
}

/// Flags, dimensions and name: what every array begins with.
fn beginning(class: u32, dimensions: &[usize], name: &str) -> Vec<u8> {
    let mut bytes = element(UINT32, &[class.to_le_bytes(), [0; 4]].concat());
    let dimensions: Vec<u8> = dimensions.iter().flat_map(|&n| (n as i32).to_le_bytes()).collect();
    bytes.extend(element(INT32, &dimensions));
    bytes.extend(element(INT8, name.as_bytes()));
    bytes
}

fn dimensions(shape: Shape) -> Vec<usize> {
    let mut dimensions = vec![shape.rows];
    // MATLAB knows no array of fewer than two axes.
    if shape.components > 1 || shape.frames.is_none() {
        dimensions.push(shape.components);
    }
    dimensions.extend(shape.frames);
    dimensions
}

fn char_array(name: &str, text: &str) -> Vec<u8> {
    // Beyond the first 65536, readers do not agree on how many letters a character is.
    let letters: Vec<u16> = text.chars().map(|c| u16::try_from(u32::from(c)).unwrap_or(0xfffd)).collect();
    let mut bytes = beginning(CHAR_CLASS, &[usize::from(!letters.is_empty()), letters.len()], name);
    let letters: Vec<u8> = letters.iter().flat_map(|letter| letter.to_le_bytes()).collect();
    bytes.extend(element(UTF16, &letters));
    bytes
}

impl<W: Write> ArrayFile for MatWriter<W> {
    const FIRST: u32 = 1;

    fn check(name: &str, number: Number, shape: Shape) -> Result<(), ArrayFileError> {
        let bytes = shape.n_values() * number.size() as u128;
        // Head and name beside the numbers.
        if bytes + 256 + name.len() as u128 > LARGEST {
            return Err(ArrayFileError::TooLarge { name: name.to_owned(), bytes });
        }
        Ok(())
    }

    fn begin(&mut self, name: &str, number: Number, shape: Shape) -> Result<(), ArrayFileError> {
        Self::check(name, number, shape)?;
        self.close()?;
        let (class, kind) = match number {
            Number::F64 => (DOUBLE_CLASS, DOUBLE),
            Number::F32 => (SINGLE_CLASS, SINGLE),
            Number::U32 => (UINT32_CLASS, UINT32),
            Number::U8 => (UINT8_CLASS, UINT8),
        };
        let n_bytes = shape.n_values() as usize * number.size();
        let beginning = beginning(class, &dimensions(shape), name);
        self.padding = padding(n_bytes);
        self.out.write_all(&tag(MATRIX, beginning.len() + 8 + n_bytes + self.padding))?;
        self.out.write_all(&beginning)?;
        self.out.write_all(&tag(kind, n_bytes))?;
        self.open = Some(Open::new(name, number, shape));
        Ok(())
    }

    fn block(&mut self, values: &Values) -> Result<(), ArrayFileError> {
        let Some(open) = &mut self.open else { return Ok(()) };
        open.take(values)?;
        let Shape { rows, components, .. } = open.shape;
        let by_columns = (0..components).flat_map(|column| (0..rows).map(move |row| row * components + column));
        Ok(self.out.write_all(&values.bytes(by_columns))?)
    }

    /// A cell array of one column.
    fn texts(&mut self, name: &str, texts: &[String]) -> Result<(), ArrayFileError> {
        let mut bytes = beginning(CELL_CLASS, &[texts.len(), 1], name);
        for text in texts {
            bytes.extend(element(MATRIX, &char_array("", text)));
        }
        if bytes.len() as u128 > LARGEST {
            return Err(ArrayFileError::TooLarge { name: name.to_owned(), bytes: bytes.len() as u128 });
        }
        self.close()?;
        Ok(self.out.write_all(&element(MATRIX, &bytes))?)
    }
}
