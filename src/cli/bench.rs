//! `quadrille bench`: what correlation costs on the devices of this machine.

use super::args::BenchArgs;
use super::run_folder::RunFolder;
use super::{Outcome, Result, plural, pool, without_doubles};
use crate::backend::Backend;
use crate::backend::cpu::CpuBackend;
use crate::backend::gpu::{GpuAdapter, adapters};
use crate::bench::{Clock, Plan, Scene, SizeCost, Spread, StartUp, Subject, size_cost, start_up};
use crate::report::{Axis, Plot, Series, Style};
use serde::Serialize;

/// `bench.json`.
#[derive(Debug, Serialize)]
struct Record {
    quadrille: &'static str,
    units: &'static str,
    machine: String,
    threads: usize,
    images: &'static str,
    plan: Plan,
    devices: Vec<DeviceRecord>,
}

/// One device.
#[derive(Debug, Serialize)]
struct DeviceRecord {
    device: String,
    kind: &'static str,
    clock: Clock,
    /// Bytes read and written by long copies, 1e9 per second.
    copy_gb_per_s: f64,
    start_up: Option<StartUp>,
    sizes: Vec<SizeCost>,
}

const UNITS: &str = "_s and seconds: seconds; _px: pixels; ns_per_px: nanoseconds per pixel of the image; gb_per_s: \
    1e9 bytes per second; percent_of_copy: of what long copies within the device's memory reach";

const IMAGES: &str = "synthetic, 8 bit, in memory: nothing is read or written; zone: the image less one element on each \
    side; cubic interpolation; motion of 1 px sinusoids, 0.5 % stretch, 0.2 degrees";

/// A device that was asked for.
enum Asked {
    Cpu,
    Adapter(GpuAdapter),
}

/// Runs the command.
pub(super) fn run(args: &BenchArgs) -> Result<Outcome> {
    let plan = plan(args)?;
    let pool = pool(args.threads)?;
    let asked = devices(args)?;
    let folder = args.output.as_deref().map(|path| RunFolder::open(path, true)).transpose()?;
    let mut record = Record {
        quadrille: env!("CARGO_PKG_VERSION"),
        units: UNITS,
        machine: machine(),
        threads: pool.current_num_threads(),
        images: IMAGES,
        plan,
        devices: Vec::new(),
    };
    if !args.json {
        println!("quadrille {}, {}, {}", record.quadrille, record.machine, plural(record.threads, "thread"));
        println!("{IMAGES}");
    }
    let opened = asked.iter().map(|device| pool.install(|| open(device))).collect::<Result<Vec<_>>>()?;
    let (subjects, devices): (Vec<Opened>, _) = opened.into_iter().unzip();
    record.devices = devices;
    for &size in &record.plan.sizes_px.clone() {
        eprintln!("{size} x {size} px: making the images");
        let scene = pool.install(|| Scene::new(size, record.plan.element_size_px, 3))?;
        for (subject, device) in subjects.iter().zip(&mut record.devices) {
            eprintln!("{size} x {size} px on {}", device.device);
            let rate = 1e9 * device.copy_gb_per_s;
            let cost = pool.install(|| match subject {
                Opened::Cpu(cpu) => size_cost(cpu, &scene, &record.plan, rate),
                Opened::Gpu(gpu) => size_cost(gpu, &scene, &record.plan, rate),
            })?;
            device.sizes.push(cost);
        }
    }
    if args.json {
        println!("{}", serde_json::to_string_pretty(&record)?);
    } else {
        print(&record);
    }
    if let Some(folder) = folder {
        folder.write_json("bench.json", &record)?;
        let picture = plot(&record).draw()?;
        for name in ["bench.png", "bench.svg"] {
            picture.save(folder.path().join(name))?;
        }
        eprintln!("numbers and curves in {}: bench.json, .png, .svg", folder.path().display());
    }
    Ok(Outcome::Fine)
}

/// A device ready to be measured.
enum Opened {
    Cpu(CpuBackend),
    Gpu(crate::backend::gpu::GpuBackend),
}

fn open(asked: &Asked) -> Result<(Opened, DeviceRecord)> {
    let head = |device: String, kind, clock, rate: f64, start_up| DeviceRecord {
        device,
        kind,
        clock,
        copy_gb_per_s: 1e-9 * rate,
        start_up,
        sizes: Vec::new(),
    };
    Ok(match asked {
        Asked::Cpu => {
            let cpu = CpuBackend::default();
            let record = head(cpu.device(), "CPU", cpu.clock(), cpu.copy_rate()?, None);
            (Opened::Cpu(cpu), record)
        }
        Asked::Adapter(adapter) => {
            let (gpu, start) = start_up(adapter)?;
            let record = head(gpu.device(), adapter.kind.name(), gpu.clock(), gpu.copy_rate()?, Some(start));
            (Opened::Gpu(gpu), record)
        }
    })
}

fn plan(args: &BenchArgs) -> Result<Plan> {
    let sizes = without_doubles(&args.size);
    if let Some(size) = sizes.iter().find(|size| !(64..=32_768).contains(*size)) {
        return Err(format!("--size {size} is outside 64 to 32768 px").into());
    }
    if !(4..=128).contains(&args.element_size) {
        return Err(format!("--element-size {} is outside 4 to 128 px", args.element_size).into());
    }
    Ok(Plan { sizes_px: sizes, element_size_px: args.element_size, runs: args.runs.max(1), frames: args.frames.max(1) })
}

/// The devices that were asked for: all there are unless some are named.
fn devices(args: &BenchArgs) -> Result<Vec<Asked>> {
    let found = adapters().list;
    if args.device.is_empty() {
        for adapter in found.iter().filter(|adapter| adapter.unusable.is_some()) {
            eprintln!("{} is left out: {}", adapter.name, adapter.unusable.as_deref().unwrap_or_default());
        }
        let usable = found.into_iter().filter(|adapter| adapter.unusable.is_none());
        return Ok([Asked::Cpu].into_iter().chain(usable.map(Asked::Adapter)).collect());
    }
    let one = |name: &String| -> Result<Asked> {
        if name == "cpu" {
            return Ok(Asked::Cpu);
        }
        let named = |adapter: &&GpuAdapter| adapter.name.to_lowercase().contains(&name.to_lowercase());
        let adapter = match name.parse::<usize>() {
            Ok(index) => found.get(index),
            Err(_) => found.iter().find(named),
        };
        let there = || {
            let list: Vec<_> = found.iter().enumerate().map(|(k, adapter)| format!("{k}: {}", adapter.name)).collect();
            if list.is_empty() { "no graphics device".into() } else { list.join(", ") }
        };
        let adapter =
            adapter.ok_or_else(|| format!("there is no device '{name}'; this machine has cpu and {}", there()))?;
        Ok(Asked::Adapter(adapter.clone()))
    };
    args.device.iter().map(one).collect()
}

fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")).map(|l| l.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {}", model.unwrap_or(std::env::consts::ARCH), plural(cores, "core"))
}

/// Milliseconds: median, and fastest to slowest in brackets.
fn ms(seconds: Spread) -> String {
    let Spread { fastest, median, slowest } = seconds.scaled(1e3);
    format!("{median:.3} ({fastest:.3}-{slowest:.3})")
}

fn print(record: &Record) {
    for device in &record.devices {
        println!();
        println!("{} [{}]", device.device, device.kind);
        println!("  times by     {}", device.clock.describe());
        let of = if device.clock == Clock::Processor { "one core copies" } else { "it copies" };
        println!("  memory       {of} {:.1} GB/s (read and written)", device.copy_gb_per_s);
        if let Some(start) = &device.start_up {
            println!(
                "  start        opened in {:.0} ms; {} compiled and run for the first time in {:.0} ms (wall)",
                1e3 * start.open_s,
                plural(start.kernels.len(), "kernel"),
                1e3 * start.kernels_s
            );
            let slow = start
                .kernels
                .iter()
                .map(|k| format!("{} {:.0} + {:.0}", name(k.kernel), 1e3 * k.compile_s, 1e3 * k.first_run_s));
            println!("               compile + first run, ms: {}", slow.collect::<Vec<_>>().join(", "));
        }
        for size in &device.sizes {
            print_size(device, size, record.plan.element_size_px, record.plan.runs);
        }
    }
    print_ratios(record);
}

fn name(kernel: crate::backend::gpu::Kernel) -> String {
    serde_json::to_value(kernel).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

fn print_size(device: &DeviceRecord, cost: &SizeCost, element: usize, runs: usize) {
    let clock = |times: crate::bench::Times| match device.clock {
        Clock::Processor => times.cpu,
        Clock::Device => times.wall,
    };
    let (size, n_elements, n_nodes) = (cost.size_px, cost.n_elements, cost.n_nodes);
    println!();
    println!(
        "  {size} x {size} px, {n_elements} elements of {element} px, {n_nodes} nodes; median (fastest-slowest) of {runs}"
    );
    println!("  {:34} {:>30} {:>8} {:>8} {:>7}", "pass, in and out of the host", "ms", "ns/px", "GB/s", "of copy");
    for pass in &cost.passes {
        println!(
            "  {:34} {:>30} {:8.3} {:8.2} {:5.0} %",
            pass.name,
            ms(clock(pass.seconds)),
            pass.ns_per_px,
            pass.bound.gb_per_s,
            pass.bound.percent_of_copy
        );
    }
    if !cost.kernels.is_empty() {
        println!("  {:34} {:>30} {:>8} {:>8} {:>7}", "kernel (dispatches)", "ms", "ns/px", "GB/s", "of copy");
    }
    for kernel in &cost.kernels {
        println!(
            "  {:34} {:>30} {:8.3} {:8.2} {:5.0} %",
            format!("{} ({})", name(kernel.kernel), kernel.dispatches),
            ms(kernel.seconds),
            kernel.ns_per_px,
            kernel.bound.gb_per_s,
            kernel.bound.percent_of_copy
        );
    }
    let both =
        |times: crate::bench::Times| format!("{} ms wall, {:.3} ms processor", ms(times.wall), 1e3 * times.cpu.fastest);
    println!("  cold pair: reference {}", both(cost.pair.reference_s));
    println!(
        "             frame     {}; {} + {} coarse iterations",
        both(cost.pair.frame_s),
        cost.pair.iterations,
        cost.pair.coarse_iterations
    );
    println!(
        "  series:    {:.1} frames/s; {}; {:.1} iterations; {}",
        cost.series.frames_per_s,
        both(cost.series.frame_s),
        cost.series.iterations,
        plural(cost.series.frames, "frame")
    );
    if let Some(traffic) = &cost.series.traffic {
        println!(
            "             per frame {}, {}, {} B up, {} B down; host's own thread {:.3} ms",
            plural(traffic.submissions, "submission"),
            plural(traffic.readbacks, "readback"),
            traffic.bytes_up,
            traffic.bytes_down,
            1e3 * cost.series.host_s.unwrap_or_default().fastest
        );
    }
    if !cost.series.shares.is_empty() {
        let shares: Vec<_> = cost.series.shares.iter().map(|s| format!("{} {:.1} %", s.part, s.percent)).collect();
        println!("             {}", shares.join(", "));
    }
}

/// Every device against the first, where they have been measured by the same clock.
fn print_ratios(record: &Record) {
    let [first, others @ ..] = record.devices.as_slice() else { return };
    for device in others {
        println!();
        println!("{} against {}: time per pixel, as so many times", device.device, first.device);
        if device.clock != first.clock {
            println!("  (different clocks: one core's time against the device's)");
        }
        for (cost, other) in device.sizes.iter().zip(&first.sizes) {
            let ratios: Vec<_> = cost
                .passes
                .iter()
                .zip(&other.passes)
                .map(|(pass, other)| format!("{} {:.3}", pass.name, pass.ns_per_px / other.ns_per_px))
                .collect();
            println!("  {:6} px: {}", cost.size_px, ratios.join(", "));
        }
    }
}

/// Time against the size of the images.
fn plot(record: &Record) -> Plot {
    let mut series = Vec::new();
    for device in &record.devices {
        let short = short_name(&device.device);
        let mut curve = |what: &str, style, value: &dyn Fn(&SizeCost) -> f64| {
            let x = device.sizes.iter().map(|cost| cost.size_px as f64).collect();
            let y = device.sizes.iter().map(|cost| 1e3 * value(cost)).collect();
            series.push(Series::new(format!("{short}: {what}"), style, x, y));
        };
        let pair = |cost: &SizeCost| cost.pair.reference_s.wall.fastest + cost.pair.frame_s.wall.fastest;
        let pass = |cost: &SizeCost| {
            let residual = cost.passes.iter().find(|pass| pass.name == "residual");
            residual.map_or(f64::NAN, |pass| pass.seconds.wall.fastest)
        };
        curve("cold pair", Style::LineAndMarkers, &pair);
        curve("frame of a series", Style::LineAndMarkers, &|cost| cost.series.frame_s.wall.fastest);
        curve("residual pass", Style::LineAndMarkers, &pass);
    }
    Plot {
        title: format!("quadrille {}: time against image size", record.quadrille),
        x: Axis::log("side of the image (px)"),
        y: Axis::log("wall time, fastest (ms)"),
        series,
        notes: vec![
            format!(
                "{}, {}; elements of {} px",
                record.machine,
                plural(record.threads, "thread"),
                record.plan.element_size_px
            ),
            "images in memory; uploads and results on the host included".into(),
        ],
    }
}

/// What stands in brackets in a device's description, up to the first comma.
fn short_name(device: &str) -> String {
    let Some((kind, rest)) = device.split_once(" (") else { return device.to_owned() };
    let rest = rest.split([',', '(', ')']).next().unwrap_or_default().trim();
    format!("{kind} {rest}")
}
