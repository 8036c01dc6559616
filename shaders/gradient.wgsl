// The reference: grey levels and the gradient of their spline at the pixels, row by row f, then both components of the gradient
// in one word.
// Twin: `gradients` in crates/dic/src/backend/cpu/gradient.rs. Thread = column of ROWS
// pixels: going down, sums along four of five rows of coefficients stay in registers.
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
    // Weights of value and derivative on the coefficients from two pixels before to two after.
    value: array<vec4<f32>, 2>,
    derivative: array<vec4<f32>, 2>,
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
    // Value and slope along x of the rows from two above to one below.
    var even = vec4<f32>(0.0);
    var slope = vec4<f32>(0.0);
    let end = min(first + ROWS, gradient.rows);
    for (var y = first - 4; y < end; y++) {
        let row = gradient.coefficients_first + (y + 2) * gradient.stride + x - 2;
        let c = vec4<f32>(coefficients[row], coefficients[row + 1], coefficients[row + 2], coefficients[row + 3]);
        let last = coefficients[row + 4];
        let even_below = dot(gradient.value[0], c) + gradient.value[1].x * last;
        let slope_below = dot(gradient.derivative[0], c) + gradient.derivative[1].x * last;
        if y >= first {
            let at = gradient.reference_first + 2 * y * gradient.stride + x;
            reference[at] = bitcast<u32>(grey[gradient.grey_first + y * gradient.stride + x]);
            reference[at + gradient.stride] = packed_gradient(
                gradient.per_unit * (dot(gradient.value[0], slope) + gradient.value[1].x * slope_below),
                gradient.per_unit * (dot(gradient.derivative[0], even) + gradient.derivative[1].x * even_below),
            );
        }
        even = vec4<f32>(even.yzw, even_below);
        slope = vec4<f32>(slope.yzw, slope_below);
    }
}
