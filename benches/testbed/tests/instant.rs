//! The device that answers at once: it says that it measures nothing.

use quadrille::backend::cpu::CpuBackend;
use quadrille::backend::{Backend, InstantBackend};
use quadrille::correlate::{Correlation, Correlator, Options, Start};
use quadrille::field::Status;
use quadrille::imaging::Image;
use quadrille::isa::Isa;
use quadrille::mesh::{Roi, Zone};
use quadrille::synth::{RenderOptions, Texture, Translation, render};
use std::sync::Arc;

const SIDE: usize = 256;

fn picture(shift: [f64; 2]) -> Arc<Image> {
    let texture = Texture::new(7, 4.5).unwrap();
    render(&texture, &Translation(shift), &RenderOptions::new(SIDE, SIDE)).map(Arc::new).unwrap()
}

fn prepared<B: Backend>(backend: B, reference: &Arc<Image>) -> Correlator<B> {
    let side = SIDE as f64;
    let zone = Zone::rectangle("all", Roi { x0: 0.0, y0: 0.0, x1: side, y1: side });
    Correlator::new(backend, reference.clone(), &[zone], Options::default()).unwrap()
}

fn bits(found: &Correlation) -> Vec<[u64; 2]> {
    found.measurement.displacement.iter().map(|u| u.map(f64::to_bits)).collect()
}

#[test]
fn a_device_that_takes_no_time_says_so_and_answers_every_prediction_as_the_first() {
    let reference = picture([0.0; 2]);
    let [first, second] = [1.3, 1.9].map(|x| picture([x, -0.4]));
    let correlator = prepared(InstantBackend::new(Isa::detect()), &reference);
    assert!(correlator.device().contains("nothing is measured"), "{}", correlator.device());
    let cpu = prepared(CpuBackend::default(), &reference);
    let cold = cpu.correlate(first.clone(), None).unwrap();
    let start = Start::new(
        cold.full_displacement().iter().map(|u| [u[0] + 0.1, u[1]]).collect(),
        cold.zones.iter().map(|zone| zone.transfer).collect(),
    );
    let from = |image: &Arc<Image>| correlator.correlate(image.clone(), Some(&start)).unwrap();
    // The first that begins at a prediction is measured: the same bits as on the CPU.
    let want = cpu.correlate(first.clone(), Some(&start)).unwrap();
    let measured = from(&first);
    assert_eq!(bits(&measured), bits(&want));
    assert!(measured.iterations > 1);
    // What comes after it is not, whatever the image shows.
    let answered = from(&second);
    assert_eq!(answered.measurement.displacement, measured.measurement.displacement);
    assert_eq!((answered.iterations, answered.measurement.status), (measured.iterations, Status::Converged));
    let other = cpu.correlate(second, None).unwrap().measurement.displacement;
    let apart = other.iter().zip(&answered.measurement.displacement).map(|(a, b)| (a[0] - b[0]).abs());
    assert!(apart.fold(0.0, f64::max) > 0.5, "the second image shows something else");
}
