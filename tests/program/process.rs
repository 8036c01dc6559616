//! The program as a process: started, sent signals, ended; and what a run leaves.

use super::Desk;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Starts the program on the desk.
pub fn start(desk: &Desk, line: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_quadrille"))
        .args(line.split_whitespace())
        .env("QUADRILLE_DEVICE", "cpu")
        .current_dir(desk.path(""))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Its exit status and what it said.
pub fn end(mut child: Child) -> (Option<i32>, String) {
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    (child.wait().unwrap().code(), said)
}

pub fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap().success());
}

/// Frames of the run in `folder` that are done.
pub fn frames_done(desk: &Desk, folder: &str) -> usize {
    // One of the entries describes the array.
    fs::read_dir(desk.path(&format!("{folder}/fields.zarr/status"))).map_or(0, |all| all.count().saturating_sub(1))
}

/// Waits until `n` frames are done.
#[track_caller]
pub fn wait_for_frames(desk: &Desk, folder: &str, n: usize) {
    let begin = Instant::now();
    while frames_done(desk, folder) < n {
        assert!(begin.elapsed() < Duration::from_secs(60), "{} frames after a minute", frames_done(desk, folder));
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn without_times(value: &mut Value) {
    match value {
        Value::Object(map) => {
            map.retain(|key, _| !key.starts_with("seconds"));
            map.values_mut().for_each(without_times);
        }
        Value::Array(items) => items.iter_mut().for_each(without_times),
        _ => {}
    }
}

/// All results of a run, but for times.
pub fn results(desk: &Desk, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let mut all: BTreeMap<String, Vec<u8>> = desk
        .all_files(folder)
        .into_iter()
        .map(|name| (name.clone(), desk.bytes(&format!("{folder}/{name}"))))
        .collect();
    let mut summary = desk.json(&format!("{folder}/summary.json"));
    without_times(&mut summary);
    all.insert("summary.json".into(), format!("{summary:#}").into_bytes());
    all
}

#[track_caller]
pub fn assert_same(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>, what: &str) {
    let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(a), names(b), "{what}: other files");
    for (name, bytes) in a {
        if &b[name] != bytes {
            let texts = [bytes, &b[name]].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
            let line = texts[0].lines().zip(texts[1].lines()).find(|(a, b)| a != b);
            panic!("{what}: {name} differs: {line:?}");
        }
    }
}
