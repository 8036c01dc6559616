//! What keeps a correlation from being tried.

use super::texture::TextureFault;
use crate::backend::BackendError;
use crate::mesh::MeshError;
use thiserror::Error;

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
    /// Nodes of the reference see no texture, more than may be left out.
    #[error("{} of {n_nodes} nodes see too little texture in the reference image: {}; {}", faults.len(), first_few(faults), advice(faults.len() < *n_nodes))]
    NoTexture {
        /// The nodes.
        faults: Vec<TextureFault>,
        /// Nodes of the mesh.
        n_nodes: usize,
    },
    /// Nothing is left to measure.
    #[error("no node of the reference image sees texture: check the zone, the exposure and the focus")]
    Textureless,
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
    /// A start that belongs to another mesh.
    #[error("the start has {nodes} nodes and {zones} zones, the mesh {mesh_nodes} and {mesh_zones}")]
    Start {
        /// Nodes of the start.
        nodes: usize,
        /// Zones of the start.
        zones: usize,
        /// Nodes of the mesh.
        mesh_nodes: usize,
        /// Zones of the mesh.
        mesh_zones: usize,
    },
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
    Kept(#[source] Box<super::UpdateRefused>),
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

fn advice(some_are_left: bool) -> &'static str {
    if some_are_left {
        "move the zone off them, enlarge the elements, leave them out with --drop-textureless, or hold them with --regularisation"
    } else {
        "check the zone, the exposure and the focus"
    }
}

fn first_few(faults: &[TextureFault]) -> String {
    const SHOWN: usize = 3;
    let mut text: Vec<String> = faults.iter().take(SHOWN).map(ToString::to_string).collect();
    if faults.len() > SHOWN {
        text.push(format!("and {} more", faults.len() - SHOWN));
    }
    text.join("; ")
}
