//! The page of the browser (`web/`) without a browser: its shaders are those of the crate, and the answer that it compares a device with
//! is what the CPU finds. `tests/commands/web.rs` opens the page.
//!
//! Both files are written, and not compared, by `QUADRILLE_BLESS=1 cargo test --test correlation web::`.

#![cfg(feature = "gpu")]

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use naga::common::wgsl::TryToWgsl;
use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::gpu::{Binding, KERNELS, Kernel, source};
use quadrille::backend::{
    Ahead, BACK_MORE, Backend, ElementMoments, GreyTransfer, KEPT_MOST, KEPT_PX, KEPT_SHARE, KernelOptions, LOST_SHARE,
    Place, STAYS_OUT,
};
use quadrille::correlate::{Correlator, Options};
use quadrille::field::{Brightness, Status};
use quadrille::imaging::{Image, Interpolation, Levels, Pixels};
use quadrille::isa::Isa;
use quadrille::linalg::{BlockMatrix, Pattern, Solver};
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

const BLESS: &str = "QUADRILLE_BLESS=1 cargo test --test correlation web::";

/// Kernels that the page has no use for: elements of any shape, a gain for each element, regularisation, and copies that are timed.
const ELSEWHERE: [Kernel; 4] = [Kernel::ResidualRuns, Kernel::Fit, Kernel::Penalty, Kernel::Copy];

fn file(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("web").join(name)
}

fn is_blessed() -> bool {
    std::env::var_os("QUADRILLE_BLESS").is_some_and(|value| value == "1")
}

// ---- shaders.js ----------------------------------------------------------------------------------------

#[test]
fn the_page_has_the_shaders_as_the_crate_puts_them_together() {
    let wanted = shaders();
    if is_blessed() {
        std::fs::write(file("shaders.js"), &wanted).unwrap();
    }
    let found = std::fs::read_to_string(file("shaders.js")).unwrap_or_default();
    let line = wanted.lines().zip(found.lines()).position(|(wanted, found)| wanted != found);
    assert!(
        wanted == found,
        "web/shaders.js is another from line {:?} on; write it anew: {BLESS}",
        line.map(|at| at + 1)
    );
}

fn shaders() -> String {
    let mut text = format!(
        "// The files of `shaders/` (a page that is opened as a file cannot read others), what each kernel binds, its constants, and where the\n\
         // fields of its structs lie. Written, and compared, by tests/correlation/web.rs: {BLESS}\n'use strict';\n\nconst SHADERS = {{\n"
    );
    let (mut layouts, mut files) = (BTreeMap::new(), BTreeMap::new());
    for kernel in KERNELS.into_iter().filter(|kernel| !ELSEWHERE.contains(kernel)) {
        let source = source(kernel, Interpolation::Cubic);
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        for (_, global) in module.global_variables.iter().filter(|(_, global)| global.binding.is_some()) {
            add_layout(&module, global.ty, &mut layouts);
        }
        let bindings: Vec<&str> = kernel
            .bindings()
            .iter()
            .map(|binding| match binding {
                Binding::Uniform => "'uniform'",
                Binding::Read => "'read'",
                Binding::Write => "'write'",
            })
            .collect();
        add_file(kernel.file(), &mut files);
        writeln!(text, "  {}: {{", kernel.name()).unwrap();
        writeln!(text, "    file: '{}',\n    entry: '{}',", kernel.file(), kernel.entry()).unwrap();
        writeln!(text, "    bindings: [{}],", bindings.join(", ")).unwrap();
        writeln!(text, "    constants: {{ {} }},\n  }},", constants(&module).join(", ")).unwrap();
    }
    text.push_str("};\n\nconst FILES = {\n");
    for (name, source) in files {
        let template = source.replace('\\', "\\\\").replace('`', "\\`").replace("${", "\\${");
        writeln!(text, "  '{name}': `{template}`,").unwrap();
    }
    text.push_str("};\n\n// Size of each struct; offset and kind of its fields.\nconst LAYOUTS = {\n");
    for (name, layout) in layouts {
        writeln!(text, "  {name}: {layout},").unwrap();
    }
    writeln!(
        text,
        "}};\n\nconst CONSTANTS = {{\n  KEPT_SHARE: {KEPT_SHARE},\n  KEPT_PX: {KEPT_PX},\n  KEPT_MOST: {KEPT_MOST},\n  \
         BACK_MORE: {BACK_MORE},\n  STAYS_OUT: {STAYS_OUT},\n  LOST_SHARE: {LOST_SHARE},\n  \
         // What noise of variance one adds to the mean square of a component of the gradient.\n  GRADIENT_NOISE_GAIN: {:.6},\n}};",
        Interpolation::Cubic.gradient_noise_gain(),
    )
    .unwrap();
    text
}

/// A file of `shaders/`, and those that it imports.
fn add_file(name: &str, files: &mut BTreeMap<String, String>) {
    if !files.contains_key(name) {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("shaders").join(format!("{name}.wgsl"));
        let source = std::fs::read_to_string(path).unwrap();
        files.insert(name.to_owned(), source.clone());
        for import in source.lines().filter_map(|line| line.strip_prefix("#import ")) {
            let import = if import == "spline" { Interpolation::Cubic.name() } else { import };
            add_file(&format!("shared/{import}"), files);
        }
    }
}

/// Whole numbers that the source gives a name.
fn constants(module: &naga::Module) -> Vec<String> {
    let of = |constant: &naga::Constant| {
        let value = match module.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) => i64::from(value),
            naga::Expression::Literal(naga::Literal::I32(value)) => i64::from(value),
            _ => return None,
        };
        Some(format!("{}: {value}", constant.name.as_deref()?))
    };
    module.constants.iter().filter_map(|(_, constant)| of(constant)).collect()
}

fn add_layout(module: &naga::Module, ty: naga::Handle<naga::Type>, layouts: &mut BTreeMap<String, String>) {
    match &module.types[ty].inner {
        naga::TypeInner::Array { base, .. } => add_layout(module, *base, layouts),
        naga::TypeInner::Struct { members, span } => {
            let field = |member: &naga::StructMember| {
                format!("{}: [{}, '{}']", member.name.as_deref().unwrap(), member.offset, kind(module, member.ty))
            };
            let fields: Vec<String> = members.iter().map(field).collect();
            let layout = format!("{{ size: {span}, fields: {{ {} }} }}", fields.join(", "));
            layouts.insert(module.types[ty].name.clone().unwrap(), layout);
            members.iter().for_each(|member| add_layout(module, member.ty, layouts));
        }
        _ => {}
    }
}

/// The kind of the numbers of a type; a struct's name.
fn kind(module: &naga::Module, ty: naga::Handle<naga::Type>) -> String {
    match &module.types[ty].inner {
        naga::TypeInner::Scalar(scalar) | naga::TypeInner::Vector { scalar, .. } => scalar.to_wgsl_for_diagnostics(),
        naga::TypeInner::Array { base, .. } => kind(module, *base),
        _ => module.types[ty].name.clone().unwrap(),
    }
}

// ---- answer.js -----------------------------------------------------------------------------------------

/// What the page compares a device with.
#[derive(Debug, Serialize, Deserialize)]
struct Answer {
    version: String,
    width: usize,
    height: usize,
    element: usize,
    /// x0, y0, x1, y1.
    zone: [f64; 4],
    /// Displacement that the finer and the coarser level start at, the same everywhere, px of the level.
    starts: [[f64; 2]; 2],
    /// Gain and offset to start with.
    transfer: [f64; 2],
    /// Steps of an iteration, after which less is left than devices may differ by.
    steps: usize,
    /// Grey levels, 8 bit, row by row.
    reference: String,
    deformed: String,
    numbers: Vec<Numbers>,
}

/// Numbers of one kind, as the CPU finds them, and what a device may differ by: px, or a share of the largest.
#[derive(Debug, Serialize, Deserialize)]
struct Numbers {
    what: String,
    unit: String,
    allowed: f64,
    values: Vec<f32>,
}

/// As in `src/backend/check.rs`: what round-off may make of sums, of sums of residuals, of displacements.
const SUMS: f64 = 3e-5;
const MOMENTS: f64 = 3e-4;
const RESIDUALS: f64 = 3e-4;
const DISPLACEMENTS_PX: f64 = 2e-5;
/// Of that, what two instruction paths of the CPU may differ by: they add in other orders, but in the same pieces.
const OF_PATHS: f64 = 0.2;

const SIZE: [usize; 2] = [131, 97];

/// The displacement of a place, px.
fn motion([x, y]: [f64; 2]) -> [f64; 2] {
    [2.3 + 0.6 * (0.05 * x + 0.03 * y).sin(), -1.6 + 0.5 * (0.04 * y - 0.02 * x).cos()]
}

/// Waves of 5 to 14 px across each other; moved, and in another light, where `moved` is 1.
fn drawn(moved: f64) -> Vec<u8> {
    const WAVES: [[f64; 3]; 6] = [
        [1.21, 0.16, 0.3],
        [-0.31, 0.97, 1.7],
        [0.62, 0.71, 2.9],
        [0.83, -0.55, 0.8],
        [0.20, -0.47, 4.1],
        [-0.44, -0.11, 5.3],
    ];
    let grey = |at: usize| {
        let place = [(at % SIZE[0]) as f64, (at / SIZE[0]) as f64];
        let u = motion(place);
        let [x, y] = [place[0] - moved * u[0], place[1] - moved * u[1]];
        let waves: f64 = WAVES.iter().map(|[kx, ky, phase]| (kx * x + ky * y + phase).sin()).sum();
        let level = 0.5 + 0.07 * waves;
        255.0 * if moved > 0.0 { 0.93 * level + 0.02 } else { level }
    };
    (0..SIZE[0] * SIZE[1]).map(|at| grey(at).round() as u8).collect()
}

/// The answer that the page has, written anew where that is asked for.
fn stored() -> &'static Answer {
    static STORED: OnceLock<Answer> = OnceLock::new();
    STORED.get_or_init(|| {
        let head = "// A pair of images and what the program finds in it on the CPU, for a page that checks a graphics device with it.\n\
                    // Written, and compared, by tests/correlation/web.rs: ";
        let head = format!("{head}{BLESS}\n'use strict';\n\nconst ANSWER = ");
        if is_blessed() {
            let json = serde_json::to_string(&Answer::made()).unwrap();
            // A line for each kind of numbers.
            let json = json.replace(",\"", ",\n\"").replace("{\"what\"", "\n{\"what\"");
            std::fs::write(file("answer.js"), format!("{head}{json};\n")).unwrap();
        }
        let text = std::fs::read_to_string(file("answer.js")).unwrap_or_default();
        let json = text.strip_prefix(&head).and_then(|text| text.strip_suffix(";\n")).unwrap_or("");
        serde_json::from_str(json).unwrap_or_else(|error| panic!("web/answer.js: {error}; write it anew: {BLESS}"))
    })
}

#[test]
fn the_answer_of_the_page_is_what_the_cpu_finds() {
    let answer = stored();
    assert_eq!(answer.version, env!("CARGO_PKG_VERSION"), "web/answer.js is of another version: {BLESS}");
    for (moved, stored) in [(0.0, &answer.reference), (1.0, &answer.deformed)] {
        // Another library of sines may round a tie the other way.
        let apart = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 1;
        assert!(drawn(moved).iter().zip(&STANDARD.decode(stored).unwrap()).all(apart), "image {moved}: {BLESS}");
    }
    let found = answer.found();
    assert_eq!(found.len(), answer.numbers.len(), "{BLESS}");
    for (found, stored) in found.iter().zip(&answer.numbers) {
        let Numbers { what, unit, allowed, values } = found;
        assert_eq!(
            (what, unit, allowed, values.len()),
            (&stored.what, &stored.unit, &stored.allowed, stored.values.len())
        );
        let largest = stored.values.iter().fold(0.0f32, |largest, v| largest.max(v.abs()));
        let scale = if unit == "px" { 1.0 } else { f64::from(largest) };
        let apart = |(a, b): (&f32, &f32)| f64::from((a - b).abs()) / scale;
        let difference = values.iter().zip(&stored.values).map(apart).fold(0.0, f64::max);
        assert!(difference <= OF_PATHS * allowed, "{what} differ by {difference:.1e}: {BLESS}");
    }
}

#[test]
fn the_answer_of_the_page_is_what_the_whole_program_measures() {
    let answer = stored();
    let [reference, deformed] = answer.images();
    // As far as single precision goes, and with the gain and offset of the page.
    let options = Options {
        brightness: Brightness::Zone,
        tolerance_px: 5e-6,
        tolerance_by_sigma: 0.0,
        element_size: answer.element,
        ..Options::default()
    };
    let correlator = Correlator::new(CpuBackend::new(Isa::detect()), reference, &answer.zones(), options).unwrap();
    let measured = correlator.correlate(deformed, None).unwrap().measurement;
    assert_eq!(measured.status, Status::Converged);
    let stored = &answer.numbers.iter().find(|numbers| numbers.what == "displacement").unwrap().values;
    let apart = |(a, b): (&f64, &f32)| (a - f64::from(*b)).abs();
    let difference = measured.displacement.as_flattened().iter().zip(stored).map(apart).fold(0.0, f64::max);
    assert!(difference <= DISPLACEMENTS_PX, "{difference:.1e} px");
    // It is near what the images were drawn with; waves of 5 px in whole grey levels and Q4 elements of 16 px allow no more.
    let inside = |[x, y]: &[f64; 2]| *x > 16.0 && *x < 112.0 && *y > 16.0 && *y < 80.0;
    for (at, u) in measured.mesh.nodes().iter().zip(&measured.displacement).filter(|(at, _)| inside(at)) {
        let true_u = motion(*at);
        assert!((0..2).all(|c| (u[c] - true_u[c]).abs() < 0.2), "{at:?}: {u:?} for {true_u:?}");
    }
}

impl Answer {
    fn made() -> Self {
        let [reference, deformed] = [0.0, 1.0].map(|moved| STANDARD.encode(drawn(moved)));
        let mut answer = Self {
            version: env!("CARGO_PKG_VERSION").into(),
            width: SIZE[0],
            height: SIZE[1],
            element: 16,
            // Elements at the upper border, where pixels leave the image.
            zone: [1.0, 0.0, 120.0, 97.0],
            starts: [[2.55, -1.35], [1.2, -0.7]],
            transfer: [1.04, -1.5],
            steps: 24,
            reference,
            deformed,
            numbers: Vec::new(),
        };
        answer.numbers = answer.found();
        answer
    }

    fn images(&self) -> [Arc<Image>; 2] {
        [&self.reference, &self.deformed].map(|text| {
            let pixels = Pixels::U8(STANDARD.decode(text).unwrap());
            Arc::new(Image::new(self.width, self.height, pixels).unwrap())
        })
    }

    fn zones(&self) -> [Zone; 1] {
        let [x0, y0, x1, y1] = self.zone;
        [Zone::rectangle("all", Roi { x0, y0, x1, y1 })]
    }

    /// What the CPU finds, in the order of `numbersOf` in `web/check.js`.
    fn found(&self) -> Vec<Numbers> {
        let backend = CpuBackend::new(Isa::detect());
        let [reference, deformed] = self.images();
        let (low, high) = reference.range();
        assert!(matches!(reference.pixels(), Levels::U8(_)));
        let options = KernelOptions::new((low, high), Interpolation::Cubic, Brightness::Zone);
        let size = [self.width, self.height];
        let fine = PixelMesh::on_zones(&self.zones(), self.element, ELEMENT_SHARE, size).unwrap();
        let coarse = fine.halved(self.element, size.map(|n| n / 2)).unwrap();
        let mut reference = backend.frame(reference, &options).unwrap();
        let mut deformed = backend.frame(deformed, &options).unwrap();
        let transfer = [GreyTransfer { gain: self.transfer[0], offset: self.transfer[1] }];
        let mut numbers = Vec::new();
        let mut add = |what: &str, unit: &str, allowed, values: Vec<f64>| {
            let values = values.into_iter().map(|v| v as f32).collect();
            numbers.push(Numbers { what: what.into(), unit: unit.into(), allowed, values });
        };

        let (coarser, moments) = backend.reference(&mut reference, 1, &coarse, &options).unwrap();
        add("moments of elements, level 1", "", MOMENTS, of_moments(&moments));
        let solver = backend.solver(&coarser, solver(&coarse, &moments)).unwrap();
        let start = vec![self.starts[1]; coarse.mesh.n_nodes()];
        let mut field = backend.start(&coarser, &mut deformed, &start, &transfer).unwrap();
        backend.observe(&coarser, &mut deformed, &mut field).unwrap();
        let rhs = backend.right_hand_side(&coarser, &mut deformed, &field).unwrap();
        add("right-hand side, level 1", "", RESIDUALS, rhs.into_flattened());
        for _ in 0..self.steps {
            backend.step(&coarser, &mut deformed, &mut field, &solver, [1.0, 0.0], &Ahead::NONE).unwrap();
        }
        let found = backend.found(&coarser, &mut deformed, &field).unwrap();
        add("displacement, level 1", "px", DISPLACEMENTS_PX, found.displacement.into_flattened());

        let (mut level, moments) = backend.reference(&mut reference, 0, &fine, &options).unwrap();
        add("moments of elements", "", MOMENTS, of_moments(&moments));
        backend.link(&mut level, places(&fine, &coarse)).unwrap();
        let solver = backend.solver(&level, self::solver(&fine, &moments)).unwrap();
        let mut field = backend.start_finer(&level, &mut deformed, &field, true).unwrap();
        let began = backend.found(&level, &mut deformed, &field).unwrap();
        // The double of what the coarser level differs by.
        add("displacement of a start", "px", 2.0 * DISPLACEMENTS_PX, began.displacement.into_flattened());
        let start = vec![self.starts[0]; fine.mesh.n_nodes()];
        backend.place(&level, &mut deformed, &mut field, &start).unwrap();
        let (sums, _) = backend.observe(&level, &mut deformed, &mut field).unwrap()[0];
        add("sums of the zone", "", SUMS, vec![sums.n, sums.f, sums.ff, sums.g, sums.gg, sums.fg]);
        add("residual of the zone", "", RESIDUALS, vec![sums.rr]);
        let rhs = backend.right_hand_side(&level, &mut deformed, &field).unwrap();
        add("right-hand side", "", RESIDUALS, rhs.into_flattened());
        let remaining = backend.remaining_moments(&level, &mut deformed, &field).unwrap();
        let remaining: Vec<ElementMoments> = remaining.into_iter().map(|(_, moments)| moments).collect();
        add("moments of elements that have lost pixels", "", MOMENTS, of_moments(&remaining));
        for _ in 0..self.steps {
            backend.step(&level, &mut deformed, &mut field, &solver, [1.0, 0.0], &Ahead::NONE).unwrap();
        }
        let found = backend.found(&level, &mut deformed, &field).unwrap();
        let area = (self.element * self.element) as f64;
        let matches = found.elements.iter().flat_map(|e| [e.correlation, e.n / area]);
        // They come as 16-bit numbers.
        add("match of elements", "", 1e-4, matches.collect());
        add("displacement", "px", DISPLACEMENTS_PX, found.displacement.into_flattened());
        numbers
    }
}

fn of_moments(moments: &[ElementMoments]) -> Vec<f64> {
    moments.iter().flat_map(|of| of.gradient.into_iter().flatten().flatten()).collect()
}

fn solver(mesh: &PixelMesh, moments: &[ElementMoments]) -> Solver {
    let mesh = &mesh.mesh;
    let pattern = Arc::new(Pattern::new(mesh.n_nodes(), mesh.elements()));
    let matrices: Vec<_> = moments.iter().map(ElementMoments::matrix).collect();
    Solver::iterative(BlockMatrix::assemble(&pattern, mesh.elements(), &matrices))
}

/// Where the nodes of the fine mesh lie in the coarse one, which covers the same rectangle.
fn places(fine: &PixelMesh, coarse: &PixelMesh) -> Vec<Place> {
    let (bounds, mesh) = (coarse.mesh.bounds(0), &coarse.mesh);
    let place = |[x, y]: &[f64; 2]| {
        // The far edges belong to no element.
        let (x, y) = (0.5 * (x - 0.5), 0.5 * (y - 0.5));
        let inside = [x.min(bounds.x1 - 1e-9), y.min(bounds.y1 - 1e-9)];
        let (element, xi, eta) = mesh.locate(0, inside[0], inside[1]).unwrap();
        let weights = [(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta];
        Place { nodes: mesh.elements()[element], weights }
    };
    fine.mesh.nodes().iter().map(place).collect()
}
