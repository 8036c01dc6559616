//! What must be known before anything else.

use super::CorrelationReport;
use crate::field::Status;
use crate::remark::{About, Remark};
use crate::report::page::{Block, Section};
use crate::report::summary::{FrameSummary, Trust, worst_misfit};

/// Frames of a kind that are named, and kinds of remarks that are quoted.
const NAMED: usize = 12;

/// Numbers in words, the first of them.
fn list(numbers: &[usize]) -> String {
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
        Status::PartlyLost => "have lost a zone or more than a third of the nodes: what is measured can be used",
        Status::Unreadable => "could not be read",
    }
}

/// The zone that a remark is about, if it is one.
fn zone(remark: &Remark) -> Option<&str> {
    if let About::Zone(name) = &remark.about { Some(name) } else { None }
}

impl CorrelationReport<'_> {
    pub(super) fn warnings(&self) -> Section {
        let frames = &self.summary.frames;
        let mut blocks = Vec::new();
        let mut warn = |text: String| blocks.push(Block::warning(text));
        let numbers = |of: &dyn Fn(&FrameSummary) -> bool| -> Vec<usize> {
            frames.iter().filter(|frame| of(frame)).map(|frame| frame.number).collect()
        };
        for status in Status::ALL.into_iter().filter(|&status| status != Status::Converged) {
            let of_status = numbers(&|frame| frame.status == status);
            if !of_status.is_empty() {
                let (n, n_frames) = (of_status.len(), frames.len());
                warn(format!("{n} of {n_frames} frames {}: {}.", meaning(status), list(&of_status)));
            }
        }
        if !self.summary.nodes_left_out.is_empty() {
            let n = self.summary.nodes_left_out.len();
            warn(format!("{n} of {} nodes see no texture and were left out of every frame.", self.summary.n_nodes));
        }
        let off = numbers(&|frame| frame.misfit.is_some());
        if let Some((worst, misfit)) = worst_misfit(frames) {
            let (n, n_frames, off) = (off.len(), frames.len(), list(&off));
            warn(format!("{n} of {n_frames} frames have misfit: {off}. Most has frame {worst}: {misfit}."));
        }
        blocks.extend(self.summary.remarks.iter().map(Block::of_remark));
        // Of one kind are remarks of one code on one zone.
        let mut kinds: Vec<(Vec<usize>, &Remark)> = Vec::new();
        let remarks = frames.iter().flat_map(|frame| frame.remarks.iter().map(|remark| (frame.number, remark)));
        for (number, remark) in remarks {
            match kinds.iter_mut().find(|(_, known)| known.code == remark.code && zone(known) == zone(remark)) {
                Some((numbers, _)) if numbers.last() == Some(&number) => {}
                Some((numbers, _)) => numbers.push(number),
                None => kinds.push((vec![number], remark)),
            }
        }
        for (numbers, remark) in kinds.iter().take(NAMED) {
            let frames = if numbers.len() == 1 { "Frame" } else { "Frames" };
            blocks.push(Block::of_remark(&(*remark).clone().after(&format!("{frames} {}: ", list(numbers)))));
        }
        if kinds.len() > NAMED {
            let text = format!("{} further remarks stand in summary.json.", kinds.len() - NAMED);
            blocks.push(Block::Lead { text, warning: false });
        }
        blocks.extend(self.quantities.remarks.iter().map(Block::of_remark));
        if !blocks.iter().any(|block| matches!(block, Block::Lead { warning: true, .. })) {
            let text = "Every frame converged, and there are no warnings.".to_owned();
            blocks.insert(0, Block::Lead { text, warning: false });
        }
        let trust = Trust::of(frames).map(|trust| Block::Lead { text: format!("Trust: {trust}."), warning: false });
        blocks.splice(0..0, trust);
        Section { title: "Read this first".into(), blocks }
    }
}
