//! The engine on a few pixels, for Miri (scripts/miri.sh): whether the code that the compiler takes on trust (columns
//! filtered side by side, taps read by one comparison) reads and writes only what is its own. Without Miri it runs in
//! no time.

use quadrille_dic as quadrille;

use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, GreyTransfer, KernelOptions};
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation, Pixels};
use quadrille::linalg::{LuChoice, LuPlan, SparseMatrix, SparsePattern};
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use std::sync::Arc;

/// Waves along both axes and across, of 5 to 9 px, that have moved by `u`.
fn waves(width: usize, height: usize, u: [f64; 2]) -> Arc<Image> {
    let grey = |x: f64, y: f64| {
        let wave = |kx: f64, ky: f64, phase: f64| (kx * x + ky * y + phase).sin();
        (128.0 + 40.0 * (wave(0.7, 0.1, 0.3) + wave(-0.2, 0.9, 1.1) + wave(0.8, -0.7, 2.0))) as f32
    };
    let at = |k: usize| grey((k % width) as f64 - u[0], (k / width) as f64 - u[1]);
    Arc::new(Image::new(width, height, Pixels::F32((0..width * height).map(at).collect())).unwrap())
}

#[test]
fn passes_over_a_few_pixels_read_what_is_there() {
    // More than a strip of columns and an odd number of them; the whole image, of whose border some leaves it. No whole
    // correlation: the factor of its matrix is of faer, which reads memory that it has not written (numbers that it
    // then replaces).
    let (width, height) = (37, 17);
    let moved = [0.4, -0.3];
    let images = [waves(width, height, [0.0; 2]), waves(width, height, moved)];
    let zone = Zone::rectangle("all", Roi { x0: 0.0, y0: 0.0, x1: width as f64, y1: height as f64 });
    let mesh = PixelMesh::on_zones(std::slice::from_ref(&zone), 8, ELEMENT_SHARE, [width, height]).unwrap();
    let backend = CpuBackend::default();
    for interpolation in [Interpolation::Cubic, Interpolation::Quintic, Interpolation::Keys] {
        let options = KernelOptions::new((0.0, 255.0), interpolation, Brightness::Zone);
        let [mut reference, mut deformed] =
            images.clone().map(|image: Arc<Image>| backend.frame(image, &options).unwrap());
        let (level, _) = backend.reference(&mut reference, 0, &mesh, &options, None).unwrap();
        let mut residual = |u: [f64; 2]| {
            let displacement = vec![u; mesh.mesh.nodes().len()];
            let mut field = backend.start(&level, &mut deformed, &displacement, &[GreyTransfer::NONE]).unwrap();
            let (sums, _) = backend.observe(&level, &mut deformed, &mut field).unwrap()[0];
            assert!(
                backend.right_hand_side(&level, &mut deformed, &field).unwrap().iter().flatten().all(|v| v.is_finite())
            );
            (sums.ff - 2.0 * sums.fg + sums.gg) / sums.n
        };
        let (still, found) = (residual([0.0; 2]), residual(moved));
        // Grey levels change by some 25 over half a pixel; interpolation of waves of 5 px leaves below one of them, but
        // for the border, where the image is continued by itself.
        assert!(still > 100.0 && found < 9.0, "{interpolation:?}: {still} at rest, {found} where it has moved");
    }
}

#[test]
fn factors_of_small_matrices_solve() {
    // A chain of five unknowns each coupled with the next four.
    let n = 14;
    let groups: Vec<Vec<u32>> = (0..n as u32 - 4).map(|k| (k..k + 5).collect()).collect();
    let pattern = Arc::new(SparsePattern::from_groups(n, groups.iter().map(Vec::as_slice)));
    let points: Vec<[f64; 2]> = (0..n).map(|k| [k as f64, 0.0]).collect();
    for diagonal in [0.3, 9.0] {
        let mut matrix = SparseMatrix::zero(&pattern);
        for column in 0..n {
            pattern.range(column).for_each(|at| matrix.values_mut()[at] = (1.0 + 0.37 * at as f64).sin());
            let at = pattern.place(column, column).unwrap();
            matrix.values_mut()[at] += diagonal;
        }
        let exact: Vec<f64> = (0..2 * n).map(|k| (0.1 + 1.3 * k as f64).cos()).collect();
        let rhs: Vec<f64> = exact.chunks(n).flat_map(|x| matrix.times(x)).collect();
        for choice in [LuChoice::Banded, LuChoice::Nested] {
            let mut factor = LuPlan::new(&pattern, &points, choice).factor();
            factor.refactor(&matrix).unwrap();
            let mut found = rhs.clone();
            factor.solve(&mut found);
            let off = found.iter().zip(&exact).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(off < 1e-9, "{choice:?}, diagonal {diagonal}: {off:e}");
        }
    }
}
