//! A reference that is in memory, prepared as a run prepares that of files: for programs that have the images
//! themselves.

use crate::camera::Rectifier;
use crate::correlate::{Correlate, Regularisation, prepare};
use crate::field::{
    Elements, Measurement, Quantities, StrainDefinition, StrainField, StrainWindow, StrainWindows, UpdateReference,
};
use crate::imaging::Image;
use crate::io::case::{CaseFile, CaseQuantities, CaseZone, CrackPath};
use crate::io::series::Frame;
use crate::mesh::Mask;
use crate::remark::Remark;
use crate::run::look::quantities::{Fields, resolve, texts};
use crate::run::plan::{Images, Plan, Request, Zones, cut};
use crate::run::words::Result;
use crate::run::words::remarks::of_device;
use crate::units::{PixelSize, Px};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// So many frames are taken to come, as nobody says: a driver is not loaded for a pair of small images.
const FRAMES: u64 = 100;

/// A prepared reference, and what a case says of the strains.
pub struct InMemory {
    /// What frames are correlated with.
    pub correlator: Arc<dyn Correlate>,
    /// What is worth knowing: of the zones that were found, of masks and mesh files, of the device.
    pub remarks: Vec<Remark>,
    /// How strains are made.
    pub strain: StrainDefinition,
    window: Option<StrainWindow>,
    windows: Option<StrainWindows>,
    pixel_size: Option<PixelSize>,
    /// Its relative standard uncertainty.
    pixel_size_std: f64,
    /// Whether nodes are bound to each other: standard uncertainties of quantities are then upper bounds.
    regularised: bool,
    /// Maps fields into the plane of the specimen.
    camera: Rectifier,
}

impl InMemory {
    /// Prepares `reference` with the zones, cracks and options of `case` and of what is asked for over it; images that
    /// they name are not looked at. Where no zone is named, nor a mask given, the specimen is looked for as
    /// `quadrille correlate` does. A `mask` holds for every zone.
    ///
    /// ```
    /// use quadrille::synth::{RenderOptions, Texture, Translation, render};
    /// use quadrille::{correlate::Tracker, io::case::CaseFile, run::InMemory, run::Request};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let texture = Texture::new(7, 4.5)?;
    /// # let photograph = |u| render(&texture, &Translation(u), &RenderOptions::new(128, 96)).map(std::sync::Arc::new);
    /// let (reference, deformed) = (photograph([0.0, 0.0])?, photograph([0.3, -0.2])?);
    /// let mut asked = Request { device: "cpu".parse()?, ..Request::default() };
    /// asked.zones.roi = vec![[16.0, 16.0, 112.0, 80.0]];
    /// let prepared = InMemory::new(&asked, &CaseFile::default(), reference, None)?;
    /// let field = Tracker::new(&*prepared.correlator).correlate(1, deformed)?.measurement;
    /// assert!((field.displacement[0][0] - 0.3).abs() < 0.02); // px
    /// assert!(prepared.strains(&field).elements[0].is_some_and(|strain| strain.xx.abs() < 0.01));
    /// # Ok(()) }
    /// ```
    ///
    /// # Errors
    /// Options, zones, cracks or texture that do not allow a measurement; a device that is not there; a crack or a
    /// change of reference that only a series finds.
    pub fn new(asked: &Request, case: &CaseFile, reference: Arc<Image>, mask: Option<Mask>) -> Result<Self> {
        let size = [reference.width(), reference.height()];
        let named = Frame::file("the reference image".into(), 0);
        let images = Images { reference: vec![named], deformed: Vec::new(), grows: false, said: Vec::new() };
        let mut plan = Plan::with(asked, case, images)?;
        if plan.update != UpdateReference::Never {
            return Err("update_reference is for a series; leave it out for single images".into());
        }
        if plan.drawn.cracks.iter().any(|crack| crack.path == CrackPath::Auto) {
            return Err("a crack is found in a series alone; give its path = [[x, y], ...] for single images".into());
        }
        if mask.is_some() && plan.zones.is_empty() {
            let [x1, y1] = size.map(|side| side as f64);
            plan.zones.push(CaseZone { roi: Some([0.0, 0.0, x1, y1]), ..CaseZone::default() });
        }
        let Zones { mut zones, mut remarks, .. } = Zones::of(&mut plan, &reference, Path::new(""))?;
        if let Some(mask) = mask {
            if [mask.width(), mask.height()] != size {
                let [own, wanted] = [[mask.width(), mask.height()], size].map(|[x, y]| format!("{x} x {y} px"));
                return Err(format!("the mask is {own}, the reference {wanted}; give one of the same size").into());
            }
            let mask = Arc::new(mask);
            zones.iter_mut().for_each(|zone| zone.mask = Some(Arc::clone(&mask)));
        }
        cut(&mut zones, &plan.drawn.cracks)?;
        let device = plan.device_of(FRAMES * (size[0] * size[1]) as u64)?;
        remarks.extend(device.remark().map(of_device));
        let correlator = prepare(&device, reference, &zones, plan.options.clone())?;
        let camera = Rectifier::new(plan.camera.clone().unwrap_or_default().camera(size)?, correlator.mesh())?;
        let windows = plan.strain_windows(camera.mesh());
        Ok(Self {
            correlator,
            remarks,
            strain: plan.strain,
            window: plan.strain_window,
            windows,
            pixel_size: plan.pixel_size,
            pixel_size_std: plan.camera.as_ref().and_then(|camera| camera.pixel_size_relative_std).unwrap_or(0.0),
            regularised: plan.options.regularisation != Regularisation::None
                || plan.options.elements != Elements::Bilinear,
            camera,
        })
    }

    /// What is asked for of a field, a text of CSV for each table by its name: the tables of `quadrille probe`, with one
    /// frame.
    ///
    /// # Errors
    /// Places that mean nothing, names that come twice, zones that are not there.
    pub fn quantities(&self, field: &Measurement<Px>, asked: &CaseQuantities) -> Result<BTreeMap<String, String>> {
        let quantities =
            Quantities { window: self.window, ..resolve(asked, self.strain, self.pixel_size, &self.camera)? };
        let fields = Fields {
            header: &[],
            camera: &self.camera,
            pixel_size: self.pixel_size,
            pixel_size_std: self.pixel_size_std,
            n_references: 1,
            element_size_px: self.camera.raw_mesh().element_size(),
            regularised: self.regularised,
        };
        texts(&quantities, fields, field)
    }

    /// The strains of a field, as the case wants them, in the plane that its camera sees.
    pub fn strains(&self, field: &Measurement<Px>) -> StrainField {
        let field = self.camera.rectify(field);
        let window = self.windows.as_ref().map(|windows| windows.of(&field, self.strain));
        StrainField { window, ..StrainField::of(&field, self.strain) }
    }
}
