//! The shaders: their sources, put together from files, and what each kernel expects.

use crate::imaging::Interpolation;

/// How a kernel uses one of its bindings, which are numbered in order from 0 in group 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Binding {
    /// A small block of constants.
    Uniform,
    /// A buffer that is read.
    Read,
    /// A buffer that is written, and may be read.
    Write,
}

/// A kernel: an entry point of a shader file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// Pixels to grey levels.
    Unpack,
    /// Next level of the pyramid.
    Downsample,
    /// B-spline coefficients along one axis.
    Prefilter,
    /// Border to the left and right of a plane.
    BorderColumns,
    /// Border above or below a plane.
    BorderRows,
    /// Grey levels and gradient of the reference.
    Gradient,
    /// Moments for the normal matrices.
    NormalMatrix,
    /// Residual of rectangles of pixels.
    Residual,
    /// Residual of elements whose pixels are runs.
    ResidualRuns,
    /// Gain and offset of every element.
    Fit,
    /// Elements left out, sums of groups of elements.
    Tally,
    /// Right-hand side per node.
    Gather,
    /// Part of the right-hand side that a regularisation asks for.
    Penalty,
    /// First half of an iteration of the conjugate gradients.
    CgProduct,
    /// Second half.
    CgUpdate,
    /// Correction of the field.
    Correct,
    /// Sums of the zones and the report of a step.
    Summary,
    /// Field of a level from that of the next coarser one.
    Prolong,
    /// Residual map and packed field.
    ResidualMap,
}

/// Every kernel.
pub const KERNELS: [Kernel; 19] = [
    Kernel::Unpack,
    Kernel::Downsample,
    Kernel::Prefilter,
    Kernel::BorderColumns,
    Kernel::BorderRows,
    Kernel::Gradient,
    Kernel::NormalMatrix,
    Kernel::Residual,
    Kernel::ResidualRuns,
    Kernel::Fit,
    Kernel::Tally,
    Kernel::Gather,
    Kernel::Penalty,
    Kernel::CgProduct,
    Kernel::CgUpdate,
    Kernel::Correct,
    Kernel::Summary,
    Kernel::Prolong,
    Kernel::ResidualMap,
];

impl Kernel {
    /// Its file in `shaders/`, without the ending.
    pub fn file(self) -> &'static str {
        match self {
            Self::Unpack => "unpack",
            Self::Downsample => "downsample",
            Self::Prefilter => "prefilter",
            Self::BorderColumns | Self::BorderRows => "border",
            Self::Gradient => "gradient",
            Self::NormalMatrix => "normal_matrix",
            Self::Residual => "residual",
            Self::ResidualRuns => "residual_runs",
            Self::Fit | Self::Tally => "tally",
            Self::Gather => "gather",
            Self::Penalty => "penalty",
            Self::CgProduct => "cg_product",
            Self::CgUpdate => "cg_update",
            Self::Correct => "correct",
            Self::Summary => "summary",
            Self::Prolong => "prolong",
            Self::ResidualMap => "residual_map",
        }
    }

    /// Its entry point.
    pub fn entry(self) -> &'static str {
        match self {
            Self::BorderColumns => "columns",
            Self::BorderRows => "rows",
            Self::Fit => "fit",
            _ => "main",
        }
    }

    /// Its bindings.
    pub fn bindings(self) -> &'static [Binding] {
        use Binding::{Read, Uniform, Write};
        match self {
            Self::Unpack | Self::Downsample | Self::Prefilter => &[Uniform, Read, Write],
            Self::BorderColumns | Self::BorderRows => &[Uniform, Write],
            Self::Gradient => &[Uniform, Read, Read, Write],
            Self::NormalMatrix => &[Uniform, Read, Read, Read, Read, Read, Write],
            Self::Residual => &[Uniform, Read, Read, Read, Read, Read, Write],
            Self::ResidualRuns => &[Uniform, Read, Read, Read, Read, Read, Write, Read],
            Self::Fit | Self::Tally => &[Uniform, Read, Read, Write, Write, Write],
            Self::Gather => &[Uniform, Read, Read, Read, Write, Write, Write, Write],
            Self::Penalty => &[Uniform, Read, Read, Read, Read, Write, Write, Write],
            Self::CgProduct => &[Uniform, Read, Read, Read, Read, Write, Write, Write],
            Self::CgUpdate => &[Uniform, Read, Read, Read, Write, Write, Write, Write],
            Self::Correct => &[Uniform, Read, Write, Write],
            Self::Summary => &[Uniform, Read, Read, Read, Write, Write, Write],
            Self::Prolong => &[Read, Read, Write],
            Self::ResidualMap => &[Uniform, Read, Read, Read, Write],
        }
    }

    /// Threads of a workgroup.
    pub fn workgroup(self) -> u32 {
        match self {
            Self::Prefilter => 32,
            Self::Gather | Self::Penalty | Self::CgProduct | Self::CgUpdate => 256,
            Self::Correct | Self::Prolong | Self::ResidualMap => 256,
            _ => 64,
        }
    }

    /// Whether its source depends on the interpolation.
    pub fn interpolates(self) -> bool {
        matches!(self, Self::Residual | Self::ResidualRuns)
    }
}

/// The files of `shaders/` by name; those that kernels import lie in `shaders/shared`.
const FILES: &[(&str, &str)] = &[
    ("border", include_str!("../../../shaders/border.wgsl")),
    ("cg_product", include_str!("../../../shaders/cg_product.wgsl")),
    ("cg_update", include_str!("../../../shaders/cg_update.wgsl")),
    ("correct", include_str!("../../../shaders/correct.wgsl")),
    ("downsample", include_str!("../../../shaders/downsample.wgsl")),
    ("gather", include_str!("../../../shaders/gather.wgsl")),
    ("gradient", include_str!("../../../shaders/gradient.wgsl")),
    ("normal_matrix", include_str!("../../../shaders/normal_matrix.wgsl")),
    ("penalty", include_str!("../../../shaders/penalty.wgsl")),
    ("prefilter", include_str!("../../../shaders/prefilter.wgsl")),
    ("prolong", include_str!("../../../shaders/prolong.wgsl")),
    ("residual", include_str!("../../../shaders/residual.wgsl")),
    ("residual_map", include_str!("../../../shaders/residual_map.wgsl")),
    ("residual_runs", include_str!("../../../shaders/residual_runs.wgsl")),
    ("summary", include_str!("../../../shaders/summary.wgsl")),
    ("tally", include_str!("../../../shaders/tally.wgsl")),
    ("unpack", include_str!("../../../shaders/unpack.wgsl")),
    ("bilinear", include_str!("../../../shaders/shared/bilinear.wgsl")),
    ("cg", include_str!("../../../shaders/shared/cg.wgsl")),
    ("cubic", include_str!("../../../shaders/shared/cubic.wgsl")),
    ("index", include_str!("../../../shaders/shared/index.wgsl")),
    ("keys", include_str!("../../../shaders/shared/keys.wgsl")),
    ("light", include_str!("../../../shaders/shared/light.wgsl")),
    ("place", include_str!("../../../shaders/shared/place.wgsl")),
    ("q4", include_str!("../../../shaders/shared/q4.wgsl")),
    ("quintic", include_str!("../../../shaders/shared/quintic.wgsl")),
    ("reduce", include_str!("../../../shaders/shared/reduce.wgsl")),
    ("sums", include_str!("../../../shaders/shared/sums.wgsl")),
    ("tallies", include_str!("../../../shaders/shared/tallies.wgsl")),
    ("taps4", include_str!("../../../shaders/shared/taps4.wgsl")),
    ("taps6", include_str!("../../../shaders/shared/taps6.wgsl")),
    ("types", include_str!("../../../shaders/shared/types.wgsl")),
];

/// The whole source of a kernel: a line `#import NAME` stands for the file of that name, taken once, and
/// `#import spline` for that of the interpolation.
///
/// ```
/// use quadrille::backend::gpu::{Kernel, source};
/// use quadrille::imaging::Interpolation;
/// assert!(source(Kernel::Residual, Interpolation::Quintic).contains("struct Element"));
/// ```
///
/// # Panics
/// When a shader imports a file that does not exist.
pub fn source(kernel: Kernel, interpolation: Interpolation) -> String {
    let mut text = String::new();
    let mut taken = Vec::new();
    add(&mut text, &mut taken, kernel.file(), interpolation);
    text
}

fn add(text: &mut String, taken: &mut Vec<&'static str>, name: &str, interpolation: Interpolation) {
    let name = match name {
        "spline" => interpolation.name(),
        name => name,
    };
    let Some((name, file)) = FILES.iter().find(|(file, _)| *file == name) else {
        panic!("there is no shader file '{name}'")
    };
    if taken.contains(name) {
        return;
    }
    taken.push(name);
    for line in file.lines() {
        match line.strip_prefix("#import ") {
            Some(import) => add(text, taken, import.trim(), interpolation),
            None => {
                text.push_str(line);
                text.push('\n');
            }
        }
    }
}
