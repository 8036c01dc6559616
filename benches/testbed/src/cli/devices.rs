//! `testbed devices`: what correlation costs on the devices of this machine.

use super::args::DevicesArgs;
use super::{Outcome, Result, plural, pool};
use quadrille::backend::choice::choose;
use quadrille::backend::gpu::{GpuAdapter, adapters};
use quadrille::report::{Axis, Plot, PlotSeries, Style};
use quadrille_testbed::bench::{Device, Plan, Record, SizeCost};

/// Runs the command.
pub(super) fn run(args: &DevicesArgs) -> Result<Outcome> {
    let plan = plan(args)?;
    let pool = pool(args.threads)?;
    let devices = devices(args)?;
    args.output.as_deref().map(std::fs::create_dir_all).transpose()?;
    let record = pool.install(|| Record::measure(&devices, plan, machine(), |what| eprintln!("{what}")))?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&record)?);
    } else {
        print!("{record}");
    }
    if let Some(folder) = &args.output {
        std::fs::write(folder.join("bench.json"), serde_json::to_string_pretty(&record)?)?;
        let picture = plot(&record).draw()?;
        for name in ["bench.png", "bench.svg"] {
            picture.save(folder.join(name))?;
        }
        eprintln!("numbers and curves in {}: bench.json, .png, .svg", folder.display());
    }
    Ok(Outcome::Fine)
}

fn plan(args: &DevicesArgs) -> Result<Plan> {
    let sizes = args.size.clone();
    check_element_size(args.element_size)?;
    sizes.iter().try_for_each(|&size| check_size(size, args.element_size, 4))?;
    Ok(Plan { sizes_px: sizes, element_size_px: args.element_size, runs: args.runs.max(1), frames: args.frames.max(1) })
}

pub(super) fn check_element_size(element: usize) -> Result<()> {
    if (4..=128).contains(&element) {
        Ok(())
    } else {
        Err(format!("--element-size {element} is outside 4 to 128 px").into())
    }
}

/// Whether an image of this side has room for `n` elements in a row.
pub(super) fn check_size(size: usize, element: usize, n: usize) -> Result<()> {
    if !(64..=32_768).contains(&size) {
        return Err(format!("--size {size} is outside 64 to 32768 px").into());
    }
    if size < n * element {
        let least = n * element;
        return Err(format!("--size {size} has no room for elements of {element} px: {least} px at least").into());
    }
    Ok(())
}

/// The devices that were asked for: all there are unless some are named.
fn devices(args: &DevicesArgs) -> Result<Vec<Device>> {
    let found = adapters();
    let adapter = |adapter: &GpuAdapter| Device::Adapter(Box::new(adapter.clone()));
    if args.device.is_empty() {
        for adapter in found.list.iter().filter(|adapter| adapter.unusable.is_some()) {
            eprintln!("{} is left out: {}", adapter.name, adapter.unusable.as_deref().unwrap_or_default());
        }
        let usable = found.list.iter().filter(|adapter| adapter.unusable.is_none());
        return Ok([Device::Cpu].into_iter().chain(usable.map(adapter)).collect());
    }
    args.device.iter().map(|choice| Ok(choose(choice, &found)?.map_or(Device::Cpu, adapter))).collect()
}

pub(super) fn machine() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|l| l.strip_prefix("model name")).map(|l| l.trim_start_matches([' ', '\t', ':']));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {}", model.unwrap_or(std::env::consts::ARCH), plural(cores, "core"))
}

/// Time against the size of the images.
fn plot(record: &Record) -> Plot {
    let mut series = Vec::new();
    for device in &record.devices {
        let short = short_name(&device.device);
        let mut curve = |what: &str, style, value: &dyn Fn(&SizeCost) -> f64| {
            let x = device.sizes.iter().map(|cost| cost.size_px as f64).collect();
            let y = device.sizes.iter().map(|cost| 1e3 * value(cost)).collect();
            series.push(PlotSeries::new(format!("{short}: {what}"), style, x, y));
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
        ..Plot::default()
    }
}

/// What stands in brackets in a device's description, up to the first comma.
fn short_name(device: &str) -> String {
    let Some((kind, rest)) = device.split_once(" (") else { return device.to_owned() };
    let rest = rest.split([',', '(', ')']).next().unwrap_or_default().trim();
    format!("{kind} {rest}")
}
