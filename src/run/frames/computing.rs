//! Who computes for the threads of a run that write.

use crate::run::frames::Engine;
use rayon::ThreadPool;
use std::time::{Duration, Instant};

/// What a thread that waits for files has computed. On the CPU the threads of the pool do it, as they do the frames: of
/// more threads than cores some wait while a core has nothing to do, since the system moves none that has just worked
/// (a tenth of both of two cores). Beside a graphics device, which threads of the pool wait for, the caller does it.
pub(crate) struct Computing<'a> {
    engine: &'a Engine,
    pool: &'a ThreadPool,
    waited: Duration,
}

impl<'a> Computing<'a> {
    pub fn new(engine: &'a Engine, pool: &'a ThreadPool) -> Self {
        Self { engine, pool, waited: Duration::ZERO }
    }

    /// Does `work`, which must not wait for anything.
    pub fn compute<T: Send>(&mut self, work: impl FnOnce() -> T + Send) -> T {
        if !self.engine.is_on_cpu() {
            return work();
        }
        let asked = Instant::now();
        let (waited, done) = self.pool.install(|| (asked.elapsed(), work()));
        self.waited += waited;
        done
    }

    /// The time since `begin` without that in which all threads of the pool had other work.
    pub fn busy_since(&self, begin: Instant) -> Duration {
        begin.elapsed().saturating_sub(self.waited)
    }
}
