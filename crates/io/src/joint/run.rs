//! A correlation run, read from its store.

use super::{JointFileError, JointMeshFile, JointRun, RunCamera, RunMatrix};
use crate::camera::{CameraTerm, Rectifier};
use crate::field::{ElementMark, Elements, Status};
use crate::linalg::{ElementMatrix, WithoutPenalty, alike};
use crate::mesh::{Mesh, mean_products};
use crate::remark::Remark;
use crate::store::Store;
use crate::units::{Px, Vector};
use std::path::Path;
use std::sync::Arc;

/// What a correlation, or an import, leaves beside its store.
const SUMMARIES: [&str; 2] = ["summary.json", "import.json"];

/// Reads the run in the folder `path`, or of the store `path`: of its zones the first two where these are `only` those
/// that are named.
///
/// # Errors
/// A store that cannot be read, no pixel size, no frame that converged; displacements that are splines.
pub fn read_joint_run(path: &Path, only: Option<&[String; 2]>) -> Result<JointRun, JointFileError> {
    let store = Store::open(path)?;
    let Some(scale) = store.header().pixel_size else {
        let what = "the run has no pixel size; correlate again with --pixel-size MM";
        return Err(JointFileError::file(path, what));
    };
    if store.header().elements() == Elements::CubicSpline {
        let what = "the displacements of the run are cubic splines, whose nodes are bound to each other: intervals made of \
                    them would be too narrow; correlate again without --elements";
        return Err(JointFileError::file(path, what));
    }
    let header = store.header();
    let refused = |error: &dyn std::fmt::Display| JointFileError::file(path, error.to_string());
    let camera = header.camera().map_err(|error| refused(&error))?;
    let rectifier = Rectifier::new(camera, store.mesh()).map_err(|error| refused(&error))?;
    let measured = rectifier.mesh();
    let n_zones = zones_of_joint(&rectifier, only).ok_or_else(|| {
        refused(&"[camera] still: list the still zones after those of the joint, which they are no part of")
    })?;
    let n_nodes = (0..n_zones).map(|zone| measured.zone_nodes(zone).end).max().unwrap_or(0);
    let n_elements = (0..n_zones).map(|zone| measured.zone_elements(zone).end).max().unwrap_or(0);
    let on_specimen = Arc::new(measured.to_mm(scale));
    let case_camera = header.case_camera().unwrap_or_default();
    let is_stated = |term: &str| match term {
        "distance" => case_camera.distance_std.is_some() || case_camera.still.is_some(),
        _ => case_camera.states_camera(),
    };
    let mut camera: Vec<RunCamera> = Vec::new();
    let mesh = JointMeshFile {
        path: path.to_owned(),
        elements: on_specimen.elements().iter().take(n_elements).copied().collect(),
        nodes: on_specimen.nodes().iter().take(n_nodes).copied().collect(),
        groups: on_specimen.zones().iter().take(n_zones).cloned().collect(),
        element_group: on_specimen.element_zone().iter().take(n_elements).copied().collect(),
        mm_per_px: Some(scale.mm_per_px()),
        ..JointMeshFile::default()
    };
    let (mut frames, mut instants, mut left_out, mut sigma) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut measured_from = Vec::new();
    let (matrix, without_penalty) = without_penalty(&store, matrix_of(&store, measured)?)?;
    for number in 1..=store.n_frames() {
        match store.frame(number)?.map(|frame| frame.measurement).filter(|field| field.status == Status::Converged) {
            Some(mut field) => {
                if let Some(without) = &without_penalty {
                    without.apply(&mut field.displacement, &mut field.sigma, &mut field.measured);
                }
                let field = rectifier.rectify(&field);
                if !field.measured.contains(&true) {
                    left_out.push(number);
                    continue;
                }
                for (k, CameraTerm { name, change, .. }) in rectifier.terms(&field).into_iter().enumerate() {
                    if k == camera.len() {
                        let (name, instants) = (name.to_owned(), Vec::new());
                        camera.push(RunCamera { is_stated: is_stated(&name), name, instants });
                    }
                    let in_mm = |u: [f64; 2]| scale.to_mm(Vector::new(u)).components();
                    if let Some(of) = camera.get_mut(k) {
                        of.instants.push(change.into_iter().take(n_nodes).map(in_mm).collect());
                    }
                }
                let field = field.to_mm(&on_specimen, scale);
                let at = |(&u, &measured): (&[f64; 2], &bool)| measured.then_some(u);
                frames.push(number);
                measured_from.push(store.reference_frame(number)?.unwrap_or(0));
                instants.push(field.displacement.iter().zip(&field.measured).take(n_nodes).map(at).collect());
                sigma.push(field.sigma.into_iter().take(n_nodes).collect());
            }
            None => left_out.push(number),
        }
    }
    if frames.is_empty() {
        return Err(JointFileError::file(path, "no frame of the run converged; look at its summary.json"));
    }
    let [noise_grey, noise_ratio] = mean_noise(&store, &frames)?;
    let per_mm = 1.0 / (scale.mm_per_px() * scale.mm_per_px());
    let in_mm =
        |list: Vec<ElementMatrix>| list.into_iter().take(n_elements).map(|matrix| flip_y(matrix, per_mm)).collect();
    let normal_matrix = matrix.map(|RunMatrix { corners, matrices, of_noise }| RunMatrix {
        corners: corners.into_iter().take(n_elements).collect(),
        matrices: in_mm(matrices),
        of_noise: in_mm(of_noise),
    });
    Ok(JointRun {
        path: path.to_owned(),
        mesh,
        without_texture: without_texture(&store, n_elements)?,
        frames,
        measured_from,
        instants,
        sigma,
        normal_matrix,
        n_references: store.header().reference.len().max(1),
        noise_grey,
        noise_ratio,
        left_out,
        camera,
        warnings: warnings_beside(path),
    })
}

/// The normal matrix of the correlation, px and y down, on the mesh as it is `measured`; `None` where none was kept.
fn matrix_of(store: &Store, measured: &Mesh<Px>) -> Result<Option<RunMatrix>, JointFileError> {
    let of_noise = store.gradient_noise()?.unwrap_or_default();
    let of_noise = of_noise.iter().enumerate();
    let of_noise = of_noise.map(|(element, factor)| alike(mean_products(measured.corners(element)), *factor)).collect();
    let corners = measured.elements().to_vec();
    Ok(store.normal_matrices()?.map(|matrices| RunMatrix { corners, matrices, of_noise }))
}

/// What takes the penalty out of the fields of a regularised run, and its `matrix` without the nodes that the images
/// alone say nothing of; of other runs the matrix as it is. From a renewed reference the penalty acts on another
/// displacement, of another mesh: such a run has no matrix.
fn without_penalty(
    store: &Store,
    matrix: Option<RunMatrix>,
) -> Result<(Option<RunMatrix>, Option<WithoutPenalty>), JointFileError> {
    let Some(penalty) = store.penalty()? else { return Ok((matrix, None)) };
    let Some(mut matrix) = matrix else { return Ok((None, None)) };
    let frames: Vec<usize> = (1..=store.n_frames()).collect();
    for &number in &frames {
        if store.reference_frame(number)?.is_some_and(|reference| reference > 0) {
            return Ok((None, None));
        }
    }
    let [noise, _] = mean_noise(store, &frames)?;
    let noise = noise.unwrap_or(0.0);
    let (texture, _) = matrix.without_noise(noise);
    let mesh = store.mesh();
    let without = WithoutPenalty::new(mesh.nodes(), mesh.elements(), &texture.matrices, penalty, noise);
    let without = without.map_err(|fault| {
        let what = format!("the images say nothing of node {}: correlate again without it", fault.node);
        JointFileError::file(store.path(), what)
    })?;
    for list in [&mut matrix.matrices, &mut matrix.of_noise] {
        list.iter_mut().zip(&matrix.corners).for_each(|(of, corners)| without.forget(of, corners));
    }
    Ok((Some(matrix), Some(without)))
}

/// Of each of the first `n` elements, whether it shows no texture. That is the reference's: the same in all frames.
fn without_texture(store: &Store, n: usize) -> Result<Vec<bool>, JointFileError> {
    for number in 1..=store.n_frames() {
        if let Some(marks) = store.frame(number)?.and_then(|frame| frame.measurement.marks) {
            return Ok(marks.iter().take(n).map(|mark| *mark == ElementMark::NoTexture).collect());
        }
    }
    Ok(vec![false; n])
}

/// Noise of one image in grey levels, over the frames that know it, and that of the residual in it; none where no frame
/// does.
fn mean_noise(store: &Store, frames: &[usize]) -> Result<[Option<f64>; 2], JointFileError> {
    let (mut squares, mut n_known) = ([0.0; 2], 0.0);
    for &number in frames {
        if let Some(of_frame) = store.noise(number)? {
            n_known += 1.0;
            squares.iter_mut().zip(of_frame).for_each(|(sum, v)| *sum += v * v);
        }
    }
    let known = n_known > 0.0;
    Ok([known.then(|| (squares[0] / n_known).sqrt()), known.then(|| (squares[1] / squares[0]).sqrt())])
}

/// How many zones are parts of the joint: the first two where `only` those are asked for, else those before the still
/// ones, which are no parts of it. `None` where still ones lie between others: the numbers of the nodes would be others
/// than in the run.
fn zones_of_joint(rectifier: &Rectifier, only: Option<&[String; 2]>) -> Option<usize> {
    let first = rectifier.mesh().zones().get(..2);
    if only.is_some_and(|only| first.is_some_and(|first| only.iter().all(|name| first.contains(name)))) {
        return Some(2);
    }
    let is_still = |zone: &String| rectifier.camera().shape().still.contains(zone);
    let zones = rectifier.mesh().zones();
    let n_zones = zones.iter().position(is_still).unwrap_or(zones.len());
    zones.iter().skip(n_zones).all(is_still).then_some(n_zones)
}

/// Warnings of the correlation from the summary beside the store; a run that goes on, or was moved, may have none.
fn warnings_beside(store: &Path) -> Vec<Remark> {
    #[derive(serde::Deserialize)]
    struct Remarks {
        #[serde(default)]
        remarks: Vec<Remark>,
    }
    let places = [Some(store), store.parent()].into_iter().flatten();
    let files = places.flat_map(|folder| SUMMARIES.map(|name| folder.join(name)));
    let text = files.filter_map(|file| std::fs::read_to_string(file).ok()).next();
    let read = text.and_then(|text| serde_json::from_str::<Remarks>(&text).ok());
    read.map_or(Vec::new(), |summary| summary.remarks.into_iter().filter(Remark::is_warning).collect())
}

/// The matrix times `factor`, with y up: what couples x and y changes its sign.
fn flip_y(mut matrix: ElementMatrix, factor: f64) -> ElementMatrix {
    let places = (0..8).flat_map(|row| (row..8).map(move |column| (row, column)));
    for (entry, (row, column)) in matrix.iter_mut().zip(places) {
        *entry *= if row % 2 == column % 2 { factor } else { -factor };
    }
    matrix
}
