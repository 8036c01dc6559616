//! Noise of one image.

use super::colour::{ByGrey, NoiseCorrelation, PhotonFit, Products};
use super::region::Region;
use super::spline::Spline;
use super::texture::TextureFigures;
use super::wave::WavePicture;
use super::{MetrologyError, Still, grey_levels};
use crate::backend::cpu::CpuBackend;
use crate::correlate::{Correlator, Options as CorrelateOptions, assumed_noise};
use crate::field::{Measurement, Status};
use crate::imaging::{Image, Interpolation, Levels};
use crate::mesh::{PixelSet, shape_functions};
use crate::units::Px;
use serde::Serialize;
use std::sync::Arc;

/// Where the noise comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Origin {
    /// Measured between images of the specimen at rest.
    StaticImages,
    /// Given by the user.
    Given,
    /// Assumed: all that the highest spatial frequencies of the one image hold is taken for noise.
    Assumed,
}

/// Noise of one image, its standard deviation in grey levels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Noise {
    /// The noise that everything else is made with. From static images: the root mean square of the pairs.
    pub sigma_grey: f64,
    /// Where it comes from.
    pub origin: Origin,
    /// White noise in the reference is at most this: all that its highest spatial frequencies hold.
    pub ceiling_grey: f64,
    /// What the texture check of `correlate` takes for noise when none is given (careful not to refuse).
    pub assumed_by_correlate_grey: f64,
    /// Each static image against the reference.
    pub pairs: Vec<StaticPair>,
    /// Noise in three equal parts of the range of grey levels, dark to bright. Empty unless measured.
    pub by_grey: Vec<GreyNoise>,
    /// How its variance rises with the grey level. `None` unless measured, on a range of grey levels.
    pub photon: Option<PhotonFit>,
    /// How it goes together from pixel to pixel. `None` unless measured.
    pub correlation: Option<NoiseCorrelation>,
}

/// What one static image says.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StaticPair {
    /// The image.
    pub name: String,
    /// Noise of one image, grey levels, without drift and change of light: root mean square of both images.
    pub sigma_grey: f64,
    /// White noise in this image is at most this.
    pub ceiling_grey: f64,
    /// Drift of the middle of the zone, px.
    pub drift_px: [f64; 2],
    /// Rotation, degrees.
    pub rotation_deg: f64,
    /// `f = gain g + offset`.
    pub gain: f64,
    /// The offset, grey levels.
    pub offset_grey: f64,
}

/// Noise of the pixels of similar grey level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GreyNoise {
    /// Grey levels from ...
    pub from_grey: f64,
    /// ... to.
    pub to_grey: f64,
    /// Noise of one image there.
    pub sigma_grey: f64,
    /// Pixels counted, over all pairs.
    pub n_pixels: usize,
}

impl Noise {
    /// White noise that can be in the reference, grey levels.
    pub(super) fn in_reference(&self) -> f64 {
        self.sigma_grey.min(self.ceiling_grey)
    }

    /// Whether bright pixels are noisier or quieter than dark ones by more than 10 % of the mean.
    pub fn depends_on_grey(&self) -> bool {
        let levels = self.by_grey.iter().filter(|part| part.n_pixels >= 1000).map(|part| part.sigma_grey);
        let (low, high) = levels.fold((f64::INFINITY, 0.0f64), |(low, high), s| (low.min(s), high.max(s)));
        high - low > 0.1 * self.sigma_grey
    }
}

/// Side of the elements that follow the drift, px: the largest of these that fits. They take few degrees of
/// freedom from the noise; and enough of them to see whether it is correlated.
const DRIFT_ELEMENTS: [usize; 5] = [64, 48, 32, 24, 16];

const ENOUGH_ELEMENTS: usize = 60;

/// The noise, from `stills` if there are any, else as `given`, else assumed.
pub(super) fn noise(
    reference: &Arc<Image>,
    stills: &[Still],
    given: Option<f64>,
    region: &Region,
) -> Result<Noise, MetrologyError> {
    let part = region.cut(reference);
    let ceiling_grey = WavePicture::noise_ceiling(&part);
    let assumed_by_correlate_grey =
        assumed_noise(&part, &[PixelSet::Box { x0: 0, y0: 0, x1: part.width(), y1: part.height() }]);
    let alone = |sigma_grey, origin| Noise {
        sigma_grey,
        origin,
        ceiling_grey,
        assumed_by_correlate_grey,
        pairs: Vec::new(),
        by_grey: Vec::new(),
        photon: None,
        correlation: None,
    };
    if let Some(given) = given {
        return Ok(alone(given, Origin::Given));
    }
    if stills.is_empty() {
        // Too much rather than too little: what is assumed must not promise an accuracy.
        return Ok(alone(ceiling_grey.max(rounding(&part)), Origin::Assumed));
    }
    for still in stills {
        let [size, of_reference] = [&still.image, reference].map(|image| [image.width(), image.height()]);
        if size != of_reference {
            return Err(MetrologyError::StaticSize { name: still.name.clone(), size, reference: of_reference });
        }
        if still.image.pixels() == reference.pixels() {
            return Err(MetrologyError::StaticIsReference(still.name.clone()));
        }
    }
    let fitting = || DRIFT_ELEMENTS.into_iter().filter(|&size| region.fits(size));
    let element_size =
        fitting().find(|&size| region.elements(size) >= ENOUGH_ELEMENTS).or(fitting().next()).unwrap_or(16);
    // Quintic: what interpolation does to the texture would count as noise.
    let interpolation = Interpolation::Quintic;
    let options =
        CorrelateOptions { element_size, interpolation, drop_textureless: true, ..CorrelateOptions::default() };
    let correlator = Correlator::new(CpuBackend::default(), part.clone(), &region.zones(), options)?;
    let (mut bins, mut pairs, mut colours) = (Bins::new(&part, region), Vec::new(), Vec::new());
    for still in stills {
        let name = still.name.clone();
        let image = region.cut(&still.image);
        if image.is_constant() {
            return Err(MetrologyError::StaticConstant { name, grey: image.grey(0, 0) });
        }
        let result = correlator.correlate(image.clone(), None)?;
        let status = result.measurement.status;
        let (Status::Converged, Some(rigid), Some(zone)) = (status, result.rigid, result.zones.first()) else {
            return Err(MetrologyError::StaticLost { name, status });
        };
        let offset_grey = correlator.offset_of(zone.transfer);
        bins.add(&part, &image, &result.measurement, zone.transfer.gain, offset_grey, interpolation);
        colours.extend(result.noise_colour.map(|colour| (colour.factor, colour.factor_sigma)));
        pairs.push(StaticPair {
            name,
            sigma_grey: zone.noise,
            ceiling_grey: WavePicture::noise_ceiling(&image),
            drift_px: rigid.translation,
            rotation_deg: rigid.rotation_rad.to_degrees(),
            gain: zone.transfer.gain,
            offset_grey,
        });
    }
    let sigma_grey = (pairs.iter().map(|pair| pair.sigma_grey.powi(2)).sum::<f64>() / pairs.len() as f64).sqrt();
    let [along_x, along_y] = bins.products.finish();
    let n = colours.len() as f64;
    let factor = (n > 0.0).then(|| [0, 1].map(|c| colours.iter().map(|(factor, _)| factor[c]).sum::<f64>() / n));
    // Pairs share the reference: together they are hardly better than one.
    let factor_sigma = (n > 0.0).then(|| colours.iter().map(|(_, sigma)| sigma).sum::<f64>() / n);
    let correlation = Some(NoiseCorrelation { along_x, along_y, factor, factor_sigma });
    let (by_grey, photon) = bins.finish();
    Ok(Noise { pairs, by_grey, photon, correlation, ..alone(sigma_grey, Origin::StaticImages) })
}

/// Noise of the rounding to whole grey levels; a trace for floats, since no image is without any.
fn rounding(image: &Image) -> f64 {
    match image.pixels() {
        Levels::F32(_) => 1e-6 * f64::from(image.range().1 - image.range().0),
        _ => 1.0 / 12f64.sqrt(),
    }
}

/// Squared residuals by grey level.
struct Bins {
    edges: [f64; 4],
    sum: [f64; 3],
    n: [usize; 3],
    fine: ByGrey,
    products: Products,
}

impl Bins {
    fn new(reference: &Image, region: &Region) -> Self {
        let sorted = grey_levels(reference, region);
        let [low, high] = TextureFigures::percentiles(&sorted);
        Self {
            edges: [0.0, 1.0, 2.0, 3.0].map(|k| low + k / 3.0 * (high - low)),
            sum: [0.0; 3],
            n: [0; 3],
            fine: ByGrey::new(reference, [low, high]),
            products: Products::default(),
        }
    }

    fn add(
        &mut self,
        reference: &Image,
        deformed: &Image,
        field: &Measurement<Px>,
        gain: f64,
        offset: f64,
        interpolation: Interpolation,
    ) {
        let spline = Spline::new(deformed);
        let mesh = &field.mesh;
        for nodes in mesh.elements() {
            let nodes = nodes.map(|node| node as usize);
            if !nodes.iter().all(|&node| field.measured[node]) {
                continue;
            }
            // The zone is a rectangle: so are its elements.
            let ([x0, y0], [x1, y1]) = (mesh.nodes()[nodes[0]], mesh.nodes()[nodes[2]]);
            let at = |xi, eta| -> [f64; 2] {
                let psi = shape_functions(xi, eta);
                [0, 1].map(|c| nodes.iter().zip(psi).map(|(&node, psi)| psi * field.displacement[node][c]).sum())
            };
            // Interpolation lets this share of the noise of g through.
            let middle = at(0.5, 0.5);
            let [cx, cy] = middle.map(|u| interpolation.noise_gain(u - u.floor()));
            let by_variance = 1.0 / (1.0 + gain * gain * cx * cy);
            let columns = x0.ceil() as usize..x1.ceil() as usize;
            let mut residual = Vec::new();
            for y in y0.ceil() as usize..y1.ceil() as usize {
                for x in columns.clone() {
                    let u = at((x as f64 - x0) / (x1 - x0), (y as f64 - y0) / (y1 - y0));
                    let Some(g) = spline.grey(x as f64 + u[0], y as f64 + u[1]) else {
                        residual.push(None);
                        continue;
                    };
                    let (f, g) = (f64::from(reference.grey(x, y)), gain * g + offset);
                    residual.push(Some(f - g));
                    // Noise of the mean of both is not correlated with their difference: it does not select the noise.
                    let grey = 0.5 * (f + g);
                    self.fine.add(grey, (f - g).powi(2) * by_variance);
                    if let Some(bin) = (0..3).find(|&k| grey >= self.edges[k] && grey < self.edges[k + 1]) {
                        self.sum[bin] += (f - g).powi(2) * by_variance;
                        self.n[bin] += 1;
                    }
                }
            }
            self.products.add(&residual, columns.len(), middle, gain, interpolation);
        }
    }

    fn finish(self) -> (Vec<GreyNoise>, Option<PhotonFit>) {
        let part = |k: usize| GreyNoise {
            from_grey: self.edges[k],
            to_grey: self.edges[k + 1],
            sigma_grey: (self.sum[k] / self.n[k].max(1) as f64).sqrt(),
            n_pixels: self.n[k],
        };
        ((0..3).map(part).collect(), self.fine.fit())
    }
}
