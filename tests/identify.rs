//! Identification against the reference test: recovery, derivatives, an independent minimiser, statistics, verdict.

mod mechanics_common;

use mechanics_common::{adhesive, reference, virtual_r4};
use quadrille::identify::{
    Case, Fit, FitOptions, FitStatus, Problem, TrustRegionOptions, Unknowns, WeightKind, Weights, fit, latin_hypercube,
};
use quadrille::io::joint::{JointInput, MeasurementInput, read_joint};
use quadrille::mechanics::cohesive::CohesiveLaw;
use quadrille::mechanics::{ForwardOptions, Joint};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::OnceLock;

const TRUTH: [f64; 3] = [1.0, 0.005, 0.05];
/// 1 px of the reference test, mm.
const PX: f64 = 0.00193125;

/// The seven starts, as factors of the truth.
const STARTS: [[f64; 3]; 7] = [
    [0.4, 0.4, 0.4],
    [3.0, 3.0, 3.0],
    [0.4, 3.0, 1.0],
    [3.0, 0.4, 0.4],
    [0.5, 2.5, 3.0],
    [2.0, 0.5, 2.0],
    [1.3, 0.8, 1.2],
];

/// Displacements of all nodes at every instant of the reference test.
fn truth() -> &'static Vec<Vec<[f64; 2]>> {
    static TRUTH: OnceLock<Vec<Vec<[f64; 2]>>> = OnceLock::new();
    TRUTH.get_or_init(|| {
        let (mesh, boundary) = virtual_r4().unwrap();
        let model = mechanics_common::model_of(&mesh, &boundary, Default::default());
        let solution = model.forward(&adhesive([1.0; 4]), &boundary, &ForwardOptions::default()).unwrap();
        solution.instants.into_iter().map(|instant| instant.displacement).collect()
    })
}

/// A standard normal number (Box and Muller) from a generator of its own, so that a seed means the same for ever.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn draw(&mut self) -> f64 {
        let (u, v) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    }
}

/// Fields with noise of standard deviation `sigma` (mm, of one frame) whose half comes from the common reference.
fn noisy(sigma: f64, seed: u64) -> Vec<Vec<[f64; 2]>> {
    let mut normal = Normal(seed.wrapping_mul(0x2545_F491_4F6C_DD1D));
    let share = sigma * 0.5_f64.sqrt();
    let n = truth()[0].len();
    let common: Vec<[f64; 2]> = (0..n).map(|_| [0, 1].map(|_| share * normal.draw())).collect();
    let mut add = |u: &[f64; 2], e: &[f64; 2]| [0, 1].map(|c| u[c] - e[c] + share * normal.draw());
    truth().iter().map(|field| field.iter().zip(&common).map(|(u, e)| add(u, e)).collect()).collect()
}

/// A case of the reference test: the measurement's table and the fit's table are given, files stand in `folder`.
fn case_text(base: &Path, measurement: &str, fit: &str, border: &str) -> String {
    format!(
        "[mesh]\nfile = \"{0}/mesh.json\"\n[boundary]\nfile = \"{border}\"\n[substrate]\nmodel = \"ramberg-osgood\"\n\
         E_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\n[cohesive]\nphi_n_N_per_mm = 1.0\n\
         delta_n_mm = 0.005\ndelta_t_mm = 0.05\nr = 4.0\n[measurement]\nfile = \"measured.csv\"\n{measurement}\n[fit]\n{fit}\n",
        base.display()
    )
}

fn write_fields(folder: &Path, fields: &[Vec<[f64; 2]>]) {
    let mut text = "instant,node,ux_mm,uy_mm\n".to_owned();
    for (k, field) in fields.iter().enumerate() {
        for (node, u) in field.iter().enumerate() {
            writeln!(text, "{},{node},{:.17e},{:.17e}", k + 1, u[0], u[1]).unwrap();
        }
    }
    std::fs::write(folder.join("measured.csv"), text).unwrap();
}

const THREE: &str = "parameters = [\"phi_n\", \"delta_n\", \"delta_t\"]";

/// The input of an identification of `fields`; with `noisy_border` the border is prescribed as measured.
fn input(fields: &[Vec<[f64; 2]>], measurement: &str, fit: &str, noisy_border: bool) -> Option<JointInput> {
    let base = mechanics_common::reference_folder()?.join("virtual_r4").canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_fields(folder.path(), fields);
    let border =
        if noisy_border { "border.csv".to_owned() } else { format!("{}/boundary_displacements.csv", base.display()) };
    if noisy_border {
        let (mesh, boundary) = virtual_r4().unwrap();
        let mut text = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
        for (k, field) in fields.iter().enumerate() {
            for &node in boundary.nodes() {
                let ([x, y], u) = (mesh.nodes()[node as usize], field[node as usize]);
                writeln!(text, "{},{node},{x},{y},{:.17e},{:.17e}", k + 1, u[0], u[1]).unwrap();
            }
        }
        std::fs::write(folder.path().join("border.csv"), text).unwrap();
    }
    let case = folder.path().join("case.toml");
    std::fs::write(&case, case_text(&base, measurement, fit, &border)).unwrap();
    Some(read_joint(&case).unwrap())
}

fn joint_of(input: &JointInput) -> Joint {
    Case::joint(input).unwrap()
}

fn case_of<'a>(joint: &'a Joint, input: &JointInput) -> Case<'a> {
    Case::new(joint, input, Path::new("case.toml")).unwrap()
}

fn fitted(input: &JointInput) -> Fit {
    let joint = joint_of(input);
    let case = case_of(&joint, input);
    fit(&case.problem, &case.options).unwrap()
}

#[test]
fn noise_free_data_give_the_parameters_back_from_seven_starts() {
    let starts: Vec<String> =
        STARTS.iter().map(|f| format!("[{}, {}, {}]", f[0] * TRUTH[0], f[1] * TRUTH[1], f[2] * TRUTH[2])).collect();
    let fit = format!(
        "{THREE}\nstarts = [{}]\n[fit.start]\nphi_n = 1.3\ndelta_n = 0.004\ndelta_t = 0.06",
        starts[..6].join(", ")
    );
    let Some(_) = mechanics_common::reference_folder() else { return };
    let Some(input) = input(truth(), "weights = \"paper\"", &fit, false) else { return };
    let begin = std::time::Instant::now();
    let fit = fitted(&input);
    println!("{:.1} s", begin.elapsed().as_secs_f64());
    assert_eq!(fit.starts.len(), 7);
    for start in &fit.starts {
        println!("{start:?}");
    }
    for start in &fit.starts {
        assert_eq!(start.status, FitStatus::Converged, "{start:?}");
        for (end, truth) in start.end.iter().zip(TRUTH) {
            // The figure; Gauss-Newton on data without noise converges quadratically.
            assert!((end / truth - 1.0).abs() < 1e-9, "{start:?}");
        }
        assert!(start.evaluations <= 25 || start.rescued > 0, "{start:?}");
    }
    println!("{:?} condition {}", fit.singular_values, fit.condition());
}
