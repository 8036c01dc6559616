//! A folder that a camera writes into: which of its files are whole, and in what order they come.

use super::images::{Accepted, Loaded, ReadError};
use super::series::{Frame, NameOrder, has_image_ending};
use glob::{MatchOptions, Pattern, PatternError};
use std::collections::{BTreeMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};
use std::{fs, io};
use thiserror::Error;

/// A file that has not changed for so many settling times and is no image is given up; later ones wait as long.
const PATIENCE: u32 = 10;
/// A file that has not been the same for once after so many times the settling time is given up as well.
const LONGEST: u32 = 100;
/// Looks per settling time.
const LOOKS: u32 = 5;

/// Why a folder cannot be watched.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WatchError {
    /// There is no such folder.
    #[error("{}: there is no such folder; name the one that the camera writes into", .0.display())]
    NoFolder(PathBuf),
    /// A pattern that cannot be understood.
    #[error("`{0}` is not a valid pattern: {1}")]
    Pattern(String, PatternError),
    /// A pattern that leads through folders.
    #[error("`{0}` names files of other folders; give a pattern of names in the one that is watched, such as '*.tif'")]
    Folders(String),
}

/// What tells that a file has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    fn of(about: &fs::Metadata) -> Self {
        Self { bytes: about.len(), modified: about.modified().ok() }
    }

    /// None of a file that is not there.
    fn at(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|about| Self::of(&about))
    }
}

/// A file as it was seen last.
#[derive(Debug, Clone, Copy)]
struct Seen {
    stamp: Stamp,
    /// When it was seen like this first.
    since: Instant,
}

/// A folder that a camera writes into.
///
/// It is looked at again and again: systems tell of changes on their own disks only. A file has settled when size and
/// time of change were the same for a while, as seen from here: clocks of other machines do not matter.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::watch::WatchedFolder;
/// use std::time::{Duration, Instant};
/// let shots = tempfile::tempdir()?;
/// let (second, begin) = (Duration::from_secs(1), Instant::now());
/// let mut folder = WatchedFolder::new(shots.path(), Some("*.tif"), second)?;
/// std::fs::write(shots.path().join("1.tif"), "half of the")?;
/// assert!(folder.look(begin)?.is_empty());
/// assert_eq!(folder.look(begin + second)?, [shots.path().join("1.tif")]);
/// assert!(folder.look(begin + 2 * second)?.is_empty()); // each once
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct WatchedFolder {
    path: PathBuf,
    pattern: Option<Pattern>,
    settle: Duration,
    /// Names that have been handed over, or are not wanted.
    taken: HashSet<OsString>,
    waiting: BTreeMap<OsString, Seen>,
    last_change: Instant,
}

impl WatchedFolder {
    /// The folder `path`, of which the files whose names fit `pattern` are taken (without one, those that end like an
    /// image) once they have been the same for `settle`. Hidden files are never meant.
    ///
    /// # Errors
    /// No such folder, a pattern that is not one of names.
    pub fn new(path: &Path, pattern: Option<&str>, settle: Duration) -> Result<Self, WatchError> {
        if !path.is_dir() {
            return Err(WatchError::NoFolder(path.to_owned()));
        }
        let compiled = |text: &str| {
            if text.contains(std::path::is_separator) {
                return Err(WatchError::Folders(text.to_owned()));
            }
            Pattern::new(text).map_err(|reason| WatchError::Pattern(text.to_owned(), reason))
        };
        Ok(Self {
            path: path.to_owned(),
            pattern: pattern.map(compiled).transpose()?,
            settle,
            taken: HashSet::new(),
            waiting: BTreeMap::new(),
            last_change: Instant::now(),
        })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// How long a file must have been the same.
    pub fn settle(&self) -> Duration {
        self.settle
    }

    /// Time between two looks.
    pub fn interval(&self) -> Duration {
        self.settle / LOOKS
    }

    /// When a file was seen to come or to change last.
    pub fn last_change(&self) -> Instant {
        self.last_change
    }

    /// The file `path` as one of this folder; none when it lies elsewhere.
    pub fn own(&self, path: &Path) -> Option<PathBuf> {
        let folder = path.parent()?;
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let same = |form: fn(&Path) -> io::Result<PathBuf>| Some(form(folder).ok()? == form(&self.path).ok()?);
        let is_own =
            same(|path| std::path::absolute(path)) == Some(true) || same(|path| fs::canonicalize(path)) == Some(true);
        is_own.then(|| path.file_name().map(|name| self.path.join(name))).flatten()
    }

    /// Never hands over `path`: it is known already.
    pub fn leave_out(&mut self, path: &Path) {
        self.taken.extend(self.own(path).as_deref().and_then(Path::file_name).map(OsStr::to_owned));
    }

    /// Looks at the folder and gives the files that have settled at the time `now`, in natural order, each once. A file
    /// waits for those before it, but not for ever.
    ///
    /// # Errors
    /// What the file system says when the folder cannot be listed; the next look may find it again.
    pub fn look(&mut self, now: Instant) -> io::Result<Vec<PathBuf>> {
        let mut there = BTreeMap::new();
        for entry in fs::read_dir(&self.path)? {
            let name = entry?.file_name();
            if self.taken.contains(&name) || !self.is_meant(&name) {
                continue;
            }
            // What is gone again was renamed.
            let Some(about) = fs::metadata(self.path.join(&name)).ok().filter(fs::Metadata::is_file) else { continue };
            let stamp = Stamp::of(&about);
            let seen = self.waiting.get(&name).copied().filter(|seen| seen.stamp == stamp).unwrap_or_else(|| {
                self.last_change = now;
                Seen { stamp, since: now }
            });
            there.insert(name, seen);
        }
        self.waiting = there;
        let mut names: Vec<_> = self.waiting.iter().map(|(name, seen)| (name.clone(), now - seen.since)).collect();
        let order = NameOrder::of(&names.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>());
        names.sort_by(|(a, _), (b, _)| order.compare(Path::new(a), Path::new(b)));
        let mut is_next = true;
        names.retain(|(_, same_for)| {
            is_next &= *same_for >= self.settle;
            is_next || *same_for >= PATIENCE * self.settle
        });
        let settled = names.iter().map(|(name, _)| self.path.join(name)).collect();
        for (name, _) in names {
            self.waiting.remove(&name);
            self.taken.insert(name);
        }
        Ok(settled)
    }

    /// The files that have not settled, in natural order.
    pub fn unsettled(&self) -> Vec<PathBuf> {
        let mut files: Vec<_> = self.waiting.keys().map(|name| self.path.join(name)).collect();
        let order = NameOrder::of(&files);
        files.sort_by(|a, b| order.compare(a, b));
        files
    }

    /// Whether a file of this name is an image of the series.
    fn is_meant(&self, name: &OsStr) -> bool {
        let text = name.to_string_lossy();
        let options = MatchOptions { require_literal_leading_dot: true, ..MatchOptions::new() };
        match &self.pattern {
            Some(pattern) => pattern.matches_with(&text, options),
            None => !text.starts_with('.') && has_image_ending(Path::new(name)),
        }
    }
}

/// Reads a frame whose file has settled, and makes sure that it was whole: an image that cannot be decoded, or changes
/// meanwhile, is read again when it has been the same for `settle` anew. None when no longer `wanted`.
///
/// What has not become an image in ten times that since its last change has the error of the last attempt.
pub fn read_whole(
    frame: &Frame,
    accepted: Accepted,
    settle: Duration,
    wanted: impl Fn() -> bool,
) -> Option<Result<Loaded, ReadError>> {
    let begin = Instant::now();
    let (mut stamp, mut since, mut changed) = (Stamp::at(&frame.path), begin, false);
    let mut read = frame.read(accepted);
    loop {
        let now = Stamp::at(&frame.path);
        if now != stamp {
            (stamp, since, changed) = (now, Instant::now(), true);
        }
        if !changed && (read.is_ok() || since.elapsed() >= PATIENCE * settle) {
            return Some(read);
        }
        if changed && since.elapsed() >= settle {
            (read, changed) = (frame.read(accepted), false);
            continue;
        }
        if begin.elapsed() >= LONGEST * settle {
            return Some(Err(ReadError::Changing(frame.path.clone())));
        }
        if !wanted() {
            return None;
        }
        std::thread::sleep(settle / LOOKS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    const SETTLE: Duration = Duration::from_secs(1);

    /// A folder with a look at it after so many tenths of a second.
    struct Shots {
        folder: TempDir,
        watched: WatchedFolder,
        begin: Instant,
    }

    impl Shots {
        fn new(pattern: Option<&str>) -> Self {
            let folder = TempDir::new().unwrap();
            let watched = WatchedFolder::new(folder.path(), pattern, SETTLE).unwrap();
            Self { folder, watched, begin: Instant::now() }
        }

        fn write(&self, name: &str, bytes: usize) {
            fs::write(self.folder.path().join(name), vec![0; bytes]).unwrap();
        }

        #[track_caller]
        fn assert_settled(&mut self, tenths: u32, wanted: &[&str]) {
            let found = self.watched.look(self.begin + tenths * Duration::from_millis(100)).unwrap();
            let wanted: Vec<_> = wanted.iter().map(|name| self.folder.path().join(name)).collect();
            assert_eq!(found, wanted, "after {tenths} tenths");
        }
    }

    #[test]
    fn a_file_has_settled_when_it_was_the_same_for_long_enough() {
        let mut shots = Shots::new(None);
        shots.write("a.png", 10);
        shots.assert_settled(0, &[]);
        shots.assert_settled(9, &[]);
        shots.write("a.png", 20);
        shots.assert_settled(10, &[]);
        assert_eq!(shots.watched.last_change(), shots.begin + SETTLE);
        shots.assert_settled(19, &[]);
        shots.assert_settled(20, &["a.png"]);
        shots.write("a.png", 30);
        shots.assert_settled(30, &[]);
        shots.assert_settled(50, &[]);
    }

    #[test]
    fn files_come_in_natural_order_and_wait_for_those_before_them_but_not_for_ever() {
        let mut shots = Shots::new(None);
        for name in ["img_10.tif", "img_2.tif", "img_9.tif"] {
            shots.write(name, 10);
        }
        shots.assert_settled(0, &[]);
        shots.write("img_9.tif", 11);
        shots.assert_settled(5, &[]);
        shots.assert_settled(10, &["img_2.tif"]);
        shots.assert_settled(15, &["img_9.tif", "img_10.tif"]);
        // One that is never at rest.
        shots.write("b.tif", 10);
        for k in 0..11 {
            shots.write("a.tif", 10 + k);
            shots.assert_settled(20 + 9 * k as u32, &[]);
        }
        assert_eq!(shots.watched.unsettled(), ["a.tif", "b.tif"].map(|name| shots.folder.path().join(name)));
        shots.write("a.tif", 50);
        shots.assert_settled(120, &["b.tif"]);
    }

    #[test]
    fn only_names_that_are_meant_are_taken() {
        let names = ["a.tif", "b.TIFF", "c.png.part", "d.tmp", ".e.tif", "f.jpg", "tif", ".png", "g.txt", "._h.png"];
        for (pattern, wanted) in
            [(None, &["a.tif", "b.TIFF", "f.jpg"][..]), (Some("*.t*"), &["a.tif", "d.tmp", "g.txt"])]
        {
            let mut shots = Shots::new(pattern);
            names.iter().for_each(|name| shots.write(name, 10));
            fs::create_dir(shots.folder.path().join("folder.tif")).unwrap();
            shots.assert_settled(0, &[]);
            shots.assert_settled(10, wanted);
        }
    }

    #[test]
    fn what_is_known_already_is_left_out_however_it_is_named() {
        let mut shots = Shots::new(None);
        ["a.tif", "b.tif", "c.tif"].iter().for_each(|name| shots.write(name, 10));
        shots.watched.leave_out(&shots.folder.path().join("a.tif"));
        fs::create_dir(shots.folder.path().join("folder")).unwrap();
        shots.watched.leave_out(&shots.folder.path().join("folder/../b.tif"));
        shots.watched.leave_out(Path::new("c.tif"));
        shots.assert_settled(0, &[]);
        shots.assert_settled(10, &["c.tif"]);
    }

    #[test]
    fn what_cannot_be_watched_is_refused() {
        let folder = TempDir::new().unwrap();
        let refused = |path: &Path, pattern| WatchedFolder::new(path, Some(pattern), SETTLE).unwrap_err();
        assert!(matches!(refused(&folder.path().join("none"), "*"), WatchError::NoFolder { .. }));
        assert!(matches!(refused(folder.path(), "a["), WatchError::Pattern { .. }));
        assert!(matches!(refused(folder.path(), "b/*.tif"), WatchError::Folders { .. }));
        let mut gone = WatchedFolder::new(folder.path(), None, SETTLE).unwrap();
        folder.close().unwrap();
        assert!(gone.look(Instant::now()).is_err());
    }

    #[test]
    fn a_file_that_never_becomes_an_image_or_never_rests_is_given_up() {
        let folder = TempDir::new().unwrap();
        let (path, settle) = (folder.path().join("a.png"), Duration::from_millis(10));
        let frame = Frame::file(path.clone(), 0);
        fs::write(&path, "no image").unwrap();
        let begin = Instant::now();
        let read = read_whole(&frame, Accepted::default(), settle, || true).unwrap();
        assert!(matches!(read, Err(ReadError::NotAnImage { .. })) && begin.elapsed() >= 10 * settle, "{read:?}");
        assert!(read_whole(&frame, Accepted::default(), settle, || false).is_none());
        // It is asked for between two looks: so it changes between any two.
        let grow = || fs::write(&path, "x".repeat(Stamp::at(&path).unwrap().bytes as usize + 1)).is_ok();
        let read = read_whole(&frame, Accepted::default(), settle, grow).unwrap();
        assert!(matches!(read, Err(ReadError::Changing { .. })), "{read:?}");
    }
}
