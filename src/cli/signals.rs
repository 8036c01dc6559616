//! Ctrl-C, and the system's request to end.

use super::Result;
use crate::run::Stop;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag::{register, register_conditional_shutdown};

/// Exit status of a run that was stopped: 128 and the number of the signal of Ctrl-C.
pub(super) const STOPPED: u8 = 130;

/// Takes Ctrl-C and SIGTERM over: the first is a wish, the second ends the process at once. SIGHUP is left alone, so that `nohup`
/// keeps its meaning.
pub(super) fn listen() -> Result<Stop> {
    let stop = Stop::default();
    for signal in [SIGINT, SIGTERM] {
        // In this order: only a second signal finds the wish.
        register_conditional_shutdown(signal, i32::from(STOPPED), stop.flag())?;
        register(signal, stop.flag())?;
    }
    Ok(stop)
}
