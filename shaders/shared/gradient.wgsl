// The gradient of the reference at a pixel: whole 16-bit numbers of a unit, x in the low half of a word, y in the high one.
// Twin: `gradients` in crates/dic/src/backend/cpu/gradient.rs.

fn packed_gradient(x: f32, y: f32) -> u32 {
    return (nearest(x) & 0xffffu) | (nearest(y) << 16u);
}

// The nearest whole number, in the low bits: a sum with 1.5 * 2^23 has no room for a fraction.
fn nearest(value: f32) -> u32 {
    return bitcast<u32>(clamp(value, -32767.0, 32767.0) + 12582912.0);
}

fn gradient_of(word: u32) -> vec2<f32> {
    return vec2<f32>(f32(bitcast<i32>(word << 16u) >> 16u), f32(bitcast<i32>(word) >> 16u));
}
