//! The exchange file of the Chair of Forming and Machining Processes, TU Dresden (DIC_Exchange 0.1), in HDF5.

use super::hdf5::{COORDINATES, SIGMA, UNIT, Y_AXIS};
use crate::field::{Measurement, StrainField, TensorStrain};
use crate::mesh::Mesh;
use crate::units::{PixelSize, Px};
use hdf5_writer::{AttributeBuilder, DatasetBuilder, Hdf5Builder, WriteOptions};
use std::io::{self, Write};

/// A series on its way into an exchange file: time steps of which the first is the reference.
///
/// Lengths are mm with y up from the centre of the top-left pixel, or px with y down without a scale; attributes of the
/// coordinates say which. A node that was not measured has NaN. Numbers keep their bits.
#[derive(Debug)]
pub struct Exchange {
    /// Length of a pixel in the unit of the file, and the sign of y.
    scale: [f64; 2],
    unit: &'static str,
    y_axis: &'static str,
    /// Triangles: two for each element of four nodes.
    triangles: Vec<u32>,
    time: Vec<f64>,
    coordinates: Vec<f64>,
    strains: Vec<f64>,
    sigma: Vec<f64>,
}

impl Exchange {
    /// Bytes of a time step with `n_nodes`.
    pub fn step_bytes(n_nodes: usize) -> usize {
        n_nodes * (3 + 3 + 2) * size_of::<f64>()
    }

    /// With the reference alone.
    pub fn new(mesh: &Mesh<Px>, scale: Option<PixelSize>) -> Self {
        let (scale, unit, y_axis) = match scale {
            Some(scale) => ([scale.mm_per_px(), -scale.mm_per_px()], "mm", "up"),
            None => ([1.0; 2], "px", "down"),
        };
        let halves = |&[a, b, c, d]: &[u32; 4]| if c == d { vec![a, b, c] } else { vec![a, b, c, a, c, d] };
        let mut file = Self {
            scale,
            unit,
            y_axis,
            triangles: mesh.elements().iter().flat_map(halves).collect(),
            time: vec![0.0],
            coordinates: Vec::new(),
            strains: vec![0.0; 3 * mesh.n_nodes()],
            sigma: vec![0.0; 2 * mesh.n_nodes()],
        };
        mesh.nodes().iter().for_each(|&at| file.push(at));
        file
    }

    fn push(&mut self, at: [f64; 2]) {
        let [x, y] = self.scale;
        self.coordinates.extend([at[0] * x, at[1] * y, 0.0]);
    }

    /// Adds a frame at a time.
    pub fn add(&mut self, time: f64, field: &Measurement<Px>, strain: &StrainField) {
        self.time.push(time);
        let nodes = field.mesh.nodes().iter().zip(&field.measured);
        for ((&[x, y], &measured), (&[u, v], &sigma)) in
            nodes.zip(field.at_points().iter().zip(field.sigma_at_points()))
        {
            let known = if measured { 0.0 } else { f64::NAN };
            self.push([x + u + known, y + v + known]);
            self.sigma.extend(sigma.map(|sigma| sigma * self.scale[0] + known));
        }
        let turned = if self.scale[1] < 0.0 { -1.0 } else { 1.0 };
        for strain in &strain.nodes {
            let [exx, eyy, exy] = strain.map_or([f64::NAN; 3], TensorStrain::components);
            self.strains.extend([exx, eyy, exy * turned]);
        }
    }

    /// Writes the file. `about` stands in it; `time_is` says what the times are.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write<W: Write>(&self, mut out: W, about: &str, time_is: &str) -> io::Result<()> {
        let file = self.file(about, time_is).and_then(|file| file.into_plan()?.encode(WriteOptions::default()));
        out.write_all(&file.map_err(io::Error::other)?)
    }

    fn file(&self, about: &str, time_is: &str) -> hdf5_writer::Result<Hdf5Builder> {
        let steps = self.time.len() as u64;
        let points = self.coordinates.len() as u64 / 3 / steps;
        let text = |name: &str, text: &str| AttributeBuilder::fixed_string(name, text);
        let coordinates = DatasetBuilder::typed_data(COORDINATES, [steps, points, 3], &self.coordinates)?
            .attribute(text(UNIT, self.unit))
            .attribute(text(Y_AXIS, self.y_axis));
        let strains = DatasetBuilder::typed_data("vector/strains", [steps, points, 3], &self.strains)?
            .attribute(text("order", "exx, eyy, exy"))
            .attribute(text("shear", "tensor"));
        let sigma =
            DatasetBuilder::typed_data(SIGMA, [steps, points, 2], &self.sigma)?.attribute(text(UNIT, self.unit));
        let time = DatasetBuilder::typed_data("scalar/time", [steps], &self.time)?.attribute(text(UNIT, time_is));
        let force = DatasetBuilder::typed_data("scalar/force", [steps], &vec![f64::NAN; self.time.len()])?;
        let mesh = DatasetBuilder::typed_data("mesh", [self.triangles.len() as u64 / 3, 3], &self.triangles)?;
        let datasets = [time, force, strains, coordinates, sigma, mesh];
        let file = Hdf5Builder::new().attribute(text("version", "0.1")).attribute(text("about", about));
        Ok(datasets.into_iter().fold(file, Hdf5Builder::dataset))
    }
}
