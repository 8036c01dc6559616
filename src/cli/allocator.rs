//! How the program gets its memory, on Linux with the GNU library: kept once it was had, and in large pages where the
//! system grants them.
//!
//! By default the allocator of the system takes every larger block from the kernel and gives it back when it is freed:
//! each is then mapped and cleared page by page again, which takes a third of the time of a first pair of images. Kept,
//! the blocks of the reference serve the frames; and in pages of 2 MB instead of 4 KB the first time is short as well
//! (`scripts/cold.py`; ARCHITECTURE.md, "Tried, and left").

#![allow(unsafe_code, reason = "an allocator, and options of one that are set before any thread starts")]

use std::alloc::{GlobalAlloc, Layout, System};

/// Blocks from this size on, bytes, are where it is seen to that memory is in large pages: of smaller ones hardly any
/// comes first.
const LARGE: usize = 16 << 10;
/// Blocks from this size on, bytes, come from the kernel one by one.
const MAPPED: usize = 1 << 30;
/// How much the memory that is kept grows by at a time, bytes (of it what is never touched takes none); and what the
/// system's allocator keeps for a thread other than the first lies in pieces of so much, at multiples of it. Of larger
/// blocks each comes from the kernel there.
const PIECE: usize = 64 << 20;

/// The allocator of the program: that of the system, which keeps what it had and asks for large pages.
#[derive(Debug, Clone, Copy, Default)]
pub struct Allocator;

/// Blocks below [`MAPPED`] come from memory that is kept.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn keep_memory() {
    let bytes = |n: usize| libc::c_int::try_from(n).unwrap_or(libc::c_int::MAX);
    for (option, bytes) in [
        (libc::M_MMAP_THRESHOLD, bytes(MAPPED)),
        (libc::M_TRIM_THRESHOLD, libc::c_int::MAX),
        (libc::M_TOP_PAD, bytes(PIECE)),
    ] {
        // SAFETY: `main` has started no other thread yet. An option that is refused leaves the default, which is
        // slower.
        unsafe { libc::mallopt(option, bytes) };
    }
}

/// Gives back to the system what is free: before a wait of which nobody knows the end.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub(crate) fn give_back() {
    // SAFETY: pages without a block go; no block is touched.
    unsafe { libc::malloc_trim(0) };
}

/// Other systems take theirs.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) const fn give_back() {}

/// Other systems keep theirs.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(crate) const fn keep_memory() {}

/// Asks for large pages where a block is, for each piece of memory once; what the system does not grant stays in small
/// ones.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
fn ask_for_large_pages(block: *mut u8, bytes: usize) {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
    /// Of most processors.
    const PAGE: usize = 2 << 20;
    /// No first thread has so much.
    const MOST: usize = 1 << 40;
    /// Up to where the first thread's memory has been asked for.
    static ASKED: AtomicUsize = AtomicUsize::new(0);
    /// Pieces of other threads that have been; where two have one place here, each is asked for again after the other.
    static PIECES: [AtomicUsize; 64] = [const { AtomicUsize::new(0) }; 64];
    if block.is_null() {
        return;
    }
    let ask = |from: usize, to: usize| {
        let from = from / PAGE * PAGE;
        // SAFETY: advice on how to map what is mapped there: no content changes, nor whether it may be read or written.
        unsafe { libc::madvise(block.with_addr(from).cast(), to.next_multiple_of(PAGE) - from, libc::MADV_HUGEPAGE) };
    };
    let at = block.addr();
    // SAFETY: it grows by nothing.
    let end = unsafe { libc::sbrk(0) }.addr();
    if (end.saturating_sub(MOST)..end).contains(&at) {
        let asked = ASKED.load(Relaxed);
        if asked < end {
            ASKED.store(end, Relaxed);
            ask(if asked == 0 { at } else { asked }, end);
        }
    } else if bytes >= PIECE / 2 {
        ask(at, at + bytes);
    } else {
        let piece = at / PIECE * PIECE;
        let asked = &PIECES[at / PIECE % PIECES.len()];
        if asked.swap(piece, Relaxed) != piece {
            ask(piece, piece + PIECE);
        }
    }
}

/// Other systems do as they think best.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
const fn ask_for_large_pages(_: *mut u8, _: usize) {}

// SAFETY: every block is one of the system's allocator, with the layout that was asked for.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promise.
        let block = unsafe { System.alloc(layout) };
        if layout.size() >= LARGE {
            ask_for_large_pages(block, layout.size());
        }
        block
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if (LARGE..PIECE).contains(&layout.size()) {
            // The system's would clear it in small pages, before large ones are asked for.
            // SAFETY: the caller's promise.
            let block = unsafe { self.alloc(layout) };
            if !block.is_null() {
                // SAFETY: a block of this size that is nobody else's.
                unsafe { block.write_bytes(0, layout.size()) };
            }
            return block;
        }
        // SAFETY: the caller's promise.
        let block = unsafe { System.alloc_zeroed(layout) };
        if layout.size() >= LARGE {
            ask_for_large_pages(block, layout.size());
        }
        block
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise; the block is the system's.
        unsafe { System.dealloc(block, layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: the caller's promise; the block is the system's.
        let block = unsafe { System.realloc(block, layout, bytes) };
        if bytes >= LARGE {
            ask_for_large_pages(block, bytes);
        }
        block
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_that_is_to_be_zero_is_so_where_another_one_was() {
        for bytes in [LARGE / 2, LARGE, 3 * LARGE + 7, PIECE] {
            let layout = Layout::from_size_align(bytes, 64).expect("a layout");
            // SAFETY: blocks that are given back with their layout, and bytes within them that were written.
            unsafe {
                let before = Allocator.alloc(layout);
                before.write_bytes(0xab, bytes);
                Allocator.dealloc(before, layout);
                let block = Allocator.alloc_zeroed(layout);
                assert!(std::slice::from_raw_parts(block, bytes).iter().all(|&byte| byte == 0));
                Allocator.dealloc(block, layout);
            }
        }
    }

    #[test]
    fn a_block_that_grows_keeps_what_is_in_it() {
        let [small, large] = [LARGE / 4, 3 * LARGE].map(|bytes| Layout::from_size_align(bytes, 16).expect("a layout"));
        // SAFETY: a block that is given back with its last layout, and bytes within it that were written.
        unsafe {
            let block = Allocator.alloc(small);
            block.write_bytes(0xab, small.size());
            let block = Allocator.realloc(block, small, large.size());
            assert!(std::slice::from_raw_parts(block, small.size()).iter().all(|&byte| byte == 0xab));
            Allocator.dealloc(block, large);
        }
    }
}
