// Copies one buffer into another, one more in every word, so that what arrives after many tells how often: the rate at
// which kernels reach the memory, where a driver's own copies may be slower. Thread = four words.
#import index

@group(0) @binding(0) var<storage, read> source: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> copied: array<vec4<u32>>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let at = group_number(group, groups) * 256u + thread;
    if at < arrayLength(&copied) {
        copied[at] = source[at] + 1u;
    }
}
