// The right-hand side of every node from its elements, in element order, and the start of the conjugate
// gradients. Twins: `Pattern::gather` in crates/base/src/linalg/blocks.rs, crates/base/src/linalg/conjugate_gradients.rs.
// Thread = node.
#import types
#import index
#import reduce

struct Gather {
    n_nodes: u32,
    unused0: u32,
    unused1: u32,
    unused2: u32,
}

@group(0) @binding(0) var<uniform> gather: Gather;
// Where each node's elements begin; then 4 element + corner of each, element by element.
@group(0) @binding(1) var<storage, read> incidence: array<u32>;
@group(0) @binding(2) var<storage, read> sums: array<f32>;
// Inverse nodal blocks xx, xy, yy; zero for a node that is held.
@group(0) @binding(3) var<storage, read> jacobi: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> residual: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> preconditioned: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> solution: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let node = number * 256u + thread;
    var product = 0.0;
    if node < gather.n_nodes {
        var b = vec2<f32>(0.0);
        for (var k = incidence[node]; k < incidence[node + 1u]; k++) {
            let place = incidence[k];
            let at = (place >> 2u) * SUMS + 2u * (place & 3u);
            b += vec2<f32>(sums[at], sums[at + 1u]);
        }
        let d = jacobi[node];
        let z = vec2<f32>(d.x * b.x + d.y * b.y, d.y * b.x + d.z * b.y);
        residual[node] = b;
        preconditioned[node] = z;
        solution[node] = vec2<f32>(0.0);
        product = dot(b, z);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < gather.n_nodes {
        products[number] = sum;
    }
}
