// B-spline coefficients of an image continued through its outermost pixels, s(-k) = 2 s(0) - s(k): along y, and written
// with rows and columns exchanged, so that after a second time both axes are filtered and the image lies as it did.
// The filter in its parallel form (Unser 1999): c(k) = sum_p a_p (down_p(k) + up_p(k) - s(k)), down_p(k) = s(k) + z_p down_p(k - 1),
// up_p(k) = s(k) + z_p up_p(k + 1). Neither way waits for the other, and a thread holds nothing but one value per pole.
// Twin: crates/dic/src/backend/cpu/prefilter.rs, which runs over the whole length; here a piece runs in from a halo of pixels beyond its
// own, where the largest pole leaves 2e-9.
// Thread = column; a workgroup filters LENGTH rows of LINES columns, and exchanges them in its memory.

struct Prefilter {
    // Rows of the image.
    n: i32,
    // Columns and rows of this dispatch.
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    // Values from one row to the next, and pixel (0, 0) in the bindings.
    source_stride: i32,
    target_stride: i32,
    source_first: i32,
    target_first: i32,
    // Samples that the first value of a way is made of.
    n_start: i32,
    halo: i32,
    // Weight of s(k) itself: 1 where there is no filter.
    own: f32,
    poles: vec2<f32>,
    amplitudes: vec2<f32>,
    // Weights of the samples in the first value of a way, by pole.
    start: array<vec4<f32>, 16>,
}

@group(0) @binding(0) var<uniform> prefilter: Prefilter;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> filtered: array<f32>;

const LINES: i32 = 64;
const LENGTH: i32 = 32;
// One more than a column needs: neighbouring columns lie in different banks.
const PITCH: i32 = LENGTH + 1;

var<workgroup> tile: array<f32, LINES * PITCH>;

// The first value of a way that begins at the border pixel `at`, `step` values from its neighbour.
fn first_value(at: i32, step: i32) -> vec2<f32> {
    var value = vec2<f32>(0.0);
    for (var k = 0; k < prefilter.n_start; k++) {
        let two = prefilter.start[k >> 1u];
        value += select(two.xy, two.zw, (k & 1) == 1) * source[at + k * step];
    }
    return value;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let left = prefilter.left + i32(group.x) * LINES;
    let top = prefilter.top + i32(group.y) * LENGTH;
    let bottom = min(top + LENGTH, prefilter.bottom) - 1;
    let step = prefilter.source_stride;
    let z = prefilter.poles;
    if left + i32(thread) < prefilter.right {
        let column = prefilter.source_first + left + i32(thread);
        let mine = i32(thread) * PITCH - top;
        // From a halo away any value that is nearly right will do: that of a signal which is constant from there on.
        let above = max(top - prefilter.halo, 0);
        var value = source[column + above * step] / (1.0 - z);
        if above == 0 {
            value = first_value(column, step);
        }
        for (var y = above + 1; y < top; y++) {
            value = source[column + y * step] + z * value;
        }
        for (var y = top; y <= bottom; y++) {
            let s = source[column + y * step];
            if y > above {
                value = s + z * value;
            }
            tile[mine + y] = prefilter.own * s + dot(prefilter.amplitudes, value);
        }
        let below = min(bottom + prefilter.halo, prefilter.n - 1);
        value = source[column + below * step] / (1.0 - z);
        if below == prefilter.n - 1 {
            value = first_value(column + below * step, -step);
        }
        for (var y = below - 1; y > bottom; y--) {
            value = source[column + y * step] + z * value;
        }
        for (var y = bottom; y >= top; y--) {
            if y < below {
                value = source[column + y * step] + z * value;
            }
            tile[mine + y] += dot(prefilter.amplitudes, value);
        }
    }
    workgroupBarrier();
    // Threads run along a column, which is a row of the target.
    for (var k = i32(thread); k < LINES * LENGTH; k += LINES) {
        let x = left + k / LENGTH;
        let y = top + k % LENGTH;
        if x < prefilter.right && y <= bottom {
            filtered[prefilter.target_first + x * prefilter.target_stride + y] = tile[(k / LENGTH) * PITCH + k % LENGTH];
        }
    }
}
