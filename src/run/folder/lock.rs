//! Who works on the folder of a run: locks that the operating system takes back when their process ends, however it
//! ends.

use crate::remark::Remark;
use crate::run::plan::Shard;
use crate::run::words::remarks::no_locks;
use crate::run::words::{Result, RunError, absolute};
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Lock of the whole run: held alone by a process without a shard, together by those with one.
const RUN: &str = "lock";
/// Lock for what the shards make once.
const COMMON: &str = "lock-common";
/// How long a lock that `quadrille status` has in its hand for a moment is waited for.
const PATIENCE: Duration = Duration::from_millis(300);

/// A process that works on a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Holder {
    pub host: String,
    pub pid: u32,
    /// When it began, seconds since 1970.
    pub since: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shard: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watches: Option<String>,
}

impl Holder {
    fn this(shard: Option<Shard>, watches: Option<&Path>) -> Self {
        let (shard, watches) = (shard.map(|shard| shard.to_string()), watches.map(absolute));
        Self { host: host(), pid: std::process::id(), since: now(), shard, watches }
    }

    fn read(file: &Path) -> Option<Self> {
        serde_json::from_str(&fs::read_to_string(file).ok()?).ok()
    }
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { host, pid, since, shard, watches } = self;
        write!(f, "process {pid} on {host}, begun {} s ago", now().saturating_sub(*since))?;
        watches.as_ref().map_or(Ok(()), |folder| write!(f, ", watching {folder}"))?;
        shard.as_ref().map_or(Ok(()), |shard| write!(f, ", shard {shard}"))
    }
}

fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

fn host() -> String {
    let of_kernel = || fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let of_shell = || ["HOSTNAME", "COMPUTERNAME"].into_iter().find_map(|name| std::env::var(name).ok());
    of_kernel().or_else(of_shell).map_or("this machine".to_owned(), |name| name.trim().to_owned())
}

/// The right to write into the folder of a run, until it is dropped.
#[derive(Debug)]
pub(crate) struct Lock {
    folder: PathBuf,
    _held: Vec<File>,
    /// What to know about it: a file system without locks.
    pub remark: Option<Remark>,
}

impl Lock {
    /// Takes the run whose locks lie in `folder` (made when it is not there), or the share `shard` of it. Its images
    /// may come from a folder that it `watches`.
    /// Errors: another process that works on it, with its machine and number.
    pub fn take(folder: &Path, shard: Option<Shard>, watches: Option<&Path>) -> Result<Self> {
        fs::create_dir_all(folder).map_err(|error| cannot(folder, error))?;
        let run = folder.join(RUN);
        let mut held = Vec::new();
        let mut take = |path: &Path, alone: bool| -> Result<bool> {
            let mut file = open(path)?;
            match patiently(|| if alone { file.try_lock() } else { file.try_lock_shared() }) {
                Ok(()) => {
                    if alone {
                        let text = serde_json::to_string(&Holder::this(shard, watches)).map_err(std::io::Error::other);
                        let written = text.and_then(|text| file.set_len(0).and_then(|()| writeln!(file, "{text}")));
                        written.map_err(|error| cannot(path, error))?;
                    }
                    held.push(file);
                    Ok(true)
                }
                Err(TryLockError::Error(error)) if without_locks(&error) => Ok(false),
                Err(TryLockError::Error(error)) => Err(cannot(path, error)),
                Err(TryLockError::WouldBlock) => Err(busy(folder)),
            }
        };
        let locks = match shard {
            None => take(&run, true)?,
            Some(shard) => take(&run, false)? && take(&folder.join(shard.lock_name()), true)?,
        };
        if let Some(shard) = shard {
            // Shards of another number of shares would do the same frames.
            let other = shards(folder).into_iter().find(|(path, n)| *n != shard.n && is_held(path));
            if other.is_some() {
                return Err(busy(folder));
            }
        }
        Ok(Self { folder: folder.to_owned(), _held: held, remark: (!locks).then(|| no_locks(folder)) })
    }

    /// Waits until no other shard does what is done once, and keeps them away until the file is dropped.
    pub fn common(&self) -> Result<File> {
        let path = self.folder.join(COMMON);
        let file = open(&path)?;
        match file.lock() {
            Err(error) if !without_locks(&error) => Err(cannot(&path, error)),
            _ => Ok(file),
        }
    }
}

/// The processes that work on the run whose locks lie in `folder`.
pub(crate) fn holders(folder: &Path) -> Vec<Holder> {
    let unknown = || Holder { host: "an unknown machine".into(), pid: 0, since: now(), shard: None, watches: None };
    let run = folder.join(RUN);
    if is_held(&run) {
        return vec![Holder::read(&run).unwrap_or_else(unknown)];
    }
    let held = shards(folder).into_iter().filter(|(path, _)| is_held(path));
    held.map(|(path, _)| Holder::read(&path).unwrap_or_else(unknown)).collect()
}

/// The locks of shards in `folder`, each with the number of shares.
fn shards(folder: &Path) -> Vec<(PathBuf, usize)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let shares = |name: &str| name.strip_prefix(Shard::LOCK)?.split_once("-of-")?.1.parse().ok();
    let mut found: Vec<_> =
        entries.filter_map(|entry| Some((entry.path(), shares(&entry.file_name().to_string_lossy())?))).collect();
    found.sort();
    found
}

/// Whether a process holds the lock `path` alone.
///
/// It is asked for together: an exclusive lock needs a file opened for writing on NFS (`EBADF` otherwise), which who
/// only looks may not be allowed.
fn is_held(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

/// Whether a lock failed because the file system has none: it says so itself, or its lock service does not answer, as
/// that of an NFS server without `lockd`.
fn without_locks(error: &std::io::Error) -> bool {
    const ENOLCK: i32 = 37;
    error.kind() == std::io::ErrorKind::Unsupported
        || (cfg!(target_os = "linux") && error.raw_os_error() == Some(ENOLCK))
}

fn open(path: &Path) -> Result<File> {
    let opened = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path);
    opened.map_err(|error| cannot(path, error))
}

fn patiently(
    mut attempt: impl FnMut() -> std::result::Result<(), TryLockError>,
) -> std::result::Result<(), TryLockError> {
    let begin = Instant::now();
    loop {
        match attempt() {
            Err(TryLockError::WouldBlock) if begin.elapsed() < PATIENCE => {
                std::thread::sleep(Duration::from_millis(20));
            }
            outcome => return outcome,
        }
    }
}

fn busy(folder: &Path) -> RunError {
    let who: Vec<String> = holders(folder).iter().map(ToString::to_string).collect();
    let who = if who.is_empty() { "another process".to_owned() } else { who.join("; ") };
    RunError::Busy { folder: folder.parent().unwrap_or(folder).to_owned(), who }
}

fn cannot(path: &Path, error: std::io::Error) -> RunError {
    RunError::file(path, "locked", error)
}
