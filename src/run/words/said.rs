//! What a run says of itself.

use crate::correlate::Reference;
use crate::field::Elements;
use crate::imaging::{GreyDepth, Image, Saturation};
use crate::io::store::STORE;
use crate::report::summary::{ReferenceSummary, Summary, units};
use crate::run::plan::{MANY, Plan};
use crate::run::words::{plural, ranges};
use std::collections::BTreeMap;

/// What a run begins with, on one line.
pub(crate) fn begin_line(plan: &Plan, correlator: &Reference, reference: &Image, threads: usize) -> String {
    let mesh = correlator.mesh();
    format!(
        "reference {} ({} x {} px, {}), {}, {} elements of {} px{}, {} nodes; {}, {}",
        plan.reference_name(),
        reference.width(),
        reference.height(),
        reference.pixels().depth(),
        plural(mesh.zones().len(), "zone"),
        mesh.n_elements(),
        plan.options.mesh_size(),
        match plan.options.elements {
            Elements::Bilinear => String::new(),
            Elements::CubicSpline => format!(" with cubic splines over every {} px", plan.options.element_size),
        },
        mesh.n_nodes(),
        correlator.device(),
        plural(threads, "thread"),
    )
}

/// What to say of an earlier start: frames that are done, and those that are done again because they are damaged, their
/// image was replaced, or they depend on such.
pub(crate) fn about_earlier(done: usize, to_do: usize, [damaged, replaced, depending]: [&[usize]; 3]) -> Vec<String> {
    let mut said = Vec::new();
    if done > 0 {
        let to_do = if to_do == 0 { "nothing is missing".into() } else { format!("{to_do} to do") };
        said.push(format!("{} done before, {to_do}", plural(done, "frame")));
    }
    if !damaged.is_empty() {
        let frames = plural(damaged.len(), "frame");
        said.push(format!("stored results of {frames} are incomplete and will be recomputed: {}", ranges(damaged)));
    }
    if !replaced.is_empty() {
        let frames = plural(replaced.len(), "frame");
        said.push(format!(
            "the images of {frames} were replaced since and will be measured again: {}",
            ranges(replaced)
        ));
    }
    if !depending.is_empty() {
        let frames = ranges(depending);
        said.push(format!("recomputed as well, since the reference depends on all frames before: {frames}"));
    }
    said
}

pub(crate) fn empty_summary(
    plan: &Plan,
    correlator: &Reference,
    reference: &Image,
    threads: usize,
    saturation: Option<Saturation>,
) -> Summary {
    Summary {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: correlator.device().to_owned(),
        threads,
        units: units(),
        reference: ReferenceSummary {
            file: plan.reference.first().map(ToString::to_string).unwrap_or_default(),
            mean_of: match plan.reference.as_slice() {
                [_] => Vec::new(),
                several => several.iter().map(ToString::to_string).collect(),
            },
            width_px: reference.width(),
            height_px: reference.height(),
            depth: reference.pixels().depth().into(),
            bits_used: GreyDepth::of(reference).map(|depth| depth.used),
            saturated_percent: saturation.map(Saturation::percent),
            range_grey: correlator.grey_range(),
        },
        n_nodes: correlator.mesh().n_nodes(),
        n_elements: correlator.mesh().n_elements(),
        n_levels: correlator.n_levels(),
        solver: correlator.solver_name().into(),
        tolerance_px: plan.options.tolerance_px,
        tolerance_in_effect_px: (correlator.tolerance_px() > plan.options.tolerance_px)
            .then(|| correlator.tolerance_px()),
        gradient_smoothing_px: Some(correlator.smoothing_px()).filter(|width| *width > 0.0),
        hot_pixels: Some(correlator.n_hot_pixels()).filter(|n| *n > 0),
        seconds_reference: 0.0,
        seconds_total: 0.0,
        nodes_left_out: correlator.dropped().iter().map(Into::into).collect(),
        nodes_held: correlator.held().iter().map(Into::into).collect(),
        remarks: Vec::new(),
        counts: BTreeMap::new(),
        trust: None,
        reference_updates: Vec::new(),
        cracks: Vec::new(),
        frames: Vec::new(),
    }
}

/// That no tables are written: because there are `many` frames, or because nobody knows how many.
pub(crate) fn store_only(many: bool) -> String {
    let why = if many { format!("more than {MANY} frames: ") } else { String::new() };
    format!(
        "{why}fields go to {STORE} alone; `quadrille export` makes tables of them, or --export csv,vtu during the run"
    )
}
