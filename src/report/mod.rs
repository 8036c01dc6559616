//! What people look at: summaries and pictures of measured fields.

mod animation;
mod axes;
mod backdrop;
mod bar;
mod cells;
pub mod correlation;
mod crack;
mod edges;
mod figure;
mod figures;
pub mod fit;
mod force;
mod frame_remarks;
pub mod identification;
pub mod joint;
mod lap;
mod law_plot;
mod letters;
mod look;
pub mod map;
mod mesh_figure;
pub(crate) mod metrology;
mod over_image;
pub mod page;
mod picture;
pub mod plot;
mod profile;
mod raster;
pub mod reduction;
mod scale;
mod scene;
pub mod summary;
mod tension;
pub mod tournament;
pub mod view;
mod with_std;
mod words;

pub use animation::{Animated, Animation, Moved};
pub use backdrop::Backdrop;
pub use cells::Cells;
pub use crack::{CrackFrameSummary, CrackSummary, CrackTipSummary, crack_figures};
pub use figure::{Figure, FigureOptions, Format};
pub use figures::{draw_figure, draw_frame, ends_of};
pub use force::{ForcePoint, ForceRecord};
pub use frame_remarks::{of_result as remarks_of, saturated};
pub use lap::{LapFrame, LapRecord};
pub use look::Look;
pub use map::{MapOptions, element_map, element_map_on, nodal_map, nodal_map_on};
pub use mesh_figure::{MeshOptions, deformed_mesh, mesh_figure, register_figure};
pub use metrology::metrology_page;
pub use picture::{Area, Picture};
pub use plot::{Axis, Plot, PlotSeries, Style};
pub(crate) use reduction::direct_plot;
pub use reduction::{ReducedTest, ReductionRecord};
pub use scale::Palette;
pub use tension::{tension_lines, tension_plot};
pub use with_std::WithStd;

use crate::field::QuantityError;
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::path::PathBuf;
use thiserror::Error;

/// A name in a record: one of this program's, or one that was read.
pub type Name = Cow<'static, str>;

/// Who writes a file.
fn version() -> String {
    format!("quadrille {}", env!("CARGO_PKG_VERSION"))
}

/// Names of columns.
fn to_strings(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

/// A number of a record; JSON has no NaN and no infinity, `null` stands for both.
pub(crate) fn number<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(from)?.unwrap_or(f64::NAN))
}

/// Numbers of a record, as [`number`].
pub(crate) fn numbers<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<f64>, D::Error> {
    let list = Vec::<Option<f64>>::deserialize(from)?;
    Ok(list.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
}

/// Why a picture cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The field is that of another mesh.
    #[error("{got} values do not fit a mesh of {expected} {what}")]
    Length {
        /// `nodes` or `elements`.
        what: &'static str,
        /// Number in the mesh.
        expected: usize,
        /// Values given.
        got: usize,
    },
    /// The range asked for, of colours or of an axis, has no extent, or no finite one.
    #[error("colours and axes cannot span {low} to {high}; give a finite range with low < high")]
    Range {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// A logarithmic axis cannot begin there.
    #[error("a logarithmic axis cannot span {low} to {high}; give a range above zero")]
    LogRange {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
    /// The lists of a series of a plot differ in length.
    #[error(
        "series '{name}' has {x} abscissae, {y} ordinates and {band} half widths of its band; give one of each per point"
    )]
    Series {
        /// Its name.
        name: String,
        /// Abscissae given.
        x: usize,
        /// Ordinates given.
        y: usize,
        /// Half widths given (as many as abscissae without a band).
        band: usize,
    },
    /// The name of a file says neither PNG nor SVG.
    #[error("{}: pictures are written as .png or .svg; give the file one of these endings", path.display())]
    Ending {
        /// The file.
        path: PathBuf,
    },
    /// Displacements cannot be multiplied by that.
    #[error("displacements cannot be magnified {factor} times; give a factor above 0, up to 1e6")]
    Magnification {
        /// What was asked for.
        factor: f64,
    },
    /// Strains over a window that nobody gave.
    #[error("strains over a window of nodes need its size, and the run has none; give --strain-window N, such as 5")]
    NoWindow,
    /// Per cent of an unknown range.
    #[error("the residual in per cent needs the range of grey levels of the reference; ask for `residual`")]
    Percent,
    /// The line of a profile is none.
    #[error("no profile can be drawn along this line")]
    Line(#[from] QuantityError),
    /// The PNG data cannot be written.
    #[error("the picture cannot be written")]
    Encode(#[source] image::ImageError),
    /// The file cannot be written.
    #[error("the picture cannot be written to {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}
