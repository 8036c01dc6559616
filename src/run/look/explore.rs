//! The page on which one looks around in a run, from its store: a file of its own, or a part of its report.

use crate::field::Status;
use crate::io::arrays::Values;
use crate::io::quantities::QUANTITY_TABLES;
use crate::io::store::{Place, Store, Variable};
use crate::report::page::{Block, Page, Section};
use crate::report::summary::Summary;
use crate::report::view::{Column, Head, Layer, On, Packed, View, ViewFrame};
use crate::report::{Backdrop, Palette};
use crate::run::folder::{RunFolder, read::read_json};
use crate::run::look::{FitOfRun, Off};
use crate::run::words::{Result, file_name, plural};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What a page has beside its frames, bytes: pictures, script, palettes.
const REST: usize = 2_000_000;
/// Size of a report with it, bytes.
const REPORT: usize = 15_000_000;
/// What it takes of a report beside frames, mesh, image and fit, bytes: script, palettes, words.
const REST_IN_REPORT: usize = 150_000;
/// Name, status and the like of a frame there, bytes.
const ABOUT_FRAME: usize = 120;
/// Frames in a report, at most, however small they are.
const FRAMES_IN_REPORT: usize = 1000;
/// Title of its section there.
const TITLE: &str = "The fields, to look around in";

/// A run to look around in.
#[derive(Debug)]
pub struct Explored<'a> {
    /// The folder of its fields.
    pub folder: &'a Path,
    /// The store in it.
    pub store: &'a Store,
    /// The frames to look at, each with a field.
    pub numbers: &'a [usize],
    /// The reference image.
    pub reference: &'a Backdrop,
    /// What cannot be shown, and why.
    pub faults: Vec<String>,
    /// The fit of a joint, where there is one.
    pub fit: Option<&'a FitOfRun>,
    /// What its model is off by, px.
    pub model: Option<&'a Off>,
}

/// A page that is made.
#[derive(Debug)]
pub struct ExplorerPage {
    /// The page.
    pub html: String,
    /// Frames in it.
    pub n_shown: usize,
}

/// The packed frames that are shown, by number.
type Shown = BTreeMap<usize, Packed>;
/// A frame that is listed: its number, and how it ended.
type Listed = (usize, Option<Status>);

impl Explored<'_> {
    /// The page `title`, of about `max_mb` MB at most: from many frames evenly spaced ones are taken, and it says so.
    ///
    /// # Errors
    /// What cannot be read of the store.
    pub fn page(&self, title: String, max_mb: f64) -> Result<ExplorerPage> {
        let sources = sources(self.store, self.model.is_some());
        let room = ((max_mb * 1e6) as usize).saturating_sub(REST);
        let mut shown = self.pack(&sources, |size| (room / size).max(1))?;
        let n_shown = shown.len();
        let header = self.store.header();
        let frames: Vec<Listed> = (1..=self.store.n_frames()).map(|number| self.list(number)).collect();
        let mut lead: Vec<(String, bool)> = self.faults.iter().map(|fault| (fault.clone(), true)).collect();
        lead.push(count_ends(&frames));
        // Without a summary the fields are there all the same.
        let trust = read_json::<Summary>(&self.folder.join(RunFolder::SUMMARY)).ok().and_then(|summary| summary.trust);
        lead.extend(trust.map(|trust| (format!("Trust: {trust}."), false)));
        if n_shown < self.numbers.len() {
            let text = format!(
                "{n_shown} of {} frames with a field are in this page, evenly spaced, to keep it below {max_mb} MB; `quadrille view --max-mb` \
                 or --frames has others.",
                self.numbers.len(),
            );
            lead.push((text, true));
        }
        let subtitle = format!(
            "reference {}; quadrille {}; px of the reference image, x to the right, y down",
            header.reference.first().map(file_name).unwrap_or_default(),
            header.quadrille
        );
        let head = Head { title, subtitle, lead };
        let html = self.view(Some(head), &sources, &frames, &mut shown).html();
        Ok(ExplorerPage { html, n_shown })
    }

    /// Puts it behind the first section of a report, as many frames as leave the report below its size.
    pub(crate) fn put_into(&self, report: &mut Page) -> Result<()> {
        if !self.numbers.is_empty() {
            let room = REPORT.saturating_sub(report.html().len());
            let section = self.section(room)?;
            report.sections.insert(1.min(report.sections.len()), section);
        }
        Ok(())
    }

    /// The same as a section of a report, of at most `room` bytes.
    fn section(&self, room: usize) -> Result<Section> {
        let sources = sources(self.store, self.model.is_some());
        let mesh = self.store.mesh();
        let law = self.fit.map_or(0, |fit| fit.view().n_bytes());
        let fixed = base64(8 * mesh.n_nodes() + 16 * mesh.n_elements() + self.reference.n_bytes());
        let room = room.saturating_sub(REST_IN_REPORT + law + fixed);
        let mut shown = self.pack(&sources, |size| (room / (size + ABOUT_FRAME)).min(FRAMES_IN_REPORT))?;
        let (n_shown, n) = (shown.len(), self.numbers.len());
        let warned = |text: String| Block::Lead { text, warning: true };
        let mut blocks: Vec<Block> = self.faults.iter().cloned().map(warned).collect();
        if n_shown == 0 {
            let text = "A frame of so many nodes is too large for this page: `quadrille view` with the folder of this page makes one of its own.";
            blocks.push(Block::Text(text.into()));
            return Ok(Section { title: TITLE.into(), blocks });
        }
        if n_shown < n {
            blocks.push(warned(format!(
                "{n_shown} of {n} frames with a field are in this page, evenly spaced, to keep it small; `quadrille view --max-mb` with the folder \
                 of this page makes one with more."
            )));
        }
        blocks.push(Block::Text(
            "Point at the field for its value and standard uncertainty. Profile: drag a line. Gauge: pick two points to plot how their distance changes. \
             Keys, once the field was clicked: arrows and space for frames, q for the quantity, v p g m for what the pointer does, + - 0 to zoom."
                .into(),
        ));
        let frames: Vec<Listed> = shown.keys().map(|&number| self.list(number)).collect();
        blocks.push(Block::Interactive(self.view(None, &sources, &frames, &mut shown).interactive()));
        Ok(Section { title: TITLE.into(), blocks })
    }

    /// Frames, evenly, as many as `room` says for the size of one, packed.
    fn pack(&self, sources: &[(Layer, Source)], room: impl Fn(usize) -> usize) -> Result<Shown> {
        let one = |&number: &usize| -> Result<_> {
            let numbers = numbers_of(self.store, number, sources, self.model)?;
            Ok((number, Packed::new(&numbers)))
        };
        let few: Shown = thin(self.numbers, 3).par_iter().map(one).collect::<Result<_>>()?;
        let size = few.values().map(Packed::size).max().unwrap_or(1).max(1);
        thin(self.numbers, room(size)).par_iter().map(one).collect()
    }

    fn list(&self, number: usize) -> Listed {
        (number, self.store.status(number).ok().flatten())
    }

    /// What is shown, with the frames that are listed.
    fn view(&self, head: Option<Head>, sources: &[(Layer, Source)], listed: &[Listed], shown: &mut Shown) -> View<'_> {
        let header = self.store.header();
        let frame = |&(number, status): &Listed| ViewFrame {
            number,
            file: header.frames.get(number - 1).map(file_name).unwrap_or_default(),
            status,
            packed: shown.remove(&number),
        };
        let frames: Vec<ViewFrame> = listed.iter().map(frame).collect();
        let in_two =
            |line: String| line.split_once(": ").map_or((String::new(), line.clone()), |(a, b)| (a.into(), b.into()));
        let mut about: Vec<(String, String)> = header.about().into_iter().map(in_two).collect();
        about.push((
            "this page".into(),
            "numbers are rounded to 1/65534 of the range of their quantity in the frame; between nodes they are interpolated as the elements \
             do; a gauge is the difference of two displacements. `quadrille export` and `probe` have all digits"
                .into(),
        ));
        View {
            head,
            folder: self.folder.display().to_string(),
            backdrop: self.reference,
            mm_per_px: header.pixel_size.map(|scale| scale.mm_per_px()),
            mesh: &header.mesh,
            layers: sources.iter().map(|(layer, _)| layer.clone()).collect(),
            n_frames: self.store.n_frames(),
            columns: columns(self.folder, listed),
            frames,
            about,
            law: self.fit.map(FitOfRun::view),
        }
    }
}

/// Bytes of base64 for so many.
fn base64(bytes: usize) -> usize {
    bytes.div_ceil(3) * 4
}

/// How many frames ended how, and whether that is worth a warning.
fn count_ends(frames: &[Listed]) -> (String, bool) {
    let count = |status: Option<Status>| frames.iter().filter(|(_, s)| *s == status).count();
    let of = Status::ALL.into_iter().map(|status| (count(Some(status)), status.name().replace('_', " ")));
    let counts: Vec<String> = of
        .chain([(count(None), "not done".to_owned())])
        .filter(|(n, _)| *n > 0)
        .map(|(n, name)| format!("{n} {name}"))
        .collect();
    let fine = count(Some(Status::Converged)) == frames.len();
    (format!("{}: {}.", plural(frames.len(), "frame"), counts.join(", ")), !fine)
}

/// As many of `numbers` as there is room for, evenly, the first and the last among them.
fn thin(numbers: &[usize], room: usize) -> Vec<usize> {
    let n = numbers.len();
    match room {
        _ if room >= n => numbers.to_vec(),
        0 => Vec::new(),
        1 => numbers.last().copied().into_iter().collect(),
        _ => (0..room).filter_map(|k| numbers.get(k * (n - 1) / (room - 1)).copied()).collect(),
    }
}

/// Where the numbers of a quantity come from.
#[derive(Debug, Clone, Copy)]
enum Source {
    /// A component of what the store has.
    Store(Variable, usize),
    /// A component of what the model of the joint is off by.
    Model(usize),
}

/// Its quantities, with the standard uncertainty of what was measured.
fn of_model(sources: &mut Vec<(Layer, Source)>) {
    let sigma = |sources: &[(Layer, Source)], key: &str| sources.iter().position(|(layer, _)| layer.key == key);
    for (component, (key, name, of)) in [("mx", "u_x", "sx"), ("my", "u_y", "sy")].into_iter().enumerate() {
        let label = format!("{name} of the model less that measured");
        let sigma = sigma(sources, of);
        let palette = Palette::BlueRed;
        let none = Layer {
            window: 0,
            figure: None,
            stored: None,
            key,
            label,
            unit: "px",
            on: On::Nodes,
            sigma,
            palette,
            choice: true,
        };
        sources.push((none, Source::Model(component)));
    }
}

/// The quantities, each with its place in the store; also those of a model.
fn sources(store: &Store, has_model: bool) -> Vec<(Layer, Source)> {
    type Row = (&'static str, &'static str, Variable, usize, Option<&'static str>, Palette);
    let window = store.header().strain_window.map_or(0, |window| window.nodes());
    let strain = ["e_xx", "e_yy", "e_xy"];
    // Values at points, where the store has them.
    let [displacement, sigma] = match store.has(Variable::DisplacementPoint) && store.has(Variable::SigmaPoint) {
        true => [Variable::DisplacementPoint, Variable::SigmaPoint],
        false => [Variable::Displacement, Variable::Sigma],
    };
    let mut rows: Vec<Row> = vec![
        ("ux", "u_x", displacement, 0, Some("sx"), Palette::Viridis),
        ("uy", "u_y", displacement, 1, Some("sy"), Palette::Viridis),
        ("exx", strain[0], Variable::StrainNode, 0, None, Palette::BlueRed),
        ("eyy", strain[1], Variable::StrainNode, 1, None, Palette::BlueRed),
        ("exy", strain[2], Variable::StrainNode, 2, None, Palette::BlueRed),
    ];
    let of_window = || {
        strain.into_iter().zip([["wxx", "swxx", "ewxx"], ["wyy", "swyy", "ewyy"], ["wxy", "swxy", "ewxy"]]).enumerate()
    };
    for (k, (name, [strain, sigma, _])) in of_window() {
        rows.push((strain, name, Variable::StrainWindow, k, Some(sigma), Palette::BlueRed));
    }
    rows.extend([
        ("residual", "residual", Variable::Residual, 0, None, Palette::Plasma),
        ("misfit", "misfit", Variable::Misfit, 0, None, Palette::Plasma),
        ("sx", "standard uncertainty of u_x", sigma, 0, None, Palette::Viridis),
        ("sy", "standard uncertainty of u_y", sigma, 1, None, Palette::Viridis),
        ("ex", "model error of u_x", Variable::ModelError, 0, None, Palette::Viridis),
        ("ey", "model error of u_y", Variable::ModelError, 1, None, Palette::Viridis),
    ]);
    for (k, (name, [_, sigma, model])) in of_window() {
        rows.push((sigma, name, Variable::SigmaStrainWindow, k, None, Palette::Viridis));
        rows.push((model, name, Variable::ModelErrorStrainWindow, k, None, Palette::Viridis));
    }
    rows.push(("mark", "what is the matter", Variable::Mark, 0, None, Palette::Plasma));
    rows.retain(|row| store.has(row.2));
    let place = |key: Option<&str>| rows.iter().position(|row| Some(row.0) == key);
    let layer = |&(key, name, variable, component, sigma, palette): &Row| {
        let label = match variable {
            Variable::StrainNode => format!("strain {name} at nodes"),
            Variable::StrainWindow => format!("strain {name} over {window} x {window} nodes"),
            Variable::SigmaStrainWindow => format!("standard uncertainty of strain {name}"),
            Variable::ModelErrorStrainWindow => format!("model error of strain {name}"),
            _ => name.to_owned(),
        };
        let on = match variable.place() {
            Place::Nodes => On::Nodes,
            Place::Elements => On::Elements,
        };
        let unit = variable.unit();
        let select = variable.components().get(component).map(|name| {
            let axis = variable.axis_of_components();
            format!("{axis}=\"{}\"", name.trim_start_matches('e'))
        });
        let (stored, figure) = (Some((variable.name(), select)), figure_of(key));
        let window = if variable.is_of_window() { window } else { 0 };
        let layer = Layer { key, label, unit, on, sigma: place(sigma), palette, choice: true, window, figure, stored };
        (layer, Source::Store(variable, component))
    };
    let mut sources: Vec<_> = rows.iter().map(layer).collect();
    if has_model {
        of_model(&mut sources);
    }
    sources
}

/// What `quadrille figures --quantity` draws the same numbers for.
fn figure_of(key: &str) -> Option<&'static str> {
    Some(match key {
        "ux" => "ux",
        "uy" => "uy",
        "exx" => "exx --strain-on nodes",
        "eyy" => "eyy --strain-on nodes",
        "exy" => "exy --strain-on nodes",
        "wxx" => "exx-window",
        "wyy" => "eyy-window",
        "wxy" => "exy-window",
        "residual" => "residual",
        "misfit" => "misfit",
        _ => return None,
    })
}

/// The numbers of a frame, of each quantity a list.
fn numbers_of(store: &Store, number: usize, sources: &[(Layer, Source)], model: Option<&Off>) -> Result<Vec<Vec<f64>>> {
    let mut read: Vec<(Variable, Vec<f64>)> = Vec::new();
    let mut lists = Vec::with_capacity(sources.len());
    for &(_, source) in sources {
        let (variable, component) = match source {
            Source::Store(variable, component) => (variable, component),
            Source::Model(component) => {
                let off = model.and_then(|model| model.get(&number));
                let none = || vec![f64::NAN; store.mesh().n_nodes()];
                let of_node = |&[x, y]: &[f64; 2]| if component == 0 { x } else { y };
                lists.push(off.map_or_else(none, |off| off.iter().map(of_node).collect()));
                continue;
            }
        };
        if read.iter().all(|(there, _)| *there != variable) {
            let values = match store.values(number, variable)? {
                Some(Values::F64(values)) => values,
                Some(Values::F32(values)) => values.into_iter().map(f64::from).collect(),
                Some(Values::U32(values)) => values.into_iter().map(f64::from).collect(),
                Some(Values::U8(values)) => values.into_iter().map(f64::from).collect(),
                None => Vec::new(),
            };
            read.push((variable, values));
        }
        let values = read.iter().find(|(there, _)| *there == variable).map_or(&[][..], |(_, values)| values);
        lists.push(values.iter().skip(component).step_by(variable.n_components()).copied().collect());
    }
    Ok(lists)
}

/// The number of every listed frame, and its times and loads where tables of the run have them.
fn columns(folder: &Path, listed: &[Listed]) -> Vec<Column> {
    let values = listed.iter().map(|&(number, _)| number as f64).collect();
    let mut columns = vec![Column { label: "frame".into(), values }];
    let tables = QUANTITY_TABLES.map(|name| folder.join("quantities").join(format!("{name}.csv")));
    let Some(path) = tables.iter().find(|path| path.is_file()) else { return columns };
    columns.extend(of_load(path, listed).unwrap_or_default());
    columns
}

/// The columns of the load file in a table of quantities.
fn of_load(path: &PathBuf, listed: &[Listed]) -> Option<Vec<Column>> {
    let mut table = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(path).ok()?;
    let names: Vec<String> = table.headers().ok()?.iter().map(str::to_owned).collect();
    let begins =
        |name: &str| ["time", "load", "force", "stress"].iter().any(|word| name.to_lowercase().starts_with(word));
    let column = |label| Column { label, values: vec![f64::NAN; listed.len()] };
    let (places, mut columns): (Vec<usize>, Vec<Column>) =
        names.into_iter().enumerate().filter(|(_, name)| begins(name)).map(|(k, name)| (k, column(name))).unzip();
    for row in table.records().filter_map(std::result::Result::ok) {
        let number = row.get(0).and_then(|text| text.parse::<usize>().ok())?;
        let Ok(at) = listed.binary_search_by_key(&number, |&(number, _)| number) else { continue };
        for (column, &k) in columns.iter_mut().zip(&places) {
            let value = row.get(k).and_then(|text| text.parse().ok());
            if let Some((place, value)) = column.values.get_mut(at).zip(value) {
                *place = value;
            }
        }
    }
    Some(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_thinned_evenly_and_the_first_and_the_last_stay() {
        let numbers: Vec<usize> = (1..=1000).collect();
        let some = thin(&numbers, 100);
        assert_eq!((some.len(), some[0], some[99]), (100, 1, 1000));
        assert!(some.windows(2).all(|pair| (10..=11).contains(&(pair[1] - pair[0]))), "{some:?}");
        assert_eq!((thin(&numbers, 1), thin(&numbers, 0)), (vec![1000], vec![]));
        assert_eq!(thin(&numbers[..3], 100), [1, 2, 3]);
    }
}
