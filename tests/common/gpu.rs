//! The GPU of the tests: one device per test program, since opening one and compiling kernels is slow.

use quadrille::backend::gpu::{AdapterKind, GpuAdapter, GpuBackend, GpuOptions, adapters};
use std::io::Write;
use std::panic::Location;
use std::sync::OnceLock;

/// The adapter to test on: the one whose name contains `QUADRILLE_TEST_ADAPTER` (in any case), else a software one
/// (it is the same everywhere), else the first. Or why there is none.
fn adapter() -> Result<GpuAdapter, String> {
    let mut found = adapters().list;
    found.retain(|adapter| adapter.unusable.is_none());
    // One device may be reached in several ways: Vulkan is what the project is measured on.
    found.sort_by_key(|adapter| adapter.api != "vulkan");
    let names = || found.iter().map(|adapter| adapter.name.as_str()).collect::<Vec<_>>().join(", ");
    if let Ok(asked) = std::env::var("QUADRILLE_TEST_ADAPTER") {
        let wanted = |name: &str| name.to_lowercase().contains(&asked.to_lowercase());
        let named = found.iter().find(|adapter| wanted(&adapter.name));
        let why = || format!("QUADRILLE_TEST_ADAPTER is '{asked}', and there is: {}", names());
        return named.cloned().ok_or_else(why);
    }
    let software = found.iter().find(|adapter| adapter.kind == AdapterKind::Software);
    let none = "no driver offers one; mesa-vulkan-drivers and libvulkan1 (Debian) bring a software one";
    software.or(found.first()).cloned().ok_or_else(|| none.to_owned())
}

fn the_adapter() -> &'static Result<GpuAdapter, String> {
    static ADAPTER: OnceLock<Result<GpuAdapter, String>> = OnceLock::new();
    ADAPTER.get_or_init(adapter)
}

/// The device of this test program; `None`, which is said, where there is none.
///
/// # Panics
/// With `QUADRILLE_GPU=require` in the environment, when there is none.
#[track_caller]
pub fn device() -> Option<GpuBackend> {
    static DEVICE: OnceLock<Result<GpuBackend, String>> = OnceLock::new();
    let opened = DEVICE.get_or_init(|| {
        let adapter = the_adapter().as_ref().map_err(Clone::clone)?;
        let device = GpuBackend::new(adapter, &GpuOptions::default()).map_err(|error| error.to_string())?;
        say(&format!("tests on {}", quadrille::backend::Backend::device(&device)));
        Ok(device)
    });
    given(opened.clone())
}

/// A device of its own, with `options`.
///
/// # Panics
/// As [`device`].
#[track_caller]
pub fn device_with(options: &GpuOptions) -> Option<GpuBackend> {
    let opened =
        the_adapter().clone().and_then(|adapter| GpuBackend::new(&adapter, options).map_err(|error| error.to_string()));
    given(opened)
}

#[track_caller]
fn given(opened: Result<GpuBackend, String>) -> Option<GpuBackend> {
    match opened {
        Ok(device) => Some(device),
        Err(why) => {
            let asked = std::env::var("QUADRILLE_GPU").is_ok_and(|asked| asked == "require");
            assert!(!asked, "QUADRILLE_GPU=require, and there is no graphics adapter: {why}");
            // The thread of a test is named after it, unless the tests run one by one.
            let thread = std::thread::current();
            let here = Location::caller().to_string();
            let name = thread.name().filter(|name| *name != "main").unwrap_or(&here);
            say(&format!("no graphics adapter: {name} did not run ({why})"));
            None
        }
    }
}

/// Prints a line that the test harness does not keep to itself.
fn say(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}"); // nobody to tell
}
