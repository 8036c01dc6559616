//! The forward model of a joint: time of a run, growth with the number of elements, and what the factors cost.
//!
//! `cargo bench --bench mechanics` prints all tables; `-- runs` or `-- solvers` one of them; `-- quick` leaves out the
//! large meshes. One thread; runs with as many as there are cores, too.

use quadrille::linalg::{BlockMatrix, Cholesky, LuChoice, LuPlan, Pattern, dissection};
use quadrille::mechanics::cohesive::ExtendedXuNeedleman;
use quadrille::mechanics::element::{ElementVector, Q4};
use quadrille::mechanics::substrate::{PlaneState, RambergOsgood, SubstrateLaw};
use quadrille::mechanics::{BoundaryHistory, ForwardOptions, JointMesh, Kinematics, Model, ModelOptions};
use std::sync::Arc;
use std::time::Instant;

const SIZE: f64 = 0.0309;

/// The joint of the reference test, refined, and a border that peels it open over `instants`.
fn joint(refinement: usize, instants: usize) -> (JointMesh, BoundaryHistory) {
    let coarse = JointMesh::rectangular(39, 7, SIZE, 0.06).expect("a mesh");
    let nodes = coarse.outer_nodes();
    let length = 39.0 * SIZE;
    let at = |opening: f64, node: u32| {
        let [x, y] = coarse.nodes()[node as usize];
        let (side, share) = (if y > 0.0 { 1.0 } else { -1.0 }, x / length);
        let up = 0.5 * side * opening * share * share * share + 0.1 * opening * share;
        // Sections stay plane: the slope of the deflection turns them.
        let slope = 1.5 * side * opening * share * share / length;
        [-slope * (y - side * 0.14), up]
    };
    let history = (1..=instants)
        .map(|k| nodes.iter().map(|&node| at(0.05 * k as f64 / instants as f64, node)).collect())
        .collect();
    let boundary = BoundaryHistory::new(nodes.clone(), history).expect("finite displacements");
    let (mesh, carry) = coarse.refined(refinement).expect("a refined mesh");
    let boundary = coarse.carry_boundary(&carry, &boundary);
    (mesh, boundary)
}

fn aluminium() -> Arc<dyn SubstrateLaw> {
    Arc::new(RambergOsgood::new([72000.0, 0.33, 180.0, 0.06, 7.0], PlaneState::PlaneStress).expect("a material"))
}

fn model(mesh: &JointMesh, boundary: &BoundaryHistory, solver: LuChoice) -> Model {
    let options = ModelOptions { solver, ..ModelOptions::default() };
    Model::new(mesh.clone(), vec![aluminium(); 2], boundary.nodes(), options).expect("a model")
}

fn law() -> ExtendedXuNeedleman {
    ExtendedXuNeedleman::new(1.0, 0.005, 0.05, 4.0).expect("a law")
}

/// Median and range of `n` runs, seconds.
fn timed(n: usize, mut run: impl FnMut()) -> (f64, f64, f64) {
    let mut times: Vec<f64> = (0..n)
        .map(|_| {
            let begin = Instant::now();
            run();
            begin.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[n / 2], times[0], times[n - 1])
}

/// Peak memory of the process, MiB.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok()).map_or(0.0, |kib| kib / 1024.0)
}

fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

fn runs(quick: bool) {
    println!("\n## Runs, four sensitivities at every instant\n");
    println!(
        "| elements | unknowns | solver | instants | model, s | run, s | the same with {} threads, s | iterations | process peak, MiB |",
        all_cores()
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let options = ForwardOptions { law_sensitivities: true, ..ForwardOptions::default() };
    let mut points: Vec<(f64, f64)> = Vec::new();
    for (refinement, instants, repeats) in [(1, 19, 9), (2, 19, 3), (6, 19, 1), (14, 19, 1)] {
        if quick && refinement > 2 {
            continue;
        }
        let (mesh, boundary) = joint(refinement, instants);
        let begin = Instant::now();
        let model = model(&mesh, &boundary, LuChoice::Auto);
        let set_up = begin.elapsed().as_secs_f64();
        let mut iterations = 0;
        // One solution at a time: what it takes counts.
        let mut run = || {
            let solution = model.forward(&law(), &boundary, &options).expect("a run");
            assert!(solution.converged(), "not converged");
            iterations = solution.instants.iter().map(|instant| instant.iterations).sum::<u32>();
        };
        let (median, fastest, slowest) = timed(repeats, &mut run);
        let (on_all, _, _) = pool(all_cores()).install(|| timed(repeats, &mut run));
        let elements = mesh.elements().len() + mesh.interfaces().len();
        println!(
            "| {elements} | {} | {} | {instants} | {set_up:.3} | {median:.4} ({fastest:.4}-{slowest:.4}) | {on_all:.4} | {iterations} | {:.0} |",
            model.n_unknowns(),
            model.solver(),
            peak_mib()
        );
        points.push((elements as f64, median / instants as f64));
    }
    for pair in points.windows(2) {
        let exponent = (pair[1].1 / pair[0].1).ln() / (pair[1].0 / pair[0].0).ln();
        println!("growth of the time per instant from {} to {} elements: exponent {exponent:.2}", pair[0].0, pair[1].0);
    }
}

fn solvers(quick: bool) {
    println!("\n## One tangent: factor, and solve for four right-hand sides, ms\n");
    println!(
        "| elements | unknowns | half band | banded | sparse (faer) | nested | Cholesky of the strips | + its solves for every jump |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for refinement in [1, 2, 6, 14] {
        if quick && refinement > 2 {
            continue;
        }
        let (mesh, boundary) = joint(refinement, 1);
        let model = model(&mesh, &boundary, LuChoice::Auto);
        let law = law();
        let solution = model.forward(&law, &boundary, &ForwardOptions::default()).expect("a run");
        let linearised = model.linearise(&law, &solution.instants[0].displacement).expect("a tangent");
        let matrix = linearised.tangent();
        let n = model.n_unknowns();
        let repeats = [9, 5, 3, 1][[1, 2, 6, 14].iter().position(|&r| r == refinement).unwrap_or(3)];
        let lu = |choice: LuChoice| {
            // The banded factor of the largest mesh takes 30 s and 2 GiB.
            if choice == LuChoice::Banded && refinement > 6 {
                return "-".to_owned();
            }
            let plan = LuPlan::new(matrix.pattern(), &model.unknown_positions(), choice);
            let mut factor = plan.factor();
            let mut rhs = vec![1.0; 4 * n];
            let (make, _, _) = timed(repeats, || factor.refactor(matrix).expect("a factor"));
            let (solve, _, _) = timed(repeats, || factor.solve(&mut rhs));
            format!("{:.2} + {:.2}", 1e3 * make, 1e3 * solve)
        };
        let columns = [lu(LuChoice::Banded), lu(LuChoice::Sparse), lu(LuChoice::Nested)];
        let (make, solve) = cholesky(&mesh, boundary.nodes(), repeats);
        let jumps = 2 * mesh.pairs().len();
        println!(
            "| {} | {n} | {} | {} | {} | {} | {:.2} | {:.1} ({jumps} of {:.2}) |",
            mesh.elements().len() + mesh.interfaces().len(),
            model.half_bandwidth(),
            columns[0],
            columns[1],
            columns[2],
            1e3 * make,
            1e3 * (make + jumps as f64 * solve),
            1e3 * solve
        );
    }
}

/// Seconds of the Cholesky factor of the strips alone, and of one solve with it: what the low-rank form of the tangent
/// needs at the least (one solve per jump component).
fn cholesky(mesh: &JointMesh, prescribed: &[u32], repeats: usize) -> (f64, f64) {
    let pattern = Arc::new(Pattern::new(mesh.nodes().len(), mesh.elements()));
    let law = aluminium();
    let mut held = vec![false; mesh.nodes().len()];
    prescribed.iter().for_each(|&node| held[node as usize] = true);
    let stiffness: Vec<_> = mesh
        .elements()
        .iter()
        .map(|corners| {
            let element =
                Q4::new(corners.map(|node| mesh.nodes()[node as usize]), Kinematics::Paper).expect("an element");
            let full = element.tangent(&*law, &ElementVector::zeros()).1;
            let mut upper = [0.0; 36];
            let mut at = 0;
            for row in 0..8 {
                for column in row..8 {
                    let held = held[corners[row / 2] as usize] || held[corners[column / 2] as usize];
                    upper[at] = match held {
                        true if row == column => 1.0,
                        true => 0.0,
                        false => full[(row, column)],
                    };
                    at += 1;
                }
            }
            upper
        })
        .collect();
    let matrix = BlockMatrix::assemble(&pattern, mesh.elements(), &stiffness);
    let order = dissection(&pattern, mesh.nodes(), 0..mesh.nodes().len());
    let (make, _, _) = timed(repeats, || drop(Cholesky::new(&matrix, &order).expect("a factor")));
    let factor = Cholesky::new(&matrix, &order).expect("a factor");
    let mut rhs = vec![[1.0; 2]; mesh.nodes().len()];
    let (solve, _, _) = timed(5, || factor.solve(&mut rhs));
    (make, solve)
}

fn main() {
    // Cargo also runs benches to see that they build.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let asked: Vec<String> = std::env::args().skip(1).filter(|arg| !arg.starts_with("--")).collect();
    let wanted = |name: &str| {
        !asked.iter().any(|arg| ["runs", "solvers"].contains(&arg.as_str())) || asked.iter().any(|arg| arg == name)
    };
    let quick = asked.iter().any(|arg| arg == "quick");
    pool(1).install(|| {
        if wanted("solvers") {
            solvers(quick);
        }
        if wanted("runs") {
            runs(quick);
        }
    });
}
