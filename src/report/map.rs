//! A field in colours over the reference image, with axes and a colour bar.

use super::bar::Bar;
use super::over_image::{FigureLayout, View, Words};
use super::scale::{LARGEST, Palette, Range};
use super::scene::{BLACK, Path, Scene, Stroke, WHITE};
use super::{Backdrop, Picture, ReportError};
use crate::field::{Measurement, Status};
use crate::imaging::Image;
use crate::units::{PixelSize, Px};

/// How a map is drawn.
#[derive(Debug, Clone, PartialEq)]
pub struct MapOptions {
    /// Above the picture; broken into lines where it is long.
    pub title: String,
    /// Beside the colour bar: the quantity and its unit, as `Displacement along x (px)`.
    pub label: String,
    /// The values at the ends of the colour bar; `None` for the smallest and the largest value. Values
    /// beyond take the colour of the end, and a tip of the bar shows that there are such.
    pub range: Option<(f64, f64)>,
    /// Share of the values that may lie beyond either end when no range is given: 0 for none. It is used where
    /// the few values beyond would otherwise stretch the bar by half or more.
    pub trim: f64,
    /// The colours. A diverging palette gets a range that is symmetric about zero, unless one is given.
    pub palette: Palette,
    /// How much the field hides of the image: 0 nothing, 1 all.
    pub opacity: f64,
    /// The scale, for axes in mm beside those in px.
    pub pixel_size: Option<PixelSize>,
    /// A line to show from (x0, y0), marked A, to (x1, y1), marked B, px.
    pub line: Option<[f64; 4]>,
    /// Elements that are hatched, since their values are to be doubted; none where it is empty.
    pub hatched: Vec<bool>,
    /// Lines of text below the picture.
    pub notes: Vec<String>,
}

impl MapOptions {
    /// Viridis over the whole range of values, the image showing through.
    pub fn new(title: impl Into<String>, label: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            label: label.into(),
            range: None,
            trim: 0.0,
            palette: Palette::default(),
            opacity: 0.7,
            pixel_size: None,
            line: None,
            hatched: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// Draws `values`, one per node and interpolated in the elements, over the reference `image`.
///
/// An element with a node that was not measured (or whose value is not finite) is left transparent.
///
/// # Errors
/// Another number of values than of nodes, and a range that is none.
pub fn nodal_map(
    image: &Image,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    nodal_map_on(&Backdrop::new(image, 1), measurement, values, options)
}

/// [`nodal_map`] of `values`, one per element.
///
/// # Errors
/// Another number of values than of elements, and a range that is none.
pub fn element_map(
    image: &Image,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    element_map_on(&Backdrop::new(image, 1), measurement, values, options)
}

/// [`nodal_map`] over an image that is ready.
///
/// # Errors
/// Those of [`nodal_map`].
pub fn nodal_map_on(
    backdrop: &Backdrop,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    draw(backdrop, measurement, &nodal_cells(measurement, values)?, options)
}

/// [`element_map`] over an image that is ready.
///
/// # Errors
/// Those of [`element_map`].
pub fn element_map_on(
    backdrop: &Backdrop,
    measurement: &Measurement<Px>,
    values: &[f64],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    draw(backdrop, measurement, &element_cells(measurement, values)?, options)
}

/// The values at the four nodes of an element; `None` where it was not measured.
pub(super) type Cell = Option<[f64; 4]>;

pub(super) fn nodal_cells(measurement: &Measurement<Px>, values: &[f64]) -> Result<Vec<Cell>, ReportError> {
    check_length("nodes", measurement.mesh.n_nodes(), values.len())?;
    Ok(cells(measurement, |_, nodes| nodes.map(|node| values[node as usize])))
}

pub(super) fn element_cells(measurement: &Measurement<Px>, values: &[f64]) -> Result<Vec<Cell>, ReportError> {
    check_length("elements", measurement.mesh.n_elements(), values.len())?;
    Ok(cells(measurement, |element, _| [values[element]; 4]))
}

pub(super) fn check_length(what: &'static str, expected: usize, got: usize) -> Result<(), ReportError> {
    if got == expected { Ok(()) } else { Err(ReportError::Length { what, expected, got }) }
}

fn cells(measurement: &Measurement<Px>, values: impl Fn(usize, &[u32; 4]) -> [f64; 4]) -> Vec<Cell> {
    let is_left_out = |element: usize| measurement.marks.as_ref().is_some_and(|marks| marks[element].is_left_out());
    let cell = |(element, nodes): (usize, &[u32; 4])| {
        let measured = nodes.iter().all(|&node| measurement.measured[node as usize]) && !is_left_out(element);
        Some(values(element, nodes)).filter(|values| measured && values.iter().all(|v| v.abs() <= LARGEST))
    };
    measurement.mesh.elements().iter().enumerate().map(cell).collect()
}

/// What must be said about a frame: how it ended, where not well, that there is nothing to see, what is left out, and
/// that the mesh does not follow the motion.
pub(super) fn warnings(measurement: &Measurement<Px>, drawn: bool) -> Vec<String> {
    let ended = match measurement.status {
        Status::Converged => None,
        Status::PartlyLost => Some("a zone or more than a third of the nodes is lost"),
        Status::IterationLimit => Some("not converged: iteration limit reached"),
        Status::Diverged => Some("diverged: this is not a measurement"),
        Status::LeftImage => Some("not converged: too much of a zone has left the image"),
        Status::Unreadable => Some("unreadable: this is not a measurement"),
        Status::Ambiguous => Some("ambiguous: the texture repeats, displacements may be off by periods of it"),
    };
    let nothing = match measurement.measured.contains(&true) {
        true => "no element with all nodes measured",
        false => "no measured node",
    };
    let mut warnings: Vec<String> = ended.into_iter().chain((!drawn).then_some(nothing)).map(str::to_owned).collect();
    let left_out: Vec<String> =
        measurement.marked().iter().filter(|marked| marked.mark.is_left_out()).map(ToString::to_string).collect();
    if !left_out.is_empty() {
        warnings.push(format!("left out: {}", left_out.join("; ")));
    }
    warnings.extend(measurement.misfit().map(|misfit| misfit.to_string()));
    warnings
}

/// The bar for these values; `None` when there is no value.
pub(super) fn bar_for(cells: &[Cell], options: &MapOptions) -> Result<Option<Bar>, ReportError> {
    let all = || cells.iter().flatten().flatten().copied();
    let asked = options.range.map(|(low, high)| Range::new(low, high)).transpose()?;
    let Some(natural) = Range::of(all()) else { return Ok(None) };
    let range = asked.unwrap_or_else(|| {
        let range = trim(natural, all(), options.trim);
        if options.palette.is_diverging() { range.symmetric() } else { range }
    });
    let narrow = asked.is_some() || range.low > natural.low || range.high < natural.high;
    Ok(Some(Bar {
        range,
        palette: options.palette,
        opacity: if options.opacity.is_finite() { options.opacity.clamp(0.0, 1.0) } else { 1.0 },
        below: narrow && all().any(|v| v < range.low),
        above: narrow && all().any(|v| v > range.high),
        label: options.label.clone(),
    }))
}

/// `natural` without the share `trim` of the values at either end, where that makes it much shorter.
fn trim(natural: Range, values: impl Iterator<Item = f64>, trim: f64) -> Range {
    if !(trim > 0.0 && trim < 0.5) {
        return natural;
    }
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let at = |part: f64| sorted[((sorted.len() - 1) as f64 * part).round() as usize];
    match Range::new(at(trim), at(1.0 - trim)) {
        Ok(range) if natural.high - natural.low > 1.5 * (range.high - range.low) => range,
        _ => natural,
    }
}

fn draw(
    backdrop: &Backdrop,
    measurement: &Measurement<Px>,
    cells: &[Cell],
    options: &MapOptions,
) -> Result<Picture, ReportError> {
    let bar = bar_for(cells, options)?;
    let mut warnings = warnings(measurement, bar.is_some());
    if measurement.marked().iter().any(|marked| !marked.mark.is_left_out()) {
        warnings.push("hatched: the residual is beyond noise, the displacement doubtful".to_owned());
    }
    let words = Words { title: &options.title, warnings, notes: options.notes.clone() };
    let layout = FigureLayout::new(backdrop, View::image(backdrop), options.pixel_size, bar.as_ref(), &words);
    let mut scene = layout.begin();
    if let Some(bar) = &bar {
        let mesh = &measurement.mesh;
        let mut layer = layout.layer();
        for (nodes, cell) in mesh.elements().iter().zip(cells) {
            if let Some(values) = cell {
                let corners = nodes.map(|node| layout.on_layer(mesh.nodes()[node as usize]));
                layer.fill_values(corners, *values, bar.palette, bar.range);
            }
        }
        layout.lay(&mut scene, &layer, bar.opacity);
        hatch(&mut scene, &layout, measurement, cells, &options.hatched);
    }
    if let Some(line) = options.line {
        draw_line(&mut scene, &layout, line);
    }
    Ok(layout.finish(scene))
}

/// Distance of the lines of a hatch on the sheet.
const HATCH: f64 = 7.0;

/// Hatches the elements that are drawn and marked.
fn hatch(
    scene: &mut Scene,
    layout: &FigureLayout<'_>,
    measurement: &Measurement<Px>,
    cells: &[Cell],
    hatched: &[bool],
) {
    let mesh = &measurement.mesh;
    let marked =
        cells.iter().zip(hatched).zip(mesh.elements()).filter(|((cell, hatched), _)| **hatched && cell.is_some());
    let mut within = Path::default();
    let mut ends: Option<[f64; 4]> = None;
    for (_, nodes) in marked {
        let corners = nodes.map(|node| layout.place(mesh.nodes()[node as usize]));
        for [x, y] in corners {
            ends = Some(ends.map_or([x, y, x, y], |[a, b, c, d]| [a.min(x), b.min(y), c.max(x), d.max(y)]));
        }
        within.polygon(corners);
    }
    let Some([x0, y0, x1, y1]) = ends else { return };
    // Lines x + y = constant, at the same places whatever is hatched.
    let mut lines = Path::default();
    let mut at = ((x0 + y0) / HATCH).ceil() * HATCH;
    while at < x1 + y1 {
        lines.line([[at - y0, y0], [at - y1, y1]]);
        at += HATCH;
    }
    scene.clip_to(&within);
    scene.stroke(&lines, &Stroke::new(WHITE, 2.2));
    scene.stroke(&lines, &Stroke::new(BLACK, 1.0));
    scene.unclip();
}

/// A line from A to B.
fn draw_line(scene: &mut Scene, layout: &FigureLayout<'_>, [x0, y0, x1, y1]: [f64; 4]) {
    let ends = [[x0, y0], [x1, y1]].map(|end| layout.place(end));
    if !ends.iter().flatten().all(|v| v.abs() < 1e6) {
        return;
    }
    let mut path = Path::default();
    path.line(ends);
    scene.stroke(&path, &Stroke::new(WHITE, 4.0));
    scene.stroke(&path, &Stroke::new(BLACK, 1.6));
    let (map, type_) = (layout.map(), &layout.letters.normal);
    for (name, [x, y]) in ["A", "B"].into_iter().zip(ends) {
        // Inside the map, above the line.
        let x = x.clamp(f64::from(map.x) + 4.0, f64::from(map.right()) - 4.0 - type_.width(name));
        let y = (y - 6.0).clamp(f64::from(map.y) + f64::from(type_.em), f64::from(map.bottom()) - 4.0);
        scene.text_on_image(type_, name, [x, y], BLACK);
    }
}
