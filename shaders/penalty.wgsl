// Takes what a regularisation asks for off the right-hand side, r -= w R a, and starts the conjugate gradients
// from there. Twin: `Solver::correction` in crates/base/src/linalg/solver.rs. Thread = node.
// The penalty of a displacement that is the same everywhere is none, so that R acts on differences to the node
// itself: no digit is lost to a large motion.
#import types
#import cg

@group(0) @binding(0) var<uniform> cg: Cg;
// Where each node's row of blocks begins; then their columns.
@group(0) @binding(1) var<storage, read> pattern: array<u32>;
@group(0) @binding(2) var<storage, read> blocks: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> displacement: array<Displacement>;
@group(0) @binding(4) var<storage, read> jacobi: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> residual: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> preconditioned: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups) + cg.first_node / 256u;
    let node = number * 256u + thread;
    var product = 0.0;
    if node < cg.last_node {
        let here = displacement[node];
        var r = residual[node];
        for (var k = pattern[node]; k < pattern[node + 1u]; k++) {
            let there = displacement[pattern[k]];
            let v = vec2<f32>(there.whole - here.whole) + (there.rest - here.rest);
            let block = blocks[k - (cg.n_nodes + 1u) - cg.first_block];
            r -= vec2<f32>(block.x * v.x + block.y * v.y, block.z * v.x + block.w * v.y);
        }
        let d = jacobi[node];
        let z = vec2<f32>(d.x * r.x + d.y * r.y, d.y * r.x + d.z * r.y);
        residual[node] = r;
        preconditioned[node] = z;
        product = dot(r, z);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < cg.last_node {
        products[number] = sum;
    }
}
