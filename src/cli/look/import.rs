//! `quadrille import`.

use crate::cli::args::ImportArgs;
use crate::cli::talk::Paint;
use crate::cli::{Outcome, Result, plural};
use crate::io::foreign::FieldOptions;
use crate::io::series::expand_series;
use crate::run::{Import, import_fields};
use crate::units::PixelSize;
use std::path::Path;

pub(crate) fn run(args: &ImportArgs) -> Result<Outcome> {
    let pixel_size = match args.pixel_size {
        Some(mm) => Some(
            PixelSize::new(mm).ok_or_else(|| format!("--pixel-size is {mm}; give the mm of a pixel, above zero"))?,
        ),
        None => None,
    };
    let options = FieldOptions {
        layout: args.layout,
        unit: args.unit,
        y: args.y,
        deformed: args.coordinates == crate::cli::args::Coordinates::Deformed,
        pixel_size,
    };
    let import = Import {
        files: expand_series(&args.files, Path::new(""))?,
        options,
        sigma_px: args.sigma,
        at_rest: expand_series(&args.at_rest, Path::new(""))?,
        reference: args.reference.clone(),
        strain: args.strain,
    };
    let imported = import_fields(&import, &args.results.output, args.results.overwrite)?;
    if !args.talk.quiet {
        imported.remarks.iter().for_each(|remark| eprintln!("{}", Paint::PLAIN.remark(remark)));
        let [dx, dy] = imported.shift_px;
        if [dx, dy] != [0.0; 2] {
            eprintln!("positions are moved by ({dx:.3}, {dy:.3}) px, so that none is below zero");
        }
        let left_out = match (imported.n_left_out, imported.n_invalid) {
            (0, 0) => String::new(),
            (alone, invalid) => format!(", {} without element, {invalid} not valid", plural(alone, "point")),
        };
        let sigma = imported.sigma_px.map_or(String::new(), |[x, y]| format!(" {x:.4}, {y:.4} px"));
        eprintln!(
            "{} of layout {}: {}, {} elements{left_out}; sigma{sigma} ({}); in {}",
            plural(imported.n_frames, "frame"),
            imported.layout,
            plural(imported.n_nodes, "node"),
            imported.n_elements,
            imported.sigma_from,
            args.results.output.display()
        );
    }
    Ok(if imported.n_empty > 0 { Outcome::Incomplete } else { Outcome::Fine })
}
