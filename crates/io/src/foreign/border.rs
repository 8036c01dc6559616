//! The measured border of the zones as boundary conditions of a model.

use crate::field::Measurement;
use crate::units::{PixelSize, Px, Vector};
use std::collections::BTreeSet;
use std::io::{self, Write};

/// Nodes on the border of zones with their displacements, mm, y up; the origin is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Zone, number of the node in the mesh, position, displacement, its standard uncertainty.
    nodes: Vec<(String, u32, [f64; 2], [f64; 2], [f64; 2])>,
}

impl Border {
    /// The measured nodes on the borders of all zones, zone by zone, with displacements as values at points.
    pub fn of(field: &Measurement<Px>, scale: PixelSize) -> Self {
        let mm = |v: [f64; 2]| scale.to_mm(Vector::new(v)).components();
        let mesh = &field.mesh;
        let mut nodes = Vec::new();
        for (zone, name) in mesh.zones().iter().enumerate() {
            let border: BTreeSet<u32> = mesh.boundary(zone).into_iter().flatten().collect();
            for node in border {
                let at = node as usize;
                let of_node = mesh.nodes().get(at).zip(field.at_points().get(at)).zip(field.sigma_at_points().get(at));
                if let (Some(((&x, &u), &sigma)), Some(true)) = (of_node, field.measured.get(at)) {
                    nodes.push((name.clone(), node, mm(x), mm(u), sigma.map(|v| scale.mm_from_px(v))));
                }
            }
        }
        Self { nodes }
    }

    /// A table with a row for each node.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_csv<W: Write>(&self, mut out: W, title: &str) -> io::Result<()> {
        writeln!(out, "# {}", one_line(title))?;
        writeln!(out, "# border of the zones, mm, y up, origin at the centre of the top-left pixel")?;
        writeln!(out, "node,zone,x_mm,y_mm,ux_mm,uy_mm,sigma_ux_mm,sigma_uy_mm")?;
        for (zone, node, at, u, sigma) in &self.nodes {
            write!(out, "{node},\"{}\"", zone.replace('"', "\"\""))?;
            [at, u, sigma].into_iter().flatten().try_for_each(|v| write!(out, ",{v:?}"))?;
            writeln!(out)?;
        }
        out.flush()
    }

    /// The same as lines of an Abaqus input file: nodes, numbered from 1, and their displacements as boundary
    /// conditions of a step.
    ///
    /// # Errors
    /// Those of the writer.
    pub fn write_inp<W: Write>(&self, mut out: W, title: &str) -> io::Result<()> {
        writeln!(
            out,
            "** {}\n** border of the zones, mm, y up, origin at the centre of the top-left pixel",
            one_line(title)
        )?;
        writeln!(out, "*NODE, NSET=MEASURED_BORDER")?;
        for (_, node, [x, y], ..) in &self.nodes {
            writeln!(out, "{}, {x:?}, {y:?}", node + 1)?;
        }
        writeln!(out, "** in a step:\n*BOUNDARY")?;
        for (_, node, _, u, _) in &self.nodes {
            (1..).zip(u).try_for_each(|(axis, u)| writeln!(out, "{}, {axis}, {axis}, {u:?}", node + 1))?;
        }
        out.flush()
    }
}

/// A text on one line: names of files may have others.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
