//! A device that several correlators share.

use super::{
    Backend, BackendError, ElementMoments, Found, GreyMap, GreyTransfer, KernelOptions, PixelSums, Place, Step, Traffic,
};
use crate::imaging::Image;
use crate::isa::Isa;
use crate::linalg::{Solver, SolverChoice};
use crate::mesh::PixelMesh;
use std::sync::Arc;

impl<B: Backend + Send> Backend for Arc<B> {
    type Frame = B::Frame;
    type Level = B::Level;
    type Field = B::Field;
    type Solver = B::Solver;

    fn device(&self) -> String {
        (**self).device()
    }

    fn host_isa(&self) -> Isa {
        (**self).host_isa()
    }

    fn solver_choice(&self, asked: SolverChoice) -> SolverChoice {
        (**self).solver_choice(asked)
    }

    fn frames_in_flight(&self) -> usize {
        (**self).frames_in_flight()
    }

    fn frame(&self, image: Arc<Image>, options: &KernelOptions) -> Result<B::Frame, BackendError> {
        (**self).frame(image, options)
    }

    fn image(&self, frame: &B::Frame) -> Arc<Image> {
        (**self).image(frame)
    }

    fn grey_map(&self, frame: &mut B::Frame, level: usize) -> GreyMap {
        (**self).grey_map(frame, level)
    }

    fn reference(
        &self,
        frame: &mut B::Frame,
        level: usize,
        mesh: &PixelMesh,
        options: &KernelOptions,
    ) -> Result<(B::Level, Vec<ElementMoments>), BackendError> {
        (**self).reference(frame, level, mesh, options)
    }

    fn restrict(&self, level: &mut B::Level, active: &[bool]) -> Result<(), BackendError> {
        (**self).restrict(level, active)
    }

    fn link(&self, level: &mut B::Level, places: Vec<Place>) -> Result<(), BackendError> {
        (**self).link(level, places)
    }

    fn solver(&self, level: &B::Level, solver: Solver) -> Result<B::Solver, BackendError> {
        (**self).solver(level, solver)
    }

    fn start(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        displacement: &[[f64; 2]],
        transfer: &[GreyTransfer],
    ) -> Result<B::Field, BackendError> {
        (**self).start(level, frame, displacement, transfer)
    }

    fn start_finer(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        coarse: &B::Field,
        moved: bool,
    ) -> Result<B::Field, BackendError> {
        (**self).start_finer(level, frame, coarse, moved)
    }

    fn observe(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &mut B::Field,
    ) -> Result<Vec<(PixelSums, GreyTransfer)>, BackendError> {
        (**self).observe(level, frame, field)
    }

    fn step(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &mut B::Field,
        solver: &B::Solver,
        damping: f64,
    ) -> Result<Step, BackendError> {
        (**self).step(level, frame, field, solver, damping)
    }

    fn right_hand_side(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &B::Field,
    ) -> Result<Vec<[f64; 2]>, BackendError> {
        (**self).right_hand_side(level, frame, field)
    }

    fn remaining_moments(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &B::Field,
    ) -> Result<Vec<(usize, ElementMoments)>, BackendError> {
        (**self).remaining_moments(level, frame, field)
    }

    fn element_sums(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &B::Field,
    ) -> Result<(Vec<PixelSums>, Vec<GreyTransfer>), BackendError> {
        (**self).element_sums(level, frame, field)
    }

    fn light(
        &self,
        level: &B::Level,
        frame: &mut B::Frame,
        field: &mut B::Field,
        light: &[GreyTransfer],
    ) -> Result<(), BackendError> {
        (**self).light(level, frame, field, light)
    }

    fn found(&self, level: &B::Level, frame: &mut B::Frame, field: &B::Field) -> Result<Found, BackendError> {
        (**self).found(level, frame, field)
    }

    fn traffic(&self, frame: &B::Frame) -> Option<Traffic> {
        (**self).traffic(frame)
    }
}
