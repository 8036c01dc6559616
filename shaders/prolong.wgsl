// The field on the nodes of a level from that of the next coarser one, whose pixels are twice as large.
// Twin: `start_finer` in crates/dic/src/backend/cpu/mod.rs. Thread = node.
#import types
#import index

struct Place {
    nodes: vec4<u32>,
    weights: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> places: array<Place>;
@group(0) @binding(1) var<storage, read> coarse: array<Displacement>;
@group(0) @binding(2) var<storage, read_write> displacement: array<Displacement>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let node = group_number(group, groups) * 256u + thread;
    if node >= arrayLength(&displacement) {
        return;
    }
    let place = places[node];
    let a = coarse[place.nodes.x];
    let b = coarse[place.nodes.y];
    let c = coarse[place.nodes.z];
    let d = coarse[place.nodes.w];
    // The weights add up to one: relative to the first node no digit is lost.
    var u = a.rest;
    u += place.weights.y * (vec2<f32>(b.whole - a.whole) + (b.rest - a.rest));
    u += place.weights.z * (vec2<f32>(c.whole - a.whole) + (c.rest - a.rest));
    u += place.weights.w * (vec2<f32>(d.whole - a.whole) + (d.rest - a.rest));
    u = clamp(2.0 * u, vec2<f32>(-1e6), vec2<f32>(1e6));
    let floors = floor(u);
    displacement[node] = Displacement(2 * a.whole + vec2<i32>(floors), u - floors);
}
