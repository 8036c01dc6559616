//! What a user sees of a long run, on stderr.

use super::plural;
use crate::field::Status;
use crate::report::summary::FrameSummary;
use crate::run::{Busy, Event};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::json;
use std::io::IsTerminal;
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
    /// One that has nothing to show yet.
    pub fn new(talk: Talk) -> Self {
        let (bar, now) = (ProgressBar::hidden(), Instant::now());
        let terminal = std::io::stderr().is_terminal();
        Self { talk, bar, terminal, total: None, before: 0, done: 0, failed: 0, begin: now, last_line: now }
    }

    /// Shows what has happened.
    pub fn take(&mut self, event: Event<'_>) {
        match event {
            Event::Begun { total, before } => self.begin(total, before),
            Event::Note(line) => self.say(line),
            Event::Frame { summary, busy } => self.frame(summary, busy),
            Event::Finished { frames, seconds } => self.finish(frames, seconds),
            Event::Simulated { .. } | Event::Identified { .. } | Event::Reported { .. } => {}
        }
    }

    /// Of `total` frames (none: as many as come), `before` of which are done.
    fn begin(&mut self, total: Option<usize>, before: usize) {
        let bar = total.map_or_else(ProgressBar::no_length, |total| ProgressBar::new(total as u64));
        let bar = bar.with_position(before as u64);
        bar.reset_eta(); // the frames of before were not done now
        if matches!(self.talk, Talk::Quiet | Talk::Json) || !self.terminal {
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
        *self = Self { bar, total, before, begin: now, last_line: now, ..*self };
    }

    /// A line about the run as a whole.
    fn say(&self, line: &str) {
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
    fn frame(&mut self, frame: &FrameSummary, busy: &Busy) {
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
            let of_total = self.total.map_or(String::new(), |total| format!(" of {total}"));
            let left = left.map_or(String::new(), |left| format!(", {left:.0} s left"));
            eprintln!("{now}{of_total} frames, {rate:.1} frames/s{left}");
        }
    }

    /// The closing table of all frames; this run took `seconds`.
    fn finish(&self, frames: &[FrameSummary], seconds: f64) {
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
        if let Some(line) = about_marks(frames) {
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

/// The frame with most marked elements in words, and how many have some.
fn about_marks(frames: &[FrameSummary]) -> Option<String> {
    let share = |frame: &FrameSummary| frame.marked.iter().map(|marked| marked.percent).sum::<f64>();
    let with = || frames.iter().filter(|frame| !frame.marked.is_empty());
    let most = with().max_by(|a, b| share(a).total_cmp(&share(b)))?;
    let marks: Vec<String> = most.marked.iter().map(ToString::to_string).collect();
    let [n, number] = [with().count(), most.number];
    Some(format!("{} with marked elements, most in frame {number}: {}", plural(n, "frame"), marks.join("; ")))
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
    for marked in &frame.marked {
        text.push_str(&format!("; {marked}"));
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
