//! A folder as the storage of a Zarr hierarchy.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zarrs::storage::byte_range::{ByteRangeIterator, InvalidByteRangeError};
use zarrs::storage::{
    Bytes, MaybeBytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits, StorageError, StoreKey,
    StorePrefix, WritableStorageTraits,
};

/// Ending of a file that is not complete yet.
pub(super) const PART: &str = ".part";

/// A folder whose files are there whole or not at all.
///
/// The crate's own file store writes in place, waits for the disk after every file (seven times a frame),
/// and keeps a lock for every file it has ever seen: too slow and too large for a long series. Here the disk is waited
/// for where a loss would cost the whole run ([`Folder::durable`]): a frame that is lost is done again, and waiting for
/// its files (4 to 13 ms on a local disk where writing them took 1 to 5 ms) would halve the speed of a fast series.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    waits: bool,
}

impl Folder {
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), waits: false }
    }

    /// A folder of which every file has reached the disk before it has its name.
    pub fn durable(path: &Path) -> Self {
        Self { path: path.to_owned(), waits: true }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the array `name` stands in it.
    pub fn has(&self, name: &str) -> bool {
        has_array(&self.path, name)
    }

    /// The file of `key`.
    pub fn file(&self, key: &StoreKey) -> PathBuf {
        self.path.join(key.as_str())
    }

    /// Writes under another name and renames.
    pub fn replace(&self, file: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut part = file.as_os_str().to_owned();
        part.push(PART);
        let part = PathBuf::from(part);
        let write = || -> io::Result<()> {
            let mut out = File::create(&part)?;
            out.write_all(bytes)?;
            if self.waits { out.sync_all() } else { Ok(()) }
        };
        let written = match write() {
            // The first file of its folder.
            Err(error) if error.kind() == ErrorKind::NotFound => {
                fs::create_dir_all(file.parent().unwrap_or(&self.path)).and_then(|()| write())
            }
            written => written,
        };
        written.and_then(|()| fs::rename(&part, file)).inspect_err(|_| {
            let _ = fs::remove_file(&part); // what is left of it helps nobody, and on a full disk takes room
        })
    }
}

/// Whether the array `name` stands in the store `path`.
pub(super) fn has_array(path: &Path, name: &str) -> bool {
    path.join(name).join("zarr.json").is_file()
}

fn storage_error(error: io::Error) -> StorageError {
    StorageError::IOError(Arc::new(error))
}

/// What the file system gives, or nothing where there is no such file.
fn if_there<T>(found: io::Result<T>) -> Result<Option<T>, StorageError> {
    match found {
        Ok(found) => Ok(Some(found)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(storage_error(error)),
    }
}

impl ReadableStorageTraits for Folder {
    fn get(&self, key: &StoreKey) -> Result<MaybeBytes, StorageError> {
        Ok(if_there(fs::read(self.file(key)))?.map(Bytes::from))
    }

    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        let Some(bytes) = self.get(key)? else { return Ok(None) };
        let size = bytes.len() as u64;
        Ok(Some(Box::new(byte_ranges.map(move |range| {
            if range.start(size) > range.end(size) || range.end(size) > size {
                return Err(InvalidByteRangeError::new(range, size).into());
            }
            Ok(bytes.slice(range.to_range_usize(size)))
        }))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        Ok(if_there(fs::metadata(self.file(key)))?.map(|about| about.len()))
    }

    fn supports_get_partial(&self) -> bool {
        false
    }
}

impl WritableStorageTraits for Folder {
    fn set(&self, key: &StoreKey, value: Bytes) -> Result<(), StorageError> {
        self.replace(&self.file(key), &value).map_err(storage_error)
    }

    fn set_partial_many(&self, key: &StoreKey, values: OffsetBytesIterator) -> Result<(), StorageError> {
        let mut bytes = self.get(key)?.map(|bytes| bytes.to_vec()).unwrap_or_default();
        for (offset, value) in values {
            let at = usize::try_from(offset).map_err(|_| StorageError::Other("a file too large for memory".into()))?;
            bytes.resize(bytes.len().max(at + value.len()), 0);
            bytes.iter_mut().skip(at).zip(value.iter()).for_each(|(byte, value)| *byte = *value);
        }
        self.set(key, bytes.into())
    }

    fn erase(&self, key: &StoreKey) -> Result<(), StorageError> {
        if_there(fs::remove_file(self.file(key))).map(drop)
    }

    fn erase_prefix(&self, prefix: &StorePrefix) -> Result<(), StorageError> {
        if_there(fs::remove_dir_all(self.path.join(prefix.as_str()))).map(drop)
    }

    fn supports_set_partial(&self) -> bool {
        false
    }
}
