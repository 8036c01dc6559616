//! Writing a store.

use super::attributes::Attributes;
use super::folder::{Folder, PART};
use super::layout::{
    Form, GRADIENT_NOISE, NO_POINT, NOISE, NORMAL_MATRICES, PENALTY, PENALTY_NODES, REFERENCE_FRAME, UNKNOWN_MARK,
    Variable, codec_options,
};
use super::reader::{Store, place_of};
use super::{StoreError, StoreHeader};
use crate::field::{Measurement, Status, StrainDefinition, StrainField, TensorStrain};
use crate::linalg::{BlockMatrix, ElementMatrix};
use crate::mesh::Mesh;
use crate::units::Px;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};
use zarrs::array::{Array, ArrayError, IntoArrayBytes};
use zarrs::storage::store::MemoryStore;
use zarrs::storage::{Bytes, ReadableStorageTraits, StorageError, StoreKey, WritableStorageTraits};

/// Frames that a growing series has room for ahead, at least.
const ROOM_AHEAD: usize = 64;

/// Writes the frames of a run, in any order and from any thread.
///
/// ```
/// # use quadrille_io as quadrille;
/// # use quadrille::{field::*, mesh::{Mesh, Roi, Zone}, io::store::*};
/// # let roi = Roi { x0: 0.0, y0: 0.0, x1: 16.0, y1: 16.0 };
/// # let mesh = std::sync::Arc::new(Mesh::on_zones(&[Zone::rectangle("all", roi)], 16, 32, 32).unwrap());
/// # let measurement = Measurement { mesh: mesh.clone(), status: Status::Converged,
/// #     displacement: vec![[0.1, -2.0]; 4], sigma: vec![[0.01; 2]; 4], measured: vec![true; 4],
/// #     element_residual: vec![1.5], model_error: None, marks: None, points: None };
/// # let header = StoreHeader { quadrille: "0.1.0".into(), device: "cpu".into(), mesh, image_size_px: [32, 32],
/// #     reference: vec!["ref.tif".into()], reference_sha256: vec![String::new()],
/// #     frames: vec!["a.tif".into(), "b.tif".into()], pixel_size: None, range_grey: 255.0,
/// #     element_size_px: 16.0, strain: StrainDefinition::default(), strain_window: None, case: String::new() };
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("fields.zarr");
/// let writer = StoreWriter::create(&path, &header)?; // the header: mesh, files, options
/// writer.write(1, &measurement, &StrainField::of(&measurement, header.strain))?;
///
/// let store = Store::open(&path)?;
/// assert_eq!(store.frame(1)?.unwrap().measurement.displacement, measurement.displacement);
/// assert_eq!(store.status(2)?, None); // not done
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct StoreWriter {
    folder: Arc<Folder>,
    series: Mutex<ByFrame>,
    mesh: Arc<Mesh<Px>>,
    status: Array<Folder>,
    /// Those that the store has, in the order of [`Variable::ALL`].
    variables: Vec<(Variable, Array<Folder>)>,
}

/// The field of a frame as its files will hold it, each nothing where all of it is the fill value.
#[derive(Debug)]
pub struct EncodedField(Vec<(StoreKey, Option<Bytes>)>);

/// Whether the fields of a store have residuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Residuals {
    Kept,
    None,
}

/// What a store says of its frames.
#[derive(Debug)]
struct ByFrame {
    attributes: Attributes,
    /// Length of the arrays by frame: not below the number of frames.
    room: usize,
}

impl StoreWriter {
    /// Makes the store `path`, without any frame. A store of an earlier run at that place is removed. It is made under
    /// another name and renamed, so that it is there whole or not at all.
    ///
    /// # Errors
    /// Something else that stands there, and what the file system refuses.
    pub fn create(path: &Path, header: &StoreHeader) -> Result<Self, StoreError> {
        Self::replace(path, header, Residuals::Kept)
    }

    /// [`StoreWriter::create`] for fields that another program measured, which have no residual.
    ///
    /// # Errors
    /// As [`StoreWriter::create`].
    pub fn create_for_points(path: &Path, header: &StoreHeader) -> Result<Self, StoreError> {
        Self::replace(path, header, Residuals::None)
    }

    fn replace(path: &Path, header: &StoreHeader, residuals: Residuals) -> Result<Self, StoreError> {
        remove_store(path)?;
        let part = Self::prepare(path, header, residuals)?;
        // What is not of the store stays where it was.
        let moved = || -> io::Result<()> {
            for entry in fs::read_dir(path).into_iter().flatten() {
                let name = entry?.file_name();
                fs::rename(path.join(&name), part.join(&name))?;
            }
            let _ = fs::remove_dir(path);
            fs::rename(&part, path)
        };
        moved().map_err(|error| StoreError::write(path.to_owned(), error))?;
        Self::open(path)
    }

    /// Makes the store `path` unless one is there already, also when another process makes it at the same moment; and
    /// opens it to go on writing. Whether it is the one that `header` describes is for the caller to see.
    ///
    /// # Errors
    /// Something else that stands there, and what the file system refuses.
    pub fn create_or_open(path: &Path, header: &StoreHeader) -> Result<Self, StoreError> {
        if !path.join("zarr.json").exists() {
            let part = Self::prepare(path, header, Residuals::Kept)?;
            if let Err(error) = fs::rename(&part, path) {
                let _ = fs::remove_dir_all(&part);
                if !path.join("zarr.json").exists() {
                    return Err(StoreError::write(path.to_owned(), error));
                }
            }
        }
        Self::open(path)
    }

    /// Opens the store `path` to go on writing.
    ///
    /// # Errors
    /// As [`Store::open`].
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let group = path.join("zarr.json");
        let text = fs::read(&group).map_err(|error| StoreError::reading(group, &error))?;
        let attributes = Attributes::parse(&text, path)?;
        let mesh = Store::open(path)?.mesh().clone();
        let folder = Arc::new(Folder::new(path));
        let n_frames = attributes.frames.len();
        let variables = Form::open_variables(&folder, [n_frames, mesh.n_nodes(), mesh.n_elements()])?;
        let status = Form::status(n_frames).open(&folder)?;
        let room = status.shape().first().map_or(0, |&room| room as usize);
        Ok(Self { folder, series: Mutex::new(ByFrame { attributes, room }), mesh, status, variables })
    }

    /// Adds frames to the end of the series; `case` is the text of its `run.toml` with them. Only then they can be
    /// written: a frame that is done is one that the store names.
    ///
    /// The arrays grow in steps, and first: a reader never finds one that is shorter than the list of the frames.
    ///
    /// # Errors
    /// What the file system refuses; the series is then as it was.
    pub fn extend(&self, frames: impl IntoIterator<Item = String>, case: String) -> Result<(), StoreError> {
        let folder = Arc::new(Folder::durable(self.path()));
        let mut series = self.series();
        let mut attributes = series.attributes.clone();
        attributes.frames.extend(frames);
        attributes.run_toml = case;
        let n_frames = attributes.frames.len();
        if n_frames > series.room {
            let room = n_frames + ROOM_AHEAD.max(n_frames / 4);
            create_frames(&folder, room, &self.mesh, |_| false)?;
            series.room = room;
        }
        write_group(&folder, &attributes)?;
        series.attributes = attributes;
        Ok(())
    }

    /// Takes the names of the reference and of the frames that are there from `header`, with its case: the files have
    /// been moved.
    ///
    /// # Errors
    /// What the file system refuses; the store is then as it was.
    pub fn rename_files(&self, header: &StoreHeader) -> Result<(), StoreError> {
        let mut series = self.series();
        let mut attributes = series.attributes.clone();
        attributes.rename_files(header);
        write_group(&Folder::durable(self.path()), &attributes)?;
        series.attributes = attributes;
        Ok(())
    }

    fn series(&self) -> MutexGuard<'_, ByFrame> {
        self.series.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Checks that the series has a frame `number`.
    fn check_number(&self, number: usize) -> Result<(), StoreError> {
        let n_frames = self.series().attributes.frames.len();
        if number == 0 || number > n_frames { Err(StoreError::NoFrame { number, n_frames }) } else { Ok(()) }
    }

    /// A whole store beside `path`, on the disk, for renaming.
    fn prepare(path: &Path, header: &StoreHeader, residuals: Residuals) -> Result<PathBuf, StoreError> {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let mut part = path.as_os_str().to_owned();
        part.push(format!(".{}-{:x}{PART}", std::process::id(), since.as_nanos()));
        let part = PathBuf::from(part);
        Self::fill(&part, header, residuals).inspect_err(|_| {
            let _ = fs::remove_dir_all(&part); // what is left of it helps nobody
        })?;
        Ok(part)
    }

    /// Writes everything of a store but its frames into the folder `path`.
    fn fill(path: &Path, header: &StoreHeader, residuals: Residuals) -> Result<(), StoreError> {
        fs::create_dir_all(path).map_err(|error| StoreError::write(path.to_owned(), error))?;
        let folder = Arc::new(Folder::durable(path));
        let attributes = Attributes::of(header);
        write_group(&folder, &attributes)?;
        let mesh = header.mesh.clone();
        let (n_nodes, n_elements) = (mesh.n_nodes(), mesh.n_elements());
        write_constant(&folder, &Form::node_position(n_nodes), mesh.nodes().as_flattened())?;
        write_constant(&folder, &Form::element_nodes(n_elements), mesh.elements().as_flattened())?;
        write_constant(&folder, &Form::node_zone(n_nodes), mesh.node_zone())?;
        write_constant(&folder, &Form::element_zone(n_elements), mesh.element_zone())?;
        let is_wanted = |variable: Variable| match variable {
            Variable::Residual => residuals == Residuals::Kept,
            variable => header.strain_window.is_some() || !variable.is_of_window(),
        };
        create_frames(&folder, header.frames.len(), &mesh, is_wanted)
    }

    /// Writes frame `number` (from 1) with its strains; the status last. Of a frame that diverged or was not
    /// readable only the status is written: it has no field.
    ///
    /// # Errors
    /// A number that the series does not have, a field of another mesh, and what the file system refuses: the
    /// frame then counts as not done.
    pub fn write(&self, number: usize, measurement: &Measurement<Px>, strain: &StrainField) -> Result<(), StoreError> {
        if measurement.status.has_field() {
            self.write_field(number, measurement, strain)?;
        }
        self.mark(number, measurement.status)
    }

    /// Writes the field of frame `number` (from 1) with its strains, but not its status: until
    /// [`mark`](Self::mark) has written that, the frame counts as not done.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub fn write_field(
        &self,
        number: usize,
        measurement: &Measurement<Px>,
        strain: &StrainField,
    ) -> Result<(), StoreError> {
        self.write_encoded(self.encode_field(number, measurement, strain)?)
    }

    /// What [`write_field`](Self::write_field) computes, without a file: no error of the file system.
    pub fn encode_field(
        &self,
        number: usize,
        measurement: &Measurement<Px>,
        strain: &StrainField,
    ) -> Result<EncodedField, StoreError> {
        self.check_sizes(number, measurement, strain)?;
        let encoded = |(v, array): &(Variable, _)| self.encode_variable(number, *v, array, measurement, strain);
        Ok(EncodedField(self.variables.iter().map(encoded).collect::<Result<_, _>>()?))
    }

    /// What [`write_field`](Self::write_field) has to do with files.
    pub fn write_encoded(&self, EncodedField(files): EncodedField) -> Result<(), StoreError> {
        for (key, bytes) in files {
            let written = match bytes {
                Some(bytes) => self.folder.set(&key, bytes),
                None => self.folder.erase(&key),
            };
            written.map_err(|error| file_error(self.folder.file(&key), error.into()))?;
        }
        Ok(())
    }

    /// Writes the residual and the marks of frame `number` (from 1), which has no field: they show why, and are no
    /// measurement. See [`Store::without_field`].
    ///
    /// # Errors
    /// A number that the series does not have, residuals of another mesh, and what the file system refuses.
    pub fn write_residual(&self, number: usize, measurement: &Measurement<Px>) -> Result<(), StoreError> {
        self.check_number(number)?;
        self.check_elements(number, "residuals", measurement.element_residual.len())?;
        let nothing = StrainField {
            definition: StrainDefinition::Infinitesimal,
            elements: Vec::new(),
            nodes: Vec::new(),
            length_px: 0.0,
            window: None,
        };
        let mut files = Vec::new();
        for (variable, array) in &self.variables {
            if matches!(variable, Variable::Residual | Variable::Mark) {
                files.push(self.encode_variable(number, *variable, array, measurement, &nothing)?);
            }
        }
        self.write_encoded(EncodedField(files))
    }

    /// The folder of the store.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes the status of frame `number` (from 1) alone: of one that has no field.
    ///
    /// # Errors
    /// A number that the series does not have, and what the file system refuses.
    pub fn mark(&self, number: usize, status: Status) -> Result<(), StoreError> {
        self.check_number(number)?;
        write_chunk(&self.folder, &self.status, &[number as u64 - 1], &[status.code()][..])
    }

    /// Adds the normal matrices of the elements of the correlation, which give the covariance of every field.
    ///
    /// # Errors
    /// Another number than of elements, and what the file system refuses.
    pub fn write_normal_matrices(&self, matrices: &[ElementMatrix]) -> Result<(), StoreError> {
        self.check_elements(0, "elements", matrices.len())?;
        write_constant(&self.folder, &Form::normal_matrices(matrices.len()), matrices.as_flattened())
    }

    /// Adds what noise in the reference adds to the normal matrix of each element: `G n / k`.
    ///
    /// # Errors
    /// Another number than of elements, and what the file system refuses.
    pub fn write_gradient_noise(&self, of_elements: &[f64]) -> Result<(), StoreError> {
        self.check_elements(0, "elements", of_elements.len())?;
        write_constant(&self.folder, &Form::gradient_noise(of_elements.len()), of_elements)
    }

    /// Adds the penalty of a regularised correlation.
    ///
    /// # Errors
    /// What the file system refuses.
    pub fn write_penalty(&self, penalty: &BlockMatrix) -> Result<(), StoreError> {
        let pattern = penalty.pattern();
        let row = |node: usize| pattern.neighbours(node).iter().flat_map(move |&other| [node as u32, other]);
        let nodes: Vec<u32> = (0..pattern.n_nodes()).flat_map(row).collect();
        write_constant(&self.folder, &Form::penalty_nodes(pattern.n_blocks()), nodes.as_slice())?;
        write_constant(&self.folder, &Form::penalty(pattern.n_blocks()), penalty.blocks().as_flattened())
    }

    /// Notes the noise of one image in frame `number` (from 1), grey levels: the one used, and that of the residual.
    /// Nothing happens in a store that an earlier version made.
    ///
    /// # Errors
    /// A number that the series does not have, and what the file system refuses.
    pub fn write_noise(&self, number: usize, [used, residual]: [f64; 2]) -> Result<(), StoreError> {
        self.check_number(number)?;
        if !self.folder.has(NOISE) {
            return Ok(());
        }
        let array = Form::noise(self.series().room).open(&self.folder)?;
        write_chunk(&self.folder, &array, &[number as u64 - 1, 0], &[used as f32, residual as f32][..])
    }

    /// Notes the number of the frame that frame `number` (from 1) was measured from, 0 for the reference given: before
    /// its status, in runs whose reference is renewed.
    ///
    /// # Errors
    /// A number that the series does not have, and what the file system refuses.
    pub fn write_reference_frame(&self, number: usize, reference_frame: usize) -> Result<(), StoreError> {
        self.check_number(number)?;
        let form = Form::reference_frame(self.series().room);
        let is_there = self.folder.has(REFERENCE_FRAME);
        let array = if is_there { form.open(&self.folder)? } else { form.create(&self.folder)? };
        write_chunk(&self.folder, &array, &[number as u64 - 1], &[reference_frame as u32][..])
    }

    /// Takes back that frame `number` (from 1) is done: what it holds is replaced.
    ///
    /// # Errors
    /// What the file system refuses.
    pub fn unmark(&self, number: usize) -> Result<(), StoreError> {
        let file = self.folder.file(&self.status.chunk_key(&[number as u64 - 1]));
        match fs::remove_file(&file) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(StoreError::write(file, error)),
            _ => Ok(()),
        }
    }

    /// Adds the SHA-256 of the deformed images, once they are all known; `None` for one that could not be read. Gives
    /// back the room that the arrays have for frames to come.
    ///
    /// # Errors
    /// What the file system refuses; the store is then as it was.
    pub fn finish(&self, frames_sha256: Vec<Option<String>>) -> Result<(), StoreError> {
        let mut series = self.series();
        let n_frames = series.attributes.frames.len();
        if series.room > n_frames {
            create_frames(&Arc::new(Folder::durable(self.path())), n_frames, &self.mesh, |_| false)?;
            series.room = n_frames;
        }
        series.attributes.frames_sha256 = frames_sha256;
        write_group(&self.folder, &series.attributes)
    }

    fn has(&self, variable: Variable) -> bool {
        self.variables.iter().any(|(there, _)| *there == variable)
    }

    fn check_elements(&self, number: usize, what: &'static str, found: usize) -> Result<(), StoreError> {
        let wanted = self.mesh.n_elements();
        if found == wanted { Ok(()) } else { Err(StoreError::WrongSize { number, what, found, wanted }) }
    }

    fn check_sizes(
        &self,
        number: usize,
        measurement: &Measurement<Px>,
        strain: &StrainField,
    ) -> Result<(), StoreError> {
        self.check_number(number)?;
        let (nodes, elements) = (self.mesh.n_nodes(), self.mesh.n_elements());
        let (model, points) = (measurement.model_error.as_ref(), measurement.points.as_ref());
        let sizes = [
            ("model errors", model.map_or(nodes, |model| model.nodes.len()), nodes),
            ("misfits", model.map_or(elements, |model| model.misfit.len()), elements),
            ("marks of elements", measurement.marks.as_ref().map_or(elements, Vec::len), elements),
            ("values at points", points.map_or(nodes, |points| points.displacement.len()), nodes),
            ("standard uncertainties of points", points.map_or(nodes, |points| points.sigma.len()), nodes),
            ("marks of values at points", points.map_or(nodes, |points| points.is_value.len()), nodes),
            ("displacements", measurement.displacement.len(), nodes),
            ("standard uncertainties", measurement.sigma.len(), nodes),
            ("marks of measured nodes", measurement.measured.len(), nodes),
            ("nodal strains", strain.nodes.len(), nodes),
            ("element strains", strain.elements.len(), elements),
            ("window strains", strain.window.as_ref().map_or(nodes, |window| window.nodes.len()), nodes),
            ("residuals", measurement.element_residual.len(), if self.has(Variable::Residual) { elements } else { 0 }),
        ];
        match sizes.into_iter().find(|(_, found, wanted)| found != wanted) {
            Some((what, found, wanted)) => Err(StoreError::WrongSize { number, what, found, wanted }),
            None => Ok(()),
        }
    }

    fn encode_variable(
        &self,
        number: usize,
        variable: Variable,
        array: &Array<Folder>,
        measurement: &Measurement<Px>,
        strain: &StrainField,
    ) -> Result<(StoreKey, Option<Bytes>), StoreError> {
        let at = place_of(number, variable);
        let (n_nodes, n_elements) = (self.mesh.n_nodes(), self.mesh.n_elements());
        let (model, points) = (measurement.model_error.as_ref(), measurement.points.as_ref());
        // Where a node is measured and the pairs are known.
        let known = |pairs: Option<&Vec<[f64; 2]>>| -> Vec<[f64; 2]> {
            let Some(pairs) = pairs else { return vec![[f64::NAN; 2]; n_nodes] };
            let kept = pairs.iter().zip(&measurement.measured);
            kept.map(|(&pair, &measured)| if measured { pair } else { [f64::NAN; 2] }).collect()
        };
        let doubles = |pairs: Vec<[f64; 2]>| self.encode(array, &at, pairs.as_flattened());
        let singles = |values: Vec<f32>| self.encode(array, &at, values.as_slice());
        let codes = |codes: Vec<u8>| self.encode(array, &at, codes.as_slice());
        let flags = |flags: &Vec<bool>| flags.iter().copied().map(u8::from).collect();
        match variable {
            Variable::Displacement => doubles(known(Some(&measurement.displacement))),
            Variable::Sigma => singles(single(known(Some(&measurement.sigma)).as_flattened())),
            Variable::Measured => codes(flags(&measurement.measured)),
            Variable::StrainElement => singles(strain_values(&strain.elements)),
            Variable::StrainNode => singles(strain_values(&strain.nodes)),
            Variable::StrainWindow | Variable::SigmaStrainWindow => {
                let is_strain = variable == Variable::StrainWindow;
                let one = |at: &Option<(TensorStrain, [f64; 3])>| {
                    at.map(|(strain, sigma)| if is_strain { strain } else { TensorStrain::of_components(sigma) })
                };
                let found = strain.window.as_ref().map(|window| window.nodes.iter().map(one).collect());
                singles(strain_values(&found.unwrap_or_else(|| vec![None; n_nodes])))
            }
            Variable::ModelErrorStrainWindow => {
                let found = strain.window.as_ref().and_then(|window| window.model_errors());
                singles(strain_values(&found.unwrap_or_else(|| vec![None; n_nodes])))
            }
            Variable::Residual => singles(single(&measurement.element_residual)),
            Variable::ModelError => singles(single(known(model.map(|model| &model.nodes)).as_flattened())),
            Variable::Misfit => {
                singles(model.map_or_else(|| vec![f32::NAN; n_elements], |model| single(&model.misfit)))
            }
            Variable::Mark => {
                let marks = measurement.marks.as_ref().map(|marks| marks.iter().map(|mark| mark.code()).collect());
                codes(marks.unwrap_or_else(|| vec![UNKNOWN_MARK; n_elements]))
            }
            Variable::DisplacementPoint => doubles(known(points.map(|points| &points.displacement))),
            Variable::SigmaPoint => singles(single(known(points.map(|points| &points.sigma)).as_flattened())),
            Variable::IsPointValue => {
                codes(points.map_or_else(|| vec![NO_POINT; n_nodes], |points| flags(&points.is_value)))
            }
        }
    }

    /// The file of the chunk `at` that is made of `values`.
    fn encode<'a>(
        &self,
        array: &Array<Folder>,
        at: &[u64],
        values: impl IntoArrayBytes<'a>,
    ) -> Result<(StoreKey, Option<Bytes>), StoreError> {
        let (memory, key) = (Arc::new(MemoryStore::new()), array.chunk_key(at));
        let stored = array.with_storage(memory.clone()).store_chunk_opt(at, values, &codec_options());
        let bytes = stored.and_then(|()| Ok(memory.get(&key)?));
        bytes.map(|bytes| (key, bytes)).map_err(|error| write_error(&self.folder, array, at, error))
    }
}

/// Writes what all frames share as its one chunk.
fn write_constant<'a>(folder: &Arc<Folder>, form: &Form, values: impl IntoArrayBytes<'a>) -> Result<(), StoreError> {
    write_chunk(folder, &form.create(folder)?, &vec![0; form.shape.len()], values)
}

fn write_chunk<'a>(
    folder: &Folder,
    array: &Array<Folder>,
    at: &[u64],
    values: impl IntoArrayBytes<'a>,
) -> Result<(), StoreError> {
    array.store_chunk_opt(at, values, &codec_options()).map_err(|error| write_error(folder, array, at, error))
}

fn single(values: &[f64]) -> Vec<f32> {
    values.iter().map(|&value| value as f32).collect()
}

fn strain_values(strains: &[Option<TensorStrain>]) -> Vec<f32> {
    strains
        .iter()
        .flat_map(|strain| strain.map_or([f32::NAN; 3], |strain| strain.components().map(|e| e as f32)))
        .collect()
}

/// Describes the arrays by frame, for `n_frames` of them; the chunks that are there stay. The status last: its length
/// is that which all have. A new store gets those that are `wanted`.
fn create_frames(
    folder: &Arc<Folder>,
    n_frames: usize,
    mesh: &Mesh<Px>,
    wanted: impl Fn(Variable) -> bool,
) -> Result<(), StoreError> {
    // A store of an earlier version stays one.
    let is_new = !folder.has("status");
    for v in Variable::ALL.into_iter().filter(|&v| if is_new { wanted(v) } else { v.is_in(folder.path()) }) {
        Form::variable(v, n_frames, mesh.n_nodes(), mesh.n_elements()).create(folder)?;
    }
    Form::noise(n_frames).create(folder)?;
    if folder.has(REFERENCE_FRAME) {
        Form::reference_frame(n_frames).create(folder)?;
    }
    Form::status(n_frames).create(folder).map(drop)
}

fn write_group(folder: &Folder, attributes: &Attributes) -> Result<(), StoreError> {
    let file = folder.path().join("zarr.json");
    folder.replace(&file, &attributes.json()).map_err(|error| StoreError::write(file, error))
}

fn write_error(folder: &Folder, array: &Array<Folder>, at: &[u64], error: ArrayError) -> StoreError {
    file_error(folder.file(&array.chunk_key(at)), error)
}

fn file_error(file: PathBuf, error: ArrayError) -> StoreError {
    match error {
        ArrayError::StorageError(StorageError::IOError(error)) => StoreError::write(file, error),
        error => StoreError::unexpected(file, &error),
    }
}

/// Removes the store `path` with all its frames; nothing else that may stand in that folder. No store there is fine.
///
/// # Errors
/// A folder that is not empty and holds no store of quadrille, and what the file system refuses.
pub fn remove_store(path: &Path) -> Result<(), StoreError> {
    let failed = |path: PathBuf| move |error| StoreError::write(path, error);
    let group = path.join("zarr.json");
    match fs::read(&group) {
        // A store of any version may be replaced, also a damaged one; something else may not.
        Ok(text) => {
            if let Err(error @ StoreError::NotAStore { .. }) = Attributes::parse(&text, path) {
                return Err(error);
            }
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return match fs::read_dir(path).map(|mut entries| entries.next()) {
                Ok(None) => Ok(()),
                Ok(Some(_)) => {
                    let reason = "it has no zarr.json".to_owned();
                    Err(StoreError::NotAStore { path: path.to_owned(), reason })
                }
                Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
                Err(error) => Err(failed(path.to_owned())(error)),
            };
        }
        Err(error) => return Err(failed(path.to_owned())(error)),
    }
    // The status first: a store that is removed half-way shows no frame that is not whole.
    let constants = [
        "node_position_px",
        "element_nodes",
        "node_zone",
        "element_zone",
        NORMAL_MATRICES,
        GRADIENT_NOISE,
        PENALTY,
        PENALTY_NODES,
        NOISE,
        REFERENCE_FRAME,
    ];
    for name in ["status"].into_iter().chain(Variable::ALL.map(Variable::name)).chain(constants) {
        let array = path.join(name);
        match fs::remove_dir_all(&array) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(failed(array)(error)),
            _ => {}
        }
    }
    fs::remove_file(&group).map_err(failed(group.clone()))?;
    let _ = fs::remove_dir(path); // stays when something else is in it
    Ok(())
}
