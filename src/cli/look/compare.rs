//! `quadrille compare`.

use crate::cli::args::CompareArgs;
use crate::cli::{Outcome, Result};
use crate::field::Measurement;
use crate::io::foreign::{FieldOptions, LengthUnit, read_points};
use crate::io::mesh_file::{is_model, read_model};
use crate::io::store::Store;
use crate::mesh::elements_of_points;
use crate::report::{Backdrop, MapOptions, nodal_map_on};
use crate::run::{Comparison, PlacedModel, Record, RunFolder, compare, reference, save_picture};
use crate::units::Px;

pub(crate) fn run(args: &CompareArgs) -> Result<Outcome> {
    let store = Store::open(&args.run)?;
    let model = placed(args, &store)?;
    let (numbers, n_without) = args.frames.with_field(&store, args.talk.quiet)?;
    let output = args.output.as_deref().unwrap_or(&args.run);
    let folder = RunFolder::writable(output)?;
    let header = store.header();
    let backdrop = match reference(header, Record::of(header).page()) {
        Ok(image) => Backdrop::new(&image, 1),
        Err(_) => Backdrop::blank(header.image_size_px[0], header.image_size_px[1], 1),
    };
    for &number in &numbers {
        let compared = compare(&store, number, &model, args.remove_rigid)?;
        let Some(frame) = store.frame(number)? else { continue };
        compared.write(&folder, header.pixel_size)?;
        draw(&compared, &frame.measurement, &backdrop, output)?;
        println!("{}", in_words(&compared));
    }
    if numbers.is_empty() {
        return Err(format!("{}: no frame asked for has a field", args.run.display()).into());
    }
    Ok(args.frames.outcome(n_without))
}

fn in_words(compared: &Comparison) -> String {
    let Comparison { frame, n_nodes, percent, rms_px, rms_sigma, largest_px, at_px: [x, y], .. } = compared;
    let mm = compared.rms_mm.map_or(String::new(), |mm| format!(" ({mm:.3e} mm)"));
    let camera = compared.rms_sigma_with_camera.map_or(String::new(), |z| format!(" ({z:.2} with the camera's)"));
    format!(
        "frame {frame}: measured less model {rms_px:.4} px{mm} rms, {rms_sigma:.2} standard uncertainties{camera}; largest \
         {largest_px:.4} px at ({x:.0}, {y:.0}); {n_nodes} nodes, {percent:.0} % of those measured"
    )
}

/// The model over the reference image.
fn placed(args: &CompareArgs, store: &Store) -> Result<PlacedModel> {
    let path = args.model.as_path();
    let scale = store.header().pixel_size;
    let bytes = std::fs::read(path).map_err(|error| format!("{}: cannot be read: {error}", path.display()))?;
    if is_model(&bytes) {
        let scale =
            scale.ok_or("a model is in mm, and the run has no pixel size; correlate again with --pixel-size MM")?;
        let field = read_model(path, args.displacements.as_deref(), args.unit.unwrap_or(LengthUnit::Mm))?;
        let model = PlacedModel::of_mm(field, args.origin, args.turn.to_radians(), scale);
        return model.map_err(|error| format!("{}: {error}", path.display()).into());
    }
    let options = FieldOptions { unit: args.unit, y: args.y, pixel_size: scale, ..FieldOptions::default() };
    let frames = read_points(path, &options)?;
    let points = frames.into_iter().next_back().map(|frame| frame.points).unwrap_or_default();
    let [dx, dy] = args.origin;
    let positions: Vec<[f64; 2]> = points.iter().map(|p| [p.position[0] + dx, p.position[1] + dy]).collect();
    let no_grid = || {
        format!(
            "{}: its points form no grid; give the mesh (.vtu, .msh, .inp) and the table with --displacements",
            path.display()
        )
    };
    let (zones, places) = elements_of_points(&positions).ok_or_else(no_grid)?;
    let (mut nodes, mut elements) = (Vec::new(), Vec::new());
    for zone in zones {
        let first = nodes.len() as u32;
        elements.extend(zone.elements.iter().map(|corners| corners.map(|node| node + first)));
        nodes.extend(zone.nodes);
    }
    let displacement = places.iter().map(|&place| points[place].displacement).collect();
    Ok(PlacedModel::new(nodes, elements, displacement)?)
}

/// Draws the length of the difference, in px and in standard uncertainties.
fn draw(compared: &Comparison, field: &Measurement<Px>, backdrop: &Backdrop, output: &std::path::Path) -> Result<()> {
    let in_px = |d: [f64; 2], _: [f64; 2]| d[0].hypot(d[1]);
    let in_sigma = |d: [f64; 2], s: [f64; 2]| (0.5 * ((d[0] / s[0]).powi(2) + (d[1] / s[1]).powi(2))).sqrt();
    type Length = fn([f64; 2], [f64; 2]) -> f64;
    let kinds: [(&str, &str, &str, Length); 2] = [
        ("difference", "Measured less model, length", "px", in_px),
        ("difference-sigma", "Measured less model, rms of components", "standard uncertainties", in_sigma),
    ];
    for (name, title, unit, length) in kinds {
        let value = |(d, s): (&Option<[f64; 2]>, &[f64; 2])| d.map_or(f64::NAN, |d| length(d, *s));
        let values: Vec<f64> = compared.difference.iter().zip(&field.sigma).map(value).collect();
        let options = MapOptions { notes: vec![in_words(compared)], ..MapOptions::new(title, unit) };
        let picture = nodal_map_on(backdrop, field, &values, &options)?;
        save_picture(&output.join("comparison"), &format!("{:06}-{name}", compared.frame), &picture)?;
    }
    Ok(())
}
