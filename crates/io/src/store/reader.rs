//! Reading a store.

use super::attributes::Attributes;
use super::folder::Folder;
use super::layout::{
    Form, GRADIENT_NOISE, NO_POINT, NOISE, NORMAL_MATRICES, NOT_DONE, PENALTY, Place, REFERENCE_FRAME, UNKNOWN_MARK,
    Variable, codec_options,
};
use super::{STORE, StoreError, StoreHeader};
use crate::arrays::{Number, Values};
use crate::case::{CaseCamera, CaseCameraError};
use crate::field::{
    ElementMark, Measurement, ModelError, PointField, Status, StrainField, TensorStrain, WindowStrains,
};
use crate::linalg::{BlockMatrix, ElementMatrix, Pattern};
use crate::mesh::{Mesh, ZoneElements};
use crate::units::Px;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zarrs::array::{Array, FromArrayBytes};

/// The results of a run, frame by frame.
///
/// Opening reads mesh and header, and no frame: a store of any length opens as fast as a short one.
#[derive(Debug)]
pub struct Store {
    folder: Arc<Folder>,
    header: StoreHeader,
    frames_sha256: Vec<Option<String>>,
    status: Array<Folder>,
    /// Those that the store has, in the order of [`Variable::ALL`].
    variables: Vec<(Variable, Array<Folder>)>,
}

/// The field of one frame.
#[derive(Debug, Clone)]
pub struct StoredFrame {
    /// Its number in the series, from 1.
    pub number: usize,
    /// The field; standard uncertainties, model errors and residuals in the precision of `f32` they are stored with.
    pub measurement: Measurement<Px>,
    /// File of the deformed image.
    pub file: String,
}

impl Store {
    /// Opens the store `path`, or the one in the folder `path` of a run.
    ///
    /// # Errors
    /// No store, another layout, and metadata or a mesh that are damaged.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, StoreError> {
        let path = path.as_ref();
        let inside = path.join(STORE);
        let path = if inside.is_dir() { inside } else { path.to_owned() };
        let group = path.join("zarr.json");
        let text = fs::read(&group).map_err(|error| match error.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => StoreError::NotFound { path: path.clone() },
            _ => StoreError::reading(group, &error),
        })?;
        let attributes = Attributes::parse(&text, &path)?;
        let folder = Arc::new(Folder::new(&path));
        let mesh = Arc::new(mesh(&folder, &attributes)?);
        let header = attributes.header(mesh, &path)?;
        let n_frames = header.frames.len();
        let variables = Form::open_variables(&folder, [n_frames, attributes.n_nodes, attributes.n_elements])?;
        let status = Form::status(n_frames).open(&folder)?;
        Ok(Self { folder, header, frames_sha256: attributes.frames_sha256, status, variables })
    }

    /// The folder of the store.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// The same fields, which are in raw px, as another camera sees their plane; also in its size of a pixel, where it
    /// states one.
    ///
    /// # Errors
    /// A camera of other images, or numbers that are none.
    pub fn seen_by(mut self, camera: &CaseCamera) -> Result<Self, CaseCameraError> {
        self.header.see_by(camera)?;
        Ok(self)
    }

    /// What holds for all frames.
    pub fn header(&self) -> &StoreHeader {
        &self.header
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<Mesh<Px>> {
        &self.header.mesh
    }

    /// Frames of the series, done or not.
    pub fn n_frames(&self) -> usize {
        self.header.frames.len()
    }

    /// The normal matrices of the elements (upper triangles by rows, px and y down); `None` when the run kept none.
    ///
    /// # Errors
    /// A chunk that is damaged or not there.
    pub fn normal_matrices(&self) -> Result<Option<Vec<ElementMatrix>>, StoreError> {
        if !self.folder.has(NORMAL_MATRICES) {
            return Ok(None);
        }
        let (_, values) = constant::<f64>(&self.folder, &Form::normal_matrices(self.mesh().n_elements()))?;
        Ok(Some(values.as_chunks::<36>().0.to_vec()))
    }

    /// What noise in the reference adds to the normal matrix of each element, `G n / k`; `None` in earlier stores.
    ///
    /// # Errors
    /// A chunk that is damaged or not there.
    pub fn gradient_noise(&self) -> Result<Option<Vec<f64>>, StoreError> {
        if !self.folder.has(GRADIENT_NOISE) {
            return Ok(None);
        }
        Ok(Some(constant::<f64>(&self.folder, &Form::gradient_noise(self.mesh().n_elements()))?.1))
    }

    /// The penalty `w R` of a regularised run (px and y down); `None` of others, and in the stores of earlier versions.
    ///
    /// # Errors
    /// A chunk that is damaged or not there.
    pub fn penalty(&self) -> Result<Option<BlockMatrix>, StoreError> {
        if !self.folder.has(PENALTY) {
            return Ok(None);
        }
        // It couples nodes of one element, or neighbours of neighbours.
        let mut pattern = Pattern::new(self.mesh().n_nodes(), self.mesh().elements());
        if Form::penalty(pattern.n_blocks()).open(&self.folder).is_err() {
            pattern = pattern.widened();
        }
        let (_, values) = constant::<f64>(&self.folder, &Form::penalty(pattern.n_blocks()))?;
        Ok(BlockMatrix::of_blocks(&Arc::new(pattern), values.as_chunks::<4>().0.to_vec()))
    }

    /// Noise of one image in frame `number` (from 1), grey levels: the one that its uncertainty is made with, and that
    /// of its residual; `None` where it was not noted.
    ///
    /// # Errors
    /// As [`Store::frame`].
    pub fn noise(&self, number: usize) -> Result<Option<[f64; 2]>, StoreError> {
        if !self.has_field(number)? || !self.folder.has(NOISE) {
            return Ok(None);
        }
        let array = Form::noise(self.n_frames()).open(&self.folder)?;
        let found = chunk::<f32>(&self.folder, &array, &[number as u64 - 1, 0], Some(number))?;
        Ok(match found.as_deref() {
            Some(&[used, residual]) if used > 0.0 && residual > 0.0 => Some([used, residual].map(f64::from)),
            _ => None,
        })
    }

    /// SHA-256 of the image of frame `number` (from 1); `None` when it was not read or the run did not end.
    pub fn frame_sha256(&self, number: usize) -> Option<&str> {
        self.frames_sha256.get(number.checked_sub(1)?)?.as_deref()
    }

    /// How frame `number` (from 1) ended; `None` when it is not done.
    ///
    /// # Errors
    /// A number that the series does not have, a damaged chunk.
    pub fn status(&self, number: usize) -> Result<Option<Status>, StoreError> {
        let n_frames = self.n_frames();
        if number == 0 || number > n_frames {
            return Err(StoreError::NoFrame { number, n_frames });
        }
        let at = [number as u64 - 1];
        match chunk::<u8>(&self.folder, &self.status, &at, Some(number))?.as_deref() {
            None | Some([NOT_DONE]) => Ok(None),
            Some(&[code]) if Status::from_code(code).is_some() => Ok(Status::from_code(code)),
            Some(codes) => Err(self.report_damage(&self.status, &at, number, format!("{codes:?} is not a status"))),
        }
    }

    fn has_field(&self, number: usize) -> Result<bool, StoreError> {
        Ok(self.status(number)?.is_some_and(Status::has_field))
    }

    /// Number of the frame that frame `number` (from 1) was measured from, 0 for the reference given; `None` in the
    /// store of a run whose reference is never renewed, and for a frame without a field.
    ///
    /// # Errors
    /// As [`Store::frame`].
    pub fn reference_frame(&self, number: usize) -> Result<Option<usize>, StoreError> {
        if !self.has_field(number)? || !self.folder.has(REFERENCE_FRAME) {
            return Ok(None);
        }
        let array = Form::reference_frame(self.n_frames()).open(&self.folder)?;
        let at = [number as u64 - 1];
        match chunk::<u32>(&self.folder, &array, &at, Some(number))?.as_deref() {
            Some(&[frame]) => Ok(Some(frame as usize)),
            Some(frames) => Err(self.report_damage(&array, &at, number, format!("{} numbers, not 1", frames.len()))),
            None => Err(StoreError::MissingChunk { file: self.reference_frame_file(number), frame: Some(number) }),
        }
    }

    /// The file of [`Store::reference_frame`].
    pub fn reference_frame_file(&self, number: usize) -> PathBuf {
        self.path().join(REFERENCE_FRAME).join(format!("c.{}", number - 1))
    }

    /// The file whose presence says that frame `number` (from 1) is done.
    pub fn status_file(&self, number: usize) -> PathBuf {
        self.folder.file(&self.status.chunk_key(&[number as u64 - 1]))
    }

    /// The files that hold the field of frame `number` (from 1), which are there when it has one.
    pub fn field_files(&self, number: usize) -> Vec<PathBuf> {
        let file = |(variable, array): &(Variable, Array<Folder>)| {
            self.folder.file(&array.chunk_key(&place_of(number, *variable)))
        };
        self.variables.iter().map(file).collect()
    }

    /// Reads every chunk of frame `number` (from 1) and checks it.
    ///
    /// # Errors
    /// As [`Store::frame`].
    pub fn check(&self, number: usize) -> Result<(), StoreError> {
        self.frame(number)?;
        self.reference_frame(number)?;
        self.strain(number).map(drop)
    }

    /// Frame `number` (from 1); `None` when it has no field: not done, unreadable or diverged.
    ///
    /// # Errors
    /// A number that the series does not have, a chunk that is damaged or not there.
    pub fn frame(&self, number: usize) -> Result<Option<StoredFrame>, StoreError> {
        let Some(status) = self.status(number)?.filter(|status| status.has_field()) else { return Ok(None) };
        let mesh = self.mesh().clone();
        let codes: Vec<u8> = self.variable(number, Variable::Measured)?;
        let mut displacement = pairs(&self.variable::<f64>(number, Variable::Displacement)?);
        let mut sigma = pairs(&doubles(&self.variable(number, Variable::Sigma)?));
        let element_residual = match self.has(Variable::Residual) {
            true => doubles(&self.variable(number, Variable::Residual)?),
            false => Vec::new(),
        };
        let measured = self.flags(number, Variable::Measured, codes)?;
        for pairs in [&mut displacement, &mut sigma] {
            self.keep_measured(number, Variable::Displacement, "number", &measured, pairs)?;
        }
        if let Some(element) = element_residual.iter().position(|residual| !residual.is_finite()) {
            let reason = format!("the residual of element {element} is not a finite number");
            return Err(self.damaged_variable(number, Variable::Residual, reason));
        }
        let model_error = self.model_error(number, &measured)?;
        let marks = self.marks(number)?;
        let points = self.points(number, &measured)?;
        let measurement =
            Measurement { mesh, status, displacement, sigma, measured, element_residual, model_error, marks, points };
        Ok(Some(StoredFrame { number, measurement, file: self.file_of(number) }))
    }

    /// Of frame `number` (from 1), which diverged, its status and the residual of its elements, which shows why and is
    /// no measurement: all displacements are zero. `None` of frames with a field, and where no residual was kept.
    ///
    /// # Errors
    /// As [`Store::frame`], but for chunks that are not there.
    pub fn without_field(&self, number: usize) -> Result<Option<StoredFrame>, StoreError> {
        let Some(status) = self.status(number)?.filter(|status| *status == Status::Diverged) else { return Ok(None) };
        let element_residual = match self.variable(number, Variable::Residual) {
            Ok(values) => doubles(&values),
            Err(StoreError::MissingChunk { .. }) => return Ok(None),
            Err(error) => return Err(error),
        };
        let n = self.mesh().n_nodes();
        let measurement = Measurement {
            mesh: self.mesh().clone(),
            status,
            displacement: vec![[0.0; 2]; n],
            sigma: vec![[0.0; 2]; n],
            measured: vec![true; n],
            element_residual,
            model_error: None,
            marks: None,
            points: None,
        };
        Ok(Some(StoredFrame { number, measurement, file: self.file_of(number) }))
    }

    /// The values at points of a frame; none in a store of an earlier version, or where nobody made them.
    fn points(&self, number: usize, measured: &[bool]) -> Result<Option<PointField>, StoreError> {
        let of_points = [Variable::DisplacementPoint, Variable::SigmaPoint, Variable::IsPointValue];
        if !of_points.into_iter().all(|variable| self.has(variable)) {
            return Ok(None);
        }
        let codes: Vec<u8> = self.variable(number, Variable::IsPointValue)?;
        if codes.iter().all(|&code| code == NO_POINT) {
            return Ok(None);
        }
        let mut displacement = pairs(&self.variable::<f64>(number, Variable::DisplacementPoint)?);
        let mut sigma = pairs(&doubles(&self.variable(number, Variable::SigmaPoint)?));
        let flags = self.flags(number, Variable::IsPointValue, codes)?;
        for pairs in [&mut displacement, &mut sigma] {
            self.keep_measured(number, Variable::DisplacementPoint, "value at its point", measured, pairs)?;
        }
        let is_value = flags.into_iter().zip(measured).map(|(flag, &measured)| flag && measured).collect();
        Ok(Some(PointField { displacement, sigma, is_value }))
    }

    /// What is the matter with the elements of a frame; none in a store of an earlier version, or where nobody looked.
    fn marks(&self, number: usize) -> Result<Option<Vec<ElementMark>>, StoreError> {
        if !self.has(Variable::Mark) {
            return Ok(None);
        }
        let codes: Vec<u8> = self.variable(number, Variable::Mark)?;
        if codes.iter().all(|&code| code == UNKNOWN_MARK) {
            return Ok(None);
        }
        let mark = |(element, &code): (usize, &u8)| {
            let reason = || format!("the mark of element {element} is {code}, which is not a mark");
            ElementMark::from_code(code).ok_or_else(|| self.damaged_variable(number, Variable::Mark, reason()))
        };
        codes.iter().enumerate().map(mark).collect::<Result<_, _>>().map(Some)
    }

    /// What the field of a frame may be off beyond noise; none in a store of an earlier version, or if not known.
    fn model_error(&self, number: usize, measured: &[bool]) -> Result<Option<ModelError>, StoreError> {
        if ![Variable::ModelError, Variable::Misfit].into_iter().all(|variable| self.has(variable)) {
            return Ok(None);
        }
        let misfit = doubles(&self.variable(number, Variable::Misfit)?);
        let mut nodes = pairs(&doubles(&self.variable(number, Variable::ModelError)?));
        let is_known = |(node, &measured): (&[f64; 2], &bool)| measured && node.iter().any(|v| !v.is_nan());
        if misfit.iter().all(|v| v.is_nan()) && !nodes.iter().zip(measured).any(is_known) {
            return Ok(None);
        }
        if let Some(element) = misfit.iter().position(|v| !v.is_finite()) {
            let reason = format!("the misfit of element {element} is not a finite number");
            return Err(self.damaged_variable(number, Variable::Misfit, reason));
        }
        self.keep_measured(number, Variable::ModelError, "model error", measured, &mut nodes)?;
        Ok(Some(ModelError { nodes, misfit }))
    }

    /// Whether the store has this array: those of earlier versions do not have all.
    pub fn has(&self, variable: Variable) -> bool {
        self.variables.iter().any(|(there, _)| *there == variable)
    }

    /// The strains of frame `number` (from 1), with the precision of `f32`; `None` as for [`Store::frame`].
    ///
    /// # Errors
    /// As [`Store::frame`].
    pub fn strain(&self, number: usize) -> Result<Option<StrainField>, StoreError> {
        if !self.has_field(number)? {
            return Ok(None);
        }
        let strains = |variable| -> Result<Vec<Option<TensorStrain>>, StoreError> {
            let values = doubles(&self.variable(number, variable)?);
            let known = |e: &[f64; 3]| e.iter().all(|v| v.is_finite()).then(|| TensorStrain::of_components(*e));
            Ok(values.as_chunks().0.iter().map(known).collect())
        };
        let window = match (self.header.strain_window, self.has(Variable::StrainWindow)) {
            (Some(window), true) => {
                let (strain, sigma) = (strains(Variable::StrainWindow)?, strains(Variable::SigmaStrainWindow)?);
                let both = |(strain, sigma): (Option<TensorStrain>, Option<TensorStrain>)| {
                    strain.zip(sigma.map(TensorStrain::components))
                };
                let model_error = match self.has(Variable::ModelErrorStrainWindow) {
                    true => {
                        let errors = strains(Variable::ModelErrorStrainWindow)?.into_iter();
                        Some(errors.map(|error| error.unwrap_or_default().components()).collect())
                    }
                    false => None,
                };
                let nodes = strain.into_iter().zip(sigma).map(both).collect();
                Some(WindowStrains { window, nodes, model_error, correlations: None, flattened: None })
            }
            _ => None,
        };
        Ok(Some(StrainField {
            definition: self.header.strain,
            elements: strains(Variable::StrainElement)?,
            nodes: strains(Variable::StrainNode)?,
            length_px: self.header.element_size_px,
            window,
        }))
    }

    /// The numbers of one array of frame `number` (from 1) as they are stored; `None` as for [`Store::frame`], and of
    /// an array that the store does not have.
    ///
    /// # Errors
    /// As [`Store::frame`].
    pub fn values(&self, number: usize, variable: Variable) -> Result<Option<Values>, StoreError> {
        if !self.has_field(number)? || !self.has(variable) {
            return Ok(None);
        }
        Ok(Some(match variable.number() {
            Number::F64 => Values::F64(self.variable(number, variable)?),
            Number::F32 => Values::F32(self.variable(number, variable)?),
            Number::U32 => Values::U32(self.variable(number, variable)?),
            Number::U8 => Values::U8(self.variable(number, variable)?),
        }))
    }

    /// The file of a frame that there is.
    fn file_of(&self, number: usize) -> String {
        number.checked_sub(1).and_then(|at| self.header.frames.get(at)).cloned().unwrap_or_default()
    }

    #[expect(clippy::indexing_slicing, reason = "every store has displacements, which are the first")]
    fn array(&self, variable: Variable) -> &Array<Folder> {
        &self.variables[self.variables.iter().position(|(there, _)| *there == variable).unwrap_or(0)].1
    }

    /// The numbers of one array of a frame that has a field.
    fn variable<T: zarrs::array::ElementOwned>(&self, number: usize, variable: Variable) -> Result<Vec<T>, StoreError>
    where
        Vec<T>: FromArrayBytes,
    {
        let (array, at) = (self.array(variable), place_of(number, variable));
        let file = || self.folder.file(&array.chunk_key(&at));
        let values = chunk(&self.folder, array, &at, Some(number))?;
        let values = values.ok_or_else(|| StoreError::MissingChunk { file: file(), frame: Some(number) })?;
        let n = match variable.place() {
            Place::Nodes => self.mesh().n_nodes(),
            Place::Elements => self.mesh().n_elements(),
        };
        let wanted = n * variable.n_components();
        if values.len() != wanted {
            return Err(self.damaged_variable(number, variable, format!("{} numbers, not {wanted}", values.len())));
        }
        Ok(values)
    }

    /// Marks of nodes, which are 0 or 1.
    fn flags(&self, number: usize, variable: Variable, codes: Vec<u8>) -> Result<Vec<bool>, StoreError> {
        let flag = |(node, code)| match code {
            0 | 1 => Ok(code == 1),
            _ => {
                let reason = format!("the mark of node {node} is {code}, not 0 or 1");
                Err(self.damaged_variable(number, variable, reason))
            }
        };
        codes.into_iter().enumerate().map(flag).collect()
    }

    /// Sets the pairs of nodes that are not measured to zero; all others must be finite.
    fn keep_measured(
        &self,
        number: usize,
        variable: Variable,
        what: &str,
        measured: &[bool],
        pairs: &mut [[f64; 2]],
    ) -> Result<(), StoreError> {
        for (node, (pair, &measured)) in pairs.iter_mut().zip(measured).enumerate() {
            if !measured {
                *pair = [0.0; 2];
            } else if !pair.iter().all(|v| v.is_finite()) {
                let reason = format!("node {node} is measured and has no finite {what}");
                return Err(self.damaged_variable(number, variable, reason));
            }
        }
        Ok(())
    }

    fn report_damage(&self, array: &Array<Folder>, at: &[u64], number: usize, reason: String) -> StoreError {
        StoreError::DamagedChunk { file: self.folder.file(&array.chunk_key(at)), frame: Some(number), reason }
    }

    fn damaged_variable(&self, number: usize, variable: Variable, reason: String) -> StoreError {
        self.report_damage(self.array(variable), &place_of(number, variable), number, reason)
    }
}

/// Place of the chunk of a frame.
pub(super) fn place_of(number: usize, variable: Variable) -> Vec<u64> {
    let mut at = vec![number as u64 - 1, 0];
    if !variable.components().is_empty() {
        at.push(0);
    }
    at
}

fn chunk<T: zarrs::array::ElementOwned>(
    folder: &Folder,
    array: &Array<Folder>,
    at: &[u64],
    frame: Option<usize>,
) -> Result<Option<Vec<T>>, StoreError>
where
    Vec<T>: FromArrayBytes,
{
    array
        .retrieve_chunk_if_exists_opt(at, &codec_options())
        .map_err(|error| StoreError::chunk(folder.file(&array.chunk_key(at)), frame, &error))
}

/// What all frames share, read from its one chunk.
fn constant<T: zarrs::array::ElementOwned>(folder: &Arc<Folder>, form: &Form) -> Result<(PathBuf, Vec<T>), StoreError>
where
    Vec<T>: FromArrayBytes,
{
    let array = form.open(folder)?;
    let at = vec![0; form.shape.len()];
    let file = folder.file(&array.chunk_key(&at));
    let missing = || StoreError::MissingChunk { file: file.clone(), frame: None };
    let values: Vec<T> = chunk(folder, &array, &at, None)?.ok_or_else(missing)?;
    let wanted = form.shape.iter().product::<u64>() as usize;
    if values.len() != wanted {
        let reason = format!("{} numbers, not {wanted}", values.len());
        return Err(StoreError::DamagedChunk { file, frame: None, reason });
    }
    Ok((file, values))
}

#[expect(
    clippy::indexing_slicing,
    reason = "the zones are counted above, and constant() has compared the numbers of nodes and corners"
)]
fn mesh(folder: &Arc<Folder>, attributes: &Attributes) -> Result<Mesh<Px>, StoreError> {
    let (n_nodes, n_elements) = (attributes.n_nodes, attributes.n_elements);
    if n_nodes > u32::MAX as usize || n_elements > u32::MAX as usize {
        let reason = format!("{n_nodes} nodes and {n_elements} elements are more than a mesh can have");
        return Err(StoreError::Metadata { file: folder.path().join("zarr.json"), reason });
    }
    let damaged = |file: &PathBuf, reason: String| StoreError::DamagedChunk { file: file.clone(), frame: None, reason };
    let (position_file, positions) = constant::<f64>(folder, &Form::node_position(n_nodes))?;
    let (corner_file, corners) = constant::<u32>(folder, &Form::element_nodes(n_elements))?;
    let (node_file, node_zone) = constant::<u32>(folder, &Form::node_zone(n_nodes))?;
    let (element_file, element_zone) = constant::<u32>(folder, &Form::element_zone(n_elements))?;
    if let Some(at) = positions.iter().position(|x| !x.is_finite()) {
        return Err(damaged(&position_file, format!("the position of node {} is not a finite number", at / 2)));
    }
    let n_zones = attributes.zones().len();
    for (file, zones) in [(&node_file, &node_zone), (&element_file, &element_zone)] {
        // Numbers of nodes and elements go zone by zone: a zone is a range of them.
        if !zones.is_sorted() || zones.last().is_some_and(|&zone| zone as usize >= n_zones) {
            return Err(damaged(file, format!("the zones are not numbered in order from 0 to below {n_zones}")));
        }
    }
    let mut zones: Vec<ZoneElements> = attributes
        .zones()
        .iter()
        .map(|name| ZoneElements { name: name.clone(), nodes: Vec::new(), elements: Vec::new() })
        .collect();
    for (position, &zone) in pairs(&positions).into_iter().zip(&node_zone) {
        zones[zone as usize].nodes.push(position);
    }
    let first: Vec<u32> =
        (0..n_zones as u32).map(|zone| node_zone.partition_point(|&other| other < zone) as u32).collect();
    for (element, (corners, &zone)) in corners.chunks_exact(4).zip(&element_zone).enumerate() {
        let zone = zone as usize;
        let own = first[zone]..first[zone] + zones[zone].nodes.len() as u32;
        if let Some(node) = corners.iter().find(|node| !own.contains(node)) {
            return Err(damaged(
                &corner_file,
                format!("element {element} has the node {node}, which its zone does not have"),
            ));
        }
        zones[zone].elements.push([0, 1, 2, 3].map(|k| corners[k] - first[zone]));
    }
    Mesh::from_zones(zones).map_err(|source| StoreError::Mesh { path: folder.path().to_owned(), source })
}

fn pairs(values: &[f64]) -> Vec<[f64; 2]> {
    values.as_chunks().0.to_vec()
}

fn doubles(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}
