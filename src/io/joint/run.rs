//! A correlation run as the mechanics sees it: mm, y up.

use super::{JointFileError, JointMeshFile};
use crate::field::Status;
use crate::io::store::Store;
use crate::linalg::{ElementMatrix, alike};
use crate::mesh::mean_products;
use crate::units::TURN;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The summary that a correlation leaves beside its store.
const SUMMARY: &str = "summary.json";

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
    /// Normal matrix of the correlation; `None` when the run kept none: it was regularised, or an earlier version
    /// made it.
    pub normal_matrix: Option<RunMatrix>,
    /// How many images the reference is the mean of.
    pub n_references: usize,
    /// Noise of one image that the frames' uncertainties are made with, grey levels, root mean square over frames and
    /// zones; `None` in stores of earlier versions.
    pub noise_grey: Option<f64>,
    /// What the residuals say of that noise, by it: rms over frames and zones; 1 unless a noise was stated. A stated noise
    /// that is contradicted makes every interval wrong by this factor.
    pub noise_ratio: Option<f64>,
    /// Frames that did not converge, or were not done: no instants are made of them.
    pub left_out: Vec<usize>,
    /// What the correlation warned of (`messages` of its `summary.json`); empty where that is not beside the store.
    pub warnings: Vec<String>,
}

/// The normal matrix `M` of a correlation, element by element. It holds the noise of the gradient: displacements have the
/// covariance of THEORY 10 with `M0 = M - sigma^2 N`, which for little noise is `2 sigma^2 M^-1`.
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

    /// `M0 = M - sigma^2 N` for `noise` grey levels in one image, and `kappa`, what was taken off by what is left (THEORY
    /// 10), a mean over the elements. Where nothing is known of `N`, `M` and 0.
    pub fn without_noise(&self, noise: f64) -> (Self, f64) {
        if self.of_noise.len() != self.matrices.len() || !noise.is_finite() {
            return (self.clone(), 0.0);
        }
        let trace = |matrix: &ElementMatrix| -> f64 {
            let mut places = (0..8).flat_map(|row| (row..8).map(move |column| row == column));
            matrix.iter().filter(|_| places.next() == Some(true)).sum()
        };
        let (mut left, mut taken) = (0.0, 0.0);
        let of = |(matrix, noisy): (&ElementMatrix, &ElementMatrix)| -> ElementMatrix {
            let (all, of_noise) = (trace(matrix), trace(noisy));
            let most = if of_noise > 0.0 { (1.0 - Self::LEAST_SHARE) * all / of_noise } else { 0.0 };
            let variance = (noise * noise).min(most);
            taken += variance * of_noise;
            left += all - variance * of_noise;
            std::array::from_fn(|k| matrix[k] - variance * noisy[k])
        };
        let matrices = self.matrices.iter().zip(&self.of_noise).map(of).collect();
        let kappa = if left > 0.0 { taken / left } else { 0.0 };
        (Self { matrices, ..self.clone() }, kappa)
    }
}

/// Reads the run in the folder `path`, or of the store `path`.
///
/// # Errors
/// A store that cannot be read, no pixel size, no frame that converged.
pub fn read_joint_run(path: &Path) -> Result<JointRun, JointFileError> {
    let store = Store::open(path)?;
    let Some(scale) = store.header().pixel_size else {
        return Err(JointFileError::NoPixelSize { path: path.to_owned() });
    };
    let measured = store.mesh();
    let on_specimen = Arc::new(measured.to_mm(scale));
    let mesh = JointMeshFile {
        path: path.to_owned(),
        elements: on_specimen.elements().to_vec(),
        nodes: on_specimen.nodes().to_vec(),
        groups: on_specimen.zones().to_vec(),
        element_group: on_specimen.element_zone().to_vec(),
        mm_per_px: Some(scale.mm_per_px()),
        ..JointMeshFile::default()
    };
    let (mut frames, mut instants, mut left_out, mut sigma) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut measured_from = Vec::new();
    for number in 1..=store.n_frames() {
        match store.frame(number)?.map(|frame| frame.measurement).filter(|field| field.status == Status::Converged) {
            Some(field) => {
                let field = field.to_mm(&on_specimen, scale);
                let at = |(&u, &measured): (&[f64; 2], &bool)| measured.then_some(u);
                frames.push(number);
                measured_from.push(store.reference_frame(number)?.unwrap_or(0));
                instants.push(field.displacement.iter().zip(&field.measured).map(at).collect());
                sigma.push(field.sigma);
            }
            None => left_out.push(number),
        }
    }
    if frames.is_empty() {
        return Err(JointFileError::NoFrame { path: path.to_owned() });
    }
    let mut noise = [0.0; 2];
    let mut n_known = 0.0;
    for &number in &frames {
        if let Some(of_frame) = store.noise(number)? {
            n_known += 1.0;
            noise.iter_mut().zip(of_frame).for_each(|(sum, v)| *sum += v * v);
        }
    }
    let known = n_known > 0.0;
    let noise_grey = known.then(|| (noise[0] / n_known).sqrt());
    let noise_ratio = known.then(|| (noise[1] / noise[0]).sqrt());
    let per_mm = 1.0 / (scale.mm_per_px() * scale.mm_per_px());
    let of_noise = store.gradient_noise()?.unwrap_or_default();
    let of_noise = of_noise.iter().enumerate().map(|(element, factor)| {
        // The two components are not coupled: turning changes nothing.
        alike(mean_products(measured.corners(element)), per_mm * factor)
    });
    let of_noise: Vec<ElementMatrix> = of_noise.collect();
    let normal_matrix = store.normal_matrices()?.map(|list| RunMatrix {
        corners: measured.elements().to_vec(),
        matrices: list.into_iter().map(|matrix| turned(matrix, per_mm)).collect(),
        of_noise,
    });
    let n_references = store.header().reference.len().max(1);
    Ok(JointRun {
        path: path.to_owned(),
        mesh,
        frames,
        measured_from,
        instants,
        sigma,
        normal_matrix,
        n_references,
        noise_grey,
        noise_ratio,
        left_out,
        warnings: warnings_beside(path),
    })
}

/// What the correlation warned of, from the summary beside the store. A run that goes on has none yet, and one that was moved
/// without it is none the worse.
fn warnings_beside(store: &Path) -> Vec<String> {
    #[derive(serde::Deserialize)]
    struct Messages {
        messages: Vec<String>,
    }
    let places = [Some(store), store.parent()].into_iter().flatten();
    let text = places.filter_map(|folder| std::fs::read_to_string(folder.join(SUMMARY)).ok()).next();
    let read = text.and_then(|text| serde_json::from_str::<Messages>(&text).ok());
    let plain = |line: &String| line.strip_prefix("warning: ").unwrap_or(line).to_owned();
    read.map_or(Vec::new(), |summary| summary.messages.iter().map(plain).collect())
}

/// The matrix times `factor`, with y up: what couples x and y changes its sign.
fn turned(mut matrix: ElementMatrix, factor: f64) -> ElementMatrix {
    let places = (0..8).flat_map(|row| (row..8).map(move |column| (row, column)));
    for (entry, (row, column)) in matrix.iter_mut().zip(places) {
        *entry *= factor * TURN[row % 2] * TURN[column % 2];
    }
    matrix
}
