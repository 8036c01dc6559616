//! Names that users give, as parts of file names; files that hold text.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// `name` as a part of a file name on every system: what is no letter, digit, `-`, `_` or `.` becomes `_`.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::text::file_name;
/// assert_eq!(file_name("ux_upper"), "ux_upper");
/// assert_eq!(file_name("../upper/left: a"), ".._upper_left__a");
/// ```
pub fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}

/// The content of the file `path`; the errors are those of a file that is not there, and of one that cannot be read.
pub(crate) fn read_file<E>(
    path: &Path,
    not_found: impl FnOnce(PathBuf) -> E,
    unreadable: impl FnOnce(PathBuf, io::Error) -> E,
) -> Result<Vec<u8>, E> {
    std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => not_found(path.to_owned()),
        _ => unreadable(path.to_owned(), reason),
    })
}

/// The line, from 1, of the byte `at`.
pub(crate) fn line_at(bytes: &[u8], at: usize) -> usize {
    1 + bytes.iter().take(at).filter(|&&byte| byte == b'\n').count()
}

/// `bytes` as text; the line of the first byte that is none as the error.
pub(crate) fn text_of(bytes: &[u8]) -> Result<&str, usize> {
    std::str::from_utf8(bytes).map_err(|error| line_at(bytes, error.valid_up_to()))
}
