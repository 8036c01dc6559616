//! What can be drawn of a frame, and how.

use crate::camera::Rectifier;
use crate::field::{
    Invariant, PointValues, RemoveRigid, StrainDefinition, StrainWindow, TensorStrain, UnknownChoice, Value,
};
use crate::units::PixelSize;
use std::fmt;
use std::str::FromStr;

/// A number of a strain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OfStrain {
    /// exx, eyy, exy.
    Component(usize),
    /// What does not depend on the axes.
    Invariant(Invariant),
}

impl OfStrain {
    pub(super) fn of(self, strain: TensorStrain) -> f64 {
        match self {
            Self::Component(c) => strain.components()[c],
            Self::Invariant(which) => strain.invariant(which),
        }
    }

    /// Of a strain at a point, with its standard uncertainty.
    pub(super) fn at(self, there: &PointValues) -> Option<Value> {
        match self {
            Self::Component(c) => {
                there.strain.map(|(strain, sigma)| Value { value: strain.components()[c], sigma: sigma[c] })
            }
            Self::Invariant(which) => {
                let at = Invariant::ALL.iter().position(|&other| other == which)?;
                Some(there.invariants?[at])
            }
        }
    }
}

/// A figure that can be drawn of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Figure {
    /// Displacement along x, px.
    Ux,
    /// Displacement along y, px.
    Uy,
    /// Strain along x.
    Exx,
    /// Strain along y.
    Eyy,
    /// Shear strain, that of the tensor.
    Exy,
    /// Length of the displacement, px.
    Magnitude,
    /// Larger principal strain.
    Major,
    /// Smaller principal strain.
    Minor,
    /// Largest shear strain, that of the tensor.
    ShearMax,
    /// Equivalent strain by von Mises.
    VonMises,
    /// Rotation, degrees.
    Rotation,
    /// Strain along x over a window of nodes.
    ExxWindow,
    /// Strain along y over a window of nodes.
    EyyWindow,
    /// Shear strain over a window of nodes.
    ExyWindow,
    /// Larger principal strain over a window of nodes.
    MajorWindow,
    /// Smaller principal strain over a window of nodes.
    MinorWindow,
    /// Largest shear strain over a window of nodes.
    ShearMaxWindow,
    /// Equivalent strain over a window of nodes.
    VonMisesWindow,
    /// Root mean square of the residual of each element, grey levels.
    Residual,
    /// The same in per cent of the reference's range of grey levels.
    ResidualPercent,
    /// Standard uncertainty of the displacement, px: root mean square of both components.
    Sigma,
    /// What the displacement may be off beyond noise, px: root mean square of both components.
    ModelError,
    /// Displacement that the elements do not follow, px.
    Misfit,
    /// The mesh on the reference image.
    Mesh,
    /// The deformed mesh.
    Deformed,
    /// The zones without their rigid motion.
    Register,
}

impl Figure {
    /// All there are.
    pub const ALL: [Figure; 26] = [
        Figure::Ux,
        Figure::Uy,
        Figure::Exx,
        Figure::Eyy,
        Figure::Exy,
        Figure::Magnitude,
        Figure::Major,
        Figure::Minor,
        Figure::ShearMax,
        Figure::VonMises,
        Figure::Rotation,
        Figure::ExxWindow,
        Figure::EyyWindow,
        Figure::ExyWindow,
        Figure::MajorWindow,
        Figure::MinorWindow,
        Figure::ShearMaxWindow,
        Figure::VonMisesWindow,
        Figure::Residual,
        Figure::ResidualPercent,
        Figure::Sigma,
        Figure::ModelError,
        Figure::Misfit,
        Figure::Mesh,
        Figure::Deformed,
        Figure::Register,
    ];

    /// Its name, and what its values are called with their unit.
    fn words(self) -> (&'static str, Option<(&'static str, &'static str)>) {
        match self {
            Figure::Ux => ("ux", Some(("Displacement ux", "px"))),
            Figure::Uy => ("uy", Some(("Displacement uy, down", "px"))),
            Figure::Exx => ("exx", Some(("Strain exx", "-"))),
            Figure::Eyy => ("eyy", Some(("Strain eyy", "-"))),
            Figure::Exy => ("exy", Some(("Shear strain exy", "-"))),
            Figure::Magnitude => ("magnitude", Some(("Displacement, length", "px"))),
            Figure::Major => ("e1", Some(("Larger principal strain e1", "-"))),
            Figure::Minor => ("e2", Some(("Smaller principal strain e2", "-"))),
            Figure::ShearMax => ("shear-max", Some(("Largest shear strain (e1 - e2)/2", "-"))),
            Figure::VonMises => ("von-mises", Some(("Equivalent strain, von Mises, volume kept", "-"))),
            Figure::Rotation => ("rotation", Some(("Rotation, clockwise", "degrees"))),
            Figure::ExxWindow => ("exx-window", Some(("Strain exx over the window", "-"))),
            Figure::EyyWindow => ("eyy-window", Some(("Strain eyy over the window", "-"))),
            Figure::ExyWindow => ("exy-window", Some(("Shear strain exy over the window", "-"))),
            Figure::MajorWindow => ("e1-window", Some(("Larger principal strain e1 over the window", "-"))),
            Figure::MinorWindow => ("e2-window", Some(("Smaller principal strain e2 over the window", "-"))),
            Figure::ShearMaxWindow => ("shear-max-window", Some(("Largest shear strain over the window", "-"))),
            Figure::VonMisesWindow => {
                ("von-mises-window", Some(("Equivalent strain, von Mises, volume kept, over the window", "-")))
            }
            Figure::Residual => ("residual", Some(("Residual, rms per element", "grey levels"))),
            Figure::ResidualPercent => ("residual-percent", Some(("Residual, rms per element", "% of the grey range"))),
            Figure::Sigma => ("sigma", Some(("Standard uncertainty of the displacement", "px"))),
            Figure::ModelError => ("model-error", Some(("Model error of the displacement", "px"))),
            Figure::Misfit => ("misfit", Some(("Displacement not followed, rms per element", "px"))),
            Figure::Mesh => ("mesh", None),
            Figure::Deformed => ("deformed", None),
            Figure::Register => ("register", None),
        }
    }

    /// Name used in options and files.
    pub fn name(self) -> &'static str {
        self.words().0
    }

    /// What its values are called, and their unit; `None` when it has no values of its own.
    pub(super) fn quantity(self) -> Option<(&'static str, &'static str)> {
        self.words().1
    }

    /// Which number of the strain it shows.
    pub(super) fn strain(self) -> Option<OfStrain> {
        Some(match self {
            Figure::Exx | Figure::ExxWindow => OfStrain::Component(0),
            Figure::Eyy | Figure::EyyWindow => OfStrain::Component(1),
            Figure::Exy | Figure::ExyWindow => OfStrain::Component(2),
            Figure::Major | Figure::MajorWindow => OfStrain::Invariant(Invariant::Major),
            Figure::Minor | Figure::MinorWindow => OfStrain::Invariant(Invariant::Minor),
            Figure::ShearMax | Figure::ShearMaxWindow => OfStrain::Invariant(Invariant::ShearMax),
            Figure::VonMises | Figure::VonMisesWindow => OfStrain::Invariant(Invariant::VonMises),
            _ => return None,
        })
    }

    /// Whether its values have either sign, and zero a meaning.
    pub(super) fn is_signed(self) -> bool {
        let one_sided = [Invariant::ShearMax, Invariant::VonMises].map(OfStrain::Invariant);
        self == Figure::Rotation || self.strain().is_some_and(|of| !one_sided.contains(&of))
    }

    /// The strains over a window of nodes that are drawn unasked.
    pub const OF_WINDOW: [Figure; 3] = [Figure::ExxWindow, Figure::EyyWindow, Figure::ExyWindow];

    /// Whether it shows a strain.
    pub fn is_strain(self) -> bool {
        self.strain().is_some()
    }

    /// Whether it shows a strain over a window of nodes.
    pub fn is_of_window(self) -> bool {
        self.name().ends_with("-window")
    }
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Figure {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        Figure::ALL.into_iter().find(|figure| figure.name() == word).ok_or_else(|| UnknownChoice {
            option: "quantity",
            given: word.to_owned(),
            expected: "ux, uy, magnitude, exx, eyy, exy, e1, e2, shear-max, von-mises, exx-window, eyy-window, exy-window, e1-window, \
                e2-window, shear-max-window, von-mises-window, rotation, residual, residual-percent, sigma, model-error, misfit, \
                mesh, deformed or register",
        })
    }
}

/// A kind of picture file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// Pixels.
    Png,
    /// Lines and letters as such, with the image inside.
    Svg,
}

impl Format {
    /// Ending of the file's name, also the name used in options.
    pub fn name(self) -> &'static str {
        match self {
            Format::Png => "png",
            Format::Svg => "svg",
        }
    }
}

impl FromStr for Format {
    type Err = UnknownChoice;

    fn from_str(word: &str) -> Result<Self, UnknownChoice> {
        [Format::Png, Format::Svg].into_iter().find(|format| format.name() == word).ok_or_else(|| UnknownChoice {
            option: "format",
            given: word.to_owned(),
            expected: "png or svg",
        })
    }
}

/// Which figures are drawn, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct FigureOptions {
    /// The figures.
    pub figures: Vec<Figure>,
    /// The kinds of file; each figure is written in all of them.
    pub formats: Vec<Format>,
    /// A line (x0, y0, x1, y1, px): shown in the maps, and each quantity drawn along it.
    pub line: Option<[f64; 4]>,
    /// Factor on displacements in `deformed` and `register`; `None` for one that makes them visible.
    pub magnify: Option<f64>,
    /// Ends of the colour bars; `None` for the values of each figure.
    pub range: Option<(f64, f64)>,
    /// How strains are made.
    pub strain: StrainDefinition,
    /// Window of nodes of the strains over a window.
    pub strain_window: Option<StrainWindow>,
    /// Whether strains are interpolated between nodes (over twice the element size), not one value per element.
    pub strain_on_nodes: bool,
    /// The rigid motion that `register` takes off.
    pub rigid: RemoveRigid,
    /// The scale, for axes in mm beside those in px.
    pub pixel_size: Option<PixelSize>,
    /// Maps fields into the plane, whose strains are drawn; those of the image without it.
    pub camera: Option<Rectifier>,
    /// Largest less smallest grey level of the reference: 100 % of the residual.
    pub range_grey: Option<f64>,
    /// Whether the noise of neighbouring nodes is correlated as that of an unregularised correlation; otherwise
    /// the bands of profiles are upper bounds.
    pub known_noise: bool,
    /// Width of the guard band of each zone, px, for `mesh`.
    pub guard_px: Vec<f64>,
    /// Lines of text below every figure: files, program.
    pub notes: Vec<String>,
}

impl Default for FigureOptions {
    /// Displacements, strains and residual as PNG.
    fn default() -> Self {
        use Figure::{Exx, Exy, Eyy, Residual, Ux, Uy};
        Self {
            figures: vec![Ux, Uy, Exx, Eyy, Exy, Residual],
            formats: vec![Format::Png],
            line: None,
            magnify: None,
            range: None,
            strain: StrainDefinition::default(),
            strain_window: None,
            strain_on_nodes: false,
            rigid: RemoveRigid::Zone,
            pixel_size: None,
            camera: None,
            range_grey: None,
            known_noise: true,
            guard_px: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// Values at nodes or on elements; what is unknown is NaN.
pub(super) enum Values {
    Nodes(Vec<f64>),
    Elements(Vec<f64>),
}
