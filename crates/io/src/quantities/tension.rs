//! A tensile test over the frames of a series: its gauges, its constants, its table.

use crate::field::{
    FrameQuantities, Quantities, Strains, Tension, TensionConstant, TensionGauges, TensionOptions, TensionPoint, Value,
};
use crate::load::LoadTable;
use crate::remark::{About, Code, Remark};
use std::io::{self, Write};

const COLUMNS: [&str; 11] = [
    "constant",
    "value",
    "sigma",
    "sigma_noise",
    "sigma_area",
    "sigma_camera",
    "from_strain",
    "to_strain",
    "frames",
    "squares",
    "bent_percent",
];

/// A tensile test: its frames and what follows from them.
#[derive(Debug, Clone, PartialEq)]
pub struct TensionResult {
    /// Frames with a strain along the load.
    pub points: Vec<TensionPoint>,
    /// The constants.
    pub tension: Tension,
    /// What was asked for.
    pub options: TensionOptions,
}

/// Strains of a frame, by the direction of the load.
type Both = [Option<Strains>; 2];

/// What the gauges read, and read when the camera is off in each of its directions.
#[derive(Debug)]
struct Row {
    frame: usize,
    strains: Both,
    changed: Vec<Both>,
}

/// The gauges of a tensile test over the frames.
#[derive(Debug)]
pub(super) struct TensionHistory {
    gauges: TensionGauges,
    rows: Vec<Row>,
    /// Names of the directions of the camera.
    terms: Vec<&'static str>,
}

/// The direction of the camera that is not common to all frames: the distance drifts while the bar is pulled.
const DRIFTS: &str = "distance";

impl TensionHistory {
    /// Without a frame; the reference is the mean of `n_references` images, which noise of all frames has in common.
    pub fn new(mut gauges: TensionGauges, n_references: usize) -> Self {
        gauges.options.common = 1.0 / (1.0 + n_references.max(1) as f64);
        Self { gauges, rows: Vec::new(), terms: Vec::new() }
    }

    /// Takes the next frame: what was drawn from it, and with each direction of the camera off.
    pub fn take(
        &mut self,
        frame: usize,
        drawn: &FrameQuantities,
        (changed, terms): (&[FrameQuantities], &[&'static str]),
        q: &Quantities,
    ) {
        self.terms = terms.to_vec();
        let read = |drawn: &FrameQuantities| self.gauges.read((&drawn.extensometers, &drawn.regions), q.strain);
        self.rows.push(Row { frame, strains: read(drawn), changed: changed.iter().map(read).collect() });
    }

    /// The constants, with the stresses of `load`.
    pub fn finish(self, load: &LoadTable) -> TensionResult {
        let Self { gauges, rows, terms } = self;
        let axis = gauges.axis_of(&rows.iter().map(|row| row.strains).collect::<Vec<_>>());
        let points = |strains: &dyn Fn(&Row) -> Option<Both>| -> Vec<TensionPoint> {
            let point = |row: &Row| {
                let [x, y] = strains(row)?;
                let (along, across) = if axis == 0 { x? } else { y? };
                let stress_mpa = load.stress().and_then(|stress| stress.at(row.frame));
                Some(TensionPoint { frame: row.frame, stress_mpa, along, across })
            };
            rows.iter().filter_map(point).collect()
        };
        let own = points(&|row| Some(row.strains));
        let mut tension = Tension::of(&own, &gauges.options);
        let largest = own.iter().map(|p| p.along.value.abs()).fold(0.0, f64::max);
        let top = largest.min(gauges.options.modulus_range[1].abs());
        for (k, name) in terms.iter().enumerate() {
            let mut changed = points(&|row| row.changed.get(k).copied());
            for (point, own) in changed.iter_mut().zip(own.iter().filter(|_| *name == DRIFTS)) {
                let share = (own.along.value.abs() / top).min(1.0);
                let drifted =
                    |to: Value, from: Value| Value { value: from.value + share * (to.value - from.value), ..to };
                point.along = drifted(point.along, own.along);
                point.across = point.across.zip(own.across).map(|(to, from)| drifted(to, from));
            }
            tension.add_camera(&Tension::of(&changed, &gauges.options));
        }
        TensionResult { points: own, tension, options: gauges.options }
    }
}

impl TensionResult {
    /// Writes the constants as a table below the comment lines `header`.
    pub(super) fn write<W: Write>(&self, mut out: W, header: &[String]) -> io::Result<()> {
        let TensionOptions { proof_strain, .. } = self.options;
        let definitions = [
            "strains are engineering ones: of the distance of an extensometer, or of the mean gradient of a region"
                .to_owned(),
            format!(
                "E: slope of stress over strain, a line through both that counts the noise of both; nu: of the strain \
                 across over that along, between the same strains; Rp: where the curve is a strain of {proof_strain} \
                 beyond the line of E; Rm: largest stress; r: of the true plastic strain across over that through the \
                 thickness, the volume being kept"
            ),
            "sigma: of noise (and scatter about the line, where that is larger), area (1 % where not stated) and camera; \
             squares: of the scatter about the line over those of noise; bent_percent: change of the slope over the \
             range, where it is clear; an empty cell has no value"
                .to_owned(),
        ];
        for line in header.iter().chain(&definitions).flat_map(|text| text.split(['\n', '\r'])) {
            writeln!(out, "# {line}")?;
        }
        let mut out = ::csv::WriterBuilder::new().has_headers(false).from_writer(out);
        out.write_record(COLUMNS)?;
        let cell = |number: Option<f64>| number.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:?}"));
        for (name, constant) in self.tension.constants() {
            let of = |value: fn(&TensionConstant) -> f64| constant.as_ref().map(value);
            let numbers = [
                of(|c| c.value),
                of(TensionConstant::sigma),
                of(|c| c.noise),
                of(|c| c.area),
                of(|c| c.camera),
                of(|c| c.range[0]),
                of(|c| c.range[1]),
            ];
            let frames = constant.map_or(String::new(), |c| c.n_frames.to_string());
            let last = [constant.and_then(|c| c.squares), constant.and_then(|c| Some(100.0 * c.bent?))];
            let cells = numbers.into_iter().map(cell).chain([frames]).chain(last.into_iter().map(cell));
            out.write_record([name.to_owned()].into_iter().chain(cells))?;
        }
        out.flush()
    }

    /// What a user should know.
    pub(super) fn remarks(&self) -> Vec<Remark> {
        let mut remarks: Vec<Remark> = (self.tension.missing.iter())
            .map(|(name, why)| {
                let text = format!("tension: there is no {name}: {why}");
                Remark::new(Code::TensionMissing, About::Parameter((*name).to_owned()), text)
            })
            .collect();
        for (name, constant) in self.tension.constants() {
            let Some((constant, bent)) = constant.and_then(|constant| Some((constant, constant.bent?))) else {
                continue;
            };
            let [from, to] = constant.range;
            let text = format!(
                "tension: the line of {name} is bent: its slope changes by {:.0} % between strains of {from:.2e} and {to:.2e}; give a \
                 range that is straight",
                100.0 * bent
            );
            let remark = Remark::new(Code::TensionBent, About::Parameter(name.to_owned()), text);
            remarks.push(remark.with("bent", bent));
        }
        remarks
    }
}
