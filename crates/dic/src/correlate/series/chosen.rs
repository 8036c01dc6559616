//! Correlation on a device that is chosen when the program runs: the boundary to it is a frame.

use crate::backend::choice::Device;
use crate::backend::{Backend, OnDevice};
use crate::correlate::correlator::Correlator;
use crate::correlate::error::CorrelationError;
use crate::correlate::prepare::options::Options;
use crate::correlate::prepare::reference::Reference;
use crate::correlate::result::correlation::Correlation;
use crate::correlate::result::overlap::Overlap;
use crate::correlate::start::initial::Start;
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
    fn upload(&self, image: Arc<Image>) -> Result<Uploaded, CorrelationError>;

    /// Correlates one deformed image, from `start` on; when it fails, or there is none, the frame is searched for.
    ///
    /// # Errors
    /// A start for another mesh, or a device that fails. Not converging is a result, not an error.
    fn correlate_uploaded(&self, frame: Uploaded, start: Option<&Start>) -> Result<Correlation, CorrelationError> {
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
    ) -> Result<Correlation, CorrelationError>;

    /// Prepares another reference of the same series on the same device.
    ///
    /// # Errors
    /// Those of [`Correlator::new`].
    fn with_reference(
        &self,
        image: Arc<Image>,
        zones: &[Zone],
        options: Options,
    ) -> Result<Box<dyn Correlate>, CorrelationError>;
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

    fn upload(&self, image: Arc<Image>) -> Result<Uploaded, CorrelationError> {
        Ok(Uploaded { frame: Box::new(self.frame(image.clone())?), image })
    }

    fn correlate_in_series(
        &self,
        Uploaded { image, frame }: Uploaded,
        start: Option<&Start>,
        overlap: &mut Overlap<'_>,
    ) -> Result<Correlation, CorrelationError> {
        let frame = match frame.downcast::<B::Frame>() {
            Ok(frame) => *frame,
            Err(_) => self.frame(image)?, // it lies on a device of another kind
        };
        self.correlate_in_series(frame, start, overlap)
    }

    fn with_reference(
        &self,
        image: Arc<Image>,
        zones: &[Zone],
        options: Options,
    ) -> Result<Box<dyn Correlate>, CorrelationError> {
        let made = Self::with_offset(self.backend().clone(), image, zones, options, self.grey_offset())?;
        // A texture that does not repeat does not begin to: it is looked at once for all references of a series.
        if self.periods().iter().all(Vec::is_empty) {
            made.assume_no_period();
        }
        Ok(Box::new(made))
    }
}

/// [`Correlator::new`] on the device that was chosen.
///
/// # Errors
/// Those of [`Correlator::new`], and a device that cannot be opened.
pub fn prepare(
    device: &Device,
    reference: Arc<Image>,
    zones: &[Zone],
    options: Options,
) -> Result<Arc<dyn Correlate>, CorrelationError> {
    struct Prepare<'a>(Arc<Image>, &'a [Zone], Options);
    impl OnDevice for Prepare<'_> {
        type Output = Result<Arc<dyn Correlate>, CorrelationError>;

        fn on<B: Backend>(self, backend: B) -> Self::Output {
            let Self(reference, zones, options) = self;
            Ok(Arc::new(Correlator::new(backend, reference, zones, options)?))
        }
    }
    device.open(Prepare(reference, zones, options))?
}
