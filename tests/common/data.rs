//! The images of real tests and of the DIC Challenge, made by others, where their folder is there.

use std::path::{Path, PathBuf};

/// The folder `name` of the real images; `None` where it is not there, which is said.
///
/// # Panics
/// When the environment variable `QUADRILLE_DATA` names a folder that does not have it: it was asked for.
#[track_caller]
pub fn folder(name: &str) -> Option<PathBuf> {
    let asked = std::env::var_os("QUADRILLE_DATA").map(PathBuf::from);
    let data = asked.clone().unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    let folder = data.join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(asked.is_none(), "QUADRILLE_DATA: there is no folder {}", folder.display());
    println!("skipped: the folder of real images is not there ({}); QUADRILLE_DATA names it", folder.display());
    None
}
