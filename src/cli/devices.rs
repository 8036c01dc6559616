//! `quadrille devices`.

#![allow(unsafe_code, reason = "the environment of drivers is set before any thread starts")]

use super::args::DevicesArgs;
use super::lines::wrapped;
use super::{Outcome, Result};
use crate::backend::choice::{DeviceChoice, choose};
use crate::backend::gpu::{GpuOptions, adapters};
use crate::isa::Isa;
use serde::Serialize;

/// Readbacks after which every graphics device fails, for tests of what happens then.
const FAIL_AFTER: &str = "QUADRILLE_GPU_FAIL_AFTER";

/// How graphics devices are opened.
pub(super) fn options() -> GpuOptions {
    let fail_after = std::env::var(FAIL_AFTER).ok().and_then(|n| n.parse().ok());
    GpuOptions { fail_after, ..GpuOptions::default() }
}

/// Mesa's drivers complain on stderr of every program that runs without a desktop session.
///
/// They are told a folder that is always there, holds no socket and cannot be given one: in a folder that others can write to,
/// anybody could put a `wayland-0` that never answers.
pub(super) fn quiet_drivers() {
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

/// Runs the command.
pub(super) fn run(args: &DevicesArgs) -> Result<Outcome> {
    let adapters = adapters();
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
    let mark = "* is taken by --device auto; a software device only by its name or number, or by --device gpu";
    println!("{}", wrapped(mark, 2));
    if let Some(reason) = &adapters.reason {
        println!("{}", wrapped(&format!("no graphics device: {reason}"), 2));
    }
    Ok(Outcome::Fine)
}

fn threads() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}
