// Residual and right-hand side of the elements whose pixels are runs with local coordinates of their own: cut
// by a mask, or of any shape. Twin: `run_sums` in crates/dic/src/backend/cpu/residual_runs.rs.
// LANES threads per element, each takes every LANES-th pixel of a run.
#import types
#import index
#import q4
#import place
#import gradient
#import spline
#import sums
#import light

@group(0) @binding(0) var<uniform> run: Pass;
@group(0) @binding(1) var<storage, read> reference: array<u32>;
@group(0) @binding(2) var<storage, read> deformed: array<f32>;
@group(0) @binding(3) var<storage, read> elements: array<Element>;
@group(0) @binding(4) var<storage, read> displacement: array<Displacement>;
@group(0) @binding(5) var<storage, read> transfer: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;
// Numbers of these elements; runs of four (column, row, pixels, first point); points of two (xi, eta).
@group(0) @binding(7) var<storage, read> shape: array<u32>;


@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let slot = thread / LANES;
    let lane = thread % LANES;
    let listed = group_number(group, groups) * (64u / LANES) + slot;
    let e = shape[min(listed, run.n_listed - 1u)];
    let element = elements[e];
    let mine = listed < run.n_listed
        && element.corner.y >= run.elements_from && element.corner.y < run.elements_to;
    var bx = vec4<f32>(0.0);
    var by = vec4<f32>(0.0);
    var n = 0.0;
    var rr = 0.0;
    var g = 0.0;
    var gg = 0.0;
    var fg = 0.0;
    var lost = vec2<f32>(0.0);
    if mine {
        let corners = corners_of(element.nodes);
        let zone = transfer[select(element.zone, e, run.own_transfer != 0u)];
        var light: Light;
        if LIGHT != 0u {
            light = light_of(element.nodes);
        }
        for (var k = 0u; k < element.n_runs; k++) {
            let at_run = run.runs_at + 4u * (element.first_run + k);
            let y = bitcast<i32>(shape[at_run + 1u]);
            for (var column = lane; column < shape[at_run + 2u]; column += LANES) {
                let x = bitcast<i32>(shape[at_run]) + i32(column);
                let at_point = run.points_at + 2u * (shape[at_run + 3u] + column);
                let xi = bitcast<f32>(shape[at_point]);
                let eta = bitcast<f32>(shape[at_point + 1u]);
                let ux = along(corners.x, xi, eta);
                let uy = along(corners.y, xi, eta);
                let floor_x = whole_floor(ux);
                let floor_y = whole_floor(uy);
                let tx = ux - f32(floor_x);
                let ty = uy - f32(floor_y);
                let px = x + corners.whole.x + floor_x;
                let py = y + corners.whole.y + floor_y;
                let window = clamp(py, 0, run.image.y - 1);
                if window >= run.floors_from && window < run.floors_to {
                    let at_reference = 2 * (y - run.reference_first) * run.stride + x;
                    let f = bitcast<f32>(reference[at_reference]);
                    let weight = weight_on(px, tx, run.image.x) * weight_on(py, ty, run.image.y);
                    if weight > 0.0 {
                        let at = (py - BEFORE + BORDER - run.deformed_first) * run.stride + px - BEFORE + BORDER;
                        var grey = interpolate(taps_at(at, run.stride), tx, ty);
                        if LIGHT != 0u {
                            grey = brought(light, xi, eta, grey);
                        }
                        let difference = (f - zone.y) - zone.x * grey;
                        let r = weight * difference;
                        let psi = shape_functions(xi, eta);
                        let gradient = gradient_of(reference[at_reference + run.stride]);
                        bx += psi * (r * gradient.x);
                        by += psi * (r * gradient.y);
                        rr += r * difference;
                        n += weight;
                        g += weight * grey;
                        gg += weight * grey * grey;
                        fg += weight * grey * f;
                    }
                    lost += (1.0 - weight) * vec2<f32>(f, f * f);
                }
            }
        }
    }
    for (var a = 0u; a < 4u; a++) {
        partial[128u * a + thread] = run.unit * bx[a];
        partial[128u * a + 64u + thread] = run.unit * by[a];
    }
    keep(thread, vec4<f32>(n, rr, g, gg), fg, lost);
    workgroupBarrier();
    if mine {
        add_up(e, slot, lane);
    }
}
