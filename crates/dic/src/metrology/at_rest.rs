//! The noise of strains between images of the specimen at rest.

use super::MetrologyError;
use super::gauge::{Lattice, Sums, Windows};
use super::trials::Trials;
use crate::backend::cpu::CpuBackend;
use crate::correlate::{CorrelationError, Correlator, Options as CorrelateOptions};
use crate::field::Status;
use crate::imaging::Image;
use std::sync::Arc;

/// Static images that are correlated with every element size, at most.
const MOST_STILLS: usize = 8;

/// The noise of strains between the reference and images of the specimen at rest, with elements of `size` px; and the
/// standard uncertainty of inner nodes that goes with it, px.
pub(super) fn at_rest(
    trials: &Trials<'_>,
    reference: &Arc<Image>,
    stills: &[Arc<Image>],
    windows: &Windows,
    size: usize,
) -> Result<(Sums, Option<[f64; 2]>), MetrologyError> {
    let options = CorrelateOptions {
        element_size: size,
        interpolation: trials.interpolation,
        drop_textureless: true,
        ..CorrelateOptions::default()
    };
    let (mut sums, mut squares, mut n) = (Sums::default(), [0.0; 2], 0.0);
    let correlator = match Correlator::new(CpuBackend::default(), reference.clone(), &trials.region.zones(), options) {
        Ok(correlator) => correlator,
        Err(CorrelationError::Textureless | CorrelationError::NoTexture { .. }) => return Ok((sums, None)),
        Err(error) => return Err(error.into()),
    };
    for still in stills.iter().take(MOST_STILLS) {
        let field = correlator.correlate(still.clone(), None)?.measurement;
        if field.status != Status::Converged {
            continue;
        }
        sums.add_still(windows, &field);
        let lattice = Lattice::new(&field);
        for node in (0..field.sigma.len()).filter(|&node| lattice.is_inner(node)) {
            (0..2).for_each(|c| squares[c] += field.sigma[node][c] * field.sigma[node][c]);
            n += 1.0;
        }
    }
    Ok((sums, (n > 0.0).then(|| squares.map(|sum: f64| (sum / n).sqrt()))))
}
