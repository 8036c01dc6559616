//! The wish to stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether a run shall stop, seen by all its threads: frames that are on the device are finished, no other is begun.
/// Copies share the wish.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Asks to stop.
    pub fn ask(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether to take no further frame.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }

    /// What a signal can set.
    pub fn flag(&self) -> Arc<AtomicBool> {
        self.0.clone()
    }
}
