// Where pixels land in the deformed image, and how much they count there. Twin: crates/dic/src/backend/cpu/sample.rs.

// A pixel that lands beyond the outermost pixel centres fades out over this distance, px.
const EDGE: f32 = 0.25;

// Weight of a position (whole pixel and fraction) on an axis of `n` pixels: 1 inside, 0 from EDGE outside on.
fn weight_on(at: i32, t: f32, n: i32) -> f32 {
    // Whole pixels and fraction apart: the sum would lose the fraction far from zero.
    let beyond = max(f32(-at) - t, f32(at - (n - 1)) + t);
    return clamp(1.0 - beyond / EDGE, 0.0, 1.0);
}

// Floor of a displacement as a whole number; a wild one must not overflow, and lands outside any image.
fn whole_floor(u: f32) -> i32 {
    return i32(clamp(floor(u), -1e6, 1e6));
}
