//! Displacement fields of other programs: tables and arrays with the displacement of points.
//!
//! [`read_points`] reads them as points in pixels with y down, as [`LAYOUTS`] describes each program's layout;
//! [`write_points`] writes a field as these programs lay out theirs.

mod archive;
mod border;
mod exchange;
mod hdf5;
mod layout;
mod mat;
mod node_table;
mod table;
mod write;

pub use border::Border;
pub use exchange::Exchange;
pub use layout::{LAYOUTS, Layout, LengthUnit, YAxis};
pub use node_table::{NodeTable, read_node_table};
pub use write::{WrittenLayout, write_points};

use crate::text::read_regular;
use crate::units::PixelSize;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// What a file leaves open, and what is to be taken otherwise than its layout says.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FieldOptions {
    /// The layout; recognised without.
    pub layout: Option<&'static Layout>,
    /// Unit of positions and displacements that the file names none for.
    pub unit: Option<LengthUnit>,
    /// Where y points.
    pub y: Option<YAxis>,
    /// Whether positions are those of the deformed state.
    pub deformed: bool,
    /// Millimetres of a pixel, which files in lengths need.
    pub pixel_size: Option<PixelSize>,
}

/// A measured point, px, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldPoint {
    /// Position in the reference state. Its origin is that of the file.
    pub position: [f64; 2],
    /// Displacement to the deformed state.
    pub displacement: [f64; 2],
    /// Standard uncertainty of the displacement, where the file has one.
    pub sigma: Option<[f64; 2]>,
}

/// The points of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldPoints {
    /// The layout that was found.
    pub layout: &'static Layout,
    /// What was measured.
    pub points: Vec<FieldPoint>,
    /// Points that the file marks as not measured.
    pub n_invalid: usize,
}

/// Why a field of another program cannot be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FieldError {
    /// The file cannot be read.
    #[error("{}: cannot be read", .0.display())]
    Io(PathBuf, #[source] io::Error),
    /// The bytes are no text and nothing that is known.
    #[error("{}: line {line} is no text; export the field as a table (csv, txt)", path.display())]
    NoText {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
    },
    /// No layout fits.
    #[error(
        "{}: no line names the columns of a known layout ({}); give the columns of position and displacement the names \
         x,y,u,v and import it with --layout table{}",
        path.display(), LAYOUTS.map(|layout| layout.name).join(", "), found(columns)
    )]
    Unknown {
        /// The file.
        path: PathBuf,
        /// The columns of the line that looks most like names.
        columns: Vec<String>,
    },
    /// Columns of the layout that was asked for are not there.
    #[error("{}: no line names the columns of the layout {layout}: {wanted}{}", path.display(), found(columns))]
    Missing {
        /// The file.
        path: PathBuf,
        /// Name of the layout.
        layout: &'static str,
        /// Columns that it has.
        wanted: String,
        /// The columns of the line that looks most like names.
        columns: Vec<String>,
    },
    /// A row that is none.
    #[error("{}: line {line} has {found} columns, the names {wanted}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Cells of the line.
        found: usize,
        /// Columns that have a name.
        wanted: usize,
    },
    /// A position without number.
    #[error("{}: line {line}, column '{column}': '{text}' is not a number", path.display())]
    Number {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// Name of the column.
        column: String,
        /// What stands there.
        text: String,
    },
    /// Nothing says in which unit the numbers are.
    #[error("{}: nothing says in which unit column '{column}' is; give --unit px, or --unit mm with --pixel-size", path.display())]
    Unit {
        /// The file.
        path: PathBuf,
        /// Name of the column.
        column: String,
    },
    /// Nothing says where y points.
    #[error("{}: nothing says whether y points up or down; give --y up or --y down", .0.display())]
    Axis(PathBuf),
    /// Lengths, and no scale.
    #[error("{}: column '{column}' is a length; give the scale of the images, --pixel-size MM", path.display())]
    Scale {
        /// The file.
        path: PathBuf,
        /// Name of the column.
        column: String,
    },
    /// An archive of arrays that is damaged or holds something else.
    #[error("{}: {reason}", path.display())]
    Arrays {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

fn found(columns: &[String]) -> String {
    const SHOWN: usize = 12;
    match columns.len() {
        0 => String::new(),
        n => {
            let more = if n > SHOWN { ", ..." } else { "" };
            let shown: Vec<&str> = columns.iter().take(SHOWN).map(String::as_str).collect();
            format!("; found: {}{more}", shown.join(", "))
        }
    }
}

/// The points of each frame in a file: one of a table, several of an archive of arrays.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::foreign::{FieldOptions, read_points};
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("dice.txt");
/// std::fs::write(&file, "COORDINATE_X,COORDINATE_Y,DISPLACEMENT_X,DISPLACEMENT_Y,SIGMA\n8,8,0.5,-1,0.01\n16,8,0,0,-1\n")?;
/// let frames = read_points(&file, &FieldOptions::default())?;
/// assert_eq!((frames[0].layout.name, frames[0].n_invalid), ("dice", 1));
/// assert_eq!((frames[0].points[0].displacement, frames[0].points[0].sigma), ([0.5, -1.0], Some([0.01; 2])));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that cannot be read or has no layout that is known, numbers that are none, and what nothing says: the unit,
/// where y points, the scale.
pub fn read_points(path: &Path, options: &FieldOptions) -> Result<Vec<FieldPoints>, FieldError> {
    let bytes = read_regular(path).map_err(|error| FieldError::Io(path.to_owned(), error))?;
    parse_points(&bytes, path, options)
}

/// The same of the content of a file; `path` stands in messages.
///
/// # Errors
/// As [`read_points`].
pub fn parse_points(bytes: &[u8], path: &Path, options: &FieldOptions) -> Result<Vec<FieldPoints>, FieldError> {
    match bytes {
        [b'P', b'K', 3, 4, ..] => archive::parse(archive::of_numpy(bytes), path, options),
        [0x89, b'H', b'D', b'F', ..] | [b'M', b'A', b'T', b'L', b'A', b'B', b' ', b'7', ..] => {
            hdf5::parse(bytes, path, options)
        }
        [b'M', b'A', b'T', b'L', b'A', b'B', ..] => archive::parse(mat::read_arrays(bytes), path, options),
        _ => table::parse(bytes, path, options).map(|points| vec![points]),
    }
}

/// What the columns of a file mean together.
struct Meaning {
    /// Pixels of a unit of position and of displacement.
    px: [f64; 2],
    /// 1 or -1 by which y of position and displacement is multiplied.
    y: [f64; 2],
    deformed: bool,
}

impl Meaning {
    /// What units in the file (of position and displacement), layout and options say together; `columns` are the names
    /// of x and u for messages.
    fn of(
        layout: &Layout,
        in_file: [Option<LengthUnit>; 2],
        columns: [&str; 2],
        path: &Path,
        options: &FieldOptions,
    ) -> Result<Self, FieldError> {
        let mut px = [1.0; 2];
        let mut units = [LengthUnit::Px; 2];
        for ((px, unit), (in_file, column)) in px.iter_mut().zip(&mut units).zip(in_file.iter().zip(columns)) {
            let (path, column) = (path.to_owned(), column.to_owned());
            let Some(known) = in_file.or(options.unit).or(layout.unit) else {
                return Err(FieldError::Unit { path, column });
            };
            *unit = known;
            if let Some(mm) = known.in_mm() {
                let Some(scale) = options.pixel_size else { return Err(FieldError::Scale { path, column }) };
                *px = mm / scale.mm_per_px();
            }
        }
        let is_px = units.map(|unit| unit == LengthUnit::Px);
        // Pixels of an image beside lengths: the axis of these may be another one.
        let is_mixed = is_px == [true, false];
        let usual = layout.y.filter(|_| !is_mixed);
        let up = options.y.or(usual).ok_or_else(|| FieldError::Axis(path.to_owned()))? == YAxis::Up;
        let sign = |up: bool| if up { -1.0 } else { 1.0 };
        Ok(Self { px, y: [sign(up && !is_mixed), sign(up)], deformed: options.deformed })
    }

    /// A point of the file in px, y down, at its place in the reference state.
    fn point(&self, [x, y, u, v]: [f64; 4], sigma: Option<[f64; 2]>) -> FieldPoint {
        let [of_position, of_displacement] = self.px;
        let displacement = [u * of_displacement, v * of_displacement * self.y[1]];
        let mut position = [x * of_position, y * of_position * self.y[0]];
        if self.deformed {
            position.iter_mut().zip(displacement).for_each(|(x, u)| *x -= u);
        }
        FieldPoint { position, displacement, sigma: sigma.map(|sigma| sigma.map(|v| v * of_displacement)) }
    }
}
