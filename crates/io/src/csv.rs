//! Displacement fields as tables of comma-separated values.

use crate::field::{ElementMark, Invariant, Measurement, StrainField, TensorStrain};
use crate::units::{PixelSize, Px};
use ::csv::{ReaderBuilder, StringRecord, WriterBuilder};
use std::io::{self, Read, Write};
use std::sync::Arc;
use thiserror::Error;

const STRAIN_COLUMNS: [&str; 3] = ["exx", "eyy", "exy"];
pub(crate) const WINDOW_COLUMNS: [&str; 6] =
    ["exx_window", "eyy_window", "exy_window", "sigma_exx_window", "sigma_eyy_window", "sigma_exy_window"];
pub(crate) const WINDOW_MODEL_COLUMNS: [&str; 3] =
    ["model_error_exx_window", "model_error_eyy_window", "model_error_exy_window"];
pub(crate) const PX_COLUMNS: [&str; 6] = ["x_px", "y_px", "ux_px", "uy_px", "sigma_ux_px", "sigma_uy_px"];
const MODEL_COLUMNS: [&str; 2] = ["model_error_ux_px", "model_error_uy_px"];
const POINT_COLUMNS: [&str; 5] =
    ["ux_point_px", "uy_point_px", "sigma_ux_point_px", "sigma_uy_point_px", "is_point_value"];
const MARK_COLUMN: &str = "mark";
const MM_COLUMNS: [&str; 6] = ["x_mm", "y_mm", "ux_mm", "uy_mm", "sigma_ux_mm", "sigma_uy_mm"];

/// Why a table of displacements cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CsvError {
    /// A column that every table of displacements has is not in the header line.
    #[error("there is no column '{name}'; is this a table that quadrille wrote?")]
    MissingColumn {
        /// Name of the column.
        name: &'static str,
    },
    /// A cell does not hold the number that its column promises.
    #[error("line {line}, column '{column}': '{text}' is not a finite number (a node is a whole number from 0)")]
    Number {
        /// Line of the file, from 1.
        line: u64,
        /// Name of the column.
        column: &'static str,
        /// What stands there.
        text: String,
    },
    /// The line is not a row of the table: too short, too long, or not UTF-8.
    #[error("line {line} is not a row of the table")]
    Row {
        /// Line of the file, from 1.
        line: u64,
        /// What the parser says.
        source: ::csv::Error,
    },
    /// The file cannot be read.
    #[error("the table cannot be read")]
    Read(#[source] ::csv::Error),
}

/// Position, displacement and standard uncertainty of a node, all in one unit; x to the right, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeValues {
    /// Position in the reference image.
    pub position: [f64; 2],
    /// Displacement from the reference to the deformed image.
    pub displacement: [f64; 2],
    /// Standard uncertainty of each component of the displacement.
    pub sigma: [f64; 2],
}

impl NodeValues {
    fn from_columns(v: [f64; 6]) -> Self {
        Self { position: [v[0], v[1]], displacement: [v[2], v[3]], sigma: [v[4], v[5]] }
    }
}

/// The displacement of a node as a value at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointRow {
    /// The displacement, px.
    pub displacement: [f64; 2],
    /// Its standard uncertainty, px.
    pub sigma: [f64; 2],
    /// Whether it is a value; where not, it is the coefficient.
    pub is_value: bool,
}

/// One row of a table of displacements: a measured node.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplacementRow {
    /// Number of the node in the mesh, from 0.
    pub node: usize,
    /// Name of its zone.
    pub zone: String,
    /// The values in pixels.
    pub px: NodeValues,
    /// The strain, when the table has it and it is known at this node.
    pub strain: Option<TensorStrain>,
    /// The strain over a window of nodes, with the uncertainty of exx, eyy, exy, if the table has it and it is known.
    pub window_strain: Option<(TensorStrain, [f64; 3])>,
    /// What exx, eyy and exy over the window may be off beyond noise, if the table has it and it is known.
    pub window_model_error: Option<[f64; 3]>,
    /// What each component of the displacement may be off beyond noise, px, when the table has it.
    pub model_error_px: Option<[f64; 2]>,
    /// The displacement as a value at the point, when the table has it.
    pub point_px: Option<PointRow>,
    /// What is the matter with the elements of the node, the gravest mark of them, when the table has it.
    pub mark: Option<ElementMark>,
    /// The values in millimetres, when the table was written with a pixel size.
    pub mm: Option<NodeValues>,
}

/// Writes the measured nodes of `measurement`, a row each, under the comment lines `header`.
///
/// The columns are `node,zone,x_px,y_px,ux_px,uy_px,sigma_ux_px,sigma_uy_px`, with a `strain` also `exx,eyy,exy` and
/// what follows from them ([`Invariant`]; all empty where it is not known), with a window of nodes these again over the window with their
/// standard uncertainty (`exx_window` to `sigma_exy_window`) and, where it is known, their model error
/// (`model_error_exx_window` to `model_error_exy_window`), and with a pixel size and the field in the `plane` (where
/// nothing is known of the camera the same field) the six again in mm of the plane; where they are known,
/// `model_error_ux_px,model_error_uy_px` stand behind, then
/// `ux_point_px,uy_point_px,sigma_ux_point_px,sigma_uy_point_px,is_point_value`, the displacement as a value at the
/// point ([`PointField`](crate::field::PointField)), and `mark` last, the name of what is the matter with an element of
/// the node ([`ElementMark`]). Numbers are the shortest that read back to the same bits: of 64 for positions and
/// displacements, of 32 for standard uncertainties and strains. The frame is that of the image in both units: x to the
/// right, **y down**. Nodes are numbered from 0; one that was not measured has no row.
///
/// ```
/// # use quadrille_io as quadrille;
/// # use quadrille::{field::{Measurement, Status}, mesh::{Mesh, Roi, Zone}};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 16.0, y1: 16.0 };
/// # let mesh = Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 32, 32).unwrap();
/// # let measurement = Measurement { mesh: mesh.into(), status: Status::Converged,
/// #     displacement: vec![[0.1, -2.0]; 4], sigma: vec![[0.01; 2]; 4], measured: vec![true; 4],
/// #     element_residual: vec![1.5], model_error: None, marks: None, points: None };
/// let mut table = Vec::new();
/// quadrille::io::csv::write_displacements(&mut table, &["frame 7".into()], &measurement, None, None).unwrap();
/// let table = String::from_utf8(table).unwrap();
/// assert!(table.starts_with("# frame 7\n") && table.ends_with("3,all,16.0,16.0,0.1,-2.0,0.01,0.01\n"));
/// ```
#[expect(
    clippy::indexing_slicing,
    reason = "written by the program: a measurement has one value for each node of its mesh"
)]
pub fn write_displacements<W: Write>(
    mut out: W,
    header: &[String],
    measurement: &Measurement<Px>,
    strain: Option<&StrainField>,
    plane: Option<(PixelSize, &Measurement<Px>)>,
) -> io::Result<()> {
    for line in header.iter().flat_map(|text| text.split(['\n', '\r'])) {
        writeln!(out, "# {line}")?;
    }
    writeln!(out, "# status: {}", measurement.status.name())?;
    writeln!(
        out,
        "# lengths in px: x to the right, y down, origin at the centre of the top-left pixel of the reference image"
    )?;
    writeln!(out, "# u leads from the reference to the deformed image; sigma is its standard uncertainty")?;
    if measurement.model_error.is_some() {
        writeln!(out, "# model_error is what u may be off beyond noise: mesh too coarse, misfit, regularisation")?;
    }
    let points = measurement.points.as_ref();
    if points.is_some() {
        writeln!(
            out,
            "# ux_px and uy_px are the coefficients of the fitted field; ux_point_px and uy_point_px the values at the"
        )?;
        writeln!(out, "# points, to be read as displacements there (is_point_value 0: the coefficient as it stands)")?;
    }
    let marks = measurement.node_marks();
    if marks.is_some() {
        let names: Vec<&str> = ElementMark::ALL.iter().map(|mark| mark.name()).collect();
        writeln!(out, "# mark says what is the matter with an element of the node: none, or {}", names.join(", "))?;
    }
    if let Some(strain) = strain {
        let window = strain.window.iter().flat_map(|strains| strains.window.describe(strain.length_px));
        for line in strain.definition.describe(strain.length_px).into_iter().chain(window) {
            writeln!(out, "# {line}")?;
        }
    }
    if let Some((size, field)) = plane {
        writeln!(out, "# 1 px = {:?} mm; the columns in mm have the same frame, y down", size.mm_per_px())?;
        if !Arc::ptr_eq(&field.mesh, &measurement.mesh) {
            writeln!(out, "# columns in mm and strains are those of the plane: the camera is taken off; px are raw")?;
        }
    }
    let mut table = WriterBuilder::new().has_headers(false).from_writer(out);
    let invariants = Invariant::ALL.map(Invariant::name);
    let (strain_columns, invariant_columns) =
        if strain.is_some() { (&STRAIN_COLUMNS[..], &invariants[..]) } else { (&[][..], &[][..]) };
    let window = strain.and_then(|strain| strain.window.as_ref());
    let window_columns = if window.is_some() { &WINDOW_COLUMNS[..] } else { &[] };
    let window_model = window.and_then(|window| Some((window, window.model_error.as_ref()?)));
    let window_model_columns = if window_model.is_some() { &WINDOW_MODEL_COLUMNS[..] } else { &[] };
    let mm_columns = if plane.is_some() { &MM_COLUMNS[..] } else { &[] };
    let model_columns = if measurement.model_error.is_some() { &MODEL_COLUMNS[..] } else { &[] };
    let of_strains = strain_columns.iter().chain(invariant_columns).chain(window_columns).chain(window_model_columns);
    let columns = ["node", "zone"].iter().chain(&PX_COLUMNS).chain(of_strains).chain(mm_columns);
    let point_columns = if points.is_some() { &POINT_COLUMNS[..] } else { &[] };
    let mark_column = marks.as_ref().map(|_| &MARK_COLUMN);
    table.write_record(columns.chain(model_columns).chain(point_columns).chain(mark_column))?;
    let mesh = &measurement.mesh;
    for (node, &[x, y]) in mesh.nodes().iter().enumerate() {
        if !measurement.measured[node] {
            continue;
        }
        let zone = mesh.zones()[mesh.node_zone()[node] as usize].as_str();
        let [ux, uy] = measurement.displacement[node];
        // As the store holds it: the table of a stored frame is that of the run, to the last digit.
        let sigma = measurement.sigma[node].map(|v| v as f32);
        let px = ([x, y, ux, uy], sigma);
        let mm = plane.map(|(size, field)| {
            let mm = |v| size.mm_from_px(v);
            let ([x, y], [ux, uy]) = (field.mesh.nodes()[node], field.displacement[node]);
            ([x, y, ux, uy].map(mm), field.sigma[node].map(|v| mm(f64::from(v as f32)) as f32))
        });
        let strain = strain.map(|field| match field.nodes[node] {
            Some(strain) => (
                strain.components().map(|e| Some(e as f32)),
                Invariant::ALL.map(|which| Some(as_stored(strain).invariant(which) as f32)),
            ),
            None => ([None; 3], [None; 5]),
        });
        let window = window.map(|strains| match strains.nodes[node] {
            Some((strain, sigma)) => (strain.components().map(|e| Some(e as f32)), sigma.map(|e| Some(e as f32))),
            None => ([None; 3], [None; 3]),
        });
        let window_model = window_model.map(|(strains, errors)| match strains.nodes[node] {
            Some(_) => errors[node].map(|e| Some(e as f32)),
            None => [None; 3],
        });
        // `serialize`, not `write_record`: it formats numbers without allocating, some ten times faster.
        let model = measurement.model_error.as_ref().map(|model| model.nodes[node].map(|v| v as f32));
        let point = points.map(|points| {
            let sigma = points.sigma[node].map(|v| v as f32);
            (points.displacement[node], sigma, u8::from(points.is_value[node]))
        });
        // A slice of none is no column.
        let mark = marks.as_ref().map(|marks| marks[node].name());
        let strains = (strain.as_slice(), window.as_slice(), window_model.as_slice());
        let mm = mm.as_slice();
        let (model, point) = (model.as_slice(), point.as_slice());
        table.serialize((node, zone, px, strains, mm, model, point, mark.as_slice()))?;
    }
    table.flush()
}

/// A strain as a store holds it: what follows from it in the table of a stored frame is then that of the run.
pub(crate) fn as_stored(strain: TensorStrain) -> TensorStrain {
    TensorStrain::of_components(strain.components().map(|e| f64::from(e as f32)))
}

/// Reads a table that [`write_displacements`] wrote. Columns are found by their names; others are passed over.
///
/// # Errors
/// A missing column, a cell that is no number, a row of the wrong length: each names its line.
pub fn read_displacements<R: Read>(input: R) -> Result<Vec<DisplacementRow>, CsvError> {
    let mut table = ReaderBuilder::new().comment(Some(b'#')).from_reader(input);
    let header = table.headers().map_err(row_error)?.clone();
    let find = |name: &'static str| {
        let at = header.iter().position(|column| column == name);
        at.map(|at| Column { name, at }).ok_or(CsvError::MissingColumn { name })
    };
    let (node, zone) = (find("node")?, find("zone")?);
    let find_all =
        |names: &[&'static str]| -> Result<Vec<Column>, CsvError> { names.iter().copied().map(find).collect() };
    // A group of columns is there as a whole or not at all.
    let find_group = |names: &[&'static str]| {
        header.iter().any(|column| names.contains(&column)).then(|| find_all(names)).transpose()
    };
    let px = find_all(&PX_COLUMNS)?;
    let (strain, mm) = (find_group(&STRAIN_COLUMNS)?, find_group(&MM_COLUMNS)?);
    let model = find_group(&MODEL_COLUMNS)?;
    let point = find_group(&POINT_COLUMNS)?;
    let mark = header.iter().position(|column| column == MARK_COLUMN);
    let (window, window_model) = (find_group(&WINDOW_COLUMNS)?, find_group(&WINDOW_MODEL_COLUMNS)?);
    let with_sigma = |[xx, yy, xy, a, b, c]: [f64; 6]| (TensorStrain { xx, yy, xy }, [a, b, c]);
    let mut rows = Vec::new();
    for record in table.records() {
        let record = record.map_err(row_error)?;
        rows.push(DisplacementRow {
            node: node.parse(&record)?,
            zone: zone.text(&record).to_owned(),
            px: NodeValues::from_columns(values(&px, &record)?),
            strain: strain
                .as_ref()
                .map(|of| known(of, &record))
                .transpose()?
                .flatten()
                .map(TensorStrain::of_components),
            window_strain: window.as_ref().map(|of| known(of, &record)).transpose()?.flatten().map(with_sigma),
            window_model_error: window_model.as_ref().map(|of| known(of, &record)).transpose()?.flatten(),
            model_error_px: model.as_ref().map(|columns| values(columns, &record)).transpose()?,
            point_px: point.as_ref().map(|columns| point_of(columns, &record)).transpose()?,
            mark: mark.and_then(|at| ElementMark::from_name(record.get(at)?)),
            mm: mm.as_ref().map(|mm| values(mm, &record)).transpose()?.map(NodeValues::from_columns),
        });
    }
    Ok(rows)
}

struct Column {
    name: &'static str,
    at: usize,
}

impl Column {
    fn text<'a>(&self, record: &'a StringRecord) -> &'a str {
        record.get(self.at).unwrap_or("") // the reader has checked the length of the row
    }

    fn parse<T: std::str::FromStr>(&self, record: &StringRecord) -> Result<T, CsvError> {
        self.text(record).parse().map_err(|_| self.no_number(record))
    }

    fn no_number(&self, record: &StringRecord) -> CsvError {
        let line = record.position().map_or(0, |position| position.line());
        CsvError::Number { line, column: self.name, text: self.text(record).to_owned() }
    }
}

fn values<const N: usize>(columns: &[Column], record: &StringRecord) -> Result<[f64; N], CsvError> {
    let mut numbers = [0.0f64; N];
    for (number, column) in numbers.iter_mut().zip(columns) {
        *number = column.parse(record)?;
        if !number.is_finite() {
            return Err(column.no_number(record));
        }
    }
    Ok(numbers)
}

/// The numbers of a group of columns; `None` where all cells are empty.
fn known<const N: usize>(columns: &[Column], record: &StringRecord) -> Result<Option<[f64; N]>, CsvError> {
    let is_empty = columns.iter().all(|column| column.text(record).is_empty());
    (!is_empty).then(|| values(columns, record)).transpose()
}

fn point_of(columns: &[Column], record: &StringRecord) -> Result<PointRow, CsvError> {
    let [ux, uy, sx, sy, is_value] = values(columns, record)?;
    Ok(PointRow { displacement: [ux, uy], sigma: [sx, sy], is_value: is_value == 1.0 })
}

fn row_error(error: ::csv::Error) -> CsvError {
    match error.position().map(|position| position.line()) {
        Some(line) => CsvError::Row { line, source: error },
        None => CsvError::Read(error),
    }
}
