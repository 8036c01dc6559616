//! The displacements of a finite-element model: a mesh with a value at its nodes.

use super::{MeshFileError, MeshFileFault, Parsed, gmsh, inp, vtu};
use crate::foreign::{LengthUnit, NodeTable, read_node_table};
use crate::text::read_file;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Nodes and elements of a plane model with the displacement of each node, mm, y up.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModelField {
    /// Positions.
    pub nodes: Vec<[f64; 2]>,
    /// Corners of each element, numbers in `nodes`; of a triangle the last one twice. Of elements of second order the
    /// corners alone.
    pub elements: Vec<[u32; 4]>,
    /// Displacements.
    pub displacement: Vec<[f64; 2]>,
}

/// Why there is no field of a model.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The table cannot be read.
    #[error(transparent)]
    Table(#[from] crate::foreign::FieldError),
    /// The mesh has no displacements, and no table is given.
    #[error("{}: has no displacement of its nodes{}; give --displacements with a table of node, ux, uy", .0.display(), arrays(.1))]
    NoDisplacement(PathBuf, Vec<String>),
    /// A node of an element has no displacement.
    #[error("{}: node {node} has no displacement in it; write those of all nodes", table.display())]
    NodeMissing {
        /// The table.
        table: PathBuf,
        /// Number of the node.
        node: u64,
    },
}

fn arrays(names: &[String]) -> String {
    if names.is_empty() { String::new() } else { format!(" (vectors at points: {})", names.join(", ")) }
}

/// Whether the content of a file is a mesh that [`read_model`] reads, rather than a table.
pub fn is_model(bytes: &[u8]) -> bool {
    gmsh::is_msh(bytes) || vtu::is_vtk_xml(bytes) || inp::is_inp(bytes)
}

/// Reads the model `path`: `.vtu` with a vector of points that is called displacement (or the only one), or a mesh
/// (`.vtu`, Gmsh `.msh`, Abaqus `.inp`) with a `table` of node, ux, uy. Positions and displacements are in `unit`.
///
/// # Errors
/// A file that cannot be read, and nodes of elements without displacement.
pub fn read_model(path: &Path, table: Option<&Path>, unit: LengthUnit) -> Result<ModelField, ModelFileError> {
    let bytes = read_file(path, MeshFileError::NotFound, MeshFileError::Io)?;
    let of = |fault: MeshFileFault| fault.of(path);
    let (parsed, vectors) = if vtu::is_vtk_xml(&bytes) {
        (vtu::parse(&bytes).map_err(of)?, vtu::vectors(&bytes).map_err(of)?)
    } else if gmsh::is_msh(&bytes) {
        (gmsh::parse(&bytes).map_err(of)?, Vec::new())
    } else if inp::is_inp(&bytes) {
        (inp::parse(&bytes).map_err(of)?, Vec::new())
    } else {
        return Err(MeshFileError::NotAMesh(path.to_owned(), crate::images::beginning(&bytes)).into());
    };
    parsed.check_positions().map_err(of)?;
    let factor = unit.in_mm().unwrap_or(1.0);
    match table {
        Some(table) => {
            let NodeTable { rows, unit: of_table } = read_node_table(table)?;
            let factor_of_table = of_table.and_then(LengthUnit::in_mm).unwrap_or(factor);
            let by_number: HashMap<u64, [f64; 2]> = rows.into_iter().collect();
            let missing = |node| ModelFileError::NodeMissing { table: table.to_owned(), node };
            field(&parsed, [factor, factor_of_table], |_, number| {
                by_number.get(&number).copied().ok_or_else(|| missing(number))
            })
        }
        None => {
            let is_named = |name: &str| {
                let name = name.to_ascii_lowercase();
                name.starts_with("disp") || ["u", "depl"].contains(&name.as_str())
            };
            let named = vectors.iter().find(|(name, _)| is_named(name));
            let only = vectors.first().filter(|_| vectors.len() == 1);
            let names = || vectors.iter().map(|(name, _)| name.clone()).collect();
            let none = || ModelFileError::NoDisplacement(path.to_owned(), names());
            let (_, values) = named.or(only).ok_or_else(none)?;
            field(&parsed, [factor; 2], |place, _| values.get(place).copied().ok_or_else(none))
        }
    }
}

/// The elements with the nodes that they use, lengths times `factors` (positions, displacements).
fn field(
    parsed: &Parsed,
    factors: [f64; 2],
    displacement: impl Fn(usize, u64) -> Result<[f64; 2], ModelFileError>,
) -> Result<ModelField, ModelFileError> {
    let (mut model, mut number_of) = (ModelField::default(), HashMap::new());
    for element in &parsed.elements {
        let mut corners = [0; 4];
        for (corner, &place) in corners.iter_mut().zip(&element.nodes) {
            let Some(node) = parsed.nodes.get(place) else { continue };
            *corner = match number_of.get(&place) {
                Some(&number) => number,
                None => {
                    let u = displacement(place, node.number)?;
                    let number = model.nodes.len() as u32;
                    number_of.insert(place, number);
                    model.nodes.push([node.at[0] * factors[0], node.at[1] * factors[0]]);
                    model.displacement.push(u.map(|u| u * factors[1]));
                    number
                }
            };
        }
        model.elements.push(corners);
    }
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_input_file_with_a_report_of_displacements_is_a_field_and_its_middle_nodes_do_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let (mesh, table) = (folder.path().join("a.inp"), folder.path().join("a.rpt"));
        let text = "*Heading\n** a comment\n*Node\n 1, 0., 0.\n2, 1, 0\n3, 1., 1.\n4, 0, 1\n5, .5, 0.\n6, 1, .5\n7, .5, 1\n8, 0, .5\n\
                    9, 2, 0\n*Element, type=CPS8R, elset=all\n10, 1, 2, 3, 4, 5,\n 6, 7, 8\n*Element, TYPE=CPE3\n11, 2, 9, 3\n\
                    *Element, type=COH2D4\n12, 1, 2, 3, 4\n*Elset, elset=all\n 10, 11\n";
        std::fs::write(&mesh, text).unwrap();
        let rows = "            Node            U.U1            U.U2\n           Label          @Loc 1          @Loc 1\n\
                    -----------------------------\n  1   0.   0.\n 2  1.E-03  0.\n 3 1.E-03 2.E-03\n 4 0. 2.E-03\n 9 3.E-03 0.\n\
                    \n  Minimum  0. 0.\n";
        std::fs::write(&table, rows).unwrap();
        let model = read_model(&mesh, Some(&table), LengthUnit::M).unwrap();
        assert_eq!(model.elements, [[0, 1, 2, 3], [1, 4, 2, 2]]);
        assert_eq!((model.nodes[4], model.displacement[2]), ([2000.0, 0.0], [1.0, 2.0]));
        std::fs::write(&table, "node,ux,uy\n1,0,0\n").unwrap();
        let error = read_model(&mesh, Some(&table), LengthUnit::Mm).unwrap_err();
        assert!(error.to_string().contains("node 2 has no displacement"), "{error}");
        let error = read_model(&mesh, None, LengthUnit::Mm).unwrap_err();
        assert!(error.to_string().contains("--displacements"), "{error}");
        for (line, wanted) in [
            ("*Include, input=b.inp", "includes another"),
            ("*Node\n1, 0, 0", "node 1 is given twice"),
            ("*Element, type=S4\n1, 1, 2, 3, 99", "node 99"),
        ] {
            std::fs::write(&mesh, format!("{text}{line}\n")).unwrap();
            let error = read_model(&mesh, Some(&table), LengthUnit::Mm).unwrap_err();
            assert!(error.to_string().contains(wanted), "{error}");
        }
    }
}
