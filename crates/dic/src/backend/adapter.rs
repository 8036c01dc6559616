//! Graphics adapters as a machine has them, and how they are used.

use super::gpu::Handle;

/// What a graphics adapter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum AdapterKind {
    /// A graphics card.
    Discrete,
    /// Part of the processor.
    Integrated,
    /// Seen through a virtual machine.
    Virtual,
    /// A driver that computes on the CPU.
    Software,
    /// Something else.
    Other,
}

impl AdapterKind {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete GPU",
            Self::Integrated => "integrated GPU",
            Self::Virtual => "virtual GPU",
            Self::Software => "software",
            Self::Other => "other",
        }
    }

    /// Most threads that work side by side in one element. A card with few wide elements would have too few of them; on
    /// a software device nothing is idle, and their sums cost a tenth more of a pass with elements of 32 px.
    #[cfg(feature = "gpu")]
    pub(super) fn most_lanes(self) -> u32 {
        if self == Self::Software { 16 } else { 64 }
    }
}

/// A graphics adapter that this machine has.
#[derive(Debug, Clone)]
pub struct GpuAdapter {
    /// The driver's own.
    pub(super) handle: Handle,
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: AdapterKind,
    /// Interface it is reached by: `vulkan`, `metal`, `dx12`.
    pub api: String,
    /// Driver and its version.
    pub driver: String,
    /// Largest buffer that a kernel can see at once, bytes.
    pub max_binding_bytes: u64,
    /// Largest buffer, bytes.
    pub max_buffer_bytes: u64,
    /// Whether it can time its own work.
    pub has_timestamps: bool,
    /// Why quadrille cannot use it, if it cannot.
    pub unusable: Option<String>,
}

/// The adapters of this machine.
#[derive(Debug, Clone)]
pub struct Adapters {
    /// In the order the drivers give them.
    pub list: Vec<GpuAdapter>,
    /// What the drivers said when there is none.
    pub reason: Option<String>,
    /// Whether this build can use none, whatever there is.
    pub built_without: bool,
}

/// Choices of a device.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct GpuOptions {
    /// Pixels of all frames from which on `auto` looks for one; [`super::choice::AUTO_FROM_PX`] where it does not say.
    pub auto_from_px: Option<u64>,
    /// Whether it is taken at its word: not compared with the CPU, neither when it is opened nor in a series.
    pub trusted: bool,
    /// A text of the shaders and what stands in its place: to test what happens on a device that computes something
    /// else.
    pub altered: Option<[String; 2]>,
    /// Whether it is altered only once it was compared with the CPU.
    pub altered_later: bool,
    /// Largest binding to use, bytes, below what the adapter offers: to test how images are split.
    pub max_binding_bytes: Option<u64>,
    /// Most threads side by side in an element, rounded down to a power of two from 4 to 64, whatever kind of device
    /// it is: to test on a software device what cards do.
    pub most_lanes: Option<u32>,
    /// Whether there is no device, and every frame ends at once as the first: to measure what the host does. Nothing
    /// is measured then.
    #[cfg(feature = "testbed")]
    pub instant: bool,
    /// Readbacks after which the device fails, as a lost one would: to test what happens then.
    pub fail_after: Option<usize>,
}
