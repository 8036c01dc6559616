//! Zones, cracks and the camera that a request and a case file ask for together.

use crate::io::case::{CaseCamera, CaseCrack, CaseFile, CaseImages, CaseZone, CrackFlags, CrackPath, ZoneFlags, over};
use crate::run::words::{Result, absolute};
use crate::units::PixelSize;
use std::path::Path;

/// The cracks that are asked for, by flags or by the case.
pub(crate) fn wanted_cracks(
    CrackFlags { path, all }: &CrackFlags,
    case: &CaseFile,
    pixel_size: Option<PixelSize>,
) -> Result<Vec<CaseCrack>> {
    let mut cracks: Vec<CaseCrack> = match path.is_empty() {
        true => case.cracks.clone(),
        false => path.iter().map(|path| CaseCrack { path: path.clone(), ..CaseCrack::default() }).collect(),
    };
    let is_given = *all != CaseCrack::default();
    if is_given && cracks.is_empty() {
        return Err("an option of cracks, such as --crack-guard, is given but no crack; draw one with --crack 'x,y x,y ...', or \
                    leave it out"
            .into());
    }
    if cracks.iter().filter(|crack| crack.path == CrackPath::Auto).count() > 1 {
        return Err("--crack auto (path = \"auto\") is given twice; once finds them all".into());
    }
    for (at, crack) in cracks.iter_mut().enumerate() {
        if is_given {
            *crack = over(all, crack)?;
        }
        let name = crack.name.clone().unwrap_or_else(|| format!("crack{}", at + 1));
        let wrong = |what: String| -> Result<Vec<CaseCrack>> { Err(format!("{name}: {what}").into()) };
        match (crack.young_mpa, crack.poisson, pixel_size) {
            (Some(young), ..) if !(young.is_finite() && young > 0.0) => {
                return wrong(format!("Young's modulus is {young} MPa; give a positive number"));
            }
            (_, Some(nu), _) if !(-1.0..=0.5).contains(&nu) || nu == -1.0 => {
                return wrong(format!("Poisson's ratio is {nu}; give a number above -1, up to 0.5"));
            }
            (Some(_), None, _) | (None, Some(_), _) => {
                return wrong(
                    "stress intensity needs Young's modulus and Poisson's ratio together; give both or none".into(),
                );
            }
            (Some(_), _, None) => {
                return wrong(
                    "stress intensity needs the size of a pixel; give --pixel-size MM or pixel_size_mm".into(),
                );
            }
            _ => {}
        }
        if let Some(radius) = crack.radius_px
            && !(radius.is_finite() && radius > 0.0)
        {
            return wrong(format!("the radius of its domain is {radius} px; give a positive number"));
        }
    }
    Ok(cracks)
}

/// The zones that are asked for, with file names that hold from the current folder.
pub(crate) fn wanted_zones(ZoneFlags { roi, polygon, all }: &ZoneFlags, case: &CaseFile) -> Vec<CaseZone> {
    let of_roi = roi.iter().map(|&roi| CaseZone { roi: Some(roi), ..CaseZone::default() });
    let of_polygon = polygon.iter().map(|polygon| CaseZone { polygon: Some(polygon.clone()), ..CaseZone::default() });
    let mut zones: Vec<CaseZone> = of_roi.chain(of_polygon).collect();
    if all.mask.is_some() {
        if zones.is_empty() {
            zones.push(CaseZone::default());
        }
        zones.iter_mut().for_each(|zone| zone.mask.clone_from(&all.mask));
    }
    if all.mesh.is_some() {
        zones.push(CaseZone { mesh: all.mesh.clone(), ..CaseZone::default() });
    }
    if zones.is_empty() {
        zones.clone_from(&case.zones);
        for zone in &mut zones {
            for file in [&mut zone.mask, &mut zone.mesh].into_iter().flatten() {
                *file = case.resolve(file).display().to_string();
            }
        }
    }
    if all.guard_px.is_some() {
        zones.iter_mut().for_each(|zone| zone.guard_px.clone_from(&all.guard_px));
    }
    zones
}

/// Zones as a case file has them, with names and with file names that hold from anywhere.
pub(crate) fn resolved_zones(wanted: &[CaseZone]) -> Vec<CaseZone> {
    let file = |name: &Option<String>| name.as_ref().map(|name| absolute(Path::new(name)));
    let complete = |(at, zone): (usize, &CaseZone)| CaseZone {
        // The zones of a mesh file have its names, unless one is given.
        name: zone.name.clone().or_else(|| zone.mesh.is_none().then(|| zone.name_at(at))),
        mask: file(&zone.mask),
        mesh: file(&zone.mesh),
        ..zone.clone()
    };
    wanted.iter().enumerate().map(complete).collect()
}

/// The camera that is asked for, or else that of the case, with the numbers of its file.
pub(crate) fn wanted_camera(asked: &CaseCamera, case: &CaseFile) -> Result<Option<CaseCamera>> {
    let section = case.camera.clone().unwrap_or_default();
    let camera = match &asked.file {
        // Another camera: of the case what is no number of it.
        Some(_) => {
            let CaseCamera { exact, distance_std, telecentric, still, .. } = section;
            CaseCamera { exact, distance_std, telecentric, still, ..asked.clone() }.resolved(Path::new(""))?
        }
        None => section.resolved(&case.base)?,
    };
    Ok((camera != CaseCamera::default()).then_some(camera))
}

/// The size of a pixel that the images state, or their camera.
pub(crate) fn wanted_pixel_size(images: &CaseImages, camera: Option<&CaseCamera>) -> Result<Option<f64>> {
    let of_camera = camera.and_then(|camera| camera.pixel_size_mm);
    match (images.pixel_size_mm, of_camera) {
        (Some(own), Some(other)) if (own - other).abs() > 1e-9 * other.abs() => Err(format!(
            "the pixel size is {own} mm, that of the camera {other} mm; state one of them, as it is at this distance"
        )
        .into()),
        (own, other) => Ok(own.or(other)),
    }
}
