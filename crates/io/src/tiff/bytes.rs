//! The content of a file: at hand, or too large for the memory and read piece by piece.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;

/// What is read from.
pub(crate) trait Bytes: std::fmt::Debug {
    /// How many there are.
    fn len(&self) -> usize;

    /// `len` of them from `at` on; `None` beyond the end.
    fn piece(&self, at: usize, len: usize) -> Option<Cow<'_, [u8]>>;

    /// All of them to be edited, where they are in memory.
    fn at_hand(&mut self) -> Option<&mut [u8]>;

    /// What the disk has refused.
    fn take_error(&mut self) -> Option<io::Error> {
        None
    }
}

impl Bytes for [u8] {
    fn len(&self) -> usize {
        <[u8]>::len(self)
    }

    fn piece(&self, at: usize, len: usize) -> Option<Cow<'_, [u8]>> {
        self.get(at..at.checked_add(len)?).map(Cow::Borrowed)
    }

    fn at_hand(&mut self) -> Option<&mut [u8]> {
        Some(self)
    }
}

impl Bytes for Vec<u8> {
    fn len(&self) -> usize {
        Vec::len(self)
    }

    fn piece(&self, at: usize, len: usize) -> Option<Cow<'_, [u8]>> {
        self.as_slice().piece(at, len)
    }

    fn at_hand(&mut self) -> Option<&mut [u8]> {
        Some(self)
    }
}

/// A file that is read by seeking.
#[derive(Debug)]
pub(crate) struct LargeFile {
    file: File,
    len: usize,
    /// The first error of the disk: what follows from it is no fault of the content.
    error: OnceCell<io::Error>,
}

impl LargeFile {
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let len = usize::try_from(file.metadata()?.len()).map_err(|_| ErrorKind::FileTooLarge)?;
        Ok(Self { file, len, error: OnceCell::new() })
    }
}

impl Bytes for LargeFile {
    fn len(&self) -> usize {
        self.len
    }

    fn piece(&self, at: usize, len: usize) -> Option<Cow<'_, [u8]>> {
        if at.checked_add(len)? > self.len {
            return None;
        }
        let mut piece = Vec::new();
        let read = || {
            piece.try_reserve_exact(len)?;
            piece.resize(len, 0);
            let mut file = &self.file;
            file.seek(SeekFrom::Start(at as u64))?;
            file.read_exact(&mut piece)
        };
        match { read }() {
            Ok(()) => Some(Cow::Owned(piece)),
            Err(error) => {
                let _ = self.error.set(error);
                None
            }
        }
    }

    fn at_hand(&mut self) -> Option<&mut [u8]> {
        None
    }

    fn take_error(&mut self) -> Option<io::Error> {
        self.error.take()
    }
}
