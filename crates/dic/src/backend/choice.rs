//! Which device does the work.

use super::adapter::{AdapterKind, Adapters, GpuAdapter, GpuOptions};
use super::{BackendError, OnDevice, cpu::CpuBackend, gpu};
use crate::isa::Isa;
use std::str::FromStr;
use thiserror::Error;

/// The device that is asked for.
///
/// ```
/// # use quadrille_dic as quadrille;
/// use quadrille::backend::choice::DeviceChoice;
/// assert_eq!("auto".parse(), Ok(DeviceChoice::Auto));
/// assert_eq!("1".parse(), Ok(DeviceChoice::Index(1)));
/// assert_eq!("RTX".parse(), Ok(DeviceChoice::Named("RTX".into())));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// A discrete or virtual GPU where there is one and the work is worth opening it, else the CPU.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A GPU, a software one if there is no other.
    Gpu,
    /// The adapter of that number.
    Index(usize),
    /// The first adapter with that in its name, in any case.
    Named(String),
}

impl FromStr for DeviceChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text.trim().to_lowercase().as_str() {
            "auto" => Self::Auto,
            "cpu" => Self::Cpu,
            "gpu" => Self::Gpu,
            other => other.parse().map_or_else(|_| Self::Named(text.trim().to_owned()), Self::Index),
        })
    }
}

/// What a build without the feature `gpu` says of graphics devices.
pub(super) const BUILT_WITHOUT: &str = "quadrille was built without graphics devices (its feature `gpu`)";

/// Why there is no such device.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// No graphics adapter at all.
    #[error(
        "there is no graphics device: {reason}; install its Vulkan driver (Debian and Ubuntu: libvulkan1 and the maker's driver, or mesa-vulkan-drivers, which has a software one), or use --device cpu"
    )]
    NoAdapter {
        /// What the drivers said.
        reason: String,
    },
    /// This build knows no graphics devices.
    #[error("there is no graphics device: {BUILT_WITHOUT}; use --device cpu")]
    BuiltWithout,
    /// None with that name or number.
    #[error("there is no graphics device '{wanted}'; this machine has {there}")]
    Unknown {
        /// What was asked for.
        wanted: String,
        /// What there is.
        there: String,
    },
    /// It could not be opened.
    #[error(transparent)]
    Backend(#[from] BackendError),
}

/// The adapter that `choice` means, `None` for the CPU.
///
/// # Errors
/// When there is none such.
pub fn choose<'a>(choice: &DeviceChoice, adapters: &'a Adapters) -> Result<Option<&'a GpuAdapter>, DeviceError> {
    let list = &adapters.list;
    let usable = |kinds: &[AdapterKind]| {
        let usable_of = |kind: &AdapterKind| list.iter().find(|a| a.kind == *kind && a.unusable.is_none());
        kinds.iter().find_map(usable_of)
    };
    const HARDWARE: [AdapterKind; 3] = [AdapterKind::Discrete, AdapterKind::Integrated, AdapterKind::Virtual];
    // An integrated GPU shares the memory that the CPU is waiting for, and has fewer units to wait with.
    const OWN_MEMORY: [AdapterKind; 2] = [AdapterKind::Discrete, AdapterKind::Virtual];
    let no_adapter = || match adapters.built_without {
        true => DeviceError::BuiltWithout,
        false => {
            DeviceError::NoAdapter { reason: adapters.reason.clone().unwrap_or_else(|| "none can be used".into()) }
        }
    };
    let unknown = |wanted: String| DeviceError::Unknown { wanted, there: list_adapters(adapters) };
    match choice {
        DeviceChoice::Cpu => Ok(None),
        DeviceChoice::Auto => Ok(usable(&OWN_MEMORY)),
        _ if list.is_empty() => Err(no_adapter()),
        DeviceChoice::Gpu => {
            let any = || usable(&[AdapterKind::Other, AdapterKind::Software]);
            usable(&HARDWARE).or_else(any).map(Some).ok_or_else(no_adapter)
        }
        DeviceChoice::Index(at) => list.get(*at).map(Some).ok_or_else(|| unknown(at.to_string())),
        DeviceChoice::Named(name) => {
            let matches = |adapter: &&GpuAdapter| adapter.name.to_lowercase().contains(&name.to_lowercase());
            list.iter().find(matches).map(Some).ok_or_else(|| unknown(name.clone()))
        }
    }
}

fn list_adapters(adapters: &Adapters) -> String {
    let names: Vec<String> = adapters.list.iter().enumerate().map(|(at, a)| format!("{at} '{}'", a.name)).collect();
    names.join(", ")
}

/// Pixels of all frames from which on a graphics device is looked for by itself: loading drivers, opening and comparing
/// a device takes as long as a core takes for some hundred million.
pub const AUTO_FROM_PX: u64 = 200_000_000;

/// A device that is used, and can be opened anew.
#[derive(Debug, Clone)]
pub struct Device {
    adapter: Option<GpuAdapter>,
    isa: Isa,
    options: GpuOptions,
    auto: bool,
    remark: Option<String>,
}

impl Device {
    /// The device of `choice` for so many pixels of all frames together; work on the CPU takes the instruction path
    /// `isa`.
    ///
    /// # Errors
    /// When there is none such.
    pub fn new(choice: &DeviceChoice, isa: Isa, options: GpuOptions, pixels: u64) -> Result<Self, DeviceError> {
        let auto = *choice == DeviceChoice::Auto;
        let is_little = auto && pixels < options.auto_from_px.unwrap_or(AUTO_FROM_PX);
        if is_little || *choice == DeviceChoice::Cpu {
            return Ok(Self { adapter: None, isa, options, auto, remark: None });
        }
        let adapters = gpu::adapters();
        let adapter = choose(choice, &adapters)?.cloned();
        let remark = adapter.is_none().then(|| match adapters.list.first() {
            None => "no graphics device: the CPU does the work".to_owned(),
            Some(GpuAdapter { name, .. }) => {
                format!("no graphics device but {name}, which is slower than the CPU: the CPU does the work")
            }
        });
        Ok(Self { adapter, isa, options, auto, remark })
    }

    /// What is worth saying of the choice: that no graphics device was found.
    pub fn remark(&self) -> Option<String> {
        self.remark.clone()
    }

    /// Whether it is a graphics device that nobody asked for by name: one that fails may be replaced.
    pub fn is_auto_gpu(&self) -> bool {
        self.auto && self.adapter.is_some()
    }

    /// Whether what it finds is held against the CPU now and then.
    pub fn is_looked_at(&self) -> bool {
        self.adapter.is_some() && !self.options.trusted
    }

    /// The same with all work on the CPU.
    pub fn on_cpu(&self) -> Self {
        Self { adapter: None, ..self.clone() }
    }

    /// Whether all work is done on the CPU.
    pub fn is_cpu(&self) -> bool {
        self.adapter.is_none()
    }

    /// Opens it and does `work` there.
    ///
    /// # Errors
    /// When the graphics device cannot be opened.
    pub fn open<W: OnDevice>(&self, work: W) -> Result<W::Output, BackendError> {
        match &self.adapter {
            #[cfg(feature = "testbed")]
            None if self.options.instant => Ok(work.on(super::InstantBackend::new(self.isa))),
            None => Ok(work.on(CpuBackend::new(self.isa))),
            Some(adapter) => gpu::open(adapter, &self.options, work),
        }
    }
}
