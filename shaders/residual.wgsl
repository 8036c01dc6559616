// Residual and right-hand side of the elements that are rectangles of pixels, in one pass (THEORY 2):
// b_i = sum (psi_i . grad f)(f - gain g(X + u) - offset). Twin: crates/dic/src/backend/cpu/residual.rs.
// Thread = pixel column of an element, LANES of them side by side; a workgroup holds 64 / LANES elements. A
// thread goes down its column with the taps in registers; the weights in xi come once, at the end.
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

// No pixel lies there, nor one row below.
const FAR: i32 = -1000000000;

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
    let mine = at_element < run.n_elements && element.n_runs == 0u
        && element.corner.y >= run.elements_from && element.corner.y < run.elements_to;
    var near_left = vec2<f32>(0.0);
    var near_right = vec2<f32>(0.0);
    var far_right = vec2<f32>(0.0);
    var far_left = vec2<f32>(0.0);
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
        for (var column = lane; column < element.size.x; column += LANES) {
            let x = element.corner.x + i32(column);
            let xi = element.local.x + f32(column) * element.local.y;
            var at_reference = 2 * (element.corner.y - run.reference_first) * run.stride + x;
            var whole = vec2<f32>(0.0);
            var far = vec2<f32>(0.0);
            var taps: Taps;
            var taps_place = vec2<i32>(FAR); // pixel that the taps are around: none yet
            for (var row = 0u; row < element.size.y; row++) {
                let eta = element.local.z + f32(row) * element.local.w;
                let ux = along(corners.x, xi, eta);
                let uy = along(corners.y, xi, eta);
                let floor_x = whole_floor(ux);
                let floor_y = whole_floor(uy);
                let tx = ux - f32(floor_x);
                let ty = uy - f32(floor_y);
                let px = x + corners.whole.x + floor_x;
                let py = element.corner.y + i32(row) + corners.whole.y + floor_y;
                let window = clamp(py, 0, run.image.y - 1);
                if window >= run.floors_from && window < run.floors_to {
                    let f = bitcast<f32>(reference[at_reference]);
                    let weight = weight_on(px, tx, run.image.x) * weight_on(py, ty, run.image.y);
                    if weight > 0.0 {
                        let at = (py - BEFORE + BORDER - run.deformed_first) * run.stride + px - BEFORE + BORDER;
                        // Going down, one row of taps is missing, or none; all after a step to the side. A loop: as
                        // two branches, software devices would load for both.
                        let place = vec2<i32>(px, py);
                        var missing = py - taps_place.y;
                        if px != taps_place.x || missing < 0 || missing > TAPS {
                            missing = TAPS;
                        }
                        for (; missing > 0; missing--) {
                            taps = taps_below(taps, at + (TAPS - missing) * run.stride);
                        }
                        taps_place = place;
                        var grey = interpolate(taps, tx, ty);
                        if LIGHT != 0u {
                            grey = brought(light, xi, eta, grey);
                        }
                        let difference = (f - zone.y) - zone.x * grey;
                        let r = weight * difference;
                        let gradient = gradient_of(reference[at_reference + run.stride]);
                        whole += r * gradient;
                        far += (eta * r) * gradient;
                        rr += r * difference;
                        n += weight;
                        g += weight * grey;
                        gg += weight * grey * grey;
                        fg += weight * grey * f;
                    }
                    lost += (1.0 - weight) * vec2<f32>(f, f * f);
                }
                at_reference += 2 * run.stride;
            }
            let near = whole - far;
            near_right += xi * near;
            near_left += near - xi * near;
            far_right += xi * far;
            far_left += far - xi * far;
        }
    }
    near_left *= run.unit;
    near_right *= run.unit;
    far_right *= run.unit;
    far_left *= run.unit;
    partial[thread] = near_left.x;
    partial[64u + thread] = near_left.y;
    partial[128u + thread] = near_right.x;
    partial[192u + thread] = near_right.y;
    partial[256u + thread] = far_right.x;
    partial[320u + thread] = far_right.y;
    partial[384u + thread] = far_left.x;
    partial[448u + thread] = far_left.y;
    keep(thread, vec4<f32>(n, rr, g, gg), fg, lost);
    workgroupBarrier();
    if mine {
        add_up(e, slot, lane);
    }
}
