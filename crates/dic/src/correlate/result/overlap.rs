//! Frames of a series that are under way at the same time.

use crate::correlate::start::initial::Start;
use rayon::ThreadPool;

/// How a frame of a series is correlated while others are under way; by default there are none.
#[derive(Default)]
pub struct Overlap<'a> {
    with: Option<With<'a>>,
}

struct With<'a> {
    pool: &'a ThreadPool,
    settled: &'a mut (dyn FnMut(Start) + Send),
}

impl<'a> Overlap<'a> {
    /// What one frame after the other has to do, its iterations, is done on the threads of `pool`. All else, the
    /// uncertainty and the marks of a frame that is predicted well, is done where the caller is, while the next
    /// frame begins: on the same threads where they compute all the time, beside them where they wait for a
    /// graphics device.
    ///
    /// `settled` is called with the field as soon as the device has done its part, so that the next frame may begin;
    /// not where it is not sure yet what becomes of a field. It remains a forecast: in rare cases what comes out is
    /// another field, or none.
    pub fn new(pool: &'a ThreadPool, settled: &'a mut (dyn FnMut(Start) + Send)) -> Self {
        Self { with: Some(With { pool, settled }) }
    }

    /// Does `work` on the threads that frames share; it may tell where the next one may begin.
    pub(crate) fn share_threads<T: Send>(
        &mut self,
        work: impl FnOnce(&mut (dyn FnMut(Start) + Send)) -> T + Send,
    ) -> T {
        match &mut self.with {
            Some(With { pool, settled }) => pool.install(|| work(*settled)),
            None => work(&mut |_| ()),
        }
    }
}
