//! A device that takes no time: what is left of a series is what the host does, which no graphics device makes faster.
//! It measures nothing: `testbed series --device instant` alone takes it.

use super::bend::{BentMoments, BentSums};
use super::cpu::{CpuBackend, CpuField, CpuFrame, CpuLevel};
use super::{
    Ahead, Backend, BackendError, ElementMoments, Found, GreyMap, GreyTransfer, KernelOptions, PixelSums, Place, Step,
};
use crate::imaging::Image;
use crate::isa::Isa;
use crate::linalg::Solver;
use crate::mesh::PixelMesh;
use std::sync::{Arc, OnceLock};

/// Frames worth correlating at the same time, as of a graphics device.
const FRAMES_IN_FLIGHT: usize = 3;

/// Answers for every frame what the CPU has found for the first one that began at a prediction.
#[derive(Debug, Clone)]
pub struct InstantBackend {
    cpu: CpuBackend,
    answers: Arc<OnceLock<Arc<Answers>>>,
}

/// What a field said that was iterated in earnest.
#[derive(Debug)]
struct Answers {
    steps: Vec<Step>,
    remaining: Vec<(usize, ElementMoments)>,
    found: Found,
    sums: Vec<PixelSums>,
    all_sums: Vec<PixelSums>,
    right_hand_side: Vec<[f64; 2]>,
    bent: Vec<BentSums>,
}

/// A displacement field that is iterated, or for which all is known.
#[derive(Debug)]
pub struct InstantField(Kind);

#[derive(Debug)]
enum Kind {
    Iterated {
        field: Box<CpuField>,
        steps: Vec<Step>,
        remaining: OnceLock<Vec<(usize, ElementMoments)>>,
        /// Whether it began at a prediction on the finest level.
        is_predicted: bool,
    },
    Known {
        started: (Vec<[f64; 2]>, Vec<GreyTransfer>),
        answers: Arc<Answers>,
        steps: usize,
    },
}

impl InstantBackend {
    /// On a processor that takes the instruction path `isa` until all is known.
    pub fn new(isa: Isa) -> Self {
        Self { cpu: CpuBackend::new(isa), answers: Arc::default() }
    }
}

impl InstantField {
    fn iterated(field: CpuField, is_predicted: bool) -> Self {
        Self(Kind::Iterated { field: Box::new(field), steps: Vec::new(), remaining: OnceLock::new(), is_predicted })
    }
}

impl Backend for InstantBackend {
    type Frame = CpuFrame;
    type Level = CpuLevel;
    type Field = InstantField;
    type Solver = Arc<Solver>;

    fn device(&self) -> String {
        "a device that takes no time (every frame ends as the first, nothing is measured)".into()
    }

    fn host_isa(&self) -> Isa {
        self.cpu.host_isa()
    }

    fn frames_in_flight(&self) -> usize {
        FRAMES_IN_FLIGHT
    }

    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<CpuFrame, BackendError> {
        self.cpu.frame(image, options)
    }

    fn image(&self, frame: &CpuFrame) -> Arc<Image> {
        self.cpu.image(frame)
    }

    fn grey_map(&self, frame: &mut CpuFrame, level: usize) -> GreyMap {
        self.cpu.grey_map(frame, level)
    }

    fn reference(
        &self,
        frame: &mut CpuFrame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
        smoothed: Option<&Arc<Image>>,
    ) -> Result<(CpuLevel, Vec<ElementMoments>), BackendError> {
        self.cpu.reference(frame, level, mesh, options, smoothed)
    }

    fn restrict(&self, level: &mut CpuLevel, active: &[bool]) -> Result<(), BackendError> {
        self.cpu.restrict(level, active)
    }

    fn link(&self, level: &mut CpuLevel, places: Vec<Place>) -> Result<(), BackendError> {
        self.cpu.link(level, places)
    }

    fn release(&self, frame: &mut CpuFrame) {
        self.cpu.release(frame);
    }

    fn solver(&self, level: &CpuLevel, solver: Solver) -> Result<Arc<Solver>, BackendError> {
        self.cpu.solver(level, solver)
    }

    fn reclaim(&self, solver: Arc<Solver>) -> Option<Solver> {
        self.cpu.reclaim(solver)
    }

    fn start(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<InstantField, BackendError> {
        let is_finest = level.level == 0;
        match self.answers.get().filter(|_| is_finest) {
            Some(answers) => {
                let started = (displacement.to_vec(), transfer.to_vec());
                Ok(InstantField(Kind::Known { started, answers: answers.clone(), steps: 0 }))
            }
            None => Ok(InstantField::iterated(self.cpu.start(level, frame, displacement, transfer)?, is_finest)),
        }
    }

    fn start_finer(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        coarse: &InstantField,
        moved: bool,
    ) -> Result<InstantField, BackendError> {
        match &coarse.0 {
            Kind::Iterated { field, .. } => {
                Ok(InstantField::iterated(self.cpu.start_finer(level, frame, field, moved)?, false))
            }
            // Only fields of the finest level are known.
            Kind::Known { .. } => unreachable!("no level is finer than the finest"),
        }
    }

    fn observe(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, .. } => self.cpu.observe(level, frame, field),
            Kind::Known { answers, .. } => {
                let Found { zones, transfer, .. } = &answers.found;
                Ok(zones.iter().copied().zip(transfer.iter().copied()).collect())
            }
        }
    }

    fn step(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
        solver: &Arc<Solver>,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, steps, .. } => {
                let step = self.cpu.step(level, frame, field, solver, scale, ahead)?;
                steps.push(step);
                Ok(step)
            }
            Kind::Known { answers, steps, .. } => {
                *steps += 1;
                Ok(answers.step(*steps))
            }
        }
    }

    fn solve_again(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
        solver: &Arc<Solver>,
        scale: [f64; 2],
        ahead: &Ahead,
    ) -> Result<Step, BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, steps, .. } => {
                let step = self.cpu.solve_again(level, frame, field, solver, scale, ahead)?;
                steps.pop();
                steps.push(step);
                Ok(step)
            }
            Kind::Known { answers, steps, .. } => Ok(answers.step(*steps)),
        }
    }

    fn right_hand_side(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        match &field.0 {
            Kind::Iterated { field, .. } => self.cpu.right_hand_side(level, frame, field),
            Kind::Known { answers, .. } => Ok(answers.right_hand_side.clone()),
        }
    }

    fn remaining_moments(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError> {
        match &field.0 {
            Kind::Iterated { field, remaining, .. } => {
                let moments = self.cpu.remaining_moments(level, frame, field)?;
                Ok(remaining.get_or_init(|| moments).clone())
            }
            Kind::Known { answers, .. } => Ok(answers.remaining.clone()),
        }
    }

    fn element_sums(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        match &field.0 {
            Kind::Iterated { field, .. } => self.cpu.element_sums(level, frame, field),
            Kind::Known { answers, .. } => Ok((answers.sums.clone(), answers.found.transfer.clone())),
        }
    }

    fn exclude(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
        excluded: &[bool],
    ) -> Result<(), BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, .. } => self.cpu.exclude(level, frame, field, excluded),
            Kind::Known { .. } => Ok(()),
        }
    }

    fn all_sums(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
    ) -> Result<Vec<PixelSums>, BackendError> {
        match &field.0 {
            Kind::Iterated { field, .. } => self.cpu.all_sums(level, frame, field),
            Kind::Known { answers, .. } => Ok(answers.all_sums.clone()),
        }
    }

    fn place(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
        displacement: &[[f64; 2]],
    ) -> Result<(), BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, .. } => self.cpu.place(level, frame, field, displacement),
            Kind::Known { .. } => Ok(()),
        }
    }

    fn read_start(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
    ) -> Result<(Vec<[f64; 2]>, Vec<GreyTransfer>), BackendError> {
        match &field.0 {
            Kind::Iterated { field, .. } => self.cpu.read_start(level, frame, field),
            Kind::Known { started, .. } => Ok(started.clone()),
        }
    }

    fn light(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &mut InstantField,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        match &mut field.0 {
            Kind::Iterated { field, .. } => self.cpu.light(level, frame, field, light),
            Kind::Known { .. } => Ok(()),
        }
    }

    fn bent_moments(&self, level: &CpuLevel, elements: &[u32]) -> Result<Vec<BentMoments>, BackendError> {
        self.cpu.bent_moments(level, elements)
    }

    fn bent_sums(
        &self,
        level: &CpuLevel,
        frame: &mut CpuFrame,
        field: &InstantField,
        elements: &[u32],
    ) -> Result<Vec<BentSums>, BackendError> {
        match &field.0 {
            Kind::Iterated { field, .. } => self.cpu.bent_sums(level, frame, field, elements),
            Kind::Known { answers, .. } => Ok(elements.iter().map(|&at| answers.bent[at as usize]).collect()),
        }
    }

    fn read_field(&self, level: &CpuLevel, frame: &mut CpuFrame, field: &InstantField) -> Result<Found, BackendError> {
        match &field.0 {
            Kind::Iterated { field, steps, remaining, is_predicted } => {
                let found = self.cpu.read_field(level, frame, field)?;
                // After one step alone it is asked for to see whether the prediction was far off.
                if *is_predicted && steps.len() > 1 {
                    let answers = Answers {
                        steps: steps.clone(),
                        remaining: remaining.get().cloned().unwrap_or_default(),
                        found: found.clone(),
                        sums: self.cpu.element_sums(level, frame, field)?.0,
                        all_sums: self.cpu.all_sums(level, frame, field)?,
                        right_hand_side: self.cpu.right_hand_side(level, frame, field)?,
                        bent: self.cpu.bent_sums(
                            level,
                            frame,
                            field,
                            &(0..level.n_elements() as u32).collect::<Vec<_>>(),
                        )?,
                    };
                    self.answers.get_or_init(|| Arc::new(answers));
                }
                Ok(found)
            }
            Kind::Known { answers, .. } => Ok(answers.found.clone()),
        }
    }
}

impl Answers {
    /// What step `number`, counted from 1, came to; the last of them where there were fewer.
    fn step(&self, number: usize) -> Step {
        self.steps[number.min(self.steps.len()) - 1]
    }
}
