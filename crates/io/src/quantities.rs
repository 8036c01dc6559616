//! Quantities of a series as tables: long, a row for each frame and place.

#![expect(
    clippy::indexing_slicing,
    reason = "writes the tables of a run: its points, lines and cracks are counted by the case, and what was drawn of a frame has as many"
)]

mod lines;
mod rates;
mod still;
mod tension;

pub use self::lines::LineHistory;
pub use self::tension::TensionResult;

use self::rates::{DEGREE, smooth};
use self::still::{STILL, still_cells, still_remarks};
use self::tension::TensionHistory;
use super::csv::{PX_COLUMNS, WINDOW_COLUMNS, WINDOW_MODEL_COLUMNS};
use super::load::{LoadColumn, LoadTable};
use crate::camera::{CameraTerm, Rectifier, StillMotion};
use crate::field::{
    CrackLine, CrackTip, Curve, ElementMark, Elongation, FrameQuantities, Jump, Measurement, NodalNoise, OPEN_BY_SIGMA,
    PointValues, Quantities, RegionValues, Status, StrainWindows, TensorStrain, TipState, Value,
};
use crate::mesh::Mesh;
use crate::plane::distance;
use crate::remark::{About, Code, Remark};
use crate::units::{PixelSize, Px};
use std::io::{self, Write};

/// Names of the tables.
pub const QUANTITY_TABLES: [&str; 12] = [
    "points",
    "lines",
    "extensometers",
    "regions",
    "openings",
    "openings_mean",
    "rigid_motions",
    "cracks",
    "crack_tips",
    "rates",
    "still",
    "tension",
];
/// Those with rows for each frame; the last one has constants.
const BY_FRAME: usize = QUANTITY_TABLES.len() - 1;

/// Writes the quantities of a series frame by frame, and keeps what is needed to draw them against load or time.
///
/// Those tables that are asked for: `points`, `lines`, `extensometers`, `regions`, `openings` (a row for each point
/// of each joint), `openings_mean`, `rigid_motions`, `cracks` (a row for each place of each crack), `crack_tips`, and
/// `still` where the camera has still zones. Every row begins with `frame,status` and the columns of the load file.
/// Lengths are in px; with a pixel size every column
/// `_px` has a twin in mm at the end of the row. A value that does not exist (outside the mesh, not measured, frame
/// without field) is an empty cell.
pub struct QuantityTables<'a, W: Write> {
    quantities: &'a Quantities,
    load: &'a LoadTable,
    tables: [Option<Table<W>>; BY_FRAME],
    camera: Option<&'a Rectifier>,
    noise: Option<NodalNoise>,
    windows: Option<StrainWindows>,
    bound: bool,
    n_references: usize,
    traces: Vec<Trace>,
    lines: Vec<LineHistory>,
    cracks: Vec<CrackHistory>,
    /// Of the fields, by their numbers, how the still zones seem to move.
    still: Vec<(usize, Option<StillMotion>)>,
    frames: Vec<usize>,
    /// The first cells of their rows, number, status, loads, where rates are asked for.
    keys: Vec<Vec<String>>,
    without_field: Vec<usize>,
    n_fields: usize,
    /// Fields in which a place had no value; points, lines, extensometers, openings, in order.
    missing: Vec<(String, usize)>,
    /// The tensile test, where it is written to, and the lines at the head.
    tension: Option<(TensionHistory, W, Vec<String>)>,
}

/// The plane that quantities are drawn in.
#[derive(Debug, Clone, Copy, Default)]
pub struct QuantityPlane<'a> {
    /// What has brought the fields there; none of fields that are taken as they are.
    pub camera: Option<&'a Rectifier>,
    /// The scale, where it is known.
    pub pixel_size: Option<PixelSize>,
    /// Its relative standard uncertainty.
    pub pixel_size_std: f64,
    /// Images whose mean is the reference; 0 where it is not known, as 1.
    pub n_references: usize,
}

/// What is left when all frames are written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct QuantitySummary {
    /// Every point, extensometer and mean opening against each column of the load file, or else against the frame.
    pub curves: Vec<Curve>,
    /// What has no value and where, and how the load file was read.
    pub remarks: Vec<Remark>,
    /// The lines over the frames.
    pub lines: Vec<LineHistory>,
    /// The column of times of the load file, s.
    pub times: Option<LoadColumn>,
    /// The cracks over the frames.
    pub cracks: Vec<CrackHistory>,
    /// The tensile test.
    pub tension: Option<TensionResult>,
}

/// What became of a crack.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackHistory {
    /// Its name.
    pub name: String,
    /// Frames with a field.
    pub frames: Vec<CrackFrame>,
}

/// A crack in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct CrackFrame {
    /// Number of the frame.
    pub number: usize,
    /// Distance along the path and jump of each place that is measured.
    pub places: Vec<(f64, Jump)>,
    /// How many of them are beside an element that was left out: their nodes were followed one by one.
    pub followed: usize,
    /// Its tips.
    pub tips: Vec<CrackTip>,
}

/// One quantity over the frames.
struct Trace {
    name: String,
    quantity: &'static str,
    values: Vec<Option<Value>>,
}

struct Table<W: Write> {
    out: ::csv::Writer<W>,
    columns: Vec<&'static str>,
    /// Places among the columns of what the camera makes uncertain; none where it is exact.
    of_camera: Vec<usize>,
    mm: Option<PixelSize>,
    /// Relative standard uncertainty of the size of a pixel.
    scale_std: f64,
}

/// What is drawn from a field, and from the same field when the camera is off, in each direction of its parameters.
struct Drawn {
    values: FrameQuantities,
    changed: Vec<FrameQuantities>,
    /// The names of these directions.
    terms: Vec<&'static str>,
}

/// Columns that the uncertainty of the camera has a column for, beside the [`INVARIANTS`].
const OF_CAMERA: [&str; 15] = [
    "ux_px",
    "uy_px",
    "exx",
    "eyy",
    "exy",
    "ezz",
    "exx_window",
    "eyy_window",
    "exy_window",
    "elongation_px",
    "strain_engineering",
    "strain_true",
    TRUE_STRESS[0],
    "opening_px",
    "sliding_px",
];

impl<W: Write> Table<W> {
    /// A row with its key cells, then the numbers that `cells` takes of what is drawn, what the camera makes of them,
    /// and the twins in mm of both.
    fn row(
        &mut self,
        keys: &[String],
        drawn: Option<&Drawn>,
        cells: impl Fn(Option<&FrameQuantities>) -> Vec<Option<f64>>,
    ) -> io::Result<()> {
        for key in keys {
            self.out.write_field(key)?;
        }
        let cell = |number: Option<f64>| number.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:?}"));
        let numbers = cells(drawn.map(|drawn| &drawn.values));
        let changed: Vec<_> =
            drawn.iter().flat_map(|drawn| &drawn.changed).map(|changed| cells(Some(changed))).collect();
        let camera = |at: usize| {
            let off = |list: &Vec<Option<f64>>| Some((list[at]? - numbers[at]?).powi(2));
            numbers[at].and_then(|_| changed.iter().map(off).sum::<Option<f64>>()).map(f64::sqrt)
        };
        let of_camera: Vec<Option<f64>> = self.of_camera.iter().map(|&at| camera(at)).collect();
        for &number in numbers.iter().chain(&of_camera) {
            self.out.write_field(cell(number))?;
        }
        if let Some(size) = self.mm {
            let is_px = |at: usize| self.columns[at].ends_with("_px");
            for &number in (0..self.columns.len()).filter(|&at| is_px(at)).map(|at| &numbers[at]) {
                self.out.write_field(cell(number.map(|px| size.mm_from_px(px))))?;
            }
            for (&at, camera) in self.of_camera.iter().zip(&of_camera).filter(|(at, _)| is_px(**at)) {
                let both = camera.zip(numbers[at]).map(|(camera, value)| camera.hypot(self.scale_std * value));
                self.out.write_field(cell(both.map(|px| size.mm_from_px(px))))?;
            }
        }
        self.out.write_record(None::<&[u8]>)?;
        Ok(())
    }
}

const MODEL: [&str; 2] = ["model_error_ux_px", "model_error_uy_px"];
const STRAIN: [&str; 6] = ["exx", "eyy", "exy", "sigma_exx", "sigma_eyy", "sigma_exy"];
const INVARIANTS: [&str; 14] = [
    "magnitude_px",
    "sigma_magnitude_px",
    "e1",
    "sigma_e1",
    "e2",
    "sigma_e2",
    "e1_direction_deg",
    "sigma_e1_direction_deg",
    "shear_max",
    "sigma_shear_max",
    "von_mises",
    "sigma_von_mises",
    "rotation_deg",
    "sigma_rotation_deg",
];
const WINDOW_INVARIANTS: [&str; 10] = [
    "e1_window",
    "sigma_e1_window",
    "e2_window",
    "sigma_e2_window",
    "e1_direction_window_deg",
    "sigma_e1_direction_window_deg",
    "shear_max_window",
    "sigma_shear_max_window",
    "von_mises_window",
    "sigma_von_mises_window",
];

fn is_of_camera(column: &str) -> bool {
    let follows = INVARIANTS.contains(&column) || WINDOW_INVARIANTS.contains(&column);
    OF_CAMERA.contains(&column) || (follows && !column.starts_with("sigma_"))
}

const THICKNESS: [&str; 2] = ["ezz", "sigma_ezz"];
const RATES: [&str; 5] = ["time_s", "smooth", "sigma_smooth", "rate_per_s", "sigma_rate_per_s"];
const VARIES: [&str; 11] = [
    "spread_ux_px",
    "spread_uy_px",
    "spread_exx",
    "least_exx",
    "largest_exx",
    "spread_eyy",
    "least_eyy",
    "largest_eyy",
    "spread_exy",
    "least_exy",
    "largest_exy",
];
const LENGTHS: [&str; 3] = ["length_px", "elongation_px", "sigma_elongation_px"];
const STRETCH: [&str; 4] = ["strain_engineering", "sigma_strain_engineering", "strain_true", "sigma_strain_true"];
const TRUE_STRESS: [&str; 2] = ["stress_true_MPa", "sigma_stress_true_MPa"];
const JUMP: [&str; 4] = ["opening_px", "sigma_opening_px", "sliding_px", "sigma_sliding_px"];
const TIP: [&str; 4] = ["along_px", "sigma_along_px", "x_px", "y_px"];
const INTENSITY: [&str; 5] =
    ["K_I_MPa_sqrt_m", "sigma_K_I_MPa_sqrt_m", "K_II_MPa_sqrt_m", "sigma_K_II_MPa_sqrt_m", "radius_px"];
const RIGID: [&str; 7] =
    ["centre_x_px", "centre_y_px", "translation_x_px", "translation_y_px", "rotation_deg", "largest_px", "left_rms_px"];

impl<'a, W: Write> QuantityTables<'a, W> {
    /// Opens the tables that `quantities` ask for: `open` gives the file for the name of a table. Each begins with
    /// the comment lines `header` and the definitions of its columns.
    ///
    /// With `regularised` fields the noise of neighbouring nodes is correlated in a way that is not known, and
    /// standard uncertainties are upper bounds. Fields are those in the `plane`; where its camera is not
    /// exact, columns `camera_` say what that does.
    pub fn new(
        quantities: &'a Quantities,
        load: &'a LoadTable,
        plane: QuantityPlane<'a>,
        regularised: bool,
        element_size_px: f64,
        header: &[String],
        mut open: impl FnMut(&str) -> io::Result<W>,
    ) -> io::Result<Self> {
        let QuantityPlane { camera, pixel_size, pixel_size_std, n_references } = plane;
        let q = quantities;
        let window = match q.window {
            Some(_) => [&WINDOW_COLUMNS[..], &WINDOW_MODEL_COLUMNS, &WINDOW_INVARIANTS].concat(),
            None => vec![],
        };
        let thickness = if q.poisson.is_some() { &THICKNESS[..] } else { &[] };
        let point = [&PX_COLUMNS[..], &MODEL, &STRAIN, &INVARIANTS, thickness, &window].concat();
        let region =
            [&["measured_percent"][..], &PX_COLUMNS, &MODEL, &STRAIN, &INVARIANTS, thickness, &VARIES].concat();
        let opening = [&["along_px", "x_px", "y_px", "gap_px", "normal_x", "normal_y"][..], &JUMP].concat();
        let crack = [&["along_px", "x_px", "y_px", "normal_x", "normal_y"][..], &JUMP].concat();
        let stretch = [&LENGTHS[..], &STRETCH, if load.stress().is_some() { &TRUE_STRESS } else { &[] }].concat();
        let has_tip = q.cracks.iter().any(|(_, crack)| crack.joined().next().is_some());
        let wanted = [
            (!q.points.is_empty(), vec!["point"], point.clone()),
            (!q.lines.is_empty(), vec!["line"], [&["along_px"][..], &point].concat()),
            (!q.extensometers.is_empty(), vec!["extensometer"], stretch),
            (!q.regions.is_empty(), vec!["region"], region),
            (!q.openings.is_empty(), vec!["opening", "part"], opening),
            (!q.openings.is_empty(), vec!["opening"], JUMP.to_vec()),
            (q.remove_rigid.is_some(), vec!["zone"], RIGID.to_vec()),
            (!q.cracks.is_empty(), vec!["crack", "mark"], crack),
            (has_tip, vec!["crack", "end", "state"], [&TIP[..], &INTENSITY].concat()),
            (q.rate_window_s.is_some(), vec!["of", "quantity"], RATES.to_vec()),
            (camera.is_some_and(Rectifier::has_still), vec![], STILL.to_vec()),
        ];
        let mut tables = [const { None }; BY_FRAME];
        for (k, (wanted, keys, columns)) in wanted.into_iter().enumerate() {
            if !wanted {
                continue;
            }
            let mut out = open(QUANTITY_TABLES[k])?;
            let of_camera = match camera.is_some_and(|camera| !camera.camera().is_exact()) {
                true => (0..columns.len()).filter(|&at| is_of_camera(columns[at])).collect(),
                false => Vec::new(),
            };
            let of_plane = said_of_camera(camera, !of_camera.is_empty());
            let said = definitions(q, QUANTITY_TABLES[k], regularised, element_size_px, pixel_size);
            for line in header.iter().chain(&said).chain(&of_plane).flat_map(|text| text.split(['\n', '\r'])) {
                writeln!(out, "# {line}")?;
            }
            let mut out = ::csv::WriterBuilder::new().has_headers(false).from_writer(out);
            let cameras: Vec<String> = of_camera.iter().map(|&at| format!("camera_{}", columns[at])).collect();
            let mm: Vec<String> = match pixel_size {
                Some(_) => {
                    let all = columns.iter().copied().chain(cameras.iter().map(String::as_str));
                    all.filter_map(|c| Some(format!("{}_mm", c.strip_suffix("_px")?))).collect()
                }
                None => Vec::new(),
            };
            let names = ["frame", "status"].into_iter().chain(load.columns.iter().map(|column| column.name.as_str()));
            let names = names.chain(keys).chain(columns.iter().copied());
            out.write_record(names.chain(cameras.iter().chain(&mm).map(String::as_str)))?;
            tables[k] = Some(Table { out, columns, of_camera, mm: pixel_size, scale_std: pixel_size_std });
        }
        let of_points = PointValues::quantities(q.window).iter().map(|(quantity, _)| *quantity).collect::<Vec<_>>();
        let of_means = PointValues::quantities(None).iter().map(|(quantity, _)| *quantity).collect::<Vec<_>>();
        let traced = (q.points.iter().map(|(name, _)| (name, of_points.clone())))
            .chain(q.extensometers.iter().map(|(name, _)| (name, Elongation::QUANTITIES.map(|named| named.0).to_vec())))
            .chain(q.regions.iter().map(|(name, _)| (name, of_means.clone())))
            .chain(q.openings.iter().map(|(name, _)| (name, Jump::QUANTITIES.map(|named| named.0).to_vec())));
        let still = "still zones".to_owned();
        let of_still = camera.filter(|camera| camera.has_still()).map(|_| (&still, vec![STILL[0]]));
        let traced = traced.chain(of_still);
        let trace = |name: &String, quantity| Trace { name: name.clone(), quantity, values: Vec::new() };
        let traces = traced.flat_map(|(name, of)| of.into_iter().map(move |quantity| trace(name, quantity))).collect();
        let named = |kind: &str, name: &String| (format!("{kind} '{name}'"), 0);
        let missing = q
            .points
            .iter()
            .map(|(name, [x, y])| (format!("point '{name}' ({x}, {y}) px"), 0))
            .chain(q.lines.iter().map(|(name, _)| named("line", name)))
            .chain(q.extensometers.iter().map(|(name, _)| named("extensometer", name)))
            .chain(q.regions.iter().map(|(name, _)| named("region", name)))
            .chain(q.openings.iter().map(|(name, _)| named("opening", name)))
            .chain(q.cracks.iter().map(|(name, _)| named("crack", name)))
            .collect();
        let tension = q.tension.map(|gauges| TensionHistory::new(gauges, n_references));
        let opened = |history| Ok::<_, io::Error>((history, open("tension")?, header.to_vec()));
        Ok(Self {
            tension: tension.map(opened).transpose()?,
            quantities,
            load,
            tables,
            camera,
            noise: None,
            windows: None,
            bound: regularised,
            n_references: n_references.max(1),
            traces,
            lines: LineHistory::of(q),
            cracks: q.cracks.iter().map(|(name, _)| CrackHistory { name: name.clone(), frames: Vec::new() }).collect(),
            still: Vec::new(),
            frames: Vec::new(),
            keys: Vec::new(),
            without_field: Vec::new(),
            n_fields: 0,
            missing,
        })
    }

    /// Writes the rows of one frame, whose `field` is `None` without one (diverged, unreadable); gives what was drawn.
    /// `still` is what was taken off the field with the still zones.
    pub fn frame(
        &mut self,
        number: usize,
        status: Option<Status>,
        field: Option<&Measurement<Px>>,
        still: Option<StillMotion>,
    ) -> io::Result<Option<FrameQuantities>> {
        let drawn = field.map(|field| {
            let raw = self.camera.map(Rectifier::raw_mesh);
            let noise = NodalNoise::along(self.noise.take(), field, self.bound, raw);
            let noise = self.noise.insert(noise);
            if let (None, Some(window)) = (&self.windows, self.quantities.window) {
                self.windows = Some(StrainWindows::new(&field.mesh, window, self.bound));
            }
            let windows = self.windows.as_ref();
            let terms = self.camera.map_or_else(Vec::new, |camera| camera.terms(field));
            let (values, mut other) = (noise.values_only(), field.clone());
            let off = |CameraTerm { change, .. }: CameraTerm| {
                let changed = field.displacement.iter().zip(change).map(|(u, by)| [u[0] + by[0], u[1] + by[1]]);
                other.displacement = changed.collect();
                self.quantities.draw(&other, &values, windows)
            };
            Drawn {
                terms: terms.iter().map(|term| term.name).collect(),
                values: self.quantities.draw(field, noise, windows),
                changed: terms.into_iter().map(off).collect(),
            }
        });
        let whole = drawn.as_ref();
        let drawn = whole.map(|drawn| &drawn.values);
        self.frames.push(number);
        match drawn {
            Some(drawn) => self.count_missing(drawn),
            None => self.without_field.push(number),
        }
        self.keep_traces(drawn, still);
        for (at, line) in self.lines.iter_mut().enumerate() {
            line.take(number, at, drawn, self.quantities);
        }
        if let (Some((history, ..)), Some(whole)) = (&mut self.tension, whole) {
            history.take(number, &whole.values, (&whole.changed, &whole.terms), self.quantities);
        }
        self.still.extend(field.map(|_| (number, still)));
        for (k, history) in self.cracks.iter_mut().enumerate() {
            let Some(values) = drawn.map(|drawn| &drawn.cracks[k]) else { continue };
            let places = self.quantities.cracks[k].1.points().iter().zip(&values.points);
            let places = places.filter_map(|(point, jump)| Some((point.along, (*jump)?))).collect();
            let given = values.points.iter().zip(&values.marks).filter(|(jump, _)| jump.is_some());
            let followed = given.filter(|(_, mark)| **mark >= ElementMark::Saturated).count();
            history.frames.push(CrackFrame { number, places, followed, tips: values.tips.clone() });
        }
        let mut keys = vec![number.to_string(), status.map_or("not_done", Status::name).to_owned()];
        for column in &self.load.columns {
            keys.push(column.at(number).map_or(String::new(), |value| format!("{value:?}")));
        }
        self.write(number, &keys, whole, field.map(|field| &*field.mesh))?;
        if let [.., Some(table)] = &mut self.tables {
            table.row(&keys, whole, |_| still_cells(still).to_vec())?;
        }
        if self.quantities.rate_window_s.is_some() {
            self.keys.push(keys);
        }
        Ok(whole.map(|drawn| drawn.values.clone()))
    }

    fn write(
        &mut self,
        number: usize,
        keys: &[String],
        drawn: Option<&Drawn>,
        mesh: Option<&Mesh<Px>>,
    ) -> io::Result<()> {
        let q = self.quantities;
        let with = |names: &[&str]| [keys, &names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>()].concat();
        let stress = self.load.stress();
        let [points, lines, extensometers, regions, openings, means, rigid, cracks, tips, ..] = &mut self.tables;
        if let Some(table) = points {
            for (k, (name, at)) in q.points.iter().enumerate() {
                table.row(&with(&[name]), drawn, |drawn| {
                    point_cells(Some(*at), drawn.and_then(|drawn| drawn.points[k]), q, q.window.is_some())
                })?;
            }
        }
        if let Some(table) = lines {
            for (k, (name, line)) in q.lines.iter().enumerate() {
                for (i, (along, at)) in line.points().into_iter().enumerate() {
                    table.row(&with(&[name]), drawn, |drawn| {
                        let values = drawn.and_then(|drawn| drawn.lines[k][i]);
                        [&[Some(along)][..], &point_cells(Some(at), values, q, q.window.is_some())].concat()
                    })?;
                }
            }
        }
        if let Some(table) = extensometers {
            for (k, (name, extensometer)) in q.extensometers.iter().enumerate() {
                let [from, to] = extensometer.ends();
                table.row(&with(&[name]), drawn, |drawn| {
                    let read = drawn.and_then(|drawn| drawn.extensometers[k]);
                    let of_it = Elongation::QUANTITIES.iter().flat_map(|(_, value)| pair(read.as_ref().map(value)));
                    let stress = stress.map(|stress| true_stress(stress.at(number), read));
                    [Some(distance(to, from))].into_iter().chain(of_it).chain(stress.into_iter().flatten()).collect()
                })?;
            }
        }
        if let Some(table) = regions {
            for (k, (name, _)) in q.regions.iter().enumerate() {
                table.row(&with(&[name]), drawn, |drawn| region_cells(drawn.and_then(|drawn| drawn.regions[k]), q))?;
            }
        }
        let at_joint =
            |place: &[f64], jump| -> Vec<_> { place.iter().copied().map(Some).chain(jump_cells(jump)).collect() };
        if let Some(table) = openings {
            for (k, (name, facing)) in q.openings.iter().enumerate() {
                for (i, point) in facing.points().iter().enumerate() {
                    let ([x, y], [nx, ny]) = (point.at, point.normal);
                    table.row(&with(&[name, &(point.part + 1).to_string()]), drawn, |drawn| {
                        let jump = drawn.and_then(|drawn| drawn.openings[k].points[i]);
                        at_joint(&[point.along, x, y, point.gap, nx, ny], jump)
                    })?;
                }
            }
        }
        if let Some(table) = means {
            for (k, (name, _)) in q.openings.iter().enumerate() {
                let mean = |drawn: Option<&FrameQuantities>| drawn.and_then(|drawn| drawn.openings[k].mean);
                table.row(&with(&[name]), drawn, |drawn| jump_cells(mean(drawn)))?;
            }
        }
        if let Some(table) = cracks {
            for (k, (name, crack)) in q.cracks.iter().enumerate() {
                for (i, point) in crack.points().iter().enumerate() {
                    let jump = |drawn: Option<&FrameQuantities>| drawn.and_then(|drawn| drawn.cracks[k].points[i]);
                    let ([x, y], [nx, ny]) = (point.at, point.normal);
                    let read = drawn.map(|drawn| &drawn.values).filter(|values| jump(Some(values)).is_some());
                    let mark = read.map_or("", |drawn| drawn.cracks[k].marks[i].name());
                    table.row(&with(&[name, mark]), drawn, |drawn| {
                        at_joint(&[point.along, x, y, nx, ny], jump(drawn))
                    })?;
                }
            }
        }
        if let Some(table) = tips {
            for (k, (name, crack)) in q.cracks.iter().enumerate() {
                for (i, (end, _)) in crack.joined().enumerate() {
                    let tip = drawn.map(|drawn| drawn.values.cracks[k].tips[i]);
                    let end = if end == 0 { "first" } else { "last" };
                    let keys = with(&[name, end, tip.map_or("", |tip| tip.state.name())]);
                    table.row(&keys, drawn, |_| tip_cells(tip).to_vec())?;
                }
            }
        }
        if let Some(table) = rigid {
            for removed in drawn.map_or(&[][..], |drawn| &drawn.values.removed) {
                let zone = removed.zone.zip(mesh).map_or("all", |(zone, mesh)| &mesh.zones()[zone]);
                let m = removed.motion;
                let ([x, y], [tx, ty], degrees) = (m.centre, m.translation, m.rotation_rad.to_degrees());
                let cells = [x, y, tx, ty, degrees, removed.largest, removed.left_rms];
                table.row(&with(&[zone]), drawn, |_| cells.map(Some).to_vec())?;
            }
        }
        Ok(())
    }

    fn count_missing(&mut self, drawn: &FrameQuantities) {
        self.n_fields += 1;
        let lacks = drawn
            .points
            .iter()
            .map(Option::is_none)
            .chain(drawn.lines.iter().map(|line| line.iter().any(Option::is_none)))
            .chain(drawn.extensometers.iter().map(Option::is_none))
            .chain(drawn.regions.iter().map(Option::is_none))
            .chain(drawn.openings.iter().map(|opening| opening.points.iter().any(Option::is_none)))
            .chain(drawn.cracks.iter().map(|crack| crack.points.iter().any(Option::is_none)));
        for ((_, n), lacks) in self.missing.iter_mut().zip(lacks) {
            *n += usize::from(lacks);
        }
    }

    fn keep_traces(&mut self, drawn: Option<&FrameQuantities>, still: Option<StillMotion>) {
        let q = self.quantities;
        let mut values = Vec::with_capacity(self.traces.len());
        for k in 0..q.points.len() {
            let point = drawn.and_then(|drawn| drawn.points[k]);
            values.extend(PointValues::quantities(q.window).iter().map(|(_, value)| point.as_ref().and_then(value)));
        }
        for k in 0..q.extensometers.len() {
            let read = drawn.and_then(|drawn| drawn.extensometers[k]);
            values.extend(Elongation::QUANTITIES.map(|(_, value)| read.as_ref().map(value)));
        }
        for k in 0..q.regions.len() {
            let mean = drawn.and_then(|drawn| drawn.regions[k]).map(|region| region.mean);
            values.extend(PointValues::quantities(None).iter().map(|(_, value)| mean.as_ref().and_then(value)));
        }
        for k in 0..q.openings.len() {
            let mean = drawn.and_then(|drawn| drawn.openings[k].mean);
            values.extend(Jump::QUANTITIES.map(|(_, value)| mean.as_ref().map(value)));
        }
        values.push(still.map(|still| still.distance_change()));
        for (trace, value) in self.traces.iter_mut().zip(values) {
            trace.values.push(value);
        }
    }

    /// Writes what quantities come to over time, and gives the rates as curves.
    fn write_rates(&mut self) -> io::Result<Vec<Curve>> {
        let [.., Some(table), _] = &mut self.tables else { return Ok(Vec::new()) };
        let (Some(window), Some(clock)) = (self.quantities.rate_window_s, self.load.times()) else {
            return Ok(Vec::new());
        };
        let times: Vec<Option<f64>> = self.frames.iter().map(|&frame| clock.at(frame)).collect();
        let mut curves = Vec::new();
        for trace in &self.traces {
            let smoothed = smooth(&times, &trace.values, window, 1.0 / (1.0 + self.n_references as f64));
            for (keys, (time, smooth)) in self.keys.iter().zip(times.iter().zip(&smoothed)) {
                let [value, rate] = [0, 1].map(|k| pair(smooth.map(|smooth| [smooth.value, smooth.rate][k])));
                let keys = [&keys[..], &[trace.name.clone(), trace.quantity.to_owned()]].concat();
                table.row(&keys, None, |_| [&[*time][..], &value, &rate].concat())?;
            }
            let points = times.iter().zip(&smoothed).filter_map(|(t, smooth)| Some(((*t)?, smooth.map(|s| s.rate))));
            curves.extend(Curve::new(&trace.name, &format!("{}_per_s", trace.quantity), &clock.name, points));
        }
        Ok(curves)
    }

    /// Closes the tables; gives the curves and what has no value.
    pub fn finish(mut self) -> io::Result<QuantitySummary> {
        let mut curves = self.write_rates()?;
        for table in self.tables.iter_mut().flatten() {
            table.out.flush()?;
        }
        for trace in &self.traces {
            // At the reference, where all is zero, a curve begins.
            let over = |against: &str, first: Option<f64>, x: &dyn Fn(usize) -> Option<f64>| {
                let first =
                    first.filter(|_| self.frames.first() == Some(&1) && trace.values.iter().any(Option::is_some));
                let first = first.map(|x| (x, Some(Value { value: 0.0, sigma: 0.0 })));
                let points = self.frames.iter().zip(&trace.values).filter_map(|(&f, v)| Some((x(f)?, *v)));
                Curve::new(&trace.name, trace.quantity, against, first.into_iter().chain(points))
            };
            if self.load.columns.is_empty() {
                curves.extend(over("frame", Some(0.0), &|frame| Some(frame as f64)));
            }
            for column in &self.load.columns {
                curves.extend(over(&column.name, column.reference, &|frame| column.at(frame)));
            }
        }
        let true_strain = Elongation::QUANTITIES[2].0;
        for trace in self.traces.iter().filter(|trace| trace.quantity == true_strain) {
            let Some(stress) = self.load.stress() else { continue };
            let at = |(&frame, strain): (&usize, &Option<Value>)| {
                let stretch = (*strain)?.value.exp();
                Some((stress.at(frame)? * stretch, *strain))
            };
            let points = self.frames.iter().zip(&trace.values).filter_map(at);
            curves.extend(Curve::new(&trace.name, true_strain, TRUE_STRESS[0], points));
        }
        let mut remarks = self.load.remarks.clone();
        if let Some(first) = self.without_field.first() {
            let n = self.without_field.len();
            let text = format!(
                "{n} of {} frames have no field, the first is {first}: their cells are empty",
                self.frames.len()
            );
            let about = About::Frames(self.without_field.clone());
            remarks.push(Remark::new(Code::CellsEmpty, about, text));
        }
        for (what, n) in self.missing.iter().filter(|(_, n)| *n > 0) {
            let text = match *n == self.n_fields {
                true => format!(
                    "{what} lies at least in part outside the mesh or on nodes that are not measured: cells are empty"
                ),
                false => format!(
                    "{what} lies at least in part on nodes that are not measured in {n} of {} fields: cells are empty",
                    self.n_fields
                ),
            };
            remarks
                .push(Remark::new(Code::CellsEmpty, About::Run, text).with("place", what.as_str()).with("fields", *n));
        }
        remarks.extend(
            self.quantities.cracks.iter().zip(&self.cracks).filter_map(|((_, crack), history)| history.remark(crack)),
        );
        if self.camera.is_some_and(Rectifier::has_still) {
            remarks.extend(still_remarks(&self.still));
        }
        let mut tension = None;
        if let Some((history, out, header)) = self.tension {
            let result = history.finish(self.load);
            result.write(out, &header)?;
            remarks.extend(result.remarks());
            tension = Some(result);
        }
        let times = self.load.times().cloned();
        Ok(QuantitySummary { curves, remarks, lines: self.lines, times, cracks: self.cracks, tension })
    }
}

impl CrackHistory {
    /// What a user should know: a crack that has grown beyond its path, stress intensities that could not be found.
    fn remark(&self, crack: &CrackLine) -> Option<Remark> {
        let tips = || self.frames.iter().flat_map(|frame| frame.tips.iter().map(|tip| (frame.number, tip)));
        let n = self.frames.len();
        let mut said = Vec::new();
        let open: Vec<usize> = tips().filter(|(_, tip)| tip.state == TipState::OpenToEnd).map(|(k, _)| k).collect();
        if let Some(first) = open.first() {
            said.push(format!(
                "is open to the end of its path in {} of {n} fields, first in frame {first}: the tip may lie further on; lengthen \
                 the path by some elements to find it",
                open.len()
            ));
        }
        let followed: usize = self.frames.iter().map(|frame| frame.followed).sum();
        if followed > 0 {
            let all: usize = self.frames.iter().map(|frame| frame.places.len()).sum();
            said.push(format!(
                "has {followed} of {all} openings beside elements that do not match: their nodes were followed one by one; see \
                 'mark' in cracks.csv before they are used"
            ));
        }
        if crack.elasticity().is_some() {
            let lacking = tips().filter(|(_, tip)| tip.intensity.is_none()).count();
            if lacking > 0 {
                said.push(format!(
                    "has no stress intensity in {lacking} of {n} fields: less than four elements lie between the tip and the next \
                     border, bend of the path or node that is not measured"
                ));
            }
            if crack.joined().next().is_none() {
                said.push(
                    "has no tip inside the mesh, and so no stress intensity: its path cuts the zone in two".to_owned(),
                );
            }
        }
        let text = format!("crack '{}' {}", self.name, said.join("; "));
        (!said.is_empty()).then(|| Remark::new(Code::CrackTip, About::Crack(self.name.clone()), text))
    }
}

fn tip_cells(tip: Option<CrackTip>) -> [Option<f64>; 9] {
    let along = pair(tip.and_then(|tip| tip.along));
    let at = tip.and_then(|tip| tip.at);
    let k = tip.and_then(|tip| tip.intensity);
    let (k1, k2) = (pair(k.map(|k| k.k1)), pair(k.map(|k| k.k2)));
    [along[0], along[1], at.map(|p| p[0]), at.map(|p| p[1]), k1[0], k1[1], k2[0], k2[1], k.map(|k| k.radius)]
}

fn pair(value: Option<Value>) -> [Option<f64>; 2] {
    [value.map(|v| v.value), value.map(|v| v.sigma)]
}

/// The force over the cross-section that is left of it while the volume stays: `stress (1 + strain)`.
fn true_stress(stress: Option<f64>, read: Option<Elongation>) -> [Option<f64>; 2] {
    let both = stress.zip(read.map(|read| read.engineering));
    pair(both.map(|(stress, e)| Value { value: stress * (1.0 + e.value), sigma: stress.abs() * e.sigma }))
}

fn jump_cells(jump: Option<Jump>) -> Vec<Option<f64>> {
    Jump::QUANTITIES.iter().flat_map(|(_, value)| pair(jump.as_ref().map(value))).collect()
}

fn point_cells(at: Option<[f64; 2]>, values: Option<PointValues>, q: &Quantities, windowed: bool) -> Vec<Option<f64>> {
    let of_each = |pair: Option<[f64; 2]>| [0, 1].map(|k| pair.map(|pair| pair[k]));
    let of_strain = |strain: Option<(TensorStrain, [f64; 3])>| {
        let both = strain.map(|(strain, sigma)| [strain.components(), sigma]);
        (0..6).map(move |k| both.map(|both| both[k / 3][k % 3]))
    };
    let mut cells = of_each(at).to_vec();
    cells.extend(of_each(values.map(|v| v.displacement)));
    cells.extend(of_each(values.map(|v| v.sigma)));
    cells.extend(of_each(values.and_then(|v| v.model_error)));
    cells.extend(of_strain(values.and_then(|v| v.strain)));
    cells.extend(pair(values.map(|v| v.magnitude)));
    cells.extend((0..5).flat_map(|k| pair(values.and_then(|v| Some(v.invariants?[k])))));
    cells.extend(pair(values.and_then(|v| v.rotation_deg)));
    if let Some(nu) = q.poisson {
        // Plane stress.
        let factor = nu / (1.0 - nu);
        let sum = values.and_then(|v| v.sum);
        cells.extend(pair(sum.map(|sum| Value { value: -factor * sum.value, sigma: factor.abs() * sum.sigma })));
    }
    if windowed {
        cells.extend(of_strain(values.and_then(|v| v.window)));
        let model = values.and_then(|v| v.window_model_error);
        cells.extend((0..3).map(|k| model.map(|error| error[k])));
        cells.extend((0..5).flat_map(|k| pair(values.and_then(|v| Some(v.window_invariants?[k])))));
    }
    cells
}

fn region_cells(region: Option<RegionValues>, q: &Quantities) -> Vec<Option<f64>> {
    let spread = |k: usize| region.map(|region| region.spread[k]);
    let of_strain = |k: usize| region.and_then(|region| Some(region.strain?[k]));
    let varies = |k: usize| of_strain(k).map(|of| [of.deviation, of.least, of.largest]);
    let strains = (0..3).flat_map(|k| (0..3).map(move |i| varies(k).map(|of| of[i])));
    let mean = point_cells(region.map(|region| region.at), region.map(|region| region.mean), q, false);
    let measured = region.map(|region| 100.0 * region.measured);
    [measured].into_iter().chain(mean).chain([spread(0), spread(1)]).chain(strains).collect()
}

/// What the camera does to the numbers of a table.
fn said_of_camera(camera: Option<&Rectifier>, has_columns: bool) -> Vec<String> {
    let plane = camera
        .filter(|camera| !camera.camera().is_plain())
        .map(|_| "camera: taken off; all is in the plane of the specimen, with a px as at the centre of the camera");
    let columns = "camera_: standard uncertainty by the camera, beside sigma; it is common to all places and frames";
    let still =
        camera.filter(|camera| camera.has_still()).map(|_| "still zones: their motion is taken off (still.csv)");
    plane.into_iter().chain(still).chain(has_columns.then_some(columns)).map(str::to_owned).collect()
}

const THICKNESS_IN_WORDS: &str = "ezz = -nu/(1 - nu) (exx + eyy): through the thickness, under plane stress, elastic";
const INVARIANTS_IN_WORDS: &str = "e1, e2: principal strains in the plane, e1 the larger; e1_direction_deg: from x towards y (down); \
    shear_max = (e1 - e2)/2; von_mises = sqrt(2/3 (e1^2 + e2^2 + e3^2)) with e3 = -e1 - e2; rotation_deg: of the polar decomposition, \
    from x towards y; where e1 - e2 is not above its noise, the noise makes e1 larger and e2 smaller";

/// What the columns of a table mean.
fn definitions(
    quantities: &Quantities,
    table: &str,
    regularised: bool,
    element_size_px: f64,
    pixel_size: Option<PixelSize>,
) -> Vec<String> {
    let mut said = vec![
        "lengths in px: x to the right, y down, origin at the centre of the top-left pixel of the reference image"
            .to_owned(),
        match quantities.remove_rigid {
            Some(which) => format!("rigid motion removed: {} (rigid_motions.csv)", which.name()),
            None => "rigid motion not removed".to_owned(),
        },
        match regularised {
            true => "sigma: upper bound of the standard uncertainty, since a regularisation or splines bind the nodes to each other",
            false => "sigma: standard uncertainty from that of the nodes and the correlation of their noise",
        }
        .to_owned(),
        "an empty cell has no value: outside the mesh, not measured, or a frame without field".to_owned(),
    ];
    if let Some(size) = pixel_size {
        said.push(format!("1 px = {:?} mm", size.mm_per_px()));
    }
    match table {
        "points" | "lines" => {
            said.extend(quantities.strain.describe(element_size_px));
            said.push("strain at a point: interpolated between the nodes, so over twice the element size".to_owned());
            said.push(INVARIANTS_IN_WORDS.to_owned());
            said.extend(quantities.poisson.map(|nu| format!("{THICKNESS_IN_WORDS}, nu = {nu}")));
            said.extend(quantities.window.iter().flat_map(|window| window.describe(element_size_px)));
        }
        "extensometers" => said.push(
            "length: distance in the reference; strain_engineering = elongation/length, strain_true = ln(1 + elongation/length); \
             stress_true = stress (1 + strain_engineering): the volume stays, and strain is even along the gauge (until it necks)"
                .to_owned(),
        ),
        "regions" => {
            said.extend(quantities.strain.describe(element_size_px));
            said.push(
                "means over what is measured of the region: x, y, ux, uy; exx, eyy, exy and what follows from them: of the mean \
                 gradient. Over the same, noise included: spread, the standard deviation; least and largest, of local strains"
                    .to_owned(),
            );
            said.push(INVARIANTS_IN_WORDS.to_owned());
            said.extend(quantities.poisson.map(|nu| format!("{THICKNESS_IN_WORDS}, nu = {nu}")));
        }
        "openings" | "openings_mean" => said.push(
            "jump first zone minus second; opening along the normal from the second to the first, positive when they move apart; \
             sliding along the tangent (-normal_y, normal_x), +x for a horizontal joint with the first zone above"
                .to_owned(),
        ),
        "cracks" => said.push(
            "jump + minus -, + lying to the left of the path as it is seen on the screen; opening along the normal from - to +, positive \
             when the faces move apart; sliding along the path (-normal_y, normal_x); mark: the gravest of the elements on either face: beside \
             no_match an opening is to be doubted"
                .to_owned(),
        ),
        "crack_tips" => {
            said.push(format!(
                "tip: where the opening falls below {OPEN_BY_SIGMA} sigma, along the path from its first point; state open_to_end: open up to \
                 the end of the path, the tip may lie further on; closed: nowhere open"
            ));
            said.push(
                "K_I, K_II: stress intensity by interaction integral between two circles about the tip (about the end of the path when \
                 closed), the outer of radius_px; plane stress; 1 MPa sqrt(m) = 31.62 MPa sqrt(mm)"
                    .to_owned(),
            );
        }
        "rates" => said.push(format!(
            "smooth, rate: value and slope at the time of the frame of the polynomial of degree {DEGREE} that fits what lies in {} s \
             around it (at the ends in the first and the last {} s), in the unit of the quantity, and that per second; sigma: by noise, of which the reference's is common to all frames \
             and goes out of a rate; what such a polynomial does not follow is not in it",
            quantities.rate_window_s.unwrap_or_default(),
            quantities.rate_window_s.unwrap_or_default()
        )),
        "still" => said.push(
            "how the still zones seem to move in the plane, taken off all that is in the plane: a point X goes to C + shift + (1 + \
             growth) R (X - C), C their middle; distance_change: dZ/Z = 1/(1 + growth) - 1; strain: beside it, the larger of \
             (exx - eyy)/2 and exy by its sigma; squares: 1 where noise is all that is left"
                .to_owned(),
        ),
        _ => said.push(
            "exact rotation about the centre, then translation; largest_px: largest displacement of a node by the motion; \
             left_rms_px: root mean square length of what is left"
                .to_owned(),
        ),
    }
    said
}
