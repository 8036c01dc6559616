//! Every reader of files of others on seeds that are changed at random (fuzz/seeds): nothing panics, and nothing takes
//! long. The long attack, guided by coverage, is `make fuzz`; this one runs in the program that the tests are built
//! into anyway, a fixed number of changes of each seed, or with `QUADRILLE_FUZZ_SECONDS` so long for each reader.

#![cfg(feature = "cli")]

use crate::readers;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::fs;
use std::panic::catch_unwind;
use std::path::Path;
use std::time::{Duration, Instant};

/// Changes of each reader's seeds in all, without a time that is asked for.
const CHANGES: u64 = 1500;
/// What one file may take: a hundred times what the slowest does, on a machine that is busy.
const PATIENCE: Duration = Duration::from_secs(20);

/// Bytes and words on which formats turn.
const WORDS: [&[u8]; 14] = [
    b"0",
    b"-1",
    b"1e308",
    b"nan",
    b"4294967296",
    b"18446744073709551615",
    b"\n",
    b",",
    b"\"",
    b"[",
    b"\xff\xff\xff\xff",
    b"\0\0\0\0",
    b"\x7f\xff\xff\xff",
    b"\0\0\0\x80",
];

/// One to eight changes of `seed`: bits, bytes, numbers, pieces that are cut, doubled, or come from `other`.
fn changed(seed: &[u8], other: &[u8], random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut data = seed.to_vec();
    for _ in 0..random.random_range(1..=8) {
        let at = random.random_range(0..=data.len());
        let end = (at + random.random_range(1..=32)).min(data.len());
        match random.random_range(0..8) {
            0 | 1 if at < data.len() => data[at] ^= 1 << random.random_range(0..8),
            2 if at < data.len() => data[at] = random.random(),
            3 => drop(data.drain(at..end)),
            4 => {
                let piece = data[at..end].to_vec();
                data.splice(at..at, piece);
            }
            5 => {
                let word = WORDS.choose(random).unwrap();
                let over = if random.random() { (at + word.len()).min(data.len()) } else { at };
                data.splice(at..over, word.iter().copied());
            }
            6 if !other.is_empty() => {
                let from = random.random_range(0..other.len());
                let piece = other[from..(from + 64).min(other.len())].to_vec();
                data.splice(at..end, piece);
            }
            7 => {
                // Another number where one stands.
                let digits = data[at..].iter().position(u8::is_ascii_digit).map(|k| at + k);
                if let Some(first) = digits {
                    let n = data[first..].iter().take_while(|b| b.is_ascii_digit()).count();
                    let number: u64 = random.random::<u64>() >> random.random_range(0..64);
                    data.splice(first..first + n, number.to_string().into_bytes());
                }
            }
            _ => data.truncate(at),
        }
    }
    data
}

/// The seeds of the reader `name`.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds").join(name);
    let Ok(entries) = fs::read_dir(&folder) else {
        println!("no seeds: {}", folder.display());
        return Vec::new();
    };
    let mut files: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    files.sort();
    files.iter().map(|file| fs::read(file).unwrap()).collect()
}

/// The seeds of the store are its own files, and changes of them.
fn seeds_of_store() -> Vec<Vec<u8>> {
    let run = tempfile::tempdir().unwrap();
    let files = readers::whole_store(&run.path().join("fields.zarr"));
    let whole = files.iter().zip(0..).map(|(file, k)| [&[k, 0], fs::read(file).unwrap().as_slice()].concat());
    whole.chain((0..files.len() as u8).map(|k| vec![k, 1, 0, 3, 7])).collect()
}

#[track_caller]
fn attack(name: &str) {
    let read = readers::ALL.iter().find(|(other, _)| *other == name).unwrap().1;
    let seeds = [seeds(name), if name == "store" { seeds_of_store() } else { Vec::new() }].concat();
    let asked = std::env::var("QUADRILLE_FUZZ_SECONDS").ok().map(|text| text.parse().unwrap());
    let (begin, time) = (Instant::now(), asked.map(Duration::from_secs_f64));
    // As they stand first: those of former findings.
    for number in 0.. {
        let seed = match seeds.get(number as usize) {
            Some(seed) => seed,
            None if seeds.is_empty() || time.map_or(number >= CHANGES, |time| begin.elapsed() > time) => {
                println!("{name}: {number} executions in {:.1} s", begin.elapsed().as_secs_f64());
                return;
            }
            None => &seeds[number as usize % seeds.len()],
        };
        let mut random = ChaCha8Rng::seed_from_u64(number);
        let other = seeds.choose(&mut random).unwrap();
        let data = if (number as usize) < seeds.len() { seed.clone() } else { changed(seed, other, &mut random) };
        let start = Instant::now();
        let ended = catch_unwind(|| read(&data));
        if ended.is_err() || start.elapsed() > PATIENCE {
            let file = std::env::temp_dir().join(format!("quadrille-finding-{name}-{number}"));
            fs::write(&file, &data).unwrap();
            panic!("{name}, change {number}: {:?}; kept in {}", start.elapsed(), file.display());
        }
    }
}

#[test]
fn no_image_ends_the_program() {
    attack("images");
}

#[test]
fn no_mask_ends_the_program() {
    attack("masks");
}

#[test]
fn no_mesh_ends_the_program() {
    attack("meshes");
}

#[test]
fn no_field_ends_the_program() {
    attack("fields");
}

#[test]
fn no_case_ends_the_program() {
    attack("cases");
}

#[test]
fn no_joint_ends_the_program() {
    attack("joints");
}

#[test]
fn no_table_ends_the_program() {
    attack("tables");
}

#[test]
fn no_damaged_store_ends_the_program() {
    attack("store");
}

#[test]
fn no_damaged_state_of_a_run_ends_the_program() {
    attack("state");
}

#[test]
fn every_reader_is_attacked_and_has_a_fuzz_target() {
    let source = include_str!("fuzz.rs");
    for (name, _) in readers::ALL {
        assert!(source.contains(&format!("attack(\"{name}\")")), "{name}");
        let target = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("fuzz/src/bin/{name}.rs"));
        assert!(target.is_file() || !target.parent().unwrap().is_dir(), "{name}");
    }
}
