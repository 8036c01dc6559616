//! A plane of values with a border, laid out for unaligned vector loads.

use crate::backend::BackendError;
use crate::backend::pyramid::Grey;
use bytemuck::Pod;
use memmap2::MmapMut;
use rayon::prelude::*;
use std::marker::PhantomData;
use std::sync::{Arc, Mutex, PoisonError};

/// Border on every side, px: a whole cache line, so that column 0 starts one. The six taps of the quintic
/// spline at a pixel just inside reach three pixels out, and one more when the floor falls just outside.
pub(super) const BORDER: usize = LANES;
const LANES: usize = 16;

/// Values beyond the last row that a vector load may touch.
const TAIL: usize = 4 * LANES;

/// Bytes of a huge page.
const HUGE: usize = 1 << 21;

/// Border above and below, px.
pub(super) const BORDER_ROWS: usize = 4;

/// Values on pages of their own: aligned to cache lines (64-byte accesses that straddle two cost
/// double), and on huge pages where the system has them (a column of 16 rows touches dozens of small ones).
#[derive(Debug)]
struct Memory {
    map: MmapMut,
    bytes: usize,
    /// Of one value.
    value_bytes: usize,
}

impl Memory {
    fn zeros(bytes: usize, value_bytes: usize) -> Result<Self, BackendError> {
        let out_of_memory = |_| BackendError::OutOfMemory { what: format!("{bytes} bytes of an image plane") };
        // Whole huge pages: the system lets none but such mappings begin with one.
        let mapped = bytes.next_multiple_of(if bytes >= HUGE / 2 { HUGE } else { 1 });
        let map = MmapMut::map_anon(mapped).map_err(out_of_memory)?;
        // Only a hint: without huge pages it is merely slower.
        #[cfg(target_os = "linux")]
        #[cfg(not(miri))] // which does not know this advice
        let _ = map.advise(memmap2::Advice::HugePage);
        Ok(Self { map, bytes, value_bytes })
    }
}

/// Memory of planes that are no longer used, for the next ones of the same size: fresh pages cost as much
/// as the work done on them.
#[derive(Debug, Clone, Default)]
pub(super) struct Pool(Arc<Mutex<Vec<Memory>>>);

/// Planes kept at most.
const KEPT: usize = 12;

impl Pool {
    /// A plane for `width` x `height` px; what it holds is arbitrary but finite.
    pub fn plane<T: Pod>(&self, width: usize, height: usize) -> Result<Plane<T>, BackendError> {
        let mut stride = (width + 2 * BORDER).next_multiple_of(LANES);
        if stride.is_multiple_of(1024) {
            stride += LANES; // rows a multiple of 4 KiB apart would share cache sets
        }
        let value_bytes = size_of::<T>();
        let bytes = (stride * (height + 2 * BORDER_ROWS) + TAIL) * value_bytes;
        let mut free = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Of values of the same kind: two whole numbers side by side may be no `f32` number, and what lanes beyond a row read is multiplied by zero.
        let memory = match free.iter().position(|memory| (memory.bytes, memory.value_bytes) == (bytes, value_bytes)) {
            Some(at) => free.swap_remove(at),
            None => Memory::zeros(bytes, value_bytes)?,
        };
        Ok(Plane { width, height, stride, memory: Some(memory), pool: self.clone(), of: PhantomData })
    }
}

impl<T> Drop for Plane<T> {
    fn drop(&mut self) {
        let mut free = self.pool.0.lock().unwrap_or_else(PoisonError::into_inner);
        if free.len() >= KEPT {
            free.remove(0);
        }
        free.extend(self.memory.take());
    }
}

/// Row-major values with [`BORDER`] px around them.
#[derive(Debug)]
pub(super) struct Plane<T = f32> {
    pub width: usize,
    pub height: usize,
    pub stride: usize,
    memory: Option<Memory>,
    pool: Pool,
    of: PhantomData<T>,
}

impl<T: Pod> Plane<T> {
    /// The values, border included.
    pub fn data(&self) -> &[T] {
        // The memory is taken only when the plane is dropped.
        self.memory.as_ref().map_or(&[], |memory| bytemuck::cast_slice(&memory.map[..memory.bytes]))
    }

    /// The values, to be written.
    pub fn data_mut(&mut self) -> &mut [T] {
        self.memory.as_mut().map_or(&mut [], |memory| bytemuck::cast_slice_mut(&mut memory.map[..memory.bytes]))
    }

    /// Index in `data` of the value at column `x`, row `y`, which may lie in the border.
    #[inline(always)]
    pub fn at(&self, x: isize, y: isize) -> usize {
        index(self.stride, x, y)
    }

    /// The plane as kernels read it: the slice is taken once, not at every access.
    pub fn view(&self) -> View<'_, T> {
        View { width: self.width, height: self.height, stride: self.stride, data: self.data() }
    }
}

impl Plane {
    /// Fills the border by continuation through the outermost pixels, `c(-k) = 2 c(0) - c(k)` (the rule of
    /// the prefilter).
    pub fn continue_border(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.stride);
        let first = self.at(0, 0);
        let data = self.data_mut();
        let through = |end: f32, inner: f32| 2.0 * end - inner;
        // Only the taps' reach: the rest of the left and right border is never read into a result.
        for row in data[first - BORDER..].chunks_mut(stride).take(height) {
            let last = BORDER + width - 1;
            for k in 1..=BORDER_ROWS {
                let inner = k.min(width - 1);
                row[BORDER - k] = through(row[BORDER], row[BORDER + inner]);
                row[last + k] = through(row[last], row[last - inner]);
            }
        }
        let row_start = |y: isize| (first - BORDER).wrapping_add_signed(y * stride as isize);
        for k in 1..=BORDER_ROWS as isize {
            let last = height as isize - 1;
            let inner = k.min(last);
            for (to, end, from) in [(-k, 0, inner), (last + k, last, last - inner)] {
                let (to, end, from) = (row_start(to), row_start(end), row_start(from));
                for x in 0..width + 2 * BORDER {
                    data[to + x] = through(data[end + x], data[from + x]);
                }
            }
        }
    }
}

/// A borrowed plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a, T = f32> {
    pub width: usize,
    pub height: usize,
    pub stride: usize,
    pub data: &'a [T],
}

impl<T> View<'_, T> {
    /// As [`Plane::at`].
    #[inline(always)]
    pub fn at(&self, x: isize, y: isize) -> usize {
        index(self.stride, x, y)
    }
}

#[inline(always)]
fn index(stride: usize, x: isize, y: isize) -> usize {
    debug_assert!(x >= -(BORDER as isize) && y >= -(BORDER_ROWS as isize));
    ((y + BORDER_ROWS as isize) * stride as isize + x + BORDER as isize) as usize
}

/// Grey levels as a plane (its border is not filled).
pub(super) fn plane_of<G: Grey>(
    pool: &Pool,
    grey: &[G],
    width: usize,
    height: usize,
    offset: f32,
) -> Result<Plane, BackendError> {
    let mut plane = pool.plane(width, height)?;
    let (stride, first) = (plane.stride, plane.at(0, 0));
    plane.data_mut()[first..].par_chunks_mut(stride).with_min_len(64).zip(grey.par_chunks(width)).for_each(
        |(out, row)| {
            for (out, grey) in out.iter_mut().zip(row) {
                *out = grey.value() - offset;
            }
        },
    );
    Ok(plane)
}
