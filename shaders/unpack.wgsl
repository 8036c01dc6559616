// Grey levels of 8-bit, 16-bit or float pixels, less the series' offset. Twin: src/backend/pyramid.rs.
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
    var value: f32;
    if unpack.depth == 1u {
        value = f32((pixels[at >> 2u] >> (8u * (at & 3u))) & 0xffu);
    } else if unpack.depth == 2u {
        value = f32((pixels[at >> 1u] >> (16u * (at & 1u))) & 0xffffu);
    } else {
        value = bitcast<f32>(pixels[at]);
    }
    grey[unpack.first + id.y * unpack.stride + id.x] = value - unpack.offset;
}
