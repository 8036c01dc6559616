//! What a user sees of a long run, on stderr.

use super::plural;
use crate::field::Status;
use crate::report::summary::FrameSummary;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::json;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// How much is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Talk {
    Quiet,
    Normal,
    Verbose,
    /// One JSON object a line.
    Json,
}

/// Time that one thread has spent with something, for others to see.
#[derive(Debug, Default)]
pub(super) struct Spent(AtomicU64);

impl Spent {
    pub fn add(&self, time: Duration) {
        self.0.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }

    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// How much the stages of a run have had to do, in seconds of their threads.
#[derive(Debug, Clone)]
pub(super) struct Busy {
    decode: f64,
    correlate: f64,
    write: f64,
    /// Without anything to do.
    camera: f64,
    /// Frames that are decoded, and that are correlated, at a time.
    widths: [f64; 2],
}

impl Busy {
    pub fn new(n_decoders: usize, in_flight: usize) -> Self {
        Self { decode: 0.0, correlate: 0.0, write: 0.0, camera: 0.0, widths: [n_decoders as f64, in_flight as f64] }
    }

    /// Adds a frame; `writing` and `waiting` for a camera are those of all frames so far.
    pub fn add(&mut self, frame: &FrameSummary, writing: Duration, waiting: Duration) {
        self.decode += frame.seconds_decode;
        self.correlate += frame.seconds;
        self.write = writing.as_secs_f64();
        self.camera = waiting.as_secs_f64();
    }

    /// The seconds of each stage, for each of the frames that it does at a time.
    fn stages(&self) -> [(&'static str, f64); 4] {
        let [decoders, in_flight] = self.widths;
        [
            ("correlate", self.correlate / in_flight),
            ("decode", self.decode / decoders),
            ("write", self.write),
            ("camera", self.camera),
        ]
    }

    /// How busy each stage was in a run of `seconds`, percent; of one without a camera.
    pub fn percent_of(&self, seconds: f64) -> [(&'static str, f64); 3] {
        let [correlate, decode, write, _] = self.stages();
        [correlate, decode, write].map(|(name, busy)| (name, 100.0 * busy / seconds))
    }

    /// The stage that the others wait for: the one that has had most to do for its width.
    pub fn limiting(&self) -> &'static str {
        let stages = self.stages();
        stages.into_iter().fold(stages[0], |most, stage| if stage.1 > most.1 { stage } else { most }).0
    }
}

/// Progress of a series: a bar on a terminal, else a plain line now and then.
pub(super) struct Progress {
    talk: Talk,
    bar: ProgressBar,
    terminal: bool,
    /// None when nobody knows how many there will be.
    total: Option<usize>,
    /// Frames that were done before, that are done now, and that did not converge.
    before: usize,
    done: usize,
    failed: usize,
    begin: Instant,
    last_line: Instant,
}

/// Seconds between two plain lines.
const EVERY: Duration = Duration::from_secs(5);
/// Seconds between two lines for programs.
const EVERY_JSON: Duration = Duration::from_secs(1);

impl Progress {
    /// Of `total` frames (none: as many as come), `before` of which are done.
    pub fn new(talk: Talk, total: Option<usize>, before: usize) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = total.map_or_else(ProgressBar::no_length, |total| ProgressBar::new(total as u64));
        let bar = bar.with_position(before as u64);
        bar.reset_eta(); // the frames of before were not done now
        if matches!(talk, Talk::Quiet | Talk::Json) || !terminal {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let template = match total {
            Some(_) => "{bar:30} {pos}/{len} frames  {rate}  {eta} left",
            None => "{spinner} {pos} frames  {rate}",
        };
        let rate = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            // Nowhere to report a failed write of the bar to.
            let _ = write!(out, "{:.1} frames/s", state.per_sec());
        };
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.with_key("rate", rate));
        let now = Instant::now();
        Self { talk, bar, terminal, total, before, done: 0, failed: 0, begin: now, last_line: now }
    }

    /// A line about the run as a whole.
    pub fn say(&self, line: &str) {
        if self.talk != Talk::Quiet {
            self.print(line);
        }
    }

    fn print(&self, line: &str) {
        if self.talk == Talk::Json {
            eprintln!("{}", json!({ "message": line }));
        } else if self.terminal {
            self.bar.suspend(|| eprintln!("{line}"));
        } else {
            eprintln!("{line}");
        }
    }

    /// One more frame is done.
    pub fn frame(&mut self, frame: &FrameSummary, busy: &Busy) {
        let fine = frame.status == Status::Converged;
        self.done += 1;
        self.failed += usize::from(!fine);
        self.bar.set_position((self.before + self.done) as u64);
        if self.talk == Talk::Verbose || (!fine && self.talk == Talk::Normal) {
            self.print(&line(frame));
        }
        let now = self.before + self.done;
        // The last one before a pause of unknown length shall not be held back.
        let always = self.talk == Talk::Json && (self.done == 1 || self.total.is_none_or(|total| now == total));
        let every = if self.talk == Talk::Json { EVERY_JSON } else { EVERY };
        if self.last_line.elapsed() < every && !always {
            return;
        }
        self.last_line = Instant::now();
        let rate = self.done as f64 / self.begin.elapsed().as_secs_f64();
        let left = self.total.map(|total| (total - now) as f64 / rate);
        if self.talk == Talk::Json {
            let line = json!({
                "done": now,
                "total": self.total,
                "failed": self.failed,
                "frames_per_second": rate,
                "seconds_left": left,
                "limited_by": busy.limiting(),
                "frame": frame.number,
                "status": frame.status.name(),
                "residual_grey": frame.residual_grey,
            });
            eprintln!("{line}");
        } else if self.talk != Talk::Quiet && !self.terminal {
            let of = self.total.map_or(String::new(), |total| format!(" of {total}"));
            let left = left.map_or(String::new(), |left| format!(", {left:.0} s left"));
            eprintln!("{now}{of} frames, {rate:.1} frames/s{left}");
        }
    }

    /// The closing table of all frames; this run took `seconds`.
    pub fn finish(&self, frames: &[FrameSummary], seconds: f64) {
        self.bar.finish_and_clear();
        if matches!(self.talk, Talk::Quiet | Talk::Json) {
            return;
        }
        const SHOWN: usize = 30;
        eprintln!(
            "frame  status           it.  correction  residual  residual   u_x mean   u_y mean  rotation  misfit     model"
        );
        eprintln!(
            "                                     px      grey         %         px         px       deg       %  error px"
        );
        for frame in frames.iter().take(SHOWN) {
            eprintln!("{}", row(frame));
        }
        if frames.len() > SHOWN {
            eprintln!("... {} more in summary.json", frames.len() - SHOWN);
        }
        if let Some(line) = about_misfit(frames) {
            eprintln!("{line}");
        }
        let counts = crate::report::summary::counts(frames);
        let counts: Vec<_> = counts.iter().map(|(status, n)| format!("{n} {}", status.replace('_', " "))).collect();
        let rate = self.done as f64 / seconds;
        let n_frames = plural(frames.len(), "frame");
        eprintln!("{n_frames} in {seconds:.1} s ({rate:.1} frames/s): {}", counts.join(", "));
    }
}

fn row(frame: &FrameSummary) -> String {
    let status = frame.status.name().replace('_', " ");
    let number = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    let motion = frame.rigid_motion.as_ref();
    format!(
        "{:5}  {status:15}  {:3}  {:>10}  {:>8}  {:>8}  {:>9}  {:>9}  {:>8}  {:>6}  {:>8}",
        frame.number,
        frame.iterations,
        frame.correction_px.map_or("-".to_owned(), |v| format!("{v:.1e}")),
        number(frame.residual_grey, 3),
        number(frame.residual_percent, 2),
        number(motion.map(|m| m.translation_px[0]), 4),
        number(motion.map(|m| m.translation_px[1]), 4),
        number(motion.map(|m| m.rotation_deg), 4),
        number(frame.model_error.map(|_| frame.misfit.map_or(0.0, |misfit| misfit.percent)), 1),
        number(frame.model_error.map(|error| error.rms_px), 4),
    )
}

/// The frame with most misfit in words, and how many have some.
fn about_misfit(frames: &[FrameSummary]) -> Option<String> {
    let with = || frames.iter().filter_map(|frame| Some((frame.number, frame.misfit?)));
    let (number, most) = with().max_by(|a, b| a.1.percent.total_cmp(&b.1.percent))?;
    let advice = "smaller elements follow shorter waves; over a crack, a blur or a shadow none do; model_error_px holds the \
                  estimated error";
    Some(format!("{} with misfit, most in frame {number}: {most}; {advice}", plural(with().count(), "frame")))
}

/// One frame in words.
fn line(frame: &FrameSummary) -> String {
    let mut text = format!("frame {} ({}): {}", frame.number, frame.file, frame.status.name().replace('_', " "));
    if let Some(correction) = frame.correction_px {
        text.push_str(&format!(", {} iterations, correction {correction:.1e} px", frame.iterations));
        if let (false, Some([x, y])) = (frame.status == Status::Converged, frame.correction_at_px) {
            text.push_str(&format!(" (largest at x {x}, y {y} px)"));
        }
    }
    if let Some(residual) = frame.residual_percent {
        text.push_str(&format!(", residual {residual:.2} %"));
    }
    for (n, what) in
        [(frame.nodes_left_image, "nodes outside the image"), (frame.elements_poor, "elements that do not match")]
    {
        if n > 0 {
            text.push_str(&format!(", {n} {what}"));
        }
    }
    if let Some(misfit) = frame.misfit {
        text.push_str(&format!("; {misfit}"));
    }
    for message in &frame.messages {
        text.push_str("; ");
        text.push_str(message);
    }
    text
}
