//! A correlation run as the mechanics sees it: mm, y up.

use super::JointMeshFile;
use crate::linalg::ElementMatrix;
use crate::remark::Remark;
use std::path::PathBuf;

/// The strips of a correlation run with their measured displacements, in mm with y up.
#[derive(Debug, Clone, PartialEq)]
pub struct JointRun {
    /// The run.
    pub path: PathBuf,
    /// Its mesh; its zones are the groups.
    pub mesh: JointMeshFile,
    /// Number of the frame of each instant.
    pub frames: Vec<usize>,
    /// Number of the frame that each instant was measured from; 0 for the reference given.
    pub measured_from: Vec<usize>,
    /// Displacement of every node at each instant, mm; `None` where it was not measured.
    pub instants: Vec<Vec<Option<[f64; 2]>>>,
    /// Standard uncertainty of each displacement at each instant, mm; zero where it was not measured.
    pub sigma: Vec<Vec<[f64; 2]>>,
    /// Normal matrix of the correlation; `None` when the run kept none: regularised, or of an earlier version.
    pub normal_matrix: Option<RunMatrix>,
    /// How many images the reference is the mean of.
    pub n_references: usize,
    /// Noise of an image behind the uncertainties, grey levels, rms over frames and zones; `None` in earlier stores.
    pub noise_grey: Option<f64>,
    /// What the residuals say of that noise, by it: rms over frames and zones; 1 unless a noise was stated. A stated
    /// noise that is contradicted makes every interval wrong by this factor.
    pub noise_ratio: Option<f64>,
    /// Frames that did not converge, or were not done: no instants are made of them.
    pub left_out: Vec<usize>,
    /// What the displacements are off when the camera is, independent of each other (THEORY 22).
    pub camera: Vec<RunCamera>,
    /// What the correlation warned of (`remarks` of its `summary.json`); empty where that is not beside the store.
    pub warnings: Vec<Remark>,
}

/// What the displacements of a run are off when its camera is off by one standard uncertainty in one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct RunCamera {
    /// Which: `lens`, `tilt_x`, `distance`.
    pub name: String,
    /// Whether the case states it: a usual lens is a default.
    pub is_stated: bool,
    /// Change of every node's displacement at each instant, mm.
    pub instants: Vec<Vec<[f64; 2]>>,
}

/// The normal matrix `M` of a correlation, element by element. It holds the noise of the gradient: displacements have
/// the covariance of THEORY 10 with `M0 = M - sigma^2 N`, which for little noise is `2 sigma^2 M^-1`.
#[derive(Debug, Clone, PartialEq)]
pub struct RunMatrix {
    /// Nodes of each element, in the order that its matrix has them.
    pub corners: Vec<[u32; 4]>,
    /// Matrix of each element, grey levels^2/mm^2, y up.
    pub matrices: Vec<ElementMatrix>,
    /// `N`: what noise of one grey level in one image adds to them; empty when the run did not keep it.
    pub of_noise: Vec<ElementMatrix>,
}

impl RunMatrix {
    /// Of each element at least this share is left.
    const LEAST_SHARE: f64 = 0.2;

    /// `M0 = M - sigma^2 N` for `noise` grey levels in one image, and `kappa`, what was taken off by what is left
    /// (THEORY 10), a mean over the elements. Where nothing is known of `N`, `M` and 0.
    pub fn without_noise(&self, noise: f64) -> (Self, f64) {
        if self.of_noise.len() != self.matrices.len() || !noise.is_finite() {
            return (self.clone(), 0.0);
        }
        let trace = |matrix: &ElementMatrix| -> f64 {
            let mut places = (0..8).flat_map(|row| (row..8).map(move |column| row == column));
            matrix.iter().filter(|_| places.next() == Some(true)).sum()
        };
        let (mut left, mut taken) = (0.0, 0.0);
        let without_noise = |(matrix, noisy): (&ElementMatrix, &ElementMatrix)| -> ElementMatrix {
            let (all, of_noise) = (trace(matrix), trace(noisy));
            let most = if of_noise > 0.0 { (1.0 - Self::LEAST_SHARE) * all / of_noise } else { 0.0 };
            let variance = (noise * noise).min(most);
            taken += variance * of_noise;
            left += all - variance * of_noise;
            let mut left = *matrix;
            left.iter_mut().zip(noisy).for_each(|(entry, noisy)| *entry -= variance * noisy);
            left
        };
        let matrices = self.matrices.iter().zip(&self.of_noise).map(without_noise).collect();
        let kappa = if left > 0.0 { taken / left } else { 0.0 };
        (Self { matrices, ..self.clone() }, kappa)
    }
}
