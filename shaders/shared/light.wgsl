// Light that changes over the specimen: gain and offset at the corners of an element. Twin: `Light` in
// crates/dic/src/backend/cpu/corners.rs. The kernel declares `transfer`.
#import q4

// Where in `transfer` the light of the nodes begins; 0: there is none, and a compiler leaves all of this out.
override LIGHT: u32 = 0u;

struct Light {
    gain: vec4<f32>,
    offset: vec4<f32>,
}

fn light_of(nodes: vec4<u32>) -> Light {
    let a = transfer[LIGHT + nodes.x];
    let b = transfer[LIGHT + nodes.y];
    let c = transfer[LIGHT + nodes.z];
    let d = transfer[LIGHT + nodes.w];
    return Light(vec4<f32>(a.x, b.x, c.x, d.x), vec4<f32>(a.y, b.y, c.y, d.y));
}

// A grey level of the deformed image, brought to the light of the reference.
fn brought(light: Light, xi: f32, eta: f32, grey: f32) -> f32 {
    return along(light.gain, xi, eta) * grey + along(light.offset, xi, eta);
}
