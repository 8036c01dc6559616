//! File names, globs and pages, expanded to a series of images.

mod cameras;
mod names;

pub use cameras::{TwoCameras, two_cameras};
pub use names::NameOrder;

use super::images::{Accepted, Loaded, PagedFile, ReadError, read_accepted};
use std::cmp::Ordering;
use std::collections::HashSet;
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Why a list of names and globs gives no series.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SeriesError {
    /// A glob matches no file in the folder that it is relative to.
    #[error("`{}` matches no file{}; check the pattern and the folder", .0, place(.0, .1))]
    NoMatch(String, PathBuf),
    /// An entry is a folder without images; it has no slash at its end here.
    #[error("`{0}` is a folder without images in it; name the files, for example `{0}/*.tif`")]
    Directory(String),
    /// A glob that cannot be understood.
    #[error("`{0}` is not a valid pattern: {1}")]
    Pattern(String, glob::PatternError),
    /// A name that records in text could not hold.
    #[error("{0:?}: the name is not UTF-8 text, which tables and records need; rename the file or folder")]
    Name(PathBuf),
    /// A folder that a glob leads through cannot be listed.
    #[error("`{0}` cannot be expanded: {1}")]
    Unreadable(String, glob::GlobError),
}

fn place(pattern: &str, folder: &Path) -> String {
    if Path::new(pattern).is_absolute() {
        String::new()
    } else if folder.as_os_str().is_empty() {
        " in the current folder".to_owned()
    } else {
        format!(" in {}", folder.display())
    }
}

/// The files that `patterns` name, in order.
///
/// An entry is a file name or a glob (`*`, `?`, `[..]`, `**`), relative to `base` unless absolute. A name that exists
/// is taken literally, also with spaces or brackets in it. The files of one glob are in the order of the numbers in their
/// names ([`NameOrder`]: `img_2` before `img_10`), the entries in the order given; a file named twice is kept once, at
/// its first place. A plain name that does not exist is kept: what it means is for the reader of the series to say. A
/// folder stands for the images in it, by the endings of their names. Globs do not match hidden files.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::series::expand_series;
/// let files = expand_series(&["b 1.tif".into(), "a.tif".into(), "b 1.tif".into()], "shots".as_ref()).unwrap();
/// assert_eq!(files, [std::path::Path::new("shots/b 1.tif"), "shots/a.tif".as_ref()]);
/// ```
///
/// # Errors
/// A glob without a match or not valid, a folder that cannot be listed or holds no image.
pub fn expand_series(patterns: &[String], base: &Path) -> Result<Vec<PathBuf>, SeriesError> {
    // In order with the globs before and behind: the first fault is the one that is told.
    expand(patterns, base, |entry, literal| {
        if !literal.is_dir() {
            return Ok(vec![literal]);
        }
        let entry = if entry.is_empty() { "." } else { entry.trim_end_matches(std::path::is_separator) }.to_owned();
        let found = images_in(&literal);
        if found.is_empty() { Err(SeriesError::Directory(entry)) } else { Ok(found) }
    })
}

/// The files in `folder` whose names end as those of images, in the order of a series; hidden ones are not meant.
fn images_in(folder: &Path) -> Vec<PathBuf> {
    let is_meant = |path: &PathBuf| {
        let is_hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
        !is_hidden && path.is_file() && has_image_ending(path)
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = entries.filter(is_meant).collect();
    names::sort(&mut files);
    files
}

/// Endings of the names of images.
const ENDINGS: [&str; 11] = ["tif", "tiff", "btf", "png", "bmp", "jpg", "jpeg", "pgm", "ppm", "pnm", "pfm"];

/// Whether the name ends as that of an image.
pub fn has_image_ending(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str());
    ending.is_some_and(|ending| ENDINGS.iter().any(|known| known.eq_ignore_ascii_case(ending)))
}

/// The files that globs would take if capital letters were small ones, such as `b.PNG` beside `*.png`.
pub fn but_for_capitals(patterns: &[String], base: &Path) -> Vec<PathBuf> {
    let globs = patterns.iter().filter(|entry| entry.contains(['*', '?', '[']) && !base.join(entry).exists());
    let both = globs.map(|entry| [false, true].map(|sensitive| matches(entry, base, sensitive).unwrap_or_default()));
    both.flat_map(|[any, exact]| any.into_iter().filter(move |file| !exact.contains(file))).collect()
}

/// The files that `patterns` name as reference images, in order: as [`expand_series`], but a folder is kept, so
/// that reading it says what is wrong.
///
/// # Errors
/// A glob without a match or not valid, a folder on its way that cannot be listed.
pub fn expand_references(patterns: &[String], base: &Path) -> Result<Vec<PathBuf>, SeriesError> {
    expand(patterns, base, |_, literal| Ok(vec![literal]))
}

/// The files that `patterns` name, in order, each once; `named` gives those of an entry that is no glob, by its path.
fn expand(
    patterns: &[String],
    base: &Path,
    named: impl Fn(&str, PathBuf) -> Result<Vec<PathBuf>, SeriesError>,
) -> Result<Vec<PathBuf>, SeriesError> {
    let mut files = Vec::new();
    for entry in patterns {
        let literal = base.join(entry);
        let is_name = literal.exists() || !entry.contains(['*', '?', '[']);
        files.extend(if is_name { named(entry, literal)? } else { matches(entry, base, true)? });
    }
    if let Some(path) = files.iter().find(|path| path.to_str().is_none()) {
        return Err(SeriesError::Name(path.clone()));
    }
    let mut seen = HashSet::new();
    files.retain(|file| seen.insert(file.clone()));
    // A film and its description are one.
    files.retain(|file| {
        let is_description = file.extension().is_some_and(|ending| ending == "cih" || ending == "cihx");
        !(is_description && seen.contains(&file.with_extension("mraw")))
    });
    Ok(files)
}

/// One image of a series: a file, or a page of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// The file.
    pub path: PathBuf,
    /// Its page; the first is 0.
    pub page: usize,
    /// Whether the other pages of the file are frames as well, so that the page belongs to the name.
    pub is_page: bool,
}

impl Frame {
    /// The page `page` of a file that stands for one frame.
    pub fn file(path: PathBuf, page: usize) -> Self {
        Self { path, page, is_page: false }
    }

    /// The frame that is displayed as `name`: `stack.tif[3]` is the page 3 of a stack (unless a file has that very
    /// name), all else the page `page` of a file.
    ///
    /// ```
    /// # use quadrille_io as quadrille;
    /// use quadrille::io::series::Frame;
    /// let frame = Frame::named("shots/stack.tif[3]", 0);
    /// assert_eq!((frame.path.to_str(), frame.page, frame.is_page), (Some("shots/stack.tif"), 3, true));
    /// assert_eq!(Frame::named("a.tif", 1), Frame::file("a.tif".into(), 1));
    /// ```
    pub fn named(name: &str, page: usize) -> Self {
        let of_stack = || {
            let (path, page) = name.strip_suffix(']')?.rsplit_once('[')?;
            Some(Self { path: path.into(), page: page.parse().ok()?, is_page: true })
        };
        let frame = of_stack().filter(|_| !Path::new(name).exists());
        frame.unwrap_or_else(|| Self::file(name.into(), page))
    }

    /// Reads the image where it is `accepted`.
    pub fn read(&self, accepted: Accepted) -> Result<Loaded, ReadError> {
        if self.is_page {
            PagedFile::open(&self.path)?.read(self.page, accepted)
        } else {
            read_accepted(&self.path, self.page, accepted)
        }
    }

    /// [`Loaded::sha256`] of the image, which is decoded only where its file is not hashed as a whole.
    pub fn sha256(&self) -> Result<String, ReadError> {
        PagedFile::open(&self.path)?.sha256(self.page)
    }

    /// Every page of the files, in order; `pages` gives those of a file, or why they are not known.
    ///
    /// ```
    /// # use quadrille_io as quadrille;
    /// use quadrille::io::series::Frame;
    /// let pages = |file: &std::path::Path| Ok::<_, ()>(if file.ends_with("a.tif") { vec![0, 2] } else { vec![0] });
    /// let frames = Frame::pages(&["a.tif".into(), "b.tif".into()], pages).unwrap();
    /// let names: Vec<_> = frames.iter().map(ToString::to_string).collect();
    /// assert_eq!(names, ["a.tif[0]", "a.tif[2]", "b.tif"]);
    /// ```
    ///
    /// # Errors
    /// That of `pages`.
    pub fn pages<E>(files: &[PathBuf], pages: impl Fn(&Path) -> Result<Vec<usize>, E>) -> Result<Vec<Self>, E> {
        let mut frames = Vec::new();
        for path in files {
            let pages = pages(path)?;
            let is_page = pages.len() > 1;
            frames.extend(pages.into_iter().map(|page| Self { path: path.clone(), page, is_page }));
        }
        Ok(frames)
    }
}

impl fmt::Display for Frame {
    /// The file, with the page in brackets when the other pages are frames too.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if self.is_page { write!(f, "[{}]", self.page) } else { Ok(()) }
    }
}

fn matches(entry: &str, base: &Path, case_sensitive: bool) -> Result<Vec<PathBuf>, SeriesError> {
    // The folder is not part of the pattern: brackets in its name are brackets.
    let pattern = if Path::new(entry).is_absolute() || base.as_os_str().is_empty() {
        entry.to_owned()
    } else {
        let folder = glob::Pattern::escape(&base.to_string_lossy());
        format!("{}{}{entry}", folder.trim_end_matches(std::path::is_separator), std::path::MAIN_SEPARATOR)
    };
    // That a leading dot is literal is seen to below: the crate's own way panics at a name that is no UTF-8.
    let options =
        glob::MatchOptions { case_sensitive, require_literal_separator: true, require_literal_leading_dot: false };
    let found = glob::glob_with(&pattern, options).map_err(|reason| SeriesError::Pattern(entry.to_owned(), reason))?;
    let mut files = Vec::new();
    for file in found {
        let file = file.map_err(|reason| SeriesError::Unreadable(entry.to_owned(), reason))?;
        if !is_hidden(&file, &pattern) && !file.is_dir() {
            files.push(file);
        }
    }
    if let Some(path) = not_text(&files, &pattern) {
        return Err(SeriesError::Name(path));
    }
    if files.is_empty() {
        return Err(SeriesError::NoMatch(entry.to_owned(), base.to_owned()));
    }
    names::sort(&mut files);
    Ok(files)
}

/// Whether a wildcard of `pattern` stands for a name with a dot at its beginning on the way to `file`. Such files are
/// not meant: some systems lay a `._img_001.tif` beside every image.
fn is_hidden(file: &Path, pattern: &str) -> bool {
    let dotted = |name: &str| name.starts_with('.') && name != "." && name != "..";
    let asked: Vec<&str> = pattern.split(std::path::is_separator).filter(|name| dotted(name)).collect();
    let name_of = |part: std::path::Component| part.as_os_str().to_string_lossy().into_owned();
    let matches = |name: &str| {
        let matches = |asked: &&str| *asked == name || glob::Pattern::new(asked).is_ok_and(|asked| asked.matches(name));
        asked.iter().any(matches)
    };
    file.components().map(name_of).any(|name| dotted(&name) && !matches(&name))
}

/// A file beside those found that `pattern` means too, but whose name is no UTF-8: it would be left out without a word.
fn not_text(found: &[PathBuf], pattern: &str) -> Option<PathBuf> {
    let last = pattern.rsplit(std::path::is_separator).next().and_then(|last| glob::Pattern::new(last).ok())?;
    let mut folders: Vec<&Path> = found.iter().filter_map(|file| file.parent()).collect();
    folders.dedup();
    let entries = folders.into_iter().flat_map(|folder| {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        std::fs::read_dir(folder).into_iter().flatten().flatten()
    });
    let lost = |name: &std::ffi::OsStr| name.to_str().is_none() && last.matches(&name.to_string_lossy());
    entries.map(|entry| entry.path()).find(|path| path.file_name().is_some_and(lost))
}

/// The plain order of two names: folder by folder, whole numbers by value with any leading zeros, ties by the letters.
pub fn natural_order(a: &Path, b: &Path) -> Ordering {
    let natural = |(a, b): (std::path::Component, std::path::Component)| {
        alphanumeric_sort::compare_str(a.as_os_str().to_string_lossy(), b.as_os_str().to_string_lossy())
    };
    a.components()
        .zip(b.components())
        .map(natural)
        .find(|order| order.is_ne())
        .unwrap_or_else(|| a.components().count().cmp(&b.components().count()))
        .then_with(|| a.cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_sort_by_value_whatever_their_leading_zeros() {
        let wanted = ["img_2.tif", "img_0003.tif", "img_04 b.tif", "img_010.tif", "img_00011.tif", "img_100.tif"];
        let mut names = wanted.map(PathBuf::from);
        names.reverse();
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, wanted.map(PathBuf::from));
    }
}
