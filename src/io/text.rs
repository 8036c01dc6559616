//! Names that users give, as cells of tables and as parts of file names.

use std::borrow::Cow;

/// `text` as one cell of a CSV table (RFC 4180): in quotes where it holds a comma, a quote or a line break.
///
/// ```
/// use quadrille::io::text::cell;
/// assert_eq!(cell("upper"), "upper");
/// assert_eq!(cell("upper, left"), "\"upper, left\"");
/// ```
pub fn cell(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) {
        Cow::Owned(format!("\"{}\"", text.replace('"', "\"\"")))
    } else {
        Cow::Borrowed(text)
    }
}

/// `name` as a part of a file name on every system: what is no letter, digit, `-`, `_` or `.` becomes `_`.
///
/// ```
/// use quadrille::io::text::file_name;
/// assert_eq!(file_name("ux_upper"), "ux_upper");
/// assert_eq!(file_name("../upper/left: a"), ".._upper_left__a");
/// ```
pub fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '_' }).collect()
}
