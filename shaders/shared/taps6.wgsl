// Interpolation from 6 x 6 coefficients, kept in registers: going down a column, five of six rows stay.
const BEFORE: i32 = 2; // taps start this far before the floor
const TAPS: i32 = 6;

struct Six {
    a: vec3<f32>,
    b: vec3<f32>,
}

struct Taps {
    r0: Six,
    r1: Six,
    r2: Six,
    r3: Six,
    r4: Six,
    r5: Six,
}

fn tap_row(at: i32) -> Six {
    return Six(
        vec3<f32>(deformed[at], deformed[at + 1], deformed[at + 2]),
        vec3<f32>(deformed[at + 3], deformed[at + 4], deformed[at + 5]),
    );
}

fn taps_at(at: i32, stride: i32) -> Taps {
    return Taps(
        tap_row(at),
        tap_row(at + stride),
        tap_row(at + 2 * stride),
        tap_row(at + 3 * stride),
        tap_row(at + 4 * stride),
        tap_row(at + 5 * stride),
    );
}

// The taps one row below `taps`; the new row begins at `at`.
fn taps_below(taps: Taps, at: i32) -> Taps {
    return Taps(taps.r1, taps.r2, taps.r3, taps.r4, taps.r5, tap_row(at));
}

fn times(w: Six, row: Six) -> f32 {
    return dot(w.a, row.a) + dot(w.b, row.b);
}

fn interpolate(taps: Taps, tx: f32, ty: f32) -> f32 {
    let wx = spline_weights(tx);
    let rows = Six(
        vec3<f32>(times(wx, taps.r0), times(wx, taps.r1), times(wx, taps.r2)),
        vec3<f32>(times(wx, taps.r3), times(wx, taps.r4), times(wx, taps.r5)),
    );
    return times(spline_weights(ty), rows);
}
