//! Constants of a bar, as a user meets them. The images are drawn by spots, and owe nothing to the program.

#![cfg(feature = "cli")]

use crate::common::spots::Spots;
use crate::program::Desk;
use std::collections::BTreeMap;

const YOUNG: f64 = 2000.0;
const NU: f64 = 0.35;
const AREA: f64 = 20.0;
const SIZE: [usize; 2] = [128, 192];
const N: usize = 24;

/// A polymer pulled along y by 0.3 MPa a frame, elastic up to 0.36 % of strain.
fn series(desk: &Desk) -> String {
    let spots = Spots::random(SIZE[1], 1.9, 7);
    let image = |name: &str, seed: u64, stress: f64| {
        let (along, across) = (stress / YOUNG, -NU * stress / YOUNG);
        let place = |[x, y]: [f64; 2]| [x + across * (x - 64.0) + 0.4, y + along * (y - 96.0) - 0.3];
        desk.image(name, &spots.image(SIZE, 1.0, seed, place));
    };
    image("00.png", 1, 0.0);
    let mut load = "load_N\n".to_owned();
    for k in 1..=N {
        let stress = 0.3 * k as f64;
        image(&format!("{k:02}.png"), 1 + k as u64, stress);
        load += &format!("{:?}\n", stress * AREA);
    }
    desk.write("load.csv", load);
    let names: Vec<String> = (0..=N).map(|k| format!("{k:02}.png")).collect();
    names.join(" ")
}

fn constants(desk: &Desk, folder: &str) -> BTreeMap<String, BTreeMap<String, String>> {
    let text = desk.read(&format!("{folder}/quantities/tension.csv"));
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(text.as_bytes());
    let rows = reader.deserialize::<BTreeMap<String, String>>().map(|row| row.unwrap());
    rows.map(|row| (row["constant"].clone(), row)).collect()
}

#[track_caller]
fn number(of: &BTreeMap<String, String>, column: &str) -> f64 {
    of[column].parse().unwrap_or_else(|_| panic!("no {column} in {of:?}"))
}

#[test]
fn a_pulled_bar_gives_modulus_and_poissons_ratio_within_their_uncertainty() {
    let desk = Desk::new();
    let images = series(&desk);
    desk.write(
        "bar.toml",
        format!(
            "[camera]\nexact = true\n[[zone]]\nroi = [8, 8, 120, 184]\n[load]\nfile = 'load.csv'\narea_mm2 = {AREA}\n\
             [[region]]\nname = 'middle'\nroi = [24, 24, 104, 168]\n[tension]\narea_mm2_std = 0.1\n"
        ),
    );
    let ran = desk.correlate(&format!("--case bar.toml --output out {images}")).fine();
    assert!(ran.stderr.contains("E = ") && ran.stderr.contains("nu = "), "{ran}");
    let found = constants(&desk, "out");
    for (name, truth, relative) in [("E_MPa", YOUNG, 0.02), ("nu", NU, 0.08)] {
        let (value, sigma) = (number(&found[name], "value"), number(&found[name], "sigma"));
        // Four standard uncertainties are chance once in 15 000.
        assert!((value - truth).abs() < 4.0 * sigma && sigma < relative * truth, "{name}: {value} +- {sigma}");
    }
    let area = number(&found["E_MPa"], "sigma_area") / number(&found["E_MPa"], "value");
    assert!((area - 0.1 / AREA).abs() < 1e-12, "{area}");
    // It does not yield.
    assert!(found["Rp_MPa"]["value"].is_empty() && found["r"]["value"].is_empty());
    let missing = desk.run("probe out").fine();
    assert!(missing.stderr.contains("there is no Rp: the curve does not leave the line by 0.002"), "{missing}");
    assert!(desk.read("out/report.html").contains("Tensile test"));
    // Gauges across each other say the same, by flags.
    let flags = "--extensometer 64,24,64,168 --extensometer 24,96,104,96 --width 60 --tension extensometer1 --across \
                 extensometer2 --load load.csv --area 20 --curves";
    desk.run(&format!("probe out {flags} --output other")).fine();
    let other = constants(&desk, "other");
    let (a, b) = (&found["E_MPa"], &other["E_MPa"]);
    // Nobody said how well the area is known: 1 %.
    assert!((number(b, "sigma_area") / number(b, "value") - 0.01).abs() < 1e-12, "{b:?}");
    let apart = number(a, "value") - number(b, "value");
    // The same noise, weighed otherwise.
    assert!(apart.abs() < 4.0 * number(b, "sigma_noise"), "{apart}");
    assert!(desk.files("other/curves").contains(&"tension-stress_MPa-against-strain_along.png".to_owned()));
}

#[test]
fn what_a_tensile_test_lacks_is_refused_or_said() {
    let desk = Desk::new();
    let images = series(&desk);
    desk.correlate(&format!("--roi 8,8,120,184 --output out {images}")).fine();
    let region = "--region 24,24,104,168";
    desk.run(&format!("probe out {region} --tension nothing")).refused(&["[tension] along", "'nothing'", "region1"]);
    desk.run(&format!("probe out {region} --tension region1 --modulus-range 0.2,0.1"))
        .refused(&["modulus_range", "0.2 to 0.1 is no range"]);
    desk.run(&format!("probe out {region} --tension region1 --area-std 0.1"))
        .refused(&["area_mm2_std", "area_mm2 in [load]"]);
    desk.run("probe out --point 60,60 --tension region1").refused(&["[tension] along", "region1"]);
    // Without a force there is Poisson's ratio.
    let ran = desk.run(&format!("probe out {region} --tension region1")).fine();
    assert!(ran.stderr.contains("there is no E: no force is known"), "{ran}");
    assert!((number(&constants(&desk, "out")["nu"], "value") - NU).abs() < 0.1);
    // Too few frames lie in a range.
    let ran = desk
        .run(&format!("probe out {region} --tension region1 --load load.csv --area 20 --modulus-range 0.004,0.005"));
    let ran = ran.fine();
    assert!(ran.stderr.contains("0 frames lie between strains of 0.004 and 0.005"), "{ran}");
    // A bent line is told where the load was misread beyond the middle.
    let bent: String = (1..=N).map(|k| format!("{:?}\n", AREA * (0.3 * k as f64 - 0.008 * (k * k) as f64))).collect();
    desk.write("bent.csv", format!("load_N\n{bent}"));
    let ran = desk.run(&format!("probe out {region} --tension region1 --load bent.csv --area 20")).fine();
    assert!(ran.stderr.contains("the line of E_MPa is bent"), "{ran}");
}
