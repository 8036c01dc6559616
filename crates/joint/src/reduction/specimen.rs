//! What is reduced: the test, its specimen, and what loads and images say at each instant.

use crate::field::Value;
pub use crate::io::case::CaseLayout as Layout;
use serde::{Deserialize, Serialize};

/// A section at which a load acts: the share of the load cell's force, and whether it points along the normal of the
/// joint (from the lower to the upper arm) or against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadedSection {
    /// What it is, for people.
    pub what: &'static str,
    /// Share of the force.
    pub share: f64,
    /// 1 along the normal, -1 against it.
    pub along: f64,
}

/// The sections where loads act, in the order in which a case names them; of bending tests from the cracked end on,
/// the load of the machine downwards. `span` is half the distance of the supports, `lever` that of the load on the
/// lever from the middle, mm.
pub fn sections(layout: Layout, half_span: f64, lever: f64) -> Vec<LoadedSection> {
    let section = |what, share, along| LoadedSection { what, share, along };
    match layout {
        Layout::Dcb => vec![section("the upper arm", 1.0, 1.0), section("the lower arm", 1.0, -1.0)],
        Layout::Enf | Layout::Slb => vec![
            section("the support of the cracked end", 0.5, 1.0),
            section("the load in the middle", 1.0, -1.0),
            section("the other support", 0.5, 1.0),
        ],
        Layout::Mmb => vec![
            section("the upper arm, which the lever lifts", lever / half_span, 1.0),
            section("the support of the cracked end", 0.5 * (half_span - lever) / half_span, 1.0),
            section("the load in the middle", (half_span + lever) / half_span, -1.0),
            section("the other support", 0.5 * (half_span + lever) / half_span, 1.0),
        ],
        Layout::Peel => vec![section("the arm that is pulled", 1.0, 1.0)],
        Layout::Lap => Vec::new(),
    }
}

/// The jump at the tip that J is drawn over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// Opening: the derivative is `T_n`.
    #[serde(rename = "opening")]
    Opening,
    /// Sliding: `T_t`.
    #[serde(rename = "sliding")]
    Sliding,
    /// Both together, `sqrt(D_n^2 + D_t^2)`: where their ratio stays, the length of their path, and the traction along it.
    #[serde(rename = "opening and sliding together")]
    Path,
}

impl Mode {
    /// That of a test.
    pub fn of(layout: Layout) -> Self {
        match layout {
            Layout::Dcb => Self::Opening,
            Layout::Enf | Layout::Lap => Self::Sliding,
            Layout::Mmb | Layout::Slb | Layout::Peel => Self::Path,
        }
    }

    /// Those that a test draws: over both together, and over each alone as far as a method tells their shares.
    pub(super) fn all_of(layout: Layout) -> &'static [Self] {
        match Self::of(layout) {
            Self::Opening => &[Self::Opening],
            Self::Sliding => &[Self::Sliding],
            Self::Path => &[Self::Path, Self::Opening, Self::Sliding],
        }
    }

    /// Name of the jump and of the traction.
    pub fn names(self) -> [&'static str; 2] {
        match self {
            Self::Opening => ["opening", "T_n"],
            Self::Sliding => ["sliding", "T_t"],
            Self::Path => ["opening and sliding together", "traction along both"],
        }
    }
}

/// What the specimen is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Specimen {
    /// Which test.
    pub layout: Layout,
    /// Width, mm.
    pub width_mm: Value,
    /// Thickness of one arm, mm.
    pub arm_mm: Option<Value>,
    /// From the line of the load (of bending: the support of the cracked end) to the initial tip, mm.
    pub crack_mm: Option<Value>,
    /// Standard uncertainty of the length of the crack over the width, where its side is seen, mm.
    pub crack_front_std_mm: f64,
    /// End blocks of a double cantilever beam: from the pin to the middle of the arm, and half of the length, mm; zeros
    /// without.
    pub end_block_mm: [f64; 2],
    /// Half the distance of the supports, mm.
    pub half_span_mm: Option<f64>,
    /// From the middle to the load on the lever, mm.
    pub lever_mm: Option<f64>,
    /// Young's modulus along the arms, MPa.
    pub young_mpa: Option<Value>,
    /// Shear modulus of the arms, MPa; without it beams do not shear.
    pub shear_mpa: Option<f64>,
    /// Relative standard uncertainty of the load cell, beside the noise of its values.
    pub load_scale_std: f64,
    /// That of the size of a pixel.
    pub length_scale_std: f64,
}

/// One instant of a test, from loads and images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    /// Its number, from 1.
    pub frame: usize,
    /// Force of the load cell, N.
    pub load_n: Value,
    /// Displacement that does work with it, mm.
    pub displacement_mm: Option<Value>,
    /// Whether that was seen by the camera, and is as uncertain as its scale.
    pub displacement_of_images: bool,
    /// `sum share sin(theta)` over the sections where loads act, theta positive in the sense of the load.
    pub rotation: Option<Value>,
    /// The part of its standard uncertainty that the noise of the reference image makes, which all instants share.
    pub rotation_common: f64,
    /// The same sum over the sections that lie ahead of the tip alone.
    pub rotation_ahead: Option<Value>,
    /// Integral of J over the sections of both arms behind the tip, N/mm, by the moduli of the specimen.
    pub section: Option<Value>,
    /// Opening at the initial tip, mm.
    pub opening_mm: Option<Value>,
    /// Sliding there, mm.
    pub sliding_mm: Option<Value>,
    /// Jump at the other end of the joint, mm, where it is more than noise: of bending tests that end slides, too, and J
    /// of the loads is the work at the tip less the work there.
    pub other_end_mm: Option<f64>,
    /// Length of the crack, mm.
    pub crack_mm: Option<Value>,
}

impl Instant {
    /// An instant of which the load alone is known.
    pub fn of_load(frame: usize, load_n: Value) -> Self {
        Self {
            frame,
            load_n,
            displacement_mm: None,
            displacement_of_images: false,
            rotation: None,
            rotation_common: 0.0,
            rotation_ahead: None,
            section: None,
            opening_mm: None,
            sliding_mm: None,
            other_end_mm: None,
            crack_mm: None,
        }
    }

    /// The jump that J is drawn over.
    pub fn jump(&self, mode: Mode) -> Option<Value> {
        let magnitude = |value: Value| Value { value: value.value.abs(), ..value };
        match mode {
            Mode::Opening => self.opening_mm,
            Mode::Sliding => self.sliding_mm.map(magnitude),
            Mode::Path => {
                let (n, t) = (self.opening_mm?, self.sliding_mm?);
                let value = n.value.hypot(t.value);
                let sigma = if value > 0.0 {
                    (n.value * n.sigma).hypot(t.value * t.sigma) / value
                } else {
                    n.sigma.max(t.sigma)
                };
                Some(Value { value, sigma })
            }
        }
    }
}

impl Instant {
    /// With other loads and lengths of images, by these factors; of the crack what is beyond `initial_mm` is such a
    /// length.
    pub(super) fn scaled(self, load: f64, lengths: f64, initial_mm: f64) -> Self {
        let times = |factor: f64| move |of: Value| Value { value: factor * of.value, sigma: factor * of.sigma };
        let of_machine = if self.displacement_of_images { lengths } else { 1.0 };
        let beyond = |crack: Value| Value {
            value: initial_mm + lengths * (crack.value - initial_mm),
            sigma: lengths * crack.sigma,
        };
        Self {
            load_n: times(load)(self.load_n),
            displacement_mm: self.displacement_mm.map(times(of_machine)),
            section: self.section.map(times(lengths)),
            opening_mm: self.opening_mm.map(times(lengths)),
            sliding_mm: self.sliding_mm.map(times(lengths)),
            other_end_mm: self.other_end_mm.map(|at| lengths * at),
            crack_mm: self.crack_mm.map(beyond),
            ..self
        }
    }
}
