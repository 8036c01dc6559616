//! What a user sees of a long run, on stderr.

use super::plural;
use crate::field::Status;
use crate::report::summary::FrameSummary;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use std::io::IsTerminal;
use std::time::{Duration, Instant};

/// How much is said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Talk {
    Quiet,
    Normal,
    Verbose,
}

/// Progress of a series: a bar on a terminal, else a plain line now and then.
pub(super) struct Progress {
    talk: Talk,
    bar: ProgressBar,
    terminal: bool,
    total: usize,
    begin: Instant,
    last_line: Instant,
}

/// Seconds between two plain lines.
const EVERY: Duration = Duration::from_secs(5);

impl Progress {
    pub fn new(talk: Talk, total: usize) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = ProgressBar::new(total as u64);
        if talk == Talk::Quiet || !terminal {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        let template = "{bar:30} {pos}/{len} frames  {rate}  {eta} left";
        let rate = |state: &ProgressState, out: &mut dyn std::fmt::Write| {
            // Nowhere to report a failed write of the bar to.
            let _ = write!(out, "{:.1} frames/s", state.per_sec());
        };
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.with_key("rate", rate));
        let now = Instant::now();
        Self { talk, bar, terminal, total, begin: now, last_line: now }
    }

    /// A line about the run as a whole.
    pub fn say(&self, line: &str) {
        if self.talk != Talk::Quiet {
            self.print(line);
        }
    }

    fn print(&self, line: &str) {
        if self.terminal {
            self.bar.suspend(|| eprintln!("{line}"));
        } else {
            eprintln!("{line}");
        }
    }

    /// One frame is done, `done` in all.
    pub fn frame(&mut self, done: usize, frame: &FrameSummary) {
        self.bar.set_position(done as u64);
        let fine = frame.status == Status::Converged;
        if self.talk == Talk::Verbose || (!fine && self.talk == Talk::Normal) {
            self.print(&line(frame));
        }
        if self.talk != Talk::Quiet && !self.terminal && self.last_line.elapsed() > EVERY {
            self.last_line = Instant::now();
            let rate = done as f64 / self.begin.elapsed().as_secs_f64();
            let left = (self.total - done) as f64 / rate;
            eprintln!("{done} of {} frames, {rate:.1} frames/s, {left:.0} s left", self.total);
        }
    }

    /// The closing table.
    pub fn finish(&self, frames: &[FrameSummary], seconds: f64) {
        self.bar.finish_and_clear();
        if self.talk == Talk::Quiet {
            return;
        }
        const SHOWN: usize = 30;
        eprintln!("frame  status           it.  correction  residual  residual   u_x mean   u_y mean  rotation");
        eprintln!("                                     px      grey         %         px         px       deg");
        for frame in frames.iter().take(SHOWN) {
            eprintln!("{}", row(frame));
        }
        if frames.len() > SHOWN {
            eprintln!("... {} more in summary.json", frames.len() - SHOWN);
        }
        let counts = crate::report::summary::counts(frames);
        let counts: Vec<_> = counts.iter().map(|(status, n)| format!("{n} {}", status.replace('_', " "))).collect();
        let rate = frames.len() as f64 / seconds;
        let n_frames = plural(frames.len(), "frame");
        eprintln!("{n_frames} in {seconds:.1} s ({rate:.1} frames/s): {}", counts.join(", "));
    }
}

fn row(frame: &FrameSummary) -> String {
    let status = frame.status.name().replace('_', " ");
    let number = |v: Option<f64>, digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
    let motion = frame.rigid_motion.as_ref();
    format!(
        "{:5}  {status:15}  {:3}  {:>10}  {:>8}  {:>8}  {:>9}  {:>9}  {:>8}",
        frame.number,
        frame.iterations,
        frame.correction_px.map_or("-".to_owned(), |v| format!("{v:.1e}")),
        number(frame.residual_grey, 3),
        number(frame.residual_percent, 2),
        number(motion.map(|m| m.translation_px[0]), 4),
        number(motion.map(|m| m.translation_px[1]), 4),
        number(motion.map(|m| m.rotation_deg), 4),
    )
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
    for message in &frame.messages {
        text.push_str("; ");
        text.push_str(message);
    }
    text
}
