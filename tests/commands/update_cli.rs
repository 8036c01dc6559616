//! `quadrille correlate --update-reference`: large deformation, measured in stages by the program.

#![cfg(feature = "cli")]

use crate::common;
use crate::program;
use common::{eight_bit, noisy, picture, rms, rounded};
use program::{Desk, INSIDE, remarks};
use quadrille::backend::cpu::CpuBackend;
use quadrille::correlate::{Correlator, Options, ReferenceChain};
use quadrille::field::{Status, UpdateReference};
use quadrille::io::images::read_image;
use quadrille::io::npz::read_npz;
use quadrille::io::store::Store;
use quadrille::mesh::{Roi, Zone};
use quadrille::remark::Code;
use quadrille::synth::{Motion, Rotation, Translation};
use serde_json::json;
use std::fs::File;
use std::num::NonZeroUsize;
use std::sync::Arc;

const SIDE: usize = 192;
/// Frames on the way to [`turned`].
const N: usize = 16;
/// A square that stays in the image, whole elements.
const LINE: &str = "--roi 48,48,144,144 --threads 2";
/// Standard deviation of the noise of every image, of 256 grey levels.
const NOISE: f32 = 2.0;

/// A large rotation.
fn turned() -> Rotation {
    Rotation::new(80.0, SIDE, SIDE)
}

/// A desk with `s/00.png`, the reference, to `s/16.png`, on the way to `motion`.
fn desk(motion: &impl Motion) -> Desk {
    let desk = Desk::new();
    for k in 0..=N {
        let image = picture(&motion.at(k as f64 / N as f64), &eight_bit(SIDE, SIDE));
        desk.image(&format!("s/{k:02}.png"), &rounded(&noisy(&image, NOISE, k as u64)));
    }
    desk
}

/// What `summary.json` says that the frames were measured from.
fn references(desk: &Desk, folder: &str) -> Vec<u64> {
    let summary = desk.json(&format!("{folder}/summary.json"));
    let frames = summary["frames"].as_array().unwrap();
    frames.iter().map(|frame| frame["reference_frame"].as_u64().unwrap_or(0)).collect()
}

#[test]
fn a_rotation_by_80_degrees_is_measured_within_its_uncertainty() {
    let desk = desk(&turned());
    desk.correlate(&format!("{LINE} --output never s/*.png"));
    for output in ["never/summary.json", "never/run.toml"] {
        assert!(!desk.read(output).contains("reference_frame"), "{output}");
    }
    assert!(desk.read("never/run.toml").contains("update_reference = \"never\""));
    assert!(!desk.path("never/fields.zarr/reference_frame").exists() && !desk.path("never/restart/chain").exists());

    let ran = desk.correlate(&format!("{LINE} --update-reference 5 --output out s/*.png")).fine();
    let references = references(&desk, "out");
    let updates = desk.json("out/summary.json")["reference_updates"].clone();
    let first = references.iter().position(|&frame| frame > 0).unwrap() + 1;
    let said = format!("frame {first}: measured from frame {}, the new reference\n", references[first - 1]);
    assert!(ran.stderr.contains(&said), "{said} in {ran}");
    assert_eq!(ran.stderr.matches("the new reference\n").count(), updates.as_array().unwrap().len(), "{ran}");
    // Whoever opens a table or a grid alone is told.
    let (number, from) = (N, *references.last().unwrap());
    for file in [format!("out/csv/{number:06}.csv"), format!("out/vtu/{number:06}.vtu")] {
        assert!(desk.read(&file).contains(&format!("(measured from frame {from};")), "{file}");
    }
    assert!(!desk.read("out/csv/000001.csv").contains("measured from frame"));
    desk.run("export out --to csv --output exported --quiet").fine();
    for number in 1..=N {
        let name = format!("csv/{number:06}.csv");
        assert!(desk.bytes(&format!("out/{name}")) == desk.bytes(&format!("exported/{name}")), "{name}");
    }
    let store = Store::open(desk.path("out")).unwrap();
    for (k, &reference) in references.iter().enumerate() {
        let number = k + 1;
        assert_eq!(store.reference_frame(number).unwrap(), Some(reference as usize));
        assert!(reference == 0 || updates.as_array().unwrap().contains(&json!(reference)), "{reference} in {updates}");
        let found = store.frame(number).unwrap().unwrap().measurement;
        let motion = turned().at(number as f64 / N as f64);
        // The second frame starts 6 px off at the corners: by the noise one or two elements there end marked as no
        // match (six of 24 seeds).
        let measured: Vec<usize> = (0..found.measured.len()).filter(|&node| found.measured[node]).collect();
        assert!(measured.len() + 2 >= found.measured.len(), "frame {number}: {} nodes", measured.len());
        let sigmas: Vec<[f64; 2]> = measured.iter().map(|&node| found.sigma[node]).collect();
        let nodes = measured.iter().map(|&node| (found.mesh.nodes()[node], found.displacement[node])).zip(&sigmas);
        let ratios: Vec<[f64; 2]> = nodes
            .map(|((x, u), sigma)| {
                let exact = motion.displacement(x);
                [0, 1].map(|c| (u[c] - exact[c]) / sigma[c])
            })
            .collect();
        let ratio = rms(&ratios) / f64::sqrt(2.0); // of one component
        let error: Vec<[f64; 2]> =
            ratios.iter().zip(&sigmas).map(|(ratio, sigma)| [0, 1].map(|c| ratio[c] * sigma[c])).collect();
        let error_px = rms(&error) / f64::sqrt(2.0);
        println!("frame {number}, from {reference}: error {ratio:.2} of its uncertainty, {error_px:.4} px rms");
        // One draw of 98 numbers, which neighbours share, scatters by 0.1; printed are 0.87 to 1 of the scatter
        // (docs/correlation.md, 2.10).
        assert!((0.7..1.4).contains(&ratio), "frame {number}: {ratio}");
    }
}

#[test]
fn a_reference_serves_for_n_frames_and_every_way_to_say_so_is_the_same() {
    let desk = desk(&Translation([8.0, -4.0]));
    desk.write("case.toml", "[correlation]\nupdate_reference = \"every 4\"");
    let want: Vec<u64> = (0..N as u64).map(|k| k / 4 * 4).collect();
    let mut first = None;
    for flags in [
        "--update-reference every 4",
        "--update-reference=every 4",
        "--update-reference every:4",
        "--update-reference 4",
        "--case case.toml",
        "--case run.toml",
    ] {
        desk.correlate(&format!("--overwrite {LINE} --output out {flags} s/*.png")).fine();
        assert_eq!(references(&desk, "out"), want, "{flags}");
        assert_eq!(desk.json("out/summary.json")["reference_updates"], json!([4, 8, 12]));
        let case = desk.read("out/run.toml");
        assert!(case.contains("update_reference = \"every 4\""), "{case}");
        desk.write("run.toml", case);
        let field = desk.bytes("out/fields.zarr/displacement_px/c.15.0.0");
        assert!(*first.get_or_insert_with(|| field.clone()) == field, "{flags}");
    }
    desk.correlate(&format!("--overwrite {LINE} --output out --case case.toml --update-reference never s/*.png"))
        .fine();
    assert_eq!(references(&desk, "out"), [0; N]);
}

#[test]
fn the_program_gives_the_bits_of_the_library() {
    let desk = desk(&turned());
    desk.correlate(&format!("{LINE} --update-reference 5 --output out s/*.png")).fine();
    let store = Store::open(desk.path("out")).unwrap();
    let image = |k: usize| Arc::new(read_image(&desk.path(&format!("s/{k:02}.png")), 0).unwrap().image);
    let zones = [Zone::rectangle("zone1", Roi { x0: 48.0, y0: 48.0, x1: 144.0, y1: 144.0 })];
    let correlator = Correlator::new(CpuBackend::default(), image(0), &zones, Options::default()).unwrap();
    let every = UpdateReference::Every(NonZeroUsize::new(5).unwrap());
    let mut chain = ReferenceChain::new(Arc::new(correlator), every);
    for number in 1..=N {
        let wanted = chain.correlate(number, image(number)).unwrap();
        let found = store.frame(number).unwrap().unwrap().measurement;
        assert_eq!(found.status, Status::Converged);
        assert!(found.displacement == wanted.measurement.displacement, "frame {number}");
        let singles = |sigma: &[[f64; 2]]| sigma.iter().map(|s| s.map(|s| s as f32)).collect::<Vec<_>>();
        assert!(singles(&found.sigma) == singles(&wanted.measurement.sigma), "frame {number}");
        assert_eq!(store.reference_frame(number).unwrap(), Some(wanted.reference_frame));
    }
    assert_eq!(desk.json("out/summary.json")["reference_updates"], json!(chain.updates()));
}

#[test]
fn exported_arrays_tell_what_each_frame_was_measured_from() {
    let desk = desk(&Translation([8.0, -4.0]));
    desk.correlate(&format!("{LINE} --update-reference 6 --output out s/*.png")).fine();
    desk.run("export out --to npz --quiet").fine();
    let arrays = read_npz(File::open(desk.path("out/fields.npz")).unwrap()).unwrap();
    let want: Vec<u32> = (0..N as u32).map(|k| k / 6 * 6).collect();
    assert_eq!(arrays["reference_frame"], quadrille::io::arrays::Values::U32(want));
}

#[test]
fn a_frame_that_is_no_new_reference_is_told_with_the_reason() {
    // At the end less than a fifth of the zone is left in the image.
    let desk = desk(&Translation([0.0, 168.0]));
    let line = "--roi 16,16,176,176 --update-reference every 1 --threads 2 --output out s/*.png";
    let ran = desk.correlate(line).incomplete();
    let summary = desk.json("out/summary.json");
    let frames = summary["frames"].as_array().unwrap();
    let refused = frames.iter().filter(|frame| !remarks(frame, Code::ReferenceRefused).is_empty()).count();
    assert!(refused > 0 && ran.stderr.contains("of zone 'zone1'"), "{ran}");
    assert!(ran.stderr.matches("is no new reference").count() >= refused, "{ran}");
}

#[test]
fn what_cannot_go_with_it_is_refused() {
    let desk = Desk::with_series();
    let line = |flags: &str| format!("{INSIDE} --output out {flags} ref.png a.png b.png");
    for (flags, wanted) in [
        ("--start independent --update-reference residual", "--update-reference residual does not go with --start"),
        ("--update-reference every 3 --shard 1/2", "--update-reference every 3 does not go with --shard"),
        ("--elements cubic-spline --update-reference every 3", "does not go with --elements cubic-spline"),
        ("--elements cubic", "`cubic` is not a choice for elements; expected bilinear or cubic-spline"),
        ("--update-reference every 0", "`every 0` is not a choice for update-reference; expected never, residual"),
        ("--update-reference often", "`often` is not a choice"),
        ("--update-reference every", "`every ref.png`"),
        ("--update-reference -3", "`-3` is not a choice"),
    ] {
        desk.correlate(&line(flags)).refused(&[wanted]);
        assert!(!desk.path("out/run.toml").exists());
    }
    desk.write("case.toml", "[correlation]\nstart = \"independent\"\nupdate_reference = \"residual\"");
    desk.correlate(&line("--case case.toml")).refused(&["does not go with --start independent", "leave one"]);
    desk.write("case.toml", "[images]\ndeformed = \"*.png\"\n[correlation]\nupdate_reference = \"every 5\"");
    let slurm = "slurm case.toml --output out --array 2";
    desk.run(slurm).refused(&["case.toml", "every 5", "tasks cannot share"]);
    desk.write("case.toml", "[images]\ndeformed = \"*.png\"\n[correlation]\nupdate_reference = \"never\"");
    desk.run(slurm).printed();
}
