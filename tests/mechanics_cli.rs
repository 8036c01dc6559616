//! `quadrille simulate` as a user meets it: files, figures, and a clear line for every wrong input.

mod mechanics_common;

use mechanics_common::{assert_close, reference_folder};
use quadrille::mechanics::JointMesh;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

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
    let summary: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("summary.json")).unwrap()).unwrap();
    assert!(summary["seconds"].as_f64().unwrap() > 0.0);
    let instants = summary["instants"].as_array().unwrap();
    assert!(instants.len() == 3 && instants.iter().all(|instant| instant["status"] == "converged"));
    for name in ["series.pvd", "interface.pvd", "vtu/000003.vtu", "vtu/000003-interface.vtu"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    for name in ["000003-deformed", "000003-tn", "000003-tt", "000003-dux_dphi_n", "000003-duy_dr"] {
        let path = out.join("figures").join(format!("{name}.png"));
        assert!(std::fs::metadata(&path).is_ok_and(|file| file.len() > 2000), "{name}");
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
    refused(&case("phi_n_N_per_mm = 1.0", "phi_n_N_per_mm = nan"), &border, &["phi_n_N_per_mm", "NaN"]);
    refused(&case("r = 4.0", ""), &border, &["r is missing"]);
    refused(&case("r = 4.0", "r = \"four\""), &border, &["give a number"]);
    refused(&case("r = 4.0", "r = 4.0\nq = 1"), &border, &["q", "no such key"]);
    refused(&case("extended-xu-needleman", "glue"), &border, &["glue", "xu-needleman"]);
    refused(&case("ramberg-osgood", "wood"), &border, &["wood", "linear-elastic"]);
    refused(&case("[substrate]", "[substrate.middle]"), &border, &["middle", "lower, upper"]);
    refused(&case("columns = 8", "columns = 0"), &border, &["0 columns"]);
    refused(&case("columns = 8\n", ""), &border, &["[mesh] needs"]);
    refused(&case("columns = 8", "colums = 8"), &border, &["colums", "line"]);
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
    refused(
        &format!("{{\"nodes\": {nodes}, \"quads\": [[0,1,2,3],[4,5,6,7]], \"cohesive\": [[4,5,3,2]]}}"),
        &["interface element 0", "pair"],
    );
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
}
