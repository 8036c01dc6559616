//! Load files: what other instruments recorded, a row for each image, or with a column of times at a rate of its own.

mod asked;
mod clock;
pub(crate) mod decimals;
mod error;
mod raw;
mod remarks;
mod source;
mod times;
mod units;

pub use asked::read_as_asked;
pub use clock::clock_time;
pub use error::LoadError;
pub use times::{FrameTimes, parse_frame_times};
pub(crate) use units::unit_of;

use crate::remark::Remark;
use error::STRESS;
use raw::{RawTable, Wanted};
use source::Source;
use std::path::Path;

/// A quantity recorded beside the images, such as time or force.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadColumn {
    /// Its name with its unit, as it stands in tables: `load_N`, `time_s`.
    pub name: String,
    /// Its value at each deformed image, from frame 1 on; `None` where the file says nothing.
    pub values: Vec<Option<f64>>,
    /// Its value at the reference, where the file has that.
    pub reference: Option<f64>,
}

impl LoadColumn {
    /// The name without the unit, and the unit: `load`, `N`. See [`name_and_unit`].
    pub fn name_and_unit(&self) -> (&str, &str) {
        name_and_unit(&self.name)
    }

    /// Its value at a frame, numbered from 1.
    pub fn at(&self, frame: usize) -> Option<f64> {
        self.values.get(frame.checked_sub(1)?).copied().flatten()
    }
}

/// The name of a column of a load file without its unit, and the unit. A quantity without unit has the unit `1`.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::load::name_and_unit;
/// assert_eq!(name_and_unit("cross_head_mm"), ("cross_head", "mm"));
/// assert_eq!(name_and_unit("frame"), ("frame", "1"));
/// ```
pub fn name_and_unit(column: &str) -> (&str, &str) {
    column.rsplit_once('_').unwrap_or((column, "1"))
}

/// What a load file says about a series.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LoadTable {
    /// The columns, in the order of the file, without the number of the frame.
    pub columns: Vec<LoadColumn>,
    /// What to know about them: units that were converted, frames without a value.
    pub remarks: Vec<Remark>,
}

impl LoadTable {
    /// The table with a column `stress_MPa`: the force over the area of the cross-section.
    ///
    /// The force is the column in N; of several that named `load` or `force`.
    ///
    /// # Errors
    /// No such column or several, and one `stress_MPa` that is there.
    pub fn with_stress(mut self, area_mm2: f64, path: &Path) -> Result<Self, LoadError> {
        let Some(force) = self.only_force().filter(|_| self.stress().is_none()).cloned() else {
            let columns = self.columns.iter().map(|column| column.name.clone()).collect();
            return Err(LoadError::Force(path.to_owned(), columns));
        };
        self.remarks.push(remarks::stress(STRESS, &force.name, area_mm2));
        let values = force.values.iter().map(|value| value.map(|force| force / area_mm2)).collect();
        let reference = force.reference.map(|force| force / area_mm2);
        self.columns.push(LoadColumn { name: STRESS.to_owned(), values, reference });
        Ok(self)
    }

    /// The times of the frames: the column in s, of several that named `time`.
    pub fn times(&self) -> Option<&LoadColumn> {
        let is_time = |column: &&LoadColumn| column.name_and_unit().0.eq_ignore_ascii_case("time");
        let in_seconds = || self.columns.iter().filter(|column| column.name_and_unit().1 == "s");
        in_seconds().find(is_time).or_else(|| in_seconds().next().filter(|_| in_seconds().count() == 1))
    }

    /// The stresses that [`with_stress`](Self::with_stress) has added, or a column of that name.
    pub fn stress(&self) -> Option<&LoadColumn> {
        self.columns.iter().find(|column| column.name == STRESS)
    }

    /// The column in N; of several that named `load` or `force`.
    fn only_force(&self) -> Option<&LoadColumn> {
        let forces: Vec<&LoadColumn> = self.columns.iter().filter(|column| column.name_and_unit().1 == "N").collect();
        let is_named =
            |column: &&&LoadColumn| ["load", "force"].contains(&column.name_and_unit().0.to_lowercase().as_str());
        match forces.as_slice() {
            [force] => Some(*force),
            several => several.iter().find(is_named).copied(),
        }
    }

    /// The column of forces called `name`, with or without its unit; without a name the only one in N, of several that
    /// named `load` or `force`.
    ///
    /// # Errors
    /// [`LoadError::NoForce`].
    pub fn force(&self, name: Option<&str>, path: &Path) -> Result<&LoadColumn, LoadError> {
        let found = match name {
            None => self.only_force(),
            Some(name) => {
                let called = |column: &&LoadColumn| column.name == name || column.name_and_unit().0 == name;
                self.columns.iter().find(called).filter(|column| column.name_and_unit().1 == "N")
            }
        };
        found.ok_or_else(|| {
            LoadError::NoForce(
                path.to_owned(),
                name.map(str::to_owned),
                self.columns.iter().map(|column| column.name.clone()).collect(),
            )
        })
    }
}

/// Reads the load file `path` for a series of `n_frames` deformed images. See [`parse_load`].
///
/// # Errors
/// A file that cannot be read, and those of [`parse_load`].
pub fn read_load(path: &Path, n_frames: usize) -> Result<LoadTable, LoadError> {
    load_of(&Source::read(path, None)?, path, n_frames)
}

/// Reads the table `path` by itself: each row is a frame, in order or by its column `frame`.
///
/// # Errors
/// A file that cannot be read, and those of [`parse_load`].
pub fn read_table(path: &Path) -> Result<LoadTable, LoadError> {
    let source = Source::read(path, None)?;
    let last = RawTable::parse(&source, path, Wanted::All)?.last_frame();
    load_of(&source, path, last)
}

/// Reads the record `path`, whose column `time` says when its rows were taken, at the `times` of the frames. See
/// [`parse_record`].
///
/// # Errors
/// A file that cannot be read, and those of [`parse_record`].
pub fn read_record(path: &Path, time: &str, times: &FrameTimes) -> Result<LoadTable, LoadError> {
    record_of(&Source::read(path, None)?, path, time, times)
}

/// Reads the times of `n_frames` deformed images from the file `path`: a row per image as a load file has it; taken is
/// the column named `time`, `timestamp` or `t`, or the only one. Clock times are understood.
///
/// # Errors
/// A file that cannot be read, without such a column, or with another number of rows.
pub fn read_frame_times(path: &Path, n_frames: usize) -> Result<FrameTimes, LoadError> {
    times::frame_times_of(&Source::read(path, None)?, path, n_frames)
}

/// The load file with the content `text`; `path` stands in messages.
///
/// A header with a unit at the end of each name (`load_N`, `load [N]` or `load (N)`; `_1` or `[-]` for none), or names
/// and in the line below them their units; then one row per image. Lines before the header are passed over. Columns are
/// separated by `,`, `;` or tabs. Which mark stands before decimals, and which between thousands, is seen from the
/// numbers of a column, else from those of the file. Lines that begin with `#` and empty lines are passed over; an empty
/// cell is a value that is not known. Forces, lengths, times and stresses become N, mm, s and MPa
/// ([`LoadTable::remarks`] says from what). A column `frame` gives the number of the deformed image, from 1 (0, the
/// reference, is passed over), in any order and with gaps; without it, rows are the deformed images in order, or all
/// images with the reference first.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::load::parse_load;
/// let table = parse_load("Time;Load\ns;kN\n0;0\n1,5;2,25\n3;4\n", "load.csv".as_ref(), 2)?;
/// assert_eq!(table.columns[1].name, "Load_N");
/// assert_eq!(table.columns[1].values, [Some(2250.0), Some(4000.0)]);
/// assert_eq!(table.remarks[0].text, "Load_N: kN in the load file, times 1000");
/// # Ok::<(), quadrille::io::load::LoadError>(())
/// ```
///
/// # Errors
/// No header or row, names without unit, rows of another length, cells that are no number or may be one of two
/// (`1.250`), frames that do not exist
/// or come twice, and another number of rows than images: each names the file and the line.
pub fn parse_load(text: &str, path: &Path, n_frames: usize) -> Result<LoadTable, LoadError> {
    load_of(&Source::of(text), path, n_frames)
}

fn load_of(source: &Source, path: &Path, n_frames: usize) -> Result<LoadTable, LoadError> {
    let table = RawTable::parse(source, path, Wanted::All)?;
    let frames = table.frames(n_frames)?;
    let values = table.values()?;
    let columns = table.columns.iter().enumerate().map(|(k, name)| {
        let (mut of_frames, mut reference) = (vec![None; n_frames], None);
        for (frame, row) in frames.iter().zip(&values) {
            let cell = match frame.checked_sub(1) {
                None => Some(&mut reference),
                Some(at) => of_frames.get_mut(at),
            };
            if let (Some(cell), Some(value)) = (cell, row.get(k)) {
                *cell = *value;
            }
        }
        LoadColumn { name: name.clone(), values: of_frames, reference }
    });
    Ok(LoadTable { columns: columns.collect(), remarks: table.remarks.clone() })
}

/// The record with the content `text` at the times of the frames: between its rows every column is interpolated
/// linearly. A frame outside the record, or beside a cell that is empty, has no value; [`LoadTable::remarks`] says so.
///
/// The column `time` (by its name with or without unit) is in s, ms, min or h, or holds clock times (`10:31:05.20`,
/// `2024-05-07 10:31:05`); it does not fall. It becomes the time of each frame.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::load::{FrameTimes, parse_record};
/// let record = "Time [s],Force [N]\n0,0\n1,10\n2,40\n";
/// let times = FrameTimes::every(0.5, 0.0, 5); // the reference at 0 s, frames at 0.5, 1, 1.5, 2 and 2.5 s
/// let table = parse_record(record, "load.csv".as_ref(), "time", &times)?;
/// assert_eq!(table.columns[1].values, [Some(5.0), Some(10.0), Some(25.0), Some(40.0), None]);
/// # Ok::<(), quadrille::io::load::LoadError>(())
/// ```
///
/// # Errors
/// Those of [`parse_load`], no such column or unit, times that fall, and frames that all lie outside the record.
pub fn parse_record(text: &str, path: &Path, time: &str, times: &FrameTimes) -> Result<LoadTable, LoadError> {
    record_of(&Source::of(text), path, time, times)
}

fn record_of(source: &Source, path: &Path, time: &str, times: &FrameTimes) -> Result<LoadTable, LoadError> {
    times::join(&RawTable::parse(source, path, Wanted::WithTime(time))?, time, times)
}
