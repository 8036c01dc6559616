//! A series spread over a real Slurm of one node (`tests/slurm/start.sh`): the scripts of `quadrille slurm`, a task
//! that is killed and submitted again, and the job that checks and exports.
#![cfg(feature = "cli")]
#![cfg(target_os = "linux")]

mod program;

use program::Desk;
use quadrille::io::images::write_image;
use quadrille::synth::{Depth, RenderOptions, Texture, Translation, render};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Frames of the series: so many that a task of the array has work left when it is stopped after its first.
const N: usize = 200;
const ARRAY: usize = 4;

/// A running Slurm, ended when dropped.
struct Cluster {
    folder: PathBuf,
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/slurm").join(name)
}

impl Cluster {
    /// Starts one in `folder`; `None`, said, where Slurm or the right to start it is missing.
    fn start(folder: PathBuf) -> Option<Self> {
        let required = std::env::var("QUADRILLE_SLURM").is_ok_and(|value| value == "require");
        let started = Command::new(script("start.sh")).arg(&folder).output().unwrap();
        let said = String::from_utf8_lossy(&started.stderr).into_owned();
        let cluster = Self { folder };
        match started.status.code() {
            Some(0) => Some(cluster),
            Some(3) if !required => {
                println!("skipped: {said}");
                None
            }
            _ => panic!("Slurm does not start: {said}"),
        }
    }

    fn command(&self, program: &str, arguments: &[&str], at: &Path) -> Output {
        Command::new(program)
            .args(arguments)
            .env("SLURM_CONF", self.folder.join("slurm.conf"))
            .current_dir(at)
            .output()
            .unwrap_or_else(|error| panic!("{program}: {error}"))
    }

    /// What a command says, which must end well.
    #[track_caller]
    fn say(&self, program: &str, arguments: &[&str], at: &Path) -> String {
        let done = self.command(program, arguments, at);
        assert!(done.status.success(), "{program} {arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap().trim().to_owned()
    }

    /// Waits until no job of the user is left.
    fn wait(&self, at: &Path) {
        let begin = Instant::now();
        while !self.say("squeue", &["-h", "-t", "PD,R,CG,CF"], at).is_empty() {
            assert!(begin.elapsed() < Duration::from_secs(120), "{}", self.say("squeue", &[], at));
            std::thread::sleep(Duration::from_millis(200));
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let _ = Command::new(script("stop.sh")).arg(&self.folder).status();
    }
}

/// A series of larger images, so that a task can be met at work, and its case.
fn series() -> Desk {
    let desk = Desk::new();
    let options = RenderOptions { depth: Depth::U8, ..RenderOptions::new(640, 480) };
    let texture = Texture::new(7, 4.5).unwrap();
    std::fs::create_dir_all(desk.path("s")).unwrap();
    for k in 0..=N {
        let image = render(&texture, &Translation([0.04 * k as f64, -0.03 * k as f64]), &options).unwrap();
        write_image(&desk.path(&format!("s/{k:02}.png")), &image).unwrap();
    }
    desk.write(
        "my case.toml",
        "[images]\nreference = \"s/00.png\"\ndeformed = \"s/*.png\"\n[correlation]\nelement_size_px = 8\n\
         interpolation = \"quintic\"\n[[zone]]\nname = \"all\"\nroi = [32, 32, 608, 448]\n",
    );
    desk
}

/// Process of task `task` of an array, which runs on this machine: found by the environment that Slurm gives it.
fn process_of(task: usize) -> Option<String> {
    let own = std::fs::canonicalize(env!("CARGO_BIN_EXE_quadrille")).unwrap();
    let name = format!("SLURM_ARRAY_TASK_ID={task}");
    let processes = std::fs::read_dir("/proc").unwrap().filter_map(Result::ok).map(|entry| entry.path());
    let is_it = |path: &PathBuf| {
        std::fs::read_link(path.join("exe")).is_ok_and(|exe| exe == own)
            && std::fs::read(path.join("environ"))
                .is_ok_and(|all| all.split(|&byte| byte == 0).any(|word| word == name.as_bytes()))
    };
    let found = processes.into_iter().find(is_it)?;
    Some(found.file_name()?.to_string_lossy().into_owned())
}

/// Stops task `task` when it has written a record of its share in `records`: it is held as soon as it is seen and let
/// go for moments, so that neither a fast nor a busy machine lets it end.
fn stop_at_work(task: usize, records: &Path) {
    let begin = Instant::now();
    let signal = |which: &str, id: &str| {
        assert!(Command::new("kill").args([which, id]).status().unwrap().success(), "task {task} has ended: {which}");
    };
    let id = loop {
        assert!(begin.elapsed() < Duration::from_secs(60), "task {task} does not start");
        match process_of(task) {
            Some(id) => break id,
            None => std::thread::sleep(Duration::from_millis(5)),
        }
    };
    let has_record = || {
        let names = std::fs::read_dir(records)
            .into_iter()
            .flatten()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        names
            .filter_map(|name| name.strip_suffix(".json")?.parse::<usize>().ok())
            .any(|number| number % ARRAY == task % ARRAY)
    };
    signal("-STOP", &id);
    while !has_record() {
        assert!(begin.elapsed() < Duration::from_secs(60), "task {task} writes nothing");
        signal("-CONT", &id);
        std::thread::sleep(Duration::from_millis(20));
        signal("-STOP", &id);
    }
}

#[test]
fn an_array_over_a_real_slurm_gives_the_bits_of_one_process_although_a_task_was_killed() {
    let desk = series();
    let Some(cluster) = Cluster::start(desk.path("slurm")) else { return };
    let at = desk.path("");
    let array = ARRAY.to_string();
    let made = desk.run_words(&[
        "slurm",
        "my case.toml",
        "--output",
        "out",
        "--array",
        &array,
        "--cpus",
        "1",
        "--export",
        "npz",
    ]);
    let commands = made.printed();
    assert!(commands.contains("sbatch --parsable './my case-array.sbatch'"), "{commands}");
    let job = cluster.say("sbatch", &["--parsable", "my case-array.sbatch"], &at);
    // One task is killed at work.
    stop_at_work(2, &desk.path("out/restart/frames"));
    cluster.say("scancel", &["--signal=KILL", "--full", &format!("{job}_2")], &at);
    cluster.say("scancel", &[&format!("{job}_2")], &at);
    cluster.wait(&at);
    let status = desk.run_words(&["status", "out", "--json"]);
    assert_eq!(status.code, Some(1), "{status}");
    let about: serde_json::Value = serde_json::from_str(&status.stdout).unwrap();
    println!("after the kill: {about}");

    // The same task again, and the job that checks when it has ended.
    let again = cluster.say("sbatch", &["--parsable", "--array=2", "my case-array.sbatch"], &at);
    let dependency = format!("--dependency=afterany:{again}");
    let check = cluster.say("sbatch", &["--parsable", &dependency, "my case-check.sbatch"], &at);
    cluster.wait(&at);
    let log = desk.read(&format!("quadrille-check-{check}.log"));
    assert!(log.contains(&N.to_string()), "{log}");
    desk.run_words(&["status", "out"]).printed();
    assert!(desk.all_files("out").iter().any(|name| name.ends_with(".npz")), "exported: {log}");

    desk.run_words(&[
        "correlate",
        "--case",
        "my case.toml",
        "--start",
        "independent",
        "--threads",
        "1",
        "--output",
        "one",
    ])
    .fine();
    let chunks = |folder: &str| -> Vec<(String, Vec<u8>)> {
        let names = desk.all_files(folder).into_iter().filter(|name| name.contains("/c."));
        names.map(|name| (name.clone(), desk.bytes(&format!("{folder}/{name}")))).collect()
    };
    let (one, many) = (chunks("one"), chunks("out"));
    assert!(one.len() > 5 * N);
    assert!(one == many, "the fields of an array differ from those of one process");
}
