// How far the residual of each element follows a displacement that bends within it (THEORY 19): sums over its pixels of
// r grad f times powers of z = 2 xi - 1 and w = 2 eta - 1, of r f, r and r^2. Twin: crates/dic/src/backend/cpu/bend.rs.
// LANES threads per element, each takes every LANES-th pixel of a row or a run.
#import types
#import index
#import q4
#import place
#import gradient
#import spline
#import light
#import lanes

@group(0) @binding(0) var<uniform> run: Pass;
@group(0) @binding(1) var<storage, read> reference: array<u32>;
@group(0) @binding(2) var<storage, read> deformed: array<f32>;
@group(0) @binding(3) var<storage, read> elements: array<Element>;
@group(0) @binding(4) var<storage, read> displacement: array<Displacement>;
@group(0) @binding(5) var<storage, read> transfer: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
// As in residual_runs.wgsl.
@group(0) @binding(7) var<storage, read> shape: array<u32>;

// Ten powers for both components of the gradient, then r f, r, r^2 and the pixels.
const QUANTITIES: u32 = 24u;
const STRIDE: u32 = QUANTITIES;
const POWERS: u32 = 10u;
var<workgroup> partial: array<f32, 1536>; // QUANTITIES * 64

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let slot = thread / LANES;
    let lane = thread % LANES;
    let at_element = group_number(group, groups) * (64u / LANES) + slot;
    let e = min(at_element, run.n_elements - 1u);
    let element = elements[e];
    let mine = at_element < run.n_elements
        && element.corner.y >= run.elements_from && element.corner.y < run.elements_to;
    // Times 1, z, w, z w; z^2, w^2, z^3, w^3; z^2 w, z w^2.
    var flat_x = vec4<f32>(0.0);
    var flat_y = vec4<f32>(0.0);
    var bent_x = vec4<f32>(0.0);
    var bent_y = vec4<f32>(0.0);
    var twisted_x = vec2<f32>(0.0);
    var twisted_y = vec2<f32>(0.0);
    var of_grey = vec4<f32>(0.0);
    if mine {
        let corners = corners_of(element.nodes);
        let zone = transfer[select(element.zone, e, run.own_transfer != 0u)];
        var light: Light;
        if LIGHT != 0u {
            light = light_of(element.nodes);
        }
        let is_runs = element.n_runs > 0u;
        let n_rows = select(element.size.y, element.n_runs, is_runs);
        for (var row = 0u; row < n_rows; row++) {
            var first = element.corner + vec2<i32>(0, i32(row));
            var n_columns = element.size.x;
            var points = 0u;
            if is_runs {
                let at_run = run.runs_at + 4u * (element.first_run + row);
                first = vec2<i32>(bitcast<i32>(shape[at_run]), bitcast<i32>(shape[at_run + 1u]));
                n_columns = shape[at_run + 2u];
                points = run.points_at + 2u * shape[at_run + 3u];
            }
            for (var column = lane; column < n_columns; column += LANES) {
                var local = element.local.xz + vec2<f32>(f32(column), f32(row)) * element.local.yw;
                if is_runs {
                    local = vec2<f32>(
                        bitcast<f32>(shape[points + 2u * column]),
                        bitcast<f32>(shape[points + 2u * column + 1u]),
                    );
                }
                let x = first.x + i32(column);
                let ux = along(corners.x, local.x, local.y);
                let uy = along(corners.y, local.x, local.y);
                let floor_x = whole_floor(ux);
                let floor_y = whole_floor(uy);
                let tx = ux - f32(floor_x);
                let ty = uy - f32(floor_y);
                let px = x + corners.whole.x + floor_x;
                let py = first.y + corners.whole.y + floor_y;
                let window = clamp(py, 0, run.image.y - 1);
                let weight = weight_on(px, tx, run.image.x) * weight_on(py, ty, run.image.y);
                if window >= run.floors_from && window < run.floors_to && weight > 0.0 {
                    let at_reference = 2 * (first.y - run.reference_first) * run.stride + x;
                    let f = bitcast<f32>(reference[at_reference]);
                    let at = (py - BEFORE + BORDER - run.deformed_first) * run.stride + px - BEFORE + BORDER;
                    var grey = interpolate(taps_at(at, run.stride), tx, ty);
                    if LIGHT != 0u {
                        grey = brought(light, local.x, local.y, grey);
                    }
                    let difference = (f - zone.y) - zone.x * grey;
                    let r = weight * difference;
                    let gradient = r * gradient_of(reference[at_reference + run.stride]);
                    let z = 2.0 * local.x - 1.0;
                    let w = 2.0 * local.y - 1.0;
                    let linear = vec4<f32>(1.0, z, w, z * w);
                    let squares = vec2<f32>(z * z, w * w);
                    let bent = vec4<f32>(squares, z * squares.x, w * squares.y);
                    let twisted = squares * vec2<f32>(w, z);
                    flat_x += gradient.x * linear;
                    flat_y += gradient.y * linear;
                    bent_x += gradient.x * bent;
                    bent_y += gradient.y * bent;
                    twisted_x += gradient.x * twisted;
                    twisted_y += gradient.y * twisted;
                    of_grey += vec4<f32>(r * f, r, r * difference, weight);
                }
            }
        }
    }
    for (var k = 0u; k < 4u; k++) {
        partial[64u * k + thread] = run.unit * flat_x[k];
        partial[64u * (k + POWERS) + thread] = run.unit * flat_y[k];
        partial[64u * (k + 4u) + thread] = run.unit * bent_x[k];
        partial[64u * (k + 4u + POWERS) + thread] = run.unit * bent_y[k];
        partial[64u * (k + 2u * POWERS) + thread] = of_grey[k];
    }
    for (var k = 0u; k < 2u; k++) {
        partial[64u * (k + 8u) + thread] = run.unit * twisted_x[k];
        partial[64u * (k + 8u + POWERS) + thread] = run.unit * twisted_y[k];
    }
    workgroupBarrier();
    if mine {
        add_up(e, slot, lane);
    }
}
