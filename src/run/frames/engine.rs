//! The correlator of a run, and what becomes of it when its device fails.

use crate::backend::BackendError;
use crate::backend::choice::Device;
use crate::correlate::{Correlate, Correlation, CorrelationError, Options, Uploaded, prepare};
use crate::field::Status;
use crate::imaging::Image;
use crate::mesh::Zone;
use crate::remark::Remark;
use crate::run::words::RunError;
use crate::run::words::remarks::{device_failed, device_unprepared, device_wrong, noise_correlated, of_device};
use rayon::ThreadPool;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, RwLock};

/// Of the frames that a graphics device measures the CPU looks at the first of a run and at every one of this number.
const LOOKED_AT: usize = 100;
/// What round-off may make of a field beyond the tolerance of the iteration, px.
const ROUND_OFF_PX: f64 = 2e-5;

/// Fresh devices that a run may open before it stays with the CPU.
const FRESH_DEVICES: usize = 3;

/// The correlator of a run, made anew on another device when its own fails.
pub(crate) struct Engine {
    reference: Arc<Image>,
    zones: Vec<Zone>,
    options: Options,
    device: Device,
    name: String,
    current: RwLock<Current>,
    remarks: Mutex<Vec<Remark>>,
    /// Whether it has been said that the noise is not white.
    colour_said: AtomicBool,
    /// What looks at frames of a graphics device, once one is to be looked at.
    twin: OnceLock<Result<Arc<dyn Correlate>, CorrelationError>>,
    /// The last frame that was looked at; 0 for none.
    looked_at: AtomicUsize,
}

#[derive(Clone)]
struct Current {
    /// How many there have been before it.
    generation: usize,
    correlator: Arc<dyn Correlate>,
    is_on_cpu: bool,
}

impl Current {
    /// The next one, on `device`.
    fn next(&self, device: &Device, correlator: Arc<dyn Correlate>) -> Self {
        Self { generation: self.generation + 1, correlator, is_on_cpu: device.is_cpu() }
    }
}

/// Why a frame cannot be correlated.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    #[error(transparent)]
    Correlation(#[from] CorrelationError),
    /// An image of before that is needed once more.
    #[error("{0}")]
    Image(String),
    /// The fields of before, of a run that goes on.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The frame was begun where the one before was forecast to be, which it is not.
    #[error("begun in a wrong place")]
    BegunElsewhere,
    /// Nobody waits for it any more.
    #[error("no longer wanted")]
    Over,
}

/// What comes of a frame.
pub(crate) type Tried<T> = Result<T, Failure>;

impl From<Failure> for RunError {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Correlation(error) => error.into(),
            Failure::Image(error) => error.into(),
            Failure::Run(error) => error,
            Failure::BegunElsewhere | Failure::Over => Self::Bug("a frame was given up that somebody waits for"),
        }
    }
}

impl Engine {
    /// Prepares the reference on `device`; on the CPU when that is a graphics device chosen by itself which fails.
    pub fn new(
        device: Device,
        reference: Arc<Image>,
        zones: Vec<Zone>,
        options: Options,
    ) -> Result<Self, CorrelationError> {
        let mut remarks: Vec<Remark> = device.remark().map(of_device).into_iter().collect();
        let prepare = |device: &Device| prepare(device, reference.clone(), &zones, options.clone());
        let (device, correlator) = match prepare(&device) {
            Err(CorrelationError::Backend(error)) if device.is_auto_gpu() => {
                remarks.push(device_unprepared(&error));
                let cpu = device.on_cpu();
                let correlator = prepare(&cpu)?;
                (cpu, correlator)
            }
            prepared => (device, prepared?),
        };
        let current = Current { generation: 0, correlator, is_on_cpu: device.is_cpu() };
        Ok(Self {
            name: current.correlator.device().to_owned(),
            reference,
            zones,
            options,
            device,
            current: RwLock::new(current),
            remarks: Mutex::new(remarks),
            colour_said: AtomicBool::new(false),
            twin: OnceLock::new(),
            looked_at: AtomicUsize::new(0),
        })
    }

    fn prepare(&self, device: &Device) -> Result<Arc<dyn Correlate>, CorrelationError> {
        prepare(device, self.reference.clone(), &self.zones, self.options.clone())
    }

    pub fn first_device(&self) -> &str {
        &self.name
    }

    pub fn correlator(&self) -> Arc<dyn Correlate> {
        self.current().correlator
    }

    pub fn is_on_cpu(&self) -> bool {
        self.current().is_on_cpu
    }

    fn current(&self) -> Current {
        self.current.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn take_remarks(&self) -> Vec<Remark> {
        std::mem::take(&mut *self.remarks.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub fn remark(&self, remark: Remark) {
        self.remarks.lock().unwrap_or_else(PoisonError::into_inner).push(remark);
    }

    /// Says once in a run that standard uncertainties are multiplied because the noise is not white.
    pub fn remark_colour(&self, number: usize, result: &Correlation) {
        let applied = result.noise_colour.filter(|colour| colour.to_apply().is_some());
        if let Some(colour) = applied
            && !self.colour_said.swap(true, Ordering::SeqCst)
        {
            self.remark(noise_correlated(number, &colour));
        }
    }

    /// Brings an image to the device ahead of its turn; a fault shows when it comes.
    pub fn upload(&self, image: Arc<Image>) -> Option<(usize, Uploaded)> {
        let Current { generation, correlator, .. } = self.current();
        Some((generation, correlator.upload(image).ok()?))
    }

    /// Correlates frame `number` by `work`, which is given the correlator of a generation, as is what was uploaded.
    /// When a graphics device fails, once more on a fresh one, then on the CPU. `work` is called outside of the
    /// threads of `pool`, so that it may wait for other frames.
    pub fn correlate(
        &self,
        pool: &ThreadPool,
        number: usize,
        image: &Arc<Image>,
        mut uploaded: Option<(usize, Uploaded)>,
        mut work: impl FnMut(usize, &Arc<dyn Correlate>, Uploaded) -> Tried<Correlation>,
    ) -> Tried<(Correlation, Arc<dyn Correlate>)> {
        let mut tried_again = false;
        loop {
            let Current { generation, correlator, is_on_cpu } = self.current();
            let frame = match uploaded.take() {
                Some((of, frame)) if of == generation => Ok(frame),
                _ => pool.install(|| correlator.upload(image.clone())),
            };
            match frame.map_err(Failure::from).and_then(|frame| work(generation, &correlator, frame)) {
                Err(Failure::Correlation(CorrelationError::Backend(error))) if !is_on_cpu => {
                    pool.install(|| self.replace(generation, number, &error, tried_again))?;
                    tried_again = true;
                }
                Ok(mut result) if !is_on_cpu && self.is_to_be_looked_at(number, &result) => {
                    match self.look(pool, number, image, &mut result) {
                        Ok(()) => return Ok((result, correlator)),
                        Err(error) => pool.install(|| self.distrust(generation, number, &error))?,
                    }
                }
                result => return result.map(|result| (result, correlator)),
            }
        }
    }

    /// Whether the CPU is to look at a frame that a graphics device has measured. What was measured from another
    /// reference than the first has no twin.
    fn is_to_be_looked_at(&self, number: usize, result: &Correlation) -> bool {
        let is_due = self.looked_at.load(Ordering::SeqCst) == 0 || number.is_multiple_of(LOOKED_AT);
        let is_field = result.measurement.status == Status::Converged && result.reference_frame == 0;
        is_due && is_field && self.device.is_looked_at()
    }

    /// Goes on from the field of a graphics device with the CPU, and notes how far that comes.
    fn look(
        &self,
        pool: &ThreadPool,
        number: usize,
        image: &Arc<Image>,
        result: &mut Correlation,
    ) -> Result<(), BackendError> {
        let on_cpu = || pool.install(|| self.prepare(&self.device.on_cpu()));
        // What the CPU cannot prepare is no fault of the device.
        let Ok(twin) = self.twin.get_or_init(on_cpu) else { return Ok(()) };
        let start = result.next_start();
        let again = || twin.upload(image.clone()).and_then(|frame| twin.correlate_uploaded(frame, start.as_ref()));
        let Ok(again) = pool.install(again) else { return Ok(()) };
        self.looked_at.store(number, Ordering::SeqCst);
        let [difference_px, allowed_px] = result.apart_from(&again, twin.tolerance_px() + ROUND_OFF_PX);
        result.device_checked_px = Some(difference_px);
        match difference_px <= allowed_px {
            true => Ok(()),
            false => Err(BackendError::WrongField { device: self.name.clone(), difference_px, allowed_px }),
        }
    }

    /// Goes on with the CPU instead of the device of `generation`, unless another frame has done so.
    fn distrust(&self, generation: usize, number: usize, error: &BackendError) -> Result<(), CorrelationError> {
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        if current.generation == generation {
            self.remark(device_wrong(number, error, LOOKED_AT));
            let cpu = self.device.on_cpu();
            *current = current.next(&cpu, self.prepare(&cpu)?);
        }
        Ok(())
    }

    /// Replaces the correlator of `generation`, unless another frame has done so.
    fn replace(
        &self,
        generation: usize,
        number: usize,
        error: &BackendError,
        tried_again: bool,
    ) -> Result<(), CorrelationError> {
        let mut current = self.current.write().unwrap_or_else(PoisonError::into_inner);
        if current.generation != generation {
            return Ok(());
        }
        if !tried_again && generation < FRESH_DEVICES {
            self.remark(device_failed(number, error, true));
            if let Ok(correlator) = self.prepare(&self.device) {
                *current = current.next(&self.device, correlator);
                return Ok(());
            }
        }
        self.remark(device_failed(number, error, false));
        let cpu = self.device.on_cpu();
        *current = current.next(&cpu, self.prepare(&cpu)?);
        Ok(())
    }
}
