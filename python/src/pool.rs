//! Threads that do the work.

use crate::errors::{raise, raised};
use pyo3::PyResult;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::{Arc, Mutex, PoisonError};

/// The pool of one thread per core that all share who do not ask for a number, with the process that made it.
static SHARED: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// A pool of `threads` threads, or the one with a thread for every core.
pub fn pool(threads: Option<i64>) -> PyResult<Arc<ThreadPool>> {
    let new = |n: usize| ThreadPoolBuilder::new().num_threads(n).build().map(Arc::new).map_err(raised);
    match threads {
        Some(n) => match usize::try_from(n) {
            Ok(n @ 1..=1024) => new(n),
            _ => Err(raise("OptionError", format!("threads is {n}; give 1 to 1024, or leave it out for all cores"))),
        },
        None => {
            let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
            match &*shared {
                Some((process, pool)) if *process == std::process::id() => Ok(Arc::clone(pool)),
                _ => {
                    let cores = std::thread::available_parallelism().map_or(1, usize::from);
                    let made = new(cores)?;
                    // After a fork the threads of the old one are gone: it is left alone, and never waited for.
                    std::mem::forget(shared.replace((std::process::id(), Arc::clone(&made))));
                    Ok(made)
                }
            }
        }
    }
}
