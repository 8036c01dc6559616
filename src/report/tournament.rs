//! What a comparison of laws gives people and programs: `tournament.json`, a table of tractions, figures, a page.

use super::fit::{law_rows, rows_of};
use super::law_plot::{MODES, law_series, mode_plot};
use super::page::{Block, Page, Section};
use super::words::{capital, plain, plain_or_dash, significant};
use super::{Name, Picture, Plot, PlotSeries, ReportError, Style, number, to_strings, version};
use crate::identify::{CurveBand, FittedParameter, LawFit, Score, Spread, Tournament};
use crate::io::joint::{JointFileError, write_table};
use crate::mechanics::cohesive::Jump;
use crate::remark::Remark;
use serde::{Deserialize, Serialize};
use std::io::{self, Write};
use std::path::Path;

/// What `tournament.json` holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TournamentRecord {
    /// Version of the program.
    pub quadrille: Name,
    /// The case file.
    pub case: String,
    /// Units and axes.
    pub units: Name,
    /// Time of all fits, s.
    pub seconds: f64,
    /// What was compared, in words.
    pub about: String,
    /// Numbers compared.
    pub data: usize,
    /// What it all comes to, a sentence each.
    pub sentences: Vec<String>,
    /// The law with the least Akaike criterion among those that are not rejected; among all where all are.
    pub best: Option<Name>,
    /// The laws that these data cannot tell from it, itself among them; empty when every law is rejected.
    pub alike: Vec<Name>,
    /// The laws, in the order that was asked for.
    pub laws: Vec<LawRecord>,
    /// What is asked for, averaged over the laws that are not rejected; null when all are.
    pub average: Option<AverageRecord>,
    /// What a user should look at.
    pub remarks: Vec<Remark>,
}

/// One law.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LawRecord {
    /// Its name.
    pub law: Name,
    /// Where its start comes from.
    pub start: String,
    /// `converged`, ... as of a fit; `failed` where there is none.
    pub status: Name,
    /// In words.
    pub reason: String,
    /// The verdict on its parameters: `determined`, `not determined`, `model rejected`; null without a fit.
    pub verdict: Option<Name>,
    /// Whether the misfit test rejects it.
    pub rejected: bool,
    /// Normal deviate of the misfit test.
    pub z: Option<f64>,
    /// The whitened residual.
    pub omega: Option<f64>,
    /// Akaike's criterion.
    pub aic: Option<f64>,
    /// Schwarz's criterion.
    pub bic: Option<f64>,
    /// How far omega lies above that of the best law.
    #[serde(default)]
    pub above_best: Option<f64>,
    /// How far noise alone puts it, in at most one of a hundred tests: up to there the two cannot be told apart.
    #[serde(default)]
    pub alike_within: Option<f64>,
    /// The whitened residual of the instants left out, each predicted by a fit to others.
    pub left_out_omega: Option<f64>,
    /// Weight in the average.
    #[serde(deserialize_with = "number")]
    pub weight: f64,
    /// Forward runs of the start that was taken.
    pub evaluations: usize,
    /// The parameters that were fitted.
    pub parameters: Vec<FittedRecord>,
    /// Those that were not: name and value.
    pub prescribed: Vec<(Name, f64)>,
    /// Work of separation in pure opening, N/mm.
    pub opening_work: Option<SpreadRecord>,
    /// Work of separation in pure sliding, N/mm.
    pub sliding_work: Option<SpreadRecord>,
    /// Work as far as the furthest pair went, N/mm.
    #[serde(default)]
    pub reached_work: Option<SpreadRecord>,
}

/// A parameter that was fitted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FittedRecord {
    /// Its symbol.
    pub name: Name,
    /// Its unit.
    pub unit: Name,
    /// Its value.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// Its standard uncertainty.
    pub std: Option<f64>,
    /// Ends of its 95 % interval.
    pub ends95: [Option<f64>; 2],
}

/// A value with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SpreadRecord {
    /// The value.
    #[serde(deserialize_with = "number")]
    pub value: f64,
    /// Its standard uncertainty.
    pub std: Option<f64>,
    /// Ends of its 95 % interval; null where it has none on that side.
    pub ends95: [Option<f64>; 2],
}

/// What is asked for, over all laws that are left; the tractions stand in `tournament-tractions.csv`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AverageRecord {
    /// Work of separation in pure opening, N/mm.
    pub opening_work: SpreadRecord,
    /// Work of separation in pure sliding, N/mm.
    pub sliding_work: SpreadRecord,
    /// Work as far as the furthest pair went, N/mm.
    #[serde(default)]
    pub reached_work: Option<SpreadRecord>,
}

impl From<&Spread> for SpreadRecord {
    fn from(spread: &Spread) -> Self {
        Self { value: spread.value, std: spread.std, ends95: spread.ends95 }
    }
}

impl LawRecord {
    fn of(law: &LawFit<'_>, best: Option<Score>) -> Self {
        let above = law.score.zip(best).map(|(score, best)| score.above(best));
        let fit = law.fit.as_ref();
        let (status, reason) = match &fit {
            Ok(fit) => (fit.status.name(), fit.reason.clone()),
            Err(reason) => ("failed", (*reason).clone()),
        };
        let fitted = |&FittedParameter { parameter, value, std, ends95, .. }: &FittedParameter| FittedRecord {
            name: parameter.name.into(),
            unit: parameter.unit.into(),
            value,
            std,
            ends95,
        };
        let all = law.problem.unknowns.law();
        let values = fit.map_or_else(|_| all.values(), |fit| fit.values.clone());
        let prescribed = (all.parameters().iter().zip(values))
            .filter(|(p, _)| law.problem.unknowns.list().iter().all(|unknown| unknown.parameter.name != p.name))
            .map(|(p, value)| (p.name.into(), value))
            .collect();
        let work = |mode: usize| law.works.as_ref().map(|works| SpreadRecord::from(&works[mode]));
        Self {
            law: law.name().into(),
            start: law.start.clone(),
            status: status.into(),
            reason,
            verdict: fit.ok().map(|fit| fit.verdict.outcome.name().into()),
            rejected: law.rejected,
            z: fit.ok().and_then(|fit| fit.misfit.as_ref()).map(|misfit| misfit.z),
            omega: law.score.map(|score| score.omega),
            aic: law.score.map(|score| score.aic),
            bic: law.score.map(|score| score.bic),
            above_best: above.map(|(above, _)| above),
            alike_within: above.map(|(_, within)| within),
            left_out_omega: law.left_out.map(|left_out| left_out.omega),
            weight: law.weight,
            evaluations: fit.map_or(0, |fit| fit.evaluations),
            parameters: fit.map_or(Vec::new(), |fit| fit.parameters.iter().map(fitted).collect()),
            prescribed,
            opening_work: work(0),
            sliding_work: work(1),
            reached_work: law.reached.as_ref().map(SpreadRecord::from),
        }
    }
}

/// A comparison of laws with its curves: as it was made, or as its files have it.
#[derive(Debug)]
pub struct TournamentReport {
    /// What `tournament.json` holds.
    pub record: TournamentRecord,
    /// Traction in opening and in sliding, averaged; `None` where no law is left.
    average: Option<[CurveBand; 2]>,
    /// Those of the laws of the record; `None` without a fit.
    curves: Vec<Option<[CurveBand; 2]>>,
}

/// Columns of `tournament-tractions.csv`.
const COLUMNS: [&str; 8] = ["law", "mode", "point", "jump_mm", "traction_MPa", "std_MPa", "low95_MPa", "high95_MPa"];

impl TournamentReport {
    /// The report of `tournament` on the case file `case`, which took `seconds`.
    pub fn new(tournament: &Tournament<'_>, case: String, about: String, seconds: f64, remarks: Vec<Remark>) -> Self {
        let name = |k: usize| Name::from(tournament.laws[k].name());
        let best = tournament.best.and_then(|best| tournament.laws[best].score);
        let average = tournament.average.as_ref().map(|average| AverageRecord {
            opening_work: (&average.works[0]).into(),
            sliding_work: (&average.works[1]).into(),
            reached_work: average.reached.as_ref().map(SpreadRecord::from),
        });
        let record = TournamentRecord {
            quadrille: env!("CARGO_PKG_VERSION").into(),
            case,
            units: "mm, MPa, N/mm; y up; instants from 1".into(),
            seconds,
            about,
            data: tournament.n_data,
            sentences: tournament.sentences.clone(),
            best: tournament.best.map(name),
            alike: tournament.alike.iter().map(|&k| name(k)).collect(),
            laws: tournament.laws.iter().map(|law| LawRecord::of(law, best)).collect(),
            average,
            remarks,
        };
        Self {
            record,
            average: tournament.average.as_ref().map(|average| average.curves.clone()),
            curves: tournament.laws.iter().map(|law| law.curves.clone()).collect(),
        }
    }

    /// The same from what was written: `record` of `tournament.json` and the file `tournament-tractions.csv`.
    ///
    /// # Errors
    /// A file that is no such table.
    pub fn read(record: TournamentRecord, tractions: &Path) -> Result<Self, JointFileError> {
        let (jumps, [traction, std, low, high]) = Default::default();
        let empty = CurveBand { jumps, traction, std, low, high };
        let mut all = vec![[empty.clone(), empty]; record.laws.len() + 1];
        for row in rows_of(tractions, &COLUMNS)? {
            let mode = usize::from(row[1] > 1.0);
            let Some(curve) = all.get_mut(row[0] as usize).map(|curves| &mut curves[mode]) else { continue };
            curve.jumps.push(match mode {
                0 => Jump { normal: row[3], tangential: 0.0 },
                _ => Jump { normal: 0.0, tangential: row[3] },
            });
            let lists = [&mut curve.traction, &mut curve.std, &mut curve.low, &mut curve.high];
            lists.into_iter().zip(&row[4..]).for_each(|(list, value)| list.push(*value));
        }
        let mut curves = all.into_iter().map(|curves| Some(curves).filter(|curves| !curves[0].jumps.is_empty()));
        let average = curves.next().flatten();
        Ok(Self { record, average, curves: curves.collect() })
    }

    /// Writes `tournament-tractions.csv`: traction against separation of every law and of their average.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_tractions<W: Write>(&self, out: W) -> io::Result<()> {
        let names: Vec<String> =
            (1..).zip(&self.record.laws).map(|(k, law): (usize, _)| format!("{k} {}", law.law)).collect();
        let notes = [
            version(),
            "tractions in pure opening (mode 1) and pure sliding (mode 2) with 95 % bands; mm, MPa".to_owned(),
            format!("law 0: average over the laws that are not rejected; {}", names.join("; ")),
        ];
        let average = self.average.as_ref().map(|curves| (0, curves));
        let laws = (1u64..).zip(&self.curves).filter_map(|(k, curves)| Some((k, curves.as_ref()?)));
        let rows = average.into_iter().chain(laws).flat_map(|(law, curves)| {
            law_rows(curves).map(move |(numbers, values)| ([vec![law], numbers].concat(), values))
        });
        write_table(out, &notes, &to_strings(&COLUMNS), rows)
    }

    /// Draws all laws over each other in each mode; `save` is called with the name (without ending) of each picture.
    ///
    /// # Errors
    /// A picture without a finite range, and what `save` refuses.
    pub fn draw<E: From<ReportError>>(&self, mut save: impl FnMut(String, Picture) -> Result<(), E>) -> Result<(), E> {
        for (mode, (name, ..)) in MODES.iter().enumerate() {
            if let Some(plot) = self.together(mode) {
                save(format!("tournament-{name}"), plot.draw()?)?;
            }
        }
        Ok(())
    }

    /// All laws in one mode; `None` where no law has a fit.
    fn together(&self, mode: usize) -> Option<Plot> {
        let mut series: Vec<PlotSeries> = Vec::new();
        if let Some(average) = &self.average {
            series.push(law_series("average", &average[mode], Style::Line, true));
        }
        for (law, curves) in self.record.laws.iter().zip(&self.curves) {
            let Some(curves) = curves else { continue };
            let words = match (law.rejected, law.weight) {
                (true, _) => "rejected".to_owned(),
                (false, weight) => format!("weight {weight:.2}"),
            };
            let counts = law.weight > 1e-3;
            let style = if counts { Style::Line } else { Style::Dashed };
            series.push(law_series(&format!("{}, {words}", law.law), &curves[mode], style, counts));
        }
        let title = format!("The laws in pure {}, 95 % bands of those that are left", MODES[mode].0);
        let notes = self.record.sentences.iter().take(1).cloned().collect();
        (!series.is_empty()).then(|| Plot { notes, ..mode_plot(title, mode, series) })
    }

    /// Law number `k` beside the average.
    fn alone(&self, k: usize, mode: usize) -> Option<Plot> {
        let law = &self.record.laws[k].law;
        let series = law_series(law, &self.curves[k].as_ref()?[mode], Style::Line, true);
        let mut plot = mode_plot(format!("{law} in {}", MODES[mode].0), mode, vec![series]);
        if let Some(average) = &self.average {
            let curve = &average[mode];
            // The bands of a law that the data hardly know would leave nothing to be seen of the others.
            let finite = curve.high.iter().chain(&plot.series[0].y).filter(|v| v.is_finite());
            let largest = finite.fold(0.0_f64, |most, v| most.max(*v));
            if largest > 0.0 {
                plot.y.range = Some((-0.05 * largest, 1.2 * largest));
            }
            plot.series.push(law_series("average", curve, Style::Dashed, false));
        }
        Some(plot)
    }

    /// The comparison as a section of a page.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn section(&self) -> Result<Section, ReportError> {
        let mut blocks = Vec::new();
        if let Some((first, rest)) = self.record.sentences.split_first() {
            let warning = self.record.alike.len() != 1;
            blocks.push(Block::Lead { text: format!("{}.", capital(first)), warning });
            blocks.extend(rest.iter().map(|line| Block::sentence(line)));
        }
        blocks.push(Block::text(
            "All laws are fitted to the same displacements with the same weights and the same noise. Omega is the whitened \
             residual: of a right model it is about the number of data. AIC = omega + 2 p and BIC = omega + p ln n judge laws with \
             different numbers p of parameters (with an unknown noise n ln(omega/n) stands for omega); left-out instants are \
             predicted from the others. The weight is that of Akaike, zero for what the misfit test rejects.",
        ));
        blocks.push(self.table());
        blocks.push(self.works());
        let pictures = |plots: Vec<Option<Plot>>, caption: &str| -> Result<Vec<Block>, ReportError> {
            plots.iter().flatten().map(|plot| Block::curves(plot, caption)).collect()
        };
        let both = pictures(vec![self.together(0), self.together(1)], "Bands: 95 %, of laws with a weight.")?;
        blocks.push(Block::Grid(both));
        blocks.push(Block::Heading("Side by side".into()));
        let each = (0..self.curves.len()).flat_map(|k| [self.alone(k, 0), self.alone(k, 1)]).collect();
        blocks.push(Block::Grid(pictures(each, "With its 95 % band, if this law were true; dashed: the average.")?));
        blocks.push(Block::Heading("Parameters".into()));
        blocks.push(self.parameters());
        Ok(Section { title: "Law against law".into(), blocks })
    }

    fn table(&self) -> Block {
        let rows = self.record.laws.iter().map(|law| {
            let digits = |value: Option<f64>| value.map_or_else(|| "\u{2013}".to_owned(), |v| format!("{v:.1}"));
            vec![
                law.law.to_string(),
                digits(law.omega),
                law.parameters.len().to_string(),
                digits(law.aic),
                digits(law.bic),
                digits(law.left_out_omega),
                digits(law.z),
                format!("{:.3}", law.weight),
                match (&law.verdict, law.rejected, &*law.status) {
                    (None, ..) => "failed".to_owned(),
                    (_, true, _) => "rejected".to_owned(),
                    (_, _, status) if status != "converged" => status.replace('_', " "),
                    (Some(verdict), ..) => verdict.to_string(),
                },
            ]
        });
        Block::table(&["law", "omega", "p", "AIC", "BIC", "left out", "z", "weight", "verdict"], rows)
    }

    fn works(&self) -> Block {
        let row = |name: &str, works: [Option<SpreadRecord>; 3]| {
            let [opening, sliding, reached] =
                works.map(|work| work.map_or_else(|| "\u{2013}".to_owned(), |work| write_spread(&work)));
            vec![name.to_owned(), opening, sliding, reached]
        };
        let mut rows: Vec<Vec<String>> = self
            .record
            .laws
            .iter()
            .map(|law| row(&law.law, [law.opening_work, law.sliding_work, law.reached_work]))
            .collect();
        if let Some(average) = self.record.average {
            rows.push(row("average", [Some(average.opening_work), Some(average.sliding_work), average.reached_work]));
        }
        let columns =
            ["law", "work in opening (N/mm)", "work in sliding (N/mm)", "work as far as the furthest pair went (N/mm)"];
        Block::table(&columns, rows)
    }

    fn parameters(&self) -> Block {
        let rows = self.record.laws.iter().flat_map(|law| {
            law.parameters.iter().map(|p| {
                let unit = if p.unit == "1" { String::new() } else { format!(" {}", p.unit) };
                let ends = p.ends95.map(plain_or_dash);
                vec![
                    law.law.to_string(),
                    p.name.to_string(),
                    format!("{}{unit}", plain(p.value)),
                    plain_or_dash(p.std),
                    format!("{} to {}", ends[0], ends[1]),
                ]
            })
        });
        Block::table(&["law", "parameter", "value", "std", "95 % interval, if this law were true"], rows)
    }

    /// The comparison as a page of its own.
    ///
    /// # Errors
    /// A picture that cannot be drawn.
    pub fn page(&self) -> Result<Page, ReportError> {
        let record = &self.record;
        let mut facts = vec![
            ("case file".to_owned(), record.case.clone()),
            ("compared".to_owned(), record.about.clone()),
            ("time of all fits".to_owned(), format!("{:.2} s", record.seconds)),
        ];
        facts.extend(record.laws.iter().map(|law| (format!("start of {}", law.law), law.start.clone())));
        facts.extend(record.remarks.iter().map(|remark| (remark.severity.name().to_owned(), remark.text.clone())));
        let about = Section { title: "What was compared".into(), blocks: vec![Block::Facts(facts)] };
        Ok(Page {
            title: "Laws of an adhesive, compared on the same test".into(),
            subtitle: format!("quadrille {}; units mm, MPa, N/mm", record.quadrille),
            sections: vec![self.section()?, about],
        })
    }
}

fn write_spread(work: &SpreadRecord) -> String {
    let ends = work.ends95.map(|end| end.map_or_else(|| "open".to_owned(), |end| significant(end, 3)));
    format!("{} ({} to {})", significant(work.value, 3), ends[0], ends[1])
}
