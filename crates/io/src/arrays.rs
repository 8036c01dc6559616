//! Named arrays of numbers, as the files of other programs take them.

use std::io;
use thiserror::Error;

/// Kind of the numbers of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Number {
    /// 64-bit floats.
    F64,
    /// 32-bit floats.
    F32,
    /// Whole numbers of 32 bits, from 0.
    U32,
    /// Whole numbers from 0 to 255.
    U8,
}

impl Number {
    /// Bytes of one number.
    pub fn size(self) -> usize {
        match self {
            Number::F64 => 8,
            Number::F32 | Number::U32 => 4,
            Number::U8 => 1,
        }
    }
}

/// Numbers of one kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// 64-bit floats.
    F64(Vec<f64>),
    /// 32-bit floats.
    F32(Vec<f32>),
    /// Whole numbers of 32 bits, from 0.
    U32(Vec<u32>),
    /// Whole numbers from 0 to 255.
    U8(Vec<u8>),
}

impl Values {
    /// Their kind.
    pub fn number(&self) -> Number {
        match self {
            Values::F64(_) => Number::F64,
            Values::F32(_) => Number::F32,
            Values::U32(_) => Number::U32,
            Values::U8(_) => Number::U8,
        }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Values::F64(values) => values.len(),
            Values::F32(values) => values.len(),
            Values::U32(values) => values.len(),
            Values::U8(values) => values.len(),
        }
    }

    /// The number at a place.
    pub(crate) fn get(&self, at: usize) -> Option<f64> {
        match self {
            Values::F64(values) => values.get(at).copied(),
            Values::F32(values) => values.get(at).copied().map(f64::from),
            Values::U32(values) => values.get(at).copied().map(f64::from),
            Values::U8(values) => values.get(at).copied().map(f64::from),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Their bytes, the lowest first, in the order `order` of their places.
    #[expect(clippy::indexing_slicing, reason = "written by the program, in an order of its own places")]
    pub(super) fn bytes(&self, order: impl Iterator<Item = usize>) -> Vec<u8> {
        match self {
            Values::F64(values) => order.flat_map(|k| values[k].to_le_bytes()).collect(),
            Values::F32(values) => order.flat_map(|k| values[k].to_le_bytes()).collect(),
            Values::U32(values) => order.flat_map(|k| values[k].to_le_bytes()).collect(),
            Values::U8(values) => order.map(|k| values[k]).collect(),
        }
    }
}

/// Shape of a named array: rows (nodes, elements, ...) with some components each, once or for every frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Frames, when the array has that axis; each is one block of values.
    pub frames: Option<usize>,
    /// Rows of a block.
    pub rows: usize,
    /// Values per row; an axis only when there are more than one.
    pub components: usize,
}

impl Shape {
    /// An array without the axis of frames: one block.
    pub fn table(rows: usize, components: usize) -> Self {
        Self { frames: None, rows, components }
    }

    /// Values in one block, row by row.
    pub fn block(self) -> usize {
        self.rows * self.components
    }

    /// All values.
    pub fn n_values(self) -> u128 {
        self.block() as u128 * self.frames.unwrap_or(1) as u128
    }
}

/// Why an array cannot be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ArrayFileError {
    /// The format has no room for it.
    #[error(
        "the array {name} would have {:.2} GB and a variable of a MAT file (level 5) ends at 2.14 GB; take fewer \
         --frames, a file for each with --split, or --to npz",
        *bytes as f64 / 1e9
    )]
    TooLarge {
        /// Name of the array.
        name: String,
        /// Its bytes.
        bytes: u128,
    },
    /// The blocks of an array are not what its beginning said. A bug of the caller.
    #[error("the array {name} was announced with {wanted} values of another kind or number than the {found} that came")]
    WrongBlock {
        /// Name of the array.
        name: String,
        /// Values that were to come.
        wanted: u128,
        /// Values that came.
        found: u128,
    },
    /// The file cannot be written.
    #[error("the file cannot be written")]
    Write(#[from] io::Error),
}

/// A file of named arrays that is written block by block, so that no array has to fit in memory.
pub trait ArrayFile {
    /// Number of the first node, element or zone: 0, or 1 as MATLAB counts.
    const FIRST: u32;

    /// Whether an array of this kind and shape fits.
    ///
    /// # Errors
    /// [`ArrayFileError::TooLarge`].
    fn check(name: &str, number: Number, shape: Shape) -> Result<(), ArrayFileError>;

    /// Begins an array; its blocks follow, and nothing else before the last of them.
    ///
    /// # Errors
    /// An array that does not fit, an array before that is not complete, and those of the file.
    fn begin(&mut self, name: &str, number: Number, shape: Shape) -> Result<(), ArrayFileError>;

    /// The next block of the array begun last, row by row.
    ///
    /// # Errors
    /// A block of another kind or size, and those of the file.
    fn block(&mut self, values: &Values) -> Result<(), ArrayFileError>;

    /// A list of texts.
    fn texts(&mut self, name: &str, texts: &[String]) -> Result<(), ArrayFileError>;

    /// An array of a single block.
    ///
    /// # Errors
    /// As [`begin`](Self::begin) and [`block`](Self::block).
    fn table(&mut self, name: &str, components: usize, values: &Values) -> Result<(), ArrayFileError> {
        self.begin(name, values.number(), Shape::table(values.len() / components.max(1), components))?;
        self.block(values)
    }
}

/// The array that is being written, to hold its blocks to what was announced.
#[derive(Debug)]
pub(super) struct Open {
    name: String,
    number: Number,
    pub shape: Shape,
    left: u128,
}

impl Open {
    pub fn new(name: &str, number: Number, shape: Shape) -> Self {
        Self { name: name.to_owned(), number, shape, left: shape.n_values() }
    }

    /// Takes a block.
    pub fn take(&mut self, values: &Values) -> Result<(), ArrayFileError> {
        let found = values.len() as u128;
        if values.number() != self.number || values.len() != self.shape.block() || found > self.left {
            return Err(ArrayFileError::WrongBlock { name: self.name.clone(), wanted: self.left, found });
        }
        self.left -= found;
        Ok(())
    }

    /// Nothing may be missing.
    pub fn close(&self) -> Result<(), ArrayFileError> {
        match self.left {
            0 => Ok(()),
            wanted => Err(ArrayFileError::WrongBlock { name: self.name.clone(), wanted, found: 0 }),
        }
    }
}
