//! What figures are made for: a screen, the column of a journal, a slide.

use crate::field::UnknownChoice;
use std::fmt;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// What figures are made for. Letters and lines have one size on the sheet; what changes is the sheet: a figure for a
/// column is drawn on a small one and shown larger.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Look {
    /// With title and notes, at 100 % of a screen.
    #[default]
    Screen,
    /// For print: about 84 mm wide (one column), letters of 8 pt, no title, no notes; warnings stand in a text beside it.
    Paper,
    /// For a slide: letters that are read from the last row, a title, no notes (warnings stay).
    Slide,
}

/// A column of a journal, mm.
const COLUMN_MM: f64 = 84.0;
/// What an axis counts is written in this size, pt, where print is meant; and in this many units of the sheet (see
/// `axes::Letters`).
const PRINTED_PT: f64 = 8.0;
const PRINTED_UNITS: f64 = 15.0;
/// Width of a sheet for a slide, units: letters of 15 are read where a figure fills its height.
const SLIDE: i32 = 620;
const MM_PER_PT: f64 = 25.4 / 72.0;

/// That of this process.
static CHOSEN: AtomicUsize = AtomicUsize::new(0);
/// Whether warnings are drawn, where the look has them.
static WARNS: AtomicBool = AtomicBool::new(true);

impl Look {
    /// All there are.
    pub const ALL: [Look; 3] = [Look::Screen, Look::Paper, Look::Slide];

    /// Name used in options.
    pub fn name(self) -> &'static str {
        match self {
            Look::Screen => "screen",
            Look::Paper => "paper",
            Look::Slide => "slide",
        }
    }

    /// Draws all figures of this process so from now on: one setting, as a run draws many figures in many places. Pages
    /// stay as they are: they are for a screen.
    pub fn choose(self) {
        let place = Self::ALL.iter().position(|&look| look == self).unwrap_or(0);
        CHOSEN.store(place, Ordering::Relaxed);
    }

    /// Puts the warnings of all figures of this process into a text beside each, whatever it is for.
    pub fn choose_without_warnings() {
        WARNS.store(false, Ordering::Relaxed);
    }

    /// The one chosen.
    pub fn chosen() -> Self {
        Self::ALL.get(CHOSEN.load(Ordering::Relaxed)).copied().unwrap_or_default()
    }

    /// A side of a map or plot that has `screen` units on a screen.
    pub(super) fn side(self, screen: f64) -> f64 {
        match self {
            Look::Screen => screen,
            Look::Paper => 0.45 * screen,
            Look::Slide => 0.65 * screen,
        }
    }

    /// Width of the whole sheet, units, which a figure is to keep within.
    pub(super) fn sheet(self) -> Option<i32> {
        match self {
            Look::Screen => None,
            Look::Paper => self.unit_mm().map(|unit| (COLUMN_MM / unit).round() as i32),
            Look::Slide => Some(SLIDE),
        }
    }

    /// A side of a map, `side` on a sheet of `width` where it fills `map` of it, so that the sheet is no wider than
    /// wanted; `None` where it is not, or nothing would be left.
    pub(super) fn narrowed(self, side: f64, width: i32, map: i32) -> Option<f64> {
        let excess = width - self.sheet()?;
        (excess > 0 && excess < map).then(|| side * f64::from(map - excess) / f64::from(map))
    }

    /// Millimetres per unit of the sheet in print; `None` where a unit is a pixel.
    pub(super) fn unit_mm(self) -> Option<f64> {
        (self == Look::Paper).then_some(PRINTED_PT * MM_PER_PT / PRINTED_UNITS)
    }

    /// Pixels of a PNG per unit of the sheet, at least: 540 per inch in print.
    pub(super) fn ratio(self) -> u32 {
        match self {
            Look::Screen => 1,
            Look::Paper => 4,
            Look::Slide => 3,
        }
    }

    /// Whether the title is drawn.
    pub(super) fn has_title(self) -> bool {
        self != Look::Paper
    }

    /// Whether warnings are drawn: nobody prints them.
    pub(super) fn has_warnings(self) -> bool {
        self != Look::Paper && WARNS.load(Ordering::Relaxed)
    }

    /// Whether the notes are drawn.
    pub(super) fn has_notes(self) -> bool {
        self == Look::Screen
    }
}

impl fmt::Display for Look {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Look {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        Look::ALL.into_iter().find(|look| look.name() == word).ok_or_else(|| UnknownChoice {
            option: "style",
            given: word.to_owned(),
            expected: "screen, paper or slide",
        })
    }
}
