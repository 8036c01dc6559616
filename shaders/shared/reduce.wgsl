// Sums over the 256 threads of a workgroup, pairwise in a fixed order.
var<workgroup> terms: array<f32, 256>;

fn sum_of_group(term: f32, thread: u32) -> f32 {
    workgroupBarrier(); // the sum before may still be read
    terms[thread] = term;
    workgroupBarrier();
    for (var half = 128u; half > 0u; half >>= 1u) {
        if thread < half {
            terms[thread] += terms[thread + half];
        }
        workgroupBarrier();
    }
    return terms[0];
}
