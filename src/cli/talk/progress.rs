//! What a user sees of a long run, on stderr.

use crate::cli::plural;
use crate::cli::talk::{Fitting, Paint, Talk, WARNING, results, wrapped};
use crate::field::Status;
use crate::remark::Remark;
use crate::report::fit::FitRecord;
use crate::report::summary::{FrameSummary, Trust, worst_misfit};
use crate::report::tournament::TournamentRecord;
use crate::run::{Busy, Event};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::{Map, Value, json};
use std::io::IsTerminal;
use std::path::Path;
use std::time::Instant;

/// Progress of a series: a bar on a terminal, else a plain line now and then.
pub(crate) struct Progress {
    talk: Talk,
    paint: Paint,
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
    fitting: Fitting,
    /// What was warned of.
    warned: Vec<Remark>,
}

impl Progress {
    pub fn new(talk: Talk, paint: Paint) -> Self {
        let (bar, now) = (ProgressBar::hidden(), Instant::now());
        let terminal = std::io::stderr().is_terminal();
        let (fitting, warned) = (Fitting::new(talk), Vec::new());
        let (total, before, done, failed) = (None, 0, 0, 0);
        let (begin, last_line) = (now, now);
        Self { talk, paint, bar, terminal, total, before, done, failed, begin, last_line, fitting, warned }
    }

    pub fn take(&mut self, event: Event<'_>) {
        match event {
            Event::Begun { total, before } => self.begin(total, before),
            Event::Note(line) => self.say(line),
            Event::Remark(remark) => {
                // What was warned of before anything ran is found once more by the step that it is about.
                if !self.warned.contains(remark) {
                    self.warned.extend(remark.is_warning().then(|| remark.clone()));
                    self.tell(remark);
                }
            }
            Event::Frame { summary, busy } => self.frame(summary, busy),
            Event::Finished { frames, seconds } => self.finish(frames, seconds),
            Event::Fitting(at) => self.fitting.take(at),
            Event::Identified { fit, folder } => self.identified(fit, folder),
            Event::Simulated { summary, folder } => {
                self.fitting.done();
                if self.talk != Talk::Quiet {
                    results::of_joint(summary, folder);
                }
            }
            Event::Compared { tournament, folder } => self.compared(tournament, folder),
            Event::Reported { .. } => {}
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
        (self.bar, self.total, self.before) = (bar, total, before);
        (self.begin, self.last_line) = (now, now);
    }

    /// A line about the run as a whole.
    fn say(&self, line: &str) {
        if self.talk != Talk::Quiet {
            self.print(line);
        }
    }

    /// A remark; programs are told its code, too.
    fn tell(&self, remark: &Remark) {
        match self.talk {
            Talk::Quiet => {}
            Talk::Json => eprintln!("{}", json!({ "message": Paint::PLAIN.remark(remark), "code": remark.code })),
            _ => self.print(&self.paint.remark(remark)),
        }
    }

    fn print(&self, line: &str) {
        if self.talk == Talk::Json {
            eprintln!("{}", json!({ "message": line }));
            return;
        }
        if self.terminal {
            self.bar.suspend(|| self.fitting.suspend(|| eprintln!("{line}")));
        } else {
            eprintln!("{line}");
        }
    }

    /// A fit has ended: what it found, and what was not warned of before.
    fn identified(&self, fit: &FitRecord, folder: &Path) {
        self.fitting.done();
        let new = fit.remarks.iter().filter(|remark| remark.is_warning() && !self.warned.contains(remark));
        new.for_each(|remark| self.tell(remark));
        match self.talk {
            Talk::Quiet => {}
            Talk::Json => {
                let values: Map<String, Value> =
                    fit.parameters.iter().map(|(name, p)| (name.to_string(), json!(p.value))).collect();
                let result = json!({ "result": {
                    "status": fit.status,
                    "cut_short": fit.cut_short,
                    "omega": fit.omega,
                    "parameters": values,
                    "verdict": fit.verdict.outcome,
                    "folder": folder,
                }});
                eprintln!("{result}");
            }
            _ => results::of_fit(fit, folder, self.paint),
        }
    }

    fn compared(&self, tournament: &TournamentRecord, folder: &Path) {
        self.fitting.done();
        match self.talk {
            Talk::Quiet => {}
            Talk::Json => {
                let (best, alike) = (&tournament.best, &tournament.alike);
                let said = &tournament.sentences;
                eprintln!("{}", json!({ "laws": { "best": best, "alike": alike, "said": said, "folder": folder } }));
            }
            _ => results::of_laws(tournament, folder),
        }
    }

    fn frame(&mut self, frame: &FrameSummary, busy: &Busy) {
        let fine = frame.status == Status::Converged;
        self.done += 1;
        self.failed += usize::from(!fine);
        self.bar.set_position((self.before + self.done) as u64);
        if self.talk == Talk::Verbose || (!fine && self.talk == Talk::Normal) {
            self.print(&line(frame, self.paint));
        }
        let now = self.before + self.done;
        // The last one before a pause of unknown length shall not be held back.
        let always = self.talk == Talk::Json && (self.done == 1 || self.total.is_none_or(|total| now == total));
        if self.last_line.elapsed() < self.talk.every() && !always {
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
        if let Some(trust) = Trust::of(frames) {
            eprintln!("{}", wrapped(&trust.to_string(), 2));
        }
        HEAD.iter().for_each(|cells| eprintln!("{}", columns(cells)));
        // Those that want a look come first.
        let mut order: Vec<&FrameSummary> = frames.iter().collect();
        order.sort_by_key(|frame| frame.status == Status::Converged);
        for frame in order.into_iter().take(SHOWN) {
            eprintln!("{}", row(frame, self.paint));
        }
        if frames.len() > SHOWN {
            eprintln!("... {} more in summary.json", frames.len() - SHOWN);
        }
        let in_lines = |line: String| wrapped(&line, 2);
        let about = [about_misfit(frames).map(in_lines), about_ambiguity(frames), about_marks(frames).map(in_lines)];
        about.into_iter().flatten().for_each(|line| eprintln!("{line}"));
        let counts = crate::report::summary::counts(frames);
        let counts: Vec<_> = counts.iter().map(|(status, n)| format!("{n} {}", status.replace('_', " "))).collect();
        let rate = self.done as f64 / seconds;
        let n_frames = plural(frames.len(), "frame");
        eprintln!("{n_frames} in {seconds:.1} s ({rate:.1} frames/s): {}", counts.join(", "));
    }
}

/// The head of the closing table, and the units; what it leaves out is in summary.json.
const HEAD: [[&str; 9]; 2] = [
    ["frame", "status", "correct", "resid.", "u_x mean", "u_y mean", "rotation", "measured", "misfit"],
    ["", "", "px", "%", "px", "px", "deg", "%", "%"],
];

/// A line of the closing table: 80 columns.
fn columns(cells: &[&str; 9]) -> String {
    let [number, status, correction, residual, x, y, rotation, measured, misfit] = cells;
    format!(
        "{number:>5} {status:15} {correction:>7} {residual:>7} {x:>8} {y:>8} {rotation:>8} {measured:>8} {misfit:>6}"
    )
}

fn row(frame: &FrameSummary, paint: Paint) -> String {
    let status = frame.status.name().replace('_', " ");
    // Large numbers need no small digits.
    let number = |v: Option<f64>, digits: usize, width: usize| {
        let with = |digits: usize| v.map_or("-".to_owned(), |v| format!("{v:.digits$}"));
        (0..=digits).rev().map(with).find(|text| text.len() <= width).unwrap_or_else(|| with(0))
    };
    let motion = frame.rigid_motion.as_ref();
    let line = columns(&[
        &frame.number.to_string(),
        "*",
        &frame.correction_px.map_or("-".to_owned(), |v| format!("{v:.1e}")),
        &number(frame.residual_percent, 2, 7),
        &number(motion.map(|m| m.translation_px[0]), 4, 8),
        &number(motion.map(|m| m.translation_px[1]), 4, 8),
        &number(motion.map(|m| m.rotation_deg), 4, 8),
        &number(frame.measured_percent, 1, 8),
        &number(frame.model_error.map(|_| frame.misfit.map_or(0.0, |misfit| misfit.percent)), 1, 6),
    ]);
    // Colour has no width, but characters.
    line.replacen(&format!("{:15}", "*"), &paint.status(frame.status, &format!("{status:15}")), 1)
}

/// The frame with most misfit in words, and how many have some.
fn about_misfit(frames: &[FrameSummary]) -> Option<String> {
    let (number, most) = worst_misfit(frames)?;
    let n = frames.iter().filter(|frame| frame.misfit.is_some()).count();
    Some(format!("{} with misfit, most in frame {number}: {most}", plural(n, "frame")))
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

/// The frame whose displacement is told worst, where the texture repeats, and how many there are.
fn about_ambiguity(frames: &[FrameSummary]) -> Option<String> {
    let with = || frames.iter().filter_map(|frame| Some((frame.number, frame.ambiguity.as_ref()?)));
    let (number, worst) = with().max_by(|a, b| a.1.from_expected_px.total_cmp(&b.1.from_expected_px))?;
    Some(format!("{WARNING}{} with a texture that repeats; frame {number}: {worst}", plural(with().count(), "frame")))
}

/// One frame in words.
fn line(frame: &FrameSummary, paint: Paint) -> String {
    let status = paint.status(frame.status, &frame.status.name().replace('_', " "));
    let mut text = format!("frame {} ({}): {status}", frame.number, frame.file);
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
    for remark in &frame.remarks {
        text.push_str("; ");
        text.push_str(&Paint::PLAIN.remark(remark));
    }
    text
}
