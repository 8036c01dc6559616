//! Work that is timed while it is done.

use super::device::{Gpu, Recorder, values};
use super::profile::{Stamps, Timing, Work};
use super::shader::Kernel;
use crate::backend::BackendError;
use crate::clock::{Elapsed, Stopwatch};
use wgpu::BufferUsages;

/// Kernels of one recorder that have a place in its timestamps.
const KERNELS_STAMPED: usize = 512;

impl Gpu {
    /// Runs `work` alone on the device and notes what it took, while the profile is on.
    pub(super) fn time<T>(&self, work: Work, run: impl FnOnce() -> T) -> T {
        if self.profile.timing().is_none() {
            return run();
        }
        self.settle();
        let watch = Stopwatch::start();
        let result = run();
        self.queue.submit([]);
        self.settle();
        self.profile.note(work, watch.elapsed());
        result
    }

    /// Waits for the device; a fault shows at the next check.
    fn settle(&self) {
        if let Err(fault) = self.wait() {
            self.fault(fault);
        }
    }
}

impl Recorder<'_> {
    /// Hands over what is recorded so far and waits for it.
    pub(super) fn settle(&mut self) {
        self.pass = None;
        self.hand_over();
        self.read_stamps();
        self.gpu.settle();
    }

    fn hand_over(&mut self) {
        let encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.gpu.queue.submit([std::mem::replace(&mut self.encoder, encoder).finish()]);
    }

    /// Runs one dispatch so that it can be timed.
    pub(super) fn run_timed(
        &mut self,
        timing: Timing,
        kernel: Kernel,
        dispatch: impl FnOnce(&mut wgpu::ComputePass<'_>),
    ) {
        match timing {
            Timing::Batches => {
                self.settle();
                let watch = Stopwatch::start();
                dispatch(&mut self.encoder.begin_compute_pass(&Default::default()));
                self.hand_over();
                self.gpu.settle();
                self.gpu.profile.note(Work::Kernel(kernel), watch.elapsed());
            }
            Timing::Timestamps => {
                self.pass = None;
                if self.stamps.as_ref().is_some_and(|stamps| stamps.kernels.len() == KERNELS_STAMPED) {
                    self.settle();
                }
                let device = &self.gpu.device;
                let stamps = self.stamps.get_or_insert_with(|| Stamps {
                    set: device.create_query_set(&wgpu::QuerySetDescriptor {
                        label: None,
                        ty: wgpu::QueryType::Timestamp,
                        count: 2 * KERNELS_STAMPED as u32,
                    }),
                    kernels: Vec::new(),
                });
                let first = 2 * stamps.kernels.len() as u32;
                stamps.kernels.push(kernel);
                dispatch(&mut self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: None,
                    timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                        query_set: &stamps.set,
                        beginning_of_pass_write_index: Some(first),
                        end_of_pass_write_index: Some(first + 1),
                    }),
                }));
            }
        }
    }

    /// Notes what the timestamps of the work handed over say.
    fn read_stamps(&mut self) {
        let Some(stamps) = self.stamps.take() else { return };
        if let Err(fault) = self.note_stamps(&stamps) {
            self.gpu.fault(fault);
        }
    }

    fn note_stamps(&self, stamps: &Stamps) -> Result<(), BackendError> {
        let (gpu, n) = (self.gpu, 2 * stamps.kernels.len());
        let bytes = 8 * n as u64;
        let ticks = gpu.buffer_for(bytes, BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC, "timestamps")?;
        let mut recorder = Recorder::untimed(gpu);
        recorder.encoder.resolve_query_set(&stamps.set, 0..n as u32, ticks.raw(), 0);
        let ticks = recorder.fetch(&[(&ticks, bytes)], &mut Default::default())?;
        let ns_per_tick = f64::from(gpu.queue.get_timestamp_period());
        for (kernel, [from, to]) in stamps.kernels.iter().zip(values::<[u64; 2]>(&ticks)) {
            let seconds = 1e-9 * ns_per_tick * to.saturating_sub(from) as f64;
            gpu.profile.note(Work::Kernel(*kernel), Elapsed { wall_s: seconds, cpu_s: seconds, thread_s: seconds });
        }
        Ok(())
    }
}
