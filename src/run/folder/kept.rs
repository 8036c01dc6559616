//! What a run whose reference is renewed keeps after every frame, so that a later start goes on with the same bits.
//!
//! `restart/chain/NNNNNN.npz` is written before the status of frame N, and that of the frame before is removed after
//! it: of the frames that are done one after the other the last has its state, whenever the run is stopped. Now and
//! then one stays ([`Kept::STAYS`]): where the last is lost, frames are done again from there.

use crate::backend::GreyTransfer;
use crate::correlate::{ChainState, Keyframe};
use crate::field::UpdateReference;
use crate::imaging::Image;
use crate::io::arrays::{ArrayFile, Values};
use crate::io::images::Accepted;
use crate::io::npz::{NpzWriter, read_npz};
use crate::io::series::Frame;
use crate::mesh::Mesh;
use crate::run::folder::RunFolder;
use crate::run::words::chain;
use crate::units::Px;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, Write};
use std::path::Path;
use std::sync::Arc;

/// The state of a chain after a frame. That before the first frame is the default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Kept {
    pub number: usize,
    pub state: Arc<ChainState>,
    /// SHA-256 of the images that it needs, by frame.
    pub images: BTreeMap<usize, String>,
}

impl Kept {
    /// The states after every so many frames stay: their dozen numbers per node are then few beside the fields.
    const STAYS: usize = 20;

    /// Where the state after frame `number` lies in the folder of the run.
    pub fn name(number: usize) -> String {
        format!("{}/{number:06}.npz", RunFolder::CHAIN)
    }

    /// The image of frame `number`, whose file is `frame`, as it was when the frame was done.
    /// Errors: an image that cannot be read any more or is another one: the frames that follow would not be those of
    /// this run.
    pub fn image(
        &self,
        number: usize,
        frame: Option<&Frame>,
        accepted: Accepted,
    ) -> std::result::Result<Arc<Image>, String> {
        let frame = frame.ok_or_else(|| format!("frame {number} is not known: this is a bug in quadrille"))?;
        let about = format!("frame {number} ({frame}) is the reference of frames to come");
        let loaded =
            frame.read(accepted).map_err(|error| format!("{about} and is needed to go on: {}", chain(&error)))?;
        match self.images.get(&number) {
            Some(sha256) if *sha256 == loaded.sha256 => Ok(Arc::new(loaded.image)),
            _ => Err(format!("{about}, and its image has changed: bring it back, or begin anew with --overwrite")),
        }
    }

    /// The last state after one of the frames up to `number` that is whole, or that before the first frame.
    pub fn last(folder: &Path, number: usize, update: UpdateReference, mesh: &Mesh<Px>) -> Self {
        let whole = |number| Self::read(folder, number).filter(|kept| kept.goes_with(update, mesh));
        (1..=number).rev().find_map(whole).unwrap_or_default()
    }

    /// Removes the state before the one after frame `number`, once that frame is done.
    pub fn remove_before(folder: &Path, number: usize) {
        let before = number - 1;
        if !before.is_multiple_of(Self::STAYS) {
            let _ = fs::remove_file(folder.join(Self::name(before))); // it is in nobody's way
        }
    }

    /// Removes the states in `folder` that a run does not need that goes on after frame `number`.
    pub fn tidy(folder: &Path, number: usize) {
        for entry in fs::read_dir(folder.join(RunFolder::CHAIN)).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let of =
                name.to_str().and_then(|name| name.strip_suffix(".npz")).and_then(|name| name.parse::<usize>().ok());
            let stays = of.is_some_and(|of| of == number || (of < number && of.is_multiple_of(Self::STAYS)));
            if !stays {
                let _ = fs::remove_file(entry.path()); // a later one takes its place
            }
        }
    }

    /// Writes it, every number with all of its bits.
    pub fn write<W: Write + Seek>(&self, out: W) -> io::Result<()> {
        let mut file = NpzWriter::new(out);
        let mut put = |name: &str, components, values| file.table(name, components, &values).map_err(io::Error::other);
        let ChainState { reference, last, before, baseline, updates, refused } = &*self.state;
        put("frame", 1, whole([self.number]))?;
        for (name, key) in [("reference", reference), ("last", last)] {
            let Some(Keyframe { frame, displacement, elements, variance, model_error, transfer }) = key else {
                continue;
            };
            put(&format!("{name}_frame"), 1, whole([*frame]))?;
            put(&format!("{name}_displacement_px"), 2, pairs(displacement))?;
            put(&format!("{name}_elements"), 1, Values::U8(elements.iter().copied().map(u8::from).collect()))?;
            put(&format!("{name}_variance_px2"), 2, pairs(variance))?;
            put(&format!("{name}_model_error_px"), 2, pairs(model_error))?;
            let transfer: Vec<[f64; 2]> = transfer.iter().map(|transfer| [transfer.gain, transfer.offset]).collect();
            put(&format!("{name}_transfer"), 2, pairs(&transfer))?;
        }
        if let Some((frame, displacement)) = before {
            put("before_frame", 1, whole([*frame]))?;
            put("before_displacement_px", 2, pairs(displacement))?;
        }
        if let Some(baseline) = baseline {
            put("baseline", 1, Values::F64(baseline.clone()))?;
        }
        put("updates", 1, whole(updates.iter().copied()))?;
        put("refused", 1, whole(refused.iter().copied()))?;
        put("image_frame", 1, whole(self.images.keys().copied()))?;
        put("image_sha256", 1, Values::U8(self.images.values().flat_map(|sha256| sha256.bytes()).collect()))?;
        file.finish().map_err(io::Error::other)?.flush()
    }

    /// The state after frame `number`; `None` when there is none, or not all of it.
    fn read(folder: &Path, number: usize) -> Option<Self> {
        let file = File::open(folder.join(Self::name(number))).ok()?;
        Self::parse(BufReader::new(file)).filter(|kept| kept.number == number)
    }

    pub(crate) fn parse(from: impl Read + Seek) -> Option<Self> {
        let mut arrays = Arrays(read_npz(from).ok()?);
        let mut keyframe = |name: &str| -> Option<Option<Keyframe>> {
            let Some(frame) = arrays.one(&format!("{name}_frame")) else { return Some(None) };
            let transfer = arrays.pairs(&format!("{name}_transfer"))?;
            Some(Some(Keyframe {
                frame,
                displacement: arrays.pairs(&format!("{name}_displacement_px"))?,
                elements: arrays.bytes(&format!("{name}_elements"))?.into_iter().map(|shown| shown != 0).collect(),
                variance: arrays.pairs(&format!("{name}_variance_px2"))?,
                model_error: arrays.pairs(&format!("{name}_model_error_px"))?,
                transfer: transfer.into_iter().map(|[gain, offset]| GreyTransfer { gain, offset }).collect(),
            }))
        };
        let (reference, last) = (keyframe("reference")?, keyframe("last")?);
        let before = match arrays.one("before_frame") {
            Some(frame) => Some((frame, arrays.pairs("before_displacement_px")?)),
            None => None,
        };
        let (baseline, updates) = (arrays.floats("baseline"), arrays.whole("updates")?);
        let refused = arrays.whole("refused")?.first().copied();
        let frames = arrays.whole("image_frame")?;
        let sha256 = String::from_utf8(arrays.bytes("image_sha256")?).ok()?;
        let each = sha256.len().checked_div(frames.len()).unwrap_or(0);
        let images =
            frames.iter().enumerate().map(|(k, &frame)| Some((frame, sha256.get(k * each..(k + 1) * each)?.into())));
        let images = images.collect::<Option<_>>()?;
        let state = Arc::new(ChainState { reference, last, before, baseline, updates, refused });
        let kept = Self { number: arrays.one("frame")?, state, images };
        // An array whose name was damaged would be missed without a word.
        arrays.0.is_empty().then_some(kept)
    }

    /// Whether it can be of such a run.
    pub(crate) fn goes_with(&self, update: UpdateReference, mesh: &Mesh<Px>) -> bool {
        let ChainState { reference, last, updates, .. } = &*self.state;
        let frame = |key: &Option<Keyframe>| key.as_ref().map_or(0, |key| key.frame);
        self.state.check(mesh).is_ok()
            && frame(reference) <= frame(last)
            && frame(last) <= self.number
            && updates.last().copied().unwrap_or(0) == frame(reference)
            && self.images.keys().copied().eq(self.state.frames_needed(update))
    }
}

fn whole(numbers: impl IntoIterator<Item = usize>) -> Values {
    Values::U32(numbers.into_iter().map(|number| number as u32).collect())
}

fn pairs(pairs: &[[f64; 2]]) -> Values {
    Values::F64(pairs.as_flattened().to_vec())
}

/// Arrays that were read, each to be taken once.
struct Arrays(BTreeMap<String, Values>);

impl Arrays {
    fn floats(&mut self, name: &str) -> Option<Vec<f64>> {
        let Values::F64(values) = self.0.remove(name)? else { return None };
        Some(values)
    }

    fn pairs(&mut self, name: &str) -> Option<Vec<[f64; 2]>> {
        let values = self.floats(name)?;
        let (pairs, []) = values.as_chunks::<2>() else { return None };
        Some(pairs.to_vec())
    }

    fn bytes(&mut self, name: &str) -> Option<Vec<u8>> {
        let Values::U8(values) = self.0.remove(name)? else { return None };
        Some(values)
    }

    fn whole(&mut self, name: &str) -> Option<Vec<usize>> {
        let Values::U32(values) = self.0.remove(name)? else { return None };
        Some(values.into_iter().map(|value| value as usize).collect())
    }

    fn one(&mut self, name: &str) -> Option<usize> {
        self.whole(name)?.first().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn kept() -> Kept {
        let key = |frame: usize| Keyframe {
            frame,
            displacement: vec![[0.1 + frame as f64, -0.0], [1e-310, f64::INFINITY]],
            elements: vec![true, false, true],
            variance: vec![[1.0 / 3.0, 2e-5], [0.0, 1e300]],
            model_error: vec![[0.125, 1e-7], [0.0, 3.0]],
            transfer: vec![GreyTransfer { gain: 1.01, offset: -0.7 }],
        };
        let state = ChainState {
            reference: Some(key(5)),
            last: Some(key(7)),
            before: Some((6, vec![[2.5, 0.1]])),
            baseline: Some(vec![1.25, 0.0]),
            updates: vec![3, 5],
            refused: Some(4),
        };
        Kept { number: 8, state: Arc::new(state), images: [(5, "0a".into()), (7, "1b".into())].into() }
    }

    fn written(kept: &Kept) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        kept.write(&mut file).unwrap();
        file.into_inner()
    }

    #[test]
    fn what_is_kept_is_read_with_every_bit() {
        let chain = |change: &dyn Fn(&mut ChainState)| {
            let mut state = (*kept().state).clone();
            change(&mut state);
            Kept { state: Arc::new(state), ..kept() }
        };
        for kept in [
            Kept::default(),
            kept(),
            chain(&|state| (state.reference, state.updates) = (None, Vec::new())),
            chain(&|state| (state.before, state.baseline, state.refused) = (None, None, None)),
        ] {
            let bytes = written(&kept);
            let read = Kept::parse(Cursor::new(&bytes)).unwrap();
            assert_eq!(read, kept);
            assert!(written(&read) == bytes, "-0 equals 0, its bits do not");
        }
    }

    #[test]
    fn a_changed_or_cut_file_is_nothing_or_the_same() {
        let (kept, bytes) = (kept(), written(&kept()));
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1 << (at % 8);
            let read = Kept::parse(Cursor::new(changed));
            assert!(read.is_none_or(|read| read == kept), "byte {at} of {}", bytes.len());
            assert!(Kept::parse(Cursor::new(&bytes[..at])).is_none(), "cut at {at}");
        }
    }
}
