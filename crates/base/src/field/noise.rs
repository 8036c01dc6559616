//! What is taken for the noise of an image.

use super::UnknownChoice;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A residual that says less than the first of these times the stated noise, or more than the second, contradicts it.
/// Misfit only adds to the residual, so that less is the plainer of the two; a quarter more is more than interpolation
/// and 8 bit rounding make of any noise that matters.
pub const NOISE_CONTRADICTED: [f64; 2] = [0.8, 1.25];

/// The noise of one image, from which standard uncertainties are made.
///
/// A standard deviation in grey levels; `photon`, a variance `a + b grey` whose two numbers are found on reference and
/// residual; `photon:A,B` (in a case file `{ a = A, b = B }`) with these numbers, as `metrology` finds them; or
/// `residual`, one standard deviation per zone and frame.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::Noise;
/// assert_eq!("2.5".parse(), Ok(Noise::Constant(2.5)));
/// assert_eq!("photon:1,0.05".parse(), Ok(Noise::Photon { a: 1.0, b: 0.05 }));
/// assert_eq!(Noise::from(None), Noise::Residual);
/// assert!("photon:1".parse::<Noise>().is_err());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(from = "NoiseWords", into = "NoiseWords")]
pub enum Noise {
    /// One standard deviation per zone, found on the residual of each frame; the default.
    #[default]
    Residual,
    /// This standard deviation, grey levels.
    Constant(f64),
    /// Variance `a + b grey`, grey levels squared; `grey` in the scale of the images.
    Photon {
        /// Variance of black.
        a: f64,
        /// Its rise per grey level.
        b: f64,
    },
    /// The same with `a` and `b` found on reference and residual of each frame.
    PhotonOfResidual,
}

/// What a file holds for it.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number of grey levels, \"photon\", \"residual\" or { a = .., b = .. }")]
enum NoiseWords {
    Number(f64),
    Word(NoiseWord),
    Variance(Variance),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum NoiseWord {
    Residual,
    Photon,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Variance {
    a: f64,
    b: f64,
}

impl From<NoiseWords> for Noise {
    fn from(words: NoiseWords) -> Self {
        match words {
            NoiseWords::Number(sigma) => Self::Constant(sigma),
            NoiseWords::Word(NoiseWord::Residual) => Self::Residual,
            NoiseWords::Word(NoiseWord::Photon) => Self::PhotonOfResidual,
            NoiseWords::Variance(Variance { a, b }) => Self::Photon { a, b },
        }
    }
}

impl From<Noise> for NoiseWords {
    fn from(noise: Noise) -> Self {
        match noise {
            Noise::Residual => Self::Word(NoiseWord::Residual),
            Noise::Constant(sigma) => Self::Number(sigma),
            Noise::Photon { a, b } => Self::Variance(Variance { a, b }),
            Noise::PhotonOfResidual => Self::Word(NoiseWord::Photon),
        }
    }
}

impl From<f64> for Noise {
    fn from(sigma: f64) -> Self {
        Self::Constant(sigma)
    }
}

impl From<Option<f64>> for Noise {
    fn from(sigma: Option<f64>) -> Self {
        sigma.map_or(Self::Residual, Self::Constant)
    }
}

impl Noise {
    /// The one standard deviation that was given, grey levels.
    pub fn constant(self) -> Option<f64> {
        match self {
            Self::Constant(sigma) => Some(sigma),
            _ => None,
        }
    }

    /// What is wanted instead of its numbers, where they are none for images whose brightest grey level is `highest`.
    pub fn fault(self, highest: f64) -> Option<&'static str> {
        let positive = |v: f64| v.is_finite() && v > 0.0;
        match self {
            Self::Constant(sigma) if !positive(sigma) => Some("a positive standard deviation in grey levels"),
            Self::Constant(sigma) if sigma > highest => {
                Some("a standard deviation in grey levels of the image, less than the brightest of the reference")
            }
            Self::Photon { a, b } if !(a.is_finite() && b.is_finite() && b >= 0.0) => {
                Some("a variance a + b grey with two numbers, b not negative")
            }
            Self::Photon { a, b } if a + b * highest <= 0.0 => {
                Some("a variance a + b grey that is positive at the grey levels of the reference")
            }
            _ => None,
        }
    }
}

impl fmt::Display for Noise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Residual => f.pad("residual"),
            Self::Constant(sigma) => write!(f, "{sigma}"),
            Self::Photon { a, b } => write!(f, "photon:{a},{b}"),
            Self::PhotonOfResidual => f.pad("photon"),
        }
    }
}

impl FromStr for Noise {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        let number = |text: &str| text.trim().parse::<f64>().ok();
        let photon = |pair: &str| {
            let (a, b) = pair.split_once(',')?;
            Some(Self::Photon { a: number(a)?, b: number(b)? })
        };
        match word {
            "residual" => Some(Self::Residual),
            "photon" => Some(Self::PhotonOfResidual),
            _ => match word.strip_prefix("photon:") {
                Some(pair) => photon(pair),
                None => number(word).map(Self::Constant),
            },
        }
        .ok_or_else(|| UnknownChoice {
            option: "noise",
            given: word.to_owned(),
            expected: "a number of grey levels, photon, photon:A,B (variance A + B grey) or residual",
        })
    }
}

/// What becomes of noise whose neighbouring pixels are correlated (demosaicing, compression, smoothing in the camera,
/// noise of whole rows): standard uncertainties made for white noise are multiplied by a factor.
///
/// ```
/// # use quadrille_base as quadrille;
/// use quadrille::field::NoiseCorrelation;
/// assert_eq!("1.8".parse(), Ok(NoiseCorrelation::Factor(1.8)));
/// assert_eq!(NoiseCorrelation::default(), "auto".parse().unwrap());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(from = "FactorWords", into = "FactorWords")]
pub enum NoiseCorrelation {
    /// The factor is found on the residual of each frame and taken where it exceeds 1.1; the default.
    #[default]
    Auto,
    /// Noise is taken to be white and nothing is looked for.
    Off,
    /// This factor, as `metrology` finds it.
    Factor(f64),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected \"auto\", \"off\" or a factor")]
enum FactorWords {
    Number(f64),
    Word(FactorWord),
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum FactorWord {
    Auto,
    Off,
}

impl From<FactorWords> for NoiseCorrelation {
    fn from(words: FactorWords) -> Self {
        match words {
            FactorWords::Number(factor) => Self::Factor(factor),
            FactorWords::Word(FactorWord::Auto) => Self::Auto,
            FactorWords::Word(FactorWord::Off) => Self::Off,
        }
    }
}

impl From<NoiseCorrelation> for FactorWords {
    fn from(choice: NoiseCorrelation) -> Self {
        match choice {
            NoiseCorrelation::Auto => Self::Word(FactorWord::Auto),
            NoiseCorrelation::Off => Self::Word(FactorWord::Off),
            NoiseCorrelation::Factor(factor) => Self::Number(factor),
        }
    }
}

impl FromStr for NoiseCorrelation {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        match (word, word.parse()) {
            ("auto", _) => Ok(Self::Auto),
            ("off", _) => Ok(Self::Off),
            (_, Ok(factor)) => Ok(Self::Factor(factor)),
            _ => Err(UnknownChoice {
                option: "noise-correlation",
                given: word.to_owned(),
                expected: "auto, off or a factor on the standard uncertainty",
            }),
        }
    }
}

impl NoiseCorrelation {
    /// Whether its number is no factor: one from 0.1 to 100.
    pub fn is_fault(self) -> bool {
        matches!(self, Self::Factor(factor) if !(0.1..=100.0).contains(&factor))
    }
}
