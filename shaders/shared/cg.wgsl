// What both halves of an iteration of the conjugate gradients share.
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

// Sum of one row of `products`, by every workgroup on its own: cheaper than a dispatch for it.
fn total(row: u32, thread: u32) -> f32 {
    var mine = 0.0;
    for (var k = thread; k < cg.n_partial; k += 256u) {
        mine += products[row * cg.n_partial + k];
    }
    return sum_of_group(mine, thread);
}
