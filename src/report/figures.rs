//! The figures of one frame, as files.

use super::figure::{Figure, FigureOptions, Values};
use super::map::{MapOptions, element_map_on, nodal_map_on};
use super::mesh_figure::{MeshOptions, deformed_mesh, mesh_figure, register_figure};
use super::profile::{Profiled, profile_plot};
use super::scale::{LARGEST, Palette, outer_ends, percentiles, write_number};
use super::{Backdrop, Picture, ReportError};
use crate::field::{
    DOUBTFUL, Measurement, PointValues, Status, StrainField, StrainWindows, TensorStrain, Value, WindowStrains,
    rotations,
};
use crate::units::Px;
use std::path::{Path, PathBuf};

/// Draws the figures of frame `number` into `folder` (made when it is not there), as `000012-exx.png`, and those
/// along a line as `000012-exx-profile.png`; gives the files. `reference` and `deformed` are the images, the
/// second only for the deformed mesh.
///
/// A frame that diverged or could not be read is no measurement: nothing is drawn of it.
///
/// # Errors
/// A range, magnification or line that is none, per cent without a range of grey levels, a file that cannot be written.
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
    let frame = Frame::new(number, measurement, reference, deformed, options)?;
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

/// One of the figures of frame `number`, as a picture. `reference` and `deformed` as in [`draw_frame`].
///
/// # Errors
/// As [`draw_frame`].
pub fn draw_figure(
    number: usize,
    measurement: &Measurement<Px>,
    reference: &Backdrop,
    deformed: Option<&Backdrop>,
    figure: Figure,
    options: &FigureOptions,
) -> Result<Picture, ReportError> {
    let options = FigureOptions { figures: vec![figure], ..options.clone() };
    Frame::new(number, measurement, reference, deformed, &options)?.draw(figure)
}

/// Share of the values at either end that the colours of an animation leave out.
const ENDS: f64 = 0.005;

/// Between which ends the values of a figure of a frame lie, but for the outermost few; `None` of one without values.
/// For colours that mean the same in all frames of a series.
///
/// # Errors
/// As [`draw_frame`].
pub fn ends_of(
    measurement: &Measurement<Px>,
    reference: &Backdrop,
    figure: Figure,
    options: &FigureOptions,
) -> Result<Option<[f64; 2]>, ReportError> {
    if figure.quantity().is_none() {
        return Ok(None);
    }
    let options = FigureOptions { figures: vec![figure], ..options.clone() };
    let values = match Frame::new(0, measurement, reference, None, &options)?.values(figure)? {
        Values::Nodes(values) | Values::Elements(values) => values,
    };
    Ok(outer_ends(values.into_iter().filter(|v| v.abs() <= LARGEST).collect(), ENDS))
}

/// One frame with what its figures share.
struct Frame<'a> {
    number: usize,
    measurement: &'a Measurement<Px>,
    reference: &'a Backdrop,
    deformed: Option<&'a Backdrop>,
    options: &'a FigureOptions,
    strain: Option<StrainField>,
    window: Option<WindowStrains>,
    /// Nodes with a large standard uncertainty.
    doubtful: Vec<bool>,
}

impl<'a> Frame<'a> {
    fn new(
        number: usize,
        measurement: &'a Measurement<Px>,
        reference: &'a Backdrop,
        deformed: Option<&'a Backdrop>,
        options: &'a FigureOptions,
    ) -> Result<Self, ReportError> {
        let strained = options.figures.iter().any(|figure| figure.strain().is_some());
        let in_plane = options.camera.as_ref().map(|camera| camera.rectify(measurement));
        let plane = in_plane.as_deref().unwrap_or(measurement);
        let strain = strained.then(|| StrainField::of(plane, options.strain));
        let window = match options.figures.iter().any(|figure| figure.is_of_window()) {
            true => {
                let window = options.strain_window.ok_or(ReportError::NoWindow)?;
                let windows = StrainWindows::new(&plane.mesh, window, !options.known_noise);
                Some(windows.of(plane, options.strain))
            }
            false => None,
        };
        let doubtful = measurement.doubtful();
        Ok(Self { number, measurement, reference, deformed, options, strain, window, doubtful })
    }

    fn draw(&self, figure: Figure) -> Result<Picture, ReportError> {
        let options = self.options;
        let Some((title, unit)) = figure.quantity() else { return self.draw_mesh(figure) };
        let values = self.values(figure)?;
        let signed = figure.is_signed();
        let map = MapOptions {
            range: options.range,
            trim: if matches!(figure, Figure::Ux | Figure::Uy) { 0.002 } else { 0.005 },
            palette: match figure {
                _ if signed => Palette::BlueRed,
                Figure::Residual | Figure::ResidualPercent | Figure::Misfit => Palette::Plasma,
                _ if figure.is_strain() => Palette::Plasma,
                _ => Palette::Viridis,
            },
            // A white middle must not be taken for a grey image.
            opacity: if signed { 0.8 } else { 0.7 },
            pixel_size: options.pixel_size,
            line: options.line,
            hatched: self.measurement.hatched(),
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
        let nodal = |c: usize| Values::Nodes(measurement.at_points().iter().map(|u| u[c]).collect());
        Ok(match figure {
            Figure::Ux => nodal(0),
            Figure::Uy => nodal(1),
            Figure::Magnitude => Values::Nodes(measurement.at_points().iter().map(|u| u[0].hypot(u[1])).collect()),
            Figure::Rotation => {
                let in_plane = self.options.camera.as_ref().map(|camera| camera.rectify(measurement));
                let of_elements = rotations(in_plane.as_deref().unwrap_or(measurement));
                Values::Elements(of_elements.into_iter().map(|angle| angle.unwrap_or(f64::NAN)).collect())
            }
            Figure::Sigma => Values::Nodes(measurement.sigma_at_points().iter().map(rms).collect()),
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
                let value = |strain: Option<TensorStrain>| {
                    figure.strain().zip(strain).map_or(f64::NAN, |(number, strain)| number.of(strain))
                };
                let strain = self.strain.as_ref().filter(|_| figure.is_strain() && !figure.is_of_window());
                match (strain, self.window.as_ref().filter(|_| figure.is_of_window())) {
                    (Some(strain), _) if self.options.strain_on_nodes => {
                        Values::Nodes(strain.nodes.iter().map(|strain| value(*strain)).collect())
                    }
                    (Some(strain), _) => {
                        Values::Elements(strain.elements.iter().map(|strain| value(*strain)).collect())
                    }
                    (None, Some(window)) => {
                        Values::Nodes(window.nodes.iter().map(|at| value(at.map(|(strain, _)| strain))).collect())
                    }
                    (None, None) => Values::Nodes(vec![f64::NAN; measurement.mesh.n_nodes()]),
                }
            }
        })
    }

    /// What stands below a map: its extremes, what a strain is, files.
    fn notes(&self, figure: Figure, unit: &str, values: &Values) -> Vec<String> {
        let (mesh, measured) = (&self.measurement.mesh, &self.measurement.measured);
        let elements = mesh.elements().iter().enumerate();
        let whole = elements.filter(|(_, nodes)| nodes.iter().all(|&node| measured[node as usize]));
        let is_shown = |value: &f64| value.abs() <= LARGEST;
        let mut is_told = vec![false; mesh.n_nodes()];
        let (mut told, mut shown) = (Vec::new(), 0);
        for (element, nodes) in whole {
            let nodes = nodes.map(|node| node as usize);
            match values {
                Values::Nodes(values) if nodes.iter().all(|&node| is_shown(&values[node])) => {
                    shown += 1;
                    for node in nodes {
                        if !self.doubtful[node] && !std::mem::replace(&mut is_told[node], true) {
                            told.push(values[node]);
                        }
                    }
                }
                Values::Elements(values) if is_shown(&values[element]) => {
                    shown += 1;
                    if !nodes.iter().any(|&node| self.doubtful[node]) {
                        told.push(values[element]);
                    }
                }
                _ => {}
            }
        }
        let mut notes = Vec::new();
        if let Some([low, high]) = percentiles(told) {
            let unit = if unit == "-" { String::new() } else { format!(" {unit}") };
            let (n, [low, high]) = (mesh.n_elements(), [low, high].map(write_number));
            notes.push(format!("percentiles 1 to 99: {low} to {high}{unit}, on {shown} of {n} elements"));
        }
        let n_doubtful = self.doubtful.iter().filter(|&&doubtful| doubtful).count();
        if n_doubtful > 0 && shown > 0 {
            let nodes = if n_doubtful == 1 { "1 node has".to_owned() } else { format!("{n_doubtful} nodes have") };
            notes.push(format!(
                "hatched: {nodes} a standard uncertainty above {DOUBTFUL} times the median, left out of the percentiles"
            ));
        }
        let rounded = |length: f64| (length * 100.0).round() / 100.0;
        if let (true, Some(WindowStrains { window, .. })) = (figure.is_of_window(), &self.window) {
            let (length, definition) = (rounded(window.gauge_length(mesh.element_size())), self.options.strain);
            let formula = definition.formula();
            notes.push(format!(
                "{definition} strain, {formula}, plane fitted to {window}: virtual strain gauge of {length} px"
            ));
        } else if let (true, Some(StrainField { definition, length_px, .. })) = (figure.is_strain(), &self.strain) {
            let length = rounded(length_px * if self.options.strain_on_nodes { 2.0 } else { 1.0 });
            notes.push(format!("{definition} strain, {}, over {length} px", definition.formula()));
        }
        if let (Figure::ResidualPercent, Some(range)) = (figure, self.options.range_grey) {
            notes.push(format!("100 % is the range of the reference, {} grey levels", write_number(range)));
        }
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
            Figure::Mesh => {
                let options = mesh("Mesh on the reference");
                mesh_figure(self.reference, &measurement.mesh, Some(&measurement.measured), &options)
            }
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
        let of = |there: &PointValues| match figure {
            Figure::Ux => Some(Value { value: there.displacement[0], sigma: there.sigma[0] }),
            Figure::Uy => Some(Value { value: there.displacement[1], sigma: there.sigma[1] }),
            Figure::Magnitude => Some(there.magnitude),
            Figure::Rotation => there.rotation_deg,
            _ => figure.strain().and_then(|number| number.at(there)),
        };
        let is_at_points = matches!(figure, Figure::Ux | Figure::Uy | Figure::Magnitude | Figure::Rotation)
            || (figure.is_strain() && !figure.is_of_window());
        let what = if is_at_points { Profiled::Numbers(&of) } else { Profiled::Values(&values) };
        let (title, unit) = figure.quantity().unwrap_or_default();
        let mut plot = profile_plot(self.measurement, what, figure.is_strain(), line, self.options)?;
        plot.title = format!("{title} along a line, frame {}", self.number);
        plot.y.label = format!("{title} ({unit})");
        plot.notes.extend(self.options.notes.iter().cloned());
        Ok(plot)
    }
}
