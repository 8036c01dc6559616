//! What the targets share.

use std::path::Path;

/// Calls `read` with a file that holds `data`, for readers that take a path. In memory where the system has such a folder.
pub fn with_file(data: &[u8], name: &str, read: impl FnOnce(&Path)) {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
    let folder = folder.expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, data).expect("a temporary file");
    read(&path);
}
