// The field plus the correction, relaxed, turned and damped by `(cos, sin)`, and the largest component of the correction. Thread = node.
// How far a node is moved, the fall of its last correction tells: twin in crates/dic/src/backend/relaxation.rs.
// The correction is for the residual before the transfer of its zone changed: less what that change moves (THEORY 2).
#import types
#import index
#import step

struct Correct {
    n_nodes: u32,
    // Damping times cosine and sine of the angle that the correction is turned by.
    cos: f32,
    sin: f32,
    coupled: u32,
    // Where in `relaxation` those of the step before begin, or NOTHING, and those of this one.
    before_first: u32,
    first: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> correct: Correct;
@group(0) @binding(1) var<storage, read> solution: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> displacement: array<Displacement>;
@group(0) @binding(3) var<storage, read_write> worst: array<Worst>;
// Displacements by a gain and by an offset of the zone.
@group(0) @binding(4) var<storage, read> responses: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> node_zone: array<u32>;
@group(0) @binding(6) var<storage, read> change: array<vec2<f32>>;
// Corrections, and what they were multiplied by.
@group(0) @binding(7) var<storage, read_write> relaxation: array<vec4<f32>>;
// Where the nodes were.
@group(0) @binding(8) var<storage, read_write> before: array<Displacement>;

const NOTHING: u32 = 0xffffffffu;
const SHORTEST: f32 = 0.6;
const LONGEST: f32 = 1.1;
const LEAST_LEFT: f32 = 0.1;
const FARTHEST: f32 = 0.25;

var<workgroup> bits: array<u32, 256>;
// The largest of sixteen neighbours, and which it is.
var<workgroup> largest_bits: array<u32, 16>;
var<workgroup> largest_at: array<u32, 16>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let node = number * 256u + thread;
    bits[thread] = 0u;
    if node < correct.n_nodes {
        var du = solution[node];
        if correct.coupled != 0u {
            let of_zone = change[node_zone[node]];
            let by = responses[node];
            du -= of_zone.x * by.xy + of_zone.y * by.zw;
        }
        var factor = 1.0;
        if correct.before_first != NOTHING {
            let earlier = relaxation[correct.before_first + node];
            let squares = dot(earlier.xy, earlier.xy);
            // A node that was not moved has no rate, and one that was far off tells nothing by it.
            if squares > 0.0 && squares <= FARTHEST * FARTHEST {
                let rate = dot(earlier.xy, du) / squares;
                factor = clamp(earlier.z / max(1.0 - rate, LEAST_LEFT), SHORTEST, LONGEST);
            }
        }
        relaxation[correct.first + node] = vec4<f32>(du, factor * length(vec2<f32>(correct.cos, correct.sin)), 0.0);
        let by = factor * du;
        let u = displacement[node];
        before[node] = u;
        let turned = vec2<f32>(correct.cos * by.x - correct.sin * by.y, correct.cos * by.y + correct.sin * by.x);
        let moved = u.rest + turned;
        let floors = clamp(floor(moved), vec2<f32>(-1e6), vec2<f32>(1e6));
        displacement[node].whole = clamp(u.whole + vec2<i32>(floors), vec2<i32>(-1000000), vec2<i32>(1000000));
        displacement[node].rest = moved - floors;
        // As bits, what is no number is larger than any that is.
        let size = bitcast<vec2<u32>>(abs(du));
        bits[thread] = max(size.x, size.y);
    }
    workgroupBarrier();
    if thread < 16u {
        var largest = 0u;
        var at = 16u * thread;
        for (var i = at; i < 16u * thread + 16u; i++) {
            if bits[i] > largest {
                largest = bits[i];
                at = i;
            }
        }
        largest_bits[thread] = largest;
        largest_at[thread] = at;
    }
    workgroupBarrier();
    if thread == 0u && number * 256u < correct.n_nodes {
        var largest = largest_bits[0];
        var at = largest_at[0];
        for (var i = 1u; i < 16u; i++) {
            if largest_bits[i] > largest {
                largest = largest_bits[i];
                at = largest_at[i];
            }
        }
        worst[number] = Worst(largest, number * 256u + at);
    }
}
