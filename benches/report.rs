//! Times and memory of the CPU path, as tables for `benches/RESULTS.md`.
//!
//!     cargo bench --bench report                 all tables (a few minutes)
//!     cargo bench --bench report -- kernels      one of: kernels, pairs, solvers
//!     cargo bench --bench report -- gate         only the ratio that CI checks: vector path / per-pixel loop
//!
//! Every number is wall time of the named work alone, images in memory; medians of the stated number of
//! runs with the fastest and slowest beside. On a shared machine only ratios within one run are safe.

use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, GreyTransfer, KernelOptions};
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{Brightness, Status};
use quadrille::imaging::{Image, Interpolation};
use quadrille::isa::Isa;
use quadrille::linalg::{BlockMatrix, Pattern, Solver, SolverChoice, inverse_diagonal, nested_dissection};
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use quadrille::synth::{Accuracy, RenderOptions, Texture, Translation, exact_at, render};
use std::sync::Arc;
use std::time::Instant;

/// The vector path must beat the per-pixel loop by this in the same run.
const GATE: f64 = 4.0;

fn main() {
    if !std::env::args().any(|a| a == "--bench" || a.starts_with("memory=")) {
        return println!("run by `cargo bench --bench report`; `cargo test` only builds it");
    }
    let words: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let asked = |name: &str| words.is_empty() || words.iter().any(|word| word == name);
    if let Some(size) = words.iter().find_map(|w| w.strip_prefix("memory=")) {
        return memory_of_pair(size.parse().expect("a size in pixels"));
    }
    println!("quadrille {}, {}", env!("CARGO_PKG_VERSION"), machine());
    let isas: Vec<_> = Isa::available().iter().map(|isa| isa.name()).collect();
    println!("instruction paths: {}\n", isas.join(", "));
    if asked("kernels") {
        kernels();
    }
    if asked("pairs") {
        pairs();
    }
    if asked("solvers") {
        solvers();
    }
    if asked("gate") {
        gate();
    }
}

fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")).map(|l| l.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {cores} cores", model.unwrap_or("unknown processor"))
}

/// Fastest, median and slowest of `runs`, seconds.
fn time<T>(runs: usize, mut work: impl FnMut() -> T) -> [f64; 3] {
    let mut seconds: Vec<f64> = (0..runs)
        .map(|_| {
            let begin = Instant::now();
            std::hint::black_box(work());
            begin.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    [seconds[0], seconds[runs / 2], seconds[runs - 1]]
}

fn shown([fastest, median, slowest]: [f64; 3], scale: f64) -> String {
    format!("{:.2} ({:.2}-{:.2})", median * scale, fastest * scale, slowest * scale)
}

fn threads(n: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a thread pool")
}

/// The pair of the accuracy figures: 8 bit, sinusoids of 1 px, 0.5 % stretch, 0.2 degrees.
fn pair(size: usize) -> [Arc<Image>; 2] {
    let texture = Texture::new(1, 4.5).expect("a texture");
    let options = RenderOptions::new(size, size);
    let reference = render(&texture, &Translation([0.0; 2]), &options).expect("an image");
    let deformed = render(&texture, &Accuracy::new(size, size), &options).expect("an image");
    [Arc::new(reference), Arc::new(deformed)]
}

/// The whole image less one element on each side.
fn zone(size: usize, element: usize) -> [Zone; 1] {
    let (low, high) = (element as f64, (size - element) as f64);
    [Zone::rectangle("image", Roi { x0: low, y0: low, x1: high, y1: high })]
}

fn kernel_options() -> KernelOptions {
    KernelOptions { interpolation: Interpolation::Cubic, grey_offset: 120.0, brightness: Brightness::Zone }
}

fn mesh(size: usize, element: usize) -> PixelMesh {
    PixelMesh::on_zones(&zone(size, element), element, ELEMENT_SHARE, [size, size]).expect("a mesh")
}

fn kernels() {
    println!("kernels, one thread, cubic B-spline, 16 px elements: ns per pixel, median (fastest-slowest) of 9");
    println!("| size | path | prefilter | gradient + matrix | residual, strain 0.1 % | residual, strain 3 % |");
    println!("|---|---|---|---|---|---|");
    threads(1).install(|| {
        for size in [1024, 2048, 4096] {
            let [reference, deformed] = pair(size);
            for isa in Isa::available() {
                if size > 1024 && ["baseline", "scalar"].contains(&isa.name()) {
                    continue;
                }
                let per_px = 1e9 / (size * size) as f64;
                let (backend, options, mesh) = (CpuBackend::new(isa), kernel_options(), mesh(size, 16));
                let frame = || backend.frame(reference.clone(), &options).expect("a frame");
                let prefilter = time(9, || {
                    let mut frame = frame();
                    backend.prefilter(&mut frame, 0).expect("memory");
                    frame
                });
                let reference_time = time(9, || backend.reference(&mut frame(), 0, &mesh, &options));
                let (level, _) = backend.reference(&mut frame(), 0, &mesh, &options).expect("a level");
                let mut deformed = backend.frame(deformed.clone(), &options).expect("a frame");
                let residual = [0.03, 1.0].map(|scale| {
                    let exact = exact_at(&Accuracy::new(size, size), mesh.mesh.nodes());
                    let exact: Vec<_> = exact.iter().map(|u| u.map(|u| 0.37 + u * scale)).collect();
                    let mut field =
                        backend.start(&level, &mut deformed, &exact, &[GreyTransfer::NONE]).expect("a field");
                    backend.observe(&level, &mut deformed, &mut field).expect("a pass");
                    time(9, || backend.observe(&level, &mut deformed, &mut field))
                });
                println!(
                    "| {size}² | {isa} | {} | {:.2} | {} | {} |",
                    shown(prefilter, per_px),
                    (reference_time[1] - prefilter[1]) * per_px,
                    shown(residual[0], per_px),
                    shown(residual[1], per_px),
                );
            }
        }
    });
    println!();
}

fn pairs() {
    println!(
        "cold pair, 8-bit images in memory, 16 px elements, tolerance 1e-4 px, 2 threads: s, median (fastest-slowest) of 7"
    );
    println!("reference = conversion, prefilter, gradients, pyramid, matrices, factor, texture check, uncertainty");
    println!("frame = conversion, prefilter, pyramid, search, all iterations, residual, uncertainty");
    println!("| size | reference | frame | both | frame from the prediction | iterations | B/px beyond the images |");
    println!("|---|---|---|---|---|---|---|");
    threads(2).install(|| {
        for size in [1024, 2048, 4096] {
            let [reference, deformed] = pair(size);
            let prepare = || {
                Correlator::new(CpuBackend::default(), reference.clone(), &zone(size, 16), Options::default())
                    .expect("a reference")
            };
            let preparing = time(7, prepare);
            let correlator = prepare();
            let cold = time(7, || correlator.correlate(deformed.clone(), None));
            let both = time(7, || prepare().correlate(deformed.clone(), None));
            let result = correlator.correlate(deformed.clone(), None).expect("a result");
            assert_eq!(result.measurement.status, Status::Converged);
            let transfer: Vec<_> = result.zones.iter().map(|zone| zone.transfer).collect();
            // 0.1 px off everywhere: the kind of start that a smooth series gives.
            let start: Vec<_> = result.measurement.displacement.iter().map(|u| u.map(|u| u + 0.1)).collect();
            let tracked = time(7, || correlator.correlate(deformed.clone(), Some((start.clone(), &transfer))));
            println!(
                "| {size}² | {} | {} | {} | {} | {} | {} |",
                shown3(preparing),
                shown3(cold),
                shown3(both),
                shown3(tracked),
                result.iterations,
                memory_in_child(size),
            );
        }
    });
    println!();
}

fn shown3([fastest, median, slowest]: [f64; 3]) -> String {
    format!("{median:.4} ({fastest:.4}-{slowest:.4})")
}

/// Peak memory of one cold pair in a process of its own, less what the images take.
fn memory_in_child(size: usize) -> String {
    let program = std::env::current_exe().expect("this program");
    let output = std::process::Command::new(program).arg(format!("memory={size}")).output().expect("a child");
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

fn memory_of_pair(size: usize) {
    threads(2).install(|| {
        let [reference, deformed] = pair(size);
        let before = status_kb("VmRSS:");
        // From here on the peak counts.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        let correlator = Correlator::new(CpuBackend::default(), reference, &zone(size, 16), Options::default());
        correlator.expect("a reference").correlate(deformed, None).expect("a result");
        let bytes = (status_kb("VmHWM:") - before) * 1024.0;
        println!("{:.1}", bytes / (size * size) as f64);
    });
}

fn status_kb(key: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(key)).unwrap_or("nan");
    line.trim().trim_end_matches("kB").trim().parse().unwrap_or(f64::NAN)
}

fn solvers() {
    println!("normal equations, 2 threads: ms, median of 5 (factor: once per reference; solve: per iteration)");
    println!("| mesh | nodes | factor | factor, MB | solve, direct | solve, CG to 1e-2 (iterations) | all variances |");
    println!("|---|---|---|---|---|---|---|");
    threads(2).install(|| {
        for (size, element) in [(512, 16), (1024, 16), (2048, 16), (1024, 4), (4096, 16), (2048, 4)] {
            let image = pair(size)[0].clone();
            let (backend, mesh) = (CpuBackend::default(), mesh(size, element));
            let mut frame = backend.frame(image, &kernel_options()).expect("a frame");
            let (_, moments) = backend.reference(&mut frame, 0, &mesh, &kernel_options()).expect("a level");
            let pattern = Arc::new(Pattern::new(mesh.mesh.n_nodes(), mesh.mesh.elements()));
            let matrices: Vec<_> = moments.iter().map(|m| m.matrix()).collect();
            let matrix = BlockMatrix::assemble(&pattern, mesh.mesh.elements(), &matrices);
            let grid = mesh.mesh.whole_grid(0).expect("a rectangle");
            let direct = || {
                let order = || nested_dissection(grid.nx + 1, grid.ny + 1);
                Solver::new(matrix.clone(), SolverChoice::Direct, order).expect("a factor")
            };
            let (factor, solver) = (time(5, direct), direct());
            let iterative = Solver::iterative(matrix.clone());
            let rhs: Vec<[f64; 2]> =
                (0..mesh.mesh.n_nodes()).map(|k| [(k as f64 * 1.3).sin(), (k as f64 * 1.7).cos()]).collect();
            let solve = time(5, || solver.solve(rhs.clone()));
            let cg = time(5, || iterative.solve(rhs.clone()));
            let (_, outcome) = iterative.jacobi().solve(&matrix, &rhs, 1e-2, 60);
            let colour: Vec<u32> =
                (0..=grid.ny).flat_map(|j| (0..=grid.nx).map(move |i| (4 * (j % 4) + i % 4) as u32)).collect();
            let variances = time(5, || inverse_diagonal(Isa::detect(), &matrix, iterative.jacobi(), &colour));
            println!(
                "| {size}²/{element} | {} | {:.1} | {:.0} | {:.2} | {:.2} ({}) | {:.1} |",
                mesh.mesh.n_nodes(),
                factor[1] * 1e3,
                solver.factor_bytes() as f64 / 1e6,
                solve[1] * 1e3,
                cg[1] * 1e3,
                outcome.iterations,
                variances[1] * 1e3,
            );
        }
    });
    println!();
}

/// Ratio of the per-pixel loop to the vector path in one run; the program fails when it is too small.
fn gate() {
    let size = 512;
    let [reference, deformed] = pair(size);
    let (options, mesh) = (kernel_options(), mesh(size, 16));
    let exact = exact_at(&Accuracy::new(size, size), mesh.mesh.nodes());
    let pass = |isa: Isa| {
        let backend = CpuBackend::new(isa);
        let mut frame = backend.frame(reference.clone(), &options).expect("a frame");
        let (level, _) = backend.reference(&mut frame, 0, &mesh, &options).expect("a level");
        let mut deformed = backend.frame(deformed.clone(), &options).expect("a frame");
        let mut field = backend.start(&level, &mut deformed, &exact, &[GreyTransfer::NONE]).expect("a field");
        time(15, || backend.observe(&level, &mut deformed, &mut field))[0]
    };
    let ratio = threads(1).install(|| {
        // The fastest of each: a neighbour on the machine can only slow a run down.
        pass(Isa::named("scalar").expect("always there")) / pass(Isa::detect())
    });
    println!("residual pass, {size}², one thread: the {} path is {ratio:.1} times the per-pixel loop", Isa::detect());
    if Isa::detect().name() != "baseline" && ratio < GATE {
        eprintln!("the vector path must be at least {GATE} times as fast: look for what keeps it from vectorising");
        std::process::exit(1);
    }
}
