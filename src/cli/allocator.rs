//! How the allocator of the system keeps memory, on Linux with the GNU library.
//!
//! By default it takes every larger block from the kernel and gives it back when it is freed: each is then mapped and cleared page by page
//! again, which takes a third of the time of a first pair of images. Kept, the blocks of the reference serve the frames.

#![allow(unsafe_code, reason = "options of the allocator are set before any thread starts")]

/// Blocks below a gigabyte come from memory that is kept, which grows by 64 MB at a time: of these what is never touched takes none.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(super) fn keep_memory() {
    for (option, bytes) in
        [(libc::M_MMAP_THRESHOLD, 1 << 30), (libc::M_TRIM_THRESHOLD, i32::MAX), (libc::M_TOP_PAD, 64 << 20)]
    {
        // SAFETY: `main` has started no other thread yet. An option that is refused leaves the default, which is slower.
        unsafe { libc::mallopt(option, bytes) };
    }
}

/// Other systems keep theirs.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) const fn keep_memory() {}
