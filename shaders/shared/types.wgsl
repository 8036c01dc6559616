// Structs that both sides see; the Rust ones are in crates/dic/src/backend/gpu/layout.rs.

// An element, its nodes and its pixels: `size.x` columns and `size.y` rows from `corner` on, column k at
// xi = local.x + k local.y, row k at eta = local.z + k local.w; or, with n_runs > 0, runs of pixels.
struct Element {
    nodes: vec4<u32>,
    corner: vec2<i32>,
    size: vec2<u32>,
    local: vec4<f32>,
    first_run: u32,
    n_runs: u32,
    zone: u32,
    unused: u32,
}

// A nodal displacement: whole pixels and the rest, never their sum (an f32 of 3000 px steps by 2.4e-4 px).
struct Displacement {
    whole: vec2<i32>,
    rest: vec2<f32>,
}

// Which part of an evaluation a dispatch does. Images larger than a storage binding are seen in windows of
// rows: an element belongs to the window that its first row lies in, a pixel to that of the floor of where it
// lands. Numbers of pixels are those of the level.
struct Pass {
    image: vec2<i32>,
    stride: i32,
    n_elements: u32,
    // Image row that the reference binding begins with, and the first rows of the elements done.
    reference_first: i32,
    elements_from: i32,
    elements_to: i32,
    // Row of the plane, border included, that the deformed binding begins with, and the floors done.
    deformed_first: i32,
    floors_from: i32,
    floors_to: i32,
    // Whether each element has a gain and offset of its own, and whether to add to the sums there are.
    own_transfer: u32,
    accumulate: u32,
    // Elements with runs: their number and where runs and local coordinates begin in `shape`.
    n_listed: u32,
    runs_at: u32,
    points_at: u32,
    // For the normal matrix: count pixels by their weight in the deformed image.
    weighted: u32,
    // Of the gradient, grey levels per px.
    unit: f32,
    unused0: u32,
    unused1: u32,
    unused2: u32,
}

// Columns and rows of border around a plane.
const BORDER: i32 = 4;

// Sums of an element: right-hand side, then pixels counted, r^2, g, g^2, f g, and f, f^2 over those lost; the
// last is how often the element has been left out, half more while it is, and negative while the host excludes it: its
// sums are kept then, but for the right-hand side, and count nowhere.
const SUMS: u32 = 16u;
const N: u32 = 8u;
const RR: u32 = 9u;
const G: u32 = 10u;
const GG: u32 = 11u;
const FG: u32 = 12u;
const F_LOST: u32 = 13u;
const FF_LOST: u32 = 14u;
const OUT: u32 = 15u;
const EXCLUDED: f32 = -1.0;
