// Grey levels of 8-bit, 16-bit or float pixels, less the series' offset. Twin: crates/dic/src/backend/pyramid.rs.
// Thread = pixel.

struct Unpack {
    width: u32,
    rows: u32,
    stride: u32,
    // Bytes of a pixel.
    depth: u32,
    // Pixels before the first in `pixels`, and values before the first in `grey`.
    skip: u32,
    first: u32,
    offset: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> unpack: Unpack;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;
@group(0) @binding(2) var<storage, read_write> grey: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= unpack.width || id.y >= unpack.rows {
        return;
    }
    let at = unpack.skip + id.y * unpack.width + id.x;
    // A word holds four pixels, two or one; without a branch, and without a division.
    let shift = 2u - (unpack.depth >> 1u);
    let bits = 8u * unpack.depth;
    let word = pixels[at >> shift];
    let part = (word >> (bits * (at & ((1u << shift) - 1u)))) & (0xffffffffu >> (32u - bits));
    let value = select(f32(part), bitcast<f32>(word), unpack.depth == 4u);
    grey[unpack.first + id.y * unpack.stride + id.x] = value - unpack.offset;
}
