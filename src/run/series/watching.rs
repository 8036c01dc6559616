//! A series that grows while it is correlated.

use crate::io::case::{CaseFile, over};
use crate::io::series::Frame;
use crate::io::store::{STORE, Store};
use crate::io::watch::WatchedFolder;
use crate::run::folder::{Lock, RunFolder, locks_in};
use crate::run::plan::resolved as plan;
use crate::run::plan::{Existing, Images, Plan, Ran, Request, Session};
use crate::run::series::camera::Camera;
use crate::run::series::files::carry_out;
use crate::run::words::{Event, Result, Watcher, chain};
use rayon::ThreadPool;
use std::path::Path;
use std::time::Duration;

/// How a folder is watched.
#[derive(Debug, Clone)]
pub struct Watching {
    /// Which files are frames: a glob of their names; all images where there is none.
    pub pattern: Option<String>,
    /// How long a file must have been the same.
    pub settle: Duration,
    /// After how long without anything new the series is over; none to wait for ever.
    pub timeout: Option<Duration>,
}

/// Correlates the images that come into the folder that stands in the place of the deformed images. `None` where it was
/// asked to stop before an image came. `output` is the folder of the results.
///
/// # Errors
/// As [`crate::run::run_series`]; a share of the series, and files whose pages are frames, are refused.
pub fn watch(
    asked: &Request,
    case: &CaseFile,
    watching: &Watching,
    output: &Path,
    pool: &ThreadPool,
    session: Session,
    watcher: Watcher<'_>,
) -> Result<Option<Ran>> {
    let Watching { pattern, settle, timeout } = watching;
    if asked.shard.is_some() {
        return Err("--shard cannot be given: the images of a camera have no known number to share".into());
    }
    let wanted = over(&asked.images, &case.images)?;
    if wanted.pages.is_some() {
        return Err("pages = \"all\" cannot be: each file of a watched folder is one frame".into());
    }
    if let Some(timeout) = timeout.filter(|timeout| timeout <= settle) {
        let [timeout, settle] = [timeout, *settle].map(|time| time.as_secs_f64());
        return Err(format!(
            "--timeout is {timeout} s, in which no file can settle; give more than --settle, {settle} s"
        )
        .into());
    }
    let page = wanted.page.unwrap_or(0) as usize;
    let watched = asked.images.deformed.iter().flatten().next().map_or("", String::as_str);
    let watched = WatchedFolder::new(Path::new(watched), pattern.as_deref(), *settle)?;
    let references = plan::references(asked, case)?;
    let mut camera = Camera::new(watched, page, plan::accepted_images(&wanted)?, *timeout);
    let mut images = Images {
        reference: references.into_iter().map(|path| Frame::file(path, page)).collect(),
        deformed: Vec::new(),
        grows: true,
        said: Vec::new(),
    };
    let folder = &RunFolder::writable(output)?;
    // Who works on the folder is told at once, not when the first image has come.
    drop(Lock::take(&locks_in(folder.path()), None, Some(camera.folder()))?);
    if session.existing == Existing::Continue && folder.holds_run() {
        let another = |why: String| folder.holds_another(Some(why));
        let store = Store::open(folder.path().join(STORE)).map_err(|error| another(chain(&error)))?;
        camera.go_on(store.header(), &mut images).map_err(another)?;
    }
    if images.reference.is_empty() {
        let line = format!("waiting in {} for the first image, which is the reference", camera.folder().display());
        watcher(Event::Note(&line));
        let Some(first) = camera.first(&|| !session.stop.is_asked())? else {
            watcher(Event::Note("stopped before an image came"));
            return Ok(None);
        };
        images.reference.push(first);
    }
    images.reference.iter().chain(&images.deformed).for_each(|frame| camera.leave_out(&frame.path));
    let plan = Plan::with(asked, case, images)?;
    carry_out(&plan, folder, pool, session, Some(camera), watcher).map(Some)
}
