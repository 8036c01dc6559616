// The end of a step: the largest component of its correction, and whether the next one of its batch is made before the host has seen it.
// Where it is not, the kernels of that one run on no workgroups. One workgroup. Twin: `Ahead` in crates/dic/src/backend/mod.rs.
#import step

struct Largest {
    // Partial results.
    n_worst: u32,
    // Number of the step in its batch, from 0.
    at: u32,
    // Bounds within which another step may follow: elements lost,
    lost: f32,
    // sizes of dispatches in use,
    n_sizes: u32,
    // bits of the largest correction, at least and less than,
    correction: vec2<u32>,
    // and pixels counted, at least and at most.
    counted: vec2<f32>,
    // Workgroups along x and y of dispatches of a step.
    sizes: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> largest: Largest;
@group(0) @binding(1) var<storage, read> worst: array<Worst>;
@group(0) @binding(2) var<storage, read_write> steps: array<Step>;
// Workgroups of the dispatches of the next step, three numbers each.
@group(0) @binding(3) var<storage, read_write> groups: array<u32>;

var<workgroup> worst_bits: array<u32, 64>;
var<workgroup> worst_node: array<u32, 64>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) thread: u32) {
    var bits = 0u;
    var node = 0u;
    for (var k = thread; k < largest.n_worst; k += 64u) {
        if worst[k].bits > bits {
            bits = worst[k].bits;
            node = worst[k].node;
        }
    }
    worst_bits[thread] = bits;
    worst_node[thread] = node;
    workgroupBarrier();
    if thread == 0u {
        for (var i = 1u; i < 64u; i++) {
            if worst_bits[i] > bits || (worst_bits[i] == bits && worst_node[i] < node) {
                bits = worst_bits[i];
                node = worst_node[i];
            }
        }
        let at = largest.at;
        var made = true;
        if at > 0u {
            made = steps[at - 1u].goes_on != 0u;
        }
        var goes_on = false;
        if made {
            steps[at].worst = Worst(bits, node);
            let counted = steps[at].counted;
            goes_on = bits >= largest.correction.x && bits < largest.correction.y && abs(steps[at].lossy - largest.lost) < 0.5
                && counted >= largest.counted.x && counted <= largest.counted.y;
        }
        steps[at].made = select(0u, 1u, made);
        steps[at].goes_on = select(0u, 1u, goes_on);
        for (var k = 0u; k < largest.n_sizes; k++) {
            groups[3u * k] = select(0u, largest.sizes[k].x, goes_on);
            groups[3u * k + 1u] = select(0u, largest.sizes[k].y, goes_on);
            groups[3u * k + 2u] = 1u;
        }
    }
}
