//! `quadrille about devices`.

#![allow(unsafe_code, reason = "the environment of drivers is set before any thread starts")]

use crate::backend::check::Compared;
use crate::backend::choice::{DeviceChoice, choose};
use crate::backend::gpu::{self, Adapters, GpuAdapter, GpuOptions, adapters};
use crate::cli::args::DevicesArgs;
use crate::cli::talk::wrapped;
use crate::cli::{Outcome, Result};
use crate::isa::Isa;
use serde::Serialize;
use std::time::Instant;

/// Readbacks after which every graphics device fails, for tests of what happens then.
const FAIL_AFTER: &str = "QUADRILLE_GPU_FAIL_AFTER";

/// A text of the shaders and what stands in its place, `FROM=>TO`, for tests of what happens then: from the first, or
/// once the device was compared with the CPU.
const ALTER: &str = "QUADRILLE_GPU_ALTER";
const ALTER_LATER: &str = "QUADRILLE_GPU_ALTER_LATER";

/// Megapixels of all frames from which on `--device auto` looks for a graphics device.
const FROM_MPX: &str = "QUADRILLE_GPU_FROM_MPX";

/// How graphics devices are opened; one that is `trusted` is not compared with the CPU.
pub(crate) fn options(trusted: bool) -> GpuOptions {
    let fail_after = std::env::var(FAIL_AFTER).ok().and_then(|n| n.parse().ok());
    let altered_later = std::env::var(ALTER_LATER).ok();
    let altered = altered_later.clone().or_else(|| std::env::var(ALTER).ok());
    let altered = altered.and_then(|text| text.split_once("=>").map(|(from, to)| [from.to_owned(), to.to_owned()]));
    let auto_from_px = std::env::var(FROM_MPX).ok().and_then(|mpx| mpx.parse().ok());
    let auto_from_px = auto_from_px.map(|mpx: u64| mpx.saturating_mul(1_000_000));
    let altered_later = altered_later.is_some();
    GpuOptions { trusted, fail_after, altered, altered_later, auto_from_px, ..GpuOptions::default() }
}

/// Mesa's drivers complain on stderr of every program that runs without a desktop session.
///
/// They are told a folder that is always there, holds no socket and cannot be given one: in a folder that others can
/// write to, anybody could put a `wayland-0` that never answers.
pub(crate) fn quiet_drivers() {
    const RUNTIME: &str = "XDG_RUNTIME_DIR";
    const WITHOUT_SOCKETS: &str = "/proc/self";
    if cfg!(target_os = "linux") && std::env::var_os(RUNTIME).is_none() {
        // SAFETY: `main` has started no other thread yet.
        unsafe { std::env::set_var(RUNTIME, WITHOUT_SOCKETS) };
    }
}

/// One device as `--json` gives it.
#[derive(Debug, Serialize)]
struct Listed<'a> {
    /// What `--device` takes.
    device: String,
    name: &'a str,
    kind: &'a str,
    api: &'a str,
    driver: &'a str,
    max_binding_bytes: Option<u64>,
    max_buffer_bytes: Option<u64>,
    timestamps: bool,
    unusable: Option<&'a str>,
    /// Whether `--device auto` takes it.
    auto: bool,
}

pub(crate) fn run(args: &DevicesArgs) -> Result<Outcome> {
    let adapters = adapters();
    if args.check {
        return check(args, &adapters);
    }
    let auto = choose(&DeviceChoice::Auto, &adapters)?;
    let processor = format!("{} threads, instruction path {}", threads(), Isa::detect());
    let mut list = vec![Listed {
        device: "cpu".into(),
        name: "CPU",
        kind: "processor",
        api: "",
        driver: &processor,
        max_binding_bytes: None,
        max_buffer_bytes: None,
        timestamps: false,
        unusable: None,
        auto: auto.is_none(),
    }];
    list.extend(adapters.list.iter().enumerate().map(|(at, adapter)| Listed {
        device: at.to_string(),
        name: &adapter.name,
        kind: adapter.kind.name(),
        api: &adapter.api,
        driver: &adapter.driver,
        max_binding_bytes: Some(adapter.max_binding_bytes),
        max_buffer_bytes: Some(adapter.max_buffer_bytes),
        timestamps: adapter.has_timestamps,
        unusable: adapter.unusable.as_deref(),
        auto: auto.is_some_and(|chosen| std::ptr::eq(chosen, adapter)),
    }));
    if args.json {
        println!("{}", serde_json::to_string_pretty(&list)?);
        return Ok(Outcome::Fine);
    }
    for device in &list {
        let mark = if device.auto { "*" } else { " " };
        println!("{mark} {:<4} {} ({})", device.device, device.name, device.kind);
        let api = if device.api.is_empty() { String::new() } else { format!("{}, ", device.api) };
        println!("{}", wrapped(&format!("       {api}{}", device.driver), 7));
        if let (Some(binding), Some(buffer)) = (device.max_binding_bytes, device.max_buffer_bytes) {
            let times = if device.timestamps { "times its kernels" } else { "cannot time its kernels" };
            println!("       {} MiB at once per kernel, {} MiB per buffer; {times}", binding >> 20, buffer >> 20);
        }
        if let Some(why) = device.unusable {
            println!("{}", wrapped(&format!("       cannot be used: {why}"), 7));
        }
    }
    let mark = "* is taken by --device auto for series of 200 megapixels or more; integrated and software devices only by their \
                name or number, or by --device gpu";
    println!("{}", wrapped(mark, 2));
    if let Some(reason) = &adapters.reason {
        println!("{}", wrapped(&format!("no graphics device: {reason}"), 2));
    }
    Ok(Outcome::Fine)
}

/// What the comparison of one device with the CPU came to, as `--check --json` gives it.
#[derive(Debug, Serialize)]
struct Checked<'a> {
    device: String,
    name: &'a str,
    /// Whether it computes what the CPU does.
    right: bool,
    /// Why it could not be asked, if it could not.
    failed: Option<String>,
    /// Every kind of numbers with its largest difference.
    compared: Vec<Compared>,
    seconds: f64,
}

/// Compares every graphics device with the CPU.
fn check<'a>(args: &DevicesArgs, adapters: &'a Adapters) -> Result<Outcome> {
    let options = options(true);
    let one = |(at, adapter): (usize, &'a GpuAdapter)| {
        let clock = Instant::now();
        let (right, failed, compared) = match gpu::check(adapter, &options) {
            Ok(check) => (check.is_right(), None, check.compared),
            Err(error) => (false, Some(error.to_string()), Vec::new()),
        };
        let (device, name, seconds) = (at.to_string(), adapter.name.as_str(), clock.elapsed().as_secs_f64());
        Checked { device, name, right, failed, compared, seconds }
    };
    let list: Vec<Checked<'_>> = adapters.list.iter().enumerate().map(one).collect();
    if args.json {
        println!("{}", serde_json::to_string_pretty(&list)?);
    }
    for checked in list.iter().filter(|_| !args.json) {
        let Checked { device, name, right, failed, compared, seconds } = checked;
        println!(
            "{device}    {name}: {} ({seconds:.1} s)",
            if *right { "computes what the CPU does" } else { "is NOT to be used" }
        );
        if let Some(failed) = failed {
            println!("{}", wrapped(&format!("     it failed: {failed}"), 5));
        }
        for Compared { what, unit, difference, allowed } in compared {
            let mark = if difference <= allowed { " " } else { "!" };
            println!("   {mark} {difference:9.1e} of {allowed:.1e} {unit:2}  {what}");
        }
    }
    if list.is_empty() && !args.json {
        let reason = adapters.reason.as_deref().unwrap_or("the drivers list none");
        println!("{}", wrapped(&format!("no graphics device: {reason}"), 0));
    }
    Ok(if list.iter().all(|checked| checked.right) { Outcome::Fine } else { Outcome::Incomplete })
}

fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}
