// The files of `shaders/` (a page that is opened as a file cannot read others), what each kernel binds, its constants, and where the
// fields of its structs lie. Written, and compared, by tests/correlation/web.rs: QUADRILLE_BLESS=1 cargo test --test correlation web::
'use strict';

const SHADERS = {
  unpack: {
    file: 'unpack',
    entry: 'main',
    bindings: ['uniform', 'read', 'write'],
    constants: {  },
  },
  downsample: {
    file: 'downsample',
    entry: 'main',
    bindings: ['uniform', 'read', 'write'],
    constants: {  },
  },
  prefilter: {
    file: 'prefilter',
    entry: 'main',
    bindings: ['uniform', 'read', 'write'],
    constants: { LINES: 64, LENGTH: 32, PITCH: 33 },
  },
  border_columns: {
    file: 'border',
    entry: 'columns',
    bindings: ['uniform', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15 },
  },
  border_rows: {
    file: 'border',
    entry: 'rows',
    bindings: ['uniform', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15 },
  },
  gradient: {
    file: 'gradient',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15, ROWS: 16 },
  },
  normal_matrix: {
    file: 'normal_matrix',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'read', 'read', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15, LANES: 16, QUANTITIES: 46, MOMENTS: 48 },
  },
  residual: {
    file: 'residual',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'read', 'read', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15, BEFORE: 1, TAPS: 4, QUANTITIES: 15, FAR: -1000000000 },
  },
  tally: {
    file: 'tally',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'write', 'write', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15, TALLIES: 11, ROOM: 12 },
  },
  gather: {
    file: 'gather',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'write', 'write', 'write', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15 },
  },
  cg_product: {
    file: 'cg_product',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'read', 'write', 'write', 'write'],
    constants: {  },
  },
  cg_update: {
    file: 'cg_update',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'write', 'write', 'write', 'write'],
    constants: {  },
  },
  correct: {
    file: 'correct',
    entry: 'main',
    bindings: ['uniform', 'read', 'write', 'write', 'read', 'read', 'read', 'write', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15, NOTHING: 4294967295 },
  },
  summary: {
    file: 'summary',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'write', 'write', 'write', 'write'],
    constants: { TALLIES: 11, ROOM: 12, OFF: 0, ZONE: 1, ELEMENT: 2 },
  },
  largest: {
    file: 'largest',
    entry: 'main',
    bindings: ['uniform', 'read', 'write', 'write'],
    constants: {  },
  },
  prolong: {
    file: 'prolong',
    entry: 'main',
    bindings: ['read', 'read', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15 },
  },
  residual_map: {
    file: 'residual_map',
    entry: 'main',
    bindings: ['uniform', 'read', 'read', 'read', 'write'],
    constants: { BORDER: 4, SUMS: 16, N: 8, RR: 9, G: 10, GG: 11, FG: 12, F_LOST: 13, FF_LOST: 14, OUT: 15 },
  },
};

const FILES = {
  'border': `// The border of a plane: continued through the outermost pixels, c(-k) = 2 c(0) - c(k), first along the rows,
// then along the columns with the corners. Twin: \`continue_border\` in src/backend/cpu/plane.rs.
#import types

struct Border {
    width: i32,
    height: i32,
    stride: i32,
    // Row of the plane, border included, that the binding begins with, and image rows of this dispatch.
    first: i32,
    begin: i32,
    end: i32,
    unused: vec2<i32>,
}

@group(0) @binding(0) var<uniform> border: Border;
@group(0) @binding(1) var<storage, read_write> plane: array<f32>;

fn place(x: i32, y: i32) -> i32 {
    return (y + BORDER - border.first) * border.stride + x + BORDER;
}

// Thread = row.
@compute @workgroup_size(64)
fn columns(@builtin(global_invocation_id) id: vec3<u32>) {
    let y = border.begin + i32(id.x);
    if y >= border.end {
        return;
    }
    let last = border.width - 1;
    for (var k = 1; k <= BORDER; k++) {
        let inner = min(k, last);
        plane[place(-k, y)] = 2.0 * plane[place(0, y)] - plane[place(inner, y)];
        plane[place(last + k, y)] = 2.0 * plane[place(last, y)] - plane[place(last - inner, y)];
    }
}

// Thread = column, border included; the binding holds the border rows above (begin = 0) or below the image.
@compute @workgroup_size(64)
fn rows(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = i32(id.x) - BORDER;
    if x >= border.width + BORDER {
        return;
    }
    let last = border.height - 1;
    for (var k = 1; k <= BORDER; k++) {
        let inner = min(k, last);
        if border.begin == 0 {
            plane[place(x, -k)] = 2.0 * plane[place(x, 0)] - plane[place(x, inner)];
        } else {
            plane[place(x, last + k)] = 2.0 * plane[place(x, last)] - plane[place(x, last - inner)];
        }
    }
}
`,
  'cg_product': `// Conjugate gradients, first half of an iteration: p = z + beta p, q = A p, p . q. The product needs p of the
// neighbours, so each thread makes those anew from the old one. Twin: src/linalg/conjugate_gradients.rs.
// Thread = node.
#import cg

@group(0) @binding(0) var<uniform> cg: Cg;
// Where each node's row of blocks begins; then their columns.
@group(0) @binding(1) var<storage, read> pattern: array<u32>;
@group(0) @binding(2) var<storage, read> blocks: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> preconditioned: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> old_direction: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> direction: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> image: array<vec2<f32>>;
// Partial sums: of r . z before each iteration and after the last in even rows, of p . q in odd ones.
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    var beta = 0.0;
    if cg.iteration > 0u {
        let before = total(2u * cg.iteration - 2u, thread);
        let now = total(2u * cg.iteration, thread);
        if before > 0.0 {
            beta = now / before;
        }
    }
    let number = group_number(group, groups) + cg.first_node / 256u;
    let node = number * 256u + thread;
    var product = 0.0;
    if node < cg.last_node {
        let p = preconditioned[node] + beta * old_direction[node];
        var q = vec2<f32>(0.0);
        for (var k = pattern[node]; k < pattern[node + 1u]; k++) {
            let other = pattern[k];
            let v = preconditioned[other] + beta * old_direction[other];
            let block = blocks[k - (cg.n_nodes + 1u) - cg.first_block];
            q += vec2<f32>(block.x * v.x + block.y * v.y, block.z * v.x + block.w * v.y);
        }
        direction[node] = p;
        image[node] = q;
        product = dot(p, q);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < cg.last_node {
        products[(2u * cg.iteration + 1u) * cg.n_partial + number] = sum;
    }
}
`,
  'cg_update': `// Conjugate gradients, second half of an iteration: x += alpha p, r -= alpha q, z = D r, r . z.
// Twin: src/linalg/conjugate_gradients.rs. Thread = node.
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
`,
  'correct': `// The field plus the correction, relaxed, turned and damped by \`(cos, sin)\`, and the largest component of the correction. Thread = node.
// How far a node is moved, the fall of its last correction tells: twin in src/backend/relaxation.rs.
// The correction is for the residual before the transfer of its zone changed: less what that change moves (THEORY 2).
#import types
#import index
#import step

struct Correct {
    n_nodes: u32,
    // Damping times cosine and sine of the angle that the correction is turned by.
    cos: f32,
    sin: f32,
    coupled: u32,
    // Where in \`relaxation\` those of the step before begin, or NOTHING, and those of this one.
    before_first: u32,
    first: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> correct: Correct;
@group(0) @binding(1) var<storage, read> solution: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read_write> displacement: array<Displacement>;
@group(0) @binding(3) var<storage, read_write> worst: array<Worst>;
// Displacements by a gain and by an offset of the zone.
@group(0) @binding(4) var<storage, read> responses: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> node_zone: array<u32>;
@group(0) @binding(6) var<storage, read> change: array<vec2<f32>>;
// Corrections, and what they were multiplied by.
@group(0) @binding(7) var<storage, read_write> relaxation: array<vec4<f32>>;
// Where the nodes were.
@group(0) @binding(8) var<storage, read_write> before: array<Displacement>;

const NOTHING: u32 = 0xffffffffu;
const SHORTEST: f32 = 0.6;
const LONGEST: f32 = 1.1;
const LEAST_LEFT: f32 = 0.1;
const FARTHEST: f32 = 0.25;

var<workgroup> bits: array<u32, 256>;
// The largest of sixteen neighbours, and which it is.
var<workgroup> largest_bits: array<u32, 16>;
var<workgroup> largest_at: array<u32, 16>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let node = number * 256u + thread;
    bits[thread] = 0u;
    if node < correct.n_nodes {
        var du = solution[node];
        if correct.coupled != 0u {
            let of_zone = change[node_zone[node]];
            let by = responses[node];
            du -= of_zone.x * by.xy + of_zone.y * by.zw;
        }
        var factor = 1.0;
        if correct.before_first != NOTHING {
            let earlier = relaxation[correct.before_first + node];
            let squares = dot(earlier.xy, earlier.xy);
            // A node that was not moved has no rate, and one that was far off tells nothing by it.
            if squares > 0.0 && squares <= FARTHEST * FARTHEST {
                let rate = dot(earlier.xy, du) / squares;
                factor = clamp(earlier.z / max(1.0 - rate, LEAST_LEFT), SHORTEST, LONGEST);
            }
        }
        relaxation[correct.first + node] = vec4<f32>(du, factor * length(vec2<f32>(correct.cos, correct.sin)), 0.0);
        let by = factor * du;
        let u = displacement[node];
        before[node] = u;
        let turned = vec2<f32>(correct.cos * by.x - correct.sin * by.y, correct.cos * by.y + correct.sin * by.x);
        let moved = u.rest + turned;
        let floors = clamp(floor(moved), vec2<f32>(-1e6), vec2<f32>(1e6));
        displacement[node].whole = clamp(u.whole + vec2<i32>(floors), vec2<i32>(-1000000), vec2<i32>(1000000));
        displacement[node].rest = moved - floors;
        // As bits, what is no number is larger than any that is.
        let size = bitcast<vec2<u32>>(abs(du));
        bits[thread] = max(size.x, size.y);
    }
    workgroupBarrier();
    if thread < 16u {
        var largest = 0u;
        var at = 16u * thread;
        for (var i = at; i < 16u * thread + 16u; i++) {
            if bits[i] > largest {
                largest = bits[i];
                at = i;
            }
        }
        largest_bits[thread] = largest;
        largest_at[thread] = at;
    }
    workgroupBarrier();
    if thread == 0u && number * 256u < correct.n_nodes {
        var largest = largest_bits[0];
        var at = largest_at[0];
        for (var i = 1u; i < 16u; i++) {
            if largest_bits[i] > largest {
                largest = largest_bits[i];
                at = largest_at[i];
            }
        }
        worst[number] = Worst(largest, number * 256u + at);
    }
}
`,
  'downsample': `// Mean of each 2 x 2 block of pixels: the next level of the pyramid. Twin: src/backend/pyramid.rs.
// Thread = pixel of the coarser level.

struct Downsample {
    width: u32,
    rows: u32,
    fine_stride: u32,
    coarse_stride: u32,
    // Values before the first of each binding.
    fine_first: u32,
    coarse_first: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> downsample: Downsample;
@group(0) @binding(1) var<storage, read> fine: array<f32>;
@group(0) @binding(2) var<storage, read_write> coarse: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= downsample.width || id.y >= downsample.rows {
        return;
    }
    let upper = downsample.fine_first + 2u * id.y * downsample.fine_stride + 2u * id.x;
    let lower = upper + downsample.fine_stride;
    let mean = 0.25 * ((fine[upper] + fine[upper + 1u]) + (fine[lower] + fine[lower + 1u]));
    coarse[downsample.coarse_first + id.y * downsample.coarse_stride + id.x] = mean;
}
`,
  'gather': `// The right-hand side of every node from its elements, in element order, and the start of the conjugate
// gradients. Twins: \`Pattern::gather\` in src/linalg/blocks.rs, src/linalg/conjugate_gradients.rs.
// Thread = node.
#import types
#import index
#import reduce

struct Gather {
    n_nodes: u32,
    unused0: u32,
    unused1: u32,
    unused2: u32,
}

@group(0) @binding(0) var<uniform> gather: Gather;
// Where each node's elements begin; then 4 element + corner of each, element by element.
@group(0) @binding(1) var<storage, read> incidence: array<u32>;
@group(0) @binding(2) var<storage, read> sums: array<f32>;
// Inverse nodal blocks xx, xy, yy; zero for a node that is held.
@group(0) @binding(3) var<storage, read> jacobi: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> residual: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> preconditioned: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> solution: array<vec2<f32>>;
@group(0) @binding(7) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let node = number * 256u + thread;
    var product = 0.0;
    if node < gather.n_nodes {
        var b = vec2<f32>(0.0);
        for (var k = incidence[node]; k < incidence[node + 1u]; k++) {
            let place = incidence[k];
            let at = (place >> 2u) * SUMS + 2u * (place & 3u);
            b += vec2<f32>(sums[at], sums[at + 1u]);
        }
        let d = jacobi[node];
        let z = vec2<f32>(d.x * b.x + d.y * b.y, d.y * b.x + d.z * b.y);
        residual[node] = b;
        preconditioned[node] = z;
        solution[node] = vec2<f32>(0.0);
        product = dot(b, z);
    }
    let sum = sum_of_group(product, thread);
    if thread == 0u && number * 256u < gather.n_nodes {
        products[number] = sum;
    }
}
`,
  'gradient': `// The reference: grey levels and the gradient of their spline at the pixels, row by row f, then both components of the gradient
// in one word.
// Twin: \`gradients\` in src/backend/cpu/gradient.rs. Thread = column of ROWS
// pixels: going down, sums along four of five rows of coefficients stay in registers.
#import types
#import gradient

struct Gradient {
    width: i32,
    rows: i32,
    stride: i32,
    // First values of the bindings at image row 0 of this dispatch.
    grey_first: i32,
    coefficients_first: i32,
    reference_first: i32,
    // Units of the gradient per grey level and px.
    per_unit: f32,
    unused: i32,
    // Weights of value and derivative on the coefficients from two pixels before to two after.
    value: array<vec4<f32>, 2>,
    derivative: array<vec4<f32>, 2>,
}

@group(0) @binding(0) var<uniform> gradient: Gradient;
@group(0) @binding(1) var<storage, read> grey: array<f32>;
@group(0) @binding(2) var<storage, read> coefficients: array<f32>;
@group(0) @binding(3) var<storage, read_write> reference: array<u32>;

const ROWS: i32 = 16;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let x = i32(id.x);
    let first = ROWS * i32(id.y);
    if x >= gradient.width || first >= gradient.rows {
        return;
    }
    // Value and slope along x of the rows from two above to one below.
    var even = vec4<f32>(0.0);
    var slope = vec4<f32>(0.0);
    let end = min(first + ROWS, gradient.rows);
    for (var y = first - 4; y < end; y++) {
        let row = gradient.coefficients_first + (y + 2) * gradient.stride + x - 2;
        let c = vec4<f32>(coefficients[row], coefficients[row + 1], coefficients[row + 2], coefficients[row + 3]);
        let last = coefficients[row + 4];
        let even_below = dot(gradient.value[0], c) + gradient.value[1].x * last;
        let slope_below = dot(gradient.derivative[0], c) + gradient.derivative[1].x * last;
        if y >= first {
            let at = gradient.reference_first + 2 * y * gradient.stride + x;
            reference[at] = bitcast<u32>(grey[gradient.grey_first + y * gradient.stride + x]);
            reference[at + gradient.stride] = packed_gradient(
                gradient.per_unit * (dot(gradient.value[0], slope) + gradient.value[1].x * slope_below),
                gradient.per_unit * (dot(gradient.derivative[0], even) + gradient.derivative[1].x * even_below),
            );
        }
        even = vec4<f32>(even.yzw, even_below);
        slope = vec4<f32>(slope.yzw, slope_below);
    }
}
`,
  'largest': `// The end of a step: the largest component of its correction, and whether the next one of its batch is made before the host has seen it.
// Where it is not, the kernels of that one run on no workgroups. One workgroup. Twin: \`Ahead\` in src/backend/mod.rs.
#import step

struct Largest {
    // Partial results.
    n_worst: u32,
    // Number of the step in its batch, from 0.
    at: u32,
    // Bounds within which another step may follow: elements lost,
    lost: f32,
    // sizes of dispatches in use,
    n_sizes: u32,
    // bits of the largest correction, at least and less than,
    correction: vec2<u32>,
    // and pixels counted, at least and at most.
    counted: vec2<f32>,
    // Workgroups along x and y of dispatches of a step.
    sizes: array<vec4<u32>, 8>,
}

@group(0) @binding(0) var<uniform> largest: Largest;
@group(0) @binding(1) var<storage, read> worst: array<Worst>;
@group(0) @binding(2) var<storage, read_write> steps: array<Step>;
// Workgroups of the dispatches of the next step, three numbers each.
@group(0) @binding(3) var<storage, read_write> groups: array<u32>;

var<workgroup> worst_bits: array<u32, 64>;
var<workgroup> worst_node: array<u32, 64>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) thread: u32) {
    var bits = 0u;
    var node = 0u;
    for (var k = thread; k < largest.n_worst; k += 64u) {
        if worst[k].bits > bits {
            bits = worst[k].bits;
            node = worst[k].node;
        }
    }
    worst_bits[thread] = bits;
    worst_node[thread] = node;
    workgroupBarrier();
    if thread == 0u {
        for (var i = 1u; i < 64u; i++) {
            if worst_bits[i] > bits || (worst_bits[i] == bits && worst_node[i] < node) {
                bits = worst_bits[i];
                node = worst_node[i];
            }
        }
        let at = largest.at;
        var made = true;
        if at > 0u {
            made = steps[at - 1u].goes_on != 0u;
        }
        var goes_on = false;
        if made {
            steps[at].worst = Worst(bits, node);
            let counted = steps[at].counted;
            goes_on = bits >= largest.correction.x && bits < largest.correction.y && abs(steps[at].lossy - largest.lost) < 0.5
                && counted >= largest.counted.x && counted <= largest.counted.y;
        }
        steps[at].made = select(0u, 1u, made);
        steps[at].goes_on = select(0u, 1u, goes_on);
        for (var k = 0u; k < largest.n_sizes; k++) {
            groups[3u * k] = select(0u, largest.sizes[k].x, goes_on);
            groups[3u * k + 1u] = select(0u, largest.sizes[k].y, goes_on);
            groups[3u * k + 2u] = 1u;
        }
    }
}
`,
  'normal_matrix': `// Moments of the reference gradient per element, from which the normal matrices M_ij = sum (psi_i . grad f)
// (psi_j . grad f) are made (THEORY 2): 27 sums instead of the 36 entries, and those that couple with a gain
// and offset. Twin: src/backend/cpu/normal_matrix.rs.
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

// Every second of eight, from \`k\` on.
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
`,
  'prefilter': `// B-spline coefficients of an image continued through its outermost pixels, s(-k) = 2 s(0) - s(k): along y, and written
// with rows and columns exchanged, so that after a second time both axes are filtered and the image lies as it did.
// The filter in its parallel form (Unser 1999): c(k) = sum_p a_p (down_p(k) + up_p(k) - s(k)), down_p(k) = s(k) + z_p down_p(k - 1),
// up_p(k) = s(k) + z_p up_p(k + 1). Neither way waits for the other, and a thread holds nothing but one value per pole.
// Twin: src/backend/cpu/prefilter.rs, which runs over the whole length; here a piece runs in from a halo of pixels beyond its
// own, where the largest pole leaves 2e-9.
// Thread = column; a workgroup filters LENGTH rows of LINES columns, and exchanges them in its memory.

struct Prefilter {
    // Rows of the image.
    n: i32,
    // Columns and rows of this dispatch.
    left: i32,
    right: i32,
    top: i32,
    bottom: i32,
    // Values from one row to the next, and pixel (0, 0) in the bindings.
    source_stride: i32,
    target_stride: i32,
    source_first: i32,
    target_first: i32,
    // Samples that the first value of a way is made of.
    n_start: i32,
    halo: i32,
    // Weight of s(k) itself: 1 where there is no filter.
    own: f32,
    poles: vec2<f32>,
    amplitudes: vec2<f32>,
    // Weights of the samples in the first value of a way, by pole.
    start: array<vec4<f32>, 16>,
}

@group(0) @binding(0) var<uniform> prefilter: Prefilter;
@group(0) @binding(1) var<storage, read> source: array<f32>;
@group(0) @binding(2) var<storage, read_write> filtered: array<f32>;

const LINES: i32 = 64;
const LENGTH: i32 = 32;
// One more than a column needs: neighbouring columns lie in different banks.
const PITCH: i32 = LENGTH + 1;

var<workgroup> tile: array<f32, LINES * PITCH>;

// The first value of a way that begins at the border pixel \`at\`, \`step\` values from its neighbour.
fn first_value(at: i32, step: i32) -> vec2<f32> {
    var value = vec2<f32>(0.0);
    for (var k = 0; k < prefilter.n_start; k++) {
        let two = prefilter.start[k >> 1u];
        value += select(two.xy, two.zw, (k & 1) == 1) * source[at + k * step];
    }
    return value;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let left = prefilter.left + i32(group.x) * LINES;
    let top = prefilter.top + i32(group.y) * LENGTH;
    let bottom = min(top + LENGTH, prefilter.bottom) - 1;
    let step = prefilter.source_stride;
    let z = prefilter.poles;
    if left + i32(thread) < prefilter.right {
        let column = prefilter.source_first + left + i32(thread);
        let mine = i32(thread) * PITCH - top;
        // From a halo away any value that is nearly right will do: that of a signal which is constant from there on.
        let above = max(top - prefilter.halo, 0);
        var value = source[column + above * step] / (1.0 - z);
        if above == 0 {
            value = first_value(column, step);
        }
        for (var y = above + 1; y < top; y++) {
            value = source[column + y * step] + z * value;
        }
        for (var y = top; y <= bottom; y++) {
            let s = source[column + y * step];
            if y > above {
                value = s + z * value;
            }
            tile[mine + y] = prefilter.own * s + dot(prefilter.amplitudes, value);
        }
        let below = min(bottom + prefilter.halo, prefilter.n - 1);
        value = source[column + below * step] / (1.0 - z);
        if below == prefilter.n - 1 {
            value = first_value(column + below * step, -step);
        }
        for (var y = below - 1; y > bottom; y--) {
            value = source[column + y * step] + z * value;
        }
        for (var y = bottom; y >= top; y--) {
            if y < below {
                value = source[column + y * step] + z * value;
            }
            tile[mine + y] += dot(prefilter.amplitudes, value);
        }
    }
    workgroupBarrier();
    // Threads run along a column, which is a row of the target.
    for (var k = i32(thread); k < LINES * LENGTH; k += LINES) {
        let x = left + k / LENGTH;
        let y = top + k % LENGTH;
        if x < prefilter.right && y <= bottom {
            filtered[prefilter.target_first + x * prefilter.target_stride + y] = tile[(k / LENGTH) * PITCH + k % LENGTH];
        }
    }
}
`,
  'prolong': `// The field on the nodes of a level from that of the next coarser one, whose pixels are twice as large.
// Twin: \`start_finer\` in src/backend/cpu/mod.rs. Thread = node.
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
`,
  'residual': `// Residual and right-hand side of the elements that are rectangles of pixels, in one pass (THEORY 2):
// b_i = sum (psi_i . grad f)(f - gain g(X + u) - offset). Twin: src/backend/cpu/residual.rs.
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
`,
  'residual_map': `// What goes back to the host at the end of a frame: how each element matched (the residual map), and the field,
// packed. Twins: \`PixelSums\` and \`ElementMatch\` in src/backend/sums.rs. Thread = element and node of one number.
#import types
#import index

struct Report {
    n_elements: u32,
    n_nodes: u32,
    unused: vec2<u32>,
}

@group(0) @binding(0) var<uniform> report: Report;
@group(0) @binding(1) var<storage, read> whole: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sums: array<f32>;
@group(0) @binding(3) var<storage, read> displacement: array<Displacement>;
// Per element two words: root mean square of the residual; share of pixels counted and correlation coefficient.
// Then per node three: whole pixels as two 16-bit numbers, the rest.
@group(0) @binding(4) var<storage, read_write> packed: array<u32>;

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups) * 256u + thread;
    if number < report.n_elements {
        let at = number * SUMS;
        let all = whole[number];
        let n = sums[at + N];
        var rms = 0.0;
        var share = 0.0;
        var correlation = 0.0;
        if n > 0.0 && sums[at + OUT] != EXCLUDED {
            rms = sqrt(max(sums[at + RR] / n, 0.0));
            // One in 32767 at least: none would mean that the element is left out.
            share = max(n / all.x, 1.0 / 32767.0);
            let mean_f = (all.y - sums[at + F_LOST]) / n;
            let mean_g = sums[at + G] / n;
            let variance_f = (all.z - sums[at + FF_LOST]) / n - mean_f * mean_f;
            let variance_g = sums[at + GG] / n - mean_g * mean_g;
            if n >= 2.0 && variance_f > 0.0 && variance_g > 0.0 {
                correlation = (sums[at + FG] / n - mean_f * mean_g) / sqrt(variance_f * variance_g);
            }
        }
        packed[2u * number] = bitcast<u32>(rms);
        packed[2u * number + 1u] = pack2x16snorm(vec2<f32>(share, correlation));
    }
    if number < report.n_nodes {
        let at = 2u * report.n_elements + 3u * number;
        let u = displacement[number];
        let whole_px = clamp(u.whole, vec2<i32>(-32768), vec2<i32>(32767));
        packed[at] = (u32(whole_px.x) & 0xffffu) | (u32(whole_px.y) << 16u);
        packed[at + 1u] = bitcast<u32>(u.rest.x);
        packed[at + 2u] = bitcast<u32>(u.rest.y);
    }
}
`,
  'shared/cg': `// What both halves of an iteration of the conjugate gradients share.
#import index
#import reduce

struct Cg {
    n_nodes: u32,
    // Number of the iteration, from 0.
    iteration: u32,
    // Partial sums per dot product: one per workgroup.
    n_partial: u32,
    // Node and block that this dispatch begins with, and the node it ends before.
    first_node: u32,
    last_node: u32,
    first_block: u32,
    unused0: u32,
    unused1: u32,
}

// Sum of one row of \`products\`, by every workgroup on its own: cheaper than a dispatch for it.
fn total(row: u32, thread: u32) -> f32 {
    var mine = 0.0;
    for (var k = thread; k < cg.n_partial; k += 256u) {
        mine += products[row * cg.n_partial + k];
    }
    return sum_of_group(mine, thread);
}
`,
  'shared/cubic': `// Cubic B-spline. Twin: \`Cubic\` in src/backend/spline.rs.
#import taps4

fn spline_weights(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    let t2 = t * t;
    let s2 = s * s;
    return vec4<f32>(
        s2 * s * (1.0 / 6.0),
        t2 * (t * 0.5 - 1.0) + 2.0 / 3.0,
        s2 * (s * 0.5 - 1.0) + 2.0 / 3.0,
        t2 * t * (1.0 / 6.0),
    );
}
`,
  'shared/gradient': `// The gradient of the reference at a pixel: whole 16-bit numbers of a unit, x in the low half of a word, y in the high one.
// Twin: \`gradients\` in src/backend/cpu/gradient.rs.

fn packed_gradient(x: f32, y: f32) -> u32 {
    return (nearest(x) & 0xffffu) | (nearest(y) << 16u);
}

// The nearest whole number, in the low bits: a sum with 1.5 * 2^23 has no room for a fraction.
fn nearest(value: f32) -> u32 {
    return bitcast<u32>(clamp(value, -32767.0, 32767.0) + 12582912.0);
}

fn gradient_of(word: u32) -> vec2<f32> {
    return vec2<f32>(f32(bitcast<i32>(word << 16u) >> 16u), f32(bitcast<i32>(word) >> 16u));
}
`,
  'shared/index': `// Number of a workgroup in a dispatch that is folded into rows (a dimension holds 65535 at most).
fn group_number(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
`,
  'shared/light': `// Light that changes over the specimen: gain and offset at the corners of an element. Twin: \`Light\` in
// src/backend/cpu/corners.rs. The kernel declares \`transfer\`.
#import q4

// Where in \`transfer\` the light of the nodes begins; 0: there is none, and a compiler leaves all of this out.
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
`,
  'shared/place': `// Where pixels land in the deformed image, and how much they count there. Twin: src/backend/cpu/sample.rs.

// A pixel that lands beyond the outermost pixel centres fades out over this distance, px.
const EDGE: f32 = 0.25;

// Weight of a position (whole pixel and fraction) on an axis of \`n\` pixels: 1 inside, 0 from EDGE outside on.
fn weight_on(at: i32, t: f32, n: i32) -> f32 {
    // Whole pixels and fraction apart: the sum would lose the fraction far from zero.
    let beyond = max(f32(-at) - t, f32(at - (n - 1)) + t);
    return clamp(1.0 - beyond / EDGE, 0.0, 1.0);
}

// Floor of a displacement as a whole number; a wild one must not overflow, and lands outside any image.
fn whole_floor(u: f32) -> i32 {
    return i32(clamp(floor(u), -1e6, 1e6));
}
`,
  'shared/q4': `// The displacement inside an element. Twin: \`Corners\` in src/backend/cpu/corners.rs.
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
`,
  'shared/reduce': `// Sums over the 256 threads of a workgroup, in a fixed order: by sixteen threads, then of their sums by every thread.
// A tree would need nine barriers, which cost software devices more than all else.
var<workgroup> terms: array<f32, 256>;
var<workgroup> parts: array<f32, 16>;

fn sum_of_group(term: f32, thread: u32) -> f32 {
    terms[thread] = term; // the sum before has been read: its second barrier is behind all threads
    workgroupBarrier();
    if thread < 16u {
        // Neighbouring threads read neighbouring values.
        var sum = 0.0;
        for (var k = 0u; k < 16u; k++) {
            sum += terms[thread + 16u * k];
        }
        parts[thread] = sum;
    }
    workgroupBarrier();
    var all = 0.0;
    for (var k = 0u; k < 16u; k++) {
        all += parts[k];
    }
    return all;
}
`,
  'shared/step': `// A correction's largest component (the bits of its magnitude, so that what is no number counts as largest)
// and its node.
struct Worst {
    bits: u32,
    node: u32,
}

// What a step tells the host.
struct Step {
    worst: Worst,
    // Smallest correlation coefficient of a zone, and smallest change since the first evaluation.
    correlation: f32,
    gained: f32,
    counted: f32,
    lossy: f32,
    // Whether it was made, and whether another one may follow before the host has seen it.
    made: u32,
    goes_on: u32,
}
`,
  'shared/sums': `// The end of both residual kernels: the sums of LANES threads become those of their element. The kernel declares
// \`run\` and \`sums\`.

override LANES: u32 = 16u;

// Eight of the right-hand side by corner and component, then n, rr, g, gg, fg, and what is lost of f and of its square.
const QUANTITIES: u32 = 15u;
var<workgroup> partial: array<f32, 960>; // QUANTITIES * 64

fn keep(thread: u32, of_grey: vec4<f32>, fg: f32, lost: vec2<f32>) {
    partial[512u + thread] = of_grey.x;
    partial[576u + thread] = of_grey.y;
    partial[640u + thread] = of_grey.z;
    partial[704u + thread] = of_grey.w;
    partial[768u + thread] = fg;
    partial[832u + thread] = lost.x;
    partial[896u + thread] = lost.y;
}

fn add_up(element: u32, slot: u32, lane: u32) {
    for (var k = lane; k < QUANTITIES; k += LANES) {
        var sum = 0.0;
        for (var i = 0u; i < LANES; i++) {
            sum += partial[64u * k + slot * LANES + i];
        }
        let at = element * SUMS + k;
        if run.accumulate != 0u {
            sum += sums[at];
        }
        sums[at] = sum;
    }
}
`,
  'shared/tallies': `// Sums of a group of elements: n, n_all, f, f^2, g, g^2, f g, r^2, lossy elements, gains and offsets of elements
// that have their own.
const TALLIES: u32 = 11u;
const ROOM: u32 = 12u; // of a group in memory
`,
  'shared/taps4': `// Interpolation from 4 x 4 coefficients, kept in registers: going down a column, three of four rows stay.
const BEFORE: i32 = 1; // taps start this far before the floor
const TAPS: i32 = 4;

struct Taps {
    r0: vec4<f32>,
    r1: vec4<f32>,
    r2: vec4<f32>,
    r3: vec4<f32>,
}

fn tap_row(at: i32) -> vec4<f32> {
    return vec4<f32>(deformed[at], deformed[at + 1], deformed[at + 2], deformed[at + 3]);
}

fn taps_at(at: i32, stride: i32) -> Taps {
    return Taps(tap_row(at), tap_row(at + stride), tap_row(at + 2 * stride), tap_row(at + 3 * stride));
}

// The taps one row below \`taps\`; the new row begins at \`at\`.
fn taps_below(taps: Taps, at: i32) -> Taps {
    return Taps(taps.r1, taps.r2, taps.r3, tap_row(at));
}

fn interpolate(taps: Taps, tx: f32, ty: f32) -> f32 {
    let wx = spline_weights(tx);
    let rows = vec4<f32>(dot(wx, taps.r0), dot(wx, taps.r1), dot(wx, taps.r2), dot(wx, taps.r3));
    return dot(spline_weights(ty), rows);
}
`,
  'shared/types': `// Structs that both sides see; the Rust ones are in src/backend/gpu/layout.rs.

// An element, its nodes and its pixels: \`size.x\` columns and \`size.y\` rows from \`corner\` on, column k at
// xi = local.x + k local.y, row k at eta = local.z + k local.w; or, with n_runs > 0, runs of pixels.
struct Element {
    nodes: vec4<u32>,
    corner: vec2<i32>,
    size: vec2<u32>,
    local: vec4<f32>,
    first_run: u32,
    n_runs: u32,
    zone: u32,
    unused: u32,
}

// A nodal displacement: whole pixels and the rest, never their sum (an f32 of 3000 px steps by 2.4e-4 px).
struct Displacement {
    whole: vec2<i32>,
    rest: vec2<f32>,
}

// Which part of an evaluation a dispatch does. Images larger than a storage binding are seen in windows of
// rows: an element belongs to the window that its first row lies in, a pixel to that of the floor of where it
// lands. Numbers of pixels are those of the level.
struct Pass {
    image: vec2<i32>,
    stride: i32,
    n_elements: u32,
    // Image row that the reference binding begins with, and the first rows of the elements done.
    reference_first: i32,
    elements_from: i32,
    elements_to: i32,
    // Row of the plane, border included, that the deformed binding begins with, and the floors done.
    deformed_first: i32,
    floors_from: i32,
    floors_to: i32,
    // Whether each element has a gain and offset of its own, and whether to add to the sums there are.
    own_transfer: u32,
    accumulate: u32,
    // Elements with runs: their number and where runs and local coordinates begin in \`shape\`.
    n_listed: u32,
    runs_at: u32,
    points_at: u32,
    // For the normal matrix: count pixels by their weight in the deformed image.
    weighted: u32,
    // Of the gradient, grey levels per px.
    unit: f32,
    unused0: u32,
    unused1: u32,
    unused2: u32,
}

// Columns and rows of border around a plane.
const BORDER: i32 = 4;

// Sums of an element: right-hand side, then pixels counted, r^2, g, g^2, f g, and f, f^2 over those lost; the
// last is how often the element has been left out, half more while it is, and negative while the host excludes it: its
// sums are kept then, but for the right-hand side, and count nowhere.
const SUMS: u32 = 16u;
const N: u32 = 8u;
const RR: u32 = 9u;
const G: u32 = 10u;
const GG: u32 = 11u;
const FG: u32 = 12u;
const F_LOST: u32 = 13u;
const FF_LOST: u32 = 14u;
const OUT: u32 = 15u;
const EXCLUDED: f32 = -1.0;
`,
  'summary': `// The end of an evaluation: sums, gain and offset of every zone, and what a step tells the host. One workgroup.
// Twins: \`zone_sums\` and \`fit_transfer\` in src/backend/cpu/mod.rs, \`PixelSums\` in src/backend/sums.rs.
#import tallies
#import step

struct Summary {
    n_zones: u32,
    // What has a gain and offset: nothing, zones, elements.
    brightness: u32,
    // Whether this is the first evaluation of a field.
    first: u32,
    // Number of the step in its batch, from 0.
    at: u32,
}

// Groups of elements of a zone, and how many elements they hold.
struct ZoneGroups {
    first: u32,
    count: u32,
    n_elements: u32,
    unused: u32,
}

// Sums over a zone and what follows from them.
struct Zone {
    n: f32,
    n_all: f32,
    f: f32,
    ff: f32,
    g: f32,
    gg: f32,
    fg: f32,
    rr: f32,
    gain: f32,
    offset: f32,
    // Correlation coefficient at the first evaluation.
    first: f32,
    unused: f32,
}

@group(0) @binding(0) var<uniform> summary: Summary;
@group(0) @binding(1) var<storage, read> zone_groups: array<ZoneGroups>;
@group(0) @binding(2) var<storage, read> group_sums: array<f32>;
@group(0) @binding(3) var<storage, read_write> transfer: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> zones: array<Zone>;
@group(0) @binding(5) var<storage, read_write> steps: array<Step>;
// What the transfer of each zone gained, as shares of f and of 1: \`GreyTransfer::change\` in src/backend/mod.rs.
@group(0) @binding(6) var<storage, read_write> change: array<vec2<f32>>;

// Share of the variance that both images have to have in common for the rest to be noise, as in src/backend/sums.rs.
const SHARED: f32 = 0.5;
// Correlation coefficient below which a change of light is not followed by the displacement, as in src/backend/mod.rs.
const COUPLED: f32 = 0.9;
const OFF: u32 = 0u;
const ZONE: u32 = 1u;
const ELEMENT: u32 = 2u;

var<workgroup> partial: array<f32, 704>; // TALLIES * 64
var<workgroup> total: array<f32, TALLIES>;

@compute @workgroup_size(64)
fn main(@builtin(local_invocation_index) thread: u32) {
    var correlation = 1.0;
    var gained = 2.0;
    var counted = 0.0;
    var lossy = 0.0;
    for (var z = 0u; z < summary.n_zones; z++) {
        let groups = zone_groups[z];
        var mine: array<f32, TALLIES>;
        for (var k = thread; k < groups.count; k += 64u) {
            for (var i = 0u; i < TALLIES; i++) {
                mine[i] += group_sums[(groups.first + k) * ROOM + i];
            }
        }
        for (var i = 0u; i < TALLIES; i++) {
            partial[64u * i + thread] = mine[i];
        }
        workgroupBarrier();
        if thread < TALLIES {
            var sum = 0.0;
            for (var i = 0u; i < 64u; i++) {
                sum += partial[64u * thread + i];
            }
            total[thread] = sum;
        }
        workgroupBarrier();
        if thread == 0u {
            let n = total[0];
            let many = max(n, 1.0);
            let mean_f = total[2] / many;
            let mean_g = total[4] / many;
            let variance_f = total[3] / many - mean_f * mean_f;
            let variance_g = total[5] / many - mean_g * mean_g;
            let covariance = total[6] / many - mean_f * mean_g;
            var of_zone = 0.0;
            if n >= 2.0 && variance_f > 0.0 && variance_g > 0.0 {
                of_zone = clamp(covariance / sqrt(variance_f * variance_g), -1.0, 1.0);
            }
            if summary.first != 0u {
                zones[z].first = of_zone;
            }
            correlation = min(correlation, of_zone);
            gained = min(gained, of_zone - zones[z].first);
            counted += n;
            lossy += total[8];
            zones[z].n = n;
            zones[z].n_all = total[1];
            zones[z].f = total[2];
            zones[z].ff = total[3];
            zones[z].g = total[4];
            zones[z].gg = total[5];
            zones[z].fg = total[6];
            zones[z].rr = total[7];
            change[z] = vec2<f32>(0.0);
            // Kept where the sums say nothing: no sensible change of light turns dark into bright.
            if summary.brightness == ZONE && n >= 2.0 && variance_g > 0.0 && covariance > 0.0 {
                // Both images are noisy: the line closest to the pairs in both directions.
                // By the ratio of the two: squares of grey levels of any size stay finite.
                let half = 0.5 * (variance_f - variance_g) / covariance;
                let root = sqrt(half * half + 1.0);
                var gain = 0.0;
                // In quotients, as above.
                if (covariance / variance_f) * (covariance / variance_g) < SHARED {
                    // Mostly misfit: the ratio of the contrasts.
                    gain = sqrt(variance_f / variance_g);
                } else if half > 0.0 {
                    gain = half + root;
                } else {
                    gain = 1.0 / (root - half);
                }
                // Not where the sums are beyond what f32 holds.
                if gain > 0.0 && gain < 1e30 {
                    let before = transfer[z];
                    let after = vec2<f32>(gain, (total[2] - gain * total[4]) / n);
                    if of_zone >= COUPLED && before.x > 0.0 {
                        let of_f = (after.x - before.x) / before.x;
                        change[z] = vec2<f32>(of_f, after.y - before.y - of_f * before.y);
                    }
                    transfer[z] = after;
                }
            }
            if summary.brightness == ELEMENT {
                zones[z].gain = total[9] / f32(groups.n_elements);
                zones[z].offset = total[10] / f32(groups.n_elements);
            } else {
                zones[z].gain = transfer[z].x;
                zones[z].offset = transfer[z].y;
            }
        }
        workgroupBarrier();
    }
    if thread == 0u {
        steps[summary.at].correlation = correlation;
        steps[summary.at].gained = gained;
        steps[summary.at].counted = counted;
        steps[summary.at].lossy = lossy;
    }
}
`,
  'tally': `// After a residual pass: which elements are left out, and the sums of groups of elements of one zone. Before
// it, where each element has a gain and offset of its own: fits them. Twins: \`run\` in src/backend/cpu/mod.rs
// and \`fitted\` in src/backend/cpu/residual_fitted.rs.
#import types
#import index
#import tallies

struct Tally {
    n_elements: u32,
    n_groups: u32,
    // Shares of its pixels that an element must keep, and must get back (\`kept_and_back_share\`), and below which it
    // is lossy (1 - LOST_SHARE).
    kept_share: f32,
    back_share: f32,
    lossy_share: f32,
    // Whether each element has a gain and offset of its own.
    own_transfer: u32,
    // How often an element is left out before it stays so.
    stays_out: f32,
    unused: u32,
}

// Elements of one zone, at most TOGETHER.
struct Group {
    first: u32,
    count: u32,
}

@group(0) @binding(0) var<uniform> tally: Tally;
@group(0) @binding(1) var<storage, read> groups_of_elements: array<Group>;
// Pixels, sum of f, of f^2 of the whole element.
@group(0) @binding(2) var<storage, read> whole: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> transfer: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read_write> group_sums: array<f32>;

var<workgroup> partial: array<f32, 704>; // TALLIES * 64

// Gain and offset of each element: those that bring g closest to f. Thread = element.
@compute @workgroup_size(64)
fn fit(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let e = group_number(group, groups) * 64u + thread;
    if e >= tally.n_elements {
        return;
    }
    let at = e * SUMS;
    let n = sums[at + N];
    let f = whole[e].y - sums[at + F_LOST];
    let g = sums[at + G];
    // Means taken out first: n g^2 - (sum g)^2 would subtract nearly equal numbers.
    let mean_g = g / max(n, 1.0);
    let variance = sums[at + GG] - g * mean_g;
    let covariance = sums[at + FG] - f * mean_g;
    // A flat element has no contrast to fit: keep the gain of 1.
    var gain = 1.0;
    if variance > 0.0 && covariance > 0.0 {
        gain = covariance / variance;
    }
    var offset = 0.0;
    if n > 0.0 {
        offset = (f - gain * g) / n;
    }
    transfer[e] = vec2<f32>(gain, offset);
}

// Workgroup = group of elements.
@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = group_number(group, groups);
    let mine = groups_of_elements[min(number, tally.n_groups - 1u)];
    var total: array<f32, TALLIES>;
    for (var k = thread; k < mine.count && number < tally.n_groups; k += 64u) {
        let e = mine.first + k;
        let at = e * SUMS;
        let all = whole[e];
        let times = floor(sums[at + OUT]);
        let was_out = sums[at + OUT] != times;
        let share = select(tally.kept_share, tally.back_share, was_out);
        let stays = was_out && times >= tally.stays_out;
        let n = sums[at + N];
        total[1] += all.x;
        if tally.own_transfer != 0u {
            total[9] += transfer[e].x;
            total[10] += transfer[e].y;
        }
        if sums[at + OUT] == EXCLUDED {
            for (var i = 0u; i < N; i++) {
                sums[at + i] = 0.0;
            }
            if n < tally.kept_share * all.x {
                sums[at + N] = 0.0;
            }
            total[8] += 2.0;
        } else if stays || n < share * all.x {
            for (var i = 0u; i < OUT; i++) {
                sums[at + i] = 0.0;
            }
            sums[at + F_LOST] = all.y;
            sums[at + FF_LOST] = all.z;
            sums[at + OUT] = select(times + 1.0, times, was_out) + 0.5;
            total[8] += 2.0;
        } else if all.x > 0.0 {
            sums[at + OUT] = times;
            total[0] += n;
            total[2] += all.y - sums[at + F_LOST];
            total[3] += all.z - sums[at + FF_LOST];
            total[4] += sums[at + G];
            total[5] += sums[at + GG];
            total[6] += sums[at + FG];
            total[7] += sums[at + RR];
            if n < tally.lossy_share * all.x {
                total[8] += 1.0;
            }
        }
    }
    for (var i = 0u; i < TALLIES; i++) {
        partial[64u * i + thread] = total[i];
    }
    workgroupBarrier();
    if thread < TALLIES && number < tally.n_groups {
        var sum = 0.0;
        for (var i = 0u; i < 64u; i++) {
            sum += partial[64u * thread + i];
        }
        group_sums[number * ROOM + thread] = sum;
    }
}
`,
  'unpack': `// Grey levels of 8-bit, 16-bit or float pixels, less the series' offset. Twin: src/backend/pyramid.rs.
// Thread = pixel.

struct Unpack {
    width: u32,
    rows: u32,
    stride: u32,
    // Bytes of a pixel.
    depth: u32,
    // Pixels before the first in \`pixels\`, and values before the first in \`grey\`.
    skip: u32,
    first: u32,
    offset: f32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> unpack: Unpack;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;
@group(0) @binding(2) var<storage, read_write> grey: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= unpack.width || id.y >= unpack.rows {
        return;
    }
    let at = unpack.skip + id.y * unpack.width + id.x;
    // A word holds four pixels, two or one; without a branch, and without a division.
    let shift = 2u - (unpack.depth >> 1u);
    let bits = 8u * unpack.depth;
    let word = pixels[at >> shift];
    let part = (word >> (bits * (at & ((1u << shift) - 1u)))) & (0xffffffffu >> (32u - bits));
    let value = select(f32(part), bitcast<f32>(word), unpack.depth == 4u);
    grey[unpack.first + id.y * unpack.stride + id.x] = value - unpack.offset;
}
`,
};

// Size of each struct; offset and kind of its fields.
const LAYOUTS = {
  Border: { size: 32, fields: { width: [0, 'i32'], height: [4, 'i32'], stride: [8, 'i32'], first: [12, 'i32'], begin: [16, 'i32'], end: [20, 'i32'], unused: [24, 'i32'] } },
  Cg: { size: 32, fields: { n_nodes: [0, 'u32'], iteration: [4, 'u32'], n_partial: [8, 'u32'], first_node: [12, 'u32'], last_node: [16, 'u32'], first_block: [20, 'u32'], unused0: [24, 'u32'], unused1: [28, 'u32'] } },
  Correct: { size: 32, fields: { n_nodes: [0, 'u32'], cos: [4, 'f32'], sin: [8, 'f32'], coupled: [12, 'u32'], before_first: [16, 'u32'], first: [20, 'u32'], unused: [24, 'u32'] } },
  Displacement: { size: 16, fields: { whole: [0, 'i32'], rest: [8, 'f32'] } },
  Downsample: { size: 32, fields: { width: [0, 'u32'], rows: [4, 'u32'], fine_stride: [8, 'u32'], coarse_stride: [12, 'u32'], fine_first: [16, 'u32'], coarse_first: [20, 'u32'], unused: [24, 'u32'] } },
  Element: { size: 64, fields: { nodes: [0, 'u32'], corner: [16, 'i32'], size: [24, 'u32'], local: [32, 'f32'], first_run: [48, 'u32'], n_runs: [52, 'u32'], zone: [56, 'u32'], unused: [60, 'u32'] } },
  Gather: { size: 16, fields: { n_nodes: [0, 'u32'], unused0: [4, 'u32'], unused1: [8, 'u32'], unused2: [12, 'u32'] } },
  Gradient: { size: 96, fields: { width: [0, 'i32'], rows: [4, 'i32'], stride: [8, 'i32'], grey_first: [12, 'i32'], coefficients_first: [16, 'i32'], reference_first: [20, 'i32'], per_unit: [24, 'f32'], unused: [28, 'i32'], value: [32, 'f32'], derivative: [64, 'f32'] } },
  Group: { size: 8, fields: { first: [0, 'u32'], count: [4, 'u32'] } },
  Largest: { size: 160, fields: { n_worst: [0, 'u32'], at: [4, 'u32'], lost: [8, 'f32'], n_sizes: [12, 'u32'], correction: [16, 'u32'], counted: [24, 'f32'], sizes: [32, 'u32'] } },
  Pass: { size: 80, fields: { image: [0, 'i32'], stride: [8, 'i32'], n_elements: [12, 'u32'], reference_first: [16, 'i32'], elements_from: [20, 'i32'], elements_to: [24, 'i32'], deformed_first: [28, 'i32'], floors_from: [32, 'i32'], floors_to: [36, 'i32'], own_transfer: [40, 'u32'], accumulate: [44, 'u32'], n_listed: [48, 'u32'], runs_at: [52, 'u32'], points_at: [56, 'u32'], weighted: [60, 'u32'], unit: [64, 'f32'], unused0: [68, 'u32'], unused1: [72, 'u32'], unused2: [76, 'u32'] } },
  Place: { size: 32, fields: { nodes: [0, 'u32'], weights: [16, 'f32'] } },
  Prefilter: { size: 320, fields: { n: [0, 'i32'], left: [4, 'i32'], right: [8, 'i32'], top: [12, 'i32'], bottom: [16, 'i32'], source_stride: [20, 'i32'], target_stride: [24, 'i32'], source_first: [28, 'i32'], target_first: [32, 'i32'], n_start: [36, 'i32'], halo: [40, 'i32'], own: [44, 'f32'], poles: [48, 'f32'], amplitudes: [56, 'f32'], start: [64, 'f32'] } },
  Report: { size: 16, fields: { n_elements: [0, 'u32'], n_nodes: [4, 'u32'], unused: [8, 'u32'] } },
  Step: { size: 32, fields: { worst: [0, 'Worst'], correlation: [8, 'f32'], gained: [12, 'f32'], counted: [16, 'f32'], lossy: [20, 'f32'], made: [24, 'u32'], goes_on: [28, 'u32'] } },
  Summary: { size: 16, fields: { n_zones: [0, 'u32'], brightness: [4, 'u32'], first: [8, 'u32'], at: [12, 'u32'] } },
  Tally: { size: 32, fields: { n_elements: [0, 'u32'], n_groups: [4, 'u32'], kept_share: [8, 'f32'], back_share: [12, 'f32'], lossy_share: [16, 'f32'], own_transfer: [20, 'u32'], stays_out: [24, 'f32'], unused: [28, 'u32'] } },
  Unpack: { size: 32, fields: { width: [0, 'u32'], rows: [4, 'u32'], stride: [8, 'u32'], depth: [12, 'u32'], skip: [16, 'u32'], first: [20, 'u32'], offset: [24, 'f32'], unused: [28, 'u32'] } },
  Worst: { size: 8, fields: { bits: [0, 'u32'], node: [4, 'u32'] } },
  Zone: { size: 48, fields: { n: [0, 'f32'], n_all: [4, 'f32'], f: [8, 'f32'], ff: [12, 'f32'], g: [16, 'f32'], gg: [20, 'f32'], fg: [24, 'f32'], rr: [28, 'f32'], gain: [32, 'f32'], offset: [36, 'f32'], first: [40, 'f32'], unused: [44, 'f32'] } },
  ZoneGroups: { size: 16, fields: { first: [0, 'u32'], count: [4, 'u32'], n_elements: [8, 'u32'], unused: [12, 'u32'] } },
};

const CONSTANTS = {
  KEPT_SHARE: 0.5,
  KEPT_PX: 6.4,
  KEPT_MOST: 0.95,
  BACK_MORE: 0.1,
  STAYS_OUT: 3,
  LOST_SHARE: 0.05,
  // What noise of variance one adds to the mean square of a component of the gradient.
  GRADIENT_NOISE_GAIN: 1.392305,
};
