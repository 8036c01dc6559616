//! Strips of other materials than one metal: laminates, layers, measured curves; and the energy that flows to the joint
//! between them.

use crate::mechanics_common;
use mechanics_common::{adhesive, assert_close, difference, largest, measured_table};
use quadrille::identify::{Case, Outcome, fit};
use quadrille::io::joint::read_joint;
use quadrille::mechanics::cohesive::{CohesiveLaw, Jump, Traction, law_by_name};
use quadrille::mechanics::substrate::{
    EngineeringStrain, LinearElastic, Orthotropic, PlaneState, Stress, SubstrateLaw, Tabulated,
};
use quadrille::mechanics::{
    BoundaryHistory, ForwardOptions, JFault, JointMesh, JointParts, Kinematics, Model, ModelOptions, NodeGroup,
};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

const SIZE: f64 = 0.0309;
const GAP: f64 = 0.06;
const LAYERS: [&str; 4] = ["lower_outer", "lower_inner", "upper_inner", "upper_outer"];

/// Two strips of `columns` x `rows` elements, each of two layers: the outer half of its rows and the inner.
fn layered(columns: usize, rows: usize, size: f64, gap: f64) -> JointMesh {
    let mesh = JointMesh::rectangular(columns, rows, size, gap).unwrap();
    let layer = |corners: &[u32; 4]| {
        let y = corners.iter().map(|&node| mesh.nodes()[node as usize][1]).sum::<f64>() / 4.0;
        let outer = y.abs() > 0.5 * gap + 0.5 * rows as f64 * size;
        match (y > 0.0, outer) {
            (false, true) => 0,
            (false, false) => 1,
            (true, false) => 2,
            (true, true) => 3,
        }
    };
    JointMesh::new(JointParts {
        nodes: mesh.nodes().to_vec(),
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        groups: LAYERS.map(str::to_owned).to_vec(),
        element_group: mesh.elements().iter().map(layer).collect(),
        ..JointParts::default()
    })
    .unwrap()
}

fn laminate(angle: f64, plane: PlaneState) -> Arc<dyn SubstrateLaw> {
    let values = [140e3, 10e3, 0.3, 5e3, angle, 9e3, 0.25, 0.4];
    Arc::new(Orthotropic::new(&values[..if plane == PlaneState::PlaneStress { 5 } else { 8 }], plane).unwrap())
}

fn tabulated(plane: PlaneState) -> Arc<dyn SubstrateLaw> {
    let curve = [[150.0 / 72e3, 150.0], [0.004, 200.0], [0.02, 260.0], [0.06, 310.0]];
    Arc::new(Tabulated::new([72e3, 0.33, 1.0], &curve, plane).unwrap())
}

/// Slope of the displacements across the layer (of u_x, of u_y) under which its stress gives the tractions `pull`
/// (along, across) on its faces while it is stretched by `a` along them.
fn across(law: &dyn SubstrateLaw, a: f64, pull: [f64; 2], small: bool) -> [f64; 2] {
    let off = |[f, g]: [f64; 2]| {
        let strain = match small {
            true => EngineeringStrain { xx: a, yy: g, gamma_xy: f },
            false => EngineeringStrain { xx: a + 0.5 * a * a, yy: g + 0.5 * (f * f + g * g), gamma_xy: (1.0 + a) * f },
        };
        let Stress([_, y, shear]) = law.stress(strain);
        match small {
            true => [shear - pull[0], y - pull[1]],
            false => [(1.0 + a) * shear + f * y - pull[0], (1.0 + g) * y - pull[1]],
        }
    };
    let mut at = [0.0; 2];
    for _ in 0..60 {
        let (here, h) = (off(at), 1e-7);
        let (by_f, by_g) = (off([at[0] + h, at[1]]), off([at[0], at[1] + h]));
        let m = nalgebra::Matrix2::new(
            (by_f[0] - here[0]) / h,
            (by_g[0] - here[0]) / h,
            (by_f[1] - here[1]) / h,
            (by_g[1] - here[1]) / h,
        );
        let step = m.try_inverse().unwrap() * nalgebra::Vector2::from(here);
        at = [at[0] - step[0], at[1] - step[1]];
    }
    at
}

#[test]
fn layers_of_different_materials_carry_a_uniform_traction_in_both_kinematics_and_plane_states() {
    let law = adhesive([1.0; 4]);
    let jump = Jump { normal: 0.0021, tangential: -0.0013 };
    let Traction { normal, tangential } = law.response(jump).traction;
    let (columns, rows) = (5, 4);
    let mesh = layered(columns, rows, SIZE, GAP);
    for plane in [PlaneState::PlaneStress, PlaneState::PlaneStrain] {
        let materials = vec![laminate(30.0, plane), tabulated(plane), laminate(-45.0, plane), laminate(90.0, plane)];
        for kinematics in [Kinematics::Objective, Kinematics::Finite] {
            let a = 2e-3;
            let slopes: Vec<[f64; 2]> = (materials.iter())
                .map(|law| across(&**law, a, [tangential, normal], kinematics != Kinematics::Finite))
                .collect();
            // From the face outwards: the inner layer, then the outer one.
            let half = 0.5 * rows as f64 * SIZE;
            let field: Vec<[f64; 2]> = (mesh.nodes().iter())
                .map(|&[x, y]| {
                    let (side, inner, outer) = if y > 0.0 { (1.0, 2, 3) } else { (-1.0, 1, 0) };
                    let depth = y.abs() - 0.5 * GAP;
                    let (near, far) = (depth.min(half), (depth - half).max(0.0));
                    let sum = |c: usize| side * (near * slopes[inner][c] + far * slopes[outer][c]);
                    [a * x + sum(0) + 0.5 * side * jump.tangential, sum(1) + 0.5 * side * jump.normal]
                })
                .collect();
            let options = ModelOptions { kinematics, ..ModelOptions::default() };
            let nodes = mesh.outer_nodes();
            let model = Model::new(mesh.clone(), materials.clone(), &nodes, options).unwrap();
            let forces = model.forces(&law, &field);
            let free = (0..forces.len()).filter(|&node| model.unknown(node, 0).is_some());
            let residual = free.map(|node| forces[node][0].hypot(forces[node][1])).fold(0.0, f64::max);
            assert!(residual < 1e-9 * largest(&forces), "{plane:?} {kinematics:?}: {residual:e}");
            // And it is what the iteration finds.
            let steps: Vec<Vec<[f64; 2]>> = (1..=3)
                .map(|k| nodes.iter().map(|&n| field[n as usize].map(|u| f64::from(k) / 3.0 * u)).collect())
                .collect();
            let boundary = BoundaryHistory::new(nodes, steps).unwrap();
            let found = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
            assert!(found.converged());
            let off = difference(&found.instants[2].displacement, &field);
            assert!(off < 1e-9 * largest(&field), "{plane:?} {kinematics:?}: {off:e}");
        }
    }
}

#[test]
fn a_laminate_that_is_turned_with_its_joint_keeps_its_forces() {
    let law = adhesive([1.0; 4]);
    let angle = 40.0_f64;
    let (sin, cos) = angle.to_radians().sin_cos();
    let turn = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
    let mesh = layered(6, 2, SIZE, GAP);
    let turned = JointMesh::new(JointParts {
        nodes: mesh.nodes().iter().map(|&at| turn(at)).collect(),
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        ..JointParts::default()
    })
    .unwrap();
    let field: Vec<[f64; 2]> = (mesh.nodes().iter())
        .map(|&[x, y]| [1e-3 * x + 2e-3 * x * y + 5e-4 * y.signum(), -3e-3 * x * x + 1e-3 * y + 1e-3 * y.signum()])
        .collect();
    let around: Vec<[f64; 2]> = field.iter().map(|&u| turn(u)).collect();
    // And once more by a rigid rotation of what is deformed, which finite rotations do not feel.
    let rolled: Vec<[f64; 2]> = (mesh.nodes().iter().zip(&field))
        .map(|(&[x, y], u)| {
            let now = turn([x + u[0], y + u[1]]);
            [now[0] - x, now[1] - y]
        })
        .collect();
    for kinematics in [Kinematics::Objective, Kinematics::Finite] {
        let options = ModelOptions { kinematics, ..ModelOptions::default() };
        let of = |mesh: &JointMesh, by: f64| {
            let plane = PlaneState::PlaneStress;
            let materials = [20.0, -45.0, 90.0, 0.0].map(|own| laminate(own + by, plane)).to_vec();
            Model::new(mesh.clone(), materials, &mesh.outer_nodes(), options).unwrap()
        };
        let straight = of(&mesh, 0.0).forces(&law, &field);
        let wanted: Vec<[f64; 2]> = straight.iter().map(|&force| turn(force)).collect();
        let found = of(&turned, angle).forces(&law, &around);
        assert!(difference(&found, &wanted) < 1e-11 * largest(&wanted), "{kinematics:?}");
        let other = of(&turned, angle + 10.0).forces(&law, &around);
        assert!(difference(&other, &wanted) > 1e-2 * largest(&wanted), "the angle matters");
        if kinematics == Kinematics::Finite {
            let found = of(&mesh, 0.0).forces(&law, &rolled);
            assert!(difference(&found, &wanted) < 1e-10 * largest(&wanted));
        }
    }
}

fn write_layered(folder: &Path, substrate: &str) -> Vec<Vec<[f64; 2]>> {
    let mesh = layered(10, 4, SIZE, GAP);
    let nodes = mesh.outer_nodes();
    let json = serde_json::json!({
        "nodes": mesh.nodes(), "quads": mesh.elements(), "cohesive": mesh.interfaces(),
        "groups": mesh.groups(), "quad_group": mesh.element_group(),
    });
    std::fs::write(folder.join("mesh.json"), json.to_string()).unwrap();
    std::fs::write(folder.join("curve.csv"), "# uniaxial\nstrain,stress_MPa\n0.0025,180\n0.004,200\n0.02,260\n")
        .unwrap();
    let at = |k: u32, node: u32| {
        let [x, y] = mesh.nodes()[node as usize];
        let (side, t) = (y.signum(), f64::from(k));
        [side * 0.004 * t, side * 0.0012 * t * (0.2 + 6.0 * x)]
    };
    let instants: Vec<Vec<[f64; 2]>> = (1..=6).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
    let mut border = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for (k, values) in instants.iter().enumerate() {
        for (&node, u) in nodes.iter().zip(values) {
            let [x, y] = mesh.nodes()[node as usize];
            writeln!(border, "{},{node},{x},{y},{:.17e},{:.17e}", k + 1, u[0], u[1]).unwrap();
        }
    }
    std::fs::write(folder.join("border.csv"), border).unwrap();
    let text = |law: &str, rest: &str| {
        format!(
            "[mesh]\nfile = 'mesh.json'\n[boundary]\nfile = 'border.csv'\n{substrate}[cohesive]\n{law}r = 4.0\nexact = true\n{rest}"
        )
    };
    let path = folder.join("case.toml");
    std::fs::write(&path, text("phi_n_N_per_mm = 1.0\ndelta_n_mm = 0.005\ndelta_t_mm = 0.05\n", "")).unwrap();
    let Ok(input) = read_joint(&path) else { return Vec::new() };
    let Ok(joint) = Case::joint(&input) else { return Vec::new() };
    let solution = joint.model.forward(&*joint.law, &joint.boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged());
    let fields: Vec<Vec<[f64; 2]>> = solution.instants.into_iter().map(|instant| instant.displacement).collect();
    std::fs::write(folder.join("measured.csv"), measured_table(&fields, || 0.0)).unwrap();
    let rest = "[measurement]\nfile = 'measured.csv'\nnodes = 'free'\nweights = 'uniform'\nboundary = 'exact'\nnoise_mm = 1e-4\n\
                [fit]\nparameters = ['phi_n', 'delta_n', 'delta_t']\nexact = true\nintervals = 'linear'\n";
    std::fs::write(&path, text("phi_n_N_per_mm = 1.3\ndelta_n_mm = 0.004\ndelta_t_mm = 0.06\n", rest)).unwrap();
    fields
}

const LAMINATE: &str = "[substrate]\nmodel = 'orthotropic'\nE_1_MPa = 140e3\nE_2_MPa = 10e3\nnu_12 = 0.3\nG_12_MPa = 5e3\nangle_deg = 0\n\
                        [substrate.lower_inner]\nmodel = 'orthotropic'\nE_1_MPa = 140e3\nE_2_MPa = 10e3\nnu_12 = 0.3\nG_12_MPa = 5e3\n\
                        angle_deg = 45.0\nangle_deg_std = 2.0\n\
                        [substrate.upper_outer]\nmodel = 'tabulated'\nE_MPa = 72e3\nnu = 0.33\nfile = 'curve.csv'\n";

#[test]
fn layers_fit_and_each_constant_of_each_layer_has_its_line() {
    let folder = tempfile::tempdir().unwrap();
    write_layered(folder.path(), LAMINATE);
    let path = folder.path().join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let groups: Vec<&str> = joint.groups.iter().map(|group| group.name.as_str()).collect();
    assert_eq!(groups, ["lower_outer+lower_inner", "upper_inner+upper_outer"]);
    let case = Case::new(&joint, &input, &path).unwrap();
    let found = fit(&case.problem, &case.options).unwrap();
    for (p, truth) in found.parameters.iter().zip([1.0, 0.005, 0.05]) {
        assert_close(p.value, truth, 1e-6 * truth, p.parameter.name);
    }
    assert!(found.verdict.outcome != Outcome::Rejected, "{:?}", found.verdict.sentences);
    let line =
        |name: &str| found.budget.lines.iter().find(|line| line.name == name).unwrap_or_else(|| panic!("no {name}"));
    assert_eq!(line("angle_lower_inner").std, Some(2.0));
    assert_eq!((line("angle").std, line("E_1").std, line("nu_12").std), (Some(1.0), Some(4200.0), Some(0.01)));
    assert_eq!((line("curve_factor_upper_outer").std, line("E_upper_outer").std), (Some(0.05), Some(2160.0)));
    for name in ["angle_lower_inner", "E_1", "curve_factor_upper_outer"] {
        assert!(line(name).parameters.iter().any(|by| by.abs() > 1e-9), "{name} does something");
    }
    assert!(
        found.verdict.given.iter().any(|text| text.contains("angle = 45 deg (lower_inner)")),
        "{:?}",
        found.verdict.given
    );
}

#[test]
fn what_is_wrong_with_a_material_is_one_clear_line() {
    let refused = |from: &str, to: &str, words: &[&str]| {
        assert!(LAMINATE.contains(from), "{from}");
        let folder = tempfile::tempdir().unwrap();
        write_layered(folder.path(), &LAMINATE.replacen(from, to, 1));
        let error = match read_joint(&folder.path().join("case.toml")) {
            Err(error) => error.to_string(),
            Ok(input) => Case::joint(&input).unwrap_err().to_string(),
        };
        assert!(words.iter().all(|word| error.contains(word)) && error.lines().count() == 1, "{words:?}: {error}");
    };
    refused("angle_deg = 0\n", "", &["substrate", "angle_deg is missing", "orthotropic"]);
    refused("E_1_MPa = 140e3", "E_1_MPa = -140e3", &["E_1_MPa is -140000", "above zero"]);
    refused("nu_12 = 0.3", "nu_12 = 4.0", &["nu_12 is 4", "nu_21"]);
    refused("model = 'orthotropic'", "model = 'orthotropic'\nplane = 'strain'", &["E_3_MPa is missing"]);
    refused(
        "G_12_MPa = 5e3\nangle_deg = 0",
        "G_12_MPa = 5e3\nangle_deg = 0\nE_3_MPa = 1.0",
        &["E_3_MPa", "no such key"],
    );
    refused("file = 'curve.csv'", "file = 'none.csv'", &["none.csv", "no such file"]);
    refused("file = 'curve.csv'", "", &["substrate.upper_outer", "file is missing"]);
    refused("file = 'curve.csv'", "curve = [[0.004, 200.0], [0.003, 250.0]]", &["row 2", "rise"]);
    refused("file = 'curve.csv'", "file = 'border.csv'", &["border.csv", "strain,stress_MPa"]);
    refused("file = 'curve.csv'", "file = 'curve.csv'\ncurve = [[0.004, 200.0]]", &["both given"]);
    refused("angle_deg = 0\n", "angle_deg = 0\nfile = 'curve.csv'\n", &["curve", "tabulated"]);
}

/// A double cantilever beam of arms `height` thick, cracked over `crack` of `columns` columns of elements, pulled apart
/// by `opening`.
fn beam(
    columns: u32,
    rows: u32,
    size: f64,
    crack: u32,
    materials: &[Arc<dyn SubstrateLaw>],
    kinematics: Kinematics,
) -> Model {
    let whole = layered(columns as usize, rows as usize, size, 0.1);
    let mesh = JointMesh::new(JointParts {
        nodes: whole.nodes().to_vec(),
        elements: whole.elements().to_vec(),
        interfaces: whole.interfaces()[crack as usize..].to_vec(),
        groups: whole.groups().to_vec(),
        element_group: whole.element_group().to_vec(),
        ..JointParts::default()
    })
    .unwrap();
    let end = |node: &u32| mesh.nodes()[*node as usize][0] == 0.0;
    let ends: Vec<u32> = (0..mesh.nodes().len() as u32).filter(end).collect();
    let options = ModelOptions { kinematics, ..ModelOptions::default() };
    Model::new(mesh, materials.to_vec(), &ends, options).unwrap()
}

/// Displacements of the beam whose ends are pulled apart by `opening` without turning, and the energy that it stores.
fn pulled(model: &Model, law: &dyn CohesiveLaw, opening: f64) -> (Vec<[f64; 2]>, f64) {
    let nodes = model.prescribed().to_vec();
    let at = |&node: &u32| [0.0, 0.5 * opening * model.mesh().nodes()[node as usize][1].signum()];
    let boundary = BoundaryHistory::new(nodes.clone(), vec![nodes.iter().map(at).collect()]).unwrap();
    let solution = model.forward(law, &boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged());
    let u = solution.instants[0].displacement.clone();
    let groups = NodeGroup::of_strips(model.mesh(), &nodes);
    let force = model.reactions(law, &u, &groups)[1][1];
    (u, 0.5 * force * opening)
}

#[test]
fn the_j_integral_is_the_energy_that_a_longer_crack_releases_whatever_the_domain() {
    // Stiff, and far from its peak: everything is linear.
    let law = law_by_name("bilinear-power", &[2e4, 4000.0, 4000.0, 1000.0, 1000.0, 1.0]).unwrap();
    let plane = PlaneState::PlaneStress;
    let elastic: Arc<dyn SubstrateLaw> = Arc::new(LinearElastic::new(72e3, 0.33, plane).unwrap());
    // Eight elements across each arm: bending of bilinear elements is off by the square of their size.
    let (columns, rows, size, crack) = (160, 8, 0.125, 80);
    for (name, materials) in [
        ("aluminium", vec![Arc::clone(&elastic); 4]),
        ("laminate", vec![laminate(0.0, plane), laminate(90.0, plane), laminate(90.0, plane), laminate(0.0, plane)]),
    ] {
        for kinematics in [Kinematics::Objective, Kinematics::Finite] {
            let of = |crack: u32| beam(columns, rows, size, crack, &materials, kinematics);
            let opening = 0.01;
            let (u, _) = pulled(&of(crack), &*law, opening);
            let found = of(crack).j_integral(&*law, &u).unwrap();
            let stored = |crack: u32| pulled(&of(crack), &*law, opening).1;
            // Central: the error is that of da^2, (0.125/10)^2 of it.
            let wanted = (stored(crack - 1) - stored(crack + 1)) / (2.0 * size);
            println!("{name} {kinematics:?}: {found:?} for {wanted:.6e}");
            assert_close(found.value, wanted, 0.012 * wanted, format!("{name} {kinematics:?}"));
            // The tractions at the tip fall over half a millimetre (laminate) to one: off by the first order of an
            // element.
            assert_close(found.of_tractions, wanted, 0.12 * wanted, format!("{name} {kinematics:?}, of the tractions"));
            assert!(found.spread < 0.01 * wanted && found.along, "{found:?}");
        }
    }
}

#[test]
fn the_work_of_separation_tells_opening_from_sliding_and_a_loaded_border_has_no_j_integral() {
    let mesh = JointMesh::rectangular(8, 2, SIZE, GAP).unwrap();
    let nodes = mesh.outer_nodes();
    let law = law_by_name("bilinear-power", &[2e4, 40.0, 40.0, 0.4, 0.8, 1.0]).unwrap();
    let elastic: Arc<dyn SubstrateLaw> = Arc::new(LinearElastic::new(72e3, 0.33, PlaneState::PlaneStress).unwrap());
    let model = Model::new(mesh.clone(), vec![Arc::clone(&elastic), elastic], &nodes, ModelOptions::default()).unwrap();
    let apart = |by: [f64; 2]| -> Vec<Vec<[f64; 2]>> {
        let at = |t: f64| mesh.nodes().iter().map(|x| by.map(|by| 0.5 * t * by * x[1].signum())).collect();
        (1..=40).map(|k| at(f64::from(k) / 40.0)).collect()
    };
    // Pulled straight through to the end of each mode: all of its work, and nothing of the other.
    for (by, wanted) in [([0.0, 0.05], [0.4, 0.0]), ([0.08, 0.0], [0.0, 0.8])] {
        let works = model.mode_works(&*law, &apart(by));
        let last = works[39][3];
        assert_close(last.opening, wanted[0], 1e-6, "opening");
        assert_close(last.sliding, wanted[1], 1e-6, "sliding");
        assert_close(last.sliding_share().unwrap(), if wanted[0] > 0.0 { 0.0 } else { 1.0 }, 1e-9, "share");
    }
    assert_eq!(model.j_integral(&*law, &apart([0.0, 0.01])[10]), Err(JFault::Loaded));
}
