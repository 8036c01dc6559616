//! `quadrille simulate` as a user meets it: files, figures, and a clear line for every wrong input.

#![cfg(feature = "cli")]

use crate::mechanics_common;
use mechanics_common::{assert_close, reference_folder};
use quadrille::field::{Measurement, Status, StrainDefinition, StrainField};
use quadrille::io::store::{StoreHeader, StoreWriter};
use quadrille::mechanics::JointMesh;
use quadrille::mesh::{Mesh, ZoneElements};
use quadrille::units::{PixelSize, Px};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Arc;

const SUBSTRATE: &str = "[substrate]\nmodel = \"ramberg-osgood\"\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\n\
                         alpha = 0.06\nn = 7.0\n";
const COHESIVE: &str = "[cohesive]\nmodel = \"extended-xu-needleman\"\nphi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\n\
                        delta_t_mm = 0.05\nr = 4.0\n";
const RECTANGLE: &str = "[mesh]\nelement_size_mm = 0.0309\ncolumns = 8\nrows = 3\ngap_mm = 0.06\n";
const BOUNDARY: &str = "[boundary]\nfile = \"border.csv\"\n";

fn quadrille(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_quadrille")).args(arguments).output().expect("the program runs")
}

fn mesh() -> JointMesh {
    JointMesh::rectangular(8, 3, 0.0309, 0.06).unwrap()
}

/// A border that opens over three instants.
fn border() -> String {
    let mesh = mesh();
    let mut text = "# a comment\ninstant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for instant in 1..=3 {
        for node in mesh.outer_nodes() {
            let [x, y] = mesh.nodes()[node as usize];
            let up = y.signum() * 0.004 * f64::from(instant) * (0.3 + 4.0 * x);
            writeln!(text, "{instant},{node},{x},{y},0,{up}").unwrap();
        }
    }
    text
}

/// A folder with `case.toml` and `border.csv`.
fn folder(case: &str, border: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("case.toml"), case).unwrap();
    std::fs::write(folder.path().join("border.csv"), border).unwrap();
    folder
}

fn simulate(folder: &Path) -> Output {
    let (case, out) = (folder.join("case.toml"), folder.join("out"));
    quadrille(&["simulate", case.to_str().unwrap(), "--output", out.to_str().unwrap()])
}

/// Columns of a table, by header, and its rows.
#[track_caller]
fn read(path: PathBuf) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().unwrap().split(',').map(str::to_owned).collect();
    (header, lines.map(|line| line.split(',').map(|v| v.parse().unwrap()).collect()).collect())
}

#[test]
fn a_case_gives_all_its_files_with_finite_numbers() {
    let folder = folder(&format!("{RECTANGLE}{BOUNDARY}{SUBSTRATE}{COHESIVE}"), &border());
    let output = simulate(folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let out = folder.path().join("out");
    let n = mesh().nodes().len();
    let (header, rows) = read(out.join("solution.csv"));
    assert_eq!(header.join(","), "instant,node,ux_mm,uy_mm");
    assert_eq!(rows.len(), 3 * n);
    let (header, rows) = read(out.join("tractions.csv"));
    assert_eq!(header.join(","), "instant,lower_node,upper_node,x_mm,y_mm,Dn_mm,Dt_mm,Tn_MPa,Tt_MPa");
    assert_eq!(rows.len(), 3 * 9);
    let (header, rows) = read(out.join("sensitivities.csv"));
    assert_eq!(
        header.join(","),
        "instant,node,dux_dphi_n,dux_ddelta_n,dux_ddelta_t,dux_dr,duy_dphi_n,duy_ddelta_n,duy_ddelta_t,duy_dr"
    );
    assert!(rows.len() == 3 * n && rows.iter().flatten().all(|v| v.is_finite()));
    let (header, rows) = read(out.join("energies.csv"));
    assert_eq!(header.join(","), "instant,work,elastic,plastic,adhesive,imbalance,settled");
    assert!(rows.len() == 3 && rows[2][1] > 0.0 && rows[2][5].abs() < 1e-6 * rows[2][1], "{rows:?}");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("energies balance to "), "{said}");
    let reactions = std::fs::read_to_string(out.join("reactions.csv")).unwrap();
    assert!(reactions.contains("instant,group,ux_mm,uy_mm,Fx_N_per_mm,Fy_N_per_mm") && reactions.contains("3,upper,"));
    let summary: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
    let force = |group: &str| summary["instants"][2]["reactions"][group]["force_N_per_mm"][1].as_f64().unwrap();
    assert!(force("upper") > 1.0);
    assert_close(force("upper"), -force("lower"), 1e-10, "what the strips hold each other with");
    assert!(summary["energy_balance"]["relative"].as_f64().unwrap() < 1e-6);
    assert!(summary["seconds"].as_f64().unwrap() > 0.0);
    let instants = summary["instants"].as_array().unwrap();
    assert!(instants.len() == 3 && instants.iter().all(|instant| instant["status"] == "converged"));
    for name in ["series.pvd", "interface.pvd", "vtu/000003.vtu", "vtu/000003-interface.vtu"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    for name in
        ["000003-deformed", "000003-tn", "000003-dux_dphi_n", "000003-duy_dphi_n", "load-displacement", "energies"]
    {
        let path = out.join("figures").join(format!("{name}.png"));
        assert!(std::fs::metadata(&path).is_ok_and(|file| file.len() > 2000), "{name}");
    }
    // The joint only opens: what slides, and what r does, is rounding and no result.
    for name in ["000003-tt", "000003-duy_dr"] {
        assert!(!out.join("figures").join(format!("{name}.png")).exists(), "{name}");
    }
    // A second run is refused, and replaced when asked for.
    let again = simulate(folder.path());
    assert_eq!(again.status.code(), Some(2));
    let (case, output) = (folder.path().join("case.toml"), out.to_str().unwrap().to_owned());
    let replaced = quadrille(&["simulate", case.to_str().unwrap(), "--output", &output, "--overwrite", "-q"]);
    assert!(replaced.status.success() && replaced.stderr.is_empty());
}

#[test]
fn the_reference_test_runs_from_its_files() {
    let Some(reference) = reference_folder() else { return };
    let base = reference.join("virtual_r4");
    let case = format!(
        "[mesh]\nfile = {:?}\n[boundary]\nfile = {:?}\n{SUBSTRATE}{COHESIVE}",
        base.join("mesh.json"),
        base.join("boundary_displacements.csv")
    );
    let folder = folder(&case, "");
    let output = simulate(folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (_, rows) = read(folder.path().join("out/tractions.csv"));
    assert_eq!(rows.len(), 19 * 40);
    let (_, solution) = read(folder.path().join("out/solution.csv"));
    let (_, given) = read(base.join("boundary_displacements.csv"));
    for row in given {
        let found = &solution[640 * (row[0] as usize - 1) + row[1] as usize];
        assert_close(found[2], row[4], 0.0, "a prescribed displacement");
        assert_close(found[3], row[5], 0.0, "a prescribed displacement");
    }
}

#[test]
fn meshes_of_gmsh_with_a_material_for_each_strip_run() {
    // Two strips of two elements; nodes shared by the layers of the upper strip are one.
    let mesh = JointMesh::rectangular(2, 1, 1.0, 0.1).unwrap();
    let mut text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n2\n2 1 \"lower\"\n2 2 \"upper\"\n\
                    $EndPhysicalNames\n"
        .to_owned();
    write!(text, "$Nodes\n{}\n", mesh.nodes().len()).unwrap();
    for (k, [x, y]) in mesh.nodes().iter().enumerate() {
        writeln!(text, "{} {x} {y} 0", k + 1).unwrap();
    }
    write!(text, "$EndNodes\n$Elements\n{}\n", mesh.elements().len()).unwrap();
    for (k, [a, b, c, d]) in mesh.elements().iter().enumerate() {
        let group = mesh.element_group()[k] + 1;
        writeln!(text, "{} 3 2 {group} {group} {} {} {} {}", k + 1, a + 1, b + 1, c + 1, d + 1).unwrap();
    }
    text.push_str("$EndElements\n");
    let mut border = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for node in mesh.outer_nodes() {
        let [x, y] = mesh.nodes()[node as usize];
        writeln!(border, "1,{node},{x},{y},0,{}", 0.001 * y.signum()).unwrap();
    }
    let case = format!(
        "[mesh]\nfile = \"joint.msh\"\n{BOUNDARY}[substrate]\nplane = \"strain\"\n[substrate.lower]\nmodel = \"linear-elastic\"\n\
         E_MPa = 70000\nnu = 0.3\n[substrate.upper]\nE_MPa = 72000\nnu = 0.33\nsigma_0_MPa = 180\nalpha = 0.06\nn = 7\n\
         {COHESIVE}kinematics = \"objective\"\nquadrature = \"gauss\"\n[output]\nsubstrate_sensitivities = true\nfigures = [1]\n"
    );
    let folder = folder(&case, &border);
    std::fs::write(folder.path().join("joint.msh"), text).unwrap();
    let output = simulate(folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (header, _) = read(folder.path().join("out/sensitivities.csv"));
    assert!(header.contains(&"dux_dE_lower".to_owned()) && header.contains(&"duy_dn_upper".to_owned()), "{header:?}");
}

/// The joint of [`mesh`] as a `.msh` file of version 4.1 with the physical surfaces `lower` and `upper`, and physical
/// curves for the faces and the outer border.
fn msh_41(mesh: &JointMesh) -> String {
    let curves: [(&str, Vec<[u32; 2]>); 3] = [
        ("lower_face", mesh.interfaces().iter().map(|&[a, b, ..]| [a, b]).collect()),
        ("upper_face", mesh.interfaces().iter().map(|&[.., a, b]| [a, b]).collect()),
        ("boundary", mesh.outer_nodes().windows(2).map(|pair| [pair[0], pair[1]]).collect()),
    ];
    let mut text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n5\n".to_owned();
    for (k, (name, _)) in curves.iter().enumerate() {
        writeln!(text, "1 {} \"{name}\"", k + 1).unwrap();
    }
    text.push_str("2 1 \"lower\"\n2 2 \"upper\"\n$EndPhysicalNames\n$Entities\n0 3 2 0\n");
    for number in [1, 2, 3, 1, 2] {
        writeln!(text, "{number} 0 0 0 1 1 0 1 {number} 0").unwrap();
    }
    let n = mesh.nodes().len();
    // Numbers of their own: nodes are found by their places.
    write!(text, "$EndEntities\n$Nodes\n1 {n} 11 {}\n2 1 0 {n}\n", n + 10).unwrap();
    (0..n).for_each(|k| writeln!(text, "{}", k + 11).unwrap());
    mesh.nodes().iter().for_each(|[x, y]| writeln!(text, "{x} {y} 0").unwrap());
    let n_lines: usize = curves.iter().map(|(_, edges)| edges.len()).sum();
    let total = n_lines + mesh.elements().len();
    write!(text, "$EndNodes\n$Elements\n5 {total} 1 {total}\n").unwrap();
    let mut number = 0;
    for (k, (_, edges)) in curves.iter().enumerate() {
        writeln!(text, "1 {} 1 {}", k + 1, edges.len()).unwrap();
        for [a, b] in edges {
            number += 1;
            writeln!(text, "{number} {} {}", a + 11, b + 11).unwrap();
        }
    }
    for group in 0..2 {
        let of: Vec<_> = mesh.elements().iter().zip(mesh.element_group()).filter(|(_, g)| **g == group).collect();
        writeln!(text, "2 {} 3 {}", group + 1, of.len()).unwrap();
        for (corners, _) in of {
            number += 1;
            let [a, b, c, d] = corners.map(|node| node + 11);
            writeln!(text, "{number} {a} {b} {c} {d}").unwrap();
        }
    }
    text + "$EndElements\n"
}

/// Displacements by place and instant: `(instant, x, y)` in nanometres.
fn by_place(out: &Path, nodes: &[[f64; 2]]) -> std::collections::BTreeMap<[i64; 3], [f64; 2]> {
    let (_, rows) = read(out.join("solution.csv"));
    let nano = |mm: f64| (mm * 1e6).round() as i64;
    let entry = |row: &Vec<f64>| {
        let [x, y] = nodes[row[1] as usize];
        ([row[0] as i64, nano(x), nano(y)], [row[2], row[3]])
    };
    rows.iter().map(entry).collect()
}

#[test]
fn a_mesh_of_gmsh_with_named_faces_and_border_gives_what_the_rectangle_gives() {
    let rectangle = folder(&format!("{RECTANGLE}{BOUNDARY}{SUBSTRATE}{COHESIVE}"), &border());
    let gmsh = folder(&format!("[mesh]\nfile = \"joint.msh\"\n{BOUNDARY}{SUBSTRATE}{COHESIVE}"), &border());
    let file = gmsh.path().join("joint.msh");
    std::fs::write(&file, msh_41(&mesh())).unwrap();
    for folder in [&rectangle, &gmsh] {
        let output = simulate(folder.path());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let read = quadrille::io::joint::read_joint_mesh(&file).unwrap();
    assert_eq!((read.faces.len(), read.prescribed.as_ref().map(Vec::len)), (18, Some(mesh().outer_nodes().len())));
    let wanted = by_place(&rectangle.path().join("out"), mesh().nodes());
    let found = by_place(&gmsh.path().join("out"), &read.nodes);
    assert_eq!(wanted.len(), found.len());
    for (place, u) in &wanted {
        for c in 0..2 {
            // The order of the nodes and with it that of the sums differs: round-off of displacements of 0.02 mm.
            assert_close(found[place][c], u[c], 1e-14, format!("{place:?}"));
        }
    }
    // The border named in the mesh has to be prescribed, but for the ends of the faces.
    let without = |node: u32| -> String {
        let rest = border();
        let of_node = |line: &&str| line.split(',').nth(1) != Some(&node.to_string());
        rest.lines().filter(of_node).map(|line| format!("{line}\n")).collect()
    };
    let again = |border: String| {
        std::fs::write(gmsh.path().join("border.csv"), border).unwrap();
        let (case, out) = (gmsh.path().join("case.toml"), gmsh.path().join("again"));
        let output = quadrille(&["simulate", case.to_str().unwrap(), "--output", out.to_str().unwrap(), "--overwrite"]);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (status, said) = again(without(3));
    assert!(status == Some(2) && said.contains("no row for node") && said.contains("(0.0927, "), "{said}");
    let end = mesh().interfaces()[0][0];
    let (status, said) = again(without(end));
    assert!(status == Some(0) && said.contains("left free"), "{said}");
}

/// A correlation run of two zones, 6 by 2 elements of 16 px each, whose frames end as `statuses` say and lack `node`.
fn correlation_run(path: &Path, statuses: &[Status], mm_per_px: f64, node: Option<usize>) {
    correlation_run_by(path, statuses, mm_per_px, node, "");
}

/// The same by the options of `case`.
fn correlation_run_by(path: &Path, statuses: &[Status], mm_per_px: f64, node: Option<usize>, case: &str) {
    let zone = |(name, top): (&str, f64)| {
        let corner = |k: u32| k % 6 + 7 * (k / 6);
        ZoneElements {
            name: name.into(),
            nodes: (0..21).map(|k| [8.0 + 16.0 * f64::from(k % 7), top + 16.0 * f64::from(k / 7)]).collect(),
            elements: (0..12).map(|k| [corner(k), corner(k) + 1, corner(k) + 8, corner(k) + 7]).collect(),
        }
    };
    let zones = [("upper", 8.0), ("lower", 71.0)].map(zone).to_vec();
    let mesh = Arc::new(Mesh::<Px>::from_zones(zones).unwrap());
    let header = StoreHeader {
        quadrille: "0.1.0".into(),
        device: "cpu".into(),
        mesh: mesh.clone(),
        image_size_px: [128, 128],
        reference: vec!["ref.tif".into()],
        reference_sha256: vec!["0a".into()],
        frames: (1..=statuses.len()).map(|k| format!("{k}.tif")).collect(),
        pixel_size: PixelSize::new(mm_per_px),
        range_grey: 255.0,
        element_size_px: 16.0,
        strain: StrainDefinition::Infinitesimal,
        strain_window: None,
        case: case.into(),
    };
    let writer = StoreWriter::create(&path.join("fields.zarr"), &header).unwrap();
    for (number, &status) in (1..).zip(statuses) {
        // The upper zone (small row numbers) moves up: to smaller row numbers.
        let at = |&[x, y]: &[f64; 2]| [0.0, if y < 55.0 { -1.0 } else { 0.5 } * number as f64 * (0.2 + 0.01 * x)];
        let field = Measurement {
            mesh: mesh.clone(),
            status,
            displacement: mesh.nodes().iter().map(at).collect(),
            sigma: vec![[0.01; 2]; mesh.n_nodes()],
            measured: (0..mesh.n_nodes()).map(|k| Some(k) != node).collect(),
            element_residual: vec![1.0; mesh.n_elements()],
            model_error: None,
            marks: None,
            points: None,
        };
        let strain = StrainField::of(&field, StrainDefinition::Infinitesimal);
        writer.write(number, &field, &strain).unwrap();
    }
    writer.finish(vec![None; statuses.len()]).unwrap();
}

#[test]
fn a_correlation_run_drives_the_joint_with_y_turned_up_and_says_which_frames_it_leaves_out() {
    let case =
        format!("[mesh]\nstore = \"run/fields.zarr\"\nrefine = 2\n[boundary]\nstore = \"run\"\n{SUBSTRATE}{COHESIVE}");
    let folder = folder(&case, "");
    let run = folder.path().join("run");
    std::fs::create_dir(&run).unwrap();
    correlation_run(&run, &[Status::Converged, Status::IterationLimit, Status::Converged], 0.00193125, None);
    let output = simulate(folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.contains("frames 2 did not converge"), "{said}");
    let (_, rows) = read(folder.path().join("out/tractions.csv"));
    assert_eq!(rows.len(), 2 * (2 * 6 + 1), "two instants, twice as many elements along the joint");
    for row in &rows {
        let (x, opening) = (row[3], row[5]);
        // Lower and upper zone part: the opening is positive, and at the prescribed ends what the frames say.
        assert!(opening > 0.0, "{row:?}");
        let column = ((x - rows[0][3]) / 0.01545).round();
        if column == 0.0 || column == 12.0 {
            let frame = if row[0] == 1.0 { 1.0 } else { 3.0 };
            let wanted = 1.5 * frame * (0.2 + 0.01 * x / 0.00193125) * 0.00193125;
            assert_close(opening, wanted, 1e-15, "opening at an end");
        }
    }
    let refused = |case: &str, words: &str| {
        std::fs::write(folder.path().join("case.toml"), case).unwrap();
        let again = quadrille(&["simulate", folder.path().join("case.toml").to_str().unwrap(), "--output", "nowhere"]);
        let said = String::from_utf8_lossy(&again.stderr).into_owned();
        assert!(again.status.code() == Some(2) && said.contains(words), "{said}");
    };
    refused(&case.replace("store = \"run\"", "store = \"other\""), "same run");
    refused(&case.replace("store = \"run\"", "file = \"a.csv\"\nstore = \"run\""), "[boundary] needs either");
    correlation_run(&run, &[Status::Diverged], 0.00193125, None);
    refused(&case, "no frame of the run converged");
    correlation_run(&run, &[Status::Converged], 0.0, None);
    refused(&case, "no pixel size");
    correlation_run(&run, &[Status::Converged], 0.00193125, Some(6));
    refused(&case, "frame 1 has no displacement at node 6");
    let splines = "[correlation]\nelements = \"cubic-spline\"";
    correlation_run_by(&run, &[Status::Converged], 0.00193125, None, splines);
    refused(&case, "correlate again without --elements");
    assert!(!Path::new("nowhere").exists());
}

#[track_caller]
fn refused(case: &str, border: &str, words: &[&str]) {
    let folder = folder(case, border);
    let output = simulate(folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(said.trim().lines().count(), 1, "{said}");
    for word in words {
        assert!(said.contains(word), "'{word}' is not in: {said}");
    }
    assert!(!folder.path().join("out/summary.json").exists());
}

#[test]
fn wrong_input_gives_one_clear_line_and_status_2() {
    let good = format!("{RECTANGLE}{BOUNDARY}{SUBSTRATE}{COHESIVE}");
    let case = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replace(from, to)
    };
    let border = border();
    refused(&case("nu = 0.33", "nu = 0.5"), &border, &["nu", "0.5", "below 0.5"]);
    refused(&case("delta_n_mm = 0.005", "delta_n_mm = -0.005"), &border, &["delta_n_mm", "-0.005", "above zero"]);
    refused(&case("phi_n_N_per_mm = 1.0", "phi_n_N_per_mm = 0"), &border, &["phi_n_N_per_mm"]);
    let with_groups = |line: &str| format!("{good}[groups]\n{line}\n");
    refused(&with_groups("grip = \"y = top\""), &border, &["groups", "grip", "y = top", "max"]);
    refused(&with_groups("grip = \"x = 7\""), &border, &["groups", "grip", "no node"]);
    refused(&with_groups("grip = [0, 4000]"), &border, &["grip", "4000", "72"]);
    refused(&with_groups("grip = \"x = 0.0309 and y = -0.0609\""), &border, &["grip", "prescribed"]);
    refused(&with_groups("grip = 3"), &border, &["grip", "condition", "list"]);
    refused(&case("phi_n_N_per_mm = 1.0", "phi_n_N_per_mm = nan"), &border, &["phi_n_N_per_mm", "NaN"]);
    refused(&case("r = 4.0", ""), &border, &["case.toml, line", "[cohesive] r is missing"]);
    refused(&case("r = 4.0", "r = \"four\""), &border, &["line", "`r` in [cohesive]", "expected a number"]);
    refused(&case("r = 4.0", "r = 4.0\nq = 1"), &border, &["q", "no such key"]);
    refused(&case("extended-xu-needleman", "glue"), &border, &["glue", "xu-needleman"]);
    refused(&case("ramberg-osgood", "wood"), &border, &["wood", "linear-elastic"]);
    refused(&case("[substrate]", "[substrate.middle]"), &border, &["middle", "lower, upper"]);
    refused(&case("columns = 8", "columns = 0"), &border, &["0 columns"]);
    refused(&case("columns = 8\n", ""), &border, &["case.toml, line 1: [mesh] needs"]);
    refused(&case("columns = 8", "colums = 8"), &border, &["colums", "line"]);
    refused(&case("[mesh]", "[mesh]\nzones = ['lower', 'upper']"), &border, &["[mesh]"]);
    refused(&case("[mesh]", "[mesh]\nrefine = 0"), &border, &["refine = 0"]);
    refused(&case("border.csv", "other.csv"), &border, &["other.csv", "no such file"]);
    refused(&case("border.csv\"", "border.csv\"\nremove_rigid_motion = \"each\""), &border, &["each", "overall"]);
    refused(&case("r = 4.0", "r = 4.0\nkinematics = \"exact\""), &border, &["exact", "objective"]);
    refused("[mesh", &border, &["line 1"]);

    let lines: Vec<&str> = border.lines().collect();
    let n = (lines.len() - 2) / 3;
    refused(&good, "", &["no row"]);
    refused(&good, "a,b\n1,2\n", &["instant,node,x_mm"]);
    refused(&good, &lines[..lines.len() - 1].join("\n"), &["instant 3", "no row for node"]);
    let two: Vec<&str> =
        lines.iter().enumerate().filter(|(k, _)| !(2 + n..2 + 2 * n).contains(k)).map(|(_, l)| *l).collect();
    refused(&good, &two.join("\n"), &["no instant 2"]);
    let broken = lines[2].rsplit_once(",0,").map(|(left, right)| format!("{left},nan,{right}")).unwrap();
    refused(&good, &border.replacen(lines[2], &broken, 1), &["ux_mm", "nan", "line 3"]);
    refused(&good, &border.replacen("1,0,0,", "1,0,5,", 1), &["node 0", "not a node of the mesh"]);
    refused(&good, &border.replace(",0,0,-", ",999,0,-"), &["node 999", "the mesh has 72 nodes"]);
    // The upper strip without any prescribed node.
    let lower: Vec<&str> =
        lines.iter().filter(|line| !line.split(',').nth(3).is_some_and(|y| y.starts_with("0."))).copied().collect();
    refused(&good, &lower.join("\n"), &["0 prescribed nodes"]);
}

#[test]
fn meshes_that_make_no_joint_are_refused_by_name() {
    let case = format!("[mesh]\nfile = \"mesh.json\"\n{BOUNDARY}{SUBSTRATE}{COHESIVE}");
    let refused = |mesh: &str, words: &[&str]| {
        let folder = folder(&case, &border());
        std::fs::write(folder.path().join("mesh.json"), mesh).unwrap();
        let output = simulate(folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "'{word}' is not in: {said}"));
    };
    refused("{}", &["mesh.json", "nodes"]);
    refused("hello", &["mesh.json"]);
    let nodes = "[[0,0],[1,0],[1,1],[0,1],[0,1.1],[1,1.1],[1,2],[0,2]]";
    refused(&format!("{{\"nodes\": {nodes}, \"quads\": [[0,3,2,1],[4,5,6,7]]}}"), &["element 0", "counter-clockwise"]);
    refused(&format!("{{\"nodes\": {nodes}, \"quads\": [[0,1,2,3]]}}"), &["node 4", "no element"]);
    let both = "\"quads\": [[0,1,2,3],[4,5,6,7]]";
    refused(&format!("{{\"nodes\": {nodes}, {both}, \"dirichlet_nodes\": [0, 8]}}"), &["names node 8", "there are 8"]);
    refused(&format!("{{\"nodes\": {nodes}, {both}, \"cohesive\": [[4,5,3,2]]}}"), &["interface element 0", "pair"]);
    let case = case.replace("[mesh]", "[mesh]\nzones = ['a', 'b']");
    let refused = |groups: &str, words: &[&str]| {
        let folder = folder(&case, &border());
        let mesh = format!("{{\"nodes\": {nodes}, {both}, \"groups\": {groups}, \"quad_group\": [0, 1]}}");
        std::fs::write(folder.path().join("mesh.json"), mesh).unwrap();
        let said = String::from_utf8_lossy(&simulate(folder.path()).stderr).into_owned();
        words.iter().for_each(|word| assert!(said.contains(word), "'{word}' is not in: {said}"));
    };
    refused("[\"a\", \"c\"]", &["[mesh] zones names \"b\"", "a, c"]);
    let case = case.replace("['a', 'b']", "['a', 'a']");
    let twice = folder(&case, &border());
    let mesh = format!("{{\"nodes\": {nodes}, {both}, \"groups\": [\"a\", \"b\"], \"quad_group\": [0, 1]}}");
    std::fs::write(twice.path().join("mesh.json"), mesh).unwrap();
    let said = String::from_utf8_lossy(&simulate(twice.path()).stderr).into_owned();
    assert!(said.contains("names \"a\" twice"), "{said}");
}

#[test]
fn units_that_cannot_be_right_are_warned_of() {
    // Elements of 10 m with micrometre openings.
    let mesh = JointMesh::rectangular(8, 3, 10_000.0, 60.0).unwrap();
    let mut border = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for node in mesh.outer_nodes() {
        let [x, y] = mesh.nodes()[node as usize];
        writeln!(border, "1,{node},{x},{y},0,{}", 1e-5 * y.signum()).unwrap();
    }
    let rectangle = RECTANGLE.replace("0.0309", "10000").replace("0.06", "60");
    let folder = folder(&format!("{rectangle}{BOUNDARY}{SUBSTRATE}{COHESIVE}"), &border);
    let output = simulate(folder.path());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code().is_some_and(|code| code < 2), "{said}");
    assert!(said.contains("are all lengths in mm?"), "{said}");
    let said_of = |text: &str, instead: &str| {
        let case = format!("{RECTANGLE}{BOUNDARY}{SUBSTRATE}{COHESIVE}").replace(text, instead);
        let output = simulate(self::folder(&case, &self::border()).path());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, said) = said_of("E_MPa = 72000.0", "E_MPa = 72.0");
    assert!(code < Some(2) && said.contains("E = 72 MPa") && said.contains("GPa meant?"), "{said}");
    // A law that holds nothing is not looked for for minutes.
    let (code, said) = said_of("phi_n_N_per_mm = 1.0", "phi_n_N_per_mm = 1e-17");
    assert!(code == Some(2) && said.contains("which holds nothing: is it in MPa?"), "{said}");
}

#[test]
fn groups_of_nodes_are_named_by_the_case_or_by_the_mesh_and_kept_when_it_is_refined() {
    let groups = "[groups]\ngrip = \"y = max\"\nfoot = [0, 1, 2, 3, 4, 5, 6, 7, 8]\n[output]\nenergies = false\n";
    let case = format!("{RECTANGLE}refine = 2\n{BOUNDARY}{SUBSTRATE}{COHESIVE}kinematics = \"finite\"\n{groups}");
    let folder = folder(&case, &border());
    let output = simulate(folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let out = folder.path().join("out");
    assert!(!out.join("energies.csv").exists());
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(summary["kinematics"], "finite");
    let of = |group: &str| &summary["instants"][2]["reactions"][group];
    // The border opens as in a mirror.
    let [grip, foot] = ["grip", "foot"].map(|group| of(group)["force_N_per_mm"][1].as_f64().unwrap());
    assert!(grip > 0.5 && (grip + foot).abs() < 1e-6 * grip, "{grip} {foot}");
    let moved = of("grip")["displacement_mm"][1].as_f64().unwrap();
    assert_close(moved, 0.012 * (0.3 + 4.0 * 4.0 * 0.0309), 1e-12, "mean displacement");
}
