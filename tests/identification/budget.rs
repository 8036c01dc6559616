//! The error budget of a fit: every effect against a refit with the constant moved; defaults, what switches a line off,
//! typos; implausible values.

use crate::mechanics_common;
use mechanics_common::{border_table, measured_table};
use quadrille::identify::{
    Budget, BudgetLine, Case, Constant, ConstantKind, ELEMENT_SIZE, Face, Fit, NORMAL_95, Source, WORK_REACHED, bands,
    fit, work_along,
};
use quadrille::io::case::{CaseExact, CaseFit, CaseForce, CaseMaterial, CaseSubstrate};
use quadrille::io::joint::{
    BoundaryInput, ForceInput, JointInput, JointMeshFile, JointRun, MeasurementInput, MeasurementTable, MeshInput,
    RunCamera, RunMatrix, read_joint,
};
use quadrille::linalg::alike;
use quadrille::mechanics::cohesive::{ExtendedXuNeedleman, law_by_name};
use quadrille::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{
    BoundaryHistory, ForwardOptions, Joint, JointMesh, Kinematics, Model, ModelOptions, NodeGroup,
};
use quadrille::mesh::ElementGeometry;
use quadrille::remark::{About, Code, Remark};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

const PIXEL_MM: f64 = 0.0019;
const SIZE: f64 = 16.0 * PIXEL_MM;
const GAP: f64 = 0.06;
/// Of the specimen, mm.
const WIDTH: f64 = 10.0;
const TRUTH: [f64; 4] = [1.0, 0.005, 0.05, 4.0];
const ALUMINIUM: [f64; 5] = [72_000.0, 0.33, 180.0, 0.06, 7.0];

fn mesh() -> JointMesh {
    JointMesh::rectangular(12, 4, SIZE, GAP).unwrap()
}

/// Displacements of all nodes of a small joint that opens and slides while its strips bend and yield a little.
fn fields(kinematics: Kinematics) -> &'static Vec<Vec<[f64; 2]>> {
    static FIELDS: [OnceLock<Vec<Vec<[f64; 2]>>>; 2] = [OnceLock::new(), OnceLock::new()];
    FIELDS[usize::from(kinematics == Kinematics::Objective)].get_or_init(|| {
        let mesh = mesh();
        let nodes = mesh.outer_nodes();
        let at = |k: u32, node: u32| {
            let ([x, y], t) = (mesh.nodes()[node as usize], f64::from(k));
            let side = y.signum();
            [side * 0.0025 * t + 2e-3 * t * x, side * 0.0018 * t * (0.2 + 9.0 * x * x) - 1e-3 * t * y]
        };
        let instants = (1..=5).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
        let boundary = BoundaryHistory::new(nodes.clone(), instants).unwrap();
        let material: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(ALUMINIUM, PlaneState::PlaneStress).unwrap());
        let materials = vec![Arc::clone(&material), material];
        let model =
            Model::new(mesh, materials, &nodes, ModelOptions { kinematics, ..ModelOptions::default() }).unwrap();
        let [phi_n, delta_n, delta_t, r] = TRUTH;
        let law = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r).unwrap();
        let solution = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
        solution.instants.into_iter().map(|instant| instant.displacement).collect()
    })
}

/// The case of the joint with the jump of the paper; `measurement` and `fit` are further lines of their tables.
fn input(measurement: &str, fit: &str) -> JointInput {
    input_of(Kinematics::Paper, measurement, fit)
}

fn input_of(kinematics: Kinematics, measurement: &str, fit: &str) -> JointInput {
    let folder = tempfile::tempdir().unwrap();
    let mesh = mesh();
    let fields = fields(kinematics);
    std::fs::write(folder.path().join("border.csv"), border_table(&mesh, &mesh.outer_nodes(), fields)).unwrap();
    std::fs::write(folder.path().join("measured.csv"), measured_table(fields, || 0.0)).unwrap();
    let [e, nu, sigma_0, alpha, n] = ALUMINIUM;
    let [phi_n, delta_n, delta_t, r] = TRUTH;
    let text = format!(
        "[mesh]\nelement_size_mm = {SIZE}\ncolumns = 12\nrows = 4\ngap_mm = {GAP}\n[boundary]\nfile = \"border.csv\"\n\
         [substrate]\nE_MPa = {e:?}\nnu = {nu}\nsigma_0_MPa = {sigma_0:?}\nalpha = {alpha}\nn = {n:?}\n\
         [cohesive]\nphi_n_N_per_mm = {phi_n:?}\ndelta_n_mm = {delta_n}\ndelta_t_mm = {delta_t}\nr = {r:?}\n\
         kinematics = \"{}\"\n[measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\nnoise_mm = 2e-5\npixel_size_mm = {PIXEL_MM}\n{measurement}\n\
         [fit]\nparameters = [\"phi_n\", \"delta_n\", \"delta_t\"]\n\
         intervals = \"linear\"\n{fit}\n",
        kinematics.name()
    );
    std::fs::write(folder.path().join("case.toml"), text).unwrap();
    read_joint(&folder.path().join("case.toml")).unwrap()
}

/// The input with the force on the upper strip along y, of the truth, beside the displacements.
fn with_force(mut input: JointInput, kinematics: Kinematics) -> JointInput {
    let mesh = mesh();
    let nodes = mesh.outer_nodes();
    let groups = NodeGroup::of_strips(&mesh, &nodes);
    let material: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(ALUMINIUM, PlaneState::PlaneStress).unwrap());
    let options = ModelOptions { kinematics, ..ModelOptions::default() };
    let model = Model::new(mesh, vec![Arc::clone(&material), material], &nodes, options).unwrap();
    let [phi_n, delta_n, delta_t, r] = TRUTH;
    let law = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r).unwrap();
    let force = |u: &Vec<[f64; 2]>| Some(WIDTH * model.reactions(&law, u, &groups)[1][1]);
    let values = fields(kinematics).iter().map(force).collect();
    let (path, column, remarks) = ("load.csv".into(), "load_N".into(), Vec::new());
    input.force = Some(ForceInput { path, column, values, remarks });
    let (group, width_mm, std_n) = (Some("upper".to_owned()), Some(WIDTH), Some(0.3));
    input.case.force = Some(CaseForce { group, width_mm, std_n, ..CaseForce::default() });
    input
}

fn fitted(input: &JointInput) -> Fit {
    let joint = Case::joint(input).unwrap();
    let case = Case::new(&joint, input, Path::new("case.toml")).unwrap();
    fit(&case.problem, &case.options).unwrap()
}

#[track_caller]
fn line<'a>(budget: &'a Budget, name: &str) -> &'a BudgetLine {
    budget.lines.iter().find(|line| line.name == name).unwrap_or_else(|| panic!("no line {name}"))
}

fn set(values: &mut BTreeMap<String, f64>, key: &str, value: f64) {
    values.insert(key.into(), value);
}

fn names(list: &[&str]) -> CaseExact {
    CaseExact::Names(list.iter().map(|&name| name.into()).collect())
}

/// The input with the mesh in a file, so that its nodes can be moved and all displacements changed: `change` gets them.
fn remade(input: &JointInput, change: impl FnOnce(&mut Vec<[f64; 2]>, &mut Vec<Vec<[f64; 2]>>)) -> JointInput {
    let mesh = mesh();
    let objective = input.case.cohesive.kinematics == Some(Kinematics::Objective);
    let kinematics = if objective { Kinematics::Objective } else { Kinematics::Paper };
    let (mut nodes, mut fields) = (mesh.nodes().to_vec(), fields(kinematics).clone());
    change(&mut nodes, &mut fields);
    let mut input = input.clone();
    let BoundaryInput::Table(border) = &mut input.boundary else { panic!("a table") };
    border.positions = border.nodes.iter().map(|&node| nodes[node as usize]).collect();
    for (values, field) in border.instants.iter_mut().zip(&fields) {
        *values = border.nodes.iter().map(|&node| field[node as usize]).collect();
    }
    let Some(MeasurementInput::Table(MeasurementTable { instants, .. })) = &mut input.measurement else {
        panic!("a table")
    };
    *instants = (1..)
        .zip(&fields)
        .map(|(k, field)| (k, (0..).zip(field.iter().copied()).collect::<BTreeMap<_, _>>()))
        .collect();
    input.mesh = MeshInput::File(JointMeshFile {
        nodes,
        elements: mesh.elements().to_vec(),
        interfaces: Some(mesh.interfaces().to_vec()),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        ..JointMeshFile::default()
    });
    input
}

/// The face nodes of a strip with those one row behind them.
fn face(face: Face) -> Vec<[usize; 2]> {
    let mesh = mesh();
    let row = 13;
    mesh.pairs()
        .iter()
        .map(|&[lower, upper]| match face {
            Face::Lower => [lower as usize, lower as usize - row],
            Face::Upper => [upper as usize, upper as usize + row],
        })
        .collect()
}

/// The input as if the constant had been off by `share` of its standard uncertainty.
fn with_moved(input: &JointInput, constant: &Constant, share: f64) -> JointInput {
    let mut other = input.clone();
    let by = share * constant.std;
    match &constant.kind {
        ConstantKind::Material { index, .. } => {
            let keys = ["E_MPa", "nu", "sigma_0_MPa", "alpha", "n"];
            set(&mut other.case.substrate.common.values, keys[*index], ALUMINIUM[*index] + by);
        }
        ConstantKind::Law { index: 3 } => set(&mut other.case.cohesive.values, "r", TRUTH[3] + by),
        ConstantKind::Law { index } => panic!("{index}"),
        ConstantKind::Thickness => {
            return remade(input, |nodes, _| {
                let upper = nodes.len() / 2;
                nodes[upper..].iter_mut().for_each(|at| at[1] += by);
            });
        }
        ConstantKind::Face(side) => {
            return remade(input, |nodes, fields| {
                for [node, behind] in face(*side) {
                    let height = nodes[node][1] - nodes[behind][1];
                    nodes[node][1] += by;
                    for field in fields.iter_mut() {
                        let slope = [0, 1].map(|c| (field[node][c] - field[behind][c]) / height);
                        field[node] = [0, 1].map(|c| field[node][c] + by * slope[c]);
                    }
                }
            });
        }
        ConstantKind::PixelSize => {
            let factor = 1.0 + by / constant.value.unwrap();
            return remade(input, |nodes, fields| {
                nodes.iter_mut().chain(fields.iter_mut().flatten()).for_each(|at| *at = at.map(|v| factor * v));
            });
        }
        ConstantKind::Width => other.case.force.as_mut().unwrap().width_mm = Some(WIDTH + by),
        ConstantKind::NoiseLevel => panic!("it moves nothing"),
        ConstantKind::Camera { term } => panic!("{term}: of runs alone"),
    }
    other
}

#[test]
fn the_effect_of_every_constant_is_what_a_refit_with_it_moved_changes() {
    // Small steps: what is left of the second order is their share of the first.
    let share = 0.02;
    let tolerance = 0.02;
    for (measurement, kinematics, parameters, force) in [
        ("weights = \"uniform\"\nboundary = \"exact\"", Kinematics::Paper, 3, false),
        ("weights = \"covariance\"", Kinematics::Objective, 3, false),
        // A prescribed length of the law does not grow with the pixel.
        ("weights = \"paper\"", Kinematics::Paper, 1, false),
        ("boundary = \"exact\"", Kinematics::Objective, 3, true),
    ] {
        let mut input = input_of(kinematics, measurement, "discretisation = \"off\"");
        if force {
            input = with_force(input, kinematics);
        }
        if parameters == 1 {
            input.case.fit.as_mut().unwrap().parameters.truncate(1);
            input.case.cohesive.exact = Some(names(&["delta_n", "delta_t"]));
        }
        let found = fitted(&input);
        let joint = Case::joint(&input).unwrap();
        let case = Case::new(&joint, &input, Path::new("case.toml")).unwrap();
        let mut moved_anything = 0;
        for constant in &case.options.constants {
            if constant.kind == ConstantKind::NoiseLevel || constant.source == Source::Exact {
                continue;
            }
            assert_eq!(constant.source, Source::Default, "{constant:?}");
            let told = line(&found.budget, &constant.name);
            let refit = fitted(&with_moved(&input, constant, share));
            for (k, (p, other)) in found.parameters.iter().zip(&refit.parameters).enumerate() {
                let change = (other.value - p.value) / share;
                let told = told.parameters[k];
                println!(
                    "{measurement:?} {} {}: {:.4e} told {:.4e}",
                    constant.name,
                    p.parameter.name,
                    change / p.value,
                    told / p.value
                );
                // Where the effect is nothing beside the others, so is its second order: 1e-5 of the value.
                let allowed = tolerance * change.abs() + 1e-5 * p.value;
                assert!(
                    (told - change).abs() < allowed,
                    "{}, {}: {told} for {change}",
                    constant.name,
                    p.parameter.name
                );
                moved_anything += usize::from(change.abs() > 1e-4 * p.value);
            }
            // At the same jump, as it is stated.
            let law = |of: &Fit| law_by_name("extended-xu-needleman", &of.values).unwrap();
            for (k, (q, other)) in found.derived.iter().zip(&refit.derived).enumerate() {
                let there = match q.quantity.name {
                    WORK_REACHED => work_along(&*law(&refit), found.furthest.unwrap()),
                    _ => other.quantity.value,
                };
                let change = (there - q.quantity.value) / share;
                let allowed = 2.0 * tolerance * change.abs() + 5e-5 * q.quantity.value;
                let told = told.derived[k];
                assert!((told - change).abs() < allowed, "{}, {}: {told} for {change}", constant.name, q.quantity.name);
            }
        }
        assert!(moved_anything > 5, "{moved_anything}");
    }
}

/// The same as a correlation run, with a camera that is off by a lens, a tilt and a distance.
fn of_run(input: &JointInput) -> JointInput {
    let (mesh, fields) = (mesh(), fields(Kinematics::Objective));
    let file = JointMeshFile {
        nodes: mesh.nodes().to_vec(),
        elements: mesh.elements().to_vec(),
        groups: mesh.groups().to_vec(),
        element_group: mesh.element_group().to_vec(),
        mm_per_px: Some(PIXEL_MM),
        ..JointMeshFile::default()
    };
    // What a lens, a tilt and a distance of usual uncertainty make of a shift of 0.04 mm an instant.
    let (centre, half) = ([0.18, 0.0], 0.5);
    let by = |change: &dyn Fn([f64; 2], f64) -> [f64; 2]| -> Vec<Vec<[f64; 2]>> {
        let at = |t: f64| mesh.nodes().iter().map(|[x, y]| change([x - centre[0], y - centre[1]], 0.04 * t)).collect();
        (1..=fields.len()).map(|k| at(k as f64)).collect()
    };
    let lens = by(&|[x, y], d| [1e-3 * d * (3.0 * x * x + y * y) / (half * half), 2e-3 * d * x * y / (half * half)]);
    let tilt = by(&|[x, y], d| [2e-3 * d * x / half, 1e-3 * d * y / half]);
    let distance = by(&|[x, y], _| [1e-4 * x, 1e-4 * y]);
    let term = |(name, instants): (&str, _)| RunCamera { name: name.into(), is_stated: true, instants };
    let run = JointRun {
        path: "run".into(),
        mesh: file.clone(),
        without_texture: Vec::new(),
        frames: (1..=fields.len()).collect(),
        measured_from: vec![0; fields.len()],
        instants: fields.iter().map(|field| field.iter().map(|&u| Some(u)).collect()).collect(),
        sigma: vec![vec![[2e-5; 2]; mesh.nodes().len()]; fields.len()],
        normal_matrix: None,
        n_references: 1,
        noise_grey: None,
        noise_ratio: None,
        left_out: Vec::new(),
        camera: [("lens", lens), ("tilt_x", tilt), ("distance", distance)].map(term).into(),
        warnings: Vec::new(),
    };
    let mut input = input.clone();
    input.mesh = MeshInput::Run(file);
    input.boundary = BoundaryInput::Run(run.clone());
    input.measurement = Some(MeasurementInput::Run(run));
    input
}

#[test]
fn the_effect_of_lens_tilt_and_distance_is_what_a_refit_with_the_camera_moved_changes() {
    for measurement in ["weights = \"covariance\"", "weights = \"uniform\"\nboundary = \"exact\""] {
        let input = of_run(&input_of(Kinematics::Objective, measurement, "discretisation = \"off\""));
        let found = fitted(&input);
        for (term, name) in ["lens", "tilt_x", "distance"].into_iter().enumerate() {
            // As with the other constants: what is left of the second order is the share of the first.
            let share = 0.02;
            let moved = |run: &mut JointRun| {
                let change = run.camera[term].instants.clone();
                for (field, change) in run.instants.iter_mut().zip(change) {
                    for (u, by) in field.iter_mut().zip(change) {
                        *u = u.map(|u| [u[0] + share * by[0], u[1] + share * by[1]]);
                    }
                }
            };
            let mut other = input.clone();
            let (BoundaryInput::Run(border), Some(MeasurementInput::Run(run))) =
                (&mut other.boundary, &mut other.measurement)
            else {
                panic!("a run")
            };
            [border, run].into_iter().for_each(moved);
            let (told, refit) = (line(&found.budget, name), fitted(&other));
            let mut largest = 0.0f64;
            for (k, (p, other)) in found.parameters.iter().zip(&refit.parameters).enumerate() {
                let change = (other.value - p.value) / share;
                println!("{name} {}: {change:.4e} told {:.4e}", p.parameter.name, told.parameters[k]);
                assert!(
                    (told.parameters[k] - change).abs() < 0.02 * change.abs() + 1e-5 * p.value,
                    "{measurement} {name}"
                );
                largest = largest.max((change / p.value).abs());
            }
            assert!(largest > 1e-3, "{name} {largest}");
        }
    }
}

#[test]
fn the_interval_is_the_root_of_the_sum_of_its_lines_and_an_exact_constant_has_none() {
    let found = fitted(&input("", "discretisation = \"included\""));
    let names: Vec<&str> = found.budget.lines.iter().map(|line| line.name.as_str()).collect();
    let wanted = [
        "noise",
        "E",
        "nu",
        "sigma_0",
        "alpha",
        "n",
        "r",
        "thickness",
        "face_lower",
        "face_upper",
        "pixel_size",
        "noise_level",
        ELEMENT_SIZE,
    ];
    assert_eq!(names, wanted);
    for (k, p) in found.parameters.iter().enumerate() {
        let square = |line: &BudgetLine| line.parameters[k].powi(2);
        let sum: f64 = found.budget.lines.iter().map(square).sum();
        let [low, high] = p.interval95.unwrap();
        assert!((high - low - 2.0 * NORMAL_95 * sum.sqrt()).abs() < 1e-12 * p.value, "{p:?}");
        let without: f64 = sum - line(&found.budget, ELEMENT_SIZE).parameters[k].powi(2);
        assert!((p.std.unwrap() - without.sqrt()).abs() < 1e-12 * p.value);
        assert!((found.covariance.as_ref().unwrap()[(k, k)] - without).abs() < 1e-12 * p.value.powi(2));
        assert_eq!(p.std_noise.unwrap(), line(&found.budget, "noise").parameters[k]);
        let largest = found.budget.largest(k);
        assert!(largest.windows(2).all(|pair| pair[0].1 >= pair[1].1) && largest[0].1 > p.std_noise.unwrap());
    }
    // 3 % of 72 GPa, 0.01, 5, 20, 5 %, a quarter of 4, 1 px, half a pixel, 0.5 %, a tenth.
    let px = PIXEL_MM;
    let stds = [2160.0, 0.01, 9.0, 0.012, 0.35, 1.0, px, 0.5 * px, 0.5 * px, 0.005 * px, 0.1];
    for (line, std) in found.budget.lines[1..12].iter().zip(stds) {
        assert_eq!(line.source, Source::Default, "{line:?}");
        assert!((line.std.unwrap() - std).abs() < 1e-12 * std, "{line:?}");
    }
    let mut exact = input("", "exact = true\ndiscretisation = \"off\"");
    exact.case.substrate.common.exact = Some(CaseExact::All(true));
    exact.case.cohesive.exact = Some(CaseExact::All(true));
    let exact = fitted(&exact);
    for (p, all) in exact.parameters.iter().zip(&found.parameters) {
        assert_eq!(p.std, p.std_noise);
        assert!((p.std_noise.unwrap() / all.std_noise.unwrap() - 1.0).abs() < 1e-9);
    }
    for line in &exact.budget.lines[1..] {
        assert!(line.source == Source::Exact && line.std == Some(0.0) && line.parameters.is_empty(), "{line:?}");
    }
}

#[test]
fn the_noise_level_widens_what_the_noise_does_and_moves_nothing() {
    let one = fitted(&input("noise_relative_std = 0.3", "exact = [\"faces\"]"));
    let told = line(&one.budget, "noise_level");
    assert_eq!(told.source, Source::Stated);
    let mut louder = input("", "");
    louder.case.measurement.as_mut().unwrap().noise_mm = Some(1.3 * 2e-5);
    let two = fitted(&louder);
    for (k, (p, other)) in one.parameters.iter().zip(&two.parameters).enumerate() {
        let more = other.std_noise.unwrap() - p.std_noise.unwrap();
        assert!((told.parameters[k] / more - 1.0).abs() < 1e-6, "{} {more}", told.parameters[k]);
        assert!((other.value / p.value - 1.0).abs() < 1e-9);
    }
    // Estimated from the residual, it is known as well as a variance of so many numbers.
    let mut unknown = input("", "");
    unknown.case.measurement.as_mut().unwrap().noise_mm = None;
    let estimated = fitted(&unknown);
    let level = line(&estimated.budget, "noise_level");
    assert!(level.source == Source::Computed && level.std.unwrap() < 0.05, "{level:?}");
}

#[test]
fn groups_with_tables_of_their_own_have_lines_of_their_own_and_shared_ones_share() {
    let mut two = input("", "");
    let plain = two.case.substrate.common.clone();
    let mut upper = CaseMaterial { exact: Some(names(&["alpha"])), ..plain.clone() };
    set(&mut upper.values, "E_MPa_std", 1000.0);
    set(&mut upper.values, "nu_std", 0.02);
    let lower = CaseMaterial { exact: Some(names(&["n"])), ..plain };
    let groups = [("upper".into(), upper), ("lower".into(), lower)].into();
    two.case.substrate = CaseSubstrate { groups, ..CaseSubstrate::default() };
    let two = fitted(&two);
    let source = |name: &str| line(&two.budget, name).source;
    assert_eq!((source("E_lower"), source("n_lower")), (Source::Default, Source::Exact));
    assert_eq!(
        (source("E_upper"), source("alpha_upper"), source("n_upper")),
        (Source::Stated, Source::Exact, Source::Default)
    );
    let one = fitted(&input("", ""));
    for k in 0..3 {
        for name in ["E", "nu"] {
            // Both strips together do what each alone does, the one after the other.
            let per_unit =
                |fit: &Fit, name: &str| line(&fit.budget, name).parameters[k] / line(&fit.budget, name).std.unwrap();
            let each = per_unit(&two, &format!("{name}_lower")) + per_unit(&two, &format!("{name}_upper"));
            let both = per_unit(&one, name);
            assert!((each - both).abs() < 1e-6 * both.abs(), "{name}: {each} {both}");
        }
    }
}

#[test]
fn bands_of_tractions_hold_what_a_constant_does_to_parameters_and_jumps_together() {
    let mut input = input("boundary = \"exact\"", "exact = true\ndiscretisation = \"off\"");
    input.case.measurement.as_mut().unwrap().noise_mm = Some(1e-9);
    input.case.substrate.common.exact = Some(CaseExact::All(true));
    let tractions = |input: &JointInput| {
        let joint = Case::joint(input).unwrap();
        let case = Case::new(&joint, input, Path::new("case.toml")).unwrap();
        let found = fit(&case.problem, &case.options).unwrap();
        bands(&case.problem, &found).unwrap()
    };
    let told = tractions(&input);
    // A standard uncertainty of a quarter, and a refit with a hundredth.
    let (share, step) = (0.25, 0.01);
    let mut moved = input.clone();
    set(&mut moved.case.cohesive.values, "r", TRUTH[3] * (1.0 + step));
    let moved = tractions(&moved);
    let scale = told.iter().flat_map(|band| &band.std).fold(0.0_f64, |most, t| most.max(t.normal));
    let mut largest = 0.0_f64;
    for (a, b) in told.iter().zip(&moved) {
        for (k, (t, moved)) in a.traction.iter().zip(&b.traction).enumerate() {
            let change = (moved.normal - t.normal).abs() * share / step;
            // Second order of a step of 1 %.
            assert!((a.std[k].normal - change).abs() < 0.05 * change + 0.01 * scale, "{change} {:?}", a.std[k]);
            largest = largest.max(change);
        }
    }
    assert!(largest > 0.1, "{largest} MPa");
}

/// What a case is refused with.
fn refused(change: impl FnOnce(&mut JointInput)) -> String {
    let mut input = input("", "");
    change(&mut input);
    let joint = match Case::joint(&input) {
        Ok(joint) => joint,
        Err(error) => return error.to_string(),
    };
    Case::new(&joint, &input, Path::new("case.toml")).expect_err("it is refused").to_string()
}

#[test]
fn what_is_stated_wrongly_is_refused_with_what_there_is() {
    fn fit_of(input: &mut JointInput) -> &mut CaseFit {
        input.case.fit.as_mut().unwrap()
    }
    let material = |change: fn(&mut CaseMaterial)| refused(|input| change(&mut input.case.substrate.common));
    let checks: [(String, &[&str]); 9] = [
        (material(|m| set(&mut m.values, "E_GPa_std", 1.0)), &["E_GPa_std", "E_MPa_std", "exact"]),
        (refused(|i| set(&mut i.case.cohesive.values, "q_std", 1.0)), &["[cohesive]", "q_std", "r_std"]),
        (material(|m| m.exact = Some(names(&["G"]))), &["case.toml, line", "[substrate]", "\"G\"", "\"sigma_0\""]),
        (material(|m| set(&mut m.values, "nu_std", 0.0)), &["nu_std", "above zero", "exact"]),
        (
            refused(|i| {
                set(&mut i.case.cohesive.values, "r_std", 1.0);
                i.case.cohesive.exact = Some(CaseExact::All(true));
            }),
            &["r_std", "exact", "take one away"],
        ),
        (refused(|i| fit_of(i).exact = Some(names(&["face"]))), &["[fit]", "\"face\"", "\"faces\"", "\"pixel_size\""]),
        (refused(|i| fit_of(i).thickness_mm_std = Some(f64::NAN)), &["thickness_mm_std", "above zero"]),
        (
            refused(|i| {
                fit_of(i).face_position_mm_std = Some(1e-3);
                fit_of(i).face_position_px_std = Some(1.0);
            }),
            &["face_position_px_std", "face_position_mm_std", "take one away"],
        ),
        (
            refused(|i| {
                i.case.measurement.as_mut().unwrap().pixel_size_mm = None;
                fit_of(i).face_position_px_std = Some(1.0);
            }),
            &["face_position_px_std", "face_position_mm_std"],
        ),
    ];
    for (said, words) in checks {
        for word in words {
            assert!(said.contains(word), "'{word}' is not in: {said}");
        }
    }
}

#[test]
fn without_a_scale_what_is_told_in_pixels_is_not_stated_and_said_to_be_so() {
    let mut input = input("", "");
    input.case.measurement.as_mut().unwrap().pixel_size_mm = None;
    let found = fitted(&input);
    for name in ["thickness", "face_lower", "face_upper", "pixel_size"] {
        let line = line(&found.budget, name);
        assert!(line.source == Source::Unknown && line.std.is_none() && !line.included, "{line:?}");
    }
    input.case.fit.as_mut().unwrap().face_position_mm_std = Some(1e-3);
    input.case.fit.as_mut().unwrap().pixel_size_relative_std = Some(0.01);
    let found = fitted(&input);
    assert_eq!(line(&found.budget, "face_lower").source, Source::Stated);
    for (k, p) in found.parameters.iter().enumerate() {
        // Lengths of all kinds grow with the pixel.
        assert!((line(&found.budget, "pixel_size").parameters[k] / p.value - 0.01).abs() < 1e-12);
    }
}

/// The parameters that remarks are about, and what they say.
fn about(remarks: &[Remark]) -> Vec<(String, String)> {
    let of = |remark: &Remark| match &remark.about {
        About::Parameter(name) => (name.clone(), remark.text.clone()),
        other => panic!("{other:?}"),
    };
    remarks.iter().map(of).collect()
}

/// Names of what is implausible of the case.
fn implausible(change: impl FnOnce(&mut JointInput)) -> Vec<(String, String)> {
    let mut input = input("", "");
    change(&mut input);
    let joint = Case::joint(&input).unwrap();
    let mut said = Vec::new();
    loop {
        // What is off by a thousand is refused, unless the case says that it is meant.
        let text = match Case::new(&joint, &input, Path::new("case.toml")) {
            Ok(case) => return [said, about(&case.remarks)].concat(),
            Err(error) => error.to_string(),
        };
        let name = text.split("meant = [\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap().to_owned();
        input.case.fit.as_mut().unwrap().meant.push(name.clone());
        said.push((name, text));
    }
}

#[test]
fn values_that_nothing_has_are_named_with_what_may_be_meant() {
    assert_eq!(implausible(|_| {}), []);
    let of = |key: &'static str, value: f64| {
        implausible(move |input| set(&mut input.case.substrate.common.values, key, value))
    };
    let gpa = of("E_MPa", 72.0);
    assert!(
        gpa.len() == 1 && gpa[0].0 == "E" && gpa[0].1.contains("72 MPa") && gpa[0].1.contains("GPa meant?"),
        "{gpa:?}"
    );
    let both = implausible(|input| {
        set(&mut input.case.substrate.common.values, "E_MPa", 72.0);
        set(&mut input.case.substrate.common.values, "sigma_0_MPa", 0.18);
    });
    assert!(both.iter().any(|(name, text)| name == "E" && text.contains("GPa meant?")), "{both:?}");
    assert!(both.iter().any(|(name, text)| name == "sigma_0" && text.contains("GPa meant?")), "{both:?}");
    assert!(of("E_MPa", 7.2e10)[0].1.contains("Pa meant?"));
    for (key, value, name) in [
        ("E_MPa", 5.0, "E"),
        ("nu", -0.2, "nu"),
        ("sigma_0_MPa", 7.0, "sigma_0"),
        ("sigma_0_MPa", 4000.0, "E"),
        ("alpha", 20.0, "alpha"),
        ("n", 80.0, "n"),
    ] {
        let said = of(key, value);
        assert!(said.iter().any(|(of, text)| of == name && text.contains(name)), "{key} = {value}: {said:?}");
    }
    // An ordinary polymer under a strong start of the fit accuses nobody.
    assert_eq!(
        implausible(|input| {
            set(&mut input.case.substrate.common.values, "E_MPa", 1000.0);
            set(&mut input.case.substrate.common.values, "sigma_0_MPa", 40.0);
        }),
        []
    );
    // Nor do the strips of published benchmarks: Abaqus' beam, two inclusions and their matrix, an aluminium, a fibre
    // composite.
    for (e, nu) in [(1000.0, 0.3), (3090.0, 0.25), (10_000.0, 0.4), (69_000.0, 0.33), (133_150.0, 0.316)] {
        let said = implausible(|input| {
            let values = [("E_MPa".into(), e), ("nu".into(), nu)].into();
            let model = Some("linear-elastic".into());
            input.case.substrate.common = CaseMaterial { model, values, ..CaseMaterial::default() };
        });
        assert_eq!(said, [], "E = {e}");
    }
    let pixel = |mm: f64| implausible(move |input| input.case.measurement.as_mut().unwrap().pixel_size_mm = Some(mm));
    assert!(pixel(1.9).iter().any(|(name, _)| name == "pixel_size"));
    assert!(pixel(0.07).iter().any(|(name, text)| name == "thickness" && text.contains("less than a pixel")));
    let thick = |input: &mut JointInput| {
        *input = remade(input, |nodes, _| {
            let upper = nodes.len() / 2;
            nodes[upper..].iter_mut().for_each(|at| at[1] += 0.1);
        });
    };
    assert!(implausible(thick).iter().any(|(name, text)| name == "thickness" && text.contains("thicker than a strip")));
    let far = implausible(|input| {
        set(&mut input.case.cohesive.values, "delta_n_mm", 5.0);
        set(&mut input.case.cohesive.values, "delta_t_mm", 50.0);
        set(&mut input.case.cohesive.values, "phi_n_N_per_mm", 1000.0);
    });
    assert!(far.iter().any(|(name, text)| name == "start" && text.contains("in mm?")), "{far:?}");
    let near = implausible(|input| {
        set(&mut input.case.cohesive.values, "delta_n_mm", 5e-7);
        set(&mut input.case.cohesive.values, "phi_n_N_per_mm", 1e-4);
    });
    assert!(near.iter().any(|(name, _)| name == "opening"), "{near:?}");
}

#[test]
fn a_result_that_nothing_has_is_named() {
    let of_fit = fitted(&input("", "")).remarks;
    assert!(of_fit.iter().all(|remark| remark.code == Code::LawExtrapolated), "{of_fit:?}");
    let joint = Case::joint(&input("", "")).unwrap();
    let input = input("", "");
    let case = Case::new(&joint, &input, Path::new("case.toml")).unwrap();
    let of = |phi_n: f64, delta_n: f64, delta_t: f64, r: f64| {
        let law = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r).unwrap();
        about(&quadrille::identify::implausible_result(&case.problem, &law))
    };
    let names = |list: &[(String, String)]| list.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&of(8e-4, 0.005, 0.05, 4.0)), ["phi_n"]);
    assert!(of(8e-4, 0.005, 0.05, 4.0)[0].1.contains("0.80 J/m^2"));
    assert!(names(&of(200.0, 0.05, 0.05, 4.0)).contains(&"phi_n".to_owned()));
    assert!(names(&of(100.0, 0.005, 0.05, 0.1)).contains(&"T_n_max".to_owned()));
    assert!(names(&of(10.0, 0.005, 0.005, 4.0)).contains(&"T_t_max".to_owned()));
    // Only the first slope loaded: in one mode, in both.
    let opening = of(20.0, 0.5, 0.05, 0.2);
    assert!(
        opening.iter().any(|(name, text)| name == "opening" && text.contains("inferred from the other mode")),
        "{opening:?}"
    );
    let both = of(20.0, 0.5, 1.5, 2.0);
    assert!(
        both.iter().any(|(name, text)| name == "sliding" && text.contains("all else of it is extrapolated")),
        "{both:?}"
    );
}

/// The joint of the case under its own law alone: what is stated of uncertainties is no hindrance.
#[test]
fn a_case_that_states_uncertainties_can_be_simulated() {
    let mut input = input("", "");
    set(&mut input.case.substrate.common.values, "E_MPa_std", 1000.0);
    input.case.cohesive.exact = Some(CaseExact::All(true));
    assert!(Joint::new(&input).is_ok());
}

#[test]
fn a_node_that_hardly_anything_is_seen_of_does_not_make_the_others_certain() {
    let sigma_with = |texture: f64| {
        let mut input = of_run(&input_of(Kinematics::Objective, "weights = \"covariance\"", ""));
        input.case.measurement.iter_mut().for_each(|measurement| measurement.noise_mm = None);
        let mesh = mesh();
        let matrix = |(k, corners): (usize, &[u32; 4])| {
            let geometry = ElementGeometry::new(corners.map(|node| mesh.nodes()[node as usize]));
            // The first element has a corner of the mesh to itself.
            alike(geometry.mass_matrix(), if k == 0 { texture } else { 1.0 })
        };
        let matrices = mesh.elements().iter().enumerate().map(matrix).collect();
        let seen = RunMatrix { corners: mesh.elements().to_vec(), matrices, of_noise: Vec::new() };
        let (BoundaryInput::Run(border), Some(MeasurementInput::Run(run))) =
            (&mut input.boundary, &mut input.measurement)
        else {
            panic!("a run")
        };
        [border, run].into_iter().for_each(|run| run.normal_matrix = Some(seen.clone()));
        let joint = Case::joint(&input).unwrap();
        Case::new(&joint, &input, Path::new("case.toml")).unwrap().problem.noise.sigma.expect("stated")
    };
    let (even, bare) = (sigma_with(1.0), sigma_with(1e-6));
    // 10^6 in one of 130 nodes is 5 % in the mean of logarithms, and its neighbours have something of it; by a mean of
    // variances the others would be a hundred times as certain.
    assert!((bare / even - 1.0).abs() < 0.1, "{bare} for {even}");
}
