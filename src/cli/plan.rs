//! From flags and case file to one resolved plan.

use super::args::{CorrelateArgs, Export};
use super::{Result, absolute};
use crate::correlate::{Options, Regularisation};
use crate::field::{RegularisationKind, StrainDefinition};
use crate::io::case::{CaseCorrelation, CaseFile, CaseImages, CaseQuantities, CaseZone, read_case};
use crate::io::series::expand_series;
use crate::isa::Isa;
use crate::mesh::{Roi, Zone};
use crate::units::PixelSize;
use clap::ValueEnum;
use std::path::{Path, PathBuf};

/// From more frames than these only the store is written, unless tables are asked for.
pub(super) const MANY: usize = 1000;

/// What a run will do, every choice made.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub reference: PathBuf,
    pub deformed: Vec<PathBuf>,
    pub page: usize,
    pub pixel_size: Option<PixelSize>,
    pub zones: Vec<CaseZone>,
    pub options: Options,
    pub isa: Isa,
    pub strain: StrainDefinition,
    pub csv: bool,
    pub vtu: bool,
    /// No tables, because there are many frames and nobody asked for them.
    pub store_only: bool,
    /// What is drawn from the fields when the series is done.
    pub drawn: CaseQuantities,
}

impl Plan {
    /// Brings case file and flags together; flags win, defaults fill the rest.
    pub fn new(args: &CorrelateArgs) -> Result<Self> {
        let case = args.case.as_deref().map(read_case).transpose()?.unwrap_or_default();
        let (reference, deformed) = images(args, &case)?;
        let given = &case.correlation;
        let default = Options::default();
        let element_size = args.element_size.or(given.element_size_px.map(i64::from));
        let options = Options {
            // A negative size is refused with the same words as 0.
            element_size: match element_size {
                Some(size) => usize::try_from(size)
                    .map_err(|_| format!("the element size is {size} px; choose 4 to 128 px (16 is a good start)"))?,
                None => default.element_size,
            },
            interpolation: args.interpolation.or(given.interpolation).unwrap_or(default.interpolation),
            tolerance_px: args.tolerance.or(given.tolerance_px).unwrap_or(default.tolerance_px),
            max_iterations: args.max_iterations.or(given.max_iterations).map_or(default.max_iterations, |n| n as usize),
            brightness: args.brightness.or(given.brightness).unwrap_or(default.brightness),
            start: args.start.or(given.start).unwrap_or(default.start),
            noise: args.noise.or(given.noise),
            drop_textureless: args.drop_textureless || given.drop_textureless.unwrap_or(false),
            regularisation: regularisation(args, given)?,
            ..default
        };
        let pixel_size = match args.pixel_size.or(case.images.pixel_size_mm) {
            Some(mm) => Some(PixelSize::new(mm).ok_or(format!("the pixel size is {mm} mm; give a positive number"))?),
            None => None,
        };
        let zones = if args.roi.is_empty() {
            case.zones.clone()
        } else {
            args.roi.iter().map(|&roi| CaseZone { name: None, roi: Some(roi) }).collect()
        };
        options.check()?;
        // A rerun of a run.toml takes the instruction path of that run where it can: the same bits.
        let recorded = |key: &str| case.run.as_ref().and_then(|run| run.get(key)).cloned();
        let recorded_isa = recorded("isa").and_then(|isa| Isa::named(isa.as_str()?));
        let isa = match &args.isa {
            Some(name) => Isa::named(name).ok_or_else(|| {
                let there: Vec<_> = Isa::available().iter().map(|isa| isa.name()).collect();
                format!("this machine has no instruction path '{name}'; it has {}", there.join(", "))
            })?,
            None => recorded_isa.unwrap_or_else(Isa::detect),
        };
        let mut store_only = false;
        let export = match &args.export {
            Some(export) => export.clone(),
            None => match recorded("export") {
                Some(toml::Value::Array(names)) => {
                    let named = |name: &toml::Value| Export::from_str(name.as_str()?, true).ok();
                    names.iter().filter_map(named).collect()
                }
                _ if deformed.len() > MANY => {
                    store_only = true;
                    Vec::new()
                }
                _ => vec![Export::Csv, Export::Vtu],
            },
        };
        if export.contains(&Export::None) && export.len() > 1 {
            return Err("--export none stands alone; give csv, vtu, or both".into());
        }
        Ok(Self {
            reference,
            deformed,
            page: args.page.or(case.images.page).unwrap_or(0) as usize,
            pixel_size,
            zones,
            options,
            isa,
            strain: args.strain.or(given.strain).unwrap_or_default(),
            csv: export.contains(&Export::Csv),
            vtu: export.contains(&Export::Vtu),
            store_only,
            drawn: drawn(&case),
        })
    }

    /// The zones on an image of this size: those asked for, or the whole image.
    pub fn zones_on(&self, width: usize, height: usize) -> Result<Vec<Zone>> {
        if self.zones.is_empty() {
            let roi = Roi { x0: 0.0, y0: 0.0, x1: width as f64, y1: height as f64 };
            return Ok(vec![Zone::rectangle("image", roi)]);
        }
        let named = |(at, zone): (usize, &CaseZone)| {
            let name = zone.name.clone().unwrap_or_else(|| format!("zone{}", at + 1));
            let roi = zone.rectangle().ok_or(format!("zone '{name}' has no roi = [x0, y0, x1, y1]"))?;
            Ok(Zone::rectangle(name, roi))
        };
        self.zones.iter().enumerate().map(named).collect()
    }

    /// The plan as a case file that gives the same result from anywhere on this machine.
    pub fn resolved(&self, zones: &[Zone]) -> CaseFile {
        let Options { element_size, interpolation, tolerance_px, max_iterations, brightness, regularisation, .. } =
            self.options;
        CaseFile {
            images: CaseImages {
                reference: Some(absolute(&self.reference)),
                deformed: Some(self.deformed.iter().map(|path| absolute(path)).collect()),
                page: Some(self.page as u32),
                pixel_size_mm: self.pixel_size.map(PixelSize::mm_per_px),
            },
            correlation: CaseCorrelation {
                element_size_px: Some(element_size as u32),
                interpolation: Some(interpolation),
                tolerance_px: Some(tolerance_px),
                max_iterations: Some(max_iterations as u32),
                brightness: Some(brightness),
                start: Some(self.options.start),
                noise: self.options.noise,
                regularisation: Some(regularisation.kind()),
                cutoff_px: regularisation.cutoff_px(),
                poisson: match regularisation {
                    Regularisation::EquilibriumGap { poisson, .. } => Some(poisson),
                    _ => None,
                },
                strain: Some(self.strain),
                drop_textureless: Some(self.options.drop_textureless),
            },
            zones: zones
                .iter()
                .map(|zone| CaseZone { name: Some(zone.name.clone()), roi: zone.roi.map(|r| [r.x0, r.y0, r.x1, r.y1]) })
                .collect(),
            ..CaseFile::default()
        }
        .with_drawn(&self.drawn)
    }
}

/// The regularisation that flags and case file ask for together. A kind given as a flag leaves aside what the case
/// file says for another kind.
fn regularisation(args: &CorrelateArgs, case: &CaseCorrelation) -> Result<Regularisation> {
    let kind = args.regularisation.or(case.regularisation).unwrap_or_default();
    let same = args.regularisation.is_none_or(|flag| Some(flag) == case.regularisation);
    let of_none = args.regularisation == Some(RegularisationKind::None);
    let cutoff_px = args.cutoff.or(case.cutoff_px.filter(|_| !of_none));
    let poisson = case.poisson.filter(|_| same);
    if kind != RegularisationKind::EquilibriumGap && poisson.is_some() {
        return Err("poisson is a matter of regularisation = \"equilibrium-gap\"; leave it out or choose that".into());
    }
    let cutoff_px = match (kind, cutoff_px) {
        (RegularisationKind::None, None) => return Ok(Regularisation::None),
        (RegularisationKind::None, Some(_)) => {
            return Err("a cut-off length is given but no regularisation; choose --regularisation tikhonov or \
                        equilibrium-gap, or leave it out"
                .into());
        }
        (_, None) => {
            return Err(format!(
                "the regularisation {kind} has no cut-off length; give --cutoff PX, four elements or more"
            )
            .into());
        }
        (_, Some(cutoff_px)) => cutoff_px,
    };
    Ok(match kind {
        RegularisationKind::EquilibriumGap => {
            Regularisation::EquilibriumGap { cutoff_px, poisson: poisson.unwrap_or(Regularisation::POISSON) }
        }
        _ => Regularisation::Tikhonov { cutoff_px },
    })
}

/// What the case draws from the fields, with a load file that is found from anywhere.
fn drawn(case: &CaseFile) -> CaseQuantities {
    let mut drawn = case.drawn();
    if let Some(load) = &mut drawn.load {
        load.file = absolute(Path::new(&load.file));
    }
    drawn
}

/// The reference and the deformed images.
fn images(args: &CorrelateArgs, case: &CaseFile) -> Result<(PathBuf, Vec<PathBuf>)> {
    let mut deformed = if args.deformed.is_empty() {
        expand_series(case.images.deformed.as_deref().unwrap_or(&[]), &case.base)?
    } else {
        expand_series(&args.deformed, Path::new(""))?
    };
    let given = args.reference.clone().or(case.images.reference.as_ref().map(|name| case.resolve(name)));
    let reference = match given {
        Some(reference) => reference,
        None if deformed.is_empty() => {
            return Err("no image is given; name the reference and the deformed images, or a --case file".into());
        }
        None => deformed.remove(0),
    };
    // A glob over the folder takes the reference along: it is no deformed image, unless it is the only one.
    let absolute = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let same = absolute(&reference);
    let listed_alone = deformed.len() == 1;
    deformed.retain(|path| listed_alone || absolute(path) != same);
    if deformed.is_empty() {
        return Err(format!("{}: there is no deformed image beside the reference", reference.display()).into());
    }
    Ok((reference, deformed))
}
