//! Numbers, paths and errors in words.

use std::error::Error;
use std::path::Path;

/// A count with its noun.
pub fn plural(n: usize, noun: &str) -> String {
    format!("{n} {noun}{}", if n == 1 { "" } else { "s" })
}

/// A path that holds from any folder.
pub fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
}

/// The last part of a path; the whole of one that has none.
pub fn file_name(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// An error and its causes on one line.
pub fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        // Many errors already repeat their cause.
        if !text.contains(&more) {
            text.push_str(": ");
            text.push_str(&more);
        }
        cause = error.source();
    }
    text
}

/// Rising numbers as ranges with both ends.
pub fn runs(numbers: &[usize]) -> Vec<[usize; 2]> {
    let mut found: Vec<[usize; 2]> = Vec::new();
    for &number in numbers {
        match found.last_mut() {
            Some([_, last]) if *last + 1 == number => *last = number,
            _ => found.push([number, number]),
        }
    }
    found
}

/// Ranges in words, the first of them.
pub fn in_words(ranges: &[[usize; 2]]) -> String {
    const SHOWN: usize = 20;
    let words = |&[first, last]: &[usize; 2]| if first == last { first.to_string() } else { format!("{first}-{last}") };
    let mut text: Vec<String> = ranges.iter().take(SHOWN).map(words).collect();
    if ranges.len() > SHOWN {
        text.push(format!("and {} more ranges", ranges.len() - SHOWN));
    }
    text.join(", ")
}

/// Rising numbers in words: `1-3, 7`.
pub fn ranges(numbers: &[usize]) -> String {
    in_words(&runs(numbers))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_in_ranges() {
        assert_eq!(ranges(&[]), "");
        assert_eq!(ranges(&[1, 2, 3, 7, 9, 10]), "1-3, 7, 9-10");
        let many: Vec<usize> = (0..50).map(|k| 2 * k + 1).collect();
        assert!(ranges(&many).ends_with("39, and 30 more ranges"), "{}", ranges(&many));
    }
}
