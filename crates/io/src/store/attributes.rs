//! The attributes of the group: what a reader must know beside the arrays.

use super::layout::{NOT_DONE, VERSION};
use super::{StoreError, StoreHeader};
use crate::field::{Status, StrainWindow};
use crate::mesh::Mesh;
use crate::units::{PixelSize, Px};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

pub(super) const FRAME_OF_REFERENCE: &str = "pixel centres at whole coordinates, x to the right, y down, origin at the centre of \
                                  the top-left pixel; displacements lead from the reference to the deformed image and \
                                  stand at positions of the reference";
pub(super) const SIGMA: &str = "Cov = sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v M0^-1 (M - M0) M0^-1], for little noise and one \
                     reference 2 sigma^2 M^-1: M the normal matrix of the correlation, M0 without the noise of the gradient, \
                     k the references averaged, gain that of brightness, sigma the noise of one image: given, or for each \
                     zone estimated from the residual r, sigma^2 = var(r)/(1/k + gain^2 v_x v_y), v_x v_y the share of the \
                     noise that interpolation lets through, v that of its product with the noise of the gradient; where the noise is not white or rises with the grey \
                     level, sigma is made for that (noise_correlation_factor, noise_photon of the frame's record)";

pub(super) const SIGMA_IMPORTED: &str = "of single points: stated, estimated from fields at rest, or from the file of the other program; \
                              see import.json";

/// Definition of the strains in words and numbers.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct StrainAttributes {
    definition: String,
    shear: String,
    /// Over which length an element value is a mean; a nodal one over twice that.
    element_length_px: f64,
    node_length_px: f64,
    /// Nodes along a side of the window of `strain_window`; absent where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    window_nodes: Option<StrainWindow>,
    /// Length of its virtual strain gauge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    window_length_px: Option<f64>,
    #[serde(default)]
    notes: Vec<String>,
}

/// The attributes as they stand in `zarr.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Attributes {
    quadrille_store: u64,
    quadrille: String,
    device: String,
    #[serde(default)]
    units: BTreeMap<String, String>,
    #[serde(default)]
    frame_of_reference: String,
    #[serde(default)]
    status_codes: BTreeMap<String, String>,
    strain: StrainAttributes,
    #[serde(default)]
    sigma: String,
    zones: Vec<String>,
    image_size_px: [usize; 2],
    pixel_size_mm: Option<f64>,
    range_grey: f64,
    element_size_px: f64,
    pub n_nodes: usize,
    pub n_elements: usize,
    reference: Vec<String>,
    reference_sha256: Vec<String>,
    pub frames: Vec<String>,
    /// Empty until the run has ended; null for a file that could not be read.
    #[serde(default)]
    pub frames_sha256: Vec<Option<String>>,
    pub run_toml: String,
}

impl Attributes {
    pub fn of(header: &StoreHeader) -> Self {
        let unit = |(key, meaning): (&str, &str)| (key.to_owned(), meaning.to_owned());
        let units = [
            ("_px", "pixels of the reference image"),
            ("_grey", "grey levels in the scale of the images"),
            ("_mm", "millimetres on the specimen"),
            ("strain", "no dimension"),
        ];
        let mut status_codes: BTreeMap<String, String> =
            Status::ALL.iter().map(|status| (status.code().to_string(), status.name().to_owned())).collect();
        status_codes.insert(NOT_DONE.to_string(), "not done".to_owned());
        let length = header.element_size_px;
        Self {
            quadrille_store: VERSION,
            quadrille: header.quadrille.clone(),
            device: header.device.clone(),
            units: units.into_iter().map(unit).collect(),
            frame_of_reference: FRAME_OF_REFERENCE.to_owned(),
            status_codes,
            strain: StrainAttributes {
                definition: header.strain.name().to_owned(),
                shear: "tensor".to_owned(),
                element_length_px: length,
                node_length_px: 2.0 * length,
                window_nodes: header.strain_window,
                window_length_px: header.strain_window.map(|window| window.gauge_length(length)),
                notes: (header.strain.describe(length).into_iter())
                    .chain(header.strain_window.iter().flat_map(|window| window.describe(length)))
                    .collect(),
            },
            sigma: header.sigma().to_owned(),
            zones: header.mesh.zones().to_vec(),
            image_size_px: header.image_size_px,
            pixel_size_mm: header.pixel_size.map(PixelSize::mm_per_px),
            range_grey: header.range_grey,
            element_size_px: length,
            n_nodes: header.mesh.n_nodes(),
            n_elements: header.mesh.n_elements(),
            reference: header.reference.clone(),
            reference_sha256: header.reference_sha256.clone(),
            frames: header.frames.clone(),
            frames_sha256: Vec::new(),
            run_toml: header.case.clone(),
        }
    }

    /// Names the files as `header` does, of frames as many as there are.
    pub fn rename_files(&mut self, header: &StoreHeader) {
        self.reference.clone_from(&header.reference);
        self.frames.iter_mut().zip(&header.frames).for_each(|(there, now)| there.clone_from(now));
        self.run_toml.clone_from(&header.case);
    }

    /// The text of `zarr.json`.
    pub fn json(&self) -> Vec<u8> {
        let group = json!({ "zarr_format": 3, "node_type": "group", "attributes": self });
        let mut text = format!("{group:#}").into_bytes();
        text.push(b'\n');
        text
    }

    /// Reads the text of the `zarr.json` of the store `path`.
    #[expect(clippy::indexing_slicing, reason = "a JSON value without such a key reads as null")]
    pub fn parse(text: &[u8], path: &Path) -> Result<Self, StoreError> {
        let file = path.join("zarr.json");
        let damaged = |reason: String| StoreError::Metadata { file: file.clone(), reason };
        let mut group: Value =
            serde_json::from_slice(text).map_err(|error| damaged(format!("it is not JSON ({error})")))?;
        let foreign = |reason: &str| StoreError::NotAStore { path: path.to_owned(), reason: reason.to_owned() };
        if group["zarr_format"] != 3 || group["node_type"] != "group" {
            return Err(foreign("its zarr.json describes no Zarr V3 group"));
        }
        let attributes = group["attributes"].take();
        match attributes["quadrille_store"].as_u64() {
            Some(VERSION) => {}
            Some(found) => {
                let writer = attributes["quadrille"].as_str().unwrap_or("of an unknown version").to_owned();
                return Err(StoreError::Version { path: path.to_owned(), found, writer });
            }
            None => return Err(foreign("its zarr.json has no attribute quadrille_store")),
        }
        serde_json::from_value(attributes).map_err(|error| damaged(format!("in its attributes, {error}")))
    }

    /// Zone names, in the order of their numbers.
    pub fn zones(&self) -> &[String] {
        &self.zones
    }

    /// The header, with the mesh that the arrays gave.
    pub fn header(&self, mesh: Arc<Mesh<Px>>, path: &Path) -> Result<StoreHeader, StoreError> {
        let damaged = |reason: String| StoreError::Metadata { file: path.join("zarr.json"), reason };
        let positive = |mm| PixelSize::new(mm).ok_or_else(|| damaged(format!("pixel_size_mm is {mm}, not above zero")));
        let pixel_size = self.pixel_size_mm.map(positive).transpose()?;
        for (name, value) in [("range_grey", self.range_grey), ("element_size_px", self.element_size_px)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(damaged(format!("{name} is {value}, not above zero")));
            }
        }
        Ok(StoreHeader {
            quadrille: self.quadrille.clone(),
            device: self.device.clone(),
            mesh,
            image_size_px: self.image_size_px,
            reference: self.reference.clone(),
            reference_sha256: self.reference_sha256.clone(),
            frames: self.frames.clone(),
            pixel_size,
            range_grey: self.range_grey,
            element_size_px: self.element_size_px,
            strain: self.strain.definition.parse().map_err(|error| damaged(format!("{error}")))?,
            strain_window: self.strain.window_nodes,
            case: self.run_toml.clone(),
        })
    }
}
