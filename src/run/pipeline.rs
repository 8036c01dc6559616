//! The frames of a run on their way: decoded ahead, brought to the device ahead, correlated, handed over.

use super::engine::{Engine, Failure};
use super::error::{Result, RunError, thread};
use super::kept::Kept;
use super::stop::Stop;
use super::text::chain;
use crate::correlate::{Correlate, Correlation, History, ReferenceChain, Start, StartUsed, UpdateRefused, Uploaded};
use crate::field::{StartFrom, Status, UpdateReference};
use crate::imaging::{Blank, FlatBlocks, Image, Saturation};
use crate::io::images::{Accepted, Loaded, PagedFile, ReadError};
use crate::io::series::Frame;
use crate::io::watch::read_whole;
use crate::report::summary::FrameSummary;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Decoded images that wait for their turn, per decoding thread.
const AHEAD: usize = 2;
/// Images on the device that wait for theirs.
const UPLOADED: usize = 1;
/// Decoding threads beside the CPU at most: PNG takes 17 ns per pixel, as much as its whole correlation.
const DECODERS: usize = 8;
/// Beside a graphics device, which takes a hundredth of that, as many as there are threads; but images that are decoded and wait hold no
/// more pixels than this (some 4 GB), where they are more than of [`DECODERS`].
const WAITING_PX: usize = 500_000_000;

/// How the deformed images of a run are read and correlated.
#[derive(Clone, Copy)]
pub(super) struct Frames<'a> {
    /// Those that are known at the start, from number 1 on.
    pub known: &'a [Frame],
    /// How long a file must have been the same, when they are being written: one that is not whole is waited for.
    pub settle: Option<Duration>,
    /// What an image may be: of the size of the reference.
    pub accepted: Accepted,
    /// The rectangles that hold the zones, px: x0, y0, x1, y1.
    pub windows: &'a [[usize; 4]],
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
    /// Lets `history` know the frames between `after` and `before` that were done before.
    fn catch_up(&self, history: &mut History, after: usize, before: usize) -> Result<()> {
        if self.start == StartFrom::Independent {
            return Ok(());
        }
        let mut found = Vec::new();
        for number in (after + 1..before).rev() {
            found.extend((self.stored)(number)?.map(|start| (number, start)));
            if found.len() == History::FIELDS {
                break;
            }
        }
        found.into_iter().rev().for_each(|(number, start)| history.note_field(number, start));
        Ok(())
    }
}

/// A frame that was read, or not.
struct Decoded {
    number: usize,
    frame: Frame,
    loaded: std::result::Result<Picture, ReadError>,
    saturation: Option<Saturation>,
    blank: Option<Blank>,
    seconds: f64,
}

/// An image with what is known of its file, brought to the device if that went well.
struct Picture {
    image: Arc<Image>,
    sha256: String,
    taken: Option<String>,
    notes: Vec<String>,
    /// With the generation of its correlator.
    uploaded: Option<(usize, Uploaded)>,
}

/// A frame that is done.
pub(super) struct Done {
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
    fn unreadable(sha256: Option<String>, number: usize, file: String, message: String, seconds_decode: f64) -> Self {
        let summary = FrameSummary::unreadable(number, file, message, seconds_decode);
        Self { sha256, summary, result: None, news: Vec::new(), kept: None }
    }
}

/// Decoding threads and frames correlated at a time.
pub(super) fn widths(engine: &Engine, pool: &rayon::ThreadPool, start: StartFrom) -> (usize, usize) {
    let threads = pool.current_num_threads();
    let [width, height] = engine.correlator().reference().size();
    let n_decoders = decoders(engine.is_on_cpu(), threads, width * height);
    let independent = start == StartFrom::Independent;
    (n_decoders, if independent { engine.correlator().frames_in_flight() } else { 1 })
}

/// Decoding threads for images of so many pixels: a graphics device leaves the cores to them, the CPU shares them.
fn decoders(on_cpu: bool, threads: usize, pixels: usize) -> usize {
    match on_cpu {
        true => (threads / 4).clamp(1, DECODERS),
        false => threads.clamp(1, (WAITING_PX / (pixels.max(1) * (1 + AHEAD))).max(DECODERS)),
    }
}

/// A frame with its number, from 1.
pub(super) type Numbered = (usize, Frame);

/// Correlates the frames and hands each to `take` when it is done, until that says false: in order when each starts from
/// the one before.
///
/// `next` gives the frames that are to be done, their numbers rising, and none after the last. It may wait for a frame, as
/// long as what it is called with says that it is wanted.
pub(super) fn run(
    engine: &Engine,
    pool: &rayon::ThreadPool,
    frames: &Frames<'_>,
    next: impl FnMut(&dyn Fn() -> bool) -> Result<Option<Numbered>> + Send,
    mut take: impl FnMut(Done) -> Result<bool>,
) -> Result<()> {
    let (n_decoders, in_flight) = widths(engine, pool, frames.start);
    let over = AtomicBool::new(false);
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
        thread(scope, move || upload(engine, pool, &decoders, &out))?;
        let uploaded = Arc::new(Mutex::new(uploaded));
        let (out, results) = sync_channel(in_flight);
        for _ in 0..in_flight {
            let (uploaded, out) = (uploaded.clone(), out.clone());
            thread(scope, move || correlate(engine, pool, frames, &uploaded, &out))?;
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

/// Reads frames as they are given.
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
        let loaded = loaded.map(|Loaded { image, sha256, taken, notes, .. }| Picture {
            image: Arc::new(image),
            sha256,
            taken,
            notes,
            uploaded: None,
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
fn upload(engine: &Engine, pool: &rayon::ThreadPool, decoders: &[Receiver<Decoded>], out: &SyncSender<Decoded>) {
    for decoder in decoders.iter().cycle() {
        let Ok(mut decoded) = decoder.recv() else { return }; // the last frame has been
        if let Ok(picture) = &mut decoded.loaded {
            // On the CPU nothing is brought anywhere: no thread of the pool is to be waited for.
            picture.uploaded = match engine.is_on_cpu() {
                true => engine.upload(picture.image.clone()),
                false => pool.install(|| engine.upload(picture.image.clone())),
            };
        }
        if out.send(decoded).is_err() {
            return; // nobody wants more
        }
    }
}

/// How a worker correlates one frame after the other.
enum Worker<'a> {
    /// All of them with the reference given.
    Tracking { history: History, last: usize },
    /// With a reference that is renewed.
    Chain(Box<Chain<'a>>),
}

/// A chain of references and what it is made of again when its device has failed.
struct Chain<'a> {
    frames: &'a Frames<'a>,
    kept: Kept,
    /// The files of the frames that it needs the images of.
    files: BTreeMap<usize, Frame>,
    /// With the generation of its correlator; none before the first frame.
    chain: Option<(usize, ReferenceChain)>,
}

/// A frame that was correlated.
struct Correlated {
    result: Correlation,
    correlator: Arc<dyn Correlate>,
    /// Whether it was predicted from frames before it.
    tracked: bool,
    /// Whether it is the first with its reference.
    renewed: bool,
    refused: Vec<UpdateRefused>,
}

impl<'a> Worker<'a> {
    fn new(frames: &'a Frames<'a>) -> Self {
        match frames.update {
            UpdateReference::Never => Self::Tracking { history: History::new(frames.start), last: 0 },
            _ => {
                let file = |&number: &usize| Some((number, frames.known.get(number - 1)?.clone()));
                let files = frames.kept.images.keys().filter_map(file).collect();
                Self::Chain(Box::new(Chain { frames, kept: frames.kept.clone(), files, chain: None }))
            }
        }
    }

    /// Lets it know the frames before `number` that were done before.
    fn catch_up(&mut self, frames: &Frames<'_>, number: usize) -> Result<()> {
        match self {
            Self::Tracking { history, last } => frames.catch_up(history, std::mem::replace(last, number), number),
            Self::Chain(_) => Ok(()),
        }
    }

    fn correlate(
        &mut self,
        engine: &Engine,
        number: usize,
        file: Frame,
        Picture { image, sha256, uploaded, .. }: Picture,
    ) -> std::result::Result<Correlated, Failure> {
        match self {
            Self::Tracking { history, .. } => {
                let mut tracked = false;
                let (result, correlator) = engine.correlate(number, &image, uploaded, |_, correlator, frame| {
                    let start = history.predict(number, correlator.mesh());
                    tracked = start.is_some();
                    Ok(correlator.correlate_uploaded(frame, start.as_ref())?)
                })?;
                history.note(number, &result);
                let refused = Vec::new();
                Ok(Correlated { result, correlator, tracked, renewed: false, refused })
            }
            Self::Chain(chain) => chain.correlate(engine, number, &image, (file, sha256), uploaded),
        }
    }

    /// What to keep after frame `number`.
    fn kept(&mut self, number: usize) -> Option<Kept> {
        let Self::Chain(chain) = self else { return None };
        chain.kept.number = number;
        Some(chain.kept.clone())
    }
}

impl Chain<'_> {
    fn correlate(
        &mut self,
        engine: &Engine,
        number: usize,
        image: &Arc<Image>,
        (file, sha256): (Frame, String),
        uploaded: Option<(usize, Uploaded)>,
    ) -> std::result::Result<Correlated, Failure> {
        let Self { frames: Frames { update, accepted, .. }, kept, files, chain } = self;
        let mut refused = Vec::new();
        let (result, correlator) = engine.correlate(number, image, uploaded, |generation, correlator, frame| {
            // A chain whose frame has failed is not put back.
            let mut whole = match chain.take() {
                Some((of, chain)) if of == generation => chain,
                _ => ReferenceChain::resume(correlator.clone(), *update, (*kept.state).clone(), |number| {
                    kept.image(number, files.get(&number), *accepted).map_err(Failure::Image)
                })?,
            };
            let result = whole.correlate_uploaded(number, frame)?;
            refused = whole.take_refused();
            *chain = Some((generation, whole));
            Ok(result)
        })?;
        let state = match chain {
            Some((_, chain)) => Arc::new(chain.state()),
            None => kept.state.clone(),
        };
        let tracked = kept.state.last.is_some();
        let renewed = state.updates.len() > kept.state.updates.len();
        kept.images.insert(number, sha256);
        files.insert(number, file);
        let needed = state.frames_needed(*update);
        kept.images.retain(|frame, _| needed.contains(frame));
        files.retain(|frame, _| needed.contains(frame));
        kept.state = state;
        Ok(Correlated { result, correlator, tracked, renewed, refused })
    }
}

/// Correlates frames as they come.
fn correlate(
    engine: &Engine,
    pool: &rayon::ThreadPool,
    frames: &Frames<'_>,
    uploaded: &Mutex<Receiver<Decoded>>,
    out: &SyncSender<Result<Done>>,
) {
    let mut worker = Worker::new(frames);
    while !frames.stop.is_asked() {
        let next = uploaded.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(decoded) = next else { return };
        let number = decoded.number;
        let known = worker.catch_up(frames, number);
        let done = known.and_then(|()| pool.install(|| one_frame(engine, &mut worker, decoded)));
        let done = done.map(|done| Done { kept: worker.kept(number), ..done });
        if out.send(done).is_err() {
            return; // nobody wants more
        }
    }
}

/// Correlates one frame. A frame that cannot be used is a result with its reason.
fn one_frame(engine: &Engine, worker: &mut Worker<'_>, decoded: Decoded) -> Result<Done> {
    let Decoded { number, frame: source, loaded, saturation, blank, seconds: seconds_decode } = decoded;
    let file = source.to_string();
    let mut picture = match loaded {
        Ok(picture) => picture,
        Err(error) => return Ok(Done::unreadable(None, number, file, chain(&error), seconds_decode)),
    };
    let begin = Instant::now();
    let (sha256, taken) = (Some(picture.sha256.clone()), picture.taken.take());
    let mut notes = std::mem::take(&mut picture.notes);
    match worker.correlate(engine, number, source, picture) {
        Ok(Correlated { result, correlator, tracked, renewed, refused }) => {
            notes.extend(about_tracking(&result).filter(|_| tracked).map(str::to_owned));
            let refused: Vec<String> = refused.iter().map(|refused| chain(refused)).collect();
            notes.extend(refused.iter().cloned());
            let mut news = refused;
            if renewed {
                let reference = result.reference_frame;
                news.push(format!("frame {number}: measured from frame {reference}, the new reference"));
            }
            engine.note_colour(number, &result);
            let seconds = [begin.elapsed().as_secs_f64(), seconds_decode];
            let mut summary = FrameSummary::of(number, file, notes, &correlator, &result, seconds);
            let device = correlator.device();
            summary.taken = taken;
            summary.device = (device != engine.first_device()).then(|| device.to_owned());
            let summary = summary.with_saturation(saturation).with_blank(blank);
            Ok(Done { sha256, summary, result: Some(result), news, kept: None })
        }
        Err(Failure::Correlation(error)) if error.is_of_the_frame() => {
            let message = format!("{file}: {}", chain(&error));
            Ok(Done::unreadable(sha256, number, file, message, seconds_decode))
        }
        Err(Failure::Correlation(error)) => Err(error.into()),
        Err(Failure::Image(error)) => Err(error.into()),
    }
}

/// What to say of a frame that was predicted from those before.
fn about_tracking(result: &Correlation) -> Option<&'static str> {
    match (result.measurement.status, result.start) {
        (Status::Converged, StartUsed::Cold) => {
            Some("the start from the frames before failed; searched for without them")
        }
        (Status::Converged, _) => None,
        _ => Some("neither the start from the frames before nor a search without them converged"),
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
