//! The figures of one frame, as files.

use super::figure::{Figure, FigureOptions, Values};
use super::map::{MapOptions, element_map_on, nodal_map_on};
use super::mesh_figure::{MeshOptions, deformed_mesh, mesh_figure, register_figure};
use super::profile::{Profiled, profile_plot};
use super::scale::{LARGEST, Palette, written};
use super::{Backdrop, Picture, ReportError};
use crate::field::{Measurement, Status, StrainField};
use crate::units::Px;
use std::path::{Path, PathBuf};

/// Draws the figures of frame `number` into `folder` (made when it is not there), as `000012-exx.png`, and those
/// along a line as `000012-exx-profile.png`; gives the files. `reference` and `deformed` are the images, the
/// second only for the deformed mesh.
///
/// A frame that diverged or could not be read is no measurement: nothing is drawn of it.
///
/// # Errors
/// A range, a magnification or a line that is none, per cent without a range of grey levels, and a file that
/// cannot be written.
pub fn draw_frame(
    folder: &Path,
    number: usize,
    measurement: &Measurement<Px>,
    reference: &Backdrop,
    deformed: Option<&Backdrop>,
    options: &FigureOptions,
) -> Result<Vec<PathBuf>, ReportError> {
    if matches!(measurement.status, Status::Diverged | Status::Unreadable) {
        return Ok(Vec::new());
    }
    std::fs::create_dir_all(folder).map_err(|source| ReportError::Write { path: folder.to_owned(), source })?;
    let frame = Frame::new(number, measurement, reference, deformed, options);
    let mut files = Vec::new();
    let mut save = |picture: &Picture, name: &str| {
        for format in &options.formats {
            let path = folder.join(format!("{number:06}-{name}.{}", format.name()));
            picture.save(&path)?;
            files.push(path);
        }
        Ok::<_, ReportError>(())
    };
    for &figure in &options.figures {
        save(&frame.draw(figure)?, figure.name())?;
        if let (Some(line), Some(_)) = (options.line, figure.quantity()) {
            let plot = frame.profile(figure, line)?;
            save(&plot.draw()?.with_ratio(reference.ratio()), &format!("{figure}-profile"))?;
        }
    }
    Ok(files)
}

/// One frame with what its figures share.
struct Frame<'a> {
    number: usize,
    measurement: &'a Measurement<Px>,
    reference: &'a Backdrop,
    deformed: Option<&'a Backdrop>,
    options: &'a FigureOptions,
    strain: Option<StrainField>,
}

impl<'a> Frame<'a> {
    fn new(
        number: usize,
        measurement: &'a Measurement<Px>,
        reference: &'a Backdrop,
        deformed: Option<&'a Backdrop>,
        options: &'a FigureOptions,
    ) -> Self {
        let strained = options.figures.iter().any(|figure| figure.strain().is_some());
        let strain = strained.then(|| StrainField::of(measurement, options.strain));
        Self { number, measurement, reference, deformed, options, strain }
    }

    fn draw(&self, figure: Figure) -> Result<Picture, ReportError> {
        let options = self.options;
        let Some((title, unit)) = figure.quantity() else { return self.draw_mesh(figure) };
        let values = self.values(figure)?;
        let signed = figure.strain().is_some();
        let map = MapOptions {
            range: options.range,
            trim: if matches!(figure, Figure::Ux | Figure::Uy) { 0.002 } else { 0.005 },
            palette: match figure {
                _ if signed => Palette::BlueRed,
                Figure::Residual | Figure::ResidualPercent | Figure::Misfit => Palette::Plasma,
                _ => Palette::Viridis,
            },
            // A white middle must not be taken for a grey image.
            opacity: if signed { 0.8 } else { 0.7 },
            pixel_size: options.pixel_size,
            line: options.line,
            notes: self.notes(figure, unit, &values),
            ..MapOptions::new(format!("{title}, frame {}", self.number), format!("{title} ({unit})"))
        };
        match &values {
            Values::Nodes(values) => nodal_map_on(self.reference, self.measurement, values, &map),
            Values::Elements(values) => element_map_on(self.reference, self.measurement, values, &map),
        }
    }

    fn values(&self, figure: Figure) -> Result<Values, ReportError> {
        let measurement = self.measurement;
        let rms = |s: &[f64; 2]| (0.5 * (s[0] * s[0] + s[1] * s[1])).sqrt();
        let nodal = |c: usize| Values::Nodes(measurement.displacement.iter().map(|u| u[c]).collect());
        Ok(match figure {
            Figure::Ux => nodal(0),
            Figure::Uy => nodal(1),
            Figure::Sigma => Values::Nodes(measurement.sigma.iter().map(rms).collect()),
            Figure::ModelError => Values::Nodes(match &measurement.model_error {
                Some(model) => model.nodes.iter().map(rms).collect(),
                None => vec![f64::NAN; measurement.mesh.n_nodes()],
            }),
            Figure::Misfit => Values::Elements(match &measurement.model_error {
                Some(model) => model.misfit.clone(),
                None => vec![f64::NAN; measurement.mesh.n_elements()],
            }),
            Figure::ResidualPercent => {
                let range = self.options.range_grey.filter(|range| *range > 0.0).ok_or(ReportError::Percent)?;
                Values::Elements(measurement.element_residual.iter().map(|r| 100.0 * r / range).collect())
            }
            Figure::Residual => Values::Elements(measurement.element_residual.clone()),
            _ => {
                let (Some(strain), Some(c)) = (&self.strain, figure.strain()) else {
                    return Ok(Values::Nodes(vec![f64::NAN; measurement.mesh.n_nodes()]));
                };
                let component = |strains: &[Option<crate::field::TensorStrain>]| -> Vec<f64> {
                    strains.iter().map(|strain| strain.map_or(f64::NAN, |strain| strain.components()[c])).collect()
                };
                if self.options.strain_on_nodes {
                    Values::Nodes(component(&strain.nodes))
                } else {
                    Values::Elements(component(&strain.elements))
                }
            }
        })
    }

    /// What stands below a map: its extremes, what a strain is, files.
    fn notes(&self, figure: Figure, unit: &str, values: &Values) -> Vec<String> {
        let (mesh, measured) = (&self.measurement.mesh, &self.measurement.measured);
        let elements = mesh.elements().iter().enumerate();
        let whole = elements.filter(|(_, nodes)| nodes.iter().all(|&node| measured[node as usize]));
        let mut ends: Option<(f64, f64)> = None;
        let mut shown = 0;
        for (element, nodes) in whole {
            let of_element = match values {
                Values::Nodes(values) => nodes.map(|node| values[node as usize]),
                Values::Elements(values) => [values[element]; 4],
            };
            if of_element.iter().all(|v| v.abs() <= LARGEST) {
                shown += 1;
                let [low, high] = [f64::min, f64::max].map(|f| of_element.into_iter().fold(of_element[0], f));
                ends = Some(ends.map_or((low, high), |(a, b)| (a.min(low), b.max(high))));
            }
        }
        let mut notes = Vec::new();
        if let Some((low, high)) = ends {
            let unit = if unit == "-" { String::new() } else { format!(" {unit}") };
            let n = mesh.n_elements();
            notes.push(format!("values {} to {}{unit}, on {shown} of {n} elements", written(low), written(high)));
        }
        if let (Some(strain), Some(_)) = (&self.strain, figure.strain()) {
            let length = strain.length_px * if self.options.strain_on_nodes { 2.0 } else { 1.0 };
            let length = (length * 100.0).round() / 100.0;
            notes.push(format!("{} strain, {}, over {length} px", strain.definition, strain.definition.formula()));
        }
        if let (Figure::ResidualPercent, Some(range)) = (figure, self.options.range_grey) {
            notes.push(format!("100 % is the range of the reference, {} grey levels", written(range)));
        }
        let marked = self.measurement.marked();
        if marked.iter().any(|marked| !marked.mark.is_left_out()) {
            notes.push("hatched: the residual is beyond noise, the displacement doubtful".to_owned());
        }
        let left_out: Vec<String> =
            marked.iter().filter(|marked| marked.mark.is_left_out()).map(ToString::to_string).collect();
        if !left_out.is_empty() {
            notes.push(format!("left out: {}", left_out.join("; ")));
        }
        notes.extend(self.measurement.misfit().map(|misfit| misfit.to_string()));
        notes.extend(self.options.notes.iter().cloned());
        notes
    }

    fn draw_mesh(&self, figure: Figure) -> Result<Picture, ReportError> {
        let (measurement, options) = (self.measurement, self.options);
        let mesh = |title: &str| MeshOptions {
            title: format!("{title}, frame {}", self.number),
            notes: options.notes.clone(),
            pixel_size: options.pixel_size,
            magnify: options.magnify,
            guard_px: options.guard_px.clone(),
        };
        match figure {
            Figure::Mesh => mesh_figure(
                self.reference,
                &measurement.mesh,
                Some(&measurement.measured),
                &mesh("Mesh on the reference"),
            ),
            Figure::Register => {
                register_figure(self.reference, measurement, options.rigid, &mesh("Zones in register"), options.range)
            }
            _ => {
                // A magnified mesh does not fit its image.
                let deformed = self.deformed.filter(|_| options.magnify.is_none_or(|factor| factor == 1.0));
                let title = mesh("Deformed mesh");
                deformed_mesh(deformed.unwrap_or(self.reference), deformed.is_some(), measurement, &title)
            }
        }
    }

    fn profile(&self, figure: Figure, line: [f64; 4]) -> Result<super::Plot, ReportError> {
        let values = self.values(figure)?;
        let what = match (figure, figure.strain()) {
            (_, Some(c)) => Profiled::Strain(c),
            (Figure::Ux, _) => Profiled::Displacement(0),
            (Figure::Uy, _) => Profiled::Displacement(1),
            _ => Profiled::Values(&values),
        };
        let (title, unit) = figure.quantity().unwrap_or_default();
        let mut plot = profile_plot(self.measurement, what, line, self.options)?;
        plot.title = format!("{title} along a line, frame {}", self.number);
        plot.y.label = format!("{title} ({unit})");
        plot.notes.extend(self.options.notes.iter().cloned());
        Ok(plot)
    }
}
