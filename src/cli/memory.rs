//! The memory of the program: large blocks lie on huge pages where the system grants them, and what was given back serves the
//! next block.
//!
//! A process that correlates one pair asks for a few hundred large arrays one after the other. From the allocator of the C
//! library each comes on fresh pages of 4 KiB, which the system clears one by one: a quarter of the time of a first pair. Here
//! blocks of 128 KiB and more are cut from regions of 32 MiB, in sizes of which there are four to an octave, and a block that
//! is freed is the first to be given out again. What is smaller stays with the C library.
//!
//! At most 512 MiB of freed blocks stay in memory; the pages of what goes beyond are handed back to the system.

#![allow(unsafe_code, reason = "an allocator deals in raw memory")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::ptr::{self, NonNull};
use std::sync::{Mutex, PoisonError};

/// Blocks from this size on are dealt with here, bytes.
const LARGE: usize = 1 << 17;
/// What the system gives at a time, bytes.
const REGION: usize = 1 << 25;
/// Blocks of more bytes have a region of their own.
const OWN: usize = REGION / 8;
/// Sizes of pages, bytes.
const HUGE: usize = 1 << 21;
const PAGE: usize = 1 << 12;
/// Blocks begin at multiples of this: that of a cache line twice, since lines come in pairs.
const ALIGNED: usize = 128;
/// Freed memory that is kept as it is, bytes.
const KEPT: usize = 1 << 29;
/// Sizes up to 2^63 bytes.
const N_SIZES: usize = 4 * 64;

/// The allocator of the program: see the head of its source.
pub struct Blocks {
    state: Mutex<State>,
}

/// Freed blocks by size, and the region from which the next one is cut.
struct State {
    /// Each freed block begins with where the next one lies.
    free: [Option<NonNull<u8>>; N_SIZES],
    /// Bytes of freed blocks whose pages are kept.
    kept: usize,
    next: usize,
    end: usize,
}

// SAFETY: the pointers lead to memory that belongs to nobody else, and whoever holds the lock alone follows them.
unsafe impl Send for State {}

impl Default for Blocks {
    fn default() -> Self {
        Self::new()
    }
}

impl Blocks {
    /// One that has asked for nothing yet.
    pub const fn new() -> Self {
        Self { state: Mutex::new(State { free: [None; N_SIZES], kept: 0, next: 0, end: 0 }) }
    }

    /// A block of the size `class`, and whether it holds nothing but zeros.
    fn block(&self, class: usize) -> Option<(NonNull<u8>, bool)> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(block) = state.free[class] {
            // SAFETY: a freed block holds where the next one lies, written by `give_back`.
            state.free[class] = unsafe { block.cast::<Option<NonNull<u8>>>().read() };
            // Of one whose pages were handed back this is less than the truth: others may be kept in its stead.
            state.kept = state.kept.saturating_sub(size_of(class));
            return Some((block, false));
        }
        let size = size_of(class);
        if size > OWN {
            return Some((region(size.checked_next_multiple_of(HUGE)?)?, true));
        }
        if state.end - state.next < size {
            // What is left of the region before was never touched. Where memory is limited, a block may still be had.
            let Some(region) = region(REGION) else { return Some((region(size.next_multiple_of(PAGE))?, true)) };
            (state.next, state.end) = (region.as_ptr() as usize, region.as_ptr() as usize + REGION);
        }
        let block = NonNull::new(state.next as *mut u8)?;
        state.next += size;
        Some((block, true))
    }

    /// Keeps a block of the size `class` for the next one.
    fn give_back(&self, block: NonNull<u8>, class: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let size = size_of(class);
        if state.kept + size > KEPT {
            if size > OWN {
                return release(block, size.next_multiple_of(HUGE));
            }
            drop_pages(block, size);
        } else {
            state.kept += size;
        }
        // SAFETY: the block is large enough, aligned, and belongs to nobody any more.
        unsafe { block.cast::<Option<NonNull<u8>>>().write(state.free[class]) };
        state.free[class] = Some(block);
    }
}

/// The smallest size that holds `size` bytes, by its number: 4, 5, 6 and 7 times the powers of two.
fn class_of(size: usize) -> usize {
    let octave = (size - 1).ilog2() as usize;
    4 * octave + ((size - 1) >> (octave - 2)) % 4
}

fn size_of(class: usize) -> usize {
    (5 + class % 4) << (class / 4 - 2)
}

/// Fresh memory of the system, `len` bytes of zeros that begin with a huge page where it has such.
fn region(len: usize) -> Option<NonNull<u8>> {
    #[cfg(target_os = "linux")]
    {
        use rustix::mm::{Advice, MapFlags, ProtFlags, madvise, mmap_anonymous};
        let flags = MapFlags::PRIVATE;
        // SAFETY: new memory at a place that the system chooses.
        let at = unsafe { mmap_anonymous(ptr::null_mut(), len, ProtFlags::READ | ProtFlags::WRITE, flags) }.ok()?;
        // Only a hint: without huge pages it is merely slower.
        // SAFETY: the memory just mapped; the advice changes nothing that it holds.
        let _ = unsafe { madvise(at, len, Advice::LinuxHugepage) };
        NonNull::new(at.cast())
    }
    #[cfg(not(target_os = "linux"))]
    {
        let layout = Layout::from_size_align(len, PAGE).ok()?;
        // SAFETY: the length is not zero.
        NonNull::new(unsafe { System.alloc_zeroed(layout) })
    }
}

/// Gives a region back to the system.
fn release(region: NonNull<u8>, len: usize) {
    #[cfg(target_os = "linux")]
    // SAFETY: the whole of what `region` has mapped, which nobody uses any more.
    let _ = unsafe { rustix::mm::munmap(region.as_ptr().cast(), len) };
    #[cfg(not(target_os = "linux"))]
    if let Ok(layout) = Layout::from_size_align(len, PAGE) {
        // SAFETY: as `region` has asked for it.
        unsafe { System.dealloc(region.as_ptr(), layout) };
    }
}

/// Hands the whole pages of a block back to the system.
fn drop_pages(block: NonNull<u8>, size: usize) {
    #[cfg(target_os = "linux")]
    {
        let first = (block.as_ptr() as usize).next_multiple_of(PAGE);
        let end = (block.as_ptr() as usize + size) / PAGE * PAGE;
        if first < end {
            // SAFETY: these pages belong to the block alone, and nobody reads it before writing.
            let _ = unsafe { rustix::mm::madvise(first as *mut _, end - first, rustix::mm::Advice::LinuxDontNeed) };
        }
    }
    #[cfg(not(target_os = "linux"))]
    let _ = (block, size);
}

fn is_large(layout: Layout) -> bool {
    layout.size() >= LARGE && layout.align() <= ALIGNED
}

// SAFETY: large blocks are disjoint parts of memory from the system, aligned, of at least the size asked for, and go to
// nobody else until they are freed; what is small is the system allocator's, which is asked with the same layout for it.
unsafe impl GlobalAlloc for Blocks {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if is_large(layout) {
            return self.block(class_of(layout.size())).map_or(ptr::null_mut(), |(block, _)| block.as_ptr());
        }
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if is_large(layout) {
            return match self.block(class_of(layout.size())) {
                Some((block, true)) => block.as_ptr(),
                Some((block, false)) => {
                    // SAFETY: the block is at least this large.
                    unsafe { block.as_ptr().write_bytes(0, layout.size()) };
                    block.as_ptr()
                }
                None => ptr::null_mut(),
            };
        }
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        match NonNull::new(at).filter(|_| is_large(layout)) {
            Some(block) => self.give_back(block, class_of(layout.size())),
            // SAFETY: as the caller promises.
            None => unsafe { System.dealloc(at, layout) },
        }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        // SAFETY: the caller promises a size that a layout of this alignment may have.
        let new = unsafe { Layout::from_size_align_unchecked(new_size, layout.align()) };
        match (is_large(layout), is_large(new)) {
            // SAFETY: as the caller promises.
            (false, false) => unsafe { System.realloc(at, layout, new_size) },
            (true, true) if class_of(layout.size()) == class_of(new_size) => at,
            _ => {
                // SAFETY: a new block, of which as much is written as both have; the old one is the caller's.
                unsafe {
                    let moved = self.alloc(new);
                    if !moved.is_null() {
                        ptr::copy_nonoverlapping(at, moved, layout.size().min(new_size));
                        self.dealloc(at, layout);
                    }
                    moved
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_holds_what_it_stands_for_with_a_quarter_to_spare_at_most() {
        for size in (LARGE..4 * LARGE).chain([REGION - 1, REGION, REGION + 1, 1 << 40, (1 << 40) + 1]) {
            let given = size_of(class_of(size));
            assert!(given >= size && given <= size + size / 4, "{size} {given}");
            assert!(class_of(size) < N_SIZES && given.is_multiple_of(ALIGNED));
        }
    }

    #[test]
    fn blocks_do_not_overlap_come_back_and_are_zero_where_that_is_asked() {
        let blocks = Blocks::new();
        let layout = |size: usize| Layout::from_size_align(size, 64).unwrap();
        let sizes = [LARGE, LARGE + 1, 3 * LARGE, OWN, OWN + 1, REGION, 2 * REGION + 5];
        // SAFETY: every block is used within its layout and freed once with it.
        unsafe {
            for round in 0..3_u8 {
                let held: Vec<(*mut u8, usize)> =
                    sizes.iter().chain(&sizes).map(|&size| (blocks.alloc_zeroed(layout(size)), size)).collect();
                for (k, &(at, size)) in held.iter().enumerate() {
                    assert!((at as usize).is_multiple_of(ALIGNED));
                    let block = std::slice::from_raw_parts_mut(at, size);
                    assert!(block.iter().all(|&byte| byte == 0), "round {round}, block {k}");
                    block.fill(k as u8 + 1);
                }
                for (k, &(at, size)) in held.iter().enumerate() {
                    assert!(std::slice::from_raw_parts(at, size).iter().all(|&byte| byte == k as u8 + 1), "{k}");
                    let larger = blocks.realloc(at, layout(size), 2 * size);
                    assert!(std::slice::from_raw_parts(larger, size).iter().all(|&byte| byte == k as u8 + 1), "{k}");
                    blocks.dealloc(larger, layout(2 * size));
                }
            }
            let first = blocks.alloc(layout(LARGE + 9));
            blocks.dealloc(first, layout(LARGE + 9));
            assert_eq!(blocks.alloc(layout(LARGE + 1)), first);
        }
    }
}
