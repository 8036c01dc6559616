//! Choices of a correlation that files and command line name alike.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// A word that names none of the choices.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("'{given}' is not one of {known}")]
pub struct UnknownChoice {
    /// The word.
    pub given: String,
    /// The choices there are.
    pub known: &'static str,
}

/// How brightness and contrast of the deformed image are followed: `f = (1 + c) g + d` (THEORY 2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Brightness {
    /// One c and d per zone; the default.
    #[default]
    Zone,
    /// Own c and d in each element, for light that changes within a zone.
    Element,
    /// `c = d = 0`: grey levels are compared as they are.
    Off,
}

impl Brightness {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            Brightness::Zone => "zone",
            Brightness::Element => "element",
            Brightness::Off => "off",
        }
    }
}

impl fmt::Display for Brightness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Brightness {
    type Err = UnknownChoice;

    fn from_str(name: &str) -> Result<Self, UnknownChoice> {
        [Self::Zone, Self::Element, Self::Off]
            .into_iter()
            .find(|choice| choice.name() == name)
            .ok_or_else(|| UnknownChoice { given: name.to_owned(), known: "zone, element, off" })
    }
}

/// Where the iteration of a frame starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StartFrom {
    /// From the extrapolation of the frames before it; the default.
    #[default]
    Previous,
    /// From a search in the frame alone, as if it were the only one.
    Cold,
}

impl StartFrom {
    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        match self {
            StartFrom::Previous => "previous",
            StartFrom::Cold => "cold",
        }
    }
}

impl fmt::Display for StartFrom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for StartFrom {
    type Err = UnknownChoice;

    fn from_str(name: &str) -> Result<Self, UnknownChoice> {
        [Self::Previous, Self::Cold]
            .into_iter()
            .find(|choice| choice.name() == name)
            .ok_or_else(|| UnknownChoice { given: name.to_owned(), known: "previous, cold" })
    }
}
