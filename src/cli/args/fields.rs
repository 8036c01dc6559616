//! What the commands take that read the fields of a run, and `metrology`.

use super::shared::{Drawn, Quiet, Threads};
use super::words::{megabytes, two_zones};
use crate::cli::look::frames::Frames;
use crate::field::{RemoveRigid, StrainDefinition};
use crate::imaging::Interpolation;
use crate::io::case::flags::numbers;
use crate::io::case::{CaseLoad, CaseQuantityOptions, CaseTension};
use crate::report::{Animated, Figure, Format};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What `quadrille export` makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// DIR/csv/NNNNNN.csv: one row per measured node.
    Csv,
    /// DIR/vtu/NNNNNN.vtu and DIR/series.pvd for ParaView.
    Vtu,
    /// DIR/fields.npz for numpy.load; with --split DIR/npz/NNNNNN.npz.
    Npz,
    /// DIR/fields.mat for MATLAB and scipy.io.loadmat; with --split DIR/mat/NNNNNN.mat.
    Mat,
    /// DIR/nodemap/NNNNNN.txt as ARAMIS writes them: mm, y up.
    Nodemap,
    /// DIR/vic-2d/NNNNNN.csv with the columns of VIC-2D: px.
    #[value(name = "vic-2d")]
    Vic2d,
    /// DIR/matchid/NNNNNN.csv with the columns of MatchID: px.
    #[value(name = "matchid")]
    MatchId,
    /// DIR/fields.h5 in the exchange layout of DIC_Exchange (TU Dresden): mm, or px without scale; with --split
    /// DIR/hdf5/NNNNNN.h5.
    Hdf5,
    /// DIR/boundary/NNNNNN.csv and .inp: displacements of the border of each zone, mm, y up, for a model.
    Boundary,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Tables and ParaView files of a long series, every frame from 100 to 200:\n    \
    quadrille export out --to csv,vtu --frames 100-200\n  \
    One file for MATLAB, in another folder:\n    \
    quadrille export out --to mat --output for-matlab\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be done.")]
pub struct ExportArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// What to make.
    #[arg(long, value_name = "csv,vtu,npz,mat,..", value_delimiter = ',', required = true)]
    pub to: Vec<Target>,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all that have a field.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "all")]
    pub frames: Frames,
    /// Folder for the files; made when it is not there. Default: DIR.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// npz and mat: a file for each frame instead of one for all.
    #[arg(long)]
    pub split: bool,
    /// Replace files that are there already.
    #[arg(long)]
    pub overwrite: bool,
    #[command(flatten)]
    pub talk: Quiet,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A point and an extensometer over all frames, beside the load recorded with each image:\n    \
    quadrille probe out --point 512,300 --extensometer 100,400,900,400 --load load.csv\n  \
    Opening and sliding along a joint, without the rotation of the specimen:\n    \
    quadrille probe out --opening upper,lower --remove-rigid all\n  \
    Modulus, Poisson's ratio and proof stress of a bar of 12.5 x 3 mm, from the strains of a region:\n    \
    quadrille probe out --region 80,40,140,400 --tension region1 --load load.csv --area 12.5x3\n\n\
    Writes DIR/quantities/points.csv, lines.csv, extensometers.csv, regions.csv, openings.csv, openings_mean.csv,\n\
    rigid_motions.csv and tension.csv, those that are asked for. Sections [[probe]], [[line]], [[extensometer]], [[region]],\n\
    [[opening]], [tension], [load] and [quantities] of a case file say the same.\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be done.")]
pub struct ProbeArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "all")]
    pub frames: Frames,
    /// A case file (TOML) that says what to draw. Flags of a kind replace its sections of that kind. Default,
    /// without any flag: the case of the run.
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// Another camera than that of the run: camera.toml, or OpenCV's YAML or JSON. The pixel size that it states is used.
    #[arg(long, value_name = "FILE", help_heading = "Input")]
    pub camera: Option<String>,
    /// A point, px: displacement and strain with their uncertainty. Repeat it for several.
    #[arg(long, value_name = "x,y", value_parser = numbers::<2>, allow_hyphen_values = true)]
    pub point: Vec<[f64; 2]>,
    /// A line, px: the same at points along it. Repeat it for several.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub line: Vec<[f64; 4]>,
    /// Distance of the points of lines, px. Default: a quarter of the element size.
    #[arg(id = "line.step_px", long = "step", value_name = "PX", allow_hyphen_values = true)]
    pub step: Option<f64>,
    /// An extensometer from one point to another, px: elongation and strain. Repeat it for several.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub extensometer: Vec<[f64; 4]>,
    /// Average extensometers over gauge lines of this length across their ends, px.
    #[arg(id = "extensometer.width_px", long = "width", value_name = "PX", allow_hyphen_values = true)]
    pub width: Option<f64>,
    /// A rectangle, px: mean displacement and strain over it, and how they vary. Repeat it for several.
    #[arg(id = "region.roi", long = "region", value_name = "x0,y0,x1,y1", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub region: Vec<[f64; 4]>,
    /// Opening and sliding between two zones along their facing edges; for a horizontal joint the upper zone
    /// first. Repeat it for several.
    #[arg(id = "opening.zones", long = "opening", value_name = "upper,lower", value_parser = two_zones)]
    pub opening: Vec<[String; 2]>,
    #[command(flatten)]
    pub options: CaseQuantityOptions,
    #[command(flatten)]
    pub tension: CaseTension,
    /// Definition of the strains. Default: that of the run.
    #[arg(long, value_name = "infinitesimal|green-lagrange|hencky", help_heading = "Output")]
    pub strain: Option<StrainDefinition>,
    /// Strains at points and lines over a window of N x N nodes as well, N odd; 1: none. Default: that of the run.
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = "Output")]
    pub strain_window: Option<u32>,
    /// What other instruments recorded (CSV, a row per image, or a column of times): joined to every row.
    #[arg(id = "load.file", long = "load", value_name = "FILE", help_heading = "Input")]
    pub load: Option<PathBuf>,
    #[command(flatten)]
    pub load_options: CaseLoad,
    /// Draw every quantity against each column of the load file, or without one against the frame number, as PNG
    /// and SVG into DIR/curves; or those named, as in --curves=stress_MPa:strain_engineering,ux_px:frame.
    #[arg(long, value_name = "Y:X,..", num_args = 0..=1, require_equals = true, default_missing_value = "",
        value_parser = Curves::parse, help_heading = "Quantities")]
    pub curves: Option<Curves>,
    /// Folder for `quantities/`. Default: DIR.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub talk: Quiet,
    #[command(flatten)]
    pub drawn: Drawn,
}

/// Curves to draw, each a quantity and what it is drawn against; all there are where none is named.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Curves(pub Vec<[String; 2]>);

impl Curves {
    fn parse(text: &str) -> Result<Self, String> {
        let pair = |text: &str| match text.split_once(':') {
            Some((of, against)) => Ok([of, against].map(|name| name.trim().to_owned())),
            None => Err(format!("'{text}' is not a quantity against another such as stress_MPa:strain_engineering")),
        };
        text.split(',').filter(|text| !text.is_empty()).map(pair).collect::<Result<_, _>>().map(Self)
    }
}

/// Where `quadrille figures` takes a strain from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StrainPlace {
    /// One value for each element, over its size.
    Elements,
    /// Interpolated between nodes, over twice the element size: smoother.
    Nodes,
}

/// A kind of file that `quadrille figures` writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// One picture a frame.
    Still(Format),
    /// All frames, one after the other.
    Moving(Animated),
    /// The same as a video.
    Video,
}

impl FileKind {
    const ALL: [Self; 5] = [
        Self::Still(Format::Png),
        Self::Still(Format::Svg),
        Self::Moving(Animated::Gif),
        Self::Moving(Animated::Apng),
        Self::Video,
    ];

    /// Ending of the file's name, also the name used in options.
    pub fn name(self) -> &'static str {
        match self {
            Self::Still(format) => format.name(),
            Self::Moving(kind) => kind.name(),
            Self::Video => "mp4",
        }
    }

    /// The kind of picture; `None` of what moves.
    pub fn still(self) -> Option<Format> {
        if let Self::Still(format) = self { Some(format) } else { None }
    }

    /// The kind of animation; `None` of a picture and of a video.
    pub fn animated(self) -> Option<Animated> {
        if let Self::Moving(kind) = self { Some(kind) } else { None }
    }
}

impl std::str::FromStr for FileKind {
    type Err = String;

    fn from_str(word: &str) -> std::result::Result<Self, String> {
        let named = Self::ALL.into_iter().find(|kind| kind.name() == word);
        named.ok_or_else(|| format!("unknown format '{word}'; expected png or svg, of a series gif, apng or mp4"))
    }
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    Displacements, strains and residual of the last frame, into out/figures:\n    \
    quadrille figures out\n  \
    Two strains of three frames for a paper, with one colour bar:\n    \
    quadrille figures out --frames 5,10,20 --quantity exx,eyy --range=-0.01,0.01 --style paper --format svg\n  \
    The whole series as an animation for slides, out/figures/eyy.gif:\n    \
    quadrille figures out --frames all --quantity eyy --format gif\n  \
    The opening along a line across two strips, and both strips brought into register:\n    \
    quadrille figures out --quantity uy,register --line 600,20,600,780\n\n\
    Exit status: 0 everything asked for is there; 1 some frame named by --frames has no field; 2 nothing could \
    be drawn.")]
pub struct FiguresArgs {
    /// Folder of a run of `quadrille correlate`; it may still go on.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all that have a field.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "last")]
    pub frames: Frames,
    /// What to draw: ux, uy, magnitude; strains exx, eyy, exy, e1, e2 (principal), shear-max, von-mises, each also over
    /// a window as exx-window and so on; rotation, residual, residual-percent, sigma, model-error, misfit, mesh, deformed,
    /// register.
    /// Default ux,uy,exx,eyy,exy,residual, with a strain window those over it as well.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub quantity: Vec<Figure>,
    /// Kinds of file: png, svg; of a whole series gif, apng, mp4 (by the program ffmpeg), with the same colours in all
    /// frames.
    #[arg(long, value_name = "png,svg,gif,apng,mp4", value_delimiter = ',', default_value = "png")]
    pub format: Vec<FileKind>,
    /// A line, px: shown in the maps, and each quantity drawn along it with a band of 2 standard uncertainties.
    #[arg(long, value_name = "x0,y0,x1,y1", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub line: Option<[f64; 4]>,
    /// Factor on displacements in deformed and register. Default: one that makes them visible; 1 where the
    /// deformed image can be shown.
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    pub magnify: Option<f64>,
    /// Ends of the colour bars, for all maps drawn. Default: the values of each.
    #[arg(long, value_name = "low,high", value_parser = numbers::<2>, allow_hyphen_values = true)]
    pub range: Option<[f64; 2]>,
    /// Definition of the strains. Default: that of the run.
    #[arg(long, value_name = "infinitesimal|green-lagrange|hencky")]
    pub strain: Option<StrainDefinition>,
    /// Nodes along a side of the window of exx-window, eyy-window and exy-window, odd; 1: none. Default: that of the
    /// run.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub strain_window: Option<u32>,
    /// Strains of elements or of nodes.
    #[arg(long, value_enum, default_value = "elements")]
    pub strain_on: StrainPlace,
    /// Rigid motion that register takes off: of each zone, or of all together.
    #[arg(long, value_name = "zone|all", default_value = "zone")]
    pub remove_rigid: RemoveRigid,
    /// Pixels per unit of length in PNG files, 1 to 4: 1 for the screen, 2 or 3 for print.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub scale: u32,
    /// Folder for the pictures; made when it is not there. Default: DIR/figures.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Put warnings into a text beside each figure.
    #[arg(long, help_heading = "Output")]
    pub no_warnings: bool,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
    #[command(flatten)]
    pub drawn: Drawn,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    A page with all frames of a run, out/view.html:\n    \
    quadrille view out\n  \
    A small one of some frames, to send:\n    \
    quadrille view out --frames 1,50,100-120 --max-mb 5 --output for-anna.html\n\n\
    The page is one file, fetches nothing and works without a network: frames, quantities, values with their uncertainty, profiles \
    along a line, gauges over all frames. Keys: arrows and space (frames), q (quantity), v p g m (what the pointer does), + - 0 \
    (zoom). The report.html of a run has the same in one of its sections. Exit status: 0 fine; 1 some frame named by --frames has no field; 2 nothing could be shown.")]
pub struct ViewArgs {
    /// Folder of a run of `quadrille correlate` or `quadrille run`, which may still go on, or of `quadrille
    /// metrology`.
    #[arg(value_name = "DIR")]
    pub run: PathBuf,
    /// Frames: numbers from 1 and ranges such as 1,5-20; last; or all that have a field.
    #[arg(long, value_name = "1,5-20|last|all", default_value = "all")]
    pub frames: Frames,
    /// Size of the page, MB: from a longer series evenly spaced frames are taken, and the page says so.
    #[arg(long, value_name = "MB", default_value_t = 15.0, value_parser = megabytes)]
    pub max_mb: f64,
    /// The file. Default: DIR/view.html.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub talk: Quiet,
}

#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  \
    One image: texture, uncertainty and resolution, with a noise that is assumed:\n    \
    quadrille metrology ref.tif\n  \
    With images of the specimen at rest, from which the noise is measured, of one zone:\n    \
    quadrille metrology ref.tif 'static/*.tif' --roi 10,10,1010,400 --output out\n  \
    Elements that resolve a period of 100 px:\n    \
    quadrille metrology ref.tif static.tif --resolve-period 100\n  \
    Noise against the length of the strain gauge, for one element size:\n    \
    quadrille metrology ref.tif static.tif --element-sizes 16 --strain-windows 3,5,9,15\n\n\
    Prints tables; with --output DIR writes DIR/report.html, the page of it, DIR/metrology.json and DIR/strain_gauges.csv as well.")]
pub struct MetrologyArgs {
    /// The reference image.
    #[arg(value_name = "REFERENCE")]
    pub reference: PathBuf,
    /// Further images of the specimen at rest, as the reference: files or quoted globs.
    #[arg(value_name = "STATIC")]
    pub stills: Vec<String>,
    /// The rectangle to look at, px: left, top, right, bottom. Default: the whole image. Of more than a
    /// million pixels the middle is used.
    #[arg(
        long,
        value_name = "x0,y0,x1,y1",
        value_parser = numbers::<4>,
        allow_hyphen_values = true,
        help_heading = "Zones"
    )]
    pub roi: Option<[f64; 4]>,
    /// Element sizes to try, px (4 to 128). Default: those of 6,8,12,16,24,32,48,64 that fit.
    #[arg(long, value_name = "PX,PX..", value_delimiter = ',', allow_hyphen_values = true)]
    pub element_sizes: Option<Vec<i64>>,
    /// Windows of the virtual strain gauges to try beside the element itself, nodes along a side, odd. Default: those
    /// of 3,5,7,9,11 that fit.
    #[arg(long, value_name = "N,N..", value_delimiter = ',', allow_negative_numbers = true)]
    pub strain_windows: Option<Vec<u32>>,
    /// Standard deviation of the noise of one image, grey levels. Default: measured on the static images;
    /// assumed without any.
    #[arg(long, value_name = "S", allow_hyphen_values = true, help_heading = "Correlation")]
    pub noise: Option<f64>,
    /// Interpolation of the correlation: quintic (default), cubic, keys, bilinear.
    #[arg(long, value_name = "NAME", help_heading = "Correlation")]
    pub interpolation: Option<Interpolation>,
    /// Standard uncertainty that the recommended elements reach, px.
    #[arg(long, value_name = "PX", default_value_t = 0.02, allow_hyphen_values = true)]
    pub target_sigma: f64,
    /// Recommend the largest elements that resolve waves of this period at 90 % of their amplitude, px.
    #[arg(long, value_name = "PX", allow_hyphen_values = true)]
    pub resolve_period: Option<f64>,
    /// Folder for metrology.json, strain_gauges.csv and the figures; made when it is not there, an earlier one is
    /// replaced.
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Seed of the noise that is added to copies of the image.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Page of multi-page TIFF files. Default 0, the first.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub page: Option<u32>,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub drawn: Drawn,
}
