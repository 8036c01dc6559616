//! Structs that both sides see; `tests/correlation/shaders.rs` compares them with the WGSL ones.

use bytemuck::{Pod, Zeroable};

/// All of the pixels of an element, as the share that shaders/residual_map.wgsl packs.
pub(super) const WHOLE: u16 = 32767;

/// A struct of the shaders, as the Rust side lays it out.
#[derive(Debug, Clone)]
pub struct Mirror {
    /// Its name, the same on both sides.
    pub name: &'static str,
    /// Bytes.
    pub size: usize,
    /// Names and offsets of its fields.
    pub fields: Vec<(&'static str, usize)>,
}

/// Declares structs laid out as in WGSL, and [`mirrors`], which lists them.
macro_rules! mirror {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty),* $(,)? })*) => {
        $(
            $(#[$doc])*
            #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
            #[repr(C)]
            pub(super) struct $name {
                $($(#[$field_doc])* pub $field: $type),*
            }
        )*

        /// Every struct that both sides see.
        pub fn mirrors() -> Vec<Mirror> {
            vec![$(Mirror {
                name: stringify!($name),
                size: size_of::<$name>(),
                fields: vec![$((stringify!($field), std::mem::offset_of!($name, $field))),*],
            }),*]
        }
    };
}

mirror! {
    /// An element, its nodes and its pixels: a rectangle, or runs.
    Element {
        nodes: [u32; 4],
        corner: [i32; 2],
        size: [u32; 2],
        local: [f32; 4],
        first_run: u32,
        n_runs: u32,
        zone: u32,
        unused: u32,
    }
    /// A nodal displacement: whole pixels and the rest.
    Displacement { whole: [i32; 2], rest: [f32; 2] }
    /// Which part of an evaluation a dispatch does.
    Pass {
        image: [i32; 2],
        stride: i32,
        n_elements: u32,
        reference_first: i32,
        elements_from: i32,
        elements_to: i32,
        deformed_first: i32,
        floors_from: i32,
        floors_to: i32,
        own_transfer: u32,
        accumulate: u32,
        n_listed: u32,
        runs_at: u32,
        points_at: u32,
        weighted: u32,
        unit: f32,
        unused0: u32,
        unused1: u32,
        unused2: u32,
    }
    Unpack {
        width: u32,
        rows: u32,
        stride: u32,
        depth: u32,
        skip: u32,
        first: u32,
        offset: f32,
        unused: u32,
    }
    Downsample {
        width: u32,
        rows: u32,
        fine_stride: u32,
        coarse_stride: u32,
        fine_first: u32,
        coarse_first: u32,
        unused: [u32; 2],
    }
    Prefilter {
        n: i32,
        left: i32,
        right: i32,
        top: i32,
        bottom: i32,
        source_stride: i32,
        target_stride: i32,
        source_first: i32,
        target_first: i32,
        n_start: i32,
        halo: i32,
        own: f32,
        poles: [f32; 2],
        amplitudes: [f32; 2],
        start: [[f32; 2]; 32],
    }
    Border {
        width: i32,
        height: i32,
        stride: i32,
        first: i32,
        begin: i32,
        end: i32,
        unused: [i32; 2],
    }
    Gradient {
        width: i32,
        rows: i32,
        stride: i32,
        grey_first: i32,
        coefficients_first: i32,
        reference_first: i32,
        per_unit: f32,
        unused: i32,
        value: [f32; 4],
        derivative: [f32; 4],
    }
    Tally {
        n_elements: u32,
        n_groups: u32,
        kept_share: f32,
        back_share: f32,
        lossy_share: f32,
        own_transfer: u32,
        stays_out: f32,
        unused: u32,
    }
    /// Elements of one zone.
    Group { first: u32, count: u32 }
    Summary { n_zones: u32, brightness: u32, first: u32, at: u32 }
    /// What follows a correction, and when.
    Largest {
        n_worst: u32,
        at: u32,
        lost: f32,
        n_sizes: u32,
        correction: [u32; 2],
        counted: [f32; 2],
        sizes: [[u32; 4]; 8],
    }
    /// Groups of elements of a zone.
    ZoneGroups { first: u32, count: u32, n_elements: u32, unused: u32 }
    /// Sums over a zone and what follows from them.
    Zone {
        n: f32,
        n_all: f32,
        f: f32,
        ff: f32,
        g: f32,
        gg: f32,
        fg: f32,
        rr: f32,
        gain: f32,
        offset: f32,
        first: f32,
        unused: f32,
    }
    /// A correction's largest component, as bits, and its node.
    Worst { bits: u32, node: u32 }
    /// What a step reports.
    Step {
        worst: Worst,
        correlation: f32,
        gained: f32,
        counted: f32,
        lossy: f32,
        made: u32,
        goes_on: u32,
    }
    Gather { n_nodes: u32, unused0: u32, unused1: u32, unused2: u32 }
    /// Part of an iteration of the conjugate gradients.
    Cg {
        n_nodes: u32,
        iteration: u32,
        n_partial: u32,
        first_node: u32,
        last_node: u32,
        first_block: u32,
        unused0: u32,
        unused1: u32,
    }
    Correct { n_nodes: u32, cos: f32, sin: f32, coupled: u32, before_first: u32, first: u32, unused: [u32; 2] }
    /// Where a node lies in the mesh of the next coarser level.
    Place { nodes: [u32; 4], weights: [f32; 4] }
    Report { n_elements: u32, n_nodes: u32, unused: [u32; 2] }
}

impl From<[f64; 2]> for Displacement {
    fn from(u: [f64; 2]) -> Self {
        // A wild field must not overflow; such pixels are outside any image.
        let whole = u.map(|u| u.floor().clamp(-1e6, 1e6));
        Self { whole: whole.map(|w| w as i32), rest: [(u[0] - whole[0]) as f32, (u[1] - whole[1]) as f32] }
    }
}
