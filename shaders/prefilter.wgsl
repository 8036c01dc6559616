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
// With two poles, and with one: that of the cubic spline fades sooner.
const HALO: i32 = 24;
const SHORT_HALO: i32 = 16;
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
    let along_rows = prefilter.step == 1;
    let n_poles = select(0, prefilter.n_poles, prefilter.n >= 2); // a constant is its own coefficient
    let halo = select(HALO, SHORT_HALO, n_poles == 1);
    let line0 = i32(group.x) * LINES;
    let core = prefilter.begin + i32(group.y) * LENGTH;
    let stop = min(core + LENGTH, prefilter.end);
    let begin = max(core - halo, 0);
    let length = min(core + LENGTH + halo, prefilter.n) - begin;
    let me = i32(thread);
    let mine = along_rows || line0 + me < prefilter.lines;
    let line = me * PITCH;
    let source_line = prefilter.source_first + (line0 + me) * prefilter.line_step + begin * prefilter.step;
    let filtered_line = prefilter.target_first + (line0 + me) * prefilter.line_step;
    // Threads run along whatever lies side by side in memory: rows by way of the tile, columns directly.
    if along_rows {
        for (var k = 0; k < LINES; k++) {
            let row = prefilter.source_first + (line0 + k) * prefilter.line_step + begin;
            for (var x = me; x < length; x += LINES) {
                if line0 + k < prefilter.lines {
                    tile[k * PITCH + x] = source[row + x];
                }
            }
        }
    }
    workgroupBarrier();
    if mine {
        for (var pole = 0; pole < n_poles; pole++) {
            let z = prefilter.poles[pole];
            let gain = (1.0 - z) * (1.0 - 1.0 / z);
            let from_tile = along_rows || pole > 0;
            // Continued through its end, the signal keeps its end value under a symmetric filter of gain 1; in
            // the halo, any value that is nearly right will do.
            var last: f32;
            if from_tile {
                last = tile[line + length - 1];
            } else {
                last = source[source_line + (length - 1) * prefilter.step];
            }
            var value = 0.0;
            for (var k = 0; k < prefilter.n_start && begin == 0; k++) {
                if from_tile {
                    value += start_weight(pole, k) * tile[line + k];
                } else {
                    value += start_weight(pole, k) * source[source_line + k * prefilter.step];
                }
            }
            value *= gain;
            if begin > 0 {
                if from_tile {
                    value = gain / (1.0 - z) * tile[line];
                } else {
                    value = gain / (1.0 - z) * source[source_line];
                }
            }
            tile[line] = value;
            if from_tile {
                for (var k = 1; k < length; k++) {
                    value = z * value + gain * tile[line + k];
                    tile[line + k] = value;
                }
            } else {
                for (var k = 1; k < length; k++) {
                    value = z * value + gain * source[source_line + k * prefilter.step];
                    tile[line + k] = value;
                }
            }
            // The way back, and out on the last one: what is beyond the core is not wanted then.
            value = last;
            let out = pole == n_poles - 1;
            tile[line + length - 1] = value;
            if out && !along_rows {
                if begin + length <= stop {
                    filtered[filtered_line + (begin + length - 1) * prefilter.step] = value;
                }
                for (var k = length - 2; k >= core - begin; k--) {
                    value = z * (value - tile[line + k]);
                    if begin + k < stop {
                        filtered[filtered_line + (begin + k) * prefilter.step] = value;
                    }
                }
            } else {
                for (var k = length - 2; k >= select(0, core - begin, out); k--) {
                    value = z * (value - tile[line + k]);
                    tile[line + k] = value;
                }
            }
        }
        if n_poles == 0 && !along_rows {
            for (var k = core - begin; begin + k < stop; k++) {
                filtered[filtered_line + (begin + k) * prefilter.step] = source[source_line + k * prefilter.step];
            }
        }
    }
    workgroupBarrier();
    if along_rows {
        for (var k = 0; k < LINES; k++) {
            let row = prefilter.target_first + (line0 + k) * prefilter.line_step;
            for (var x = core + me; x < stop; x += LINES) {
                if line0 + k < prefilter.lines {
                    filtered[row + x] = tile[k * PITCH + x - begin];
                }
            }
        }
    }
}
