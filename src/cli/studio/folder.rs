//! The folder of a studio: its images, and nothing else.

use crate::io::images::Accepted;
use crate::io::series::{Frame, NameOrder, has_image_ending};
use crate::report::Backdrop;
use serde::Serialize;
use std::path::{Path, PathBuf};

const MOST: usize = 20_000;
/// Pixels of the picture for one of a figure: zones are drawn to the pixel.
const RATIO: u32 = 2;
/// What a pattern gives a meaning to.
const OF_PATTERNS: [char; 4] = ['*', '?', '[', ']'];

#[derive(Debug, Clone, Serialize)]
pub(super) struct Listed {
    /// Its name from the folder on, with `/`.
    pub name: String,
    /// The pattern that gives it and its like; none where a name has signs of a pattern.
    pub pattern: Option<String>,
    #[serde(skip)]
    path: PathBuf,
}

/// The images in `folder` and in the folders in it, but for those of results, in natural order. What lies elsewhere and
/// is only linked is left out.
pub(super) fn images(folder: &Path, output: &Path) -> Vec<Listed> {
    let mut found = in_folder(folder, folder);
    for path in entries(folder) {
        let is_of_run = path == output || path.join("run.toml").exists() || path.join("steps.json").exists();
        if path.is_dir() && !is_of_run && is_inside(folder, &path) {
            found.extend(in_folder(folder, &path));
        }
    }
    found.truncate(MOST);
    found
}

/// What is in a folder and not hidden.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let shown =
        |path: &PathBuf| path.file_name().and_then(|name| name.to_str()).is_some_and(|name| !name.starts_with('.'));
    let mut entries: Vec<PathBuf> = entries.filter(shown).collect();
    let order = NameOrder::of(&entries);
    entries.sort_by(|a, b| order.compare(a, b));
    entries
}

/// Whether what `path` is in the end lies in `folder`.
pub(super) fn is_inside(folder: &Path, path: &Path) -> bool {
    path.canonicalize().is_ok_and(|real| real.starts_with(folder))
}

/// Names of the files in `folder` with one of these endings.
pub(super) fn named(folder: &Path, endings: &[&str]) -> Vec<String> {
    let is_named = |path: &PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_lowercase);
        ending.is_some_and(|ending| endings.contains(&ending.as_str())) && path.is_file() && is_inside(folder, path)
    };
    let name = |path: PathBuf| Some(path.file_name()?.to_str()?.to_owned());
    entries(folder).into_iter().filter(is_named).filter_map(name).take(MOST).collect()
}

fn in_folder(root: &Path, folder: &Path) -> Vec<Listed> {
    let listed = |path: PathBuf| {
        let ending = path.extension()?.to_str()?.to_owned();
        if !has_image_ending(&path) || !path.is_file() || !is_inside(root, &path) {
            return None;
        }
        let from_root = path.strip_prefix(root).ok()?.to_str()?.replace(std::path::MAIN_SEPARATOR, "/");
        let begin = from_root.rfind('/').map_or("", |at| &from_root[..=at]).to_owned();
        let pattern = (!begin.contains(OF_PATTERNS)).then(|| format!("{begin}*.{ending}"));
        Some(Listed { name: from_root, pattern, path })
    };
    entries(folder).into_iter().filter_map(listed).collect()
}

pub(super) fn backdrop(listed: &Listed) -> crate::cli::Result<Backdrop> {
    let image = Frame::file(listed.path.clone(), 0).read(Accepted::ANY)?.image;
    Ok(Backdrop::new(&image, RATIO))
}
