//! The frames of a run on their way: what is wanted of them, what was read, what came of it.

use crate::correlate::{Correlation, History, Start, Uploaded};
use crate::field::{StartFrom, UpdateReference};
use crate::imaging::{Blank, FlatBlocks, Image, Saturation};
use crate::io::images::{Accepted, ReadError};
use crate::io::series::Frame;
use crate::report::summary::FrameSummary;
use crate::run::folder::Kept;
use crate::run::frames::relay::Known;
use crate::run::plan::Stop;
use crate::run::words::Result;
use std::sync::Arc;
use std::time::Duration;

/// How the deformed images of a run are read and correlated.
#[derive(Clone, Copy)]
pub(crate) struct Frames<'a> {
    /// Those that are known at the start, from number 1 on.
    pub known: &'a [Frame],
    /// How long a file must have been the same, when they are being written: one that is not whole is waited for.
    pub settle: Option<Duration>,
    /// What an image may be: of the size of the reference.
    pub accepted: Accepted,
    /// The rectangles that hold the zones, px: x0, y0, x1, y1.
    pub windows: &'a [[usize; 4]],
    /// Smallest and largest grey level of the reference.
    pub range: (f32, f32),
    /// Which blocks of the reference have one grey level.
    pub flat: &'a FlatBlocks,
    pub start: StartFrom,
    /// When the reference is renewed; then only in order.
    pub update: UpdateReference,
    /// Where a run whose reference is renewed goes on.
    pub kept: &'a Kept,
    /// Of a frame that was done before: where tracking goes on after it, when it converged.
    pub stored: &'a (dyn Fn(usize) -> Result<Option<Start>> + Sync),
    /// Once it is asked to stop, frames that are on the device are finished and no other is begun.
    pub stop: &'a Stop,
}

impl Frames<'_> {
    /// What is known before frame `number`, with the frames since `known` that were done before.
    pub fn caught_up(&self, known: &Known, number: usize) -> Result<Known> {
        let mut found = Vec::new();
        for number in (known.number + 1..number).rev() {
            found.extend((self.stored)(number)?.map(|start| (number, start)));
            if found.len() == History::FIELDS {
                break;
            }
        }
        let mut known = known.clone();
        found.into_iter().rev().for_each(|(number, start)| known.history.note_field(number, start));
        Ok(known)
    }
}

/// A frame that was read, or not.
pub(crate) struct Decoded {
    pub number: usize,
    pub frame: Frame,
    pub loaded: std::result::Result<Picture, ReadError>,
    pub saturation: Option<Saturation>,
    pub blank: Option<Blank>,
    pub seconds: f64,
}

/// An image with what is known of its file, brought to the device if that went well.
pub(crate) struct Picture {
    pub image: Arc<Image>,
    pub sha256: String,
    pub taken: Option<String>,
    pub time_s: Option<f64>,
    pub notes: Vec<String>,
    /// With the generation of its correlator.
    pub uploaded: Option<(usize, Uploaded)>,
}

pub(crate) struct Done {
    pub sha256: Option<String>,
    pub summary: FrameSummary,
    /// None when it could not be read.
    pub result: Option<Correlation>,
    /// What is worth saying of it beside.
    pub news: Vec<String>,
    /// What a run whose reference is renewed needs to go on after it.
    pub kept: Option<Kept>,
}

impl Done {
    /// A frame that could not be read, or not be used.
    pub fn unreadable(sha256: Option<String>, summary: FrameSummary) -> Self {
        Self { sha256, summary, result: None, news: Vec::new(), kept: None }
    }
}
