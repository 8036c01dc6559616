// The end of an evaluation: sums, gain and offset of every zone, and what a step tells the host. One workgroup.
// Twins: `zone_sums` and `fit_transfer` in crates/dic/src/backend/cpu/mod.rs, `PixelSums` in crates/dic/src/backend/sums.rs.
#import tallies
#import step

struct Summary {
    n_zones: u32,
    // What has a gain and offset: nothing, zones, elements.
    brightness: u32,
    // Whether this is the first evaluation of a field.
    first: u32,
    // Number of the step in its batch, from 0.
    at: u32,
}

// Groups of elements of a zone, and how many elements they hold.
struct ZoneGroups {
    first: u32,
    count: u32,
    n_elements: u32,
    unused: u32,
}

// Sums over a zone and what follows from them.
struct Zone {
    n: f32,
    n_all: f32,
    f: f32,
    ff: f32,
    g: f32,
    gg: f32,
    fg: f32,
    rr: f32,
    gain: f32,
    offset: f32,
    // Correlation coefficient at the first evaluation.
    first: f32,
    unused: f32,
}

@group(0) @binding(0) var<uniform> summary: Summary;
@group(0) @binding(1) var<storage, read> zone_groups: array<ZoneGroups>;
@group(0) @binding(2) var<storage, read> group_sums: array<f32>;
@group(0) @binding(3) var<storage, read_write> transfer: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> zones: array<Zone>;
@group(0) @binding(5) var<storage, read_write> steps: array<Step>;
// What the transfer of each zone gained, as shares of f and of 1: `GreyTransfer::change` in crates/dic/src/backend/mod.rs.
@group(0) @binding(6) var<storage, read_write> change: array<vec2<f32>>;

// Share of the variance that both images have to have in common for the rest to be noise, as in crates/dic/src/backend/sums.rs.
const SHARED: f32 = 0.5;
// Correlation coefficient below which a change of light is not followed by the displacement, as in crates/dic/src/backend/mod.rs.
const COUPLED: f32 = 0.9;
const OFF: u32 = 0u;
const ZONE: u32 = 1u;
const ELEMENT: u32 = 2u;

var<workgroup> partial: array<f32, 704>; // TALLIES * 64
var<workgroup> total: array<f32, TALLIES>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) thread: u32) {
    var correlation = 1.0;
    var gained = 2.0;
    var counted = 0.0;
    var lossy = 0.0;
    for (var z = 0u; z < summary.n_zones; z++) {
        let groups = zone_groups[z];
        var mine: array<f32, TALLIES>;
        for (var k = thread; k < groups.count; k += 64u) {
            for (var i = 0u; i < TALLIES; i++) {
                mine[i] += group_sums[(groups.first + k) * ROOM + i];
            }
        }
        for (var i = 0u; i < TALLIES; i++) {
            partial[64u * i + thread] = mine[i];
        }
        workgroupBarrier();
        if thread < TALLIES {
            var sum = 0.0;
            for (var i = 0u; i < 64u; i++) {
                sum += partial[64u * thread + i];
            }
            total[thread] = sum;
        }
        workgroupBarrier();
        if thread == 0u {
            let n = total[0];
            let many = max(n, 1.0);
            let mean_f = total[2] / many;
            let mean_g = total[4] / many;
            let variance_f = total[3] / many - mean_f * mean_f;
            let variance_g = total[5] / many - mean_g * mean_g;
            let covariance = total[6] / many - mean_f * mean_g;
            var of_zone = 0.0;
            if n >= 2.0 && variance_f > 0.0 && variance_g > 0.0 {
                of_zone = clamp(covariance / sqrt(variance_f * variance_g), -1.0, 1.0);
            }
            if summary.first != 0u {
                zones[z].first = of_zone;
            }
            // A zone that is left out says nothing.
            if n > 0.0 {
                correlation = min(correlation, of_zone);
                gained = min(gained, of_zone - zones[z].first);
            }
            counted += n;
            lossy += total[8];
            zones[z].n = n;
            zones[z].n_all = total[1];
            zones[z].f = total[2];
            zones[z].ff = total[3];
            zones[z].g = total[4];
            zones[z].gg = total[5];
            zones[z].fg = total[6];
            zones[z].rr = total[7];
            change[z] = vec2<f32>(0.0);
            // Kept where the sums say nothing: no sensible change of light turns dark into bright.
            if summary.brightness == ZONE && n >= 2.0 && variance_g > 0.0 && covariance > 0.0 {
                // Both images are noisy: the line closest to the pairs in both directions.
                // By the ratio of the two: squares of grey levels of any size stay finite.
                let half = 0.5 * (variance_f - variance_g) / covariance;
                let root = sqrt(half * half + 1.0);
                var gain = 0.0;
                // In quotients, as above.
                if (covariance / variance_f) * (covariance / variance_g) < SHARED {
                    // Mostly misfit: the ratio of the contrasts.
                    gain = sqrt(variance_f / variance_g);
                } else if half > 0.0 {
                    gain = half + root;
                } else {
                    gain = 1.0 / (root - half);
                }
                // Not where the sums are beyond what f32 holds.
                if gain > 0.0 && gain < 1e30 {
                    let before = transfer[z];
                    let after = vec2<f32>(gain, (total[2] - gain * total[4]) / n);
                    if of_zone >= COUPLED && before.x > 0.0 {
                        let of_f = (after.x - before.x) / before.x;
                        change[z] = vec2<f32>(of_f, after.y - before.y - of_f * before.y);
                    }
                    transfer[z] = after;
                }
            }
            if summary.brightness == ELEMENT {
                zones[z].gain = total[9] / f32(groups.n_elements);
                zones[z].offset = total[10] / f32(groups.n_elements);
            } else {
                zones[z].gain = transfer[z].x;
                zones[z].offset = transfer[z].y;
            }
        }
        workgroupBarrier();
    }
    if thread == 0u {
        steps[summary.at].correlation = correlation;
        steps[summary.at].gained = gained;
        steps[summary.at].counted = counted;
        steps[summary.at].lossy = lossy;
    }
}
