//! A case is read whole before anything runs: the joint that the measurement will give is made of the zones alone, and
//! everything that is said of it and of the fit is tried on it.

use crate::correlate::CorrelationError;
use crate::field::Elements;
use crate::identify::Case;
use crate::io::case::CaseDocument;
use crate::io::joint::{
    BoundaryInput, DrivesInput, JointInput, JointMeshFile, JointRun, MeasurementInput, MeshInput, read_force,
};
use crate::io::run_case::RunCase;
use crate::mesh::PixelMesh;
use crate::remark::{Code, Remark};
use crate::run::frames::{Reference, about_reference};
use crate::run::plan::{Plan, Zones};
use crate::run::words::{Result, RunError};
use crate::units::PixelSize;

/// Opening at the last instant of what is made up, by the thickness of the adhesive: enough to be no rigid motion.
const OPENING: f64 = 1e-3;
/// Its standard uncertainty, px.
const SIGMA_PX: f64 = 0.01;

/// Refuses what would be refused after the correlation, and gives what would be warned of whatever is measured: lengths
/// and materials that hardly anything has.
/// Errors: zones without elements, faces that do not pair, a border that does not hold the joint, and all that
/// [`Case::joint`] and [`Case::new`] refuse.
pub(crate) fn rehearse(case: &RunCase, plan: &Plan) -> Result<Vec<Remark>> {
    if plan.options.elements == Elements::CubicSpline {
        return Err(RunError::Refused(
            "identification needs bilinear elements: the nodes of cubic splines are bound to each other, and intervals made of them \
             would be too narrow; leave elements = \"cubic-spline\" (--elements) out"
                .into(),
        ));
    }
    let Some(scale) = plan.pixel_size else { return Ok(Vec::new()) };
    let path = case.text.path();
    let run = make_up(case, plan, scale)?;
    let mut mesh = run.mesh.clone();
    let text = case.joint_case("measured", case.has_fit());
    let mut of_joint = CaseDocument::parse(&text, path)?.joint()?;
    // Faults are shown in the file that the user wrote.
    of_joint.text = case.text.clone();
    if let Some([first, _]) = &of_joint.mesh.zones {
        mesh.lower = mesh.groups.iter().position(|group| group == first).map(|at| at as u32);
    }
    let measurement = case.has_fit().then(|| MeasurementInput::Run(run.clone()));
    let boundary = BoundaryInput::Run(run);
    let drives = DrivesInput::default();
    let force = read_force(&of_joint, &boundary, &drives)?;
    let input = JointInput { case: of_joint, mesh: MeshInput::Run(mesh), boundary, drives, measurement, force };
    let joint = Case::joint(&input)?;
    let mut found: Vec<Remark> = joint.remarks.iter().filter(|r| r.code == Code::LengthsApart).cloned().collect();
    if case.has_fit() {
        let of_case = Case::new(&joint, &input, path)?;
        // What it says of the jumps is said of those made up here.
        let known = |r: &&Remark| matches!(r.code, Code::MaterialImplausible | Code::LengthImplausible);
        found.extend(of_case.remarks.iter().filter(known).cloned());
    }
    Ok(found)
}

/// What the correlation would give if the joint opened a little.
#[expect(clippy::indexing_slicing, reason = "numbers of nodes and zones of one mesh")]
fn make_up(case: &RunCase, plan: &Plan, scale: PixelSize) -> Result<JointRun> {
    let Reference { image, .. } = Reference::of(plan)?;
    let (size, options) = ([image.width(), image.height()], &plan.options);
    let zones = Zones::on(plan, size)?.zones;
    let laid = PixelMesh::on_zones(&zones, options.mesh_size(), options.element_share, size)
        .map_err(|error| about_reference(plan, &image, &CorrelationError::Mesh(error)))?;
    let on_specimen = laid.mesh.to_mm(scale);
    let (elements, groups) = (on_specimen.elements().to_vec(), on_specimen.zones().to_vec());
    let n_nodes = on_specimen.nodes().len();
    let mut moves = vec![false; n_nodes];
    for (corners, &group) in elements.iter().zip(on_specimen.element_zone()) {
        if groups[group as usize] == case.interface.zones[1] {
            corners.iter().for_each(|&node| moves[node as usize] = true);
        }
    }
    let n_frames = plan.deformed.len();
    let instant = |k: usize| {
        let by = OPENING * case.thickness_mm * (k + 1) as f64 / n_frames as f64;
        let opened = |&moves: &bool| Some(if moves { case.normal.map(|n| by * n) } else { [0.0; 2] });
        moves.iter().map(opened).collect()
    };
    let mesh = JointMeshFile {
        path: case.text.path().to_owned(),
        nodes: on_specimen.nodes().to_vec(),
        element_group: on_specimen.element_zone().to_vec(),
        elements,
        groups,
        mm_per_px: Some(scale.mm_per_px()),
        ..JointMeshFile::default()
    };
    Ok(JointRun {
        path: case.text.path().to_owned(),
        mesh,
        without_texture: Vec::new(),
        frames: (1..=n_frames).collect(),
        measured_from: vec![0; n_frames],
        instants: (0..n_frames).map(instant).collect(),
        sigma: vec![vec![[SIGMA_PX * scale.mm_per_px(); 2]; n_nodes]; n_frames],
        normal_matrix: None,
        n_references: plan.reference.len().max(1),
        noise_grey: None,
        noise_ratio: None,
        camera: Vec::new(),
        left_out: Vec::new(),
        warnings: Vec::new(),
    })
}
