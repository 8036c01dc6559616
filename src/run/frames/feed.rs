//! The frames that a run has to do.

use crate::io::store::StoreWriter;
use crate::run::frames::{Engine, Numbered, Spent};
use crate::run::plan::run_toml::RunToml;
use crate::run::series::camera::Camera;
use crate::run::words::Result;
use std::collections::VecDeque;
use std::time::Instant;

/// Share of the time that telling the store of new frames may take: its list of them grows with the series.
const EXTEND_SHARE: u32 = 20;

/// The frames that a run has to do: those of its plan, then those of its camera.
pub(crate) struct Feed<'a> {
    pub to_do: VecDeque<Numbered>,
    pub camera: Option<&'a mut Camera>,
    pub record: &'a mut RunToml,
    pub store: &'a StoreWriter,
    pub engine: &'a Engine,
    /// Time without anything to do.
    pub waiting: &'a Spent,
}

impl Feed<'_> {
    /// The next of them; waits for the camera while the frame is `wanted`.
    pub fn next(&mut self, wanted: &dyn Fn() -> bool) -> Result<Option<Numbered>> {
        let Some(camera) = &mut self.camera else { return Ok(self.to_do.pop_front()) };
        let begin = Instant::now();
        let come = camera.take(self.to_do.is_empty(), wanted);
        self.waiting.add(begin.elapsed());
        camera.take_remarks().into_iter().for_each(|remark| self.engine.remark(remark));
        if !come.is_empty() {
            // The store names a frame before anything of it is done: what is stored under a number stays that frame's,
            // however this process ends.
            let begin = Instant::now();
            let first = self.record.deformed.len() + 1;
            self.record.deformed.extend(come.iter().cloned());
            self.store.extend(come.iter().map(ToString::to_string), self.record.without_images())?;
            camera.rest(EXTEND_SHARE * begin.elapsed());
            self.to_do.extend((first..).zip(come));
        }
        Ok(self.to_do.pop_front())
    }
}
