// Cubic B-spline. Twin: `Cubic` in crates/dic/src/backend/spline.rs.
#import taps4

fn spline_weights(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return vec4<f32>(
        s2 * s * (1.0 / 6.0),
        t2 * (t * 0.5 - 1.0) + 2.0 / 3.0,
        s2 * (s * 0.5 - 1.0) + 2.0 / 3.0,
        t2 * t * (1.0 / 6.0),
    );
}
