//! Names that users give, as parts of file names.

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
