//! The mesh over an image, where it stands and where it has moved to; zones brought into register.

use super::edges::{Edges, lines};
use super::map::{bar_for, check_length, nodal_cells, warnings};
use super::over_image::{FigureLayout, View, Words};
use super::scale::{LARGEST, write_number};
use super::scene::{BLACK, COLOURS, Path, Rgb, Scene, Stroke, WHITE};
use super::{Backdrop, MapOptions, Picture, ReportError};
use crate::field::{Measurement, RemoveRigid, RigidMotion, RigidRemoved, remove_rigid};
use crate::mesh::Mesh;
use crate::units::{PixelSize, Px};

/// What the largest displacement becomes on the sheet, as a part of the longer side of the mesh, when the
/// magnification is chosen here.
const SHOWN_PART: f64 = 0.06;
/// Lengths below this are nothing.
const NOTHING_PX: f64 = 1e-6;
/// Beyond this, noise would pass for a deformation.
const LARGEST_CHOICE: f64 = 1000.0;

/// How a mesh is drawn.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshOptions {
    /// Above the picture; broken into lines where it is long.
    pub title: String,
    /// Lines of text below the picture.
    pub notes: Vec<String>,
    /// The scale, for axes in mm beside those in px.
    pub pixel_size: Option<PixelSize>,
    /// Factor on displacements; `None` for 1 on a deformed image, else for one that makes them visible.
    pub magnify: Option<f64>,
    /// Width of the band along the border of each zone, px, that was left out of the sums; none without a number.
    pub guard_px: Vec<f64>,
}

impl MeshOptions {
    /// A mesh without a guard band.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }
}

/// Draws the mesh on the reference image, a colour for each zone. `measured` tells which nodes have a result:
/// elements without all of theirs are left out; `None` shows all.
///
/// # Errors
/// Another number of marks than of nodes.
pub fn mesh_figure(
    backdrop: &Backdrop,
    mesh: &Mesh<Px>,
    measured: Option<&[bool]>,
    options: &MeshOptions,
) -> Result<Picture, ReportError> {
    check_length("nodes", mesh.n_nodes(), measured.map_or(mesh.n_nodes(), <[bool]>::len))?;
    let drawn = |element: usize| {
        measured.is_none_or(|measured| mesh.elements()[element].iter().all(|&node| measured[node as usize]))
    };
    let n = (0..mesh.n_elements()).filter(|&element| drawn(element)).count();
    let mut notes = vec![format!("{} of {} elements, {} nodes", n, mesh.n_elements(), mesh.n_nodes())];
    if options.guard_px.iter().any(|&guard| guard > 0.0) {
        notes.push("shaded along borders: guard band, left out of all sums".to_owned());
    }
    notes.extend(options.notes.iter().cloned());
    let words = Words { title: &options.title, warnings: Vec::new(), notes };
    let layout = FigureLayout::new(backdrop, View::image(backdrop), options.pixel_size, None, &words);
    let mut scene = layout.begin();
    let at = |node: u32| mesh.nodes()[node as usize];
    draw_mesh(&mut scene, &layout, mesh, &drawn, &at, &options.guard_px);
    name_zones(&mut scene, &layout, mesh, &drawn, &at);
    Ok(layout.finish(scene))
}

/// Draws the deformed mesh over `backdrop`: the deformed image (`on_deformed`) or the reference image, with the
/// outline of the undeformed mesh. Elements without all nodes measured are left out.
///
/// # Errors
/// A magnification that is not a positive number up to 1e6.
pub fn deformed_mesh(
    backdrop: &Backdrop,
    on_deformed: bool,
    measurement: &Measurement<Px>,
    options: &MeshOptions,
) -> Result<Picture, ReportError> {
    let mesh = &measurement.mesh;
    let drawn = drawable(measurement);
    let any = drawn.contains(&true);
    let factor = match options.magnify {
        None if on_deformed => 1.0,
        asked => magnification(asked, measurement, &drawn)?,
    };
    let image = if on_deformed { "deformed" } else { "reference" };
    let mut notes = vec![
        format!("displacements {}", in_words(factor)),
        format!("dashed: outline before deformation; image: {image}"),
    ];
    notes.extend(options.notes.iter().cloned());
    let words = Words { title: &options.title, warnings: warnings(measurement, any), notes };
    let at = move_by(mesh, &measurement.displacement, factor);
    let positions = elements_of(mesh, &drawn).map(&at);
    let layout = FigureLayout::new(backdrop, View::image(backdrop).with(positions), options.pixel_size, None, &words);
    let mut scene = layout.begin();
    let choose = |element: usize| drawn[element];
    draw_mesh(&mut scene, &layout, mesh, &choose, &at, &[]);
    outline(&mut scene, &layout, mesh, &choose);
    name_zones(&mut scene, &layout, mesh, &choose, &at);
    Ok(layout.finish(scene))
}

/// Draws the zones brought into register: the rigid motion of each (or the common one) is taken off, what is left
/// is magnified, and the elements carry the reference image and the length of what is left in colours. The
/// motions stand below.
///
/// # Errors
/// A magnification that is not a positive number up to 1e6, and a range of colours that is none.
pub fn register_figure(
    backdrop: &Backdrop,
    measurement: &Measurement<Px>,
    which: RemoveRigid,
    options: &MeshOptions,
    range: Option<(f64, f64)>,
) -> Result<Picture, ReportError> {
    let mesh = &measurement.mesh;
    let (left, removed) = remove_rigid(measurement, which);
    let drawn = drawable(measurement);
    let factor = magnification(options.magnify, &left, &drawn)?;
    let lengths: Vec<f64> = left.displacement.iter().map(|u| u[0].hypot(u[1])).collect();
    let cells = nodal_cells(&left, &lengths)?;
    // Where nothing is left but round-off, its pattern is no result.
    let largest = cells.iter().flatten().flatten().fold(0.0, |a: f64, &b| a.max(b));
    let range = range.or((largest < NOTHING_PX).then_some((0.0, NOTHING_PX)));
    let map = MapOptions { range, trim: 0.005, ..MapOptions::new("", "displacement left (px)") };
    let bar = bar_for(&cells, &map)?;

    let times = in_words(factor).replace("their", "its");
    let mut notes = vec![format!("rigid motion removed; what is left {times}; dashed: outline before deformation")];
    for RigidRemoved { zone, motion: RigidMotion { centre, translation, rotation_rad }, left_rms, .. } in &removed {
        if !translation.iter().chain([rotation_rad, left_rms]).all(|v| v.is_finite()) {
            continue;
        }
        let name = zone.map_or("all zones".to_owned(), |zone| format!("zone '{}'", mesh.zones()[zone]));
        let [x, y] = translation.map(write_number);
        let [cx, cy] = centre.map(|c| format!("{c:.0}"));
        let (turn, rest) = (write_number(rotation_rad.to_degrees()), write_number(*left_rms));
        notes.push(format!(
            "{name}: moved by ({x}, {y}) px, turned by {turn} deg about ({cx}, {cy}) px; left {rest} px rms"
        ));
        // A sheet of fifty zones is no caption.
        if notes.len() == 9 && removed.len() > 8 {
            notes.push(format!("and {} more zones", removed.len() - 8));
            break;
        }
    }
    notes.extend(options.notes.iter().cloned());
    let words = Words { title: &options.title, warnings: warnings(measurement, bar.is_some()), notes };
    let at = move_by(mesh, &left.displacement, factor);
    let positions = || elements_of(mesh, &drawn).flat_map(|node| [at(node), mesh.nodes()[node as usize]]);
    let view = View::around(positions()).unwrap_or(View::image(backdrop));
    // The image goes with the elements: there is none behind them.
    let [width, height] = backdrop.size();
    let sheet = Backdrop::blank(width, height, backdrop.ratio());
    let layout = FigureLayout::new(&sheet, view, options.pixel_size, bar.as_ref(), &words);
    let mut scene = layout.begin();
    let choose = |element: usize| drawn[element];
    if let Some(bar) = &bar {
        let (mut image, mut field) = (layout.layer(), layout.layer());
        for (nodes, cell) in mesh.elements().iter().zip(&cells) {
            let Some(values) = cell else { continue };
            let corners = nodes.map(|node| layout.on_layer(at(node)));
            let home = nodes.map(|node| mesh.nodes()[node as usize]);
            image.fill(corners, |shape| {
                let [x, y] = [0, 1].map(|k| shape.iter().zip(home).map(|(n, p)| n * p[k]).sum());
                [backdrop.grey(x, y); 3]
            });
            field.fill_values(corners, *values, bar.palette, bar.range);
        }
        layout.lay(&mut scene, &image, 1.0);
        layout.lay(&mut scene, &field, bar.opacity);
    }
    scene.stroke(&borders(&layout, mesh, &choose, at), &Stroke::new(BLACK, 1.2));
    outline(&mut scene, &layout, mesh, &choose);
    name_zones(&mut scene, &layout, mesh, &choose, &at);
    Ok(layout.finish(scene))
}

/// Which elements have all their nodes measured, with finite displacements.
fn drawable(measurement: &Measurement<Px>) -> Vec<bool> {
    let usable = |node: u32| {
        let node = node as usize;
        measurement.measured[node] && measurement.displacement[node].iter().all(|u| u.abs() <= LARGEST.sqrt())
    };
    measurement.mesh.elements().iter().map(|nodes| nodes.iter().all(|&node| usable(node))).collect()
}

/// The nodes of the elements chosen; one may come several times.
fn elements_of<'a>(mesh: &'a Mesh<Px>, drawn: &'a [bool]) -> impl Iterator<Item = u32> + 'a {
    mesh.elements().iter().zip(drawn).filter(|(_, drawn)| **drawn).flat_map(|(nodes, _)| *nodes)
}

fn move_by<'a>(mesh: &'a Mesh<Px>, displacement: &'a [[f64; 2]], factor: f64) -> impl Fn(u32) -> [f64; 2] + Copy + 'a {
    move |node| {
        let (x, u) = (mesh.nodes()[node as usize], displacement[node as usize]);
        [x[0] + factor * u[0], x[1] + factor * u[1]]
    }
}

/// The magnification asked for, or one of 1, 2, 5, 10 ... that makes nearly all displacements visible.
fn magnification(asked: Option<f64>, measurement: &Measurement<Px>, drawn: &[bool]) -> Result<f64, ReportError> {
    if let Some(factor) = asked {
        let good = factor > 0.0 && factor <= 1e6;
        return if good { Ok(factor) } else { Err(ReportError::Magnification { factor }) };
    }
    let mesh = &measurement.mesh;
    let mut lengths: Vec<f64> = elements_of(mesh, drawn)
        .map(|node| measurement.displacement[node as usize])
        .map(|u| u[0].hypot(u[1]))
        .collect();
    let nodes = elements_of(mesh, drawn).map(|node| mesh.nodes()[node as usize]);
    let Some(View([x0, y0, x1, y1])) = View::around(nodes) else { return Ok(1.0) };
    lengths.sort_unstable_by(f64::total_cmp);
    // Not the largest of all: one node gone wrong must not hide the others.
    let length = lengths[(lengths.len() - 1) * 99 / 100];
    let wanted = SHOWN_PART * (x1 - x0).max(y1 - y0) / length.max(f64::MIN_POSITIVE);
    let wanted = wanted.min(largest_factor(measurement, drawn)).clamp(1.0, LARGEST_CHOICE);
    let power = 10f64.powf(wanted.log10().floor());
    Ok([5.0, 2.0, 1.0].into_iter().map(|m| m * power).find(|v| *v <= wanted * (1.0 + 1e-9)).unwrap_or(power))
}

/// The factor at which elements begin to fold over, nearly.
fn largest_factor(measurement: &Measurement<Px>, drawn: &[bool]) -> f64 {
    let mesh = &measurement.mesh;
    let edges = Edges::new(mesh, 0..mesh.n_elements(), |element| drawn[element]).all;
    let between = |field: &[[f64; 2]], [a, b]: [u32; 2]| {
        let [a, b] = [a, b].map(|node| field[node as usize]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    };
    let ratio = |&edge: &[u32; 2]| between(&measurement.displacement, edge) / between(mesh.nodes(), edge);
    let mut ratios: Vec<f64> = edges.iter().map(ratio).filter(|ratio| ratio.is_finite()).collect();
    ratios.sort_unstable_by(f64::total_cmp);
    let steep = ratios.get(ratios.len().saturating_sub(1) * 98 / 100).copied().unwrap_or(0.0);
    0.5 / steep.max(f64::MIN_POSITIVE)
}

/// How displacements are drawn, the factor without needless decimals.
fn in_words(factor: f64) -> String {
    match factor {
        1.0 => "at their true size".to_owned(),
        _ => format!("magnified {} times", (factor * 1e4).round() / 1e4),
    }
}

/// Adds edges to a path: chained as they lie at `home`, drawn where `at` says.
fn trace(
    path: &mut Path,
    layout: &FigureLayout<'_>,
    edges: &[[u32; 2]],
    home: impl Fn(u32) -> [f64; 2],
    at: impl Fn(u32) -> [f64; 2],
) {
    for line in lines(edges, home) {
        path.straightened(line.into_iter().map(|node| layout.place(at(node))));
    }
}

/// The borders of all zones.
fn borders(
    layout: &FigureLayout<'_>,
    mesh: &Mesh<Px>,
    drawn: &impl Fn(usize) -> bool,
    at: impl Fn(u32) -> [f64; 2] + Copy,
) -> Path {
    let mut path = Path::default();
    for zone in 0..mesh.zones().len() {
        trace(&mut path, layout, &Edges::new(mesh, mesh.zone_elements(zone), drawn).border, at, at);
    }
    path
}

/// The outline of the undeformed mesh, dashed.
fn outline(scene: &mut Scene, layout: &FigureLayout<'_>, mesh: &Mesh<Px>, drawn: &impl Fn(usize) -> bool) {
    let path = borders(layout, mesh, drawn, |node| mesh.nodes()[node as usize]);
    scene.stroke(&path, &Stroke { opacity: 0.8, ..Stroke::new(WHITE, 2.6) });
    scene.stroke(&path, &Stroke { dash: &[6.0, 4.0], ..Stroke::new([60; 3], 1.3) });
}

/// Colour of a zone; bright enough over a grey image.
fn zone_colour(zone: usize) -> Rgb {
    const ORDER: [usize; 6] = [1, 4, 5, 2, 3, 0];
    COLOURS[ORDER[zone % ORDER.len()]]
}

fn draw_mesh(
    scene: &mut Scene,
    layout: &FigureLayout<'_>,
    mesh: &Mesh<Px>,
    drawn: &impl Fn(usize) -> bool,
    at: &(impl Fn(u32) -> [f64; 2] + Copy),
    guard_px: &[f64],
) {
    for zone in 0..mesh.zones().len() {
        let edges = Edges::new(mesh, mesh.zone_elements(zone), drawn);
        let colour = zone_colour(zone);
        let path_of = |edges: &[[u32; 2]]| {
            let mut path = Path::default();
            trace(&mut path, layout, edges, |node| mesh.nodes()[node as usize], at);
            path
        };
        let border = path_of(&edges.border);
        if let Some(&guard) = guard_px.get(zone)
            && guard.is_finite()
            && guard > 0.0
        {
            // A stroke twice as wide, of which the inner half is seen.
            scene.clip_to(&border);
            scene.stroke(&border, &Stroke { opacity: 0.5, ..Stroke::new(colour, 2.0 * guard * layout.unit()) });
            scene.unclip();
        }
        // Fine meshes get finer lines, or they would cover the image.
        let width = (mean_edge(mesh, &edges.all) * layout.unit() / 12.0).clamp(0.3, 1.2);
        scene.stroke(&path_of(&edges.all), &Stroke { opacity: 0.9, ..Stroke::new(colour, width) });
        scene.stroke(&border, &Stroke::new(colour, width + 0.8));
    }
}

/// Mean length of edges, px.
fn mean_edge(mesh: &Mesh<Px>, edges: &[[u32; 2]]) -> f64 {
    let length = |[a, b]: &[u32; 2]| {
        let [a, b] = [a, b].map(|&node| mesh.nodes()[node as usize]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    };
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

/// The name of each zone in its upper left corner, when there are several.
fn name_zones(
    scene: &mut Scene,
    layout: &FigureLayout<'_>,
    mesh: &Mesh<Px>,
    drawn: &impl Fn(usize) -> bool,
    at: &impl Fn(u32) -> [f64; 2],
) {
    if mesh.zones().len() < 2 {
        return;
    }
    let (map, type_) = (layout.map(), &layout.letters.normal);
    for (zone, name) in mesh.zones().iter().enumerate() {
        let nodes = mesh.zone_elements(zone).filter(|&e| drawn(e)).flat_map(|e| mesh.elements()[e]);
        // The corner: least x + y, so that it lies on the mesh whatever its shape.
        let Some([x, y]) = nodes.map(at).min_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1]))) else { continue };
        let [x, y] = layout.place([x, y]);
        let name = type_.fit(name, f64::from(map.width) - 12.0);
        let (left, right) = (f64::from(map.x) + 6.0, f64::from(map.right()) - 6.0 - type_.width(&name));
        let (top, bottom) = (f64::from(map.y) + f64::from(type_.em) + 2.0, f64::from(map.bottom()) - 6.0);
        let foot = [(x + 6.0).min(right).max(left), (y + f64::from(type_.em) + 4.0).min(bottom).max(top)];
        scene.text_on_image(type_, &name, foot, BLACK);
    }
}
