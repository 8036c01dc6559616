//! Quantities of a series: from what is asked for to the tables in `DIR/quantities`.

use crate::camera::{CameraError, Rectifier};
use crate::field::{
    CrackLine, Elasticity, Extensometer, Facing, FrameQuantities, Gauge, Measurement, Quantities, Region, RemoveRigid,
    Segment, Status, StrainDefinition, StrainWindow, TensionGauges, TensionOptions,
};
use crate::io::case::{CaseCamera, CaseLoad, CaseQuantities, CaseRegion, CaseTension, ImageAxis, parse_case};
use crate::io::load::{LoadTable, read_as_asked};
use crate::io::quantities::{QUANTITY_TABLES, QuantityPlane, QuantitySummary, QuantityTables};
use crate::io::store::{STORE, Store};
use crate::mesh::Mesh;
use crate::run::folder::record::Record;
use crate::run::plan::wanted::wanted_camera;
use crate::run::words::{Result, RunError};
use crate::units::{PixelSize, Px};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;
use std::rc::Rc;

pub(crate) const FOLDER: &str = "quantities";

/// A store as the camera of a file sees it; of the camera of the run what is no number of it stays.
pub(crate) fn seen_by(store: Store, file: &str) -> Result<Store> {
    let case = parse_case(&store.header().case, Path::new(STORE))?;
    let asked = CaseCamera { file: Some(file.to_owned()), ..CaseCamera::default() };
    let camera = wanted_camera(&asked, &case)?.unwrap_or_default();
    Ok(store.seen_by(&camera)?)
}

/// What is asked for, on a mesh, in the plane that the camera sees: places are named in px of the image.
/// Errors: numbers that mean nothing, names that come twice, zones that are not there or do not face each other, an
/// opening while the motion of each zone is removed.
pub(crate) fn resolve(
    asked: &CaseQuantities,
    strain: StrainDefinition,
    pixel_size: Option<PixelSize>,
    camera: &Rectifier,
) -> Result<Quantities> {
    let (raw, mesh) = (camera.raw_mesh(), camera.mesh());
    let place = |[x, y]: [f64; 2]| match [x, y].iter().all(|v| v.is_finite()) {
        true => camera.camera().plane([x, y]).ok_or(CameraError::Folds { x, y }),
        false => Ok([x, y]),
    };
    let named =
        |name: &Option<String>, kind: &str, at: usize| name.clone().unwrap_or_else(|| format!("{kind}{}", at + 1));
    let rate_window_s = asked.options.rate_window_s;
    if let Some(window) = rate_window_s.filter(|window| !(window.is_finite() && *window > 0.0)) {
        return Err(format!("--rate-window (rate_window_s) is {window}; give seconds above 0").into());
    }
    let poisson = asked.options.nu;
    if let Some(nu) = poisson.filter(|nu| !(-1.0..=0.5).contains(nu)) {
        return Err(format!("--poisson (nu) is {nu}; Poisson's ratio is from -1 to 0.5").into());
    }
    let remove_rigid = asked.options.remove_rigid;
    let mut quantities = Quantities { strain, poisson, rate_window_s, remove_rigid, ..Quantities::default() };
    for (at, probe) in asked.probes.iter().enumerate() {
        let name = named(&probe.name, "point", at);
        if let Some(value) = probe.point.iter().find(|value| !value.is_finite()) {
            return Err(format!("{name}: a coordinate is {value}; give a finite number").into());
        }
        quantities.points.push((name, place(probe.point)?));
    }
    for (at, line) in asked.lines.iter().enumerate() {
        let name = named(&line.name, "line", at);
        let step = line.step_px.unwrap_or(0.25 * mesh.element_size());
        let segment =
            Segment::new(place(line.from)?, place(line.to)?, step).map_err(|error| format!("{name}: {error}"))?;
        quantities.lines.push((name, segment));
    }
    for (at, gauge) in asked.extensometers.iter().enumerate() {
        let name = named(&gauge.name, "extensometer", at);
        let width = gauge.width_px.unwrap_or(0.0);
        let gauge = Extensometer::new(place(gauge.from)?, place(gauge.to)?, width)
            .map_err(|error| format!("{name}: {error}"))?;
        quantities.extensometers.push((name, gauge));
    }
    for (at, region) in asked.regions.iter().enumerate() {
        let name = region.name.clone().or_else(|| region.zone.clone());
        let name = named(&name, "region", at);
        let made = region_of(region, mesh, place).map_err(|error| format!("region '{name}': {error}"))?;
        quantities.regions.push((name, made));
    }
    for opening in &asked.openings {
        let [plus, minus] = &opening.zones;
        let name = opening.name.clone().unwrap_or_else(|| format!("{plus}-{minus}"));
        if asked.options.remove_rigid == Some(RemoveRigid::Zone) {
            return Err(format!(
                "opening '{name}': nothing is left of it when the rigid motion of each zone is removed; remove that of all \
                 together, or none"
            )
            .into());
        }
        let facing = Facing::between(mesh, plus, minus).map_err(|error| format!("opening '{name}': {error}"))?;
        quantities.openings.push((name, facing));
    }
    for (at, crack) in asked.cracks.iter().enumerate() {
        let name = named(&crack.name, "crack", at);
        if asked.options.remove_rigid == Some(RemoveRigid::Zone) && mesh.zones().len() > 1 {
            return Err(format!(
                "crack '{name}': the rigid motion of each zone is removed, which changes what lies between zones; remove that of all \
                 together, or none"
            )
            .into());
        }
        let elasticity = crack.young_mpa.zip(crack.poisson).zip(pixel_size).map(|((young_mpa, poisson), size)| {
            Elasticity { young_mpa, poisson, mm_per_unit: size.mm_per_px(), radius: crack.radius_px }
        });
        let line = match crack.path.points() {
            Some(path) => CrackLine::on(raw, path.to_vec(), elasticity)
                .and_then(|crack| crack.placed(|at| camera.camera().plane(at)))
                .ok_or_else(|| format!("crack '{name}': the mesh of this run is not cut along it"))?,
            None => {
                let what = "\"auto\" is found when images are correlated; give the path that this said, as it stands in run.toml";
                return Err(format!("crack '{name}': {what}").into());
            }
        };
        quantities.cracks.push((name, line));
    }
    fn once<T>(what: &str, list: &[(String, T)]) -> Result<()> {
        let mut seen = BTreeSet::new();
        let twice = list.iter().find(|(name, _)| !seen.insert(name));
        twice.map_or(Ok(()), |(name, _)| Err(format!("two {what} are named '{name}'; names must differ").into()))
    }
    once("points", &quantities.points)?;
    once("lines", &quantities.lines)?;
    once("extensometers", &quantities.extensometers)?;
    once("regions", &quantities.regions)?;
    once("openings", &quantities.openings)?;
    once("cracks", &quantities.cracks)?;
    quantities.tension = match &asked.tension {
        Some(tension) => Some(tension_of(tension, asked.load.as_ref(), &quantities)?),
        None => None,
    };
    Ok(quantities)
}

/// The gauges of a tensile test among `quantities`.
fn tension_of(asked: &CaseTension, load: Option<&CaseLoad>, quantities: &Quantities) -> Result<TensionGauges> {
    let refused = |key: &str, what: String| RunError::from(format!("[tension] {key}: {what}"));
    let Quantities { extensometers, regions, .. } = quantities;
    let gauge = |key: &str, name: &String| {
        let extensometer = extensometers.iter().position(|(own, _)| own == name).map(Gauge::Extensometer);
        let found = extensometer.or_else(|| regions.iter().position(|(own, _)| own == name).map(Gauge::Region));
        let names = || extensometers.iter().map(|of| &of.0).chain(regions.iter().map(|of| &of.0));
        let there = || names().cloned().collect::<Vec<_>>().join(", ");
        found
            .ok_or_else(|| refused(key, format!("there is no extensometer or region '{name}'; there are: {}", there())))
    };
    let first = || match (extensometers.is_empty(), regions.is_empty()) {
        (false, _) => Ok(Gauge::Extensometer(0)),
        (true, false) => Ok(Gauge::Region(0)),
        _ => Err(refused("along", "strains need an [[extensometer]] or a [[region]]; give one".to_owned())),
    };
    let along = asked.along.as_ref().map_or_else(first, |name| gauge("along", name))?;
    let across = asked.across.as_ref().map(|name| gauge("across", name)).transpose()?;
    let least = TensionOptions::default();
    let rising = |key: &str, range: [f64; 2]| match range[0] < range[1] && range.iter().all(|v| v.is_finite()) {
        true => Ok(range),
        false => {
            Err(refused(key, format!("{} to {} is no range; give a smaller and a larger strain", range[0], range[1])))
        }
    };
    let positive = |key: &str, value: Option<f64>| match value {
        Some(value) if !(value.is_finite() && value > 0.0) => {
            Err(refused(key, format!("it is {value}; give a number above 0")))
        }
        value => Ok(value),
    };
    let area = load.and_then(|load| load.area_mm2);
    let by_area = |key: &str, value: Option<f64>, default: f64| match (positive(key, value)?, area) {
        (Some(value), Some(area)) => Ok(value / area),
        (None, _) => Ok(default),
        (Some(_), None) => Err(refused(key, "the area is not known; give area_mm2 in [load]".to_owned())),
    };
    let options = TensionOptions {
        modulus_range: rising("modulus_range", asked.modulus_range.unwrap_or(least.modulus_range))?,
        proof_strain: positive("proof_strain", asked.proof_strain)?.unwrap_or(least.proof_strain),
        r_range: rising("r_range", asked.r_range.unwrap_or(least.r_range))?,
        stress_std_mpa: by_area("load_N_std", asked.load_n_std, least.stress_std_mpa)?,
        area_relative_std: by_area("area_mm2_std", asked.area_mm2_std, least.area_relative_std)?,
        ..least
    };
    let axis = asked.axis.map(|axis| match axis {
        ImageAxis::X => 0,
        ImageAxis::Y => 1,
    });
    Ok(TensionGauges { along, across, axis: axis.or_else(|| axis_of_gauges(along, across, extensometers)), options })
}

/// Direction of the load for a region beside an extensometer: where that lies along it, or across it.
fn axis_of_gauges(along: Gauge, across: Option<Gauge>, extensometers: &[(String, Extensometer)]) -> Option<usize> {
    let direction = |k: usize| {
        let [[x0, y0], [x1, y1]] = extensometers.get(k)?.1.ends();
        Some(usize::from((y1 - y0).abs() > (x1 - x0).abs()))
    };
    match (along, across) {
        (Gauge::Extensometer(k), Some(Gauge::Region(_))) => direction(k),
        (Gauge::Region(_), Some(Gauge::Extensometer(k))) => direction(k).map(|along| 1 - along),
        _ => None,
    }
}

/// A region, whose corners are placed in the plane.
fn region_of(
    region: &CaseRegion,
    mesh: &Mesh<Px>,
    place: impl Fn([f64; 2]) -> std::result::Result<[f64; 2], CameraError>,
) -> Result<Region> {
    let corners = match (&region.roi, &region.polygon, &region.zone) {
        (None, None, Some(name)) => {
            let zone = mesh.zones().iter().position(|zone| zone == name);
            let zones = mesh.zones().join(", ");
            return Ok(Region::of_zone(
                zone.ok_or_else(|| format!("there is no zone '{name}'; the zones are {zones}"))?,
            ));
        }
        (&Some([x0, y0, x1, y1]), None, None) => vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]],
        (None, Some(polygon), None) => polygon.clone(),
        _ => return Err("give one of roi, polygon and zone".into()),
    };
    let corners = corners.into_iter().map(place).collect::<std::result::Result<_, _>>()?;
    Ok(Region::within(corners).map_err(|error| error.to_string())?)
}

/// Whether there is something to be drawn: what is asked for, or what still zones show.
pub(crate) fn is_drawn(asked: &CaseQuantities, camera: &Rectifier) -> bool {
    !asked.is_empty() || camera.has_still()
}

/// The load file that is asked for, a row for each frame; nothing without one.
/// Errors: a file that cannot be read or joined, times that are missing or given twice.
pub(crate) fn load(asked: &CaseQuantities, n_frames: usize) -> Result<LoadTable> {
    let load = asked.load.as_ref().map_or_else(|| Ok(LoadTable::default()), |load| read_as_asked(load, n_frames))?;
    if asked.options.rate_window_s.is_some() && load.times().is_none() {
        return Err("--rate-window needs the times of the frames; give --frame-interval S, --frame-times FILE, or a load file with \
                    a column in s"
            .into());
    }
    Ok(load)
}

/// What the fields of a run are like.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fields<'a> {
    /// Lines for the head of every table: program, images, options.
    pub header: &'a [String],
    /// How the camera sees the plane.
    pub camera: &'a Rectifier,
    pub pixel_size: Option<PixelSize>,
    /// Its relative standard uncertainty.
    pub pixel_size_std: f64,
    /// Images whose mean is the reference.
    pub n_references: usize,
    pub element_size_px: f64,
    /// Whether a regularisation or splines bind the nodes to each other: standard uncertainties are then upper bounds.
    pub regularised: bool,
}

/// A frame on its way to the tables: number, status and field, when they exist.
pub(crate) type Frame = (usize, Option<Status>, Option<Measurement<Px>>);

/// Writes the tables of `quantities` into `folder/quantities`, and removes the tables of an earlier call that are not
/// asked for any more. Each frame is shown to `look` with what was drawn from it.
///
/// Under another name and renamed in the end, so that a table is there whole or not at all.
pub(crate) fn write(
    folder: &Path,
    quantities: &Quantities,
    load: &LoadTable,
    fields: Fields<'_>,
    frames: impl Iterator<Item = Result<Frame>>,
    mut look: impl FnMut(usize, &FrameQuantities),
) -> Result<QuantitySummary> {
    let folder = folder.join(FOLDER);
    let failed = |error: std::io::Error| RunError::file(&folder, "written", error);
    fs::create_dir_all(&folder).map_err(failed)?;
    let unfinished = |name: &str| folder.join(format!("{name}.csv.part"));
    let write = || -> Result<QuantitySummary> {
        let open = |name: &str| Ok(BufWriter::new(File::create(unfinished(name))?));
        let Fields { header, camera, pixel_size, pixel_size_std, n_references, element_size_px, regularised } = fields;
        let camera = &camera.only(quantities.nodes(camera.mesh()));
        let plane = QuantityPlane { camera: Some(camera), pixel_size, pixel_size_std, n_references };
        let tables = QuantityTables::new(quantities, load, plane, regularised, element_size_px, header, open);
        let mut tables = tables.map_err(failed)?;
        for frame in frames {
            let (number, status, field) = frame?;
            let plane = field.as_ref().map(|field| camera.rectify(field));
            let still = field.as_ref().and_then(|field| camera.still_motion(field));
            if let Some(drawn) = tables.frame(number, status, plane.as_deref(), still).map_err(failed)? {
                look(number, &drawn);
            }
        }
        let summary = tables.finish().map_err(failed)?;
        for name in QUANTITY_TABLES {
            let path = folder.join(format!("{name}.csv"));
            match unfinished(name).exists() {
                true => fs::rename(unfinished(name), path).map_err(failed)?,
                false if path.exists() => fs::remove_file(path).map_err(failed)?,
                false => {}
            }
        }
        Ok(summary)
    };
    write().inspect_err(|_| {
        for name in QUANTITY_TABLES {
            let _ = fs::remove_file(unfinished(name)); // what is left of them helps nobody
        }
    })
}

/// What is drawn of one field, a text of CSV for each table by its name.
pub(crate) fn texts(
    quantities: &Quantities,
    fields: Fields<'_>,
    field: &Measurement<Px>,
) -> Result<BTreeMap<String, String>> {
    /// A table in memory.
    #[derive(Default, Clone)]
    struct Kept(Rc<RefCell<Vec<u8>>>);
    impl Write for Kept {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.borrow_mut().write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let failed = |error: std::io::Error| RunError::from(error.to_string());
    let mut kept: BTreeMap<String, Kept> = BTreeMap::new();
    let Fields { header, camera, pixel_size, pixel_size_std, n_references, element_size_px, regularised } = fields;
    let plane = QuantityPlane { camera: Some(camera), pixel_size, pixel_size_std, n_references };
    let load = LoadTable::default();
    let open = |name: &str| Ok(kept.entry(name.to_owned()).or_default().clone());
    let tables = QuantityTables::new(quantities, &load, plane, regularised, element_size_px, header, open);
    let mut tables = tables.map_err(failed)?;
    let measured = Some(field).filter(|field| field.status.has_field());
    let still = measured.and_then(|field| camera.still_motion(field));
    let plane = measured.map(|field| camera.rectify(field));
    tables.frame(1, Some(field.status), plane.as_deref(), still).map_err(failed)?;
    tables.finish().map_err(failed)?;
    Ok(kept.into_iter().map(|(name, kept)| (name, String::from_utf8_lossy(&kept.0.borrow()).into_owned())).collect())
}

/// Removes the tables of an earlier call from `folder/quantities`, and nothing else.
pub(crate) fn remove(folder: &Path) -> Result<()> {
    let folder = folder.join(FOLDER);
    for path in QUANTITY_TABLES.map(|name| folder.join(format!("{name}.csv"))).into_iter().filter(|path| path.exists())
    {
        fs::remove_file(&path).map_err(|error| RunError::file(&path, "removed", error))?;
    }
    let _ = fs::remove_dir(folder); // stays when it holds something else
    Ok(())
}

/// Draws what is `asked` for from the frames `numbers` of a store into `output/quantities`; each frame is shown to
/// `look`. For `quadrille probe`, and for `quadrille correlate` when a series is done.
pub(crate) fn write_of_store(
    store: &Store,
    asked: &CaseQuantities,
    (strain, window): (Option<StrainDefinition>, Option<Option<StrainWindow>>),
    numbers: &[usize],
    output: &Path,
    look: impl FnMut(usize, &FrameQuantities),
) -> Result<QuantitySummary> {
    let header = store.header();
    let camera = &Rectifier::new(header.camera()?, store.mesh())?;
    let quantities = Quantities {
        window: window.unwrap_or(header.strain_window),
        ..resolve(asked, strain.unwrap_or(header.strain), header.pixel_size, camera)?
    };
    let load = load(asked, store.n_frames())?;
    let mut lines = vec![
        format!("quadrille {}: quantities of the fields of {}", env!("CARGO_PKG_VERSION"), store.path().display()),
        format!("fields by quadrille {}, {}", header.quadrille, header.device),
        format!("reference: {}", header.reference.join(", ")),
    ];
    if let Some(load) = asked.load.as_ref().filter(|load| !load.file.is_empty()) {
        lines.push(format!("load file: {}", load.file));
    }
    lines.extend(load.remarks.iter().map(|remark| remark.text.clone()));
    let fields = Fields {
        header: &lines,
        camera,
        pixel_size: header.pixel_size,
        pixel_size_std: header.pixel_size_std(),
        n_references: header.reference.len(),
        element_size_px: header.element_size_px,
        regularised: Record::of(header).is_regularised(),
    };
    let frames = numbers.iter().map(|&number| -> Result<Frame> {
        let status = store.status(number)?;
        let field = match status.is_some_and(|status| status.has_field()) {
            true => store.frame(number)?.map(|frame| frame.measurement),
            false => None,
        };
        Ok((number, status, field))
    });
    write(output, &quantities, &load, fields, frames, look)
}
