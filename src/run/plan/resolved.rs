//! From a case and the request over it to one plan: every choice made.

use crate::backend::choice::{Device, DeviceChoice};
use crate::backend::gpu::GpuOptions;
use crate::correlate::{Options, Regularisation};
use crate::field::{
    Elements, RegularisationKind, StartFrom, StrainDefinition, StrainWindow, StrainWindows, UpdateReference,
};
use crate::io::case::{
    CaseCamera, CaseCorrelation, CaseFile, CaseGuard, CaseImages, CaseQuantities, CaseReport, CaseZone, Pages,
    ZoneFlags, complete, over,
};
use crate::io::images::{Accepted, ReadError, pages_of};
use crate::io::series::{Frame, but_for_capitals, expand_references, expand_series};
use crate::io::store::StoreHeader;
use crate::isa::Isa;
use crate::mesh::Mesh;
use crate::remark::Remark;
use crate::run::plan::wanted::{resolved_zones, wanted_camera, wanted_cracks, wanted_pixel_size, wanted_zones};
use crate::run::plan::{Export, Request, which_reference};
use crate::run::words::{Result, absolute};
use crate::units::{PixelSize, Px};
use std::path::{Path, PathBuf};

/// From more frames than these only the store is written, unless tables are asked for.
pub(crate) const MANY: usize = 1000;

/// What a run will do, every choice made.
#[derive(Debug, Clone)]
pub struct Plan {
    /// One reference image, or several whose mean is taken.
    pub reference: Vec<Frame>,
    /// Whether it was named, and is not just the first of the images.
    pub reference_named: bool,
    /// The deformed images, in order.
    pub deformed: Vec<Frame>,
    /// The scale, where it is known.
    pub pixel_size: Option<PixelSize>,
    /// How the plane of the specimen is seen, with the numbers of its file; where nothing is stated, a usual lens.
    pub camera: Option<CaseCamera>,
    /// What an image may be to be read.
    pub accepted: Accepted,
    /// The section `[correlation]` that this comes to, with its defaults.
    pub correlation: CaseCorrelation,
    /// What is measured; where there is none, the specimen is looked for in the reference.
    pub zones: Vec<CaseZone>,
    /// Whether the zones were found so, now or in the run that this one repeats.
    pub zone_found: bool,
    /// Whether cracks were looked for, now or in the run that this one repeats.
    pub crack_auto: bool,
    /// Guard of the zones that are found, px, instead of the usual one.
    pub guard_px: Option<f64>,
    /// Options of the correlation.
    pub options: Options,
    /// When the reference is renewed.
    pub update: UpdateReference,
    /// Instruction path of the CPU.
    pub isa: Isa,
    /// Whether the instruction path was asked for, or found out.
    pub isa_asked: bool,
    /// Where the pixel work is done.
    pub device: DeviceChoice,
    /// How a graphics device is opened.
    pub gpu: GpuOptions,
    /// Definition of the strains.
    pub strain: StrainDefinition,
    /// Window of nodes of further strains.
    pub strain_window: Option<StrainWindow>,
    /// Whether a CSV file is written per frame.
    pub csv: bool,
    /// Whether a VTU file is written per frame.
    pub vtu: bool,
    /// Whether these tables were asked for, or not, by a flag.
    pub export_asked: bool,
    /// No tables, because there are many frames, or nobody knows how many, and nobody asked for them.
    pub store_only: bool,
    /// Whether the series ends with a report.
    pub report: bool,
    /// What is said of the test in the report.
    pub setup: CaseReport,
    /// What is drawn from the fields when the series is done.
    pub drawn: CaseQuantities,
    /// What there is to say of the names of its files.
    pub said: Vec<Remark>,
}

impl Plan {
    /// Lays what is asked for over a case; defaults fill the rest.
    ///
    /// # Errors
    /// No images, files that are not there, options that contradict each other.
    pub fn of(asked: &Request, case: &CaseFile) -> Result<Self> {
        Self::with(asked, case, Images::of(asked, case)?)
    }

    /// The same with the images found already.
    ///
    /// # Errors
    /// Options that contradict each other.
    pub fn with(asked: &Request, case: &CaseFile, images: Images) -> Result<Self> {
        let Images { reference, deformed, grows, said } = images;
        let wanted = over(&asked.images, &case.images)?;
        let (given, regularisation) = correlation_of(asked, case)?;
        let options = options_of(&given, regularisation, case, reference.len())?;
        let size = |mm| {
            let refused = || format!("the pixel size is {mm} mm; give a positive number, from 1e-12 to 1e12");
            PixelSize::new(mm).ok_or_else(refused)
        };
        let camera = wanted_camera(&asked.camera, case)?;
        let pixel_size = wanted_pixel_size(&wanted, camera.as_ref())?.map(size).transpose()?;
        if asked.shard.is_some() && options.start == StartFrom::Previous {
            return Err("--shard needs --start independent: the frames before are done by other processes".into());
        }
        let update = given.update_reference.unwrap_or_default();
        may_be_updated(update, &options, asked.shard.is_some())?;
        options.check()?;
        // A rerun of a run.toml takes the instruction path of that run where it can: the same bits.
        let recorded = |key: &str| case.run.as_ref().and_then(|run| run.get(key)).cloned();
        let recorded_isa = recorded("isa").and_then(|isa| Isa::named(isa.as_str()?));
        let isa = match &asked.isa {
            Some(name) => Isa::named(name).ok_or_else(|| {
                let there: Vec<_> = Isa::available().iter().map(|isa| isa.name()).collect();
                format!("this machine has no instruction path '{name}'; it has {}", there.join(", "))
            })?,
            None => recorded_isa.unwrap_or_else(Isa::detect),
        };
        let many = grows || deformed.len() > MANY;
        let export = match (&asked.export, recorded("export")) {
            (Some(export), _) => export.clone(),
            (None, Some(toml::Value::Array(names))) => {
                names.iter().filter_map(|name| name.as_str()?.parse().ok()).collect()
            }
            (None, _) if many => Vec::new(),
            (None, _) => vec![Export::Csv, Export::Vtu],
        };
        let store_only = many && asked.export.is_none() && !matches!(recorded("export"), Some(toml::Value::Array(_)));
        if export.contains(&Export::None) && export.len() > 1 {
            return Err("--export none cannot be combined with csv or vtu".into());
        }
        let was_so = |key: &str| recorded(key).is_some_and(|so| so.as_bool() == Some(true));
        let zone_found = was_so("zone_found") && !names_zone(&asked.zones);
        let mut plan = Self {
            reference,
            reference_named: wanted.reference.is_some(),
            deformed,
            pixel_size,
            camera,
            accepted: accepted_images(&wanted)?,
            strain: given.strain.unwrap_or_default(),
            strain_window: strain_window(given.strain_window)?,
            correlation: given,
            zones: wanted_zones(&asked.zones, case),
            zone_found,
            crack_auto: asked.cracks.path.is_empty() && was_so("crack_auto"),
            guard_px: match asked.zones.all.guard_px {
                Some(CaseGuard::All(guard_px)) => Some(guard_px),
                _ => None,
            },
            options,
            update,
            isa,
            isa_asked: asked.isa.is_some(),
            device: asked.device.clone(),
            gpu: asked.gpu.clone(),
            csv: export.contains(&Export::Csv),
            vtu: export.contains(&Export::Vtu),
            // Who wants nothing beside the store wants no report.
            report: !asked.no_report && !export.contains(&Export::None),
            export_asked: asked.export.is_some(),
            store_only,
            setup: case.report.clone(),
            drawn: CaseQuantities { cracks: wanted_cracks(&asked.cracks, case, pixel_size)?, ..quantities_of(case) },
            said,
        };
        if zone_found {
            plan.allow_textureless();
        }
        Ok(plan)
    }

    /// The device that does the pixel work on images of so many pixels.
    ///
    /// # Errors
    /// None of that name.
    pub fn device(&self, pixels: usize) -> Result<Device> {
        // Frames that are still to come may be any number.
        let work = match self.deformed.len() {
            0 => u64::MAX,
            frames => (pixels as u64).saturating_mul(frames as u64),
        };
        self.device_of(work)
    }

    /// The device for so many pixels of all frames together.
    ///
    /// # Errors
    /// None of that name.
    pub fn device_of(&self, work: u64) -> Result<Device> {
        Ok(Device::new(&self.device, self.isa, self.gpu.clone(), work)?)
    }

    /// What makes the strains over a window of nodes of `mesh`, where one is asked for.
    pub(crate) fn strain_windows(&self, mesh: &Mesh<Px>) -> Option<StrainWindows> {
        self.strain_window.map(|window| StrainWindows::new(mesh, window, self.options.is_held()))
    }

    /// The reference in words: its file, or the first of several.
    pub fn reference_name(&self) -> String {
        match self.reference.as_slice() {
            [first, rest @ ..] if !rest.is_empty() => format!("{first} and {} more", rest.len()),
            frames => frames.iter().map(ToString::to_string).collect(),
        }
    }

    /// The plan of a run that goes on: with the instruction path of the earlier start, where this machine has it, and
    /// with its tables, unless others are asked for.
    pub fn as_before(&self, there: &StoreHeader) -> Self {
        let mut plan = self.clone();
        if let Some(isa) = isa_of(there).filter(|_| !self.isa_asked) {
            plan.isa = isa;
        }
        if let Some((csv, vtu)) = tables_of(there).filter(|_| !self.export_asked) {
            plan = Self { csv, vtu, store_only: false, ..plan };
        }
        plan
    }

    /// The zones that the user named; none where they were found.
    pub(crate) fn named_zones(&self) -> &[CaseZone] {
        if self.zone_found { &[] } else { &self.zones }
    }

    /// Its zones were found where there is texture: a node there that lacks it is no reason to refuse the reference.
    pub(crate) fn allow_textureless(&mut self) {
        (self.zone_found, self.options.textureless_share) = (true, 1.0);
    }

    /// The plan as a case file that gives the same result from anywhere on this machine.
    pub fn to_case_file(&self) -> CaseFile {
        CaseFile {
            images: CaseImages {
                reference: Some(files(&self.reference)),
                deformed: Some(files(&self.deformed)),
                page: self.reference.first().map(|frame| frame.page as u32),
                pages: self.deformed.iter().any(|frame| frame.is_page).then_some(Pages::All),
                pixel_size_mm: self.pixel_size.map(PixelSize::mm_per_px),
                max_image_mpx: (self.accepted != Accepted::default()).then_some(self.accepted.max_mpx),
            },
            camera: self.camera.clone(),
            correlation: self.correlation.clone(),
            report: self.setup.clone(),
            zones: resolved_zones(&self.zones),
            ..CaseFile::default()
        }
        .with_drawn(&self.drawn)
    }
}

/// Whether a zone is named beside the case.
fn names_zone(ZoneFlags { roi, polygon, all }: &ZoneFlags) -> bool {
    !roi.is_empty() || !polygon.is_empty() || all.mask.is_some() || all.mesh.is_some()
}

/// The files of frames, by names that hold from anywhere.
pub(crate) fn files(frames: &[Frame]) -> Vec<String> {
    let mut files: Vec<String> = frames.iter().map(|frame| absolute(&frame.path)).collect();
    files.dedup(); // the pages of one file
    files
}

/// Refuses an update of the reference where frames or elements do not allow any.
fn may_be_updated(update: UpdateReference, options: &Options, has_shard: bool) -> Result<()> {
    if update == UpdateReference::Never {
        return Ok(());
    }
    if options.elements == Elements::CubicSpline {
        return Err(format!(
            "--update-reference {update} does not go with --elements cubic-spline: a new reference has a mesh that the specimen \
             has deformed, and splines need a regular one; leave one of them out"
        )
        .into());
    }
    if options.start == StartFrom::Independent {
        let why = if has_shard { "--shard" } else { "--start independent" };
        return Err(format!(
            "--update-reference {update} does not go with {why}: a reference is made of the frames before, one after the \
             other; leave one of them out"
        )
        .into());
    }
    Ok(())
}

/// The section `[correlation]` that is asked for, with its defaults, and the regularisation that it comes to.
fn correlation_of(asked: &Request, case: &CaseFile) -> Result<(CaseCorrelation, Regularisation)> {
    let (flags, file) = (&asked.correlation, &case.correlation);
    let mut given = over(flags, file)?;
    // A kind given as a flag leaves aside what the case file says for another kind.
    if flags.regularisation.is_some_and(|kind| file.regularisation != Some(kind)) {
        given.poisson = flags.poisson;
    }
    if flags.regularisation == Some(RegularisationKind::None) {
        given.cutoff_px = flags.cutoff_px;
    }
    if asked.shard.is_some() {
        given.start.get_or_insert(StartFrom::Independent);
    }
    let regularisation = regularisation(&given)?;
    let poisson = match regularisation {
        Regularisation::EquilibriumGap { poisson, .. } => Some(poisson),
        _ => None,
    };
    Ok((CaseCorrelation { poisson, ..complete(&given)? }, regularisation))
}

fn options_of(
    given: &CaseCorrelation,
    regularisation: Regularisation,
    case: &CaseFile,
    n_references: usize,
) -> Result<Options> {
    let default = Options::default();
    Ok(Options {
        n_references,
        element_size: given.element_size_px.map_or(default.element_size, |size| size as usize),
        element_share: given.element_share.unwrap_or(default.element_share),
        interpolation: given.interpolation.unwrap_or_default(),
        tolerance_px: given.tolerance_px.unwrap_or(default.tolerance_px),
        max_iterations: given.max_iterations.map_or(default.max_iterations, |n| n as usize),
        brightness: given.brightness.unwrap_or_default(),
        start: given.start.unwrap_or_default(),
        noise: given.noise.unwrap_or_default(),
        noise_correlation: given.noise_correlation.unwrap_or_default(),
        sigma_most_px: given.sigma_most_px.unwrap_or(default.sigma_most_px),
        drop_textureless: given.drop_textureless.unwrap_or(default.drop_textureless),
        elements: given.elements.unwrap_or_default(),
        // The edges of an opening are the faces of a joint.
        whole_borders: case.openings.iter().flat_map(|opening| opening.zones.clone()).collect(),
        regularisation,
        ..default
    })
}

/// What images may be.
/// Errors: a number of pixels that cannot be counted.
pub(crate) fn accepted_images(images: &CaseImages) -> Result<Accepted> {
    let most = Accepted::MOST_MPX;
    match images.max_image_mpx {
        None => Ok(Accepted::default()),
        Some(max_mpx) if (1..=most).contains(&max_mpx) => Ok(Accepted { max_mpx, size: None }),
        Some(wrong) => Err(format!("the most pixels of an image are {wrong} million; give 1 to {most}").into()),
    }
}

/// The window of that many nodes; none for 1.
///
/// # Errors
/// A number that is even or too large.
pub fn strain_window(nodes: Option<u32>) -> Result<Option<StrainWindow>> {
    match nodes {
        None | Some(1) => Ok(None),
        Some(nodes) => Ok(Some(StrainWindow::new(nodes).ok_or_else(|| {
            let most = StrainWindow::MOST;
            format!("the strain window is {nodes} nodes; give an odd number from 3 to {most}, such as 5, or 1 for none")
        })?)),
    }
}

fn regularisation(
    &CaseCorrelation { regularisation, cutoff_px, poisson, .. }: &CaseCorrelation,
) -> Result<Regularisation> {
    let kind = regularisation.unwrap_or_default();
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

/// What the case draws from the fields, with load files that are found from anywhere.
fn quantities_of(case: &CaseFile) -> CaseQuantities {
    let mut drawn = case.drawn();
    if let Some(load) = &mut drawn.load {
        let found = |file: &String| absolute(Path::new(file));
        load.file = Some(&load.file).filter(|file| !file.is_empty()).map(found).unwrap_or_default();
        load.frame_times = load.frame_times.as_ref().map(found);
    }
    drawn
}

/// Which images a run takes.
#[derive(Debug)]
pub struct Images {
    /// The reference, or several whose mean is taken.
    pub reference: Vec<Frame>,
    /// The deformed images, in order.
    pub deformed: Vec<Frame>,
    /// Whether there are more to come.
    pub grows: bool,
    /// What there is to say of their names: the order they make, files left out, two cameras.
    pub said: Vec<Remark>,
}

/// The files of the reference that is named; none when none is.
pub fn references(asked: &Request, case: &CaseFile) -> Result<Vec<PathBuf>> {
    Ok(match (&asked.images.reference, &case.images.reference) {
        (Some(named), _) => expand_references(named, Path::new(""))?,
        (None, named) => expand_references(named.as_deref().unwrap_or(&[]), &case.base)?,
    })
}

impl Images {
    fn of(asked: &Request, case: &CaseFile) -> Result<Self> {
        let wanted = over(&asked.images, &case.images)?;
        let (patterns, base) = match (&asked.images.deformed, &case.images.deformed) {
            (Some(named), _) => (named.as_slice(), Path::new("")),
            (None, named) => (named.as_deref().unwrap_or(&[]), case.base.as_path()),
        };
        let mut deformed = expand_series(patterns, base)?;
        let left_out = which_reference::without_texts(&mut deformed);
        let said = which_reference::about_names(&deformed, &left_out, &but_for_capitals(patterns, base))?;
        let mut reference = references(asked, case)?;
        if reference.is_empty() {
            which_reference::check(&deformed)?;
            let Some(first) = deformed.first() else {
                return Err("no image is given; name the reference and the deformed images, or a --case file".into());
            };
            reference.push(first.clone());
            // Alone it may be a stack, of which the first page is the reference.
            if deformed.len() > 1 {
                deformed.remove(0);
            }
        }
        let page = wanted.page.map(|page| page as usize);
        let all_pages = wanted.pages == Some(Pages::All);
        let first_page = page.unwrap_or(0);
        let mut frames = match deformed.as_slice() {
            files if all_pages => Frame::pages(files, pages_of)?,
            // A stack alone is a series, unless one page of it is asked for.
            [file] if page.is_none() => Frame::pages(std::slice::from_ref(file), pages_of)?,
            _ => Vec::new(),
        };
        if !frames.iter().any(|frame| frame.is_page) {
            frames = deformed.into_iter().map(|path| Frame::file(path, first_page)).collect();
        }
        // A glob over the folder takes the reference along: it is no deformed image, unless it was named for one.
        let absolute = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let taken: Vec<PathBuf> = reference.iter().map(|path| absolute(path)).collect();
        let named_alone = frames.len() == 1 && wanted.reference.is_some();
        frames.retain(|frame| named_alone || frame.page != first_page || !taken.contains(&absolute(&frame.path)));
        let is_page = |path: &Path| frames.iter().any(|frame| frame.is_page && absolute(&frame.path) == absolute(path));
        let reference: Vec<Frame> =
            reference.into_iter().map(|path| Frame { is_page: is_page(&path), path, page: first_page }).collect();
        if frames.is_empty() {
            let named = left_out.iter().chain(reference.iter().map(|frame| &frame.path));
            if let Some(foreign) = named.into_iter().find_map(|path| ReadError::of_foreign(path)) {
                return Err(foreign.into());
            }
            let name = reference.first().map(Frame::to_string).unwrap_or_default();
            return Err(format!("{name}: only a reference image was given; add at least one deformed image").into());
        }
        Ok(Self { reference, deformed: frames, grows: false, said })
    }
}

/// What the section `[run]` of an earlier start says under `key`.
fn read_recorded(header: &StoreHeader, key: &str) -> Option<toml::Value> {
    header.case.parse::<toml::Table>().ok()?.get("run")?.get(key).cloned()
}

/// The instruction path of an earlier start, when this machine has it.
fn isa_of(header: &StoreHeader) -> Option<Isa> {
    Isa::named(read_recorded(header, "isa")?.as_str()?)
}

/// Whether an earlier start wrote CSV and VTU files.
fn tables_of(header: &StoreHeader) -> Option<(bool, bool)> {
    let names = read_recorded(header, "export")?;
    let has = |name: &str| names.as_array().is_some_and(|names| names.iter().any(|one| one.as_str() == Some(name)));
    Some((has("csv"), has("vtu")))
}
