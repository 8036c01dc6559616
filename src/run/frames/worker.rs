//! Those who correlate the frames of a run as they come: each frame for itself, each in its turn, or with a reference
//! that is renewed.

use crate::correlate::{Correlate, Correlation, Overlap, ReferenceChain, Start, UpdateRefused};
use crate::field::{StartFrom, UpdateReference};
use crate::io::images::ReadError;
use crate::io::series::Frame;
use crate::remark::Remark;
use crate::report::summary::FrameSummary;
use crate::run::folder::Kept;
use crate::run::frames::engine::Tried;
use crate::run::frames::relay::{Known, Relay, Turn};
use crate::run::frames::{Decoded, Done, Engine, Failure, Frames, Picture};
use crate::run::words::remarks::{of_image, of_tracking, reference_refused};
use crate::run::words::{Result, RunError, chain};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// How a worker correlates one frame after the other.
pub(crate) enum Worker<'a> {
    /// Each for itself, with the reference given.
    Independent,
    /// Each from where those before it are, with the reference given; a thread of its own does what others do not
    /// share, where those of the pool wait for a graphics device.
    Tracking(&'a Relay, Option<ThreadPool>),
    /// With a reference that is renewed.
    Chain(Box<Chain<'a>>),
}

/// A chain of references and what it is made of again when its device has failed.
pub(crate) struct Chain<'a> {
    frames: &'a Frames<'a>,
    kept: Kept,
    /// The files of the frames that it needs the images of.
    files: BTreeMap<usize, Frame>,
    /// With the generation of its correlator; none before the first frame.
    chain: Option<(usize, ReferenceChain)>,
}

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
        self.turn.end_frame(&self.known, self.number, self.start);
    }
}

impl<'a> Worker<'a> {
    pub fn new(engine: &Engine, frames: &'a Frames<'a>, relay: &'a Relay) -> Result<Self> {
        Ok(match (frames.start, frames.update) {
            (StartFrom::Independent, UpdateReference::Never) => Self::Independent,
            (StartFrom::Previous, UpdateReference::Never) => {
                let own = || ThreadPoolBuilder::new().num_threads(1).build();
                let own = (!engine.is_on_cpu()).then(own).transpose();
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
    fn take_kept(&mut self, number: usize) -> Option<Kept> {
        let Self::Chain(chain) = self else { return None };
        chain.kept.number = number;
        Some(chain.kept.clone())
    }
}

fn independent(
    engine: &Engine,
    pool: &ThreadPool,
    number: usize,
    Picture { image, uploaded, .. }: Picture,
) -> Tried<Correlated> {
    let begin = Instant::now();
    let (result, correlator) = engine.correlate(pool, number, &image, uploaded, |_, correlator, frame| {
        Ok(pool.install(|| correlator.correlate_uploaded(frame, None))?)
    })?;
    let seconds = begin.elapsed().as_secs_f64();
    Ok(Correlated { result, correlator, seconds, tracked: false, renewed: false, refused: Vec::new() })
}

/// Correlates a frame in its turn, and what it was predicted from.
fn track(
    engine: &Engine,
    (pool, own): (&ThreadPool, Option<&ThreadPool>),
    frames: &Frames<'_>,
    turn: &Turn<'_>,
    number: usize,
    Picture { image, mut uploaded, .. }: Picture,
) -> Tried<(Correlated, Known)> {
    let mut forecast = turn.forecast().ok_or(Failure::Over)?;
    loop {
        let known = frames.caught_up(&forecast, number)?;
        let (mut tracked, mut seconds) = (false, 0.0);
        let done = engine.correlate(pool, number, &image, uploaded.take(), |_, correlator, frame| {
            let own = own.filter(|_| !engine.is_on_cpu()).unwrap_or(pool);
            let result = own.install(|| {
                let begin = Instant::now();
                let start = known.history.predict(number, correlator.mesh());
                tracked = start.is_some();
                let mut tell = |start| turn.tell(&known, number, start);
                let result = correlator.correlate_in_series(frame, start.as_ref(), &mut Overlap::new(pool, &mut tell));
                seconds = begin.elapsed().as_secs_f64();
                result
            });
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
    ) -> Tried<Correlated> {
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
pub(crate) fn correlate<'a>(
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
            Ok((done, handing)) => (Ok(Done { kept: worker.take_kept(number), ..done }), handing),
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
) -> Tried<(Done, Option<Handing<'a>>)> {
    let Decoded { number, frame: source, loaded, saturation, blank, seconds: seconds_decode } = decoded;
    let file = source.to_string();
    // What has no field hands on what is known before it.
    let without_field = |turn: Option<Turn<'a>>| -> Tried<_> {
        let Some(turn) = turn else { return Ok(None) };
        let known = frames.caught_up(&*turn.known().ok_or(Failure::Over)?, number)?;
        Ok(Some(Handing { turn, known, number, start: None }))
    };
    let mut picture = match loaded {
        Ok(picture) => picture,
        Err(error) => {
            let mut summary = FrameSummary::unreadable(number, file, chain(&error), seconds_decode);
            if let ReadError::OtherSize { width, height, .. } = error {
                summary.size_px = Some([width, height]);
            }
            return Ok((Done::unreadable(None, summary), without_field(turn)?));
        }
    };
    let (sha256, taken, time_s) = (Some(picture.sha256.clone()), picture.taken.take(), picture.time_s);
    let mut remarks: Vec<Remark> = of_image(number, &picture.notes).into_iter().collect();
    let correlated = match (worker, &turn) {
        (Worker::Tracking(_, own), Some(turn)) => track(engine, (pool, own.as_ref()), frames, turn, number, picture)
            .map(|(correlated, known)| (correlated, Some(known))),
        (Worker::Chain(chain), _) => {
            chain.correlate(engine, pool, number, source, picture).map(|correlated| (correlated, None))
        }
        _ => independent(engine, pool, number, picture).map(|correlated| (correlated, None)),
    };
    match correlated {
        Ok((Correlated { result, correlator, seconds, tracked, renewed, refused }, known)) => {
            remarks.extend(of_tracking(number, &result).filter(|_| tracked));
            let refused: Vec<Remark> = refused.iter().map(|refused| reference_refused(number, refused)).collect();
            let mut news: Vec<String> = refused.iter().map(|remark| remark.text.clone()).collect();
            remarks.extend(refused);
            if renewed {
                let reference = result.reference_frame;
                news.push(format!("frame {number}: measured from frame {reference}, the new reference"));
            }
            engine.remark_colour(number, &result);
            let mut summary = FrameSummary::of(number, file, remarks, &correlator, &result, [seconds, seconds_decode]);
            let device = correlator.device();
            summary.taken = taken;
            summary.time_s = time_s;
            summary.device = (device != engine.first_device()).then(|| device.to_owned());
            let summary = summary.with_saturation(saturation).with_blank(blank);
            let start = result.next_start();
            let handing = turn.zip(known).map(|(turn, known)| Handing { turn, known, number, start });
            Ok((Done { sha256, summary, result: Some(result), news, kept: None }, handing))
        }
        Err(Failure::Correlation(error)) if error.is_of_the_frame() => {
            let message = format!("{file}: {}", chain(&error));
            let summary = FrameSummary::unreadable(number, file, message, seconds_decode);
            Ok((Done::unreadable(sha256, summary), without_field(turn)?))
        }
        Err(failure) => Err(failure),
    }
}
