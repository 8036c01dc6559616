// Keys' cubic convolution, a = -1/2. Twin: `Keys` in crates/dic/src/backend/spline.rs.
#import taps4

fn spline_weights(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return vec4<f32>(-0.5 * t * s2, t2 * (1.5 * t - 2.5) + 1.0, s2 * (1.5 * s - 2.5) + 1.0, -0.5 * s * t2);
}
