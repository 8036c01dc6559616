//! A measured field against that of a model: difference, map and number.

use super::projection::project;
use crate::camera::Rectifier;
use crate::field::{Measurement, RigidMotion};
use crate::io::store::Store;
use crate::mesh::{Mesh, MeshError, ZoneElements};
use crate::run::folder::RunFolder;
use crate::run::words::Result;
use crate::units::{PixelSize, Px};
use serde::Serialize;
use std::io::Write;

/// Folder of what is compared, in that of the run.
pub(crate) const COMPARISON: &str = "comparison";

/// The field of a model, laid over the plane of the specimen: px, y down.
#[derive(Debug)]
pub struct PlacedModel {
    mesh: Mesh<Px>,
    displacement: Vec<[f64; 2]>,
}

impl PlacedModel {
    /// The model with these nodes, elements and displacements, px, y down.
    ///
    /// # Errors
    /// Elements that are none.
    pub fn new(
        nodes: Vec<[f64; 2]>,
        elements: Vec<[u32; 4]>,
        displacement: Vec<[f64; 2]>,
    ) -> std::result::Result<Self, MeshError> {
        let zone = ZoneElements { name: "model".into(), nodes, elements };
        Ok(Self { mesh: Mesh::from_zones(vec![zone])?, displacement })
    }

    /// The model with lengths in mm and y up, of which the origin is at the pixel `origin` and the x axis is turned by
    /// `turn_rad` from that of the image towards up.
    ///
    /// # Errors
    /// Elements that are none.
    pub fn of_mm(
        model: crate::io::mesh_file::ModelField,
        origin: [f64; 2],
        turn_rad: f64,
        scale: PixelSize,
    ) -> std::result::Result<Self, MeshError> {
        let (sin, cos) = turn_rad.sin_cos();
        let turned =
            |&[x, y]: &[f64; 2]| [(cos * x - sin * y) / scale.mm_per_px(), -(sin * x + cos * y) / scale.mm_per_px()];
        let place = |at: &[f64; 2]| {
            let [x, y] = turned(at);
            [origin[0] + x, origin[1] + y]
        };
        let displacement = model.displacement.iter().map(turned).collect();
        Self::new(model.nodes.iter().map(place).collect(), model.elements, displacement)
    }

    /// The displacement at a place; nothing outside.
    fn at(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        Some(self.mesh.interpolate(&self.displacement, self.mesh.find(x, y)?))
    }
}

/// What a comparison came to; `comparison/NNNNNN.json`.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Number of the frame.
    pub frame: usize,
    /// Its image.
    pub file: String,
    /// How the model was brought to the nodes: `projection` or `nodes`.
    pub method: &'static str,
    /// Nodes that are compared.
    pub n_nodes: usize,
    /// Of the measured ones, per cent.
    pub percent: f64,
    /// Measured less model, root mean square of the components, px.
    pub rms_px: f64,
    /// The same in mm, where the scale is known.
    pub rms_mm: Option<f64>,
    /// The same in standard uncertainties of the measurement: 1 where only noise is between them.
    pub rms_sigma: f64,
    /// The same in standard uncertainties of measurement and camera together; none of an exact camera.
    pub rms_sigma_with_camera: Option<f64>,
    /// Largest difference, length of the vector, px.
    pub largest_px: f64,
    /// Where it is.
    pub at_px: [f64; 2],
    /// The rigid motion that was taken off the difference.
    pub rigid_motion: Option<RigidMotion>,
    /// Difference of each node, px; none where it is not compared.
    #[serde(skip)]
    pub difference: Vec<Option<[f64; 2]>>,
    #[serde(skip)]
    model: Vec<Option<[f64; 2]>>,
    /// What is compared with it, in the plane that the camera sees.
    #[serde(skip)]
    field: Measurement<Px>,
    /// Standard uncertainty of each node by the camera, common to all of them, px; none of an exact camera.
    #[serde(skip)]
    of_camera: Option<Vec<[f64; 2]>>,
}

/// Compares frame `number` with the model. The model is brought to the nodes as the measurement brings the motion of the
/// pixels to them, by least squares over the elements; of fields of another program it is taken at the points.
/// `without_rigid` takes the rigid motion that fits the difference best off it.
///
/// # Errors
/// A frame without field, a model that covers no element.
pub fn compare(store: &Store, number: usize, model: &PlacedModel, without_rigid: bool) -> Result<Comparison> {
    let Some(frame) = store.frame(number)? else { return Err(format!("frame {number} has no field").into()) };
    // A model has no lens: it is laid over the field in the plane.
    let camera = Rectifier::new(store.header().camera()?, store.mesh())?;
    let field = camera.rectify(&frame.measurement).into_owned();
    let mesh = camera.mesh();
    let (method, seen) = match store.header().imported_from() {
        None => ("projection", project(mesh, &field.measured, |at| model.at(at))),
        Some(_) => ("nodes", mesh.nodes().iter().map(|&at| model.at(at)).collect()),
    };
    let off = |((u, seen), &measured): ((&[f64; 2], &Option<[f64; 2]>), &bool)| {
        seen.filter(|_| measured).map(|[x, y]| [u[0] - x, u[1] - y])
    };
    let mut difference: Vec<Option<[f64; 2]>> =
        field.displacement.iter().zip(&seen).zip(&field.measured).map(off).collect();
    let compared = |list: &[Option<[f64; 2]>]| -> Vec<([f64; 2], [f64; 2])> {
        mesh.nodes().iter().zip(list).filter_map(|(&at, d)| Some((at, (*d)?))).collect()
    };
    let rigid_motion = without_rigid.then(|| RigidMotion::fit(compared(&difference).into_iter())).flatten();
    if let Some(motion) = &rigid_motion {
        for (d, &at) in difference.iter_mut().zip(mesh.nodes()) {
            let rigid = motion.displacement(at);
            *d = d.map(|d| [d[0] - rigid[0], d[1] - rigid[1]]);
        }
    }
    let pairs = compared(&difference);
    let Some(&(at_px, largest)) = pairs.iter().max_by(|a, b| length(a.1).total_cmp(&length(b.1))) else {
        return Err(
            "the model covers no measured element: give the place of its origin with --origin, and its unit".into()
        );
    };
    let n = 2.0 * pairs.len() as f64;
    let rms_px = (pairs.iter().flat_map(|(_, d)| d).map(|d| d * d).sum::<f64>() / n).sqrt();
    let in_sigma = |sigma: &[[f64; 2]]| {
        let squares = difference.iter().zip(sigma).filter_map(|(d, sigma)| {
            let [x, y] = (*d)?;
            Some((x / sigma[0]).powi(2) + (y / sigma[1]).powi(2))
        });
        (squares.sum::<f64>() / n).sqrt()
    };
    let of_camera = camera_of_nodes(&camera, &field, &difference, rigid_motion.is_some());
    let with_camera = |of_camera: &Vec<[f64; 2]>| -> Vec<[f64; 2]> {
        field.sigma.iter().zip(of_camera).map(|(a, b)| [a[0].hypot(b[0]), a[1].hypot(b[1])]).collect()
    };
    let n_measured = field.measured.iter().filter(|&&measured| measured).count();
    Ok(Comparison {
        frame: number,
        file: frame.file.clone(),
        method,
        n_nodes: pairs.len(),
        percent: 100.0 * pairs.len() as f64 / n_measured.max(1) as f64,
        rms_px,
        rms_mm: store.header().pixel_size.map(|scale| scale.mm_from_px(rms_px)),
        rms_sigma: in_sigma(&field.sigma),
        rms_sigma_with_camera: of_camera.as_ref().map(|of_camera| in_sigma(&with_camera(of_camera))),
        largest_px: length(largest),
        at_px,
        rigid_motion,
        difference,
        model: seen,
        field,
        of_camera,
    })
}

/// Standard uncertainty of each node by the camera; of what is left without a rigid motion where one is taken off.
fn camera_of_nodes(
    camera: &Rectifier,
    field: &Measurement<Px>,
    difference: &[Option<[f64; 2]>],
    without_rigid: bool,
) -> Option<Vec<[f64; 2]>> {
    let mut squares = vec![[0.0; 2]; field.measured.len()];
    for term in camera.terms(field) {
        let places = field.mesh.nodes().iter().zip(&term.change);
        let compared = places.clone().zip(difference).filter(|(_, d)| d.is_some());
        let motion = without_rigid.then(|| RigidMotion::fit(compared.map(|((&at, &u), _)| (at, u)))).flatten();
        for (sum, (&at, u)) in squares.iter_mut().zip(places) {
            let rigid = motion.as_ref().map_or([0.0; 2], |motion| motion.displacement(at));
            let left = u.iter().zip(rigid).map(|(u, rigid)| u - rigid);
            sum.iter_mut().zip(left).for_each(|(sum, left)| *sum += left * left);
        }
    }
    (!camera.camera().is_exact()).then(|| squares.into_iter().map(|sum| sum.map(f64::sqrt)).collect())
}

fn length([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}

impl Comparison {
    /// Writes the number as JSON and the nodes as a table into `comparison/` of a folder.
    ///
    /// # Errors
    /// What the file system refuses.
    pub fn write(&self, folder: &RunFolder, scale: Option<PixelSize>) -> Result<()> {
        let field = &self.field;
        folder.make(COMPARISON)?;
        folder.write_json(&format!("{COMPARISON}/{:06}.json", self.frame), self)?;
        folder.write(&format!("{COMPARISON}/{:06}.csv", self.frame), |out| {
            writeln!(out, "# measured less model at the nodes, frame {}: {:?}", self.frame, self.file)?;
            writeln!(out, "# lengths in px, y down; the model by {}; sigma of the measurement alone", self.method)?;
            write!(out, "node,x_px,y_px,ux_px,uy_px,model_ux_px,model_uy_px,difference_ux_px,difference_uy_px")?;
            write!(out, ",sigma_ux_px,sigma_uy_px,difference_ux_sigma,difference_uy_sigma")?;
            write!(out, "{}", self.of_camera.as_ref().map_or("", |_| ",camera_ux_px,camera_uy_px"))?;
            writeln!(out, "{}", scale.map_or("", |_| ",difference_ux_mm,difference_uy_mm"))?;
            let nodes = field.mesh.nodes().iter().zip(&field.displacement).zip(&field.sigma);
            let compared = self.difference.iter().zip(&self.model);
            for (node, (((at, u), sigma), (difference, model))) in nodes.zip(compared).enumerate() {
                let (Some(d), Some(model)) = (difference, model) else { continue };
                write!(out, "{node}")?;
                let in_sigma = [d[0] / sigma[0], d[1] / sigma[1]];
                let pairs = [at, u, model, d, sigma, &in_sigma];
                pairs.into_iter().flatten().try_for_each(|v| write!(out, ",{v:?}"))?;
                let of_camera = self.of_camera.as_ref().and_then(|list| list.get(node));
                of_camera.into_iter().flatten().try_for_each(|v| write!(out, ",{v:?}"))?;
                if let Some(scale) = scale {
                    d.iter().try_for_each(|&v| write!(out, ",{:?}", scale.mm_from_px(v)))?;
                }
                writeln!(out)?;
            }
            Ok(())
        })
    }
}
