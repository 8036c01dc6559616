//! `quadrille view`.

use super::args::ViewArgs;
use super::figures::reference;
use super::metrology::METROLOGY;
use super::{Outcome, Result, chain, plural, pool};
use crate::field::Status;
use crate::io::arrays::Values;
use crate::io::quantities::QUANTITY_TABLES;
use crate::io::store::{Place, Store, Variable};
use crate::report::view::{Column, Layer, On, Packed, View, ViewFrame};
use crate::report::{Backdrop, Palette};
use crate::run::{FitOfRun, Record, RunFolder, correlation_in, model_less_measured};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the page in the folder of the run.
const PAGE: &str = "view.html";
/// What a page has beside its frames, bytes: pictures, script, palettes.
const REST: usize = 2_000_000;

/// A page that is made.
pub(super) struct Made {
    /// The page.
    pub html: String,
    /// Frames in it, and those with a field.
    n_shown: usize,
    n_with: usize,
    /// Frames that were asked for and have no field.
    n_without: usize,
}

/// Runs the command.
pub(super) fn run(args: &ViewArgs) -> Result<Outcome> {
    let path = args.output.clone().unwrap_or_else(|| args.run.join(PAGE));
    let write = |html: &str| -> Result<()> {
        Ok(std::fs::write(&path, html).map_err(|error| format!("{}: cannot be written: {error}", path.display()))?)
    };
    if args.run.join(METROLOGY).is_file() && Store::open(fields_in(&args.run)).is_err() {
        // One page is all there is to see of it, and was made with it.
        let made = args.run.join(RunFolder::REPORT);
        let html = std::fs::read_to_string(&made).map_err(|error| {
            format!("{}: cannot be read: {error}; `quadrille metrology --output` makes it again", made.display())
        })?;
        write(&html)?;
        if !args.talk.quiet {
            eprintln!("{}: what the images can measure: open it in a browser", path.display());
        }
        return Ok(Outcome::Fine);
    }
    let Made { html, n_shown, n_with, n_without } = made(args)?;
    write(&html)?;
    if !args.talk.quiet {
        let left =
            if n_shown < n_with { format!(" of {n_with}, evenly spaced (--max-mb for more)") } else { String::new() };
        let mb = html.len() as f64 / 1e6;
        eprintln!("{} with {}{left}, {mb:.1} MB: open it in a browser", path.display(), plural(n_shown, "frame"));
    }
    let complete = n_without == 0 || !args.frames.are_named();
    Ok(if complete { Outcome::Fine } else { Outcome::Incomplete })
}

/// The folder of the fields of a run: its own, or that of the correlation in it.
fn fields_in(run: &Path) -> PathBuf {
    let inner = correlation_in(run);
    if inner.is_dir() { inner } else { run.to_owned() }
}

/// The page that the arguments ask for.
pub(super) fn made(args: &ViewArgs) -> Result<Made> {
    let folder = fields_in(&args.run);
    let store = Store::open(&folder)?;
    let (numbers, n_without) = args.frames.with_field(&store, args.talk.quiet)?;
    if numbers.is_empty() {
        let path = store.path().display();
        return Err(format!("{path}: no frame asked for has a field; `quadrille status` says why").into());
    }
    let mut sources = sources(&store);
    // What is wrong with the files of a fit keeps no field from being looked at.
    let (fit, model) = (FitOfRun::read(&args.run), model_less_measured(&args.run));
    let faults: Vec<String> =
        [fit.as_ref().err(), model.as_ref().err()].into_iter().flatten().map(|e| chain(e)).collect();
    let (fit, model) = (fit.ok().flatten(), model.ok().flatten());
    if model.is_some() {
        of_model(&mut sources);
    }
    let pool = pool(args.threads.threads)?;
    let packed = |number: usize| -> Result<Packed> { Ok(Packed::new(&numbers_of(&store, number, &sources, &model)?)) };
    let pack = |numbers: &[usize]| -> Result<BTreeMap<usize, Packed>> {
        let one = |&number: &usize| Ok((number, packed(number)?));
        pool.install(|| numbers.par_iter().map(one).collect::<Result<_>>())
    };
    let room = ((args.max_mb * 1e6) as usize).saturating_sub(REST);
    let chosen = thinned(&numbers, room / packed(numbers[numbers.len() - 1])?.size().max(1));
    let mut shown = pack(&chosen)?;
    let about = AboutRun { folder: &folder, n_with: numbers.len(), fit: fit.as_ref(), faults };
    let html = page(&store, &about, args, &sources, &mut shown);
    Ok(Made { html, n_shown: chosen.len(), n_with: numbers.len(), n_without })
}

/// As many of `numbers` as there is room for, evenly, the first and the last among them.
fn thinned(numbers: &[usize], room: usize) -> Vec<usize> {
    let (n, room) = (numbers.len(), room.max(1));
    if room >= n {
        return numbers.to_vec();
    }
    if room == 1 {
        return numbers[n - 1..].to_vec();
    }
    (0..room).map(|k| numbers[k * (n - 1) / (room - 1)]).collect()
}

/// Where the numbers of a quantity come from.
#[derive(Debug, Clone, Copy)]
enum Source {
    /// A component of what the store has.
    Store(Variable, usize),
    /// A component of what the model of the joint is off by.
    Model(usize),
}

/// What the model of the joint is off by, px, by the number of the frame.
type ModelLess = Option<BTreeMap<usize, Vec<[f64; 2]>>>;

/// Its quantities, with the standard uncertainty of what was measured.
fn of_model(sources: &mut Vec<(Layer, Source)>) {
    let sigma = |sources: &[(Layer, Source)], key: &str| sources.iter().position(|(layer, _)| layer.key == key);
    for (component, (key, name, of)) in [("mx", "u_x", "sx"), ("my", "u_y", "sy")].into_iter().enumerate() {
        let label = format!("{name} of the model less that measured");
        let sigma = sigma(sources, of);
        let layer = Layer { key, label, unit: "px", on: On::Nodes, sigma, palette: Palette::BlueRed, choice: true };
        sources.push((layer, Source::Model(component)));
    }
}

/// The quantities of the page, each with its place in the store.
fn sources(store: &Store) -> Vec<(Layer, Source)> {
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
    let of_window = |k: usize| ["wxx", "wyy", "wxy"][k];
    let sigma_of_window = |k: usize| ["swxx", "swyy", "swxy"][k];
    for (k, name) in strain.into_iter().enumerate() {
        rows.push((of_window(k), name, Variable::StrainWindow, k, Some(sigma_of_window(k)), Palette::BlueRed));
    }
    rows.extend([
        ("residual", "residual", Variable::Residual, 0, None, Palette::Plasma),
        ("misfit", "misfit", Variable::Misfit, 0, None, Palette::Plasma),
        ("sx", "standard uncertainty of u_x", sigma, 0, None, Palette::Viridis),
        ("sy", "standard uncertainty of u_y", sigma, 1, None, Palette::Viridis),
        ("ex", "model error of u_x", Variable::ModelError, 0, None, Palette::Viridis),
        ("ey", "model error of u_y", Variable::ModelError, 1, None, Palette::Viridis),
    ]);
    for (k, name) in strain.into_iter().enumerate() {
        rows.push((sigma_of_window(k), name, Variable::SigmaStrainWindow, k, None, Palette::Viridis));
    }
    rows.push(("mark", "what is the matter", Variable::Mark, 0, None, Palette::Plasma));
    rows.retain(|row| store.has(row.2));
    let place = |key: Option<&str>| rows.iter().position(|row| Some(row.0) == key);
    let layer = |&(key, name, variable, component, sigma, palette): &Row| {
        let label = match variable {
            Variable::StrainNode => format!("strain {name} at nodes"),
            Variable::StrainWindow => format!("strain {name} over {window} x {window} nodes"),
            Variable::SigmaStrainWindow => format!("standard uncertainty of strain {name}"),
            _ => name.to_owned(),
        };
        let on = match variable.place() {
            Place::Nodes => On::Nodes,
            Place::Elements => On::Elements,
        };
        let unit = variable.unit();
        let layer = Layer { key, label, unit, on, sigma: place(sigma), palette, choice: true };
        (layer, Source::Store(variable, component))
    };
    rows.iter().map(layer).collect()
}

/// The numbers of a frame, of each quantity a list.
fn numbers_of(store: &Store, number: usize, sources: &[(Layer, Source)], model: &ModelLess) -> Result<Vec<Vec<f64>>> {
    let mut read: Vec<(Variable, Vec<f64>)> = Vec::new();
    let mut lists = Vec::with_capacity(sources.len());
    for &(_, source) in sources {
        let (variable, component) = match source {
            Source::Store(variable, component) => (variable, component),
            Source::Model(component) => {
                let off = model.as_ref().and_then(|model| model.get(&number));
                let none = || vec![f64::NAN; store.mesh().n_nodes()];
                lists.push(off.map_or_else(none, |off| off.iter().map(|off| off[component]).collect()));
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

/// What is known of the run beside its store.
struct AboutRun<'a> {
    folder: &'a Path,
    /// Frames with a field.
    n_with: usize,
    fit: Option<&'a FitOfRun>,
    /// Why there is no fit, where there should be.
    faults: Vec<String>,
}

fn page(
    store: &Store,
    about_run: &AboutRun<'_>,
    args: &ViewArgs,
    sources: &[(Layer, Source)],
    shown: &mut BTreeMap<usize, Packed>,
) -> String {
    let header = store.header();
    let AboutRun { folder, n_with, fit, faults } = about_run;
    let mut lead: Vec<(String, bool)> = faults.iter().map(|fault| (fault.clone(), true)).collect();
    let statuses: Vec<Option<Status>> = (1..=store.n_frames()).map(|n| store.status(n).ok().flatten()).collect();
    let count = |status: Status| statuses.iter().filter(|&&s| s == Some(status)).count();
    let mut counts: Vec<String> = Status::ALL
        .into_iter()
        .map(|status| (count(status), status.name().replace('_', " ")))
        .filter(|(n, _)| *n > 0)
        .map(|(n, name)| format!("{n} {name}"))
        .collect();
    let not_done = statuses.iter().filter(|s| s.is_none()).count();
    counts.extend((not_done > 0).then(|| format!("{not_done} not done")));
    let fine = count(Status::Converged) == statuses.len();
    lead.push((format!("{}: {}.", plural(statuses.len(), "frame"), counts.join(", ")), !fine));
    if shown.len() < *n_with {
        let text = format!(
            "{} of {n_with} frames with a field are in this page, evenly spaced, to keep it below {} MB; `quadrille view --max-mb` or \
             --frames has others.",
            shown.len(),
            args.max_mb
        );
        lead.push((text, true));
    }
    let backdrop = match reference(header, Record::of(header).page()) {
        Ok(image) => Backdrop::new(&image, 1),
        Err(why) => {
            lead.push((format!("{why}; the fields are drawn on white."), true));
            Backdrop::blank(header.image_size_px[0], header.image_size_px[1], 1)
        }
    };
    let name = |path: &str| Path::new(path).file_name().map_or(path.to_owned(), |n| n.to_string_lossy().into_owned());
    let frame = |(k, file): (usize, &String)| ViewFrame {
        number: k + 1,
        file: name(file),
        status: statuses[k],
        packed: shown.remove(&(k + 1)),
    };
    let frames: Vec<ViewFrame> = header.frames.iter().enumerate().map(frame).collect();
    let mut about: Vec<(String, String)> = header
        .about()
        .into_iter()
        .map(|line| line.split_once(": ").map_or((String::new(), line.clone()), |(a, b)| (a.to_owned(), b.to_owned())))
        .collect();
    about.push((
        "this page".into(),
        "numbers are rounded to 1/65534 of the range of their quantity in the frame; between nodes they are interpolated as the elements \
         do; a gauge is the difference of two displacements. `quadrille export` and `probe` have all digits"
            .into(),
    ));
    let layers: Vec<Layer> = sources.iter().map(|(layer, ..)| layer.clone()).collect();
    View {
        title: format!("Fields of {}", args.run.display()),
        subtitle: format!(
            "reference {}; quadrille {}; px of the reference image, x to the right, y down",
            header.reference.first().map(|path| name(path)).unwrap_or_default(),
            header.quadrille
        ),
        lead,
        backdrop: &backdrop,
        mm_per_px: header.pixel_size.map(|scale| scale.mm_per_px()),
        mesh: &header.mesh,
        layers: &layers,
        columns: columns(folder, frames.len()),
        frames,
        about,
        law: fit.map(FitOfRun::view),
    }
    .html()
}

/// The number of every frame, and its times and loads where tables of the run have them.
fn columns(folder: &Path, n_frames: usize) -> Vec<Column> {
    let mut columns =
        vec![Column { label: "frame".into(), values: (1..=n_frames).map(|number| number as f64).collect() }];
    let tables = QUANTITY_TABLES.map(|name| folder.join("quantities").join(format!("{name}.csv")));
    let Some(path) = tables.iter().find(|path| path.is_file()) else { return columns };
    columns.extend(of_load(path, n_frames).unwrap_or_default());
    columns
}

/// The columns of the load file in a table of quantities.
fn of_load(path: &PathBuf, n_frames: usize) -> Option<Vec<Column>> {
    let mut table = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(path).ok()?;
    let names: Vec<String> = table.headers().ok()?.iter().map(str::to_owned).collect();
    let begins =
        |name: &str| ["time", "load", "force", "stress"].iter().any(|word| name.to_lowercase().starts_with(word));
    let places: Vec<usize> = (0..names.len()).filter(|&k| begins(&names[k])).collect();
    let mut columns: Vec<Column> =
        places.iter().map(|&k| Column { label: names[k].clone(), values: vec![f64::NAN; n_frames] }).collect();
    for row in table.records().filter_map(std::result::Result::ok) {
        let number = row.get(0).and_then(|text| text.parse::<usize>().ok()).filter(|n| (1..=n_frames).contains(n))?;
        for (column, &k) in columns.iter_mut().zip(&places) {
            column.values[number - 1] = row.get(k).and_then(|text| text.parse().ok()).unwrap_or(f64::NAN);
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
        let some = thinned(&numbers, 100);
        assert_eq!((some.len(), some[0], some[99]), (100, 1, 1000));
        assert!(some.windows(2).all(|pair| (10..=11).contains(&(pair[1] - pair[0]))), "{some:?}");
        assert_eq!(thinned(&numbers, 0), [1000]);
        assert_eq!(thinned(&numbers[..3], 100), [1, 2, 3]);
    }
}
