//! What stands where in a store: the table that writer and reader share.

use super::StoreError;
use super::folder::{Folder, has_array};
use crate::arrays::Number;
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use zarrs::array::codec::{Crc32cCodec, ZstdCodec};
use zarrs::array::{Array, ArrayBuilder, ArrayMetadataOptions, ArrayShape, CodecOptions, DataType, data_type};
use zarrs::metadata::ChunkKeySeparator;

/// Version of the layout; raised when a reader of the old one would go wrong.
pub(super) const VERSION: u64 = 1;
pub(super) const NORMAL_MATRICES: &str = "normal_matrix";
pub(super) const REFERENCE_FRAME: &str = "reference_frame";
pub(super) const PENALTY: &str = "penalty";
pub(super) const PENALTY_NODES: &str = "penalty_nodes";
pub(super) const GRADIENT_NOISE: &str = "gradient_noise";
pub(super) const NOISE: &str = "noise_grey";
/// Status of a frame that is not done: the fill value of the array.
pub(super) const NOT_DONE: u8 = 255;
/// The fastest: most of a field is noise in the last digits, which no level makes smaller.
const ZSTD_LEVEL: i32 = 1;

/// An array of a store that holds one chunk for each frame.
///
/// ```
/// # use quadrille_io as quadrille;
/// use quadrille::io::store::Variable;
/// let [first, ..] = Variable::ALL;
/// assert_eq!((first.name(), first.unit(), first.components()), ("displacement_px", "px", &["x", "y"][..]));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variable {
    /// Displacement of the nodes.
    Displacement,
    /// Its standard uncertainty.
    Sigma,
    /// Whether the node was measured.
    Measured,
    /// Strain at the centres of the elements.
    StrainElement,
    /// Strain at the nodes.
    StrainNode,
    /// Strain at the nodes over a window of nodes; of runs that asked for it.
    StrainWindow,
    /// Its standard uncertainty.
    SigmaStrainWindow,
    /// What it may be off beyond noise; not in stores of earlier versions.
    ModelErrorStrainWindow,
    /// Residual of the elements; not of fields that another program measured.
    Residual,
    /// What the displacement of the nodes may be off beyond noise; not in stores of earlier versions.
    ModelError,
    /// Displacement that the elements do not follow; not in stores of earlier versions.
    Misfit,
    /// What is the matter with each element; not in stores of earlier versions.
    Mark,
    /// Displacement of the nodes as values at points; not in stores of earlier versions.
    DisplacementPoint,
    /// Its standard uncertainty; not in stores of earlier versions.
    SigmaPoint,
    /// Whether it is a value, and not the coefficient as it stands; not in stores of earlier versions.
    IsPointValue,
}

/// The mark of an element of which nobody knows.
pub(super) const UNKNOWN_MARK: u8 = 255;
/// What stands for a node of which nobody made a value at a point.
pub(super) const NO_POINT: u8 = 255;

/// Where the values of a [`Variable`] live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// On the nodes of the mesh.
    Nodes,
    /// On its elements.
    Elements,
}

impl Place {
    /// Name of the axis: `node` or `element`.
    pub fn axis(self) -> &'static str {
        match self {
            Place::Nodes => "node",
            Place::Elements => "element",
        }
    }
}

/// Name, unit, place, components and kind of the numbers of a [`Variable`].
type Row = (&'static str, &'static str, Place, &'static [&'static str], Number);

impl Variable {
    /// All, in the order in which they are written.
    pub const ALL: [Variable; 15] = [
        Variable::Displacement,
        Variable::Sigma,
        Variable::Measured,
        Variable::StrainElement,
        Variable::StrainNode,
        Variable::StrainWindow,
        Variable::SigmaStrainWindow,
        Variable::ModelErrorStrainWindow,
        Variable::Residual,
        Variable::ModelError,
        Variable::Misfit,
        Variable::Mark,
        Variable::DisplacementPoint,
        Variable::SigmaPoint,
        Variable::IsPointValue,
    ];

    fn row(self) -> Row {
        use Number::{F32, F64, U8};
        use Place::{Elements, Nodes};
        const ONE: &[&str] = &[];
        const PAIR: &[&str] = &["x", "y"];
        const STRAIN: &[&str] = &["exx", "eyy", "exy"];
        match self {
            Variable::Displacement => ("displacement_px", "px", Nodes, PAIR, F64),
            Variable::Sigma => ("sigma_px", "px", Nodes, PAIR, F32),
            Variable::Measured => ("measured", "1", Nodes, ONE, U8),
            Variable::StrainElement => ("strain_element", "1", Elements, STRAIN, F32),
            Variable::StrainNode => ("strain_node", "1", Nodes, STRAIN, F32),
            Variable::StrainWindow => ("strain_window", "1", Nodes, STRAIN, F32),
            Variable::SigmaStrainWindow => ("sigma_strain_window", "1", Nodes, STRAIN, F32),
            Variable::ModelErrorStrainWindow => ("model_error_strain_window", "1", Nodes, STRAIN, F32),
            Variable::Residual => ("residual_grey", "grey levels", Elements, ONE, F32),
            Variable::ModelError => ("model_error_px", "px", Nodes, PAIR, F32),
            Variable::Misfit => ("misfit_px", "px", Elements, ONE, F32),
            Variable::Mark => ("mark", "1", Elements, ONE, U8),
            Variable::DisplacementPoint => ("displacement_point_px", "px", Nodes, PAIR, F64),
            Variable::SigmaPoint => ("sigma_point_px", "px", Nodes, PAIR, F32),
            Variable::IsPointValue => ("is_point_value", "1", Nodes, ONE, U8),
        }
    }

    /// Name of the array in the store and in exported files.
    pub fn name(self) -> &'static str {
        self.row().0
    }

    /// Unit of the values; `1` for numbers without dimension.
    pub fn unit(self) -> &'static str {
        self.row().1
    }

    /// Nodes or elements.
    pub fn place(self) -> Place {
        self.row().2
    }

    /// Names along the last axis; none when there is one value per node or element.
    pub fn components(self) -> &'static [&'static str] {
        self.row().3
    }

    /// Kind of the numbers.
    pub fn number(self) -> Number {
        self.row().4
    }

    /// What the values mean.
    pub fn meaning(self) -> &'static str {
        match self {
            Variable::Displacement => {
                "displacement from the reference to the deformed image, at the positions of the reference: the coefficients of \
                 the bilinear field that was fitted, from which identification starts, and not its values at points, which \
                 displacement_point_px has; NaN where not measured"
            }
            Variable::Sigma => "standard uncertainty of each component of displacement_px; NaN where not measured",
            Variable::DisplacementPoint => {
                "displacement at the node as a value at a point: a sum over the coefficients displacement_px nearby; NaN \
                 where not measured"
            }
            Variable::SigmaPoint => {
                "standard uncertainty of each component of displacement_point_px; NaN where not measured"
            }
            Variable::IsPointValue => {
                "1 where displacement_point_px is a value at a point, 0 where it is the coefficient as it stands (too few measured \
                 nodes near, a regularised run, or not measured); 255 not known"
            }
            Variable::Measured => "1 for a node that was measured in this frame, 0 for one that was not",
            Variable::StrainElement => {
                "strain at the centre of the element, exy the tensor shear; NaN where a node is not measured"
            }
            Variable::StrainNode => "strain at the node, exy the tensor shear; NaN where it is not known",
            Variable::StrainWindow => {
                "strain at the node over a window of nodes (plane fitted by least squares), exy the tensor shear; NaN where too \
                 few of the window are measured"
            }
            Variable::SigmaStrainWindow => {
                "standard uncertainty of each component of strain_window; an upper bound where the run was regularised or of splines"
            }
            Variable::ModelErrorStrainWindow => {
                "estimate of what each component of strain_window may be off at the node beyond noise (the window flattens), \
                 beside sigma_strain_window; NaN where strain_window is"
            }
            Variable::Residual => "root mean square of the residual f - (1 + c) g - d over the element",
            Variable::ModelError => {
                "estimate of what each component of displacement_px may be off beyond noise (mesh too coarse, misfit, \
                 regularisation), beside sigma_px; NaN where not measured"
            }
            Variable::Misfit => "displacement that the element does not follow, root mean square; 0 where none shows",
            Variable::Mark => {
                "what is the matter with the element: 0 nothing, 1 misfit (displacement not followed), 2 still while the specimen \
                 moves; left out of the frame: 3 no texture, 4 left the image, 5 saturated, 6 covered, torn or no match; 255 \
                 not known"
            }
        }
    }

    /// Name of the axis along its components.
    pub fn axis_of_components(self) -> &'static str {
        match self.n_components() {
            2 => "component",
            3 => "strain_component",
            _ => "parameter",
        }
    }

    /// Values per node or element.
    pub fn n_components(self) -> usize {
        self.components().len().max(1)
    }

    /// Whether every store has it: those of earlier versions and of other programs do not have all.
    pub fn is_in_every_store(self) -> bool {
        let is_later = matches!(self, Variable::Residual | Variable::ModelError | Variable::Misfit | Variable::Mark);
        !is_later && !self.is_of_points() && !self.is_of_window()
    }

    /// Whether it is of strains over a window of nodes, which not every run asks for.
    pub fn is_of_window(self) -> bool {
        matches!(self, Variable::StrainWindow | Variable::SigmaStrainWindow | Variable::ModelErrorStrainWindow)
    }

    /// Whether it is of values at points.
    pub fn is_of_points(self) -> bool {
        matches!(self, Variable::DisplacementPoint | Variable::SigmaPoint | Variable::IsPointValue)
    }

    /// Whether it stands in the store in `folder`.
    pub(super) fn is_in(self, folder: &Path) -> bool {
        self.is_in_every_store() || has_array(folder, self.name())
    }
}

/// Everything that the metadata of one array says.
pub(super) struct Form {
    pub name: &'static str,
    pub number: Number,
    pub shape: ArrayShape,
    pub chunk: ArrayShape,
    axes: Vec<&'static str>,
    components: &'static [&'static str],
    unit: &'static str,
    meaning: &'static str,
    /// Value of what is not written.
    fill: Option<u8>,
}

impl Form {
    /// An array that does not change from frame to frame, in one chunk.
    fn constant(name: &'static str, number: Number, axes: &[(&'static str, usize)], about: [&'static str; 2]) -> Self {
        let shape: ArrayShape = axes.iter().map(|&(_, n)| n as u64).collect();
        let chunk = shape.iter().map(|&n| n.max(1)).collect();
        let axes = axes.iter().map(|&(axis, _)| axis).collect();
        Self { name, number, chunk, shape, axes, components: &[], unit: about[0], meaning: about[1], fill: Some(0) }
    }

    pub fn node_position(n_nodes: usize) -> Self {
        let about = ["px", "position of the nodes in the reference image: x to the right, y down"];
        Self {
            components: &["x", "y"],
            ..Self::constant("node_position_px", Number::F64, &[("node", n_nodes), ("component", 2)], about)
        }
    }

    pub fn element_nodes(n_elements: usize) -> Self {
        let about = [
            "1",
            "numbers of the four nodes of the element, from 0, in the order (0,0), (1,0), (1,1), (0,1) of its local \
             coordinates; the last two are equal in a triangle",
        ];
        Self::constant("element_nodes", Number::U32, &[("element", n_elements), ("corner", 4)], about)
    }

    pub fn node_zone(n_nodes: usize) -> Self {
        let about = ["1", "number of the zone of the node, from 0; names in the attribute zones of the group"];
        Self::constant("node_zone", Number::U32, &[("node", n_nodes)], about)
    }

    pub fn element_zone(n_elements: usize) -> Self {
        let about = ["1", "number of the zone of the element, from 0; names in the attribute zones of the group"];
        Self::constant("element_zone", Number::U32, &[("element", n_elements)], about)
    }

    /// Not in every store.
    pub fn normal_matrices(n_elements: usize) -> Self {
        let about = [
            "grey levels^2/px^2",
            "normal matrix M of the correlation, element by element: upper triangle by rows of the 8 by 8 matrix, unknown \
             2 k + c is component c of corner k. The displacements have the covariance 2 sigma^2 M^-1; of a regularised run \
             see penalty. Not there with splines, or where brightness was solved for each element. It holds the noise of \
             the gradient: M0 = M - sigma^2 gradient_noise mean(psi_i psi_j), and Cov = sigma^2 [(1/k + gain^2) M0^-1 + gain^2 v M0^-1 (M - M0) \
             M0^-1] for the mean of k references",
        ];
        Self::constant(NORMAL_MATRICES, Number::F64, &[("element", n_elements), ("entry", 36)], about)
    }

    /// Only of a regularised run.
    pub fn penalty(n_blocks: usize) -> Self {
        let about = [
            "grey levels^2/px^2",
            "w R of the regularisation, block by block: xx, xy, yx, yy of the nodes in penalty_nodes. The field has come to \
             rest where the right-hand side of the images is w R u: what they alone say is u + M0^-1 w R u, with the \
             covariance that normal_matrix tells",
        ];
        Self::constant(PENALTY, Number::F64, &[("block", n_blocks), ("entry", 4)], about)
    }

    /// Only of a regularised run.
    pub fn penalty_nodes(n_blocks: usize) -> Self {
        let about = ["1", "row and column of each block of penalty: numbers of nodes, from 0"];
        Self::constant(PENALTY_NODES, Number::U32, &[("block", n_blocks), ("place", 2)], about)
    }

    /// Not in the stores of earlier versions.
    pub fn gradient_noise(n_elements: usize) -> Self {
        let about = [
            "1",
            "what noise in the reference adds to normal_matrix: G n / k with the noise gain G of the gradient, the n pixels \
             of the element, and the k images whose mean the reference is; times the mean of psi_i psi_j over the element \
             and the noise of one image squared",
        ];
        Self::constant(GRADIENT_NOISE, Number::F64, &[("element", n_elements)], about)
    }

    /// Not in the stores of earlier versions.
    pub fn noise(n_frames: usize) -> Self {
        Self {
            number: Number::F32,
            shape: vec![n_frames as u64, 2],
            chunk: vec![1, 2],
            axes: vec!["frame", "noise"],
            components: &["used", "residual"],
            unit: "grey levels",
            fill: None,
            ..Self::per_frame(
                NOISE,
                Number::F32,
                n_frames,
                "noise of one image, root mean square over the zones: that sigma_px is made with, and what the residual of \
                 the frame says of it; the same unless a noise was given",
            )
        }
    }

    pub fn status(n_frames: usize) -> Self {
        let meaning = "how the frame ended, written after everything else of it: codes in the attribute status_codes \
                       of the group; 255 while it is not done";
        Self { fill: Some(NOT_DONE), ..Self::per_frame("status", Number::U8, n_frames, meaning) }
    }

    /// Not in every store.
    pub fn reference_frame(n_frames: usize) -> Self {
        let meaning = "number (from 1) of the frame whose image the frame was correlated with; 0 for the reference given. \
                       Displacements lead from the reference given in any case, as the sum of the stages, and sigma_px is \
                       that of the whole way; residual_grey is against the image of that frame, and normal_matrix is that \
                       of the reference given";
        Self::per_frame(REFERENCE_FRAME, Number::U32, n_frames, meaning)
    }

    /// One number for each frame.
    fn per_frame(name: &'static str, number: Number, n_frames: usize, meaning: &'static str) -> Self {
        Self {
            name,
            number,
            shape: vec![n_frames as u64],
            chunk: vec![1],
            axes: vec!["frame"],
            components: &[],
            unit: "1",
            meaning,
            fill: Some(0),
        }
    }

    pub fn variable(variable: Variable, n_frames: usize, n_nodes: usize, n_elements: usize) -> Self {
        let n = match variable.place() {
            Place::Nodes => n_nodes,
            Place::Elements => n_elements,
        };
        let (mut shape, mut chunk) = (vec![n_frames as u64, n as u64], vec![1, n.max(1) as u64]);
        let mut axes = vec!["frame", variable.place().axis()];
        if !variable.components().is_empty() {
            // One name for one length: readers with named axes (xarray) ask for that.
            axes.push(variable.axis_of_components());
            [&mut shape, &mut chunk].into_iter().for_each(|list| list.push(variable.n_components() as u64));
        }
        Self {
            name: variable.name(),
            number: variable.number(),
            shape,
            chunk,
            axes,
            components: variable.components(),
            unit: variable.unit(),
            meaning: variable.meaning(),
            fill: (variable == Variable::Measured).then_some(0),
        }
    }

    /// The arrays of the variables that the store has, in the order of [`Variable::ALL`].
    pub fn open_variables(
        folder: &Arc<Folder>,
        [n_frames, n_nodes, n_elements]: [usize; 3],
    ) -> Result<Vec<(Variable, Array<Folder>)>, StoreError> {
        let open = |v| Ok((v, Self::variable(v, n_frames, n_nodes, n_elements).open(folder)?));
        Variable::ALL.into_iter().filter(|v| v.is_in(folder.path())).map(open).collect()
    }

    fn data_type(&self) -> DataType {
        match self.number {
            Number::F64 => data_type::float64(),
            Number::F32 => data_type::float32(),
            Number::U32 => data_type::uint32(),
            Number::U8 => data_type::uint8(),
        }
    }

    /// The array with its metadata written.
    pub fn create(&self, folder: &Arc<Folder>) -> Result<Array<Folder>, StoreError> {
        let mut builder = match (self.number, self.fill) {
            (Number::F64, None) => self.builder(f64::NAN),
            (Number::F32, None) => self.builder(f32::NAN),
            (Number::F64, Some(fill)) => self.builder(f64::from(fill)),
            (Number::F32, Some(fill)) => self.builder(f32::from(fill)),
            (Number::U32, fill) => self.builder(u32::from(fill.unwrap_or(0))),
            (Number::U8, fill) => self.builder(fill.unwrap_or(0)),
        };
        let mut attributes = serde_json::Map::new();
        attributes.insert("unit".into(), json!(self.unit));
        attributes.insert("description".into(), json!(self.meaning));
        if !self.components.is_empty() {
            attributes.insert("components".into(), json!(self.components));
        }
        builder
            .bytes_to_bytes_codecs(vec![Arc::new(ZstdCodec::new(ZSTD_LEVEL, false)), Arc::new(Crc32cCodec::new())])
            // One file a chunk and no folder: `c.17.0.0`, not `c/17/0/0`.
            .chunk_key_encoding_default_separator(ChunkKeySeparator::Dot)
            .dimension_names(Some(self.axes.iter().copied()))
            .attributes(attributes);
        let array = builder
            .build(folder.clone(), &format!("/{}", self.name))
            .map_err(|error| StoreError::unexpected(folder.path().join(self.name), &error))?
            .with_metadata_options(ArrayMetadataOptions::default().with_include_zarrs_metadata(false));
        array.store_metadata().map_err(|error| StoreError::write(folder.path().join(self.name), error))?;
        Ok(array)
    }

    fn builder(&self, fill: impl Into<zarrs::array::builder::ArrayBuilderFillValue>) -> ArrayBuilder {
        ArrayBuilder::new(self.shape.clone(), self.chunk.clone(), self.data_type(), fill)
    }

    /// The array in `folder`, when it is what the layout says; by frame it may be longer, as a growing series has room.
    pub fn open(&self, folder: &Arc<Folder>) -> Result<Array<Folder>, StoreError> {
        let file = folder.path().join(self.name).join("zarr.json");
        let damaged = |reason: String| StoreError::Metadata { file: file.clone(), reason };
        let array = Array::open(folder.clone(), &format!("/{}", self.name))
            .map_err(|error| damaged(format!("it describes no array ({error})")))?;
        let by_frame = self.axes.first() == Some(&"frame");
        let fits = |(axis, (&there, &wanted)): (usize, (&u64, &u64))| {
            there == wanted || by_frame && axis == 0 && there > wanted
        };
        if array.shape().len() != self.shape.len() || !array.shape().iter().zip(&self.shape).enumerate().all(fits) {
            return Err(damaged(format!("the array has the shape {:?}, not {:?}", array.shape(), self.shape)));
        }
        let origin = vec![0; self.shape.len()];
        let chunk: Option<ArrayShape> =
            array.chunk_shape(&origin).ok().map(|chunk| chunk.iter().map(|n| n.get()).collect());
        if self.shape.iter().all(|&n| n > 0) && chunk.as_deref() != Some(&self.chunk) {
            return Err(damaged(format!("the chunks have the shape {chunk:?}, not {:?}", self.chunk)));
        }
        if *array.data_type() != self.data_type() {
            return Err(damaged(format!("the numbers are {:?}, not {:?}", array.data_type(), self.data_type())));
        }
        Ok(array)
    }
}

/// Chunks of fill values are written as well: what is missing is damaged. One thread is enough for one chunk.
pub(super) fn codec_options() -> CodecOptions {
    CodecOptions::default().with_store_empty_chunks(true).with_concurrent_target(1)
}
