//! Going on where a run was stopped: what is kept of every frame beside the store, and which frames are done.
//!
//! A frame is done when its status is in the store and its record in `restart/frames/NNNNNN.json`, and all files that
//! the record names have the length they were written with. The frames that were finished last are read whole as well:
//! of these a machine that went down may have lost what was not yet on the disk.

use crate::backend::GreyTransfer;
use crate::correlate::{Correlation, Start};
use crate::field::{Measurement, Status, UpdateReference};
use crate::io::images::{Accepted, ReadError};
use crate::io::series::Frame;
use crate::io::store::{Store, StoreHeader};
use crate::mesh::Mesh;
use crate::report::summary::FrameSummary;
use crate::run::folder::{Kept, RunFolder, csv_name, vtu_name};
use crate::run::words::{Result, RunError};
use crate::units::Px;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Frames that were finished this long before the last one are on the disk: systems write within half of it.
const ON_DISK_AFTER: Duration = Duration::from_secs(60);
/// Differences that are named.
const NAMED: usize = 3;

/// What is kept of a frame beside its field.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct FrameRecord {
    pub summary: FrameSummary,
    /// Of its file; none when that could not be read.
    pub sha256: Option<String>,
    /// Size and time of its file when it was read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    image: Option<Stamp>,
    /// Gain and offset of each zone: where the next frame starts.
    #[serde(default)]
    transfer: Vec<[f64; 2]>,
    /// Displacement, px, of the nodes that were not measured, from which the next frame starts as well. A number that
    /// is none is null.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    unmeasured: Vec<(usize, [Option<f64>; 2])>,
    /// The elements that the next frame begins without.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    left_out: Vec<u32>,
    /// Length of each file of the frame, by its name in the folder of the run.
    #[serde(default)]
    bytes: BTreeMap<PathBuf, u64>,
}

impl FrameRecord {
    /// The record of a frame whose `files` (names in `folder`) have been written; `result` where later frames start
    /// from it.
    pub fn new(
        folder: &Path,
        summary: FrameSummary,
        (image, sha256): (Option<&Path>, Option<String>),
        result: Option<&Correlation>,
        files: impl IntoIterator<Item = PathBuf>,
    ) -> Result<Self> {
        let (transfer, unmeasured, left_out, bytes) = Default::default();
        let image = image.and_then(Stamp::of);
        let mut record = Self { summary, sha256, image, transfer, unmeasured, left_out, bytes };
        if let Some((result, start)) = result.and_then(|result| Some((result, result.next_start()?))) {
            record.transfer = start.transfer.iter().map(|transfer| [transfer.gain, transfer.offset]).collect();
            record.left_out = start.left_out;
            let measured = &result.measurement.measured;
            let finite = |u: [f64; 2]| u.map(|u| u.is_finite().then_some(u));
            let all = start.displacement.iter().zip(measured).enumerate();
            // What is zero there is zero when it is read.
            let told = |&(_, (u, measured)): &(usize, (&[f64; 2], &bool))| !measured && u.map(f64::to_bits) != [0; 2];
            record.unmeasured = all.filter(told).map(|(node, (&u, _))| (node, finite(u))).collect();
        }
        for file in files {
            let path = folder.join(&file);
            let about = fs::metadata(&path).map_err(|error| RunError::file(&path, "read", error))?;
            record.bytes.insert(file, about.len());
        }
        Ok(record)
    }

    /// Where the record of frame `number` lies in the folder of the run.
    pub fn name(number: usize) -> String {
        format!("{}/{number:06}.json", RunFolder::FRAMES)
    }

    fn read(folder: &Path, number: usize) -> Option<Self> {
        let text = fs::read(folder.join(Self::name(number))).ok()?;
        serde_json::from_slice::<Self>(&text).ok().filter(|record| record.summary.number == number)
    }

    /// Whether the image is another than the one that was measured. Where size and time are the same, nothing is read; a
    /// file that is gone says nothing.
    fn is_of_another(&self, image: &Frame) -> bool {
        let (Some(was), Some(is)) = (&self.image, Stamp::of(&image.path)) else { return false };
        *was != is
            && match image.sha256() {
                Ok(sha256) => self.sha256.as_ref() != Some(&sha256),
                Err(error) => !matches!(error, ReadError::Io(..) | ReadError::NotFound(_)),
            }
    }

    /// Whether its files are as long as they were written.
    fn is_whole(&self, folder: &Path) -> bool {
        self.bytes.iter().all(|(file, &bytes)| fs::metadata(folder.join(file)).is_ok_and(|about| about.len() == bytes))
    }
}

/// Size and time of an image file: where both are as before, so is the content.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
struct Stamp {
    bytes: u64,
    /// Nanoseconds since 1970.
    modified_ns: u64,
}

impl Stamp {
    /// That of a file; none of one that is not there.
    fn of(file: &Path) -> Option<Self> {
        let about = fs::metadata(file).ok()?;
        let since = about.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        Some(Self { bytes: about.len(), modified_ns: since.as_nanos() as u64 })
    }
}

/// Whether `bytes` are one of the files of a restart on `mesh`: the record of a frame, or the state of a chain of
/// references. What attacks on these files call.
#[doc(hidden)]
pub fn is_of_a_restart(bytes: &[u8], mesh: &Mesh<Px>) -> bool {
    let state = Kept::parse(Cursor::new(bytes));
    state.is_some_and(|kept| kept.goes_with(UpdateReference::Residual, mesh))
        || serde_json::from_slice::<FrameRecord>(bytes).is_ok()
}

/// What was found of an earlier start of the same run.
#[derive(Debug, Default)]
pub(crate) struct Earlier {
    /// The frames that are done, by number.
    pub done: BTreeMap<usize, (FrameSummary, Option<String>)>,
    /// Those whose file could not be read, with the SHA-256 where one of another size could be.
    unreadable: BTreeMap<usize, (FrameSummary, Option<String>)>,
    /// Frames with a status that are not whole.
    pub damaged: Vec<usize>,
    /// Frames whose image is another than the one that was measured.
    pub replaced: Vec<usize>,
}

impl Earlier {
    /// The frames of `numbers` that are done, with CSV and VTU files where these are wanted and there is a field, and
    /// whose images (of the series `frames`) are those that were measured. Runs on the threads of the pool it is called
    /// in.
    pub fn find(store: &Store, folder: &Path, (frames, numbers): (&[Frame], &[usize]), [csv, vtu]: [bool; 2]) -> Self {
        let written = |number: &usize| fs::metadata(store.status_file(*number)).and_then(|about| about.modified()).ok();
        let times: Vec<Option<SystemTime>> = numbers.par_iter().map(written).collect();
        let last = times.iter().flatten().max().copied();
        // A clock that went back says nothing of what was done last.
        let is_ahead = last.is_some_and(|last| last > SystemTime::now() + ON_DISK_AFTER);
        let is_new = |time: &SystemTime| {
            let is_recent = |last: SystemTime| last.duration_since(*time).is_ok_and(|before| before < ON_DISK_AFTER);
            is_ahead || last.is_some_and(is_recent)
        };
        let look = |(&number, time): (&usize, &Option<SystemTime>)| {
            let time = time.as_ref()?;
            let whole = || {
                let status = store.status(number).ok()??;
                let record = FrameRecord::read(folder, number).filter(|record| record.summary.status == status)?;
                let has = |name: String| record.bytes.contains_key(Path::new(&name));
                let has_tables = || (!csv || has(csv_name(number))) && (!vtu || has(vtu_name(number)));
                let whole = record.is_whole(folder)
                    && (!status.has_field() || has_tables())
                    && (!is_new(time) || store.check(number).is_ok());
                let image = number.checked_sub(1).and_then(|at| frames.get(at));
                let is_replaced = whole && image.is_some_and(|image| record.is_of_another(image));
                whole.then_some((record.summary, record.sha256, is_replaced))
            };
            Some((number, whole()))
        };
        let found: Vec<_> = numbers.par_iter().zip(&times).filter_map(look).collect();
        let mut earlier = Self::default();
        for (number, frame) in found {
            match frame {
                // A file that could not be read may be there now.
                Some((summary, sha256, _)) if summary.status == Status::Unreadable => {
                    earlier.unreadable.insert(number, (summary, sha256));
                }
                Some((.., true)) => earlier.replaced.push(number),
                Some((summary, sha256, false)) => drop(earlier.done.insert(number, (summary, sha256))),
                None => earlier.damaged.push(number),
            }
        }
        earlier
    }

    /// What of it holds when every frame depends on those before it: the frames up to the last from which a chain can
    /// go on, and its state there. A frame that could not be read is one of them as long as its file is what it
    /// was.
    pub fn of_chain(
        self,
        folder: &Path,
        (frames, accepted): (&[Frame], Accepted),
        update: UpdateReference,
        mesh: &Mesh<Px>,
    ) -> (Self, Kept) {
        let Self { mut done, mut unreadable, damaged, replaced } = self;
        let is_as_before = |number: usize, sha256: &Option<String>| {
            let frame = frames.get(number - 1);
            frame.is_some_and(|frame| frame.read(accepted).map(|loaded| loaded.sha256).ok() == *sha256)
        };
        let mut number = 1;
        while done.contains_key(&number) || unreadable.get(&number).is_some_and(|(_, was)| is_as_before(number, was)) {
            done.extend(unreadable.remove(&number).map(|frame| (number, frame)));
            number += 1;
        }
        let kept = Kept::last(folder, number - 1, update, mesh);
        done.retain(|&number, _| number <= kept.number);
        (Self { done, unreadable, damaged, replaced }, kept)
    }
}

/// Where tracking goes on after frame `number`, which was done before: none when that did not converge.
pub(crate) fn stored_start(store: &Store, folder: &Path, number: usize) -> Result<Option<Start>> {
    if !store.status(number)?.is_some_and(Status::is_measured) {
        return Ok(None);
    }
    let lost = || RunError::RecordLost { number, remedy: "run the same command again" };
    let record = FrameRecord::read(folder, number).ok_or_else(lost)?;
    let Measurement { mut displacement, mesh, .. } = store.frame(number)?.ok_or_else(lost)?.measurement;
    for (node, u) in record.unmeasured {
        *displacement.get_mut(node).ok_or_else(lost)? = u.map(|u| u.unwrap_or(f64::NAN));
    }
    let transfer = record.transfer.into_iter().map(|[gain, offset]| GreyTransfer { gain, offset }).collect();
    let is_element = |&element: &u32| (element as usize) < mesh.n_elements();
    let left_out = Some(record.left_out).filter(|left_out| left_out.iter().all(is_element)).ok_or_else(lost)?;
    Ok(Some(Start { displacement, transfer, left_out }))
}

/// Every frame of the series with its SHA-256; none of those that are not done.
pub(crate) fn all_frames(folder: &Path, n_frames: usize) -> Vec<Option<(FrameSummary, Option<String>)>> {
    let numbers: Vec<usize> = (1..=n_frames).collect();
    let read = |&number: &usize| FrameRecord::read(folder, number).map(|record| (record.summary, record.sha256));
    numbers.par_iter().map(read).collect()
}

/// What a store says of its run with the names of its files where they are now: a project may have been moved as a whole.
/// Whether their content is the same is seen apart from that.
fn relocated(there: &StoreHeader, asked: &StoreHeader) -> StoreHeader {
    let mut header = there.clone();
    let (Some(old), Some(new)) = (reference_in(&there.case), reference_in(&asked.case)) else { return header };
    let [mut from, mut to] = [old.as_path(), new.as_path()];
    while let (Some(a), Some(b)) = (from.file_name(), to.file_name()) {
        let (true, Some(above), Some(above_new)) = (a == b, from.parent(), to.parent()) else { break };
        (from, to) = (above, above_new);
    }
    if from == to || from == old {
        return header;
    }
    let moved = |name: &mut String| {
        if let Ok(rest) = Path::new(name.as_str()).strip_prefix(from) {
            *name = to.join(rest).display().to_string();
        }
    };
    header.reference.iter_mut().chain(&mut header.frames).for_each(&moved);
    if let Ok(case) = header.case.parse::<toml::Table>() {
        let mut value = toml::Value::Table(case);
        for_each_text(&mut value, &moved);
        header.case = toml::to_string(&value).unwrap_or_else(|_| there.case.clone());
    }
    header
}

/// The first reference image that a case names.
fn reference_in(case: &str) -> Option<PathBuf> {
    let case: toml::Table = case.parse().ok()?;
    let named = case.get("images")?.get("reference")?;
    named.as_str().or_else(|| named.as_array()?.first()?.as_str()).map(PathBuf::from)
}

/// Whether the files of a run have other names than those that its store has.
pub(crate) fn is_moved(there: &StoreHeader, asked: &StoreHeader) -> bool {
    reference_in(&there.case) != reference_in(&asked.case)
}

fn for_each_text(value: &mut toml::Value, change: &impl Fn(&mut String)) {
    match value {
        toml::Value::String(text) => change(text),
        toml::Value::Array(list) => list.iter_mut().for_each(|value| for_each_text(value, change)),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, value)| for_each_text(value, change)),
        _ => {}
    }
}

/// What the run in a store has different from the one asked for, in words; nothing when it can go on. Where the series
/// `may_grow`, that in the store may be the beginning of the one asked for.
pub(crate) fn differences(there: &StoreHeader, asked: &StoreHeader, may_grow: bool) -> Vec<String> {
    let there = &relocated(there, asked);
    let mut found = Vec::new();
    let mut differ = |name: &str, there: String, asked: String| {
        if there != asked {
            found.push(format!("{name}: {there} in the store, {asked} asked"));
        }
    };
    let version = |text: &str| {
        let mut parts = text.split('.');
        let (major, minor) = (parts.next().unwrap_or("").to_owned(), parts.next().unwrap_or("").to_owned());
        // Before 1.0 the second number counts what breaks.
        if major == "0" { format!("{major}.{minor}") } else { major }
    };
    differ("version of quadrille", version(&there.quadrille), version(&asked.quadrille));
    let tables = [there, asked].map(|header| leaves(&header.case));
    let keys: std::collections::BTreeSet<&String> = tables.iter().flat_map(|table| table.keys()).collect();
    for key in keys {
        let [there, asked] = tables.each_ref().map(|table| table.get(key));
        let name = key.strip_prefix("correlation.").unwrap_or(key);
        match (there, asked) {
            (Some(toml::Value::Array(there)), Some(toml::Value::Array(asked)))
                if may_grow && key == "images.deformed" && asked.starts_with(there) => {}
            (Some(toml::Value::Array(there)), Some(toml::Value::Array(asked)))
                if there.len() > 1 || asked.len() > 1 =>
            {
                match there.iter().zip(asked).find(|(there, asked)| there != asked) {
                    Some((there, asked)) => differ(name, there.to_string(), asked.to_string()),
                    None => differ(name, format!("{} entries", there.len()), format!("{} entries", asked.len())),
                }
            }
            _ => {
                let [there, asked] = [there, asked].map(|value| value.map_or("none".to_owned(), ToString::to_string));
                differ(name, there, asked);
            }
        }
    }
    let count = |header: &StoreHeader| format!("{} frames", header.frames.len());
    if !(may_grow && begins(there, asked)) {
        differ("series", count(there), count(asked));
    }
    for ((file, there), asked) in asked.reference.iter().zip(&there.reference_sha256).zip(&asked.reference_sha256) {
        if there != asked {
            differ(&format!("content of {file}, SHA-256"), there.clone(), asked.clone());
        }
    }
    if found.is_empty() && !same_mesh(&there.mesh, &asked.mesh) {
        found.push("the mesh is another one".to_owned());
    }
    let more = found.len().saturating_sub(NAMED);
    found.truncate(NAMED);
    if more > 0 {
        found.push(format!("{more} more"));
    }
    found
}

/// Whether the series of a store is the beginning of the one asked for. That the files are the same is seen elsewhere:
/// here stacks could have more pages than before.
fn begins(there: &StoreHeader, asked: &StoreHeader) -> bool {
    // The folders may be named from another place.
    let same = |(there, asked): (&String, &String)| Path::new(there).file_name() == Path::new(asked).file_name();
    there.frames.len() <= asked.frames.len() && there.frames.iter().zip(&asked.frames).all(same)
}

/// Whether two meshes have the same nodes, elements and zones: a grid is a free mesh once it was stored.
fn same_mesh(a: &Mesh<Px>, b: &Mesh<Px>) -> bool {
    a.nodes() == b.nodes()
        && a.elements() == b.elements()
        && a.zones() == b.zones()
        && a.node_zone() == b.node_zone()
        && a.element_zone() == b.element_zone()
}

/// The values of a case that decide about the fields, each with the path of its key.
fn leaves(case: &str) -> BTreeMap<String, toml::Value> {
    fn walk(value: toml::Value, key: String, found: &mut BTreeMap<String, toml::Value>) {
        match value {
            toml::Value::Table(table) => {
                for (name, value) in table {
                    walk(value, if key.is_empty() { name } else { format!("{key}.{name}") }, found);
                }
            }
            value => drop(found.insert(key, value)),
        }
    }
    let mut found = BTreeMap::new();
    walk(toml::Value::Table(case.parse().unwrap_or_default()), String::new(), &mut found);
    // Of before there was a choice.
    let update = "correlation.update_reference".to_owned();
    found.entry(update).or_insert_with(|| UpdateReference::Never.to_string().into());
    let aside = |key: &str| {
        key == "run.quadrille" || key == "run.threads" || ["run.units.", "report."].iter().any(|of| key.starts_with(of))
    };
    found.retain(|key, _| !aside(key));
    found
}
