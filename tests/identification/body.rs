//! One body without an adhesive: constants of its material from its own displacements and a force (THEORY 24).

use crate::mechanics_common;
use mechanics_common::{border_table, measured_table};
use quadrille::identify::{Case, Fit, Outcome, fit};
use quadrille::io::case::PlaneState;
use quadrille::io::joint::read_joint;
use quadrille::mechanics::cohesive::NoAdhesive;
use quadrille::mechanics::substrate::{SubstrateLaw, substrate_by_name};
use quadrille::mechanics::{
    BoundaryHistory, ForwardOptions, JointMesh, JointParts, Kinematics, Model, ModelOptions, NodeGroup,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

const SIZE: f64 = 0.5;
const COLUMNS: usize = 12;
const ROWS: usize = 20;
const WIDTH: f64 = 2.0;
/// Noise of a displacement, mm, and of a force, N.
const NOISE: f64 = 2e-4;
const STD: f64 = 5.0;

/// A plate with a square hole in its middle.
fn plate() -> JointMesh {
    let per_row = COLUMNS as u32 + 1;
    let at = |i: usize, j: usize| [i as f64 * SIZE, j as f64 * SIZE];
    let hole = |i: usize, j: usize| (5..7).contains(&i) && (9..11).contains(&j);
    let mut elements = Vec::new();
    for j in 0..ROWS {
        for i in (0..COLUMNS).filter(|&i| !hole(i, j)) {
            let a = j as u32 * per_row + i as u32;
            elements.push([a, a + 1, a + 1 + per_row, a + per_row]);
        }
    }
    // The node in the middle of the hole belongs to no element.
    let middle = 10 * per_row + 6;
    let nodes: Vec<[f64; 2]> = (0..=ROWS).flat_map(|j| (0..=COLUMNS).map(move |i| at(i, j))).collect();
    let nodes: Vec<[f64; 2]> =
        nodes.into_iter().enumerate().filter(|(k, _)| *k as u32 != middle).map(|(_, at)| at).collect();
    elements.iter_mut().flatten().for_each(|node| *node -= u32::from(*node > middle));
    JointMesh::of_body(JointParts { nodes, elements, ..JointParts::default() }).unwrap()
}

/// A plate that was pulled: its fields, and the force on its upper end by mm of width.
struct Pulled {
    mesh: JointMesh,
    ends: Vec<u32>,
    fields: Vec<Vec<[f64; 2]>>,
    forces: Vec<f64>,
}

fn pulled(law: &str, values: &[f64], strain: f64) -> Pulled {
    let mesh = plate();
    let top = ROWS as f64 * SIZE;
    let ends: Vec<u32> =
        (0u32..).zip(mesh.nodes()).filter(|(_, at)| at[1] == 0.0 || at[1] == top).map(|(k, _)| k).collect();
    let material: Arc<dyn SubstrateLaw> = Arc::from(substrate_by_name(law, values, PlaneState::PlaneStress).unwrap());
    // Grips: nothing moves across the load.
    let at = |k: u32, node: u32| [0.0, f64::from(k) / 8.0 * strain * mesh.nodes()[node as usize][1]];
    let instants = (1..=8).map(|k| ends.iter().map(|&node| at(k, node)).collect()).collect();
    let boundary = BoundaryHistory::new(ends.clone(), instants).unwrap();
    let options = ModelOptions { kinematics: Kinematics::Finite, ..ModelOptions::default() };
    let model = Model::new(mesh.clone(), vec![material], &ends, options).unwrap();
    let solution = model.forward(&NoAdhesive, &boundary, &ForwardOptions::default()).unwrap();
    let fields: Vec<_> = solution.instants.into_iter().map(|instant| instant.displacement).collect();
    let upper: Vec<u32> = ends.iter().copied().filter(|&node| mesh.nodes()[node as usize][1] == top).collect();
    let groups = [NodeGroup::new("top", upper)];
    let forces = fields.iter().map(|u| model.reactions(&NoAdhesive, u, &groups)[0][1]).collect();
    Pulled { mesh, ends, fields, forces }
}

const ELASTIC: &str = "model = 'linear-elastic'\nE_MPa = 60000\nnu = 0.25\nexact = true\n";
const FORCE: &str = "[force]\nfile = 'load.csv'\ngroup = 'top'\nwidth_mm = 2\nstd_N = 5\n";

fn write_case(folder: &Path, pulled: &Pulled, seed: u64, substrate: &str, force: &str, fit: &str) {
    let Pulled { mesh, ends, fields, forces } = pulled;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
    let noise = if seed == 0 { 0.0 } else { 1.0 };
    let mesh_text = serde_json::json!({ "nodes": mesh.nodes(), "quads": mesh.elements() });
    std::fs::write(folder.join("mesh.json"), mesh_text.to_string()).unwrap();
    std::fs::write(folder.join("border.csv"), border_table(mesh, ends, fields)).unwrap();
    std::fs::write(folder.join("measured.csv"), measured_table(fields, || noise * NOISE * draw())).unwrap();
    let mut load = "load_N\n".to_owned();
    for value in forces {
        writeln!(load, "{:.12}", WIDTH * value + noise * STD * draw()).unwrap();
    }
    std::fs::write(folder.join("load.csv"), load).unwrap();
    let text = format!(
        "[mesh]\nfile = 'mesh.json'\n[groups]\ntop = 'y = max'\nleft = 'x = min'\nright = 'x = max'\n\
         hole = 'x > 2 and x < 4 and y > 4 and y < 6'\n[boundary]\nfile = 'border.csv'\n\
         free = ['left', 'right', 'hole']\n[substrate]\n{substrate}[measurement]\nfile = 'measured.csv'\n\
         nodes = 'free'\nboundary = 'exact'\nweights = 'covariance'\ncommon_reference = false\nnoise_mm = {NOISE}\n\
         {force}[fit]\nexact = true\nbootstrap = 0\nintervals = 'linear'\n{fit}"
    );
    std::fs::write(folder.join("case.toml"), text).unwrap();
}

/// Fits the case, and looks at it.
#[track_caller]
fn fitted<T>(
    pulled: &Pulled,
    seed: u64,
    [substrate, force, asked]: [&str; 3],
    look: impl FnOnce(&Case<'_>, &Fit) -> T,
) -> T {
    let folder = tempfile::tempdir().unwrap();
    write_case(folder.path(), pulled, seed, substrate, force, asked);
    let path = folder.path().join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let case = Case::new(&joint, &input, &path).unwrap();
    let found = fit(&case.problem, &case.options).unwrap();
    look(&case, &found)
}

const E_NU: &str = "parameters = ['E', 'nu']\n";

#[test]
fn a_plate_with_a_hole_gives_modulus_and_poissons_ratio_within_their_intervals() {
    let pulled = pulled("linear-elastic", &[72_000.0, 0.33], 2e-3);
    let (mut held, mut n) = (0, 0);
    for seed in 1..=10 {
        fitted(&pulled, seed, [ELASTIC, FORCE, E_NU], |_, found| {
            assert_eq!(found.verdict.outcome, Outcome::Determined, "{:?}", found.verdict.sentences);
            assert!(found.derived.is_empty() && found.released.is_none());
            for (p, truth) in found.parameters.iter().zip([72_000.0, 0.33]) {
                let [low, high] = p.ends95.map(|end| end.expect("an end"));
                held += usize::from(low <= truth && truth <= high);
                n += 1;
                // 2e-4 mm of noise at 250 nodes and 8 instants, 5 of some 1500 N.
                assert!(p.std.expect("known") < 0.03 * truth, "{p:?}");
            }
        });
    }
    // Of 20 intervals of 95 %: 16 or fewer hold once in 80.
    assert!(held >= 17, "{held} of {n}");
    // Without noise the truth comes out to what the step tolerance leaves.
    fitted(&pulled, 0, [ELASTIC, FORCE, E_NU], |_, found| {
        for (p, truth) in found.parameters.iter().zip([72_000.0, 0.33]) {
            assert!((p.value / truth - 1.0).abs() < 1e-4, "{p:?}");
        }
    });
}

#[test]
fn displacements_alone_give_poissons_ratio_and_leave_the_modulus_open() {
    let pulled = pulled("linear-elastic", &[72_000.0, 0.33], 2e-3);
    fitted(&pulled, 1, [ELASTIC, "", "parameters = ['nu']\n"], |_, found| {
        assert!(
            (found.parameters[0].value - 0.33).abs() < 4.0 * found.parameters[0].std.unwrap(),
            "{:?}",
            found.parameters
        );
    });
    fitted(&pulled, 1, [ELASTIC, "", E_NU], |_, found| {
        assert_eq!(found.verdict.outcome, Outcome::NotDetermined, "{:?}", found.verdict.sentences);
        assert!(
            found.parameters[0].std.is_none_or(|std| std > 1e3 * found.parameters[0].value),
            "{:?}",
            found.parameters
        );
    });
}

#[test]
fn hardening_comes_from_the_plastic_zone_and_an_elastic_model_of_it_is_rejected() {
    let truth = [72_000.0, 0.33, 180.0, 0.06, 7.0];
    let pulled = pulled("ramberg-osgood", &truth, 4e-3);
    let start =
        "model = 'ramberg-osgood'\nE_MPa = 72000\nnu = 0.33\nsigma_0_MPa = 150\nalpha = 0.06\nn = 9\nexact = true\n";
    fitted(&pulled, 1, [start, FORCE, "parameters = ['sigma_0', 'n']\n"], |_, found| {
        assert_eq!(found.verdict.outcome, Outcome::Determined, "{:?}", found.verdict.sentences);
        for (p, truth) in found.parameters.iter().zip([180.0, 7.0]) {
            let off = (p.value - truth).abs() / p.std.expect("known");
            assert!(off < 4.0 && p.std.unwrap() < 0.05 * truth, "{p:?}");
        }
    });
    fitted(&pulled, 1, [ELASTIC, FORCE, E_NU], |_, found| {
        assert_eq!(found.verdict.outcome, Outcome::Rejected, "{:?}", found.verdict.sentences);
        let regions = &found.misfit.as_ref().expect("tested").by_region;
        assert!(regions.iter().any(|region| region.name == "middle third, centre"), "{regions:?}");
    });
}

#[test]
fn two_parts_without_a_law_between_them_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pulled = pulled("linear-elastic", &[72_000.0, 0.33], 2e-3);
    write_case(folder.path(), &pulled, 1, ELASTIC, FORCE, E_NU);
    let apart = serde_json::json!({
        "nodes": [[0, 0], [1, 0], [1, 1], [0, 1], [0, 1.1], [1, 1.1], [1, 2], [0, 2]],
        "quads": [[0, 1, 2, 3], [4, 5, 6, 7]],
    });
    let path = folder.path().join("case.toml");
    std::fs::write(folder.path().join("mesh.json"), apart.to_string()).unwrap();
    let error = Case::joint(&read_joint(&path).unwrap()).unwrap_err().to_string();
    assert!(error.contains("[cohesive] is missing, and the mesh has more than one part"), "{error}");
    // A group that is not there, and nodes that are not free and have no row.
    write_case(folder.path(), &pulled, 1, ELASTIC, FORCE, E_NU);
    let text = std::fs::read_to_string(&path).unwrap();
    let refused = |from: &str, to: &str, wanted: &str| {
        std::fs::write(&path, text.replace(from, to)).unwrap();
        let error = Case::joint(&read_joint(&path).unwrap()).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    refused("free = ['left', 'right', 'hole']", "free = ['left', 'middle']", "free: middle: ");
    refused("free = ['left', 'right', 'hole']", "free = ['left', 'right']", "which [boundary] free does not name");
}

#[test]
fn a_plate_of_a_composite_gives_both_moduli_and_the_shear_modulus() {
    // Fibres at 30 degrees: every modulus takes part.
    let truth = [45_000.0, 12_000.0, 0.3, 5_000.0, 30.0];
    let pulled = pulled("orthotropic", &truth, 3e-3);
    let start = "model = 'orthotropic'\nE_1_MPa = 40000\nE_2_MPa = 15000\nnu_12 = 0.3\nG_12_MPa = 4000\nangle_deg = 30\nexact = true\n";
    fitted(&pulled, 1, [start, FORCE, "parameters = ['E_1', 'E_2', 'G_12']\n"], |_, found| {
        assert_eq!(found.verdict.outcome, Outcome::Determined, "{:?}", found.verdict.sentences);
        for (p, truth) in found.parameters.iter().zip([45_000.0, 12_000.0, 5_000.0]) {
            let off = (p.value - truth).abs() / p.std.expect("known");
            assert!(off < 4.0 && p.std.unwrap() < 0.1 * truth, "{p:?}");
        }
    });
}
