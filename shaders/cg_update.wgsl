// Conjugate gradients, second half of an iteration: x += alpha p, r -= alpha q, z = D r, r . z.
// Twin: crates/base/src/linalg/conjugate_gradients.rs. Thread = node.
#import cg

@group(0) @binding(0) var<uniform> cg: Cg;
// Inverse nodal blocks xx, xy, yy; zero for a node that is held.
@group(0) @binding(1) var<storage, read> jacobi: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> direction: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> image: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> solution: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> residual: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> preconditioned: array<vec2<f32>>;
// Partial sums: of r . z before each iteration and after the last in even rows, of p . q in odd ones.
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rz = total(2u * cg.iteration, thread);
    let pq = total(2u * cg.iteration + 1u, thread);
    // Not positive definite along p, or solved: what is reached so far stands.
    var alpha = 0.0;
    if pq > 0.0 {
        alpha = rz / pq;
    }
    let number = group_number(group, groups);
    let node = number * 256u + thread;
    var product = 0.0;
    if node < cg.n_nodes {
        let r = residual[node] - alpha * image[node];
        let d = jacobi[node];
        let z = vec2<f32>(d.x * r.x + d.y * r.y, d.y * r.x + d.z * r.y);
        solution[node] += alpha * direction[node];
        residual[node] = r;
        preconditioned[node] = z;
        product = dot(r, z);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < cg.n_nodes {
        products[(2u * cg.iteration + 2u) * cg.n_partial + number] = sum;
    }
}
