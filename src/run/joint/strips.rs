//! The zones of a joint whose case names none: two strips, found in the reference image.

use crate::imaging::{Image, Strips};
use crate::io::case::read_document;
use crate::io::run_case::RunCase;
use crate::plane::bounds;
use crate::run::frames::Reference;
use crate::run::plan::{Plan, Request};
use crate::run::words::{Result, RunError};
use std::path::Path;

/// The case of `file`; where it has no zone, with those of the strips in its reference image, and what was found.
pub(crate) fn case_with_strips(file: &Path, asked: &Request) -> Result<(RunCase, Option<String>)> {
    let document = read_document(file)?;
    let Some(interface) = document.case.interface.as_ref().filter(|_| document.case.zones.is_empty()) else {
        return Ok((document.run()?, None));
    };
    let plan = Plan::of(asked, &document.of_correlation()?)?;
    let image: Image = Reference::of(&plan)?.image;
    let found = Strips::find(&image, plan.options.element_size).map_err(|error| {
        RunError::Reference(format!(
            "{}: {} names no [[zone]], and no joint is found: {error}; draw the strips on the image: quadrille make page",
            plan.reference_name(),
            file.display()
        ))
    })?;
    let zones = as_zones(&found, &interface.zones);
    let case = document.followed_by(&zones)?.run()?;
    let mm = plan.pixel_size.map_or(String::new(), |size| {
        let [gap, std] = [found.gap_px, found.gap_std_px].map(|px| size.mm_from_px(px));
        format!(" = {gap:.4} +- {std:.4} mm")
    });
    let note = format!(
        "joint found: faces {:.2} +- {:.2} px apart{mm} (only how its parts differ); to change them, put these lines into {}:\n{zones}",
        found.gap_px,
        found.gap_std_px,
        file.display()
    );
    Ok((case, Some(note)))
}

/// As they stand in a case file.
fn as_zones(found: &Strips, [first, second]: &[String; 2]) -> String {
    // The first is the lower one, or that at the left.
    let names = if found.is_upright { [first, second] } else { [second, first] };
    let zone = |name: &String, corners: &[[f64; 2]; 4]| {
        let shape = match (found.are_rectangles, corners) {
            (true, corners) => {
                let [[x0, y0], [x1, y1]] = bounds(corners);
                format!("roi = [{x0:.2}, {y0:.2}, {x1:.2}, {y1:.2}]")
            }
            (false, corners) => {
                let corners: Vec<String> = corners.iter().map(|[x, y]| format!("[{x:.2}, {y:.2}]")).collect();
                format!("polygon = [{}]", corners.join(", "))
            }
        };
        format!("[[zone]]\nname = {}\n{shape}\n", toml_text(name))
    };
    names.iter().zip(&found.corners).map(|(name, corners)| zone(name, corners)).collect()
}

fn toml_text(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
