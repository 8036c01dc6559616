//! A reduced test: the record, its tables, its figures and its page.

use super::lap::LapRecord;
use super::page::{Block, Page, Section};
use super::with_std::WithStd;
use super::words::significant;
use super::{Axis, Picture, Plot, PlotSeries, ReportError, Style, to_strings, version};
use crate::field::Value;
use crate::io::joint::write_table;
use crate::mechanics::cohesive::CohesiveLaw;
use crate::reduction::{Instant, Layout, Mode, Reduction, Specimen, Traction};
use crate::remark::Remark;
use serde::Serialize;
use std::io::{self, Write};

/// `reduction.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReductionRecord {
    /// Version of the program.
    pub quadrille: &'static str,
    /// The case file.
    pub case: String,
    /// The test.
    pub layout: &'static str,
    /// Compliance before anything grows, mm/N, and slack, mm.
    #[serde(rename = "initial_compliance_mm_per_N")]
    pub initial_compliance_mm_per_n: Option<f64>,
    /// See there.
    pub slack_mm: Option<f64>,
    /// Frame, with its fraction, at which growth begins by each definition.
    pub growth_begins_at_frame: Vec<(String, f64)>,
    /// The results, in the order of the report.
    pub results: Vec<ResultRecord>,
    /// What each method fitted.
    pub notes: Vec<(String, String)>,
    /// Methods that cannot be used, and what they lack.
    pub missing: Vec<(String, String)>,
    /// What is to be looked at.
    pub remarks: Vec<Remark>,
    /// The traction over the separation: of a mixed test along both jumps, then of opening and sliding alone.
    pub tractions: Vec<Traction>,
    /// What standards ask of a test: the condition, what was found, and whether it holds.
    pub checks: Vec<(&'static str, String, bool)>,
    /// Why there is none.
    pub no_traction: Option<&'static str>,
    #[serde(skip)]
    found: Reduction,
    #[serde(skip)]
    specimen: Specimen,
}

/// A result, what is known of it, and what each constant does to it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResultRecord {
    /// What, with its unit.
    pub name: String,
    /// Its value; the standard uncertainty is that of images, loads and constants.
    #[serde(flatten)]
    pub value: WithStd,
    /// By images and loads alone.
    pub std_measured: f64,
    /// Its change by one standard uncertainty of each constant.
    pub by_constant: Vec<(&'static str, f64)>,
}

/// Name of the table and of the figure of the traction at this place of the list.
fn name_of(place: usize, mode: Mode) -> &'static str {
    match mode {
        _ if place == 0 => "traction",
        Mode::Sliding => "traction-sliding",
        _ => "traction-opening",
    }
}

/// A traction as far as the test went, with the law that was fitted where there is one.
fn traction_plot(Traction { method, mode, curve, .. }: &Traction, title: &str, fitted: Option<Vec<f64>>) -> Plot {
    let shown = curve.traction_mpa.iter().zip(&curve.visited).map(|(t, seen)| if *seen { *t } else { f64::NAN });
    let [over, traction] = mode.names();
    let slope = PlotSeries::new(method.name(), Style::Line, curve.separation_mm.clone(), shown.collect());
    let fitted = fitted.map(|fitted| PlotSeries::new("fitted law", Style::Line, curve.separation_mm.clone(), fitted));
    let all: Vec<PlotSeries> = std::iter::once(slope.with_band(curve.half_of_all_mpa.clone())).chain(fitted).collect();
    Plot::new(title, format!("{over} at the initial tip (mm)"), Axis::linear(format!("{traction} (MPa)")), all)
}

/// The plot of a traction beside the fitted law.
pub(crate) fn direct_plot(direct: &Traction, law: &dyn CohesiveLaw) -> Plot {
    traction_plot(direct, "The fitted law beside the slope of J", Some(direct.of_law(law)))
}

impl ReductionRecord {
    /// That of `found` for the `specimen` of the file `case`.
    pub fn new(case: String, specimen: &Specimen, found: Reduction) -> Self {
        let result = |(name, value): (String, Value)| {
            let of_line = |line: &crate::reduction::BudgetLine| {
                let change = line.changes.iter().find(|(other, _)| *other == name)?.1;
                Some((line.name, change))
            };
            let by_constant: Vec<(&'static str, f64)> = found.budget.iter().filter_map(of_line).collect();
            let variance = value.sigma.powi(2) + by_constant.iter().map(|(_, by)| by * by).sum::<f64>();
            let all = Value { value: value.value, sigma: variance.sqrt() };
            ResultRecord { name, value: all.into(), std_measured: value.sigma, by_constant }
        };
        let frame = |place: f64| {
            let at = |k: usize| found.instants.get(k).map(|instant| instant.frame as f64);
            let here = at(place as usize)?;
            Some(here + place.fract() * (at(place as usize + 1).unwrap_or(here) - here))
        };
        let noted = found.methods.iter().filter(|result| !result.note.is_empty());
        Self {
            quadrille: env!("CARGO_PKG_VERSION"),
            case,
            layout: specimen.layout.name(),
            initial_compliance_mm_per_n: found.line.map(|line| line.compliance_mm_per_n),
            slack_mm: found.line.map(|line| line.slack_mm),
            growth_begins_at_frame: (found.begins.iter())
                .filter_map(|(definition, place)| Some((definition.name().to_owned(), frame(*place)?)))
                .collect(),
            results: found.numbers().into_iter().map(result).collect(),
            notes: noted.map(|result| (result.method.name().to_owned(), result.note.clone())).collect(),
            missing: found.missing.iter().map(|(method, lacks)| (method.name().to_owned(), lacks.clone())).collect(),
            remarks: found.remarks.clone(),
            tractions: found.tractions.clone(),
            checks: found.checks.iter().map(|check| (check.what, check.found.clone(), check.holds)).collect(),
            no_traction: found.no_traction,
            specimen: *specimen,
            found,
        }
    }

    /// Writes `reduction.csv`: a row for each instant; a cell is empty where nothing is known.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_instants<W: Write>(&self, out: W) -> io::Result<()> {
        let mut columns =
            to_strings(&["frame", "load_N", "displacement_mm", "rotation_1", "opening_mm", "sliding_mm", "crack_mm"]);
        columns = columns.into_iter().flat_map(|name| with_sigma(name.clone(), name != "frame")).collect();
        columns.push("other_end_mm".to_owned());
        for result in &self.found.methods {
            let name = result.method.name();
            columns.extend(with_sigma(format!("{name}_N_per_mm"), true));
            columns.extend([format!("{name}_crack_mm"), format!("{name}_sliding_share_1")]);
        }
        let pair = |value: Option<Value>| value.map_or([f64::NAN; 2], |value| [value.value, value.sigma]);
        let row = |(k, instant): (usize, &Instant)| {
            let Instant { load_n, displacement_mm, rotation, opening_mm, sliding_mm, other_end_mm, crack_mm, .. } =
                *instant;
            let measured = [Some(load_n), displacement_mm, rotation, opening_mm, sliding_mm, crack_mm];
            let mut values: Vec<f64> = measured.into_iter().flat_map(pair).collect();
            values.push(other_end_mm.unwrap_or(f64::NAN));
            for result in &self.found.methods {
                values.extend(pair(result.release[k]));
                values.extend([result.crack_mm[k], result.sliding_share[k]].map(|of| of.unwrap_or(f64::NAN)));
            }
            (vec![instant.frame as u64], values)
        };
        let about = "energy release rates in N/mm; sigma by images and loads; docs/reduction.md".to_owned();
        write_table(out, &[version(), about], &columns, self.found.instants.iter().enumerate().map(row))
    }

    /// Names of the tables of its tractions.
    pub fn tables(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.tractions.iter().enumerate().map(|(place, traction)| name_of(place, traction.mode))
    }

    /// Writes the traction at this place of the list as a table.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_traction<W: Write>(&self, place: usize, out: W) -> io::Result<()> {
        let Some(Traction { method, mode, curve, .. }) = self.tractions.get(place) else { return Ok(()) };
        let (of, over) = (method.name(), mode.names()[0]);
        let columns = to_strings(&["visited", "separation_mm", "traction_MPa", "std_MPa", "half_of_all_MPa"]);
        let row = |k: usize| {
            let values =
                [&curve.separation_mm, &curve.traction_mpa, &curve.std_mpa, &curve.half_of_all_mpa].map(|of| of[k]);
            (vec![u64::from(curve.visited[k])], values.to_vec())
        };
        let about = format!("slope of {of} over the {over} at the initial tip; bands: 95 %, at all places together");
        write_table(out, &[version(), about], &columns, (0..curve.separation_mm.len()).map(row))
    }

    /// Draws every figure, each with its name.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn draw(&self) -> Result<Vec<(&'static str, Picture)>, ReportError> {
        self.plots().into_iter().map(|(name, plot, _)| Ok((name, plot.draw()?))).collect()
    }

    /// The figures, each with its name and its caption.
    fn plots(&self) -> Vec<(&'static str, Plot, String)> {
        let Reduction { instants, methods, .. } = &self.found;
        let mode = Mode::of(self.specimen.layout);
        let mut plots = Vec::new();
        let points = |x: &dyn Fn(usize) -> Option<f64>, y: &dyn Fn(usize) -> Option<Value>| {
            let all: Vec<(f64, Value)> = (0..instants.len()).filter_map(|k| Some((x(k)?, y(k)?))).collect();
            (all.len() > 1).then(|| {
                let band = all.iter().map(|(_, value)| 1.96 * value.sigma).collect();
                let (x, y) = all.iter().map(|(x, value)| (*x, value.value)).unzip();
                PlotSeries::new("", Style::LineAndMarkers, x, y).with_band(band)
            })
        };
        let named = |series: PlotSeries, name: &str| PlotSeries { name: name.to_owned(), ..series };
        let displacement = |k: usize| Some(instants[k].displacement_mm?.value);
        if let Some(series) = points(&displacement, &|k| Some(instants[k].load_n)) {
            let mut all = vec![named(series, "measured")];
            if let Some(line) = &self.found.line {
                let most = instants.iter().map(|instant| instant.load_n.value).fold(0.0, f64::max);
                let y = vec![0.0, most];
                for (factor, name) in [(1.0, "initial compliance"), (1.05, "5 % more")] {
                    let x = y.iter().map(|load| line.slack_mm + factor * line.compliance_mm_per_n * load).collect();
                    all.push(PlotSeries::new(name, Style::Line, x, y.clone()));
                }
            }
            let plot = Plot::new("Load over displacement", "displacement of the load (mm)", "load (N)", all);
            plots.push(("load-displacement", plot, "Load over the displacement that it does work with".to_owned()));
        }
        let jump = |k: usize| Some(instants[k].jump(mode)?.value);
        let over_jump: Vec<PlotSeries> = (methods.iter())
            .filter_map(|result| Some(named(points(&jump, &|k| result.release[k])?, result.method.name())))
            .collect();
        let over = mode.names()[0];
        if !over_jump.is_empty() {
            let label = format!("{over} at the initial tip (mm)");
            let plot = Plot::new("Energy release rate over separation", label, "energy release rate (N/mm)", over_jump);
            plots.push(("release-separation", plot, "Bands: 95 %, images and loads".to_owned()));
        }
        let resistance: Vec<PlotSeries> = (methods.iter())
            .filter_map(|result| {
                Some(named(points(&|k| result.crack_mm[k], &|k| result.release[k])?, result.method.name()))
            })
            .collect();
        if !resistance.is_empty() {
            let plot =
                Plot::new("Resistance curve", "length of the crack (mm)", "energy release rate (N/mm)", resistance);
            let caption = "Each method over its own crack: measured, or that of a beam of the same compliance";
            plots.push(("resistance", plot, caption.to_owned()));
        }
        if mode == Mode::Path {
            let sliding = |k: usize| instants[k].sliding_mm;
            let path = points(&|k| Some(instants[k].opening_mm?.value), &sliding);
            let series = path.map(|path| named(path, "measured"));
            plots.extend(series.map(|series| {
                let plot = Plot::new("Path of the tip", "opening (mm)", "sliding (mm)", vec![series]);
                ("path", plot, "Where it is straight, the traction along both is that of one mix of modes".to_owned())
            }));
        }
        for (place, traction) in self.tractions.iter().enumerate() {
            let caption = match place {
                0 => "The slope of J; band: 95 %, at all places together, of a smooth law: corners are rounded",
                _ => "The slope of the share that beam theory gives this mode; band: 95 %, at all places together",
            };
            let plot = traction_plot(traction, "Traction over separation", None);
            plots.push((name_of(place, traction.mode), plot, caption.to_owned()));
        }
        plots
    }

    /// The page.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn page(&self) -> Result<Page, ReportError> {
        let mut blocks: Vec<Block> = self.remarks.iter().map(Block::of_remark).collect();
        let rows = self.results.iter().map(|result| {
            let largest = result.by_constant.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            let largest = largest.filter(|(_, by)| *by != 0.0);
            let largest = largest.map_or("-".to_owned(), |(name, by)| format!("{name}: {}", significant(*by, 2)));
            vec![result.name.clone(), result.value.in_words(), significant(result.std_measured, 2), largest]
        });
        let columns = ["result", "value \u{b1} standard uncertainty", "of images and loads", "largest constant"];
        blocks.push(Block::table(&columns, rows));
        blocks.extend(self.no_traction.map(|why| Block::text(format!("There is no traction: {why}."))));
        let methods = self.found.methods.iter().map(|result| {
            let note = if result.note.is_empty() { "-".to_owned() } else { result.note.clone() };
            vec![result.method.name().to_owned(), result.method.in_words().to_owned(), note]
        });
        let lacking = self.found.missing.iter().map(|(method, lacks)| {
            vec![method.name().to_owned(), method.in_words().to_owned(), format!("not used: {lacks}")]
        });
        let methods = Block::table(&["method", "what it is", "what was fitted for it"], methods.chain(lacking));
        let checks = self.checks.iter().map(|(what, found, holds)| {
            vec![(*what).to_owned(), found.clone(), if *holds { "holds" } else { "does not hold" }.to_owned()]
        });
        let checks = Block::table(&["condition", "found", ""], checks);
        let figures = self.plots().into_iter().map(|(_, plot, caption)| Block::curves(&plot, caption));
        Ok(Page {
            title: format!("{} test, reduced", title(self.specimen.layout)),
            subtitle: format!("quadrille {}, {}", self.quadrille, self.case),
            sections: vec![
                Section { title: "Result".into(), blocks },
                Section { title: "Curves".into(), blocks: vec![Block::Grid(figures.collect::<Result<_, _>>()?)] },
                Section {
                    title: "Methods".into(),
                    blocks: if self.checks.is_empty() { vec![methods] } else { vec![methods, checks] },
                },
                Section { title: "Specimen".into(), blocks: vec![Block::Facts(self.facts())] },
            ],
        })
    }

    /// The section of the report of a run: the results, and the traction beside the fitted `law`.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub(crate) fn section(&self, law: Option<&dyn CohesiveLaw>) -> Result<Section, ReportError> {
        let rows = self.results.iter().map(|result| vec![result.name.clone(), result.value.in_words()]);
        let results = Block::table(&["result", "value \u{b1} standard uncertainty"], rows);
        let mut figures = Vec::new();
        if let (Some(direct), Some(law)) = (self.tractions.first(), law) {
            let caption = "Band of the slope: 95 %, at all places together";
            figures.push(Block::curves(&direct_plot(direct, law), caption.to_owned())?);
        }
        for (_, plot, caption) in self.plots() {
            figures.push(Block::curves(&plot, caption)?);
        }
        let more = "The same test without a model, by quadrille reduce; its own report is in the folder reduction.";
        let mut blocks: Vec<Block> = vec![Block::text(more)];
        blocks.extend(self.remarks.iter().map(Block::of_remark));
        blocks.extend([results, Block::Grid(figures)]);
        Ok(Section { title: "Directly from images and loads".into(), blocks })
    }

    /// What the report of a standard asks of the specimen.
    fn facts(&self) -> Vec<(String, String)> {
        let Specimen { width_mm, arm_mm, crack_mm, end_block_mm, half_span_mm, lever_mm, young_mpa, shear_mpa, .. } =
            self.specimen;
        let [pin, half] = end_block_mm;
        let blocks = format!(
            "{} from pin to the middle of the arm, {} long, taken as exact",
            significant(pin, 4),
            significant(2.0 * half, 4)
        );
        let stated = |value: Value| match value.sigma > 0.0 {
            true => format!("{} \u{b1} {}", significant(value.value, 6), significant(value.sigma, 2)),
            false => format!("{}, taken as exact", significant(value.value, 6)),
        };
        let exact = |value: f64| format!("{}, taken as exact", significant(value, 6));
        let begins = self.growth_begins_at_frame.iter().map(|(name, frame)| format!("{name}: {frame:.1}"));
        let begins: Vec<String> = begins.collect();
        let list = [
            ("width (mm)", Some(stated(width_mm))),
            ("thickness of an arm (mm)", arm_mm.map(stated)),
            ("initial crack from the line of load (mm)", crack_mm.map(stated)),
            ("end blocks (mm)", (end_block_mm != [0.0; 2]).then_some(blocks)),
            ("half span (mm)", half_span_mm.map(exact)),
            ("lever (mm)", lever_mm.map(exact)),
            ("Young's modulus (MPa)", young_mpa.map(stated)),
            ("shear modulus (MPa)", Some(shear_mpa.map_or("none: arms do not shear".to_owned(), exact))),
            ("initial compliance (mm/N)", self.initial_compliance_mm_per_n.map(|c| significant(c, 4))),
            ("slack taken off (mm)", self.slack_mm.map(|slack| significant(slack, 3))),
            ("frames at which growth begins", (!begins.is_empty()).then(|| begins.join(", "))),
        ];
        list.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect()
    }

    /// One line for each result, for the terminal.
    pub fn lines(&self) -> Vec<String> {
        self.results.iter().map(|result| format!("{}: {}", result.name, result.value.in_words())).collect()
    }
}

fn with_sigma(name: String, wanted: bool) -> Vec<String> {
    let sigma = wanted.then(|| format!("sigma_{name}"));
    std::iter::once(name).chain(sigma).collect()
}

fn title(layout: Layout) -> &'static str {
    match layout {
        Layout::Dcb => "Double cantilever beam",
        Layout::Enf => "End-notched flexure",
        Layout::Mmb => "Mixed-mode bending",
        Layout::Slb => "Single-leg bending",
        Layout::Peel => "Peel",
        Layout::Lap => "Lap joint",
    }
}

/// A reduced test, of loads and rotations or of strains along a lap.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
#[expect(clippy::large_enum_variant, reason = "there is one of them")]
pub enum ReducedTest {
    /// J, methods of the standards, tractions.
    Loads(ReductionRecord),
    /// The shear traction along a lap.
    Lap(LapRecord),
}

impl ReducedTest {
    /// What is to be looked at.
    pub fn remarks(&self) -> &[Remark] {
        match self {
            Self::Loads(record) => &record.remarks,
            Self::Lap(record) => &record.remarks,
        }
    }

    /// Lines for the terminal: what is missing, and the results.
    pub fn lines(&self) -> Vec<String> {
        match self {
            Self::Loads(record) => {
                let missing = record.missing.iter().map(|(method, lacks)| format!("{method} is not used: {lacks}"));
                let no_traction = record.no_traction.iter().map(|why| format!("no traction: {why}"));
                missing.chain(no_traction).chain(record.lines()).collect()
            }
            Self::Lap(record) => record.lines(),
        }
    }

    /// The figures, each with its name.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn draw(&self) -> Result<Vec<(&'static str, Picture)>, ReportError> {
        match self {
            Self::Loads(record) => record.draw(),
            Self::Lap(record) => record.draw(),
        }
    }

    /// The page.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn page(&self) -> Result<Page, ReportError> {
        match self {
            Self::Loads(record) => record.page(),
            Self::Lap(record) => record.page(),
        }
    }

    /// The section of the report of a run, beside the fitted `law`.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub(crate) fn section(&self, law: Option<&dyn CohesiveLaw>) -> Result<Section, ReportError> {
        match self {
            Self::Loads(record) => record.section(law),
            Self::Lap(record) => {
                let blocks = record.page()?.sections.into_iter().flat_map(|section| section.blocks).collect();
                Ok(Section { title: "Directly from images and loads".into(), blocks })
            }
        }
    }

    /// Whether it has a traction that a fit can be compared with; of a lap each place has its own.
    pub(crate) fn has_traction(&self) -> bool {
        matches!(self, Self::Loads(record) if !record.tractions.is_empty())
    }
}
