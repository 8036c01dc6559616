//! Correlation on a device that is chosen when the program runs: the boundary to it is a frame.

use crate::backend::choice::Device;
use crate::backend::{Backend, OnDevice};
use crate::correlate::{Correlation, Correlator, Options, Overlap, Reference, Result, Start};
use crate::imaging::Image;
use crate::mesh::Zone;
use std::any::Any;
use std::ops::Deref;
use std::sync::Arc;

/// A deformed image that was brought to a device.
pub struct Uploaded {
    image: Arc<Image>,
    frame: Box<dyn Any + Send>,
}

impl Uploaded {
    /// The image.
    pub fn image(&self) -> &Arc<Image> {
        &self.image
    }
}

/// A [`Correlator`] that does not say in its type which device it is on; it leads to its [`Reference`].
pub trait Correlate: Send + Sync {
    /// What is known of the reference.
    fn reference(&self) -> &Reference;

    /// Brings a deformed image to the device: worth doing while the frame before it is correlated.
    ///
    /// # Errors
    /// An image of another size or without contrast, or a device that fails.
    fn upload(&self, image: Arc<Image>) -> Result<Uploaded>;

    /// Correlates one deformed image, from `start` on; when it fails, or there is none, the frame is searched for.
    ///
    /// # Errors
    /// A start for another mesh, or a device that fails. Not converging is a result, not an error.
    fn correlate_uploaded(&self, frame: Uploaded, start: Option<&Start>) -> Result<Correlation> {
        self.correlate_in_series(frame, start, &mut Overlap::default())
    }

    /// As [`Correlate::correlate_uploaded`], while other frames of a series are under way.
    ///
    /// # Errors
    /// Those of [`Correlate::correlate_uploaded`].
    fn correlate_in_series(
        &self,
        frame: Uploaded,
        start: Option<&Start>,
        overlap: &mut Overlap<'_>,
    ) -> Result<Correlation>;

    /// Prepares another reference of the same series on the same device.
    ///
    /// # Errors
    /// Those of [`Correlator::new`].
    fn with_reference(&self, image: Arc<Image>, zones: &[Zone], options: Options) -> Result<Box<dyn Correlate>>;
}

impl Deref for dyn Correlate + '_ {
    type Target = Reference;

    fn deref(&self) -> &Reference {
        self.reference()
    }
}

impl<B: Backend> Correlate for Correlator<B> {
    fn reference(&self) -> &Reference {
        self
    }

    fn upload(&self, image: Arc<Image>) -> Result<Uploaded> {
        Ok(Uploaded { frame: Box::new(self.frame(image.clone())?), image })
    }

    fn correlate_in_series(
        &self,
        Uploaded { image, frame }: Uploaded,
        start: Option<&Start>,
        overlap: &mut Overlap<'_>,
    ) -> Result<Correlation> {
        let frame = match frame.downcast::<B::Frame>() {
            Ok(frame) => *frame,
            Err(_) => self.frame(image)?, // it lies on a device of another kind
        };
        self.correlate_in_series(frame, start, overlap)
    }

    fn with_reference(&self, image: Arc<Image>, zones: &[Zone], options: Options) -> Result<Box<dyn Correlate>> {
        let made = Self::with_offset(self.backend().clone(), image, zones, options, self.kernel.grey_offset)?;
        // A texture that does not repeat does not begin to: it is looked at once for all references of a series.
        if self.periods().iter().all(Vec::is_empty) {
            made.periods.get_or_init(|| vec![Vec::new(); made.zone_pixels.len()]);
        }
        Ok(Box::new(made))
    }
}

/// [`Correlator::new`] on the device that was chosen.
///
/// # Errors
/// Those of [`Correlator::new`], and a device that cannot be opened.
pub fn prepare(device: &Device, reference: Arc<Image>, zones: &[Zone], options: Options) -> Result<Arc<dyn Correlate>> {
    struct Prepare<'a>(Arc<Image>, &'a [Zone], Options);
    impl OnDevice for Prepare<'_> {
        type Output = Result<Arc<dyn Correlate>>;

        fn on<B: Backend>(self, backend: B) -> Self::Output {
            Ok(Arc::new(Correlator::new(backend, self.0, self.1, self.2)?))
        }
    }
    device.open(Prepare(reference, zones, options))?
}
