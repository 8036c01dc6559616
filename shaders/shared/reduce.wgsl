// Sums over the 256 threads of a workgroup, in a fixed order: by sixteen threads, then of their sums by every thread.
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
