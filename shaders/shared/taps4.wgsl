// Interpolation from 4 x 4 coefficients, kept in registers: going down a column, three of four rows stay.
const BEFORE: i32 = 1; // taps start this far before the floor
const TAPS: i32 = 4;

struct Taps {
    r0: vec4<f32>,
    r1: vec4<f32>,
    r2: vec4<f32>,
    r3: vec4<f32>,
}

fn tap_row(at: i32) -> vec4<f32> {
    return vec4<f32>(deformed[at], deformed[at + 1], deformed[at + 2], deformed[at + 3]);
}

fn taps_at(at: i32, stride: i32) -> Taps {
    return Taps(tap_row(at), tap_row(at + stride), tap_row(at + 2 * stride), tap_row(at + 3 * stride));
}

// The taps one row below `taps`; the new row begins at `at`.
fn taps_below(taps: Taps, at: i32) -> Taps {
    return Taps(taps.r1, taps.r2, taps.r3, tap_row(at));
}

fn interpolate(taps: Taps, tx: f32, ty: f32) -> f32 {
    let wx = spline_weights(tx);
    let rows = vec4<f32>(dot(wx, taps.r0), dot(wx, taps.r1), dot(wx, taps.r2), dot(wx, taps.r3));
    return dot(spline_weights(ty), rows);
}
