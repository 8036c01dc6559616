//! Law against law: fits of every law from far off, the tournament, what it prints.

#![cfg(feature = "cli")]

mod mechanics_common;

use mechanics_common::{aluminium, measured_table};
use quadrille::identify::{Case, Discretisation, Fit, FitOptions, FitStatus, Intervals, fit};
use quadrille::io::joint::read_joint;
use quadrille::mechanics::cohesive::{CohesiveLaw, law_by_name, parameters_by_name};
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, Model, ModelOptions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use std::fmt::Write as _;
use std::path::Path;

/// 1 px of the virtual test, mm.
const PX: f64 = 0.00193125;

/// A law of every kind, of about the same strength and work, with what is fitted of it.
const LAWS: [(&str, &[f64], &[&str]); 8] = [
    ("extended-xu-needleman", &[1.0, 0.005, 0.05, 4.0], &["phi_n", "delta_n", "delta_t"]),
    ("xu-needleman", &[1.0, 0.005, 0.05, 4.0, 0.0], &["phi_n", "delta_n", "delta_t"]),
    ("bilinear-benzeggagh-kenane", &[2e4, 60.0, 60.0, 1.0, 4.0, 1.5], &["K", "T_n0", "T_t0", "G_Ic", "G_IIc"]),
    ("bilinear-power", &[2e4, 60.0, 60.0, 1.0, 4.0, 1.0], &["K", "T_n0", "T_t0", "G_Ic", "G_IIc"]),
    ("trapezoidal-benzeggagh-kenane", &[2e4, 50.0, 50.0, 1.0, 4.0, 1.5, 0.4], &["K", "T_n0", "T_t0", "G_Ic", "G_IIc", "plateau"]),
    ("trapezoidal-power", &[2e4, 50.0, 50.0, 1.0, 4.0, 1.0, 0.4], &["K", "T_n0", "T_t0", "G_Ic", "G_IIc", "plateau"]),
    ("park-paulino-roesler", &[1.0, 4.0, 60.0, 60.0, 3.0, 3.0, 0.1, 0.1], &["phi_n", "phi_t", "T_n0", "T_t0", "lambda_n", "lambda_t"]),
    ("smith-ferrante", &[1.0, 0.005, 0.6], &["G_c", "delta_c", "beta"]),
];

/// Border and displacements of a joint that is peeled open from its right end and slid over `n` instants, 12 x 4 elements.
fn pulled(law: &dyn CohesiveLaw, n: u32, uneven: f64, slide: f64) -> (String, Vec<Vec<[f64; 2]>>) {
    let mesh = JointMesh::rectangular(12, 4, 0.0309, 0.06).unwrap();
    let nodes = mesh.outer_nodes();
    let at = |k: u32, node: u32| {
        let [x, y] = mesh.nodes()[node as usize];
        let (side, t) = (y.signum(), f64::from(k) * 6.0 / f64::from(n));
        [side * slide * t, side * uneven * t * (0.1 + 4.0 * x)]
    };
    let instants: Vec<Vec<[f64; 2]>> = (1..=n).map(|k| nodes.iter().map(|&node| at(k, node)).collect()).collect();
    let mut border = "instant,node,x_mm,y_mm,ux_mm,uy_mm\n".to_owned();
    for (k, values) in instants.iter().enumerate() {
        for (&node, u) in nodes.iter().zip(values) {
            let [x, y] = mesh.nodes()[node as usize];
            writeln!(border, "{},{node},{x},{y},{:e},{:e}", k + 1, u[0], u[1]).unwrap();
        }
    }
    let boundary = BoundaryHistory::new(nodes.clone(), instants).unwrap();
    let model = Model::new(mesh, aluminium(2), &nodes, ModelOptions::default()).unwrap();
    let solution = model.forward(law, &boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged());
    (border, solution.instants.into_iter().map(|instant| instant.displacement).collect())
}

fn case_text(law: &str, values: &[f64], noise_px: f64, fit: &str) -> String {
    let cohesive: String =
        parameters_by_name(law).unwrap().iter().zip(values).map(|(p, v)| format!("{} = {v:e}\n", p.key())).collect();
    format!(
        "[mesh]\nelement_size_mm = 0.0309\ncolumns = 12\nrows = 4\ngap_mm = 0.06\n[boundary]\nfile = \"border.csv\"\n\
         [substrate]\nE_MPa = 72000.0\nnu = 0.33\nsigma_0_MPa = 180.0\nalpha = 0.06\nn = 7.0\nexact = true\n[cohesive]\n\
         model = \"{law}\"\n{cohesive}exact = true\n[measurement]\nfile = \"measured.csv\"\nnodes = \"free\"\n\
         weights = \"covariance\"\nboundary = \"exact\"\ncommon_reference = false\nnoise_mm = {:e}\n[fit]\n{fit}\
         exact = true\n[output]\nfigures = []\n",
        noise_px.max(0.01) * PX
    )
}

fn write_tables(folder: &Path, (border, fields): &(String, Vec<Vec<[f64; 2]>>), noise_px: f64, seed: u64) {
    let (mut random, noise) = (ChaCha8Rng::seed_from_u64(seed), Normal::new(0.0, noise_px * PX).unwrap());
    std::fs::write(folder.join("border.csv"), border).unwrap();
    std::fs::write(folder.join("measured.csv"), measured_table(fields, || noise.sample(&mut random))).unwrap();
}

#[track_caller]
fn fitted(folder: &Path) -> Fit {
    let path = folder.join("case.toml");
    let input = read_joint(&path).unwrap();
    let joint = Case::joint(&input).unwrap();
    let case = Case::new(&joint, &input, &path).unwrap();
    let options =
        FitOptions { doubt: false, intervals: Intervals::Linear, discretisation: Discretisation::Off, ..case.options };
    fit(&case.problem, &options).unwrap()
}

fn big_pulled(law: &dyn CohesiveLaw) -> (String, Vec<Vec<[f64; 2]>>) {
    let (mesh, boundary) = mechanics_common::virtual_r4().unwrap();
    let model = mechanics_common::model_of(&mesh, &boundary, Default::default());
    let solution = model.forward(law, &boundary, &ForwardOptions::default()).unwrap();
    assert!(solution.converged());
    let border = std::fs::read_to_string("/work/wt/shared/reference/virtual_r4/boundary_displacements.csv").unwrap();
    (border, solution.instants.into_iter().map(|instant| instant.displacement).collect())
}

#[test]
#[ignore = "a trace for people"]
fn trace() {
    let only = std::env::var("LAW").unwrap_or_default();
    let n: u32 = std::env::var("N").map_or(6, |n| n.parse().unwrap());
    let uneven: f64 = std::env::var("UNEVEN").map_or(0.004, |n| n.parse().unwrap());
    let slide: f64 = std::env::var("SLIDE").map_or(0.006, |n| n.parse().unwrap());
    let verbose = std::env::var("V").is_ok();
    for (name, values, unknowns) in LAWS.iter().filter(|law| law.0.contains(&only)) {
        let law = law_by_name(name, values).unwrap();
        let big = std::env::var("BIG").is_ok();
        let data = if big { big_pulled(&*law) } else { pulled(&*law, n, uneven, slide) };
        let folder = tempfile::tempdir().unwrap();
        let noise_px: f64 = std::env::var("NOISE").map_or(0.0, |n| n.parse().unwrap());
        write_tables(folder.path(), &data, noise_px, 1);
        let list = unknowns.iter().map(|u| format!("\"{u}\"")).collect::<Vec<_>>().join(", ");
        let parameters = law.parameters();
        let mut seed = 1;
        let mixes: usize = std::env::var("MIXES").map_or(4, |n| n.parse().unwrap());
        for factors in ["all 0.3", "all 3"].into_iter().chain(std::iter::repeat_n("mix", mixes)) {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            seed += 1;
            let start: Vec<f64> = (parameters.iter().zip(*values))
                .map(|(p, v)| {
                    let u: f64 = rand::RngExt::random(&mut random);
                    let f = match factors {
                        "all 0.3" => 0.3_f64,
                        "all 3" => 3.0,
                        _ => (10.0_f64.powf(u - 0.5)).clamp(1.0 / 3.0, 3.0),
                    };
                    match p.name {
                        name if !unknowns.contains(&name) => *v,
                        "plateau" => (v * f).min(0.9),
                        _ => v * f,
                    }
                })
                .collect();
            std::fs::write(
                folder.path().join("case.toml"),
                {
                    let text = case_text(name, &start, noise_px, &format!("parameters = [{list}]\n"));
                    match big {
                        true => text.replace(
                            "element_size_mm = 0.0309\ncolumns = 12\nrows = 4\ngap_mm = 0.06\n",
                            "file = \"/work/wt/shared/reference/virtual_r4/mesh.json\"\n",
                        ),
                        false => text,
                    }
                },
            )
            .unwrap();
            let path = folder.path().join("case.toml");
            let input = read_joint(&path).map_err(|e| e.to_string());
            let begin = std::time::Instant::now();
            let joint = input.as_ref().map_err(Clone::clone).and_then(|i| Case::joint(i).map_err(|e| e.to_string()));
            let found = match &joint {
                Err(e) => Err(e.clone()),
                Ok(joint) => {
                    let case = Case::new(joint, input.as_ref().unwrap(), &path).unwrap();
                    let options = FitOptions {
                        doubt: false,
                        intervals: Intervals::Linear,
                        discretisation: Discretisation::Off,
                        ..case.options.clone()
                    };
                    fit(&case.problem, &options).map_err(|e| e.to_string())
                }
            };
            let s = begin.elapsed().as_secs_f64();
            match found {
                Err(e) => println!("{name} {factors} {start:?}: ERROR {e}"),
                Ok(f) => {
                    let off: Vec<String> =
                        f.values.iter().zip(*values).map(|(a, b)| format!("{:.4}", a / b)).collect();
                    println!(
                        "{name} {factors}: {} ({}) {} evals {} rescued {s:.1} s omega {:.2e} ratio {} start {start:?}",
                        f.status.name(), f.reason, f.evaluations, f.rescued, f.omega, off.join(" ")
                    );
                    if verbose {
                        for i in &f.history {
                            println!("    {:?} {:?} r={:.2e} {} {}", i.omega, i.z, i.radius, i.accepted, i.rescued);
                        }
                    }
                }
            }
        }
    }
    let _ = FitStatus::Converged;
}
