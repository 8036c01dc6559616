//! Ctrl-C, and the system's request to end.

use crate::cli::Result;
use crate::run::Stop;
use signal_hook::consts::{SIGABRT, SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Exit status of a run that was stopped: 128 and the number of the signal of Ctrl-C.
pub(crate) const STOPPED: u8 = 130;

/// Makes an exit status of what the language ends a process for by SIGABRT, memory that cannot be had: `memory
/// allocation of N bytes failed` has been said by then, and whoever called the program is to see that it could not run,
/// not that it crashed.
pub(crate) fn end_where_memory_ends() {
    // Where no signal can be taken over, the process ends as before.
    let _ = register_conditional_shutdown(SIGABRT, 2, Arc::new(AtomicBool::new(true)));
}

/// Takes Ctrl-C and SIGTERM over: the first is a wish, the second ends the process at once. SIGHUP is left alone, so
/// that `nohup` keeps its meaning.
pub(crate) fn listen() -> Result<Stop> {
    let stop = Stop::default();
    for signal in [SIGINT, SIGTERM] {
        // In this order: only a second signal finds the wish.
        register_conditional_shutdown(signal, i32::from(STOPPED), stop.flag())?;
        register(signal, stop.flag())?;
    }
    Ok(stop)
}
