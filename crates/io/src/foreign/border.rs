//! The measured border of the zones as boundary conditions of a model.

use crate::field::Measurement;
use crate::units::{PixelSize, Px, Vector};
use ::csv::WriterBuilder;
use std::collections::BTreeSet;
use std::io::{self, Write};

/// Nodes on the border of zones with their displacements, mm, y up; the origin is the centre of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    nodes: Vec<BorderNode>,
}

/// A node on a border, mm.
#[derive(Debug, Clone, PartialEq)]
struct BorderNode {
    zone: String,
    /// Its number in the mesh.
    number: u32,
    at: [f64; 2],
    u: [f64; 2],
    sigma: [f64; 2],
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
                    let sigma = sigma.map(|v| scale.mm_from_px(v));
                    nodes.push(BorderNode { zone: name.clone(), number: node, at: mm(x), u: mm(u), sigma });
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
        let mut table = WriterBuilder::new().from_writer(&mut out);
        table.write_record(["node", "zone", "x_mm", "y_mm", "ux_mm", "uy_mm", "sigma_ux_mm", "sigma_uy_mm"])?;
        for BorderNode { zone, number, at, u, sigma } in &self.nodes {
            let numbers = [at, u, sigma].into_iter().flatten().map(|v| format!("{v:?}"));
            table.write_record([number.to_string(), zone.clone()].into_iter().chain(numbers))?;
        }
        table.flush()?;
        drop(table);
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
        for BorderNode { number, at: [x, y], .. } in &self.nodes {
            writeln!(out, "{}, {x:?}, {y:?}", number + 1)?;
        }
        writeln!(out, "** in a step:\n*BOUNDARY")?;
        for BorderNode { number, u, .. } in &self.nodes {
            (1..).zip(u).try_for_each(|(axis, u)| writeln!(out, "{}, {axis}, {axis}, {u:?}", number + 1))?;
        }
        out.flush()
    }
}

/// A text on one line: names of files may have others.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
