//! The kernels and solvers of the CPU path one by one: `cargo bench --bench kernels`.
//!
//! One thread, images in memory, 16 px elements, cubic B-spline. Items are pixels, so that divan prints a
//! rate; fastest, slowest and median stand beside each other. Tables for `benches/RESULTS.md`, whole
//! pairs and memory: `cargo bench --bench report`.

use divan::Bencher;
use divan::counter::ItemsCount;
use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, GreyTransfer, KernelOptions};
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation};
use quadrille::isa::Isa;
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use quadrille::synth::{Motion, RenderOptions, Texture, Translation, exact_at, render};
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
        backend.reference(&mut frame, 0, &mesh, &options).expect("a level").1
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

fn residual_pass(bencher: Bencher, interpolation: &str, element: usize) {
    let (backend, options, mesh) = (CpuBackend::default(), options(interpolation), mesh(element));
    let mut reference = backend.frame(REFERENCE.clone(), &options).expect("a frame");
    let (level, _) = backend.reference(&mut reference, 0, &mesh, &options).expect("a level");
    let mut deformed = backend.frame(DEFORMED.clone(), &options).expect("a frame");
    let mut field = backend
        .start(&level, &mut deformed, &exact_at(&SHIFT, mesh.mesh.nodes()), &[GreyTransfer::NONE])
        .expect("a field");
    bencher
        .counter(ItemsCount::new(SIZE * SIZE))
        .bench_local(|| backend.observe(&level, &mut deformed, &mut field).expect("a pass"));
}
