//! Which frames of a series a command is for.

use crate::cli::{Outcome, Result};
use crate::io::store::Store;
use std::str::FromStr;

/// Frames as the user names them: `all`, `last`, or numbers and ranges such as `1,5-20`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Frames {
    /// Every frame that has a field.
    All,
    /// The last frame that has a field.
    Last,
    /// These ranges, both ends included, in the order given.
    Ranges(Vec<[usize; 2]>),
}

impl FromStr for Frames {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text.trim() {
            "all" => return Ok(Self::All),
            "last" => return Ok(Self::Last),
            _ => {}
        }
        let wrong = |part: &str| {
            format!("'{part}' is not a frame; give numbers from 1 and ranges such as 1,5-20, last, or all")
        };
        let number = |part: &str| part.trim().parse::<usize>().ok().filter(|&number| number > 0);
        let range = |part: &str| match part.split_once('-') {
            Some((first, last)) => number(first).zip(number(last)).ok_or_else(|| wrong(part)),
            None => number(part).map(|number| (number, number)).ok_or_else(|| wrong(part)),
        };
        let mut ranges = Vec::new();
        for part in text.split(',') {
            let (first, last) = range(part)?;
            if first > last {
                return Err(format!("the range {part} ends before it begins; give {last}-{first}"));
            }
            ranges.push([first, last]);
        }
        Ok(Self::Ranges(ranges))
    }
}

impl Frames {
    /// Whether each of them was named, so that one without a field is worth a word.
    pub fn are_named(&self) -> bool {
        matches!(self, Self::Ranges(_))
    }

    /// What a command came to that had `n_without` of them without a field.
    pub fn outcome(&self, n_without: usize) -> Outcome {
        if n_without > 0 && self.are_named() { Outcome::Incomplete } else { Outcome::Fine }
    }

    /// Those of a series that have a field, and how many have none. Of each without that was named a line is said,
    /// unless `quiet`.
    /// Errors: a number beyond the series, and what cannot be read of the store.
    pub fn with_field(&self, store: &Store, quiet: bool) -> Result<(Vec<usize>, usize)> {
        let (mut numbers, mut n_without) = (Vec::new(), 0);
        for number in self.numbers(store.n_frames())? {
            match store.status(number)? {
                Some(status) if status.has_field() => numbers.push(number),
                status => {
                    n_without += 1;
                    if self.are_named() && !quiet {
                        let status = status.map_or("not done".to_owned(), |status| status.name().replace('_', " "));
                        eprintln!("frame {number} has no field: {status}");
                    }
                }
            }
            if self.is_last() && !numbers.is_empty() {
                break;
            }
        }
        Ok((numbers, n_without))
    }

    /// Whether one frame is enough: the first of [`numbers`](Self::numbers) that has a field.
    pub fn is_last(&self) -> bool {
        *self == Self::Last
    }

    /// The numbers in a series of `n_frames`, each once, in the order given; of `last` all, from the end.
    /// Errors: a number beyond the series.
    pub fn numbers(&self, n_frames: usize) -> Result<Vec<usize>> {
        match self {
            Self::All => Ok((1..=n_frames).collect()),
            Self::Last => Ok((1..=n_frames).rev().collect()),
            Self::Ranges(ranges) => {
                if let Some([_, last]) = ranges.iter().find(|[_, last]| *last > n_frames) {
                    return Err(format!("--frames names frame {last}; the series has {n_frames}").into());
                }
                let mut taken = vec![false; n_frames];
                let named = ranges.iter().flat_map(|&[first, last]| first..=last);
                Ok(named.filter(|&number| !std::mem::replace(&mut taken[number - 1], true)).collect())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_ranges_name_each_frame_once_in_the_order_given() {
        let numbers = |text: &str| text.parse::<Frames>().unwrap().numbers(9).unwrap();
        assert_eq!(numbers("5-7, 1,6"), [5, 6, 7, 1]);
        assert_eq!(numbers("all"), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(numbers("last")[0], 9);
    }

    #[test]
    fn what_names_no_frame_is_refused_in_words() {
        for text in ["", "0", "1,,2", "-3", "2-", "x", "1.5", "3-0", "99999999999999999999999"] {
            assert!(text.parse::<Frames>().unwrap_err().contains("is not a frame"), "{text}");
        }
        assert!("7-3".parse::<Frames>().unwrap_err().contains("3-7"));
        let error = "1,4-10".parse::<Frames>().unwrap().numbers(9).unwrap_err();
        assert!(error.to_string().contains("frame 10; the series has 9"), "{error}");
        // A range far beyond the series is refused before it is written out.
        assert!("1-99999999999999".parse::<Frames>().unwrap().numbers(9).is_err());
    }
}
