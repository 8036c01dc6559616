// A correction's largest component (the bits of its magnitude, so that what is no number counts as largest)
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
