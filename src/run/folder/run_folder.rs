//! The folder of a run: what it holds, and how it is replaced.

use crate::field::{Elements, Measurement, Noise, StrainField};
use crate::io::case::{CaseFile, parse_case};
use crate::io::store::{STORE, StoreHeader, remove_store};
use crate::io::{csv, vtk};
use crate::report::Picture;
use crate::run::words::{Result, RunError};
use crate::units::Px;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

pub(crate) const CORRELATION: &str = "correlation";
/// What the parameters are when the rigid motion is treated the other way.
pub(crate) const RIGID_MOTION: &str = "rigid-motion.json";
/// Results of an identification, of a sweep, and of a comparison of laws.
const FITS: [&str; 4] = ["fit.json", "sweep.json", TOURNAMENT, REDUCTION];
/// A test that was reduced.
pub(crate) const REDUCTION: &str = "reduction.json";
/// What a comparison of laws came to.
pub(crate) const TOURNAMENT: &str = "tournament.json";
/// Its page, and its table of tractions.
pub(crate) const TOURNAMENT_TRACTIONS: &str = "tournament-tractions.csv";
/// The load cell beside the prediction.
pub(crate) const FORCE: &str = "force.csv";
/// The energy that flows to the front of the joint.
pub(crate) const J_INTEGRAL: &str = "j-integral.csv";
pub(crate) const FIGURES: &str = "figures";
/// Folder of what a later start of the same run needs: locks, and a record of every frame.
const RESTART: &str = "restart";
/// Beginning of the name of a file that shows whether the folder can be written.
const TRIAL: &str = ".quadrille-trial-";
const SERIES: &str = "series.pvd";
const INTERFACE_SERIES: &str = "interface.pvd";

/// The correlation of the run in `folder`.
pub fn correlation_in(folder: &Path) -> PathBuf {
    folder.join(CORRELATION)
}

/// The output folder of a run.
#[derive(Debug, Clone)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// The options that were chosen, and the images.
    pub(crate) const CASE: &str = "run.toml";
    /// What the frames of a run came to.
    pub(crate) const SUMMARY: &str = "summary.json";
    /// What was measured, to be looked at.
    pub(crate) const REPORT: &str = "report.html";
    pub(crate) const FRAMES: &str = "restart/frames";
    /// Folder of the states of a run whose reference is renewed.
    pub(crate) const CHAIN: &str = "restart/chain";

    /// Makes the folder and checks that it can be written and holds no other run, unless `overwrite`.
    /// Nothing is removed yet.
    pub fn open(path: &Path, overwrite: bool) -> Result<Self> {
        let folder = Self::writable(path)?;
        if !overwrite {
            if folder.holds_run() {
                return Err(folder.holds_another(None));
            }
            folder.spare_files_of_others()?;
        }
        Ok(folder)
    }

    /// Makes the folder and checks that it can be written.
    pub fn writable(path: &Path) -> Result<Self> {
        let folder = Self::for_export(path)?;
        // Of this process alone: others may try at the same time.
        let trial = path.join(format!("{TRIAL}{}", std::process::id()));
        let tried = fs::write(&trial, b"").and_then(|()| fs::remove_file(&trial));
        tried.map_err(|source| RunError::Folder { folder: path.to_owned(), source })?;
        Ok(folder)
    }

    pub(crate) fn holds_run(&self) -> bool {
        [Self::CASE, Self::SUMMARY, STORE].iter().chain(&FITS).any(|name| self.has(name))
    }

    /// Refuses a folder without a run in which files have the names of results: their owner may not know.
    pub(crate) fn spare_files_of_others(&self) -> Result<()> {
        // What a process that was killed while it cleared the folder has left is no one else's.
        if self.holds_run() || self.has(Self::FRAMES) {
            return Ok(());
        }
        let names = [Self::REPORT.to_owned(), SERIES.to_owned(), csv_name(1), vtu_name(1)];
        match names.into_iter().find(|name| self.has(name)) {
            Some(name) => Err(RunError::FileOfOthers { path: self.0.join(name) }),
            None => Ok(()),
        }
    }

    /// Why a run that is there is not replaced; and why it cannot be gone on with, when that was tried.
    pub(crate) fn holds_another(&self, why: Option<String>) -> RunError {
        RunError::HoldsAnother { folder: self.0.clone(), why }
    }

    /// The folder `path`, made when it is not there, for files that are made again from a store.
    pub(crate) fn for_export(path: &Path) -> Result<Self> {
        if path.is_file() {
            return Err(RunError::NoFolder { path: path.to_owned() });
        }
        fs::create_dir_all(path).map_err(|source| RunError::Folder { folder: path.to_owned(), source })?;
        Ok(Self(path.to_owned()))
    }

    /// The folder `path` without results of an earlier run, which `overwrite` allows to remove, and with that of
    /// figures; for a joint, where `vtu` with that of grids.
    pub(crate) fn for_joint(path: &Path, overwrite: bool, vtu: bool) -> Result<Self> {
        let folder = Self::open(path, overwrite)?;
        folder.clear(false, vtu)?;
        folder.make(FIGURES)?;
        Ok(folder)
    }

    /// Removes the results of an earlier run (and nothing else), and makes the folders of this one.
    pub(crate) fn clear(&self, csv: bool, vtu: bool) -> Result<()> {
        // First: while it is there, the folder shows that a run was here.
        let shown = [SERIES, INTERFACE_SERIES, Self::REPORT, Self::SUMMARY, TOURNAMENT_TRACTIONS];
        // Not every run writes these.
        for name in shown.into_iter().chain(FITS).chain([FORCE, J_INTEGRAL]) {
            remove(&self.0.join(name))?;
        }
        remove_store(&self.0.join(STORE))?;
        remove(&self.0.join(Self::CASE))?;
        let numbered = [
            ("csv", &["csv"][..]),
            ("vtu", &["vtu"]),
            (FIGURES, &["png", "svg", "txt"]),
            (Self::FRAMES, &["json"]),
            (Self::CHAIN, &["npz"]),
        ];
        for (kind, endings) in numbered {
            let Ok(entries) = fs::read_dir(self.0.join(kind)) else { continue };
            for entry in entries.flatten() {
                let name = entry.file_name();
                let name = name.to_string_lossy();
                let Some((stem, ending)) = name.rsplit_once('.') else { continue };
                // What a file shows may stand behind its number.
                let number = stem.split('-').next().unwrap_or_default();
                let numbered = number.len() >= 6 && number.bytes().all(|b| b.is_ascii_digit());
                if numbered && endings.contains(&ending) {
                    remove(&entry.path())?;
                }
            }
        }
        self.make_folders(csv, vtu)
    }

    /// Removes what a process that was killed has left half made, when no other can be at it.
    pub(crate) fn tidy(&self) {
        for entry in fs::read_dir(&self.0).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if name.starts_with(&format!("{STORE}.")) && name.ends_with(".part") {
                let _ = fs::remove_dir_all(entry.path()); // it is in nobody's way
            } else if name.starts_with(TRIAL) {
                let _ = fs::remove_file(entry.path());
            }
        }
    }

    pub(crate) fn make_folders(&self, csv: bool, vtu: bool) -> Result<()> {
        for (kind, wanted) in [("csv", csv), ("vtu", vtu), (Self::FRAMES, true)] {
            if wanted {
                self.make(kind)?;
            }
        }
        Ok(())
    }

    pub(crate) fn make(&self, name: &str) -> Result<()> {
        fs::create_dir_all(self.0.join(name)).map_err(|e| failed(&self.0.join(name), e))
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.0.join(name).exists()
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    pub(crate) fn write_case(&self, text: &str) -> Result<()> {
        self.write(Self::CASE, |out| out.write_all(text.as_bytes()))
    }

    pub(crate) fn write_json(&self, name: &str, value: &impl serde::Serialize) -> Result<()> {
        self.write(name, |out| {
            serde_json::to_writer_pretty(&mut *out, value)?;
            out.write_all(b"\n")
        })
    }

    pub(crate) fn write_summary(&self, summary: &impl serde::Serialize) -> Result<()> {
        self.write_json(Self::SUMMARY, summary)
    }

    /// Writes a figure as PNG and SVG, where the folder of figures was made.
    pub(crate) fn save_figure(&self, name: &str, picture: &Picture) -> Result<()> {
        save_picture(&self.0.join(FIGURES), name, picture)
    }

    /// Writes what is wanted of the tables of frame `number`: its CSV file and its VTU file; gives their names. `plane`
    /// is the field in the plane of the specimen, of which the strains are.
    pub(crate) fn write_tables(
        &self,
        [csv, vtu]: [bool; 2],
        number: usize,
        about: &About,
        file: &str,
        [field, plane]: [&Measurement<Px>; 2],
        strain: &StrainField,
    ) -> Result<Vec<PathBuf>> {
        let header = &about.header;
        if csv {
            let head = about.table_head(number, file);
            self.write(&csv_name(number), |out| {
                let mm = header.pixel_size.map(|size| (size, plane));
                csv::write_displacements(out, &head, field, Some(strain), mm)
            })?;
        }
        if vtu {
            let title = format!("quadrille {}, frame {number}: {file}", header.quadrille);
            self.write(&vtu_name(number), |out| {
                vtk::write_vtu(out, &title, field, Some(strain), header.range_grey).map_err(std::io::Error::other)
            })?;
        }
        let names = [csv.then(|| csv_name(number)), vtu.then(|| vtu_name(number))];
        Ok(names.into_iter().flatten().map(PathBuf::from).collect())
    }

    pub(crate) fn write_series(&self, numbers: &[usize]) -> Result<()> {
        self.write_list(SERIES, "", numbers)
    }

    /// The list of the grids of a joint's interface.
    pub(crate) fn write_interface_series(&self, numbers: &[usize]) -> Result<()> {
        self.write_list(INTERFACE_SERIES, "-interface", numbers)
    }

    fn write_list(&self, name: &str, ending: &str, numbers: &[usize]) -> Result<()> {
        let entries: Vec<_> = numbers.iter().map(|&n| (n as f64, format!("vtu/{n:06}{ending}.vtu"))).collect();
        self.write(name, |out| vtk::write_pvd(out, &entries).map_err(std::io::Error::other))
    }

    /// Writes under another name and renames, so that a file is there whole or not at all.
    pub(crate) fn write(
        &self,
        name: &str,
        content: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
    ) -> Result<()> {
        let path = self.0.join(name);
        let unfinished = self.0.join(format!("{name}.part"));
        let write = || -> std::io::Result<()> {
            let mut out = BufWriter::with_capacity(1 << 18, File::create(&unfinished)?);
            content(&mut out)?;
            out.into_inner()?.flush()?;
            fs::rename(&unfinished, &path)
        };
        write().map_err(|error| {
            let _ = fs::remove_file(&unfinished); // what is left of it helps nobody
            failed(&path, error)
        })
    }
}

/// What the files of every frame say about their run; the same from a run and from its store.
#[derive(Debug, Clone)]
pub(crate) struct About {
    pub header: StoreHeader,
    case: CaseFile,
}

impl About {
    pub fn new(header: StoreHeader) -> Result<Self> {
        let case = parse_case(&header.case, Path::new(STORE))?;
        Ok(Self { header, case })
    }

    /// The comment lines of a table.
    fn table_head(&self, number: usize, file: &str) -> Vec<String> {
        if let Some(program) = self.header.imported_from() {
            return vec![
                format!("quadrille {}: displacement of points that {program} measured", self.header.quadrille),
                format!("frame {number}: {file}"),
                format!("points about {} px apart", self.header.element_size_px),
            ];
        }
        let options = &self.case.correlation;
        let named = [
            options.interpolation.map(|interpolation| format!("{} interpolation", interpolation.name())),
            options.brightness.map(|brightness| format!("brightness {brightness}")),
            options.tolerance_px.map(|tolerance| format!("tolerance {tolerance:e} px")),
        ];
        let named: String = named.into_iter().flatten().map(|text| format!("{text}, ")).collect();
        vec![
            format!("quadrille {}: displacement of the nodes, global Q4 image correlation", self.header.quadrille),
            format!("frame {number}: {file}"),
            format!("reference: {}", self.header.reference.join(", ")),
            format!("elements of {} px, {named}{}", self.header.element_size_px, self.header.device),
            match (options.regularisation, options.cutoff_px) {
                (Some(kind), Some(cutoff_px)) => format!("regularisation {kind}, cut-off {cutoff_px} px"),
                _ => match options.elements {
                    Some(Elements::CubicSpline) => "cubic splines with a knot every two elements".to_owned(),
                    _ => "no regularisation".to_owned(),
                },
            },
            match options.noise {
                Some(Noise::Constant(noise)) => format!("sigma from the given image noise of {noise} grey levels"),
                Some(Noise::Photon { a, b }) => {
                    format!("sigma from the given image noise, variance {a} + {b} times the grey level")
                }
                Some(Noise::PhotonOfResidual) => {
                    "sigma from an image noise with variance a + b times the grey level, estimated from the residual (misfit \
                     counts as noise)"
                        .to_owned()
                }
                Some(Noise::Residual) | None => "sigma from the image noise estimated from the residual (misfit counts as noise)".to_owned(),
            },
        ]
    }
}

/// Writes `picture` as PNG and SVG into `folder`.
pub(crate) fn save_picture(folder: &Path, name: &str, picture: &Picture) -> Result<()> {
    ["png", "svg"].into_iter().try_for_each(|ending| Ok(picture.save(folder.join(format!("{name}.{ending}")))?))
}

pub(crate) fn locks_in(folder: &Path) -> PathBuf {
    folder.join(RESTART)
}

/// The file of a frame in words; with what it was measured from where that is not the reference given: its residual is
/// against that frame.
pub(crate) fn frame_in_words(file: &str, reference_frame: usize) -> String {
    match reference_frame {
        0 => file.to_owned(),
        frame => format!("{file} (measured from frame {frame}; displacement from the reference)"),
    }
}

pub(crate) fn csv_name(number: usize) -> String {
    format!("csv/{number:06}.csv")
}

pub(crate) fn vtu_name(number: usize) -> String {
    format!("vtu/{number:06}.vtu")
}

fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(failed(path, error)),
        _ => Ok(()),
    }
}

fn failed(path: &Path, error: std::io::Error) -> RunError {
    RunError::file(path, "written", error)
}
