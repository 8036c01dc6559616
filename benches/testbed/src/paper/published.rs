//! The figures of the paper (R. Fedele, B. Raka, F. Hild, S. Roux, J. Mech. Phys. Solids 57, 2009, 1003-1016).

/// A row of a published table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedRow {
    /// Standard deviation of the noise (px) in Table 1, `r` in Table 2.
    pub key: f64,
    /// N/mm.
    pub phi_n: f64,
    /// um.
    pub delta_n: f64,
    /// um.
    pub delta_t: f64,
    /// Objective; not given row by row in Table 2.
    pub omega: Option<f64>,
}

/// `phi_n` (N/mm), `delta_n`, `delta_t` (mm) of the artificial data, section 4.1. The peaks given there, 74 and 103
/// MPa, are those of r = 6.
pub const REFERENCE_LAW: [f64; 3] = [1.0, 5e-3, 50e-3];
/// `phi_n` (N/mm), `delta_n`, `delta_t` (mm), `r` identified from the experiment, section 4.2.
pub const MEASURED_LAW: [f64; 4] = [2.5, 8.5e-3, 85e-3, 4.0];
/// Standard deviations of the noise in Table 1 and Figure 10, px.
pub const LEVELS_PX: [f64; 5] = [0.0, 0.1, 0.6, 1.0, 2.0];
/// Values of `r` in Table 2.
pub const PRESCRIBED_R: [f64; 4] = [3.0, 4.0, 5.0, 6.0];
/// Noise with which Table 2 is done again: the objective of the experiment is that of 0.4 to 0.6 px.
pub const SWEEP_NOISE_PX: f64 = 0.5;
/// Initial stiffnesses identified from the experiment, normal and tangential, MPa/mm. The paper prints 34.1 and 2.7 as
/// N/mm^3; by its parameters they are kN/mm^3.
pub const PUBLISHED_STIFFNESS: [f64; 2] = [34.1e3, 2.7e3];
/// Young's modulus (MPa) and Poisson's ratio that the paper assumes for the epoxy in bulk, and the adhesive's thickness
/// (mm).
pub const BULK: [f64; 3] = [1000.0, 0.4, 0.06];

const fn row(key: f64, phi_n: f64, delta_n: f64, delta_t: f64, omega: Option<f64>) -> PublishedRow {
    PublishedRow { key, phi_n, delta_n, delta_t, omega }
}

/// Table 1: one draw for each level.
pub const TABLE_1: [PublishedRow; 4] = [
    row(0.1, 1.0, 5.0, 50.0, Some(0.4)),
    row(0.6, 0.9, 5.1, 48.0, Some(7.5)),
    row(1.0, 1.0, 5.6, 52.0, Some(14.3)),
    row(2.0, 0.9, 7.4, 49.0, Some(30.6)),
];

/// Table 2: the experiment under prescribed `r`.
pub const TABLE_2: [PublishedRow; 4] = [
    row(3.0, 3.0, 9.4, 80.0, None),
    row(4.0, 2.5, 8.5, 85.0, None),
    row(5.0, 2.2, 7.9, 90.0, None),
    row(6.0, 1.9, 7.5, 94.0, None),
];
