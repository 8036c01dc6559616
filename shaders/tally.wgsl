// After a residual pass: which elements are left out, and the sums of groups of elements of one zone. Before
// it, where each element has a gain and offset of its own: fits them. Twins: `run` in crates/dic/src/backend/cpu/mod.rs
// and `fitted` in crates/dic/src/backend/cpu/residual_fitted.rs.
#import types
#import index
#import tallies

struct Tally {
    n_elements: u32,
    n_groups: u32,
    // Shares of its pixels that an element must keep, and must get back (`kept_and_back_share`), and below which it
    // is lossy (1 - LOST_SHARE).
    kept_share: f32,
    back_share: f32,
    lossy_share: f32,
    // Whether each element has a gain and offset of its own.
    own_transfer: u32,
    // How often an element is left out before it stays so.
    stays_out: f32,
    unused: u32,
}

// Elements of one zone, at most TOGETHER.
struct Group {
    first: u32,
    count: u32,
}

@group(0) @binding(0) var<uniform> tally: Tally;
@group(0) @binding(1) var<storage, read> groups_of_elements: array<Group>;
// Pixels, sum of f, of f^2 of the whole element.
@group(0) @binding(2) var<storage, read> whole: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> transfer: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> group_sums: array<f32>;

var<workgroup> partial: array<f32, 704>; // TALLIES * 64

// Gain and offset of each element: those that bring g closest to f. Thread = element.
@compute @workgroup_size(64)
fn fit(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let e = group_number(group, groups) * 64u + thread;
    if e >= tally.n_elements {
        return;
    }
    let at = e * SUMS;
    let n = sums[at + N];
    let f = whole[e].y - sums[at + F_LOST];
    let g = sums[at + G];
    // Means taken out first: n g^2 - (sum g)^2 would subtract nearly equal numbers.
    let mean_g = g / max(n, 1.0);
    let variance = sums[at + GG] - g * mean_g;
    let covariance = sums[at + FG] - f * mean_g;
    // A flat element has no contrast to fit: keep the gain of 1.
    var gain = 1.0;
    if variance > 0.0 && covariance > 0.0 {
        gain = covariance / variance;
    }
    var offset = 0.0;
    if n > 0.0 {
        offset = (f - gain * g) / n;
    }
    transfer[e] = vec2<f32>(gain, offset);
}

// Workgroup = group of elements.
@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let mine = groups_of_elements[min(number, tally.n_groups - 1u)];
    var total: array<f32, TALLIES>;
    for (var k = thread; k < mine.count && number < tally.n_groups; k += 64u) {
        let e = mine.first + k;
        let at = e * SUMS;
        let all = whole[e];
        let times = floor(sums[at + OUT]);
        let was_out = sums[at + OUT] != times;
        let share = select(tally.kept_share, tally.back_share, was_out);
        let stays = was_out && times >= tally.stays_out;
        let n = sums[at + N];
        total[1] += all.x;
        if tally.own_transfer != 0u {
            total[9] += transfer[e].x;
            total[10] += transfer[e].y;
        }
        if sums[at + OUT] == EXCLUDED {
            for (var i = 0u; i < N; i++) {
                sums[at + i] = 0.0;
            }
            if n < tally.kept_share * all.x {
                sums[at + N] = 0.0;
            }
            total[8] += 2.0;
        } else if stays || n < share * all.x {
            for (var i = 0u; i < OUT; i++) {
                sums[at + i] = 0.0;
            }
            sums[at + F_LOST] = all.y;
            sums[at + FF_LOST] = all.z;
            sums[at + OUT] = select(times + 1.0, times, was_out) + 0.5;
            total[8] += 2.0;
        } else if all.x > 0.0 {
            sums[at + OUT] = times;
            total[0] += n;
            total[2] += all.y - sums[at + F_LOST];
            total[3] += all.z - sums[at + FF_LOST];
            total[4] += sums[at + G];
            total[5] += sums[at + GG];
            total[6] += sums[at + FG];
            total[7] += sums[at + RR];
            if n < tally.lossy_share * all.x {
                total[8] += 1.0;
            }
        }
    }
    for (var i = 0u; i < TALLIES; i++) {
        partial[64u * i + thread] = total[i];
    }
    workgroupBarrier();
    if thread < TALLIES && number < tally.n_groups {
        var sum = 0.0;
        for (var i = 0u; i < 64u; i++) {
            sum += partial[64u * thread + i];
        }
        group_sums[number * ROOM + thread] = sum;
    }
}
