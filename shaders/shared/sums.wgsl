// The end of both residual kernels: the sums of LANES threads become those of their element. The kernel declares
// `run` and `sums`.

override LANES: u32 = 16u;

// Eight of the right-hand side by corner and component, then n, rr, g, gg, fg, and what is lost of f and of its square.
const QUANTITIES: u32 = 15u;
var<workgroup> partial: array<f32, 960>; // QUANTITIES * 64

fn keep(thread: u32, of_grey: vec4<f32>, fg: f32, lost: vec2<f32>) {
    partial[512u + thread] = of_grey.x;
    partial[576u + thread] = of_grey.y;
    partial[640u + thread] = of_grey.z;
    partial[704u + thread] = of_grey.w;
    partial[768u + thread] = fg;
    partial[832u + thread] = lost.x;
    partial[896u + thread] = lost.y;
}

fn add_up(element: u32, slot: u32, lane: u32) {
    for (var k = lane; k < QUANTITIES; k += LANES) {
        var sum = 0.0;
        for (var i = 0u; i < LANES; i++) {
            sum += partial[64u * k + slot * LANES + i];
        }
        let at = element * SUMS + k;
        if run.accumulate != 0u {
            sum += sums[at];
        }
        sums[at] = sum;
    }
}
