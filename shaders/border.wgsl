// The border of a plane: continued through the outermost pixels, c(-k) = 2 c(0) - c(k), first along the rows,
// then along the columns with the corners. Twin: `continue_border` in crates/dic/src/backend/cpu/plane.rs.
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
