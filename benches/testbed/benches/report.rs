//! Times and memory of the CPU path, and of all devices, as tables; `make results` writes them to `benches/RESULTS.md`.
//!
//!     cargo bench --bench report                 all tables (a few minutes)
//!     cargo bench --bench report -- kernels      one of: kernels, pairs, borders, solvers, devices
//!     cargo bench --bench report -- gate         only the ratios that CI checks: first pair / next ones, vector path /
//!                                                per-pixel loop, whole image / inner zone
//!
//! Every number is wall time of the named work alone, images in memory; medians of the stated number of
//! runs with the fastest and slowest beside. On a shared machine only ratios within one run are safe.

use quadrille::backend::Backend;
use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::gpu::adapters;
use quadrille::correlate::{Correlation, CorrelationError, Correlator, Options, Start};
use quadrille::field::Status;
use quadrille::imaging::Image;
use quadrille::isa::Isa;
use quadrille::linalg::{BlockMatrix, Pattern, Solver, SolverChoice, inverse_diagonal, nested_dissection};
use quadrille::mesh::{Roi, Zone};
use quadrille::synth::{Accuracy, Motion, RenderOptions, Sinusoids, Texture, Translation, render};
use quadrille_testbed::bench::{
    Device, Plan, Record, ResidualPass, Scene, Spread, Subject, kernel_options, once, repeat,
};
use std::convert::Infallible;
use std::fmt::Debug;
use std::sync::Arc;

/// The vector path must beat the per-pixel loop by this in the same run.
const GATE: f64 = 4.0;
/// The whole image as the zone may take so many iterations more than a zone that stays inside, and this many times its
/// time per pixel: counts do not vary, times by a third between runs.
const BORDER_GATE: (usize, f64) = (1, 1.6);

/// The first pair of a process may take this many times the processor time of those after it.
const COLD_GATE: f64 = 2.5;

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
    if asked("borders") {
        borders(&[1024, 2048, 4096]);
    }
    if asked("solvers") {
        solvers();
    }
    if asked("devices") {
        devices();
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

/// Seconds on the wall of `runs` repetitions.
fn time<T, E: Debug>(runs: usize, work: impl FnMut() -> Result<T, E>) -> Spread {
    repeat(runs, work).expect("a measurement").wall
}

fn shown(Spread { fastest, median, slowest }: Spread, scale: f64) -> String {
    format!("{:.2} ({:.2}-{:.2})", median * scale, fastest * scale, slowest * scale)
}

/// The result of work that cannot fail.
fn always<T>(value: T) -> Result<T, Infallible> {
    Ok(value)
}

fn threads(n: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("a thread pool")
}

fn scene(size: usize, element: usize) -> Scene {
    Scene::new(size, element, 1).expect("a scene")
}

fn kernels() {
    println!("kernels, one thread, cubic B-spline, 16 px elements: ns per pixel, median (fastest-slowest) of 9");
    println!("| size | path | prefilter | gradient + matrix | residual, strain 0.1 % | residual, strain 3 % |");
    println!("|---|---|---|---|---|---|");
    threads(1).install(|| {
        for size in [1024, 2048, 4096] {
            let scene = scene(size, 16);
            for isa in Isa::available() {
                if size > 1024 && ["baseline", "scalar"].contains(&isa.name()) {
                    continue;
                }
                let per_px = 1e9 / (size * size) as f64;
                let (backend, options) = (CpuBackend::new(isa), kernel_options());
                let prefilter = time(9, || backend.prepare(scene.reference.clone(), &options));
                let reference = time(9, || {
                    let mut frame = backend.frame(scene.reference.clone(), &options)?;
                    backend.reference(&mut frame, 0, &scene.mesh, &options, None)
                });
                let residual = [0.03, 1.0].map(|scale| {
                    let mut pass = ResidualPass::new(&backend, &scene, scale).expect("a field");
                    time(9, || pass.observe())
                });
                println!(
                    "| {size}² | {isa} | {} | {:.2} | {} | {} |",
                    shown(prefilter, per_px),
                    (reference.median - prefilter.median) * per_px,
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
            let scene = scene(size, 16);
            let deformed = scene.frame(0);
            let prepare =
                || Correlator::new(CpuBackend::default(), scene.reference.clone(), &scene.zone(), scene.options());
            let preparing = time(7, prepare);
            let correlator = prepare().expect("a reference");
            let cold = time(7, || correlator.correlate(deformed.clone(), None));
            let both = time(7, || prepare()?.correlate(deformed.clone(), None));
            let result = correlator.correlate(deformed.clone(), None).expect("a result");
            assert_eq!(result.measurement.status, Status::Converged);
            let transfer: Vec<_> = result.zones.iter().map(|zone| zone.transfer).collect();
            // 0.1 px off everywhere: the kind of start that a smooth series gives.
            let displacement = result.measurement.displacement.iter().map(|u| u.map(|u| u + 0.1)).collect();
            let start = Start::new(displacement, transfer);
            let tracked = time(7, || correlator.correlate(deformed.clone(), Some(&start)));
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

fn shown3(Spread { fastest, median, slowest }: Spread) -> String {
    format!("{median:.4} ({fastest:.4}-{slowest:.4})")
}

/// The waves of [`Accuracy`] with hardly any stretch, so that the border moves by `shift`.
#[derive(Clone, Copy)]
struct Moved {
    waves: Sinusoids,
    shift: [f64; 2],
}

impl Motion for Moved {
    fn displacement(&self, x: [f64; 2]) -> [f64; 2] {
        let u = self.waves.displacement(x);
        [u[0] + self.shift[0], u[1] + self.shift[1]]
    }

    fn at(&self, fraction: f64) -> Self {
        Self { waves: self.waves.at(fraction), shift: self.shift.map(|u| fraction * u) }
    }

    fn body_gradient(&self, body: usize, x: [f64; 2]) -> [[f64; 2]; 2] {
        self.waves.body_gradient(body, x)
    }
}

/// A frame that is measured again and again from the same start.
struct Tracked {
    correlator: Correlator<CpuBackend>,
    deformed: Arc<Image>,
    start: Start,
    /// Pixels of the zone.
    pixels: f64,
}

impl Tracked {
    /// On the whole image but for `margin` px at each side, from 0.1 px beside what is found.
    fn new(reference: &Arc<Image>, deformed: &Arc<Image>, margin: f64) -> Self {
        let [x1, y1] = [reference.width(), reference.height()].map(|n| n as f64 - margin);
        let zone = [Zone::rectangle("image", Roi { x0: margin, y0: margin, x1, y1 })];
        let correlator = Correlator::new(CpuBackend::default(), reference.clone(), &zone, Options::default());
        let correlator = correlator.expect("a reference");
        let found = correlator.correlate(deformed.clone(), None).expect("a result");
        assert_eq!(found.measurement.status, Status::Converged, "margin {margin}");
        let start = Start::new(
            found.full_displacement().iter().map(|u| u.map(|u| u + 0.1)).collect(),
            found.zones.iter().map(|zone| zone.transfer).collect(),
        );
        let pixels = (x1 - margin) * (y1 - margin);
        Self { correlator, deformed: deformed.clone(), start, pixels }
    }

    fn correlate(&self) -> Result<Correlation, CorrelationError> {
        self.correlator.correlate(self.deformed.clone(), Some(&self.start))
    }
}

/// What the whole image as the zone costs, where its border leaves the deformed image, against a zone that stays within
/// it.
#[derive(Clone, Copy)]
struct BorderCost {
    /// Iterations: inner zone, whole image.
    iterations: [usize; 2],
    /// Processor time per pixel of the zone, s.
    seconds: [f64; 2],
}

impl BorderCost {
    /// Of frames of `size` px moved by `motion`, `motion_px` at most; the fastest of some runs taken in turn.
    fn new(size: usize, motion: &impl Motion, motion_px: f64) -> Self {
        let texture = Texture::new(1, 4.5).expect("a texture");
        let options = RenderOptions::new(size, size);
        let reference = Arc::new(render(&texture, &Translation([0.0; 2]), &options).expect("an image"));
        let deformed = Arc::new(render(&texture, motion, &options).expect("an image"));
        let inner = 16.0 * (motion_px / 16.0).ceil() + 16.0;
        let both = [inner, 0.0].map(|margin| Tracked::new(&reference, &deformed, margin));
        let iterations = both.each_ref().map(|tracked| tracked.correlate().expect("a result").iterations);
        let mut seconds = [f64::INFINITY; 2];
        for _ in 0..3 {
            for (tracked, seconds) in both.iter().zip(&mut seconds) {
                let fastest = repeat(3, || tracked.correlate()).expect("a measurement").cpu.fastest;
                *seconds = seconds.min(fastest / tracked.pixels);
            }
        }
        Self { iterations, seconds }
    }

    /// Processor time per pixel, whole image over inner zone.
    fn ratio(&self) -> f64 {
        self.seconds[1] / self.seconds[0]
    }
}

fn borders(sizes: &[usize]) {
    println!(
        "frame that starts 0.1 px off, 2 threads, 16 px elements: whole image as the zone against one that stays inside"
    );
    println!("processor time per pixel of the zone, all but reading the file, fastest of 9 taken in turn");
    println!("| size | motion | iterations, inner | whole | ns/px, inner | whole | whole / inner |");
    println!("|---|---|---|---|---|---|---|");
    threads(2).install(|| {
        for &size in sizes {
            let waves = Sinusoids { amplitude: 1.0, wavelength: 256.0 };
            let stretched = Accuracy::new(size, size);
            let reach = 0.0065 * 0.5 * size as f64 + 1.0;
            let of_stretch = ("0.5 %, 0.2 degrees".to_owned(), BorderCost::new(size, &stretched, reach));
            let moved = [5.0, 20.0, 60.0].map(|px| {
                let motion = Moved { waves, shift: [0.8 * px, -0.6 * px] };
                (format!("{px} px"), BorderCost::new(size, &motion, px + 1.0))
            });
            for (what, cost) in moved.into_iter().chain([of_stretch]) {
                let ([inner, whole], ns) = (cost.iterations, cost.seconds.map(|s| 1e9 * s));
                let ratio = cost.ratio();
                println!("| {size}² | {what} | {inner} | {whole} | {:.2} | {:.2} | {ratio:.2} |", ns[0], ns[1]);
            }
        }
    });
    println!();
}

/// Peak memory of one cold pair in a process of its own, less what the images take.
fn memory_in_child(size: usize) -> String {
    let program = std::env::current_exe().expect("this program");
    let output = std::process::Command::new(program).arg(format!("memory={size}")).output().expect("a child");
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

fn memory_of_pair(size: usize) {
    threads(2).install(|| {
        let Scene { reference, mut deformed, .. } = scene(size, 16);
        let zone = scene(64, 16).zone();
        let before = status_kb("VmRSS:");
        // From here on the peak counts.
        let _ = std::fs::write("/proc/self/clear_refs", "5");
        let correlator = Correlator::new(CpuBackend::default(), reference, &zone, Options::default());
        correlator.expect("a reference").correlate(deformed.remove(0), None).expect("a result");
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
    println!("| mesh | nodes | factor | factor, MB | solve, direct | solve, CG to 3e-3 (iterations) | all variances |");
    println!("|---|---|---|---|---|---|---|");
    threads(2).install(|| {
        for (size, element) in [(512, 16), (1024, 16), (2048, 16), (1024, 4), (4096, 16), (2048, 4)] {
            let Scene { reference, mesh, .. } = scene(size, element);
            let backend = CpuBackend::default();
            let mut frame = backend.frame(reference, &kernel_options()).expect("a frame");
            let (_, moments) = backend.reference(&mut frame, 0, &mesh, &kernel_options(), None).expect("a level");
            let pattern = Arc::new(Pattern::new(mesh.mesh.n_nodes(), mesh.mesh.elements()));
            let matrices: Vec<_> = moments.iter().map(|m| m.matrix()).collect();
            let matrix = BlockMatrix::assemble(&pattern, mesh.mesh.elements(), &matrices);
            let grid = mesh.mesh.whole_grid(0).expect("a rectangle");
            let direct = || {
                let order = || nested_dissection(grid.nx + 1, grid.ny + 1);
                Solver::new(matrix.clone(), SolverChoice::Direct, order)
            };
            let (factor, solver) = (time(5, direct), direct().expect("a factor"));
            let iterative = Solver::iterative(matrix.clone());
            let rhs: Vec<[f64; 2]> =
                (0..mesh.mesh.n_nodes()).map(|k| [(k as f64 * 1.3).sin(), (k as f64 * 1.7).cos()]).collect();
            let solve = time(5, || always(solver.solve(rhs.clone())));
            let cg = time(5, || always(iterative.solve(rhs.clone())));
            let (_, outcome) = iterative.jacobi().solve(&matrix, &rhs, 3e-3, 60);
            let colour: Vec<u32> =
                (0..=grid.ny).flat_map(|j| (0..=grid.nx).map(move |i| (4 * (j % 4) + i % 4) as u32)).collect();
            let variances = time(5, || always(inverse_diagonal(Isa::detect(), &matrix, iterative.jacobi(), &colour)));
            println!(
                "| {size}²/{element} | {} | {:.1} | {:.0} | {:.2} | {:.2} ({}) | {:.1} |",
                mesh.mesh.n_nodes(),
                factor.median * 1e3,
                solver.factor_bytes() as f64 / 1e6,
                solve.median * 1e3,
                cg.median * 1e3,
                outcome.iterations,
                variances.median * 1e3,
            );
        }
    });
    println!();
}

/// Every device of this machine; the same as `testbed devices`.
fn devices() {
    let usable = adapters().list.into_iter().filter(|adapter| adapter.unusable.is_none());
    let devices: Vec<_> = [Device::Cpu].into_iter().chain(usable.map(|a| Device::Adapter(Box::new(a)))).collect();
    let plan = Plan { sizes_px: vec![512, 1024, 2048], element_size_px: 16, runs: 5, frames: 6 };
    let record = threads(2).install(|| Record::measure(&devices, plan, machine(), |what| eprintln!("{what}")));
    println!("{}", record.expect("figures"));
}

/// Ratios in one run; the program fails when one of them is not what it must be.
fn gate() {
    gate_of_first_pair(); // while this process is fresh
    gate_of_paths();
    gate_of_borders();
}

/// The first pair of a process, for which memory is touched, threads are started and tables are made, against the next
/// ones: processor time, from two images in memory to the field.
fn gate_of_first_pair() {
    let scene = scene(1024, 16);
    let pair = || {
        let correlator =
            Correlator::new(CpuBackend::default(), scene.reference.clone(), &scene.zone(), scene.options())?;
        correlator.correlate(scene.frame(0).clone(), None)
    };
    let [first, next] =
        threads(2).install(|| [once(pair), repeat(5, pair)].map(|times| times.expect("a pair").cpu.median));
    let ratio = first / next;
    println!("cold pair, 1024²: the first of the process takes {ratio:.2} times the processor time of the next ones");
    if ratio > COLD_GATE {
        eprintln!("the first pair must take at most {COLD_GATE} times as long: look for what is made or touched once");
        std::process::exit(1);
    }
}

/// The whole image as the zone against one that stays inside: iterations, and processor time per pixel, whose fastest
/// run a neighbour on the machine can only slow down.
fn gate_of_borders() {
    let motion = Moved { waves: Sinusoids { amplitude: 1.0, wavelength: 256.0 }, shift: [16.0, -12.0] };
    let cost = threads(2).install(|| BorderCost::new(1024, &motion, 21.0));
    let ([inner, whole], time) = (cost.iterations, cost.ratio());
    println!(
        "whole image against inner zone, 1024², 20 px: {whole} iterations against {inner}, {time:.2} times the time"
    );
    let (more, most_time) = BORDER_GATE;
    if whole > inner + more || time > most_time {
        eprintln!(
            "the whole image must take at most {more} iteration more than the inner zone and {most_time} times its time: \
             look for what the border adds"
        );
        std::process::exit(1);
    }
}

/// Ratio of the per-pixel loop to the vector path.
fn gate_of_paths() {
    let scene = scene(512, 16);
    let pass = |isa: Isa| {
        // A strain of 0.1 %, so that floors change seldom and the pixels alone are compared.
        let mut pass = ResidualPass::new(&CpuBackend::new(isa), &scene, 0.03).expect("a field");
        // The fastest: a neighbour on the machine can only slow a run down.
        time(15, || pass.observe()).fastest
    };
    let ratio = threads(1).install(|| pass(Isa::named("scalar").expect("always there")) / pass(Isa::detect()));
    println!("residual pass, 512², one thread: the {} path is {ratio:.1} times the per-pixel loop", Isa::detect());
    if Isa::detect().name() != "baseline" && ratio < GATE {
        eprintln!("the vector path must be at least {GATE} times as fast: look for what keeps it from vectorising");
        std::process::exit(1);
    }
}
