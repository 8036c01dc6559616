//! The zones of a plan on the reference image: masks and mesh files are read here.

use crate::camera::Camera;
use crate::imaging::Image;
use crate::io::case::{CaseCrack, CaseElements, CaseGuard, CaseInMm, CaseZone};
use crate::io::mask::read_mask;
use crate::io::mesh_file::read_mesh;
use crate::mesh::{Crack, Guard, Mask, MeshError, Zone, ZoneElements};
use crate::remark::Remark;
use crate::run::plan::Plan;
use crate::run::plan::found::Found;
use crate::run::words::Result;
use crate::run::words::remarks::{of_zone_file, zones_found};
use crate::units::PixelSize;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Zones with what is worth knowing about the files that they come from.
#[derive(Debug, Default)]
pub(crate) struct Zones {
    pub zones: Vec<Zone>,
    /// What a user should know about masks and mesh files, each with its file.
    pub remarks: Vec<Remark>,
    /// Masks and mesh files with their SHA-256.
    pub files: Vec<(PathBuf, String)>,
    /// Zones that were looked for, since none was named.
    pub found: Option<Found>,
}

impl Zones {
    /// The zones of `plan`; when it has none, it gets those where `reference` shows the specimen, whose masks will lie
    /// in `folder`.
    pub fn of(plan: &mut Plan, reference: &Image, folder: &Path) -> Result<Self> {
        if !plan.zones.is_empty() {
            return Self::on(plan, [reference.width(), reference.height()]);
        }
        let found = Found::on(reference, plan, folder)?;
        plan.zones.clone_from(&found.cases);
        plan.allow_textureless();
        let (zones, files) = (found.zones.clone(), found.files());
        let remarks = vec![zones_found(found.note.clone())];
        Ok(Self { zones, remarks, files, found: Some(found) })
    }

    /// The zones that `plan` names, on an image of `width` x `height` px.
    pub(crate) fn on(plan: &Plan, [width, height]: [usize; 2]) -> Result<Self> {
        let (wanted, size) = (&plan.zones, plan.options.element_size);
        let mut found = Self::default();
        let mut masks: HashMap<PathBuf, Arc<Mask>> = HashMap::new();
        for (at, zone) in wanted.iter().enumerate() {
            let name = zone.name_at(at);
            let drawing = Drawing::of(zone, &name, plan, [width, height])?;
            let zone = &drawing.as_ref().map_or_else(|| Ok(zone.clone()), |drawing| drawing.outline(zone))?;
            let mut region = Zone {
                name: name.clone(),
                roi: zone.rectangle(),
                polygon: zone.polygon.clone().unwrap_or_default(),
                exclude: zone.exclude.clone().unwrap_or_default(),
                mask: None,
                elements: None,
                guard: guard_of(&name, zone)?,
                cracks: Vec::new(),
            };
            if zone.polygon.as_ref().is_some_and(Vec::is_empty) {
                return Err(
                    format!("zone '{name}': a polygon of 0 corners encloses nothing; give three or more").into()
                );
            }
            if let Some(file) = &zone.mask {
                let path = PathBuf::from(file);
                let mask = match masks.get(&path) {
                    Some(mask) => Arc::clone(mask),
                    None => found.mask(&path, width, height)?,
                };
                masks.insert(path, Arc::clone(&mask));
                region.mask = Some(mask);
            }
            match &zone.mesh {
                Some(_) if zone.elements.is_some() => {
                    let what = "has elements = \"mapped\" and a mesh file; leave one of them out";
                    return Err(format!("zone '{name}' {what}").into());
                }
                Some(file) => found.mesh(Path::new(file), zone, &region, drawing.as_ref())?,
                None if zone.group.is_some() => {
                    return Err(format!("zone '{name}' has a group but no mesh; name the mesh file").into());
                }
                None if region.roi.is_none() && region.is_rectangle() => {
                    return Err(format!("zone '{name}' has no roi = [x0, y0, x1, y1], no polygon, mask or mesh").into());
                }
                None => {
                    if zone.elements == Some(CaseElements::Mapped) {
                        region.elements =
                            Some(Arc::new(map_polygon(&region, size).map_err(|error| error.to_string())?));
                    }
                    found.zones.push(region);
                }
            }
        }
        Ok(found)
    }

    fn mask(&mut self, path: &Path, width: usize, height: usize) -> Result<Arc<Mask>> {
        let loaded = read_mask(path, width, height)?;
        let percent = 100.0 * loaded.share;
        let white = of_zone_file(path, &format!("{percent:.1} % of the image is white"));
        self.remarks.push(white.with("white_percent", percent));
        self.remarks.extend(loaded.notes.iter().map(|note| of_zone_file(path, note)));
        self.files.push((path.to_owned(), loaded.sha256));
        Ok(Arc::new(loaded.mask))
    }

    /// A zone for each group of a mesh file, or for the one asked for.
    fn mesh(&mut self, path: &Path, wanted: &CaseZone, region: &Zone, drawing: Option<&Drawing>) -> Result<()> {
        let mut file = read_mesh(path)?;
        self.remarks.extend(file.notes.iter().map(|note| of_zone_file(path, note)));
        self.files.push((path.to_owned(), std::mem::take(&mut file.sha256)));
        let groups = match &wanted.group {
            Some(group) => vec![file.group(group, path)?],
            None => file.zones,
        };
        let alone = groups.len() == 1;
        for mut elements in groups {
            if let Some(name) = &wanted.name {
                // One name for several zones: theirs tell them apart.
                elements.name = if alone { name.clone() } else { format!("{name} {}", elements.name) };
            }
            if let Some(drawing) = drawing {
                elements.nodes = drawing.pixels(&elements.nodes)?;
            }
            let name = elements.name.clone();
            self.zones.push(Zone { name, elements: Some(Arc::new(elements)), ..region.clone() });
        }
        Ok(())
    }
}

/// The plane of a zone in mm as the camera sees it.
struct Drawing {
    zone: String,
    camera: Camera,
    scale: PixelSize,
    place: CaseInMm,
}

impl Drawing {
    /// That of a zone in mm; nothing of one in px.
    fn of(zone: &CaseZone, name: &str, plan: &Plan, image: [usize; 2]) -> Result<Option<Self>> {
        let Some(place) = zone.in_mm else { return Ok(None) };
        if !(place.origin_px.iter().all(|v| v.is_finite()) && place.turn_deg.is_finite()) {
            return Err(format!("zone '{name}': in_mm needs finite numbers").into());
        }
        let Some(scale) = plan.pixel_size else {
            return Err(
                format!("zone '{name}' is in mm, but nothing says how large a pixel is; give --pixel-size").into()
            );
        };
        let camera = plan.camera.clone().unwrap_or_default().camera(image).map_err(|error| error.to_string())?;
        Ok(Some(Self { zone: name.to_owned(), camera, scale, place }))
    }

    /// Where points in mm are seen, px.
    fn pixels(&self, points: &[[f64; 2]]) -> Result<Vec<[f64; 2]>> {
        let (sin, cos) = self.place.turn_deg.to_radians().sin_cos();
        let origin = self.camera.plane(self.place.origin_px);
        let origin =
            origin.ok_or_else(|| format!("zone '{}': the camera does not see the origin of in_mm", self.zone))?;
        let pixel = |&[x, y]: &[f64; 2]| {
            let [right, up] = [cos * x - sin * y, sin * x + cos * y].map(|mm| mm / self.scale.mm_per_px());
            self.camera.pixel([origin[0] + right, origin[1] - up])
        };
        Ok(points.iter().map(pixel).collect())
    }

    /// A zone in px with the outline of one in mm; a rectangle becomes a polygon, from its lower left corner on.
    fn outline(&self, zone: &CaseZone) -> Result<CaseZone> {
        let corners = |[x0, y0, x1, y1]: [f64; 4]| vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
        if zone.roi.is_some() && zone.polygon.is_some() {
            return Err(format!("zone '{}' is in mm and has both roi and polygon; give one of them", self.zone).into());
        }
        let outline = zone.polygon.clone().or(zone.roi.map(corners));
        let cut = |polygons: &Vec<Vec<[f64; 2]>>| polygons.iter().map(|polygon| self.pixels(polygon)).collect();
        Ok(CaseZone {
            roi: None,
            polygon: outline.map(|points| self.pixels(&points)).transpose()?,
            exclude: zone.exclude.as_ref().map(cut).transpose()?,
            ..zone.clone()
        })
    }
}

/// Cuts the zones along cracks whose path is known.
/// Errors: a zone with elements of its own.
pub(crate) fn cut(zones: &mut [Zone], cracks: &[CaseCrack]) -> Result<()> {
    if cracks.is_empty() {
        return Ok(());
    }
    for zone in zones {
        if zone.elements.is_some() {
            return Err(MeshError::CrackInOwnElements { zone: zone.name.clone() }.to_string().into());
        }
        let of_case = |crack: &CaseCrack| {
            let path = crack.path.points()?.to_vec();
            Some(Crack { path, guard: crack.guard_px.unwrap_or(Crack::GUARD) })
        };
        zone.cracks = cracks.iter().filter_map(of_case).collect();
    }
    Ok(())
}

/// Elements of `size` px along the sides of the polygon of `zone`.
fn map_polygon(zone: &Zone, size: usize) -> std::result::Result<ZoneElements, MeshError> {
    let not_convex = || MeshError::NotConvex { zone: zone.name.clone() };
    let corners = zone.polygon.as_slice().try_into().map_err(|_| not_convex())?;
    ZoneElements::mapped(&zone.name, corners, size as f64)
}

fn guard_of(name: &str, zone: &CaseZone) -> Result<Guard> {
    Ok(match &zone.guard_px {
        None => Guard::default(),
        Some(CaseGuard::All(guard)) => Guard::All(*guard),
        Some(CaseGuard::Sides(sides)) => Guard::Sides(sides.clone()),
        Some(CaseGuard::Along { along, width }) => Guard::Along { line: along.clone(), width: *width },
        Some(CaseGuard::Rectangle { .. }) if zone.roi.is_none() || zone.polygon.is_some() => {
            let what = "guard_px = { left, top, right, bottom } is for the sides of a roi";
            return Err(format!("zone '{name}': {what}; give one number, or a list with one for each side").into());
        }
        Some(CaseGuard::Rectangle { left, top, right, bottom }) => Guard::Sides(vec![*left, *top, *right, *bottom]),
    })
}
