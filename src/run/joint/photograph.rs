//! Images of a computed specimen, with its loads and the case of its reduction: `quadrille make specimen --images`.

#![expect(clippy::indexing_slicing, reason = "the specimen is made here, and what is read of its solution is checked")]

use crate::imaging::Image;
use crate::io::images::write_image;
use crate::io::joint::{read_table, write_table};
use crate::mechanics::{Specimen, SpecimenKind, SpecimenOptions};
use crate::run::folder::read::write_file;
use crate::run::words::{Result, RunError};
use crate::synth::{Depth, GridField, RenderOptions, Strips, Texture, render};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use rayon::ThreadPool;
use rayon::prelude::*;
use std::fmt::Write as _;
use std::io::BufWriter;
use std::path::Path;

/// Pixels across the thickness of an arm, around the specimen, and across an element.
const ARM_PX: f64 = 75.0;
const MARGIN_PX: f64 = 20.0;
const ELEMENT_PX: f64 = 12.0;
/// From a face of the adhesive to the zone of an arm, px.
const GUARD_PX: f64 = 3.0;
/// Grey levels of the noise, mean speckle (px) and seed.
const NOISE: f32 = 2.0;
const SPECKLE_PX: f64 = 4.5;
const SEED: u64 = 7;
/// Width of the specimen, mm, and noise of the load cell, N.
const WIDTH: f64 = 25.0;
const FORCE_STD: f64 = 0.3;
/// Plane strain of the usual specimen: modulus of a wide beam and shear modulus, MPa.
const MODULI: [f64; 2] = [70_000.0 / (1.0 - 0.33 * 0.33), 70_000.0 / (2.0 * 1.33)];

/// The view of a specimen: lengths in mm.
struct View<'a> {
    kind: SpecimenKind,
    of: &'a SpecimenOptions,
    mm_per_px: f64,
    /// Row of the mid-line, and size of the images, px.
    middle: f64,
    size: [usize; 2],
}

/// Takes the images of what `quadrille simulate` has computed of a specimen, in the folder `computed`, and writes them
/// into `folder`, with `load.csv` and `test.toml`, the case of its measurement and its reduction.
///
/// # Errors
/// Tests without a reduction, tables that are not of this specimen, files that cannot be written.
pub fn photograph(
    (kind, options): (SpecimenKind, &SpecimenOptions),
    computed: &Path,
    folder: &Path,
    pool: &ThreadPool,
) -> Result<()> {
    if kind == SpecimenKind::Peel {
        return Err("--images is for dcb, enf, mmb and lap: a peeled arm leaves the view".into());
    }
    let view = View::new(kind, options);
    let specimen = Specimen::new(kind, options).map_err(|error| error.to_string())?;
    let mesh = specimen.mesh().map_err(|error| error.to_string())?;
    let nodes = mesh.nodes();
    let solution = columns(&computed.join("solution.csv"), &["instant", "node", "ux_mm", "uy_mm"])?;
    let mut fields = vec![vec![[0.0; 2]; nodes.len()]];
    for row in &solution {
        let (instant, node) = (row[0] as usize, row[1] as usize);
        if node >= nodes.len() || instant > options.instants {
            let what = format!("node {node} at instant {instant} is not of this specimen");
            return Err(format!("{}: {what}", computed.display()).into());
        }
        if fields.len() <= instant {
            fields.resize(instant + 1, vec![[0.0; 2]; nodes.len()]);
        }
        fields[instant][node] = [row[2], row[3]];
    }
    let texture = Texture::new(SEED, SPECKLE_PX)?;
    pool.install(|| {
        fields.par_iter().enumerate().try_for_each(|(frame, field)| -> Result<()> {
            let image = view.image(&texture, &view.motion(nodes, field)?, frame)?;
            Ok(write_image(&folder.join(format!("{frame:04}.tif")), &image)?)
        })
    })?;
    let loads = view.loads(computed)?;
    let path = folder.join("load.csv");
    let file = std::fs::File::create(&path).map_err(|error| RunError::file(&path, "written", error))?;
    let names = ["frame", "load_N"].map(str::to_owned);
    let note = format!("a computed {} of {WIDTH} mm width; noise of {FORCE_STD} N", kind.name());
    let rows = loads.into_iter().enumerate().map(|(frame, load)| (vec![frame as u64], vec![load]));
    write_table(BufWriter::new(file), &[note], &names, rows)
        .map_err(|error| RunError::file(&path, "written", error))?;
    write_file(&folder.join("test.toml"), view.case())
}

/// The columns of these names, row by row.
fn columns(path: &Path, names: &[&str]) -> Result<Vec<Vec<f64>>> {
    let (there, rows) = read_table(path)?;
    let place = |name: &&str| {
        there
            .iter()
            .position(|column| column == name)
            .ok_or_else(|| format!("{}: there is no column {name}", path.display()))
    };
    let places = names.iter().map(place).collect::<std::result::Result<Vec<_>, _>>()?;
    Ok(rows.iter().map(|row| places.iter().map(|&k| row[k]).collect()).collect())
}

impl<'a> View<'a> {
    fn new(kind: SpecimenKind, of: &'a SpecimenOptions) -> Self {
        let mm_per_px = of.arms[0].max(of.arms[1]) / ARM_PX;
        // Room for what bends down or is pulled apart.
        let half = (of.opening + of.arms[0].max(of.arms[1]) + of.adhesive) / mm_per_px + MARGIN_PX;
        let length = if kind == SpecimenKind::Lap { 2.0 * of.length + of.crack } else { of.length };
        let size = [length / mm_per_px + 2.0 * MARGIN_PX, 2.0 * half].map(|v| v.ceil() as usize);
        Self { kind, of, mm_per_px, middle: half.round(), size }
    }

    /// Where an arm begins and ends, mm.
    fn extent(&self, upper: bool) -> [f64; 2] {
        let &SpecimenOptions { length, crack, .. } = self.of;
        match (self.kind, upper) {
            (SpecimenKind::Lap, false) => [0.0, length + crack],
            (SpecimenKind::Lap, true) => [length, 2.0 * length + crack],
            _ => [0.0, length],
        }
    }

    /// The motion of a field (mm, y up) in the image.
    fn motion(&self, nodes: &[[f64; 2]], field: &[[f64; 2]]) -> Result<Strips> {
        let half = 0.5 * self.of.adhesive;
        let [lower, upper] = self.of.arms;
        let strip = |is_upper: bool, [low, high]: [f64; 2]| {
            let step = (high - low) / self.of.rows as f64;
            let [from, to] = self.extent(is_upper);
            let columns = ((to - from) / step).ceil() as usize;
            // Of each row of nodes, from the top, those between which a place lies.
            let rows = (0..=self.of.rows).rev().map(|row| low + step * row as f64);
            let grid = rows.flat_map(|y| {
                let on_row = |k: &usize| (nodes[*k][1] - y).abs() < 1e-6 * step;
                let mut row: Vec<usize> = (0..nodes.len()).filter(on_row).collect();
                row.sort_by(|a, b| nodes[*a][0].total_cmp(&nodes[*b][0]));
                (0..=columns).map(move |column| {
                    let x = (from + step * column as f64).min(to);
                    let next = row.partition_point(|&k| nodes[k][0] < x).clamp(1, row.len() - 1);
                    let [a, b] = [row[next - 1], row[next]];
                    let t = (x - nodes[a][0]) / (nodes[b][0] - nodes[a][0]);
                    let [u, v] = [0, 1].map(|c| ((1.0 - t) * field[a][c] + t * field[b][c]) / self.mm_per_px);
                    [u, -v]
                })
            });
            let top = self.middle - high / self.mm_per_px;
            let left = MARGIN_PX + from / self.mm_per_px;
            GridField::new([left, top], step / self.mm_per_px, [columns, self.of.rows], grid.collect())
        };
        let strips = strip(true, [half, half + upper]).zip(strip(false, [-half - lower, -half]));
        strips.map(|(upper, lower)| Strips::new(upper, lower)).ok_or(RunError::Bug("a specimen has a grid"))
    }

    fn image(&self, texture: &Texture, motion: &Strips, frame: usize) -> Result<Image> {
        let [width, height] = self.size;
        let options = RenderOptions {
            depth: Depth::U8,
            noise: NOISE,
            seed: SEED,
            frame: frame as u64,
            ..RenderOptions::new(width, height)
        };
        Ok(render(texture, motion, &options)?)
    }

    /// What a load cell says of each frame, N: none of the first.
    fn loads(&self, computed: &Path) -> Result<Vec<f64>> {
        let loaded = match self.kind {
            SpecimenKind::Enf => "middle",
            SpecimenKind::Mmb => "lever",
            SpecimenKind::Lap => "right",
            _ => "upper_pin",
        };
        let column = if self.kind == SpecimenKind::Lap { "Fx_N_per_mm" } else { "Fy_N_per_mm" };
        let path = computed.join("reactions.csv");
        let mut rows = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .from_path(&path)
            .map_err(|e| format!("{}: {e}", path.display()))?;
        let heads = rows.headers().map_err(|e| format!("{}: {e}", path.display()))?.clone();
        let place = |name: &str| {
            heads
                .iter()
                .position(|head| head == name)
                .ok_or_else(|| format!("{}: there is no column {name}", path.display()))
        };
        let [group, force] = [place("group")?, place(column)?];
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut loads = vec![0.0];
        for row in rows.records().filter_map(std::result::Result::ok).filter(|row| row.get(group) == Some(loaded)) {
            let force: f64 = row.get(force).and_then(|force| force.parse().ok()).unwrap_or(f64::NAN);
            let noise: f64 = StandardNormal.sample(&mut random);
            loads.push(WIDTH * force.abs() + FORCE_STD * noise);
        }
        Ok(loads)
    }

    /// The zone of an arm: whole elements beside its face.
    fn zone(&self, upper: bool) -> [f64; 4] {
        let arm = self.of.arms[usize::from(upper)] / self.mm_per_px;
        let face = 0.5 * self.of.adhesive / self.mm_per_px + GUARD_PX;
        let height = ((arm - GUARD_PX) / ELEMENT_PX).floor().max(1.0) * ELEMENT_PX;
        let rows = match upper {
            true => [self.middle - face - height, self.middle - face],
            false => [self.middle + face, self.middle + face + height],
        };
        let [from, to] = self.extent(upper).map(|mm| MARGIN_PX + mm / self.mm_per_px);
        [from, rows[0], to, rows[1]]
    }

    /// The sections where loads act: name, arm, and from where to where, mm.
    fn sections(&self) -> Vec<(&'static str, bool, [f64; 2])> {
        let (arm, length, half) = (self.of.arms[0], self.of.length, 0.5 * self.of.length);
        let end = ("cracked end", false, [0.0, 1.25 * arm]);
        let bent = [
            ("middle", true, [half - 0.75 * arm, half + 0.75 * arm]),
            ("other end", false, [length - 1.25 * arm, length]),
        ];
        match self.kind {
            SpecimenKind::Enf => [end].into_iter().chain(bent).collect(),
            SpecimenKind::Mmb => [("lifted", true, end.2), end].into_iter().chain(bent).collect(),
            SpecimenKind::Lap => Vec::new(),
            _ => vec![("upper pin", true, [0.0, 0.5 * arm]), ("lower pin", false, [0.0, 0.5 * arm])],
        }
    }

    /// The case of the measurement and of the reduction.
    fn case(&self) -> String {
        let sections = self.sections();
        let names: Vec<String> = sections.iter().map(|(name, ..)| format!("\"{name}\"")).collect();
        let px = |mm: f64| MARGIN_PX + mm / self.mm_per_px;
        let half = 0.5 * self.of.length;
        let mut of_layout = match self.kind {
            SpecimenKind::Dcb | SpecimenKind::Lap => String::new(),
            SpecimenKind::Mmb => format!("half_span_mm = {half:?}\nlever_mm = {:?}\n", self.of.lever),
            _ => format!("half_span_mm = {half:?}\n"),
        };
        if self.kind != SpecimenKind::Lap {
            // Writing to a String cannot fail.
            let _ = write!(
                of_layout,
                "sections = [{}]   # where loads act\ntip = [{:.1}, {:.1}]   # the initial tip, px\n\
                 crack_mm = {:?}   # from the load to the tip\ncrack_mm_std = 0.1\ncrack_opening_mm = 0.05\n",
                names.join(", "),
                px(self.of.crack),
                self.middle,
                self.of.crack
            );
        }
        let mut text = format!(
            "# A computed test and its images. Measure it, and reduce it:\n\
             #   quadrille correlate --case test.toml --output fields && quadrille reduce test.toml --output reduced\n\n\
             [images]\nreference = \"0000.tif\"\ndeformed = \"*.tif\"\npixel_size_mm = {:?}\n\n\
             [camera]\nexact = true                # these images had no lens\n\n\
             [correlation]\nelement_size_px = {ELEMENT_PX}\n\n[load]\nfile = \"load.csv\"\n\n\
             [reduction]\nlayout = \"{}\"\nrun = \"fields\"\n{of_layout}width_mm = {WIDTH:?}\nwidth_mm_std = 0.05\n\
             arm_mm = {:?}\nadhesive_mm = {:?}\nE_MPa = {:.1}   # of a wide beam: E/(1 - nu^2)\nG_MPa = {:.1}\n\
             force_std_N = {FORCE_STD}\n\n[[opening]]\nzones = [\"upper\", \"lower\"]\n",
            self.mm_per_px,
            self.kind.name(),
            self.of.arms[1],
            self.of.adhesive,
            MODULI[0],
            MODULI[1],
        );
        for (name, upper) in [("upper", true), ("lower", false)] {
            let _ = write!(text, "\n[[zone]]\nname = \"{name}\"\nroi = {:.1?}\n", self.zone(upper));
        }
        for (name, upper, [from, to]) in sections {
            let [_, y0, _, y1] = self.zone(upper);
            let _ = write!(text, "\n[[region]]\nname = \"{name}\"\nroi = {:.1?}\n", [px(from), y0, px(to), y1]);
        }
        text
    }
}
