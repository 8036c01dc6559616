//! The shaders against the Rust side, without a GPU: every kernel parses and validates, and both sides agree on
//! structs, bindings and workgroup sizes.

#![cfg(feature = "gpu")]

use naga::BinaryOperator as Op;
use naga::valid::{Capabilities, ValidationFlags, Validator};
use quadrille::backend::gpu::{Binding, Extent, KERNELS, Kernel, mirrors, source};
use quadrille::imaging::Interpolation;
use std::collections::BTreeSet;
use std::process::Command;

const INTERPOLATIONS: [Interpolation; 4] =
    [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys, Interpolation::Bilinear];

/// Every kernel with every source it can have.
fn variants() -> Vec<(Kernel, Interpolation)> {
    let of = |kernel: Kernel| {
        let n = if kernel.interpolates() { INTERPOLATIONS.len() } else { 1 };
        INTERPOLATIONS[..n].iter().map(move |&interpolation| (kernel, interpolation))
    };
    KERNELS.into_iter().flat_map(of).collect()
}

#[track_caller]
fn parsed(kernel: Kernel, interpolation: Interpolation) -> naga::Module {
    let text = source(kernel, interpolation);
    match naga::front::wgsl::parse_str(&text) {
        Ok(module) => module,
        Err(error) => panic!("{kernel:?}, {interpolation:?}: {}", error.emit_to_string(&text)),
    }
}

#[test]
fn every_shader_is_valid_without_any_optional_capability() {
    for (kernel, interpolation) in variants() {
        let module = parsed(kernel, interpolation);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        if let Err(error) = validator.validate(&module) {
            panic!("{kernel:?}, {interpolation:?}: {}", error.emit_to_string(&source(kernel, interpolation)));
        }
    }
}

/// What Vulkan and DirectX 12 are given: a driver gets no WGSL.
#[test]
fn every_shader_is_translated_for_vulkan_and_directx() {
    let validator = Command::new("spirv-val").arg("--version").output().is_ok();
    if !validator {
        println!("skipped: no spirv-val (Debian's package spirv-tools): SPIR-V is written, and not validated");
    }
    let folder = tempfile::tempdir().unwrap();
    for (kernel, interpolation) in variants() {
        let what = format!("{kernel:?}, {interpolation:?}");
        let module = parsed(kernel, interpolation);
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module).unwrap();
        let (module, info) =
            naga::back::pipeline_constants::process_overrides(&module, &info, None, &Default::default()).unwrap();
        let words = naga::back::spv::write_vec(&module, &info, &Default::default(), None);
        let words = words.unwrap_or_else(|error| panic!("{what}: SPIR-V: {error}"));
        if validator {
            let file = folder.path().join("kernel.spv");
            std::fs::write(&file, words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
            let said = Command::new("spirv-val").args(["--target-env", "vulkan1.1"]).arg(&file).output().unwrap();
            assert!(said.status.success(), "{what}: {}", String::from_utf8_lossy(&said.stderr));
        }
        let (options, pipeline, mut text) = (Default::default(), Default::default(), String::new());
        let written = naga::back::hlsl::Writer::new(&mut text, &options, &pipeline).write(&module, &info, None);
        let written = written.unwrap_or_else(|error| panic!("{what}: HLSL: {error}"));
        assert!(written.entry_point_names.iter().all(Result::is_ok), "{what}: {:?}", written.entry_point_names);
        assert!(text.contains("numthreads"), "{what}: {text}");
    }
}

/// What Metal is given, and OpenGL ES would be. wgpu builds their writers on their own systems alone; the program
/// `naga` has them all (`cargo install naga-cli`; `scripts/drivers.sh --long` installs it), and QUADRILLE_NAGA names
/// it.
#[test]
fn every_shader_is_translated_for_metal_and_opengl() {
    let Some(naga) = std::env::var_os("QUADRILLE_NAGA") else {
        println!("skipped: QUADRILLE_NAGA does not name the program naga (the crate naga-cli)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let [wgsl, metal, glsl] = ["kernel.wgsl", "kernel.metal", "kernel.comp"].map(|name| folder.path().join(name));
    for (kernel, interpolation) in variants() {
        std::fs::write(&wgsl, source(kernel, interpolation)).unwrap();
        let mut commands = [Command::new(&naga), Command::new(&naga)];
        commands[0].arg(&wgsl).arg(&metal);
        commands[1].arg(&wgsl).arg(&glsl).args(["--profile", "es310", "--entry-point", kernel.entry()]);
        for command in &mut commands {
            let said = command.output().unwrap();
            let text = String::from_utf8_lossy(&said.stderr);
            assert!(said.status.success(), "{kernel:?}, {interpolation:?}, {command:?}: {text}");
        }
        let [metal, glsl] = [&metal, &glsl].map(|file| std::fs::read_to_string(file).unwrap());
        assert!(metal.contains("kernel void"), "{kernel:?}, {interpolation:?}: {metal}");
        assert!(glsl.contains("local_size_x"), "{kernel:?}, {interpolation:?}: {glsl}");
    }
}

#[test]
fn structs_have_the_same_fields_at_the_same_offsets_on_both_sides() {
    let mirrors = mirrors();
    let mut seen = BTreeSet::new();
    for (kernel, interpolation) in variants() {
        let module = parsed(kernel, interpolation);
        for (_, global) in module.global_variables.iter().filter(|(_, global)| global.binding.is_some()) {
            check(&module, global.ty, &mirrors, &mut seen);
        }
    }
    let unseen: Vec<_> = mirrors.iter().map(|m| m.name).filter(|name| !seen.contains(*name)).collect();
    assert!(unseen.is_empty(), "no shader has {unseen:?}");
}

fn check(
    module: &naga::Module,
    ty: naga::Handle<naga::Type>,
    mirrors: &[quadrille::backend::gpu::Mirror],
    seen: &mut BTreeSet<String>,
) {
    match &module.types[ty].inner {
        naga::TypeInner::Array { base, .. } => check(module, *base, mirrors, seen),
        naga::TypeInner::Struct { members, span } => {
            let name = module.types[ty].name.as_deref().unwrap();
            let mirror = mirrors.iter().find(|mirror| mirror.name == name);
            let mirror = mirror.unwrap_or_else(|| panic!("no Rust struct is called {name}"));
            let fields: Vec<(&str, usize)> =
                members.iter().map(|m| (m.name.as_deref().unwrap(), m.offset as usize)).collect();
            assert_eq!(fields, mirror.fields, "fields of {name}");
            assert_eq!(*span as usize, mirror.size, "size of {name}");
            seen.insert(name.to_owned());
            members.iter().for_each(|member| check(module, member.ty, mirrors, seen));
        }
        _ => {}
    }
}

#[test]
fn bindings_and_workgroups_are_those_that_the_rust_side_says() {
    for (kernel, interpolation) in variants() {
        let module = parsed(kernel, interpolation);
        let entry = module.entry_points.iter().find(|entry| entry.name == kernel.entry());
        let entry = entry.unwrap_or_else(|| panic!("{kernel:?} has no entry point {}", kernel.entry()));
        assert_eq!(entry.workgroup_size, [kernel.workgroup(), 1, 1], "{kernel:?}");
        let mut bindings: Vec<_> = module
            .global_variables
            .iter()
            .filter_map(|(_, global)| {
                let binding = global.binding?;
                assert_eq!(binding.group, 0);
                Some((
                    binding.binding,
                    match global.space {
                        naga::AddressSpace::Uniform => Binding::Uniform,
                        naga::AddressSpace::Storage { access } if access.contains(naga::StorageAccess::STORE) => {
                            Binding::Write
                        }
                        naga::AddressSpace::Storage { .. } => Binding::Read,
                        space => panic!("{kernel:?} binds {space:?}"),
                    },
                ))
            })
            .collect();
        bindings.sort_by_key(|binding| binding.0);
        let numbers: Vec<u32> = bindings.iter().map(|binding| binding.0).collect();
        assert_eq!(numbers, (0..bindings.len() as u32).collect::<Vec<_>>(), "{kernel:?}");
        let kinds: Vec<Binding> = bindings.into_iter().map(|binding| binding.1).collect();
        assert_eq!(kinds, kernel.bindings(), "{kernel:?}");
    }
}

#[test]
fn every_kernel_keeps_within_the_limits_of_every_webgpu_device() {
    for (kernel, interpolation) in variants() {
        let storage = kernel.bindings().iter().filter(|binding| **binding != Binding::Uniform).count();
        assert!(storage <= 8, "{kernel:?} has {storage} storage buffers");
        assert!(kernel.workgroup() <= 256);
        let module = parsed(kernel, interpolation);
        let mut layouter = naga::proc::Layouter::default();
        layouter.update(module.to_ctx()).unwrap();
        let shared: u32 = module
            .global_variables
            .iter()
            .filter(|(_, global)| global.space == naga::AddressSpace::WorkGroup)
            .map(|(_, global)| layouter[global.ty].size)
            .sum();
        assert!(shared <= 16384, "{kernel:?} shares {shared} bytes in a workgroup");
    }
}

/// What lets shaders run without wgpu's bounds of loops and guards of divisions
/// (`crates/dic/src/backend/gpu/device.rs`).
#[test]
fn every_loop_counts_up_to_a_bound_and_whole_numbers_are_divided_by_constants() {
    for (kernel, interpolation) in variants() {
        let module = parsed(kernel, interpolation);
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        let info = validator.validate(&module).unwrap();
        let functions = module.functions.iter().map(|(handle, function)| (function, &info[handle]));
        let entries =
            module.entry_points.iter().enumerate().map(|(k, entry)| (&entry.function, info.get_entry_point(k)));
        for (function, of_function) in functions.chain(entries) {
            for (handle, expression) in function.expressions.iter() {
                let naga::Expression::Binary { op: Op::Divide | Op::Modulo, right, .. } = *expression else { continue };
                let kind = of_function[handle].ty.inner_with(&module.types).scalar_kind();
                if matches!(kind, Some(naga::ScalarKind::Sint | naga::ScalarKind::Uint)) {
                    assert!(is_constant(&module, function, right), "{kernel:?}: {:?}", function.expressions[right]);
                }
            }
            assert_bounded(&function.body, kernel);
        }
    }
}

/// Whether it is a number other than 0 that is known when the shader is made.
fn is_constant(module: &naga::Module, function: &naga::Function, expression: naga::Handle<naga::Expression>) -> bool {
    let not_zero = |literal: &naga::Literal| match *literal {
        naga::Literal::I32(value) => value > 0,
        naga::Literal::U32(value) => value > 0,
        _ => false,
    };
    let global = |init: naga::Handle<naga::Expression>| match &module.global_expressions[init] {
        naga::Expression::Literal(literal) => not_zero(literal),
        _ => false,
    };
    match &function.expressions[expression] {
        naga::Expression::Literal(literal) => not_zero(literal),
        naga::Expression::Constant(constant) => global(module.constants[*constant].init),
        // Threads of an element, which the host sets to 4, 8 or 16.
        naga::Expression::Override(constant) => module.overrides[*constant].init.is_some_and(global),
        _ => false,
    }
}

/// Every loop begins with the question whether it is over, and ends each turn with a step.
fn assert_bounded(block: &naga::Block, kernel: Kernel) {
    for statement in block.iter() {
        match statement {
            naga::Statement::Block(block) => assert_bounded(block, kernel),
            naga::Statement::If { accept, reject, .. } => {
                assert_bounded(accept, kernel);
                assert_bounded(reject, kernel);
            }
            naga::Statement::Switch { cases, .. } => cases.iter().for_each(|case| assert_bounded(&case.body, kernel)),
            naga::Statement::Loop { body, continuing, .. } => {
                let leaves = |block: &naga::Block| block.iter().any(|s| matches!(s, naga::Statement::Break));
                // The second where the first works out a condition of two parts.
                let is_asked =
                    body.iter().filter(|s| !matches!(s, naga::Statement::Emit(_))).take(2).any(|s| match s {
                        naga::Statement::If { accept, reject, .. } => leaves(accept) || leaves(reject),
                        _ => false,
                    });
                let steps = continuing.iter().any(|statement| matches!(statement, naga::Statement::Store { .. }));
                assert!(is_asked && steps, "{kernel:?}: a loop without a bound: {body:?}");
                assert_bounded(body, kernel);
            }
            _ => {}
        }
    }
}

/// A graphics device as its maker describes it.
struct Card {
    name: &'static str,
    /// Bytes per second of its memory, 1e9.
    memory: f64,
    /// Single-precision operations per second, 1e12, a fused multiplication and addition as two.
    arithmetic: f64,
}

const CARDS: [Card; 5] = [
    Card { name: "Intel UHD 770, DDR5-4800", memory: 76.8, arithmetic: 0.79 },
    Card { name: "Apple M2, 10 cores", memory: 100.0, arithmetic: 3.6 },
    Card { name: "NVIDIA RTX 3060", memory: 360.0, arithmetic: 12.7 },
    Card { name: "NVIDIA RTX 4090", memory: 1008.0, arithmetic: 82.6 },
    Card { name: "NVIDIA H100 SXM", memory: 3350.0, arithmetic: 66.9 },
];

/// A bound of arithmetic that is reached: few operations are fused, and integers share the units.
const REACHED: f64 = 0.4;

/// Milliseconds of a kernel on each card, as memory or arithmetic bounds them, and whether it is arithmetic.
fn bounds(kernel: Kernel, extent: Extent) -> [(f64, bool); CARDS.len()] {
    let (bytes, operations) = (kernel.moves(extent).0 as f64, kernel.operations(extent) as f64);
    CARDS.each_ref().map(|card| {
        let (memory, arithmetic) = (1e-6 * bytes / card.memory, 1e-9 * operations / (REACHED * card.arithmetic));
        (memory.max(arithmetic), arithmetic > memory)
    })
}

#[test]
fn the_roofline_in_the_documents_is_that_of_the_kernels() {
    const BEGIN: &str = "<!-- roofline: written by QUADRILLE_BLESS=1 cargo test --test correlation roofline -->\n";
    const END: &str = "<!-- roofline ends -->";
    let side = 2048u64;
    let per_side = side / 16;
    let of = |runs: u64| Extent {
        pixels: side * side,
        side,
        elements: per_side * per_side,
        nodes: (per_side + 1).pow(2),
        runs,
    };
    // Once per image; once per iteration, with five of the conjugate gradients; once per frame.
    let image = [Kernel::Unpack, Kernel::Prefilter, Kernel::BorderColumns, Kernel::BorderRows];
    let reference = [Kernel::Gradient, Kernel::NormalMatrix];
    let iteration = [
        Kernel::Residual,
        Kernel::Tally,
        Kernel::Gather,
        Kernel::CgProduct,
        Kernel::CgUpdate,
        Kernel::Correct,
        Kernel::Summary,
        Kernel::Largest,
    ];
    let cell = |(ms, arithmetic): (f64, bool)| {
        let ms = if ms < 0.0005 { "< 0.001".to_owned() } else { format!("{ms:.3}") };
        if arithmetic { format!("{ms} a") } else { ms }
    };
    let line = |name: &str, ms: [(f64, bool); CARDS.len()]| format!("| {name} | {} |\n", ms.map(cell).join(" | "));
    let names = CARDS.each_ref().map(|card| card.name).join(" | ");
    let mut table = format!("| kernel | {names} |\n| --- |{}\n", " --- |".repeat(CARDS.len()));
    let mut sum = |of_sum: &str, kernels: &[Kernel], times: f64, begin: [f64; CARDS.len()]| {
        let mut all = begin;
        for &kernel in kernels {
            let ms = bounds(kernel, of(5));
            all.iter_mut().zip(ms).for_each(|(all, (ms, _))| *all += times * ms);
            if begin == [0.0; CARDS.len()] {
                table += &line(&format!("`{}`", kernel.name()), ms);
            }
        }
        table += &line(of_sum, all.map(|ms| (ms, false)));
        all
    };
    let of_image = sum("*image to coefficients*", &image, 1.0, [0.0; CARDS.len()]);
    sum("*reference, once, without its image*", &reference, 1.0, [0.0; CARDS.len()]);
    sum("*an iteration*", &iteration, 1.0, [0.0; CARDS.len()]);
    sum("*a frame: its image and four iterations*", &iteration, 4.0, of_image);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/performance.md");
    let text = std::fs::read_to_string(path).unwrap();
    let (before, rest) = text.split_once(BEGIN).expect("a place for the table");
    let (there, after) = rest.split_once(END).expect("its end");
    if std::env::var_os("QUADRILLE_BLESS").is_some_and(|value| value == "1") {
        std::fs::write(path, format!("{before}{BEGIN}\n{table}\n{END}{after}")).unwrap();
        return;
    }
    assert_eq!(there.trim(), table.trim(), "docs/performance.md");
}
