//! The frames of a run on their way: decoded ahead, brought to the device ahead, correlated, handed over.

use super::engine::{Engine, Failure};
use super::error::{Result, RunError, thread};
use super::kept::Kept;
use super::relay::{Known, Relay, Turn};
use super::stop::Stop;
use super::text::chain;
use crate::correlate::{
    Correlate, Correlation, History, Overlap, ReferenceChain, Start, StartUsed, UpdateRefused, Uploaded,
};
use crate::field::{StartFrom, Status, UpdateReference};
use crate::imaging::{Blank, FlatBlocks, Image, Saturation};
use crate::io::images::{Accepted, Loaded, PagedFile, ReadError};
use crate::io::series::Frame;
use crate::io::watch::read_whole;
use crate::report::summary::FrameSummary;
use rayon::{ThreadPool, ThreadPoolBuilder};
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
/// Tracked frames at a time: half as many as there are threads and one more, and so many at most. While one iterates on all threads,
/// uncertainty and marks of those before it are computed by a thread for each.
const TRACKED: usize = 8;
/// Threads that write at most: of many threads one in four.
const WRITERS: usize = 4;
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
    /// What is known before frame `number`, with the frames since `known` that were done before.
    fn caught_up(&self, known: &Known, number: usize) -> Result<Known> {
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

/// Frames that each stage of a run does at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Widths {
    pub decoded: usize,
    pub correlated: usize,
    pub written: usize,
}

/// How many frames are done at a time.
pub(super) fn widths(engine: &Engine, pool: &ThreadPool, start: StartFrom, update: UpdateReference) -> Widths {
    let threads = pool.current_num_threads();
    let [width, height] = engine.correlator().reference().size();
    let decoded = decoders(engine.is_on_cpu(), threads, width * height);
    let writers = (threads / 4).clamp(1, WRITERS);
    match (start, update) {
        // Which reference a frame has is known when all is known of the one before, and what it keeps replaces what that one kept.
        (_, UpdateReference::Residual | UpdateReference::Every(_)) => Widths { decoded, correlated: 1, written: 1 },
        (StartFrom::Independent, _) => {
            Widths { decoded, correlated: engine.correlator().frames_in_flight(), written: writers }
        }
        // One thread alone does one after the other.
        (StartFrom::Previous, _) if threads == 1 => Widths { decoded, correlated: 1, written: writers },
        (StartFrom::Previous, _) => Widths { decoded, correlated: (threads / 2 + 1).min(TRACKED), written: writers },
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
pub(super) type Numbered = (usize, Frame);

/// Correlates the frames and hands each to `take` when it is done, until that says false: in order when each starts from
/// the one before.
///
/// `next` gives the frames that are to be done, their numbers rising, and none after the last. It may wait for a frame, as
/// long as what it is called with says that it is wanted.
pub(super) fn run(
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
            let (uploaded, out, worker) = (uploaded.clone(), out.clone(), Worker::new(frames, relay)?);
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

/// How a worker correlates one frame after the other.
enum Worker<'a> {
    /// Each for itself, with the reference given.
    Independent,
    /// Each from where those before it are, with the reference given; the thread does what others do not share.
    Tracking(&'a Relay, ThreadPool),
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
    seconds: f64,
    /// Whether it was predicted from frames before it.
    tracked: bool,
    /// Whether it is the first with its reference.
    renewed: bool,
    refused: Vec<UpdateRefused>,
}

/// What a frame that is done hands on to the next one.
struct Handing<'a> {
    turn: Turn<'a>,
    known: Known,
    number: usize,
    start: Option<Start>,
}

impl Handing<'_> {
    fn on(self) {
        self.turn.done(&self.known, self.number, self.start);
    }
}

impl<'a> Worker<'a> {
    fn new(frames: &'a Frames<'a>, relay: &'a Relay) -> Result<Self> {
        Ok(match (frames.start, frames.update) {
            (StartFrom::Independent, UpdateReference::Never) => Self::Independent,
            (StartFrom::Previous, UpdateReference::Never) => {
                let own = ThreadPoolBuilder::new().num_threads(1).build();
                Self::Tracking(relay, own.map_err(|error| RunError::Threads(std::io::Error::other(error)))?)
            }
            _ => {
                let file = |&number: &usize| Some((number, frames.known.get(number - 1)?.clone()));
                let files = frames.kept.images.keys().filter_map(file).collect();
                Self::Chain(Box::new(Chain { frames, kept: frames.kept.clone(), files, chain: None }))
            }
        })
    }

    /// The turn of the next frame, where there are turns.
    fn turn(&self) -> Option<Turn<'a>> {
        match self {
            Self::Tracking(relay, _) => Some(relay.turn()),
            Self::Independent | Self::Chain(_) => None,
        }
    }

    /// What to keep after frame `number`.
    fn kept(&mut self, number: usize) -> Option<Kept> {
        let Self::Chain(chain) = self else { return None };
        chain.kept.number = number;
        Some(chain.kept.clone())
    }
}

/// Correlates a frame by itself.
fn independent(
    engine: &Engine,
    pool: &ThreadPool,
    number: usize,
    Picture { image, uploaded, .. }: Picture,
) -> std::result::Result<Correlated, Failure> {
    let begin = Instant::now();
    let (result, correlator) = engine.correlate(pool, number, &image, uploaded, |_, correlator, frame| {
        Ok(pool.install(|| correlator.correlate_uploaded(frame, None))?)
    })?;
    let seconds = begin.elapsed().as_secs_f64();
    Ok(Correlated { result, correlator, seconds, tracked: false, renewed: false, refused: Vec::new() })
}

/// Correlates a frame in its turn, and what it was predicted from.
fn tracked(
    engine: &Engine,
    [pool, own]: [&ThreadPool; 2],
    frames: &Frames<'_>,
    turn: &Turn<'_>,
    number: usize,
    Picture { image, mut uploaded, .. }: Picture,
) -> std::result::Result<(Correlated, Known), Failure> {
    let mut forecast = turn.forecast().ok_or(Failure::Over)?;
    loop {
        let known = frames.caught_up(&forecast, number)?;
        let (mut tracked, mut seconds) = (false, 0.0);
        let done = engine.correlate(pool, number, &image, uploaded.take(), |_, correlator, frame| {
            let begin = Instant::now();
            let result = own.install(|| {
                let start = known.history.predict(number, correlator.mesh());
                tracked = start.is_some();
                let mut tell = |start| turn.tell(&known, number, start);
                correlator.correlate_in_series(frame, start.as_ref(), &mut Overlap::new(pool, &mut tell))
            });
            seconds = begin.elapsed().as_secs_f64();
            let before = turn.known().ok_or(Failure::Over)?;
            if !Arc::ptr_eq(&before, &forecast) {
                return Err(Failure::BegunElsewhere);
            }
            Ok(result?)
        });
        match done {
            Err(Failure::BegunElsewhere) => forecast = turn.known().ok_or(Failure::Over)?,
            done => {
                let (result, correlator) = done?;
                let refused = Vec::new();
                return Ok((Correlated { result, correlator, seconds, tracked, renewed: false, refused }, known));
            }
        }
    }
}

impl Chain<'_> {
    fn correlate(
        &mut self,
        engine: &Engine,
        pool: &ThreadPool,
        number: usize,
        file: Frame,
        Picture { image, sha256, uploaded, .. }: Picture,
    ) -> std::result::Result<Correlated, Failure> {
        let begin = Instant::now();
        let Self { frames: Frames { update, accepted, .. }, kept, files, chain } = self;
        let mut refused = Vec::new();
        let mut work = |generation, correlator: &Arc<dyn Correlate>, frame| {
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
        };
        let work =
            |generation, correlator: &Arc<dyn Correlate>, frame| pool.install(|| work(generation, correlator, frame));
        let (result, correlator) = engine.correlate(pool, number, &image, uploaded, work)?;
        let seconds = begin.elapsed().as_secs_f64();
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
        Ok(Correlated { result, correlator, seconds, tracked, renewed, refused })
    }
}

/// Correlates frames as they come.
fn correlate<'a>(
    engine: &Engine,
    pool: &ThreadPool,
    (frames, mut worker): (&Frames<'_>, Worker<'a>),
    uploaded: &Mutex<Receiver<Decoded>>,
    out: &SyncSender<Result<Done>>,
) {
    while !frames.stop.is_asked() {
        // Turns are those of the frames: both are taken together.
        let next = {
            let given = uploaded.lock().unwrap_or_else(PoisonError::into_inner);
            given.recv().map(|decoded| (decoded, worker.turn()))
        };
        let Ok((decoded, turn)) = next else { return };
        let number = decoded.number;
        let (done, handing) = match one_frame(engine, pool, (frames, &mut worker), decoded, turn) {
            Ok((done, handing)) => (Ok(Done { kept: worker.kept(number), ..done }), handing),
            Err(Failure::Over) => return,
            Err(failure) => (Err(failure.into()), None),
        };
        if out.send(done).is_err() {
            return; // nobody wants more
        }
        // Only now, so that frames come out in their order.
        handing.into_iter().for_each(Handing::on);
    }
}

/// Correlates one frame. A frame that cannot be used is a result with its reason.
fn one_frame<'a>(
    engine: &Engine,
    pool: &ThreadPool,
    (frames, worker): (&Frames<'_>, &mut Worker<'a>),
    decoded: Decoded,
    turn: Option<Turn<'a>>,
) -> std::result::Result<(Done, Option<Handing<'a>>), Failure> {
    let Decoded { number, frame: source, loaded, saturation, blank, seconds: seconds_decode } = decoded;
    let file = source.to_string();
    // What has no field hands on what is known before it.
    let without_field = |turn: Option<Turn<'a>>| -> std::result::Result<_, Failure> {
        let Some(turn) = turn else { return Ok(None) };
        let known = frames.caught_up(&*turn.known().ok_or(Failure::Over)?, number)?;
        Ok(Some(Handing { turn, known, number, start: None }))
    };
    let mut picture = match loaded {
        Ok(picture) => picture,
        Err(error) => {
            let done = Done::unreadable(None, number, file, chain(&error), seconds_decode);
            return Ok((done, without_field(turn)?));
        }
    };
    let (sha256, taken) = (Some(picture.sha256.clone()), picture.taken.take());
    let mut notes = std::mem::take(&mut picture.notes);
    let correlated = match (worker, &turn) {
        (Worker::Tracking(_, own), Some(turn)) => tracked(engine, [pool, own], frames, turn, number, picture)
            .map(|(correlated, known)| (correlated, Some(known))),
        (Worker::Chain(chain), _) => {
            chain.correlate(engine, pool, number, source, picture).map(|correlated| (correlated, None))
        }
        _ => independent(engine, pool, number, picture).map(|correlated| (correlated, None)),
    };
    match correlated {
        Ok((Correlated { result, correlator, seconds, tracked, renewed, refused }, known)) => {
            notes.extend(about_tracking(&result).filter(|_| tracked).map(str::to_owned));
            let refused: Vec<String> = refused.iter().map(|refused| chain(refused)).collect();
            notes.extend(refused.iter().cloned());
            let mut news = refused;
            if renewed {
                let reference = result.reference_frame;
                news.push(format!("frame {number}: measured from frame {reference}, the new reference"));
            }
            engine.note_colour(number, &result);
            let mut summary = FrameSummary::of(number, file, notes, &correlator, &result, [seconds, seconds_decode]);
            let device = correlator.device();
            summary.taken = taken;
            summary.device = (device != engine.first_device()).then(|| device.to_owned());
            let summary = summary.with_saturation(saturation).with_blank(blank);
            let start = result.next_start();
            let handing = turn.zip(known).map(|(turn, known)| Handing { turn, known, number, start });
            Ok((Done { sha256, summary, result: Some(result), news, kept: None }, handing))
        }
        Err(Failure::Correlation(error)) if error.is_of_the_frame() => {
            let message = format!("{file}: {}", chain(&error));
            Ok((Done::unreadable(sha256, number, file, message, seconds_decode), without_field(turn)?))
        }
        Err(failure) => Err(failure),
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
