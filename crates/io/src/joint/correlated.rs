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
    /// Of each element, whether it shows no texture.
    pub without_texture: Vec<bool>,
    /// Number of the frame of each instant.
    pub frames: Vec<usize>,
    /// Number of the frame that each instant was measured from; 0 for the reference given.
    pub measured_from: Vec<usize>,
    /// Displacement of every node at each instant, mm; `None` where it was not measured.
    pub instants: Vec<Vec<Option<[f64; 2]>>>,
    /// Standard uncertainty of each displacement at each instant, mm; zero where it was not measured.
    pub sigma: Vec<Vec<[f64; 2]>>,
    /// Normal matrix of the correlation; `None` when the run kept none: of an earlier version, with brightness for each
    /// element, or regularised with references that were renewed.
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

impl JointRun {
    /// The same without the elements that show no texture, and the nodes that are theirs alone: a hole is no part of a
    /// body. What is left is numbered anew.
    #[expect(clippy::indexing_slicing, reason = "elements name nodes of their mesh")]
    pub fn of_body(mut self) -> Self {
        let is_kept: Vec<bool> = self.without_texture.iter().map(|bare| !bare).collect();
        let mut is_used = vec![false; self.mesh.nodes.len()];
        for (corners, _) in self.mesh.elements.iter().zip(&is_kept).filter(|(_, kept)| **kept) {
            corners.iter().for_each(|&node| is_used[node as usize] = true);
        }
        let count = |before: &mut u32, used: &bool| {
            *before += u32::from(*used);
            Some(before.saturating_sub(1))
        };
        let numbers: Vec<u32> = is_used.iter().scan(0, count).collect();
        let renumber = |elements: &mut Vec<[u32; 4]>| {
            keep(elements, &is_kept);
            let number = |node: &mut u32| *node = numbers[*node as usize];
            elements.iter_mut().flatten().for_each(number);
        };
        renumber(&mut self.mesh.elements);
        keep(&mut self.mesh.element_group, &is_kept);
        keep(&mut self.mesh.nodes, &is_used);
        self.instants.iter_mut().for_each(|field| keep(field, &is_used));
        self.sigma.iter_mut().for_each(|sigma| keep(sigma, &is_used));
        self.camera.iter_mut().flat_map(|term| &mut term.instants).for_each(|field| keep(field, &is_used));
        if let Some(RunMatrix { corners, matrices, of_noise }) = &mut self.normal_matrix {
            renumber(corners);
            keep(matrices, &is_kept);
            keep(of_noise, &is_kept);
        }
        keep(&mut self.without_texture, &is_kept);
        self
    }
}

/// Keeps of `list` what is to be kept; a list of another length stays.
fn keep<T>(list: &mut Vec<T>, is_kept: &[bool]) {
    if list.len() == is_kept.len() {
        let mut kept = is_kept.iter();
        list.retain(|_| kept.next().copied().unwrap_or(true));
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_is_without_the_elements_that_show_no_texture() {
        // Three squares in a row, the middle one bare: its nodes are those of its neighbours.
        let nodes: Vec<[f64; 2]> = (0..8).map(|k| [f64::from(k / 2), f64::from(k % 2)]).collect();
        let mut elements: Vec<[u32; 4]> = (0..3).map(|k| [2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1]).collect();
        // A fourth one beside them, with two nodes of its own.
        elements.push([6, 8, 9, 7]);
        let nodes: Vec<[f64; 2]> = nodes.into_iter().chain([[4.0, 0.0], [4.0, 1.0]]).collect();
        let field: Vec<Option<[f64; 2]>> = (0..10).map(|k| Some([f64::from(k), 0.0])).collect();
        let run = JointRun {
            path: PathBuf::new(),
            mesh: JointMeshFile { nodes, elements, element_group: vec![0, 1, 2, 3], ..JointMeshFile::default() },
            without_texture: vec![true, true, false, false],
            frames: vec![1],
            measured_from: vec![0],
            instants: vec![field],
            sigma: vec![vec![[0.1; 2]; 10]],
            normal_matrix: None,
            n_references: 1,
            noise_grey: None,
            noise_ratio: None,
            left_out: Vec::new(),
            camera: Vec::new(),
            warnings: Vec::new(),
        };
        let body = run.of_body();
        assert_eq!(body.mesh.elements, [[0, 2, 3, 1], [2, 4, 5, 3]]);
        assert_eq!(body.mesh.element_group, [2, 3]);
        assert_eq!(body.mesh.nodes, [[2.0, 0.0], [2.0, 1.0], [3.0, 0.0], [3.0, 1.0], [4.0, 0.0], [4.0, 1.0]]);
        assert_eq!(body.instants[0].iter().flatten().map(|u| u[0]).collect::<Vec<_>>(), [4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
        assert_eq!((body.sigma[0].len(), body.without_texture), (6, vec![false, false]));
    }
}
