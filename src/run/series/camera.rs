//! A camera that writes images into a folder while they are correlated.

use crate::io::case::{CaseFile, parse_case};
use crate::io::images::Accepted;
use crate::io::series::{Frame, NameOrder};
use crate::io::store::{STORE, StoreHeader};
use crate::io::watch::{WatchedFolder, read_whole};
use crate::remark::Remark;
use crate::run::plan::Images;
use crate::run::words::remarks::{folder_unreadable, frame_late};
use crate::run::words::{Result, chain, plural};
use std::cmp::Ordering;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Share of the time that looking at the folder may take: listing many files is slow, on a network above all.
const LOOK_SHARE: u32 = 20;
/// How soon the wish to stop is noticed.
const ATTENTION: Duration = Duration::from_millis(50);

/// A camera at work: the frames that it writes.
#[derive(Debug)]
pub(crate) struct Camera {
    watched: WatchedFolder,
    page: usize,
    accepted: Accepted,
    timeout: Option<Duration>,
    /// Frames that have come and were not taken.
    come: VecDeque<Frame>,
    /// The last of the frames that were taken in their order.
    last: Option<PathBuf>,
    next_look: Instant,
    /// Why the folder could not be listed when it was looked at last.
    fault: Option<Remark>,
    remarks: Vec<Remark>,
}

impl Camera {
    pub fn new(watched: WatchedFolder, page: usize, accepted: Accepted, timeout: Option<Duration>) -> Self {
        let (come, remarks, next_look) = (VecDeque::new(), Vec::new(), Instant::now());
        Self { watched, page, accepted, timeout, come, last: None, next_look, fault: None, remarks }
    }

    /// Where it writes.
    pub fn folder(&self) -> &Path {
        self.watched.path()
    }

    /// Takes no file of this path: it is part of the series already.
    pub fn leave_out(&mut self, path: &Path) {
        self.watched.leave_out(path);
    }

    /// How long a file must have been the same.
    pub fn settle(&self) -> Duration {
        self.watched.settle()
    }

    /// What is to be known of a run that goes on: the frames that have their numbers, and the reference where none is
    /// named.
    pub fn go_on(&mut self, store: &StoreHeader, images: &mut Images) -> std::result::Result<(), String> {
        let CaseFile { images: there, .. } =
            parse_case(&store.case, Path::new(STORE)).map_err(|error| error.to_string())?;
        let frames = |files: Option<Vec<String>>| -> Vec<Frame> {
            let own = |file: String| self.watched.own(Path::new(&file)).unwrap_or_else(|| file.into());
            files.unwrap_or_default().into_iter().map(|file| Frame::file(own(file), self.page)).collect()
        };
        images.deformed = frames(there.deformed);
        if images.deformed.len() != store.frames.len() {
            return Err("its frames are pages of files".to_owned());
        }
        if images.reference.is_empty() {
            images.reference = frames(there.reference);
        }
        self.last = images.deformed.iter().map(|frame| frame.path.clone()).max_by(|a, b| compare_pair(a, b));
        Ok(())
    }

    /// The first image, once its file is whole; none when it is not `wanted` any more.
    pub fn first(&mut self, wanted: &dyn Fn() -> bool) -> Result<Option<Frame>> {
        self.come = self.take(true, wanted).into();
        let Some(first) = self.come.pop_front() else {
            return match self.timeout.filter(|_| wanted()) {
                Some(time) => {
                    Err(format!("{}: no image came for {} s", self.folder().display(), time.as_secs_f64()).into())
                }
                None => Ok(None),
            };
        };
        match read_whole(&first, self.accepted, self.settle(), wanted) {
            Some(Ok(_)) => Ok(Some(first)),
            Some(Err(error)) => {
                Err(format!("{}; it came first and would be the reference: name one with --reference", chain(&error))
                    .into())
            }
            None => Ok(None),
        }
    }

    /// The frames that have come, in order. Where `waits`, not before there is one: none when the time-out is over or
    /// nothing is `wanted` any more.
    pub fn take(&mut self, waits: bool, wanted: &dyn Fn() -> bool) -> Vec<Frame> {
        loop {
            let looked = Instant::now() >= self.next_look;
            if looked {
                self.look();
            }
            if !wanted() {
                return Vec::new();
            }
            let over = self.timeout.is_some_and(|time| looked && self.watched.last_change().elapsed() >= time);
            if !self.come.is_empty() || !waits || over {
                return self.come.drain(..).collect();
            }
            let rest = self.next_look.saturating_duration_since(Instant::now());
            std::thread::sleep(rest.min(ATTENTION));
        }
    }

    fn look(&mut self) {
        let begin = Instant::now();
        match self.watched.look(begin) {
            Ok(files) => {
                self.fault = None;
                for path in files {
                    match self.last.as_ref().filter(|last| compare_pair(&path, last).is_lt()) {
                        Some(last) => self.remarks.push(frame_late(&path, last)),
                        None => self.last = Some(path.clone()),
                    }
                    self.come.push_back(Frame::file(path, self.page));
                }
            }
            // A disk of the network may come back.
            Err(error) => {
                let fault = folder_unreadable(self.folder(), &error);
                if self.fault.as_ref() != Some(&fault) {
                    self.remarks.push(fault.clone());
                }
                self.fault = Some(fault);
            }
        }
        self.next_look = Instant::now();
        self.rest(self.watched.interval().max(LOOK_SHARE * begin.elapsed()));
    }

    /// Does not look again for so long.
    pub fn rest(&mut self, time: Duration) {
        self.next_look = self.next_look.max(Instant::now() + time);
    }

    pub fn take_remarks(&mut self) -> Vec<Remark> {
        std::mem::take(&mut self.remarks)
    }

    /// What to say at the end, whether a signal or the time-out was that.
    pub fn ending(&self, stopped: bool) -> Vec<String> {
        let folder = self.folder().display();
        let how = match stopped {
            true => format!("stopped watching {folder}"),
            false => format!("nothing new in {folder} for {} s", self.timeout.unwrap_or_default().as_secs_f64()),
        };
        let mut lines = vec![format!("{how}; the same command resumes with what has arrived by then")];
        let left: Vec<String> = self.watched.unsettled().iter().map(|path| path.display().to_string()).collect();
        if let [first, ..] = left.as_slice() {
            lines.push(format!("{} had not settled and left out, from {first}", plural(left.len(), "file")));
        }
        lines
    }
}

/// Which of two names comes first, by what these two show.
fn compare_pair(a: &Path, b: &Path) -> Ordering {
    NameOrder::of(&[a, b]).compare(a, b)
}
