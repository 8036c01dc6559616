//! Memory of the planes and of the pixels of a reference.

use crate::backend::BackendError;
use bytemuck::Pod;
use memmap2::MmapMut;
use std::marker::PhantomData;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of a huge page.
const HUGE: usize = 1 << 21;

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
    fn zeros(bytes: usize, value_bytes: usize, what: &str) -> Result<Self, BackendError> {
        let out_of_memory = |_| BackendError::OutOfMemory { what: format!("{bytes} bytes of {what}") };
        // Whole huge pages: the system lets none but such mappings begin with one. And no mapping is empty.
        let mapped = bytes.next_multiple_of(if bytes >= HUGE / 2 { HUGE } else { 1 }).max(1);
        let map = MmapMut::map_anon(mapped).map_err(out_of_memory)?;
        // Only a hint: without huge pages it is merely slower.
        #[cfg(target_os = "linux")]
        #[cfg(not(miri))] // which does not know this advice
        let _ = map.advise(memmap2::Advice::HugePage);
        Ok(Self { map, bytes, value_bytes })
    }
}

/// Memory that is no longer used, for what is next of the same size: fresh pages cost as much as the work done on them.
#[derive(Debug, Clone, Default)]
pub(super) struct Pool(Arc<Mutex<Vec<Memory>>>);

/// Pieces kept at most.
const KEPT: usize = 12;

impl Pool {
    /// `n` values of `what`; they are arbitrary, but those of a kind that was written before, or 0.
    pub fn pages<T: Pod>(&self, n: usize, what: &str) -> Result<Pages<T>, BackendError> {
        let (bytes, value_bytes) = (n * size_of::<T>(), size_of::<T>());
        let mut free = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Of values of the same kind: whole numbers side by side may be no `f32` number, and what lanes beyond a row
        // read is multiplied by zero.
        let memory = match free.iter().position(|memory| (memory.bytes, memory.value_bytes) == (bytes, value_bytes)) {
            Some(at) => free.swap_remove(at),
            None => Memory::zeros(bytes, value_bytes, what)?,
        };
        Ok(Pages { memory: Some(memory), pool: self.clone(), of: PhantomData })
    }
}

/// Values whose memory goes back to the pool.
#[derive(Debug)]
pub(super) struct Pages<T> {
    memory: Option<Memory>,
    pool: Pool,
    of: PhantomData<T>,
}

impl<T: Pod> Pages<T> {
    /// The values.
    pub fn data(&self) -> &[T] {
        // The memory is taken only when they are dropped.
        self.memory.as_ref().map_or(&[], |memory| bytemuck::cast_slice(&memory.map[..memory.bytes]))
    }

    /// The values, to be written.
    pub fn data_mut(&mut self) -> &mut [T] {
        self.memory.as_mut().map_or(&mut [], |memory| bytemuck::cast_slice_mut(&mut memory.map[..memory.bytes]))
    }
}

impl<T> Drop for Pages<T> {
    fn drop(&mut self) {
        let mut free = self.pool.0.lock().unwrap_or_else(PoisonError::into_inner);
        if free.len() >= KEPT {
            free.remove(0);
        }
        free.extend(self.memory.take());
    }
}
