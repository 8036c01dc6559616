// What both residual kernels sum. The kernel declares `run` and `sums`.
#import lanes

// Eight of the right-hand side by corner and component, then n, rr, g, gg, fg, and what is lost of f and of its square.
const QUANTITIES: u32 = 15u;
const STRIDE: u32 = SUMS;
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
