//! Loops whose parts are shared by the threads of a pool, and that end as soon as these are done.
//!
//! A loop of rayon waits for its last parts by taking up whatever else there is to do. Where that is the end of another
//! frame, ten times as long as the loop, those who wait for what follows it have nothing to do meanwhile.

use rayon::Scope;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Looks, some ten nanoseconds each, for the end of what others are at before the thread gives its core away.
const LOOKS: usize = 2000;
/// So many are made once all is done: until the pool knows it, too.
const LAST_LOOKS: usize = 20;

/// Does `work` for each of `parts`, by this thread and by all of its pool that have nothing else to do. While others
/// are still at their last part this one waits and takes up nothing, so that a part must not wait for anything.
pub fn for_each<T: Send>(parts: Vec<T>, work: impl Fn(T) + Sync) {
    for_each_init(parts, || (), |(), part| work(part));
}

/// As [`for_each`], with a `state` of each thread.
pub fn for_each_init<T: Send, S>(parts: Vec<T>, state: impl Fn() -> S + Sync, work: impl Fn(&mut S, T) + Sync) {
    let helpers = rayon::current_num_threads().min(parts.len()).saturating_sub(1);
    let parts = Mutex::new(parts.into_iter());
    let take = || {
        let mut own = None;
        loop {
            let next = parts.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(part) = next else { return };
            work(own.get_or_insert_with(&state), part);
        }
    };
    with_help(helpers, &take);
}

/// Lets this thread and so many others `take` parts until none is left; not generic, so compiled once for all loops.
fn with_help(helpers: usize, take: &(dyn Fn() + Sync)) {
    if helpers == 0 {
        return take();
    }
    let at_work = AtomicUsize::new(0);
    let help = || {
        let _end = AtWork::begin(&at_work);
        take();
    };
    rayon::scope(|scope| {
        invite(scope, helpers, &help);
        take();
        let mut looks = 0;
        while at_work.load(Ordering::Acquire) > 0 {
            looks += 1;
            if looks < LOOKS { std::hint::spin_loop() } else { std::thread::yield_now() }
        }
        (0..LAST_LOOKS).for_each(|_| std::hint::spin_loop());
    });
}

/// What `work` makes of each number below `n`, by parts of so many; `blank` is written first.
pub fn map<T: Send + Clone>(n: usize, part: usize, blank: T, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut all = vec![blank; n];
    for_each(all.chunks_mut(part).enumerate().collect(), |(k, all): (usize, &mut [T])| {
        (k * part..).zip(all).for_each(|(at, one)| *one = work(at));
    });
    all
}

/// Asks so many for help, who ask each other on: to wake one takes as long as a part.
fn invite<'s>(scope: &Scope<'s>, helpers: usize, help: &'s (impl Fn() + Sync)) {
    for helpers in [helpers.div_ceil(2), helpers / 2].into_iter().filter(|&helpers| helpers > 0) {
        scope.spawn(move |scope| {
            invite(scope, helpers - 1, help);
            help();
        });
    }
}

/// Counts as at work until it is dropped, also by a panic.
struct AtWork<'a>(&'a AtomicUsize);

impl<'a> AtWork<'a> {
    fn begin(count: &'a AtomicUsize) -> Self {
        count.fetch_add(1, Ordering::AcqRel);
        Self(count)
    }
}

impl Drop for AtWork<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;
    use std::sync::atomic::AtomicBool;
    use std::time::Duration;

    fn pool(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
    }

    #[test]
    fn every_part_is_done_once_by_any_number_of_threads() {
        for threads in [1, 2, 7] {
            for n in [0, 1, 5, 1000] {
                let mut done = vec![0; n];
                pool(threads).install(|| for_each(done.iter_mut().collect(), |part: &mut i32| *part += 1));
                assert!(done.iter().all(|&times| times == 1), "{threads} threads, {n} parts");
            }
        }
    }

    #[test]
    fn a_thread_that_waits_for_the_last_part_takes_up_nothing_else() {
        let (pool, both, is_over) = (pool(2), Barrier::new(3), AtomicBool::new(false));
        let (told, asked) = std::sync::mpsc::channel();
        std::thread::scope(|threads| {
            threads.spawn(|| {
                both.wait();
                // Both threads are at a part.
                let tell = || told.send((rayon::current_thread_index(), is_over.load(Ordering::SeqCst)));
                pool.scope(|scope| scope.spawn(|_| tell().expect("somebody asks")));
            });
            let first = pool.install(|| {
                let first = rayon::current_thread_index();
                for_each(vec![(), ()], |()| {
                    both.wait();
                    let is_first = rayon::current_thread_index() == first;
                    std::thread::sleep(Duration::from_millis(if is_first { 50 } else { 300 }));
                });
                is_over.store(true, Ordering::SeqCst);
                first
            });
            // The other thread may begin it as soon as its own part is done.
            let (by, was_over) = asked.recv().expect("told");
            assert!(was_over || by != first, "the thread that waited took it up");
        });
    }

    #[test]
    fn what_is_made_of_numbers_is_in_their_order() {
        for n in [0, 63, 64, 65, 1000] {
            let squares = pool(3).install(|| map(n, 64, 0, |at| at * at));
            assert!(squares.len() == n && squares.iter().enumerate().all(|(at, &square)| square == at * at));
        }
    }

    #[test]
    fn a_panic_in_a_part_is_passed_on() {
        let panics = || for_each((0..100).collect(), |part: i32| assert!(part != 50, "this part"));
        assert!(std::panic::catch_unwind(|| pool(3).install(panics)).is_err());
    }
}
