//! What can be said of a case before it is run: mesh, texture, expected uncertainty, bare borders; and whether it keeps
//! to its folder.

use crate::backend::choice::{Device, DeviceChoice};
use crate::camera::CameraGrid;
use crate::correlate::prepare;
use crate::imaging::Saturation;
use crate::io::case::CrackPath;
use crate::mesh::Roi;
use crate::metrology::{Look, look};
use crate::remark::Remark;
use crate::run::frames::{Reference, about_reference, windows};
use crate::run::look::crack_auto;
use crate::run::plan::{Plan, Zones};
use crate::run::words::remarks::{left_over, of_border, of_grey, of_nodes};
use crate::run::words::{Result, RunError, absolute};
use rayon::ThreadPool;
use std::path::{Component, Path};
use std::sync::Arc;

/// A case looked at before it is run.
#[derive(Debug)]
pub struct Checked {
    /// Zone by zone.
    pub zones: Vec<CheckedZone>,
    /// Places of the nodes, px.
    pub nodes: Vec<[f64; 2]>,
    /// Nodes of the elements.
    pub elements: Vec<[u32; 4]>,
    /// Nodes that the reference has too little texture for.
    pub without_texture: Vec<usize>,
    /// What a run would say of reference and zones.
    pub remarks: Vec<Remark>,
    /// The plane as the camera sees it; none of a plain one.
    pub grid: Option<CameraGrid>,
}

/// A zone of it.
#[derive(Debug)]
pub struct CheckedZone {
    /// Its name.
    pub name: String,
    /// Elements of its mesh.
    pub n_elements: usize,
    /// Nodes of its mesh.
    pub n_nodes: usize,
    /// Nodes of them that the reference has too little texture for.
    pub n_without_texture: usize,
    /// Noise and texture of the largest rectangle around it, or why there is none.
    pub look: std::result::Result<Look, String>,
    /// Median over its nodes of the expected standard uncertainty of a displacement, along x and y, px, with the noise
    /// of `look`.
    pub sigma_px: Option<[f64; 2]>,
}

/// Looks at `plan` as its run will: the same mesh, the same texture check. Cracks that are to be found are left aside.
///
/// # Errors
/// What the run would be refused for before its first frame.
#[expect(clippy::indexing_slicing, reason = "numbers of nodes and zones of one mesh")]
pub fn check(plan: &Plan, pool: &ThreadPool) -> Result<Checked> {
    let mut plan = plan.clone();
    plan.drawn.cracks.retain(|crack| crack.path != CrackPath::Auto);
    let Reference { image, mut remarks, .. } = Reference::of(&plan)?;
    let camera = plan.camera.clone().unwrap_or_default().camera([image.width(), image.height()])?;
    // Masks of zones that are found would lie there; nothing is written here.
    let Zones { mut zones, remarks: of_zones, .. } = pool.install(|| Zones::of(&mut plan, &image, Path::new("")))?;
    let image = Arc::new(image);
    pool.install(|| crack_auto::cut(&mut plan, None, &image, &mut zones))?;
    let cpu = Device::new(&DeviceChoice::Cpu, plan.isa, plan.gpu.clone(), 0)?;
    let prepared = pool.install(|| prepare(&cpu, Arc::clone(&image), &zones, plan.options.clone()));
    let correlator = prepared.map_err(|error| about_reference(&plan, &image, &error))?;
    let reference = correlator.reference();
    let mesh = reference.mesh();
    let without_texture: Vec<usize> = reference.dropped().iter().map(|fault| fault.node).collect();
    let mut kept = vec![true; mesh.n_nodes()];
    without_texture.iter().for_each(|&node| kept[node] = false);
    let unit = reference.unit_sigma();
    let of_zone = |zone: usize| {
        let nodes = mesh.zone_nodes(zone);
        let Roi { x0, y0, x1, y1 } = mesh.bounds(zone);
        let within = |v: f64, n: usize| v.clamp(0.0, n as f64);
        let ([x0, x1], [y0, y1]) =
            ([x0, x1].map(|v| within(v, image.width())), [y0, y1].map(|v| within(v, image.height())));
        let roi = Roi { x0, y0, x1, y1 };
        let look = pool.install(|| look(&image, Some(roi), plan.options.noise.constant())).map_err(|e| e.to_string());
        let median = |component: usize| {
            let mut all: Vec<f64> =
                nodes.clone().filter(|&node| kept[node]).map(|node| unit[node][component]).collect();
            all.sort_by(f64::total_cmp);
            all.get(all.len() / 2).copied()
        };
        let unit = median(0).zip(median(1)).map(|(x, y)| [x, y]);
        let noise = look.as_ref().ok().map(|look| look.noise.sigma_grey);
        CheckedZone {
            name: mesh.zones()[zone].clone(),
            n_elements: mesh.zone_elements(zone).len(),
            n_nodes: nodes.len(),
            n_without_texture: nodes.clone().filter(|&node| !kept[node]).count(),
            sigma_px: unit.zip(noise).map(|(unit, noise)| unit.map(|unit| unit * noise)),
            look,
        }
    };
    remarks.extend(of_grey(&plan.reference_name(), &image, Saturation::of(&image, &windows(mesh))));
    remarks.extend(of_zones);
    remarks.extend(left_over(plan.named_zones(), plan.options.mesh_size()));
    remarks.extend(of_nodes(reference).chain(reference.bare_borders().iter().map(of_border)));
    Ok(Checked {
        zones: (0..mesh.zones().len()).map(of_zone).collect(),
        nodes: mesh.nodes().to_vec(),
        elements: mesh.elements().to_vec(),
        remarks,
        without_texture,
        grid: camera.grid(),
    })
}

/// Refuses a case with the content `text` that names a file outside of `folder`, its own folder: by an absolute name,
/// by `..`, or through a link. Files that a pattern gives are those of `plan`.
///
/// # Errors
/// The first such name.
pub fn keeps_to(folder: &Path, text: &str, plan: Option<&Plan>) -> Result<()> {
    let beyond = |name: &str| -> Result<()> {
        Err(RunError::from(format!(
            "{name}: this lies outside of the folder {}; only files in it are read",
            absolute(folder)
        )))
    };
    let inside = |path: &Path| path.canonicalize().map_or(true, |real| real.starts_with(folder));
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    let mut names = Vec::new();
    for (section, value) in &table {
        // What is said of the test names no files.
        if section != "report" {
            texts(value, &mut names);
        }
    }
    for name in names {
        let path = Path::new(name);
        let leads_out = |part: Component<'_>| !matches!(part, Component::Normal(_) | Component::CurDir);
        if path.components().any(leads_out) || !inside(&folder.join(path)) {
            return beyond(name);
        }
    }
    let frames = plan.into_iter().flat_map(|plan| plan.reference.iter().chain(&plan.deformed));
    for frame in frames {
        if !inside(&frame.path) {
            return beyond(&frame.path.display().to_string());
        }
    }
    Ok(())
}

/// All texts in `value` but names of things.
fn texts<'a>(value: &'a toml::Value, found: &mut Vec<&'a str>) {
    match value {
        toml::Value::String(text) => found.push(text),
        toml::Value::Array(list) => list.iter().for_each(|value| texts(value, found)),
        toml::Value::Table(table) => {
            let named = table.iter().filter(|(key, _)| !["name", "zones", "group"].contains(&key.as_str()));
            named.for_each(|(_, value)| texts(value, found));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_keeps_to_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let keeps = |text: &str| keeps_to(&folder, text, None);
        keeps("[images]\nreference = 'a.png'\ndeformed = ['frames/*.png']\n[[zone]]\nname = '/ ..'\nmask = 'm.png'")
            .unwrap();
        keeps("[report]\ncamera = '/dev/video'").unwrap();
        for wrong in [
            "[images]\nreference = '/etc/passwd'",
            "[images]\ndeformed = ['a.png', 'frames/../../*.png']",
            "[[zone]]\nmask = '../m.png'",
            "[load]\nfile = '../load.csv'",
            "[substrate]\nfile = '/curve.csv'",
        ] {
            assert!(keeps(wrong).unwrap_err().to_string().contains("outside of the folder"), "{wrong}");
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("/", folder.join("way")).unwrap();
            let error = keeps("[images]\nreference = 'way/etc/passwd'").unwrap_err().to_string();
            assert!(error.starts_with("way/etc/passwd: "), "{error}");
        }
    }
}
