//! A virtual test with its images, its truth, and a case file to run: what `quadrille make virtual-test` does.

#![expect(clippy::indexing_slicing, reason = "nothing is read here that others have written")]

use crate::identify::law_like;
use crate::io::images::{sha256, write_image};
use crate::io::joint::write_table;
use crate::mechanics::JointMesh;
use crate::mechanics::cohesive::ExtendedXuNeedleman;
use crate::run::folder::read::write_file;
use crate::run::words::{Result, RunError};
use crate::virtual_test::{
    ALUMINIUM, BAND_PX, ELEMENT_PX, Mixity, PIXEL_MM, SIZE, VirtualOptions, VirtualTest, faces_px, zones_px,
};
use rayon::ThreadPool;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::fs;
use std::io::BufWriter;
use std::path::Path;

const TRUTH: &str = "truth.json";
const IMAGES: &str = "images";
const LOAD: &str = "load.csv";

/// Computes a joint of this law, with the strengths and works of separation of the default one, and writes its test into
/// `folder`. What `truth.json` says of it is returned.
///
/// # Errors
/// See [`crate::run::RunError`]: also a folder that holds another test, unless `overwrite` allows to replace it.
pub fn virtual_test(
    options: VirtualOptions,
    law: &str,
    folder: &Path,
    overwrite: bool,
    pool: &ThreadPool,
) -> Result<Value> {
    if folder.join(TRUTH).exists() && !overwrite {
        return Err(RunError::HoldsAnother { folder: folder.to_owned(), why: Some("a virtual test".to_owned()) });
    }
    let [phi_n, delta_n, delta_t, r] = options.law;
    let usual = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r)?;
    let truth = law_like(law, &usual)
        .ok_or_else(|| format!("--law {law}: no such law has the strengths and works of the default one"))?;
    write_virtual_test(&pool.install(|| VirtualTest::with_law(options, truth))?, folder, pool)
}

/// Writes the test into `folder`: images, truth, case file. An earlier one there is replaced. What `truth.json` says of
/// it is returned.
///
/// # Errors
/// See [`crate::run::RunError`].
pub fn write_virtual_test(test: &VirtualTest, folder: &Path, pool: &ThreadPool) -> Result<Value> {
    let images = folder.join(IMAGES);
    let truth = folder.join("truth");
    for path in [&images, &truth] {
        fs::create_dir_all(path).map_err(|error| cannot(path, error))?;
    }
    // Before anything is replaced: without its truth a half-written test is none.
    remove_earlier(folder)?;
    let hashes = pool.install(|| {
        (0..=test.options().instants)
            .into_par_iter()
            .map(|k| -> Result<Value> {
                let name = format!("{k:06}.png");
                let path = images.join(&name);
                write_image(&path, &test.image(k)?)?;
                let bytes = fs::read(&path).map_err(|error| cannot(&path, error))?;
                Ok(json!({ "file": format!("{IMAGES}/{name}"), "sha256": sha256(&bytes) }))
            })
            .collect::<Result<Vec<Value>>>()
    })?;
    write_truth(test, &truth)?;
    write_loads(test, &folder.join(LOAD))?;
    write_file(&folder.join("case.toml"), test.case_toml())?;
    let truth = about(test, hashes);
    write_file(&folder.join(TRUTH), format!("{truth:#}\n"))?;
    Ok(truth)
}

/// Removes the images of an earlier test, which a glob would take along, and what says that it is there.
fn remove_earlier(folder: &Path) -> Result<()> {
    let mut images = (0..=VirtualOptions::MOST_INSTANTS).map(|k| folder.join(IMAGES).join(format!("{k:06}.png")));
    let gone = |path: &Path| match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(cannot(path, error)),
        _ => Ok(()),
    };
    gone(&folder.join(TRUTH))?;
    images.try_for_each(|path| gone(&path))
}

fn parameters(test: &VirtualTest) -> serde_json::Map<String, Value> {
    let law = test.law();
    let values = law.values();
    law.parameters().iter().zip(values).map(|(parameter, value)| (parameter.name.to_owned(), json!(value))).collect()
}

fn about(test: &VirtualTest, images: Vec<Value>) -> Value {
    let options = test.options();
    let law = test.law();
    let units: serde_json::Map<String, Value> =
        law.parameters().iter().map(|parameter| (parameter.name.to_owned(), json!(parameter.unit))).collect();
    let [upper, lower] = zones_px();
    let positions = test.model().pair_positions();
    let first = positions.first().map_or(0.0, |(at, along)| at[0] - along);
    let instants: Vec<Value> = (1..)
        .zip(&test.solution().instants)
        .map(|(k, instant)| {
            let tractions = test.model().tractions(law, &instant.displacement);
            let most = |pick: fn(f64, f64) -> f64, start: f64| tractions.iter().map(|t| t.normal).fold(start, pick);
            json!({
                "instant": k,
                "crack_front_px": test.model().crack_front(law, &instant.displacement).map(|at| (first + at) / PIXEL_MM),
                "largest_Tn_MPa": most(f64::max, f64::NEG_INFINITY),
                "smallest_Tn_MPa": most(f64::min, f64::INFINITY),
                "rescued": instant.status != crate::mechanics::Status::Converged,
            })
        })
        .collect();
    let peak = law.peak();
    json!({
        "quadrille": env!("CARGO_PKG_VERSION"),
        "what": match options.mixity {
            Mixity::Mixed => "virtual test of a bonded joint: remote mixed-mode opening, the crack runs from right to left",
            Mixity::Opening => "virtual test of a bonded joint: remote opening with a little sliding, the crack runs from right to left",
            Mixity::Sliding => "virtual test of a bonded joint: remote sliding with a little opening, the whole joint at once",
        },
        "mixity": options.mixity.name(),
        "units": "mm, MPa, N/mm; x to the right, y up from the centre of the top-left pixel; px with y down; nodes from 0, instants from 1",
        "seed": options.seed,
        "noise_grey": options.noise_grey,
        "depth": format!("{:?}", options.depth),
        "speckle_px": options.speckle_px,
        "size_px": SIZE,
        "pixel_size_mm": PIXEL_MM,
        "thickness_mm": BAND_PX * PIXEL_MM,
        "faces_px": faces_px(),
        "zones_px": { "upper": upper, "lower": lower },
        "element_size_px": ELEMENT_PX,
        "true_element_size_px": test.model().mesh().element_size() / PIXEL_MM,
        "law": law.name(),
        "parameters": parameters(test),
        "parameter_units": units,
        "peak_traction_MPa": { "normal": peak.normal, "tangential": peak.tangential },
        "substrate": {
            "model": "ramberg-osgood", "plane": "stress", "E_MPa": ALUMINIUM[0], "nu": ALUMINIUM[1],
            "sigma_0_MPa": ALUMINIUM[2], "alpha": ALUMINIUM[3], "n": ALUMINIUM[4],
        },
        "largest_strip_rotation_rad": test.largest_rotation(),
        "instants": instants,
        "images": images,
    })
}

/// Mesh, displacements, border and tractions of the region.
fn write_truth(test: &VirtualTest, folder: &Path) -> Result<()> {
    let (region, of) = test.region();
    let notes = |what: &str| {
        let units = "mm, MPa; y up; nodes from 0, instants from 1";
        vec![format!("quadrille {}", env!("CARGO_PKG_VERSION")), format!("virtual test: {what}; {units}")]
    };
    let columns = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let fields = || (1..).zip(&test.solution().instants).map(|(k, instant)| (k, &instant.displacement));
    let table = |name: &str, what: &str, names: &[&str], rows: &mut dyn Iterator<Item = (Vec<u64>, Vec<f64>)>| {
        let path = folder.join(name);
        let file = fs::File::create(&path).map_err(|error| cannot(&path, error))?;
        write_table(BufWriter::new(file), &notes(what), &columns(names), rows).map_err(|error| cannot(&path, error))
    };
    write_file(&folder.join("mesh.json"), format!("{}\n", mesh_json(&region)))?;
    let all = (0u64..).zip(&of);
    table(
        "displacement.csv",
        "true displacement of every node of mesh.json",
        &["instant", "node", "ux_mm", "uy_mm"],
        &mut fields().flat_map(|(k, u)| all.clone().map(move |(node, &old)| (vec![k, node], u[old as usize].to_vec()))),
    )?;
    let border = region.outer_nodes();
    let (nodes, of) = (region.nodes(), &of);
    table(
        "boundary_displacements.csv",
        "true displacement of the outer nodes of mesh.json",
        &["instant", "node", "x_mm", "y_mm", "ux_mm", "uy_mm"],
        &mut fields().flat_map(|(k, u)| {
            border.iter().map(move |&node| {
                let ([x, y], [ux, uy]) = (nodes[node as usize], u[of[node as usize] as usize]);
                (vec![k, node.into()], vec![x, y, ux, uy])
            })
        }),
    )?;
    let (model, law) = (test.model(), test.law());
    let inside: Vec<bool> = model.mesh().pairs().iter().map(|[lower, _]| of.contains(lower)).collect();
    let positions = model.pair_positions();
    let mut rows = fields().flat_map(|(k, u)| {
        let rows: Vec<_> = (model.jumps(u).into_iter().zip(&positions).zip(&inside))
            .filter(|(_, inside)| **inside)
            .map(|((jump, ([x, y], _)), _)| {
                let traction = law.response(jump).traction;
                (vec![k], vec![*x, *y, jump.normal, jump.tangential, traction.normal, traction.tangential])
            })
            .collect();
        rows
    });
    let names = ["instant", "x_mm", "y_mm", "Dn_mm", "Dt_mm", "Tn_MPa", "Tt_MPa"];
    table("tractions.csv", "true jump and traction along the adhesive", &names, &mut rows)
}

/// The load cell, as `[load]` and `[force]` read it.
fn write_loads(test: &VirtualTest, path: &Path) -> Result<()> {
    let loads = test.loads()?;
    let notes = [
        format!("quadrille {}", env!("CARGO_PKG_VERSION")),
        "virtual test: forces on the upper strip per mm of width: [force] width_mm = 1; x to the right, y up"
            .to_owned(),
        "load: at the grip, of the whole joint; region: of the part that the images show (column = \"region\")"
            .to_owned(),
    ];
    let names = ["frame", "load_N", "load_x_N", "region_N", "region_x_N"].map(str::to_owned);
    let mut rows = (1..).zip(&loads).map(|(k, [[gx, gy], [rx, ry]])| (vec![k], vec![*gy, *gx, *ry, *rx]));
    let file = fs::File::create(path).map_err(|error| cannot(path, error))?;
    write_table(BufWriter::new(file), &notes, &names, &mut rows).map_err(|error| cannot(path, error))
}

fn mesh_json(mesh: &JointMesh) -> Value {
    let face = |at: [usize; 2]| {
        let mut nodes: Vec<u32> = mesh.interfaces().iter().flat_map(|corners| at.map(|k| corners[k])).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    };
    json!({
        "nodes": mesh.nodes(),
        "quads": mesh.elements(),
        "cohesive": mesh.interfaces(),
        "lower_face": face([0, 1]),
        "upper_face": face([2, 3]),
        "dirichlet_nodes": mesh.outer_nodes(),
        "groups": mesh.groups(),
        "quad_group": mesh.element_group(),
    })
}

fn cannot(path: &Path, error: std::io::Error) -> RunError {
    RunError::file(path, "written", error)
}
