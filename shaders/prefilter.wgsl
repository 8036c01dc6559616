// B-spline coefficients along one axis: the recursive prefilter of an image continued through its outermost
// pixels, s(-k) = 2 s(0) - s(k). Twin: src/backend/cpu/prefilter.rs, which runs over the whole length; here a
// tile runs in from HALO pixels beyond its own, where the largest pole leaves 2e-9.
// A workgroup filters LINES lines over LENGTH pixels in its memory; thread = line. Along y a line is a column.

struct Prefilter {
    // Pixels along the axis and lines across it, all and those of this dispatch.
    n: i32,
    lines: i32,
    // Distance of neighbours along the axis, and of lines.
    step: i32,
    line_step: i32,
    // First pixel and its end along the axis of this dispatch; first value of both bindings.
    begin: i32,
    end: i32,
    source_first: i32,
    target_first: i32,
    poles: vec2<f32>,
    n_poles: i32,
    // Weights of the first samples in the first causal value, MOST per pole.
    n_start: i32,
    start: array<vec4<f32>, 16>,
}

@group(0) @binding(0) var<uniform> prefilter: Prefilter;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> filtered: array<f32>;

const LINES: i32 = 32;
const LENGTH: i32 = 64;
const HALO: i32 = 24;
const MOST: i32 = 32;
const ROOM: i32 = LENGTH + 2 * HALO;
// One more than a row needs: neighbouring lines lie in different banks.
const PITCH: i32 = ROOM + 1;

var<workgroup> tile: array<f32, LINES * PITCH>;

fn start_weight(pole: i32, k: i32) -> f32 {
    let at = pole * MOST + k;
    return prefilter.start[at >> 2][at & 3];
}

@compute @workgroup_size(32)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let line0 = i32(group.x) * LINES;
    let core = prefilter.begin + i32(group.y) * LENGTH;
    let begin = max(core - HALO, 0);
    let end = min(core + LENGTH + HALO, prefilter.n);
    let length = end - begin;
    let me = i32(thread);
    // Threads run along whatever lies side by side in memory.
    if prefilter.step == 1 {
        for (var line = 0; line < LINES; line++) {
            let row = prefilter.source_first + (line0 + line) * prefilter.line_step + begin;
            for (var k = me; k < length; k += LINES) {
                if line0 + line < prefilter.lines {
                    tile[line * PITCH + k] = source[row + k];
                }
            }
        }
    } else if line0 + me < prefilter.lines {
        let column = prefilter.source_first + (line0 + me) * prefilter.line_step;
        for (var k = 0; k < length; k++) {
            tile[me * PITCH + k] = source[column + (begin + k) * prefilter.step];
        }
    }
    workgroupBarrier();
    // A constant is its own coefficient.
    if prefilter.n >= 2 {
        let at = me * PITCH;
        for (var pole = 0; pole < prefilter.n_poles; pole++) {
            let z = prefilter.poles[pole];
            let gain = (1.0 - z) * (1.0 - 1.0 / z);
            // Continued through its end, the signal keeps its end value under a symmetric filter of gain 1; in
            // the halo, any value that is nearly right will do.
            let last = tile[at + length - 1];
            var value: f32;
            if begin == 0 {
                value = 0.0;
                for (var k = 0; k < prefilter.n_start; k++) {
                    value += start_weight(pole, k) * tile[at + k];
                }
                value *= gain;
            } else {
                value = gain / (1.0 - z) * tile[at];
            }
            tile[at] = value;
            for (var k = 1; k < length; k++) {
                value = z * value + gain * tile[at + k];
                tile[at + k] = value;
            }
            value = last;
            tile[at + length - 1] = value;
            for (var k = length - 2; k >= 0; k--) {
                value = z * (value - tile[at + k]);
                tile[at + k] = value;
            }
        }
    }
    workgroupBarrier();
    let stop = min(core + LENGTH, prefilter.end);
    if prefilter.step == 1 {
        for (var line = 0; line < LINES; line++) {
            let row = prefilter.target_first + (line0 + line) * prefilter.line_step;
            for (var x = core + me; x < stop; x += LINES) {
                if line0 + line < prefilter.lines {
                    filtered[row + x] = tile[line * PITCH + x - begin];
                }
            }
        }
    } else if line0 + me < prefilter.lines {
        let column = prefilter.target_first + (line0 + me) * prefilter.line_step;
        for (var y = core; y < stop; y++) {
            filtered[column + y * prefilter.step] = tile[me * PITCH + y - begin];
        }
    }
}
