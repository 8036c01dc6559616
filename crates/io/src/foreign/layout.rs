//! How other programs lay out their fields: one table for all.

/// A unit of length in a table of another program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthUnit {
    /// Pixels of the reference image.
    Px,
    /// Micrometres.
    Um,
    /// Millimetres.
    Mm,
    /// Metres.
    M,
    /// Inches.
    Inch,
}

impl LengthUnit {
    /// The unit that stands in brackets behind a name.
    pub(super) fn named(word: &str) -> Option<Self> {
        Some(match word.trim().to_ascii_lowercase().as_str() {
            "px" | "pix" | "pixel" | "pixels" => Self::Px,
            "um" | "\u{b5}m" | "\u{3bc}m" => Self::Um,
            "mm" => Self::Mm,
            "m" => Self::M,
            "in" | "inch" | "inches" => Self::Inch,
            _ => return None,
        })
    }

    /// Millimetres that it is; nothing for pixels.
    pub fn in_mm(self) -> Option<f64> {
        match self {
            Self::Px => None,
            Self::Um => Some(1e-3),
            Self::Mm => Some(1.0),
            Self::M => Some(1e3),
            Self::Inch => Some(25.4),
        }
    }
}

impl std::str::FromStr for LengthUnit {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        Self::named(word).ok_or_else(|| format!("unknown unit '{word}'; expected px, um, mm, m or inch"))
    }
}

/// Where y points in a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum YAxis {
    /// Down, as the rows of an image go.
    Down,
    /// Up.
    Up,
}

impl std::str::FromStr for YAxis {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "up" => Ok(Self::Up),
            "down" => Ok(Self::Down),
            _ => Err(format!("unknown direction '{word}' of y; expected up or down")),
        }
    }
}

/// How a point says that it was not measured, beside numbers that are none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Invalid {
    /// Its uncertainty is below zero.
    NegativeSigma,
    /// This column is zero.
    Zero(&'static str),
}

/// How a program lays out a field: names of its columns (small letters, without unit, `_` for spaces), what it leaves
/// unsaid, and how it marks points that it did not measure.
#[derive(Debug, PartialEq, Eq)]
pub struct Layout {
    /// Name in options.
    pub name: &'static str,
    /// The program.
    pub program: &'static str,
    /// Possible names of the columns of x, y, u and v; none of what is no table.
    pub(super) columns: &'static [[&'static str; 4]],
    /// Columns of which one is there, where those above do not tell it from others.
    pub(super) beside: &'static [&'static str],
    /// Columns of the standard uncertainty of u and v, in their unit.
    pub(super) sigma: Option<[&'static str; 2]>,
    /// The unit where the file names none.
    pub(super) unit: Option<LengthUnit>,
    /// Where y points; nothing where the program leaves it to its user.
    pub(super) y: Option<YAxis>,
    pub(super) invalid: Option<Invalid>,
}

const PLAIN: Layout = Layout {
    name: "table",
    program: "a table",
    columns: &[
        ["x", "y", "u", "v"],
        ["x", "y", "ux", "uy"],
        ["x", "y", "dx", "dy"],
        ["x_px", "y_px", "u_px", "v_px"],
        ["x_mm", "y_mm", "u_mm", "v_mm"],
        ["x_mm", "y_mm", "ux_mm", "uy_mm"],
    ],
    beside: &[],
    sigma: None,
    unit: None,
    y: None,
    invalid: None,
};

/// Layouts of files in HDF5.
pub(super) const NCORR: &str = "ncorr";
pub(super) const EXCHANGE: &str = "dic-exchange";

/// All layouts; the first that fits is taken.
pub const LAYOUTS: [Layout; 10] = [
    Layout {
        name: "quadrille",
        program: "quadrille",
        // The coefficients, of which the uncertainty is that of the file.
        columns: &[["x_px", "y_px", "ux_px", "uy_px"]],
        sigma: Some(["sigma_ux_px", "sigma_uy_px"]),
        unit: Some(LengthUnit::Px),
        y: Some(YAxis::Down),
        ..PLAIN
    },
    Layout {
        name: "dice",
        program: "DICe",
        columns: &[["coordinate_x", "coordinate_y", "displacement_x", "displacement_y"]],
        sigma: Some(["sigma", "sigma"]),
        unit: Some(LengthUnit::Px),
        y: Some(YAxis::Down),
        invalid: Some(Invalid::NegativeSigma),
        ..PLAIN
    },
    Layout {
        name: "matchid",
        program: "MatchID",
        columns: &[
            [
                "coordinates.image_x",
                "coordinates.image_y",
                "disp.horizontal_displacement_u",
                "disp.vertical_displacement_v",
            ],
            ["x_pic", "y_pic", "u", "v"],
        ],
        unit: Some(LengthUnit::Px),
        y: Some(YAxis::Down),
        ..PLAIN
    },
    Layout {
        name: "nodemap",
        program: "ARAMIS or GOM Correlate",
        columns: &[["x_undef", "y_undef", "u", "v"], ["x_undef", "y_undef", "ux", "uy"]],
        unit: Some(LengthUnit::Mm),
        y: Some(YAxis::Up),
        ..PLAIN
    },
    Layout {
        name: "pyaldic",
        program: "pyALDIC",
        columns: &[["x_px", "y_px", "disp_u", "disp_v"]],
        unit: Some(LengthUnit::Px),
        y: Some(YAxis::Down),
        ..PLAIN
    },
    Layout {
        name: "davis",
        program: "DaVis",
        columns: &[["x", "y", "vx", "vy"]],
        invalid: Some(Invalid::Zero("isvalid")),
        ..PLAIN
    },
    Layout {
        name: "vic-2d",
        program: "VIC-2D",
        columns: &[["x", "y", "u", "v"]],
        beside: &["sigma", "x_c", "u_c"],
        sigma: Some(["sigma", "sigma"]),
        unit: Some(LengthUnit::Px),
        y: Some(YAxis::Down),
        invalid: Some(Invalid::NegativeSigma),
    },
    Layout { name: NCORR, program: "Ncorr", columns: &[], unit: Some(LengthUnit::Px), y: Some(YAxis::Down), ..PLAIN },
    Layout { name: EXCHANGE, program: "another program", columns: &[], ..PLAIN },
    PLAIN,
];

impl Layout {
    /// The layout of this name.
    pub fn of_name(name: &str) -> Option<&'static Self> {
        LAYOUTS.iter().find(|layout| layout.name == name)
    }

    /// Places of x, y, u and v among columns of these names.
    pub(super) fn places(&self, names: &[String]) -> Option<[usize; 4]> {
        let at = |name: &str| names.iter().position(|column| column == name);
        let all = |[x, y, u, v]: &[&str; 4]| Some([at(x)?, at(y)?, at(u)?, at(v)?]);
        self.columns.iter().find_map(all)
    }

    /// Whether columns of these names are recognised as this layout.
    pub(super) fn is_of(&self, names: &[String]) -> bool {
        let is_there = |name: &&str| names.iter().any(|column| column == name);
        self.places(names).is_some() && (self.beside.is_empty() || self.beside.iter().any(is_there))
    }
}

impl std::str::FromStr for &'static Layout {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let names = || LAYOUTS.map(|layout| layout.name).join(", ");
        Layout::of_name(word).ok_or_else(|| format!("unknown layout '{word}'; expected {}", names()))
    }
}
