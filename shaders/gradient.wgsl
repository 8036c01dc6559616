// The reference: grey levels and the gradient of their spline at the pixels, row by row f, then both components of the gradient
// in one word.
// Twin: `gradients` in crates/dic/src/backend/cpu/gradient.rs. Thread = column of ROWS
// pixels: going down, sums along two of three rows of coefficients stay in registers.
#import types
#import gradient

struct Gradient {
    width: i32,
    rows: i32,
    stride: i32,
    // First values of the bindings at image row 0 of this dispatch.
    grey_first: i32,
    coefficients_first: i32,
    reference_first: i32,
    // Units of the gradient per grey level and px.
    per_unit: f32,
    unused: i32,
    // Weights of value and derivative on the coefficients from one pixel before to one after.
    value: vec4<f32>,
    derivative: vec4<f32>,
}

@group(0) @binding(0) var<uniform> gradient: Gradient;
@group(0) @binding(1) var<storage, read> grey: array<f32>;
@group(0) @binding(2) var<storage, read> coefficients: array<f32>;
@group(0) @binding(3) var<storage, read_write> reference: array<u32>;

const ROWS: i32 = 16;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = i32(id.x);
    let first = ROWS * i32(id.y);
    if x >= gradient.width || first >= gradient.rows {
        return;
    }
    // Value and slope along x of the rows from one above to one below.
    var even = vec3<f32>(0.0);
    var slope = vec3<f32>(0.0);
    let end = min(first + ROWS, gradient.rows);
    for (var y = first - 2; y < end; y++) {
        let row = gradient.coefficients_first + (y + 1) * gradient.stride + x - 1;
        let c = vec3<f32>(coefficients[row], coefficients[row + 1], coefficients[row + 2]);
        even = vec3<f32>(even.yz, dot(gradient.value.xyz, c));
        slope = vec3<f32>(slope.yz, dot(gradient.derivative.xyz, c));
        if y >= first {
            let at = gradient.reference_first + 2 * y * gradient.stride + x;
            reference[at] = bitcast<u32>(grey[gradient.grey_first + y * gradient.stride + x]);
            reference[at + gradient.stride] = packed_gradient(
                gradient.per_unit * dot(gradient.value.xyz, slope),
                gradient.per_unit * dot(gradient.derivative.xyz, even),
            );
        }
    }
}
