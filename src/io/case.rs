//! Case files: what to correlate and how, as TOML.

use crate::field::{
    Brightness, Noise, NoiseCorrelation, RegularisationKind, StartFrom, StrainDefinition, UpdateReference,
};
use crate::imaging::Interpolation;
use crate::mesh::Roi;
use lists::{four_numbers, one_or_list, one_or_more, polygon, polygons};
use serde::{Deserialize, Serialize};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use thiserror::Error;
use toml::de::{DeTable, DeValue};

mod lists;
mod quantities;

pub use quantities::{
    CaseExtensometer, CaseLine, CaseLoad, CaseOpening, CaseProbe, CaseQuantities, CaseQuantityOptions,
};

/// A case file; what it does not say is `None` and left to the command line and the defaults.
///
/// ```
/// use quadrille::io::case::parse_case;
/// let case = parse_case("images.deformed = 'shots/*.tif'\n[[zone]]\nroi = [10, 10, 90, 90]", "a/case.toml".as_ref())?;
/// assert_eq!(case.images.deformed, Some(vec!["shots/*.tif".to_owned()]));
/// assert_eq!(case.base, std::path::Path::new("a"));
/// # Ok::<(), quadrille::io::case::CaseError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Folder of the case file: relative names in it are relative to this. Not written.
    #[serde(skip)]
    pub base: PathBuf,
    /// The section `[images]`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub images: CaseImages,
    /// The section `[correlation]`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub correlation: CaseCorrelation,
    /// The sections `[[zone]]`, in order.
    #[serde(rename = "zone", default, skip_serializing_if = "Vec::is_empty")]
    pub zones: Vec<CaseZone>,
    /// The section `[quantities]`.
    #[serde(default, skip_serializing_if = "is_default")]
    pub quantities: CaseQuantityOptions,
    /// The section `[load]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub load: Option<CaseLoad>,
    /// The sections `[[probe]]`, in order.
    #[serde(rename = "probe", default, skip_serializing_if = "Vec::is_empty")]
    pub probes: Vec<CaseProbe>,
    /// The sections `[[line]]`, in order.
    #[serde(rename = "line", default, skip_serializing_if = "Vec::is_empty")]
    pub lines: Vec<CaseLine>,
    /// The sections `[[extensometer]]`, in order.
    #[serde(rename = "extensometer", default, skip_serializing_if = "Vec::is_empty")]
    pub extensometers: Vec<CaseExtensometer>,
    /// The sections `[[opening]]`, in order.
    #[serde(rename = "opening", default, skip_serializing_if = "Vec::is_empty")]
    pub openings: Vec<CaseOpening>,
    /// The section `[run]`: how a finished run came about. Ignored when a case is run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<toml::Table>,
}

impl CaseFile {
    /// `name` of this case file as a path: relative names start at the folder of the case file.
    pub fn resolve(&self, name: &str) -> PathBuf {
        self.base.join(name)
    }

    /// What this case draws from the fields, with the load file as a path that starts at the current folder.
    pub fn drawn(&self) -> CaseQuantities {
        let load = |load: &CaseLoad| CaseLoad { file: self.resolve(&load.file).display().to_string() };
        CaseQuantities {
            options: self.quantities.clone(),
            load: self.load.as_ref().map(load),
            probes: self.probes.clone(),
            lines: self.lines.clone(),
            extensometers: self.extensometers.clone(),
            openings: self.openings.clone(),
        }
    }

    /// This case with other quantities.
    pub fn with_drawn(self, drawn: &CaseQuantities) -> Self {
        let CaseQuantities { options, load, probes, lines, extensometers, openings } = drawn.clone();
        Self { quantities: options, load, probes, lines, extensometers, openings, ..self }
    }
}

/// Which images.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseImages {
    /// The reference image: a file name. Of several, names or globs, the mean is taken. In the file one string or a
    /// list of strings.
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "one_or_more",
        serialize_with = "one_or_list"
    )]
    pub reference: Option<Vec<String>>,
    /// The deformed images: file names and globs. In the file one string or a list of strings.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "one_or_more")]
    pub deformed: Option<Vec<String>>,
    /// Page of TIFF files with several pages; the first is 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub page: Option<u32>,
    /// Whether every page of the deformed files is a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pages: Option<Pages>,
    /// Size of a pixel on the specimen, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_size_mm: Option<f64>,
}

/// Which pages of a file are frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pages {
    /// Every page.
    All,
}

/// How to correlate.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseCorrelation {
    /// Side of the elements, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element_size_px: Option<u32>,
    /// Share of its pixels that an element of a polygon or a mask must have inside, to be kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub element_share: Option<f64>,
    /// Sub-pixel interpolation of the deformed image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<Interpolation>,
    /// Correction of the displacement below which a frame has converged, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_px: Option<f64>,
    /// Largest number of iterations of a frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_iterations: Option<u32>,
    /// Correction of brightness and contrast.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brightness: Option<Brightness>,
    /// Where the correlation of a frame starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<StartFrom>,
    /// When a frame becomes the reference of those that follow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub update_reference: Option<UpdateReference>,
    /// The camera noise: its standard deviation, grey levels, or a variance that rises with the grey level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<Noise>,
    /// What becomes of noise that is correlated from pixel to pixel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_correlation: Option<NoiseCorrelation>,
    /// What the displacement is held by beside the images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regularisation: Option<RegularisationKind>,
    /// Cut-off length of the regularisation, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cutoff_px: Option<f64>,
    /// Poisson's ratio in the equilibrium gap.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poisson: Option<f64>,
    /// Definition of the strains.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strain: Option<StrainDefinition>,
    /// Whether nodes without texture are left out, however many; if not, a few of them are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drop_textureless: Option<bool>,
}

/// A zone of the reference image: what lies in all of rectangle, polygon and mask, and in no excluded polygon.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaseZone {
    /// Its name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its rectangle `[x0, y0, x1, y1]`, px of the reference image; `x1` and `y1` are not included.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "four_numbers")]
    pub roi: Option<[f64; 4]>,
    /// Corners `[x, y]` of its polygon, px, in order.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "polygon")]
    pub polygon: Option<Vec<[f64; 2]>>,
    /// Polygons that are cut out, px.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "polygons")]
    pub exclude: Option<Vec<Vec<[f64; 2]>>>,
    /// A mask: an image file of the size of the reference, white where it is measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<String>,
    /// A mesh of its own instead of a grid: a `.msh` or `.vtu` file with positions in px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// The one group of the mesh file that is taken; without it every group is a zone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Elements other than those of a grid of squares on its polygon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub elements: Option<CaseElements>,
    /// Width along the border of the zone whose pixels are left out, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard_px: Option<CaseGuard>,
}

/// How the elements of a zone are laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CaseElements {
    /// Along the sides of its polygon of four corners, of about the element size.
    Mapped,
}

/// Width along the border of a zone whose pixels are left out, px.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum CaseGuard {
    /// The same everywhere.
    All(f64),
    /// One for each side of a polygon, in order; side k leads from corner k to the next.
    Sides(Vec<f64>),
    /// One for each side of a rectangle; in the file those left out are 0.
    Rectangle {
        /// Left.
        left: f64,
        /// Top.
        top: f64,
        /// Right.
        right: f64,
        /// Bottom.
        bottom: f64,
    },
    /// Along a line alone.
    Along {
        /// Points of the line in order, px.
        along: Vec<[f64; 2]>,
        /// Distance from it, px.
        width: f64,
    },
}

impl CaseZone {
    /// The rectangle, when the file gives one.
    pub fn rectangle(&self) -> Option<Roi> {
        self.roi.map(|[x0, y0, x1, y1]| Roi { x0, y0, x1, y1 })
    }
}

/// Why a case file cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CaseError {
    /// There is no such file.
    #[error("{}: there is no such case file; check the name and the folder", path.display())]
    NotFound {
        /// The file.
        path: PathBuf,
    },
    /// The file system refuses.
    #[error("{}: the case file cannot be read: {reason}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// The file is not UTF-8 text.
    #[error("{}, line {line}: the case file is no UTF-8 text; save it as UTF-8", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// Line of the first byte that is none, from 1.
        line: usize,
    },
    /// Not TOML, an unknown key, or a value of the wrong kind.
    #[error("{}, line {line}: {message}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
        /// The key with its section, such as `correlation.noise`, when it is known.
        key: Option<String>,
        /// What is wrong, with the key and what is expected.
        message: String,
    },
}

/// Reads the case file `path`.
///
/// # Errors
/// A file that cannot be read, that is not TOML, or that has a key or a value that a case file does not have.
pub fn read_case(path: &Path) -> Result<CaseFile, CaseError> {
    let bytes = std::fs::read(path).map_err(|reason| match reason.kind() {
        ErrorKind::NotFound => CaseError::NotFound { path: path.to_owned() },
        _ => CaseError::Io { path: path.to_owned(), reason },
    })?;
    match std::str::from_utf8(&bytes) {
        Ok(text) => parse_case(text, path),
        Err(error) => {
            let line = 1 + bytes[..error.valid_up_to()].iter().filter(|&&b| b == b'\n').count();
            Err(CaseError::NotText { path: path.to_owned(), line })
        }
    }
}

/// The case file with the content `text`; `path` gives its folder and stands in messages.
///
/// # Errors
/// As [`read_case`], but nothing is read.
pub fn parse_case(text: &str, path: &Path) -> Result<CaseFile, CaseError> {
    let mut case: CaseFile = toml::from_str(text).map_err(|error| explained(&error, text, path))?;
    case.base = path.parent().map(Path::to_owned).unwrap_or_default();
    Ok(case)
}

/// The text of a case file that says what `case` says. Reading it gives an equal case.
pub fn write_case(case: &CaseFile) -> String {
    // Every value of these structs has a form in TOML: numbers fit in 64 bits, keys are text.
    let body = toml::to_string(case).unwrap_or_else(|error| unreachable!("a case file has a form in TOML: {error}"));
    format!("# Case file of quadrille. File names are relative to the folder of this file.\n{body}")
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Says where `error` is and in plain words what is wrong.
fn explained(error: &toml::de::Error, text: &str, path: &Path) -> CaseError {
    let at = error.span().map_or(0, |span| span.start).min(text.len());
    let before = text.get(..at).unwrap_or("");
    let line = 1 + before.matches('\n').count();
    let column = 1 + before.rsplit('\n').next().unwrap_or("").chars().count();
    let found = DeTable::parse(text).ok().and_then(|table| locate(table.get_ref(), at));
    let (section, key) = match &found {
        Some(found) => (found.section(), Some(found.key())),
        None => (String::new(), None),
    };
    let wrong = plain(error.message());
    let message = match (&found, wrong.split_once(", expected ")) {
        (Some(_), Some((what, expected))) if what.starts_with("unknown key") => {
            format!("{what} {section}; expected {expected}")
        }
        (Some(found), _) => {
            let wrong = wrong.replace("[[..]]", &format!("[[{}]]", found.name)).replace(" in double brackets", "");
            format!("`{}` {section}: {wrong}", found.name)
        }
        // A key that is there twice: the text at the error is the key.
        (None, _) if wrong == "duplicate key" => {
            let name = error.span().and_then(|span| text.get(span)).unwrap_or("");
            format!("the key `{name}` is there twice; remove one")
        }
        (None, _) => wrong,
    };
    CaseError::Invalid { path: path.to_owned(), line, column, key, message }
}

/// serde's words in those of a user.
fn plain(message: &str) -> String {
    let message = message.trim_end();
    if let Some(unknown) = message.strip_prefix("unknown field ") {
        return format!("unknown key {unknown}");
    }
    if let Some(unknown) = message.strip_prefix("unknown variant ") {
        return format!("unknown word {unknown}");
    }
    if let Some(missing) = message.strip_prefix("missing field ") {
        return format!("the key {missing} is missing");
    }
    if message == "wanted string or table" {
        return "expected a word in quotes".to_owned();
    }
    if message.starts_with("missing escaped value") {
        return "a backslash in \"..\" starts an escape; write the text in '..' or with / for \\".to_owned();
    }
    if message.starts_with("string values must be quoted") {
        return "there is no value here, or a text without quotes".to_owned();
    }
    let wrong = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "));
    // The value may itself hold the words looked for: what is expected stands last, the kind first.
    let Some((found, expected)) = wrong.and_then(|wrong| wrong.rsplit_once(", expected ")) else {
        return message.to_owned();
    };
    let found = [
        ("floating point ", "the number "),
        ("integer ", "the number "),
        ("string ", "the text "),
        ("boolean ", ""),
        ("sequence", "a list"),
        ("map", "a section"),
    ]
    .into_iter()
    .find_map(|(theirs, ours)| found.strip_prefix(theirs).map(|rest| format!("{ours}{rest}")))
    .unwrap_or_else(|| found.to_owned());
    let expected = match expected {
        "u32" => "a whole number, 0 or larger",
        "f64" => "a number",
        "a boolean" => "true or false",
        "a string" | "string or table" => "a text in quotes",
        "a sequence" => "sections in double brackets [[..]]",
        "struct CaseZone"
        | "struct CaseProbe"
        | "struct CaseLine"
        | "struct CaseExtensometer"
        | "struct CaseOpening" => "a section in double brackets [[..]]",
        "struct CaseImages" | "struct CaseCorrelation" | "struct CaseLoad" | "struct CaseQuantityOptions" | "a map" => {
            "a section"
        }
        other => other,
    };
    format!("is {found}, expected {expected}")
}

/// Sections that may be there several times.
const LISTS: [&str; 5] = ["zone", "probe", "line", "extensometer", "opening"];

/// A key of the file and the sections above it.
struct Located {
    above: Vec<String>,
    name: String,
}

impl Located {
    fn key(&self) -> String {
        self.above.iter().chain([&self.name]).cloned().collect::<Vec<_>>().join(".")
    }

    fn section(&self) -> String {
        match self.above.as_slice() {
            [] => "at the top level".to_owned(),
            [list] if LISTS.contains(&list.as_str()) => format!("in [[{list}]]"),
            above => format!("in [{}]", above.join(".")),
        }
    }
}

/// The key that stands, or whose value stands, at the byte `at`; the innermost one.
fn locate(table: &DeTable<'_>, at: usize) -> Option<Located> {
    fn inside(value: &DeValue<'_>, at: usize) -> Option<Located> {
        match value {
            DeValue::Table(table) => locate(table, at),
            DeValue::Array(items) => items.iter().find_map(|item| inside(item.get_ref(), at)),
            _ => None,
        }
    }
    table.iter().find_map(|(key, value)| {
        let name = key.get_ref().to_string();
        if let Some(mut found) = inside(value.get_ref(), at) {
            found.above.insert(0, name);
            return Some(found);
        }
        (key.span().contains(&at) || value.span().contains(&at)).then_some(Located { above: Vec::new(), name })
    })
}
