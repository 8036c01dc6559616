//! Numbers and sentences as the page shows them.

/// A number with `digits` significant digits.
pub(in crate::report) fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value.is_finite() { "0".to_owned() } else { "-".to_owned() };
    }
    let before = value.abs().log10().floor() as i32;
    if (-4..6).contains(&before) {
        format!("{value:.*}", (digits as i32 - 1 - before).max(0) as usize)
    } else {
        format!("{value:.*e}", digits.saturating_sub(1))
    }
}

/// A number for a table: whole ones as such, others with five digits, very large and very small ones as powers of ten.
pub(in crate::report) fn plain(value: f64) -> String {
    if value == value.round() && value.abs() < 1e6 {
        format!("{value:.0}")
    } else if (1e-5..1e6).contains(&value.abs()) {
        format!("{}", significant(value, 5).parse().unwrap_or(value))
    } else if value.is_finite() {
        significant(value, 3)
    } else {
        "-".to_owned()
    }
}

/// The same of a number that may be missing.
pub(in crate::report) fn plain_or_dash(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), plain)
}

/// A sentence that begins a paragraph; one that begins with a symbol stays.
pub(in crate::report) fn capital(sentence: &str) -> String {
    let word = sentence.split([' ', ',']).next().unwrap_or("");
    match sentence.chars().next() {
        Some(first) if !word.contains('_') && word.len() > 1 => {
            first.to_uppercase().chain(sentence.chars().skip(1)).collect()
        }
        _ => sentence.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_significant_digits() {
        assert_eq!(significant(0.0050123, 3), "0.00501");
        assert_eq!(significant(73.576, 4), "73.58");
        assert_eq!(significant(1.0e-9, 2), "1.0e-9");
        assert_eq!(significant(-123456.0, 3), "-123456");
        assert_eq!(significant(f64::NAN, 3), "-");
    }
}
