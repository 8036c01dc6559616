//! Adapters, the device, and the way to and from it.

use super::profile::{Profile, Stamps, Timing, Work};
use super::shader::{Binding, Kernel, source};
use crate::backend::adapter::{AdapterKind, Adapters, GpuAdapter, GpuOptions};
use crate::backend::{BackendError, Traffic};
use crate::imaging::Interpolation;
use bytemuck::Pod;
use std::collections::HashMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;
use wgpu::BufferUsages;
use wgpu::util::DeviceExt;

/// Storage buffers that a kernel uses at most: what every WebGPU device offers.
const STORAGE_BUFFERS: u32 = 8;
/// Threads of a workgroup, and bytes they share: likewise.
const THREADS: u32 = 256;
const SHARED_BYTES: u32 = 16384;

/// Asks the drivers of this machine for their adapters.
pub fn adapters() -> Adapters {
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        // Workgroups whose numbers the device sets are those of the host, or none.
        flags: wgpu::InstanceFlags::from_build_config().difference(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let instance = wgpu::Instance::new(descriptor);
    let found = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    let list: Vec<GpuAdapter> = found.into_iter().map(describe).collect();
    let reason = list.is_empty().then(|| match pollster::block_on(instance.request_adapter(&Default::default())) {
        Ok(_) => "the drivers list no adapter".to_owned(),
        Err(error) => error.to_string(),
    });
    Adapters { list, reason, built_without: false }
}

/// The adapter with what it says of itself.
fn describe(handle: wgpu::Adapter) -> GpuAdapter {
    let (info, limits) = (handle.get_info(), handle.limits());
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
        wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
        wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
        wgpu::DeviceType::Cpu => AdapterKind::Software,
        wgpu::DeviceType::Other => AdapterKind::Other,
    };
    let lacks = [
        (limits.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS, "storage buffers per kernel"),
        (limits.max_compute_invocations_per_workgroup < THREADS, "threads per workgroup"),
        (limits.max_compute_workgroup_storage_size < SHARED_BYTES, "bytes shared by a workgroup"),
    ];
    let unusable = lacks.iter().find(|(lacks, _)| *lacks).map(|(_, what)| format!("too few {what}"));
    GpuAdapter {
        name: info.name,
        kind,
        api: info.backend.to_string(),
        driver: [info.driver, info.driver_info].into_iter().filter(|s| !s.is_empty()).collect::<Vec<_>>().join(" "),
        max_binding_bytes: limits.max_storage_buffer_binding_size,
        max_buffer_bytes: limits.max_buffer_size,
        has_timestamps: handle.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        unusable,
        handle,
    }
}
/// The first fault of a device, kept until somebody asks.
#[derive(Debug, Default)]
struct Faults(Mutex<Option<BackendError>>);

impl Faults {
    fn note(&self, fault: BackendError) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(fault);
    }
}

/// An open device with its compiled kernels and its memory.
#[derive(Debug)]
pub(super) struct Gpu {
    pub adapter: GpuAdapter,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) profile: Profile,
    faults: Arc<Faults>,
    /// Readbacks that are left before an injected failure.
    left: OnceLock<AtomicUsize>,
    /// A text of the shaders that is replaced.
    altered: Mutex<Option<[String; 2]>>,
    pub max_binding_bytes: u64,
    /// Most threads side by side in an element.
    pub most_lanes: u32,
    alignment: u64,
    pipelines: Mutex<HashMap<Variant, Arc<Pipeline>>>,
    free: Arc<Free>,
    /// Buffers of constants, by what they hold.
    uniforms: Mutex<HashMap<Box<[u8]>, wgpu::Buffer>>,
}

/// A kernel, its interpolation, and its threads per element.
type Variant = (Kernel, Option<Interpolation>, Option<[u32; 2]>);

/// A compiled kernel.
#[derive(Debug)]
pub(super) struct Pipeline {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    kernel: Kernel,
}

/// Buffers that nobody uses at the moment, by size and usage: allocation is slow, and zeroes the memory.
#[derive(Debug, Default)]
struct Free(Mutex<HashMap<(u64, BufferUsages), Vec<wgpu::Buffer>>>);

/// A buffer of the device. One that is returned for others to use when dropped must not be dropped between the
/// recording of work on it and its submission.
#[derive(Debug)]
pub(super) struct Buffer {
    buffer: Option<wgpu::Buffer>,
    free: Option<Arc<Free>>,
}

/// Buffers of constants kept at most.
const UNIFORMS: usize = 1024;
/// Buffers of one size kept at most.
const KEPT: usize = 8;

impl Drop for Buffer {
    fn drop(&mut self) {
        let (Some(buffer), Some(free)) = (self.buffer.take(), &self.free) else { return };
        let mut free = free.0.lock().unwrap_or_else(PoisonError::into_inner);
        let same = free.entry((buffer.size(), buffer.usage())).or_default();
        if same.len() < KEPT {
            same.push(buffer);
        }
    }
}

impl Buffer {
    pub(super) fn raw(&self) -> &wgpu::Buffer {
        self.buffer.as_ref().expect("taken only when dropped")
    }

    /// The whole of it.
    pub fn whole(&self) -> wgpu::BindingResource<'_> {
        self.raw().as_entire_binding()
    }

    /// A part of it, in bytes; `from` is a multiple of the alignment.
    pub fn part(&self, from: u64, bytes: u64) -> wgpu::BindingResource<'_> {
        wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: self.raw(),
            offset: from,
            size: std::num::NonZeroU64::new(bytes),
        })
    }

    pub fn bytes(&self) -> u64 {
        self.raw().size()
    }
}

/// How long a device may take for one batch of work before it counts as hung.
const PATIENCE: Duration = Duration::from_secs(120);

impl Gpu {
    /// Opens `adapter`, with no optional feature and larger limits in size alone.
    pub fn open(adapter: GpuAdapter, options: &GpuOptions) -> Result<Self, BackendError> {
        let offered = adapter.handle.limits();
        let required_limits = wgpu::Limits {
            max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
            max_buffer_size: offered.max_buffer_size,
            ..wgpu::Limits::default()
        };
        let required_limits = required_limits.or_worse_values_from(&offered);
        let timestamps = adapter.handle.features() & wgpu::Features::TIMESTAMP_QUERY;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("quadrille"),
            required_features: timestamps,
            required_limits,
            ..Default::default()
        };
        let failed = |message: String| BackendError::Device { device: adapter.name.clone(), message };
        let (device, queue) = pollster::block_on(adapter.handle.request_device(&descriptor))
            .map_err(|error| failed(error.to_string()))?;
        let faults = Arc::new(Faults::default());
        let (of_errors, name) = (faults.clone(), adapter.name.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            of_errors.note(match error {
                wgpu::Error::OutOfMemory { .. } => BackendError::OutOfMemory { what: format!("a buffer on {name}") },
                error => BackendError::Device { device: name.clone(), message: error.to_string() },
            });
        }));
        let (of_loss, name) = (faults.clone(), adapter.name.clone());
        device.set_device_lost_callback(move |reason, message| {
            let message = format!("the device was lost ({reason:?}) {message}");
            of_loss.note(BackendError::Device { device: name.clone(), message });
        });
        let limit = options.max_binding_bytes.unwrap_or(u64::MAX);
        Ok(Self {
            max_binding_bytes: adapter.max_binding_bytes.min(limit),
            most_lanes: 1 << options.most_lanes.unwrap_or(adapter.kind.most_lanes()).clamp(4, 64).ilog2(),
            alignment: u64::from(device.limits().min_storage_buffer_offset_alignment),
            adapter,
            device,
            queue,
            profile: Profile::default(),
            faults,
            left: options.fail_after.map(AtomicUsize::new).map_or_else(OnceLock::new, OnceLock::from),
            altered: Mutex::new(options.altered.clone()),
            pipelines: Mutex::default(),
            free: Arc::default(),
            uniforms: Mutex::default(),
        })
    }

    /// Compiles all kernels anew, with a text of them replaced.
    pub fn alter(&self, altered: Option<[String; 2]>) {
        *self.altered.lock().unwrap_or_else(PoisonError::into_inner) = altered;
        self.pipelines.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// Fails after so many readbacks more.
    pub fn fail_after(&self, readbacks: usize) {
        self.left.get_or_init(|| AtomicUsize::new(readbacks));
    }

    /// The error that the device has met, if any: it is no longer to be trusted.
    pub fn check(&self) -> Result<(), BackendError> {
        let fault = self.faults.0.lock().unwrap_or_else(PoisonError::into_inner);
        fault.clone().map_or(Ok(()), Err)
    }

    /// The compiled `kernel`; `lanes` threads per element where it asks for them.
    pub fn pipeline(&self, kernel: Kernel, interpolation: Interpolation, lanes: u32) -> Arc<Pipeline> {
        self.pipeline_in_light(kernel, interpolation, lanes, 0)
    }

    /// As [`Gpu::pipeline`], of a kernel that interpolates; the light of the nodes begins at place `light` of the
    /// transfers, 0 where there is none.
    pub fn pipeline_in_light(
        &self,
        kernel: Kernel,
        interpolation: Interpolation,
        lanes: u32,
        light: u32,
    ) -> Arc<Pipeline> {
        let interpolates = kernel.interpolates();
        let variant = (kernel, interpolates.then_some(interpolation), interpolates.then_some([lanes, light]));
        let mut pipelines = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let compile = || Arc::new(self.compile(kernel, interpolation, variant.2));
        pipelines.entry(variant).or_insert_with(|| self.time(Work::Compile(kernel), compile)).clone()
    }

    fn compile(&self, kernel: Kernel, interpolation: Interpolation, constants: Option<[u32; 2]>) -> Pipeline {
        let label = Some(kernel.file());
        let mut text = source(kernel, interpolation);
        if let Some([from, to]) = &*self.altered.lock().unwrap_or_else(PoisonError::into_inner) {
            text = text.replace(from, to);
        }
        let descriptor = wgpu::ShaderModuleDescriptor { label, source: wgpu::ShaderSource::Wgsl(text.into()) };
        let checks = wgpu::ShaderRuntimeChecks {
            force_loop_bounding: false,
            int_div_checks: false,
            ..wgpu::ShaderRuntimeChecks::checked()
        };
        // SAFETY: indices stay checked. Every loop of our shaders counts up to a bound, and whole numbers are divided
        // by constants alone that are not 0 (tests/correlation/shaders.rs).
        #[allow(unsafe_code, reason = "shaders without checks that ours do not need: a third of their instructions")]
        let module = unsafe { self.device.create_shader_module_trusted(descriptor, checks) };
        let entries: Vec<_> = kernel
            .bindings()
            .iter()
            .zip(0..)
            .map(|(kind, binding)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: match kind {
                        Binding::Uniform => wgpu::BufferBindingType::Uniform,
                        Binding::Read => wgpu::BufferBindingType::Storage { read_only: true },
                        Binding::Write => wgpu::BufferBindingType::Storage { read_only: false },
                    },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let descriptor = wgpu::BindGroupLayoutDescriptor { label, entries: &entries };
        let layout = self.device.create_bind_group_layout(&descriptor);
        let pipeline_layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&layout)],
            ..Default::default()
        });
        let constants: &[(&str, f64)] = match constants {
            Some([lanes, light]) => &[("LANES", f64::from(lanes)), ("LIGHT", f64::from(light))],
            None => &[],
        };
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label,
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some(kernel.entry()),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                // Every kernel writes what it reads.
                zero_initialize_workgroup_memory: false,
            },
            cache: None,
        });
        Pipeline { pipeline, layout, kernel }
    }

    /// A bind group of `pipeline`.
    pub fn bind(&self, pipeline: &Arc<Pipeline>, bindings: &[wgpu::BindingResource<'_>]) -> Bound {
        let entries: Vec<_> = bindings
            .iter()
            .zip(0..)
            .map(|(resource, binding)| wgpu::BindGroupEntry { binding, resource: resource.clone() })
            .collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(pipeline.kernel.file()),
            layout: &pipeline.layout,
            entries: &entries,
        });
        Bound { pipeline: pipeline.clone(), group }
    }

    /// Bytes of a buffer that serves for so many: one of eight sizes between two powers of two, so that what differs a
    /// little from frame to frame (elements that lost pixels) is of few sizes.
    fn rounded(&self, bytes: u64) -> u64 {
        let exact = bytes.next_multiple_of(16).max(16);
        let rounded = exact.next_multiple_of((exact.next_power_of_two() / 16).max(16));
        let limit = self.adapter.max_buffer_bytes.min(self.max_binding_bytes);
        if rounded > limit { exact } else { rounded }
    }

    pub(super) fn buffer_for(&self, bytes: u64, usage: BufferUsages, what: &str) -> Result<Buffer, BackendError> {
        let bytes = self.rounded(bytes);
        if bytes > self.adapter.max_buffer_bytes {
            let what = format!("{what} ({} MB on {})", bytes / 1_000_000, self.adapter.name);
            return Err(BackendError::OutOfMemory { what });
        }
        let mut free = self.free.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = free.get_mut(&(bytes, usage)).and_then(Vec::pop);
        drop(free);
        let buffer = kept.unwrap_or_else(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        });
        Ok(Buffer { buffer: Some(buffer), free: Some(self.free.clone()) })
    }

    /// A storage buffer of at least `bytes`; what it holds is arbitrary.
    pub fn storage(&self, bytes: u64, what: &str) -> Result<Buffer, BackendError> {
        self.buffer_for(bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC, what)
    }

    /// A buffer for the workgroups of a [`Condition`].
    pub fn conditions(&self, bytes: u64) -> Result<Buffer, BackendError> {
        self.buffer_for(bytes, BufferUsages::STORAGE | BufferUsages::INDIRECT, "numbers of workgroups")
    }

    /// As [`Gpu::storage`], for one that kernels see as a whole.
    pub fn visible(&self, bytes: u64, what: &str) -> Result<Buffer, BackendError> {
        if bytes > self.max_binding_bytes {
            let what = format!(
                "{what}, {} MB where {} shows a kernel {} MB at most",
                bytes / 1_000_000,
                self.adapter.name,
                self.max_binding_bytes / 1_000_000
            );
            return Err(BackendError::OutOfMemory { what });
        }
        self.storage(bytes, what)
    }

    /// A storage buffer with the given contents.
    pub fn filled<T: Pod>(&self, contents: &[T], what: &str) -> Result<Buffer, BackendError> {
        let buffer = self.visible(size_of_val(contents) as u64, what)?;
        self.write(&buffer, contents);
        Ok(buffer)
    }

    /// A buffer of constants, which may be dropped as soon as it is bound. Frames ask for the same ones again and
    /// again.
    pub fn uniform<T: Pod>(&self, contents: &T) -> Buffer {
        let contents = bytemuck::bytes_of(contents);
        let mut kept = self.uniforms.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(buffer) = kept.get(contents) {
            return Buffer { buffer: Some(buffer.clone()), free: None };
        }
        if kept.len() >= UNIFORMS {
            kept.clear();
        }
        let usage = BufferUsages::UNIFORM;
        let buffer = self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage });
        kept.insert(contents.into(), buffer.clone());
        Buffer { buffer: Some(buffer), free: None }
    }

    /// Overwrites the beginning of a buffer, after the work submitted so far; returns the bytes sent.
    pub fn write<T: Pod>(&self, buffer: &Buffer, contents: &[T]) -> usize {
        let bytes: &[u8] = bytemuck::cast_slice(contents);
        // Copies are of whole words.
        let whole = bytes.len() / 4 * 4;
        self.time(Work::Upload, || {
            self.queue.write_buffer(buffer.raw(), 0, &bytes[..whole]);
            if whole < bytes.len() {
                let mut last = [0u8; 4];
                last[..bytes.len() - whole].copy_from_slice(&bytes[whole..]);
                self.queue.write_buffer(buffer.raw(), whole as u64, &last);
            }
        });
        bytes.len()
    }

    /// Distance that bindings within a buffer must keep, bytes.
    pub fn alignment(&self) -> u64 {
        self.alignment
    }

    /// A recorder of work.
    pub fn record(&self) -> Recorder<'_> {
        Recorder { timing: self.profile.timing(), ..Recorder::untimed(self) }
    }

    /// Waits for everything submitted so far.
    pub fn wait(&self) -> Result<(), BackendError> {
        self.poll(None)
    }

    fn poll(&self, submission_index: Option<wgpu::SubmissionIndex>) -> Result<(), BackendError> {
        let waited = self.device.poll(wgpu::PollType::Wait { submission_index, timeout: Some(PATIENCE) });
        self.check()?;
        waited.map(|_| ()).map_err(|error| self.note_failure(format!("waiting for it: {error}")))
    }

    /// Notes a fault that nobody could return: the next check finds it.
    pub(super) fn fault(&self, fault: BackendError) {
        self.faults.note(fault);
    }

    /// Notes that the device has failed: what it holds is no longer known.
    fn note_failure(&self, message: String) -> BackendError {
        let fault = BackendError::Device { device: self.adapter.name.clone(), message };
        self.faults.note(fault.clone());
        fault
    }
}

/// A kernel with its buffers.
#[derive(Debug)]
pub(super) struct Bound {
    pipeline: Arc<Pipeline>,
    group: wgpu::BindGroup,
}

/// Dispatches that run only where the device finds so: it sets their workgroups to none where it does not.
#[derive(Debug, Clone)]
pub(super) struct Condition {
    /// Workgroups along x, y and z of every size.
    pub groups: wgpu::Buffer,
    /// Workgroups along x and y, of all sizes that occur.
    pub sizes: Vec<[u32; 2]>,
}

/// Records a batch of work.
pub(super) struct Recorder<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) encoder: wgpu::CommandEncoder,
    pub(super) pass: Option<wgpu::ComputePass<'static>>,
    /// What the dispatches from here on depend on.
    pub condition: Option<Condition>,
    timing: Option<Timing>,
    pub(super) stamps: Option<Stamps>,
}

/// Workgroups along one dimension at most (what every WebGPU device offers is 65535).
pub(super) const MOST_GROUPS: u32 = 32768;

/// So many workgroups along x and y, in rows when they are many.
pub(super) fn folded(groups: u32) -> [u32; 2] {
    [groups.min(MOST_GROUPS), groups.div_ceil(MOST_GROUPS)]
}

impl<'a> Recorder<'a> {
    /// One whose kernels are not timed.
    pub(super) fn untimed(gpu: &'a Gpu) -> Self {
        let encoder = gpu.device.create_command_encoder(&Default::default());
        Self { gpu, encoder, pass: None, condition: None, timing: None, stamps: None }
    }

    /// Whether its kernels are timed: one by one, each with the host waiting for it.
    pub fn is_timed(&self) -> bool {
        self.timing.is_some()
    }

    /// Runs `bound` on `groups` workgroups, folded into rows when they are many.
    pub fn run(&mut self, bound: &Bound, groups: u32) {
        if groups > 0 {
            let [x, y] = folded(groups);
            self.run_2d(bound, x, y);
        }
    }

    /// Runs `bound` on `x` by `y` workgroups.
    pub fn run_2d(&mut self, bound: &Bound, x: u32, y: u32) {
        let condition = self.condition.as_ref().map(|condition| {
            let of_size = condition.sizes.iter().position(|&size| size == [x, y]);
            (condition.groups.clone(), 12 * of_size.expect("all sizes of a step are known") as u64)
        });
        let dispatch = |pass: &mut wgpu::ComputePass<'_>| {
            pass.set_pipeline(&bound.pipeline.pipeline);
            pass.set_bind_group(0, &bound.group, &[]);
            match &condition {
                Some((groups, at)) => pass.dispatch_workgroups_indirect(groups, *at),
                None => pass.dispatch_workgroups(x, y, 1),
            }
        };
        if let Some(timing) = self.timing {
            return self.run_timed(timing, bound.pipeline.kernel, dispatch);
        }
        let encoder = &mut self.encoder;
        dispatch(self.pass.get_or_insert_with(|| encoder.begin_compute_pass(&Default::default()).forget_lifetime()));
    }

    /// Sets a buffer to zeros.
    pub fn clear(&mut self, buffer: &Buffer) {
        self.pass = None;
        self.encoder.clear_buffer(buffer.raw(), 0, None);
    }

    /// Copies `bytes` from a place in one buffer to a place in another.
    pub fn copy(&mut self, from: &Buffer, from_at: u64, to: &Buffer, at: u64, bytes: u64) {
        self.pass = None;
        self.encoder.copy_buffer_to_buffer(from.raw(), from_at, to.raw(), at, bytes);
    }

    /// Hands the work to the device.
    pub fn submit(mut self, traffic: &mut Traffic) -> wgpu::SubmissionIndex {
        self.pass = None;
        if self.timing.is_some() {
            self.settle();
        }
        traffic.submissions += 1;
        self.gpu.queue.submit([self.encoder.finish()])
    }

    /// Hands the work to the device and fetches the beginnings of buffers, each so many bytes.
    pub fn fetch(mut self, parts: &[(&Buffer, u64)], traffic: &mut Traffic) -> Result<Vec<u8>, BackendError> {
        let gpu = self.gpu;
        if self.timing.take().is_some() {
            self.settle();
            return gpu.time(Work::Readback, || self.fetch(parts, traffic));
        }
        let bytes: u64 = parts.iter().map(|part| part.1).sum();
        let landing = gpu.buffer_for(bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST, "results")?;
        let mut at = 0;
        for (buffer, bytes) in parts {
            self.copy(buffer, 0, &landing, at, *bytes);
            at += bytes;
        }
        let index = self.submit(traffic);
        traffic.readbacks += 1;
        traffic.bytes_down += bytes as usize;
        if let Some(left) = gpu.left.get()
            && left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
        {
            gpu.note_failure("injected failure".into());
        }
        let (sender, receiver) = std::sync::mpsc::channel();
        landing.raw().map_async(wgpu::MapMode::Read, 0..bytes, move |result| {
            let _ = sender.send(result); // nobody waits after an error
        });
        gpu.poll(Some(index))?;
        // Where several threads wait, the one that hears of it may be another: it passes the word on in a moment.
        let mapped =
            receiver.recv_timeout(PATIENCE).map_err(|_| gpu.note_failure("its results did not arrive".into()))?;
        mapped.map_err(|error| gpu.note_failure(format!("its results cannot be read: {error}")))?;
        let view = landing.raw().get_mapped_range(0..bytes);
        let values = view.map(|view| view.to_vec()).map_err(|error| gpu.note_failure(error.to_string()));
        landing.raw().unmap();
        values
    }
}

/// The values in bytes that came from the device.
pub(super) fn values<T: Pod>(bytes: &[u8]) -> Vec<T> {
    bytemuck::pod_collect_to_vec(bytes)
}
