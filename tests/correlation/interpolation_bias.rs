//! The bias of the interpolation that the texture predicts (THEORY 21), against images of another renderer.

use crate::common::scenes::{SPOT_PX, Spots, rendered};
use crate::common::{inside, mean, prepared};
use quadrille::correlate::Options;
use quadrille::field::Status;
use quadrille::imaging::{Image, Interpolation, Pixels};
use std::sync::Arc;

const SIDE: usize = 320;

/// Without noise and rounding, so that only the interpolation is off.
fn image(spots: &Spots, shift: [f64; 2]) -> Arc<Image> {
    let exact = rendered(SIDE, |y| spots.grey([y[0] - shift[0], y[1] - shift[1]]));
    let pixels = exact.into_iter().map(|grey| grey as f32).collect();
    Arc::new(Image::new(SIDE, SIDE, Pixels::F32(pixels)).unwrap())
}

#[test]
fn the_bias_of_the_interpolation_is_predicted_by_the_texture() {
    let shift = [0.25, 0.4];
    for (width, interpolation) in [
        (SPOT_PX, Interpolation::Cubic),
        (SPOT_PX, Interpolation::Quintic),
        (0.8, Interpolation::Cubic),
        (0.8, Interpolation::Quintic),
    ] {
        let spots = Spots::new(3, SIDE, width);
        let options = Options { interpolation, tolerance_px: 1e-6, tolerance_by_sigma: 0.0, ..Options::default() };
        let correlator = prepared(&image(&spots, [0.0; 2]), &inside(SIDE, SIDE, 24), options);
        let found = correlator.correlate(image(&spots, shift), None).unwrap();
        assert_eq!(found.measurement.status, Status::Converged);
        let errors: Vec<[f64; 2]> =
            found.measurement.displacement.iter().map(|u| [u[0] - shift[0], u[1] - shift[1]]).collect();
        let (seen, predicted) = (mean(&errors).map(f64::abs), found.interpolation_bias_px);
        let [predicted_px, seen_px] = [predicted, seen].map(|bias| bias.map(|px| format!("{px:.1e}")).join(", "));
        println!("| {width} px | {} | {predicted_px} | {seen_px} |", interpolation.name());
        for c in 0..2 {
            // A texture in the mean of its waves: within half; the kernels differ by three (fine) and ten (soft).
            let ratio = predicted[c] / seen[c];
            assert!((0.5..2.0).contains(&ratio), "{width} px, {}: {predicted:?}, {seen:?}", interpolation.name());
        }
    }
}
