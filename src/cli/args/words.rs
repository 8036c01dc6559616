//! Words of the command line, read.

use std::time::Duration;

/// `text` where it is `fine`, else what is `expected`.
fn accept(fine: bool, text: &str, expected: &str) -> Result<String, String> {
    if fine { Ok(text.to_owned()) } else { Err(expected.to_owned()) }
}

/// A time above zero.
pub(super) fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| format!("'{text}' is not a number of seconds"))?;
    // Below a millisecond nothing settles, above a year nothing ends.
    let fine = (1e-3..=3.2e7).contains(&seconds);
    if fine { Ok(Duration::from_secs_f64(seconds)) } else { Err("give seconds from 0.001 to a year".into()) }
}

/// The same as a number.
pub(super) fn positive_seconds(text: &str) -> Result<f64, String> {
    seconds(text).map(|time| time.as_secs_f64())
}

/// A size of a file, MB.
pub(super) fn megabytes(text: &str) -> Result<f64, String> {
    let size: f64 = text.parse().map_err(|_| "give a number of MB".to_owned())?;
    if (0.1..=1e4).contains(&size) { Ok(size) } else { Err("give MB from 0.1 to 10000".into()) }
}

/// A count from 1.
pub(super) fn count(text: &str) -> Result<usize, std::num::ParseIntError> {
    text.parse::<std::num::NonZeroUsize>().map(std::num::NonZeroUsize::get)
}

/// A time as Slurm takes it: minutes, or with hours, days and seconds.
pub(super) fn slurm_time(text: &str) -> Result<String, String> {
    let (days, rest) = match text.split_once('-') {
        Some((days, rest)) => (Some(days), rest),
        None => (None, text),
    };
    let parts: Vec<&str> = rest.split(':').collect();
    let digits = |part: &&str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let fine =
        parts.len() <= 3 && days.iter().chain(&parts).all(digits) && parts[1..].iter().all(|part| part.len() <= 2);
    accept(fine, text, "Slurm takes HH:MM:SS (04:00:00), D-HH:MM:SS (1-12:00:00), or minutes (240)")
}

/// A value of an option of sbatch: one word, so that it ends where it seems to.
pub(super) fn slurm_word(text: &str) -> Result<String, String> {
    let fine = |c: char| c.is_ascii_alphanumeric() || "_-.,:+@%/=".contains(c);
    let fine = !text.is_empty() && text.chars().all(fine);
    accept(fine, text, "one word of letters, digits and _-.,:+@%/= is expected")
}

/// An option of sbatch as it stands in a script behind `#SBATCH`.
pub(super) fn sbatch_option(text: &str) -> Result<String, String> {
    let plain = |c: char| c.is_ascii_graphic() || c == ' ';
    let is_long = text.strip_prefix("--").is_some_and(|name| name.starts_with(|c: char| c.is_ascii_lowercase()));
    accept(is_long, text, "an option of sbatch begins with two hyphens, as in --sbatch=--qos=long")?;
    accept(text.chars().all(plain), text, "an option on one line, in ASCII, is expected")
}

/// A parameter that is prescribed, and its values.
#[derive(Debug, Clone)]
pub struct Prescribed {
    pub name: String,
    pub values: Vec<f64>,
}

/// `r=3,4,5,6`.
pub(super) fn sweep(text: &str) -> Result<Prescribed, String> {
    let (name, values) =
        text.split_once('=').ok_or("write NAME=X,X,..., such as r=3,4,5,6; the case file stands before --sweep")?;
    let number = |word: &str| word.trim().parse().map_err(|_| format!("'{word}' is not a number"));
    Ok(Prescribed { name: name.trim().to_owned(), values: values.split(',').map(number).collect::<Result<_, _>>()? })
}

/// The name of a law; whether there is one the case says.
pub(super) fn law(text: &str) -> Result<String, String> {
    let is_file = text.ends_with(".toml");
    accept(!is_file, text, "a law is expected; the case file stands before --tournament")
}

pub(super) fn two_zones(text: &str) -> Result<[String; 2], String> {
    let names: Vec<String> = text.split(',').map(|name| name.trim().to_owned()).collect();
    names
        .try_into()
        .map_err(|names: Vec<_>| format!("'{text}' names {} zones instead of two: upper,lower", names.len()))
}

pub(super) fn size(text: &str) -> Result<[usize; 2], String> {
    two_counts(text).ok_or_else(|| format!("'{text}' is not an image size such as 1024x768"))
}

/// Columns and rows of points.
pub(super) fn columns_by_rows(text: &str) -> Result<[usize; 2], String> {
    two_counts(text).ok_or_else(|| format!("'{text}' is not columns and rows such as 9x6"))
}

fn two_counts(text: &str) -> Option<[usize; 2]> {
    let parse = |v: &str| v.trim().parse::<usize>().ok().filter(|v| (1..=32_768).contains(v));
    let (a, b) = text.split_once(['x', 'X'])?;
    Some([parse(a)?, parse(b)?])
}
