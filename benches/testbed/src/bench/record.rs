//! All devices of a machine, side by side.

use super::measured::{DeviceRecord, Measured, opened};
use super::{BenchError, Plan, Scene, graphics};
use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::gpu::GpuAdapter;
use serde::Serialize;

/// A device to be measured.
#[derive(Debug, Clone)]
pub enum Device {
    /// The CPU, on its fastest instruction path.
    Cpu,
    /// A graphics adapter.
    Adapter(Box<GpuAdapter>),
}

/// What was measured, and on what.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Record {
    /// Version.
    pub quadrille: &'static str,
    /// What the endings of names mean.
    pub units: &'static str,
    /// Processor and cores.
    pub machine: String,
    /// Threads of the CPU path.
    pub threads: usize,
    /// What images are measured.
    pub images: &'static str,
    /// Sizes and repetitions.
    pub plan: Plan,
    /// Device by device.
    pub devices: Vec<DeviceRecord>,
}

const UNITS: &str = "_s and seconds: seconds; _px: pixels; ns_per_px: nanoseconds per pixel of the image; gb_per_s: \
    1e9 bytes per second; percent_of_copy: of what long copies within the device's memory reach";

const IMAGES: &str = "synthetic, 8 bit, in memory: nothing is read or written; zone: the image less one element on each \
    side; cubic interpolation; motion of 1 px sinusoids, 0.5 % stretch, 0.2 degrees";

impl Record {
    /// Measures `devices` by `plan`; `say` hears what is done next. `machine` is what the record calls it.
    ///
    /// # Errors
    /// When a device fails, or the elements do not fit an image.
    pub fn measure(devices: &[Device], plan: Plan, machine: String, say: impl Fn(&str)) -> Result<Self, BenchError> {
        let mut record = Self {
            quadrille: env!("CARGO_PKG_VERSION"),
            units: UNITS,
            machine,
            threads: rayon::current_num_threads(),
            images: IMAGES,
            plan,
            devices: Vec::new(),
        };
        let opened = devices.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        let (subjects, heads): (Vec<Box<dyn Measured>>, _) = opened.into_iter().unzip();
        record.devices = heads;
        for &size in &record.plan.sizes_px {
            say(&format!("{size} x {size} px: making the images"));
            let scene = Scene::new(size, record.plan.element_size_px, 3)?;
            for (subject, device) in subjects.iter().zip(&mut record.devices) {
                say(&format!("{size} x {size} px on {}", device.device));
                let rate = 1e9 * device.copy_gb_per_s;
                device.sizes.push(subject.size_cost(&scene, &record.plan, rate)?);
            }
        }
        Ok(record)
    }
}

fn open(device: &Device) -> Result<(Box<dyn Measured>, DeviceRecord), BenchError> {
    match device {
        Device::Cpu => opened(CpuBackend::default(), "CPU", None),
        Device::Adapter(adapter) => graphics::open(adapter),
    }
}
