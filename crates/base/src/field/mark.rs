//! Why an element of a frame says nothing, or less than its numbers do.

use serde::{Deserialize, Serialize};
use std::fmt;

/// What is the matter with an element in one frame.
///
/// Of elements that are [left out](Self::is_left_out) nothing is in the field: a node that has no other elements was
/// not measured. The displacement of the nodes of the others is doubtful.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementMark {
    /// Nothing.
    #[default]
    None,
    /// It cannot follow the displacement, or the image has changed all over its zone.
    Misfit,
    /// What it shows stays where it is while the specimen moves: dust, a reflection, something off the specimen.
    Still,
    /// It sees no texture in the reference.
    NoTexture,
    /// Its pixels have left the deformed image.
    LeftImage,
    /// Its pixels are white in the deformed image and were not in the reference.
    Saturated,
    /// Its pixels are covered, torn or not those of the reference.
    NoMatch,
}

impl ElementMark {
    /// All but [`ElementMark::None`], in the order of their codes.
    pub const ALL: [Self; 6] =
        [Self::Misfit, Self::Still, Self::NoTexture, Self::LeftImage, Self::Saturated, Self::NoMatch];

    /// Number in files without words: 0 none, 1 misfit, 2 still, 3 no texture, 4 left image, 5 saturated, 6 no match.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The mark with this [`code`](Self::code).
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::field::ElementMark;
    /// assert_eq!(ElementMark::from_code(ElementMark::Saturated.code()), Some(ElementMark::Saturated));
    /// assert_eq!(ElementMark::from_code(255), None);
    /// ```
    pub fn from_code(code: u8) -> Option<Self> {
        [Self::None].into_iter().chain(Self::ALL).find(|mark| mark.code() == code)
    }

    /// Name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Misfit => "misfit",
            Self::Still => "still",
            Self::NoTexture => "no_texture",
            Self::LeftImage => "left_image",
            Self::Saturated => "saturated",
            Self::NoMatch => "no_match",
        }
    }

    /// The mark with this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None].into_iter().chain(Self::ALL).find(|mark| mark.name() == name)
    }

    /// Whether the element is in no sum: nothing was measured on it.
    pub fn is_left_out(self) -> bool {
        matches!(self, Self::NoTexture | Self::LeftImage | Self::Saturated | Self::NoMatch)
    }

    /// What it says to a reader.
    pub fn words(self) -> &'static str {
        match self {
            Self::None => "nothing",
            Self::Misfit => "displacement not followed",
            Self::Still => "stays still while the specimen moves",
            Self::NoTexture => "no texture",
            Self::LeftImage => "left the image",
            Self::Saturated => "white in the deformed image",
            Self::NoMatch => "covered, torn or does not match",
        }
    }
}

impl fmt::Display for ElementMark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The elements of a frame with one mark.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Marked {
    /// The mark.
    pub mark: ElementMark,
    /// How many elements.
    pub elements: usize,
    /// Of all elements of the mesh, per cent.
    pub percent: f64,
}

impl fmt::Display for Marked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { mark, elements, percent } = self;
        let plural = if *elements == 1 { "" } else { "s" };
        write!(f, "{elements} element{plural} ({percent:.1} %) {mark}: {}", mark.words())
    }
}
