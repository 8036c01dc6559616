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

/// A word of a command line, in quotes where a shell would take it apart.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::text::shell_word;
/// assert_eq!((shell_word("a/b_1.tif"), shell_word("F *.tif")), ("a/b_1.tif".to_owned(), "'F *.tif'".to_owned()));
/// ```
pub fn shell_word(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:=,@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// The content of the file `path`; the errors are those of a file that is not there, and of one that cannot be read.
pub(crate) fn read_file<E>(
    path: &Path,
    not_found: impl FnOnce(PathBuf) -> E,
    unreadable: impl FnOnce(PathBuf, io::Error) -> E,
) -> Result<Vec<u8>, E> {
    read_regular(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => not_found(path.to_owned()),
        _ => unreadable(path.to_owned(), reason),
    })
}

/// The content of a file; see [`check_regular`].
pub(crate) fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    check_regular(path)?;
    std::fs::read(path)
}

/// Refuses a pipe or a device: it may have no end, or nothing for ever.
pub(crate) fn check_regular(path: &Path) -> io::Result<()> {
    let about = std::fs::metadata(path)?;
    if about.is_file() || about.is_dir() {
        return Ok(());
    }
    Err(io::Error::other("it is a pipe or a device; copy what comes from it into a file"))
}

/// Text of any of the usual encodings, and which it is where that is not UTF-8; the line of a byte that is no text as
/// the error.
pub(crate) fn decoded(bytes: &[u8]) -> Result<(String, Option<&'static str>), usize> {
    // What Windows-1252 has from 0x80 on, where Latin-1 has nothing to be seen.
    const WINDOWS: &str = "\u{20ac}\u{81}\u{201a}\u{192}\u{201e}\u{2026}\u{2020}\u{2021}\u{2c6}\u{2030}\u{160}\u{2039}\u{152}\u{8d}\u{17d}\u{8f}\
        \u{90}\u{2018}\u{2019}\u{201c}\u{201d}\u{2022}\u{2013}\u{2014}\u{2dc}\u{2122}\u{161}\u{203a}\u{153}\u{9d}\u{17e}\u{178}";
    let wide = |from: fn([u8; 2]) -> u16, bytes: &[u8]| {
        let (pairs, rest) = bytes.as_chunks::<2>();
        let text = String::from_utf16(&pairs.iter().map(|&pair| from(pair)).collect::<Vec<_>>());
        text.ok().filter(|_| rest.is_empty()).map(|text| (text, Some("UTF-16"))).ok_or(1)
    };
    match bytes {
        [0xff, 0xfe, rest @ ..] => return wide(u16::from_le_bytes, rest),
        [0xfe, 0xff, rest @ ..] => return wide(u16::from_be_bytes, rest),
        // Letters of a header without the mark that says so.
        [1..=255, 0, 1..=255, 0, ..] => return wide(u16::from_le_bytes, bytes),
        [0, 1..=255, 0, 1..=255, ..] => return wide(u16::from_be_bytes, bytes),
        _ => {}
    }
    if let Some(at) = bytes.iter().position(|&byte| byte == 0) {
        return Err(line_at(bytes, at));
    }
    if let Ok(text) = std::str::from_utf8(bytes) {
        return Ok((text.to_owned(), None));
    }
    let letter = |&byte: &u8| match byte {
        0x80..=0x9f => WINDOWS.chars().nth(usize::from(byte) - 0x80).unwrap_or(char::REPLACEMENT_CHARACTER),
        byte => char::from(byte),
    };
    Ok((bytes.iter().map(letter).collect(), Some("Windows-1252 (Latin-1)")))
}

/// The line, from 1, of the byte `at`.
pub(crate) fn line_at(bytes: &[u8], at: usize) -> usize {
    1 + bytes.iter().take(at).filter(|&&byte| byte == b'\n').count()
}

/// `bytes` as text; the line of the first byte that is none as the error.
pub(crate) fn text_of(bytes: &[u8]) -> Result<&str, usize> {
    std::str::from_utf8(bytes).map_err(|error| line_at(bytes, error.valid_up_to()))
}
