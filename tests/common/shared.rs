//! What many tests begin with is made once for all of them, also where each test has a process of its own.

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The folder for all tests of a run (scripts/test.sh), or else for those of this process.
fn root() -> &'static Path {
    static OWN: OnceLock<(PathBuf, Option<tempfile::TempDir>)> = OnceLock::new();
    let (path, _) = OWN.get_or_init(|| match std::env::var_os("QUADRILLE_SHARED") {
        Some(path) => (path.into(), None),
        None => {
            let own = tempfile::tempdir().unwrap();
            (own.path().to_owned(), Some(own))
        }
    });
    path
}

/// The folder `name`: the first test that asks for it fills it by `make`, the others wait. Nobody writes into it
/// afterwards.
#[track_caller]
pub fn folder(name: &str, make: impl FnOnce(&Path)) -> PathBuf {
    let path = root().join(name);
    let lock = File::create(root().join(format!("{name}.lock"))).unwrap();
    lock.lock().unwrap();
    let done = root().join(format!("{name}.done"));
    if !done.exists() {
        // A test that fails while it fills the folder leaves it to the next one. It keeps its name: files in it may
        // have written that down.
        let _ = fs::remove_dir_all(&path);
        fs::create_dir(&path).unwrap();
        make(&path);
        fs::write(done, "").unwrap();
    }
    path
}

/// The value `name`, made once by `make`. Numbers come back with all their bits.
#[track_caller]
pub fn value<T: Serialize + DeserializeOwned>(name: &str, make: impl FnOnce() -> T) -> T {
    let folder = folder(name, |folder| {
        fs::write(folder.join("value.json"), serde_json::to_vec(&make()).unwrap()).unwrap();
    });
    serde_json::from_slice(&fs::read(folder.join("value.json")).unwrap()).unwrap()
}
