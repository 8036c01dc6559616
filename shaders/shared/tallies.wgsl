// Sums of a group of elements: n, n_all, f, f^2, g, g^2, f g, r^2, lossy elements, gains and offsets of elements
// that have their own.
const TALLIES: u32 = 11u;
const ROOM: u32 = 12u; // of a group in memory
