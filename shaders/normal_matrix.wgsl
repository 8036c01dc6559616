// Moments of the reference gradient per element, from which the normal matrices M_ij = sum (psi_i . grad f)
// (psi_j . grad f) are made (THEORY 2): 27 sums instead of the 36 entries, and those that couple with a gain
// and offset. Twin: crates/dic/src/backend/cpu/normal_matrix.rs.
// 16 threads per element, each takes every 16th column of each of its rows.
#import types
#import index
#import q4
#import place
#import gradient

@group(0) @binding(0) var<uniform> run: Pass;
@group(0) @binding(1) var<storage, read> reference: array<u32>;
@group(0) @binding(2) var<storage, read> elements: array<Element>;
@group(0) @binding(3) var<storage, read> displacement: array<Displacement>;
@group(0) @binding(4) var<storage, read> shape: array<u32>;
// The elements of this dispatch, by number.
@group(0) @binding(5) var<storage, read> list: array<u32>;
@group(0) @binding(6) var<storage, read_write> moments: array<f32>;

const LANES: u32 = 16u;
// 27 moments, pixels, sum of f and of f^2, 8 + 8 coupling sums; padded.
const QUANTITIES: u32 = 46u;
const MOMENTS: u32 = 48u;
var<workgroup> partial: array<f32, 2944>; // QUANTITIES * 64

// Sums of fx fx, fx fy, fy fy by weight in eta, their components by weight in xi. Single variables: a device
// keeps an array that is indexed by a loop in memory.
var<private> xx_near: vec3<f32>;
var<private> xx_middle: vec3<f32>;
var<private> xx_far: vec3<f32>;
var<private> xy_near: vec3<f32>;
var<private> xy_middle: vec3<f32>;
var<private> xy_far: vec3<f32>;
var<private> yy_near: vec3<f32>;
var<private> yy_middle: vec3<f32>;
var<private> yy_far: vec3<f32>;
var<private> counts: vec3<f32>;
// psi fx, psi fy times f and times 1: for elements with a gain and offset of their own.
var<private> x_with_f: vec4<f32>;
var<private> y_with_f: vec4<f32>;
var<private> x_with_one: vec4<f32>;
var<private> y_with_one: vec4<f32>;

fn add_pixel(at: i32, xi: f32, eta: f32, weight: f32) {
    let f = bitcast<f32>(reference[at]);
    let gradient = gradient_of(reference[at + run.stride]);
    let fx = gradient.x;
    let fy = gradient.y;
    let wx = weight * vec3<f32>((1.0 - xi) * (1.0 - xi), xi * (1.0 - xi), xi * xi);
    let near = (1.0 - eta) * (1.0 - eta);
    let middle = eta * (1.0 - eta);
    let far = eta * eta;
    xx_near += (fx * fx * near) * wx;
    xx_middle += (fx * fx * middle) * wx;
    xx_far += (fx * fx * far) * wx;
    xy_near += (fx * fy * near) * wx;
    xy_middle += (fx * fy * middle) * wx;
    xy_far += (fx * fy * far) * wx;
    yy_near += (fy * fy * near) * wx;
    yy_middle += (fy * fy * middle) * wx;
    yy_far += (fy * fy * far) * wx;
    counts += weight * vec3<f32>(1.0, f, f * f);
    if run.own_transfer != 0u {
        let psi = weight * shape_functions(xi, eta);
        x_with_f += (fx * f) * psi;
        y_with_f += (fy * f) * psi;
        x_with_one += fx * psi;
        y_with_one += fy * psi;
    }
}

fn store3(k: u32, thread: u32, sums: vec3<f32>) {
    partial[k * 64u + thread] = sums.x;
    partial[(k + 1u) * 64u + thread] = sums.y;
    partial[(k + 2u) * 64u + thread] = sums.z;
}

// Every second of eight, from `k` on.
fn store4(k: u32, thread: u32, sums: vec4<f32>) {
    partial[k * 64u + thread] = sums.x;
    partial[(k + 2u) * 64u + thread] = sums.y;
    partial[(k + 4u) * 64u + thread] = sums.z;
    partial[(k + 6u) * 64u + thread] = sums.w;
}

fn weight_of(corners: Corners, x: i32, y: i32, xi: f32, eta: f32) -> f32 {
    let ux = along(corners.x, xi, eta);
    let uy = along(corners.y, xi, eta);
    let floor_x = whole_floor(ux);
    let floor_y = whole_floor(uy);
    return weight_on(x + corners.whole.x + floor_x, ux - f32(floor_x), run.image.x)
        * weight_on(y + corners.whole.y + floor_y, uy - f32(floor_y), run.image.y);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let slot = thread / LANES;
    let lane = thread % LANES;
    let listed = group_number(group, groups) * (64u / LANES) + slot;
    let element = elements[list[min(listed, run.n_listed - 1u)]];
    let mine = listed < run.n_listed
        && element.corner.y >= run.elements_from && element.corner.y < run.elements_to;
    if mine {
        let weighted = run.weighted != 0u;
        var corners: Corners;
        if weighted {
            corners = corners_of(element.nodes);
        }
        let rows = select(element.size.y, element.n_runs, element.n_runs > 0u);
        for (var row = 0u; row < rows; row++) {
            var x0 = element.corner.x;
            var y = element.corner.y + i32(row);
            var columns = element.size.x;
            var at_point = 0u;
            if element.n_runs > 0u {
                let at_run = run.runs_at + 4u * (element.first_run + row);
                x0 = bitcast<i32>(shape[at_run]);
                y = bitcast<i32>(shape[at_run + 1u]);
                columns = shape[at_run + 2u];
                at_point = run.points_at + 2u * shape[at_run + 3u];
            }
            for (var column = lane; column < columns; column += LANES) {
                var xi = element.local.x + f32(column) * element.local.y;
                var eta = element.local.z + f32(row) * element.local.w;
                if element.n_runs > 0u {
                    xi = bitcast<f32>(shape[at_point + 2u * column]);
                    eta = bitcast<f32>(shape[at_point + 2u * column + 1u]);
                }
                let x = x0 + i32(column);
                var weight = 1.0;
                if weighted {
                    weight = weight_of(corners, x, y, xi, eta);
                }
                add_pixel(2 * (y - run.reference_first) * run.stride + x, xi, eta, weight);
            }
        }
    }
    store3(0u, thread, xx_near);
    store3(3u, thread, xx_middle);
    store3(6u, thread, xx_far);
    store3(9u, thread, xy_near);
    store3(12u, thread, xy_middle);
    store3(15u, thread, xy_far);
    store3(18u, thread, yy_near);
    store3(21u, thread, yy_middle);
    store3(24u, thread, yy_far);
    store3(27u, thread, counts);
    // Unknown 2 a + c of corner a: times f, then times 1.
    store4(30u, thread, x_with_f);
    store4(31u, thread, y_with_f);
    store4(38u, thread, x_with_one);
    store4(39u, thread, y_with_one);
    workgroupBarrier();
    if mine {
        for (var k = lane; k < QUANTITIES; k += LANES) {
            var sum = 0.0;
            for (var i = 0u; i < LANES; i++) {
                sum += partial[64u * k + slot * LANES + i];
            }
            moments[listed * MOMENTS + k] = sum;
        }
    }
}
