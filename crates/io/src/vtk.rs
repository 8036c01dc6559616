//! Displacement fields as files for ParaView: `.vtu` for one frame, `.pvd` for a series.

use crate::csv::as_stored;
use crate::field::{ElementMark, Invariant, Measurement, Status, StrainField, TensorStrain, WindowStrains};
use crate::units::Px;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use std::io::{self, Write};
use thiserror::Error;

/// Type of a quadrilateral among VTK's cells.
const VTK_QUAD: u8 = 9;
/// Name of the array by which VTK hides points and cells, and its bits for both.
const GHOSTS: &str = "vtkGhostType";
const HIDDEN_POINT: u8 = 2;
const HIDDEN_CELL: u8 = 32;

/// Why a file for ParaView cannot be written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum VtkError {
    /// Residuals cannot be given in per cent of this range, grey levels.
    #[error("residuals in per cent need a dynamic range above zero, not {0} grey levels")]
    DynamicRange(f64),
    /// The file cannot be written.
    #[error("the VTK file cannot be written")]
    Write(#[from] io::Error),
}

/// Writes `measurement` as a VTK unstructured grid of quadrilaterals (XML, binary inline, little-endian).
///
/// Points are the nodes at `(x, y, 0)`, in px and with **y down** as in the image (in ParaView, turn the view about x
/// by 180 degrees to see it as the image). Point data: `displacement_px` and `sigma_px` (three components, z zero) and
/// `measured`, 1 or 0: a node that was not measured stays in the file with displacement zero and is hidden, as are its
/// elements, by `vtkGhostType` of points (2) and cells (32), so that warping closes no hole. Cell data:
/// `residual_grey`, the root mean square of `f - g` in grey levels; `residual_percent`, the same in per cent of
/// `dynamic_range` (grey levels); and `zone`, numbered from 0. Where they are known, `model_error_px` of the nodes
/// beside `sigma_px`, and `misfit_px` of the elements ([`crate::field::ModelError`]); `displacement_point_px`,
/// `sigma_point_px` and `is_point_value`, the displacement as a value at the point ([`crate::field::PointField`])
/// beside the coefficient `displacement_px`; and `mark` of both, what is the matter with an element
/// ([`ElementMark::code`]). With a `strain`, `strain_node` and `strain_element`: three components exx, eyy, exy without
/// dimension, NaN where they are not known, and of the nodes what follows from them ([`Invariant`]); with one over a
/// window of nodes `strain_window`, `sigma_strain_window` and, where it is known, `model_error_strain_window` of the
/// nodes. Field data: `converged`, 1 or 0, `status_code` ([`Status::code`]), and `dynamic_range_grey`. A comment at the
/// head holds `title`, status, units and zone names.
///
/// # Errors
/// A dynamic range that is not positive, and the errors of `out`.
pub fn write_vtu<W: Write>(
    out: W,
    title: &str,
    measurement: &Measurement<Px>,
    strain: Option<&StrainField>,
    dynamic_range: f64,
) -> Result<(), VtkError> {
    if !(dynamic_range > 0.0 && dynamic_range.is_finite()) {
        return Err(VtkError::DynamicRange(dynamic_range));
    }
    let mesh = &measurement.mesh;
    let measured = || measurement.measured.iter().copied();
    let spatial = |pairs: &[[f64; 2]]| -> Vec<[f64; 3]> {
        let kept = pairs.iter().zip(measured()).map(|(&v, measured)| if measured { v } else { [0.0; 2] });
        kept.map(|[x, y]| [x, y, 0.0]).collect()
    };
    let points: Vec<[f64; 3]> = mesh.nodes().iter().map(|&[x, y]| [x, y, 0.0]).collect();
    let displacement = spatial(&measurement.displacement);
    // Single precision as in the store: the file of a stored frame is that of the run, to the last bit.
    let single =
        |pairs: &[[f64; 2]]| -> Vec<[f32; 3]> { spatial(pairs).into_iter().map(|v| v.map(|v| v as f32)).collect() };
    let sigma = single(&measurement.sigma);
    let measured: Vec<u8> = measured().map(u8::from).collect();
    // Of every frame, or ParaView would lose the array along a series.
    let hidden: Vec<u8> = measured.iter().map(|&measured| if measured == 1 { 0 } else { HIDDEN_POINT }).collect();
    #[expect(clippy::indexing_slicing, reason = "written by the program: the nodes of its own mesh")]
    let is_whole = |nodes: &[u32; 4]| nodes.iter().all(|&node| measured[node as usize] == 1);
    let hidden_cells: Vec<u8> =
        mesh.elements().iter().map(|nodes| if is_whole(nodes) { 0 } else { HIDDEN_CELL }).collect();
    let residual: Vec<f32> = measurement.element_residual.iter().map(|&r| r as f32).collect();
    let residual_percent: Vec<f32> = residual.iter().map(|&r| (100.0 * f64::from(r) / dynamic_range) as f32).collect();
    let points_of = measurement.points.as_ref();
    let point = points_of.map(|points| spatial(&points.displacement));
    let point_sigma = points_of.map(|points| single(&points.sigma));
    let is_value: Option<Vec<u8>> = points_of.map(|points| points.is_value.iter().copied().map(u8::from).collect());
    let model = measurement.model_error.as_ref();
    let model_error = model.map(|model| single(&model.nodes));
    let misfit: Option<Vec<f32>> = model.map(|model| model.misfit.iter().map(|&v| v as f32).collect());
    let codes = |marks: Vec<ElementMark>| -> Vec<u8> { marks.into_iter().map(ElementMark::code).collect() };
    let (mark_nodes, mark) = (measurement.node_marks().map(codes), measurement.marks.clone().map(codes));
    let zone: Vec<i32> = mesh.element_zone().iter().map(|&zone| zone as i32).collect();
    // Signed, as VTK itself does: meshio turns unsigned node numbers into floats.
    let connectivity: Vec<i64> = mesh.elements().iter().flatten().map(|&node| i64::from(node)).collect();
    let offsets: Vec<i64> = (1..=mesh.n_elements() as i64).map(|element| 4 * element).collect();
    let types = vec![VTK_QUAD; mesh.n_elements()];
    let converged = [u8::from(measurement.status == Status::Converged)];

    write_file(out, &comment(title, measurement, strain, dynamic_range), |xml| {
        inside(xml, "FieldData", &[], |xml| {
            one_value(xml, "converged", &converged)?;
            one_value(xml, "status_code", &[measurement.status.code()])?;
            if residual.is_empty() { Ok(()) } else { one_value(xml, "dynamic_range_grey", &[dynamic_range]) }
        })?;
        let size = [("NumberOfPoints", mesh.n_nodes()), ("NumberOfCells", mesh.n_elements())];
        inside(xml, "Piece", &size, |xml| {
            inside(xml, "PointData", &[], |xml| {
                vectors(xml, "displacement_px", &displacement)?;
                vectors(xml, "sigma_px", &sigma)?;
                point.as_ref().map_or(Ok(()), |point| vectors(xml, "displacement_point_px", point))?;
                point_sigma.as_ref().map_or(Ok(()), |sigma| vectors(xml, "sigma_point_px", sigma))?;
                is_value.as_ref().map_or(Ok(()), |value| scalars(xml, "is_point_value", value))?;
                model_error.as_ref().map_or(Ok(()), |error| vectors(xml, "model_error_px", error))?;
                scalars(xml, "measured", &measured)?;
                mark_nodes.as_ref().map_or(Ok(()), |mark| scalars(xml, "mark", mark))?;
                scalars(xml, GHOSTS, &hidden)?;
                strain.map_or(Ok(()), |strain| strains(xml, "strain_node", &strain.nodes))?;
                strain.map_or(Ok(()), |strain| invariants(xml, &strain.nodes))?;
                strain.and_then(|strain| strain.window.as_ref()).map_or(Ok(()), |strains| window(xml, strains))
            })?;
            inside(xml, "CellData", &[], |xml| {
                // Fields of another program have none.
                if !residual.is_empty() {
                    scalars(xml, "residual_grey", &residual)?;
                    scalars(xml, "residual_percent", &residual_percent)?;
                }
                misfit.as_ref().map_or(Ok(()), |misfit| scalars(xml, "misfit_px", misfit))?;
                mark.as_ref().map_or(Ok(()), |mark| scalars(xml, "mark", mark))?;
                scalars(xml, "zone", &zone)?;
                scalars(xml, GHOSTS, &hidden_cells)?;
                strain.map_or(Ok(()), |strain| strains(xml, "strain_element", &strain.elements))
            })?;
            write_cells(xml, &points, &connectivity, &offsets, &types)
        })
    })
}

/// A file of an unstructured grid, with a `comment` at its head.
fn write_file<W: Write>(
    mut out: W,
    comment: &str,
    content: impl FnOnce(&mut Writer<&mut W>) -> io::Result<()>,
) -> Result<(), VtkError> {
    let mut xml = Writer::new_with_indent(&mut out, b' ', 1);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    xml.write_event(Event::Comment(BytesText::from_escaped(format!("\n{comment}\n"))))?;
    let file = xml.create_element("VTKFile").with_attributes([
        ("type", "UnstructuredGrid"),
        ("version", "1.0"), // the first with 64-bit headers; meshio knows no later one
        ("byte_order", "LittleEndian"),
        ("header_type", "UInt64"),
    ]);
    file.write_inner_content(|xml| inside(xml, "UnstructuredGrid", &[], content))?;
    writeln!(out)?;
    out.flush()?;
    Ok(())
}

/// Points and cells, which end a piece.
fn write_cells<W: Write>(
    xml: &mut Writer<W>,
    points: &[[f64; 3]],
    connectivity: &[i64],
    offsets: &[i64],
    types: &[u8],
) -> io::Result<()> {
    inside(xml, "Points", &[], |xml| vectors(xml, "Points", points))?;
    inside(xml, "Cells", &[], |xml| {
        scalars(xml, "connectivity", connectivity)?;
        scalars(xml, "offsets", offsets)?;
        scalars(xml, "types", types)
    })
}

/// The element `name`, with `content` in it.
fn inside<W: Write>(
    xml: &mut Writer<W>,
    name: &str,
    attributes: &[(&str, usize)],
    content: impl FnOnce(&mut Writer<W>) -> io::Result<()>,
) -> io::Result<()> {
    let mut element = xml.create_element(name);
    for &(key, value) in attributes {
        element = element.with_attribute((key, value.to_string().as_str()));
    }
    element.write_inner_content(content)?;
    Ok(())
}

/// A number that VTK knows.
trait Scalar: Copy {
    const VTK_TYPE: &'static str;
    fn put(self, bytes: &mut Vec<u8>);
}

macro_rules! scalar {
    ($($type:ty => $name:literal),*) => { $(
        impl Scalar for $type {
            const VTK_TYPE: &'static str = $name;
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        }
    )* };
}

scalar!(u8 => "UInt8", i32 => "Int32", i64 => "Int64", f32 => "Float32", f64 => "Float64");

fn scalars<W: Write, T: Scalar>(xml: &mut Writer<W>, name: &str, values: &[T]) -> io::Result<()> {
    data_array(xml, name, &[], values)
}

fn vectors<W: Write, T: Scalar>(xml: &mut Writer<W>, name: &str, values: &[[T; 3]]) -> io::Result<()> {
    data_array(xml, name, &[("NumberOfComponents", "3")], values.as_flattened())
}

fn window<W: Write>(xml: &mut Writer<W>, found: &WindowStrains) -> io::Result<()> {
    let strain: Vec<_> = found.nodes.iter().map(|at| at.map(|(strain, _)| strain)).collect();
    let sigma: Vec<_> = found.nodes.iter().map(|at| at.map(|(_, sigma)| TensorStrain::of_components(sigma))).collect();
    strains(xml, "strain_window", &strain)?;
    strains(xml, "sigma_strain_window", &sigma)?;
    found.model_errors().map_or(Ok(()), |errors| strains(xml, "model_error_strain_window", &errors))
}

fn strains<W: Write>(xml: &mut Writer<W>, name: &str, values: &[Option<TensorStrain>]) -> io::Result<()> {
    let values: Vec<[f32; 3]> = values
        .iter()
        .map(|strain| strain.map_or([f32::NAN; 3], |strain| strain.components().map(|e| e as f32)))
        .collect();
    let names = ["exx", "eyy", "exy"];
    let attributes = [
        ("NumberOfComponents", "3"),
        ("ComponentName0", names[0]),
        ("ComponentName1", names[1]),
        ("ComponentName2", names[2]),
    ];
    data_array(xml, name, &attributes, values.as_flattened())
}

/// Writes principal strains and what else follows from `values`, an array each.
fn invariants<W: Write>(xml: &mut Writer<W>, values: &[Option<TensorStrain>]) -> io::Result<()> {
    Invariant::ALL.into_iter().try_for_each(|which| {
        let of =
            |strain: &Option<TensorStrain>| strain.map_or(f32::NAN, |strain| as_stored(strain).invariant(which) as f32);
        scalars(xml, which.name(), &values.iter().map(of).collect::<Vec<_>>())
    })
}

fn one_value<W: Write, T: Scalar>(xml: &mut Writer<W>, name: &str, value: &[T; 1]) -> io::Result<()> {
    data_array(xml, name, &[("NumberOfTuples", "1")], value)
}

/// An array in base64: its length in bytes as 64 bits, then its numbers, encoded as one.
fn data_array<W: Write, T: Scalar>(
    xml: &mut Writer<W>,
    name: &str,
    attributes: &[(&str, &str)],
    values: &[T],
) -> io::Result<()> {
    let n_bytes = size_of_val(values);
    let mut bytes = Vec::with_capacity(8 + n_bytes);
    bytes.extend_from_slice(&(n_bytes as u64).to_le_bytes());
    values.iter().for_each(|value| value.put(&mut bytes));
    let element = xml.create_element("DataArray").with_attributes([("type", T::VTK_TYPE), ("Name", name)]);
    let element = element.with_attributes(attributes.iter().copied()).with_attribute(("format", "binary"));
    element.write_text_content(BytesText::from_escaped(BASE64.encode(bytes)))?;
    Ok(())
}

/// The text of the head comment; without `--`, which XML forbids there, and without control characters.
fn comment(title: &str, measurement: &Measurement<Px>, strain: Option<&StrainField>, dynamic_range: f64) -> String {
    let zones = measurement.mesh.zones().iter().enumerate();
    let zones: Vec<String> = zones.map(|(number, name)| format!("{number} = {name}")).collect();
    let mut lines = vec![
        title.to_owned(),
        format!("status: {}", measurement.status.name()),
        "lengths in px of the reference image: x to the right, y down, z = 0".to_owned(),
        "measured: 1, or 0 for a node without measurement (its displacement and sigma are 0 and mean nothing)"
            .to_owned(),
        "displacement_px: coefficients of the fitted field; displacement_point_px: values at the points (is_point_value 0: \
         the coefficient as it stands)"
            .to_owned(),
        "vtkGhostType: hides nodes without measurement (2) and their elements (32)".to_owned(),
        format!(
            "residual_grey: root mean square of f - g in grey levels; residual_percent: of {dynamic_range} grey levels"
        ),
        format!("zones: {}", zones.join(", ")),
    ];
    lines.extend(strain.iter().flat_map(|strain| strain.definition.describe(strain.length_px)));
    let window = strain.and_then(|strain| Some((strain.window.as_ref()?, strain.length_px)));
    lines.extend(window.iter().flat_map(|(strains, length_px)| strains.window.describe(*length_px)));
    let mut text = String::new();
    for character in lines.join("\n").chars() {
        if character == '-' && text.ends_with('-') {
            text.push(' ');
        }
        text.push(if is_xml(character) { character } else { ' ' });
    }
    text
}

fn is_xml(character: char) -> bool {
    character == '\n' || !(character.is_control() || matches!(character, '\u{fffe}' | '\u{ffff}'))
}

/// Writes the list of a series for ParaView (`series.pvd`): each entry is a time and the path of its
/// `.vtu` file, relative to the list, with `/` between folders.
///
/// ```
/// # use quadrille_io as quadrille;
/// let mut list = Vec::new();
/// quadrille::io::vtk::write_pvd(&mut list, &[(0.5, "vtu/frame_0001.vtu".into())]).unwrap();
/// let line = r#"<DataSet timestep="0.5" part="0" file="vtu/frame_0001.vtu"/>"#;
/// assert!(String::from_utf8(list).unwrap().contains(line));
/// ```
pub fn write_pvd<W: Write>(mut out: W, entries: &[(f64, String)]) -> Result<(), VtkError> {
    let mut xml = Writer::new_with_indent(&mut out, b' ', 1);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    let file = xml.create_element("VTKFile");
    let file = file.with_attributes([("type", "Collection"), ("version", "0.1"), ("byte_order", "LittleEndian")]);
    file.write_inner_content(|xml| {
        inside(xml, "Collection", &[], |xml| {
            for (time, file) in entries {
                let time = format!("{time:?}");
                let attributes = [("timestep", time.as_str()), ("part", "0"), ("file", file)];
                xml.create_element("DataSet").with_attributes(attributes).write_empty()?;
            }
            Ok(())
        })
    })?;
    writeln!(out)?;
    out.flush()?;
    Ok(())
}

/// Values for a file of [`write_grid`]: a name and one number, or one vector, for each point or cell.
#[derive(Debug, Clone, PartialEq)]
pub enum GridValues {
    /// One number each.
    Scalars(String, Vec<f64>),
    /// Three numbers each.
    Vectors(String, Vec<[f64; 3]>),
}

impl GridValues {
    fn write<W: Write>(&self, xml: &mut Writer<W>) -> io::Result<()> {
        match self {
            Self::Scalars(name, values) => scalars(xml, name, values),
            Self::Vectors(name, values) => vectors(xml, name, values),
        }
    }
}

/// Writes an unstructured grid of `points` (z = 0) and `cells` of two (lines), three (triangles) or four points
/// (quadrilaterals), with values at points and cells.
///
/// # Errors
/// Those of `out`.
///
/// # Panics
/// When a cell has another number of points.
pub fn write_grid<W: Write>(
    out: W,
    title: &str,
    points: &[[f64; 2]],
    cells: &[Vec<u32>],
    at_points: &[GridValues],
    at_cells: &[GridValues],
) -> Result<(), VtkError> {
    let points: Vec<[f64; 3]> = points.iter().map(|&[x, y]| [x, y, 0.0]).collect();
    let connectivity: Vec<i64> = cells.iter().flatten().map(|&node| i64::from(node)).collect();
    let offsets: Vec<i64> = cells
        .iter()
        .scan(0, |end, cell| {
            *end += cell.len() as i64;
            Some(*end)
        })
        .collect();
    let kind = |cell: &Vec<u32>| match cell.len() {
        2 => 3,
        3 => 5,
        4 => VTK_QUAD,
        #[expect(clippy::panic, reason = "cells are made by this module's callers, not read")]
        n => panic!("a cell of {n} points"),
    };
    let types: Vec<u8> = cells.iter().map(kind).collect();
    let title: String = title.replace("--", "- -").chars().filter(|&c| is_xml(c)).collect();
    write_file(out, &title, |xml| {
        let size = [("NumberOfPoints", points.len()), ("NumberOfCells", cells.len())];
        inside(xml, "Piece", &size, |xml| {
            inside(xml, "PointData", &[], |xml| at_points.iter().try_for_each(|values| values.write(xml)))?;
            inside(xml, "CellData", &[], |xml| at_cells.iter().try_for_each(|values| values.write(xml)))?;
            write_cells(xml, &points, &connectivity, &offsets, &types)
        })
    })
}
