//! Maps of fields over the image: what must be in the picture, in every shape of image.
//!
//! The pictures stay in `target/tmp/maps`, to be looked at.

#![cfg(feature = "report")]

use crate::common::blobs;
use blobs::{speckle, uniform};
use quadrille::field::{Measurement, Status};
use quadrille::imaging::{Image, Levels, Pixels};
use quadrille::mesh::{Mesh, Roi, Zone};
use quadrille::report::{Area, MapOptions, Palette, Picture, ReportError, element_map, nodal_map};
use quadrille::units::Px;
use std::path::PathBuf;

fn folder() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("maps");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

fn measurement(rois: &[Roi], size: usize, image: &Image) -> Measurement<Px> {
    let zone = |(k, &roi): (usize, &Roi)| Zone::rectangle(format!("zone {k}"), roi);
    let zones: Vec<Zone> = rois.iter().enumerate().map(zone).collect();
    let mesh = Mesh::on_zones(&zones, size, image.width(), image.height()).unwrap();
    Measurement {
        status: Status::Converged,
        displacement: vec![[0.0; 2]; mesh.n_nodes()],
        sigma: vec![[0.0; 2]; mesh.n_nodes()],
        measured: vec![true; mesh.n_nodes()],
        element_residual: vec![0.0; mesh.n_elements()],
        model_error: None,
        marks: None,
        points: None,
        mesh: mesh.into(),
    }
}

fn roi(x0: f64, y0: f64, x1: f64, y1: f64) -> Roi {
    Roi { x0, y0, x1, y1 }
}

fn inner(image: &Image, margin: f64) -> Roi {
    roi(margin, margin, image.width() as f64 - margin, image.height() as f64 - margin)
}

/// A field from `low` to `high` along the diagonal of the mesh.
fn ramp(measurement: &Measurement<Px>, low: f64, high: f64) -> Vec<f64> {
    let along = |p: &[f64; 2]| p[0] + p[1];
    let nodes = measurement.mesh.nodes();
    let (from, to) = nodes.iter().map(along).fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
    nodes.iter().map(|p| low + (high - low) * (along(p) - from) / (to - from)).collect()
}

fn inside(area: Area, x: u32, y: u32) -> bool {
    (area.x..area.x + area.width).contains(&x) && (area.y..area.y + area.height).contains(&y)
}

fn colours(picture: &Picture, area: Area) -> impl Iterator<Item = [u8; 3]> + '_ {
    (area.y..area.y + area.height)
        .flat_map(move |y| (area.x..area.x + area.width).map(move |x| picture.pixel(x, y).unwrap()))
}

fn is_grey([r, g, b]: [u8; 3]) -> bool {
    r == g && g == b
}

/// What holds for every picture; saves it under `name`.
#[track_caller]
fn check(name: &str, picture: &Picture) {
    let (width, height, map) = (picture.width(), picture.height(), picture.map_area());
    let path = folder().join(format!("{name}.png"));
    picture.save(&path).unwrap();
    let read = image::open(&path).unwrap().into_rgb8();
    assert_eq!((read.width(), read.height()), (width, height), "{name}");
    assert_eq!(read.as_raw(), picture.rgb(), "{name}: the file does not hold the picture");
    assert_eq!(map.width.max(map.height), 900, "{name}");
    for y in 0..height {
        for x in 0..width {
            // A clipped label would leave ink on the border.
            if x < 4 || y < 4 || x + 4 >= width || y + 4 >= height {
                assert_eq!(picture.pixel(x, y).unwrap(), [255; 3], "{name}: ink at the border, ({x}, {y})");
            }
        }
    }
    if let Some(bar) = picture.bar_area() {
        assert!(bar.width.max(bar.height) >= 500 && bar.width.min(bar.height) >= 16, "{name}: squashed bar {bar:?}");
        let apart = bar.x >= map.x + map.width || bar.y >= map.y + map.height;
        assert!(apart, "{name}: the bar {bar:?} covers the image {map:?}");
        assert!(bar.x + bar.width < width && bar.y + bar.height < height, "{name}");
    }
}

/// The colours at the lower and the upper end of the bar.
#[track_caller]
fn bar_ends(picture: &Picture) -> [[u8; 3]; 2] {
    let bar = picture.bar_area().unwrap();
    let (right, bottom) = (bar.x + bar.width - 1, bar.y + bar.height - 1);
    let ends =
        if bar.width > bar.height { [(bar.x, bar.y), (right, bar.y)] } else { [(bar.x, bottom), (bar.x, bar.y)] };
    ends.map(|(x, y)| picture.pixel(x, y).unwrap())
}

#[test]
fn fields_are_drawn_over_images_of_every_shape_and_scale_of_values() {
    let cases = [
        ("square", 1000, 1000, 16, -0.42, 1.37),
        ("wide", 3000, 300, 32, -0.000123, 0.000087),
        ("tall", 300, 3000, 32, 12345.6, 12345.9),
        ("flat", 2000, 24, 8, -12345.6, 9876.5),
        ("thin", 24, 2000, 8, -1e-9, 2.5e-9),
        ("small", 48, 32, 8, 0.0, 1.0),
        ("four_to_three", 1600, 1200, 16, -3.2, 7.9),
    ];
    for (name, width, height, size, low, high) in cases {
        let image = speckle(width, height);
        let measurement = measurement(&[inner(&image, size as f64 / 2.0)], size, &image);
        let options = MapOptions::new(format!("Frame 7: displacement along x, {name}"), "Displacement along x (px)");
        let picture = nodal_map(&image, &measurement, &ramp(&measurement, low, high), &options).unwrap();
        check(name, &picture);
        let coloured = colours(&picture, picture.map_area()).filter(|&c| !is_grey(c)).count();
        let area = (picture.map_area().width * picture.map_area().height) as usize;
        assert!(3 * coloured > area, "{name}: only {coloured} of {area} pixels show the field");
    }
}

#[test]
fn the_ends_of_the_bar_are_the_colours_of_the_extreme_values() {
    let image = uniform(640, 480, 90);
    let measurement = measurement(&[inner(&image, 16.0)], 16, &image);
    let n = measurement.mesh.n_elements();
    for palette in [Palette::Viridis, Palette::Plasma, Palette::Cividis] {
        let values: Vec<f64> = (0..n).map(|e| e as f64 / n as f64).collect();
        let options = MapOptions { palette, ..MapOptions::new("Residual", "Residual (% of the dynamic range)") };
        let picture = element_map(&image, &measurement, &values, &options).unwrap();
        check(&format!("residual_{palette:?}").to_lowercase(), &picture);
        let [low, high] = bar_ends(&picture);
        assert_ne!(low, high);
        for end in [low, high] {
            assert!(colours(&picture, picture.map_area()).any(|c| c == end), "{palette:?}: {end:?} is not in the map");
        }
    }
}

#[test]
fn values_are_bilinear_inside_an_element() {
    let image = uniform(64, 64, 128);
    let measurement = measurement(&[roi(-0.5, -0.5, 63.5, 63.5)], 64, &image);
    let options = MapOptions { opacity: 1.0, ..MapOptions::new("One element", "u (px)") };
    let picture = nodal_map(&image, &measurement, &[0.0, 1.0, 1.0, 2.0], &options).unwrap();
    check("one_element", &picture);
    let map = picture.map_area();
    // Picture pixel (i, j) is centred on the local coordinates ((i + 1/2)/900, (j + 1/2)/900).
    for (i, j) in [(0, 0), (899, 0), (450, 450), (120, 700), (899, 899)] {
        let [xi, eta] = [i, j].map(|k| (f64::from(k) + 0.5) / 900.0);
        // Nodes (0,0), (1,0), (0,1), (1,1) hold 0, 1, 1, 2: the field is xi + eta.
        let want = Palette::Viridis.colour((xi + eta) / 2.0);
        assert_eq!(picture.pixel(map.x + i, map.y + j), Some(want), "({i}, {j})");
    }
}

#[test]
fn what_was_not_measured_shows_the_image() {
    let image = speckle(800, 600);
    let rois = [roi(40.0, 40.0, 760.0, 270.0), roi(40.0, 330.0, 760.0, 560.0)];
    let mut measurement = measurement(&rois, 16, &image);
    let hole = |p: [f64; 2]| (p[0] - 300.0).hypot(p[1] - 150.0) < 60.0;
    for (node, &position) in measurement.mesh.nodes().iter().enumerate() {
        measurement.measured[node] = !hole(position);
    }
    let mut values = ramp(&measurement, -1.0, 2.0);
    values[measurement.mesh.n_nodes() - 1] = f64::NAN; // the last element is transparent too
    let options = MapOptions::new("Two zones, a hole", "Displacement along y (px)");
    let picture = nodal_map(&image, &measurement, &values, &options).unwrap();
    check("two_zones", &picture);
    let map = picture.map_area();
    let scale = f64::from(map.width) / 800.0;
    let at =
        |x: f64, y: f64| picture.pixel(map.x + ((x + 0.5) * scale) as u32, map.y + ((y + 0.5) * scale) as u32).unwrap();
    for (x, y) in [(300.0, 150.0), (340.0, 150.0), (10.0, 10.0), (400.0, 300.0), (755.0, 550.0)] {
        assert!(is_grey(at(x, y)), "({x}, {y}) px: {:?}", at(x, y));
    }
    for (x, y) in [(50.0, 50.0), (600.0, 150.0), (400.0, 340.0), (720.0, 520.0)] {
        assert!(!is_grey(at(x, y)), "({x}, {y}) px: {:?}", at(x, y));
    }
    // The grey levels there are those of the image alone.
    measurement.measured.fill(false);
    let bare = nodal_map(&image, &measurement, &values, &options).unwrap();
    let bare_map = bare.map_area();
    for (x, y) in [(100u32, 20u32), (450, 340)] {
        assert_eq!(picture.pixel(map.x + x, map.y + y), bare.pixel(bare_map.x + x, bare_map.y + y));
    }
}

#[test]
fn a_constant_field_has_the_colour_of_the_middle_of_its_bar() {
    let image = uniform(400, 300, 128);
    let measurement = measurement(&[inner(&image, 20.0)], 20, &image);
    for (name, value) in [("constant", 3.7), ("zero", 0.0), ("negative", -12345.6)] {
        let options = MapOptions { opacity: 1.0, ..MapOptions::new("Constant", "u (px)") };
        let values = vec![value; measurement.mesh.n_nodes()];
        let picture = nodal_map(&image, &measurement, &values, &options).unwrap();
        check(&format!("constant_{name}"), &picture);
        let middle = Palette::Viridis.colour(0.5);
        let near = |c: [u8; 3]| c.iter().zip(middle).all(|(&a, b)| a.abs_diff(b) <= 1); // rounding of 1/2
        let coloured: Vec<_> = colours(&picture, picture.map_area()).filter(|&c| !is_grey(c)).collect();
        assert!(!coloured.is_empty() && coloured.into_iter().all(near), "{name}");
    }
}

#[test]
fn a_field_without_a_measured_node_says_so_and_has_no_bar() {
    for (name, width, height) in [("square", 500, 500), ("tall", 60, 3000), ("flat", 3000, 60)] {
        let image = speckle(width, height);
        let mut measurement = measurement(&[inner(&image, 8.0)], 16, &image);
        measurement.measured.fill(false);
        let values = vec![0.0; measurement.mesh.n_nodes()];
        let options = MapOptions { range: Some((0.0, 1.0)), ..MapOptions::new("Lost frame", "u (px)") };
        let picture = nodal_map(&image, &measurement, &values, &options).unwrap();
        check(&format!("nothing_{name}"), &picture);
        assert_eq!(picture.bar_area(), None);
        assert!(colours(&picture, picture.map_area()).all(is_grey));
        // The note is the only coloured ink, above the image.
        let top = Area { x: 0, y: 0, width: picture.width(), height: picture.map_area().y };
        assert!(colours(&picture, top).filter(|&c| !is_grey(c)).count() > 100, "{name}");
    }
}

#[test]
fn values_beyond_the_range_asked_for_take_the_colour_of_its_end() {
    for (name, width, height) in [("beyond_wide", 900, 300), ("beyond_tall", 300, 400)] {
        let image = uniform(width, height, 128);
        let measurement = measurement(&[inner(&image, 10.0)], 10, &image);
        let options = MapOptions { range: Some((-0.2, 0.3)), ..MapOptions::new("Clipped", "u (px)") };
        let picture = nodal_map(&image, &measurement, &ramp(&measurement, -1.0, 1.0), &options).unwrap();
        check(name, &picture);
        for end in bar_ends(&picture) {
            let n = colours(&picture, picture.map_area()).filter(|&c| c == end).count();
            assert!(n > 10_000, "{name}: {n} pixels of {end:?}");
            // The tip of the bar has the colour too.
            let bar = picture.bar_area().unwrap();
            let all = Area { x: 0, y: 0, width: picture.width(), height: picture.height() };
            let outside = (0..all.height).flat_map(|y| (0..all.width).map(move |x| (x, y))).filter(|&(x, y)| {
                !inside(bar, x, y) && !inside(picture.map_area(), x, y) && picture.pixel(x, y) == Some(end)
            });
            assert!(outside.count() > 50, "{name}: no tip of {end:?}");
        }
    }
}

#[test]
fn long_texts_are_broken_or_shortened_and_never_clipped() {
    let word = "a_file_name_without_any_blank_".repeat(8);
    let title = format!("A title that is far too long for one line above so narrow a picture, of {word}\n(2)");
    for (name, width, height) in [("long_wide", 900, 60), ("long_tall", 60, 900)] {
        let image = speckle(width, height);
        let measurement = measurement(&[inner(&image, 8.0)], 8, &image);
        let options = MapOptions::new(&title, "Displacement along x (px), ".repeat(9));
        let picture = nodal_map(&image, &measurement, &ramp(&measurement, 0.0, 1.0), &options).unwrap();
        check(name, &picture);
    }
    let image = speckle(60, 60);
    let measurement = measurement(&[inner(&image, 8.0)], 8, &image);
    check(
        "no_text",
        &nodal_map(&image, &measurement, &ramp(&measurement, 0.0, 1.0), &MapOptions::new("", "")).unwrap(),
    );
}

#[test]
fn the_smallest_images_are_drawn_too() {
    for (width, height) in [(5, 5), (1200, 5), (5, 1200)] {
        let image = speckle(width, height);
        let measurement = measurement(&[roi(0.0, 0.0, 4.0, 4.0)], 4, &image);
        let picture =
            nodal_map(&image, &measurement, &[0.0, 1.0, 2.0, 3.0], &MapOptions::new("Tiny", "u (px)")).unwrap();
        check(&format!("tiny_{width}x{height}"), &picture);
    }
}

#[test]
fn grey_levels_of_any_depth_give_the_same_picture() {
    let image = speckle(200, 150);
    let measurement = measurement(&[inner(&image, 10.0)], 10, &image);
    let values = ramp(&measurement, 0.0, 1.0);
    let draw = |pixels| {
        let image = Image::new(200, 150, pixels).unwrap();
        nodal_map(&image, &measurement, &values, &MapOptions::new("Depth", "u (px)")).unwrap()
    };
    let Levels::U8(grey) = image.pixels() else { unreachable!() };
    let want = draw(Pixels::U8(grey.to_vec()));
    // Powers of two: the same numbers but for the exponent.
    assert_eq!(draw(Pixels::U16(grey.iter().map(|&v| u16::from(v) * 256).collect())), want);
    assert_eq!(draw(Pixels::F32(grey.iter().map(|&v| f32::from(v) / 1024.0).collect())), want);
}

#[test]
fn the_same_field_gives_the_same_bytes() {
    let image = speckle(500, 400);
    let measurement = measurement(&[inner(&image, 16.0)], 16, &image);
    let png = || {
        let values = ramp(&measurement, -1.0, 1.0);
        let mut bytes = Vec::new();
        let picture = nodal_map(&image, &measurement, &values, &MapOptions::new("Twice", "u (px)")).unwrap();
        picture.write_png(&mut bytes).unwrap();
        bytes
    };
    assert_eq!(png(), png());
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let image = uniform(64, 64, 1);
    let measurement = measurement(&[inner(&image, 0.0)], 16, &image);
    let options = MapOptions::new("", "");
    let (nodes, elements) = (measurement.mesh.n_nodes(), measurement.mesh.n_elements());
    let error = nodal_map(&image, &measurement, &vec![0.0; elements], &options).unwrap_err();
    assert!(matches!(error, ReportError::Length { what: "nodes", .. }));
    let error = element_map(&image, &measurement, &vec![0.0; nodes], &options).unwrap_err();
    assert!(matches!(error, ReportError::Length { what: "elements", .. }));
    for (low, high) in [(1.0, 1.0), (2.0, 1.0), (f64::NAN, 1.0), (0.0, f64::INFINITY), (f64::MIN, f64::MAX)] {
        let options = MapOptions { range: Some((low, high)), ..options.clone() };
        let error = nodal_map(&image, &measurement, &vec![0.0; nodes], &options).unwrap_err();
        assert!(matches!(error, ReportError::Range { .. }), "{low} to {high}");
    }
    let picture = nodal_map(&image, &measurement, &vec![0.0; nodes], &options).unwrap();
    let error = picture.save(folder().join("no such folder/map.png")).unwrap_err();
    assert!(matches!(error, ReportError::Write { .. }) && error.to_string().contains("map.png"));
    // A slice without room stands for a full disk.
    let error = picture.write_png(&mut [][..]).unwrap_err();
    assert!(matches!(error, ReportError::Encode(_)));
}
