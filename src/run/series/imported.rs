//! Fields that another program measured, as a run.

use crate::field::{Measurement, Status, StrainDefinition, StrainField};
use crate::io::case::{CaseFile, CaseImages, write_case};
use crate::io::foreign::{FieldOptions, FieldPoint, FieldPoints, read_points};
use crate::io::images::Accepted;
use crate::io::series::Frame;
use crate::io::store::{IMPORTED_FROM, STORE, StoreHeader, StoreWriter};
use crate::mesh::{Mesh, elements_of_points};
use crate::plane::bounds;
use crate::remark::{About, Code, Remark};
use crate::run::folder::RunFolder;
use crate::run::words::{Result, RunError, absolute, plural};
use crate::units::Px;
use serde::Serialize;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// File that says what was taken from where.
const RECORD: &str = "import.json";
/// Two points are the same place where they are closer than this share of their mean distance.
const SAME_PLACE: f64 = 0.05;
/// So many points are kept from looking for places to writing fields, 0.3 GB; beyond, the files are read twice.
const MOST_KEPT: usize = 5_000_000;

/// What to import.
#[derive(Debug, Clone, Default)]
pub struct Import {
    /// A file for each frame, or one with several, in order.
    pub files: Vec<PathBuf>,
    /// How they are read.
    pub options: FieldOptions,
    /// Standard uncertainty of a displacement component, px, where it is known.
    pub sigma_px: Option<f64>,
    /// Fields of the specimen at rest, whose scatter is the noise.
    pub at_rest: Vec<PathBuf>,
    /// The reference image, over which fields are drawn.
    pub reference: Option<PathBuf>,
    /// Definition of the strains.
    pub strain: StrainDefinition,
}

/// What was imported; `import.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Imported {
    /// Version.
    pub quadrille: &'static str,
    /// Name of the layout.
    pub layout: &'static str,
    /// Frames.
    pub n_frames: usize,
    /// Frames without any valid point.
    pub n_empty: usize,
    /// Nodes and elements of the mesh.
    pub n_nodes: usize,
    /// Elements of the mesh.
    pub n_elements: usize,
    /// Points that belong to no element.
    pub n_left_out: usize,
    /// Points that the files mark as not measured, over all frames.
    pub n_invalid: usize,
    /// What was added to all positions, px, so that none is below zero.
    pub shift_px: [f64; 2],
    /// Where the standard uncertainty comes from: `stated`, `at rest`, `file`.
    pub sigma_from: &'static str,
    /// Standard uncertainty of x and y, px, where it is the same everywhere.
    pub sigma_px: Option<[f64; 2]>,
    /// What whoever goes on with the fields should know.
    pub remarks: Vec<Remark>,
}

/// Reads the fields and writes them as a run into the folder `output`, which `overwrite` allows to replace.
///
/// # Errors
/// Files that cannot be read, points that form no grid, no standard uncertainty, a folder that cannot be written.
pub fn import_fields(import: &Import, output: &Path, overwrite: bool) -> Result<Imported> {
    let (places, kept) = Places::of_files(import)?;
    let Some((zones, of_node)) = elements_of_points(&places.points) else {
        return Err(places.no_grid(import));
    };
    let shift = shift(&places.points, places.spacing);
    let moved = zones.into_iter().map(|mut zone| {
        zone.nodes.iter_mut().for_each(|at| *at = [at[0] + shift[0], at[1] + shift[1]]);
        zone
    });
    let mesh = Arc::new(Mesh::from_zones(moved.collect()).map_err(|error| RunError::Refused(error.to_string()))?);
    let (sigma_from, sigma) = sigma_of(import, &places)?;
    let folder = RunFolder::open(output, overwrite)?;
    let header = header_of(import, &places, &mesh)?;
    folder.clear(false, false)?;
    let writer = StoreWriter::create_for_points(&output.join(STORE), &header)?;
    let mut node_at = vec![None; places.points.len()];
    of_node
        .iter()
        .enumerate()
        .for_each(|(node, &place)| node_at.iter_mut().skip(place).take(1).for_each(|at| *at = Some(node)));
    let (mut number, mut n_empty, mut n_invalid) = (0, 0, 0);
    let again = if kept.is_empty() { import.files.as_slice() } else { &[] };
    let again = again.iter().map(|file| read_points(file, &import.options).map_err(RunError::from));
    for frames in std::iter::once(Ok(kept)).chain(again) {
        for frame in frames? {
            number += 1;
            n_invalid += frame.n_invalid;
            if frame.points.is_empty() {
                n_empty += 1;
                writer.mark(number, Status::Unreadable)?;
                continue;
            }
            let field = places.field(&frame, &node_at, &mesh, sigma);
            writer.write(number, &field, &StrainField::of(&field, import.strain))?;
        }
    }
    folder.write_case(&header.case)?;
    let imported = Imported {
        quadrille: env!("CARGO_PKG_VERSION"),
        layout: places.layout,
        n_frames: number,
        n_empty,
        n_nodes: mesh.n_nodes(),
        n_elements: mesh.n_elements(),
        n_left_out: places.points.len() - of_node.len(),
        n_invalid,
        shift_px: shift,
        sigma_from,
        sigma_px: sigma,
        remarks: vec![neighbours_share_pixels(places.program)],
    };
    folder.write_json(RECORD, &imported)?;
    Ok(imported)
}

/// What the standard uncertainties of another program do not hold.
fn neighbours_share_pixels(program: &str) -> Remark {
    let text = format!(
        "the fields were measured by {program}: sigma is of single points as if these were independent. Where subsets \
         overlap, means over many points and fitted parameters are less certain than stated"
    );
    Remark::new(Code::FieldImported, About::Run, text)
}

/// The places at which any frame has a point.
struct Places {
    layout: &'static str,
    program: &'static str,
    /// Name of each frame, in order.
    frames: Vec<String>,
    points: Vec<[f64; 2]>,
    /// Mean distance of neighbours, px.
    spacing: f64,
    cells: HashMap<[i64; 2], u32>,
    has_sigma: bool,
}

impl Places {
    /// Reads all files, and gives their frames where these fit in the memory.
    fn of_files(import: &Import) -> Result<(Self, Vec<FieldPoints>)> {
        let (mut kept, mut n_points) = (Vec::new(), 0);
        let mut places = Self {
            layout: "",
            program: "",
            frames: Vec::new(),
            points: Vec::new(),
            spacing: 0.0,
            cells: HashMap::new(),
            has_sigma: true,
        };
        for file in &import.files {
            let read = read_points(file, &import.options)?;
            let n = read.len();
            for (k, frame) in read.into_iter().enumerate() {
                let name = file.display().to_string();
                places.frames.push(if n > 1 { format!("{name}[{k}]") } else { name });
                if places.layout.is_empty() {
                    (places.layout, places.program) = (frame.layout.name, frame.layout.program);
                } else if places.layout != frame.layout.name {
                    return Err(format!(
                        "{} has the layout {}, the files before {}; import them apart, or give --layout",
                        file.display(),
                        frame.layout.name,
                        places.layout
                    )
                    .into());
                }
                places.add(&frame).map_err(|why| format!("{}: {why}", file.display()))?;
                n_points += frame.points.len();
                if n_points <= MOST_KEPT {
                    kept.push(frame);
                }
            }
        }
        if places.points.is_empty() {
            return Err("no file has a valid point".into());
        }
        if n_points > MOST_KEPT {
            kept.clear();
        }
        Ok((places, kept))
    }

    /// Takes the places of a frame; why it is none, where two of its points are at one.
    fn add(&mut self, frame: &FieldPoints) -> std::result::Result<(), String> {
        self.has_sigma &=
            frame.points.iter().all(|point| point.sigma.is_some_and(|sigma| sigma.iter().all(|s| *s > 0.0)));
        if self.spacing == 0.0 && !frame.points.is_empty() {
            let [low, high] = bounds(frame.points.iter().map(|point| &point.position));
            let area = (high[0] - low[0]) * (high[1] - low[1]);
            self.spacing = (area / frame.points.len() as f64).sqrt();
            if !(self.spacing > 0.0 && self.spacing.is_finite()) {
                self.spacing = 1.0; // on a line or at one place: no grid in any case
            }
        }
        let mut seen = HashSet::new();
        for &FieldPoint { position, .. } in &frame.points {
            let place = self.at(position).unwrap_or(self.points.len());
            if place == self.points.len() {
                self.cells.insert(self.cell(position), place as u32);
                self.points.push(position);
            }
            if !seen.insert(place) {
                let [x, y] = position;
                return Err(format!("two points are at the place ({x}, {y}); export each point once"));
            }
        }
        Ok(())
    }

    fn cell(&self, at: [f64; 2]) -> [i64; 2] {
        at.map(|v| (v / (SAME_PLACE * self.spacing)).round() as i64)
    }

    /// The place that a position is at.
    fn at(&self, at: [f64; 2]) -> Option<usize> {
        let [i, j] = self.cell(at);
        let around = (-1..=1).flat_map(|di| (-1..=1).map(move |dj| [i + di, j + dj]));
        let found = around.filter_map(|cell| Some(*self.cells.get(&cell)? as usize));
        let off = |&place: &usize| self.points.get(place).map_or(f64::MAX, |p| (p[0] - at[0]).hypot(p[1] - at[1]));
        let closest = found.min_by(|a, b| off(a).total_cmp(&off(b)))?;
        (off(&closest) <= SAME_PLACE * self.spacing).then_some(closest)
    }

    fn no_grid(&self, import: &Import) -> RunError {
        let deformed = if import.options.deformed {
            ""
        } else {
            ", and --coordinates deformed where positions move with the specimen"
        };
        RunError::Refused(format!(
            "the {} in {} form no grid: elements need points in rows and columns, of which half have neighbours on all \
             sides. Export all points of a regular grid{deformed}, or interpolate to one",
            plural(self.points.len(), "point"),
            plural(import.files.len(), "file"),
        ))
    }

    /// The field of a frame on the nodes of the mesh.
    fn field(
        &self,
        frame: &FieldPoints,
        node_at: &[Option<usize>],
        mesh: &Arc<Mesh<Px>>,
        sigma: Option<[f64; 2]>,
    ) -> Measurement<Px> {
        let mut nodes: Vec<Option<&FieldPoint>> = vec![None; mesh.n_nodes()];
        for point in &frame.points {
            let node = self.at(point.position).and_then(|place| node_at.get(place).copied().flatten());
            if let Some(held) = node.and_then(|node| nodes.get_mut(node)) {
                *held = Some(point);
            }
        }
        let displacement = nodes.iter().map(|point| point.map_or([0.0; 2], |point| point.displacement)).collect();
        let own = |point: &FieldPoint| sigma.or(point.sigma).unwrap_or_default();
        Measurement {
            mesh: Arc::clone(mesh),
            status: Status::Converged,
            displacement,
            sigma: nodes.iter().map(|point| point.map_or([0.0; 2], own)).collect(),
            measured: nodes.iter().map(Option::is_some).collect(),
            element_residual: Vec::new(),
            model_error: None,
            marks: None,
            points: None,
        }
    }
}

/// What is added to positions: nothing along an axis without any below zero, else the first stands one step from zero.
fn shift(points: &[[f64; 2]], spacing: f64) -> [f64; 2] {
    let [low, _] = bounds(points);
    low.map(|low| if low < 0.0 { spacing - low } else { 0.0 })
}

/// Where the standard uncertainty comes from, and its value where it is one for all points.
fn sigma_of(import: &Import, places: &Places) -> Result<(&'static str, Option<[f64; 2]>)> {
    match import.sigma_px {
        Some(sigma) if sigma.is_finite() && sigma > 0.0 => return Ok(("stated", Some([sigma; 2]))),
        Some(sigma) => return Err(format!("--sigma is {sigma}; give a standard uncertainty in px above zero").into()),
        None => {}
    }
    if !import.at_rest.is_empty() {
        return Ok(("at rest", Some(scatter_at_rest(import)?)));
    }
    match places.has_sigma {
        true => Ok(("file", None)),
        false => Err(
            "the files name no standard uncertainty above zero for every point: give --static with a field of the specimen at rest, from which \
                      it is estimated, or state it with --sigma (px; 0.01 to 0.05 is usual)"
                .into(),
        ),
    }
}

/// Standard deviation of the displacements of fields at rest about the plane that fits each best, px.
fn scatter_at_rest(import: &Import) -> Result<[f64; 2]> {
    /// Digits of a table scatter so, px; no measurement does.
    const LEAST_SCATTER: f64 = 1e-6;
    /// Unknowns of a plane.
    const PLANE: usize = 3;
    let (mut sums, mut n_free) = ([0.0; 2], 0);
    for file in &import.at_rest {
        for frame in read_points(file, &import.options)? {
            if frame.points.len() <= PLANE {
                continue;
            }
            for (c, sum) in sums.iter_mut().enumerate() {
                let values = frame
                    .points
                    .iter()
                    .map(|p| (p.position, if c == 0 { p.displacement[0] } else { p.displacement[1] }));
                *sum += about_plane(&values.collect::<Vec<_>>());
            }
            n_free += frame.points.len() - PLANE;
        }
    }
    let sigma = sums.map(|sum| (sum / n_free.max(1) as f64).sqrt());
    match sigma.iter().all(|sigma| *sigma > LEAST_SCATTER) {
        true => Ok(sigma),
        false => Err("the fields of --static do not scatter: they are no measurement".into()),
    }
}

/// Sum of squares about the plane of least squares.
fn about_plane(values: &[([f64; 2], f64)]) -> f64 {
    let n = values.len() as f64;
    let mean = values.iter().fold([0.0; 3], |[x, y, v], (at, value)| [x + at[0] / n, y + at[1] / n, v + value / n]);
    let off = || values.iter().map(|(at, value)| [at[0] - mean[0], at[1] - mean[1], value - mean[2]]);
    let product = |a: usize, b: usize| {
        off().map(|d| d.get(a).copied().unwrap_or(0.0) * d.get(b).copied().unwrap_or(0.0)).sum::<f64>()
    };
    let (xx, xy, yy, xv, yv) = (product(0, 0), product(0, 1), product(1, 1), product(0, 2), product(1, 2));
    let determinant = xx * yy - xy * xy;
    let slope = match determinant > 0.0 {
        true => [(xv * yy - yv * xy) / determinant, (yv * xx - xv * xy) / determinant],
        false => [0.0; 2],
    };
    off().map(|[x, y, v]| (v - slope[0] * x - slope[1] * y).powi(2)).sum()
}

fn header_of(import: &Import, places: &Places, mesh: &Arc<Mesh<Px>>) -> Result<StoreHeader> {
    let [_, high] = bounds(mesh.nodes());
    let mut image_size_px = high.map(|v| (v + places.spacing).ceil() as usize + 1);
    let (mut reference, mut reference_sha256) = (Vec::new(), Vec::new());
    if let Some(file) = &import.reference {
        let loaded = Frame::file(file.clone(), 0).read(Accepted::ANY)?;
        image_size_px = [loaded.image.width(), loaded.image.height()];
        if high.iter().zip(image_size_px).any(|(&v, side)| v > side as f64) {
            let ([x, y], [width, height]) = (high, image_size_px);
            let file = file.display();
            return Err(format!("points reach to ({x:.0}, {y:.0}) px, {file} has {width} x {height} px").into());
        }
        reference.push(absolute(file));
        reference_sha256.push(loaded.sha256);
    }
    let images = CaseImages {
        reference: (!reference.is_empty()).then(|| reference.clone()),
        pixel_size_mm: import.options.pixel_size.map(|size| size.mm_per_px()),
        ..CaseImages::default()
    };
    Ok(StoreHeader {
        quadrille: env!("CARGO_PKG_VERSION").into(),
        device: format!("{IMPORTED_FROM}{}", places.program),
        mesh: Arc::clone(mesh),
        image_size_px,
        reference,
        reference_sha256,
        frames: places.frames.clone(),
        pixel_size: import.options.pixel_size,
        // There are no residuals to be given in per cent of it.
        range_grey: 1.0,
        element_size_px: mesh.element_size(),
        strain: import.strain,
        strain_window: None,
        case: write_case(&CaseFile { images, ..CaseFile::default() }),
    })
}
