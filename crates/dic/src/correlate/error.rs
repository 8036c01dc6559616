//! What keeps a correlation from being tried.

use crate::backend::BackendError;
use crate::mesh::MeshError;
use thiserror::Error;

pub(crate) type Result<T, E = CorrelationError> = std::result::Result<T, E>;

/// Why a reference cannot be prepared, or a frame not be tried.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CorrelationError {
    /// The zones or the element size do not fit the image.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A number among the options makes no sense.
    #[error("{name} is {value}; give {wanted}")]
    Option {
        /// The option.
        name: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        wanted: &'static str,
    },
    /// Cubic splines on a mesh that is not regular.
    #[error(
        "zone {zone:?} has no regular mesh, which cubic-spline elements need: a mesh of a file, or one that a crack cuts, has bilinear elements; leave --elements out"
    )]
    Splines {
        /// The zone.
        zone: String,
    },
    /// Nodes of the reference see no texture, more than may be left out.
    #[error("{}", no_texture(faults, *n_nodes, *stated))]
    NoTexture {
        /// The noise, grey levels, where it is stated and more than the image shows.
        stated: Option<f64>,
        /// The nodes.
        faults: Vec<TextureFault>,
        /// Nodes of the mesh.
        n_nodes: usize,
    },
    /// Nodes on a border that has to be whole see no texture.
    #[error("on the edge of zone '{zone}', which is to be whole (the face of a joint or of an opening), {} too little texture in the reference image: {}; move that edge of the zone to where there is texture, enlarge the elements, or let such nodes be left out there too with --drop-textureless (drop_textureless = true)", nodes_see(faults.len()), first_few(faults))]
    FaceWithoutTexture {
        /// Name of the zone.
        zone: String,
        /// The nodes on its edge.
        faults: Vec<TextureFault>,
    },
    /// Nothing is left to measure.
    #[error("{}", textureless(*stated, *larger))]
    Textureless {
        /// The noise, grey levels, where it is stated and more than the image shows.
        stated: Option<f64>,
        /// Size of elements that would see enough, px, where it is not texture that lacks but pixels.
        larger: Option<usize>,
    },
    /// A deformed image of another size.
    #[error("the image is {width} x {height} px, the reference {reference_width} x {reference_height} px")]
    Size {
        /// Columns of the deformed image.
        width: usize,
        /// Rows of the deformed image.
        height: usize,
        /// Columns of the reference.
        reference_width: usize,
        /// Rows of the reference.
        reference_height: usize,
    },
    /// A deformed image without any contrast.
    #[error("every pixel has the grey level {grey}: there is no picture to correlate")]
    Constant {
        /// The grey level.
        grey: f32,
    },
    /// Grey levels of the reference too large, or too small, for sums of products in single precision.
    #[error(
        "the grey levels of the reference range over {0:.2e}, and numbers of single precision do not hold sums of their products: multiply all images by the same number, so that they range over some hundreds"
    )]
    GreyLevels(f64),
    /// A start that belongs to another mesh: of other nodes and zones, or without an element that there is not.
    #[error("the start {0}")]
    Start(String),
    /// A kept state of a chain of references that belongs to another mesh.
    #[error("the kept state has {given} {what}, the mesh {wanted}: it belongs to other zones or elements")]
    State {
        /// What there are too few or too many of.
        what: &'static str,
        /// In the state.
        given: usize,
        /// In the mesh.
        wanted: usize,
    },
    /// The reference frame of a kept state is none with the image given.
    #[error("the kept state does not go with the image given for its reference")]
    Kept(#[source] Box<UpdateRefused>),
    /// The device failed.
    #[error("the device failed")]
    Backend(#[from] BackendError),
}

impl CorrelationError {
    /// Whether the fault is one of the deformed image alone, so that the series can go on.
    pub fn is_of_the_frame(&self) -> bool {
        matches!(self, Self::Size { .. } | Self::Constant { .. })
    }
}

/// A node that cannot be measured, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureFault {
    /// Number of the node in the mesh.
    pub node: usize,
    /// Its place, px.
    pub at: [f64; 2],
    /// What is missing there.
    pub lack: Lack,
}

/// What a node lacks to be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Lack {
    /// Texture, in all directions or along stripes.
    Texture {
        /// Root mean square of the gradient in the weakest direction, grey levels per px.
        weakest: f64,
        /// What is needed: the noise's share times a margin.
        needed: f64,
        /// Whether there is texture across stripes, but none along them.
        striped: bool,
    },
    /// Enough texture with its neighbours: the displacement would be this uncertain (infinite: not determined).
    Precision {
        /// Standard uncertainty, px.
        sigma_px: f64,
    },
}

impl Lack {
    /// In a few words.
    pub fn name(self) -> &'static str {
        match self {
            Lack::Texture { striped: false, .. } => "no texture",
            Lack::Texture { striped: true, .. } => "stripes: no texture along them",
            Lack::Precision { .. } => "too little texture",
        }
    }
}

impl std::fmt::Display for TextureFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "node {} at ({}, {}) px: {} ", self.node, self.at[0], self.at[1], self.lack.name())?;
        match self.lack {
            Lack::Texture { weakest, needed, .. } => {
                write!(f, "(gradient {weakest:.3} of {needed:.3} grey levels/px needed)")
            }
            Lack::Precision { sigma_px } if sigma_px.is_finite() => {
                write!(f, "(the displacement there would be uncertain by {sigma_px:.2} px)")
            }
            Lack::Precision { .. } => write!(f, "(the displacement there is not determined)"),
        }
    }
}

/// Why a frame did not become the reference. The frames go on with the old one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UpdateRefused {
    /// Too much of a zone cannot be seen in it.
    #[error(
        "frame {frame} is no new reference: it shows {left} of {of} elements of zone '{zone}'; the rest has moved out of the image or was not measured"
    )]
    LeftImage {
        /// The frame.
        frame: usize,
        /// Zone's name.
        zone: String,
        /// Elements that it shows whole.
        left: usize,
        /// Elements of the zone in the reference given.
        of: usize,
    },
    /// It cannot be prepared: an element is folded there, or its nodes see no texture.
    #[error("frame {frame} is no new reference")]
    Unfit {
        /// The frame.
        frame: usize,
        /// What is wrong with it.
        #[source]
        source: CorrelationError,
    },
}

impl UpdateRefused {
    /// The frame that was refused.
    pub fn frame(&self) -> usize {
        match self {
            Self::LeftImage { frame, .. } | Self::Unfit { frame, .. } => *frame,
        }
    }
}

fn nodes_see(n: usize) -> String {
    if n == 1 { "1 node sees".into() } else { format!("{n} nodes see") }
}

fn no_texture(faults: &[TextureFault], n_nodes: usize, stated: Option<f64>) -> String {
    let (n, few, what) = (faults.len(), first_few(faults), advice(faults.len() < n_nodes));
    format!("{n} of {n_nodes} nodes see too little texture in the reference image: {few}; {what}{}", by_stated(stated))
}

fn textureless(stated: Option<f64>, larger: Option<usize>) -> String {
    let what = larger.map_or("check the zone, the exposure and the focus".into(), |size| {
        format!(
            "elements of {size} px would do (--element-size {size}); where speckles are many pixels wide, so would means \
             of pixels"
        )
    });
    format!("no node of the reference image sees enough texture: {what}{}", by_stated(stated))
}

fn by_stated(noise: Option<f64>) -> String {
    noise.map_or(String::new(), |noise| {
        format!("; the noise is stated as {noise:.2} grey levels, more than the image shows: is that so (--noise)?")
    })
}

fn advice(some_are_left: bool) -> &'static str {
    if some_are_left {
        "more than may be left out: move the zone off them, name no zone (the specimen is then found), enlarge the elements, leave them out with --drop-textureless, or hold them with --regularisation"
    } else {
        "check the zone, the exposure and the focus"
    }
}

fn first_few(faults: &[TextureFault]) -> String {
    /// Faults that a message names; the others it counts.
    const SHOWN: usize = 3;
    let mut text: Vec<String> = faults.iter().take(SHOWN).map(ToString::to_string).collect();
    if faults.len() > SHOWN {
        text.push(format!("and {} more", faults.len() - SHOWN));
    }
    text.join("; ")
}
