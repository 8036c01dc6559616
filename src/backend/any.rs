//! A device chosen at run time.

use super::cpu::{CpuBackend, CpuField, CpuFrame, CpuLevel};
use super::gpu::{GpuBackend, GpuField, GpuFrame, GpuLevel, GpuSolver};
use super::{
    Backend, BackendError, ElementMoments, Found, GreyMap, GreyTransfer, KernelOptions, PixelSums, Place, Step, Traffic,
};
use crate::imaging::Image;
use crate::isa::Isa;
use crate::linalg::{Solver, SolverChoice};
use crate::mesh::PixelMesh;
use std::ops::Deref;
use std::sync::Arc;

/// Declares what lives on either device.
macro_rules! either {
    ($(#[$doc:meta])* $name:ident, $cpu:ty, $gpu:ty) => {
        $(#[$doc])*
        #[derive(Debug)]
        #[allow(clippy::large_enum_variant, reason = "few of them live at a time, behind other owners")]
        pub enum $name {
            /// On the CPU.
            Cpu($cpu),
            /// On a graphics device.
            Gpu($gpu),
        }
    };
}

either! {
    /// The CPU or a graphics device.
    AnyBackend, CpuBackend, GpuBackend
}
either! {
    /// An image on either.
    AnyFrame, CpuFrame, GpuFrame
}
either! {
    /// A prepared reference on either.
    AnyLevel, CpuLevel, GpuLevel
}
either! {
    /// A field on either.
    AnyField, CpuField, GpuField
}
either! {
    /// A solver on either.
    AnySolver, Arc<Solver>, GpuSolver
}

impl Deref for AnySolver {
    type Target = Solver;

    fn deref(&self) -> &Solver {
        match self {
            Self::Cpu(solver) => solver,
            Self::Gpu(solver) => solver,
        }
    }
}

const FOREIGN: &str = "a backend is given only what it made itself";

/// Copies share the device.
impl Clone for AnyBackend {
    fn clone(&self) -> Self {
        match self {
            Self::Cpu(cpu) => Self::Cpu(cpu.clone()),
            Self::Gpu(gpu) => Self::Gpu(gpu.clone()),
        }
    }
}

impl AnyBackend {
    /// Whether the work is done on the CPU.
    pub fn is_cpu(&self) -> bool {
        matches!(self, Self::Cpu(_))
    }
}

impl Backend for AnyBackend {
    type Frame = AnyFrame;
    type Level = AnyLevel;
    type Field = AnyField;
    type Solver = AnySolver;

    fn device(&self) -> String {
        match self {
            Self::Cpu(cpu) => cpu.device(),
            Self::Gpu(gpu) => gpu.device(),
        }
    }

    fn host_isa(&self) -> Isa {
        match self {
            Self::Cpu(cpu) => cpu.host_isa(),
            Self::Gpu(gpu) => gpu.host_isa(),
        }
    }

    fn solver_choice(&self, asked: SolverChoice) -> SolverChoice {
        match self {
            Self::Cpu(cpu) => cpu.solver_choice(asked),
            Self::Gpu(gpu) => gpu.solver_choice(asked),
        }
    }

    fn frames_in_flight(&self) -> usize {
        match self {
            Self::Cpu(cpu) => cpu.frames_in_flight(),
            Self::Gpu(gpu) => gpu.frames_in_flight(),
        }
    }

    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<AnyFrame, BackendError> {
        Ok(match self {
            Self::Cpu(cpu) => AnyFrame::Cpu(cpu.frame(image, options)?),
            Self::Gpu(gpu) => AnyFrame::Gpu(gpu.frame(image, options)?),
        })
    }

    fn image(&self, frame: &AnyFrame) -> Arc<Image> {
        match (self, frame) {
            (Self::Cpu(cpu), AnyFrame::Cpu(frame)) => cpu.image(frame),
            (Self::Gpu(gpu), AnyFrame::Gpu(frame)) => gpu.image(frame),
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn grey_map(&self, frame: &mut AnyFrame, level: usize) -> GreyMap {
        match (self, frame) {
            (Self::Cpu(cpu), AnyFrame::Cpu(frame)) => cpu.grey_map(frame, level),
            (Self::Gpu(gpu), AnyFrame::Gpu(frame)) => gpu.grey_map(frame, level),
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn reference(
        &self,
        frame: &mut AnyFrame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
    ) -> Result<(AnyLevel, Vec<ElementMoments>), BackendError> {
        match (self, frame) {
            (Self::Cpu(cpu), AnyFrame::Cpu(frame)) => {
                cpu.reference(frame, level, mesh, options).map(|(level, moments)| (AnyLevel::Cpu(level), moments))
            }
            (Self::Gpu(gpu), AnyFrame::Gpu(frame)) => {
                gpu.reference(frame, level, mesh, options).map(|(level, moments)| (AnyLevel::Gpu(level), moments))
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn restrict(&self, level: &mut AnyLevel, active: &[bool]) -> Result<(), BackendError> {
        match (self, level) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level)) => cpu.restrict(level, active),
            (Self::Gpu(gpu), AnyLevel::Gpu(level)) => gpu.restrict(level, active),
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn link(&self, level: &mut AnyLevel, places: Vec<Place>) -> Result<(), BackendError> {
        match (self, level) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level)) => cpu.link(level, places),
            (Self::Gpu(gpu), AnyLevel::Gpu(level)) => gpu.link(level, places),
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn solver(&self, level: &AnyLevel, solver: Solver) -> Result<AnySolver, BackendError> {
        match (self, level) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level)) => cpu.solver(level, solver).map(AnySolver::Cpu),
            (Self::Gpu(gpu), AnyLevel::Gpu(level)) => gpu.solver(level, solver).map(AnySolver::Gpu),
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn start(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<AnyField, BackendError> {
        match (self, level, frame) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame)) => {
                cpu.start(level, frame, displacement, transfer).map(AnyField::Cpu)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame)) => {
                gpu.start(level, frame, displacement, transfer).map(AnyField::Gpu)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn start_finer(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        coarse: &AnyField,
        moved: bool,
    ) -> Result<AnyField, BackendError> {
        match (self, level, frame, coarse) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(coarse)) => {
                cpu.start_finer(level, frame, coarse, moved).map(AnyField::Cpu)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(coarse)) => {
                gpu.start_finer(level, frame, coarse, moved).map(AnyField::Gpu)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn observe(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &mut AnyField,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.observe(level, frame, field)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.observe(level, frame, field)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn right_hand_side(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &AnyField,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.right_hand_side(level, frame, field)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.right_hand_side(level, frame, field)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn remaining_moments(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &AnyField,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.remaining_moments(level, frame, field)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.remaining_moments(level, frame, field)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn element_sums(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &AnyField,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.element_sums(level, frame, field)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.element_sums(level, frame, field)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn light(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &mut AnyField,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.light(level, frame, field, light)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.light(level, frame, field, light)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn found(&self, level: &AnyLevel, frame: &mut AnyFrame, field: &AnyField) -> Result<Found, BackendError> {
        match (self, level, frame, field) {
            (Self::Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field)) => {
                cpu.found(level, frame, field)
            }
            (Self::Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field)) => {
                gpu.found(level, frame, field)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn step(
        &self,
        level: &AnyLevel,
        frame: &mut AnyFrame,
        field: &mut AnyField,
        solver: &AnySolver,
        damping: f64,
    ) -> Result<Step, BackendError> {
        use AnyBackend::{Cpu, Gpu};
        match (self, level, frame, field, solver) {
            (Cpu(cpu), AnyLevel::Cpu(level), AnyFrame::Cpu(frame), AnyField::Cpu(field), AnySolver::Cpu(solver)) => {
                cpu.step(level, frame, field, solver, damping)
            }
            (Gpu(gpu), AnyLevel::Gpu(level), AnyFrame::Gpu(frame), AnyField::Gpu(field), AnySolver::Gpu(solver)) => {
                gpu.step(level, frame, field, solver, damping)
            }
            _ => unreachable!("{FOREIGN}"),
        }
    }

    fn traffic(&self, frame: &AnyFrame) -> Option<Traffic> {
        match (self, frame) {
            (Self::Gpu(gpu), AnyFrame::Gpu(frame)) => gpu.traffic(frame),
            _ => None,
        }
    }
}
