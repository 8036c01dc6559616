//! What each piece of work takes, noted while somebody wants to know.

use super::shader::Kernel;
use crate::clock::Elapsed;
use std::sync::{Mutex, PoisonError};

/// How kernels are timed. Either way every piece of work is waited for, so that nothing overlaps: the sum is more
/// than the same work takes unobserved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Timing {
    /// The device's own clock, before and after each kernel.
    Timestamps,
    /// Each kernel is a batch of its own: time of this process from handing it over until it is done.
    Batches,
}

/// A piece of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Work {
    /// Making a kernel for the device.
    Compile(Kernel),
    /// Bytes to the device.
    Upload,
    /// A kernel, once.
    Kernel(Kernel),
    /// Bytes from the device.
    Readback,
}

/// What one piece of work took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noted {
    /// The work.
    pub work: Work,
    /// What it took; of a kernel timed by timestamps all three are the device's time.
    pub elapsed: Elapsed,
}

/// Notes, while it is switched on.
#[derive(Debug, Default)]
pub(super) struct Profile(Mutex<Option<(Timing, Vec<Noted>)>>);

impl Profile {
    /// Switches it on, or off; returns the notes so far.
    pub fn switch(&self, timing: Option<Timing>) -> Vec<Noted> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *state, timing.map(|timing| (timing, Vec::new()))).map_or(Vec::new(), |(_, noted)| noted)
    }

    /// How kernels are timed, while it is on.
    pub fn timing(&self) -> Option<Timing> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(|(timing, _)| *timing)
    }

    pub fn note(&self, work: Work, elapsed: Elapsed) {
        if let Some((_, noted)) = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            noted.push(Noted { work, elapsed });
        }
    }
}

/// Timestamps of the kernels of a recorder.
pub(super) struct Stamps {
    pub set: wgpu::QuerySet,
    pub kernels: Vec<Kernel>,
}
