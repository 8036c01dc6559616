//! The wish to stop: Ctrl-C, or the system's request to end.

use super::Result;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit status of a run that was stopped: 128 and the number of the signal of Ctrl-C.
pub(super) const STOPPED: u8 = 130;

/// Whether the run shall stop, seen by all its threads.
#[derive(Debug, Clone, Default)]
pub(super) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Takes Ctrl-C and SIGTERM over: the first is a wish, the second ends the process at once. SIGHUP is left alone, so
    /// that `nohup` keeps its meaning.
    pub fn listen() -> Result<Self> {
        let stop = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // In this order: only a second signal finds the wish.
            register_conditional_shutdown(signal, i32::from(STOPPED), stop.0.clone())?;
            register(signal, stop.0.clone())?;
        }
        Ok(stop)
    }

    /// Whether to take no further frame.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}
