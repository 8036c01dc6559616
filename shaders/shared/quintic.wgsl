// Quintic B-spline. Twin: `Quintic` in crates/dic/src/backend/spline.rs.
#import taps6

// beta5(1 + t): the ring between one and two pixels from the knot.
fn ring(t: f32, t2: f32) -> f32 {
    let a = t * (5.0 / 120.0) - 20.0 / 120.0;
    let b = t2 * a + (20.0 / 120.0 * t + 20.0 / 120.0);
    return t2 * b + (t * (-50.0 / 120.0) + 26.0 / 120.0);
}

// beta5(t): within one pixel.
fn core(t: f32, t2: f32) -> f32 {
    let a = t * (-10.0 / 120.0) + 30.0 / 120.0;
    return t2 * (t2 * a - 60.0 / 120.0) + 66.0 / 120.0;
}

fn spline_weights(t: f32) -> Six {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return Six(
        vec3<f32>(s2 * s2 * s * (1.0 / 120.0), ring(t, t2), core(t, t2)),
        vec3<f32>(core(s, s2), ring(s, s2), t2 * t2 * t * (1.0 / 120.0)),
    );
}
