//! Choices of a correlation that case files and the command line name in words.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;
use thiserror::Error;

/// A word that is none of the choices of an option.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("`{given}` is not a choice for {option}; expected {expected}")]
pub struct UnknownChoice {
    /// The option.
    pub option: &'static str,
    /// The word given.
    pub given: String,
    /// The words that exist.
    pub expected: &'static str,
}

impl UnknownChoice {
    /// The one of `all` whose name is `word`.
    pub(in crate::field) fn or_one_of<T: Copy>(
        all: &[T],
        name: fn(T) -> &'static str,
        word: &str,
        [option, expected]: [&'static str; 2],
    ) -> Result<T, Self> {
        let found = all.iter().copied().find(|&choice| name(choice) == word);
        found.ok_or_else(|| Self { option, given: word.to_owned(), expected })
    }
}

/// The change of brightness and contrast that is found along with the displacement:
/// `f = (1 + c) g + d`, with `f` the reference and `g` the deformed image.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::Brightness;
/// assert_eq!("element".parse(), Ok(Brightness::Element));
/// assert_eq!(Brightness::default().to_string(), "auto");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Brightness {
    /// As `zone`, and as `smooth` in each frame in which that lowers the residual significantly; the default.
    #[default]
    Auto,
    /// One `c` and one `d` for each zone.
    Zone,
    /// `c` and `d` as fields, bilinear on a coarse grid over each zone: for gradients of light and moving shadows.
    Smooth,
    /// A `c` and a `d` for each element: for light that changes over the specimen.
    Element,
    /// `c = d = 0`: grey levels are compared as recorded.
    Off,
}

impl Brightness {
    /// Every choice.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Zone, Self::Smooth, Self::Element, Self::Off];

    /// What the sums over pixels are made with: a smooth field starts from the transfer of its zone.
    pub fn of_sums(self) -> Self {
        match self {
            Self::Auto | Self::Smooth => Self::Zone,
            of_sums => of_sums,
        }
    }

    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Brightness::Auto => "auto",
            Brightness::Zone => "zone",
            Brightness::Smooth => "smooth",
            Brightness::Element => "element",
            Brightness::Off => "off",
        }
    }
}

impl fmt::Display for Brightness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Brightness {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let told = ["brightness", "auto, zone, smooth, element or off"];
        UnknownChoice::or_one_of(&Self::ALL, Self::name, word, told)
    }
}

/// Where the correlation of a frame starts.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::StartFrom;
/// assert_eq!("independent".parse(), Ok(StartFrom::Independent));
/// assert!("warm".parse::<StartFrom>().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum StartFrom {
    /// The field of the frame before; the default.
    #[default]
    Previous,
    /// Nothing known: each frame is searched for on its own, so that frames can be done in any order. Called `cold`
    /// as well.
    #[serde(alias = "cold")]
    Independent,
}

impl StartFrom {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            StartFrom::Previous => "previous",
            StartFrom::Independent => "independent",
        }
    }
}

impl fmt::Display for StartFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for StartFrom {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let word = if word == "cold" { "independent" } else { word };
        let told = ["start", "previous or independent"];
        UnknownChoice::or_one_of(&[Self::Previous, Self::Independent], Self::name, word, told)
    }
}

/// What a displacement field is held by beside the images.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::RegularisationKind;
/// assert_eq!("equilibrium-gap".parse(), Ok(RegularisationKind::EquilibriumGap));
/// assert_eq!(RegularisationKind::default().to_string(), "none");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RegularisationKind {
    /// Nothing; the default.
    #[default]
    None,
    /// Small gradients of the displacement.
    Tikhonov,
    /// Equilibrium of an elastic plate without forces in its plane.
    EquilibriumGap,
}

impl RegularisationKind {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            RegularisationKind::None => "none",
            RegularisationKind::Tikhonov => "tikhonov",
            RegularisationKind::EquilibriumGap => "equilibrium-gap",
        }
    }
}

impl fmt::Display for RegularisationKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for RegularisationKind {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let told = ["regularisation", "none, tikhonov or equilibrium-gap"];
        UnknownChoice::or_one_of(&[Self::None, Self::Tikhonov, Self::EquilibriumGap], Self::name, word, told)
    }
}

/// What the displacement is between the nodes.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::Elements;
/// assert_eq!("cubic-spline".parse(), Ok(Elements::CubicSpline));
/// assert_eq!(Elements::default().to_string(), "bilinear");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Elements {
    /// Bilinear in each element (Q4); the default.
    #[default]
    Bilinear,
    /// A bicubic spline with knots one element size apart; kept at nodes half as far apart, between which it is
    /// bilinear.
    CubicSpline,
}

impl Elements {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bilinear => "bilinear",
            Self::CubicSpline => "cubic-spline",
        }
    }
}

impl fmt::Display for Elements {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Elements {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let told = ["elements", "bilinear or cubic-spline"];
        UnknownChoice::or_one_of(&[Self::Bilinear, Self::CubicSpline], Self::name, word, told)
    }
}

/// When a series takes one of its own frames for the reference of those that follow.
///
/// `never`, `residual` or `every N`; a number of frames alone is `every N` as well.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::UpdateReference;
/// let every: UpdateReference = "every 5".parse().unwrap();
/// assert_eq!(("5".parse(), every.to_string().as_str()), (Ok(every), "every 5"));
/// assert_eq!(UpdateReference::default(), "never".parse().unwrap());
/// assert!("every 0".parse::<UpdateReference>().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "UpdateWord", into = "String")]
pub enum UpdateReference {
    /// Every frame is correlated with the reference given; the default.
    #[default]
    Never,
    /// When a frame does not converge, or matches the present reference much worse than the first frame after the
    /// last update did.
    Residual,
    /// After this many frames.
    Every(NonZeroUsize),
}

/// What a case file holds for it.
#[derive(Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected \"never\", \"residual\" or \"every N\"")]
enum UpdateWord {
    Frames(i64),
    Word(#[schemars(regex(pattern = r"^(never|residual|(every[ :]*)?[0-9]+)$"))] String),
}

impl TryFrom<UpdateWord> for UpdateReference {
    type Error = UnknownChoice;

    fn try_from(word: UpdateWord) -> Result<Self, UnknownChoice> {
        match word {
            UpdateWord::Frames(frames) => frames.to_string().parse(),
            UpdateWord::Word(word) => word.parse(),
        }
    }
}

impl From<UpdateReference> for String {
    fn from(update: UpdateReference) -> Self {
        update.to_string()
    }
}

impl fmt::Display for UpdateReference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            UpdateReference::Never => f.pad("never"),
            UpdateReference::Residual => f.pad("residual"),
            UpdateReference::Every(frames) => f.pad(&format!("every {frames}")),
        }
    }
}

impl FromStr for UpdateReference {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let frames = word.strip_prefix("every").unwrap_or(word).trim_start_matches([' ', ':']);
        match word {
            "never" => Ok(UpdateReference::Never),
            "residual" => Ok(UpdateReference::Residual),
            _ => frames.parse().map(UpdateReference::Every).map_err(|_| UnknownChoice {
                option: "update-reference",
                given: word.to_owned(),
                expected: "never, residual or a number of frames from 1 on (every N)",
            }),
        }
    }
}
