//! The WGSL sources of quadrille, as texts. Each file says its twin on the CPU; a line `#import NAME` stands for
//! `shared/NAME.wgsl`.

macro_rules! texts {
    ($($name:literal)*) => {
        /// Every file by its name without the ending, with its text.
        pub const TEXTS: &[(&str, &str)] = &[$(($name, include_str!(concat!($name, ".wgsl")))),*];
    };
}

texts! {
    "bend" "border" "cg_product" "cg_update" "copy" "correct" "downsample" "gather" "gradient" "largest" "normal_matrix"
    "penalty" "prefilter" "prolong" "residual" "residual_map" "residual_runs" "summary" "tally" "unpack"
    "shared/bilinear" "shared/cg" "shared/cubic" "shared/gradient" "shared/index" "shared/keys" "shared/lanes" "shared/light"
    "shared/place" "shared/q4" "shared/quintic" "shared/reduce" "shared/step" "shared/sums" "shared/tallies"
    "shared/taps4" "shared/taps6" "shared/types"
}

/// The text of the file of this name, without the ending.
///
/// # Panics
///
/// If there is no such file; in a constant the compiler says so.
pub const fn text(name: &str) -> &'static str {
    let mut at = 0;
    while at < TEXTS.len() {
        if same(TEXTS[at].0.as_bytes(), name.as_bytes()) {
            return TEXTS[at].1;
        }
        at += 1;
    }
    panic!("no shader has this name")
}

const fn same(a: &[u8], b: &[u8]) -> bool {
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}
