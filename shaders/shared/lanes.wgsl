// The end of kernels with LANES threads per element: their sums become those of the element. The kernel declares `run`,
// `sums`, QUANTITIES, `partial` of 64 times as many, and STRIDE, the values of an element in `sums`.

override LANES: u32 = 16u;

fn add_up(element: u32, slot: u32, lane: u32) {
    for (var k = lane; k < QUANTITIES; k += LANES) {
        var sum = 0.0;
        for (var i = 0u; i < LANES; i++) {
            sum += partial[64u * k + slot * LANES + i];
        }
        let at = element * STRIDE + k;
        if run.accumulate != 0u {
            sum += sums[at];
        }
        sums[at] = sum;
    }
}
