//! The wish to stop: Ctrl-C, or a signal of the system.

use super::Result;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit status of a run that was stopped: 128 and the number of the signal of Ctrl-C.
pub(super) const STOPPED: u8 = 130;

/// Whether the run shall stop, seen by all its threads.
#[derive(Debug, Clone, Default)]
pub(super) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Takes Ctrl-C, SIGTERM and SIGHUP over: the first is a wish, the second ends the process at once. Once in a process.
    pub fn listen() -> Result<Self> {
        let stop = Self::default();
        let asked = stop.0.clone();
        ctrlc::set_handler(move || {
            if asked.swap(true, Ordering::SeqCst) {
                std::process::exit(i32::from(STOPPED));
            }
        })?;
        Ok(stop)
    }

    /// Whether to take no further frame.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}
