//! Several tests in one fit: information that adds, what each test determines, what is missing, and what is said of tests that do not go
//! together.

use quadrille::identify::{
    Case, CombinedCase, CombinedFit, Fit, FitError, FittedParameter, Outcome, fit, fit_combined, stds_of_information,
};
use quadrille::io::joint::{IdentifyInput, JointFileError, TestsInput, read_identify, read_joint};
use quadrille::mechanics::cohesive::ExtendedXuNeedleman;
use quadrille::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, Model, ModelOptions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::{Arc, OnceLock};

const PIXEL_MM: f64 = 0.0019;
const SIZE: f64 = 16.0 * PIXEL_MM;
const GAP: f64 = 0.06;
const COLUMNS: usize = 16;
const ROWS: usize = 4;
const TRUTH: [f64; 4] = [1.0, 0.005, 0.05, 4.0];
const ALUMINIUM: [f64; 5] = [72_000.0, 0.33, 180.0, 0.06, 7.0];
const PARAMETERS: &str = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\", \"r\"]\n";

type Field = Vec<[f64; 2]>;

/// How a joint is loaded.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Loading {
    /// It opens from the right, and slides a little.
    Opening,
    /// It slides, and opens a little.
    Sliding,
}

fn mesh() -> JointMesh {
    JointMesh::rectangular(COLUMNS, ROWS, SIZE, GAP).unwrap()
}

/// True displacements of all nodes.
fn fields(loading: Loading) -> &'static [Field] {
    static FIELDS: [OnceLock<Vec<Field>>; 2] = [OnceLock::new(), OnceLock::new()];
    FIELDS[usize::from(loading == Loading::Sliding)].get_or_init(|| {
        let mesh = mesh();
        let nodes = mesh.outer_nodes();
        let at = |k: u32, node: u32| {
            let ([x, y], t) = (mesh.nodes()[node as usize], f64::from(k));
            let side = 0.5 * y.signum();
            match loading {
                Loading::Opening => [side * 0.0014 * t, side * 0.0022 * t * (0.1 + 7.0 * x * x)],
                Loading::Sliding => [side * 0.011 * t * (0.7 + x), side * 0.0001 * t],
            }
        };
        let instants = (1..=8).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
        let boundary = BoundaryHistory::new(nodes.clone(), instants).unwrap();
        let material: Arc<dyn SubstrateLaw> = Arc::new(RambergOsgood::new(ALUMINIUM, PlaneState::PlaneStress).unwrap());
        let model = Model::new(mesh, vec![Arc::clone(&material), material], &nodes, ModelOptions::default()).unwrap();
        let [phi_n, delta_n, delta_t, r] = TRUTH;
        let law = ExtendedXuNeedleman::new(phi_n, delta_n, delta_t, r).unwrap();
        let solution = model.forward(&law, &boundary, &ForwardOptions::default()).unwrap();
        solution.instants.into_iter().map(|instant| instant.displacement).collect()
    })
}

/// Noise of one frame that a test is given, mm: a tenth of a pixel.
const NOISE: f64 = 0.1 * PIXEL_MM;

/// The case of one test in `folder`, its displacements with noise of `noise` (mm) drawn by `seed`; the border is exact.
fn write_test(folder: &Path, loading: Loading, noise: f64, seed: u64) {
    write_test_with(folder, loading, noise, seed, |text| text);
}

fn write_test_with(folder: &Path, loading: Loading, noise: f64, seed: u64, change: impl Fn(String) -> String) {
    std::fs::create_dir_all(folder).unwrap();
    let mesh = mesh();
    let mut border = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    let mut measured = "instant,node,ux_mm,uy_mm\n".to_owned();
    let mut random = ChaCha8Rng::seed_from_u64(seed + 1000 * u64::from(loading == Loading::Sliding));
    let mut drawn = || noise * <StandardNormal as Distribution<f64>>::sample(&StandardNormal, &mut random);
    for (k, field) in fields(loading).iter().enumerate() {
        for node in mesh.outer_nodes() {
            let ([x, y], u) = (mesh.nodes()[node as usize], field[node as usize]);
            writeln!(border, "{},{node},{x},{y},{:.17e},{:.17e}", k + 1, u[0], u[1]).unwrap();
        }
        for (node, u) in field.iter().enumerate() {
            writeln!(measured, "{},{node},{:.17e},{:.17e}", k + 1, u[0] + drawn(), u[1] + drawn()).unwrap();
        }
    }
    std::fs::write(folder.join("border.csv"), border).unwrap();
    std::fs::write(folder.join("measured.csv"), measured).unwrap();
    let [e, nu, sigma_0, alpha, n] = ALUMINIUM;
    let text = format!(
        "[mesh]\nelement_size_mm = {SIZE}\ncolumns = {COLUMNS}\nrows = {ROWS}\ngap_mm = {GAP}\n[boundary]\nfile = \"border.csv\"\n\
         [substrate]\nE_MPa = {e:?}\nnu = {nu}\nsigma_0_MPa = {sigma_0:?}\nalpha = {alpha}\nn = {n:?}\nexact = true\n\
         [cohesive]\nphi_n_N_per_mm = 1.2\ndelta_n_mm = 0.0045\ndelta_t_mm = 0.055\nr = 3.5\n\
         [measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\nweights = \"covariance\"\nboundary = \"exact\"\n\
         common_reference = false\nnoise_mm = {NOISE:e}\npixel_size_mm = {PIXEL_MM}\n\
         [fit]\n{PARAMETERS}exact = true\n"
    );
    std::fs::write(folder.join("case.toml"), change(text)).unwrap();
}

/// The case of tests in the folders `tests` of `folder`, with further lines of `[fit]`.
fn write_combined(folder: &Path, tests: &[&str], fit: &str) {
    let mut text = String::new();
    tests.iter().for_each(|test| writeln!(text, "[[test]]\ncase = \"{test}/case.toml\"").unwrap());
    writeln!(text, "[fit]\n{PARAMETERS}exact = true\n{fit}").unwrap();
    std::fs::write(folder.join("all.toml"), text).unwrap();
}

fn read(folder: &Path) -> Result<TestsInput, JointFileError> {
    match read_identify(&folder.join("all.toml"))? {
        IdentifyInput::Several(input) => Ok(input),
        IdentifyInput::One(_) => panic!("several tests"),
    }
}

fn combined(input: &TestsInput) -> Result<(CombinedFit, Vec<String>), FitError> {
    let joints = CombinedCase::joints(input)?;
    let case = CombinedCase::new(&joints, input)?;
    Ok((fit_combined(&case)?, case.doubts.clone()))
}

#[track_caller]
fn fitted_together(folder: &Path) -> (CombinedFit, Vec<String>) {
    combined(&read(folder).unwrap()).unwrap()
}

#[track_caller]
fn fitted_alone(case: &Path) -> Fit {
    let input = read_joint(case).unwrap();
    let joint = Case::joint(&input).unwrap();
    let case = Case::new(&joint, &input, case).unwrap();
    fit(&case.problem, &case.options).unwrap()
}

/// An opening and a sliding test, drawn by `seed`.
fn both(seed: u64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_test(&folder.path().join("opening"), Loading::Opening, NOISE, seed);
    write_test(&folder.path().join("sliding"), Loading::Sliding, NOISE, seed);
    write_combined(folder.path(), &["opening", "sliding"], "");
    folder
}

fn relative(p: &FittedParameter) -> f64 {
    100.0 * p.std_noise.unwrap() / p.value
}

#[test]
fn an_opening_and_a_sliding_test_determine_together_what_neither_does_alone() {
    let folder = both(1);
    let (together, doubts) = fitted_together(folder.path());
    for p in &together.fit().parameters {
        println!("{}: {} +- {:.2} %", p.parameter.name, p.value, relative(p));
    }
    for test in &together.tests {
        println!("{:?}", test.share);
    }
    println!("{doubts:#?} {:#?} {:?}", together.fit().verdict, together.consistency);
    for name in ["opening", "sliding"] {
        let alone = fitted_alone(&folder.path().join(name).join("case.toml"));
        for p in &alone.parameters {
            println!("{name}: {}: {} +- {:.2} % {:?}", p.parameter.name, p.value, relative(p), p.ends95);
        }
        println!("{name}: {:#?}", alone.verdict);
    }
}
