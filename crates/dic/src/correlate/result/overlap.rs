//! Frames of a series that are under way at the same time.

use crate::correlate::Start;
use rayon::ThreadPool;

/// How a frame of a series is correlated while others are under way; by default there are none.
#[derive(Default)]
pub struct Overlap<'a> {
    with: Option<(&'a ThreadPool, &'a mut (dyn FnMut(Start) + Send))>,
}

impl<'a> Overlap<'a> {
    /// The iterations, which frames do one after the other, run on the threads of `pool`. All else, uncertainty and
    /// marks of a frame that is predicted well, runs where the caller is while the next frame begins: on the same
    /// threads if they compute all the time, beside them if they wait for a graphics device.
    ///
    /// `settled` is called with the field as soon as the device is done, so that the next frame may begin; not where it
    /// is unsure what becomes of it. It is a forecast: in rare cases another field comes out, or none.
    pub fn new(pool: &'a ThreadPool, settled: &'a mut (dyn FnMut(Start) + Send)) -> Self {
        Self { with: Some((pool, settled)) }
    }

    /// Does `work` on the threads that frames share; it may tell where the next one may begin.
    pub(crate) fn share_threads<T: Send>(
        &mut self,
        work: impl FnOnce(&mut (dyn FnMut(Start) + Send)) -> T + Send,
    ) -> T {
        match &mut self.with {
            Some((pool, settled)) => pool.install(|| work(*settled)),
            None => work(&mut |_| ()),
        }
    }
}
