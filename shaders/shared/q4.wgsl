// The displacement inside an element. Twin: `Corners` in crates/dic/src/backend/cpu/corners.rs.
#import types

// Displacement of the corners: whole pixels plus the rest, within 0..1 at the element's centre.
struct Corners {
    whole: vec2<i32>,
    x: vec4<f32>,
    y: vec4<f32>,
}

fn corners_of(nodes: vec4<u32>) -> Corners {
    let a = displacement[nodes.x];
    let b = displacement[nodes.y];
    let c = displacement[nodes.z];
    let d = displacement[nodes.w];
    let ub = vec2<f32>(b.whole - a.whole) + b.rest;
    let uc = vec2<f32>(c.whole - a.whole) + c.rest;
    let ud = vec2<f32>(d.whole - a.whole) + d.rest;
    let floors = floor(0.25 * ((a.rest + ub) + (uc + ud)));
    return Corners(
        a.whole + vec2<i32>(floors),
        vec4<f32>(a.rest.x, ub.x, uc.x, ud.x) - floors.x,
        vec4<f32>(a.rest.y, ub.y, uc.y, ud.y) - floors.y,
    );
}

// Displacement (less the whole offset) at a point of the element.
fn along(corner: vec4<f32>, xi: f32, eta: f32) -> f32 {
    let left = corner.x + eta * (corner.w - corner.x);
    let right = corner.y + eta * (corner.z - corner.y);
    return left + xi * (right - left);
}

fn shape_functions(xi: f32, eta: f32) -> vec4<f32> {
    return vec4<f32>((1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), xi * eta, (1.0 - xi) * eta);
}
