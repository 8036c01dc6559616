//! The program, run as a user runs it: in a folder of its own, with small speckle images.
#![allow(dead_code)] // each test file takes the tools it needs

pub mod browser;
pub mod process;

use quadrille::field::ElementMark;
use quadrille::imaging::Image;
use quadrille::io::csv::{DisplacementRow, read_displacements};
use quadrille::io::images::write_image;
use quadrille::remark::{Code, Remark};
use quadrille::synth::{Depth, Motion, RenderOptions, Texture, Translation, render};
use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Size of the test images, px.
pub const WIDTH: usize = 128;
/// Size of the test images, px.
pub const HEIGHT: usize = 96;
/// The zone of most tests: whole elements of 16 px, far enough from the edges for shifts of a few px.
pub const INSIDE: &str = "--roi 16,16,112,80";
/// Nodes of [`INSIDE`]: 7 x 5.
pub const N_INSIDE: usize = 35;
/// A run that takes longer hangs: they take some 20 ms.
const PATIENCE: Duration = Duration::from_secs(60);
/// The same for what computes a joint at many instants: some 10 s.
const PATIENCE_WITH_A_JOINT: Duration = Duration::from_secs(600);

/// The test texture under `motion`.
#[track_caller]
pub fn speckle(motion: &impl Motion, depth: Depth) -> Image {
    let options = RenderOptions { depth, ..RenderOptions::new(WIDTH, HEIGHT) };
    render(&Texture::new(7, 4.5).unwrap(), motion, &options).unwrap()
}

/// The test texture moved by `u`, 8 bit.
#[track_caller]
pub fn moved(u: [f64; 2]) -> Image {
    speckle(&Translation(u), Depth::U8)
}

/// The remarks of `code` in what a file holds of a run, a frame or a fit.
#[track_caller]
pub fn remarks(of: &Value, code: Code) -> Vec<Remark> {
    let all = of.get("remarks").map_or(Vec::new(), |list| serde_json::from_value::<Vec<Remark>>(list.clone()).unwrap());
    all.into_iter().filter(|remark| remark.code == code).collect()
}

/// A folder to run the program in.
pub struct Desk(TempDir);

impl Desk {
    pub fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    /// A desk with `ref.png` and the frames `a.png`, `b.png`, `c.png`, moved by 0.25, 0.5, 0.75 px in x and
    /// the opposite in y.
    pub fn with_series() -> Self {
        let desk = Self::new();
        for (at, name) in ["ref.png", "a.png", "b.png", "c.png"].into_iter().enumerate() {
            let shift = 0.25 * at as f64;
            desk.image(name, &moved([shift, -shift]));
        }
        desk
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes an image, and its folder when needed.
    #[track_caller]
    pub fn image(&self, name: &str, image: &Image) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        write_image(&self.path(name), image).unwrap();
    }

    #[track_caller]
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        std::fs::write(self.path(name), content).unwrap();
    }

    #[track_caller]
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    #[track_caller]
    pub fn read(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).unwrap()
    }

    #[track_caller]
    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    /// The remarks of `code` on the whole run in `folder`.
    #[track_caller]
    pub fn remarks(&self, folder: &str, code: Code) -> Vec<Remark> {
        remarks(&self.json(&format!("{folder}/summary.json")), code)
    }

    #[track_caller]
    pub fn rows(&self, name: &str) -> Vec<DisplacementRow> {
        read_displacements(self.bytes(name).as_slice()).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// The files under `folder`, sorted, with `/`; those of a store have a list of their own.
    pub fn files(&self, folder: &str) -> Vec<String> {
        let mut found = self.all_files(folder);
        found.retain(|name| !name.starts_with("fields.zarr/") && !name.contains("/fields.zarr/"));
        found
    }

    /// The files under `folder`, those of stores too, but for what only a later start of the same run reads: locks and
    /// records, which tell of processes and times, and for the report.
    pub fn all_files(&self, folder: &str) -> Vec<String> {
        fn walk(folder: &Path, root: &Path, found: &mut Vec<String>) {
            for entry in std::fs::read_dir(folder).into_iter().flatten() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    walk(&path, root, found);
                } else {
                    found.push(path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/"));
                }
            }
        }
        let mut found = Vec::new();
        walk(&self.path(folder), &self.path(folder), &mut found);
        found.retain(|name| !name.starts_with("restart/") && !name.contains("/restart/"));
        // It tells of times as well.
        found.retain(|name| name != "report.html" && !name.ends_with("/report.html"));
        found.sort();
        found
    }

    /// Runs `quadrille` with the words of `line`.
    #[track_caller]
    pub fn run(&self, line: &str) -> Ran<'_> {
        self.run_words(&line.split_whitespace().collect::<Vec<_>>())
    }

    /// Runs `quadrille correlate` with the words of `line`.
    #[track_caller]
    pub fn correlate(&self, line: &str) -> Ran<'_> {
        self.run(&format!("correlate {line}"))
    }

    /// Runs `quadrille` with arguments that may hold blanks. Whatever happens, it neither panics nor hangs,
    /// and no number that it has written is NaN or infinite.
    #[track_caller]
    pub fn run_words(&self, arguments: &[&str]) -> Ran<'_> {
        self.run_with(&[], arguments)
    }

    /// As [`Desk::run_words`], with variables of the environment. The pixel work is done on the CPU unless they or the
    /// arguments say otherwise.
    #[track_caller]
    pub fn run_with(&self, environment: &[(&str, &str)], arguments: &[&str]) -> Ran<'_> {
        let mut child = Command::new(env!("CARGO_BIN_EXE_quadrille"))
            .args(arguments)
            .env("QUADRILLE_DEVICE", "cpu")
            .envs(environment.iter().copied())
            .current_dir(self.0.path())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let said = |pipe: Option<Box<dyn Read + Send>>| {
            std::thread::spawn(move || {
                let mut text = Vec::new();
                pipe.unwrap().read_to_end(&mut text).unwrap();
                String::from_utf8_lossy(&text).into_owned()
            })
        };
        let stdout = said(child.stdout.take().map(|pipe| Box::new(pipe) as _));
        let stderr = said(child.stderr.take().map(|pipe| Box::new(pipe) as _));
        let of_joint = arguments.first().is_some_and(|command| ["make", "run"].contains(command));
        let patience = if of_joint { PATIENCE_WITH_A_JOINT } else { PATIENCE };
        let begin = Instant::now();
        let code = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status.code();
            }
            if begin.elapsed() > patience {
                child.kill().unwrap();
                panic!("quadrille {arguments:?} hangs");
            }
            std::thread::sleep(Duration::from_millis(2));
        };
        let (stdout, stderr) = (stdout.join().unwrap(), stderr.join().unwrap());
        let ran = Ran { desk: self, line: arguments.join(" "), code, stdout, stderr };
        assert!(!ran.stderr.contains("panicked"), "{ran}");
        self.assert_numbers_are_finite(&ran);
        ran
    }

    #[track_caller]
    fn assert_numbers_are_finite(&self, ran: &Ran<'_>) {
        for name in self.files("") {
            // Tables of the mechanics and of fits have columns of their own, and tests that read them.
            let beside = |other: &str| self.path(&name).with_file_name(other).exists();
            if beside("reactions.csv") || beside("fit.json") {
                continue;
            }
            if name.ends_with(".csv") && !["exact", "quantities", "boundary"].iter().any(|other| name.contains(other)) {
                for row in self.read(&name).lines().filter(|line| !line.starts_with('#')).skip(1) {
                    for cell in row.split(',').rev().take(7) {
                        // A strain that is not known leaves its cell empty; the last column is a word.
                        let finite = cell.is_empty()
                            || ElementMark::from_name(cell).is_some()
                            || cell.parse::<f64>().is_ok_and(f64::is_finite);
                        assert!(finite, "{name}: '{cell}' in {row}\n{ran}");
                    }
                }
            } else if name.ends_with("summary.json") {
                // serde_json writes NaN as null: a converged frame has none, and no other but in its motion.
                for frame in self.json(&name)["frames"].as_array().unwrap() {
                    let unread = frame["status"] == "unreadable";
                    let mut nulls = Vec::new();
                    null_keys(frame, "", &mut nulls);
                    let all = "/correction_px /correction_at_px /residual_grey /residual_percent /rigid_motion /start";
                    let allowed = |key: &str| {
                        unread && all.split(' ').any(|there| there == key)
                            || frame["nodes_measured"] == 0 && key.ends_with("/rigid_motion")
                    };
                    nulls.retain(|key| !allowed(key));
                    assert!(nulls.is_empty(), "{name}: no number at {nulls:?} of {frame:#}\n{ran}");
                }
            }
        }
    }
}

fn null_keys(value: &Value, at: &str, found: &mut Vec<String>) {
    match value {
        Value::Null => found.push(at.to_owned()),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(k, item)| null_keys(item, &format!("{at}/{k}"), found));
        }
        Value::Object(map) => map.iter().for_each(|(key, item)| null_keys(item, &format!("{at}/{key}"), found)),
        _ => {}
    }
}

/// What came of a run.
pub struct Ran<'a> {
    desk: &'a Desk,
    line: String,
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl std::fmt::Display for Ran<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "quadrille {}\nexit {:?}\n{}{}", self.line, self.code, self.stdout, self.stderr)
    }
}

impl Ran<'_> {
    /// All converged: exit 0, and nothing on stdout, which is for data.
    #[track_caller]
    pub fn fine(self) -> Self {
        assert_eq!(self.code, Some(0), "{self}");
        assert_eq!(self.stdout, "", "{self}");
        self
    }

    /// As [`Ran::fine`], for a command that prints data.
    #[track_caller]
    pub fn printed(self) -> String {
        assert_eq!(self.code, Some(0), "{self}");
        self.stdout
    }

    /// Ran, but some frame did not converge: exit 1.
    #[track_caller]
    pub fn incomplete(self) -> Self {
        assert_eq!(self.code, Some(1), "{self}");
        assert_eq!(self.stdout, "", "{self}");
        self
    }

    /// Could not run: exit 2, and one line on stderr that begins with the program's name and says `wanted`.
    #[track_caller]
    pub fn refused(self, wanted: &[&str]) -> Self {
        assert_eq!(self.code, Some(2), "{self}");
        assert_eq!(self.stdout, "", "{self}");
        assert!(self.stderr.starts_with("quadrille: "), "{self}");
        assert!(self.stderr.ends_with('\n') && self.stderr.lines().count() == 1, "more than one line: {self}");
        for wanted in wanted {
            assert!(self.stderr.contains(wanted), "'{wanted}' is not said: {self}");
        }
        self
    }

    /// The frames of the summary in `folder`.
    #[track_caller]
    pub fn frames(&self, folder: &str) -> Vec<Value> {
        self.desk.json(&format!("{folder}/summary.json"))["frames"].as_array().unwrap().clone()
    }

    /// Their states.
    #[track_caller]
    pub fn statuses(&self, folder: &str) -> Vec<String> {
        self.frames(folder).iter().map(|frame| frame["status"].as_str().unwrap().to_owned()).collect()
    }
}

/// Asserts that the nodes of a table moved as `motion` says, within `tolerance` px each.
#[track_caller]
pub fn assert_moved(rows: &[DisplacementRow], motion: &impl Motion, tolerance: f64) {
    assert!(!rows.is_empty(), "the table is empty");
    for row in rows {
        let want = motion.displacement(row.px.position);
        for k in 0..2 {
            let error = row.px.displacement[k] - want[k];
            assert!(error.abs() < tolerance, "node {}: off by {error} px in direction {k}: {:?}", row.node, row.px);
        }
    }
}
