//! Standard uncertainties of a specimen that has stretched far (THEORY 18), on images of another renderer.

use crate::common::scenes::{AffineMotion, SPOT_PX, Spots, photographed};
use crate::common::{inside, prepared};
use quadrille::correlate::{Options, Tracker};
use quadrille::field::Status;

const SIDE: usize = 320;
const NOISE: f64 = 2.0;

/// Stretched along x by `stretch`, narrower along y by its root, and turned by `degrees`.
fn motion(stretch: f64, degrees: f64) -> AffineMotion {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let narrow = 1.0 / stretch.sqrt();
    let gradient = [[cos * stretch - 1.0, -sin * narrow], [sin * stretch, cos * narrow - 1.0]];
    AffineMotion { shift: [0.0; 2], gradient, centre: 0.5 * SIDE as f64 }
}

#[test]
fn uncertainties_are_those_of_the_stretched_and_turned_image() {
    let spots = Spots::new(5, SIDE, SPOT_PX);
    let reference = photographed(SIDE, NOISE, 1, |x| spots.grey(x));
    // What is stretched by half stays in the image.
    let correlator = prepared(&reference, &inside(SIDE, SIDE, 64), Options { element_size: 12, ..Options::default() });
    for degrees in [0.0, 70.0] {
        let mut tracker = Tracker::new(&correlator);
        for (number, stretch) in (1u32..).zip([1.0, 1.15, 1.3, 1.45]) {
            // Turned in steps that the search follows.
            let motion = motion(stretch, degrees * f64::from(number) / 4.0);
            let deformed = photographed(SIDE, NOISE, 10 + u64::from(number), |y| spots.grey(motion.material(y)));
            let found = tracker.correlate(number as usize, deformed).unwrap().measurement;
            assert_eq!(found.status, Status::Converged, "{stretch}, {degrees}");
            let nodes = (0..found.mesh.n_nodes()).filter(|&node| found.measured[node]);
            let (mut squares, mut n) = ([0.0; 2], 0.0);
            for node in nodes {
                let truth = motion.displacement(found.mesh.nodes()[node]);
                (0..2).for_each(|c| {
                    squares[c] += ((found.displacement[node][c] - truth[c]) / found.sigma[node][c]).powi(2);
                });
                n += 1.0;
            }
            assert!(n > 200.0, "{n} nodes");
            let [zx, zy] = squares.map(|sum: f64| (sum / n).sqrt());
            println!("stretch {stretch}, {degrees} degrees: z {zx:.2}, {zy:.2}");
            // Neighbouring nodes scatter together, so that z of 289 scatters by about 0.05; without F the last ones
            // are 1.45 and 0.83.
            assert!((zx - 1.0).abs() < 0.16 && (zy - 1.0).abs() < 0.16, "{stretch}, {degrees}: {zx} {zy}");
        }
    }
}
