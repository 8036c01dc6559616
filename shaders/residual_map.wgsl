// What goes back to the host at the end of a frame: how each element matched (the residual map), and the field,
// packed. Twins: `PixelSums` and `ElementMatch` in crates/dic/src/backend/sums.rs. Thread = element and node of one number.
#import types
#import index

struct Report {
    n_elements: u32,
    n_nodes: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> report: Report;
@group(0) @binding(1) var<storage, read> whole: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sums: array<f32>;
@group(0) @binding(3) var<storage, read> displacement: array<Displacement>;
// Per element two words: root mean square of the residual; share of pixels counted and correlation coefficient.
// Then per node three: whole pixels as two 16-bit numbers, the rest.
@group(0) @binding(4) var<storage, read_write> packed: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups) * 256u + thread;
    if number < report.n_elements {
        let at = number * SUMS;
        let all = whole[number];
        let n = sums[at + N];
        var rms = 0.0;
        var share = 0.0;
        var correlation = 0.0;
        if n > 0.0 && sums[at + OUT] != EXCLUDED {
            rms = sqrt(max(sums[at + RR] / n, 0.0));
            // One in 32767 at least: none would mean that the element is left out.
            share = max(n / all.x, 1.0 / 32767.0);
            let mean_f = (all.y - sums[at + F_LOST]) / n;
            let mean_g = sums[at + G] / n;
            let variance_f = (all.z - sums[at + FF_LOST]) / n - mean_f * mean_f;
            let variance_g = sums[at + GG] / n - mean_g * mean_g;
            if n >= 2.0 && variance_f > 0.0 && variance_g > 0.0 {
                correlation = (sums[at + FG] / n - mean_f * mean_g) / sqrt(variance_f * variance_g);
            }
        }
        packed[2u * number] = bitcast<u32>(rms);
        packed[2u * number + 1u] = pack2x16snorm(vec2<f32>(share, correlation));
    }
    if number < report.n_nodes {
        let at = 2u * report.n_elements + 3u * number;
        let u = displacement[number];
        let whole_px = clamp(u.whole, vec2<i32>(-32768), vec2<i32>(32767));
        packed[at] = (u32(whole_px.x) & 0xffffu) | (u32(whole_px.y) << 16u);
        packed[at + 1u] = bitcast<u32>(u.rest.x);
        packed[at + 2u] = bitcast<u32>(u.rest.y);
    }
}
