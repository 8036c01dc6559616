//! The images and the mesh that are measured with.

use super::BenchError;
use quadrille::backend::KernelOptions;
use quadrille::correlate::Options;
use quadrille::field::Brightness;
use quadrille::imaging::{Image, Interpolation};
use quadrille::mesh::{ELEMENT_SHARE, PixelMesh, Roi, Zone};
use quadrille::synth::{Accuracy, Motion, RenderOptions, Texture, Translation, exact_at, render};
use std::sync::Arc;

/// A synthetic series in memory, 8 bit: sinusoids of 1 px, 0.5 % stretch, 0.2 degrees, growing a little from frame to
/// frame; and square elements on the whole image less one element on each side.
#[derive(Debug)]
pub struct Scene {
    /// Side of the images, px.
    pub size: usize,
    /// Side of the elements, px.
    pub element: usize,
    /// The reference image.
    pub reference: Arc<Image>,
    /// Deformed images, each some 0.2 px at most from the one before.
    pub deformed: Vec<Arc<Image>>,
    /// Elements and their pixels.
    pub mesh: PixelMesh,
}

/// Deformed images made at most: a series goes through them to and fro.
const DEFORMED: usize = 3;

impl Scene {
    /// Images of `size` by `size` pixels for elements of `element` pixels, of which `n_deformed` deformed ones.
    ///
    /// # Errors
    /// When the elements do not fit.
    pub fn new(size: usize, element: usize, n_deformed: usize) -> Result<Self, BenchError> {
        let mesh = PixelMesh::on_zones(&zone(size, element), element, ELEMENT_SHARE, [size, size])?;
        let texture = Texture::new(1, 4.5)?;
        let options = RenderOptions::new(size, size);
        let reference = render(&texture, &Translation([0.0; 2]), &options)?;
        let step = 0.05 * 1024.0 / size.max(256) as f64;
        let deformed = (0..n_deformed.clamp(1, DEFORMED))
            .map(|k| Ok(Arc::new(render(&texture, &Accuracy::new(size, size).at(1.0 + k as f64 * step), &options)?)))
            .collect::<Result<_, BenchError>>()?;
        Ok(Self { size, element, reference: Arc::new(reference), deformed, mesh })
    }

    /// The zone that is measured.
    pub fn zone(&self) -> [Zone; 1] {
        zone(self.size, self.element)
    }

    /// Options of a correlation with these elements.
    pub fn options(&self) -> Options {
        Options { element_size: self.element, ..Options::default() }
    }

    /// Frame `k` of the series: to and fro through the images.
    pub fn frame(&self, k: usize) -> &Arc<Image> {
        let turn = 2 * (self.deformed.len() - 1).max(1);
        let at = k % turn;
        &self.deformed[at.min(turn - at) % self.deformed.len()]
    }

    /// Pixels of an image.
    pub fn pixels(&self) -> u64 {
        (self.size * self.size) as u64
    }

    /// A displacement of the nodes with the variations of the first deformed image times `scale`: 1 for strains up to
    /// 3 %, 0.03 for 0.1 %.
    pub fn field(&self, scale: f64) -> Vec<[f64; 2]> {
        if scale == 1.0 {
            return exact_at(&Accuracy::new(self.size, self.size), self.mesh.mesh.nodes());
        }
        let exact = exact_at(&Accuracy::new(self.size, self.size), self.mesh.mesh.nodes());
        exact.iter().map(|u| u.map(|u| 0.37 + u * scale)).collect()
    }
}

fn zone(size: usize, element: usize) -> [Zone; 1] {
    let (low, high) = (element as f64, size as f64 - element as f64);
    [Zone::rectangle("image", Roi { x0: low, y0: low, x1: high, y1: high })]
}

/// Cubic interpolation, one gain and offset for the zone.
pub fn kernel_options() -> KernelOptions {
    KernelOptions::new((0.0, 255.0), Interpolation::Cubic, Brightness::Zone)
}
