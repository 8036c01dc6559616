//! The frames of a run on their way: decoded ahead, brought to the device ahead, correlated, handed over.

use crate::correlate::History;
use crate::field::{StartFrom, UpdateReference};
use crate::imaging::{FlatBlocks, Saturation};
use crate::io::images::{Accepted, Loaded, PagedFile, ReadError};
use crate::io::series::Frame;
use crate::io::watch::read_whole;
use crate::run::frames::relay::Relay;
use crate::run::frames::worker::{Worker, correlate};
use crate::run::frames::{Decoded, Done, Engine, Frames, Picture};
use crate::run::words::remarks::another_scale;
use crate::run::words::{Result, RunError, thread};
use rayon::ThreadPool;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Decoded images that wait for their turn, per decoding thread.
const AHEAD: usize = 2;
/// Images on the device that wait for theirs.
const UPLOADED: usize = 1;
/// Frames at a time on the CPU, and tracked ones: half as many as there are threads and two more, and so many at most.
/// While one iterates on all threads, uncertainty and marks of those before it are computed by a thread for each; with
/// one frame less a thread has nothing to do at times (3 % of the time of a tracked series on two of them, 5 % where
/// each frame is searched for).
const AT_A_TIME: usize = 8;
/// Threads that write at most: of many threads one in four.
const WRITERS: usize = 4;
/// Decoding threads beside the CPU at most: PNG takes 17 ns per pixel, as much as its whole correlation.
const DECODERS: usize = 8;
/// Beside a graphics device, which takes a hundredth of that, as many as there are threads; but images that are decoded
/// and wait hold no more pixels than this (some 4 GB), where they are more than of [`DECODERS`].
const WAITING_PX: usize = 500_000_000;

/// Frames that each stage of a run does at a time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Widths {
    pub decoded: usize,
    pub correlated: usize,
    pub written: usize,
}

pub(crate) fn widths(engine: &Engine, pool: &ThreadPool, start: StartFrom, update: UpdateReference) -> Widths {
    let threads = pool.current_num_threads();
    let [width, height] = engine.correlator().reference().size();
    let decoded = decoders(engine.is_on_cpu(), threads, width * height);
    let writers = (threads / 4).clamp(1, WRITERS);
    match (start, update) {
        // Which reference a frame has is known when all is known of the one before, and what it keeps replaces what
        // that one kept.
        (_, UpdateReference::Residual | UpdateReference::Every(_)) => Widths { decoded, correlated: 1, written: 1 },
        (StartFrom::Independent, _) if !engine.is_on_cpu() => {
            Widths { decoded, correlated: engine.correlator().frames_in_flight(), written: writers }
        }
        // One thread alone does one after the other.
        _ if threads == 1 => Widths { decoded, correlated: 1, written: writers },
        _ => Widths { decoded, correlated: (threads / 2 + 2).min(AT_A_TIME), written: writers },
    }
}

/// Decoding threads for images of so many pixels: a graphics device leaves the cores to them, the CPU shares them.
fn decoders(on_cpu: bool, threads: usize, pixels: usize) -> usize {
    match on_cpu {
        true => (threads / 4).clamp(1, DECODERS),
        false => threads.clamp(1, (WAITING_PX / (pixels.max(1) * (1 + AHEAD))).max(DECODERS)),
    }
}

/// A frame with its number, from 1.
pub(crate) type Numbered = (usize, Frame);

/// Correlates the frames and hands each to `take` when it is done, until that says false: in order when each starts
/// from the one before.
///
/// `next` gives the frames that are to be done, their numbers rising, and none after the last. It may wait for a frame,
/// as long as what it is called with says that it is wanted.
pub(crate) fn run(
    engine: &Engine,
    pool: &ThreadPool,
    frames: &Frames<'_>,
    next: impl FnMut(&dyn Fn() -> bool) -> Result<Option<Numbered>> + Send,
    mut take: impl FnMut(Done) -> Result<bool>,
) -> Result<()> {
    let Widths { decoded: n_decoders, correlated: in_flight, .. } = widths(engine, pool, frames.start, frames.update);
    let over = AtomicBool::new(false);
    let relay = &Relay::new(History::new(frames.start));
    let wanted = &|| !frames.stop.is_asked() && !over.load(Ordering::SeqCst);
    std::thread::scope(|scope| {
        // Also where the system gives no further thread.
        let _end = End(&over);
        let mut to_read = Vec::with_capacity(n_decoders);
        let decoders: Vec<Receiver<Decoded>> = (0..n_decoders)
            .map(|_| {
                let (handed, given) = sync_channel(AHEAD);
                to_read.push(handed);
                let (out, decoded) = sync_channel(AHEAD);
                thread(scope, move || decode(frames, wanted, &given, &out))?;
                Ok(decoded)
            })
            .collect::<Result<_>>()?;
        let handing = thread(scope, move || hand_out(next, wanted, &to_read))?;
        let (out, uploaded) = sync_channel(UPLOADED);
        thread(scope, move || upload(engine, &decoders, &out))?;
        let uploaded = Arc::new(Mutex::new(uploaded));
        let (out, results) = sync_channel(in_flight);
        for _ in 0..in_flight {
            let (uploaded, out, worker) = (uploaded.clone(), out.clone(), Worker::new(engine, frames, relay)?);
            thread(scope, move || correlate(engine, pool, (frames, worker), &uploaded, &out))?;
        }
        // From here on the workers alone hold both: when they stop, everybody does.
        drop((uploaded, out));
        let mut taken = Ok(true);
        for done in results {
            taken = done.and_then(&mut take);
            if !matches!(taken, Ok(true)) {
                break;
            }
        }
        over.store(true, Ordering::SeqCst);
        let handed = handing.join().map_err(|_| RunError::Bug("what gives the frames stopped"))?;
        taken.and(handed)
    })
}

/// Lets the threads know that it is over.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

/// Gives the frames to those who read them, in turn.
fn hand_out(
    mut next: impl FnMut(&dyn Fn() -> bool) -> Result<Option<Numbered>>,
    wanted: &(dyn Fn() -> bool + Sync),
    readers: &[SyncSender<Numbered>],
) -> Result<()> {
    for reader in readers.iter().cycle() {
        let Some(frame) = next(&wanted)?.filter(|_| wanted()) else { break };
        if reader.send(frame).is_err() {
            break; // nobody wants more
        }
    }
    Ok(())
}

/// Reads frames as they are given: not by the threads of the pool, since a thread of it that waits for a part of a
/// frame may take up any other work, and would keep that frame until a large PNG is decoded.
fn decode(
    frames: &Frames<'_>,
    wanted: &(dyn Fn() -> bool + Sync),
    given: &Receiver<Numbered>,
    out: &SyncSender<Decoded>,
) {
    let mut stack = None;
    for (number, frame) in given {
        if !wanted() {
            return;
        }
        let begin = Instant::now();
        let loaded = match frames.settle {
            Some(settle) => read_whole(&frame, frames.accepted, settle, wanted),
            None => Some(read_frame(&frame, frames.accepted, &mut stack)),
        };
        let Some(loaded) = loaded else { return };
        let saturation = loaded.as_ref().ok().and_then(|loaded| Saturation::of(&loaded.image, frames.windows));
        let flat = loaded.as_ref().ok().map(|loaded| FlatBlocks::of(&loaded.image));
        let blank = flat.and_then(|flat| flat.blank(frames.flat, frames.windows));
        let loaded = loaded.map(|Loaded { image, sha256, taken, time_s, mut notes, .. }| {
            notes.extend(another_scale(&image, frames.range));
            Picture { image: Arc::new(image), sha256, taken, time_s, notes, uploaded: None }
        });
        let seconds = begin.elapsed().as_secs_f64();
        if out.send(Decoded { number, frame, loaded, saturation, blank, seconds }).is_err() {
            return; // nobody wants more
        }
    }
}

/// Reads a frame. A file whose pages are frames stays in `stack` for the next one.
fn read_frame(
    frame: &Frame,
    accepted: Accepted,
    stack: &mut Option<(PathBuf, PagedFile)>,
) -> std::result::Result<Loaded, ReadError> {
    if !frame.is_page {
        return frame.read(accepted);
    }
    match stack {
        Some((path, file)) if *path == frame.path => file.read(frame.page, accepted),
        _ => {
            let (_, file) = stack.insert((frame.path.clone(), PagedFile::open(&frame.path)?));
            file.read(frame.page, accepted)
        }
    }
}

/// Brings the frames to the device, in order, while others are correlated.
fn upload(engine: &Engine, decoders: &[Receiver<Decoded>], out: &SyncSender<Decoded>) {
    for decoder in decoders.iter().cycle() {
        let Ok(mut decoded) = decoder.recv() else { return }; // the last frame has been
        if let Ok(picture) = &mut decoded.loaded {
            // Not on a thread of the pool, which would have to be waited for.
            picture.uploaded = engine.upload(picture.image.clone());
        }
        if out.send(decoded).is_err() {
            return; // nobody wants more
        }
    }
}

#[cfg(test)]
mod tests {
    use super::decoders;

    #[test]
    fn a_graphics_device_has_all_threads_for_decoding_unless_waiting_images_would_fill_the_memory() {
        assert_eq!([1, 4, 16, 64].map(|threads| decoders(true, threads, 1 << 20)), [1, 1, 4, 8]);
        assert_eq!([1, 4, 16, 64].map(|threads| decoders(false, threads, 1 << 22)), [1, 4, 16, 39]);
        assert_eq!(decoders(false, 64, 30_000_000), 8);
    }
}
