//! A lap joint, reduced: the shear traction along it at each frame, its table, its figures and its page.

use super::page::{Block, Page, Section};
use super::with_std::WithStd;
use super::words::significant;
use super::{Picture, Plot, PlotSeries, ReportError, Style, to_strings, version};
use crate::io::joint::write_table;
use crate::reduction::LapCurve;
use crate::remark::Remark;
use serde::Serialize;
use std::io::{self, Write};

/// Frames that are drawn, at most.
const DRAWN: usize = 6;

/// `reduction.json` of a lap joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LapRecord {
    /// Version of the program.
    pub quadrille: &'static str,
    /// The case file.
    pub case: String,
    /// The test.
    pub layout: &'static str,
    /// Stiffness `E t` of each adherend, N/mm by unit of width, and its standard uncertainty.
    #[serde(rename = "stiffness_N_per_mm")]
    pub stiffness_n_per_mm: WithStd,
    /// The frames.
    pub frames: Vec<LapFrame>,
    /// What is to be looked at.
    pub remarks: Vec<Remark>,
}

/// A frame of a lap joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LapFrame {
    /// Its number.
    pub frame: usize,
    /// Force of the load cell, N.
    #[serde(rename = "load_N")]
    pub load_n: f64,
    /// The force that the mean traction makes over the lap, N: it should be the load.
    #[serde(rename = "force_by_strain_N")]
    pub force_n: WithStd,
    /// Mean traction, MPa.
    #[serde(rename = "mean_MPa")]
    pub mean_mpa: WithStd,
    /// The largest, MPa.
    #[serde(rename = "largest_MPa")]
    pub largest_mpa: WithStd,
    /// The traction along the lap, whose standard uncertainty is that of the images.
    #[serde(flatten)]
    pub curve: LapCurve,
    /// Sliding at the same places, mm; where it is not measured, none.
    pub sliding_mm: Vec<Option<f64>>,
}

impl LapRecord {
    /// Writes `lap.csv`: a row for each place of each frame; a cell is empty where nothing is known.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write<W: Write>(&self, out: W) -> io::Result<()> {
        let columns = to_strings(&["frame", "along_mm", "sliding_mm", "traction_MPa", "std_MPa"]);
        let rows = self.frames.iter().flat_map(|of| {
            (0..of.curve.along_mm.len()).map(|k| {
                let LapCurve { along_mm, traction_mpa, std_mpa, .. } = &of.curve;
                let sliding = of.sliding_mm[k].unwrap_or(f64::NAN);
                (vec![of.frame as u64], vec![along_mm[k], sliding, traction_mpa[k], std_mpa[k]])
            })
        });
        let about = "shear traction along the lap, from the strain of the adherends; std of images".to_owned();
        write_table(out, &[version(), about], &columns, rows)
    }

    /// Draws every figure, each with its name.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn draw(&self) -> Result<Vec<(&'static str, Picture)>, ReportError> {
        self.plots().into_iter().map(|(name, plot, _)| Ok((name, plot.draw()?))).collect()
    }

    fn plots(&self) -> Vec<(&'static str, Plot, String)> {
        let step = self.frames.len().div_ceil(DRAWN).max(1);
        let drawn: Vec<&LapFrame> = self.frames.iter().rev().step_by(step).collect();
        let along = drawn.iter().rev().map(|of| {
            let LapCurve { along_mm, traction_mpa, std_mpa, .. } = &of.curve;
            let name = format!("frame {}", of.frame);
            let band = std_mpa.iter().map(|std| 1.96 * std).collect();
            PlotSeries::new(name, Style::Line, along_mm.clone(), traction_mpa.clone()).with_band(band)
        });
        let along =
            Plot::new("Shear traction along the lap", "along the lap (mm)", "T_t (MPa)", along.collect::<Vec<_>>());
        let over = drawn.iter().rev().map(|of| {
            let pairs = of.sliding_mm.iter().zip(&of.curve.traction_mpa).filter_map(|(d, t)| Some(((*d)?, *t)));
            let (x, y) = pairs.unzip();
            PlotSeries::new(format!("frame {}", of.frame), Style::Markers, x, y)
        });
        let over = Plot::new("Shear traction over sliding", "sliding (mm)", "T_t (MPa)", over.collect::<Vec<_>>());
        vec![
            ("shear-along", along, "From the strain of the adherends; bands: 95 %, of images".to_owned()),
            ("shear-sliding", over, "Each place of the lap at each frame: one curve where one law holds".to_owned()),
        ]
    }

    /// The page.
    ///
    /// # Errors
    /// A figure without a finite range.
    pub fn page(&self) -> Result<Page, ReportError> {
        let mut blocks: Vec<Block> = self.remarks.iter().map(Block::of_remark).collect();
        let rows = self.frames.iter().map(|of| {
            vec![
                of.frame.to_string(),
                significant(of.load_n, 4),
                of.force_n.in_words(),
                of.mean_mpa.in_words(),
                of.largest_mpa.in_words(),
            ]
        });
        let columns = ["frame", "load (N)", "force by the strain (N)", "mean T_t (MPa)", "largest T_t (MPa)"];
        blocks.push(Block::table(&columns, rows));
        let figures = self.plots().into_iter().map(|(_, plot, caption)| Block::curves(&plot, caption));
        let stiffness = vec![("stiffness E t of each adherend (N/mm)".to_owned(), self.stiffness_n_per_mm.in_words())];
        Ok(Page {
            title: "Lap joint, reduced".to_owned(),
            subtitle: format!("quadrille {}, {}", self.quadrille, self.case),
            sections: vec![
                Section { title: "Result".into(), blocks },
                Section { title: "Curves".into(), blocks: vec![Block::Grid(figures.collect::<Result<_, _>>()?)] },
                Section { title: "Specimen".into(), blocks: vec![Block::Facts(stiffness)] },
            ],
        })
    }

    /// A line for the frame of the largest load, for the terminal.
    pub fn lines(&self) -> Vec<String> {
        let largest = self.frames.iter().max_by(|a, b| a.load_n.total_cmp(&b.load_n));
        let line = |of: &LapFrame| {
            let words = |what: &str, value: WithStd| format!("frame {}, {what}: {}", of.frame, value.in_words());
            vec![
                words("mean T_t (MPa)", of.mean_mpa),
                words("largest T_t (MPa)", of.largest_mpa),
                format!("{}; the load is {}", words("force by the strain (N)", of.force_n), significant(of.load_n, 4)),
            ]
        };
        largest.map(line).unwrap_or_default()
    }
}
