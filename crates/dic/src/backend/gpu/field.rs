//! A displacement field under iteration.

use super::device::{Bound, Buffer, Condition, Gpu, Recorder, folded, values};
use super::layout::{self, Displacement, WHOLE};
use super::level::{GpuLevel, SUMS, TALLIES};
use super::plane::GpuFrame;
use super::shader::Kernel;
use super::solver::{GpuSolver, NODES_TOGETHER, Vectors, gather};
use crate::backend::bend::{BentSums, COLUMNS};
use crate::backend::relaxation::is_relaxed;
use crate::backend::{Ahead, BackendError, ElementMatch, Found, GreyTransfer, PixelSums, Step, Traffic};
use crate::field::Brightness;
use bytemuck::bytes_of;
use std::collections::VecDeque;
use std::sync::OnceLock;

/// A displacement field under iteration, on the device.
#[derive(Debug)]
pub struct GpuField {
    displacement: Buffer,
    /// The displacement of the last evaluation, before the correction that was added since.
    before: Buffer,
    /// Displacement and transfer at the start.
    started: [Buffer; 2],
    /// Gain and offset per zone, or per element; then the light of the nodes, where it was set.
    transfer: Buffer,
    in_light: bool,
    sums: Buffer,
    group_sums: Buffer,
    zones: Buffer,
    /// What the steps of a batch report.
    reports: Buffer,
    worst: Buffer,
    /// Workgroups of the steps of a batch but the first.
    groups: Buffer,
    /// What the last evaluation added to the transfer of each zone.
    change: Buffer,
    vectors: Vectors,
    /// Corrections of the nodes before the last evaluation and after it, in turns in the two halves.
    relaxation: Buffer,
    /// Steps made since it was placed.
    steps: usize,
    evaluated: bool,
    /// Whether a correction was added since the last evaluation.
    corrected: bool,
    n_nodes: usize,
    n_zones: usize,
    /// The kernels of an evaluation: residual, fit of transfers, tally.
    residual: Vec<(Bound, u32)>,
    fit: (Bound, u32),
    tally: (Bound, u32),
    /// Those of a solver, by its number: gather, iterations.
    solving: Option<(u64, Vec<(Bound, u32)>)>,
    /// Steps made that have not been asked for yet.
    ahead: VecDeque<Step>,
    /// The place of the report of the last step.
    last_report: usize,
    /// What has been found, as it came with the last batch; empty where it has not.
    found: Vec<u8>,
    /// What the residual follows beyond the field, where it has been asked.
    bent: OnceLock<Vec<BentSums>>,
}

/// Steps of a batch at most.
const BATCH: usize = 3;
/// Steps whose reports have a place: a batch may begin with the last one of the batch before, made again.
const REPORTS: usize = 2 * BATCH - 1;
/// Steps from a start after which what has been found comes with the report, in case it is the end.
const MAY_END: usize = 5;
/// Sizes of dispatches that shaders/largest.wgsl knows.
const SIZES: usize = 8;

/// A solver, and what its corrections are multiplied by.
pub(super) type By<'a> = (&'a GpuSolver, [f64; 2]);

/// Where the sums of an element say whether it is left out, and what they say of one that the host has excluded; as in
/// shaders/shared/types.wgsl.
const OUT: usize = 15;
const EXCLUDED: f32 = -1.0;

/// Values of shaders/bend.wgsl per element.
const BENT_SUMS: usize = COLUMNS + 2;

/// That there were no corrections before, as in shaders/correct.wgsl.
const NOTHING: u32 = u32::MAX;

/// The fit of transfers and the tally, with their workgroups.
fn tally_kernels(gpu: &Gpu, level: &GpuLevel, [sums, transfer, group_sums]: [&Buffer; 3]) -> [(Bound, u32); 2] {
    let bindings = [
        level.tally.whole(),
        level.groups.whole(),
        level.whole_buffer.whole(),
        sums.whole(),
        transfer.whole(),
        group_sums.whole(),
    ];
    let kernel = |kernel| gpu.bind(&gpu.pipeline(kernel, level.options.interpolation, 0), &bindings);
    let fits = (level.mesh.n_elements() as u32).div_ceil(Kernel::Fit.workgroup());
    [(kernel(Kernel::Fit), fits), (kernel(Kernel::Tally), level.n_groups as u32)]
}

impl GpuField {
    fn empty(gpu: &Gpu, level: &GpuLevel, frame: &mut GpuFrame) -> Result<Self, BackendError> {
        let (n_nodes, n_elements) = (level.mesh.n_nodes(), level.mesh.n_elements());
        let nodal = || gpu.visible(16 * n_nodes as u64, "a field");
        let n_transfers = if level.own_transfer() { n_elements.max(level.n_zones) } else { level.n_zones };
        let displacement = nodal()?;
        let transfer = gpu.visible(8 * n_transfers as u64, "gains and offsets")?;
        let sums = gpu.visible((4 * SUMS * n_elements) as u64, "sums of the elements")?;
        let group_sums = gpu.visible((4 * TALLIES * level.n_groups) as u64, "sums of groups of elements")?;
        let [fit, tally] = tally_kernels(gpu, level, [&sums, &transfer, &group_sums]);
        Ok(Self {
            residual: level.residual_kernels(gpu, frame, [&displacement, &transfer, &sums], 0)?,
            fit,
            tally,
            started: [nodal()?, gpu.visible(8 * level.n_zones as u64, "gains and offsets")?],
            before: nodal()?,
            displacement,
            transfer,
            sums,
            group_sums,
            zones: gpu.visible((size_of::<layout::Zone>() * level.n_zones) as u64, "sums of the zones")?,
            reports: gpu.visible((REPORTS * size_of::<layout::Step>()) as u64, "reports")?,
            groups: gpu.conditions((12 * SIZES) as u64)?,
            worst: gpu.visible(8 * n_nodes.div_ceil(NODES_TOGETHER) as u64, "corrections")?,
            change: gpu.visible(8 * level.n_zones as u64, "changes of light")?,
            vectors: Vectors::new(gpu, n_nodes)?,
            relaxation: gpu.visible(32 * n_nodes as u64, "corrections")?,
            steps: 0,
            in_light: false,
            evaluated: false,
            corrected: false,
            n_nodes,
            n_zones: level.n_zones,
            solving: None,
            ahead: VecDeque::new(),
            last_report: 0,
            found: Vec::new(),
            bent: OnceLock::new(),
        })
    }

    /// A field at `displacement` and `transfer`.
    pub(super) fn new(
        gpu: &Gpu,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<Self, BackendError> {
        let field = Self::empty(gpu, level, frame)?;
        let displacement: Vec<Displacement> = displacement.iter().map(|&u| u.into()).collect();
        let transfer: Vec<[f32; 2]> = transfer.iter().map(|t| [t.gain as f32, t.offset as f32]).collect();
        let mut recorder = gpu.record();
        recorder.clear(&field.sums);
        frame.traffic.bytes_up += gpu.write(&field.displacement, &displacement);
        frame.traffic.bytes_up += gpu.write(&field.transfer, &transfer);
        field.note_start(&mut recorder);
        recorder.submit(&mut frame.traffic);
        Ok(field)
    }

    /// A field of `level` where that of the next coarser level is, or began.
    pub(super) fn finer(
        gpu: &Gpu,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        coarse: &Self,
        moved: bool,
    ) -> Result<Self, BackendError> {
        coarse.nothing_ahead(gpu)?;
        let field = Self::empty(gpu, level, frame)?;
        let [started, started_transfer] = &coarse.started;
        let (from, transfer) =
            if moved { (&coarse.displacement, &coarse.transfer) } else { (started, started_transfer) };
        let Some(places) = &level.places else {
            return Err(bug(gpu, "the level has not been linked to the coarser one"));
        };
        let pipeline = gpu.pipeline(Kernel::Prolong, level.options.interpolation, 0);
        let bound = gpu.bind(&pipeline, &[places.whole(), from.whole(), field.displacement.whole()]);
        let mut recorder = gpu.record();
        recorder.clear(&field.sums);
        recorder.copy(transfer, 0, &field.transfer, 0, 8 * level.n_zones as u64);
        recorder.run(&bound, field.node_groups());
        field.note_start(&mut recorder);
        recorder.submit(&mut frame.traffic);
        Ok(field)
    }

    fn note_start(&self, recorder: &mut Recorder<'_>) {
        recorder.copy(&self.displacement, 0, &self.started[0], 0, 16 * self.n_nodes as u64);
        recorder.copy(&self.transfer, 0, &self.started[1], 0, 8 * self.n_zones as u64);
    }

    fn node_groups(&self) -> u32 {
        self.n_nodes.div_ceil(NODES_TOGETHER) as u32
    }

    /// Forgets what has been found: it is another field from now on.
    fn forget(&mut self) {
        self.found.clear();
        self.bent.take();
    }

    /// Residual and sums of all elements.
    fn evaluate(&self, level: &GpuLevel, recorder: &mut Recorder<'_>) {
        let passes = if level.own_transfer() { 2 } else { 1 };
        for pass in 0..passes {
            if pass == 1 {
                recorder.run(&self.fit.0, self.fit.1);
            }
            self.residual.iter().for_each(|(bound, groups)| recorder.run(bound, *groups));
        }
        recorder.run(&self.tally.0, self.tally.1);
    }

    /// The sums of the zones and what follows from them, for the step of that place in its batch.
    fn summary(&mut self, gpu: &Gpu, level: &GpuLevel, at: usize) -> Bound {
        let constants = layout::Summary {
            n_zones: level.n_zones as u32,
            brightness: match level.options.brightness {
                Brightness::Off => 0,
                Brightness::Zone | Brightness::Smooth | Brightness::Auto => 1,
                Brightness::Element => 2,
            },
            first: u32::from(!self.evaluated),
            at: at as u32,
        };
        self.evaluated = true;
        let pipeline = gpu.pipeline(Kernel::Summary, level.options.interpolation, 0);
        let uniform = gpu.uniform(&constants);
        gpu.bind(
            &pipeline,
            &[
                uniform.whole(),
                level.zone_groups.whole(),
                self.group_sums.whole(),
                self.transfer.whole(),
                self.zones.whole(),
                self.reports.whole(),
                self.change.whole(),
            ],
        )
    }

    /// The largest correction of the step of that place in its batch, and whether the next one is made.
    fn largest(&self, gpu: &Gpu, level: &GpuLevel, at: usize, ahead: &Ahead, sizes: &[[u32; 2]]) -> Bound {
        // A little inside: what the host would say with more digits has to hold.
        const INSIDE: f64 = 1e-6;
        let [least, most] = ahead.correction_px;
        let bits = |px: f64| (px as f32).to_bits();
        let [from, to] = ahead.counted.map(|n| n as f32);
        let mut constants = layout::Largest {
            n_worst: self.node_groups(),
            at: at as u32,
            lost: ahead.lost as f32,
            n_sizes: sizes.len() as u32,
            correction: [bits(least * (1.0 + INSIDE)), bits(most * (1.0 - INSIDE))],
            counted: [from.next_up(), to.next_down()],
            sizes: [[0; 4]; SIZES],
        };
        for (size, [x, y]) in constants.sizes.iter_mut().zip(sizes) {
            *size = [*x, *y, 1, 0];
        }
        let pipeline = gpu.pipeline(Kernel::Largest, level.options.interpolation, 0);
        let uniform = gpu.uniform(&constants);
        let bindings = [uniform.whole(), self.worst.whole(), self.reports.whole(), self.groups.whole()];
        gpu.bind(&pipeline, &bindings)
    }

    fn zone_bytes(&self) -> u64 {
        (size_of::<layout::Zone>() * self.n_zones) as u64
    }

    /// The sums at the field as it is.
    pub(super) fn observe(
        &mut self,
        gpu: &Gpu,
        level: &GpuLevel,
        traffic: &mut Traffic,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        self.nothing_ahead(gpu)?;
        let mut recorder = gpu.record();
        self.evaluate(level, &mut recorder);
        recorder.run(&self.summary(gpu, level, 0), 1);
        self.corrected = false;
        self.forget();
        let bytes = recorder.fetch(&[(&self.zones, self.zone_bytes())], traffic)?;
        Ok(values::<layout::Zone>(&bytes).iter().map(of_zone).collect())
    }

    /// One Gauss-Newton step, and as many after it as `ahead` allows.
    pub(super) fn step(
        &mut self,
        gpu: &Gpu,
        level: &GpuLevel,
        by: By<'_>,
        ahead: &Ahead,
        traffic: &mut Traffic,
    ) -> Result<Step, BackendError> {
        if let Some(step) = self.ahead.pop_front() {
            return Ok(step);
        }
        let mut recorder = gpu.record();
        self.use_solver(gpu, level, by.0, &mut recorder);
        self.steps += 1;
        self.last_report = 0;
        self.evaluate(level, &mut recorder);
        recorder.run(&self.summary(gpu, level, 0), 1);
        self.batch(gpu, level, by, ahead, recorder, traffic)
    }

    /// The correction of the last step taken back, and another one made from the same sums; then as many steps as
    /// `ahead` allows.
    pub(super) fn solve_again(
        &mut self,
        gpu: &Gpu,
        level: &GpuLevel,
        by: By<'_>,
        ahead: &Ahead,
        traffic: &mut Traffic,
    ) -> Result<Step, BackendError> {
        self.nothing_ahead(gpu)?;
        let mut recorder = gpu.record();
        recorder.copy(&self.before, 0, &self.displacement, 0, 16 * self.n_nodes as u64);
        self.use_solver(gpu, level, by.0, &mut recorder);
        self.batch(gpu, level, by, ahead, recorder, traffic)
    }

    /// Corrects the field by the sums of its last evaluation, after what is recorded, and makes as many steps after
    /// that as `ahead` allows.
    fn batch<'a>(
        &mut self,
        gpu: &'a Gpu,
        level: &GpuLevel,
        by: By<'_>,
        ahead: &Ahead,
        recorder: Recorder<'a>,
        traffic: &mut Traffic,
    ) -> Result<Step, BackendError> {
        self.forget();
        let sizes = self.sizes(level);
        let has_none_ahead = recorder.is_timed() || by.0.device.is_none() || sizes.len() > SIZES;
        let n_ahead = if has_none_ahead { 0 } else { ahead.steps.min(BATCH - 1).min(REPORTS - 1 - self.last_report) };
        let (first, last) = (self.last_report, self.last_report + n_ahead);
        let condition = Condition { groups: self.groups.raw().clone(), sizes };
        let mut recorder = self.correct(gpu, level, by, recorder, traffic)?;
        for at in first..=last {
            if at > first {
                recorder.condition = Some(condition.clone());
                self.steps += 1;
                self.evaluate(level, &mut recorder);
                recorder.run(&self.summary(gpu, level, at), 1);
                recorder = self.correct(gpu, level, by, recorder, traffic)?;
                // The end of a step runs always, also where nothing has been done before it.
                recorder.condition = None;
            }
            let sizes = if at < last { &condition.sizes[..] } else { &[] };
            recorder.run(&self.largest(gpu, level, at, ahead, sizes), 1);
        }
        let steps_before = self.steps - n_ahead;
        let may_be_asked_for = level.level == 0 && (n_ahead > 0 || (BATCH..=MAY_END).contains(&self.steps));
        let packed = match may_be_asked_for && !recorder.is_timed() {
            true => Some(self.pack(gpu, level, &mut recorder)?),
            false => None,
        };
        let of_reports = (last + 1) * size_of::<layout::Step>();
        let mut parts = vec![(&self.reports, of_reports as u64)];
        parts.extend(packed.iter().flat_map(|packed| self.parts_of_found(level, packed)));
        let mut bytes = recorder.fetch(&parts, traffic)?;
        self.found = bytes.split_off(of_reports);
        let reports = values::<layout::Step>(&bytes);
        self.ahead.extend(reports[first..].iter().take_while(|report| report.made != 0).map(of_report));
        let Some(step) = self.ahead.pop_front() else { return Err(bug(gpu, "the first step of a batch was not made")) };
        self.steps = steps_before + self.ahead.len();
        self.last_report = first + self.ahead.len();
        Ok(step)
    }

    /// That no steps have been made of which the host does not know yet.
    fn nothing_ahead(&self, gpu: &Gpu) -> Result<(), BackendError> {
        if self.ahead.is_empty() { Ok(()) } else { Err(bug(gpu, "a field is asked for while steps of it are ahead")) }
    }

    /// Prepares the kernels of `solver`, unless it is the one of before.
    fn use_solver(&mut self, gpu: &Gpu, level: &GpuLevel, solver: &GpuSolver, recorder: &mut Recorder<'_>) {
        let Some(cg) = &solver.device else { return };
        if self.solving.as_ref().is_none_or(|(id, _)| *id != solver.id) {
            let mut kernels = cg.gather(gpu, level, [&self.sums, &self.displacement], &self.vectors);
            recorder.clear(&self.vectors.directions[0]);
            kernels.extend(cg.kernels(gpu, level, &self.vectors));
            self.solving = Some((solver.id, kernels));
        }
    }

    /// Workgroups along x and y of the dispatches of a step, each once.
    fn sizes(&self, level: &GpuLevel) -> Vec<[u32; 2]> {
        let solving = self.solving.iter().flat_map(|(_, kernels)| kernels);
        let fit = level.own_transfer().then_some(&self.fit);
        let kernels = self.residual.iter().chain(fit).chain([&self.tally]).chain(solving);
        let mut sizes: Vec<[u32; 2]> = kernels.map(|kernel| folded(kernel.1)).collect();
        sizes.extend([folded(1), folded(self.node_groups())]);
        sizes.sort_unstable();
        sizes.dedup();
        sizes
    }

    /// Corrects the field by the sums of its last evaluation, after what is recorded.
    fn correct<'a>(
        &mut self,
        gpu: &'a Gpu,
        level: &GpuLevel,
        (solver, scale): By<'_>,
        mut recorder: Recorder<'a>,
        traffic: &mut Traffic,
    ) -> Result<Recorder<'a>, BackendError> {
        let (n_nodes, [cos, sin]) = (self.n_nodes as u32, scale.map(|v| v as f32));
        let half = |step: usize| (step % 2) as u32 * n_nodes;
        let before_first = if is_relaxed(self.steps, solver) { half(self.steps - 1) } else { NOTHING };
        let first = half(self.steps);
        let coupled = solver.responses.is_some().into();
        let constants =
            gpu.uniform(&layout::Correct { n_nodes, cos, sin, coupled, before_first, first, unused: [0; 2] });
        if solver.device.is_some() {
            let kernels = self.solving.iter().flat_map(|(_, kernels)| kernels);
            kernels.for_each(|(bound, groups)| recorder.run(bound, *groups));
        } else {
            let nothing = gpu.visible(16 * self.n_nodes as u64, "the nodal blocks")?;
            let (bound, groups) = gather(gpu, level, &self.sums, &self.vectors, &nothing);
            recorder.run(&bound, groups);
            let parts =
                [(&self.vectors.residual, 8 * self.n_nodes as u64), (&self.displacement, 16 * self.n_nodes as u64)];
            let bytes = recorder.fetch(&parts, traffic)?;
            let (rhs, displacement) = bytes.split_at(8 * self.n_nodes);
            let rhs = values::<[f32; 2]>(rhs).iter().map(|b| b.map(f64::from)).collect();
            let displacement: Vec<[f64; 2]> = values::<Displacement>(displacement).iter().map(position).collect();
            let correction = solver.correction(rhs, &displacement);
            let correction: Vec<[f32; 2]> = correction.iter().map(|du| du.map(|du| du as f32)).collect();
            traffic.bytes_up += gpu.write(&self.vectors.solution, &correction);
            recorder = gpu.record();
        }
        let pipeline = gpu.pipeline(Kernel::Correct, level.options.interpolation, 0);
        let correct = gpu.bind(
            &pipeline,
            &[
                constants.whole(),
                self.vectors.solution.whole(),
                self.displacement.whole(),
                self.worst.whole(),
                // Not read where there are none.
                solver.responses.as_deref().unwrap_or(&self.change).whole(),
                level.node_zone.whole(),
                self.change.whole(),
                self.relaxation.whole(),
                self.before.whole(),
            ],
        );
        recorder.run(&correct, self.node_groups());
        self.corrected = true;
        Ok(recorder)
    }

    /// The right-hand side of the last evaluation.
    pub(super) fn right_hand_side(
        &self,
        gpu: &Gpu,
        level: &GpuLevel,
        traffic: &mut Traffic,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        self.nothing_ahead(gpu)?;
        let nothing = gpu.visible(16 * self.n_nodes as u64, "the nodal blocks")?;
        let (bound, groups) = gather(gpu, level, &self.sums, &self.vectors, &nothing);
        let mut recorder = gpu.record();
        recorder.run(&bound, groups);
        let bytes = recorder.fetch(&[(&self.vectors.residual, 8 * self.n_nodes as u64)], traffic)?;
        Ok(values::<[f32; 2]>(&bytes).iter().map(|b| b.map(f64::from)).collect())
    }

    /// Numbers of the elements that have lost pixels, and whether anything of them is left.
    pub(super) fn read_lost(
        &self,
        gpu: &Gpu,
        level: &GpuLevel,
        traffic: &mut Traffic,
    ) -> Result<Vec<(u32, bool)>, BackendError> {
        self.nothing_ahead(gpu)?;
        let n_elements = level.mesh.n_elements();
        if !self.found.is_empty() && level.is_told_by_shares() {
            let shares = values::<[u32; 2]>(&self.found[..8 * n_elements]).into_iter().map(|[_, packed]| packed as u16);
            let lost =
                (0..).zip(shares).filter(|&(element, share)| share < WHOLE && level.pixels_of(element as usize) > 0.0);
            return Ok(lost.map(|(element, share)| (element, share > 0)).collect());
        }
        let bytes = gpu.record().fetch(&[(&self.sums, (4 * SUMS * n_elements) as u64)], traffic)?;
        let counted = values::<f32>(&bytes);
        let count = |sums: &[f32]| if sums[OUT] == EXCLUDED { 0.0 } else { f64::from(sums[8]) };
        let counted = (0..).zip(counted.chunks_exact(SUMS).map(count));
        let lost = counted.filter(|&(element, n)| n < level.pixels_of(element as usize));
        Ok(lost.map(|(element, n)| (element, n > 0.0)).collect())
    }

    /// The displacement of the last evaluation.
    pub(super) fn evaluated(&self) -> &Buffer {
        if self.corrected { &self.before } else { &self.displacement }
    }

    /// Leaves the elements where `excluded` is true out of all sums, and takes the others back.
    pub(super) fn exclude(
        &mut self,
        gpu: &Gpu,
        level: &GpuLevel,
        traffic: &mut Traffic,
        excluded: &[bool],
    ) -> Result<(), BackendError> {
        self.nothing_ahead(gpu)?;
        self.forget();
        let bytes = gpu.record().fetch(&[(&self.sums, (4 * SUMS * level.mesh.n_elements()) as u64)], traffic)?;
        let mut sums = values::<f32>(&bytes);
        for (sums, &excluded) in sums.chunks_exact_mut(SUMS).zip(excluded) {
            if excluded {
                sums[..8].fill(0.0);
                sums[OUT] = EXCLUDED;
            } else if sums[OUT] == EXCLUDED {
                sums[OUT] = 0.0;
            }
        }
        traffic.bytes_up += gpu.write(&self.sums, &sums);
        Ok(())
    }

    /// Puts the field to `displacement`.
    pub(super) fn place(&mut self, gpu: &Gpu, traffic: &mut Traffic, displacement: &[[f64; 2]]) {
        let displacement: Vec<Displacement> = displacement.iter().map(|&u| u.into()).collect();
        traffic.bytes_up += gpu.write(&self.displacement, &displacement);
        self.corrected = false;
        self.steps = 0;
        self.ahead.clear();
        self.forget();
    }

    /// Displacement and transfer at the start.
    pub(super) fn read_start(
        &self,
        gpu: &Gpu,
        traffic: &mut Traffic,
    ) -> Result<(Vec<[f64; 2]>, Vec<GreyTransfer>), BackendError> {
        let of_nodes = 16 * self.n_nodes;
        let parts = [(&self.started[0], of_nodes as u64), (&self.started[1], 8 * self.n_zones as u64)];
        let bytes = gpu.record().fetch(&parts, traffic)?;
        let (nodes, zones) = bytes.split_at(of_nodes);
        let transfer = |&[gain, offset]: &[f32; 2]| GreyTransfer { gain: gain.into(), offset: offset.into() };
        let displacement = values::<Displacement>(nodes).iter().map(position).collect();
        Ok((displacement, values::<[f32; 2]>(zones).iter().map(transfer).collect()))
    }

    /// The sums of the last evaluation, per element; with `all` of excluded elements too.
    pub(super) fn element_sums(
        &self,
        gpu: &Gpu,
        level: &GpuLevel,
        traffic: &mut Traffic,
        all: bool,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        self.nothing_ahead(gpu)?;
        let n_elements = level.mesh.n_elements();
        let parts = [(&self.sums, (4 * SUMS * n_elements) as u64), (&self.zones, self.zone_bytes())];
        let bytes = gpu.record().fetch(&parts, traffic)?;
        let (sums, zones) = bytes.split_at(4 * SUMS * n_elements);
        let sums = values::<f32>(sums);
        let of_element = |(element, sums): (usize, &[f32])| {
            let [n_all, f, ff] = level.whole(element);
            let at = |k: usize| f64::from(sums[k]);
            if sums[8] == 0.0 || (sums[OUT] == EXCLUDED && !all) {
                return PixelSums { n_all, ..PixelSums::default() };
            }
            let [n, rr, g, gg, fg] = [8, 9, 10, 11, 12].map(at);
            PixelSums { n, n_all, f: f - at(13), ff: ff - at(14), g, gg, fg, rr }
        };
        let sums = sums.chunks_exact(SUMS).enumerate().map(of_element).collect();
        Ok((sums, values::<layout::Zone>(zones).iter().map(|zone| of_zone(zone).1).collect()))
    }

    /// What the residual at the field as it is follows beyond it, per element.
    pub(super) fn bend(&self, gpu: &Gpu, level: &GpuLevel, frame: &mut GpuFrame) -> Result<&[BentSums], BackendError> {
        if let Some(bent) = self.bent.get() {
            return Ok(bent);
        }
        self.nothing_ahead(gpu)?;
        let bytes = (size_of::<[f32; BENT_SUMS]>() * level.mesh.n_elements()) as u64;
        let bent = gpu.visible(bytes, "what the elements do not follow")?;
        let light = if self.in_light { self.n_zones as u32 } else { 0 };
        let (buffers, of) = ([&self.displacement, &self.transfer, &bent], (Kernel::Bend, level.mesh.n_elements()));
        let kernels = level.pixel_kernels(gpu, frame, buffers, light, &[of])?;
        let mut recorder = gpu.record();
        recorder.clear(&bent);
        kernels.iter().for_each(|(bound, groups)| recorder.run(bound, *groups));
        let fetched = recorder.fetch(&[(&bent, bytes)], &mut frame.traffic)?;
        let of_element = |sums: &[f32; BENT_SUMS]| {
            let at = |k: usize| f64::from(sums[k]);
            BentSums { along: std::array::from_fn(at), rr: at(COLUMNS), n: at(COLUMNS + 1) }
        };
        Ok(self.bent.get_or_init(|| values::<[f32; BENT_SUMS]>(&fetched).iter().map(of_element).collect()))
    }

    /// Sets the light of the nodes.
    pub(super) fn light(
        &mut self,
        gpu: &Gpu,
        level: &GpuLevel,
        frame: &mut GpuFrame,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        self.nothing_ahead(gpu)?;
        self.forget();
        let light: Vec<[f32; 2]> = light.iter().map(|t| [t.gain as f32, t.offset as f32]).collect();
        let (of_zones, of_nodes) = (8 * self.n_zones as u64, size_of_val(&*light) as u64);
        let nodes = gpu.visible(of_nodes, "the light of the nodes")?;
        frame.traffic.bytes_up += gpu.write(&nodes, &light);
        let mut recorder = gpu.record();
        // Held until the copy from it is on its way.
        let mut before = None;
        if !self.in_light {
            let transfer = gpu.visible(of_zones + of_nodes, "gains and offsets")?;
            recorder.copy(&self.transfer, 0, &transfer, 0, of_zones);
            self.residual =
                level.residual_kernels(gpu, frame, [&self.displacement, &transfer, &self.sums], self.n_zones as u32)?;
            [self.fit, self.tally] = tally_kernels(gpu, level, [&self.sums, &transfer, &self.group_sums]);
            before = Some(std::mem::replace(&mut self.transfer, transfer));
            self.in_light = true;
        }
        recorder.copy(&nodes, 0, &self.transfer, of_zones, of_nodes);
        recorder.submit(&mut frame.traffic);
        drop(before);
        Ok(())
    }

    /// Records what packs the matches of the elements and the field.
    fn pack(&self, gpu: &Gpu, level: &GpuLevel, recorder: &mut Recorder<'_>) -> Result<Buffer, BackendError> {
        let n_elements = level.mesh.n_elements();
        let packed = gpu.visible(self.packed_bytes(level), "results")?;
        let pipeline = gpu.pipeline(Kernel::ResidualMap, level.options.interpolation, 0);
        let bound = gpu.bind(
            &pipeline,
            &[
                level.report.whole(),
                level.whole_buffer.whole(),
                self.sums.whole(),
                self.displacement.whole(),
                packed.whole(),
            ],
        );
        recorder.run(&bound, n_elements.max(self.n_nodes).div_ceil(NODES_TOGETHER) as u32);
        Ok(packed)
    }

    fn packed_bytes(&self, level: &GpuLevel) -> u64 {
        (8 * level.mesh.n_elements() + 12 * self.n_nodes) as u64
    }

    /// What is fetched of what has been found.
    fn parts_of_found<'a>(&'a self, level: &GpuLevel, packed: &'a Buffer) -> [(&'a Buffer, u64); 2] {
        [(packed, self.packed_bytes(level)), (&self.zones, self.zone_bytes())]
    }

    /// What the iteration has found.
    pub(super) fn read(&self, gpu: &Gpu, level: &GpuLevel, traffic: &mut Traffic) -> Result<Found, BackendError> {
        self.nothing_ahead(gpu)?;
        if !self.found.is_empty() {
            return Ok(self.unpack(level, &self.found));
        }
        let mut recorder = gpu.record();
        let packed = self.pack(gpu, level, &mut recorder)?;
        let bytes = recorder.fetch(&self.parts_of_found(level, &packed), traffic)?;
        Ok(self.unpack(level, &bytes))
    }

    fn unpack(&self, level: &GpuLevel, bytes: &[u8]) -> Found {
        let (packed, zones) = bytes.split_at(self.packed_bytes(level) as usize);
        let n_elements = level.mesh.n_elements();
        let (elements, nodes) = packed.split_at(8 * n_elements);
        let elements = values::<[u32; 2]>(elements).into_iter().enumerate().map(|(at, [rms, packed])| {
            let short = |shift: u32| f64::from((packed >> shift) as u16 as i16) / f64::from(WHOLE);
            ElementMatch {
                n: short(0) * level.pixels_of(at),
                residual_rms: f64::from(f32::from_bits(rms)),
                correlation: short(16),
            }
        });
        let nodes = values::<[u32; 3]>(nodes).into_iter().map(|[whole, x, y]| {
            let short = |shift: u32| f64::from((whole >> shift) as u16 as i16);
            [short(0) + f64::from(f32::from_bits(x)), short(16) + f64::from(f32::from_bits(y))]
        });
        let zones: Vec<_> = values::<layout::Zone>(zones).iter().map(of_zone).collect();
        Found {
            displacement: nodes.collect(),
            elements: elements.collect(),
            zones: zones.iter().map(|zone| zone.0).collect(),
            transfer: zones.iter().map(|zone| zone.1).collect(),
        }
    }
}

fn of_report(report: &layout::Step) -> Step {
    Step {
        correction_px: f64::from(f32::from_bits(report.worst.bits)),
        worst_node: report.worst.node as usize,
        correlation: f64::from(report.correlation),
        gained: f64::from(report.gained),
        counted: f64::from(report.counted),
        lost: report.lossy.round() as usize,
    }
}

fn bug(gpu: &Gpu, what: &str) -> BackendError {
    BackendError::Device { device: gpu.adapter.name.clone(), message: format!("{what}: this is a bug in quadrille") }
}

fn position(u: &Displacement) -> [f64; 2] {
    [0, 1].map(|c| f64::from(u.whole[c]) + f64::from(u.rest[c]))
}

fn of_zone(zone: &layout::Zone) -> (PixelSums, GreyTransfer) {
    debug_assert_eq!(bytes_of(zone).len(), 48);
    let sums = PixelSums {
        n: zone.n.into(),
        n_all: zone.n_all.into(),
        f: zone.f.into(),
        ff: zone.ff.into(),
        g: zone.g.into(),
        gg: zone.gg.into(),
        fg: zone.fg.into(),
        rr: zone.rr.into(),
    };
    (sums, GreyTransfer { gain: zone.gain.into(), offset: zone.offset.into() })
}
