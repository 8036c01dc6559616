// Conjugate gradients, first half of an iteration: p = z + beta p, q = A p, p . q. The product needs p of the
// neighbours, so each thread makes those anew from the old one. Twin: crates/base/src/linalg/conjugate_gradients.rs.
// Thread = node.
#import cg

@group(0) @binding(0) var<uniform> cg: Cg;
// Where each node's row of blocks begins; then their columns.
@group(0) @binding(1) var<storage, read> pattern: array<u32>;
@group(0) @binding(2) var<storage, read> blocks: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> preconditioned: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> old_direction: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> direction: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> image: array<vec2<f32>>;
// Partial sums: of r . z before each iteration and after the last in even rows, of p . q in odd ones.
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    var beta = 0.0;
    if cg.iteration > 0u {
        let before = total(2u * cg.iteration - 2u, thread);
        let now = total(2u * cg.iteration, thread);
        if before > 0.0 {
            beta = now / before;
        }
    }
    let number = group_number(group, groups) + cg.first_node / 256u;
    let node = number * 256u + thread;
    var product = 0.0;
    if node < cg.last_node {
        let p = preconditioned[node] + beta * old_direction[node];
        var q = vec2<f32>(0.0);
        for (var k = pattern[node]; k < pattern[node + 1u]; k++) {
            let other = pattern[k];
            let v = preconditioned[other] + beta * old_direction[other];
            let block = blocks[k - (cg.n_nodes + 1u) - cg.first_block];
            q += vec2<f32>(block.x * v.x + block.y * v.y, block.z * v.x + block.w * v.y);
        }
        direction[node] = p;
        image[node] = q;
        product = dot(p, q);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < cg.last_node {
        products[(2u * cg.iteration + 1u) * cg.n_partial + number] = sum;
    }
}
