// The reference: grey levels and the gradient of their spline at the pixels, row by row f, fx, fy.
// Twin: `gradient` in src/backend/cpu/pixels.rs. Thread = pixel.
#import types

struct Gradient {
    width: i32,
    rows: i32,
    stride: i32,
    // First values of the bindings at image row 0 of this dispatch.
    grey_first: i32,
    coefficients_first: i32,
    reference_first: i32,
    unused: vec2<i32>,
    // Weights of value and derivative on the coefficients from two pixels before to two after.
    value: array<vec4<f32>, 2>,
    derivative: array<vec4<f32>, 2>,
}

@group(0) @binding(0) var<uniform> gradient: Gradient;
@group(0) @binding(1) var<storage, read> grey: array<f32>;
@group(0) @binding(2) var<storage, read> coefficients: array<f32>;
@group(0) @binding(3) var<storage, read_write> reference: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = i32(id.x);
    let y = i32(id.y);
    if x >= gradient.width || y >= gradient.rows {
        return;
    }
    var fx = 0.0;
    var fy = 0.0;
    for (var j = 0; j < 5; j++) {
        let row = gradient.coefficients_first + (y + j - 2) * gradient.stride + x - 2;
        var smooth_x = 0.0;
        var slope_x = 0.0;
        for (var k = 0; k < 5; k++) {
            let c = coefficients[row + k];
            smooth_x += gradient.value[k >> 2][k & 3] * c;
            slope_x += gradient.derivative[k >> 2][k & 3] * c;
        }
        fx += gradient.value[j >> 2][j & 3] * slope_x;
        fy += gradient.derivative[j >> 2][j & 3] * smooth_x;
    }
    let at = gradient.reference_first + 3 * y * gradient.stride + x;
    reference[at] = grey[gradient.grey_first + y * gradient.stride + x];
    reference[at + gradient.stride] = fx;
    reference[at + 2 * gradient.stride] = fy;
}
