//! What must be known before anything else.

use super::CorrelationReport;
use crate::field::Status;
use crate::report::page::{Block, Section};
use crate::report::summary::FrameSummary;
use crate::report::words::capital;

/// Frames of a kind that are named, and remarks that are quoted.
const NAMED: usize = 12;

/// Numbers in words, the first of them.
fn listed(numbers: &[usize]) -> String {
    let first: Vec<String> = numbers.iter().take(NAMED).map(ToString::to_string).collect();
    let more = if numbers.len() > NAMED { format!(" and {} more", numbers.len() - NAMED) } else { String::new() };
    format!("{}{more}", first.join(", "))
}

/// What a status means to whoever reads the fields.
fn meaning(status: Status) -> &'static str {
    match status {
        Status::Converged => "converged",
        Status::IterationLimit => "reached the iteration limit: their fields are there but not settled",
        Status::Diverged => "diverged: they have no field",
        Status::LeftImage => "have partly left the image: they are not converged",
        Status::Ambiguous => "are ambiguous: the texture repeats, and displacements may be off by periods of it",
        Status::Unreadable => "could not be read",
    }
}

impl CorrelationReport<'_> {
    pub(super) fn warnings(&self) -> Section {
        let frames = &self.summary.frames;
        let mut found = Vec::new();
        let numbers = |of: &dyn Fn(&FrameSummary) -> bool| -> Vec<usize> {
            frames.iter().filter(|frame| of(frame)).map(|frame| frame.number).collect()
        };
        for status in
            [Status::Diverged, Status::Unreadable, Status::Ambiguous, Status::LeftImage, Status::IterationLimit]
        {
            let of_status = numbers(&|frame| frame.status == status);
            if !of_status.is_empty() {
                found.push(format!(
                    "{} of {} frames {}: {}.",
                    of_status.len(),
                    frames.len(),
                    meaning(status),
                    listed(&of_status)
                ));
            }
        }
        found.extend(self.summary.messages.iter().cloned());
        if !self.summary.nodes_left_out.is_empty() {
            let n = self.summary.nodes_left_out.len();
            found.push(format!(
                "{n} of {} nodes see no texture and were left out of every frame.",
                self.summary.n_nodes
            ));
        }
        let off = numbers(&|frame| frame.misfit.is_some());
        if let Some(worst) = frames
            .iter()
            .filter_map(|frame| Some((frame.number, frame.misfit?)))
            .max_by(|a, b| a.1.displacement.total_cmp(&b.1.displacement))
        {
            found.push(format!(
                "In {} of {} frames the residual of some elements is beyond noise: {}. Worst is frame {}: {}.",
                off.len(),
                frames.len(),
                listed(&off),
                worst.0,
                worst.1
            ));
        }
        // What it is a warning of is said by the colour.
        let bare = |text: &'_ str| text.strip_prefix("warning: ").unwrap_or(text).to_owned();
        let remarks = frames.iter().flat_map(|frame| frame.messages.iter().map(move |text| (frame.number, text)));
        let mut kinds: Vec<(String, Vec<usize>, &String)> = Vec::new();
        let mut n_more = 0;
        for (number, text) in remarks {
            // Of one kind are remarks that differ in their numbers alone.
            let kind: String = text.chars().filter(|c| !c.is_ascii_digit()).collect();
            let at = kinds.iter().position(|(known, ..)| *known == kind);
            match at {
                Some(at) if kinds[at].1.last() == Some(&number) => {}
                Some(at) => kinds[at].1.push(number),
                None if kinds.len() < NAMED => kinds.push((kind, vec![number], text)),
                None => n_more += 1,
            }
        }
        for (_, numbers, text) in &kinds {
            found.push(match numbers.as_slice() {
                [number] => format!("Frame {number}: {}", bare(text)),
                several => format!("Frames {}: {}", listed(several), bare(text)),
            });
        }
        if n_more > 0 {
            found.push(format!("{n_more} further remarks stand in summary.json."));
        }
        found.extend(self.notes.iter().cloned());
        let mut blocks: Vec<Block> =
            found.into_iter().map(|text| Block::Lead { text: capital(&bare(&text)), warning: true }).collect();
        if blocks.is_empty() {
            let text = "Every frame converged, and there are no warnings.".to_owned();
            blocks.push(Block::Lead { text, warning: false });
        }
        Section { title: "Read this first".into(), blocks }
    }
}
