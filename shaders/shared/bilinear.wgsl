// Bilinear, as four taps of which the outer ones weigh nothing. Twin: `Bilinear` in crates/dic/src/backend/spline.rs.
#import taps4

fn spline_weights(t: f32) -> vec4<f32> {
    return vec4<f32>(0.0, 1.0 - t, t, 0.0);
}
