// Mean of each 2 x 2 block of pixels: the next level of the pyramid. Twin: crates/dic/src/backend/pyramid.rs.
// Thread = pixel of the coarser level.

struct Downsample {
    width: u32,
    rows: u32,
    fine_stride: u32,
    coarse_stride: u32,
    // Values before the first of each binding.
    fine_first: u32,
    coarse_first: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> downsample: Downsample;
@group(0) @binding(1) var<storage, read> fine: array<f32>;
@group(0) @binding(2) var<storage, read_write> coarse: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= downsample.width || id.y >= downsample.rows {
        return;
    }
    let upper = downsample.fine_first + 2u * id.y * downsample.fine_stride + 2u * id.x;
    let lower = upper + downsample.fine_stride;
    let mean = 0.25 * ((fine[upper] + fine[upper + 1u]) + (fine[lower] + fine[lower + 1u]));
    coarse[downsample.coarse_first + id.y * downsample.coarse_stride + id.x] = mean;
}
