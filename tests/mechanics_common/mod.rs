//! What the tests of the mechanics share: the reference numbers where their folder is there, and comparisons.
#![allow(dead_code)] // each test program uses its own part

use quadrille::mechanics::cohesive::{CohesiveLaw, ExtendedXuNeedleman};
use quadrille::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, JointParts, Model, ModelOptions};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The folder of the reference numbers (QUADRILLE_REFERENCE); says so when it is not there.
pub fn reference_folder() -> Option<PathBuf> {
    let folder = std::env::var_os("QUADRILLE_REFERENCE")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/reference"), PathBuf::from);
    if !folder.is_dir() {
        assert!(std::env::var_os("QUADRILLE_REFERENCE").is_none(), "QUADRILLE_REFERENCE names no folder");
        println!("skipped: the reference numbers are not there (QUADRILLE_REFERENCE)");
        return None;
    }
    Some(folder)
}

/// A file of the reference folder, as JSON.
#[track_caller]
pub fn reference(name: &str) -> Option<Value> {
    let path = reference_folder()?.join(name);
    let text = std::fs::read_to_string(&path).expect("a file of the reference folder");
    Some(serde_json::from_str(&text).expect("JSON"))
}

/// A number of a JSON file.
#[track_caller]
pub fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// The entry called `key`, as a number.
#[track_caller]
pub fn get(value: &Value, key: &str) -> f64 {
    number(&value[key])
}

/// A list of numbers.
#[track_caller]
pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(number).collect()
}

/// A list of lists of numbers.
#[track_caller]
pub fn table(value: &Value) -> Vec<Vec<f64>> {
    value.as_array().expect("a list").iter().map(numbers).collect()
}

#[track_caller]
pub fn assert_close(found: f64, wanted: f64, tolerance: f64, what: impl std::fmt::Display) {
    let off = (found - wanted).abs();
    assert!(off <= tolerance, "{what}: {found:e} for {wanted:e}, off by {off:e}, allowed {tolerance:e}");
}

/// Derivative of `f` at `x` by five points, with the step `h`.
pub fn five_points(f: impl Fn(f64) -> f64, x: f64, h: f64) -> f64 {
    (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h)
}

/// The aluminium of the reference test.
pub fn aluminium(groups: usize) -> Vec<Arc<dyn SubstrateLaw>> {
    let law = RambergOsgood::new([72000.0, 0.33, 180.0, 0.06, 7.0], PlaneState::PlaneStress).unwrap();
    vec![Arc::new(law) as Arc<dyn SubstrateLaw>; groups]
}

/// The adhesive of the reference test, with its parameters times `factors`.
pub fn adhesive(factors: [f64; 4]) -> ExtendedXuNeedleman {
    let [phi_n, delta_n, delta_t, r] = factors;
    ExtendedXuNeedleman::new(phi_n, 0.005 * delta_n, 0.05 * delta_t, 4.0 * r).unwrap()
}

pub fn quads_of(value: &Value) -> Vec<[u32; 4]> {
    let quad = |v: Vec<f64>| std::array::from_fn(|k| v[k] as u32);
    table(value).into_iter().map(quad).collect()
}

/// A mesh of the reference files.
#[track_caller]
pub fn joint_of(mesh: &Value) -> JointMesh {
    let nodes = table(&mesh["nodes"]).into_iter().map(|v| [v[0], v[1]]).collect();
    let parts = JointParts {
        nodes,
        elements: quads_of(&mesh["quads"]),
        interfaces: quads_of(&mesh["cohesive"]),
        ..JointParts::default()
    };
    JointMesh::new(parts).unwrap()
}

/// Mesh and prescribed displacements of the 19-instant test.
pub fn virtual_r4() -> Option<(JointMesh, BoundaryHistory)> {
    let mesh = joint_of(&reference("virtual_r4/mesh.json")?);
    let path = reference_folder()?.join("virtual_r4/boundary_displacements.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let (mut nodes, mut instants): (Vec<u32>, Vec<Vec<[f64; 2]>>) = (Vec::new(), Vec::new());
    for line in text.lines().skip(1) {
        let fields: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
        if fields[0] as usize > instants.len() {
            instants.push(Vec::new());
        }
        if instants.len() == 1 {
            nodes.push(fields[1] as u32);
        }
        instants.last_mut().unwrap().push([fields[4], fields[5]]);
    }
    Some((mesh, BoundaryHistory::new(nodes, instants).unwrap()))
}

#[track_caller]
pub fn model_of(mesh: &JointMesh, boundary: &BoundaryHistory, options: ModelOptions) -> Model {
    Model::new(mesh.clone(), aluminium(mesh.groups().len()), boundary.nodes(), options).unwrap()
}

/// Largest component, in magnitude.
pub fn largest(field: &[[f64; 2]]) -> f64 {
    field.iter().flatten().fold(0.0, |most, u| most.max(u.abs()))
}

/// Largest difference of a component.
#[track_caller]
pub fn difference(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().flatten().zip(b.iter().flatten()).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

/// The same law with another value of parameter `k`.
pub fn with_value(law: &dyn CohesiveLaw, k: usize, value: f64) -> Box<dyn CohesiveLaw> {
    let mut values = law.values();
    values[k] = value;
    law.with_values(&values).unwrap()
}

/// A joint that was pulled: the table of its border, and its displacements at every instant, mm.
pub struct Pulled {
    pub border: String,
    pub fields: Vec<Vec<[f64; 2]>>,
}

/// Two strips of `columns` x `rows` elements that open, and the more so by `uneven` towards one end, over `n` instants;
/// phi_n = 1, delta_n = 0.005, delta_t = 0.05, r = 4.
pub fn pulled(columns: usize, rows: usize, n: u32, uneven: f64) -> Pulled {
    let mesh = JointMesh::rectangular(columns, rows, 0.0309, 0.06).unwrap();
    let nodes = mesh.outer_nodes();
    let at = |k: u32, node: u32| {
        let [x, y] = mesh.nodes()[node as usize];
        let (side, t) = (y.signum(), f64::from(k));
        [side * 0.004 * t, side * uneven * t * (0.1 + 4.0 * x)]
    };
    let instants: Vec<Vec<[f64; 2]>> = (1..=n).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
    let boundary = BoundaryHistory::new(nodes.clone(), instants).unwrap();
    let model = Model::new(mesh, aluminium(2), &nodes, ModelOptions::default()).unwrap();
    let law = ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).unwrap();
    let solution = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
    let fields: Vec<_> = solution.instants.into_iter().map(|instant| instant.displacement).collect();
    Pulled { border: border_table(model.mesh(), &nodes, &fields), fields }
}

/// The table of displacements of the prescribed `nodes`.
pub fn border_table(mesh: &JointMesh, nodes: &[u32], fields: &[Vec<[f64; 2]>]) -> String {
    let mut table = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for (k, field) in fields.iter().enumerate() {
        for &node in nodes {
            let ([x, y], u) = (mesh.nodes()[node as usize], field[node as usize]);
            table += &format!("{},{node},{x},{y},{:.17e},{:.17e}\n", k + 1, u[0], u[1]);
        }
    }
    table
}

/// The table of displacements of all nodes, each with an error of its own, mm.
pub fn measured_table(fields: &[Vec<[f64; 2]>], mut error: impl FnMut() -> f64) -> String {
    let mut table = "instant,node,ux_mm,uy_mm\n".to_owned();
    for (k, field) in fields.iter().enumerate() {
        for (node, u) in field.iter().enumerate() {
            let u = u.map(|u| u + error());
            table += &format!("{},{node},{:.17e},{:.17e}\n", k + 1, u[0], u[1]);
        }
    }
    table
}

/// The mesh with its nodes moved by `place`.
#[track_caller]
pub fn moved(mesh: &JointMesh, place: impl Fn(usize, [f64; 2]) -> [f64; 2]) -> JointMesh {
    let parts = JointParts {
        nodes: mesh.nodes().iter().enumerate().map(|(k, &x)| place(k, x)).collect(),
        elements: mesh.elements().to_vec(),
        interfaces: mesh.interfaces().to_vec(),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        ..JointParts::default()
    };
    JointMesh::new(parts).unwrap()
}

/// A place turned about the origin, radians.
pub fn rotated([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}
