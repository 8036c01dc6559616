//! What can be measured on the user's images: noise, texture, uncertainty, resolution, and the element size for them.
//!
//! Everything is measured with the correlation itself, on noisy copies of the reference image that are moved by known
//! amounts without interpolation. `docs/metrology.md` says how, and what it does not show.

mod advice;
mod colour;
mod error;
mod gauge;
mod noise;
mod region;
mod spline;
pub mod target;
mod texture;
mod theory;
mod trials;
mod wave;

pub use advice::Advice;
pub use colour::{NoiseCorrelation, PhotonFit};
pub use error::MetrologyError;
pub use gauge::{STRAIN_WINDOWS, StrainGauge, StrainGauges, StrainNoiseOn};
pub use noise::{GreyNoise, Noise, Origin, StaticPair};
pub use texture::TextureFigures;
pub use theory::{
    Crest, RESOLVED, displacement_sigma_px, strain_period_by_size, strain_sigma, strain_wave_gain, wave_gain,
};
pub use trials::{Bias, Resolved, Scatter};

use crate::correlate::CorrelationError;
use crate::field::StrainWindow;
use crate::imaging::{Image, Interpolation};
use crate::mesh::Roi;
use gauge::Windows;
use rayon::prelude::*;
use region::Region;
use serde::Serialize;
use std::sync::Arc;
use trials::{Trials, with_texture};
use wave::WavePicture;

/// Element sizes that are tried unless others are asked for, px.
pub const ELEMENT_SIZES: [usize; 8] = [6, 8, 12, 16, 24, 32, 48, 64];

/// An image of the specimen at rest, beside the reference.
#[derive(Debug, Clone)]
pub struct Still {
    /// What messages call it.
    pub name: String,
    /// The image.
    pub image: Arc<Image>,
}

/// Choices of a metrology.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Element sizes, px; `None` for those of [`ELEMENT_SIZES`] that fit.
    pub element_sizes: Option<Vec<usize>>,
    /// The rectangle to look at; `None` for the whole image. Of a large one the middle is used.
    pub roi: Option<Roi>,
    /// Standard deviation of the noise of one image, grey levels; from static images or assumed if `None`.
    pub noise: Option<f64>,
    /// Interpolation of the correlation.
    pub interpolation: Interpolation,
    /// Standard uncertainty that the recommended elements reach, px.
    pub target_sigma_px: f64,
    /// Period that the recommended elements resolve at 90 %, px, if one is asked for.
    pub resolve_period_px: Option<f64>,
    /// Windows of virtual strain gauges, beside the element; `None` for those of [`STRAIN_WINDOWS`] that fit.
    pub strain_windows: Option<Vec<StrainWindow>>,
    /// Seed of the noise that is added.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            element_sizes: None,
            roi: None,
            noise: None,
            interpolation: Interpolation::default(),
            target_sigma_px: 0.02,
            resolve_period_px: None,
            strain_windows: None,
            seed: 1,
        }
    }
}

/// What elements of one size measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SizeResult {
    /// Side of the elements, px.
    pub element_size_px: usize,
    /// Nodes of the mesh on the zone that is looked at.
    pub n_nodes: usize,
    /// Nodes that the texture check refuses, per cent.
    pub refused_percent: f64,
    /// Standard uncertainty of an inner node by the formula `sqrt(6) sigma / (l g)`, along x and y, px.
    pub sigma_formula_px: [f64; 2],
    /// The same as `correlate` would predict it: root mean square over the inner nodes; `None` without any.
    pub sigma_predicted_px: Option<[f64; 2]>,
    /// Measured on displaced copies with noise; `None` when nothing converged.
    pub measured: Option<Scatter>,
    /// Standard uncertainty of exx and eyy at the centre of an element, `2.36 sigma / (l^2 g)`.
    pub strain_sigma_formula: [f64; 2],
    /// Period resolved at 90 % by theory: best, averaged over phase, worst, px.
    pub period_theory_px: [f64; 3],
    /// The same measured.
    pub period_measured: Option<Resolved>,
    /// Measured uncertainty (the larger component) times measured period averaged over phase, px^2.
    pub sigma_times_period_px2: Option<f64>,
}

impl SizeResult {
    /// The larger component of the measured standard uncertainty of inner nodes, px.
    pub fn sigma_px(&self) -> Option<f64> {
        self.measured.as_ref().map(|scatter| scatter.inner_px[0].max(scatter.inner_px[1]))
    }

    /// The period resolved at 90 % averaged over phase, px: measured, else by theory.
    pub fn period_px(&self) -> f64 {
        self.period_measured.and_then(|periods| periods.averaged_px).unwrap_or(self.period_theory_px[1])
    }
}

/// Everything that was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrology {
    /// The zone that was looked at: left, top, right, bottom, px, the last two not included.
    pub zone_px: [usize; 4],
    /// Noise of one image.
    pub noise: Noise,
    /// Texture of the reference.
    pub texture: TextureFigures,
    /// Element size by element size.
    pub sizes: Vec<SizeResult>,
    /// Noise and resolution of virtual strain gauges.
    pub strain_gauges: StrainGauges,
    /// Element size of the bias, px.
    pub bias_element_size_px: usize,
    /// Bias of each interpolation.
    pub bias: Vec<Bias>,
    /// What to do.
    pub advice: Advice,
}

/// What one image alone shows, in a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Its noise: assumed, unless it is given.
    pub noise: Noise,
    /// Its texture.
    pub texture: TextureFigures,
}

/// Noise and texture of `reference` within `roi` (else all of it), as [`measure`] finds them without static images.
///
/// # Errors
/// A region that does not fit the image, or without texture.
pub fn look(reference: &Arc<Image>, roi: Option<Roi>, noise: Option<f64>) -> Result<Look, MetrologyError> {
    let (region, part) = cut_out(reference, roi)?;
    let noise = noise::noise(reference, &[], noise, &region)?;
    let texture = TextureFigures::new(&part, &region, noise.in_reference());
    Ok(Look { noise, texture })
}

/// What is looked at of `reference`, which has some contrast.
fn cut_out(reference: &Image, roi: Option<Roi>) -> Result<(Region, Arc<Image>), MetrologyError> {
    let region = Region::new(reference, roi)?;
    let part = region.cut(reference);
    if part.is_constant() { Err(MetrologyError::Constant { grey: part.grey(0, 0) }) } else { Ok((region, part)) }
}

/// Measures what can be measured on `reference`, with the noise of `stills` where there are any.
///
/// # Errors
/// Options or a region that do not fit; no texture; static images of another size, equal, or that do not match.
pub fn measure(reference: &Arc<Image>, stills: &[Still], options: &Options) -> Result<Metrology, MetrologyError> {
    check(options)?;
    let (region, part) = cut_out(reference, options.roi)?;
    let sizes = sizes(options, &region)?;
    let noise = noise::noise(reference, stills, options.noise, &region)?;
    let texture = TextureFigures::new(&part, &region, noise.in_reference());
    if texture.weaker_gradient() <= 0.0 {
        return Err(MetrologyError::OnlyNoise(noise.sigma_grey));
    }
    let picture = WavePicture::new(&part, noise.in_reference());
    let interpolation = options.interpolation;
    let trials = Trials { region: &region, picture: &picture, noise: noise.sigma_grey, interpolation };
    let windows = Windows::new(options.strain_windows.as_deref());
    let scatter = trials.scatter(&sizes, stills.is_empty().then_some(&windows), options.seed)?;
    let (scatter, strains): (Vec<_>, Vec<_>) = scatter.into_iter().unzip();
    // One size a task: much of a small correlation runs on one thread.
    let results: Vec<SizeResult> = (sizes.par_iter().zip(scatter))
        .map(|(&size, measured)| size_result(&trials, &part, &texture, size, measured))
        .collect::<Result<_, _>>()?;
    if results.iter().all(|result| result.sigma_predicted_px.is_none()) {
        return Err(CorrelationError::Textureless { stated: None, larger: None }.into());
    }
    let strain_gauges = strain_gauges(&trials, &part, stills, &windows, &results, strains)?;
    let bias_element_size_px = bias_size(&results, &texture);
    let bias = trials.bias(bias_element_size_px)?;
    let advice = Advice::new(&noise, &texture, &results, &bias, options);
    let zone_px = region.in_image();
    Ok(Metrology { zone_px, noise, texture, sizes: results, strain_gauges, bias_element_size_px, bias, advice })
}

/// The noise of strains: on the static images where there are any, else on the moved copies (`on_copies`).
fn strain_gauges(
    trials: &Trials<'_>,
    part: &Arc<Image>,
    stills: &[Still],
    windows: &Windows,
    results: &[SizeResult],
    on_copies: Vec<gauge::Sums>,
) -> Result<StrainGauges, MetrologyError> {
    let [x0, y0, x1, y1] = trials.region.zone;
    let gauges = |result: &SizeResult, sigma, found: &gauge::Sums| {
        let size = result.element_size_px;
        windows.gauges(size, (x1 - x0).min(y1 - y0) / size + 1, sigma, found)
    };
    if stills.is_empty() {
        let rows = results.iter().zip(&on_copies);
        let gauges = rows.flat_map(|(result, found)| gauges(result, result.sigma_predicted_px, found)).collect();
        return Ok(StrainGauges { measured_on: StrainNoiseOn::MovedCopies, gauges });
    }
    let stills: Vec<Arc<Image>> = stills.iter().map(|still| trials.region.cut(&still.image)).collect();
    let of_size = |result: &SizeResult| {
        let (found, sigma) = trials.at_rest(part, &stills, windows, result.element_size_px)?;
        Ok(gauges(result, sigma, &found))
    };
    let by_size: Vec<Vec<StrainGauge>> = results.par_iter().map(of_size).collect::<Result<_, MetrologyError>>()?;
    Ok(StrainGauges { measured_on: StrainNoiseOn::StaticImages, gauges: by_size.into_iter().flatten().collect() })
}

fn check(options: &Options) -> Result<(), MetrologyError> {
    let positive = |v: f64| v.is_finite() && v > 0.0;
    let fault = |name, value: f64, wanted| Err(MetrologyError::Option { name, value: value.to_string(), wanted });
    let pixels = "a positive number of pixels";
    match (options.noise, options.target_sigma_px, options.resolve_period_px) {
        (Some(noise), ..) if !positive(noise) => {
            fault("the noise", noise, "a positive standard deviation in grey levels")
        }
        (_, target, _) if !positive(target) => fault("the target uncertainty", target, pixels),
        (.., Some(period)) if !positive(period) => fault("the period to resolve", period, pixels),
        _ => Ok(()),
    }
}

/// The element sizes, rising, each once.
fn sizes(options: &Options, region: &Region) -> Result<Vec<usize>, MetrologyError> {
    let [x0, y0, x1, y1] = region.zone;
    let Some(asked) = &options.element_sizes else {
        return Ok(ELEMENT_SIZES.into_iter().filter(|&size| region.fits(size)).collect());
    };
    let mut sizes = asked.clone();
    sizes.sort_unstable();
    sizes.dedup();
    if sizes.is_empty() {
        return Err(MetrologyError::NoSize);
    }
    for &size in &sizes {
        if !(4..=128).contains(&size) {
            return Err(MetrologyError::ElementSize { size });
        }
        if !region.fits(size) {
            return Err(MetrologyError::ElementTooLarge { size, zone: [x1 - x0, y1 - y0] });
        }
    }
    Ok(sizes)
}

fn size_result(
    trials: &Trials<'_>,
    part: &Arc<Image>,
    texture: &TextureFigures,
    size: usize,
    measured: Option<Scatter>,
) -> Result<SizeResult, MetrologyError> {
    let sigma = trials.noise;
    let side = size as f64;
    let [x0, y0, x1, y1] = trials.region.zone;
    let mut result = SizeResult {
        element_size_px: size,
        n_nodes: ((x1 - x0) / size + 1) * ((y1 - y0) / size + 1),
        refused_percent: 100.0,
        sigma_formula_px: texture.gradient_grey_per_px.map(|g| displacement_sigma_px(sigma, side, g)),
        sigma_predicted_px: None,
        measured,
        strain_sigma_formula: texture.gradient_grey_per_px.map(|g| strain_sigma(sigma, side, g)),
        period_theory_px: Crest::ALL.map(|crest| side * crest.resolved_period_by_size()),
        period_measured: None,
        sigma_times_period_px2: None,
    };
    if let Some(correlator) = with_texture(trials.correlator(part, size, trials.interpolation, sigma))? {
        result.refused_percent = 100.0 * correlator.dropped().len() as f64 / result.n_nodes as f64;
        result.sigma_predicted_px = trials::predicted(&correlator, sigma);
        result.period_measured = Some(trials.resolved(size)?);
    }
    let period = result.period_measured.and_then(|periods| periods.averaged_px);
    result.sigma_times_period_px2 = result.sigma_px().zip(period).map(|(sigma, period)| sigma * period);
    Ok(result)
}

/// The size whose bias is shown: 16 px, or what holds three speckles if that is more.
fn bias_size(results: &[SizeResult], texture: &TextureFigures) -> usize {
    let least = (3.0 * texture.larger_speckle_px().unwrap_or(0.0)).max(16.0);
    let usable = || results.iter().filter(|result| result.sigma_predicted_px.is_some());
    let large_enough = usable().find(|result| result.element_size_px as f64 >= least);
    large_enough.or_else(|| usable().next_back()).map_or(16, |result| result.element_size_px)
}

/// Grey levels of the zone, sorted.
fn grey_levels(image: &Image, region: &Region) -> Vec<f32> {
    let [x0, y0, x1, y1] = region.zone;
    let mut greys: Vec<f32> = (y0..y1).flat_map(|y| (x0..x1).map(move |x| image.grey(x, y))).collect();
    greys.sort_by(f32::total_cmp);
    greys
}
