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

/// Where the time that a kernel takes is counted, when that of a frame is shared out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// From pixels to interpolation coefficients.
    Image,
    /// The residual and its sums.
    Residual,
    /// The normal equations.
    Solve,
    /// All else.
    Other,
}

/// How large the work of a kernel is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Pixels of the image.
    pub pixels: u64,
    /// Pixels of one of its sides.
    pub side: u64,
    /// Elements of the mesh.
    pub elements: u64,
    /// Its nodes; inner ones are coupled with nine.
    pub nodes: u64,
    /// Times that the kernel runs.
    pub runs: u64,
}

/// All that is asked of a kernel.
struct Row {
    name: &'static str,
    file: &'static str,
    text: &'static str,
    entry: &'static str,
    threads: u32,
    interpolates: bool,
    bindings: &'static [Binding],
    part: Part,
    bytes: fn(Extent) -> u64,
    operations: fn(Extent) -> u64,
    moves: &'static str,
}

/// Makes [`Kernel`] of a table with a row for each: its name; its file in `shaders/`, without the ending, and its entry
/// point there, with `spline` where the source depends on the interpolation; threads of a workgroup and bindings; the
/// [`Part`] of a frame's time that it counts to; the bytes that it must move at least; its arithmetic, integers
/// included, as counted in the source for the cubic spline, right to about a third; and what the bytes are: every value
/// that it reads or writes counts once, however often it is read; P pixels, E elements, N nodes.
macro_rules! kernels {
    ($(
        $(#[$doc:meta])*
        $kernel:ident = $name:literal: $file:literal $entry:ident $($spline:ident)?,
            $threads:literal [$($binding:ident)*], $part:ident, $bytes:expr, $operations:expr, $moves:literal;
    )*) => {
        /// A kernel: an entry point of a shader file.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Kernel {
            $($(#[$doc])* $kernel,)*
        }

        /// Every kernel.
        pub const KERNELS: [Kernel; ROWS.len()] = [$(Kernel::$kernel),*];

        /// In the order of [`Kernel`].
        const ROWS: &[Row] = &[$(Row {
            name: $name,
            file: $file,
            text: quadrille_shaders::text($file),
            entry: stringify!($entry),
            threads: $threads,
            interpolates: !<[&str]>::is_empty(&[$(stringify!($spline))?]),
            bindings: &[$(Binding::$binding),*],
            part: Part::$part,
            bytes: $bytes,
            operations: $operations,
            moves: $moves,
        }),*];
    };
}

kernels! {
    /// Pixels to grey levels.
    Unpack = "unpack": "unpack" main, 64 [Uniform Read Write],
        Image, |of| 5 * of.pixels, |of| 10 * of.pixels, "P (1 B pixel + 4 B grey level)";
    /// Next level of the pyramid.
    Downsample = "downsample": "downsample" main, 64 [Uniform Read Write],
        Image, |of| 5 * of.pixels, |of| 4 * of.pixels, "P (4 B fine + 1/4 of 4 B coarse)";
    /// B-spline coefficients along one axis, and both axes exchanged.
    Prefilter = "prefilter": "prefilter" main, 64 [Uniform Read Write],
        Image, |of| 16 * of.pixels, |of| 70 * of.pixels, "2 passes x P (4 B in + 4 B out)";
    /// Border to the left and right of a plane.
    BorderColumns = "border_columns": "border" columns, 64 [Uniform Write],
        Image, |of| 72 * of.side, |of| 60 * of.side, "per row 10 values in, 8 out";
    /// Border above or below a plane.
    BorderRows = "border_rows": "border" rows, 64 [Uniform Write],
        Image, |of| 72 * of.side, |of| 60 * of.side, "per column 10 values in, 8 out";
    /// Grey levels and gradient of the reference.
    Gradient = "gradient": "gradient" main, 64 [Uniform Read Read Write],
        Other, |of| 16 * of.pixels, |of| 60 * of.pixels, "P (4 B grey level, 4 B coefficient in; 4 B f, 4 B gradient out)";
    /// Moments for the normal matrices.
    NormalMatrix = "normal_matrix": "normal_matrix" main, 64 [Uniform Read Read Read Read Read Write],
        Other, |of| 8 * of.pixels + 256 * of.elements, |of| 90 * of.pixels + 2000 * of.elements, "P (4 B f, 4 B gradient) + E (64 B element, 192 B moments)";
    /// Residual of rectangles of pixels.
    Residual = "residual": "residual" main spline, 64 [Uniform Read Read Read Read Read Write],
        Residual, of_residual, of_residual_work, "P (4 B f, 4 B gradient, 4 B coefficient) + E (64 B element, 64 B sums) + 16 B N";
    /// Residual of elements whose pixels are runs.
    ResidualRuns = "residual_runs": "residual_runs" main spline, 64 [Uniform Read Read Read Read Read Write Read],
        Residual, of_residual, of_residual_work, "P (4 B f, 4 B gradient, 4 B coefficient) + E (64 B element, 64 B sums) + 16 B N";
    /// What the residual follows beyond the field.
    Bend = "bend": "bend" main spline, 64 [Uniform Read Read Read Read Read Write Read],
        Other, |of| of_residual(of) + 32 * of.elements, |of| of_residual_work(of) + 40 * of.pixels,
        "P (4 B f, 4 B gradient, 4 B coefficient) + E (64 B element, 96 B sums) + 16 B N";
    /// Gain and offset of every element.
    Fit = "fit": "tally" fit, 64 [Uniform Read Read Write Write Write],
        Residual, |of| 80 * of.elements, |of| 40 * of.elements, "E (64 B sums, 16 B of the reference)";
    /// Elements left out, sums of groups of elements.
    Tally = "tally": "tally" main, 64 [Uniform Read Read Write Write Write],
        Residual, |of| 80 * of.elements, |of| 40 * of.elements, "E (64 B sums, 16 B of the reference)";
    /// Right-hand side per node.
    Gather = "gather": "gather" main, 256 [Uniform Read Read Read Write Write Write Write],
        Solve, |of| 32 * of.elements + 64 * of.nodes, |of| 60 * of.nodes, "E 32 B of sums + N (24 B incidence, 16 B block, 24 B out)";
    /// Part of the right-hand side that a regularisation asks for.
    Penalty = "penalty": "penalty" main, 256 [Uniform Read Read Read Read Write Write Write],
        Other, |of| 236 * of.nodes, |of| 110 * of.nodes, "9 N (16 B block, 4 B column) + N (16 B field, 16 B block, 8 B in, 16 B out)";
    /// First half of an iteration of the conjugate gradients.
    CgProduct = "cg_product": "cg_product" main, 256 [Uniform Read Read Read Read Write Write Write],
        Solve, |of| of.runs * 212 * of.nodes, |of| of.runs * 100 * of.nodes, "per run: 9 N (16 B block, 4 B column) + N 4 vectors of 8 B";
    /// Second half.
    CgUpdate = "cg_update": "cg_update" main, 256 [Uniform Read Read Read Write Write Write Write],
        Solve, |of| of.runs * 72 * of.nodes, |of| of.runs * 50 * of.nodes, "per run: N (16 B block, 4 vectors in, 3 out of 8 B)";
    /// Correction of the field.
    Correct = "correct": "correct" main, 256 [Uniform Read Write Write Read Read Read Write Write],
        Other, |of| 108 * of.nodes, |of| 60 * of.nodes, "N (8 B correction, 16 B in and out, 20 B of how light moves it, 16 B before and after, 16 B of where it was)";
    /// Sums of the zones, and what follows from them.
    Summary = "summary": "summary" main, 64 [Uniform Read Read Write Write Write Write],
        Other, |of| 48 * of.elements.div_ceil(256), |of| 20 * of.elements.div_ceil(256), "sums of groups of elements";
    /// Largest correction, and whether another step follows.
    Largest = "largest": "largest" main, 64 [Uniform Read Write Write],
        Other, |of| 8 * of.nodes.div_ceil(256), |of| 4 * of.nodes.div_ceil(256), "largest corrections of groups of nodes";
    /// Field of a level from that of the next coarser one.
    Prolong = "prolong": "prolong" main, 256 [Read Read Write],
        Other, |of| 64 * of.nodes, |of| 30 * of.nodes, "N (32 B place, 16 B in, 16 B out)";
    /// Residual map and packed field.
    ResidualMap = "residual_map": "residual_map" main, 256 [Uniform Read Read Read Write],
        Other, |of| 88 * of.elements + 28 * of.nodes, |of| 30 * of.elements + 20 * of.nodes, "E (80 B in, 8 B out) + N (16 B in, 12 B out)";
    /// Of one buffer into another, to measure the memory: no frame needs it.
    Copy = "copy": "copy" main, 256 [Read Write],
        Other, |of| of.runs * 8 * of.pixels, |of| of.runs * 2 * of.pixels, "per run: P (4 B in + 4 B out)";
}

fn of_residual(of: Extent) -> u64 {
    12 * of.pixels + 128 * of.elements + 16 * of.nodes
}

fn of_residual_work(of: Extent) -> u64 {
    160 * of.pixels + 400 * of.elements
}

impl Kernel {
    fn row(self) -> &'static Row {
        &ROWS[self as usize]
    }

    /// Its name in records.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Its file in `shaders/`, without the ending.
    pub fn file(self) -> &'static str {
        self.row().file
    }

    /// Its entry point.
    pub fn entry(self) -> &'static str {
        self.row().entry
    }

    /// Its bindings.
    pub fn bindings(self) -> &'static [Binding] {
        self.row().bindings
    }

    /// Threads of a workgroup.
    pub fn workgroup(self) -> u32 {
        self.row().threads
    }

    /// Whether its source depends on the interpolation.
    pub fn interpolates(self) -> bool {
        self.row().interpolates
    }

    /// Where its time is counted.
    pub fn part(self) -> Part {
        self.row().part
    }

    /// Bytes that it must move at least, and what they are.
    pub fn moves(self, extent: Extent) -> (u64, &'static str) {
        ((self.row().bytes)(extent), self.row().moves)
    }

    /// Its arithmetic, integers included, as counted in the source for the cubic spline: right to about a third.
    pub fn operations(self, extent: Extent) -> u64 {
        (self.row().operations)(extent)
    }
}

/// The whole source of a kernel: a line `#import NAME` stands for the file of that name, taken once, and
/// `#import spline` for that of the interpolation.
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::backend::gpu::{Kernel, source};
/// use quadrille::imaging::Interpolation;
/// assert!(source(Kernel::Residual, Interpolation::Quintic).contains("struct Element"));
/// ```
///
/// # Panics
/// When a shader imports a file that does not exist.
pub fn source(kernel: Kernel, interpolation: Interpolation) -> String {
    let mut text = String::new();
    add(&mut text, &mut Vec::new(), kernel.row().text, interpolation);
    text
}

fn add(text: &mut String, taken: &mut Vec<&'static str>, file: &str, interpolation: Interpolation) {
    for line in file.lines() {
        match line.strip_prefix("#import ").map(str::trim) {
            Some(import) => {
                let import = if import == "spline" { interpolation.name() } else { import };
                let file = quadrille_shaders::text(&format!("shared/{import}"));
                if !taken.contains(&file) {
                    taken.push(file);
                    add(text, taken, file, interpolation);
                }
            }
            None => {
                text.push_str(line);
                text.push('\n');
            }
        }
    }
}
