//! The kernels and solvers of the CPU path one by one: `cargo bench --bench kernels`.
//!
//! One thread, images in memory, 16 px elements, cubic B-spline. Items are pixels, so that divan prints a
//! rate; fastest, slowest and median stand beside each other. Tables, whole
//! pairs and memory: `cargo bench --bench report`.

use divan::Bencher;
use divan::counter::ItemsCount;
use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, GreyTransfer, KernelOptions};
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation};
use quadrille::isa::Isa;
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use quadrille::synth::{Motion, RenderOptions, Texture, Translation, render};
use std::sync::{Arc, LazyLock};

fn main() {
    println!("instruction path {}, one thread", Isa::detect());
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    one.install(divan::main);
}

const SIZE: usize = 1024;
const SHIFT: Translation = Translation([0.37, -0.71]);
const INTERPOLATIONS: [&str; 4] = ["cubic", "quintic", "keys", "bilinear"];

fn image(motion: &impl Motion) -> Arc<Image> {
    let texture = Texture::new(1, 4.5).expect("a texture");
    Arc::new(render(&texture, motion, &RenderOptions::new(SIZE, SIZE)).expect("an image"))
}

static REFERENCE: LazyLock<Arc<Image>> = LazyLock::new(|| image(&Translation([0.0; 2])));
static DEFORMED: LazyLock<Arc<Image>> = LazyLock::new(|| image(&SHIFT));

fn mesh(element: usize) -> PixelMesh {
    let (low, high) = (element as f64, (SIZE - element) as f64);
    let zone = Zone::rectangle("image", Roi { x0: low, y0: low, x1: high, y1: high });
    PixelMesh::on_zones(&[zone], element, ELEMENT_SHARE, [SIZE, SIZE]).expect("a mesh")
}

fn options(interpolation: &str) -> KernelOptions {
    let interpolation = [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear]
        .into_iter()
        .find(|i| i.name() == interpolation)
        .expect("a name of the list");
    KernelOptions::new((0.0, 255.0), interpolation, Brightness::Zone)
}

/// Conversion from 8 bit and B-spline prefilter.
#[divan::bench(args = INTERPOLATIONS)]
fn prefilter(bencher: Bencher, interpolation: &str) {
    let (backend, options) = (CpuBackend::default(), options(interpolation));
    bencher.counter(ItemsCount::new(SIZE * SIZE)).bench(|| {
        let mut frame = backend.frame(REFERENCE.clone(), &options).expect("a frame");
        backend.prefilter(&mut frame, 0).expect("memory");
        frame
    });
}

/// Prefilter, gradients and element moments of a reference.
#[divan::bench]
fn reference(bencher: Bencher) {
    let (backend, options, mesh) = (CpuBackend::default(), options("cubic"), mesh(16));
    bencher.counter(ItemsCount::new(SIZE * SIZE)).bench(|| {
        let mut frame = backend.frame(REFERENCE.clone(), &options).expect("a frame");
        backend.reference(&mut frame, 0, &mesh, &options, None).expect("a level").1
    });
}

/// The fused pass of an iteration: interpolation, residual, right-hand side, grey-level sums.
#[divan::bench(args = INTERPOLATIONS)]
fn residual(bencher: Bencher, interpolation: &str) {
    residual_pass(bencher, interpolation, 16);
}

/// The same for other element sizes.
#[divan::bench(args = [4, 8, 24, 32, 64])]
fn residual_by_element_size(bencher: Bencher, element: usize) {
    residual_pass(bencher, "cubic", element);
}

/// The same in fields whose pixels land beyond different floors along a row, as those of any strain or turn do.
#[divan::bench(args = ["moved", "3 % along x", "3 % along y", "25 % along x", "2 degrees", "15 degrees"])]
fn residual_by_field(bencher: Bencher, field: &str) {
    let about_middle = |[xx, xy, yx, yy]: [f64; 4]| {
        move |x: f64, y: f64| {
            let [x, y] = [x, y].map(|at| at - 0.5 * SIZE as f64);
            [0.37 + xx * x + xy * y, -0.71 + yx * x + yy * y]
        }
    };
    let turned = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [cos - 1.0, -sin, sin, cos - 1.0]
    };
    residual_pass_in(
        bencher,
        "cubic",
        16,
        about_middle(match field {
            "moved" => [0.0; 4],
            "3 % along x" => [0.03, 0.0, 0.0, 0.0],
            "3 % along y" => [0.0, 0.0, 0.0, 0.03],
            "25 % along x" => [0.25, 0.0, 0.0, 0.0],
            "2 degrees" => turned(2.0),
            "15 degrees" => turned(15.0),
            _ => unreachable!("a field of the list"),
        }),
    );
}

fn residual_pass(bencher: Bencher, interpolation: &str, element: usize) {
    residual_pass_in(bencher, interpolation, element, |_, _| SHIFT.0);
}

/// In a field that need not be that of the image: what a pass takes does not depend on it.
fn residual_pass_in(bencher: Bencher, interpolation: &str, element: usize, field: impl Fn(f64, f64) -> [f64; 2]) {
    let (backend, options, mesh) = (CpuBackend::default(), options(interpolation), mesh(element));
    let displacement: Vec<[f64; 2]> = mesh.mesh.nodes().iter().map(|&[x, y]| field(x, y)).collect();
    let mut reference = backend.frame(REFERENCE.clone(), &options).expect("a frame");
    let (level, _) = backend.reference(&mut reference, 0, &mesh, &options, None).expect("a level");
    let mut deformed = backend.frame(DEFORMED.clone(), &options).expect("a frame");
    let mut field = backend.start(&level, &mut deformed, &displacement, &[GreyTransfer::NONE]).expect("a field");
    bencher
        .counter(ItemsCount::new(SIZE * SIZE))
        .bench_local(|| backend.observe(&level, &mut deformed, &mut field).expect("a pass"));
}
