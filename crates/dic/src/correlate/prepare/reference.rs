//! What is known of a prepared reference, whatever the device.

use crate::backend::{ElementMoments, GreyTransfer, KernelOptions};
use crate::correlate::{BareBorder, Correlation, NodalSpread, Options, TextureFault, ZoneResult, gradient_sums};
use crate::field::{Brightness, Elements};
use crate::linalg::{BlockMatrix, ElementMatrix};
use crate::mesh::{Mesh, PixelSet};
use crate::units::Px;
use std::sync::Arc;

/// What [`crate::correlate::Correlator`] and [`crate::correlate::Correlate`] know of a reference, but for the device.
pub struct Reference {
    pub(crate) device: String,
    pub(crate) frames_in_flight: usize,
    pub(crate) options: Options,
    /// That of the finest level.
    pub(crate) kernel: KernelOptions,
    pub(crate) size: [usize; 2],
    pub(crate) mesh: Arc<Mesh<Px>>,
    pub(crate) moments: Arc<Vec<ElementMoments>>,
    pub(crate) n_levels: usize,
    pub(crate) solver_name: &'static str,
    /// The pixels of each zone that are summed over.
    pub(crate) zone_pixels: Vec<PixelSet>,
    pub(crate) spread: NodalSpread,
    /// That of the finest level.
    pub(crate) penalty: Option<Arc<BlockMatrix>>,
    pub(crate) tolerance_px: f64,
    pub(crate) dropped: Vec<TextureFault>,
    pub(crate) held: Vec<TextureFault>,
    pub(crate) bare_borders: Vec<BareBorder>,
    pub(crate) grey_range: f64,
    pub(crate) smoothing_px: f64,
    pub(crate) n_hot_pixels: usize,
}

impl Reference {
    /// The device: its name and the instruction path or driver.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Frames worth correlating at the same time there, when they do not depend on each other.
    pub fn frames_in_flight(&self) -> usize {
        self.frames_in_flight
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The mesh, px of the reference image.
    pub fn mesh(&self) -> &Arc<Mesh<Px>> {
        &self.mesh
    }

    /// Nodes left out because the reference has no texture there.
    pub fn dropped(&self) -> &[TextureFault] {
        &self.dropped
    }

    /// Nodes without texture of their own, which the regularisation holds: they follow the nodes around them.
    pub fn held(&self) -> &[TextureFault] {
        &self.held
    }

    /// Zones that end at a place without texture and have no guard there.
    pub fn bare_borders(&self) -> &[BareBorder] {
        &self.bare_borders
    }

    /// Range of grey levels of the reference: 100 % for residuals.
    pub fn grey_range(&self) -> f64 {
        self.grey_range
    }

    /// Standard deviation, px, of the Gaussian by which the reference is smoothed for its gradient: 0 but for references
    /// with so much noise that displacements are more certain with it.
    pub fn smoothing_px(&self) -> f64 {
        self.smoothing_px
    }

    /// Pixels of the zones that stand alone in the reference, as hot and dead pixels of a sensor do. Where they show in an
    /// image as well, what their neighbours say takes their place.
    pub fn n_hot_pixels(&self) -> usize {
        self.n_hot_pixels
    }

    /// Grey levels that a transfer adds after its gain, in the images' own scale.
    pub fn offset_of(&self, transfer: GreyTransfer) -> f64 {
        transfer.offset + f64::from(self.kernel.grey_offset) * (1.0 - transfer.gain)
    }

    /// Number of pyramid levels, the image itself included.
    pub fn n_levels(&self) -> usize {
        self.n_levels
    }

    /// The solver of the finest level: `direct` or `iterative`.
    pub fn solver_name(&self) -> &'static str {
        self.solver_name
    }

    /// Standard uncertainty per node for image noise of one grey level: `sqrt(2 (M^-1)_ii)`, px; with
    /// regularisation `sqrt(2 (A^-1 M A^-1)_ii)`. With the mean of k references 1 + 1/k stands for 2.
    pub fn unit_sigma(&self) -> Vec<[f64; 2]> {
        let both = self.options.noise_of_both();
        self.spread.variance.iter().map(|v| v.map(|v| (both * v).sqrt())).collect()
    }

    /// The normal matrices of the elements of the finest level, whose sum `M` gives the covariance `2 sigma^2 M^-1` of
    /// every field that is not held; `None` with splines, or brightness for each element, where it is none of these.
    pub fn normal_matrices(&self) -> Option<Vec<ElementMatrix>> {
        let plain = self.options.elements == Elements::Bilinear && self.options.brightness != Brightness::Element;
        plain.then(|| self.moments.iter().map(|moments| moments.matrix()).collect())
    }

    /// The penalty `w R` of a regularisation on the finest level.
    pub fn penalty(&self) -> Option<&BlockMatrix> {
        self.penalty.as_deref()
    }

    /// What noise in the reference adds to [`Reference::normal_matrices`], per element: `G n / k` with the noise gain G
    /// of the gradient, the pixels n of the element and the k images whose mean the reference is; times the noise
    /// of one image squared and [`crate::mesh::mean_products`] (THEORY 10).
    pub fn gradient_noise(&self) -> Vec<f64> {
        let gain = self.kernel.gradient_noise_gain / self.options.n_references.max(1) as f64;
        self.moments.iter().map(|moments| gain * moments.n).collect()
    }

    /// Error left below which a frame counts as converged, px: the tolerance of the options, or 1 % of the smallest
    /// standard uncertainty of a node if larger, for the noise of the reference, at most that stated (THEORY 10).
    pub fn tolerance_px(&self) -> f64 {
        self.tolerance_px
    }

    /// Columns and rows of the images.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Whether an element of the finest level holds any pixel and no node that is left out.
    pub(crate) fn in_use(&self, element: usize) -> bool {
        self.moments[element].n > 0.0
    }

    /// Share of the reference's mean square gradient in each zone that is none of texture but of the image noise that a
    /// frame was found to have: `G noise^2 / g^2` with the noise gain G of the gradient, at most 1.
    pub(crate) fn noise_shares(&self, found: &Correlation) -> Vec<f64> {
        let of_zone = |(zone, ZoneResult { noise, .. }): (usize, &ZoneResult)| {
            let moments = &self.moments[self.mesh.zone_elements(zone)];
            let power: f64 = moments.iter().map(|m| gradient_sums(m)[0] + gradient_sums(m)[2]).sum();
            let support: f64 = moments.iter().map(|m| 2.0 * m.n).sum();
            let from_noise = noise * noise * self.kernel.gradient_noise_gain * support;
            if from_noise < power { from_noise / power } else { 1.0 }
        };
        found.zones.iter().enumerate().map(of_zone).collect()
    }
}
