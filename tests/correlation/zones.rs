//! Zones by themselves: where the specimen is in an image, what is left out and why, borders beside which there is
//! nothing to see, and texture that turns out to be noise. The pictures are drawn here, disc by disc, and not by the
//! program's renderer.

use crate::common;
use crate::program;
use common::{data, drawn, prepared, zone};
use program::Desk;
use quadrille::correlate::Options;
use quadrille::imaging::{Image, Levels, Pixels, Specimen};
use quadrille::io::csv::NodeValues;
use quadrille::io::images::read_image;
use quadrille::mesh::{Guard, Zone};
use quadrille::remark::Code;
use std::sync::Arc;

const WIDTH: usize = 400;
const HEIGHT: usize = 320;

/// Numbers between 0 and 1, the same for one `seed`.
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Nearly normal, with variance one.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.roll()).sum::<f64>() - 6.0
    }
}

/// Dark discs of about `radius` px with soft edges on a bright ground, as dense as `density` (discs' area by area),
/// moved by `shift`.
fn discs(width: usize, height: usize, radius: f64, density: f64, shift: [f64; 2], seed: u64) -> Vec<f64> {
    let mut dice = Dice(seed);
    let mut grey = vec![205.0_f64; width * height];
    let margin = 30.0;
    let (w, h) = (width as f64 + 2.0 * margin, height as f64 + 2.0 * margin);
    let n = (density * w * h / (std::f64::consts::PI * radius * radius)) as usize;
    for _ in 0..n {
        let centre = [dice.roll() * w - margin + shift[0], dice.roll() * h - margin + shift[1]];
        let r = radius * (0.7 + 0.6 * dice.roll());
        let reach = r + 3.0;
        let range =
            |c: f64, n: usize| (c - reach).max(0.0) as usize..((c + reach).max(-1.0) + 1.0).min(n as f64) as usize;
        for y in range(centre[1], height) {
            for x in range(centre[0], width) {
                let distance = (x as f64 - centre[0]).hypot(y as f64 - centre[1]);
                let dark = 55.0 + 150.0 / (1.0 + (-(distance - r) / 0.6).exp());
                grey[y * width + x] = grey[y * width + x].min(dark);
            }
        }
    }
    grey
}

/// What a camera makes of it: noise and 8 bit.
fn shot(width: usize, height: usize, grey: impl Fn(usize, usize) -> f64, noise: f64, seed: u64) -> Arc<Image> {
    let mut dice = Dice(seed);
    let level = |at: usize| (grey(at % width, at / width) + noise * dice.normal()).round().clamp(0.0, 255.0) as u8;
    Arc::new(Image::new(width, height, Pixels::U8((0..width * height).map(level).collect())).unwrap())
}

const HOLE: ([f64; 2], f64) = ([140.0, 150.0], 40.0);

fn in_hole(x: usize, y: usize) -> bool {
    (x as f64 - HOLE.0[0]).hypot(y as f64 - HOLE.0[1]) < HOLE.1
}

/// A strip from row 48 to 272, with a hole and a glaring spot, between dark grounds; above it an island, a wire and
/// dust.
fn is_specimen(x: usize, y: usize) -> bool {
    (48..272).contains(&y) && !in_hole(x, y) && !is_glaring(x, y)
}

fn is_glaring(x: usize, y: usize) -> bool {
    (270..340).contains(&x) && (120..190).contains(&y)
}

fn strip_with_a_hole(shift: [f64; 2], seed: u64) -> Arc<Image> {
    let texture = discs(WIDTH, HEIGHT, 2.5, 0.6, shift, 11);
    let grey = |x: usize, y: usize| {
        let is_island = (200..228).contains(&x) && (8..30).contains(&y);
        let is_wire = (20..24).contains(&((x + y) % 400)) && y < 48;
        match () {
            () if is_glaring(x, y) => 300.0,
            () if is_specimen(x, y) || is_island => texture[y * WIDTH + x],
            () if is_wire => 180.0,
            () => 14.0,
        }
    };
    shot(WIDTH, HEIGHT, grey, 1.5, seed)
}

/// Shares of the pixels found that are no specimen, and of the specimen (but for `rim` px at its borders) that is not
/// found.
fn wrong_and_missed(found: &Specimen, rim: usize) -> [f64; 2] {
    let pixels = || (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    let is_found = |x: usize, y: usize| found.parts.iter().any(|part| part.contains(x, y));
    let n_found = pixels().filter(|&(x, y)| is_found(x, y)).count();
    let wrong = pixels().filter(|&(x, y)| is_found(x, y) && !is_specimen(x, y)).count();
    let is_deep = |x: usize, y: usize| {
        (rim..WIDTH - rim).contains(&x)
            && (rim..HEIGHT - rim).contains(&y)
            && [(0, rim), (rim, 0), (2 * rim, rim), (rim, 2 * rim), (rim, rim)]
                .iter()
                .all(|(dx, dy)| is_specimen(x + dx - rim, y + dy - rim))
    };
    let deep = pixels().filter(|&(x, y)| is_deep(x, y)).count();
    let missed = pixels().filter(|&(x, y)| is_deep(x, y) && !is_found(x, y)).count();
    [wrong as f64 / n_found as f64, missed as f64 / deep as f64]
}

#[test]
fn the_specimen_is_found_without_its_hole_the_ground_the_glare_and_what_lies_apart() {
    let found = Specimen::find(&strip_with_a_hole([0.0; 2], 1), 16, 8);
    assert_eq!(found.parts.len(), 1, "{:?}", found.parts.iter().map(|part| part.bounds).collect::<Vec<_>>());
    let [wrong, missed] = wrong_and_missed(&found, 12);
    // Cells of 4 px: half a cell too far along 1300 px of border would be 3 % of 82 000 px. The guard takes 3 px off.
    assert!(wrong < 0.025, "{wrong}");
    assert!(missed < 0.03, "{missed}");
    // Nothing of the hole but its rim, nothing of the island.
    let part = &found.parts[0];
    for (x, y) in (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y))).filter(|&(x, y)| part.contains(x, y)) {
        let [dx, dy] = [x as f64 - HOLE.0[0], y as f64 - HOLE.0[1]];
        assert!(dx.hypot(dy) > HOLE.1 - 4.0 && (44..276).contains(&y), "({x}, {y})");
    }
    // Its largest rectangle is what lies left of the hole, right of it or below both: 80 rows, 330 columns and more.
    let [x0, y0, x1, y1] = part.largest_rectangle();
    assert!((y0..y1).all(|y| (x0..x1).all(|x| part.contains(x, y))), "{:?}", [x0, y0, x1, y1]);
    assert!((x1 - x0) * (y1 - y0) > 70 * 330, "{:?}", [x0, y0, x1, y1]);
    let left_out = found.left_out;
    // 70 x 70 px of 400 x 320, within a window; the ground and the hole; the island.
    assert!((left_out.saturated - 0.038).abs() < 0.012, "{left_out:?}");
    assert!(left_out.textureless > 0.25 && left_out.apart > 0.002 && left_out.border > 0.02, "{left_out:?}");
    let all = found.share(&strip_with_a_hole([0.0; 2], 1))
        + left_out.saturated
        + left_out.textureless
        + left_out.apart
        + left_out.border;
    assert!((all - 1.0).abs() < 1e-9, "{all}");
}

#[test]
fn metrology_looks_at_the_zone_that_a_correlation_would_find() {
    let desk = Desk::new();
    desk.image("ref.png", &strip_with_a_hole([0.0; 2], 1));
    let ran = desk.run("metrology ref.png --element-sizes 16 --output found");
    assert_eq!(ran.code, Some(0), "{ran}");
    let found = desk.json("found/metrology.json");
    let roi: Vec<String> = found["options"]["roi_px"].as_array().unwrap().iter().map(ToString::to_string).collect();
    let ran = desk.run(&format!("metrology ref.png --element-sizes 16 --output named --roi {}", roi.join(",")));
    assert_eq!(ran.code, Some(0), "{ran}");
    assert_eq!(found["texture"], desk.json("named/metrology.json")["texture"]);
    // Hole, ground and glare have no texture: nothing of them is in it.
    assert_eq!(found["sizes"][0]["refused_percent"], 0.0);
}

#[test]
fn two_strips_beside_a_dark_joint_are_two_parts_and_a_textured_image_is_one_rectangle() {
    let texture = discs(WIDTH, HEIGHT, 2.5, 0.6, [0.0; 2], 3);
    let joint = |x: usize, y: usize| if (144..160).contains(&y) { 12.0 } else { texture[y * WIDTH + x] };
    let found = Specimen::find(&shot(WIDTH, HEIGHT, joint, 1.5, 4), 16, 8);
    assert_eq!(found.parts.len(), 2);
    let mut rows: Vec<[usize; 2]> = found.parts.iter().map(|part| [part.bounds[1], part.bounds[3]]).collect();
    rows.sort_unstable();
    assert!((136..=145).contains(&rows[0][1]) && (159..=168).contains(&rows[1][0]), "{rows:?}");
    for (radius, density) in [(1.5, 0.6), (2.5, 0.6), (4.0, 0.8)] {
        let texture = discs(WIDTH, HEIGHT, radius, density, [0.0; 2], 5);
        let found = Specimen::find(&shot(WIDTH, HEIGHT, |x, y| texture[y * WIDTH + x], 1.5, 6), 16, 8);
        let shape: Vec<_> = found.parts.iter().map(|part| (part.bounds, part.bits.is_none())).collect();
        assert_eq!(shape, [([8, 8, WIDTH - 8, HEIGHT - 8], true)], "discs of {radius} px");
    }
}

#[test]
fn noise_stripes_and_one_grey_level_are_no_specimen() {
    let none = |what: &str, image: &Image| {
        let found = Specimen::find(image, 16, 8);
        assert!(found.parts.is_empty(), "{what}: {:?}", found.parts.iter().map(|part| part.bounds).collect::<Vec<_>>());
    };
    none("grey", &drawn(256, 256, |_, _| 90.0));
    none("white", &drawn(256, 256, |_, _| 255.0));
    none("noise", &shot(256, 256, |_, _| 100.0, 4.0, 8));
    none("stripes", &shot(256, 256, |x, _| if x % 9 < 4 { 40.0 } else { 200.0 }, 1.0, 9));
    none("tiny", &drawn(7, 5, |x, y| ((x * y) % 3) as f32 * 80.0));
    none("one pixel", &drawn(1, 1, |_, _| 3.0));
}

#[test]
fn the_zone_does_not_depend_on_threads_depth_or_scale_of_grey() {
    let image = strip_with_a_hole([0.0; 2], 2);
    let Levels::U8(levels) = image.pixels() else { panic!("8 bit") };
    let found = Specimen::find(&image, 16, 8);
    for threads in [1, 3, 8] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| Specimen::find(&image, 16, 8)), found, "{threads} threads");
    }
    // The same in 16 bits, white at the end of the range.
    let scaled = Pixels::U16(levels.iter().map(|&v| u16::from(v) * 256 + u16::from(v == 255) * 255).collect());
    let of_16_bit = Specimen::find(&Image::new(WIDTH, HEIGHT, scaled).unwrap(), 16, 8);
    let [wrong, missed] = wrong_and_missed(&of_16_bit, 12);
    assert!(wrong < 0.025 && missed < 0.03, "{wrong}, {missed}");
}

#[test]
fn the_program_finds_the_zone_writes_it_down_and_has_it_again_without_a_search() {
    let desk = Desk::new();
    desk.image("shots/img_0.png", &strip_with_a_hole([0.0; 2], 21));
    desk.image("shots/img_1.png", &strip_with_a_hole([0.4, -0.3], 22));
    let ran = desk.correlate("--output out --pixel-size 0.02 shots/*.png").fine();
    let line = ran.stderr.lines().find(|line| line.starts_with("zone found:")).unwrap_or_else(|| panic!("{ran}"));
    for said in
        ["% of the image; left out: ", "% without texture", "% saturated", "% at the border of the image", "mesh.png"]
    {
        assert!(line.contains(said), "'{said}' is not said: {line}");
    }
    assert_eq!(desk.remarks("out", Code::BorderBare), [], "{ran}");
    assert!(desk.path("out/figures/mesh.png").is_file() && desk.path("out/zone.png").is_file());
    // Measured is the specimen: no node in the hole or on the dark ground, and those that are move as they should.
    let rows = desk.rows("out/csv/000001.csv");
    assert!(rows.len() > 150, "{}", rows.len());
    for row in &rows {
        let NodeValues { position: [x, y], displacement: [u, v], sigma: [su, sv] } = row.px;
        assert!((x - HOLE.0[0]).hypot(y - HOLE.0[1]) > HOLE.1 - 16.0 && (40.0..280.0).contains(&y), "({x}, {y})");
        // Nodes of elements of which half is left see a fifth of the pixels: five of their standard uncertainties, and
        // the bias of the interpolation on sharp-edged discs.
        let error = (u - 0.4).hypot(v + 0.3);
        assert!(error < 0.02 + 5.0 * su.hypot(sv), "({x}, {y}): {error}");
    }
    let case: toml::Table = desk.read("out/run.toml").parse().unwrap();
    let zones = case["zone"].as_array().unwrap();
    assert_eq!(zones.len(), 1);
    assert!(zones[0]["mask"].as_str().unwrap().ends_with("zone.png"), "{zones:?}");
    assert_eq!(zones[0]["guard_px"].as_float(), Some(3.0));
    // The same command goes on; a run of its record has the same bits; shards find the same zone.
    let again = desk.correlate("--output out --pixel-size 0.02 shots/*.png").fine();
    assert!(again.stderr.contains("nothing is missing"), "{again}");
    let from_record = desk.correlate("--output rerun --case out/run.toml").fine();
    assert!(!from_record.stderr.contains("zone found"), "{from_record}");
    assert_eq!(desk.rows("rerun/csv/000001.csv"), rows);
    for shard in ["1/2", "2/2"] {
        let line = format!("--output shards --pixel-size 0.02 --shard {shard} --start independent shots/*.png");
        desk.correlate(&line);
    }
    assert_eq!(desk.rows("shards/csv/000001.csv"), rows);
}

#[test]
fn a_ground_that_stays_still_behind_the_specimen_becomes_a_zone_of_its_own() {
    let desk = Desk::new();
    let ground = discs(WIDTH, HEIGHT, 2.5, 0.6, [0.0; 2], 5);
    let image = |u: usize, seed: u64| {
        let body = discs(WIDTH, HEIGHT, 2.5, 0.6, [u as f64, 0.0], 6);
        let is_body = |x: usize, y: usize| (100 + u..260 + u).contains(&x) && (90..230).contains(&y);
        shot(WIDTH, HEIGHT, |x, y| if is_body(x, y) { body[y * WIDTH + x] } else { ground[y * WIDTH + x] }, 1.5, seed)
    };
    (0..4).for_each(|k| desk.image(&format!("shots/{k}.png"), &image(3 * k, 40 + k as u64)));
    let ran = desk.correlate("--output out shots/*.png").fine();
    assert!(ran.stderr.contains("what stays still while the rest moves is the zone 'still'"), "{ran}");
    let frame = &desk.json("out/summary.json")["frames"][2];
    let motion = |of: &serde_json::Value| of["rigid_motion"]["translation_px"].clone();
    let of_zone = |k: usize| (frame["zones"][k]["name"].as_str().unwrap(), motion(&frame["zones"][k]));
    let ((specimen, moved), (still, rest)) = (of_zone(0), of_zone(1));
    assert_eq!([specimen, still], ["specimen", "still"]);
    // 50 nodes of some 0.02 px and 250.
    let off = |of: &serde_json::Value, u: f64| (of[0].as_f64().unwrap() - u).hypot(of[1].as_f64().unwrap());
    assert!(off(&moved, 9.0) < 0.03 && off(&rest, 0.0) < 0.02, "{moved} {rest}");
    assert_eq!(motion(frame), moved, "what is still has no part in the motion of a frame");
    // The same command goes on, and the record has the zones.
    let again = desk.correlate("--output out shots/*.png").fine();
    assert!(again.stderr.contains("nothing is missing"), "{again}");
    let from_record = desk.correlate("--output rerun --case out/run.toml").fine();
    assert!(!from_record.stderr.contains("zone found"), "{from_record}");
    assert_eq!(desk.rows("rerun/csv/000003.csv"), desk.rows("out/csv/000003.csv"));
}

#[test]
fn two_halves_that_move_apart_become_two_zones() {
    let desk = Desk::new();
    let image = |k: usize, seed: u64| {
        let halves =
            [[-2.0, 0.5], [3.0, 0.0]].map(|[u, v]| discs(WIDTH, HEIGHT, 2.5, 0.6, [u * k as f64, v * k as f64], 5));
        let half =
            |x: usize| if x < 150 - 2 * k { Some(&halves[0]) } else { Some(&halves[1]).filter(|_| x >= 150 + 3 * k) };
        shot(WIDTH, HEIGHT, |x, y| half(x).map_or(30.0, |half| half[y * WIDTH + x]), 1.5, seed)
    };
    (0..3).for_each(|k| desk.image(&format!("shots/{k}.png"), &image(k, 60 + k as u64)));
    let ran = desk.correlate("--output out shots/*.png").fine();
    assert!(ran.stderr.contains("bodies that move apart are zones of their own, 2 of them"), "{ran}");
    let frame = &desk.json("out/summary.json")["frames"][1];
    assert_eq!(frame["status"], "converged", "{frame}");
    for (k, name, u) in [(0, "specimen1", [-4.0, 1.0]), (1, "specimen2", [6.0, 0.0])] {
        let zone = &frame["zones"][k];
        let moved = &zone["rigid_motion"]["translation_px"];
        assert_eq!(zone["name"], name);
        // Some hundred nodes of 0.02 px.
        let off = (moved[0].as_f64().unwrap() - u[0]).hypot(moved[1].as_f64().unwrap() - u[1]);
        assert!(off < 0.02, "{zone}");
    }
}

#[test]
fn an_image_with_nothing_to_measure_is_refused_with_what_is_there() {
    let desk = Desk::new();
    for k in 0..2 {
        desk.image(&format!("shots/{k}.png"), &shot(128, 96, |_, _| 40.0, 3.0, 30 + k));
    }
    desk.correlate("--output out shots/*.png").refused(&["no zone is named, and none is found", "--roi"]);
}

/// Zones of whole elements at several places of an image.
fn places(width: usize, height: usize) -> Vec<[f64; 4]> {
    let mut dice = Dice(77);
    let mut extent = |n: usize| {
        let length = 16 * (4 + (dice.roll() * ((n - 40) as f64 / 16.0 - 4.0)) as usize);
        let low = 6 + (dice.roll() * (n - 12 - length) as f64) as usize;
        [low as f64, (low + length) as f64]
    };
    (0..12).map(|_| (extent(width), extent(height))).map(|([x0, x1], [y0, y1])| [x0, y0, x1, y1]).collect()
}

#[test]
fn the_warning_of_a_band_is_silent_on_textured_images() {
    let mut n_warned = 0;
    for (radius, density) in [(1.5, 0.6), (2.5, 0.6), (2.5, 0.3), (4.0, 0.8)] {
        let texture = discs(WIDTH, HEIGHT, radius, density, [0.0; 2], 41);
        let image = shot(WIDTH, HEIGHT, |x, y| texture[y * WIDTH + x], 1.5, 42);
        for roi in places(WIDTH, HEIGHT) {
            let options = Options { drop_textureless: true, ..Options::default() };
            n_warned += prepared(&image, &[zone("all", roi)], options).bare_borders().len();
        }
    }
    // Of 48.
    assert!(n_warned <= 1, "{n_warned}");
}

#[test]
fn the_warning_of_a_band_speaks_at_a_dark_joint_also_when_nodes_are_dropped() {
    for (radius, density) in [(1.5, 0.6), (2.5, 0.6), (4.0, 0.8)] {
        let texture = discs(WIDTH, HEIGHT, radius, density, [0.0; 2], 51);
        let grey = |x: usize, y: usize| if (160..176).contains(&y) { 12.0 } else { texture[y * WIDTH + x] };
        let image = shot(WIDTH, HEIGHT, grey, 1.0, 52);
        let upper = zone("upper", [40.0, 64.0, 360.0, 160.0]);
        for drop_textureless in [false, true] {
            let options = Options { drop_textureless, ..Options::default() };
            let found = prepared(&image, std::slice::from_ref(&upper), options).bare_borders().to_vec();
            assert_eq!(found.len(), 1, "discs of {radius} px");
            assert!((256.0..=352.0).contains(&found[0].length_px) && !found[0].is_within, "{found:?}");
            assert!((found[0].at[1] - 160.0).abs() < 1.0, "{found:?}");
        }
        let guarded = [Zone { guard: Guard::All(3.0), ..upper }];
        assert_eq!(prepared(&image, &guarded, Options::default()).bare_borders(), []);
    }
    // A zone over a wide dark joint: its nodes are dropped, and the borders that this makes inside are told.
    let texture = discs(WIDTH, HEIGHT, 2.5, 0.6, [0.0; 2], 53);
    let grey = |x: usize, y: usize| if (140..190).contains(&y) { 12.0 } else { texture[y * WIDTH + x] };
    let image = shot(WIDTH, HEIGHT, grey, 1.0, 54);
    let options = Options { drop_textureless: true, ..Options::default() };
    let correlator = prepared(&image, &[zone("all", [40.0, 32.0, 360.0, 288.0])], options);
    assert!(correlator.dropped().len() > 20);
    let found = correlator.bare_borders();
    assert!(found.iter().any(|border| border.is_within && border.length_px > 300.0), "{found:?}");
}

#[test]
fn a_place_that_only_looked_textured_is_left_out_when_the_residual_shows_the_noise() {
    // A quiet dark border makes the noise of the reference seem small; a smooth spot holds nothing but the noise of
    // bright places, which is then taken for texture.
    let texture = [discs(WIDTH, HEIGHT, 3.0, 0.6, [0.0; 2], 61), discs(WIDTH, HEIGHT, 3.0, 0.6, [1.0, 2.0], 61)];
    let spot = |x: usize, y: usize| (160..240).contains(&x) && (130..210).contains(&y);
    let is_quiet = |x: usize, y: usize| y < 40 || x < 30;
    let [reference, deformed] = [0, 1].map(|k| {
        let mut dice = Dice(62 + k as u64);
        let level = |at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            let (grey, noise) = match () {
                () if is_quiet(x, y) => (10.0, 0.4),
                () if spot(x, y) => (150.0, 9.0),
                () => (texture[k][at], 9.0),
            };
            (grey + noise * dice.normal()).round().clamp(0.0, 255.0) as u8
        };
        let levels = (0..WIDTH * HEIGHT).map(level).collect();
        Arc::new(Image::new(WIDTH, HEIGHT, Pixels::U8(levels)).unwrap())
    });
    let correlator = prepared(&reference, &[zone("all", [48.0, 64.0, 368.0, 304.0])], Options::default());
    assert!(correlator.dropped().is_empty(), "{:?}", correlator.dropped());
    let result = correlator.correlate(deformed, None).unwrap();
    let field = &result.measurement;
    let at = |node: usize| field.mesh.nodes()[node];
    // A node sees 16 px around it.
    let is_deep = |x: [f64; 2]| (176.0..=224.0).contains(&x[0]) && (146.0..=194.0).contains(&x[1]);
    let is_far = |x: [f64; 2]| !(144.0..=256.0).contains(&x[0]) || !(114.0..=226.0).contains(&x[1]);
    let lost: Vec<[f64; 2]> = (0..field.mesh.n_nodes()).filter(|&node| !field.measured[node]).map(at).collect();
    // Some go with elements that do not match, the others by this rule.
    assert!((1..=lost.len()).contains(&result.nodes_in_noise), "{} of {lost:?}", result.nodes_in_noise);
    let n_deep = (0..field.mesh.n_nodes()).filter(|&node| is_deep(at(node))).count();
    let n_lost_deep = lost.iter().filter(|&&x| is_deep(x)).count();
    assert!(n_deep >= 9 && n_lost_deep == n_deep, "{n_lost_deep} of {n_deep}: {lost:?}");
    // Nodes of the spot that find no rest pull others along, two steps away at most.
    let is_farther = |x: [f64; 2]| !(112.0..=288.0).contains(&x[0]) || !(82.0..=258.0).contains(&x[1]);
    let n_pulled = lost.iter().filter(|&&x| is_far(x)).count();
    assert!(n_pulled <= 4 && !lost.iter().any(|&x| is_farther(x)), "{lost:?}");
}

#[test]
fn no_node_of_a_textured_zone_is_lost_in_the_noise_of_the_residual() {
    let texture = [discs(WIDTH, HEIGHT, 2.5, 0.6, [0.0; 2], 71), discs(WIDTH, HEIGHT, 2.5, 0.6, [0.3, -0.2], 71)];
    for noise in [0.0, 2.0, 6.0] {
        let [reference, deformed] =
            [0, 1].map(|k| shot(WIDTH, HEIGHT, |x, y| texture[k][y * WIDTH + x], noise, 72 + k as u64));
        let correlator = prepared(&reference, &[zone("all", [16.0, 16.0, 384.0, 304.0])], Options::default());
        let result = correlator.correlate(deformed, None).unwrap();
        assert_eq!(result.nodes_in_noise, 0, "noise {noise}");
    }
}

#[test]
fn holes_and_triangles_of_real_images_are_left_out() {
    if let Some(folder) = data::folder("dicchallenge-s12-openhole") {
        let image = read_image(&folder.join("oht_cfrp_00.tiff"), 0).unwrap().image;
        let found = Specimen::find(&image, 16, 8);
        assert_eq!(found.parts.len(), 1);
        let part = &found.parts[0];
        let in_hole = |x: usize, y: usize| (x as f64 - 192.5).hypot(y as f64 - 541.4) < 46.0;
        for (x, y) in (0..1040).flat_map(|y| (0..400).map(move |x| (x, y))).filter(|&(x, y)| part.contains(x, y)) {
            // The strip lies between x = 38 and 354.
            assert!(!in_hole(x, y) && (34..=358).contains(&x), "({x}, {y})");
        }
        assert!(found.share(&image) > 0.7, "{}", found.share(&image));
    }
    if let Some(folder) = data::folder("crack-heterogeneous") {
        let image = read_image(&folder.join("img_0000.tif"), 0).unwrap().image;
        let found = Specimen::find(&image, 16, 8);
        assert_eq!(found.parts.len(), 1);
        let part = &found.parts[0];
        // The black triangles are 0 to the last pixel; the notch and the speckles are not.
        let (width, height) = (image.width(), image.height());
        let is_black = |x: usize, y: usize| {
            (x.saturating_sub(2)..(x + 3).min(width))
                .all(|x| (y.saturating_sub(2)..(y + 3).min(height)).all(|y| image.grey(x, y) == 0.0))
        };
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        assert!(!pixels.filter(|&(x, y)| part.contains(x, y)).any(|(x, y)| is_black(x, y)));
        // The plate, not the loading blocks: x from about 225 on.
        assert!((0.6..0.7).contains(&found.share(&image)), "{}", found.share(&image));
        assert!(!part.contains(100, 300) && !part.contains(100, 900) && part.contains(500, 600));
    }
}
